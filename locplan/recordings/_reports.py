"""Evaluations, calibrations and replays of recorded drives as tables for people, and as files."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from locplan._util.files import replacing
from locplan._util.formats import in_degrees, in_metres, in_percent, with_unit
from locplan._util.intervals import Interval
from locplan._util.results import ResultFolder, digest_of
from locplan._util.tables import REPORT_WIDTH, table, write_json, write_rows
from locplan.errors import LocplanError
from locplan.field import position_axes, save_config
from locplan.recordings._calibration import ALPHAS, DriveCalibration
from locplan.recordings._evaluation import DriveEvaluation
from locplan.recordings._replay import WITHIN, Replay
from locplan.recordings._verdict import agreement_texts
from locplan.simulation import PROFILE_COLUMNS, check_calibration

ZERO = 2e-5
"""Value below which 0 is shown."""
ROWS = (
    ("odometry: drift of the distance", "distance_drift", "m/√m"),
    ("odometry: drift of the heading", "heading_drift_deg", "deg/√m"),
    ("odometry: drift in turns", "turn_drift_deg", "deg/√rad"),
    ("odometry: bias of distances", "distance_bias", ""),
    ("odometry: bend to one side", "heading_bias_deg", "deg/m"),
    ("odometry: bias of turns", "turn_bias", ""),
    ("recorded poses: noise of the position", "position_noise", "m"),
    ("recorded poses: noise of the heading", "heading_noise_deg", "deg"),
)
COLUMNS = (
    *("scan", "time_s", "x_m", "y_m", "heading_rad", "judged", "outdated", "score"),
    *("returns", "offset_x_m", "offset_y_m", "offset_heading_rad"),
    *("major_std_m", "minor_std_m", "major_axis_rad", "heading_std_rad", "ambiguity"),
)
"""Columns of scans.csv; two more for each estimator."""


def drive_table(found: DriveEvaluation) -> str:
    """The drive, the agreement of each estimator, and the verdict."""
    matches, some = found.matches, found.compared
    low, middle, high = 100 * np.quantile(matches.position_std[some], (0.1, 0.5, 0.9))
    apart = int(found.outdated.sum())
    left = len(matches) - int(some.sum()) - apart
    rows = [
        ("map", matches.grid.name),
        ("drive", repr(matches.recording)),
        ("scans compared", f"{some.sum()} of {len(matches)}"),
        ("set apart", f"{apart} that saw what is not on the map, {left} off the free space"),
        ("deviation", f"median {middle:.1f} cm, 10 to 90 %: {low:.1f} to {high:.1f} cm"),
    ]
    columns = ["", "rank correlation", "AUC", "direction", "factor"]
    estimators = [[name, *agreement_texts(each)] for name, each in found.agreements.items()]
    said = textwrap.fill(" ".join(found.verdict), REPORT_WIDTH, break_on_hyphens=False)
    about = (
        "predicted against measured deviations of the position [95 % intervals, stretches of 10 m];"
        "\nAUC: for the worst fifth; direction: share of long ellipses right to 15 deg; factor:"
        " predicted\nover measured"
    )
    return "\n".join([table([], rows), table(columns, estimators), about, said])


def write_drive(results: ResultFolder, found: DriveEvaluation) -> list[Path]:
    """Write drive.json, drive.png, and scans.csv with a row per scan."""
    from locplan.plotting import save_figure
    from locplan.recordings import _figures

    matches, drive = found.matches, found.matches.recording
    major, minor, direction = position_axes(matches.covariance)
    values = [
        np.arange(len(drive)),
        np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0],
        *drive.poses.T,
        matches.judged,
        found.outdated,
        matches.score,
        matches.returns,
        *matches.best.T,
        major,
        minor,
        direction,
        np.sqrt(matches.covariance[:, 2, 2]),
        matches.ambiguity,
    ]
    columns = list(COLUMNS)
    for name, covariance in found.predicted.items():
        own, _, towards = position_axes(covariance)
        values += [own, towards]
        columns += [f"{name}_major_std_m", f"{name}_major_axis_rad"]
    with results.writing() as folder:
        picture, about, scans = (folder / name for name in DriveEvaluation.files.names)
        save_figure(_figures.drive_figure(found), picture)
        write_json(about, found.summary())
        write_rows(scans, columns, np.column_stack(values).astype(float).tolist())
    return [results.folder / name for name in DriveEvaluation.files.names]


def replay_table(replay: Replay) -> str:
    """Table of the errors against the recorded poses, and of the filter's consistency."""
    drives, found = replay.drives, replay.consistency
    within = found.within
    share = f"{within.value:.0%}" if np.isnan(within.low) else in_percent(within)
    of_filter = [
        (f"within the {WITHIN:.0%} ellipse", share),
        ("rms deviation by the filter", in_metres(found.filter_std)),
    ]
    rows = [
        ("map", replay.grid.name),
        ("drive", repr(replay.recording)),
        ("runs", f"{len(replay.errors)}, each of {found.updates} updates"),
        ("median error", with_unit(drives.median_error, "m")),
        ("lost (> 1 m at any time)", in_percent(drives.lost_rate)),
        ("RMSE of those not lost", with_unit(drives.kept_rmse, "m")),
        ("RMSE of all", with_unit(drives.rmse, "m")),
        ("RMSE at the end", with_unit(drives.final_rmse, "m")),
        ("heading RMSE", with_unit(in_degrees(drives.heading_rmse), "deg")),
        *(of_filter if found.updates else ()),
        *(("note", note) for note in replay.notes),
    ]
    about = (
        "errors against the recorded positions [95 % intervals over runs, of the ellipse by"
        f" stretches of\n10 m]; with {replay.robot.title}"
    )
    said = textwrap.fill(replay.verdict, REPORT_WIDTH, break_on_hyphens=False)
    return "\n".join([table([], rows), about, said])


def write_replay(results: ResultFolder, replay: Replay) -> list[Path]:
    """Write replay.json, replay.png, and errors.csv with the errors along the drive.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.recordings import _figures

    with results.writing() as folder:
        picture, about, errors = (folder / name for name in Replay.files.names)
        save_figure(_figures.replay_figure(replay), picture)
        write_json(about, replay.summary())
        rows = np.column_stack([replay.drives.profile(), replay.filter_std])
        write_rows(errors, [*PROFILE_COLUMNS, "filter_std_m"], rows.tolist())
    return [results.folder / name for name in Replay.files.names]


def drive_calibration_table(found: DriveCalibration) -> str:
    """Table of what was fitted, with units and intervals."""
    rows = [["drive", repr(found.recording), ""]]
    if (field := found.field) is not None:
        name = field.config.estimator.name
        rows += [
            [f"noise level k of {name}", *_with(field.noise_level, "")],
            ["typically off by a factor", f"{field.factor:.2f}", ""],
        ]
    scans = found.scans
    rows += [
        ["scatter of the ranges", *_with(scans.range_sigma, "m")],
        ["outliers", *_with(scans.outliers, "", 100)],
        ["beams that are blocked", *_with(scans.blocked, "", 100)],
        ["scans with an object in view", *_with(scans.occlusion, "", 100)],
        ["angle of this object", *_with(scans.occlusion_deg, "deg")],
    ]
    if (odometry := found.odometry) is not None:
        rows += [[name, *_with(getattr(odometry, name), "")] for name in ALPHAS]
        rows += [[text, *_with(getattr(odometry, name), unit)] for text, name, unit in ROWS]
    rows += [["note", note, ""] for note in found.notes]
    lines = [table(["", "value", "95 %"], rows)]
    if found.field and not found.field.in_metres:
        lines.append(found.field.warning)
    return "\n".join(lines)


def _with(interval: Interval, unit: str, percent: float = 0) -> tuple[str, str]:
    """Texts of a value with its unit, and of its interval."""
    unit = "%" if percent else unit
    factor = percent or 1.0
    value, low, high = (f"{0 if abs(each) < ZERO else factor * each:.3g}" for each in interval)
    return f"{value} {unit}".rstrip(), "" if np.isnan(interval.low) else f"{low} to {high}"


def write_drive_calibration(
    target: Path, found: DriveCalibration, *, force: bool = False
) -> list[Path]:
    """Write the settings as `locplan.field.save_config` does, with those of simulated robots.

    If the noise level was fitted, a picture of the fit stands beside them.

    Raises
    ------
    LocplanError
        If a file cannot be written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import calibration_figure

    picture = check_calibration(target, force=force)
    field = found.field
    verdict = field.verdict if field else {"in_metres": False, "why": found.notes[-1]}
    robot = found.robot.summary()
    about = {"robot": robot, **verdict, "calibration": found.summary()}
    if field is None:
        with replacing(target) as settings:
            save_config(settings, found.config, **about)
        return [target]
    with replacing(picture) as drawn, replacing(target) as settings:
        try:
            figure = calibration_figure(field)
            figure.axes[0].set_ylabel("rms deviation by the recorded scan's posterior [m]")
            save_figure(figure, drawn)
            save_config(settings, found.config, **about, picture=digest_of(drawn))
        except LocplanError as error:  # it names the files' last places
            text = str(error).replace(str(drawn), str(picture)).replace(str(settings), str(target))
            raise type(error)(text) from None
    return [target, picture]

"""Evaluations, calibrations and replays of recorded drives as tables for people, and as files."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from locplan._util.files import replacing
from locplan._util.intervals import Interval, in_metres, in_percent
from locplan._util.records import Table
from locplan._util.results import digest_of
from locplan._util.tables import REPORT_WIDTH, table
from locplan.errors import LocplanError
from locplan.field import save_config
from locplan.recordings._agreement import agreement_texts
from locplan.recordings._calibration import ALPHAS, DriveCalibration
from locplan.recordings._evaluation import DriveEvaluation
from locplan.recordings._replay import WITHIN, Replay
from locplan.simulation import DRIVEN, check_calibration

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


def drive_report(found: DriveEvaluation) -> str:
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


def replay_report(replay: Replay) -> str:
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
        *Table.of(DRIVEN, [drives]).turned(),
        *(of_filter if found.updates else ()),
        *(("note", note) for note in replay.notes),
    ]
    about = (
        "errors against the recorded positions [95 % intervals over runs, of the ellipse by"
        f" stretches of\n10 m]; with {replay.robot.title}"
    )
    said = textwrap.fill(replay.verdict, REPORT_WIDTH, break_on_hyphens=False)
    return "\n".join([table([], rows), about, said])


def drive_calibration_report(found: DriveCalibration) -> str:
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

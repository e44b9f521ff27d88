"""Calibrations by recorded drives: a table for people, and the file of settings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from locplan._util.files import replacing
from locplan._util.intervals import Interval
from locplan._util.results import digest_of
from locplan._util.tables import table
from locplan.errors import LocplanError
from locplan.field import save_config
from locplan.recordings._calibration import ALPHAS, DriveCalibration
from locplan.simulation import check_calibration

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

"""A field, a filter and disturbances calibrated by a recorded drive.

A field's noise level is the one at which it predicts the deviations measured along the drive.
"""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.checks import file_path, instance
from locplan._util.intervals import Interval
from locplan._util.progress import ProgressCallback, parts
from locplan._util.tables import finite, table
from locplan.errors import CalibrationError
from locplan.field import Estimator, FieldConfig, Fused, config_of
from locplan.maps import OccupancyGrid, check_grid
from locplan.recordings._evaluation import evaluate_drive
from locplan.recordings._odometry_noise import MIN_UPDATES, OdometryNoise, odometry_noise
from locplan.recordings._recording import Recording
from locplan.recordings._scan_noise import ScanNoise, scan_noise
from locplan.robots import Lidar, Robot
from locplan.simulation import Calibration, calibrate_moments, write_calibration


@dataclass(frozen=True, eq=False, repr=False)
class DriveCalibration:
    """What a recorded drive says of a robot: for fields, for its filter, and for simulations."""

    recording: Recording
    """The drive."""
    config: FieldConfig
    """Settings of the field, with the fitted noise level and the range noise of its lidar."""
    field: Calibration | None
    """Fit of the noise level; None if the drive does not determine it."""
    scans: ScanNoise
    """Noise of the scans."""
    odometry: OdometryNoise | None
    """Noise of odometry; None where the drive has none, or is too short."""
    robot: Robot
    """The robot with the recording's lidar and all that was fitted but the alphas, which are those
    of the odometry."""
    notes: tuple[str, ...]
    """What limits the calibration, in sentences without a full stop."""

    def __repr__(self) -> str:
        level = f"k {self.field.noise_level.value:.3g}, " if self.field else ""
        return f"DriveCalibration({level}{self.recording!r})"

    def report(self) -> str:
        """Text for people: what was fitted, with units and intervals."""
        rows = [["drive", repr(self.recording), ""]]
        if (field := self.field) is not None:
            name = field.config.estimator.name
            rows += [
                [f"noise level k of {name}", *_texts(field.noise_level, "")],
                ["typically off by a factor", f"{field.factor:.2f}", ""],
            ]
        rows += [
            ["scatter of the ranges", *_texts(self.scans.range_sigma, "m")],
            ["outliers", *_texts(self.scans.outliers, "%")],
            ["beams that are blocked", *_texts(self.scans.blocked, "%")],
            ["scans with an object in view", *_texts(self.scans.occlusion, "%")],
            ["angle of this object", *_texts(self.scans.occlusion_deg, "deg")],
        ]
        rows += [
            [text, *_texts(getattr(self.odometry, name), unit)]
            for text, name, unit in (
                *((f"alpha{n}", f"alpha{n}", "") for n in range(1, 5)),
                ("odometry: drift of the distance", "distance_drift", "m/√m"),
                ("odometry: drift of the heading", "heading_drift_deg", "deg/√m"),
                ("odometry: drift in turns", "turn_drift_deg", "deg/√rad"),
                ("odometry: bias of distances", "distance_bias", ""),
                ("odometry: bend to one side", "heading_bias_deg", "deg/m"),
                ("odometry: bias of turns", "turn_bias", ""),
                ("recorded poses: noise of the position", "position_noise", "m"),
                ("recorded poses: noise of the heading", "heading_noise_deg", "deg"),
            )
            if self.odometry is not None
        ]
        rows += [["note", note, ""] for note in self.notes]
        text = table(["", "value", "95 %"], rows)
        return text if field is None or field.in_metres else f"{text}\n{field.warning}"

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
        """Write the settings as `locplan.field.save_config` does, with those of simulated robots.

        If the noise level was fitted, a picture of the fit stands beside them.

        Parameters
        ----------
        path : path
            The file, which ends in .json.
        force : bool, default False
            True replaces files that are no calibration.

        Returns
        -------
        list of Path
            The file, and its picture.

        Raises
        ------
        LocplanError
            If a file cannot be written, or is in the way.
        """
        field, figure = self.field, None
        verdict = field.verdict if field else {"in_metres": False, "why": self.notes[-1]}
        about = {"robot": self.robot.summary(), **verdict, "calibration": self.summary()}
        if field:
            figure = field.figure()
            figure.axes[0].set_ylabel("rms deviation by the recorded scan's posterior [m]")
        target = file_path("a calibration's file", path)
        return write_calibration(target, self.config, figure, about, force=force)

    def summary(self) -> dict[str, object]:
        """Results in numbers, fit for JSON."""
        about: dict[str, object] = {
            "drive": self.recording.summary(),
            "field": self.field.summary() if self.field else None,
            "scans": dataclasses.asdict(self.scans),
            "odometry": dataclasses.asdict(self.odometry) if self.odometry else None,
            "notes": list(self.notes),
        }
        return finite(about)


def _texts(interval: Interval, unit: str) -> tuple[str, str]:
    """Texts of a value with its unit, and of its interval."""
    factor = 100.0 if unit == "%" else 1.0
    value, low, high = (f"{0 if abs(each) < 2e-5 else factor * each:.3g}" for each in interval)
    return f"{value} {unit}".rstrip(), "" if np.isnan(interval.low) else f"{low} to {high}"


def calibrate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    config: FieldConfig | Estimator | None = None,
    robot: Robot | None = None,
    *,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> DriveCalibration:
    """Fit the noise level of a field, and the noise of odometry and scans, to a recorded drive.

    The noise level k makes the field's deviations those of the posteriors of the recorded scans.
    Odometry is compared with the recorded poses, and ranges with the map's walls.

    Parameters
    ----------
    recording : Recording
        The drive; its poses are the reference.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    config : FieldConfig or Estimator, optional
        Settings of the field; by default those of `locplan.Fused` with the recording's lidar.
    robot : Robot, optional
        The robot, whose settings stay where a drive says nothing of them. The alphas that are
        fitted hold for its filter's distance between updates. They are those of the odometry alone,
        and no advice for a filter, whose particles must spread more.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    DriveCalibration
        The field's settings, the disturbances and the noise, with what limits them.

    Raises
    ------
    RecordingError
        If too few scans fit the map.

    Notes
    -----
    The scatter of the ranges is that of the lidar and of the map's cells together. The drifts of
    odometry come out too low by 4 % on simulated drives of 300 m that turn all the time, where they
    scatter by a tenth, and by a tenth on drives of 70 m, where they scatter by a third; their
    intervals hold the true value in 65 to 95 % of the drives. The biases are those of one drive.
    Objects that block beams are taken to stand 0.5 to 2 m away, as in simulation: those further
    away are left out.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (36.0, 3.0)).path
    >>> drive = record_drive(grid, path, locplan.Robot(locplan.Lidar(range=6.0, beams=60)))
    >>> found = calibrate_drive(drive, grid)
    >>> 0.02 < found.robot.disturbances.outliers < 0.06
    True
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_drive")
    check_grid(grid)
    config = config_of(Fused(recording.lidar) if config is None else config)
    robot = recording.robot(robot)
    first, second = parts(progress, [500, 500])
    scans = scan_noise(recording, grid, threads=threads, progress=first)
    notes = []
    if scans.set_apart:
        notes.append(
            f"{scans.set_apart} of {scans.set_apart + scans.scans} scans fit the map nowhere near"
            " their poses, and are left out"
        )
    changes = scans.settings()
    odometry = odometry_noise(recording, robot.amcl)
    if odometry:
        notes += odometry.notes
        changes |= odometry.settings()
        notes.append(
            "these alphas are the odometry's own, and not written as the filter's, whose particles"
            " must mostly spread more; locplan tune --drive tries them, and larger ones"
        )
    elif recording.odometry is None:
        notes.append("the drive has no odometry: that of simulations stays as it was")
    else:
        notes.append(
            f"the drive has fewer than {MIN_UPDATES} updates of the filter, too few for the noise"
            " of odometry, which stays as it was"
        )
    config = _with_noise(config, scans.range_sigma.value)
    field = None
    try:
        field = _fitted_field(recording, grid, config, threads, second)
    except CalibrationError as error:
        notes.append(str(error))
    else:
        config = field.config
    robot = robot.changed(changes)
    return DriveCalibration(recording, config, field, scans, odometry, robot, tuple(notes))


def _with_noise(config: FieldConfig, sigma: float) -> FieldConfig:
    """The config with the range noise of its lidar [m], if it has one."""
    estimator: Any = config.estimator
    lidar: Lidar | None = getattr(estimator, "lidar", None)
    if lidar is None:
        return config
    noisy = dataclasses.replace(lidar, range_sigma=max(1e-3, sigma))
    return dataclasses.replace(config, estimator=estimator.with_lidar(noisy))


def _fitted_field(
    recording: Recording,
    grid: OccupancyGrid,
    config: FieldConfig,
    threads: int | None,
    progress: ProgressCallback,
) -> Calibration:
    """Fit the noise level of a field to the covariances of the posteriors of a drive's scans.

    The fit is that of `locplan.simulation.calibrate`, between logarithms of rms deviations of the
    position; the interval is over blocks of the drive.

    Raises
    ------
    RecordingError
        If too few scans were taken where the map is known and fits.
    CalibrationError
        If the covariances do not determine k.
    """
    estimator: Any = config.estimator
    plain = {estimator.name: dataclasses.replace(estimator, noise_level=1.0)}
    found = evaluate_drive(recording, grid, estimators=plain, threads=threads, progress=progress)
    some, (predicted,) = found.compared, found.predicted.values()
    both = predicted[some][:, :2, :2], found.matches.covariance[some][:, :2, :2]
    return calibrate_moments(config, grid, *both, found.blocks[some])

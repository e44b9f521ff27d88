"""Study of a recorded drive: faults, ground truth, noise, and the fit of the map."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from locplan._support.checks import check_file_path, check_instance, check_integer, check_threads
from locplan._support.output import ResultFiles, ResultOutput
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.records import Result, Table
from locplan._support.saved import to_plain_data
from locplan._support.tables import format_table, nan_to_none, wrap_lines
from locplan.errors import LocplanError
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.map_faults import MapFault
from locplan.recordings.calibration import DriveCalibration, calibrate_drive
from locplan.recordings.faults import RecordingFaults, find_recording_faults
from locplan.recordings.map_fit import MapFit, check_recording_on_map, find_misfits, fit_to_map
from locplan.recordings.recording import Recording
from locplan.recordings.replays import Replay, replay
from locplan.recordings.smoothing import load_or_smooth
from locplan.recordings.trajectory import Trajectory
from locplan.robots.presets import PRECISE, describe_preset
from locplan.robots.robot import Robot

RUNS = 12
"""Number of replays of the robot's filter."""
FILE_SUFFIXES = ".csv", ".tum", ".txt", ".json", ".bag", ".mcap", ".db3"
"""Suffixes that are probably a wrong file format, not the name of a folder."""
MAX_LISTED_PLACES = 3
"""Maximum number of listed places per fault of the map."""
SOUND = "Sound: odometry, stamps and map agree with the scans."
SOUND_IN_PART = "Sound, as far as the scans show."
USABLE = "Usable: {number}, too small to mislead `locplan tune`."
NOT_SOUND = (
    "Not sound: {number}. With this recording `locplan tune` does not write the precise settings"
    f" ({describe_preset(PRECISE)})."
)
"""Verdicts on a recording."""
SCAN_NUMBERS = "The log has no stamps: times in poses.tum are scan numbers."


@dataclass(frozen=True, eq=False, repr=False)
class RecordingReport(Result):
    """Results of the study of a recorded drive: ground truth, faults, noise, and fit of the map."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "recording",
        ("recording.json", "drive.npz", "poses.csv", "poses.tum"),
        purposes={
            "drive.npz": "the recording, for --recording of other commands",
            "poses.tum": "the ground truth, for evo",
            "poses.csv": "the ground truth with standard deviations",
            "robot.yaml": "the robot with its measured noise, for --robot",
            "recording.png": "the picture",
            "*.npz": "the recording, for --recording of other commands",
        },
    )

    recording: Recording
    """The drive; with a map, poses are the ground truth, and doubtful scans are dropped."""
    faults: RecordingFaults
    """Faults of odometry, stamps and the map's fit."""
    seed: int
    """Seed of all random numbers."""
    grid: OccupancyGrid | None = None
    """The map; without a map, this and all following fields are None or empty."""
    trajectory: Trajectory | None = None
    """The ground truth at all scans."""
    fit: MapFit | None = None
    """Fit of the map."""
    map_faults: tuple[MapFault, ...] = ()
    """Places where scans contradict the map, the worst first."""
    calibration: DriveCalibration | None = None
    """The noise of scans and odometry."""
    replay: Replay | None = None
    """Replays of the robot's filter; None without odometry."""

    def __repr__(self) -> str:
        return f"RecordingReport({self.recording!r}, {self.faults!r})"

    @property
    def is_drawable(self) -> bool:
        """True if there is a map to draw the drive on."""
        return self.trajectory is not None

    def figure(self) -> object:
        """Draw the ground truth on the map."""
        assert self.trajectory is not None
        return self.trajectory.figure()

    def summary(self) -> dict[str, object]:
        """Return all results for JSON."""
        return nan_to_none(
            {
                "recording": self.recording.summary(),
                "faults": list(self.faults.sentences),
                "is_sound": self.faults.is_sound,
                "ground_truth": self.trajectory and self.trajectory.summary(),
                "map_fit": self.fit and {"fits": self.fit.fits, "sentence": self.fit.sentence},
                "map_faults": [
                    {"fault": fault.sentence, "boxes": [list(box) for box in fault.boxes]}
                    for fault in self.map_faults
                ],
                "noise": self.calibration
                and {
                    "scans": to_plain_data(self.calibration.scans),
                    "odometry": self.calibration.odometry
                    and to_plain_data(self.calibration.odometry),
                    "notes": self.calibration.notes,
                },
                "replay": self.replay and self.replay.summary(),
                "robot": self.calibration and self.calibration.robot.summary(),
                "seed": self.seed,
            }
        )

    def table(self) -> Table:
        """Return a row per scan with the ground truth; empty without a map."""
        return self.trajectory.table() if self.trajectory else Table((), ())

    def save(
        self, folder: str | os.PathLike[str], *related_results: Any, force: bool = False
    ) -> None:
        """Write the recording for other commands, or a folder with all results.

        Parameters
        ----------
        folder : path
            A file .npz, which gets the recording with its ground truth alone; or a folder, which
            gets drive.npz, recording.json, and with a map poses.csv, poses.tum (time, x, y, z,
            quaternion, as evo reads them), recording.png and robot.yaml.
        *related_results
            Nothing: the report is complete.
        force : bool, default False
            If True, also replace files that locplan did not write.

        Raises
        ------
        LocplanError
            If a file cannot be written, or exists already.
        """
        target = check_file_path("a recording's file or folder", folder)
        if target.suffix == ".npz":
            with make_recording_output(target, force=force).writing() as file:
                self.recording.save(file)
        else:
            super().save(target, force=force)

    def _write(self, folder: Path) -> None:
        self.recording.save(folder / "drive.npz")
        if self.trajectory:
            self.trajectory.table().write_csv(folder / "poses.csv")
            self.trajectory.write_tum(folder / "poses.tum")
        if self.calibration:
            self.calibration.robot.save(folder / "robot.yaml")

    def report(self) -> str:
        """Return the verdict and a table of topics, ground truth, map, noise and replay."""
        return recording_report(self)


def make_recording_output(target: Path, *, force: bool = False) -> ResultOutput:
    """Return the checked output for a recording's file or folder, to fail before long work.

    Parameters
    ----------
    target : path
        A file that ends in .npz, or a folder.
    force : bool, default False
        If True, replace existing files that are not earlier results.
    """
    if target.suffix == ".npz":
        files = RecordingReport.files
        output = ResultOutput(target, files.kind, force, is_file=True, purposes=files.purposes)
        output.check()
        return output
    if target.suffix in FILE_SUFFIXES:
        raise LocplanError(
            f"{target}: must end in .npz, or be a folder (for poses.csv and poses.tum)"
        )
    return RecordingReport.files.make_output(target, force=force)


def study_recording(
    recording: Recording,
    grid: OccupancyGrid | None = None,
    robot: Robot | None = None,
    *,
    start: ArrayLike | str | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> RecordingReport:
    """Find the faults of a recorded drive; with its map, also ground truth, noise and fit.

    Without a map, only the faults of odometry and stamps are found.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid, optional
        The map.
    robot : Robot, optional
        The robot, whose filter is replayed; by default Nav2's settings.
    start : (x, y, heading), optional
        Pose at the first scan [m, m, rad]; by default the whole map is searched.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    RecordingReport
        The recording with its ground truth, and the results.

    Raises
    ------
    LocplanError
        If the recording was not taken on this map.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("office", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 2.0), (7.5, 1.9)).path
    >>> drive = record_drive(grid, path, locplan.Robot("turtlebot4"))
    >>> study_recording(drive).faults.is_sound
    True
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_integer("seed", seed, 0)
    check_threads(threads)
    if grid is None:
        return RecordingReport(recording, find_recording_faults(recording), seed)
    check_grid(grid)
    check_recording_on_map(recording, grid)
    smoothing, calibrating, replaying = split_progress(progress, [700, 200, 100])
    trajectory = load_or_smooth(recording, grid, robot, start=start, seed=seed, progress=smoothing)
    ground_truth = trajectory.replace_poses(recording)
    faults = find_recording_faults(ground_truth, grid)
    fit = fit_to_map(ground_truth, grid)
    misfits = find_misfits(grid, [ground_truth])
    calibration = calibrate_drive(ground_truth, grid, robot, threads=threads, progress=calibrating)
    replays = None
    if ground_truth.odometry is not None:
        replays = replay(
            ground_truth, grid, robot, runs=RUNS, seed=seed, threads=threads, progress=replaying
        )
    return RecordingReport(
        ground_truth,
        faults,
        seed,
        grid,
        trajectory,
        fit,
        tuple(misfits.faults(grid)),
        calibration,
        replays,
    )


def recording_report(report: RecordingReport) -> str:
    """Return the verdict and a table of topics, ground truth, map, noise and replay."""
    answer = _format_verdict(report.faults)
    rows = [*report.recording.rows()]
    if report.trajectory:
        rows.append(("ground truth", report.trajectory.sentences[0]))
    if report.fit:
        rows.append(("map", report.fit.sentence))
        rows += [("", _format_fault(fault)) for fault in report.map_faults]
    if report.calibration:
        rows += _format_noise_rows(report.calibration)
    if report.replay:
        drives = report.replay.drives
        runs = f"{len(report.replay.errors)} runs: error {drives.typical_rmse.value:.2g} m"
        lost = f"lost in {drives.lost.sum()}, off at the end in {drives.off_at_end.sum()}"
        rows.append(("filter, replayed", f"{runs}, {lost}"))
    notes = [SCAN_NUMBERS] if report.trajectory and report.recording.times is None else []
    return "\n".join(
        [*wrap_lines([answer, *report.faults.sentences, *notes]), "", format_table([], rows)]
    )


def _format_verdict(faults: RecordingFaults) -> str:
    """Return the verdict on a recording in one line."""
    count = len(faults.fault_sentences)
    number = "1 fault" if count == 1 else f"{count} faults"
    if not faults.is_sound:
        return NOT_SOUND.format(number=number)
    if count:
        return USABLE.format(number=number)
    return SOUND_IN_PART if faults.sentences else SOUND


def _format_noise_rows(calibration: DriveCalibration) -> list[tuple[str, str]]:
    """Format the noise of scans and odometry as table rows."""
    scans, odometry = calibration.scans, calibration.odometry
    of_scans = (
        f"ranges scatter by {100 * scans.range_sigma.value:.1f} cm, outliers"
        f" {scans.outliers.value:.1%}, blocked beams {scans.blocked.value:.1%}"
    )
    if odometry is None:
        return [("scan noise", of_scans)]
    of_odometry = (
        f"distances {odometry.distance_bias.value:+.1%}, turns {odometry.turn_bias.value:+.1%},"
        f" curvature {odometry.heading_bias_deg.value:+.2f} deg/m, drift in turns"
        f" {odometry.turn_drift_deg.value:.1f} deg/√rad"
    )
    return [("scan noise", of_scans), ("odometry", of_odometry)]


def _format_fault(fault: MapFault) -> str:
    """Format a fault of the map with its worst places."""
    places = ", ".join(
        f"({(box[0] + box[2]) / 2:.1f}, {(box[1] + box[3]) / 2:.1f})"
        for box in fault.boxes[:MAX_LISTED_PLACES]
    )
    return f"{fault.sentence}. Worst at {places}." if places else f"{fault.sentence}."

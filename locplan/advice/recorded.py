"""Evidence from recorded drives on the map and the robot, before anything is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from locplan._support.intervals import Interval, format_percent
from locplan._support.kernels.arrays import Bools
from locplan.advice.map_reading import MapCorrection
from locplan.errors import LocplanError
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFault, MapFaults
from locplan.recordings.calibration import fit_odometry_noise, fit_scan_noise
from locplan.recordings.faults import RecordingFaults, find_recording_faults
from locplan.recordings.map_fit import find_misfits, fit_ranges, fit_to_map
from locplan.recordings.recording import Recording
from locplan.recordings.replays import ReplayedDrive, find_replay_obstacle, find_sparse_scan_notes
from locplan.robots.robot import Robot


@dataclass(frozen=True)
class RecordingEvidence:
    """Robot and map corrected by recorded drives; unchanged without recordings."""

    robot: Robot
    """The robot with lidar and odometry errors as recorded."""
    faults: MapFaults
    """Faults of the map; faults found by the drives come first."""
    stretch: float = 1.0
    """Ratio of the true lengths to the map's; 1 unless it differs significantly."""
    sentences: tuple[str, ...] = ()
    """Sentences about the drives, without a full stop."""
    findings: tuple[str, ...] = ()
    """The sentences on the fit of the map and on faults of a drive."""
    are_sound: tuple[bool, ...] = ()
    """True for each drive that fits the map and whose odometry and scans agree."""
    replays: tuple[ReplayedDrive, ...] = ()
    """The drives for replays of settings: they fit the map and have enough scans."""


def analyze_recordings(
    recordings: Sequence[Recording],
    correction: MapCorrection,
    map_faults: MapFaults,
    robot: Robot,
    filter_map: OccupancyGrid | None,
    seed: int,
    threads: int | None,
) -> RecordingEvidence:
    """Compare recorded drives with the map, and calibrate the robot's errors.

    Parameters
    ----------
    recordings : sequence of Recording
        The drives.
    reading : Reading
        The corrections of the map's file.
    map_faults : MapFaults
        Faults of the map.
    robot : Robot
        The robot.
    filter_map, seed, threads
        See `locplan.check`.
    """
    grid, sentences, fitting, ranges = correction.grid, list[str](), [], None
    faults, replays, findings = list[RecordingFaults](), list[ReplayedDrive](), list[str]()
    for number, recording in enumerate(recordings, 1):
        fit = fit_to_map(recording, grid)
        ranges = ranges or fit.ranges
        sentences.append(f"drive {number}: {fit.sentence.rstrip('.')}")
        faults.append(find_recording_faults(recording, grid if fit.fits else None))
        sentences += [f"drive {number}: {text.rstrip('.')}" for text in faults[-1].sentences]
        texts = fit.sentence, *faults[-1].fault_sentences
        findings += [f"drive {number}: {text.rstrip('.')}" for text in texts]
        if not fit.fits:
            continue
        fitting.append(recording)
        name = f"drive {number}"
        if recording.odometry is not None and find_sparse_scan_notes(recording, robot.amcl):
            sentences.append(
                f"{name}: too few scans to measure how often the filter gets lost. Record all scans"
            )
        if limit := find_replay_obstacle(recording):
            sentences.append(f"{name}: {limit}")
        else:
            replays.append(
                ReplayedDrive(name, recording, grid, robot, filter_map, seed=seed, threads=threads)
            )
    misfits: tuple[MapFault, ...] = ()
    if fitting:
        ranges = fit_ranges(grid, fitting)
        longest = max(fitting, key=len)
        faulty = faults[list(recordings).index(longest)].faulty_steps
        robot, noise_sentences = _calibrate_robot(longest, grid, robot, faulty, threads)
        sentences += noise_sentences
        try:
            # On a map whose resolution is wrong, all walls seem to be.
            misfits = () if ranges.is_scaled else (*find_misfits(grid, fitting).faults(grid),)
        except LocplanError as error:  # the poses are too inaccurate
            sentences.append(f"walls: {error}")
    stretch = ranges.factor.value if ranges and ranges.is_scaled else 1.0
    of_ranges = ranges.faults(grid) if ranges else ()
    map_faults = replace(map_faults, corrected_map=grid, faults=(*of_ranges, *misfits, *map_faults))
    sound = (
        recording in fitting and drive_faults.is_sound
        for recording, drive_faults in zip(recordings, faults, strict=True)
    )
    if stretch != 1:  # the poses are in other lengths than those of the map
        replays = []
    return RecordingEvidence(
        robot, map_faults, stretch, tuple(sentences), tuple(findings), tuple(sound), tuple(replays)
    )


def _calibrate_robot(
    drive: Recording, grid: OccupancyGrid, robot: Robot, faulty: Bools, threads: int | None
) -> tuple[Robot, list[str]]:
    """Return the robot with a drive's errors of lidar and odometry, and sentences on them."""

    def format_noise(name: str, value: Interval, unit: str) -> str:
        return f"{name} {value.value:.3g} [{value.low:.2g}, {value.high:.2g}] {unit}"

    try:
        scans = fit_scan_noise(drive, grid, threads=threads)
    except LocplanError as error:
        return robot, [f"calibration: {error}"]
    changes = scans.settings()
    sentences = [
        f"lidar as recorded: {format_percent(scans.outliers)} random beams,"
        f" {format_percent(scans.blocked)} blocked beams"
    ]
    noise = fit_odometry_noise(drive, robot.amcl, faulty)
    if noise is None:
        return robot.with_settings(changes), [
            *sentences,
            "odometry: the drive is too short to calibrate it, so the configured errors stay",
        ]
    changes |= noise.settings()
    sentences.append(
        f"odometry as recorded: {format_noise('drift', noise.distance_drift, 'm/√m')},"
        f" {format_noise('heading', noise.heading_drift_deg, 'deg/√m')}"
    )
    return replace(robot.with_settings(changes), filter=robot.filter), sentences

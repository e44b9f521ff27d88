"""What recorded drives say of a map and a robot, before anything is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from locplan._kernels.arrays import Bools
from locplan._util.intervals import Interval, in_metres, in_percent
from locplan.diagnosis._reading import Reading
from locplan.errors import LocplanError
from locplan.maps import MapFault, MapFaults, OccupancyGrid
from locplan.recordings import (
    Recording,
    RecordingFaults,
    find_misfits,
    find_recording_faults,
    fit_to_map,
    odometry_noise,
    range_fit,
    replay,
    scan_noise,
)
from locplan.robots import Robot


@dataclass(frozen=True)
class Recorded:
    """The robot and the map as recorded drives say they are; as given without any."""

    robot: Robot
    """The robot, whose lidar and odometry err as recorded."""
    faults: MapFaults
    """Faults of the map, those that the drives show first."""
    stretch: float = 1.0
    """Ratio of the true lengths to those of the map; 1 unless it surely is another."""
    said: tuple[str, ...] = ()
    """What they say, in sentences without a full stop."""
    are_sound: tuple[bool, ...] = ()
    """Whether each drive fits the map and is evidence for settings that trust odometry and map."""


def recorded(
    recordings: Sequence[Recording],
    reading: Reading,
    known: MapFaults,
    robot: Robot,
    seed: int,
    threads: int | None,
) -> Recorded:
    """Look at what recorded drives say.

    Parameters
    ----------
    recordings : sequence of Recording
        The drives.
    reading : Reading
        How the map's file should be read.
    known : MapFaults
        Faults of the map.
    robot : Robot
        The robot as given.
    seed, threads
        See `locplan.check`.
    """
    grid, said, fitting, ranges = reading.grid, list[str](), [], None
    faults = list[RecordingFaults]()
    for number, each in enumerate(recordings, 1):
        fit = fit_to_map(each, grid)
        ranges = ranges or fit.ranges
        said.append(f"drive {number}: {fit.sentence.rstrip('.')}")
        faults.append(find_recording_faults(each, grid if fit.fits else None))
        said += [f"drive {number}: {text.rstrip('.')}" for text in faults[-1].sentences]
        if fit.fits:
            fitting.append(each)
            said += [f"drive {number}: {text}" for text in _replayed(each, grid, robot, seed)]
    misfits: tuple[MapFault, ...] = ()
    if fitting:
        ranges = range_fit(grid, fitting)
        longest = max(fitting, key=len)
        faulty = faults[list(recordings).index(longest)].faulty_steps
        robot, more = _calibrated(longest, grid, robot, faulty, threads)
        said += more
        try:
            # On a map whose resolution is wrong, all walls seem to be.
            misfits = () if ranges.is_scaled else (*find_misfits(grid, fitting).faults(grid),)
        except LocplanError as error:  # of poses that are too bad to judge walls by
            said.append(f"walls: {error}")
    stretch = ranges.factor.value if ranges and ranges.is_scaled else 1.0
    of_ranges = ranges.faults(grid) if ranges else ()
    known = replace(known, meant=grid, found=(*of_ranges, *misfits, *known))
    sound = (each in fitting and own.is_sound for each, own in zip(recordings, faults, strict=True))
    return Recorded(robot, known, stretch, tuple(said), tuple(sound))


def _replayed(drive: Recording, grid: OccupancyGrid, robot: Robot, seed: int) -> list[str]:
    """How the filter does when it is run on a recorded drive."""
    if drive.odometry is None:
        return ["it has no odometry, so that the filter cannot be run on it"]
    done = replay(drive, grid, robot, runs=10, seed=seed)
    if done.is_sparse:
        return ["it has too few scans to tell how the filter does; record every scan"]
    lost = in_percent(done.drives.lost_rate)
    error = in_metres(done.drives.typical_rmse.value)
    return [f"the filter, run on all of it, is usually off by {error}, and by over 1 m in {lost}"]


def _calibrated(
    drive: Recording, grid: OccupancyGrid, robot: Robot, faulty: Bools, threads: int | None
) -> tuple[Robot, list[str]]:
    """The robot whose lidar and odometry err as on a drive, and what that is."""

    def text(name: str, value: Interval, unit: str) -> str:
        return f"{name} {value.value:.3g} [{value.low:.2g}, {value.high:.2g}] {unit}"

    try:
        scans = scan_noise(drive, grid, threads=threads)
    except LocplanError as error:
        return robot, [f"calibration: {error}"]
    changes = scans.settings()
    said = [
        f"lidar as recorded: {in_percent(scans.outliers)} of the beams end anywhere,"
        f" {in_percent(scans.blocked)} are blocked"
    ]
    noise = odometry_noise(drive, robot.amcl, faulty)
    if noise is None:
        return robot.changed(changes), [*said, "odometry: too short a drive, taken as it was"]
    changes |= noise.settings()
    said.append(
        f"odometry as recorded: {text('drift', noise.distance_drift, 'm/√m')},"
        f" {text('heading', noise.heading_drift_deg, 'deg/√m')}"
    )
    return replace(robot.changed(changes), filter=robot.filter), said

"""Global localization: the poses of a whole map that explain one scan, or those near a route."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from locplan._kernels.arrays import Floats, Ints, Singles
from locplan._util.checks import check_threads, instance, number, shown, whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import (
    APART,
    CLEARANCE,
    ENOUGH,
    MIN_RETURNS,
    TURNED,
    Database,
    ScanDatabase,
    ScanOnMap,
    checked_database,
    in_batches,
)
from locplan.recordings._location import LocatedDrive, Location, Mode
from locplan.recordings._recording import Recording
from locplan.robots import Lidar

WITHIN = 3.0
"""Default distance from a route within which a robot is looked for [m]."""
COUNT = 10
"""Default number of modes that are kept."""
STEPS, STEP = 5, 0.1
"""Steps to each side that are tried about a mode, and their length, at least a cell [m]."""
TURNS_ASIDE, TURN = 5, math.radians(2.0)
"""Turns to each side that are tried about a mode, and their angle [rad]."""


class NotLocatedError(ConfigError):
    """A scan leaves open where it was taken."""


def locate(
    grid: OccupancyGrid,
    scan: ArrayLike | Recording,
    lidar: Lidar | None = None,
    *,
    near: Path | ArrayLike | None = None,
    within: float = WITHIN,
    count: int = COUNT,
    clearance: float = CLEARANCE,
    database: ScanDatabase | None = None,
) -> Location:
    """Find where on a map a robot can be that has taken one scan.

    The scan is compared with what the lidar would see at places 0.4 m apart all over the map, at 96
    turns; the best of them are refined on the map's likelihood field, at last with all beams. Beams
    without a return count for nothing. What a lidar sees everywhere is found when the first scan is
    located, and kept for the next ones.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    scan : (beams,) array or Recording
        Distances along the beams [m] in the order of ``lidar.angles``, inf or 0 without a return;
        or a recording of one scan, such as ``drive[n : n + 1]``.
    lidar : Lidar, optional
        The lidar, with its mount on the robot. A recording has its own.
    near : Path or (n, 2) array, optional
        Only poses along this path, or near one of these positions in the world, are looked for
        [m]; by default all of the map.
    within : float, default 3.0
        Their greatest distance from it, at least 0.5 [m].
    count : int, default 10
        Maximum number of modes that are kept, at least 1. The weights are shares of all that were
        found.
    clearance : float, default 0.1
        Distance of the robot's centre from walls at which a pose is possible [m], >= 0. Raise it to
        the robot's radius where map and walls agree well.
    database : ScanDatabase, optional
        What the lidar sees on this map, if it is to be kept by the caller. Its own clearance
        counts. By default the last four are kept.

    Returns
    -------
    Location
        The modes, the best first.

    Raises
    ------
    LocplanError
        If the scan does not belong to the lidar, has too few returns, or there is no place for the
        robot.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=8.0, beams=180))
    >>> route = locplan.Path([[13.0, 5.5], [20.0, 5.5]])
    >>> drive = locplan.recordings.record_drive(grid, route, robot, seed=1)
    >>> anywhere = locate(grid, drive[:1])
    >>> anywhere.best.weight <= sum(mode.weight for mode in anywhere.modes) <= 1.001
    True
    >>> here = locate(grid, drive[:1], near=route, within=1.0)
    >>> bool(abs(here.best.pose[0] - 13.0) < 0.5)
    True
    """
    check_grid(grid)
    ranges, lidar = _checked(scan, lidar)
    whole("count", count)
    database = checked_database(grid, lidar, clearance, database)
    places = places_of(database, near, within)
    return located(database, ranges, places, count, restricted=near is not None)


def places_of(database: ScanDatabase, near: Path | ArrayLike | None, within: float) -> Database:
    """The ranges of the places at which the robot may be.

    Raises
    ------
    LocplanError
        If there is none, or the positions are wrong.
    """
    if near is None:
        return database.everywhere
    # Least such distance, a little more than that of the places that scans are compared with [m].
    radius, places = number("within", within, 0.5), near
    if isinstance(places, Path):
        places = places.resampled(database.grid.resolution).xy
    return database.near(Path(np.asarray(places)).xy, radius)


def located(
    database: ScanDatabase, ranges: Floats, places: Database, count: int, *, restricted: bool
) -> Location:
    """Find the modes of a scan, inf without a return, among places of a database."""
    from locplan._kernels.scan_losses import TOP, fits, settle, unlike

    lidar, resolution = database.lidar, database.grid.resolution
    compared = places.matching.compared(ranges[None])[0]
    scan = ScanOnMap(places, compared)
    starts = scan.shortlisted()
    found = scan.refined(starts)
    on_robot = lidar.ends_on_robot(ranges[None].astype(np.float32))
    ends = database.compared_ends(on_robot[0])
    if found.returns < MIN_RETURNS or ends.shape[1] < MIN_RETURNS:
        raise NotLocatedError(
            f"the scan has too few returns, {int(np.isfinite(ranges).sum())}, to know where it was"
            f" taken; at least {MIN_RETURNS} of {int(places.matching.seen.sum())} directions need"
            " one"
        )
    # Where people stand around, a wide deviation leads away from the true pose.
    # Modes and, of the shortlist's best pairs of a place and a turn, those refined with all beams.
    poses = np.concatenate([found.poses[:150], starts[:20]])
    tables, lever, step = places.tables, scan.lever, max(STEP / resolution, 1.0)
    losses = np.array(
        [settle(tables, ends, lever, STEPS, step, TURNS_ASIDE, TURN, pose) for pose in poses]
    )
    losses *= database.nats_a_loss / TOP
    stands = np.array([fits(places.tables, *pose[:2]) for pose in poses.tolist()], bool)
    if not stands.any():
        raise NotLocatedError("the robot fits at no place that explains the scan; lower clearance")
    poses, losses = poses[stands], losses[stands]
    kept = unlike(poses, np.argsort(losses, kind="stable"), APART / resolution, TURNED)
    excess = losses[kept] - losses[kept[0]]
    kept = kept[excess <= ENOUGH]
    excess = excess[: len(kept)]
    share = np.exp(-excess) / np.exp(-excess).sum()
    best = kept[:count]
    world = places.in_world(poses[best])
    matched = database.matcher.posteriors(np.repeat(on_robot, len(best), axis=0), world)
    modes = [
        Mode(tuple(pose), float(weight), float(above), covariance)
        for pose, weight, above, covariance in zip(
            world.tolist(), share[:count], excess[:count], matched.covariance, strict=True
        )
    ]
    return Location(
        database.grid,
        lidar,
        ranges,
        tuple(modes),
        second=float(excess[1]) if len(excess) > 1 else math.inf,
        explained=_explained(places, ends, poses[kept[0]]),
        restricted=restricted,
    )


def _explained(places: Database, ends: Singles, pose: Floats) -> float:
    """Share of the ends that lie within two deviations of a wall at a pose on the map."""
    from locplan._kernels.scan_losses import TOP, loss_at

    tables, z_rand = places.tables, places.matching.z_rand
    # A beam's end within two deviations of a wall is explained by it.
    most = TOP * math.log((1 - z_rand) * math.exp(-0.5 * 2.0**2) + z_rand) / math.log(z_rand)
    last = len(tables.corners) - 1
    losses = [loss_at(tables, last, ends[:, [n]], *pose.tolist()) for n in range(ends.shape[1])]
    return float(np.mean(np.array(losses) <= most))


def _checked(scan: ArrayLike | Recording, lidar: Lidar | None) -> tuple[Floats, Lidar]:
    """The ranges of a scan, inf without a return, and the lidar that took it."""
    if isinstance(scan, Recording):
        if lidar is not None and lidar != scan.lidar:
            raise ConfigError("the recording has a lidar of its own; leave lidar out")
        if len(scan) != 1:
            raise ConfigError(
                f"one scan is located at a time, not {len(scan)}; take drive[n : n + 1], or"
                " locplan.recordings.locate_drive for all"
            )
        return scan.ranges[0].astype(np.float64), scan.lidar
    if lidar is None:
        raise ConfigError("name the lidar that took the scan; only a recording knows its own")
    instance("lidar", lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
    try:
        ranges = np.array(scan, np.float64)
    except (TypeError, ValueError):
        raise ConfigError(f"a scan must be an array of ranges [m], not {shown(scan)}") from None
    if ranges.shape != (lidar.beams,):
        raise ConfigError(
            f"a scan must be the ranges of the lidar's {lidar.beams} beams, not an array of shape"
            f" {ranges.shape}; see locplan.Lidar.from_scan"
        )
    if np.isnan(ranges).any():
        raise ConfigError(
            f"the range of beam {int(np.argmax(np.isnan(ranges)))} is NaN; give inf where there is"
            " no return"
        )
    returns = lidar.has_return(ranges.astype(np.float32))
    if not returns.any():
        raise ConfigError(
            f"no beam of the scan ends within {lidar.min_range:g} to {lidar.range:g} m; are the"
            " ranges in metres, and the lidar's right?"
        )
    return np.where(returns, ranges, np.inf), lidar


def locate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    near: Path | ArrayLike | None = None,
    within: float = WITHIN,
    count: int = COUNT,
    clearance: float = CLEARANCE,
    database: ScanDatabase | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> LocatedDrive:
    """Locate each scan of a recorded drive by itself, as `locate` does.

    The recorded poses are only compared with the result.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    near, within, count, clearance, database
        See `locate`.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Returns
    -------
    LocatedDrive
        The location of each scan, and how many are right.

    Raises
    ------
    LocplanError
        If a value is out of its range, no scan has enough returns, or there is no place for the
        robot.
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_recording")
    check_grid(grid)
    whole("count", count)
    workers = check_threads(threads)
    database = checked_database(grid, recording.lidar, clearance, database)
    places = places_of(database, near, within)
    _ = database.matcher.prepared  # now, once for all threads

    def find(some: Ints) -> list[Location | None]:
        found: list[Location | None] = []
        for n in some:
            ranges = recording.ranges[n].astype(np.float64)
            try:
                found.append(located(database, ranges, places, count, restricted=near is not None))
            except NotLocatedError:
                found.append(None)
        return found

    locations = in_batches(find, len(recording), workers, progress)
    if not any(locations):
        raise RecordingError(
            f"none of {len(recording)} scans has enough returns to know where it was taken"
        )
    return LocatedDrive(recording, grid, tuple(locations))

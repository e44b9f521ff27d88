"""Ambiguous places of a map, where one scan fits several places, and safe starts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from locplan._support.checks import check_positive, check_threads
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.poses import wrap_angles
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError
from locplan.field.config import equip_robot
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.recordings.matching import (
    MIN_RETURNS,
    MODE_DISTANCE,
    MODE_TURN,
    WRONG_DISTANCE,
    RangeDatabase,
    ScanOnMap,
    resolve_database,
    run_in_batches,
    select_spaced_places,
)
from locplan.robots.robot import Robot

SPACING = 1.6
"""Default distance between neighbouring places [m]."""
HEADINGS = 8
"""Number of headings at each place if the scan depends on the heading."""
THRESHOLD = 3.0
"""Maximum excess of an ambiguous place; matching confuses 10 % of such places [nats]."""
STARTS, STARTS_APART = 3, 3.0
"""Maximum number of proposed starts, and minimum distance between them [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class AmbiguousPlaces:
    """Ambiguity of the places of a map: how similar their scans are to scans over 2 m away."""

    places: Floats
    """World x and y of the places, (n, 2) [m]."""
    excess: Floats
    """Excess of the best pose over 2 m away, at the worst heading, (n,) [nats].

    0 with too few returns, infinite without such a pose.
    """
    elsewhere: Floats
    """Probability of poses over 2 m away, mean over headings, (n,)."""
    spacing: float
    """Distance between neighbouring places [m]."""

    def __repr__(self) -> str:
        return f"AmbiguousPlaces({self.share:.0%} of {len(self.places)} places)"

    @property
    def is_ambiguous(self) -> Bools:
        """Mask of the ambiguous places, with an excess of up to 3 nats, (n,)."""
        return np.asarray(self.excess <= THRESHOLD)

    @property
    def share(self) -> float:
        """Share of the places that are ambiguous, 0..1."""
        return float(self.is_ambiguous.mean())

    @property
    def starts(self) -> Floats:
        """World x and y of up to three safe starts for the robot, the safest first, (k, 2) [m].

        Neighbouring places are not ambiguous either, because the start of a robot is inaccurate.
        Starts are at least 3 m apart.
        """
        from scipy.spatial import cKDTree

        # Neighbours are within 1.6 times the spacing.
        near = cKDTree(self.places).query_ball_point(self.places, 1.6 * self.spacing)
        nearby_excess = np.array([self.excess[neighbours].min() for neighbours in near])
        nearby_elsewhere = np.array([self.elsewhere[neighbours].max() for neighbours in near])
        starts: list[Floats] = []
        for n in np.lexsort([nearby_elsewhere, -nearby_excess]):
            if len(starts) == STARTS or nearby_excess[n] <= THRESHOLD:
                break
            if all(np.hypot(*(self.places[n] - start)) >= STARTS_APART for start in starts):
                starts.append(self.places[n])
        return np.array(starts).reshape(-1, 2)

    @property
    def sentence(self) -> str:
        """Sentence for people: the share of ambiguous places, and safe starts."""
        share = f"{100 * self.share:.0f} % of the places are ambiguous to one scan"
        starts = [f"{x:.1f},{y:.1f}" for x, y in self.starts.tolist()]
        if not starts:
            return f"{share}, and no start is safe: set the initial pose"
        return f"{share}; safe starts: {' '.join(starts)}"


def find_ambiguous_places(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    spacing: float = SPACING,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> AmbiguousPlaces:
    """Find the places of a map where one scan fits several places.

    The expected scan at each place is compared with all places and turns, and the best poses are
    refined on the map's likelihood field. The result predicts failures of global matching of single
    scans. It does not predict failures of AMCL's global localization well, which scatters
    particles while the robot drives.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot, optional
        The robot with its lidar, by default with a range of 6 m and a full field of view; its
        radius is the minimum distance from walls.
    spacing : float, default 1.6
        Distance between neighbouring places [m], at least a cell. A smaller spacing finds more
        places and takes longer.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with (done, total) poses.

    Returns
    -------
    AmbiguousPlaces
        The places, their ambiguity, and safe starts.

    Raises
    ------
    LocplanError
        If a value is out of range, or the robot fits nowhere.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> found = find_ambiguous_places(grid, locplan.Robot(locplan.Lidar(range=8.0)), spacing=2.0)
    >>> found.is_ambiguous.shape == found.excess.shape == (len(found.places),)
    True
    """
    check_grid(grid)
    robot = equip_robot(robot)
    lidar = robot.known_lidar
    check_positive("spacing", spacing, "m")
    if spacing < grid.resolution:
        raise ConfigError(
            f"spacing must be at least a cell of the map, {grid.resolution:g} m, not {spacing:g}"
        )
    workers = check_threads(threads)
    database = resolve_database(grid, lidar, robot.radius, None).full_database
    positions = select_spaced_places(spacing, database.fits, grid.resolution)
    count = 1 if lidar.is_heading_independent else HEADINGS
    headings = np.arange(count, dtype=np.float64) * (2 * math.pi / count)
    poses = np.column_stack(
        [np.repeat(positions, count, axis=0), np.tile(headings, len(positions))]
    )
    ranges = database.simulate_scans(poses)

    def compare_batch(scan_numbers: Ints) -> list[tuple[float, float]]:
        return [_compare_with_other_places(database, ranges[n], poses[n]) for n in scan_numbers]

    values = np.array(run_in_batches(compare_batch, len(poses), workers, progress)).reshape(
        -1, count, 2
    )
    return AmbiguousPlaces(
        np.column_stack(grid.grid_to_world(positions[:, 1], positions[:, 0])),
        values[..., 0].min(axis=1),
        values[..., 1].mean(axis=1),
        float(spacing),
    )


def _compare_with_other_places(
    database: RangeDatabase, ranges: Floats, scan_pose: Floats
) -> tuple[float, float]:
    """Return the minimum excess of poses over 2 m away from `scan_pose`, and their probability.

    The scan is matched with the whole map; `scan_pose` is x, y [cells] and heading on the map.
    """
    modes = ScanOnMap(database, ranges).find_modes(scan_pose)
    if modes.n_returns < MIN_RETURNS:
        return 0.0, 1.0
    distances = np.hypot(*(modes.poses[:, :2] - scan_pose[:2]).T) * database.grid.resolution
    turn = np.abs(wrap_angles(modes.poses[:, 2] - scan_pose[2]))
    home_modes = np.flatnonzero((distances < MODE_DISTANCE) & (turn < MODE_TURN))
    if not home_modes.size:  # the robot does not fit exactly there
        return 0.0, 1.0
    excess = modes.losses - modes.losses[home_modes[0]]
    weights = np.exp(-(modes.losses - modes.losses.min()))
    far = distances > WRONG_DISTANCE
    return (
        float(excess[far].min()) if far.any() else math.inf,
        float(weights[far].sum() / weights.sum()),
    )

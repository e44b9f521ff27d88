"""Simulated drives: what their kernels take, and their results, errors and scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from locplan._support.checks import check_integer
from locplan._support.intervals import (
    Interval,
    compute_wilson_interval,
    estimate_geometric_mean,
    estimate_mean,
    estimate_median,
    estimate_rms,
)
from locplan._support.kernels.arrays import Bools, Floats, Singles
from locplan._support.poses import Poses, compute_travel_distances
from locplan._support.records import POSE, Table, TableColumn
from locplan.maps.grid import OccupancyGrid
from locplan.robots.amcl import Amcl, Filter
from locplan.robots.lidar import Lidar
from locplan.robots.particles import make_beam_scores, make_filter_settings
from locplan.robots.robot import Robot

MAX_DRIVES = 100_000
"""Maximum number of drives along a path, or to a place."""
DEFAULT_DRIVES = 100
"""Default number of drives along a path."""
LOST_DISTANCE = 1.0
"""Error of the position above which a robot is lost at any time of a drive, and off at the end
where the drive ends [m]."""
LOST_TEXT: str = f"off by more than {LOST_DISTANCE:g} m"
"""The definition of lost in sentences."""
LOST_SHORT_TEXT: str = f"off by > {LOST_DISTANCE:g} m"
"""The definition of lost in figures and headings of tables."""
MIN_MEAN_SQUARE = 1e-6
"""Mean square error that is added, so that no drive without error decides alone [m^2, rad^2]."""


def make_rate_column(
    name: str, title: str, value: Callable[[Any], Interval] | None = None
) -> TableColumn:
    """Column of a share of drives with its interval."""
    return TableColumn(name, "", title, 0, "%", interval=True, value=value)


RATE_COLUMNS: tuple[TableColumn, ...] = (
    make_rate_column("lost_rate", f"lost ({LOST_SHORT_TEXT})"),
    make_rate_column("off_at_end_rate", f"off at the end (> {LOST_DISTANCE:g} m)"),
)
"""Columns of shares of the drives that go wrong, with 95 % intervals."""
DRIVE_COLUMNS = (
    TableColumn("drives", value=lambda drives: len(drives.errors)),
    TableColumn("length", "m", "length"),
    TableColumn("typical_rmse", "m", "error of a typical drive", interval=True),
    TableColumn("median_error", "m", "median error", interval=True),
    *RATE_COLUMNS,
    TableColumn("kept_rmse", "m", "RMSE of those never lost", interval=True),
    TableColumn("rmse", "m", "RMSE of all", interval=True),
    TableColumn("final_rmse", "m", "RMSE at the end", interval=True),
    TableColumn("heading_rmse", "rad", "heading RMSE", 1, "deg", interval=True),
)
"""Columns of `Drives`: their length and errors, with 95 % intervals over the drives."""
PROFILE_COLUMNS = (
    TableColumn("distance", "m"),
    *POSE,
    *(TableColumn(f"error_{statistic}", "m") for statistic in ("mean", "median")),
    *(TableColumn(f"error_percentile_{statistic}", "m") for statistic in (10, 90)),
    TableColumn("heading_error_rms", "rad"),
)
"""Columns of `Drives.profile`."""


def check_drive_count(drives: int, *, allows_none: bool = False) -> None:
    """Check that a path can be driven so often; to be called before long work.

    Parameters
    ----------
    drives : int
        Number of drives along a path, 2 to 100,000.
    allows_none : bool, default False
        True also allows 0, for no drives.

    Raises
    ------
    ConfigError
        If the number is out of its range.
    """
    if drives or not allows_none:
        check_integer("drives, unless 0," if allows_none else "drives", drives, 2, MAX_DRIVES)


class RateProperties:
    """Rates and errors of drives, from flags for lost and off at the end and from distances."""

    @property
    def lost_rate(self: Any) -> Interval:
        """Share of the drives that were lost, 0..1."""
        return compute_wilson_interval(float(self.lost.mean()), len(self.lost))

    @property
    def off_at_end_rate(self: Any) -> Interval:
        """Share of the drives that were off at the end, 0..1."""
        return compute_wilson_interval(float(self.off_at_end.mean()), len(self.off_at_end))

    @property
    def rmse(self: Any) -> Interval:
        """Root mean square of the position error along the way [m].

        The drives that were lost make most of it; see `kept_rmse`.
        """
        return estimate_rms(self.mean_squares)

    @property
    def kept_rmse(self: Any) -> Interval:
        """RMSE of the drives that were not lost at any time [m]; NaN if all of them were."""
        return estimate_rms(self.mean_squares[~self.lost])


@dataclass(frozen=True, eq=False, repr=False)
class Drives(RateProperties):
    """Simulated drives along one line.

    The n-th drives of two lines with the same ends are pairs: they have the same world and the same
    random numbers. Intervals are over the drives.
    """

    poses: Floats
    """The true poses x, y, heading, (n, 3), in the world [m, m, rad]."""
    errors: Floats
    """The filter's pose minus the true one, (drives, n, 3), in the world [m, m, rad]."""

    def __repr__(self) -> str:
        return (
            f"Drives({len(self.errors)} of {self.distance[-1]:.2f} m,"
            f" median error {self.median_error.value:.3g} m, {format_rates(self)})"
        )

    @property
    def distance(self) -> Floats:
        """Distance driven up to each pose, (n,) [m]."""
        return compute_travel_distances(self.poses)

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(self.distance[-1])

    @property
    def position_error(self) -> Floats:
        """Distance of the filter's position from the true one, (drives, n) [m]."""
        return np.hypot(self.errors[..., 0], self.errors[..., 1])

    @property
    def median_error(self) -> Interval:
        """Median of the position error over all poses of all drives [m]."""
        return estimate_median(self.position_error)

    @property
    def typical_rmse(self) -> Interval:
        """RMSE of a typical drive [m], at least 1 mm: the geometric mean over the drives."""
        return estimate_geometric_mean(np.sqrt(self.mean_squares + MIN_MEAN_SQUARE))

    @property
    def heading_rmse(self) -> Interval:
        """Root mean square of the heading error along the way [rad]."""
        return estimate_rms((self.errors[..., 2] ** 2).mean(axis=1))

    @property
    def mean_squares(self) -> Floats:
        """Mean square of each drive's position error, (drives,) [m^2]."""
        return np.asarray((self.position_error**2).mean(axis=1))

    @property
    def lost(self) -> Bools:
        """True for each drive that was lost, (drives,)."""
        return np.asarray(self.position_error.max(axis=1) > LOST_DISTANCE)

    @property
    def off_at_end(self) -> Bools:
        """True for each drive that is off at the end, (drives,)."""
        return np.asarray(self.position_error[:, -1] > LOST_DISTANCE)

    @property
    def lost_way(self) -> Interval:
        """Share of the poses with a lost robot, 0..1."""
        return estimate_mean((self.position_error > LOST_DISTANCE).mean(axis=1))

    @property
    def first_loss(self) -> float:
        """Median distance [m] until the robot is lost; infinite if half never were."""
        is_lost = self.position_error > LOST_DISTANCE
        at = self.distance[is_lost.argmax(axis=1)]
        return float(np.median(np.where(is_lost.any(axis=1), at, np.inf)))

    @property
    def final_rmse(self) -> Interval:
        """Root mean square of the position error at the end of the drives [m]."""
        return estimate_rms(self.position_error[:, -1] ** 2)

    def profile(self) -> Floats:
        """Poses and errors along the way, (n, 9), in the columns of `PROFILE_COLUMNS`."""
        error = self.position_error
        low, median, high = np.quantile(error, (0.1, 0.5, 0.9), axis=0)
        heading = np.sqrt((self.errors[..., 2] ** 2).mean(axis=0))
        columns = self.distance, self.poses, error.mean(axis=0), median, low, high, heading
        return np.column_stack(columns)


def format_rates(drives: Any) -> str:
    """Return the shares of drives that go wrong as text.

    Parameters
    ----------
    drives : Drives, or any object with its rates
        The drives.
    """
    return ", ".join(
        f"{column.extract_value(drives).value:.0%} {column.title}" for column in RATE_COLUMNS
    )


def tabulate_profiles(drives: Mapping[str, Drives]) -> Table:
    """The profiles of drives along some paths, with the path's name in the first column.

    Parameters
    ----------
    drives : mapping of str to Drives
        Drives by the names of the paths.
    """
    rows = (
        (name, *row)
        for name, path_drives in drives.items()
        for row in path_drives.profile().tolist()
    )
    return Table((TableColumn("path"), *PROFILE_COLUMNS), tuple(rows))


def compute_rmse_ratio(drives: Drives, baseline: Drives) -> Interval:
    """Return the RMSE of a typical drive relative to a baseline with the same seeds.

    Parameters
    ----------
    drives, baseline : Drives
        Equally many drives; the n-th of both have the same world and seed.

    Returns
    -------
    Interval
        Geometric mean of the ratio with its 95 % interval over the drives, as
        `locplan.recommend_path` confirms it; below 1 the drives are better than the baseline.
    """
    squares, below = drives.mean_squares + MIN_MEAN_SQUARE, baseline.mean_squares + MIN_MEAN_SQUARE
    return estimate_geometric_mean(np.sqrt(squares / below))


def compute_rmse_ratios(drives: Mapping[str, Drives]) -> dict[str, Interval]:
    """Return the RMSE of each path's drives relative to the first path's RMSE."""
    first, *rest = drives
    return {name: compute_rmse_ratio(drives[name], drives[first]) for name in rest}


class DrivePoses(NamedTuple):
    """The poses that a drive leads through."""

    truth: Poses
    """In the own axes of the filter's map, (n, 3) [m, m, rad]."""
    cells: Poses
    """Row and column in the map that is driven in, and heading, (n, 3) [cells, cells, rad]."""
    ideal_odometry: Poses
    """As odometry would report them without errors, (n, 3) [m, m, rad]: `truth`, unless the
    filter's map has a kink."""


class CustomFilter(NamedTuple):
    """A filter that is not AMCL, with the arguments that start it."""

    settings: Filter
    grid: OccupancyGrid
    """The filter's map."""
    lidar: Lidar


class DriveArguments(NamedTuple):
    """Arguments of the kernels of drives."""

    scores: Any
    """`particles.BeamScores` of the map; None where the filter is not AMCL."""
    lidar: Any
    """`lidar.Lidar` with the beams that AMCL compares, or with all beams."""
    disturbances: Any
    """`measured.BeamDisturbances`: outliers and occlusions."""
    odometry: Any
    """`drives.Odometry`: errors of the reported odometry."""
    start: Any
    """`tracking.Start`: standard deviations of the filter's first pose."""
    filter: Any
    """`particles.Filter`: AMCL's parameters; or an `OwnFilter`."""


def make_drive_arguments(
    grid: OccupancyGrid, robot: Robot, *, scores: Singles | None = None
) -> DriveArguments:
    """Arguments of the kernels of drives for a map and a robot.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    robot : Robot
        The robot, with its lidar.
    scores : (H + 2, W + 2) array of float32, optional
        What a beam that ends in each cell adds to a particle, for this map, filter and lidar; by
        default it is computed.

    Returns
    -------
    DriveArguments
        The arguments.
    """
    from locplan._support.kernels.drives import StartSpread

    lidar, odometry, disturbances = robot.known_lidar, robot.odometry, robot.disturbances
    start = StartSpread(disturbances.start_sigma, math.radians(disturbances.start_sigma_deg))
    filter_scores: Any = None
    settings: Any
    if isinstance(amcl := robot.filter, Amcl):
        filter_scores = make_beam_scores(grid, amcl, lidar, scores)
        angles, settings = (
            lidar.angles[:: amcl.compute_beam_step(lidar.beams)],
            make_filter_settings(amcl),
        )
        nearest, farthest = (
            max(lidar.min_range, amcl.laser_min_range),
            amcl.compute_max_range(lidar),
        )
    else:
        angles, nearest, farthest = lidar.angles, lidar.min_range, lidar.range
        settings = CustomFilter(robot.filter, grid, lidar)
    return DriveArguments(
        filter_scores,
        lidar.to_kernel_settings()._replace(
            angles=np.ascontiguousarray(angles), min_range=nearest, max_range=farthest
        ),
        disturbances.to_kernel_settings(),
        odometry.to_kernel_settings(),
        start,
        settings,
    )

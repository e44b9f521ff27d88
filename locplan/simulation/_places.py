"""Places of a map, and the localization errors of a robot there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.field import FieldConfig, well_spaced
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot, radius_of
from locplan.simulation._drives import LOST, MAX_DRIVES, OFF
from locplan.simulation._simulator import APPROACH, POINTS, Simulator
from locplan.simulation._worlds import approaches, check_of_one_map

ErrorKind = Literal["tracking", "match"]
KINDS: dict[ErrorKind, str] = {
    "tracking": "error of a particle filter, 10 m drives",
    "match": "error of single-scan matches",
}
"""The kinds of errors, and what people call them."""


@dataclass(frozen=True, eq=False, repr=False)
class Places:
    """Places of a map and the errors there.

    "tracking" is the error of the particle filter over the last metre of drives of 10 m that end
    at the place, along shortest paths from all around (on a smaller map over the last tenth of the
    longest drives possible); "match" is the error of the most likely pose of single scans. Without
    drives or scans they are NaN.
    """

    grid: OccupancyGrid
    """The map."""
    points: Ints
    """Rows and columns of the places on the lattice of a field's default stride, (n, 2)."""
    tracking: Floats
    """Second moments of the particle filter's errors, (n, 3, 3), in the world [m, m, rad]."""
    match: Floats
    """Second moments of the matches' errors, (n, 3, 3), in the world [m, m, rad]."""
    tracking_median: Floats
    """Median of the particle filter's position error, (n,) [m]."""
    match_median: Floats
    """Median of the matches' position error, (n,) [m]."""
    lost: Floats
    """Share of the drives to each place that were off by more than 1 m at some time, (n,), 0..1."""
    off_at_goal: Floats
    """Share of those that were off by more than 0.5 m at the place, (n,), 0..1."""
    kept_rmse: Floats
    """RMSE of the position of those never off by more than 1 m, (n,) [m]; NaN where all were."""
    halves: Floats
    """RMSE of the position of every second drive and of the others, (n, 2) [m]."""

    def __repr__(self) -> str:
        return f"Places({len(self.points)} of {self.grid.name or 'map'})"

    @property
    def xy(self) -> Floats:
        """Positions of the places in the world, (n, 2) [m]."""
        rows, cols = (_cells(self.grid, self.points) + 0.5).T
        return np.column_stack(self.grid.grid_to_world(rows, cols))

    def moments(self, kind: ErrorKind) -> Floats:
        """Second moments of one kind of error, (n, 3, 3), in the world [m, m, rad].

        Parameters
        ----------
        kind : str
            "tracking" of a particle filter, or "match" of single scans.
        """
        return self.tracking if kind == "tracking" else self.match

    def position_rmse(self, kind: ErrorKind) -> Floats:
        """RMSE of the position at each place, (n,) [m].

        Parameters
        ----------
        kind : str
            "tracking" or "match", see `Places.moments`.
        """
        return np.sqrt(self.moments(kind)[:, 0, 0] + self.moments(kind)[:, 1, 1])

    def position_median(self, kind: ErrorKind) -> Floats:
        """Median error of the position at each place, (n,) [m].

        Parameters
        ----------
        kind : str
            "tracking" or "match", see `Places.moments`.
        """
        return self.tracking_median if kind == "tracking" else self.match_median

    def heading_rmse(self, kind: ErrorKind) -> Floats:
        """RMSE of the heading at each place, (n,) [rad].

        Parameters
        ----------
        kind : str
            "tracking" or "match", see `Places.moments`.
        """
        return np.sqrt(self.moments(kind)[:, 2, 2])

    @property
    def sizes(self) -> dict[str, Floats]:
        """Sizes of the errors at each place by name, (n,) [m]; those of `RATES` are shares."""
        return {
            "tracking_median": self.tracking_median,
            "lost_rate": self.lost,
            "off_at_goal": self.off_at_goal,
            "tracking_kept_rmse": self.kept_rmse,
            "tracking_rmse": self.position_rmse("tracking"),
            "match_median": self.match_median,
            "match_rmse": self.position_rmse("match"),
        }


def choose_points(grid: OccupancyGrid, count: int, *, robot: Robot | float, seed: int) -> Ints:
    """Random lattice points where a robot can stand, at least 1 m apart.

    They lie in the largest part of the map that is connected for a robot of this radius.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    count : int
        Maximum number of points, at least 2; there are fewer if the map has no more.
    robot : Robot, or float
        The robot, or its radius [m].
    seed : int
        Seed of the random numbers, >= 0.

    Returns
    -------
    (n, 2) array of int
        Rows and columns on the lattice of a field's default stride.

    Raises
    ------
    ConfigError
        If `count` is below 2, or the map has fewer than two such points.
    """
    import cv2

    check_grid(grid)
    whole("places", count, 2)
    wide = grid.free & (grid.clearance >= radius_of(robot))
    _, labels, about, _ = cv2.connectedComponentsWithStats(wide.astype(np.uint8), connectivity=4)
    if len(about) < 2:
        raise ConfigError(f"{grid.name or 'the map'}: has no cell where the robot fits")
    largest = 1 + int(np.argmax(about[1:, cv2.CC_STAT_AREA]))
    stride = _stride(grid)
    points = np.argwhere(labels[::stride, ::stride] == largest).reshape(-1, 2)
    priority = random_of(seed, POINTS).random(len(points))
    spacing = 1.0 / (stride * grid.resolution)
    chosen = well_spaced(points.astype(float), priority, spacing)[:count]
    if len(chosen) < 2:
        raise ConfigError(f"{grid.name or 'the map'}: is too small for two places 1 m apart")
    return points[chosen]


def measure(
    simulator: Simulator,
    points: Ints,
    *,
    drives: int = 16,
    scans: int = 16,
    progress: ProgressCallback | None = None,
) -> Places:
    """Drive to each place, and match scans there.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the map.
    points : (n, 2) array of int
        Places, as returned by `choose_points`.
    drives, scans : int, default 16
        Number of drives to each place, and of scans at each; 0 leaves them out.
    progress : callable, optional
        Called with (done, total) drives and places.

    Returns
    -------
    Places
        The errors of the filter and of the matches at each place.
    """
    grid = simulator.grid
    costs = Costmap.blank(grid, robot=simulator.robot)
    random = random_of(simulator.seed, APPROACH)
    callbacks = parts(progress, [drives * len(points), len(points)])
    driven = np.full((len(points), 1, 1, 3), np.nan)
    matching = np.full((len(points), 1, 3), np.nan)
    if drives:
        lines = [
            line
            for row, col in _cells(grid, points)
            for line in approaches(costs, (int(row), int(col)), drives, 10.0, random)
        ]
        errors = simulator.drive(lines, progress=callbacks[0])
        driven = errors.reshape(len(points), drives, -1, 3)
    if scans:
        matching = simulator.match(_cells(grid, points), scans, progress=callbacks[1])
    last = driven[:, :, -max(1, round(0.1 * driven.shape[2])) :]  # the last metre of 10 m
    tracking = last.reshape(len(points), -1, 3)
    moments = _moments(tracking), _moments(matching)
    medians = (np.median(_distances(tracking), axis=1), np.median(_distances(matching), axis=1))
    lost, kept = _lost_and_kept(driven, last)
    ends = last[:, :, -1]
    off = np.where(np.isnan(ends[..., 0]), np.nan, _distances(ends) > OFF).mean(axis=1)
    return Places(grid, points, *moments, *medians, lost, off, kept, _halves(last))


def measure_maps(
    grids: Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    places: int = 100,
    drives: int = 16,
    scans: int = 16,
    filter_map: OccupancyGrid | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> list[Places]:
    """Choose places on each map, and measure the errors there.

    Parameters
    ----------
    grids : sequence of OccupancyGrid
        The maps.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round.
    places : int, default 100
        Maximum number of random places on each map, at least 2, which are at least 1 m apart.
    drives, scans : int, default 16
        Number of drives to each place, and of single scans at each, 0 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs from the only one that is driven in;
        single scans are matched on the latter.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives and places of all maps.

    Returns
    -------
    list of Places
        The places of each map, with their errors.

    Raises
    ------
    ConfigError
        If there is no map, a number is out of its range, or a robot has no room on a map.
    """
    if not grids:
        raise ConfigError("there must be at least one map")
    check_of_one_map(filter_map, grids)
    for name, value in (("drives", drives), ("scans", scans)):
        whole(name, value, 0, MAX_DRIVES)
    whole("seed", seed, 0)
    robot = robot or Robot()
    chosen = [choose_points(grid, places, robot=robot, seed=seed) for grid in grids]
    callbacks = parts(progress, [(drives + 1) * len(points) for points in chosen])
    own: Any = {"filter_map": filter_map, "seed": seed, "threads": threads}
    return [
        measure(Simulator(grid, robot, **own), points, drives=drives, scans=scans, progress=part)
        for grid, points, part in zip(grids, chosen, callbacks, strict=True)
    ]


def _stride(grid: OccupancyGrid) -> int:
    return FieldConfig().stride_cells(grid.resolution)


def _cells(grid: OccupancyGrid, points: Ints) -> Ints:
    """Cells (row, col) of lattice points, (n, 2)."""
    return points * _stride(grid)


def _distances(errors: Floats) -> Floats:
    """Position errors, (...), of errors (..., 3) [m]."""
    return np.asarray(np.hypot(errors[..., 0], errors[..., 1]))


def _lost_and_kept(driven: Floats, last: Floats) -> tuple[Floats, Floats]:
    """Share of lost drives, and RMSE [m] of the others, (n,), of errors (n, drives, k, 3).

    A drive may be lost at any time of `driven`; the RMSE is over `last`, its end.
    """
    farthest = _distances(driven).max(axis=2)
    lost = farthest > LOST
    squares = np.where(lost, np.nan, (_distances(last) ** 2).mean(axis=2))
    counts = (~np.isnan(squares)).sum(axis=1)
    with np.errstate(invalid="ignore"):
        kept = np.sqrt(np.nansum(squares, axis=1) / counts)
    return np.where(np.isnan(farthest), np.nan, lost).mean(axis=1), kept


def _halves(last: Floats) -> Floats:
    """RMSE of the position of every second drive and of the others, (n, 2) [m].

    They are NaN unless there are two drives (n, drives, k, 3) or more.
    """
    if last.shape[1] < 2:
        return np.full((len(last), 2), np.nan)
    squares = (_distances(last) ** 2).mean(axis=2)
    return np.sqrt([squares[:, n::2].mean(axis=1) for n in (0, 1)]).T


def _moments(errors: Floats) -> Floats:
    """Second moments, (n, 3, 3), of errors (n, k, 3)."""
    return np.asarray(np.einsum("nki,nkj->nij", errors, errors) / errors.shape[1])

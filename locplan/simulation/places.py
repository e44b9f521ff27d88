"""Places of a map, and how badly a robot is localized there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig
from locplan.costmap import Costmap
from locplan.errors import ConfigError
from locplan.grid import OccupancyGrid
from locplan.lattice import spread_out, stride_cells
from locplan.progress import ProgressCallback, in_turn
from locplan.simulation.motion import approaches
from locplan.simulation.settings import Amcl, Reality
from locplan.simulation.simulator import Simulator

APART = 1.0
"""Least distance between places [m]."""
PLACES = 100
"""On each map."""
DRIVES, SCANS = 16, 16
"""To each place, and at each."""
LENGTH = 10.0
"""Of a drive to a place [m]."""
LAST = 0.1
"""The share of it, at its end, whose error counts."""

ErrorKind = Literal["tracking", "match"]


@dataclass(frozen=True, eq=False)
class Places:
    """Places of a map and the errors there, as second moments of (x, y, heading).

    "tracking" is that of the particle filter over the last metre of drives of 10 m that end at the
    place, along shortest paths from all around; "match" that of the likeliest pose of single scans.
    """

    grid: OccupancyGrid
    points: NDArray[np.int64]
    """(n, 2): rows and columns of the lattice."""
    stride: int
    """Spacing of the lattice [cells]."""
    tracking: NDArray[np.float64]
    """(n, 3, 3), in the world [m, m, rad]."""
    match: NDArray[np.float64]
    """The same."""

    @property
    def xy(self) -> NDArray[np.float64]:
        """Where they are, (n, 2) [m]."""
        rows, cols = (self.points * self.stride + 0.5).T
        return np.column_stack(self.grid.grid_to_world(rows, cols))

    def moments(self, kind: ErrorKind) -> NDArray[np.float64]:
        """Second moments of one kind of error, (n, 3, 3)."""
        return self.tracking if kind == "tracking" else self.match

    def position_rmse(self, kind: ErrorKind) -> NDArray[np.float64]:
        """Root mean square of the distance, (n,) [m]."""
        return np.sqrt(self.moments(kind)[:, 0, 0] + self.moments(kind)[:, 1, 1])

    def heading_rmse(self, kind: ErrorKind) -> NDArray[np.float64]:
        """And of the heading, (n,) [rad]."""
        return np.sqrt(self.moments(kind)[:, 2, 2])


def choose_points(
    grid: OccupancyGrid, count: int, *, robot_radius: float, seed: int
) -> NDArray[np.int64]:
    """Lattice points at random where a robot can stand, none of them close together.

    Of the largest part of the map that holds together for a robot of this radius.

    Raises
    ------
    ConfigError
        If there is none.
    """
    import cv2

    if count < 2:
        raise ConfigError(f"there must be at least 2 places, not {count}")
    stride = stride_cells(FieldConfig(), grid.resolution)
    wide = grid.free & (grid.clearance >= robot_radius)
    _, labels, about, _ = cv2.connectedComponentsWithStats(wide.astype(np.uint8), connectivity=4)
    if len(about) < 2:
        raise ConfigError(f"{grid.name or 'the map'}: has no cell where the robot fits")
    largest = 1 + int(np.argmax(about[1:, cv2.CC_STAT_AREA]))
    points = np.argwhere(labels[::stride, ::stride] == largest)
    if len(points) < 2:
        raise ConfigError(f"{grid.name or 'the map'}: is too small to evaluate")
    priority = np.random.default_rng([seed, 2]).random(len(points))
    spacing = APART / (stride * grid.resolution)
    return points[spread_out(points.astype(float), priority, spacing)[:count]]


def measure(
    simulator: Simulator,
    points: NDArray[np.int64],
    *,
    robot_radius: float,
    drives: int = DRIVES,
    scans: int = SCANS,
    progress: ProgressCallback | None = None,
) -> Places:
    """Drive to each place, and match scans there."""
    grid = simulator.grid
    stride = stride_cells(FieldConfig(), grid.resolution)
    costs = Costmap.blank(grid, robot_radius=robot_radius)
    random = np.random.default_rng([simulator.seed, 3])
    lines = [
        line
        for row, col in points * stride
        for line in approaches(costs, (int(row), int(col)), drives, LENGTH, random)
    ]
    errors = simulator.drive(lines, progress=progress)
    at_last = errors[:, -round(LAST * errors.shape[1]) :].reshape(len(points), -1, 3)
    matched = simulator.match(points * stride, scans)
    return Places(grid, points, stride, _moments(at_last), _moments(matched))


def places_of(
    grids: Sequence[OccupancyGrid],
    *,
    amcl: Amcl | None = None,
    reality: Reality | None = None,
    places: int = PLACES,
    drives: int = DRIVES,
    scans: int = SCANS,
    robot_radius: float = 0.25,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> list[Places]:
    """Choose places on each map, and measure there; see `locplan.simulation.evaluate`."""
    if not grids:
        raise ConfigError("there must be at least one map")
    for name, value in (("drives", drives), ("scans", scans)):
        if value < 1:
            raise ConfigError(f"{name} must be at least 1, not {value}")
    chosen = [choose_points(grid, places, robot_radius=robot_radius, seed=seed) for grid in grids]
    told = in_turn(progress, len(grids)) if progress else None
    return [
        measure(
            Simulator(grid, amcl, reality, seed=seed, threads=threads),
            points,
            robot_radius=robot_radius,
            drives=drives,
            scans=scans,
            progress=told,
        )
        for grid, points in zip(grids, chosen, strict=True)
    ]


def _moments(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean outer product of errors (n, k, 3), (n, 3, 3)."""
    return np.einsum("nki,nkj->nij", errors, errors) / errors.shape[1]

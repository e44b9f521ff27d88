"""A new plan for a robot that is hindered: on the map and what it sees, back to its path."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.poses import Poses, after_way, way_along, way_between
from locplan.costs import Path
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Robot
from locplan.simulation._worlds import inflated, inflation_of

POINTS = 0.05
"""Distance between the points of a path that is followed [m]."""
SIGHT, JOIN, AROUND = 3.0, (1.0, 5.0), 8.0
"""A new plan knows the true walls so far away, joins the path so far ahead, and is made on the map
so far around the robot [m]."""
LEAVE, LEAVING = 0.3, 50.0
"""Distance from the robot in which a new plan may come too near to walls [m], and its cost there
per metre."""


@dataclass(frozen=True)
class Replanner:
    """Plans on the inflated map and the walls that are seen, as Nav2's planners make them."""

    grid: OccupancyGrid
    """The map that is driven in; all poses are in its own axes."""
    robot: Robot
    """The robot."""

    @cached_property
    def density(self) -> Floats:
        """Cost per metre of each cell on the inflated map, (H, W)."""
        return self._inflated(self.grid.clearance)

    def driven(self, way: Floats, truth: Floats, believed: Floats, world: Any) -> Floats:
        """A way (n, 4) of a car-like robot round what it sees in its way, by the lattice planner.

        Ways have positions [m], gears and headings [rad]. The new one joins the old one a metre
        after its first collision. The old one stays where it has none, or where no way is found.
        """
        from locplan.costs import Costmap
        from locplan.planners import Lattice, path_faults

        scene = self._scene(truth, believed, world)
        if scene is None:
            return way
        low, density, walls, window = scene
        cells = self.grid.cells[window].copy()
        cells[tuple(walls.T)] = OCCUPIED
        seen, shift = OccupancyGrid(cells, self.grid.resolution), low[::-1] * self.grid.resolution
        within = _within(np.floor((way[:, 1::-1] - shift[::-1]) / seen.resolution), cells.shape)
        near = way[: len(way) if within.all() else int(np.argmin(within))]
        if len(near) < 2:
            return way
        ahead = Path(near[:, :2] - shift, near[:, 3])
        faults = path_faults(seen, ahead, self.robot)
        ends = [each.along + each.length for each in faults if each.kind == "collision"]
        if not ends:
            return way
        join = min(int(np.searchsorted(ahead.distance, ends[0] + JOIN[0])), len(near) - 1)
        robot = replace(self.robot, margin=0.0, goal_tolerance=0.0)
        costs = Costmap.from_density(seen, density, robot=robot)
        first = (*(believed[:2] - shift).tolist(), float(believed[2]))
        last = (*ahead.xy[join].tolist(), float(near[join, 3]))
        cells_of_ends = (seen.cell(each[:2]) for each in (first, last))
        if not all(np.isfinite(costs.density[cell]) for cell in cells_of_ends):
            return way
        found = Lattice().solve(costs, first, last).path
        if found is None:
            return way
        even = found.resampled(POINTS, even=True)
        new = geared(np.column_stack([even.xy + shift, even.facing]))
        return np.concatenate([new, way[join + 1 :]])

    def way(self, way: Any, truth: Any, believed: Any, world: Any) -> Floats:
        """A way (n, 2) from the believed pose back to the path, on the map and what is seen.

        It joins the path within some metres where that is cheapest, or else later. The path stays
        where no way is found.
        """
        from locplan._kernels.search import bordered_half, shortest_costs
        from locplan._kernels.ways import trace

        scene = self._scene(truth, believed, world)
        if scene is None:
            return np.asarray(way)
        (low, density, walls, window), resolution = scene, self.grid.resolution
        start = np.floor(believed[1::-1] / resolution).astype(int) - low
        density[self.grid.cells[window] != FREE] = np.inf
        density[tuple(walls.T)] = np.inf
        density[tuple(start)] = LEAVING

        half, columns = bordered_half(density, 1), density.shape[1] + 2
        costs = shortest_costs(half, columns, (start[0] + 1) * columns + start[1] + 1, -1, False)
        along = way_along(way)
        points = np.floor(way[:, ::-1] / resolution).astype(int) - low
        able = _within(points, density.shape) & (along >= min(JOIN[0], along[-1]))
        flat = (points[able] + 1) @ (columns, 1)
        cost = np.full(len(way), np.inf)
        cost[able] = resolution * costs[flat]
        cost += _cost_to_end(way, along, points, density)
        soon = np.where(along <= JOIN[1], cost, np.inf)
        best = int(np.argmin(soon if np.isfinite(soon).any() else cost))
        if not np.isfinite(cost[best]):
            return np.asarray(way)
        cells = trace(half, columns, costs, (points[best] + 1) @ (columns, 1), False)
        centres = (np.column_stack(np.divmod(cells, columns)[::-1]) - 0.5 + low[::-1]) * resolution
        if len(centres) > 1:
            centres = Path(centres).resampled(POINTS).xy
        # The goal stays where it is, and not at the centre of its cell.
        return np.concatenate([centres, way[min(best + 1, len(way) - 1) :]])

    def _scene(self, truth: Any, believed: Any, world: Any) -> tuple[Any, Floats, Ints, Any] | None:
        """The first cell of the part around the believed pose, its density, the cells of walls that
        are seen in it, and its slices of the map; None off the map."""
        resolution = self.grid.resolution
        here, reach = np.floor(believed[1::-1] / resolution).astype(int), AROUND / resolution
        low = np.maximum(here - math.ceil(reach), 0)
        window = tuple(
            slice(a, max(b, 0)) for a, b in zip(low, here + math.ceil(reach), strict=True)
        )
        density = self.density[window].copy()
        if not _within((here - low)[None], density.shape).all():
            return None
        # Walls are seen from the true pose, and put where the believed one has them.
        seen = after_way(believed, way_between(truth, self._seen(truth, world)))
        walls = np.floor(seen[:, 1::-1] / resolution).astype(int) - low
        walls = walls[_within(walls, density.shape)]
        self._add(walls, density)
        # A robot that stands too near to a wall may leave, at a price.
        leave = int(LEAVE / resolution)
        about = tuple(slice(max(0, each - leave), each + leave + 1) for each in here - low)
        density[about] = np.minimum(density[about], LEAVING)
        return low, density, walls, window

    def _add(self, walls: Ints, density: Floats) -> None:
        """Raise a density about further walls, cells (n, 2)."""
        if not len(walls):
            return
        robot = self.robot
        reach = max(robot.radius, inflation_of(robot).inflation_radius)
        margin = math.ceil(reach / self.grid.resolution) + 1
        low = np.maximum(walls.min(axis=0) - margin, 0)
        window = tuple(slice(a, b + margin) for a, b in zip(low, walls.max(axis=0), strict=True))
        cells = np.full(density[window].shape, FREE)
        cells[tuple((walls - low).T)] = OCCUPIED
        more = self._inflated(OccupancyGrid(cells, self.grid.resolution).clearance)
        density[window] = np.maximum(density[window], more)

    def _inflated(self, clearance: Floats) -> Floats:
        """Density at a clearance, which is infinite where the robot does not fit."""
        density = inflated(clearance, self.robot)
        return np.where(clearance < self.robot.radius - 1e-9, np.inf, density)

    def _seen(self, truth: Floats, world: Any) -> Poses:
        """Centres of the true walls near the robot, with heading 0 [m, m, rad]."""
        resolution = world.resolution
        low = np.maximum((truth[1::-1] - SIGHT) / resolution, 0).astype(int)
        high = np.maximum(np.ceil((truth[1::-1] + SIGHT) / resolution), 0).astype(int)
        stops = world.squares[0, 1:-1, 1:-1][low[0] : high[0], low[1] : high[1]] == 0
        rows, cols = np.nonzero(stops)
        xy = (np.column_stack([cols + low[1], rows + low[0]]) + 0.5) * resolution
        return at_heading_0(xy[np.hypot(*(xy - truth[:2]).T) <= SIGHT])


def _cost_to_end(way: Floats, along: Floats, points: Ints, density: Floats) -> Floats:
    """Cost of the rest of a way from each of its points; a metre costs 1 outside of the density."""
    price = np.ones(len(way))
    inside = _within(points, density.shape)
    price[inside] = np.minimum(density[tuple(points[inside].T)], LEAVING)
    steps = np.diff(along) * (price[1:] + price[:-1]) / 2
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)


def geared(poses: Poses) -> Floats:
    """Poses (n, 3) as a way (n, 4) with their gears before the heading."""
    way = np.insert(poses, 2, 1.0, axis=1)
    if len(way) > 1:
        steps, middle = np.diff(way[:, :2], axis=0), (way[1:, 3] + way[:-1, 3]) / 2
        ahead = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
        way[1:, 2] = np.where(ahead < 0, -1.0, 1.0)
        way[0, 2] = way[1, 2]
    return way


def at_heading_0(xy: Floats) -> Poses:
    """Poses at positions, with heading 0."""
    return np.column_stack([xy, np.zeros(len(xy))])


def _within(cells: NDArray[Any], shape: tuple[int, ...]) -> Bools:
    return np.asarray(((cells >= 0) & (cells < shape)).all(axis=1))

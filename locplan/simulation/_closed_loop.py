"""Closed-loop drives: a follower steers the robot by the filter's pose.

Unlike an open-loop drive, which follows its path exactly whatever the filter believes, the robot
leaves the path with the filter's errors, meets walls, and plans again on what it sees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import random_of
from locplan._util.poses import Poses, after_way, way_between
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, own_axes
from locplan.robots import Robot
from locplan.simulation._arrivals import (
    ARRIVED,
    ELSEWHERE,
    FOLLOWER,
    STUCK,
    TIMED_OUT,
    WORLD,
    Arrival,
    Arrivals,
)
from locplan.simulation._drives import OFF
from locplan.simulation._own_filters import OwnLoop
from locplan.simulation._simulator import CLOSED, Simulator
from locplan.simulation._worlds import Stage, inflated, inflation_of

POINTS = 0.05
"""Distance between the points of a path that is followed [m]."""
SIGHT, JOIN, AROUND = 3.0, (1.0, 5.0), 8.0
"""A new plan knows the true walls so far away, joins the path so far ahead, and is made on the map
so far around the robot [m]."""
LEAVE, LEAVING = 0.3, 50.0
"""Distance from the robot in which a new plan may come too near to walls [m], and its cost there
per metre."""
FINE = 0.02
"""Maximum edge of the cells on which a way through a world is looked for [m]."""
PATIENCE = 60.0, 3.0
"""Maximum time of a drive: so long [s], and so many times that of its path."""


def drive_closed(
    simulator: Simulator,
    paths: Mapping[str, Path],
    drives: range,
    *,
    replan: float | None = None,
    perfect: bool = False,
    progress: ProgressCallback | None = None,
) -> dict[str, Arrivals]:
    """Drive along each path several times, steered by the filter's pose.

    Parameters
    ----------
    simulator : Simulator
        The map and the robot, whose outline, speed and goal tolerance count, too.
    paths : mapping of str to Path
        The paths by name.
    drives : range
        Numbers of the drives; each has a world and random numbers of its own.
    replan : float, optional
        Time after which a new plan is made in any case [s]; by default only where something is in
        the way.
    perfect : bool, default False
        Whether the robot knows its true pose, which shows what the follower alone can do.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    dict of str to Arrivals
        The drives along each path.

    Raises
    ------
    ConfigError
        If the robot is car-like.
    """
    loop = ClosedLoop(simulator, dict(paths), replan, perfect)
    found: dict[str, list[Any]] = {name: [None] * len(drives) for name in paths}

    def run(n: int) -> None:
        world = loop.world(drives[n])
        for name in paths:
            found[name][n] = loop.drive(name, world, drives[n])

    _ = loop.density, loop.body  # made once, not by every thread
    simulator.in_threads(run, len(drives), progress, len(drives) * len(paths))
    return {name: Arrivals(tuple(each)) for name, each in found.items()}


def seen_on(
    simulator: Simulator, path: Path, number: int, poses: Poses
) -> list[NDArray[np.float64]]:
    """What the lidar sees on a closed-loop drive along one path.

    Parameters
    ----------
    simulator : Simulator
        The map and the robot.
    path : Path
        The only path of `drive_closed`.
    number : int
        Number of the drive.
    poses : (n, 3) array
        True poses of it, in the world [m, m, rad].

    Returns
    -------
    list of (k, 2) arrays
        Ends of the beams that return, ahead of the robot and to its left [m], for each pose.
    """
    from locplan._kernels.lidar import measured_ends

    loop = ClosedLoop(simulator, {"": path}, None, False)
    world, arguments = loop.world(number), simulator.arguments
    random = random_of(simulator.seed, CLOSED, 0, number, 1)
    cells = own_axes(loop.part, poses)[:, [1, 0, 2]] / (world.resolution, world.resolution, 1)
    found = []
    for cell in cells:
        ends = np.empty((arguments.lidar.angles.size, 2))
        measured_ends(random, *world, cell, arguments.lidar, arguments.disturbances, ends)
        found.append(world.resolution * ends[np.isfinite(ends[:, 0])])
    return found


@dataclass(frozen=True)
class ClosedLoop:
    """Closed-loop drives on the part of a map about some paths, in whose own axes all poses are."""

    simulator: Simulator
    paths: Mapping[str, Path]
    replan: float | None
    perfect: bool

    @cached_property
    def stage(self) -> Stage:
        """The part of the map in which worlds differ."""
        xy = np.concatenate([path.xy for path in self.paths.values()])
        return self.simulator.stage([self.simulator.line(_at(xy))])

    @cached_property
    def part(self) -> OccupancyGrid:
        """The part of the map."""
        return self.simulator.grid.part(*self.stage.window)

    @cached_property
    def frame(self) -> NDArray[np.float64]:
        """Pose of the filter map's own axes [m, m, rad]."""
        return np.asarray(own_axes(self.part, np.array([self.simulator.filter_map.origin]))[0])

    @cached_property
    def body(self) -> Any:
        """The robot's outline and motion as the follower takes them."""
        from locplan._kernels.follower import Body

        robot, kinematics = self.simulator.robot, self.simulator.robot.kinematics
        if kinematics.drive == "car-like":
            raise ConfigError("a car-like robot cannot be steered yet; drive it in the open loop")
        sideways = kinematics.drive == "omnidirectional"
        return Body(_discs(robot), sideways, kinematics.speed, robot.goal_tolerance)

    @cached_property
    def density(self) -> NDArray[np.float64]:
        """Cost per metre of each cell, as Nav2's planners see it on the inflated map, (H, W)."""
        return self._inflated(self.part.clearance)

    def world(self, number: int) -> Any:
        """The world of a drive, that of the open-loop drive of this number."""
        from locplan._kernels.follower import Surroundings

        # Nobody knows what stands in unknown cells: they are no walls, as in the lidar's world.
        return Surroundings(self.stage.world(0, number), self.part.resolution)

    def drive(self, name: str, world: Any, number: int) -> Arrival:
        """Drive once along a path; a drive that fails is repeated with perfect localization."""
        found = self._driven(name, world, number, perfect=self.perfect)
        if found.outcome == ARRIVED:
            return found
        control = found
        if not self.perfect:
            control = self._driven(name, world, number, perfect=True)
        if control.outcome == ARRIVED:
            return found
        return replace(found, fault=FOLLOWER if self._has_way(name, world) else WORLD)

    def _has_way(self, name: str, world: Any) -> bool:
        """Whether a disc within the outline fits through a world from the start to the goal."""
        from scipy.ndimage import label

        # Cells of 2 cm at most: on coarse ones a gap would seem narrower than it is.
        finer = math.ceil(world.resolution / FINE)
        cells = np.where(world.squares[0, 1:-1, 1:-1], FREE, OCCUPIED).astype(np.uint8)
        cells, resolution = cells.repeat(finer, 0).repeat(finer, 1), world.resolution / finer
        clearance, robot = OccupancyGrid(cells, resolution).clearance, self.simulator.robot
        radius = robot.outline.inscribed_radius if robot.outline else robot.footprint
        rooms, _ = label(clearance >= max(radius - resolution / 2, resolution / 2))
        ends = own_axes(self.part, _at(self.paths[name].xy[[0, -1]]))[:, 1::-1]
        reach = self.body.tolerance
        low, high = (
            np.maximum(np.ceil((ends + each) / resolution), 0).astype(int)
            for each in (-reach, reach)
        )
        near = [rooms[a:b, c:d] for (a, c), (b, d) in zip(low, high, strict=True)]
        return bool(np.intersect1d(*near).any())

    def _driven(self, name: str, world: Any, number: int, *, perfect: bool) -> Arrival:
        from locplan._kernels import follower

        random = random_of(self.simulator.seed, CLOSED, 0, number)
        way = own_axes(self.part, _at(self.paths[name].resampled(POINTS, even=True).xy))
        way = np.ascontiguousarray(way[:, :2])
        ahead = way[min(len(way) - 1, 6)] - way[0]
        first = np.array([*way[0], math.atan2(ahead[1], ahead[0])])
        length = self.paths[name].length
        ticks = (PATIENCE[0] + PATIENCE[1] * length / self.body.speed) / follower.TICK
        trace = self._trace(random, first, round(ticks))
        follow = self._follower(random, world, trace, perfect)
        while (decision := follow(way)) == follower.PLAN:
            n, at = trace.counts[follower.TICKS], trace.counts[follower.AT]
            way = self._planned(way[at:], trace.truth[n], trace.believed[n], world)
            trace.counts[follower.AT] = 0
        n = int(trace.counts[follower.TICKS]) + 1
        outcome = {follower.STUCK: STUCK, follower.TIMED_OUT: TIMED_OUT}.get(decision, ARRIVED)
        near = max(OFF, 2 * self.body.tolerance)
        if outcome == ARRIVED and math.dist(trace.truth[n - 1, :2], way[-1]) > near:
            outcome = ELSEWHERE
        of_part = np.array(self.part.origin)
        truth, believed = (after_way(of_part, each[:n]) for each in (trace.truth, trace.believed))
        return Arrival.of(outcome, truth, believed, self.paths[name])

    def _trace(self, random: np.random.Generator, first: Any, ticks: int) -> Any:
        """An empty trace, with this drive's biases of odometry."""
        from locplan._kernels.follower import Trace

        odometry = self.simulator.arguments.odometry
        deviations = [odometry.distance_bias, odometry.heading_bias, odometry.turn_bias]
        biases = np.array([1.0, 0.0, 1.0]) + deviations * random.standard_normal(3)
        truth, believed, reported = np.zeros((3, ticks, 3))
        truth[0] = first
        return Trace(truth, believed, reported, np.zeros(3), biases, np.zeros(8, np.int64))

    def _follower(self, random: Any, world: Any, trace: Any, perfect: bool) -> Any:
        """A function that follows a way until a plan is needed, or the drive has ended."""
        from locplan._kernels.drives import begin
        from locplan._kernels.follower import TICK, follow

        arguments, sensing = self.simulator.arguments, random.spawn(1)[0]
        first = way_between(self.frame, trace.truth[0])
        # Without one the period is longer than any drive.
        period = round(self.replan / TICK) if self.replan else len(trace.truth)
        driven = world, self.body, period
        if arguments.scores is None:
            own = OwnLoop(arguments, self.frame, (random, sensing), first, trace)
            return lambda way: own.follow(way, *driven, perfect)
        tracker = begin(sensing, first, arguments.start, arguments.filter)
        known = (arguments.scores, arguments.lidar, arguments.disturbances, arguments.odometry)
        return lambda way: follow(
            random,
            sensing,
            way,
            *driven,
            self.frame,
            tracker,
            *known,
            arguments.filter,
            perfect,
            trace,
        )

    def _planned(self, way: Any, truth: Any, believed: Any, world: Any) -> NDArray[np.float64]:
        """A way (n, 2) from the believed pose back to the path, on the map and what is seen.

        It joins the path within some metres where that is shortest, or else later. The path stays
        where no way is found.
        """
        from locplan._kernels.search import bordered_half, shortest_costs
        from locplan._kernels.ways import trace

        resolution = self.part.resolution
        here, reach = np.floor(believed[1::-1] / resolution).astype(int), AROUND / resolution
        low = np.maximum(here - math.ceil(reach), 0)
        window = tuple(
            slice(a, max(b, 0)) for a, b in zip(low, here + math.ceil(reach), strict=True)
        )
        density, start = self.density[window].copy(), here - low
        if not _within(start[None], density.shape).all():
            return np.asarray(way)
        # Walls are seen from the true pose, and put where the believed one has them.
        seen = after_way(believed, way_between(truth, self._seen(truth, world)))
        walls = np.floor(seen[:, 1::-1] / resolution).astype(int) - low
        walls = walls[_within(walls, density.shape)]
        self._add(walls, density)
        # A robot that stands too near to a wall may leave, at a price.
        leave = int(LEAVE / resolution)
        about = tuple(slice(max(0, each - leave), each + leave + 1) for each in start)
        density[about] = np.minimum(density[about], LEAVING)
        density[self.part.cells[window] != FREE] = np.inf
        density[tuple(walls.T)] = np.inf
        density[tuple(start)] = LEAVING

        half, columns = bordered_half(density, 1), density.shape[1] + 2
        costs = shortest_costs(half, columns, (start[0] + 1) * columns + start[1] + 1, -1, False)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        points = np.floor(way[:, ::-1] / resolution).astype(int) - low
        able = _within(points, density.shape) & (along >= min(JOIN[0], along[-1]))
        flat = (points[able] + 1) @ (columns, 1)
        cost = np.full(len(way), np.inf)
        cost[able] = resolution * costs[flat]
        cost += along[-1] - along
        soon = np.where(along <= JOIN[1], cost, np.inf)
        best = int(np.argmin(soon if np.isfinite(soon).any() else cost))
        if not np.isfinite(cost[best]):
            return np.asarray(way)
        cells = trace(half, columns, costs, (points[best] + 1) @ (columns, 1), False)
        centres = (np.column_stack(np.divmod(cells, columns)[::-1]) - 0.5 + low[::-1]) * resolution
        if len(centres) > 1:
            centres = Path(centres).resampled(POINTS).xy
        return np.concatenate([centres, way[best + 1 :]])

    def _add(self, walls: NDArray[np.int64], density: NDArray[np.float64]) -> None:
        """Raise a density about further walls, cells (n, 2)."""
        if not len(walls):
            return
        robot = self.simulator.robot
        reach = max(robot.radius, inflation_of(robot).inflation_radius)
        margin = math.ceil(reach / self.part.resolution) + 1
        low = np.maximum(walls.min(axis=0) - margin, 0)
        window = tuple(slice(a, b + margin) for a, b in zip(low, walls.max(axis=0), strict=True))
        cells = np.full(density[window].shape, FREE)
        cells[tuple((walls - low).T)] = OCCUPIED
        more = self._inflated(OccupancyGrid(cells, self.part.resolution).clearance)
        density[window] = np.maximum(density[window], more)

    def _inflated(self, clearance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Density at a clearance, which is infinite where the robot does not fit."""
        density = inflated(clearance, self.simulator.robot)
        return np.where(clearance < self.simulator.robot.radius - 1e-9, np.inf, density)

    def _seen(self, truth: NDArray[np.float64], world: Any) -> Poses:
        """Centres of the true walls near the robot, with heading 0 [m, m, rad]."""
        resolution = world.resolution
        low = np.maximum((truth[1::-1] - SIGHT) / resolution, 0).astype(int)
        high = np.maximum(np.ceil((truth[1::-1] + SIGHT) / resolution), 0).astype(int)
        stops = world.squares[0, 1:-1, 1:-1][low[0] : high[0], low[1] : high[1]] == 0
        rows, cols = np.nonzero(stops)
        xy = (np.column_stack([cols + low[1], rows + low[0]]) + 0.5) * resolution
        return _at(xy[np.hypot(*(xy - truth[:2]).T) <= SIGHT])


def _discs(robot: Robot) -> NDArray[np.float64]:
    """The robot's outline as discs: x, y and radius, (n, 3) [m]."""
    if robot.outline is None:
        return np.array([[0.0, 0.0, robot.footprint]])
    corners = robot.outline.vertices
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edge = np.concatenate(
        [a + np.arange(0, 1, POINTS / math.dist(a, b))[:, None] * (b - a) for a, b in sides]
    )
    return np.column_stack([edge, np.full(len(edge), POINTS / 2)])


def _at(xy: NDArray[np.float64]) -> Poses:
    """Poses at positions, with heading 0."""
    return np.column_stack([xy, np.zeros(len(xy))])


def _within(cells: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.asarray(((cells >= 0) & (cells < shape)).all(axis=1))

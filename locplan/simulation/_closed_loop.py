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
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, own_axes
from locplan.planners import plan_field
from locplan.robots import Inflation, Robot
from locplan.simulation._arrivals import (
    ARRIVED,
    ELSEWHERE,
    STUCK,
    TIMED_OUT,
    Arrival,
    Arrivals,
)
from locplan.simulation._own_filters import OwnLoop
from locplan.simulation._simulator import CLOSED, Simulator
from locplan.simulation._worlds import Stage

ARRIVES = 0.5
"""Distance from the goal within which a robot has arrived, or twice its tolerance [m]."""
POINTS = 0.05
"""Distance between the points of a path that is followed [m]."""
SIGHT, JOIN, AROUND = 3.0, (1.0, 5.0), 8.0
"""A new plan knows the true walls so far away, joins the path so far ahead, and is made on the map
so far around the robot [m]."""
LEAVE, LEAVING = 6, 50.0
"""Cells about the robot that a new plan may pass in any case, and their cost per metre."""
PATIENCE = 60.0, 3.0
"""Maximum time of a drive: so long [s], and so many times that of its path."""


def drive_closed(
    simulator: Simulator,
    paths: Mapping[str, Path],
    drives: range,
    *,
    replan: float | None = None,
    stream: int = 0,
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
        Numbers of the drives.
    replan : float, optional
        Time after which a new plan is made in any case [s]; by default only where something is in
        the way.
    stream : int, default 0
        Number of the stream of random numbers.
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
        world = loop.world(stream, drives[n])
        for name in paths:
            found[name][n] = loop.drive(name, world, stream, drives[n])

    _ = loop.stage, loop.body  # made once, not by every thread
    simulator.in_threads(run, len(drives), progress, len(drives) * len(paths))
    return {name: Arrivals(tuple(each)) for name, each in found.items()}


@dataclass(frozen=True)
class World:
    """The world of a closed-loop drive."""

    stops: NDArray[np.bool_]
    """Cells that are occupied, (H, W)."""
    surroundings: Any
    """`follower.Surroundings`."""


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

    def world(self, stream: int, number: int) -> World:
        """The world of a drive, that of the open-loop drive of this number."""
        from locplan._kernels.follower import Surroundings
        from locplan._kernels.rays import empty_squares

        stops = self.stage.stops_of(stream, number)
        # Nobody knows what stands in unknown cells: they are no walls, as in the lidar's world.
        walls = replace(self.part, cells=np.where(stops, OCCUPIED, FREE).astype(np.uint8))
        clearance = np.minimum(walls.clearance, AROUND)
        return World(stops, Surroundings(empty_squares(stops), clearance, self.part.resolution))

    def drive(self, name: str, world: World, stream: int, number: int) -> Arrival:
        """Drive once along a path; a drive that fails is repeated with perfect localization."""
        found = self._driven(name, world, stream, number, perfect=self.perfect)
        if found.outcome == ARRIVED or self.perfect:
            return found
        control = self._driven(name, world, stream, number, perfect=True)
        return replace(found, follower_fails=control.outcome != ARRIVED)

    def _driven(
        self, name: str, world: World, stream: int, number: int, *, perfect: bool
    ) -> Arrival:
        from locplan._kernels import follower

        random = random_of(self.simulator.seed, CLOSED, stream, number)
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
            way = self._planned(way[at:], trace.truth[n], trace.believed[n], world.stops)
            trace.counts[follower.AT] = 0
        n = int(trace.counts[follower.TICKS]) + 1
        outcome = {follower.STUCK: STUCK, follower.TIMED_OUT: TIMED_OUT}.get(decision, ARRIVED)
        near = max(ARRIVES, 2 * self.body.tolerance)
        if outcome == ARRIVED and math.dist(trace.truth[n - 1, :2], way[-1]) > near:
            outcome = ELSEWHERE
        of_part = np.array(self.part.origin)
        return Arrival(
            outcome, after_way(of_part, trace.truth[:n]), after_way(of_part, trace.believed[:n])
        )

    def _trace(self, random: np.random.Generator, first: Any, ticks: int) -> Any:
        """An empty trace, with this drive's biases of odometry."""
        from locplan._kernels.follower import Trace

        odometry = self.simulator.arguments.odometry
        deviations = [odometry.distance_bias, odometry.heading_bias, odometry.turn_bias]
        biases = np.array([1.0, 0.0, 1.0]) + deviations * random.standard_normal(3)
        truth, believed, reported = np.zeros((3, ticks, 3))
        truth[0] = first
        return Trace(truth, believed, reported, np.zeros(3), biases, np.zeros(8, np.int64))

    def _follower(self, random: Any, world: World, trace: Any, perfect: bool) -> Any:
        """A function that follows a way until a plan is needed, or the drive has ended."""
        from locplan._kernels.drives import begin
        from locplan._kernels.follower import TICK, follow

        arguments, sensing = self.simulator.arguments, random.spawn(1)[0]
        first = way_between(self.frame, trace.truth[0])
        # Without one the period is longer than any drive.
        period = round(self.replan / TICK) if self.replan else len(trace.truth)
        driven = world.surroundings, self.body, period
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

    def _planned(
        self, way: Any, truth: Any, believed: Any, stops: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """A way (n, 2) from the believed pose back to the path, on the map and what is seen.

        It joins the path within some metres where that is shortest, or else later. The path stays
        where no way is found.
        """
        resolution, radius = self.part.resolution, self.simulator.robot.radius
        here = np.floor(believed[1::-1] / resolution).astype(int)
        low = np.maximum(here - math.ceil(AROUND / resolution), 0)
        high = np.maximum(here + math.ceil(AROUND / resolution), 0)
        near = self.part.cells[low[0] : high[0], low[1] : high[1]].copy()
        start, unknown = here - low, near == UNKNOWN
        if not _within(start[None], near.shape).all():
            return np.asarray(way)
        # Walls are seen from the true pose, and put where the believed one has them.
        seen = after_way(believed, way_between(truth, self._seen(truth, stops)))
        to = np.floor(seen[:, 1::-1] / resolution).astype(int) - low
        near[tuple(to[_within(to, near.shape)].T)] = OCCUPIED
        near[tuple(start)] = FREE
        joined = OccupancyGrid(near, resolution)
        density = _inflated(joined.clearance, self.simulator.robot)
        density[(joined.clearance < radius - 1e-9) | unknown] = np.inf
        # A robot that stands too near to a wall may leave, at a price.
        about = tuple(slice(max(0, each - LEAVE), each + LEAVE + 1) for each in start)
        density[about] = np.minimum(density[about], LEAVING)
        to_go = plan_field(Costmap.from_density(joined, density), joined.cell_to_world(*start))

        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        points = np.floor(way[:, ::-1] / resolution).astype(int) - low
        able = _within(points, near.shape) & (along >= min(JOIN[0], along[-1]))
        cost = np.full(len(way), np.inf)
        cost[able] = to_go.cost[tuple(points[able].T)]
        cost += along[-1] - along
        soon = np.where(along <= JOIN[1], cost, np.inf)
        best = int(np.argmin(soon if np.isfinite(soon).any() else cost))
        if not np.isfinite(cost[best]):
            return np.asarray(way)
        back = to_go.path(joined.cell_to_world(*points[best]))
        assert back is not None  # its cost is finite
        back_xy = back.resampled(POINTS).xy[::-1] if back.length else back.xy
        return np.concatenate([back_xy + low[::-1] * resolution, way[best + 1 :]])

    def _seen(self, truth: NDArray[np.float64], stops: NDArray[np.bool_]) -> Poses:
        """Centres of the true walls near the robot, with heading 0 [m, m, rad]."""
        resolution = self.part.resolution
        low = np.maximum((truth[1::-1] - SIGHT) / resolution, 0).astype(int)
        high = np.maximum(np.ceil((truth[1::-1] + SIGHT) / resolution), 0).astype(int)
        rows, cols = np.nonzero(stops[low[0] : high[0], low[1] : high[1]])
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


def _inflated(clearance: NDArray[np.float64], robot: Robot) -> NDArray[np.float64]:
    """Density that Nav2's planners see in the robot's inflated costmap."""
    inflation = robot.inflation or Inflation(inflation_radius=0.7, cost_scaling_factor=3.0)
    cost = 4 * np.exp(-inflation.cost_scaling_factor * (clearance - robot.radius))
    return 1 + np.where(clearance <= inflation.inflation_radius, np.minimum(cost, 4), 0)


def _at(xy: NDArray[np.float64]) -> Poses:
    """Poses at positions, with heading 0."""
    return np.column_stack([xy, np.zeros(len(xy))])


def _within(cells: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.asarray(((cells >= 0) & (cells < shape)).all(axis=1))

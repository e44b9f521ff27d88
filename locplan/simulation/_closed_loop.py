"""Closed-loop drives: a follower steers the robot by the filter's pose.

Unlike an open-loop drive, which follows its path exactly whatever the filter believes, the robot
leaves the path with the filter's errors, meets walls, and plans again on what it sees; a car-like
robot by the lattice planner, where its outline does not fit along its path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from locplan._kernels.arrays import Floats, Octets
from locplan._util.intervals import random_of
from locplan._util.poses import after_way, way_between
from locplan.costs import Path
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, own_axes
from locplan.robots import Robot
from locplan.simulation._arrivals import (
    ABORTED,
    ARRIVED,
    ELSEWHERE,
    FOLLOWER,
    NEAR_GOAL,
    TIMED_OUT,
    WORLD,
    Arrival,
)
from locplan.simulation._own_filters import OwnLoop
from locplan.simulation._replanning import POINTS, Replanner, at_heading_0, geared
from locplan.simulation._simulator import CLOSED, Simulator
from locplan.simulation._worlds import Stage

PATIENCE = 60.0, 3.0
"""Maximum time of a drive: so long [s], and so many times that of its path."""
RETREAT = 0.15
"""Speed of backing off [m/s]."""


@dataclass(frozen=True)
class ClosedLoop:
    """Closed-loop drives along some paths of a map, in whose own axes all poses are."""

    simulator: Simulator
    paths: Mapping[str, Path]
    replan: float | None
    perfect: bool

    @cached_property
    def stage(self) -> Stage:
        """The whole map, for a lost robot may drive anywhere."""
        return self.simulator.stage()

    @property
    def grid(self) -> OccupancyGrid:
        """The map."""
        return self.simulator.grid

    @cached_property
    def frame(self) -> Floats:
        """Pose of the filter map's own axes [m, m, rad]."""
        return np.asarray(own_axes(self.grid, np.array([self.simulator.filter_map.origin]))[0])

    @cached_property
    def body(self) -> Any:
        """The robot's outline and motion as the follower takes them."""
        from locplan._kernels.bodies import Body

        robot, kinematics = self.simulator.robot, self.simulator.robot.kinematics
        sideways = kinematics.drive == "omnidirectional"
        return Body(
            discs=_discs(robot),
            omnidirectional=sideways,
            speed=kinematics.speed,
            tolerance=robot.goal_tolerance,
            radius=kinematics.turning_radius,
            retreat=0.0 if self._is_car and not kinematics.reverse else RETREAT,
        )

    @property
    def _is_car(self) -> bool:
        """Whether the robot turns on a radius."""
        return self.simulator.robot.kinematics.turning_radius > 0

    @cached_property
    def planner(self) -> Replanner:
        """What leads a hindered robot back to its path."""
        return Replanner(self.grid, self.simulator.robot)

    def world(self, route: int, number: int) -> Any:
        """Return the world of a drive of a route, see `locplan.simulation.driver.route_key`."""
        from locplan._kernels.bodies import Surroundings

        # Nobody knows what stands in unknown cells: they are no walls, as in the lidar's world.
        return Surroundings(self.stage.world(route, number), self.grid.resolution)

    def drive(self, name: str, world: Any, route: int, number: int) -> Arrival:
        """Drive once along a path; a drive that fails is repeated with perfect localization."""
        found = self._driven(name, world, (route, number), perfect=self.perfect)
        if found.outcome == ARRIVED:
            return found
        control = found
        if not self.perfect:
            control = self._driven(name, world, (route, number), perfect=True)
        if control.outcome == ARRIVED:
            return found
        return replace(found, fault=FOLLOWER if self._has_way(name, world) else WORLD)

    def _has_way(self, name: str, world: Any) -> bool:
        """Whether a disc within the outline fits through a world from the start to the goal; for a
        car-like robot whether the outline does along the path."""
        if self._is_car:
            return self._is_clear(self.paths[name], world)
        cells = np.where(world.squares[0, 1:-1, 1:-1], FREE, OCCUPIED).astype(np.uint8)
        robot, resolution = self.simulator.robot, world.resolution
        radius = robot.outline.inscribed_radius if robot.outline else robot.footprint
        # A wide way shows on the map's own cells, in a hundredth of the time.
        if self._joins_ends(name, cells, resolution, radius + resolution):
            return True
        # Cells of 2 cm at most: on coarse ones a gap would seem narrower than it is.
        finer = math.ceil(resolution / 0.02)
        cells, resolution = cells.repeat(finer, 0).repeat(finer, 1), resolution / finer
        clearance = max(radius - resolution / 2, resolution / 2)
        return self._joins_ends(name, cells, resolution, clearance)

    def _joins_ends(self, name: str, cells: Octets, resolution: float, clearance: float) -> bool:
        """Whether cells with a clearance join the start and the goal of a path."""
        from scipy.ndimage import label

        rooms, _ = label(OccupancyGrid(cells, resolution).clearance >= clearance)
        ends = own_axes(self.grid, at_heading_0(self.paths[name].xy[[0, -1]]))[:, 1::-1]
        reach = self.body.tolerance
        low, high = (
            np.maximum(np.ceil((ends + each) / resolution), 0).astype(int)
            for each in (-reach, reach)
        )
        near = [rooms[a:b, c:d] for (a, c), (b, d) in zip(low, high, strict=True)]
        return bool(np.intersect1d(*near).any())

    def _is_clear(self, path: Path, world: Any) -> bool:
        """Whether the outline keeps the follower's distance from a world's walls along a path."""
        from locplan._kernels.bodies import margin_at
        from locplan._kernels.pursuit import MARGIN

        path = path.resampled(POINTS / 2)
        poses = own_axes(self.grid, np.column_stack([path.xy, path.facing]))
        return all(margin_at(world, self.body, *pose, 2 * MARGIN) >= MARGIN for pose in poses)

    def _driven(self, name: str, world: Any, drive: tuple[int, int], *, perfect: bool) -> Arrival:
        from locplan._kernels import follower, pursuit

        random = random_of(self.simulator.seed, CLOSED, *drive)
        way, first = self._way(name)
        length = self.paths[name].length
        ticks = (PATIENCE[0] + PATIENCE[1] * length / self.body.speed) / pursuit.TICK
        trace = self._trace(random, first, round(ticks))
        follow = self._follower(random, world, trace, perfect)
        while (decision := follow(way)) == follower.PLAN:
            n, at = trace.counts[pursuit.TICKS], trace.counts[pursuit.AT]
            way = way[at:]
            where = trace.truth[n], trace.believed[n], world
            if self._is_car:
                way = self.planner.driven(way, *where)
            else:
                new = self.planner.way(way[:, :2], *where)
                way = np.insert(new, 2, 1.0, axis=1)
            trace.counts[pursuit.AT] = 0
        n = int(trace.counts[pursuit.TICKS]) + 1
        outcome = {follower.ABORTED: ABORTED, follower.TIMED_OUT: TIMED_OUT}.get(decision, ARRIVED)
        near = max(NEAR_GOAL, 2 * self.body.tolerance)
        if outcome == ARRIVED and math.dist(trace.truth[n - 1, :2], way[-1, :2]) > near:
            outcome = ELSEWHERE
        origin = np.array(self.grid.origin)
        truth, believed = (after_way(origin, each[:n]) for each in (trace.truth, trace.believed))
        standstills = int(trace.counts[pursuit.STANDSTILLS])
        return Arrival.of(outcome, truth, believed, self.paths[name], standstills)

    def _way(self, name: str) -> tuple[Floats, Floats]:
        """The way of a path as the follower takes it, with headings where the robot is a car, and
        the pose that it begins at."""
        path = self.paths[name].resampled(POINTS, even=True)
        poses = own_axes(self.grid, np.column_stack([path.xy, path.facing]))
        if self._is_car:
            return geared(poses), poses[0]
        way = np.insert(poses[:, :2], 2, 1.0, axis=1)
        ahead = way[min(len(way) - 1, 6)] - way[0]
        return way, np.array([*way[0, :2], math.atan2(ahead[1], ahead[0])])

    def _trace(self, random: np.random.Generator, first: Any, ticks: int) -> Any:
        """An empty trace, with this drive's biases of odometry."""
        from locplan._kernels.pursuit import Trace

        odometry = self.simulator.arguments.odometry
        deviations = [odometry.distance_bias, odometry.heading_bias, odometry.turn_bias]
        biases = np.array([1.0, 0.0, 1.0]) + deviations * random.standard_normal(3)
        truth, believed, reported = np.zeros((3, ticks, 3))
        truth[0] = first
        return Trace(truth, believed, reported, np.zeros(3), biases, np.zeros(8, np.int64))

    def _follower(self, random: Any, world: Any, trace: Any, perfect: bool) -> Any:
        """A function that follows a way until a plan is needed, or the drive has ended."""
        from locplan._kernels.drives import begin
        from locplan._kernels.follower import follow
        from locplan._kernels.pursuit import TICK

        arguments, sensing = self.simulator.arguments, random.spawn(1)[0]
        first = way_between(self.frame, trace.truth[0])
        # Without one the period is longer than any drive.
        period = max(1, round(self.replan / TICK)) if self.replan else len(trace.truth)
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


def _discs(robot: Robot) -> Floats:
    """The robot's outline as discs: x, y and radius, (n, 3) [m]."""
    if robot.outline is None:
        return np.array([[0.0, 0.0, robot.footprint]])
    corners = robot.outline.vertices
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edge = np.concatenate(
        [a + np.arange(0, 1, POINTS / math.dist(a, b))[:, None] * (b - a) for a, b in sides]
    )
    return np.column_stack([edge, np.full(len(edge), POINTS / 2)])

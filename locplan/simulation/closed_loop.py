"""Closed-loop drives: a follower steers the robot by the estimated pose, and replans if
hindered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.intervals import make_generator
from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets
from locplan._support.poses import Poses, apply_motions, compute_motions, compute_travel_distances
from locplan.maps.grid import OccupancyGrid, world_to_map_frame
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import (
    ABORTED,
    ARRIVED,
    ELSEWHERE,
    FOLLOWER_FAULT,
    NEAR_GOAL,
    TIMED_OUT,
    WORLD_FAULT,
    ClosedLoopDrive,
)
from locplan.simulation.custom_filters import CustomFilterLoop
from locplan.simulation.simulator import CLOSED_LOOP_STREAM, Simulator
from locplan.simulation.worlds import WorldRegion, compute_inflated_density, get_inflation

POINT_SPACING = 0.05
"""Distance between the points of a path that is followed [m]."""
SIGHT_RANGE, JOIN_DISTANCES, SCENE_RANGE = 3.0, (1.0, 5.0), 8.0
"""A new plan knows the true walls so far away, joins the path so far ahead, and is made on the map
so far around the robot [m]."""
LEAVE_DISTANCE, LEAVE_COST = 0.3, 50.0
"""Distance from the robot in which a new plan may come too near to walls [m], and its cost there
per metre."""


@dataclass(frozen=True)
class Replanner:
    """Plans on the inflated map and the walls that are seen, as Nav2's planners make them."""

    grid: OccupancyGrid
    """The map that is driven in; all poses are in its own axes."""
    robot: Robot
    """The robot."""
    no_go: Bools
    """Mask of the cells in no-go zones, (H, W)."""

    @cached_property
    def density(self) -> Floats:
        """Cost per metre of each cell on the inflated map, (H, W)."""
        return np.where(self.no_go, np.inf, self._compute_density(self.grid.clearance))

    def plan_car_way(
        self, way: Floats, true_pose: Floats, believed_pose: Floats, world: Any
    ) -> Floats:
        """Return a car-like robot's way (n, 4) round seen obstacles, by the lattice planner.

        Ways have positions [m], gears and headings [rad]. The new way joins the old way a metre
        after its first collision. The old way stays if it is free, or if no new way is found.
        """
        from locplan.planning.costmap import Costmap
        from locplan.planning.lattice import Lattice
        from locplan.planning.path_check import find_path_faults

        scene = self._crop_scene(true_pose, believed_pose, world)
        if scene is None:
            return way
        low, density, walls, window = scene
        cells = self.grid.cells[window].copy()
        cells[tuple(walls.T)] = OCCUPIED
        local_map, shift = (
            OccupancyGrid(cells, self.grid.resolution),
            low[::-1] * self.grid.resolution,
        )
        within = _are_inside_grid(
            np.floor((way[:, 1::-1] - shift[::-1]) / local_map.resolution), cells.shape
        )
        near = way[: len(way) if within.all() else int(np.argmin(within))]
        if len(near) < 2:
            return way
        ahead = Path(near[:, :2] - shift, near[:, 3])
        faults = find_path_faults(local_map, ahead, self.robot)
        ends = [fault.along + fault.length for fault in faults if fault.kind == "collision"]
        if not ends:
            return way
        join = min(int(np.searchsorted(ahead.distance, ends[0] + JOIN_DISTANCES[0])), len(near) - 1)
        robot = replace(self.robot, margin=0.0, goal_tolerance=0.0)
        costs = Costmap.from_density(local_map, density, robot=robot)
        first = (*(believed_pose[:2] - shift).tolist(), float(believed_pose[2]))
        last = (*ahead.xy[join].tolist(), float(near[join, 3]))
        cells_of_ends = (local_map.cell(fault[:2]) for fault in (first, last))
        if not all(np.isfinite(costs.density[cell]) for cell in cells_of_ends):
            return way
        detour = Lattice().solve(costs, first, last).path
        if detour is None:
            return way
        even = detour.resample(POINT_SPACING, even=True)
        new = add_gears(np.column_stack([even.xy + shift, even.facing]))
        return np.concatenate([new, way[join + 1 :]])

    def plan_way(self, way: Any, true_pose: Any, believed_pose: Any, world: Any) -> Floats:
        """Return a way (n, 2) from the estimated pose to the path, past mapped and seen walls.

        It joins the path at the cheapest point within some metres, otherwise later. The path stays
        if no way is found.
        """
        from locplan._support.kernels.search import (
            compute_shortest_costs,
            make_bordered_half_density,
        )
        from locplan._support.kernels.ways import trace_path

        scene = self._crop_scene(true_pose, believed_pose, world)
        if scene is None:
            return np.asarray(way)
        (low, density, walls, window), resolution = scene, self.grid.resolution
        start = np.floor(believed_pose[1::-1] / resolution).astype(int) - low
        density[self.grid.cells[window] != FREE] = np.inf
        density[tuple(walls.T)] = np.inf
        density[tuple(start)] = LEAVE_COST

        half, columns = make_bordered_half_density(density, 1), density.shape[1] + 2
        costs = compute_shortest_costs(
            half, columns, (start[0] + 1) * columns + start[1] + 1, -1, False
        )
        along = compute_travel_distances(way)
        points = np.floor(way[:, ::-1] / resolution).astype(int) - low
        able = _are_inside_grid(points, density.shape) & (
            along >= min(JOIN_DISTANCES[0], along[-1])
        )
        flat = (points[able] + 1) @ (columns, 1)
        cost = np.full(len(way), np.inf)
        cost[able] = resolution * costs[flat]
        cost += _compute_cost_to_end(way, along, points, density)
        soon = np.where(along <= JOIN_DISTANCES[1], cost, np.inf)
        best = int(np.argmin(soon if np.isfinite(soon).any() else cost))
        if not np.isfinite(cost[best]):
            return np.asarray(way)
        cells = trace_path(half, columns, costs, (points[best] + 1) @ (columns, 1), False)
        centres = (np.column_stack(np.divmod(cells, columns)[::-1]) - 0.5 + low[::-1]) * resolution
        if len(centres) > 1:
            centres = Path(centres).resample(POINT_SPACING).xy
        # The goal stays where it is, and not at the centre of its cell.
        return np.concatenate([centres, way[min(best + 1, len(way) - 1) :]])

    def _crop_scene(
        self, true_pose: Any, believed_pose: Any, world: Any
    ) -> tuple[Any, Floats, Ints, Any] | None:
        """The first cell of the part around the believed pose, its density, the cells of walls that
        are seen in it, and its slices of the map; None off the map."""
        resolution = self.grid.resolution
        robot_cell, reach = (
            np.floor(believed_pose[1::-1] / resolution).astype(int),
            SCENE_RANGE / resolution,
        )
        low = np.maximum(robot_cell - math.ceil(reach), 0)
        window = tuple(
            slice(a, max(b, 0)) for a, b in zip(low, robot_cell + math.ceil(reach), strict=True)
        )
        density = self.density[window].copy()
        if not _are_inside_grid((robot_cell - low)[None], density.shape).all():
            return None
        # Walls are seen from the true pose, and put where the believed one has them.
        wall_poses = apply_motions(
            believed_pose, compute_motions(true_pose, self._find_seen_walls(true_pose, world))
        )
        walls = np.floor(wall_poses[:, 1::-1] / resolution).astype(int) - low
        walls = walls[_are_inside_grid(walls, density.shape)]
        self._raise_density(walls, density)
        # A robot that stands too near to a wall may leave, at a price.
        leave = int(LEAVE_DISTANCE / resolution)
        leave_window = tuple(
            slice(max(0, coordinate - leave), coordinate + leave + 1)
            for coordinate in robot_cell - low
        )
        density[leave_window] = np.minimum(density[leave_window], LEAVE_COST)
        if not self.no_go[tuple(robot_cell)]:  # a robot that is lost may have to leave a zone
            density[self.no_go[window]] = np.inf
        return low, density, walls, window

    def _raise_density(self, walls: Ints, density: Floats) -> None:
        """Raise a density about further walls, cells (n, 2)."""
        if not len(walls):
            return
        robot = self.robot
        reach = max(robot.radius, get_inflation(robot).inflation_radius)
        margin = math.ceil(reach / self.grid.resolution) + 1
        low = np.maximum(walls.min(axis=0) - margin, 0)
        window = tuple(slice(a, b + margin) for a, b in zip(low, walls.max(axis=0), strict=True))
        cells = np.full(density[window].shape, FREE)
        cells[tuple((walls - low).T)] = OCCUPIED
        wall_density = self._compute_density(OccupancyGrid(cells, self.grid.resolution).clearance)
        density[window] = np.maximum(density[window], wall_density)

    def _compute_density(self, clearance: Floats) -> Floats:
        """Return the density at a clearance, infinite if the robot does not fit."""
        density = compute_inflated_density(clearance, self.robot)
        return np.where(clearance < self.robot.radius - 1e-9, np.inf, density)

    def _find_seen_walls(self, truth: Floats, world: Any) -> Poses:
        """Centres of the true walls near the robot, with heading 0 [m, m, rad]."""
        resolution = world.resolution
        low = np.maximum((truth[1::-1] - SIGHT_RANGE) / resolution, 0).astype(int)
        high = np.maximum(np.ceil((truth[1::-1] + SIGHT_RANGE) / resolution), 0).astype(int)
        stops = world.squares[0, 1:-1, 1:-1][low[0] : high[0], low[1] : high[1]] == 0
        rows, cols = np.nonzero(stops)
        xy = (np.column_stack([cols + low[1], rows + low[0]]) + 0.5) * resolution
        return poses_from_positions(xy[np.hypot(*(xy - truth[:2]).T) <= SIGHT_RANGE])


def _compute_cost_to_end(way: Floats, along: Floats, points: Ints, density: Floats) -> Floats:
    """Cost of the rest of a way from each of its points; a metre costs 1 outside of the density."""
    price = np.ones(len(way))
    inside = _are_inside_grid(points, density.shape)
    price[inside] = np.minimum(density[tuple(points[inside].T)], LEAVE_COST)
    steps = np.diff(along) * (price[1:] + price[:-1]) / 2
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)


def add_gears(poses: Poses) -> Floats:
    """Poses (n, 3) as a way (n, 4) with their gears before the heading."""
    way = np.insert(poses, 2, 1.0, axis=1)
    if len(way) > 1:
        steps, middle = np.diff(way[:, :2], axis=0), (way[1:, 3] + way[:-1, 3]) / 2
        ahead = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
        way[1:, 2] = np.where(ahead < 0, -1.0, 1.0)
        way[0, 2] = way[1, 2]
    return way


def poses_from_positions(xy: Floats) -> Poses:
    """Poses at positions, with heading 0."""
    return np.column_stack([xy, np.zeros(len(xy))])


def _are_inside_grid(cells: NDArray[Any], shape: tuple[int, ...]) -> Bools:
    return np.asarray(((cells >= 0) & (cells < shape)).all(axis=1))


TIME_LIMITS = 60.0, 3.0
"""Maximum time of a drive: so long [s], and so many times that of its path."""
RETREAT_SPEED = 0.15
"""Speed of backing off [m/s]."""


@dataclass(frozen=True)
class ClosedLoop:
    """Closed-loop drives along some paths of a map. All poses are in the map's axes."""

    simulator: Simulator
    paths: Mapping[str, Path]
    replan: float | None
    perfect: bool

    @cached_property
    def whole_region(self) -> WorldRegion:
        """The whole map, for a lost robot may drive anywhere."""
        return self.simulator.make_world_region()

    @property
    def grid(self) -> OccupancyGrid:
        """The map."""
        return self.simulator.grid

    @cached_property
    def filter_map_frame(self) -> Floats:
        """Pose of the filter map's axes [m, m, rad]."""
        return np.asarray(
            world_to_map_frame(self.grid, np.array([self.simulator.filter_map.origin]))[0]
        )

    @cached_property
    def robot_body(self) -> Any:
        """The robot's outline and motion as the follower takes them."""
        from locplan.simulation.kernels.bodies import RobotBody

        robot, kinematics = self.simulator.robot, self.simulator.robot.kinematics
        sideways = kinematics.drive == "omnidirectional"
        return RobotBody(
            discs=_discs_from_outline(robot),
            omnidirectional=sideways,
            speed=kinematics.speed,
            tolerance=robot.goal_tolerance,
            radius=kinematics.turning_radius,
            retreat=0.0 if self._is_car and not kinematics.reverse else RETREAT_SPEED,
        )

    @property
    def _is_car(self) -> bool:
        """Whether the robot turns on a radius."""
        return self.simulator.robot.kinematics.turning_radius > 0

    @cached_property
    def planner(self) -> Replanner:
        """What leads a hindered robot back to its path."""
        closed = self.simulator.zones.cells(self.grid, "no-go")
        return Replanner(self.grid, self.simulator.robot, closed)

    def make_world(self, route: int, number: int) -> Any:
        """Return the world of a drive of a route, by the key of `driver.compute_route_key`."""
        from locplan.simulation.kernels.bodies import DriveWorld

        # Nobody knows what stands in unknown cells: they are no walls, as in the lidar's world.
        return DriveWorld(self.whole_region.make_world(route, number), self.grid.resolution)

    def drive(self, path_name: str, world: Any, route: int, number: int) -> ClosedLoopDrive:
        """Drive once along a path; a drive that fails is repeated with perfect localization."""
        arrival = self._drive_once(path_name, world, (route, number), perfect=self.perfect)
        if arrival.outcome == ARRIVED:
            return arrival
        control = arrival
        if not self.perfect:
            control = self._drive_once(path_name, world, (route, number), perfect=True)
        if control.outcome == ARRIVED:
            return arrival
        return replace(
            arrival,
            fault=FOLLOWER_FAULT if self._is_goal_reachable(path_name, world) else WORLD_FAULT,
        )

    def _is_goal_reachable(self, path_name: str, world: Any) -> bool:
        """Whether a disc within the outline fits through a world from the start to the goal; for a
        car-like robot whether the outline does along the path."""
        if self._is_car:
            return self._is_path_clear(self.paths[path_name], world)
        cells = np.where(world.squares[0, 1:-1, 1:-1], FREE, OCCUPIED).astype(np.uint8)
        robot, resolution = self.simulator.robot, world.resolution
        radius = robot.outline.inscribed_radius if robot.outline else robot.footprint
        # A wide way shows on the map's own cells, in a hundredth of the time.
        if self._are_ends_connected(path_name, cells, resolution, radius + resolution):
            return True
        # Cells of 2 cm at most: on coarse ones a gap would seem narrower than it is.
        finer = math.ceil(resolution / 0.02)
        cells, resolution = cells.repeat(finer, 0).repeat(finer, 1), resolution / finer
        clearance = max(radius - resolution / 2, resolution / 2)
        return self._are_ends_connected(path_name, cells, resolution, clearance)

    def _are_ends_connected(
        self, path_name: str, cells: Octets, resolution: float, clearance: float
    ) -> bool:
        """Whether cells with a clearance join the start and the goal of a path."""
        from scipy.ndimage import label

        rooms, _ = label(OccupancyGrid(cells, resolution).clearance >= clearance)
        ends = world_to_map_frame(
            self.grid, poses_from_positions(self.paths[path_name].xy[[0, -1]])
        )[:, 1::-1]
        reach = self.robot_body.tolerance
        low, high = (
            np.maximum(np.ceil((ends + offset) / resolution), 0).astype(int)
            for offset in (-reach, reach)
        )
        near = [rooms[a:b, c:d] for (a, c), (b, d) in zip(low, high, strict=True)]
        return bool(np.intersect1d(*near).any())

    def _is_path_clear(self, path: Path, world: Any) -> bool:
        """Whether the outline keeps the follower's distance from a world's walls along a path."""
        from locplan.simulation.kernels.bodies import measure_margin
        from locplan.simulation.kernels.pursuit import MARGIN

        path = path.resample(POINT_SPACING / 2)
        poses = world_to_map_frame(self.grid, np.column_stack([path.xy, path.facing]))
        return all(
            measure_margin(world, self.robot_body, *pose, 2 * MARGIN) >= MARGIN for pose in poses
        )

    def _drive_once(
        self, path_name: str, world: Any, drive_key: tuple[int, int], *, perfect: bool
    ) -> ClosedLoopDrive:
        from locplan.simulation.kernels import follower, pursuit

        random = make_generator(self.simulator.seed, CLOSED_LOOP_STREAM, *drive_key)
        way, first = self._make_follower_way(path_name)
        length = self.paths[path_name].length
        ticks = (TIME_LIMITS[0] + TIME_LIMITS[1] * length / self.robot_body.speed) / pursuit.TICK
        trace = self._make_trace(random, first, round(ticks))
        follow = self._make_follower(random, world, trace, perfect)
        while (decision := follow(way)) == follower.PLAN:
            n, at = trace.counts[pursuit.TICKS], trace.counts[pursuit.AT]
            way = way[at:]
            drive_state = trace.truth[n], trace.believed[n], world
            if self._is_car:
                way = self.planner.plan_car_way(way, *drive_state)
            else:
                new = self.planner.plan_way(way[:, :2], *drive_state)
                way = np.insert(new, 2, 1.0, axis=1)
            trace.counts[pursuit.AT] = 0
        n = int(trace.counts[pursuit.TICKS]) + 1
        outcome = {follower.ABORTED: ABORTED, follower.TIMED_OUT: TIMED_OUT}.get(decision, ARRIVED)
        near = max(NEAR_GOAL, 2 * self.robot_body.tolerance)
        if outcome == ARRIVED and math.dist(trace.truth[n - 1, :2], way[-1, :2]) > near:
            outcome = ELSEWHERE
        origin = np.array(self.grid.origin)
        truth, believed = (
            apply_motions(origin, track[:n]) for track in (trace.truth, trace.believed)
        )
        standstills = int(trace.counts[pursuit.STANDSTILLS])
        return ClosedLoopDrive.from_drive(
            outcome, truth, believed, self.paths[path_name], standstills
        )

    def _make_follower_way(self, path_name: str) -> tuple[Floats, Floats]:
        """Return a path as the follower takes it, with headings for a car, and its first pose."""
        path = self.paths[path_name].resample(POINT_SPACING, even=True)
        poses = world_to_map_frame(self.grid, np.column_stack([path.xy, path.facing]))
        if self._is_car:
            return add_gears(poses), poses[0]
        way = np.insert(poses[:, :2], 2, 1.0, axis=1)
        ahead = way[min(len(way) - 1, 6)] - way[0]
        return way, np.array([*way[0, :2], math.atan2(ahead[1], ahead[0])])

    def _make_trace(self, random: np.random.Generator, first_pose: Any, n_ticks: int) -> Any:
        """An empty trace, with this drive's biases of odometry."""
        from locplan.simulation.kernels.pursuit import DriveTrace

        odometry = self.simulator.arguments.odometry
        deviations = [odometry.distance_bias, odometry.heading_bias, odometry.turn_bias]
        biases = np.array([1.0, 0.0, 1.0]) + deviations * random.standard_normal(3)
        truth, believed, reported = np.zeros((3, n_ticks, 3))
        truth[0] = first_pose
        return DriveTrace(truth, believed, reported, np.zeros(3), biases, np.zeros(8, np.int64))

    def _make_follower(self, random: Any, world: Any, trace: Any, perfect: bool) -> Any:
        """A function that follows a way until a plan is needed, or the drive has ended."""
        from locplan._support.kernels.drives import start_filter
        from locplan.simulation.kernels.follower import follow_path
        from locplan.simulation.kernels.pursuit import TICK

        arguments, sensing = self.simulator.arguments, random.spawn(1)[0]
        first = compute_motions(self.filter_map_frame, trace.truth[0])
        # Without one the period is longer than any drive.
        period = max(1, round(self.replan / TICK)) if self.replan else len(trace.truth)
        drive_inputs = world, self.robot_body, period
        if arguments.scores is None:
            custom_loop = CustomFilterLoop(
                arguments, self.filter_map_frame, (random, sensing), first, trace
            )
            return lambda way: custom_loop.follow(way, *drive_inputs, perfect)
        tracker = start_filter(sensing, first, arguments.start, arguments.filter)
        sensor_arguments = (
            arguments.scores,
            arguments.lidar,
            arguments.disturbances,
            arguments.odometry,
        )
        return lambda way: follow_path(
            random,
            sensing,
            way,
            *drive_inputs,
            self.filter_map_frame,
            tracker,
            *sensor_arguments,
            arguments.filter,
            perfect,
            trace,
        )


def _discs_from_outline(robot: Robot) -> Floats:
    """The robot's outline as discs: x, y and radius, (n, 3) [m]."""
    if robot.outline is None:
        return np.array([[0.0, 0.0, robot.footprint]])
    corners = robot.outline.vertices
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edge = np.concatenate(
        [a + np.arange(0, 1, POINT_SPACING / math.dist(a, b))[:, None] * (b - a) for a, b in sides]
    )
    return np.column_stack([edge, np.full(len(edge), POINT_SPACING / 2)])

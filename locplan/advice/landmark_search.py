"""Greedy search for landmarks among the allowed places."""

from __future__ import annotations

import copy
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.poses import compute_travel_distances
from locplan._support.progress import ProgressCallback
from locplan.advice.landmark_objects import ObjectShape, compute_outline_points, find_filled_cells
from locplan.advice.landmark_sight import PlacementObjective
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import UNKNOWN
from locplan.planning.path import Path

PASSAGE_RADIUS = 3.0
"""Radius around an object within which the robot must find a way past it [m]."""

Pose = Floats
"""Row, column and heading on the map, (3,) [cells, cells, rad]."""


class RobotSpace:
    """Free space for the centre of a robot between the placed objects.

    An object cuts a passage if it disconnects space within `PASSAGE_RADIUS`: for the robot alone,
    since it may have to pass a narrow door, or for the robot with a clearance.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    shape : Shape
        Outline of the objects.
    robot_radius, clearance : float
        Radius of the robot, and its additional clearance [m].
    """

    def __init__(
        self, grid: OccupancyGrid, shape: ObjectShape, robot_radius: float, clearance: float
    ) -> None:
        self.grid, self.shape = grid, shape
        self.free_by_radius = {
            radius: grid.free & ~grid.cells_near_walls(radius - 1e-9)
            for radius in sorted({robot_radius, robot_radius + clearance})
        }

    def close_around(self, pose: Pose) -> None:
        """Close the space around a newly placed object."""
        for radius, space in self.free_by_radius.items():
            window, distances = self.shape.compute_window_distances(self.grid, pose, radius)
            space[window] &= distances >= radius - 1e-9

    def copy(self) -> RobotSpace:
        """Return a copy for further objects."""
        other = copy.copy(self)
        other.free_by_radius = {
            radius: space.copy() for radius, space in self.free_by_radius.items()
        }
        return other

    def is_cut_by(self, pose: Pose) -> bool:
        """True if an object at a pose would cut a passage."""
        return any(
            self._is_cut_by(radius, pose, 2 * self.grid.resolution)
            and self._is_cut_by(radius, pose, PASSAGE_RADIUS)  # the small window decides most cases
            for radius in self.free_by_radius
        )

    def _is_cut_by(self, radius: float, pose: Pose, search_margin: float) -> bool:
        import cv2

        window, distances = self.shape.compute_window_distances(
            self.grid, pose, radius + search_margin
        )
        before = self.free_by_radius[radius][window]
        after = before & (distances >= radius - 1e-9)
        if (after == before).all():
            return False
        _, parts, statistics, _ = cv2.connectedComponentsWithStats(
            after.astype("u1"), connectivity=4
        )
        # Area of free space that may be closed off, since it is no passage [m^2].
        min_cells = 0.25 / self.grid.resolution**2 if search_margin >= PASSAGE_RADIUS else 0
        large = np.flatnonzero(statistics[:, cv2.CC_STAT_AREA] >= min_cells)
        large = large[large > 0]
        if large.size < 2:
            return False
        _, old_parts = cv2.connectedComponents(before.astype("u1"), connectivity=4)
        owners = [old_parts[parts == part][0] for part in large.tolist()]
        return any(
            owners.count(part_label) > 1
            for part_label in np.unique(old_parts[before & ~after]).tolist()
        )


WALL_GAP, OBJECT_GAP = 0.05, 0.05
"""Minimum distance of an object from a wall, and between two objects [m]."""
SPACING = 0.5
"""Distance between the places along walls and beside routes [m]."""
CLEARANCE = 0.2
"""Distance that routes and passages keep from the objects, added to the robot's radius [m]."""


def format_reason_counts(reasons: Iterable[str]) -> str:
    """Return the number of refused places by reason, as text."""
    counts = Counter(reasons).items()
    return ", ".join(f"{reason} ({count})" for reason, count in counts) or "there are no places"


def list_candidate_places(
    grid: OccupancyGrid, shape: ObjectShape, routes: Iterable[Path], route_clearance: float
) -> Floats:
    """Return poses of an object along walls and free-standing, not yet checked, (n, 3).

    Objects along walls are aligned with the wall; long free-standing objects have two headings.
    """
    return np.concatenate(
        [
            _place_along_walls(grid, shape),
            _place_free_standing(grid, shape),
            _place_beside_routes(grid, shape, routes, route_clearance),
        ]
    )


def _place_along_walls(grid: OccupancyGrid, shape: ObjectShape) -> Floats:
    """Return poses every `SPACING` [m] along the walls, at least `WALL_GAP` from them."""
    import cv2

    resolution = grid.resolution
    distance = shape.half_width + WALL_GAP + resolution
    clear = np.where(grid.free, grid.clearance, 0.0)
    mask = (clear >= distance).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    pose_lists = [np.empty((0, 3))]
    for contour in contours:
        at = contour[:, 0, ::-1].astype(np.float64) + 0.5  # (row, col) of the cells' centres
        ring = np.concatenate([at, at[:1]])
        way = compute_travel_distances(ring) * resolution
        count = max(1, int(way[-1] / SPACING))
        sample_distances = (np.arange(count) + 0.5) * way[-1] / count
        # Half the length along a wall over which its direction is measured [m].
        half = min(0.25, way[-1] / 4)
        length = max(way[-1], 1e-9)
        d_row, d_col = (
            np.interp((sample_distances + half) % length, way, v)
            - np.interp((sample_distances - half) % length, way, v)
            for v in ring.T
        )
        nearest = np.searchsorted(way, sample_distances).clip(0, len(at)) % len(at)
        rows, cols = at[nearest].T
        # Maximum distance of an object from its wall beyond the least one [m].
        near = clear[rows.astype(int), cols.astype(int)] < distance + 0.3
        # Two headings half a turn apart are one.
        heading = np.mod(np.arctan2(d_row, d_col) + 1e-9, np.pi) - 1e-9
        pose_lists.append(np.column_stack([rows, cols, heading])[near])
    return np.concatenate(pose_lists)


def _place_free_standing(grid: OccupancyGrid, shape: ObjectShape) -> Floats:
    """Return poses on a lattice of 1 m with a clearance above 1.2 m."""
    # Spacing of free-standing candidates [m].
    step = 1.0 / grid.resolution
    rows, cols = (np.arange(step / 2, size, step) for size in grid.shape)
    row, col = (v.ravel() for v in np.meshgrid(rows, cols, indexing="ij"))
    ways = (0.0,) if shape.half_length == shape.half_width else (0.0, math.pi / 2)
    poses = [np.column_stack([row, col, np.full(len(row), way)]) for way in ways]
    return _select_open_poses(grid, np.concatenate(poses))


def _select_open_poses(grid: OccupancyGrid, poses: Floats) -> Floats:
    """Select the poses with a clearance above 1.2 m."""
    rows, cols = np.floor(poses[:, :2]).astype(int).T
    inside = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    poses, at = poses[inside], (rows[inside], cols[inside])
    # Clearance from which on an object may stand free [m].
    return np.asarray(poses[grid.free[at] & (grid.clearance[at] > 1.2)])


def _place_beside_routes(
    grid: OccupancyGrid, shape: ObjectShape, routes: Iterable[Path], route_clearance: float
) -> Floats:
    """Return poses every `SPACING` [m] on both sides of routes, as near as allowed.

    Near objects help most if the heading is uncertain. They are aligned with the route; long
    objects are also tried across it. The clearance is above 1.2 m.
    """
    long = shape.half_length != shape.half_width
    pose_lists = [np.empty((0, 3))]
    for path in routes:
        fine = path.resample(SPACING, even=True)
        ahead = np.arctan2(*np.gradient(fine.xy, axis=0).T[::-1]) - grid.origin[2]
        row, col = grid.world_to_grid(*fine.xy.T)
        for turn in (0.0, math.pi / 2) if long else (0.0,):
            extent = shape.half_length if turn else shape.half_width
            for side in (-1, 1):
                side_offset = side * (route_clearance + extent) / grid.resolution + side
                at_row, at_col = (
                    row + np.cos(ahead) * side_offset,
                    col - np.sin(ahead) * side_offset,
                )
                heading = np.mod(ahead + turn + 1e-9, np.pi) - 1e-9
                pose_lists.append(np.column_stack([at_row, at_col, heading]))
    return _select_open_poses(grid, np.concatenate(pose_lists))


def find_refusal_reasons(
    places: Floats,
    grid: OccupancyGrid,
    robot_space: RobotSpace,
    routes: Floats,
    route_clearance: float,
    is_no_go: Bools,
) -> list[str]:
    """Return the reason against an object at each place, or "" if it is allowed.

    Parameters
    ----------
    places : (n, 3) array
        Row, column and heading [cells, cells, rad].
    grid : OccupancyGrid
        The map without objects.
    robot_space : RobotSpace
        Space of the robot next to such objects.
    routes : (m, 2) array
        Row and column of positions along the routes [cells]; objects keep `route_clearance` [m].
    route_clearance : float
        Minimum distance of an object from the routes [m].
    is_no_go : (H, W) array of bool
        Cells in no-go zones, which no object may fill.
    """
    from scipy.spatial import cKDTree

    shape, resolution = robot_space.shape, grid.resolution
    is_taken = grid.clearance < WALL_GAP + resolution / 2 - 1e-9
    unknown, tree = grid.cells == UNKNOWN, cKDTree(routes)

    def reason(pose: Pose) -> str:
        row, col, heading = pose.tolist()
        cells = find_filled_cells(grid, shape, pose)
        corners = compute_outline_points(shape, np.array([0.0, 0.0, heading])) / resolution
        reach = np.abs(corners[:, ::-1]).max(axis=0) - 1e-6
        is_outside = (pose[:2] < reach) | (pose[:2] > grid.shape - reach)
        if is_outside.any() or unknown[cells].any():
            return "reaches beyond the map or into unknown space"
        if is_taken[cells].any():
            return "less than 5 cm from a wall or another object"
        if is_no_go[cells].any():
            return "in a no-go zone"
        near = tree.query_ball_point(
            (row, col), (shape.outer_radius + route_clearance) / resolution
        )
        y, x = (routes[near] - (row, col)).T * resolution
        if (shape.compute_distance(x, y, heading) < route_clearance).any():
            return "in the way of a route"
        return "cuts a passage for the robot" if robot_space.is_cut_by(pose) else ""

    return [reason(pose) for pose in places]


def is_too_close(shape: ObjectShape, pose: Floats, other_poses: Floats, resolution: float) -> bool:
    """True if an object is closer than `OBJECT_GAP` to an existing one [cells, cells, rad]."""
    distances = np.hypot(*(other_poses[:, :2] - pose[:2]).T) * resolution
    near = other_poses[distances < 2 * shape.outer_radius + OBJECT_GAP]
    return any(shape.is_round or _are_boxes_close(shape, pose, other, resolution) for other in near)


def _are_boxes_close(shape: ObjectShape, first: Floats, second: Floats, resolution: float) -> bool:
    """True if two rectangles are closer than `OBJECT_GAP`, tested at points of both."""
    along, across = np.meshgrid(
        np.linspace(-shape.half_length, shape.half_length, 9),
        np.linspace(-shape.half_width, shape.half_width, 9),
    )
    for base, against in ((first, second), (second, first)):
        cos, sin = math.cos(base[2]), math.sin(base[2])
        x = cos * along - sin * across + (base[1] - against[1]) * resolution
        y = sin * along + cos * across + (base[0] - against[0]) * resolution
        if (shape.compute_distance(x, y, against[2]) < OBJECT_GAP).any():
            return True
    return False


@dataclass
class LandmarkSearch:
    """Greedy search for the places that lower the objective of `PlacementObjective` most."""

    sight: PlacementObjective
    """The visible objects along the routes, and the objective."""
    robot_space: RobotSpace
    """Space of the robot on the map without objects."""
    n_lazy: int = 128
    """Number of places that a lazy search evaluates together."""

    @property
    def places(self) -> Floats:
        """Row, column and heading of all places on the map, (n, 3) [cells, cells, rad]."""
        return self.sight.places

    def select_places(
        self, count: int, progress: ProgressCallback | None = None
    ) -> tuple[list[int], Floats]:
        """Return indices of at most `count` places, and the objective with 0, 1, ... of them."""
        selected: list[int] = []
        bounds = np.full(len(self.places), np.inf)
        curve = []
        while True:
            self.sight.place_objects(np.array(selected, np.int64))
            curve.append(self.sight.compute_objective())
            best = self.find_best_place(selected, bounds) if len(selected) < count else None
            if progress:
                progress(count if best is None else len(selected) + 1, count)
            if best is None:
                return selected, np.array(curve)
            selected.append(best)

    def find_best_place(self, other_places: list[int], bounds: Floats | None = None) -> int | None:
        """Return the best allowed place in addition to occupied ones; None without a gain.

        With `bounds` (n,), which no gain exceeds, the search is lazy: places are looked at from the
        greatest bound on, until none of the rest can gain more. Gains with fewer objects are such
        bounds as far as the objective has diminishing returns; they are lowered in place.
        """
        self.sight.place_objects(np.array(other_places, np.int64))
        value = self.sight.compute_objective()
        # Share of the objective by which a place must lower it.
        min_gain = 1e-6 * value
        waiting = np.setdiff1d(np.arange(len(self.places)), other_places)
        lot = max(len(waiting), 1)
        if bounds is not None:
            waiting, lot = waiting[np.argsort(-bounds[waiting], kind="stable")], self.n_lazy
        gains = np.full(len(self.places), -np.inf)
        robot_space = self.make_robot_space(other_places)
        for begin in range(0, len(waiting), lot):
            part = waiting[begin : begin + lot]
            gains[part] = value - self.sight.compute_objectives(part)
            rest = -np.inf
            if bounds is not None:
                bounds[part] = gains[part]
                rest = bounds[waiting[begin + lot :]].max(initial=-np.inf)
            for n in np.argsort(-gains, kind="stable").tolist():
                if not gains[n] > min_gain or gains[n] < rest:
                    break
                if self.is_allowed(n, other_places, robot_space):
                    return int(n)
                gains[n] = -np.inf
            if not rest > min_gain:
                return None
        return None

    def make_robot_space(self, placed: list[int]) -> RobotSpace:
        """Return the robot's space with objects at these places."""
        robot_space = self.robot_space.copy()
        for n in placed:
            robot_space.close_around(self.places[n])
        return robot_space

    def is_allowed(self, place: int, other_places: list[int], robot_space: RobotSpace) -> bool:
        """True if an object may stand at a place in addition to occupied ones."""
        pose, sight = self.places[place], self.sight
        near = is_too_close(sight.shape, pose, self.places[other_places], sight.grid.resolution)
        return not near and not robot_space.is_cut_by(pose)

    def draw_random_places(self, count: int, random: np.random.Generator) -> list[int]:
        """Return places drawn at random that are allowed together, at most `count`."""
        selected: list[int] = []
        robot_space = self.robot_space.copy()
        for n in random.permutation(len(self.places)).tolist():
            if len(selected) == count:
                break
            if self.is_allowed(n, selected, robot_space):
                selected.append(n)
                robot_space.close_around(self.places[n])
        return selected


def poses_from_places(grid: OccupancyGrid, places: Floats) -> Floats:
    """Return places (row, col, heading) on a map as poses in the world, (n, 3) [m, m, rad]."""
    x, y = grid.grid_to_world(places[:, 0], places[:, 1])
    return np.column_stack([x, y, places[:, 2] + grid.origin[2]])

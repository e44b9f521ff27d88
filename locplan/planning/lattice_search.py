"""The search of the lattice planner: motion primitives, their costs, and the search itself."""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from locplan._support.kernels.arrays import Array, Floats, Ints, Singles, Words
from locplan._support.kernels.outlines import TOUCH, find_swept_cells
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.planning.grid import find_cheapest_cells
from locplan.planning.kernels import lattice as kernels
from locplan.planning.kernels.bit_masks import WORD, mark_run_collisions, widen_bits
from locplan.planning.kernels.lattice import BACKWARD, EITHER, FORWARD, LatticeCostmap, LatticeMoves
from locplan.planning.metrics import find_cells_of_path
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position
from locplan.robots.parts import Footprint, Kinematics
from locplan.robots.robot import Robot

DIRECTIONS: dict[int, tuple[tuple[int, int], ...]] = {
    8: ((1, 0), (1, 1)),
    16: ((1, 0), (2, 1), (1, 1), (1, 2)),
    32: ((1, 0), (3, 1), (2, 1), (3, 2), (1, 1), (2, 3), (1, 2), (1, 3)),
}
"""Directions (columns, rows) of a quarter of the headings, by the number of all."""
ARC_STEP = 0.025
"""Maximum turn between two poses on an arc [rad]; an arc is then at most 2.6e-5 too short."""


@dataclass(frozen=True)
class MotionPrimitive:
    """A motion from the centre of cell (0, 0) to the centre of a cell."""

    source: int
    """Heading that it begins with."""
    target: int
    """Heading that it ends with."""
    poses: tuple[tuple[float, float, float], ...]
    """Poses (col, row, heading) along it, from (0, 0) on [cells, rad]."""
    sideways: bool = False
    """True for a motion sideways."""

    @property
    def end(self) -> tuple[int, int]:
        """Rows and columns that it leads on."""
        col, row, _ = self.poses[-1]
        return round(row), round(col)

    @property
    def turn(self) -> float:
        """Turn on the spot, >= 0 [rad]; 0 for moving primitives."""
        if self.end != (0, 0):
            return 0.0
        return abs(math.remainder(self.poses[-1][2] - self.poses[0][2], 2 * math.pi))

    @property
    def neutral(self) -> bool:
        """True if it leads neither ahead nor, driven from its end, in reverse."""
        return self.sideways or self.turn > 0


def compute_heading_angles(headings: int) -> Floats:
    """Return the headings of a lattice, rising from 0 [rad]."""
    return np.array(
        [math.atan2(row, col) % (2 * math.pi) for col, row in _list_directions(headings)]
    )


def _list_directions(headings: int) -> list[tuple[int, int]]:
    """Return the direction (columns, rows) of each heading."""
    quarter, directions = DIRECTIONS[headings], []
    for turns in range(4):
        for col, row in quarter:
            for _ in range(turns):
                col, row = -row, col
            directions.append((col, row))
    return directions


@lru_cache(maxsize=32)
def make_primitives(
    headings: int, radius: float, sideways: bool, span: int = 1
) -> tuple[MotionPrimitive, ...]:
    """Return the primitives of all headings, sorted by the heading that they begin with.

    Parameters
    ----------
    headings : int
        Number of headings: 8, 16 or 32.
    radius : float
        Turning radius, >= 0 [cells]; with 0 turns are on the spot.
    sideways : bool
        True adds motions sideways.
    span : int, default 1
        Number of headings, at least 1, that a turn may pass to either side.
    """
    directions, angles = _list_directions(headings), compute_heading_angles(headings)
    motion_primitives = []
    for source, ahead in enumerate(directions):
        start, angle = (0.0, 0.0, angles[source]), angles[source]
        motion_primitives.append(
            MotionPrimitive(source, source, (start, (*map(float, ahead), angle)))
        )
        for steps in (*range(1, span + 1), *range(-1, -span - 1, -1)):
            target = (source + steps) % headings
            for poses in _make_turns(ahead, directions[target], angle, radius):
                motion_primitives.append(MotionPrimitive(source, target, poses))
        for quarter in (1, 3) if sideways else ():
            direction = directions[(source + quarter * headings // 4) % headings]
            poses = start, (*map(float, direction), angle)
            motion_primitives.append(MotionPrimitive(source, source, poses, sideways=True))
    return tuple(motion_primitives)


def _make_turns(
    first_direction: tuple[int, int],
    second_direction: tuple[int, int],
    heading: float,
    radius: float,
) -> list[tuple[tuple[float, float, float], ...]]:
    """Return the poses of the turns from one direction to another."""
    (x, y), (x1, y1) = first_direction, second_direction
    cross = x * y1 - y * x1
    turn = math.atan2(cross, x * x1 + y * y1)
    long, long1 = math.hypot(x, y), math.hypot(x1, y1)
    min_tangent = radius * math.tan(abs(turn) / 2)
    # The ends lie in a parallelogram from the least turn's end on.
    near, reach = min_tangent * (x / long + x1 / long1), math.ceil(long + long1)
    columns = range(math.floor(near) - reach, math.ceil(near) + reach + 1)
    near = min_tangent * (y / long + y1 / long1)
    rows = range(math.floor(near) - reach, math.ceil(near) + reach + 1)
    pose_lists = []
    for col, row in itertools.product(columns, rows):
        along = (col * y1 - row * x1) / cross * long
        along1 = (x * row - y * col) / cross * long1
        first, second = along - min_tangent, along1 - min_tangent
        if -1e-9 <= first < long - 1e-9 and -1e-9 <= second < long1 - 1e-9:
            pose_lists.append(_sample_turn(heading, turn, along, along1, (float(col), float(row))))
    return pose_lists


def _sample_turn(
    heading: float, turn: float, length_before: float, length_after: float, end: tuple[float, float]
) -> tuple[tuple[float, float, float], ...]:
    """Return poses along a straight piece, an arc, and a straight piece."""
    tangent = min(length_before, length_after)
    radius, side = tangent / math.tan(abs(turn) / 2), math.copysign(1.0, turn)
    cos, sin = math.cos(heading), math.sin(heading)
    poses = [(0.0, 0.0, heading)]
    begin = length_before - tangent
    steps = max(1, math.ceil(abs(turn) / ARC_STEP)) if radius > 1e-9 else 1
    for n in range(steps + 1):
        angle = abs(turn) * n / steps
        x, y = begin + radius * math.sin(angle), side * radius * (1 - math.cos(angle))
        poses.append((cos * x - sin * y, sin * x + cos * y, heading + side * angle))
    if math.hypot(poses[1][0], poses[1][1]) <= 1e-9:
        del poses[1]  # no straight rest before the arc
    if math.hypot(poses[-1][0] - end[0], poses[-1][1] - end[1]) <= 1e-9:
        del poses[-1]
    return (*poses, (*end, heading + turn))


def compute_reach(
    motion_primitives: tuple[MotionPrimitive, ...], outline: Footprint | None, resolution: float
) -> int:
    """Return the distance [cells], rounded up, from a primitive's start to its farthest point."""
    body = 0.0 if outline is None else outline.circumscribed_radius / resolution
    far = max(
        max(abs(col), abs(row))
        for primitive in motion_primitives
        for col, row, _ in primitive.poses
    )
    return math.ceil(far + body) + 2


def find_centre_cells(primitive: MotionPrimitive) -> Ints:
    """Return the cells (n, 2) of (row, col) that the centre crosses, or touches at a corner."""
    row, col, _, _ = _find_crossed_cells(primitive, 1, 0.0)
    cells = [np.column_stack([row, col])]
    corner = np.flatnonzero((np.diff(row) != 0) & (np.diff(col) != 0))
    cells += [np.column_stack([row[corner], col[corner + 1]])]
    cells += [np.column_stack([row[corner + 1], col[corner]])]
    return np.unique(np.concatenate(cells), axis=0)


def _find_crossed_cells(
    primitive: MotionPrimitive, layers: int, yaw: float
) -> tuple[Array, Array, Array, Array]:
    """Return rows, columns, layers and lengths of the cells that the centre crosses [cells]."""
    poses = np.array(primitive.poses)
    unit = OccupancyGrid(np.full((1, 1), FREE), 1.0)
    path = Path(poses[:, :2] + 0.5, poses[:, 2] + yaw)
    layer, row, col, length = find_cells_of_path(unit, path, layers)
    return row, col, layer, length


@dataclass(frozen=True)
class MotionPrices:
    """Costs of motions in addition to the integral of the density."""

    reverse: float
    """Factor on the cost of motions in reverse and sideways, above 1."""
    gear_change: float
    """Cost of a change between forward and reverse [m]."""
    turn: float
    """Cost of a turn on the spot [m/rad]."""


def make_moves(
    motion_primitives: tuple[MotionPrimitive, ...],
    kinematics: Kinematics,
    prices: MotionPrices,
    costs: Costmap,
) -> tuple[LatticeMoves, list[tuple[int, bool]]]:
    """Return the motions that primitives make on a costmap.

    Beside the kernels' arrays it gives the primitive of each motion, and whether it is driven from
    its end.
    """
    yaw, turn = costs.grid.origin[2], prices.turn / costs.grid.resolution
    slots, motions = (
        number_primitives_per_heading(motion_primitives),
        _list_motions(motion_primitives, kinematics.reverse),
    )
    crossed, lengths, rest = [], [], []
    for number, back in motions:
        primitive = motion_primitives[number]
        cells, shares = _index_crossed_cells(primitive, back, costs.density_of_heading.shape, yaw)
        factor = prices.reverse if back or primitive.sideways else 1.0
        crossed.append(cells)
        lengths.append(2 * factor * shares)
        gear = EITHER if primitive.neutral else BACKWARD if back else FORWARD
        ends = (
            (primitive.target, primitive.source) if back else (primitive.source, primitive.target)
        )
        leads = (-primitive.end[0], -primitive.end[1]) if back else primitive.end
        rest.append((*ends, *leads, gear, int(back), primitive.source, slots[number]))
    begin = np.searchsorted([row[0] for row in rest], np.arange(motion_primitives[-1].source + 2))
    table = np.array(rest, np.int64).T
    count = np.array(
        [len(cell_lengths) if cell_lengths.sum() > 0 else 0 for cell_lengths in lengths]
    )
    extra = np.array([turn * motion_primitives[number].turn for number, _ in motions])
    base_costs = np.array([cell_lengths.sum() / 2 for cell_lengths in lengths])
    arrays = _pad_rows(crossed, np.int64), _pad_rows(lengths, np.float64), count, extra, base_costs
    moves = LatticeMoves._make([begin.astype(np.int64), *(row.copy() for row in table), *arrays])
    return moves, motions


def _list_motions(
    motion_primitives: tuple[MotionPrimitive, ...], reverse: bool
) -> list[tuple[int, bool]]:
    """Return the number of each primitive, and if it is driven reversed, by the first heading."""
    ahead = [
        (primitive.source, number, False) for number, primitive in enumerate(motion_primitives)
    ]
    reversible = enumerate(motion_primitives) if reverse else ()
    back = [
        (primitive.target, number, True)
        for number, primitive in reversible
        if not primitive.neutral
    ]
    return [(number, backward) for _, number, backward in sorted(ahead + back)]


def _index_crossed_cells(
    primitive: MotionPrimitive, back: bool, shape: tuple[int, ...], yaw: float
) -> tuple[Array, Array]:
    """Return the offset of each crossed cell from the first, by layers, and its length."""
    layers, rows, columns = shape
    row, col, layer, length = _find_crossed_cells(primitive, layers, yaw)
    if back:
        row, col = row - primitive.end[0], col - primitive.end[1]
    return (layer * rows + row) * columns + col, length


@lru_cache(maxsize=32)
def number_primitives_per_heading(motion_primitives: tuple[MotionPrimitive, ...]) -> list[int]:
    """Return the index of each primitive among the primitives of its heading."""
    slots: list[int] = []
    for primitive in motion_primitives:
        slots.append(
            sum(other.source == primitive.source for other in motion_primitives[: len(slots)])
        )
    return slots


def _pad_rows(rows: list[Array], dtype: type) -> Array:
    """Return an array of rows of unequal length, filled up with zeros."""
    result: Array = np.zeros((len(rows), max(map(len, rows))), dtype)
    for row, values in zip(result, rows, strict=True):
        row[: len(values)] = values
    return result


def make_lattice_costmap(
    motion_primitives: tuple[MotionPrimitive, ...],
    outline: Footprint | None,
    costs: Costmap,
) -> LatticeCostmap:
    """Return the density that motions cross, and masks of the cells where primitives are blocked.

    A primitive is free where no cell that the outline sweeps is occupied, and the centre crosses
    and touches no cell of infinite density.
    """
    density = costs.density_of_heading
    rows, columns = costs.grid.shape
    masks = make_outline_masks(costs.grid, outline, motion_primitives).copy()
    centres = [
        np.insert(find_centre_cells(primitive), 2, 1, axis=1) for primitive in motion_primitives
    ]
    _add_primitive_masks(masks, np.isinf(density[0]), centres, motion_primitives, outside=True)
    half = np.array(density).reshape(-1) / 2
    free = half[np.isfinite(half)]
    cheapest = 2 * float(free.min()) if free.size else 1.0
    return LatticeCostmap(
        half,
        masks,
        rows,
        columns,
        cheapest,
        _find_least_density_nearby(density, compute_reach(motion_primitives, None, 1.0)),
    )


def _find_least_density_nearby(density: Array, reach: int) -> Singles:
    """Return the least density near each cell, over all headings, (rows * columns,)."""
    import cv2

    lowest_density = density.min(axis=0).astype(np.float32)
    size = 2 * reach + 1
    eroded = cv2.erode(lowest_density, np.ones((size, size), np.uint8), borderValue=np.inf)
    # A free cell is below infinity; single precision may have rounded it up.
    nearby_density: Singles = np.where(np.isfinite(eroded), eroded * np.float32(1 - 1e-6), 0.0)
    return nearby_density.astype(np.float32).reshape(-1)


@lru_cache(maxsize=4)
def make_outline_masks(
    grid: OccupancyGrid, outline: Footprint | None, motion_primitives: tuple[MotionPrimitive, ...]
) -> Words:
    """Return bits (headings, rows, words, slots), set if a primitive from a cell is blocked."""
    rows, columns = grid.shape
    slots = max(number_primitives_per_heading(motion_primitives)) + 1
    masks: Words = np.zeros(
        (motion_primitives[-1].source + 1, rows, -(-columns // WORD), slots), np.uint64
    )
    if outline is not None:
        reach, half = (
            compute_reach(motion_primitives, outline, grid.resolution),
            np.array([0.5, 0.5, 0.0]),
        )
        corners = outline.vertices / grid.resolution
        cells = [
            find_swept_cells(corners, np.array(swept_cells.poses) + half, reach)
            for swept_cells in motion_primitives
        ]
        runs = [_find_runs(swept_cells, reach) for swept_cells in cells]
        _add_primitive_masks(masks, grid.cells == OCCUPIED, runs, motion_primitives, outside=False)
    masks.setflags(write=False)
    return masks


def _add_primitive_masks(
    masks: Words,
    plane: Array,
    runs: list[Ints],
    motion_primitives: tuple[MotionPrimitive, ...],
    *,
    outside: bool,
) -> None:
    """Set the bits of cells if the runs of cells of a primitive meet a plane there."""
    farthest = max(int(np.abs(primitive).max()) + int(primitive[:, 2].max()) for primitive in runs)
    margin = WORD * math.ceil(farthest / WORD)
    wide = widen_bits(_pack_bordered_bits(plane, margin, masks.shape[2], outside))
    for primitive, slot, primitive_runs in zip(
        motion_primitives, number_primitives_per_heading(motion_primitives), runs, strict=True
    ):
        mark_run_collisions(masks, wide, primitive_runs, np.array([primitive.source, slot]), margin)


def _pack_bordered_bits(plane: Array, margin: int, words: int, outside: bool) -> Array:
    """Return the bits of a plane with a margin [cells] around the map, (rows, words)."""
    rows, columns = plane.shape
    wide = np.full((rows + 2 * margin, 64 * (words + 1) + 2 * margin), outside)
    wide[margin : margin + rows, margin : margin + columns] = plane
    return np.packbits(wide, axis=1, bitorder="little").view(np.uint64)


def _find_runs(cells: Array, reach: int) -> Ints:
    """Return runs (n, 3) of cells: row, first column and number, from the middle one."""
    edges = np.diff(cells.astype(np.int8), axis=1, prepend=0, append=0)
    row, first = np.nonzero(edges == 1)
    _, after = np.nonzero(edges == -1)
    return np.column_stack([row - reach, first - reach, after - first])


STRETCH = 1 << 16
"""Number of expansions between two looks at the clock."""


class OutOfTimeError(Exception):
    """The time is up; its argument is the cost that was reached [m]."""


class LatticeSearch:
    """A search of one path on a costmap, for its robot."""

    def __init__(
        self,
        costs: Costmap,
        headings: int,
        span: int,
        prices: MotionPrices,
        until: float = math.inf,
    ) -> None:
        grid, robot = costs.grid, costs.robot
        self._costs, self._angles, self._until = costs, compute_heading_angles(headings), until
        kinematics = robot.kinematics if robot else Kinematics()
        radius = kinematics.turning_radius / grid.resolution
        all_primitives = make_primitives(
            headings, radius, kinematics.drive == "omnidirectional", span
        )
        self._primitives = tuple(
            primitive for primitive in all_primitives if not _leaves_grid(primitive, grid.shape)
        )
        ground = make_lattice_costmap(self._primitives, robot.outline if robot else None, costs)
        moves, self._motions = make_moves(self._primitives, kinematics, prices, costs)
        change = prices.gear_change / grid.resolution if kinematics.reverse else 0.0
        terms = kernels.LatticeConstants(
            1.0 / ground.cheapest, change, 2 if change else 1, np.inf, 0
        )
        self.graph = kernels.StateGraph(ground, moves, terms)
        reversible = len(costs.density_of_heading) == 1 and _is_half_turn_symmetric(robot)
        self._project_moves = self.graph._replace(moves=_project_moves(moves, reversible))
        self._size = grid.shape[0] * grid.shape[1]

    def find_path(self, start: Position, goal: Position) -> PlannerResult:
        """Return the path from start to goal or within the goal tolerance; if none, the reason."""
        robot, near = self._costs.robot, self._find_tolerated_cells(goal)
        try:
            planner_result, may_come_near = self._search_targets(
                [self._index_cell(goal)], start, goal, near
            )
            if planner_result.status != "infeasible" or robot is None or len(near) < 2:
                return planner_result
            nearly = self._search_targets(near, start, goal)[0] if may_come_near else planner_result
        except OutOfTimeError as out:
            note = f"the time was up; every path of the lattice costs at least {out.args[0]:.2f} m"
            return PlannerResult(status="timeout", note=note)
        tolerance = f"the robot's goal tolerance, {robot.goal_tolerance:g} m"
        if nearly.path is None:
            return dataclasses.replace(
                planner_result, note=f"{planner_result.note}, nor into {tolerance}"
            )
        distance = math.dist(nearly.path.xy[-1], goal[:2])
        note = f"ends {distance:.2f} m from the goal, within {tolerance}: none leads into its cell"
        return dataclasses.replace(nearly, note=note)

    def _search_targets(
        self, targets: list[int], start: Position, goal: Position, near_cells: Sequence[int] = ()
    ) -> tuple[PlannerResult, bool]:
        """Return the path from start to a cell of `targets`, in the goal's heading, or the reason.

        The second value is False if it is certain that no path leads to any of the `near_cells`.
        """
        bound = self.compute_bounds(targets, self._index_cell(start))
        cap = float(bound[self._index_cell(start)]) * (1 - kernels.ROUNDING)
        if math.isinf(cap):
            return self._explain_failure(start, goal, 0), True
        goal_headings = sum(1 << heading for heading in self._list_headings(goal))
        terms = self.graph.terms._replace(cap=cap, goal_headings=goal_headings)
        graph = self.graph._replace(terms=terms)
        cost, last, expanded = self.explore_costs(start, bound, graph)
        if last < 0:
            # All that can be reached was, but for cells from which none leads to the targets.
            of_others = cost.reshape(self._size, -1, len(self._angles))[near_cells]
            reached = of_others[:, :, self._list_headings(goal)].any(axis=(1, 2))
            reached |= np.isinf(bound[near_cells])
            return self._explain_failure(start, goal, expanded), bool(reached.any())
        moves = kernels.trace_motions(graph, cost, last)
        return PlannerResult(self._path_from_moves(moves), expanded=expanded), True

    def _find_tolerated_cells(self, goal: Position) -> list[int]:
        """Return the cells whose centres lie within the robot's goal tolerance of the goal."""
        grid, robot = self._costs.grid, self._costs.robot
        tolerance = (robot.goal_tolerance if robot else 0.0) / grid.resolution
        row, col = (float(coordinate) for coordinate in grid.world_to_grid(*goal[:2]))
        rows = np.arange(grid.shape[0])[:, None] + 0.5 - row
        columns = np.arange(grid.shape[1]) + 0.5 - col
        free = np.isfinite(self._costs.density)
        return np.flatnonzero((np.hypot(rows, columns) <= tolerance) & free).tolist()

    def compute_bounds(self, targets: list[int], source: int) -> Array:
        """Return lower bounds of the cost from cells to any target, final up to cell `source`."""
        cost_to_go, graph = np.full(self._size, np.inf, np.float32), self._project_moves
        queue = kernels.make_queue(self._count_buckets(1.0), 0)
        for target in targets:
            cost_to_go[target] = 0.0
            kernels.put_state(queue, target, 0)
        self._run_kernel(
            lambda queue, max_expansions: kernels.search_cells_backward(
                queue, graph, cost_to_go, source, max_expansions
            ),
            queue,
        )
        return cost_to_go

    def explore_costs(
        self, start: Position, cost_to_go: Array, graph: kernels.StateGraph
    ) -> tuple[Array, int, int]:
        """Return the costs of the search over states, the last state or -1, and the expansions."""
        terms, source = graph.terms, self._index_cell(start)
        layers = terms.gears * len(self._angles)
        cost = np.zeros(self._size * layers, np.float32)
        lowest = int(terms.cap * terms.per_cost)
        queue = kernels.make_queue(self._count_buckets(2.0), lowest)
        for gear in range(terms.gears):
            for heading in self._list_headings(start):
                state = source * layers + gear * len(self._angles) + heading
                cost[state] = 1.0
                kernels.put_state(queue, state, lowest)
                if cost_to_go[source] == 0 and (terms.goal_headings >> heading) & 1:
                    queue.state[kernels.BEST] = state  # the start is the goal
        queue = self._run_kernel(
            lambda queue, max_expansions: kernels.search_states(
                queue, graph, cost_to_go, cost, max_expansions
            ),
            queue,
        )
        numbers = queue.state
        return cost, int(numbers[kernels.BEST]), int(numbers[kernels.EXPANDED])

    def _run_kernel(
        self, run_step: Callable[[kernels.StateQueue, int], int], queue: kernels.StateQueue
    ) -> kernels.StateQueue:
        """Run a kernel until it has finished, adding memory and watching the time limit."""
        while (status := run_step(queue, STRETCH)) != kernels.FINISHED:
            if status == kernels.OUT_OF_ROOM:
                queue = kernels.grow_queue(queue)
            elif time.perf_counter() > self._until:
                reached = queue.state[kernels.LOWEST] / self.graph.terms.per_cost
                raise OutOfTimeError(reached * self._costs.grid.resolution)
        return queue

    def _count_buckets(self, factor: float) -> int:
        """Return the number of buckets that a motion's cost spans, a power of two."""
        ground, moves, terms = self.graph
        half = ground.half
        costliest = 2 * half[np.isfinite(half)].max(initial=0.5)
        longest = float((moves.lengths.sum(axis=1) / 2 * costliest + moves.extra).max())
        spanned = factor * (longest + terms.gear_change) * terms.per_cost + 2
        # States that are to come later wait in the last bucket.
        return int(min(2**14, 2 ** math.ceil(math.log2(spanned))))

    def _index_cell(self, pose: Position) -> int:
        """Return the number of the cell of a pose."""
        row, col = self._costs.find_cell(pose[:2])
        return row * self.graph.ground.columns + col

    def _list_headings(self, pose: Position) -> list[int]:
        """Return the layer nearest to the heading of a pose; all headings if it has none."""
        if len(pose) < 3:
            return list(range(len(self._angles)))
        alignment = np.cos(self._angles + self._costs.grid.origin[2] - pose[2])
        return [int(np.argmax(alignment))]

    def _path_from_moves(self, moves: Array) -> Path:
        """Return the path of motions after the state that begins it."""
        state, grid = int(moves[0]), self._costs.grid
        cell, layer = divmod(state, self.graph.terms.gears * len(self._angles))
        row, col = divmod(cell, self.graph.ground.columns)
        heading = self._angles[layer % len(self._angles)]
        pieces: list[Floats] = [np.array([(col + 0.5, row + 0.5, heading)])]
        for move in moves[1:].tolist():
            number, back = self._motions[move]
            poses = np.array(self._primitives[number].poses)
            poses = poses[::-1] if back else poses
            begin = pieces[-1][-1] - poses[0]
            begin[2] = 0.0
            pieces.append(poses[1:] + begin)
        poses = np.concatenate(pieces)
        if len(poses) == 1:
            poses = np.repeat(poses, 2, axis=0)
        x, y = grid.grid_to_world(poses[:, 1], poses[:, 0])
        return Path(np.column_stack([x, y]), poses[:, 2] + grid.origin[2])

    def _explain_failure(self, start: Position, goal: Position, expanded: int) -> PlannerResult:
        """Return the reason why there is no path, after all states were searched."""
        ends = start[:2], goal[:2]
        cells, _ = find_cheapest_cells(self._costs, *ends, allow_corner_cutting=False)
        if cells is None:
            return PlannerResult(status="unreachable", expanded=expanded)
        headings, edge = len(self._angles), self._costs.grid.resolution
        note = f"none of the motions between {headings} headings and cells of {edge:g} m lead to"
        note += " the goal with the robot's outline, drive and turning radius"
        return PlannerResult(status="infeasible", note=note, expanded=expanded)


def _leaves_grid(motion: MotionPrimitive, shape: tuple[int, ...]) -> bool:
    """Return True if a motion turns too wide for a map of a shape, from every cell."""
    turns = motion.source != motion.target
    return turns and any(abs(n) >= size for n, size in zip(motion.end, shape, strict=True))


def _is_half_turn_symmetric(robot: Robot | None) -> bool:
    """Return True if a robot covers the same cells when it is turned by 180 degrees."""
    if robot is None or robot.outline is None:
        return True
    corners = robot.outline.vertices
    distance = np.hypot(*(corners[:, None] + corners).T)
    return bool((distance.min(axis=0) < TOUCH).all())


def _project_moves(moves: kernels.LatticeMoves, reversible: bool) -> kernels.LatticeMoves:
    """Return the motions that lead to another cell at least cost, of which `begin` means nothing.

    A robot that is `reversible` drives its forward motions, turned by 180 degrees, in reverse at a
    higher cost.
    """
    is_kept = (moves.row != 0) | (moves.col != 0)
    if reversible:
        is_kept &= moves.gear != kernels.BACKWARD
    return kernels.LatticeMoves(moves.begin, *(array[is_kept] for array in moves[1:]))

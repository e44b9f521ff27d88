"""One search of the lattice planner, from its costmap's arrays to a path."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from locplan._kernels import lattice as kernels
from locplan._kernels.arrays import Array, Floats
from locplan._kernels.outlines import TOUCH
from locplan.costs import Costmap, Path
from locplan.planners._grid import cheapest_cells
from locplan.planners._primitives import (
    Prices,
    Primitive,
    angles_of,
    masked_ground,
    moves_of,
    primitives,
)
from locplan.planners._protocol import Found, Position
from locplan.robots import Kinematics, Robot

STRETCH = 1 << 16
"""Number of expansions between two looks at the clock."""


class OutOfTimeError(Exception):
    """The time is up; its argument is the cost that was reached [m]."""


class LatticeSearch:
    """A search of one path on a costmap, for its robot."""

    def __init__(
        self, costs: Costmap, headings: int, span: int, prices: Prices, until: float = math.inf
    ) -> None:
        grid, robot = costs.grid, costs.robot
        self._costs, self._angles, self._until = costs, angles_of(headings), until
        kinematics = robot.kinematics if robot else Kinematics()
        radius = kinematics.turning_radius / grid.resolution
        every = primitives(headings, radius, kinematics.drive == "omnidirectional", span)
        self._primitives = tuple(each for each in every if not _leads_off(each, grid.shape))
        ground = masked_ground(self._primitives, robot.outline if robot else None, costs)
        moves, self._made = moves_of(self._primitives, kinematics, prices, costs)
        change = prices.gear_change / grid.resolution if kinematics.reverse else 0.0
        terms = kernels.Terms(1.0 / ground.cheapest, change, 2 if change else 1, np.inf, 0)
        self.graph = kernels.Graph(ground, moves, terms)
        reversible = len(costs.density_of_heading) == 1 and _is_reversible(robot)
        self._between_cells = self.graph._replace(moves=_between_cells(moves, reversible))
        self._size = grid.shape[0] * grid.shape[1]

    def found(self, start: Position, goal: Position) -> Found:
        """The path from start to goal, or else into the robot's tolerance of it, or why neither."""
        robot, near = self._costs.robot, self._near(goal)
        try:
            found, may_come_near = self._found_to([self._cell(goal)], start, goal, near)
            if found.status != "infeasible" or robot is None or len(near) < 2:
                return found
            nearly = self._found_to(near, start, goal)[0] if may_come_near else found
        except OutOfTimeError as out:
            note = f"the time was up; every path of the lattice costs at least {out.args[0]:.2f} m"
            return Found(status="timeout", note=note)
        tolerance = f"the robot's goal tolerance, {robot.goal_tolerance:g} m"
        if nearly.path is None:
            return dataclasses.replace(found, note=f"{found.note}, nor into {tolerance}")
        away = math.dist(nearly.path.xy[-1], goal[:2])
        note = f"ends {away:.2f} m from the goal, within {tolerance}: none leads into its cell"
        return dataclasses.replace(nearly, note=note)

    def _found_to(
        self, targets: list[int], start: Position, goal: Position, others: Sequence[int] = ()
    ) -> tuple[Found, bool]:
        """The path from start to one of the cells `targets`, in the goal's heading, or why none.

        The second value is False if surely none leads to any of the `others`, either.
        """
        bound = self.bound_to(targets, self._cell(start))
        cap = float(bound[self._cell(start)]) * (1 - kernels.ROUNDING)
        if math.isinf(cap):
            return self._none(start, goal, 0), True
        goal_headings = sum(1 << heading for heading in self._headings(goal))
        terms = self.graph.terms._replace(cap=cap, goal_headings=goal_headings)
        graph = self.graph._replace(terms=terms)
        cost, last, expanded = self.costs_from(start, bound, graph)
        if last < 0:
            # All that can be reached was, but for cells from which none leads to the targets.
            of_others = cost.reshape(self._size, -1, len(self._angles))[others]
            reached = of_others[:, :, self._headings(goal)].any(axis=(1, 2))
            reached |= np.isinf(bound[others])
            return self._none(start, goal, expanded), bool(reached.any())
        moves = kernels.traced(graph, cost, last)
        return Found(self._path(moves), expanded=expanded), True

    def _near(self, goal: Position) -> list[int]:
        """The cells whose centres lie within the robot's goal tolerance of the goal."""
        grid, robot = self._costs.grid, self._costs.robot
        tolerance = (robot.goal_tolerance if robot else 0.0) / grid.resolution
        row, col = (float(one) for one in grid.world_to_grid(*goal[:2]))
        rows = np.arange(grid.shape[0])[:, None] + 0.5 - row
        columns = np.arange(grid.shape[1]) + 0.5 - col
        free = np.isfinite(self._costs.density)
        return np.flatnonzero((np.hypot(rows, columns) <= tolerance) & free).tolist()

    def bound_to(self, targets: list[int], source: int) -> Array:
        """Bound of the cost to any target of each cell, final up to that of the cell `source`."""
        bound, graph = np.full(self._size, np.inf, np.float32), self._between_cells
        queue = kernels.new_queue(self._buckets(1.0), 0)
        for target in targets:
            bound[target] = 0.0
            kernels.put(queue, target, 0)
        self._run(lambda queue, most: kernels.project(queue, graph, bound, source, most), queue)
        return bound

    def costs_from(
        self, start: Position, bound: Array, graph: kernels.Graph
    ) -> tuple[Array, int, int]:
        """The costs of the search over states, the last state or -1, and the expansions."""
        terms, source = graph.terms, self._cell(start)
        layers = terms.gears * len(self._angles)
        cost = np.zeros(self._size * layers, np.float32)
        lowest = int(terms.cap * terms.per_cost)
        queue = kernels.new_queue(self._buckets(2.0), lowest)
        for gear in range(terms.gears):
            for heading in self._headings(start):
                state = source * layers + gear * len(self._angles) + heading
                cost[state] = 1.0
                kernels.put(queue, state, lowest)
                if bound[source] == 0 and (terms.goal_headings >> heading) & 1:
                    queue.state[kernels.BEST] = state  # the start is the goal
        queue = self._run(
            lambda queue, most: kernels.explore(queue, graph, bound, cost, most), queue
        )
        numbers = queue.state
        return cost, int(numbers[kernels.BEST]), int(numbers[kernels.EXPANDED])

    def _run(
        self, step: Callable[[kernels.Queue, int], int], queue: kernels.Queue
    ) -> kernels.Queue:
        """Run a kernel until it has finished, giving it room and looking at the clock."""
        while (status := step(queue, STRETCH)) != kernels.FINISHED:
            if status == kernels.OUT_OF_ROOM:
                queue = kernels.grown(queue)
            elif time.perf_counter() > self._until:
                reached = queue.state[kernels.LOWEST] / self.graph.terms.per_cost
                raise OutOfTimeError(reached * self._costs.grid.resolution)
        return queue

    def _buckets(self, factor: float) -> int:
        """Number of buckets that a motion's cost spans, a power of two."""
        ground, moves, terms = self.graph
        half = ground.half
        costliest = 2 * half[np.isfinite(half)].max(initial=0.5)
        longest = float((moves.lengths.sum(axis=1) / 2 * costliest + moves.extra).max())
        spanned = factor * (longest + terms.gear_change) * terms.per_cost + 2
        # States that are to come later wait in the last bucket.
        return int(min(2**14, 2 ** math.ceil(math.log2(spanned))))

    def _cell(self, pose: Position) -> int:
        """The number of the cell of a pose."""
        row, col = self._costs.cell_of(pose[:2])
        return row * self.graph.ground.columns + col

    def _headings(self, pose: Position) -> list[int]:
        """The heading nearest to that of a pose; without one all headings."""
        if len(pose) < 3:
            return list(range(len(self._angles)))
        apart = np.cos(self._angles + self._costs.grid.origin[2] - pose[2])
        return [int(np.argmax(apart))]

    def _path(self, moves: Array) -> Path:
        """The path of motions after the state that begins it."""
        state, grid = int(moves[0]), self._costs.grid
        cell, layer = divmod(state, self.graph.terms.gears * len(self._angles))
        row, col = divmod(cell, self.graph.ground.columns)
        heading = self._angles[layer % len(self._angles)]
        pieces: list[Floats] = [np.array([(col + 0.5, row + 0.5, heading)])]
        for move in moves[1:].tolist():
            number, back = self._made[move]
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

    def _none(self, start: Position, goal: Position, expanded: int) -> Found:
        """Why there is no path, after all states were searched."""
        ends = start[:2], goal[:2]
        cells, _ = cheapest_cells(self._costs, *ends, allow_corner_cutting=False)
        if cells is None:
            return Found(status="unreachable", expanded=expanded)
        headings, edge = len(self._angles), self._costs.grid.resolution
        note = f"none of the motions between {headings} headings and cells of {edge:g} m lead to"
        note += " the goal with the robot's outline, drive and turning radius"
        return Found(status="infeasible", note=note, expanded=expanded)


def _leads_off(motion: Primitive, shape: tuple[int, ...]) -> bool:
    """Whether a motion is a turn too wide for a map of a shape, from wherever it begins."""
    turns = motion.source != motion.target
    return turns and any(abs(n) >= size for n, size in zip(motion.end, shape, strict=True))


def _is_reversible(robot: Robot | None) -> bool:
    """Whether a robot covers the same cells when it stands the other way round."""
    if robot is None or robot.outline is None:
        return True
    corners = robot.outline.vertices
    apart = np.hypot(*(corners[:, None] + corners).T)
    return bool((apart.min(axis=0) < TOUCH).all())


def _between_cells(moves: kernels.Moves, reversible: bool) -> kernels.Moves:
    """The motions that lead to another cell at least cost, of which `begin` means nothing.

    In reverse a robot that is `reversible` goes where it does ahead the other way round, but at a
    higher cost.
    """
    kept = (moves.row != 0) | (moves.col != 0)
    if reversible:
        kept &= moves.gear != kernels.BACKWARD
    return kernels.Moves(moves.begin, *(each[kept] for each in moves[1:]))

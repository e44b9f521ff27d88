"""Any-angle paths: paths over the grid, straightened and shifted to reduce their cost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal

import numpy as np

from locplan._support.checks import check_choice
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan.planning.costmap import Costmap
from locplan.planning.grid import (
    GridPlanner,
    PaddedCostmap,
    cells_from_flat_indices,
    drop_repeated_positions,
    find_bordered_end_indices,
    find_cheapest_cells,
    find_straight_line,
    find_turning_centres,
    make_blank_costs,
)
from locplan.planning.metrics import path_cost
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position

REACH = 3
"""Reach of the longest of the 32 moves along an axis [cells]."""
LOOKAHEAD = 20
"""Maximum number of positions that one straight line may replace."""


SHIFTS = (2.0, 1.0, 0.5)
"""Steps by which positions are shifted, one after the other [cells]."""


@dataclass(frozen=True)
class AnyAngle:
    """This planner finds a path of straight lines in any direction.

    It improves the path of the grid planner, or with accuracy "high" the cheapest path over 32
    neighbours. Its path never costs more than the grid planner's.
    """

    accuracy: Literal["normal", "high"] = "normal"
    """Accuracy, "normal" or "high"; "high" takes about five times as long, for paths that are
    planned once and driven often."""
    allow_corner_cutting: bool = False
    """True lets a line pass the corner of a blocked cell; set it to compare with a planner that
    does so."""
    name: ClassVar[str] = "any-angle"
    minimises: ClassVar[str] = "J"
    space: ClassVar[str] = "R2"

    def check(self) -> None:
        """Raise a ConfigError if the accuracy is unknown."""
        check_choice("accuracy", self.accuracy, ("normal", "high"))

    def prepare(self) -> None:
        """Compile the kernels, so that the first plan is not timed with them."""
        GridPlanner().prepare()
        self.solve(make_blank_costs(3, 9), (0.5, 0.5), (8.5, 1.5))

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between two world positions [m] in free cells; the path has exactly these ends.

        See `locplan.planning.Planner.solve`.
        """
        return self.solve_prepared(costs, PaddedCostmap.from_costmap(costs), start, goal)

    def solve_prepared(
        self,
        costs: Costmap,
        bordered: PaddedCostmap,
        start: Position,
        goal: Position,
        check: Callable[[], None] | None = None,
    ) -> PlannerResult:
        """Plan as `solve` does, on a costmap that was prepared for several plans.

        Parameters
        ----------
        costs : Costmap
            The costmap to plan on.
        bordered : PaddedCostmap
            The same costmap, prepared by ``PaddedCostmap.from_costmap(costs)``.
        start, goal : (x, y)
            Positions in the world [m].
        check : callable, optional
            Function that is called without arguments from time to time during the search; an
            exception from it ends the plan.
        """
        cutting = self.allow_corner_cutting
        cells, _ = find_cheapest_cells(costs, start, goal, cutting, bordered=bordered, check=check)
        if cells is None:
            return PlannerResult(status="unreachable")
        cells_with_32_moves = None
        if self.accuracy == "high":
            cells_with_32_moves = _find_cells_with_32_moves(costs, start, goal, cutting)
        return PlannerResult(
            make_any_angle_path(costs, bordered, cells, start, goal, cutting, cells_with_32_moves)
        )


def make_any_angle_path(
    costs: Costmap,
    bordered: PaddedCostmap,
    cells: Ints,
    start: Position,
    goal: Position,
    allow_corner_cutting: bool = False,
    cells_with_32_moves: Ints | None = None,
) -> Path:
    """Straighten a path over cells; the result never costs more than the cells' path.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    bordered : PaddedCostmap
        The same costmap, prepared by ``PaddedCostmap.from_costmap(costs)``.
    cells : (n, 2) array
        Rows and columns of the path's cells from start to goal.
    start, goal : (x, y)
        Positions in the world [m].
    allow_corner_cutting : bool, default False
        True lets lines pass the corner of a blocked cell.
    cells_with_32_moves : (m, 2) array, optional
        Cells to straighten in place of those, if they were searched over more moves.
    """
    candidates = [_drop_end_centres(costs, cells, start, goal)]
    if (line := find_straight_line(costs, start, goal, allow_corner_cutting)) is not None:
        candidates.append(line)
    ends = np.array(costs.grid.world_to_grid(*np.transpose([start, goal]))).T
    inner = (cells if cells_with_32_moves is None else cells_with_32_moves) + 0.5
    positions = np.vstack([ends[:1], inner, ends[1:]])
    straight = _straighten_and_shift(costs, bordered, positions, start, goal, allow_corner_cutting)
    # Rounding can push a line along a wall's edge into the wall; the grid's path then wins.
    best: Path = min(straight, *candidates, key=lambda path: path_cost(costs, path))
    return best


def _drop_end_centres(costs: Costmap, cells: Ints, start: Position, goal: Position) -> Path:
    """Return the path over cells, without the centres of its end cells if that costs no more."""
    xy = np.vstack([start, find_turning_centres(costs, cells), goal])
    for end, between, far in ((0, 1, 2), (-1, -2, -3)):
        if len(xy) > 2:
            direct, around = Path(xy[[end, far]]), Path(xy[[end, between, far]])
            if path_cost(costs, direct) <= path_cost(costs, around):
                xy = np.delete(xy, between, axis=0)
    return drop_repeated_positions(costs, xy)


def straighten_path(costs: Costmap, path: Path, *, allow_corner_cutting: bool = False) -> Path:
    """Straighten and shift a path between its ends until it costs least; it never costs more."""
    start, goal = (tuple(map(float, path.xy[end])) for end in (0, -1))
    positions = np.column_stack(costs.grid.world_to_grid(*path.xy.T))
    bordered = PaddedCostmap.from_costmap(costs)
    straight = _straighten_and_shift(costs, bordered, positions, start, goal, allow_corner_cutting)
    return min(straight, path, key=lambda path: path_cost(costs, path))


def _straighten_and_shift(
    costs: Costmap,
    bordered: PaddedCostmap,
    positions: Floats,
    start: Position,
    goal: Position,
    cutting: bool,
) -> Path:
    """Straighten positions (n, 2) of (row, col) at all scales and shift them; the ends stay."""
    from locplan.planning.kernels.any_angle import choose_kept_positions, shift_positions

    half, columns, cheapest = bordered.half, bordered.columns, bordered.scale.cheapest
    positions, spacing = positions + 1, 1.0
    while True:
        indices = choose_kept_positions(half, columns, positions, LOOKAHEAD, cutting, cheapest)
        positions = positions[indices]
        length = np.hypot(*np.diff(positions, axis=0).T).sum()
        if LOOKAHEAD * spacing >= length:
            break
        spacing *= 4  # one straightening looks at four times the scale of the one before
        positions = subdivide_line(positions, spacing)
    positions = subdivide_line(positions, 8.0)
    for step in SHIFTS:  # in at most 20 sweeps over all positions
        positions = shift_positions(half, columns, positions, step, 20, cutting)
    indices = choose_kept_positions(half, columns, positions, LOOKAHEAD // 2, cutting, cheapest)
    xy = np.column_stack(costs.grid.grid_to_world(*(positions[indices] - 1).T))
    return drop_repeated_positions(costs, np.vstack([start, xy[1:-1], goal]))


def subdivide_line(positions: Floats, spacing: float) -> Floats:
    """Add positions to a line so that they lie at most `spacing` apart."""
    steps = np.diff(positions, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*steps.T) / spacing)).astype(int)
    share = np.concatenate([np.arange(1, count + 1) / count for count in counts])[:, None]
    inner = np.repeat(positions[:-1], counts, axis=0) + share * np.repeat(steps, counts, axis=0)
    inner[np.cumsum(counts) - 1] = positions[1:]
    return np.vstack([positions[:1], inner])


def _find_cells_with_32_moves(
    costs: Costmap, start: Position, goal: Position, allow_corner_cutting: bool
) -> Ints | None:
    """Return the cheapest cells over 32 moves; None without a path or if costs differ too much."""
    from locplan._support.kernels.search import make_bordered_half_density
    from locplan.planning.kernels.any_angle import find_cheapest_move_cells

    columns = costs.grid.shape[1] + 2 * REACH
    half, ends = (
        make_bordered_half_density(costs.density, REACH),
        find_bordered_end_indices(costs, start, goal, REACH),
    )
    flat = find_cheapest_move_cells(
        half, *ends, _make_straight_moves(columns, allow_corner_cutting)
    )
    return cells_from_flat_indices(flat, columns, REACH) if flat.size else None


@cache
def _make_straight_moves(columns: int, allow_corner_cutting: bool) -> Any:
    """Return the 32 moves, `locplan.planning.kernels.any_angle.StraightMoves`."""
    from locplan._support.kernels.rays import find_crossed_cells
    from locplan.planning.kernels.any_angle import StraightMoves

    steps = range(-REACH, REACH + 1)
    moves = [move for move in itertools.product(steps, steps) if math.gcd(*move) == 1]
    crossed, lengths, touched = [], [], []
    for move in moves:
        rows, cols, inside = find_crossed_cells(
            np.array([(0.5, 0.5), (move[0] + 0.5, move[1] + 0.5)])
        )
        crossed.append(rows * columns + cols)
        lengths.append(2 * inside)
        corners = (np.diff(rows) != 0) & (np.diff(cols) != 0)
        flanks = rows[:-1] * columns + cols[1:], rows[1:] * columns + cols[:-1]
        touched.append(np.concatenate([cells[corners] for cells in flanks]))
    if allow_corner_cutting:
        touched = [np.empty(0, np.int64) for _ in moves]
    offsets = np.array([row * columns + col for row, col in moves])
    return StraightMoves(offsets, _pad_rows(crossed), _pad_rows(lengths), _pad_rows(touched))


def _pad_rows(rows: list[Array]) -> Array:
    """Return an array of rows of unequal length, filled up with zeros."""
    result = np.zeros((len(rows), max(1, *map(len, rows))), rows[0].dtype)
    for row, values in zip(result, rows, strict=True):
        row[: len(values)] = values
    return result

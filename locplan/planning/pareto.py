"""The Pareto front of length against an integral along the path, and the best path within a
budget.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_choice, check_number, check_positive
from locplan._support.kernels.arrays import Array, Floats, Ints
from locplan._support.tables import format_rounded_up
from locplan.errors import ConfigError
from locplan.planning.costmap import Costmap, check_costs
from locplan.planning.grid import (
    cells_from_flat_indices,
    find_bordered_end_indices,
    find_straight_line,
    make_blank_costs,
    make_path_through_centres,
)
from locplan.planning.metrics import path_metrics
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position
from locplan.planning.results import ParetoFront

GAIN = 1e-10
"""Share of a weighted sum by which a path must be better to lie below a line."""
TOLERANCE = 1e-9
"""Share of the greatest rate by which integrals may differ, over the path of least integral.

Of it, whole units take 1.4e-10 a step, ties 2e-11, and the metrics' sums of floats the rest.
"""
STRETCH = 200_000
"""Number of expansions between two looks at the clock."""


class FrontTimeoutError(Exception):
    """A search over the grid was given up at its time limit."""


@dataclass(frozen=True, eq=False)
class StraightLine:
    """The straight line from start to goal, the shortest of all grid paths."""

    path: Path
    """The line."""
    measures: tuple[float, float]
    """Its length [m], and the integral along it."""
    units: tuple[float, float]
    """Both costs in whole units, less those of the ways from the ends to their cells' centres."""


@dataclass(frozen=True, eq=False)
class ParetoProblem:
    """Two costs on the bordered grid, in whole units as `locplan.planning.kernels.pareto` wants
    them.

    A path leads from the start to the centre of its cell, over centres, and to the goal, or along
    the straight `line`, as paths of the grid planner do.
    """

    costs: Costmap
    """The costmap that is searched."""
    half: Floats
    """Half the density of the second cost, u or e; that of the first, the length, is constant."""
    layer: NDArray[np.floating]
    """The second cost's density as the costmap has it, (H, W)."""
    source: int
    """Flat index of the start's cell."""
    target: int
    """Flat index of the goal's cell."""
    per_metre: float
    """Units of the first cost for a metre."""
    per_integral: float
    """Units of the second cost for an integral of 1 (m, or m^2 rad m)."""
    ends: tuple[float, float]
    """Both costs of the ways from the ends to their cells' centres: [m], and the integral."""
    allow_corner_cutting: bool
    """True lets a diagonal step pass the corner of a blocked cell."""
    line: StraightLine | None
    """The straight line, which the search over cells does not know; None if it is no grid path."""
    until: float = np.inf
    """Time of `time.perf_counter` at which searches over the grid are given up [s]."""

    @classmethod
    def for_route(
        cls,
        costs: Costmap,
        start: Position,
        goal: Position,
        objective: str,
        cutting: bool,
        until: float = np.inf,
    ) -> ParetoProblem:
        """Return the problem of a costmap between two positions; a ConfigError without a field."""
        from locplan.planning.kernels.pareto import SCALE

        layer = costs.e if objective == "e" else costs.u
        free = np.isfinite(costs.density)
        if not np.isfinite(layer[free]).all():
            raise ConfigError(f"a costmap without a field has no {objective} to trade length for")
        greatest = float(np.max(layer, where=free, initial=0.0)) or 1.0
        rows, columns = free.shape
        half = np.full((rows + 2, columns + 2), np.inf)
        inner = half[1:-1, 1:-1]
        np.multiply(layer, SCALE / greatest / 2, out=inner, where=free, dtype=np.float64)
        np.rint(inner, out=inner)
        source, target = find_bordered_end_indices(costs, start, goal)
        ends_length = ends_integral = 0.0
        for xy in (start, goal):
            cell = costs.find_cell(xy)
            offset = float(np.hypot(*np.subtract(xy, costs.grid.position(*cell))))
            ends_length += offset
            ends_integral += offset * float(layer[cell])
        per_metre = SCALE / costs.grid.resolution
        per_integral = SCALE / (costs.grid.resolution * greatest)
        line, path = None, find_straight_line(costs, start, goal, cutting)
        if path is not None:
            metrics = path_metrics(costs, path)
            integral = metrics.integrated_e if objective == "e" else metrics.integrated_u
            first = np.ceil((metrics.length - ends_length) * per_metre)
            second = np.floor((integral - ends_integral) * per_integral)
            line = StraightLine(path, (metrics.length, integral), (float(first), float(second)))
        return cls(
            costs=costs,
            half=half.reshape(-1),
            layer=layer,
            source=source,
            target=target,
            per_metre=per_metre,
            per_integral=per_integral,
            ends=(ends_length, ends_integral),
            allow_corner_cutting=cutting,
            line=line,
            until=until,
        )

    @property
    def columns(self) -> int:
        """Number of columns of the bordered grid."""
        return self.costs.grid.shape[1] + 2

    def to_go(self, length_weight: float, integral_weight: float) -> tuple[Array, Array | None]:
        """Compute the least weighted sums of both costs to the goal, and the start's path.

        No sum is overstated, except the integral's, by the ties. After `until` it raises
        `FrontTimeoutError`.
        """
        from locplan._support.kernels.search import measure_cost_scale, search_grid
        from locplan._support.kernels.ways import trace_path
        from locplan.planning.kernels.pareto import SCALE

        half = self.half * (integral_weight or 1.0)
        if not integral_weight:
            half[np.isfinite(half)] = 0.0
        # Where only the integral counts, a little of length makes the shortest of equal paths win:
        # a third of a unit a cell, and 53 bits still hold each step beside a sum over 10^5 cells.
        half += (length_weight or 2e-11) * SCALE / 2
        way = half, self.columns, self.target, -1, self.allow_corner_cutting
        cost, _, finished = search_grid(*way, measure_cost_scale(half), until=self.until)
        if not finished:
            raise FrontTimeoutError
        np.abs(cost, out=cost)
        if not np.isfinite(cost[self.source]):
            return cost, None
        flat = trace_path(half, self.columns, cost, self.source, self.allow_corner_cutting)
        cost *= 1 - 1e-12  # by which sums of floats over a path may overstate its cost
        return cost, flat[::-1]

    def measure_units(self, flat: Ints) -> tuple[float, float]:
        """Return both costs of a path over cells, given by flat indices, in whole units."""
        from locplan.planning.kernels.pareto import SCALE

        index_steps = np.abs(np.diff(flat))
        diagonal = (index_steps > 1) & (index_steps != self.columns)
        steps = self.half[flat[1:]] + self.half[flat[:-1]]
        second = np.where(diagonal, np.ceil(np.sqrt(2.0) * steps), steps).sum()
        first = np.where(diagonal, np.ceil(np.sqrt(2.0) * SCALE), SCALE).sum()
        return float(first), float(second)

    def measure_metres(self, cells: Ints) -> tuple[float, float]:
        """Return the length [m] of a path over cells (n, 2) with its ends, and its integral.

        Without cells both are measured along the line.
        """
        if self.line is not None and not len(cells):
            return self.line.measures
        step_lengths = self.costs.grid.resolution * np.hypot(*np.diff(cells, axis=0).T)
        rates = np.asarray(self.layer[cells[:, 0], cells[:, 1]], np.float64)
        integral = float(step_lengths @ (rates[1:] + rates[:-1]) / 2)
        return float(step_lengths.sum()) + self.ends[0], integral + self.ends[1]

    def length(self, first: float) -> float:
        """Return the length of a path with its ends, from whole units [m]."""
        return first / self.per_metre + self.ends[0]

    def tolerance(self, least_integral_cells: Ints) -> float:
        """Return the units by which integrals may differ, from the path of least integral."""
        first, second = self.measure_units(least_integral_cells)
        if self.line is not None and self.line.units[1] <= second:
            first = self.line.units[0]
        return TOLERANCE * (first + self.ends[0] * self.per_metre)


def check_front_limits(objective: str, time_limit: float, max_labels: int = 1) -> None:
    """Check the options of a search for trade-offs, before a field is computed.

    Parameters
    ----------
    objective, time_limit, max_labels
        See `pareto_front`.

    Raises
    ------
    ConfigError
        If one is out of its range.
    """
    check_choice("objective", objective, ("u", "e"))
    check_positive("time_limit", time_limit, "s")
    check_positive("max_labels", max_labels)


def compile_pareto_kernels() -> None:
    """Compile the kernels, so that no time limit is spent on that."""
    costs = dataclasses.replace(make_blank_costs(2, 3), u=np.ones((2, 3)))
    problem = ParetoProblem.for_route(costs, (0.5, 0.5), (2.5, 1.5), "u", False)
    search = ParetoSearch(problem, problem.to_go(1, 0)[0], problem.to_go(0, 1)[0], max_labels=100)
    labels, _ = search.run(1, np.inf)
    search.trace_cells(int(labels[0]))


class ParetoSearch:
    """A bi-objective search that can be paused, with its labels (partial paths).

    It looks for second costs of at most `within`. `ParetoProblem.to_go` gives the lower bounds to
    the goal; `joint` holds both_to_go, multiplier and most of the kernel's search.
    """

    def __init__(
        self,
        problem: ParetoProblem,
        first_to_go: Floats,
        second_to_go: Floats,
        max_labels: int,
        within: float = np.inf,
        joint: tuple[Floats, float, float] | None = None,
    ) -> None:
        from locplan.planning.kernels import pareto

        self.problem = problem
        self._max_labels = max(max_labels, 9)
        grid = problem.half, problem.columns, problem.target, problem.allow_corner_cutting
        joint = joint or (first_to_go, 0.0, np.inf)
        self._terms = pareto.ParetoConstants(*grid, first_to_go, second_to_go, *joint)
        room = min(1 << 16, self._max_labels)  # at first
        lowest = int(first_to_go[problem.source] * pareto.BUCKETS_A_CELL / pareto.SCALE)
        state = np.zeros(7, np.int64)
        state[[pareto.UNUSED, pareto.USED, pareto.WAITING]] = -1, 1, 1
        state[pareto.LOWEST] = lowest
        heads = np.full(pareto.BUCKETS, -1, np.int32)
        heads[lowest % pareto.BUCKETS] = 0
        lowest_second = np.full(problem.half.size, np.inf)
        lowest_second[problem.target] = within + 0.5
        self._labels = pareto.ParetoLabels(
            state=state,
            cell=np.full(room, problem.source, np.int32),
            first=np.zeros(room),
            second=np.zeros(room),
            parent=np.full(room, -1, np.int32),
            following=np.full(room, -1, np.int32),
            heads=heads,
            heap=np.zeros(room, np.int32),
            heap_first=np.zeros(room),
            heap_second=np.zeros(room),
            least=lowest_second,
        )

    @property
    def labels(self) -> int:
        """Number of labels."""
        from locplan.planning.kernels.pareto import USED

        return int(self._labels.state[USED])

    def run(self, n_solutions: int, until: float) -> tuple[NDArray[np.int32], float]:
        """Search until there are so many solutions or labels, or `time.perf_counter` is `until`.

        The labels at the goal come by rising first cost, with a bound on all remaining first costs.
        """
        from locplan.planning.kernels import pareto

        solution_labels = np.zeros(n_solutions, np.int32)
        while True:
            bound = pareto.search_labels(self._labels, self._terms, STRETCH, solution_labels)
            status, count = (int(self._labels.state[i]) for i in (pareto.STATUS, pareto.SOLUTIONS))
            full = status == pareto.OUT_OF_LABELS and not self._double_capacity()
            late = time.perf_counter() > until
            if status == pareto.FINISHED or count == n_solutions or full or late:
                return solution_labels[:count], bound

    def read_costs(self, labels: NDArray[np.int32]) -> tuple[Array, Array]:
        """Return both costs of labels in whole units."""
        return self._labels.first[labels], self._labels.second[labels]

    def trace_cells(self, label: int) -> Ints:
        """Return the cells (n, 2) of the path to a label, as (row, col)."""
        from locplan.planning.kernels.pareto import trace_label

        return cells_from_flat_indices(trace_label(self._labels, label), self.problem.columns)

    def _double_capacity(self) -> bool:
        """Double the room up to its limit; return False if it is full."""
        room = min(2 * self._labels.cell.size, self._max_labels)
        if self.labels + 8 > room:
            return False
        twice = {
            name: np.concatenate([values, values[: room - values.size]])
            for name, values in self._labels._asdict().items()
            if name not in ("state", "heads", "least")
        }
        self._labels = self._labels._replace(**twice)
        return True


@dataclass(frozen=True)
class BudgetPlanner:
    """This planner finds the shortest grid path whose integral of u or e is within a budget.

    The path is exact: Lagrangian bounds keep a bi-objective search small. An integral is within
    the budget if it exceeds it by no more than 1e-9 of the layer's greatest value on the map times
    the length of the path of least integral. So each path of a `ParetoFront` is found again by its
    integral, from the front or from the metrics.
    """

    budget: float
    """Maximum integral of u [m], or of e [m^2 rad m], >= 0."""
    objective: Literal["u", "e"] = "u"
    """The layer that is integrated: "u" gives degenerate metres [m], "e" the paper's
    number [m^2 rad m]."""
    allow_corner_cutting: bool = False
    """True lets a diagonal step pass the corner of a blocked cell; set it to compare with a planner
    that does so."""
    time_limit: float = 60.0
    """Time after which the best path so far is returned, with its bound [s]; above 0."""
    max_labels: int = 20_000_000
    """Maximum number of partial paths that are kept, above 0; each takes 48 bytes. Lower it where
    memory is short."""
    name: ClassVar[str] = "grid"
    minimises: ClassVar[str] = "length"
    space: ClassVar[str] = "R2"

    def check(self) -> None:
        """Raise a ConfigError unless the options are within their ranges."""
        check_number("budget", self.budget, 0)
        check_front_limits(self.objective, self.time_limit, self.max_labels)

    def prepare(self) -> None:
        """Compile the kernels, so that no time limit is spent on that."""
        compile_pareto_kernels()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between two world positions [m] in free cells.

        See `locplan.planning.Planner.solve`. The status is "infeasible", with the least budget that
        would do, if no grid path is within the budget.

        Raises
        ------
        PoseError
            If start or goal lies outside the map or in a blocked cell.
        ConfigError
            If the costmap has no field.
        """
        began = time.perf_counter()
        cutting, until = self.allow_corner_cutting, began + self.time_limit
        problem = ParetoProblem.for_route(costs, start, goal, self.objective, cutting, until)
        try:
            second_to_go, frugal = problem.to_go(0, 1)
            first_to_go, short = problem.to_go(1, 0)
        except FrontTimeoutError:
            note = f"the bounds of the search take longer than {self.time_limit:g} s on this map"
            return PlannerResult(status="timeout", note=note)
        if frugal is None:
            return PlannerResult(status="unreachable")
        allowed = (self.budget - problem.ends[1]) * problem.per_integral
        within, line = np.floor(allowed + problem.tolerance(frugal)), problem.line
        if line is not None and line.units[1] <= within:
            return PlannerResult(line.path, bound=line.path.length)
        if problem.measure_units(frugal)[1] > within:
            min_integral = problem.measure_metres(cells_from_flat_indices(frugal, problem.columns))[
                1
            ]
            if line is not None:
                min_integral = min(min_integral, line.measures[1])
            note = (
                f"no path over the grid has an integral of {self.objective} within {self.budget:g};"
                f" the least is {format_rounded_up(min_integral)}"
            )
            return PlannerResult(status="infeasible", feasible_from=min_integral, note=note)
        assert short is not None  # because there is a frugal one
        bounds = _maximize_bound(problem, first_to_go, short, frugal, within)
        lower = bounds.upper
        if bounds.upper > bounds.lower:
            search = ParetoSearch(
                problem, first_to_go, second_to_go, self.max_labels, within, bounds.joint
            )
            solution_labels, to_come = search.run(1, until)
            if solution_labels.size:
                path = make_path_through_centres(
                    costs, search.trace_cells(int(solution_labels[0])), start, goal
                )
                return PlannerResult(path, bound=path.length)
            lower = min(max(to_come, bounds.lower), bounds.upper)
        best = make_path_through_centres(
            costs, cells_from_flat_indices(bounds.best, problem.columns), start, goal
        )
        return PlannerResult(best, bound=min(problem.length(lower), best.length))


@dataclass(frozen=True)
class _LagrangianBounds:
    """The bounds that Lagrangian relaxation gives, in whole units."""

    best: Ints
    """The shortest path found so far that is within the budget, as flat indices of cells."""
    upper: float
    """The first cost of `best`."""
    lower: float
    """Minimum first cost that a path within the budget can have."""
    joint: tuple[Floats, float, float]
    """Both costs to go, their multiplier, and the greatest sum of a better path."""


def _maximize_bound(
    problem: ParetoProblem,
    first_to_go: Floats,
    shortest_cells: Ints,
    least_integral_cells: Ints,
    budget: float,
) -> _LagrangianBounds:
    """Raise the multiplier to the value with the greatest bound (Handler and Zang, 1980)."""
    outer_first, outer_second = problem.measure_units(shortest_cells)
    if outer_second <= budget:
        return _LagrangianBounds(
            shortest_cells, outer_first, outer_first, (first_to_go, 0.0, np.inf)
        )
    best, (best_first, best_second) = (
        least_integral_cells,
        problem.measure_units(least_integral_cells),
    )
    lower, joint = outer_first, (first_to_go, 0.0, np.inf)
    while True:
        multiplier = (best_first - outer_first) / (outer_second - best_second)
        try:
            joint_to_go, cells = problem.to_go(1, multiplier)
        except FrontTimeoutError:
            return _LagrangianBounds(best, best_first, lower, joint)
        assert cells is not None
        lower = max(lower, joint_to_go[problem.source] - multiplier * budget)
        first, second = problem.measure_units(cells)
        line = outer_first + multiplier * outer_second
        closer = line - (first + multiplier * second) > GAIN * line
        if second <= budget and first < best_first:
            best, best_first, best_second = cells, first, second
        elif budget < second < outer_second:
            outer_first, outer_second = first, second
        else:
            closer = False
        if not closer:  # no path lies below the line between the two
            joint = joint_to_go, multiplier, best_first + multiplier * budget
            return _LagrangianBounds(best, best_first, lower, joint)


SUPPORTED = 24
"""Number of paths of least weighted sums that complete a front whose search was cut short."""
Point: TypeAlias = tuple[float, float, Ints]
"""Both costs of a path in whole units, and its cells (n, 2)."""


def pareto_front(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    objective: str = "u",
    allow_corner_cutting: bool = False,
    time_limit: float = 30.0,
    max_labels: int = 20_000_000,
) -> ParetoFront:
    """Return the exact front of length against an integral along the path, over 8 neighbours.

    The paths are grid planner paths: from the start to the centre of its cell, over
    centres, and to the goal; or straight to the goal if both cells lie in one row,
    column or diagonal. So each of the grid planner's paths, with any weight, is on the front, or
    is dominated by a path on it.

    If time or labels run out, paths of least weighted sums complete the front, and `epsilon` is
    its guaranteed quality. Before the exact search come two searches over all cells, for
    the front's ends; if the time does not suffice for these, the front is empty, with the status
    "timeout".

    Parameters
    ----------
    costs : Costmap
        Costmap made from a field; its weight does not matter.
    start, goal : (x, y)
        Positions in the world [m].
    objective : str, default "u"
        The layer to integrate: "u" gives degenerate metres [m], "e" gives [m^2 rad m].
    allow_corner_cutting : bool, default False
        True lets a diagonal step pass the corner of a blocked cell. Set it to compare with a
        planner that does so.
    time_limit : float, default 30.0
        Time for all searches together [s], above 0; of it, at most a quarter is kept for
        completing the front. It may be exceeded by a tenth of a second. Raise it on a large map
        where `epsilon` is above 0.
    max_labels : int, default 20_000_000
        Maximum number of partial paths that are kept, above 0; each takes 48 bytes. Lower it
        where memory is short.

    Returns
    -------
    ParetoFront
        The front, empty if the goal is unreachable or time ran out at once. Its lengths and
        integrals equal the metrics of its plans. Paths that lower the integral by no more than
        1e-9 of the layer's greatest value times the length of the path of least integral are left
        out; this is also how far a path may exceed a budget.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If an option is out of its range, or the costmap has no field.
    """
    check_costs(costs)
    check_front_limits(objective, time_limit, max_labels)
    compile_pareto_kernels()
    began = time.perf_counter()
    until = began + time_limit
    problem = ParetoProblem.for_route(costs, start, goal, objective, allow_corner_cutting, until)
    searching = time.perf_counter()
    points: list[Point] = []
    epsilon, labels = 0.0, 0
    short = frugal = None
    try:
        second_to_go, frugal = problem.to_go(0, 1)
        first_to_go, short = problem.to_go(1, 0)
    except FrontTimeoutError:
        epsilon = math.inf
    if short is not None and frugal is not None:
        search = ParetoSearch(problem, first_to_go, second_to_go, max_labels=max_labels)
        completing = SUPPORTED * (time.perf_counter() - searching) / 2
        completing = min(completing, time_limit / 4)
        solution_labels, to_come = search.run(100_000, until - completing)
        labels = search.labels
        for label, first, second in zip(
            solution_labels, *search.read_costs(solution_labels), strict=True
        ):
            points.append((float(first), float(second), search.trace_cells(int(label))))
        if problem.line is not None:
            points.append((*problem.line.units, np.empty((0, 2), np.int64)))
        exact = math.isinf(to_come)
        bounds = [] if exact else _add_weighted_sums(problem, points, short, frugal)
        longest = problem.measure_units(frugal)[0]
        points = _drop_dominated(points, longest, problem.tolerance(frugal))
        epsilon = (
            0.0
            if exact
            else _compute_epsilon(points, to_come, second_to_go[problem.source], bounds)
        )
    measures = np.reshape([problem.measure_metres(cells) for *_, cells in points], (-1, 2))
    return ParetoFront(
        costs=costs,
        start=start,
        goal=goal,
        objective=objective,
        length=measures[:, 0],
        integral=measures[:, 1],
        epsilon=epsilon,
        labels=labels,
        solve_time=time.perf_counter() - began,
        cells=tuple(cells for *_, cells in points),
    )


def _drop_dominated(points: list[Point], longest: float, tolerance: float) -> list[Point]:
    """Return the points that no point dominates, by rising first cost up to `longest`.

    A second cost must be lower by more than the tolerance than for every shorter path, so that
    a budget of that much never lets one of them in.
    """
    best: list[Point] = []
    lowest_second = math.inf
    for point in sorted(points, key=lambda point: point[:2]):
        if point[0] <= longest and point[1] < lowest_second - tolerance:
            best.append(point)
        lowest_second = min(lowest_second, point[1])
    return best


def _compute_epsilon(
    points: list[Point], min_first: float, min_second: float, bounds: list[tuple[float, float]]
) -> float:
    """Return the greatest relative gain over all points of a path that may have been missed.

    Its first cost is at least `min_first`, its second at least `min_second`, and first +
    multiplier * second at least value, for each (multiplier, value) of `bounds`.
    """
    first, second = (np.array([point[i] for point in points]) for i in (0, 1))
    edges = np.linspace(min(min_first, first[-1]), first[-1], 4001)
    below = np.full(edges.size, float(min_second))
    for multiplier, value in bounds:
        below = np.maximum(below, (value - edges) / multiplier)
    # From one edge to the next the bound on the second cost falls; both ends count at worst.
    over_first = first[:, None] / np.maximum(edges[None, :-1], 1e-300)
    over_second = np.maximum(second[:, None], 1e-9) / np.maximum(below[None, 1:], 1e-9)
    worst = np.maximum(over_first, over_second).min(axis=0).max()
    return max(0.0, float(worst) - 1)


def _add_weighted_sums(
    problem: ParetoProblem, points: list[Point], shortest_cells: Ints, least_integral_cells: Ints
) -> list[tuple[float, float]]:
    """Add paths of least weighted sums to the points, the widest gaps first.

    For each (multiplier, value) that is returned, all paths have first + multiplier * second of at
    least value.
    """
    bounds: list[tuple[float, float]] = []
    left, right = problem.measure_units(shortest_cells), problem.measure_units(least_integral_cells)
    points.append((*left, cells_from_flat_indices(shortest_cells, problem.columns)))
    points.append((*right, cells_from_flat_indices(least_integral_cells, problem.columns)))
    gaps = [(left, right)]
    while gaps and len(bounds) < SUPPORTED and not (bounds and time.perf_counter() > problem.until):
        gaps.sort(key=lambda gap: (gap[1][0] - gap[0][0]) * (gap[0][1] - gap[1][1]))
        left, right = gaps.pop()
        if not (right[0] > left[0] and left[1] > right[1]):
            continue
        multiplier = (right[0] - left[0]) / (left[1] - right[1])
        try:
            to_go, flat = problem.to_go(1, multiplier)
        except FrontTimeoutError:
            break
        assert flat is not None
        bounds.append((multiplier, float(to_go[problem.source])))
        middle = problem.measure_units(flat)
        line = left[0] + multiplier * left[1]
        if line - (middle[0] + multiplier * middle[1]) > GAIN * line:
            points.append((*middle, cells_from_flat_indices(flat, problem.columns)))
            gaps += [(left, middle), (middle, right)]
    return bounds

"""The exact search for trade-offs between length and an integral along the path, on the grid."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Array, Floats, Ints
from locplan._util.checks import one_of, positive
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError
from locplan.planners._grid import blank_costs, bordered_ends, cells_of
from locplan.planners._grid_paths import straight_line
from locplan.planners._protocol import Position

GAIN = 1e-10
"""Share of a weighted sum by which a path must be better to lie below a line."""
TOLERANCE = 1e-9
"""Share of the greatest rate by which integrals may differ, over the path of least integral.

Of it, whole units take 1.4e-10 a step, ties 2e-11, and the metrics' sums of floats the rest.
"""
STRETCH = 200_000
"""Number of expansions between two looks at the clock."""


class OutOfTime(Exception):
    """A search over the grid was given up at its time limit."""


@dataclass(frozen=True, eq=False)
class Line:
    """The straight line from start to goal, which is the shortest of all grid paths."""

    path: Path
    """The line."""
    measures: tuple[float, float]
    """Its length [m], and the integral along it."""
    units: tuple[float, float]
    """Both costs in whole units, less those of the ways from the ends to their cells' centres."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Two costs on the bordered grid, in whole units as `locplan._kernels.pareto` wants them.

    A path leads from the start to the centre of its cell, over centres, and to the goal, or along
    the straight `line`, as those of the grid planner do.
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
    line: Line | None
    """The straight line, which the search over cells does not know; None if it is no grid path."""
    until: float = np.inf
    """Time of `time.perf_counter` at which searches over the grid are given up [s]."""

    @classmethod
    def between(
        cls,
        costs: Costmap,
        start: Position,
        goal: Position,
        objective: str,
        cutting: bool,
        until: float = np.inf,
    ) -> Problem:
        """The problem of a costmap between two positions; without a field it is a ConfigError."""
        from locplan._kernels.pareto import SCALE

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
        source, target = bordered_ends(costs, start, goal)
        ends_length = ends_integral = 0.0
        for xy in (start, goal):
            cell = costs.cell_of(xy)
            apart = float(np.hypot(*np.subtract(xy, costs.grid.position(*cell))))
            ends_length += apart
            ends_integral += apart * float(layer[cell])
        per_metre = SCALE / costs.grid.resolution
        per_integral = SCALE / (costs.grid.resolution * greatest)
        line, path = None, straight_line(costs, start, goal, cutting)
        if path is not None:
            metrics = path_metrics(costs, path)
            integral = metrics.integrated_e if objective == "e" else metrics.integrated_u
            first = np.ceil((metrics.length - ends_length) * per_metre)
            second = np.floor((integral - ends_integral) * per_integral)
            line = Line(path, (metrics.length, integral), (float(first), float(second)))
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

    def to_go(self, length: float, integral: float) -> tuple[Array, Array | None]:
        """Minimum weighted sums of both costs to the goal, and the start's path over flat indices.

        No sum is overstated, but that of the integral alone, by the ties. Once `until` is over, it
        is `OutOfTime`.
        """
        from locplan._kernels.pareto import SCALE
        from locplan._kernels.search import scale_of, search
        from locplan._kernels.ways import trace

        half = self.half * (integral or 1.0)
        if not integral:
            half[np.isfinite(half)] = 0.0
        # Where only the integral counts, a little of length makes the shortest of equal paths win:
        # a third of a unit a cell, and 53 bits still hold each step beside a sum over 10^5 cells.
        half += (length or 2e-11) * SCALE / 2
        way = half, self.columns, self.target, -1, self.allow_corner_cutting
        cost, _, finished = search(*way, scale_of(half), until=self.until)
        if not finished:
            raise OutOfTime
        np.abs(cost, out=cost)
        if not np.isfinite(cost[self.source]):
            return cost, None
        flat = trace(half, self.columns, cost, self.source, self.allow_corner_cutting)
        cost *= 1 - 1e-12  # by which sums of floats over a path may overstate its cost
        return cost, flat[::-1]

    def measured(self, flat: Ints) -> tuple[float, float]:
        """Both costs of a path over cells, given by flat indices, in whole units."""
        from locplan._kernels.pareto import SCALE

        apart = np.abs(np.diff(flat))
        diagonal = (apart > 1) & (apart != self.columns)
        steps = self.half[flat[1:]] + self.half[flat[:-1]]
        second = np.where(diagonal, np.ceil(np.sqrt(2.0) * steps), steps).sum()
        first = np.where(diagonal, np.ceil(np.sqrt(2.0) * SCALE), SCALE).sum()
        return float(first), float(second)

    def unrounded(self, cells: Ints) -> tuple[float, float]:
        """The length [m] of a path over cells (n, 2) with its ends, and the integral along it.

        Without cells they are those of the line.
        """
        if self.line is not None and not len(cells):
            return self.line.measures
        apart = self.costs.grid.resolution * np.hypot(*np.diff(cells, axis=0).T)
        rates = np.asarray(self.layer[cells[:, 0], cells[:, 1]], np.float64)
        integral = float(apart @ (rates[1:] + rates[:-1]) / 2)
        return float(apart.sum()) + self.ends[0], integral + self.ends[1]

    def length(self, first: float) -> float:
        """The length of a path with its ends, from whole units [m]."""
        return first / self.per_metre + self.ends[0]

    def tolerance(self, frugal: Ints) -> float:
        """Units by which integrals may differ, from the path of least integral (`TOLERANCE`)."""
        first, second = self.measured(frugal)
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
    one_of("objective", objective, ("u", "e"))
    positive("time_limit", time_limit, "s")
    positive("max_labels", max_labels)


def prepare() -> None:
    """Compile the kernels, so that no time limit is spent on that."""
    costs = dataclasses.replace(blank_costs(2, 3), u=np.ones((2, 3)))
    problem = Problem.between(costs, (0.5, 0.5), (2.5, 1.5), "u", False)
    search = Search(problem, problem.to_go(1, 0)[0], problem.to_go(0, 1)[0], max_labels=100)
    found, _ = search.run(1, np.inf)
    search.cells_of(int(found[0]))


class Search:
    """A bi-objective search that can be paused, with its labels, which are partial paths.

    It looks for second costs of at most `within`. Lower bounds to the goal are those that
    `Problem.to_go` gives; `joint` holds both_to_go, multiplier and most of the kernel's search.
    """

    def __init__(
        self,
        problem: Problem,
        first_to_go: Floats,
        second_to_go: Floats,
        max_labels: int,
        within: float = np.inf,
        joint: tuple[Floats, float, float] | None = None,
    ) -> None:
        from locplan._kernels import pareto

        self.problem = problem
        self._max_labels = max(max_labels, 9)
        grid = problem.half, problem.columns, problem.target, problem.allow_corner_cutting
        joint = joint or (first_to_go, 0.0, np.inf)
        self._terms = pareto.Terms(*grid, first_to_go, second_to_go, *joint)
        room = min(1 << 16, self._max_labels)  # at first
        lowest = int(first_to_go[problem.source] * pareto.BUCKETS_A_CELL / pareto.SCALE)
        state = np.zeros(7, np.int64)
        state[[pareto.UNUSED, pareto.USED, pareto.WAITING]] = -1, 1, 1
        state[pareto.LOWEST] = lowest
        heads = np.full(pareto.BUCKETS, -1, np.int32)
        heads[lowest % pareto.BUCKETS] = 0
        least = np.full(problem.half.size, np.inf)
        least[problem.target] = within + 0.5
        self._labels = pareto.Labels(
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
            least=least,
        )

    @property
    def labels(self) -> int:
        """Number of labels."""
        from locplan._kernels.pareto import USED

        return int(self._labels.state[USED])

    def run(self, solutions: int, until: float) -> tuple[NDArray[np.int32], float]:
        """Search until there are so many solutions or labels, or `time.perf_counter` is `until`.

        The labels at the goal come by rising first cost, then the least first cost of all others.
        """
        from locplan._kernels import pareto

        found = np.zeros(solutions, np.int32)
        while True:
            bound = pareto.search(self._labels, self._terms, STRETCH, found)
            status, count = (int(self._labels.state[i]) for i in (pareto.STATUS, pareto.SOLUTIONS))
            full = status == pareto.OUT_OF_LABELS and not self._grow()
            late = time.perf_counter() > until
            if status == pareto.FINISHED or count == solutions or full or late:
                return found[:count], bound

    def costs_of(self, labels: NDArray[np.int32]) -> tuple[Array, Array]:
        """Both costs of labels in whole units."""
        return self._labels.first[labels], self._labels.second[labels]

    def cells_of(self, label: int) -> Ints:
        """The cells (n, 2) of the path to a label, as (row, col)."""
        from locplan._kernels.pareto import path_of

        return cells_of(path_of(self._labels, label), self.problem.columns)

    def _grow(self) -> bool:
        """Double the room as far as it is allowed; return False if it is full."""
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

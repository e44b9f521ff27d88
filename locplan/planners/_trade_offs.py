"""The exact trade-off between length and an integral along the path, on the grid."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import one_of, positive
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.planners._grid import bordered_index, cells_of

OBJECTIVES = ("u", "e")
ROOM = 1 << 16
"""For labels, at first."""
TIE = 2e-11
"""Weight of length where only the integral counts: of paths with one integral the shortest.

Over 10^5 cells it adds half a unit, and each step still counts beside the sum in 53 bits.
"""
STRETCH = 200_000
"""Expansions between two looks at the clock."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Two costs on the bordered grid, in whole units as `locplan._kernels.pareto` wants them.

    A path goes from the start to its cell's centre, over centres, and from the goal's to the goal.
    """

    costs: Costmap
    length_half: NDArray[np.float64]
    """Half the first cost's density: lengths."""
    half: NDArray[np.float64]
    """Half the second cost's: u or e."""
    source: int
    """The start's cell."""
    target: int
    """The goal's cell."""
    per_metre: float
    """Units of the first cost a metre."""
    per_integral: float
    """Units of the second cost for an integral of 1 (m, or m^2 rad m)."""
    ends: tuple[float, float]
    """What both ends cost besides, from positions to centres: [m], and the integral."""
    allow_corner_cutting: bool

    @classmethod
    def between(
        cls,
        costs: Costmap,
        start: Sequence[float],
        goal: Sequence[float],
        objective: str,
        allow_corner_cutting: bool,
    ) -> Problem:
        """The problem of a costmap.

        Raises
        ------
        ConfigError
            If the costmap has no field.
        PoseError
            If start or goal lies outside the map or in a blocked cell.
        """
        from locplan._kernels.pareto import SCALE
        from locplan._kernels.search import bordered_half

        layer = costs.e if objective == "e" else costs.u
        free = np.isfinite(costs.density)
        if not np.isfinite(layer[free]).all():
            raise ConfigError(f"a costmap without a field has no {objective} to trade length for")
        greatest = float(layer[free].max()) or 1.0
        # Rounded up, so that no integral is understated.
        whole = 2 * np.ceil(np.where(free, layer, 0.0) * (SCALE / greatest / 2))
        ends_length = ends_integral = 0.0
        for role, xy in (("start", start), ("goal", goal)):
            cell = costs.cell_of(xy, role)
            apart = float(np.hypot(*np.subtract(xy, costs.grid.cell_to_world(*cell))))
            ends_length += apart
            ends_integral += apart * float(layer[cell])
        return cls(
            costs=costs,
            length_half=bordered_half(np.where(free, float(SCALE), np.inf), 1),
            half=bordered_half(np.where(free, whole, np.inf), 1),
            source=bordered_index(costs, start, "start"),
            target=bordered_index(costs, goal, "goal"),
            per_metre=SCALE / costs.grid.resolution,
            per_integral=SCALE / (costs.grid.resolution * greatest),
            ends=(ends_length, ends_integral),
            allow_corner_cutting=allow_corner_cutting,
        )

    @property
    def columns(self) -> int:
        """Of the bordered grid."""
        return self.costs.grid.shape[1] + 2

    def to_go(
        self, length: float, integral: float
    ) -> tuple[NDArray[Any], NDArray[np.int64] | None]:
        """Least weighted sum of both costs from every cell to the goal, and the start's path.

        The sum is never overstated; of equal ones the shortest path is taken.
        """
        from locplan._kernels.search import shortest_costs, trace

        half = (length or TIE) * self.length_half
        if integral:
            half = half + integral * self.half
        cutting = self.allow_corner_cutting
        cost = shortest_costs(half, self.columns, self.target, -1, cutting)
        if not np.isfinite(cost[self.source]):
            return cost, None
        flat = trace(half, self.columns, cost, self.source, cutting)
        # Whole units, so that without the ties, too, no path costs less.
        return (cost * (1 - 1e-14) if length else np.floor(cost)), flat[::-1]

    def measured(self, flat: NDArray[np.int64]) -> tuple[float, float]:
        """Both costs of a path over cells, in whole units."""
        from locplan._kernels.pareto import SCALE

        diagonal = np.abs(np.diff(flat)) > 1
        diagonal &= np.abs(np.diff(flat)) != self.columns
        steps = self.half[flat[1:]] + self.half[flat[:-1]]
        second = np.where(diagonal, np.ceil(np.sqrt(2.0) * steps), steps).sum()
        first = np.where(diagonal, np.ceil(np.sqrt(2.0) * SCALE), SCALE).sum()
        return float(first), float(second)

    def length(self, first: NDArray[Any] | float) -> NDArray[Any] | float:
        """Whole units as the length of the path with its ends [m]."""
        return first / self.per_metre + self.ends[0]

    def integral(self, second: NDArray[Any] | float) -> NDArray[Any] | float:
        """Whole units as the integral along the path with its ends."""
        return second / self.per_integral + self.ends[1]


def check_caps(objective: str, time_limit: float, max_labels: int) -> None:
    """Raise a ConfigError unless these options of a search are within their ranges."""
    one_of("objective", objective, OBJECTIVES)
    positive("time_limit", time_limit, "s")
    positive("max_labels", max_labels)


def prepare() -> None:
    """Compile the kernels, so that no time limit is spent on that."""
    from locplan._kernels.search import bordered_half, costs_by_heap
    from locplan.maps import FREE, OccupancyGrid

    costs_by_heap(bordered_half(np.ones((1, 1)), 1), 3, 4, 4, False)
    blank = Costmap.blank(OccupancyGrid(np.full((2, 3), FREE), 1.0))
    costs = dataclasses.replace(blank, u=np.ones((2, 3)))
    problem = Problem.between(costs, (0.5, 0.5), (2.5, 1.5), "u", False)
    bounds = problem.to_go(1, 0)[0], problem.to_go(0, 1)[0]
    search = Search(problem, *bounds, max_labels=100)
    found, _ = search.run(1, np.inf)
    search.cells_of(int(found[0]))


class Search:
    """A bi-objective search that can be paused, with its labels.

    Parameters
    ----------
    problem : Problem
        What to search.
    first_to_go, second_to_go : (n,) arrays
        Lower bounds, as `Problem.to_go` gives them.
    max_labels : int
        How many there may be.
    within : float
        Second costs of this or less are wanted.
    both_to_go, multiplier, most
        See `locplan._kernels.pareto.search`; by default nothing is left out by them.
    """

    def __init__(
        self,
        problem: Problem,
        first_to_go: NDArray[np.float64],
        second_to_go: NDArray[np.float64],
        *,
        max_labels: int,
        within: float = np.inf,
        both_to_go: NDArray[np.float64] | None = None,
        multiplier: float = 0.0,
        most: float = np.inf,
    ) -> None:
        from locplan._kernels import pareto

        self.problem = problem
        self._max_labels = max(max_labels, 9)
        self._bounds = first_to_go, second_to_go
        self._joint = first_to_go if both_to_go is None else both_to_go, multiplier, most
        room = min(ROOM, self._max_labels)
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
        """How many there are."""
        from locplan._kernels.pareto import USED

        return int(self._labels.state[USED])

    def run(self, solutions: int, until: float) -> tuple[NDArray[np.int32], float]:
        """Search until so many solutions, a moment of `time.perf_counter`, or so many labels.

        Returns
        -------
        solutions : (n,) array of int32
            Labels at the goal, by rising first cost.
        bound : float
            What all others cost first at least; infinite if there are none.
        """
        from locplan._kernels import pareto

        found = np.zeros(solutions, np.int32)
        while True:
            bound = pareto.search(
                self._labels,
                self.problem.half,
                self.problem.columns,
                self.problem.target,
                *self._bounds,
                *self._joint,
                self.problem.allow_corner_cutting,
                STRETCH,
                found,
            )
            status, count = (int(self._labels.state[i]) for i in (pareto.STATUS, pareto.SOLUTIONS))
            full = status == pareto.OUT_OF_LABELS and not self._grow()
            late = time.perf_counter() > until
            if status == pareto.FINISHED or count == solutions or full or late:
                return found[:count], bound

    def costs_of(self, labels: NDArray[np.int32]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Both costs of labels, in whole units."""
        return self._labels.first[labels], self._labels.second[labels]

    def cells_of(self, label: int) -> NDArray[np.int64]:
        """The cells (n, 2) of (row, col) of a label's path."""
        from locplan._kernels.pareto import path_of

        return cells_of(path_of(self._labels, label), self.problem.columns)

    def _grow(self) -> bool:
        """Twice the room, or as much as is allowed; whether there is any."""
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

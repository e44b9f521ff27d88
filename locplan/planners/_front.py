"""A Pareto front of paths as a result: its table, its knee, its files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.saved import Stored
from locplan._util.tables import finite, rounded_up, table, write_csv
from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.planners._grid import through_centres
from locplan.planners._protocol import Found, Position, Status
from locplan.planners._result import Plan, finished

POINT = Column("length", "m", "length"), Column("integral", title="integral")
"""Columns of a front's paths; the integral is in m of u, and in m^2 rad m of e."""
SUMMARY = ("start", "goal", "objective", "status", "epsilon", "labels", "solve_time")
SAME_DISTANCE = 1e-9
"""Distance from a chord, as a share of the front's spans, up to which two paths are level."""


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Result, Stored):
    """Grid paths by rising length and falling integral, so that none is better in both.

    `save` writes front.npz, which `load` reads, and front.json, front.csv, a picture and the path
    at the knee.
    """

    kind: ClassVar[str] = "front"
    files: ClassVar[Results] = Results(
        "front", ("front.json", "front.npz", "front.csv", "front.png", "knee.csv")
    )
    costs: Costmap
    """The costmap that the paths were planned on."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    objective: str
    """The layer that is integrated, "u" or "e"."""
    length: NDArray[np.float64]
    """Length of each path, (n,) [m]."""
    integral: NDArray[np.float64]
    """Integral of u [m] or e [m^2 rad m] along each path, (n,)."""
    epsilon: float
    """A path of the front is at most 1 + epsilon times as long and uncertain as any grid path.
    Epsilon is 0 and the front exact, unless time or labels ran out; it is infinite if the time did
    not suffice for a single path."""
    labels: int
    """Number of partial paths that were kept."""
    solve_time: float
    """Time spent on the search, without compilation [s]."""
    cells: tuple[NDArray[np.int64], ...]
    """The cells of each path as (row, col), (n, 2)."""
    _drawn_by: ClassVar[str] = "locplan.plotting:front_figure"

    def __repr__(self) -> str:
        if self.status == "timeout":
            return f"ParetoFront(no path was found within the time limit, {self.solve_time:.3g} s)"
        if not len(self):
            return "ParetoFront(no path joins start and goal)"
        exact = "exact" if self.epsilon == 0 else f"within {self.epsilon:.2%}"
        return (
            f"ParetoFront({len(self)} paths of {self.length[0]:.2f} to {self.length[-1]:.2f} m,"
            f" {exact}, knee at {self.length[self.knee]:.2f} m)"
        )

    @property
    def drawable(self) -> bool:
        """Whether there is a path."""
        return len(self) > 0

    def __len__(self) -> int:
        return len(self.length)

    @property
    def status(self) -> Status:
        """The status is "solved", or says why there is no path: "unreachable", or "timeout"."""
        if len(self):
            return "solved"
        return "timeout" if math.isinf(self.epsilon) else "unreachable"

    def plan(self, index: int) -> Plan:
        """One of the paths as a plan, with its metrics.

        Parameters
        ----------
        index : int
            Index of the path, 0 for the shortest; -1 for the longest, as in a list. `knee` is the
            index of a good compromise.

        Raises
        ------
        ConfigError
            If there is no such path.
        """
        self._check_paths()
        if not -len(self) <= index < len(self):
            raise ConfigError(f"the front has {len(self)} paths, from 0 on; there is no {index}")
        path = through_centres(self.costs, self.cells[index], self.start, self.goal)
        return finished("pareto", self.costs, self.start, self.goal, Found(path), self.solve_time)

    def summary(self) -> dict[str, object]:
        """The front without its cells, fit for JSON."""
        about = {name: getattr(self, name) for name in SUMMARY}
        about["knee"] = self.knee if len(self) else None
        about |= {each.name: getattr(self, each.name).tolist() for each in POINT}
        costs = about_costs(self.costs)
        del costs["weight"]  # it does not matter
        return {**costs, **finite(about)}

    def table(self) -> Table:
        """Length and integral of each path."""
        return Table(POINT, tuple(zip(*(getattr(self, each.name) for each in POINT), strict=True)))

    def report(self) -> str:
        """Up to twelve paths with what each metre more saves, the knee marked."""
        if self.status == "timeout":
            return (
                f"timeout: no path was found within {self.solve_time:.2f} s; raise the time limit"
            )
        if not len(self):
            return "unreachable: no path leads to the goal"
        unit = "m" if self.objective == "u" else f"{self.costs.e_unit} m"
        lengths = np.linspace(self.length[0], self.length[-1], 12)
        shown = np.abs(self.length[:, None] - lengths).argmin(axis=0)
        rows = []
        for index in sorted({*map(int, shown), self.knee}):
            longer = self.length[index] / self.length[0] - 1
            texts = [f"{self.length[index]:.2f} m", f"+{longer:.1%}"]
            texts += [
                f"{rounded_up(self.integral[index])} {unit}",
                "knee" if index == self.knee else "",
            ]
            rows.append([str(index), *texts])
        how = "exact" if self.epsilon == 0 else f"within {self.epsilon:.2%} of every path"
        count = f"{len(self)} path{'' if len(self) == 1 else 's'}"
        last = f"{count}, {how}; {self.labels:,} labels, {self.solve_time:.2f} s"
        return f"{table(['path', 'length', 'longer', f'∫{self.objective} ds', ''], rows)}\n{last}"

    def _write(self, folder: Path, *_: object) -> None:
        self.write(folder / "front.npz")
        # All digits: a budget that is copied from here must not lie below the path's integral.
        both = np.column_stack([self.length, self.integral])
        write_csv(folder / "front.csv", both, ",".join(self.table().names), "%s")
        if len(self):
            path = self.plan(self.knee).path
            assert path is not None
            path.save(folder / "knee.csv")

    @property
    def knee(self) -> int:
        """Index of the path that lies farthest below the chord between the front's ends.

        Lengths and integrals count as shares of what they span on the front: this is the knee of
        Das (1999), which depends on the front's shape alone, not on how much there is to save. On a
        front that nowhere bends below its chord, such as one of two paths, it is the shortest path.
        An empty front has no knee: that is a ConfigError.

        References
        ----------
        Das, "On characterizing the 'knee' of the Pareto curve based on normal-boundary
        intersection", Structural Optimization 18 (1999), doi 10.1007/BF01195985. For curves of one
        variable it is that of Satopaa et al., "Finding a 'kneedle' in a haystack", ICDCS Workshops
        (2011), doi 10.1109/ICDCSW.2011.20.
        """
        self._check_paths()
        spans = self.length[-1] - self.length[0], self.integral[0] - self.integral[-1]
        if not min(spans) > 0:
            return 0
        longer = (self.length - self.length[0]) / spans[0]
        saved = (self.integral[0] - self.integral) / spans[1]
        below = saved - longer
        # The first of those that rounding alone sets apart.
        return int(np.argmax(below > below.max() - SAME_DISTANCE))

    def _check_paths(self) -> None:
        """Raise a ConfigError if there is no path."""
        if self.status == "timeout":
            raise ConfigError("the front is empty: no path was found in time; raise time_limit")
        if self.status == "unreachable":
            raise ConfigError("the front is empty: the goal is unreachable")

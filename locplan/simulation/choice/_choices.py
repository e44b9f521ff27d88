"""Many simulated choices, and what they bring over the shortest paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.tables import finite, table
from locplan.planners import Query
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._driven import Candidate

COLUMNS = (
    "map",
    "query",
    "start_x_m",
    "start_y_m",
    "goal_x_m",
    "goal_y_m",
    "chosen",
    "length_shortest_m",
    "length_chosen_m",
    "error_shortest",
    "error_chosen",
    "lost_shortest",
    "lost_chosen",
)
"""Names of the columns of `Choices.rows`; errors are in metres, or in radians of headings."""


@dataclass(frozen=True)
class MapChoice:
    """The choice for one query."""

    map: str
    """Name of the map."""
    query: Query
    """Start and goal that were asked for."""
    choice: Choice
    """The candidates of the query, and the one to take."""

    @property
    def lengths(self) -> tuple[float, float]:
        """Length of the shortest and of the chosen path [m]; NaN without a path."""
        return self._both(lambda each: each.path.length)

    @property
    def errors(self) -> tuple[float, float]:
        """Typical error of both: geometric mean over the drives [m], or [rad] of headings."""
        return self._both(lambda each: each.driven.error.value if each.driven else math.nan)

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives of both, 0..1; NaN without a path."""
        return self._both(lambda each: each.driven.lost_rate.value if each.driven else math.nan)

    def _both(self, value: Callable[[Candidate], float]) -> tuple[float, float]:
        shortest, chosen = self.choice.shortest, self.choice.chosen
        if shortest is None or chosen is None:
            return math.nan, math.nan
        return value(shortest), value(chosen)


@dataclass(frozen=True, repr=False)
class Choices:
    """Choices for many queries; intervals are over the queries that have a path.

    Errors are those of the drives that confirmed the choice: those of paths that were taken are
    promised a few per cent too small.
    """

    choices: tuple[MapChoice, ...]
    """Choices in the order of the maps and of their queries."""

    def __repr__(self) -> str:
        ratio = f"error {self.error_ratio.value:.2f} of the shortest's"
        return f"Choices({len(self)} queries, {self.left} left the shortest, {ratio})"

    def __len__(self) -> int:
        return len(self.choices)

    def __iter__(self) -> Iterator[MapChoice]:
        return iter(self.choices)

    def __getitem__(self, number: int) -> MapChoice:
        return self.choices[number]

    @property
    def solved(self) -> tuple[MapChoice, ...]:
        """Choices for the queries that have a path."""
        return tuple(each for each in self.choices if each.choice.candidates)

    @property
    def left(self) -> int:
        """Number of queries for which another path than the shortest is recommended."""
        return sum(each.choice.best > 0 for each in self.solved)

    @property
    def error_ratio(self) -> Interval:
        """Ratio of the chosen paths' error to the shortest's: geometric mean over the queries."""
        return of_geometric_mean(np.array([e.errors[1] / e.errors[0] for e in self.solved]))

    @property
    def length_ratio(self) -> Interval:
        """Ratio of the chosen paths' length to the shortest's: geometric mean."""
        return of_geometric_mean(np.array([e.lengths[1] / e.lengths[0] for e in self.solved]))

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives along the shortest and the chosen paths: means over the queries."""
        both = np.array([each.lost for each in self.solved]).reshape(-1, 2)
        if not len(both):
            return math.nan, math.nan
        shortest, chosen = both.mean(axis=0).tolist()
        return shortest, chosen

    def of_map(self, name: str) -> Choices:
        """Choices for the queries on one map.

        Parameters
        ----------
        name : str
            Name of the map, as in `MapChoice.map`.
        """
        return Choices(tuple(each for each in self.choices if each.map == name))

    def rows(self) -> list[list[object]]:
        """One row per query, in the columns of `COLUMNS`; NaN where there is no path."""
        return [
            [
                each.map,
                each.query.name,
                *each.query.start[:2],
                *each.query.goal[:2],
                each.choice.chosen.name if each.choice.chosen else "",
                *each.lengths,
                *each.errors,
                *each.lost,
            ]
            for each in self.choices
        ]

    def summary(self) -> dict[str, object]:
        """What the choices bring, and each of them, fit for JSON.

        Pairs are of the shortest and of the chosen path.
        """
        about: dict[str, object] = {
            "queries": len(self),
            "solved": len(self.solved),
            "left_the_shortest": self.left,
            "error_ratio": list(self.error_ratio),
            "length_ratio": list(self.length_ratio),
            "lost": list(self.lost),
            "choices": [
                {"map": each.map, "query": each.query.name, **each.choice.summary()}
                for each in self.choices
            ],
        }
        return finite(about)

    def table(self) -> str:
        """Text of what the choices bring, one row per map and one of all maps."""
        names = list(dict.fromkeys(each.map for each in self.choices))
        groups = {name: self.of_map(name) for name in names}
        if len(names) > 1:
            groups["all maps"] = self
        columns = ["map", "queries", "detours", "length", "error", "lost"]
        rows = [[name, *group._texts()] for name, group in groups.items()]
        last = (
            "detours leave the shortest path; chosen over shortest, by the drives that confirmed it"
            " [95 % intervals]"
        )
        return f"{table(columns, rows)}\n{last}"

    def _texts(self) -> list[str]:
        if not self.solved:
            return [f"0 of {len(self)} have a path", *["–"] * 4]
        solved, every = len(self.solved), len(self)
        ratio, before, after = self.error_ratio, *self.lost
        interval = "" if math.isnan(ratio.low) else f" [{ratio.low:.2f}, {ratio.high:.2f}]"
        return [
            f"{every}" if solved == every else f"{solved} of {every}",
            f"{self.left}",
            f"{self.length_ratio.value - 1:+.1%}",
            f"{ratio.value:.2f}{interval}",
            f"{before:.0%} -> {after:.0%}",
        ]

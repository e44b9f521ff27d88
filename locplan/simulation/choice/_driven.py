"""Candidates of a choice, and how their drives went."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_mean, wilson
from locplan._util.records import Column
from locplan._util.tables import finite
from locplan.costs import Path, PathMetrics
from locplan.simulation._drives import Drives

STEPS = 200
"""Greatest number of places at which errors along a path are kept."""


@dataclass(frozen=True, eq=False)
class Driven:
    """How the drives went whose figures are shown of a candidate."""

    numbers: range
    """Numbers of the drives; those of the same number have one world and one seed."""
    log_error: NDArray[np.float64]
    """Logarithm of the error of each drive, (drives,) [ln m, or ln rad]."""
    lost: NDArray[np.bool_]
    """True for each drive that was off by more than 1 m at some time, (drives,)."""
    ratio: Interval
    """Ratio of the error to the shortest path's."""
    profile: NDArray[np.float64]
    """Distance along the path, and the median, the 10 % and the 90 % quantile over the drives of
    the error of the position there, (n, 4) [m]."""

    @classmethod
    def of(
        cls, drives: Drives, numbers: range, log_error: NDArray[np.float64], ratio: Interval
    ) -> Driven:
        """What is kept of some drives.

        Parameters
        ----------
        drives : Drives
            The drives along one path.
        numbers : range
            Numbers of these drives.
        log_error : (drives,) array
            Logarithm of the error of each drive [ln m, or ln rad].
        ratio : Interval
            Ratio of the error to the shortest path's.
        """
        at = np.unique(np.linspace(0, len(drives.poses) - 1, STEPS).round().astype(int))
        low, median, high = np.quantile(drives.position_error[:, at], (0.1, 0.5, 0.9), axis=0)
        profile = np.column_stack([drives.distance[at], median, low, high])
        return cls(numbers, log_error, drives.lost, ratio, profile)

    @property
    def error(self) -> Interval:
        """Error of a typical drive: the geometric mean [m, or rad]."""
        return Interval(*np.exp(of_mean(self.log_error)).tolist())

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were off by more than 1 m at some time."""
        return wilson(float(self.lost.mean()), len(self.lost))

    def summary(self) -> dict[str, Any]:
        """All of it, fit for JSON."""
        return finite(
            {
                "drives": len(self.numbers),
                "first_drive": self.numbers.start,
                "error": list(self.error),
                "ratio": list(self.ratio),
                "lost_rate": list(self.lost_rate),
                "log_error": self.log_error.tolist(),
                "lost": self.lost.tolist(),
                "profile": self.profile.tolist(),
            }
        )

    @classmethod
    def from_summary(cls, about: Mapping[str, Any]) -> Driven:
        """What `summary` described.

        Parameters
        ----------
        about : mapping
            What `summary` gives.
        """
        first = about["first_drive"]
        return cls(
            range(first, first + about["drives"]),
            np.array(about["log_error"], float),
            np.array(about["lost"], bool),
            Interval(*map(number_of, about["ratio"])),
            np.array(about["profile"], float),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Candidate:
    """A path that may be taken."""

    name: str
    """Name of the path, such as "shortest" or "clear of walls"."""
    path: Path
    """The path from start to goal."""
    metrics: PathMetrics
    """Metrics of the path on the costmap."""
    driven: Driven | None = None
    """How its drives went; None where nothing was driven."""
    deviation: tuple[float, float] = (math.nan, math.nan)
    """Mean and greatest deviation of the position in the field along the path [m]; NaN where that
    is not known."""
    planner: str = ""
    """Name of its planner; empty of a path that was given."""
    note: str = ""
    """What the planner says of it."""
    history: tuple[tuple[float, float], ...] = ()
    """Time since a sampling planner began [s] and its best J [m], whenever that fell."""

    def __repr__(self) -> str:
        return f"Candidate({self.name}, {self.path.length:.2f} m)"

    def summary(self) -> dict[str, Any]:
        """All of it, fit for JSON."""
        heading = self.path.heading
        return {
            "name": self.name,
            "metrics": finite(dataclasses.asdict(self.metrics)),
            "driven": self.driven.summary() if self.driven else None,
            "deviation": finite(list(self.deviation)),
            "planner": self.planner,
            "note": self.note,
            "history": [list(each) for each in self.history],
            "xy": self.path.xy.tolist(),
            "heading": None if heading is None else heading.tolist(),
        }

    @classmethod
    def from_summary(cls, about: Mapping[str, Any]) -> Candidate:
        """What `summary` described.

        Parameters
        ----------
        about : mapping
            What `summary` gives.
        """
        metrics = {name: number_of(value) for name, value in about["metrics"].items()}
        heading = about["heading"]
        return cls(
            about["name"],
            Path(np.array(about["xy"]), None if heading is None else np.array(heading)),
            PathMetrics(**metrics),
            Driven.from_summary(about["driven"]) if about["driven"] else None,
            tuple(map(number_of, about["deviation"])),  # type: ignore[arg-type]
            about["planner"],
            about["note"],
            tuple((time, cost) for time, cost in about["history"]),
        )


def number_of(value: float | None) -> float:
    """A number of a file, where null stands for NaN."""
    return math.nan if value is None else value


def _of_metrics(name: str, unit: str, title: str | None = None, digits: int = 2) -> Column:
    return Column(name, unit, title, digits, value=lambda each: getattr(each.metrics, name))


def _of_drives(name: str, unit: str, title: str, digits: int = 2, people: str = "") -> Column:
    def value(each: Candidate) -> Any:
        return getattr(each.driven, name)

    return Column(name, unit, title, digits, people, interval=True, value=value)


_NAMED = (Column("name", title="path"), _of_metrics("length", "m", "length", 1))
_REST = tuple(
    _of_metrics(name, unit)
    for name, unit in (
        ("cost", "m"),
        ("integrated_u", "m"),
        ("integrated_e", "m² rad m"),
        ("mean_e", "m² rad"),
        ("max_e", "m² rad"),
        ("degenerate_share", ""),
        ("longest_degenerate", "m"),
        ("clearance", "m"),
    )
)
_TITLES = {
    "integrated_u": ("degenerate", 1),
    "integrated_e": ("∫e ds", 3),
}
PLANNED = (
    *_NAMED,
    *(
        dataclasses.replace(each, title=_TITLES[each.name][0], digits=_TITLES[each.name][1])
        if each.name in _TITLES
        else each
        for each in _REST
    ),
    Column("position_std", "m", "mean std", 1, "cm", value=lambda each: each.deviation[0]),
    Column("max_position_std", "m", "max std", 1, "cm", value=lambda each: each.deviation[1]),
)
"""Columns of candidates that were not driven."""
DRIVEN = (
    *_NAMED,
    _of_drives("error", "m", "error"),
    _of_drives("ratio", "", "ratio"),
    _of_drives("lost_rate", "", "lost", 0, "%"),
    Column("drives", value=lambda each: len(each.driven.numbers)),
    *_REST,
)
"""Columns of candidates that were driven."""

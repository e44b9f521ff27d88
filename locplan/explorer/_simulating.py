"""The simulated choice for the way shown: which path keeps the robot from getting lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import whole
from locplan._util.intervals import Interval
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.explorer._view import MOST_DRIVES, STEPS, View, given, rounded
from locplan.planners import AWARE, SHORTEST
from locplan.simulation import (
    Drives,
    choose,
    is_one_way,
    simulate as simulate_paths,
    verdict,
)

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

FEW_DRIVES = 8
"""Number of drives of a candidate by default, as `locplan.choose` has it."""
PATH_SHOWN = "path shown"
"""Name of the path of the weight that the page shows."""


@dataclass(frozen=True, eq=False)
class ErrorProfile:
    """The error of the filter's position along a path, over all drives."""

    distance: Numbers
    """Distances along the path, (n,) [m]."""
    median: Numbers
    """Median over the drives, the largest near each distance, (n,) [m]."""
    high: Numbers
    """95 % quantile over the drives, the largest near each distance, (n,) [m]."""

    @classmethod
    def of(cls, drives: Drives) -> ErrorProfile:
        """The profile of some drives, of at most `STEPS` steps."""
        median, high = np.quantile(drives.position_error, (0.5, 0.95), axis=0)
        count = len(median)
        first = np.unique(np.linspace(0, count, min(count, STEPS) + 1)[:-1].astype(np.int64))
        last = np.append(first[1:], count) - 1
        distance = drives.distance
        return cls(
            (distance[first] + distance[last]) / 2,
            np.maximum.reduceat(median, first),
            np.maximum.reduceat(high, first),
        )


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """A candidate, and how its drives went."""

    name: str
    label: str
    """The name for people."""
    path: Path
    error: Interval
    """Typical error, by which `locplan.choose` chooses: the geometric mean over the drives of the
    RMSE of the position, with its 95 % interval [m]."""
    lost: Interval
    """Share of the drives that were lost at any time, with its 95 % interval."""
    profile: ErrorProfile

    @classmethod
    def of(cls, name: str, label: str, path: Path, drives: Drives) -> DrivenPath:
        """A candidate from its drives."""
        profile = ErrorProfile.of(drives)
        return cls(name, label, path, drives.typical_rmse, drives.lost_rate, profile)

    def summary(self) -> dict[str, object]:
        """The candidate, fit for JSON."""
        profile = self.profile
        return {
            "name": self.name,
            "label": self.label,
            "xy": rounded(self.path.xy),
            "length": self.path.length,
            "error_m": list(self.error),
            "lost": list(self.lost),
            "profile": {
                "s": profile.distance.round(2).tolist(),
                "median_cm": (100 * profile.median).round(2).tolist(),
                "p95_cm": (100 * profile.high).round(2).tolist(),
            },
        }


@dataclass(frozen=True, eq=False)
class Simulated:
    """Candidates that were driven, and the one that is recommended."""

    verdict: str
    """The verdict in words, with the number of drives and the filter."""
    chosen: str | None
    """Name of the candidate that is recommended; None if no path leads to the goal."""
    candidates: tuple[DrivenPath, ...]
    """Candidates, the shortest first."""
    drives: int
    """Number of drives of each candidate."""

    def summary(self) -> dict[str, object]:
        """The choice, fit for JSON."""
        about: dict[str, object] = {
            "verdict": self.verdict,
            "chosen": self.chosen,
            "candidates": [each.summary() for each in self.candidates],
            "drives": self.drives,
        }
        return finite(about)


def simulated(
    view: View,
    *,
    drives: int = FEW_DRIVES,
    filter: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Simulated:
    """Drive the path shown and its alternatives in simulation, and choose among them.

    Without waypoints it is `locplan.choose`, with the path of the view's weight as a further
    candidate. `choose` knows no waypoints: with them the aware path and the shortest one are
    compared, as `locplan plan` does it; if they are one, it is driven alone. Work that is cancelled
    ends after the drives that are under way; the searches and the worlds before the first drive
    have no progress, and run out.

    Parameters
    ----------
    view : View
        The way.
    drives : int
        Greatest number of drives of each candidate, 2 to 100.
    filter : mapping of str to value, optional
        Settings of the robot by name that are not the view's, see `Robot.changed`.
    seed : int
        Seed of all random numbers.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) drives, first once the path shown is planned; what it raises ends
        the work.

    Raises
    ------
    LocplanError
        If a setting is unknown or out of its range, or the robot cannot stand at an end.
    """
    count = whole("drives", drives, 2, MOST_DRIVES)
    if not isinstance(filter, (Mapping, type(None))):
        raise ConfigError("filter must be settings by name, such as alpha1 and its value")
    asked: dict[str, Any] = {
        "robot": view.robot.changed(filter or {}),
        "drives": count,
        "seed": seed,
        "threads": threads,
        "progress": progress or (lambda done, total: None),
    }
    return _compared(view, asked) if view.via else _chosen(view, asked)


def simulate(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the simulated choice of the way shown."""
    view = session.view(ask)
    drives = given(ask.whole("drives", 2, MOST_DRIVES), FEW_DRIVES)
    filter = ask.mapping("filter")
    work.progress(0, drives, "planning")
    return simulated(view, drives=drives, filter=filter, progress=work.progress).summary()


def _chosen(view: View, asked: Mapping[str, Any]) -> Simulated:
    """The choice among all candidates."""
    aware, shortest = view.paths()
    asked["progress"](0, asked["drives"])
    # The shortest path is a candidate anyway: the same way would only be driven twice.
    own = {} if is_one_way(shortest, aware) else {PATH_SHOWN: aware}
    ends = view.start, view.goal
    choice = choose(view.grid, *ends, costs=view.costs, candidates=own, **asked)
    labels = {PATH_SHOWN: f"path shown, weight {view.costs.weight:g}"}
    made = tuple(
        DrivenPath.of(each.name, labels.get(each.name, each.name), each.path, each.drives)
        for each in choice.candidates
    )
    text, done = choice.sentence, 0
    if choice.chosen is not None:
        done = len(choice.chosen.drives.errors)
        text += f" ({choice.driven} in simulation with {choice.robot.title})"
    return Simulated(text, choice.chosen.name if choice.chosen else None, made, done)


def _compared(view: View, asked: Mapping[str, Any]) -> Simulated:
    """The verdict on the aware path and the shortest one through the waypoints."""
    plans = view.plans()
    asked["progress"](0, asked["drives"])
    found = verdict(view.costs, plans, **asked)
    if found is None:
        return Simulated("no path leads over the waypoints to the goal", None, (), 0)
    labels = {AWARE: f"path shown, weight {view.costs.weight:g}", SHORTEST: SHORTEST}
    driven = found.drives
    if not driven:  # both are one path, which is driven to show its error
        alone = plans[SHORTEST].path
        assert alone is not None, "a verdict needs both paths"
        driven = simulate_paths(view.grid, {SHORTEST: alone}, **asked).drives
    made = []
    for label, each in driven.items():
        path = plans[label].path
        assert path is not None
        made.append(DrivenPath.of(label, labels[label], path, each))
    done = len(driven[SHORTEST].errors)
    return Simulated(found.text, found.recommended, tuple(made), done)

"""The choice among candidate paths that were driven in simulation, and the reason for it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.notebook import Pictured
from locplan._util.records import Reported
from locplan._util.results import Results
from locplan._util.tables import finite
from locplan.costs import Costmap, Path, PathMetrics, about_costs
from locplan.planners import Position
from locplan.robots import Robot
from locplan.simulation._drives import Drives
from locplan.simulation._scores import CLEARLY, FLOOR, SLIGHT, Minimise, front_of, is_slight

MANY_LOST = 0.5
"""Share of lost drives of the recommended path from which on paths are not the remedy."""
UNTUNED = (
    "half of its drives or more are lost: tune the filter first with `locplan tune`;"
    " `locplan evaluate` tells if single scans fail as well"
)
LOST_COUNTS = 0.2
"""Difference of the shares of lost drives that is worth telling."""
ALIKE = 0.05
"""Difference of lengths below which two paths are equally long [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Candidate:
    """A path that was driven in simulation."""

    name: str
    """Name of the path, such as "shortest" or "way around 1"."""
    path: Path
    """The path from start to goal."""
    metrics: PathMetrics
    """Metrics of the path on the costmap."""
    drives: Drives
    """Errors of its drives; the n-th drives of all candidates have the same world and seed."""
    log_error: float
    """Mean over the drives of the logarithm of the error that is minimised (m) [ln m, ln rad]."""
    price: float
    """Price of the metres that it is longer than the shortest, which is added to `log_error`."""

    def __repr__(self) -> str:
        return f"Candidate({self.name}, {self.path.length:.2f} m, {self.drives!r})"

    @property
    def typical_rmse(self) -> float:
        """Geometric mean over the drives of the RMSE of the position [m], at least a millimetre."""
        return float(np.exp(0.5 * np.log(self.drives.mean_squares + FLOOR).mean()))


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Pictured, Reported):
    """Candidate paths with their simulated drives, and the one to take."""

    _reported_by: ClassVar[str] = "locplan.simulation.choice._reports:choice_table"
    _written_by: ClassVar[str] = "locplan.simulation.choice._reports:write_choice"
    files: ClassVar[Results] = Results(
        "choice", ("choice.json", "choice.png", "candidates.csv", "chosen.csv", "errors.csv")
    )

    _drawn_by: ClassVar[str] = "locplan.simulation.choice._figures:choice_figure"

    costs: Costmap
    """Costmap on which candidates were planned and measured."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    candidates: tuple[Candidate, ...]
    """Candidates, the shortest path first; none if no path leads to the goal."""
    best: int
    """Index of the candidate that is recommended."""
    minimise: Minimise
    """Error that the recommended path has least of: "rmse", "goal-error", "heading" or "lost"."""
    price: float | None
    """Detour that is accepted for a halved error [m]; None counts no length."""
    robot: Robot
    """The robot that was simulated."""
    drives: int
    """Greatest number of drives of each candidate."""
    seed: int
    """Seed of all random numbers."""
    left_out: tuple[str, ...] = ()
    """Names of the candidates on which the robot's outline meets a wall."""

    def __repr__(self) -> str:
        return f"Choice({self.costs.grid.name or 'map'}, {self.why})"

    @property
    def status(self) -> Literal["solved", "unreachable", "not found"]:
        """The status is "unreachable" if no path leads to the goal.

        It is "not found" if the robot's outline meets a wall on all paths that were found.
        """
        if self.candidates:
            return "solved"
        return "not found" if self.left_out else "unreachable"

    @property
    def shortest(self) -> Candidate | None:
        """Candidate that is the shortest path; None if there is no path."""
        return self.candidates[0] if self.candidates else None

    @property
    def chosen(self) -> Candidate | None:
        """Candidate that is recommended; None if there is no path."""
        return self.candidates[self.best] if self.candidates else None

    @property
    def path(self) -> Path | None:
        """Path that is recommended; None if there is none."""
        return self.chosen.path if self.chosen else None

    @property
    def front(self) -> tuple[Candidate, ...]:
        """Candidates on the Pareto front of length against simulated error, by length."""
        lengths = np.array([each.path.length for each in self.candidates])
        errors = np.array([each.log_error for each in self.candidates])
        return tuple(self.candidates[n] for n in front_of(lengths, errors))

    @property
    def why(self) -> str:
        """Reason for the choice in one line."""
        chosen, shortest = self.chosen, self.shortest
        if chosen is None or shortest is None:
            if self.left_out:
                return "the robot's outline meets a wall on every candidate; no other was searched"
            return "no path leads to the goal"
        if len(self.candidates) == 1:
            return "there is no other way that is not much longer: the shortest"
        if chosen is shortest:
            better = any(e.log_error <= shortest.log_error + CLEARLY for e in self.candidates)
            if self.minimise == "lost":
                count = len(shortest.drives.errors)
                return f"no alternative loses clearly fewer of {count} drives: the shortest"
            which = "worth its length" if better else "clearly better"
            return f"no alternative is {which}: the shortest"
        reason = f"{gain(shortest, chosen, self.minimise)}, {at_length(shortest, chosen)}"
        before, after = (math.exp(each.log_error) for each in (shortest, chosen))
        lost = int(shortest.drives.lost.sum())
        slight = self.minimise == "rmse" and is_slight(before, after, lost)
        return reason + SLIGHT * slight

    @property
    def sentence(self) -> str:
        """Name of the chosen candidate, and the reason."""
        if self.chosen is None or self.chosen is self.shortest:
            return self.why
        return f"{self.chosen.name}: {self.why}"

    @property
    def driven(self) -> str:
        """Number of drives of each candidate in words."""
        done = len(self.candidates[0].drives.errors)
        return f"{done} drives each" if done == self.drives else f"{done} of {self.drives} drives"

    @property
    def nearly(self) -> Candidate | None:
        """Shortest candidate that is clearly better than the shortest path, too, and whose error
        is at most a ninth above that of the chosen one; None if that is the chosen one itself."""
        chosen, shortest = self.chosen, self.shortest
        if chosen is None or shortest is None or chosen is shortest or self.minimise == "lost":
            return None
        others = [
            each
            for each in self.candidates
            if each.path.length < chosen.path.length
            and each.log_error + each.price <= shortest.log_error + CLEARLY
            and each.log_error + each.price <= chosen.log_error + chosen.price - CLEARLY
        ]
        return min(others, key=lambda each: each.path.length, default=None)

    def ratio(self, candidate: Candidate) -> Interval:
        """Ratio of the RMSE of the position to the shortest's: geometric mean over the drives.

        Parameters
        ----------
        candidate : Candidate
            One of `candidates`.
        """
        assert self.shortest is not None
        both = candidate.drives, self.shortest.drives
        squares, others = (drives.mean_squares + FLOOR for drives in both)
        return of_geometric_mean(np.sqrt(squares / others))

    def summary(self) -> dict[str, object]:
        """Candidates with their errors, the choice and its settings, fit for JSON."""
        front = self.front
        about: dict[str, object] = {
            **about_costs(self.costs),
            "status": self.status,
            "start": list(self.start),
            "goal": list(self.goal),
            "chosen": self.chosen.name if self.chosen else None,
            "left_out": list(self.left_out),
            "why": self.why,
            "minimise": self.minimise,
            "price_m": self.price,
            "candidates": {
                each.name: {
                    **each.drives.summary(),
                    "typical_rmse_m": each.typical_rmse,
                    "rmse_ratio": list(self.ratio(each)),
                    "log_error": each.log_error,
                    "price": each.price,
                    "on_front": each in front,
                    "metrics": finite(dataclasses.asdict(each.metrics)),
                    "xy": each.path.xy.tolist(),
                }
                for each in self.candidates
            },
            "most_drives": self.drives,
            "seed": self.seed,
            "robot": self.robot.summary(),
        }
        return finite(about)


def gain(shortest: Candidate, chosen: Candidate, minimise: Minimise) -> str:
    """Gain of a candidate over the shortest path in words, and what it costs in lost drives."""
    before, after = (float(each.drives.lost.mean()) for each in (shortest, chosen))
    lost = f"{after:.0%} of drives lost instead of {before:.0%}"
    if minimise == "lost" or (minimise == "rmse" and before - after >= LOST_COUNTS):
        return lost
    but = f", but {lost}" if after - before >= LOST_COUNTS else ""
    errors = [math.exp(each.log_error) for each in (chosen, shortest)]
    if minimise == "heading":
        after, before = (math.degrees(each) for each in errors)
        return f"a heading error of {after:.2g} deg instead of {before:.2g} deg{but}"
    where = " at the goal" if minimise == "goal-error" else ""
    after_m, before_m = (f"{error:#.2g}".rstrip(".") for error in errors)
    return f"an error of {after_m} m{where} instead of {before_m} m{but}"


def at_length(shortest: Candidate, other: Candidate) -> str:
    """How much longer than the shortest path a candidate is in words; a user's may be shorter."""
    extra = other.path.length - shortest.path.length
    if abs(extra) < ALIKE:
        return "at the same length"
    return f"for {abs(extra):.1f} m {'more' if extra > 0 else 'less'}"

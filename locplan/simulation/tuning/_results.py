"""Results of tuning: the presets that competed, and the best one next to the user's settings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from locplan._util.intervals import Interval, two_digits
from locplan._util.output import Results
from locplan._util.records import Column, Result, Table
from locplan._util.saved import tree_of
from locplan._util.tables import finite
from locplan.maps import OccupancyGrid
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import RATES
from locplan.simulation._worlds import about_filter
from locplan.simulation.tuning._bench import JudgedCase
from locplan.simulation.tuning._parameters import BeamsLeft, differing_names, write_tuned
from locplan.simulation.verdict import BETTER, UNDECIDED, DriveSet, RatePair, Verdict

OWN = "your settings"
"""Name of the user's settings, which may be Nav2's defaults."""
JUDGED = (
    Column("settings", title="settings"),
    Column("case", title="drives"),
    Column("error", "m", "error", interval=True),
    replace(RATES[0], name="lost"),
    replace(RATES[1], name="off_at_end"),
    Column("verdict", title="verdict"),
)
"""Columns of the settings that were judged, a row per case."""


@dataclass(frozen=True)
class TriedPreset:
    """A preset in the drives that chose the best one."""

    name: str
    """Its name: what it changes."""
    amcl: Amcl
    """The user's settings with its changes."""
    drives: int
    """Number of drives; fewer than others have if it was clearly worse than the best."""
    error: float
    """Error of a typical drive: the geometric mean [m]."""
    lost: float
    """Share of lost drives, 0..1."""

    @classmethod
    def from_drives(cls, name: str, amcl: Amcl, drives: DriveSet) -> TriedPreset:
        """Summarize the drives of a preset.

        Parameters
        ----------
        name : str
            The preset's name.
        amcl : Amcl
            The user's settings with its changes.
        drives : DriveSet
            Its drives.
        """
        error = float(np.exp(drives.log_error.mean()))
        return cls(name, amcl, len(drives.lost), error, float(drives.lost.mean()))


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """The best preset of AMCL's settings for a map or a recording, and the evidence for it."""

    _reported_by: ClassVar[str] = "locplan.simulation.tuning._report:tuning_report"
    _drawn_by: ClassVar[str] = "locplan.simulation:tuning_figure"
    files: ClassVar[Results] = Results("tuning", ("tuning.json", "tuning.png", "nav2_params.yaml"))

    grids: tuple[OccupancyGrid, ...]
    """The maps."""
    robot: Robot
    """The robot with the user's settings of AMCL."""
    tried: tuple[TriedPreset, ...]
    """The presets in the drives that chose the best one."""
    candidate: Amcl
    """The best preset in these drives."""
    cases: tuple[JudgedCase, ...]
    """The best preset and the user's settings in fresh drives, case by case."""
    candidate_verdict: Verdict
    """The verdict on the best preset by the fresh drives that decide."""
    beams_ratio: float
    """Beams that the best preset compares, over those of the user's settings. The CPU time of
    AMCL follows it."""
    beams_left: BeamsLeft
    """Number of the compared beams that return."""
    warnings: tuple[str, ...]
    """Warnings of the user's settings."""
    paths: int
    """Number of paths on each map, or of stretches of a recording, that judged."""
    drives: int
    """Number of drives along each of them."""
    seed: int
    """Seed of all random numbers."""
    recording: str = ""
    """Names of the recordings; empty for simulated drives."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it is not that of `grids`."""
    notes: tuple[str, ...] = ()
    """Limits of the result, in sentences without a full stop."""

    def __repr__(self) -> str:
        return f"Tuning({self.where}, {self.candidate_name}: {self.verdict})"

    @property
    def where(self) -> str:
        """Names of the maps."""
        return ", ".join(grid.name or "map" for grid in self.grids)

    @property
    def own(self) -> Amcl:
        """The user's own settings."""
        return self.robot.amcl

    @property
    def candidate_name(self) -> str:
        """Name of the best preset."""
        return next(preset.name for preset in self.tried if preset.amcl == self.candidate)

    @property
    def contradicting(self) -> tuple[JudgedCase, ...]:
        """The cases that speak against the best preset."""
        return tuple(case for case in self.cases if case.contradicts)

    @property
    def verdict(self) -> str:
        """The verdict on the best preset; undecided if it is better but a case contradicts."""
        word = self.candidate_verdict.word
        return UNDECIDED if word == BETTER and self.contradicting else word

    @property
    def winner(self) -> Amcl:
        """The settings to use: the best preset if it is better, otherwise the user's own."""
        return self.candidate if self.verdict == BETTER else self.own

    @property
    def changes(self) -> dict[str, float | str]:
        """Parameters to change, by their names; empty if no preset is better."""
        own, winner = self.own, self.winner
        return {name: getattr(winner, name) for name in differing_names(own, winner)}

    @property
    def conclusion(self) -> str:
        """The result in one sentence."""
        name, shown = self.candidate_name, self.candidate_verdict
        if self.verdict == BETTER:
            less = 100 * (1 - shown.ratio.value)
            cost = "" if self.beams_ratio < 1.05 else f", for {self.beams_ratio:.1f} times the CPU"
            return f"Use {name}: {less:.0f} % less error than with {OWN}{cost}"
        best = f"{name}, the best of {len(self.tried)} presets,"
        if shown.word == BETTER:
            names = ", ".join(case.name for case in self.contradicting)
            return f"Keep {OWN}: {best} is better on the other drives, but not here: {names}"
        ratio = two_digits(shown.ratio)
        return f"Keep {OWN}: {best} has {ratio} times their error: {shown.word}"

    def table(self) -> Table:
        """The user's settings and the best preset, a row per case."""
        rows: list[tuple[Any, ...]] = []
        for place, name in enumerate((OWN, self.candidate_name)):
            for case in self.cases:
                error = (case.baseline_error, case.error)[place]
                word = case.verdict.word if place else ""
                rates = (_rate(pair, place) for pair in _rates(case.verdict))
                rows.append((name, case.name, error, *rates, word))
        return Table(JUDGED, tuple(rows))

    def figure(self, *about: Any, **options: Any) -> Any:
        """The figure of matplotlib that shows it.

        Parameters
        ----------
        *about, **options
            What `save` takes, which the figure does not show.
        """
        return super().figure()

    def _write(self, folder: Path, *about: Any) -> None:
        write_tuned(folder / "nav2_params.yaml", self.winner, *about)

    def summary(self, *about: Any, **more: Any) -> dict[str, object]:
        """Everything in numbers, fit for JSON.

        Parameters
        ----------
        *about, **more
            What `save` takes, which the numbers do not have.
        """
        maps = [{"name": grid.name, "digest": grid.digest} for grid in self.grids]
        return finite(
            {
                "conclusion": self.conclusion,
                **({"maps": maps} if maps[1:] else {"map": maps[0]}),
                "verdict": self.verdict,
                "changes": self.changes,
                "best_preset": self.candidate_name,
                "judged": tree_of(self.candidate_verdict),
                "cases": tree_of(self.cases),
                "presets": tree_of(self.tried),
                "beams_ratio": self.beams_ratio,
                "notes": list(self.notes),
                "warnings": list(self.warnings),
                "beams_compared": self.beams_left.compared,
                "beams_returned": self.beams_left.returned,
                **{name: getattr(self, name) for name in ("paths", "drives", "seed")},
                **about_filter(self.filter_map),
                "robot": self.robot.summary(),
                "recording": self.recording or None,
            }
        )


def _rates(verdict: Verdict) -> tuple[RatePair | None, RatePair | None]:
    return verdict.lost, verdict.off_at_end


def _rate(pair: RatePair | None, place: int) -> Interval:
    return pair[place] if pair else Interval(np.nan, np.nan, np.nan)

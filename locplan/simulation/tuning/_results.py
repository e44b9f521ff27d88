"""What tuning found: settings that were judged on paths and in worlds of their own, and in text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_uppercase
from typing import Any, ClassVar

from locplan._util.intervals import Interval, two_digits
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.saved import tree_of
from locplan._util.tables import finite, table
from locplan.maps import OccupancyGrid
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import RATES
from locplan.simulation._worlds import about_filter
from locplan.simulation.tuning._bench import DisturbanceLevel
from locplan.simulation.tuning._space import (
    Axis,
    BeamsLeft,
    Value,
    changed_axes,
    described,
    differing_names,
    write_tuned,
)

OWN = "your settings"
"""Name of the user's settings, which may be Nav2's defaults."""


@dataclass(frozen=True)
class AtLevel:
    """Errors of one setting at one level of disturbance; intervals are over the paths."""

    level: DisturbanceLevel
    """The level, as factors on the disturbances that were asked for."""
    m: float
    """Mean over the drives of 0.5 ln(mean square position error [m^2] + 1e-6)."""
    rmse: Interval
    """RMSE of the position along a path: geometric mean over the paths [m]."""
    kept_rmse: float
    """Root mean square position error of the drives never off by more than 1 m [m]."""
    median_error: float
    """Median of the position error on the way [m]."""
    lost: Interval
    """Share of the drives that were off by more than 1 m at some time."""
    off_at_goal: Interval
    """Share of the drives that were off by more than 0.5 m at the end."""
    rmse_ratio: Interval
    """Ratio of the RMSE to that of the user's settings: geometric mean over the paths."""
    lost_difference: Interval
    """Share of lost drives minus that of the user's settings: mean over the paths."""


@dataclass(frozen=True)
class Judged:
    """One setting, judged at every level of disturbance."""

    derived: ClassVar[tuple[str, ...]] = ("worst", "better", "better_at_every_level")

    name: str
    """Name in tables: whose settings they are, or what differs from the user's own."""
    amcl: Amcl
    """The setting."""
    levels: tuple[AtLevel, ...]
    """Its errors at each level of disturbance."""
    rmse_ratio: Interval
    """Ratio of the RMSE to that of the user's settings: geometric mean over levels and paths."""
    cpu_ms_per_update: float
    """CPU time of the simulation an update of the filter, the scan included [ms]."""
    cpu_ms_per_metre: float
    """CPU time of the simulation a metre that is driven [ms]."""

    @property
    def worst(self) -> float:
        """The greatest m of all levels, which tuning minimises."""
        return max(each.m for each in self.levels)

    @property
    def better(self) -> bool:
        """True if it is better than the user's settings over all levels, and harms at none."""
        harm = any(each.rmse_ratio.low > 1 or each.lost_difference.low > 0 for each in self.levels)
        return self.rmse_ratio.high < 1 and not harm

    @property
    def better_at_every_level(self) -> bool:
        """True if it is better than the user's settings at every level of disturbance."""
        return self.better and all(each.rmse_ratio.high < 1 for each in self.levels)


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """Settings of AMCL that were tuned on one map, and the evidence for them."""

    _reported_by: ClassVar[str] = "locplan.simulation.tuning._results:tuning_report"
    _drawn_by: ClassVar[str] = "locplan.simulation:tuning_figure"
    files: ClassVar[Results] = Results("tuning", ("tuning.json", "tuning.png", "nav2_params.yaml"))

    grid: OccupancyGrid
    """The map."""
    robot: Robot
    """The robot, with the user's own settings of AMCL, at the level `x1`."""
    candidate: Amcl
    """Settings that the search found, which may be the user's own."""
    judged: tuple[Judged, ...]
    """The user's settings, what was found, and others, on paths that nothing was chosen on."""
    contributions: Mapping[str, float]
    """RMSE without each change of the best setting, relative to that with it, on the paths of the
    search; also of changes that were put back because they gain next to nothing."""
    beams_left: BeamsLeft
    """Number of the beams compared that return."""
    lints: tuple[str, ...]
    """Warnings about the user's settings."""
    rungs: tuple[tuple[int, int, int], ...]
    """Settings, paths and drives along each path of each rung of the search."""
    paths: int
    """Number of paths on which was judged."""
    drives: int
    """Number of drives along each path at each level."""
    seed: int
    """Seed of the search."""
    judged_seed: int
    """Seed of the paths, worlds and drives on which was judged."""
    drive: str = ""
    """Name of the recorded drive, whose stretches are the paths; empty if they were simulated."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, where it is not `grid`."""

    def __repr__(self) -> str:
        changes = described(self.own, self.winner)
        return f"Tuning({self.grid.name or 'map'}, {changes or 'nothing is clearly better'})"

    @property
    def own(self) -> Amcl:
        """The user's own settings."""
        return self.robot.amcl

    @property
    def levels(self) -> tuple[DisturbanceLevel, ...]:
        """The levels of disturbance; a recorded drive has one, its own."""
        return tuple(each.level for each in self.judged[0].levels)

    @property
    def found(self) -> Judged:
        """The setting that the search found, as it was judged."""
        return next(each for each in self.judged if each.amcl == self.candidate)

    @property
    def winner(self) -> Amcl:
        """The settings to use: what was found if it is clearly better, else the user's own."""
        return self.found.amcl if self.found.better else self.own

    @property
    def changes(self) -> dict[str, Value]:
        """Parameters to change, by their names; empty if nothing is clearly better."""
        own, winner = self.own, self.winner
        return {name: getattr(winner, name) for name in differing_names(own, winner)}

    @property
    def conclusion(self) -> str:
        """The result in one sentence."""
        own, found = self.judged[0], self.found
        if found is own:
            return f"nothing found is better than {own.name}: keep them"
        changes = described(self.own, found.amcl)
        if not found.better:
            return (
                f"nothing is clearly better than {own.name}: keep them (the best found, {changes},"
                f" has {two_digits(found.rmse_ratio)} times their RMSE)"
            )
        levels = [each.level.name for each in found.levels if each.rmse_ratio.high < 1]
        where = "better over all levels of disturbance together"
        if self.drive:
            where = "better on stretches of the drive that it was not chosen on"
        elif found.better_at_every_level:
            where = "better at every level of disturbance"
        elif levels:
            where = f"clearly better at the levels {' and '.join(levels)} of disturbance"
        middle = len(own.levels) // 2  # the one that was asked for
        before, after = own.levels[middle], found.levels[middle]
        return (
            f"{changes}: RMSE {before.rmse.value:.2g} -> {after.rmse.value:.2g} m, off by"
            f" more than 1 m in {100 * before.lost.value:.0f} -> {after.lost.value:.0%}; {where};"
            f" {found.cpu_ms_per_metre / own.cpu_ms_per_metre:.1f} times the CPU"
        )

    def changed_axes(self) -> list[Axis]:
        """What the search changed."""
        return changed_axes(self.own, self.candidate)

    def table(self) -> Table:
        """The settings that were judged, at each level of disturbance."""
        columns = (
            Column("settings", title="settings"),
            Column("level", title="level"),
            Column("rmse", "m", "RMSE", interval=True),
            replace(RATES[0], name="lost"),
            RATES[1],
            Column("ratio", "", f"RMSE over {OWN}'", interval=True),
        )
        rows = tuple(
            (each.name, at.level.name, at.rmse, at.lost, at.off_at_goal, at.rmse_ratio)
            for each in self.judged
            for at in each.levels
        )
        return Table(columns, rows)

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
            What `save` takes, of which it says nothing.
        """
        names = "settings", "paths", "drives"
        levels = [(each.name, each.of(self.robot).summary()) for each in self.levels]
        found: dict[str, object] = {
            "conclusion": self.conclusion,
            "map": {"name": self.grid.name, "digest": self.grid.digest},
            "verdict": "better" if self.changes else "nothing is clearly better",
            "changes": self.changes,
            "judged": tree_of(self.judged),
            "rmse_ratio_without": dict(self.contributions),
            "warnings": list(self.lints),
            "beams_compared": self.beams_left.compared,
            "beams_returned": self.beams_left.returned,
            "rungs": [dict(zip(names, rung, strict=True)) for rung in self.rungs],
            **{name: getattr(self, name) for name in ("paths", "drives", "seed", "judged_seed")},
            **about_filter(self.filter_map),
            "robot": self.robot.summary(),
            "drive": self.drive or None,
            "levels": None if self.drive else [{"name": n, "robot": r} for n, r in levels],
        }
        return finite(found)


def tuning_report(tuning: Tuning) -> str:
    """Table of the settings that were judged, the warnings, and the conclusion."""
    head = ["", *(level.name for level in tuning.levels), "RMSE to A's", "ms/update", "ms/m"]
    rows, names = [], []
    for letter, each in zip(ascii_uppercase, tuning.judged, strict=False):
        rows.append(
            [
                letter,
                *(
                    f"{at.rmse.value:.2g} m {at.lost.value:.0%} {at.off_at_goal.value:.0%}"
                    for at in each.levels
                ),
                "1" if each is tuning.judged[0] else _short(each.rmse_ratio),
                f"{each.cpu_ms_per_update:.2f}",
                f"{each.cpu_ms_per_metre:.2f}",
            ]
        )
        names.append(f"{letter}: {_name(tuning, each)}")
    lines = [
        table(head, rows),
        *names,
        _explained(tuning),
        *_gains(tuning),
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {each}" for each in tuning.lints),
        tuning.conclusion,
    ]
    return "\n".join(lines)


def _explained(tuning: Tuning) -> str:
    """What the table's numbers are."""
    if tuning.drive:
        return (
            "RMSE of the position, and shares of the replays off by > 1 m at some time and by"
            " > 0.5 m at the end,\nagainst the recorded poses, on"
            f" {tuning.paths} stretches of {tuning.drive}, {tuning.drives} replays each, on which"
            " nothing was chosen;\nRMSE to A's [95 % over the stretches]; ms: CPU time"
        )
    return (
        "RMSE of the position, and shares of the drives off by > 1 m at some time and by > 0.5 m"
        " at the\ngoal, with a third of, once and three times odometry's errors, on"
        f" {tuning.paths} random paths, {tuning.drives} drives each, on which\nnothing was chosen;"
        " RMSE to A's over all levels [95 %]; ms: CPU time,"
        " with that of the simulated scan"
    )


def _gains(tuning: Tuning) -> list[str]:
    """What each change of the best setting gains, and what was put back."""
    kept = [axis.name for axis in tuning.changed_axes()]
    gains = [
        f"{name} {100 * (ratio - 1):+.0f} %{'' if name in kept else ' (put back)'}"
        for name, ratio in sorted(tuning.contributions.items(), key=lambda each: -each[1])
    ]
    where = "" if tuning.drive else " at its worst level"
    return [f"RMSE{where} without a change: {', '.join(gains)}"] if gains else []


def _name(tuning: Tuning, judged: Judged) -> str:
    marks = ["to use"] if judged.amcl == tuning.winner and tuning.changes else []
    if judged.better_at_every_level and not tuning.drive:
        marks.append("better at every level")
    return f"{judged.name} ({'; '.join(marks)})" if marks else judged.name


def _short(interval: Interval) -> str:
    """Text of an interval without its leading zeros."""
    return two_digits(interval).removeprefix("0").replace("[0", "[").replace(" 0", " ")

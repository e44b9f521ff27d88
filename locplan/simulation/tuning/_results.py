"""What tuning found: settings that were judged on paths and in worlds of their own, and in text."""

from __future__ import annotations

import math
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
from locplan.simulation.tuning._judged import Judged, WholeDrive
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


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """Settings of AMCL that were tuned on a map, or several, and the evidence for them."""

    _reported_by: ClassVar[str] = "locplan.simulation.tuning._results:tuning_report"
    _drawn_by: ClassVar[str] = "locplan.simulation:tuning_figure"
    files: ClassVar[Results] = Results("tuning", ("tuning.json", "tuning.png", "nav2_params.yaml"))

    grids: tuple[OccupancyGrid, ...]
    """The maps."""
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
    """Number of paths on which was judged, on each map."""
    drives: int
    """Number of drives along each path at each level."""
    seed: int
    """Seed of the search."""
    judged_seed: int
    """Seed of the paths, worlds and drives on which was judged."""
    drive: str = ""
    """Names of the recorded drives, whose stretches are the paths; empty if they were simulated."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, where it is not that of `grids`."""
    notes: tuple[str, ...] = ()
    """What limits the result, in sentences without a full stop."""

    def __repr__(self) -> str:
        changes = described(self.own, self.winner)
        return f"Tuning({self.where}, {changes or 'nothing is clearly better'})"

    @property
    def where(self) -> str:
        """Names of the maps."""
        return ", ".join(each.name or "map" for each in self.grids)

    @property
    def is_joined(self) -> bool:
        """True if the settings are for several maps, or several drives."""
        return len({(each.odometry, each.clutter) for each in self.levels}) < len(self.levels)

    @property
    def own(self) -> Amcl:
        """The user's own settings."""
        return self.robot.amcl

    @property
    def levels(self) -> tuple[DisturbanceLevel, ...]:
        """The levels of disturbance on each map; a recorded drive has one, its own."""
        return tuple(each.level for each in self.judged[0].levels)

    @property
    def found(self) -> Judged:
        """The setting that the search found, as it was judged."""
        return next(each for each in self.judged if each.amcl == self.candidate)

    @property
    def to_use(self) -> Judged:
        """What was found if it is clearly better, else the user's own settings, as judged."""
        return self.found if self.found.better else self.judged[0]

    @property
    def winner(self) -> Amcl:
        """The settings to use."""
        return self.to_use.amcl

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
        if found.whole and own.whole:
            return self._of_drive(changes, found.whole, own.whole)
        if not found.better:
            return (
                f"nothing is clearly better than {own.name}: keep them (the best found, {changes},"
                f" has {two_digits(found.rmse_ratio)} times their RMSE)"
            )
        levels = [each.level.name for each in found.levels if each.rmse_ratio.high < 1]
        where = "better over all levels of disturbance together"
        if found.better_at_every_level:
            where = "better at every level of disturbance"
        elif levels:
            where = f"clearly better at the levels {' and '.join(levels)} of disturbance"
        # The level that was asked for, or the strongest one for poor odometry.
        asked = 1.0 if own.levels[-1].level.odometry < 10 else own.levels[-1].level.odometry
        before, after = own.worst_at(asked), found.worst_at(asked)
        return (
            f"{changes}: RMSE {before.rmse.value:.2g} -> {after.rmse.value:.2g} m, off by"
            f" more than 1 m in {100 * before.lost.value:.0f} -> {after.lost.value:.0%}; {where};"
            f" {self._cost}"
        )

    @property
    def _cost(self) -> str:
        """What the settings found cost beside the user's own."""
        own, found = self.judged[0], self.found
        update = f"{own.cpu_ms_per_update:.2f} -> {found.cpu_ms_per_update:.2f} ms an update"
        return f"{found.cpu_ms_per_metre / own.cpu_ms_per_metre:.1f} times the CPU ({update})"

    def _of_drive(self, changes: str, found: WholeDrive, own: WholeDrive) -> str:
        """The conclusion of a recorded drive."""
        said = f"on the whole drive {found.sentence}; {OWN}: {own.sentence}"
        if self.found.better:
            return f"{changes}: {said}; {self._cost}"
        kept = f"keep {self.judged[0].name} (the best found, {changes}, {said})"
        if found.better:
            return f"nothing is clearly better on the half that nothing was chosen on: {kept}"
        return f"nothing that was tried holds on your drive: {kept}"

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
        maps = [{"name": each.name, "digest": each.digest} for each in self.grids]
        found: dict[str, object] = {
            "conclusion": self.conclusion,
            **({"maps": maps} if maps[1:] else {"map": maps[0]}),
            "verdict": "better" if self.changes else "nothing is clearly better",
            "changes": self.changes,
            "judged": tree_of(self.judged),
            "rmse_ratio_without": dict(self.contributions),
            "notes": list(self.notes),
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
    levels = ["worst"] if tuning.is_joined else [level.name for level in tuning.levels]
    if tuning.drive:
        levels = ["whole drive", "first off", *(levels if tuning.is_joined else ["stretches"])]
    head = ["", *levels, "RMSE to A's", "ms/update", "ms/m"]
    rows, names = [], []
    for letter, each in zip(ascii_uppercase, tuning.judged, strict=False):
        rows.append(
            [
                letter,
                *_of_whole(each.whole),
                *_at_levels(tuning, each),
                "1" if each is tuning.judged[0] else _short((each.whole or each).rmse_ratio),
                f"{each.cpu_ms_per_update:.2f}",
                f"{each.cpu_ms_per_metre:.2f}",
            ]
        )
        names.append(f"{letter}: {_name(tuning, each)}")
    lines = [
        *(f"note: {each}" for each in tuning.notes),
        table(head, rows),
        *names,
        _explained(tuning),
        *_gains(tuning),
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {each}" for each in tuning.lints),
        tuning.conclusion,
        *_holds_for(tuning),
        *_comes_back(tuning),
    ]
    return "\n".join(lines)


def _at_levels(tuning: Tuning, judged: Judged) -> list[str]:
    """Cells of the levels; of several maps, that of the worst one, with its name."""
    some = [judged.worst_at()] if tuning.is_joined else judged.levels
    cells = []
    for at in some:
        where = f" {at.level.name}" if tuning.is_joined else ""
        shares = f"{at.lost.value:.0%} {at.off_at_goal.value:.0%}"
        cells.append(f"{at.rmse.value:.2g} m {shares}{where}")
    return cells


def _of_whole(whole: WholeDrive | None) -> list[str]:
    """Cells of the whole drive, or none."""
    if whole is None:
        return []
    first = f"{whole.first_loss:.0f} m" if math.isfinite(whole.first_loss) else "never"
    where = f" {whole.name}" if whole.name else ""
    return [f"{whole.rmse.value:.2g} m {whole.lost_way.value:.0%}{where}", first]


def _explained(tuning: Tuning) -> str:
    """What the table's numbers are."""
    where = tuning.drive or tuning.where
    if tuning.is_joined:
        where = f"each of {where} (the worst by name)"
    if tuning.drive:
        return (
            "RMSE of the position against the recorded poses, on the whole drive with the share of"
            " the way\noff by > 1 m and where it began, and with the shares of replays off by > 1 m"
            f" and by > 0.5 m at the\nend, on {tuning.paths} stretches of {where},"
            f" {tuning.drives} replays each, on which nothing was chosen;\nRMSE to A's on the whole"
            " drive [95 % over the replays]; ms: CPU time"
        )
    of_maps = f" of {where}" if tuning.is_joined else ""
    return (
        "RMSE of the position, and shares of the drives off by > 1 m at some time and by > 0.5 m"
        " at the\ngoal, at multiples of odometry's errors, on"
        f" {tuning.paths} random paths{of_maps}, {tuning.drives} drives each, on which\nnothing was"
        " chosen; RMSE to A's over all levels [95 %]; ms: CPU time, with that of the simulated scan"
    )


def _holds_for(tuning: Tuning) -> list[str]:
    """For which odometry the settings hold, and what they do beyond it."""
    if tuning.drive:
        return []
    judged = tuning.to_use
    most = f"{tuning.levels[-1].odometry:.0f}"
    chosen = f"They were chosen for odometry up to {most} times as bad as that of this robot"
    if (at := judged.beyond) is None:
        return [f"{chosen}."]
    return [
        f"{chosen}; at ten times: {at.rmse.value:.2g} m, off by more than 1 m in"
        f" {at.lost.value:.0%} (--odometry poor searches for that)."
    ]


def _comes_back(tuning: Tuning) -> list[str]:
    """What the settings to use do after they were lost or kidnapped."""
    found = "; ".join(each.sentence for each in tuning.to_use.recoveries)
    return [f"They are back within 10 m of driving, or by the goal, {found}."] if found else []


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
    marks = ["to use"] if judged is tuning.to_use and tuning.changes else []
    marks += ["better at every level"] * (judged.better_at_every_level and not tuning.drive)
    return f"{judged.name} ({'; '.join(marks)})" if marks else judged.name


def _short(interval: Interval) -> str:
    """Text of an interval without its leading zeros."""
    return two_digits(interval).removeprefix("0").replace("[0", "[").replace(" 0", " ")

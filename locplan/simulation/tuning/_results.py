"""What tuning found: settings that were judged on paths and in worlds of their own, and in text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from locplan._util.intervals import two_digits
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.saved import tree_of
from locplan._util.tables import finite
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
from locplan.simulation.verdict import BETTER, UNDECIDED

OWN = "your settings"
"""Name of the user's settings, which may be Nav2's defaults."""


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """Settings of AMCL that were tuned on a map, or several, and the evidence for them."""

    _reported_by: ClassVar[str] = "locplan.simulation.tuning._report:tuning_report"
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
    search, where that of lost drives counts e times; also of changes that were put back because
    they gain next to nothing."""
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
        return f"Tuning({self.where}, {changes or 'nothing is better'})"

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
        """What was found if it is better, else the user's own settings, as judged."""
        return self.found if self.found.better else self.judged[0]

    @property
    def winner(self) -> Amcl:
        """The settings to use."""
        return self.to_use.amcl

    @property
    def changes(self) -> dict[str, Value]:
        """Parameters to change, by their names; empty if nothing is better."""
        own, winner = self.own, self.winner
        return {name: getattr(winner, name) for name in differing_names(own, winner)}

    @property
    def verdict(self) -> str:
        """The verdict on what was found; undecided if it is better, but harms somewhere."""
        word = self.found.verdict
        return UNDECIDED if word == BETTER and not self.found.better else word

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
                f"nothing is better than {own.name}: keep them (the best found, {changes},"
                f" has {two_digits(found.rmse_ratio)} times their RMSE: {self.verdict})"
            )
        levels = [each.level.name for each in found.levels if each.verdict == BETTER]
        where = "better over all levels of disturbance together"
        if found.better_at_every_level:
            where = "better at every level of disturbance"
        elif levels:
            where = f"better at the levels {' and '.join(levels)} of disturbance"
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
        if found.holds:
            return f"nothing is better on the half that nothing was chosen on: {kept}"
        return (
            f"nothing that was tried holds on your drive: {kept}, and look where it is first off:"
            " how few scans fit the map there (locplan evaluate --drive), and how far odometry"
            " drifts (locplan calibrate --drive)"
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
        maps = [{"name": each.name, "digest": each.digest} for each in self.grids]
        found: dict[str, object] = {
            "conclusion": self.conclusion,
            **({"maps": maps} if maps[1:] else {"map": maps[0]}),
            "verdict": self.verdict,
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

"""The result of a choice: the path to take, the verdict, and the drives that say so."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, ClassVar, Literal

from locplan._util.output import Results
from locplan._util.records import Column, Result, Table
from locplan._util.saved import Stored
from locplan._util.tables import file_name, wrapped, write_rows
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField, FieldConfig
from locplan.planners import Plan, Position
from locplan.robots import Robot
from locplan.simulation._arrivals import Arrivals
from locplan.simulation.choice._answer import (
    Decision,
    compare_tuning,
    format_answer,
    format_reached,
    list_advice,
    list_answer,
)
from locplan.simulation.choice._ask import ChoiceSettings
from locplan.simulation.choice._densities import config_of, costmap_of, costs_again
from locplan.simulation.choice._driven import DRIVEN, PLANNED, Candidate, Driven
from locplan.simulation.choice._evidence import evidence_table, list_notes
from locplan.simulation.choice._race import Judgement
from locplan.simulation.verdict import UNDECIDED


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Result, Stored):
    """The path to take between two places, and the candidates beside it."""

    kind: ClassVar[str] = "choice"
    suffix: ClassVar[str] = ".json"
    version: ClassVar[int] = 4
    derived: ClassVar[tuple[str, ...]] = (
        *("taken", "verdict", "sentence", "arrives", "advice", "answer"),
    )

    files: ClassVar[Results] = Results(
        "choice", ("choice.json", "choice.png", "candidates.csv", "chosen.csv", "errors.csv")
    )
    _drawn_by: ClassVar[str] = "locplan.simulation._advice_figures:choice_figure"

    about: Mapping[str, Any]
    """Version, map and settings of the costmap, see `locplan.costs.about_costs`."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    candidates: tuple[Candidate, ...]
    """Candidates, the shortest path first; none if no path leads to the goal."""
    settings: ChoiceSettings
    """What bound the candidates, and what decided."""
    robot: Robot
    """The robot, which was driven where its lidar is known."""
    seed: int
    """Seed of all random numbers."""
    status: Literal["solved", "unreachable", "infeasible", "timeout", "not found"]
    """"solved", or why there is no path, see `Plan.status`."""
    note: str = ""
    """What there is to say beside: why nothing was driven, or why there is no path."""
    left_out: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Why each other path that was planned or given is no candidate, by its name."""
    judgement: Judgement | None = None
    """The race and its confirmation; None where nothing was driven."""
    rival: Driven | None = None
    """Drives along the shortest path with the filter of `ChoiceSettings.rival`."""
    costs: Costmap | None = dataclasses.field(default=None, compare=False)
    """Costmap that the paths were measured on; None in a choice that was loaded."""

    def __repr__(self) -> str:
        return f"Choice({self.map['name'] or 'map'}, {self.sentence})"

    def __eq__(self, other: object) -> bool:  # a filter of one's own is loaded as its name
        return isinstance(other, Choice) and self.summary() == other.summary()

    def __hash__(self) -> int:
        return hash(self.map["digest"])

    @property
    def map(self) -> Mapping[str, str]:
        """Name and digest of the map."""
        found: Mapping[str, str] = self.about["map"]
        return found

    @property
    def verdict(self) -> str:
        """The verdict on the winner of the race; empty where nothing was driven."""
        return self.judgement.verdict if self.judgement else ""

    @property
    def best(self) -> int:
        """Index of the candidate to take: the aware path of the field where nothing was driven."""
        if self.judgement is None:
            return int(len(self.candidates) > 1 and self.candidates[1].planner != "")
        takes = self.judgement.takes(self.settings.bold) and not self._fails_more
        return self.judgement.leader if takes else 0

    @property
    def _arrivals(self) -> list[Arrivals]:
        """Closed-loop drives of the shortest path, and of another one that drives speak for."""
        return [each.arrivals for each in self.candidates if each.arrivals is not None]

    @property
    def _fails_more(self) -> bool:
        """Whether the robot arrives too seldom by the winner of the race."""
        if len(self._arrivals) < 2:
            return False
        shortest, leader = self._arrivals
        # It may fail in an eighth of the drives more than the shortest.
        return shortest.count - leader.count > len(leader.drives) / 8

    @property
    def shortest(self) -> Candidate | None:
        """Candidate that is the shortest path; None if there is no path."""
        return self.candidates[0] if self.candidates else None

    @property
    def chosen(self) -> Candidate | None:
        """Candidate to take; None if there is no path."""
        return self.candidates[self.best] if self.candidates else None

    @property
    def taken(self) -> str:
        """Name of the candidate to take; empty if there is no path."""
        return self.chosen.name if self.chosen else ""

    @property
    def path(self) -> Path | None:
        """Path to take; None if there is none."""
        return self.chosen.path if self.chosen else None

    @property
    def _decision(self) -> Decision:
        return Decision(
            self.candidates,
            self.best,
            self.judgement,
            self.rival,
            self.settings,
            self.robot.filter,
            self.status,
            self.note,
        )

    @property
    def leader(self) -> Candidate | None:
        """Candidate that the verdict is on, or the one to take where nothing was driven."""
        return self._decision.leader

    @property
    def sentence(self) -> str:
        """Which path to take, in a sentence or two."""
        return format_answer(self._decision)

    @property
    def arrives(self) -> str:
        """How many robots reach the goal in closed loop, in words; empty if none was driven."""
        return format_reached(self._decision)

    @property
    def advice(self) -> list[str]:
        """Sentences on what may matter more than the path; the first may say to tune first."""
        return list_advice(self._decision)

    @property
    def answer(self) -> list[str]:
        """The whole answer in sentences, what gains most first."""
        return list_answer(self._decision)

    @property
    def is_tuning_first(self) -> bool:
        """True if other settings of the filter gain more than any path."""
        return compare_tuning(self._decision) is not None

    @property
    def is_undecided(self) -> bool:
        """True if the shortest path is kept because more drives may show another to be better."""
        return self.best == 0 and self.verdict == UNDECIDED and self.leader is not self.shortest

    @property
    def driven(self) -> str:
        """Which drives and which robot are shown, in words."""
        if self.judgement is None:
            return ""
        return f"Open-loop drives of {self.robot.title}; seed {self.seed}"

    @property
    def config(self) -> FieldConfig:
        """Settings of the field that the paths were measured on, or would be without one."""
        return config_of(self.about, self.robot.lidar)

    def with_field(self, field: CovarianceField) -> Choice:
        """The same with a costmap of a field, which a choice that was loaded lacks.

        Parameters
        ----------
        field : CovarianceField
            The field of the map, of the settings `config`.

        Raises
        ------
        ConfigError
            If it is that of another map.
        """
        return dataclasses.replace(self, costs=costs_again(self.about, field))

    def costmap(self) -> Costmap:
        """The costmap on which the path to take costs least, such as for `locplan.export`.

        A path that was given, or of a planner that was driven, costs 1 a metre, and 9 off it.

        Raises
        ------
        ConfigError
            If there is no path, or the choice was loaded; `with_field` gives it a costmap.
        """
        chosen, costs = self.chosen, self.costs
        if chosen is None:
            raise ConfigError(f"the choice has no path: {self.sentence}")
        if costs is None:
            raise ConfigError("a choice that was loaded has no costmap; give it with_field(field)")
        if chosen.planner and chosen is not self.shortest:
            return costs
        paths = {each.name: each.path for each in self.candidates}
        return costmap_of(costs, paths, chosen.name, self.robot, self.settings.max_e)

    def table(self) -> Table:
        """The candidates, a row each; of driven ones, the first column marks the one to take."""
        columns = DRIVEN if self.judgement else PLANNED
        if self.settings.minimise == "heading":
            columns = tuple(
                dataclasses.replace(each, unit="rad", people="deg", digits=1)
                if each.name == "error"
                else each
                for each in columns
            )
        marks = Column("chosen", title="", value=lambda each: ">" if each is self.chosen else "")
        return Table.of((marks, *columns) if self.judgement else columns, self.candidates)

    def report(self, *about: Any, **more: Any) -> str:
        """The answer, the table of the drives, and why other paths are no candidates.

        Parameters
        ----------
        *about, **more
            What `save` takes, of which it says nothing.
        """
        if not self.candidates:
            return self.sentence
        evidence = [*wrapped([f"{self.driven}:"])] if self.judgement else []
        evidence.append(evidence_table(self._decision) or str(self.table()))
        notes = list_notes(self._decision)
        notes += [f"{each.name}: {each.note}" for each in self.candidates if each.note]
        names: dict[str, list[str]] = {}
        for name, why in self.left_out.items():
            names.setdefault(why, []).append(name)
        notes += [f"left out: {', '.join(group)}: {why}" for why, group in names.items()]
        if self.costs is not None and self.costs.note:
            notes.append(self.costs.note)
        if self.costs is not None and not self.costs.has_weak_spots:
            notes.append("no weak spot for this lidar: u is 0 throughout the map")
        return "\n".join([*wrapped(self.answer), "", *evidence, *wrapped(notes)])

    def _write(self, folder: File, *about: Any) -> None:
        """Write the paths, the table and the errors along the paths."""
        self.table().write_csv(folder / "candidates.csv")
        if self.path:
            self.path.save(folder / "chosen.csv")
        for number, each in enumerate(self.candidates, 1):
            each.path.save(folder / f"{number:02}-{file_name(each.name)[:60]}.csv")
        columns = ["path", "distance", "error_median", "error_low", "error_high"]
        rows = (
            [each.name, *at]
            for each in self.candidates
            if each.driven
            for at in each.driven.profile.tolist()
        )
        write_rows(folder / "errors.csv", columns, rows)
        searched = [each for each in self.candidates if len(each.history) > 1]
        if searched:
            from locplan import plotting

            plans = {each.name: self._plan(each) for each in searched}
            plotting.save_figure(plotting.history_figure(plans), folder / "history.png")

    def _plan(self, each: Candidate) -> Plan:
        """A candidate as a plan, for the figure of its search."""
        costs, history = self.costs, each.history
        return Plan(
            *("solved", each.planner, self.start, self.goal, each.path, each.metrics),
            solve_time=history[-1][0],
            history=history,
            costs=costs,
        )

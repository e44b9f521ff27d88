"""The result of a choice: the path to take, the verdict, and the drives that say so."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, ClassVar, Literal

from locplan._util.intervals import short
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.saved import Stored, listed, tree_of
from locplan._util.tables import file_name, wrapped, write_rows
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField, FieldConfig
from locplan.planners import Plan, Position
from locplan.robots import Robot
from locplan.simulation._arrivals import Arrivals, faults_of
from locplan.simulation.choice._ask import ChoiceSettings
from locplan.simulation.choice._densities import config_of, costmap_of, costs_again
from locplan.simulation.choice._driven import DRIVEN, PLANNED, Candidate, Driven, comparable
from locplan.simulation.choice._race import ROUNDS, Judgement
from locplan.simulation.choice._tuning_advice import tuning_advice
from locplan.simulation.verdict import BETTER, NO_DIFFERENCE, UNDECIDED


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Result, Stored):
    """The path to take between two places, and the candidates beside it."""

    kind: ClassVar[str] = "choice"
    suffix: ClassVar[str] = ".json"
    version: ClassVar[int] = 3
    derived: ClassVar[tuple[str, ...]] = ("taken", "verdict", "sentence", "arrives", "advice")

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
    def sentence(self) -> str:
        """The answer in one sentence."""
        chosen, shortest, found = self.chosen, self.shortest, self.judgement
        if chosen is None or shortest is None:
            return f"{self.status}: {self.note}" if self.note else self.status
        if found is None:
            return f"take {chosen.quoted}, untested: {self.note}"
        if found.leader == 0:
            if len(self.candidates) == 1:
                return "take the shortest: no other path is a candidate"
            return f"take the shortest: no other path led by 1 % in the race of {ROUNDS[-1]} drives"
        leader = self.candidates[found.leader]
        error = f"x{short(found.ratio)} of its error {leader.at_length(shortest)}"
        if chosen is leader:
            words = "better than the shortest" if found.verdict == BETTER else found.verdict
            return f'take "{leader.name}": {words}, {error}{self._slight}'
        if self._fails_more:
            return f"take the shortest: on {leader.name} fewer robots arrive, {error}"
        if found.more_lost and found.verdict in (BETTER, UNDECIDED):
            return f"take the shortest: on {leader.name} more drives are off by over 1 m, {error}"
        what = f"{leader.name} is {found.verdict}"
        if found.verdict == NO_DIFFERENCE:
            what = f"{found.verdict} to {leader.name}"
        elif found.verdict == UNDECIDED:
            what += f" after {len(found.drives)} drives"
            error += "; --bold (bold=True) takes it" if found.is_worthwhile else ""
        elif found.verdict == BETTER:
            error += ", less than a tenth"
        return f"take the shortest: {what}, {error}"

    @property
    def arrives(self) -> str:
        """How many robots arrive that a follower steers by their filters' poses, in words."""
        driven = [each for each in self.candidates if each.arrivals is not None]
        if not driven:
            return ""
        shortest, faults = self._arrivals[0], faults_of(*self._arrivals)
        last = driven[-1].arrivals or shortest
        said = f"steered by its filter, the robot arrives on {driven[-1].quoted} in {last.words}"
        if len(driven) == 1:
            return said + faults
        same = last.count == shortest.count
        return f"{said}, {'as on' if same else f'and in {shortest.words} on'} the shortest{faults}"

    @property
    def _slight(self) -> str:
        chosen, shortest = self.chosen, self.shortest
        if not (chosen and shortest and chosen.driven and shortest.driven):
            return ""
        gained = shortest.driven.error.value - chosen.driven.error.value
        if self.settings.minimise != "rmse" or gained >= 0.02 or shortest.driven.lost.any():
            return ""
        return "; that is under 2 cm, and no drive is off by over 1 m on the shortest either"

    @property
    def advice(self) -> list[str]:
        """Sentences on the filter, which may matter more than the path."""
        if self.shortest is None or self.chosen is None or self.judgement is None:
            return []
        return tuning_advice(
            self.shortest,
            self.chosen,
            self.judgement.ratio.value if self.best else 1.0,
            self.robot.filter,
            self.rival,
            self.settings.rival,
        )

    @property
    def said(self) -> list[str]:
        """The answer, who arrives, and the advice."""
        return [each for each in (self.sentence, self.arrives, *self.advice) if each]

    @property
    def driven(self) -> str:
        """Which drives are shown, in words."""
        if self.judgement is None or self.shortest is None:
            return ""
        count, leader = len(self.judgement.drives), self.candidates[self.judgement.leader]
        of = (
            f" of {leader.quoted} and of the shortest"
            if self.judgement.leader
            else (" at most of each path")
        )
        return f"{count} drives{of}; seed {self.seed}; with {self.robot.title}"

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

    def summary(self, *about: Any, **more: Any) -> dict[str, object]:
        """The answer, the candidates and the settings, fit for JSON and for `load`.

        Parameters
        ----------
        *about, **more
            What `save` takes, of which it says nothing.
        """
        return dict(listed(tree_of(self)))

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
        """The answer with its advice, the table, and which drives are shown.

        Parameters
        ----------
        *about, **more
            What `save` takes, of which it says nothing.
        """
        if not self.candidates:
            return self.sentence
        what = {"rmse": "error", "lost": "error", "goal-error": "error at the goal"}
        shown_of = what.get(self.settings.minimise, "error of the heading")
        heads = [
            f"{shown_of}: the geometric mean of the drives' RMSE [95 % interval]; a dash where a"
            " path had other drives, 4 to 8: its ratio is to the shortest in these",
        ]
        left = [f"{each.name}: {each.note}" for each in self.candidates if each.note]
        names: dict[str, list[str]] = {}
        for name, why in self.left_out.items():
            names.setdefault(why, []).append(name)
        left += [f"left out: {', '.join(group)}: {why}" for why, group in names.items()]
        below = [*left, *([self.driven, *heads] if self.judgement else [])]
        if self.costs is not None and self.costs.note:
            below.append(self.costs.note)
        if self.costs is not None and not self.costs.has_weak_spots:
            below.append("no weak spot for this lidar: u is 0 all over the map")
        return "\n".join(
            [*wrapped(self.said), str(comparable(self.table(), self.candidates)), *wrapped(below)]
        )

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

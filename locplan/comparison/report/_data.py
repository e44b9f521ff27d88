"""The contents of a report: the runs, their statistics, and the scenes of its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypedDict

from locplan.comparison._runs import Run
from locplan.field import CovarianceField
from locplan.planners import ParetoFront

Case = tuple[str, str]
"""A map's name and the label of its field's settings."""
Ends = tuple[tuple[float, ...], tuple[float, ...]]
"""Start and goal [m]."""


class Row(TypedDict):
    """The statistics of one planner on one map, with one config and one weight."""

    map: str
    config: str
    weight: float
    planner: str
    solved_share: float
    """The share of runs that were solved, 0..1."""
    pairs: int
    """The number of queries that the planner and the baseline both solved."""
    measures: Mapping[str, tuple[float, float, float]]
    """Median, lower and upper quartile on those queries, by the names of `MEASURES`."""
    baseline_cost: float
    """The baseline's median J on those queries [m]; NaN if there are none."""
    ratio: float
    """The ratio of J to the baseline's; NaN if it is unknown."""
    ratio_low: float
    """The lower end of the ratio's 95 % interval."""
    ratio_high: float
    """The upper end of the ratio's 95 % interval."""
    sentence: str
    """The ratio in words, such as "no significant difference"; may be empty."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A map with one config, for pictures."""

    field: CovarianceField
    queries: Mapping[str, Ends]
    """The queries whose paths are drawn, by name."""
    front: ParetoFront | None = None
    """The Pareto front of one representative query."""
    front_query: str = ""
    """The name of that query."""


@dataclass(frozen=True, eq=False)
class ReportData:
    """The contents of a report."""

    runs: Sequence[Run]
    rows: Sequence[Row]
    """The statistics in the order in which they are shown."""
    scenes: Mapping[Case, Scene]
    """The scenes to draw; a case without one has no pictures of paths and no front."""
    baseline: str
    """The label of the planner that the others are compared with."""
    answers: Mapping[str, str] = field(default_factory=dict)
    """The verdict on each map in words."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Versions, options, the machine and the time, each by its name in the report."""
    command: str = ""
    """The command that repeats the comparison."""
    title: str = "Planner comparison"

    @property
    def e_unit(self) -> str:
        """The unit of e, which has no angle if the field has no rotation."""
        return next((scene.field.e_unit for scene in self.scenes.values()), "m² rad")

    @property
    def planners(self) -> tuple[str, ...]:
        """The planners' labels in the order of the runs, which decides their colours and dashes."""
        return tuple(dict.fromkeys(run.task.planner for run in self.runs))

    @property
    def cases(self) -> tuple[Case, ...]:
        """Maps and configs, in the order of the runs."""
        return tuple(dict.fromkeys((run.task.map, run.task.config) for run in self.runs))

    def of_case(self, case: Case) -> list[Run]:
        """The runs of a map and config."""
        return [run for run in self.runs if (run.task.map, run.task.config) == case]

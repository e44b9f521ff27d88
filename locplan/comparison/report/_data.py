"""What a report of a comparison tells: the runs, their statistics, and what pictures draw on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypedDict

from locplan.comparison._runs import Run
from locplan.costs import Costmap
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
    """0..1"""
    measures: Mapping[str, tuple[float, float, float]]
    """Median, lower and upper quartile of the solved runs, by the names of `runs.MEASURES`."""
    ratio: float
    """Of J to the baseline's; NaN for the baseline itself, or if there is none."""
    ratio_low: float
    """Where its 95 % interval begins,"""
    ratio_high: float
    """and where it ends."""
    sentence: str
    """The ratio in words, such as "no significant difference"; may be empty."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A map with one config, as pictures need it."""

    costs: Costmap
    field: CovarianceField
    queries: Mapping[str, Ends]
    """The queries whose paths are drawn, by name."""
    front: ParetoFront | None = None
    """Of one representative query."""
    front_query: str = ""
    """Which."""


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that a report tells."""

    runs: Sequence[Run]
    rows: Sequence[Row]
    """In the order to show them in."""
    scenes: Mapping[Case, Scene]
    """May lack cases: then these have no paths and no front."""
    baseline: str
    """The planner's label to which J is compared."""
    answers: Mapping[str, str] = field(default_factory=dict)
    """One sentence for each map."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """By what to call them: versions, options, the machine, when."""
    command: str = ""
    """How to repeat it."""
    title: str = "Planner comparison"

    @property
    def e_unit(self) -> str:
        """Of e: without rotation there is no angle in it."""
        units = [scene.field.e_unit for scene in self.scenes.values()]
        return units[0] if units else "m² rad"

    @property
    def planners(self) -> tuple[str, ...]:
        """Their labels, in the order of the runs; the place decides colour and dash."""
        return tuple(dict.fromkeys(run.task.planner for run in self.runs))

    @property
    def cases(self) -> tuple[Case, ...]:
        """Maps and configs, in the order of the runs."""
        return tuple(dict.fromkeys((run.task.map, run.task.config) for run in self.runs))

    def of_case(self, case: Case) -> list[Run]:
        """The runs of a map and config."""
        return [run for run in self.runs if (run.task.map, run.task.config) == case]

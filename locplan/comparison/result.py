"""Result of a comparison: runs, statistics, verdicts, and the files that show them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan._support.saved import to_plain_data
from locplan._support.tables import wrap_lines
from locplan.comparison import statistics
from locplan.comparison.benchmarks import write_ompl_logs
from locplan.comparison.statistics import (
    PlannerContrast,
    PlannerRun,
    PlannerSummary,
    RunSetting,
    compute_contrasts,
)
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.field.store import load_or_compute
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import Costmap
from locplan.planning.queries import Query

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class MapCase:
    """A map with the settings of a field, which is read from the cache when needed."""

    map: str
    """The map's name."""
    config: str
    """The label of the field's settings."""
    grid: OccupancyGrid
    """The map."""
    robot_radius: float
    """Radius of the robot [m]."""
    settings: FieldConfig | None = None
    """The settings of the field; None for a user's costmap."""
    criterion: str | None = None
    """The scalar that u is based on; None for a user's costmap."""
    zones: Zones = dataclasses.field(default_factory=Zones)
    """The zones of the map."""
    user_costmap: Costmap | None = None
    """The user's costmap, which has no field."""
    queries: tuple[Query, ...] = ()
    """The queries."""
    load_field: Callable[[OccupancyGrid, FieldConfig], CovarianceField] = load_or_compute
    """The function that computes a field or reads it from the cache."""

    @property
    def key(self) -> tuple[str, str]:
        """The names of map and settings."""
        return self.map, self.config

    def costmap(self) -> tuple[Costmap, CovarianceField | None]:
        """Return the costmap with the estimator's weight, and its field."""
        if self.settings is None:
            assert self.user_costmap is not None
            return self.user_costmap, None
        covariance_field = self.load_field(self.grid, self.settings)
        costs = Costmap.from_field(
            covariance_field, robot=self.robot_radius, criterion=self.criterion, zones=self.zones
        )
        return costs, covariance_field


@dataclass(frozen=True)
class PlannerStanding:
    """A planner's statistics, and each of its measures compared with the baseline's.

    Medians and ratios use the queries that the planner and the baseline both solved. Otherwise a
    planner that fails on hard queries would look better than it is.
    """

    summary: PlannerSummary
    """The statistics of the planner by itself."""
    contrasts: Mapping[str, PlannerContrast]
    """The comparisons with the baseline, by measure."""

    @property
    def setting(self) -> RunSetting:
        """The map, the field's settings and the weight."""
        return self.summary.setting

    @property
    def cost(self) -> PlannerContrast:
        """J compared with the baseline's."""
        return self.contrasts["cost"]

    @property
    def verdict(self) -> str:
        """ "cheaper" or "costlier" if J differs significantly from the baseline's, or empty."""
        _, low, high = self.cost.estimate
        if not self.cost.has_interval or self.summary.planner == self.cost.baseline:
            return ""
        return "cheaper" if high < 1 - 1e-6 else "costlier" if low > 1 + 1e-6 else ""

    @property
    def answer(self) -> str:
        """The planner's part of a verdict; empty for a baseline that solves everything."""
        share = self.summary.success.value
        parts = [self.cost.sentence, f"solves {share:.0%}" if share < 1 else ""]
        text = ", ".join(filter(None, parts))
        return f"{self.summary.planner}: {text}" if text else ""


def _describe_failure(runs: Sequence[PlannerRun], planner: str) -> str:
    """Return the first exception of a planner if all its runs raise one; otherwise nothing."""
    notes = [run.note for run in runs if run.task.planner == planner and run.status == "error"]
    if not notes or len(notes) < sum(run.task.planner == planner for run in runs):
        return ""
    return f"{planner} raises in all {len(notes)} runs, first {notes[0]}"


def _make_median_getter(measure: str) -> Callable[[PlannerStanding], float]:
    return lambda standing: standing.contrasts[measure].planner_quartiles.median


STANDING_COLUMNS = (
    TableColumn("map", value=lambda standing: standing.setting.map),
    TableColumn("config", value=lambda standing: standing.setting.config),
    TableColumn("weight", "m", value=lambda standing: standing.setting.weight),
    TableColumn("planner", title="planner", value=lambda standing: standing.summary.planner),
    TableColumn(
        "success", "", "solved", 0, "%", value=lambda standing: standing.summary.success.value
    ),
    TableColumn("pairs", "", "n", 0, value=lambda standing: standing.cost.pairs),
    TableColumn("ratio", "", "ratio\nof J", 3, value=lambda standing: standing.cost.estimate.value),
    TableColumn("ratio_low", value=lambda standing: standing.cost.estimate.low),
    TableColumn("ratio_high", value=lambda standing: standing.cost.estimate.high),
    TableColumn("cost", "m", "J", value=_make_median_getter("cost")),
    TableColumn(
        "baseline_cost",
        "m",
        "base\nJ",
        value=lambda standing: standing.cost.baseline_quartiles.median,
    ),
    TableColumn("integrated_u", "m", "∫u", value=_make_median_getter("integrated_u")),
    TableColumn("seconds", "s", "time", 3, value=_make_median_getter("seconds")),
    TableColumn("sentence", value=lambda standing: standing.cost.sentence),
)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """All runs of a comparison with their statistics, as returned by `compare`."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "comparison",
        ("report.html", "comparison.csv", "runs.csv"),
        unfinished=("runs.jsonl",),
        purposes={
            "report.html": "the report, for your browser",
            "comparison.csv": "a row per planner and case",
            "runs.csv": "a row per run",
            "runs.jsonl": "the runs, from which an interrupted comparison resumes",
        },
    )

    runs: tuple[PlannerRun, ...]
    """The runs by map, settings, weight, query, planner and seed."""
    baseline: str
    """The label of the planner that all planners are compared with."""
    cases: Mapping[tuple[str, str], MapCase]
    """The map, settings and queries of each case, by the names of map and settings."""
    description: Mapping[str, Any] = field(default_factory=dict)
    """Settings, versions, the machine and the time of the comparison, fit for JSON."""
    command: str = ""
    """Command that repeats the comparison, which the report shows."""

    def __repr__(self) -> str:
        planners = dict.fromkeys(run.task.planner for run in self.runs)
        failures = filter(None, (_describe_failure(self.runs, planner) for planner in planners))
        planners_text = "; ".join([", ".join(planners), *failures])
        return f"Comparison({len(self.runs)} runs of {planners_text})"

    def summaries(self, *, pooled: bool = False) -> list[PlannerSummary]:
        """Return success, medians and quartiles of each planner.

        Parameters
        ----------
        pooled : bool, default False
            True pools all maps; otherwise maps are separate.
        """
        return statistics.compute_summaries(self.runs, pooled)

    def contrasts(self, *, pooled: bool = False) -> list[PlannerContrast]:
        """Return each planner's measures compared with the baseline's, with interval and sentence.

        Parameters
        ----------
        pooled : bool, default False
            True pools all maps, with equal weight for each query; otherwise maps are separate.
        """
        return compute_contrasts(self.runs, self.baseline, pooled)

    def standings(self, *, pooled: bool = False) -> list[PlannerStanding]:
        """Return each planner's statistics, by map, settings and weight.

        Parameters
        ----------
        pooled : bool, default False
            True pools all maps; otherwise maps are separate.
        """
        contrasts_by_planner: dict[tuple[RunSetting, str], dict[str, PlannerContrast]] = {}
        for summary in self.contrasts(pooled=pooled):
            contrasts_by_planner.setdefault((summary.setting, summary.planner), {})[
                summary.measure
            ] = summary
        summaries = self.summaries(pooled=pooled)
        rows = [
            PlannerStanding(summary, contrasts_by_planner[summary.setting, summary.planner])
            for summary in summaries
        ]
        cases = [statistics.setting_from_run(run, pooled)[:2] for run in self.runs]
        order = {case: n for n, case in enumerate(dict.fromkeys([*self.cases, *cases]))}
        return sorted(rows, key=lambda row: (order[row.setting[:2]], row.setting.weight))

    def answers(self) -> dict[str, str]:
        """Return the verdict on each map in words: each planner's J at the greatest weight."""
        texts: dict[str, list[str]] = {}
        for case, group in itertools.groupby(self.standings(), lambda row: row.setting[:2]):
            rows = list(group)
            weight = rows[-1].setting.weight
            row_answers = [row.answer for row in rows if row.setting.weight == weight]
            text = f"At weight {weight:g}, {case[1]}: {'; '.join(filter(None, row_answers))}."
            texts.setdefault(str(case[0]), []).append(text)
        return {name: " ".join(sentences) for name, sentences in texts.items()}

    def table(self) -> Table:
        """Return each planner's success, J, degeneracy and time, by map, settings and weight."""
        return Table.from_records(STANDING_COLUMNS, self.standings())

    def report(self) -> str:
        """Return a table for each map, settings and weight, followed by the verdicts on J.

        The tables fit a terminal of 80 columns.
        """
        parts = []
        for setting, group in itertools.groupby(self.standings(), lambda row: row.setting):
            rows = list(group)
            parts.append(f"{setting.map}, {setting.config}, weight {setting.weight:g}")
            parts.append(str(Table.from_records(STANDING_COLUMNS, rows)))
            runs = [run for run in self.runs if statistics.setting_from_run(run) == setting]
            sentences = [
                _describe_failure(runs, r.summary.planner)
                or f"{r.summary.planner}: {r.cost.sentence or 'the baseline'}"
                f"{self._format_undrivable(r)}"
                for r in rows
            ]
            parts += wrap_lines(sentences)
        note = (
            "n: queries that planner and baseline both solved. Ratio of J, and medians of J, of the"
            " baseline's J (base J), of degenerate metres (∫u) and of time, over these queries."
        )
        return "\n".join([*parts, *wrap_lines([note])])

    def _format_undrivable(self, row: PlannerStanding) -> str:
        """Return the number of a planner's undrivable paths, as the end of a sentence."""
        row_key = row.setting, row.summary.planner
        runs = [
            r
            for r in self.runs
            if (statistics.setting_from_run(r), r.task.planner) == row_key and r.measures
        ]
        count = sum(run.note.startswith(PlannerRun.undrivable_note) for run in runs)
        return f"; the robot cannot drive {count} of its {len(runs)} paths" if count else ""

    def to_frame(self) -> Any:
        """Return a pandas data frame with a row per run; raise a LocplanError without pandas."""
        return Table.from_records(statistics.RUN_COLUMNS, self.runs).to_frame()

    def summary(self) -> dict[str, Any]:
        """Return the settings and all statistics as plain data for JSON."""
        return {
            **self.description,
            "cases": [
                {
                    "map": case.map,
                    "digest": case.grid.digest,
                    "field": case.config,
                    "config": case.settings and case.settings.to_json(),
                    "criterion": case.criterion,
                    "robot_radius": case.robot_radius,
                    "queries": [dataclasses.asdict(query) for query in case.queries],
                }
                for case in self.cases.values()
            ],
            "baseline": self.baseline,
            "command": self.command,
            "summaries": [_statistics_to_plain_data(summary) for summary in self.summaries()],
            "contrasts": [_statistics_to_plain_data(contrast) for contrast in self.contrasts()],
        }

    def write_files(self, folder: Path, *related_results: Any) -> None:
        """Write the report, the tables and OMPL's logs into an existing folder.

        Parameters
        ----------
        folder : path
            The folder.
        *related_results
            Not used.
        """
        from locplan.comparison.report import write_comparison_report

        write_comparison_report(folder / "report.html", self)
        self.table().write_csv(folder / "comparison.csv")
        Table.from_records(statistics.RUN_COLUMNS, self.runs).write_csv(folder / "runs.csv")
        seconds, size = (
            self.description.get(name) or math.nan for name in ("time_limit", "memory")
        )
        write_ompl_logs(
            self.runs,
            folder / "ompl_logs",
            baseline=self.baseline,
            time_limit=seconds,
            memory_limit=size / 1e6,  # in MB
            started=datetime.fromisoformat(self.description["began"]),
        )

    def figure(self) -> Figure:
        """Draw the ratio of each planner's J to the baseline's, with its interval."""
        from locplan.comparison.figures import cost_figure

        return cost_figure(self)


def _statistics_to_plain_data(figures: PlannerSummary | PlannerContrast) -> dict[str, Any]:
    """Return statistics as plain data, with the map, field and weight by name."""
    return to_plain_data(figures) | {"setting": figures.setting._asdict()}

"""The result of a comparison: its runs, statistics and verdicts, and the files that show them."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from locplan._util.checks import file_path
from locplan._util.results import ResultFolder, Results
from locplan._util.tables import finite, table, wrapped
from locplan.comparison._cases import Source
from locplan.comparison._ompl_log import write_ompl_logs
from locplan.comparison._pairs import Contrast, contrasts
from locplan.comparison._runs import Run, to_frame, write_table
from locplan.comparison._statistics import Setting, Summary, summaries
from locplan.comparison.report import write_report
from locplan.comparison.report._data import Case, ReportData, Row

MAX_SCENES, MAX_FRONTS = 24, 8
"""Greatest number of cases that a report draws, and of those with the front of a query."""
REPORTED = (
    *("locplan", "python", "numpy", "numba", "scipy", "ompl", "machine", "workers", "began"),
    *("time_limit", "random_queries"),
)
"""The keys of `Comparison.about` that a report shows."""
FRONT_TIME = 20.0
"""Time limit of the exact front of a query in a report [s]."""


COMPARISON = Results("comparison", ("report.html", "comparison.json", "runs.csv", "runs.parquet"))


def check_result_folder(folder: Path, *, force: bool = False) -> ResultFolder:
    """The folder of a comparison's results, checked before long work.

    Parameters
    ----------
    folder : Path
        Folder of the results, which need not exist.
    force : bool, default False
        True also replaces files of these names that locplan did not write.

    Raises
    ------
    LocplanError
        If the results cannot be written, or would replace files of others.
    """
    return COMPARISON.into(folder, force=force)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """All runs of a comparison with their statistics; `compare` makes it."""

    runs: tuple[Run, ...]
    """The runs by map, settings, weight, query, planner and seed."""
    baseline: str
    """The label of the planner that the others are compared with."""
    sources: Mapping[Case, Source]
    """The map, settings and queries of each case, by the names of map and settings."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Settings, versions, the machine and the time of the comparison, fit for JSON."""

    def __repr__(self) -> str:
        planners = dict.fromkeys(run.task.planner for run in self.runs)
        return f"Comparison({len(self.runs)} runs of {', '.join(planners)})"

    def summaries(self, *, pooled: bool = False) -> list[Summary]:
        """Success, medians and quartiles of each planner.

        Parameters
        ----------
        pooled : bool, default False
            True takes all maps together; by default each map has its own.
        """
        return summaries(self.runs, pooled)

    def contrasts(self, *, pooled: bool = False) -> list[Contrast]:
        """Each planner and measure compared with the baseline's, with interval and sentence.

        Parameters
        ----------
        pooled : bool, default False
            True takes all maps together, each query alike; by default each map has its own.
        """
        return contrasts(self.runs, self.baseline, pooled)

    def to_frame(self) -> Any:
        """A pandas data frame with one row for every run; a LocplanError without pandas."""
        return to_frame(self.runs)

    def save(
        self, folder: str | os.PathLike[str], *, command: str = "", force: bool = False
    ) -> list[Path]:
        """Write report.html, runs.csv (and runs.parquet with pyarrow), comparison.json, ompl_logs.

        Parameters
        ----------
        folder : path
            Folder of the results, which need not exist.
        command : str, default ""
            Command that repeats the comparison, which the report shows.
        force : bool, default False
            True also replaces files of these names that locplan did not write.

        Returns
        -------
        list of Path
            The files that were written, and the folder of OMPL's logs.

        Raises
        ------
        LocplanError
            If a file cannot be written, or would replace one that locplan did not write.
        """
        results = check_result_folder(file_path("a folder of results", folder), force=force)
        tables = ["runs.csv", *(["runs.parquet"] if find_spec("pyarrow") else [])]
        limits = [self.about.get(name) for name in ("time_limit", "memory")]
        seconds, size = (math.nan if limit is None else limit for limit in limits)
        with results.writing() as new:
            write_report(new / "report.html", self._report(command))
            for name in tables:
                write_table(self.runs, new / name)
            about = json.dumps(self.to_json(), indent=2)
            (new / "comparison.json").write_text(about + "\n", encoding="utf-8")
            write_ompl_logs(
                self.runs,
                new / "ompl_logs",
                baseline=self.baseline,
                time_limit=seconds,
                memory_limit=size / 1e6,  # in MB
                started=datetime.fromisoformat(self.about["began"]),
            )
        names = ("report.html", *tables, "comparison.json", "ompl_logs")
        return [results.folder / name for name in names]

    def to_json(self) -> dict[str, Any]:
        """The settings and all statistics, fit for JSON."""
        return {
            **self.about,
            "baseline": self.baseline,
            "summaries": [summary_json(summary) for summary in self.summaries()],
            "contrasts": [contrast_json(contrast) for contrast in self.contrasts()],
        }

    def rows(self) -> list[Row]:
        """Each planner's statistics, with its J compared with the baseline's, for tables."""
        return rows_of(self.runs, self.baseline, self.sources)

    def answers(self) -> dict[str, str]:
        """The verdict on each map in words: each planner's J compared, at the greatest weight."""
        return answers(self.rows(), self.baseline)

    def table(self) -> str:
        """The rows as text, as wide as the terminal."""
        return comparison_table(self.rows())

    def _telling_query(self, case: Case) -> str:
        """The query of a case in which the baseline's degenerate metres differ most."""
        names = [query.name for query in self.sources[case].queries]
        found: dict[str, list[float]] = {name: [] for name in names}
        for run in self.runs:
            task = run.task
            if (task.map, task.config, task.planner) == (*case, self.baseline) and run.measures:
                found[run.task.query].append(run.measures["integrated_u"])
        spans = {name: max(own) - min(own) if own else -1.0 for name, own in found.items()}
        return max(names, key=spans.__getitem__)

    def _report(self, command: str) -> ReportData:
        chosen = list(self.sources.items())[:MAX_SCENES]
        drawn = {
            case: source.scene(self._telling_query(case), FRONT_TIME if n < MAX_FRONTS else None)
            for n, (case, source) in enumerate(chosen)
        }
        scenes = {case: scene for case, scene in drawn.items() if scene is not None}
        settings = {key: str(self.about[key]) for key in REPORTED if key in self.about}
        for source in self.sources.values():
            config = json.dumps(source.to_json()["config"])
            made = f"{config}, u of {source.criterion}" if source.criterion else config
            settings[f"field of {', '.join(source.case)}"] = made
            settings["robot radius"] = f"{source.robot_radius:g} m"
        return ReportData(
            self.runs, self.rows(), scenes, self.baseline, self.answers(), settings, command
        )


def rows_of(runs: Sequence[Run], baseline: str, cases: Iterable[Case]) -> list[Row]:
    """Each planner's statistics, with its J compared with the baseline's, in order of the cases.

    Medians are over the queries that the planner and the baseline have both solved, as the ratio
    is: otherwise a planner that fails at hard queries would look better than it is.
    """
    found: dict[tuple[Setting, str], dict[str, Contrast]] = {}
    for each in contrasts(runs, baseline):
        found.setdefault((each.setting, each.planner), {})[each.measure] = each
    rows = []
    for summary in summaries(runs):
        measures = found[summary.setting, summary.planner]
        cost = measures["cost"]
        row = Row(
            map=summary.setting.map or "all maps",
            config=summary.setting.config,
            weight=summary.setting.weight,
            planner=summary.planner,
            solved_share=summary.success.value,
            pairs=cost.pairs,
            measures={name: each.ours[:3] for name, each in measures.items()},
            baseline_cost=cost.theirs.median,
            ratio=cost.estimate.value,
            ratio_low=cost.estimate.low,
            ratio_high=cost.estimate.high,
            sentence=cost.sentence,
        )
        rows.append(row)
    order = {case: n for n, case in enumerate(cases)}
    return sorted(rows, key=lambda row: (order[row["map"], row["config"]], row["weight"]))


def answers(rows: Sequence[Row], baseline: str) -> dict[str, str]:
    """The verdicts on each map in one text: for each settings a sentence on its greatest weight."""
    texts: dict[str, list[str]] = {}
    for (name, config), group in itertools.groupby(rows, lambda row: (row["map"], row["config"])):
        own = list(group)
        greatest = max(row["weight"] for row in own)
        parts = (_answer(row, baseline) for row in own if row["weight"] == greatest)
        text = f"At weight {greatest:g}, {config}: {'; '.join(filter(None, parts))}."
        texts.setdefault(name, []).append(text)
    return {name: " ".join(sentences) for name, sentences in texts.items()}


def comparison_table(rows: Sequence[Row]) -> str:
    """Each planner's success, J, degeneracy and time, a table for each map, field and weight.

    What is said of J stands below each table, which then fits a terminal of 80 columns.
    """
    parts = []
    medians = "J\n[m]", "base-\nline's", "degen.\n[m]", "time\n[s]"
    heads = ("planner", "solved", "n", "ratio\nof J", *medians)
    groups = itertools.groupby(rows, lambda row: (row["map"], row["config"], row["weight"]))
    for (name, config, weight), group in groups:
        members = list(group)
        parts.append(f"{name}, {config}, weight {weight:g}")
        parts.append(table(heads, [_cells(row) for row in members]))
        said = [f"{row['planner']}: {row['sentence'] or 'the baseline'}" for row in members]
        parts += wrapped(said)
    note = (
        "n: queries that planner and baseline both solved. Over these: the ratio of J, and the"
        " medians of J and the baseline's, of degenerate metres and of time."
    )
    return "\n".join([*parts, *wrapped([note])])


def _cells(row: Row) -> list[str]:
    own, *others = (row["measures"][name][0] for name in ("cost", "integrated_u", "seconds"))
    values = row["ratio"], own, row["baseline_cost"], *others
    numbers = ["–" if math.isnan(value) else f"{value:.4g}" for value in values]
    return [row["planner"], f"{row['solved_share']:.0%}", str(row["pairs"]), *numbers]


def _answer(row: Row, baseline: str) -> str:
    parts = [] if row["planner"] == baseline else [row["sentence"]]
    if row["solved_share"] < 1:
        parts.append(f"solves {row['solved_share']:.0%}")
    return f"{row['planner']}: {', '.join(parts)}" if parts else ""


def summary_json(summary: Summary) -> dict[str, Any]:
    """A planner's statistics, fit for JSON."""
    return {
        **summary.setting._asdict(),
        **{name: getattr(summary, name) for name in ("planner", "runs", "solved")},
        "success": finite(summary.success._asdict()),
        "measures": {name: finite(each._asdict()) for name, each in summary.measures.items()},
    }


def contrast_json(contrast: Contrast) -> dict[str, Any]:
    """A comparison with the baseline, fit for JSON."""
    names = ("planner", "measure", "kind", "pairs", "sentence")
    about = contrast.setting._asdict() | {name: getattr(contrast, name) for name in names}
    medians = {"median": contrast.ours.median, "baseline_median": contrast.theirs.median}
    return about | finite(contrast.estimate._asdict() | medians)

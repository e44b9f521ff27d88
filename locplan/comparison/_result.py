"""The result of a comparison: its runs, its statistics, and the files that show them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from locplan._util.checks import file_path
from locplan._util.results import ResultFolder, Results
from locplan.comparison._cases import Source
from locplan.comparison._frames import to_frame, write_table
from locplan.comparison._ompl_log import write_ompl_logs
from locplan.comparison._pairs import Contrast, contrasts
from locplan.comparison._runs import Run
from locplan.comparison._statistics import Summary, summaries
from locplan.comparison._verdicts import (
    answers,
    comparison_table,
    contrast_json,
    rows_of,
    summary_json,
)
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

"""The verdicts of a comparison: in rows for tables, in sentences, and fit for JSON."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

from locplan._util.intervals import Interval
from locplan._util.tables import finite, table
from locplan.comparison._pairs import Contrast, contrasts
from locplan.comparison._runs import Run
from locplan.comparison._statistics import Query, Setting, Summary, query_of, setting_of, summaries
from locplan.comparison.report._data import Case, Row


def rows_of(runs: Sequence[Run], baseline: str, cases: Iterable[Case]) -> list[Row]:
    """Each planner's statistics, with its J compared with the baseline's, in order of the cases.

    Medians are over the queries that all planners have solved: otherwise a planner that fails at
    hard queries would look better than it is.
    """
    costs = {(c.setting, c.planner): c for c in contrasts(runs, baseline) if c.measure == "cost"}
    order = {case: n for n, case in enumerate(cases)}
    shared = {(s.setting, s.planner): s.measures for s in summaries(_solved_by_all(runs))}
    rows = []
    for summary in summaries(runs):
        key = summary.setting, summary.planner
        contrast = costs.get(key)
        ratio = contrast.estimate if contrast else Interval(math.nan, math.nan, math.nan)
        row = Row(
            map=summary.setting.map or "all maps",
            config=summary.setting.config,
            weight=summary.setting.weight,
            planner=summary.planner,
            solved_share=summary.success.value,
            measures={name: quartiles[:3] for name, quartiles in shared.get(key, {}).items()},
            ratio=ratio.value,
            ratio_low=ratio.low,
            ratio_high=ratio.high,
            sentence=contrast.sentence if contrast else "",
        )
        rows.append(row)
    return sorted(rows, key=lambda row: (order[row["map"], row["config"]], row["weight"]))


def _solved_by_all(runs: Sequence[Run]) -> list[Run]:
    """The runs of those queries that every planner has solved with any of its seeds."""
    solved: dict[Query, set[str]] = {}
    planners: dict[Setting, set[str]] = {}
    for run in runs:
        planners.setdefault(setting_of(run), set()).add(run.task.planner)
        if run.status == "solved":
            solved.setdefault(query_of(run), set()).add(run.task.planner)
    return [run for run in runs if solved.get(query_of(run)) == planners[setting_of(run)]]


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


def comparison_table(rows: Sequence[Row], baseline: str) -> str:
    """Each planner's success, J, degeneracy and time, a table for each map, field and weight."""
    parts = []
    groups = itertools.groupby(rows, lambda row: (row["map"], row["config"], row["weight"]))
    for (name, config, weight), group in groups:
        parts.append(f"{name}, {config}, weight {weight:g}")
        heads = ("planner", "solved", "J [m]", "degenerate [m]", "time [s]")
        cells = [_cells(row, baseline) for row in group]
        parts.append(table([*heads, "J beside the baseline's"], cells))
    return "\n".join(parts)


def _cells(row: Row, baseline: str) -> list[str]:
    names = ("cost", "integrated_u", "seconds")
    medians = [row["measures"].get(name, (math.nan,))[0] for name in names]
    numbers = ["–" if math.isnan(value) else f"{value:.4g}" for value in medians]
    verdict = "the baseline" if row["planner"] == baseline else row["sentence"]
    return [row["planner"], f"{row['solved_share']:.0%}", *numbers, verdict]


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
        "measures": {
            name: finite(quartiles._asdict()) for name, quartiles in summary.measures.items()
        },
    }


def contrast_json(contrast: Contrast) -> dict[str, Any]:
    """A comparison with the baseline, fit for JSON."""
    names = ("planner", "measure", "kind", "pairs", "sentence")
    about = contrast.setting._asdict() | {name: getattr(contrast, name) for name in names}
    return about | finite(contrast.estimate._asdict())

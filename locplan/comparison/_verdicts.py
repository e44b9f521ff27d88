"""What a comparison says: in rows for tables, in sentences, and fit for JSON."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from locplan._util.tables import finite, table
from locplan.comparison._pairs import Contrast, contrasts
from locplan.comparison._runs import Run
from locplan.comparison._statistics import Setting, Summary, setting_of, summaries
from locplan.comparison.report._data import Case, Row


def rows_of(runs: Sequence[Run], baseline: str, cases: Iterable[Case]) -> list[Row]:
    """Each planner's statistics with its J beside the baseline's, in the order of the cases.

    Medians are over the queries that all planners have solved: one that fails where it is hard
    would look better than it is.
    """
    costs = {(c.setting, c.planner): c for c in contrasts(runs, baseline) if c.measure == "cost"}
    order = {case: n for n, case in enumerate(cases)}
    shared = {(s.setting, s.planner): s.measures for s in summaries(solved_by_all(runs))}
    rows = [
        _row(
            dataclasses.replace(s, measures=shared.get((s.setting, s.planner), {})),
            costs.get((s.setting, s.planner)),
        )
        for s in summaries(runs)
    ]
    return sorted(rows, key=lambda row: (order[row["map"], row["config"]], row["weight"]))


def solved_by_all(runs: Sequence[Run]) -> list[Run]:
    """The runs of queries that every planner has solved, with any seed: so that medians compare."""
    solved: dict[tuple[Setting, str], set[str]] = {}
    planners: dict[Setting, set[str]] = {}
    for run in runs:
        setting = setting_of(run)
        planners.setdefault(setting, set()).add(run.task.planner)
        if run.status == "solved":
            solved.setdefault((setting, run.task.query), set()).add(run.task.planner)
    return [
        run
        for run in runs
        if solved.get((setting_of(run), run.task.query)) == planners[setting_of(run)]
    ]


def answers(rows: Sequence[Row], baseline: str) -> dict[str, str]:
    """For each map what is to be said of each planner at the greatest weight, by settings."""
    names = dict.fromkeys(row["map"] for row in rows)
    return {name: " ".join(_answers(rows, name, baseline)) for name in names}


def comparison_table(rows: Sequence[Row], baseline: str) -> str:
    """Each planner's success, J, degeneracy and time, a table for each map, field and weight."""
    parts = []
    groups = itertools.groupby(rows, lambda row: (row["map"], row["config"], row["weight"]))
    for (name, config, weight), group in groups:
        parts.append(f"{name}, {config}, weight {weight:g}")
        columns = [
            "planner",
            "solved",
            "J [m]",
            "degenerate [m]",
            "time [s]",
            "J beside the baseline's",
        ]
        parts.append(table(columns, [_cells(row, baseline) for row in group]))
    return "\n".join(parts)


def _cells(row: Mapping[str, Any], baseline: str) -> list[str]:
    names = ("cost", "integrated_u", "seconds")
    medians = [row["measures"].get(name, (math.nan,))[0] for name in names]
    numbers = ["–" if math.isnan(value) else f"{value:.4g}" for value in medians]
    verdict = "the baseline" if row["planner"] == baseline else row["sentence"]
    return [row["planner"], f"{row['solved_share']:.0%}", *numbers, verdict]


def _row(summary: Summary, contrast: Contrast | None) -> Row:
    ratio = contrast.estimate if contrast else (float("nan"),) * 3
    map_name = summary.setting.map or "all maps"
    return Row(
        map=map_name,
        config=summary.setting.config,
        weight=summary.setting.weight,
        planner=summary.planner,
        solved_share=summary.success.value,
        measures={name: spread[:3] for name, spread in summary.measures.items()},
        ratio=ratio[0],
        ratio_low=ratio[1],
        ratio_high=ratio[2],
        sentence=contrast.sentence if contrast else "",
    )


def _answers(rows: Sequence[Row], name: str, baseline: str) -> Iterator[str]:
    """One sentence for each kind of field."""
    own = [row for row in rows if row["map"] == name]
    greatest = max(row["weight"] for row in own)
    for config in dict.fromkeys(row["config"] for row in own):
        parts = [
            _answer(row, baseline)
            for row in own
            if (row["config"], row["weight"]) == (config, greatest)
        ]
        yield f"At weight {greatest:g}, {config}: {'; '.join(filter(None, parts))}."


def _answer(row: Row, baseline: str) -> str:
    parts = [] if row["planner"] == baseline else [row["sentence"]]
    if row["solved_share"] < 1:
        parts.append(f"solves {row['solved_share']:.0%}")
    return f"{row['planner']}: {', '.join(parts)}" if parts else ""


def summary_json(summary: Summary) -> dict[str, Any]:
    measures = {name: finite(spread._asdict()) for name, spread in summary.measures.items()}
    return {
        **_setting_json(summary.setting),
        "planner": summary.planner,
        "runs": summary.runs,
        "solved": summary.solved,
        "success": finite(summary.success._asdict()),
        "measures": measures,
    }


def contrast_json(contrast: Contrast) -> dict[str, Any]:
    return {
        **_setting_json(contrast.setting),
        "planner": contrast.planner,
        "measure": contrast.measure,
        "kind": contrast.kind,
        "pairs": contrast.pairs,
        "sentence": contrast.sentence,
        **finite(contrast.estimate._asdict()),
    }


def _setting_json(setting: Setting) -> dict[str, Any]:
    return dict(setting._asdict())

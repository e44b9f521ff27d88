"""The verdicts of a comparison: in rows for tables, in sentences, and fit for JSON."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

from locplan._util.tables import finite, table, wrapped
from locplan.comparison._pairs import Contrast, contrasts
from locplan.comparison._runs import Run
from locplan.comparison._statistics import Setting, Summary, summaries
from locplan.comparison.report._data import Case, Row


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

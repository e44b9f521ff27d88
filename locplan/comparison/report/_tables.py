"""The tables of a report: each planner's statistics, and the runs that failed."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from locplan.comparison._runs import MEASURES, Run
from locplan.comparison.report._data import ReportData, Row
from locplan.comparison.report._figures import Look
from locplan.comparison.report._filters import of_case
from locplan.comparison.report._html import (
    Cell,
    Html,
    Line,
    breakable,
    counted,
    element,
    html,
    joined,
    table,
)
from locplan.comparison.report._marks import Scale, interval, line

COLUMNS = ("cost", "seconds", "length", "integrated_u", "integrated_e")
HEADS = {"cost": "J [m]", "seconds": "time [ms]"} | {
    name: f"{label} [{unit}]" for name, (label, unit) in MEASURES.items() if name in COLUMNS[2:]
}
MAX_GROUPS = 200
"""Greatest number of kinds of failures in the table."""
NO_BREAK = "\u00a0"


def results(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """Every planner's statistics, a table for each map, config and weight."""
    note = (
        f"The mark beside each ratio is its 95{NO_BREAK}% interval, the upright line the J of"
        f" {data.baseline}; grey where the interval includes it, an arrow where it lies outside."
        " n is the number of queries that planner and baseline both solved; the ratio and the"
        " medians, with their interquartile ranges below, are over these."
    )
    yield element("p", note, kind="muted note")
    measured = HEADS | {"integrated_e": f"{MEASURES['integrated_e'][0]} [{data.e_unit} m]"}
    heads = ["planner", "J / baseline's J", "solved", *(measured[name] for name in COLUMNS)]
    for case, in_case in itertools.groupby(data.rows, lambda row: (row["map"], row["config"])):
        name = ", ".join(case)
        tables = [
            table(
                f"{name}, weight {weight:g}",
                heads,
                _rows(list(rows), data, looks),
                **of_case(case, weight),
            )
            for weight, rows in itertools.groupby(in_case, lambda row: row["weight"])
        ]
        title = element("summary", element("h3", name))
        yield element("details", title, *tables, open="open", **of_case(case))


def _rows(rows: Sequence[Row], data: ReportData, looks: Mapping[str, Look]) -> Iterator[Line]:
    scale = Scale.of([(row["ratio_low"], row["ratio_high"]) for row in rows])
    for row in rows:
        label, share = row["planner"], row["solved_share"]
        mark = line(looks[label]) if label in looks else ""
        name = element("span", mark, element("span", breakable(label)), kind="planner")
        measures = (_measure_cell(row, measure) for measure in COLUMNS)
        percent = f"{share:.0%}".replace("%", f"{NO_BREAK}%")
        solved = Cell(percent, share, "" if share == 1 else "few")
        cells = [Cell(name), _ratio_cell(row, data.baseline, scale), solved, *measures]
        yield Line(cells, {"data_planner": label})


def _measure_cell(row: Row, measure: str) -> Cell:
    quartiles = row["measures"].get(measure, (math.nan,) * 3)
    if not math.isfinite(quartiles[0]):
        return Cell("–", math.nan)
    factor = 1000 if measure == "seconds" else 1
    middle, low, high = (number(factor * value) for value in quartiles)
    return Cell(joined([middle, element("small", f"{low} – {high}")]), quartiles[0])


def _ratio_cell(row: Row, baseline: str, scale: Scale) -> Cell:
    ratio, low, high = row["ratio"], row["ratio_low"], row["ratio_high"]
    text, note = f"{ratio:.3f} [{low:.3f}, {high:.3f}]", row["sentence"]
    medians = f"n = {row['pairs']}, {baseline}: {number(row['baseline_cost'])} m"
    if row["planner"] == baseline:
        ratio, low, high, text, note = 1.0, 1.0, 1.0, "1", "baseline"
    if not math.isfinite(ratio):
        return Cell("–", math.nan)
    drawn = interval(ratio, low, high, scale)
    return Cell(joined([text, drawn, element("small", f"{note} ({medians})")]), ratio, "ratio")


def number(value: float) -> str:
    """Text with four significant digits above 10, three above 1 and two below."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    size = math.floor(math.log10(abs(value)))
    if size < -4:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:,.{1 - size if size < 0 else max(0, min(2, 3 - size))}f}"


def failures(data: ReportData) -> Iterator[Html]:
    """The runs without a path, in one row for each kind of failure."""
    groups: dict[tuple[str, ...], list[Run]] = {}
    for run in data.runs:
        if run.status != "solved":
            task = run.task
            key = run.status, task.planner, task.map, task.config, run.note
            groups.setdefault(key, []).append(run)
    if not groups:
        yield element("p", "Every run was solved.")
        return
    statuses = Counter(run.status for group in groups.values() for run in group)
    text = ", ".join(f"{count:,} {status}" for status, count in statuses.most_common())
    count = counted(statuses.total(), "run")
    yield element("p", f"{count} of {len(data.runs):,} without a path: {text}.")
    heads = ("planner", "status", "note", "runs", "longest [s]", "map", "which")
    rows = (_failure_row(*group) for group in itertools.islice(groups.items(), MAX_GROUPS))
    yield table("Runs without a path", heads, rows)
    if len(groups) > MAX_GROUPS:
        yield element("p", f"And {len(groups) - MAX_GROUPS:,} kinds more.")


def _failure_row(key: tuple[str, ...], runs: Sequence[Run]) -> Line:
    status, planner, name, config, note = key
    which = [f"{r.task.query}, weight {r.task.weight:g}, seed {r.task.seed}" for r in runs[:3]]
    which += ["…"] if len(runs) > 3 else []
    longest = max(run.wall_seconds for run in runs)
    cells = [
        Cell(breakable(planner)),
        Cell(status),
        Cell(note or "–", kind="note"),
        Cell(str(len(runs)), float(len(runs))),
        Cell(number(longest), longest),
        Cell(f"{name}, {config}"),
        Cell(Html("<br>".join(map(html, which)))),
    ]
    return Line(cells, of_case((name, config)) | {"data_planner": planner, "data_status": status})

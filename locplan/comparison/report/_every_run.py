"""The table of every run of a comparison."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

from locplan.comparison._runs import MEASURES, Run
from locplan.comparison._statistics import query_of
from locplan.comparison.report._data import ReportData
from locplan.comparison.report._figures import Look
from locplan.comparison.report._filters import of_task
from locplan.comparison.report._html import Cell, Html, Line, breakable, element, table
from locplan.comparison.report._marks import line
from locplan.comparison.report._query_costs import costs_of
from locplan.comparison.report._tables import NO_BREAK, number

MAX_RUNS = 2000
"""Greatest number of runs in the table."""
COLUMNS = ("length", "integrated_u", "integrated_e")


def every_run(data: ReportData, looks: Mapping[str, Look]) -> Iterator[Html]:
    """A row for each run, which the filters choose from."""
    total = len(data.runs)
    if not total:
        yield element("p", "Nothing was run.")
        return
    note = f"Each run by itself, beside the J of {data.baseline} for the same query."
    if total > MAX_RUNS:
        note += f" The first {MAX_RUNS:,} of {total:,} runs are shown; runs.csv has all."
    yield element("p", note, kind="muted note")
    baseline = costs_of(run for run in data.runs if run.task.planner == data.baseline)
    reference = {query: cost for (query, _), cost in baseline.items()}
    seeded = any(run.task.seed for run in data.runs)
    units = {name: unit for name, (_, unit) in MEASURES.items()}
    units["integrated_e"] = f"{data.e_unit} m"
    measured = [f"{MEASURES[name][0]} [{units[name]}]" for name in COLUMNS]
    heads = ["planner", "map", "query", "weight", *(["seed"] if seeded else []), "status"]
    heads += ["J [m]", "J / baseline's J", "time [ms]", *measured]
    rows = (
        Line(
            _cells(run, looks, reference.get(query_of(run)), seeded), of_task(run.task, run.status)
        )
        for run in itertools.islice(data.runs, MAX_RUNS)
    )
    yield element("div", table("Every run", heads, rows), id="every-run")


def _cells(
    run: Run, looks: Mapping[str, Look], reference: float | None, seeded: bool
) -> Iterator[Cell]:
    task = run.task
    name = element("span", line(looks[task.planner]), breakable(task.planner), kind="planner")
    yield Cell(name)
    yield Cell(f"{task.map}, {task.config}")
    yield Cell(task.query)
    yield Cell(f"{task.weight:g}", task.weight)
    if seeded:
        yield Cell(str(task.seed) if task.seed else "–", float(task.seed))
    yield Cell(run.status.replace(" ", NO_BREAK), kind="" if run.status == "solved" else "few")
    cost = run.measures.get("cost")
    yield _cell(cost)
    ratio = cost / reference if cost is not None and reference else None
    yield Cell("–", float("nan")) if ratio is None else Cell(f"{ratio:.3f}", round(ratio, 9))
    yield _cell(1000 * run.seconds)
    for measure in COLUMNS:
        yield _cell(run.measures.get(measure))


def _cell(value: float | None) -> Cell:
    return Cell("–", float("nan")) if value is None else Cell(number(value), float(f"{value:.6g}"))

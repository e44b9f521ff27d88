"""The report of a comparison: one HTML file that needs nothing else."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping

from locplan._util.files import replacing
from locplan.comparison._runs import MEASURES, Run
from locplan.comparison._statistics import query_of
from locplan.comparison.report._data import ReportData
from locplan.comparison.report._figures import Look, looks_of
from locplan.comparison.report._filters import filter_bar, of_task
from locplan.comparison.report._html import (
    Cell,
    Html,
    Line,
    breakable,
    counted,
    element,
    page,
    table,
)
from locplan.comparison.report._marks import line, palette
from locplan.comparison.report._pictures import over_time, paths, trade_offs
from locplan.comparison.report._query_costs import costs_of
from locplan.comparison.report._tables import NO_BREAK, failures, number, results

MAX_RUNS = 2000
"""Greatest number of runs in the table."""
COLUMNS = ("length", "integrated_u", "integrated_e")


def write_report(path: str | os.PathLike[str], data: ReportData) -> None:
    """Write the report, whole or not at all.

    Parameters
    ----------
    path : path
        The HTML file.
    data : ReportData
        The contents. Names, labels and notes may hold any text.
    """
    text = page(data.title, _parts(data), palette())
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")


def _parts(data: ReportData) -> Iterator[Html]:
    looks = looks_of(data.planners)
    sections: dict[str, Iterator[Html]] = {
        "Results": results(data, looks),
        "Trade-offs": trade_offs(data, looks),
        "Progress over time": over_time(data, looks),
        "Paths": paths(data, looks),
        "Runs": every_run(data, looks),
        "Failures": failures(data),
        "Settings": _settings(data),
    }
    answers = (element("li", element("b", name), text) for name, text in data.answers.items())
    links = (element("a", title, href=f"#{_anchor(title)}") for title in sections)
    yield element("h1", data.title)
    yield element("p", _extent(data), kind="muted")
    yield element("ul", *answers, kind="answers")
    yield element("nav", *links, aria_label="sections")
    yield from filter_bar(data.runs, looks)
    for title, parts in sections.items():
        yield element("h2", title, id=_anchor(title))
        yield from parts


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


def _extent(data: ReportData) -> str:
    queries = {(run.task.map, run.task.query) for run in data.runs}
    maps = {run.task.map for run in data.runs}
    solved = sum(run.status == "solved" for run in data.runs)
    return (
        f"{counted(len(data.runs), 'run')} of {counted(len(data.planners), 'planner')} on"
        f" {counted(len(queries), 'query', 'queries')} in {counted(len(maps), 'map')};"
        f" {solved:,} solved. J is compared with that of {data.baseline}."
    )


def _settings(data: ReportData) -> Iterator[Html]:
    seeds = sorted({run.task.seed for run in data.runs if run.task.seed})
    facts: dict[str, str] = dict(data.settings) | {
        "planners": Html("<br>".join(map(breakable, data.planners))),
        "baseline": data.baseline,
        "weights": ", ".join(f"{w:g}" for w in sorted({r.task.weight for r in data.runs})),
        "seeds": ", ".join(map(str, seeds)) or "none needed",
    }
    rows = (
        part for name, text in facts.items() for part in (element("dt", name), element("dd", text))
    )
    yield element("dl", *rows)
    if data.command:
        yield element("h3", "To repeat it")
        yield element("pre", data.command, tabindex="0")


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

"""The report of a comparison: one HTML file that needs nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterator

from locplan._util.files import replacing
from locplan.comparison.report._data import ReportData
from locplan.comparison.report._every_run import every_run
from locplan.comparison.report._figures import looks_of
from locplan.comparison.report._filters import filter_bar
from locplan.comparison.report._html import Html, breakable, counted, element, page
from locplan.comparison.report._marks import palette
from locplan.comparison.report._pictures import over_time, paths, trade_offs
from locplan.comparison.report._tables import failures, results


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

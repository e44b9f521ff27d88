"""Report of a comparison: a self-contained HTML file, rendered from `templates`."""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup, escape

from locplan._support.files import write_text
from locplan._support.public import load_templates, render_png
from locplan.comparison.figures import cost_figure, find_most_telling_scene, scene_figure
from locplan.comparison.result import Comparison, PlannerStanding
from locplan.comparison.statistics import PlannerRun, group_records

MAX_FAILURES = 30
"""Maximum number of kinds of failures in the report."""


class ReportAnswer(NamedTuple):
    """The verdicts of a comparison for one kind of field, over all maps."""

    scope: str
    """The field and the weight."""
    title: str
    sentences: list[str]


class ReportPicture(NamedTuple):
    """A picture with its caption and its alternative text."""

    data: str
    """The image as a URL."""
    caption: str
    text: str


def write_comparison_report(path: Path, comparison: Comparison) -> None:
    """Write the report; names, labels and notes may hold any text."""
    environment = load_templates("locplan.comparison", autoescape=True, lstrip_blocks=True)
    environment.filters |= {
        "breakable": add_line_breaks,
        "key": format_sort_key,
        "number": format_number,
    }
    script = environment.get_template("report.js").render()
    rows = comparison.standings()
    text = environment.get_template("report.html").render(
        comparison=comparison,
        answers=list(find_answers(comparison)),
        drawings=list(draw_pictures(comparison)),
        rows=rows,
        varying=[
            name
            for name in ("map", "config", "weight")
            if len({_get_setting_part(r, name) for r in rows}) > 1
        ],
        solved=sum(run.status == "solved" for run in comparison.runs),
        queries=len({(run.task.map, run.task.query) for run in comparison.runs}),
        maps=comparison.answers(),
        failures=group_failures(comparison),
        max_failures=MAX_FAILURES,
        settings=collect_settings(comparison),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    write_text(path, text, errors="replace")


def find_answers(comparison: Comparison) -> Iterator[ReportAnswer]:
    """Yield the answer for each kind of field, over all maps, at the greatest weight."""
    groups = group_records(comparison.standings(pooled=True), lambda row: row.setting.config)
    for config, group in groups.items():
        weight = max(row.setting.weight for row in group)
        rows = [row for row in group if row.setting.weight == weight]
        sentences = list(filter(None, (row.answer for row in rows)))
        yield ReportAnswer(f"{config}, weight {weight:g}", _format_title(rows), sentences)


def _format_title(rows: list[PlannerStanding]) -> str:
    baseline = rows[0].cost.baseline
    rival_rows = [row for row in rows if row.summary.planner != baseline]
    cheaper = sorted(
        (row for row in rival_rows if row.verdict == "cheaper"), key=lambda r: r.cost.estimate.value
    )
    if cheaper:
        names = " and ".join(row.summary.planner for row in cheaper[:3])
        return f"{names} {'beats' if len(cheaper) == 1 else 'beat'} {baseline}"
    if not rival_rows:
        return f"Only {baseline} was run"
    if not any(row.cost.has_interval for row in rival_rows):
        return "Too few queries for a verdict"
    return f"No planner beats {baseline}"


def draw_pictures(comparison: Comparison) -> Iterator[ReportPicture]:
    """Yield the picture of the costs, and the picture of the paths if there are any."""
    rows = [
        f"{row.summary.planner} {row.cost.estimate.value:.3f}"
        for row in comparison.standings(pooled=True)
        if row.cost.pairs
    ]
    yield ReportPicture(
        _make_image_url(cost_figure(comparison)),
        f"Ratio of J to that of {comparison.baseline}, with 95 % intervals. Grey: no"
        " significant difference.",
        f"Ratio of J to that of {comparison.baseline}: {'; '.join(rows)}.",
    )
    scene = find_most_telling_scene(comparison)
    if scene is not None:
        costs = [f"{name} {run.measures['cost']:.1f} m" for name, run in scene.runs.items()]
        yield ReportPicture(
            _make_image_url(scene_figure(scene)),
            f"Paths on the query on which the planners differ most: {scene.title}.",
            f"Paths of {scene.title}, with J: {'; '.join(costs)}.",
        )


def _make_image_url(figure: Any) -> str:
    return f"data:image/png;base64,{base64.b64encode(render_png(figure, dpi=130)).decode()}"


def group_failures(comparison: Comparison) -> list[list[PlannerRun]]:
    """Return the runs without a path, grouped by kind of failure, most frequent first."""

    def get_failure_kind(run: PlannerRun) -> tuple[str, ...]:
        return run.status, run.task.planner, run.task.map, run.note

    groups = group_records(
        (run for run in comparison.runs if run.status != "solved"), get_failure_kind
    )
    return sorted(groups.values(), key=len, reverse=True)


def collect_settings(comparison: Comparison) -> dict[str, str]:
    """Return versions, options, the machine and the time, each by its name in the report."""
    names = (
        *("locplan", "python", "numpy", "numba", "scipy", "ompl", "machine", "workers"),
        *("began", "time_limit", "random_queries"),
    )
    report_settings = {
        name: str(comparison.description[name]) for name in names if name in comparison.description
    }
    for case in comparison.cases.values():
        config = json.dumps(case.settings and case.settings.to_json())
        field_text = f"{config}, u of {case.criterion}" if case.criterion else config
        report_settings[f"field of {case.map}, {case.config}"] = field_text
        report_settings["robot radius"] = f"{case.robot_radius:g} m"
    tasks = [run.task for run in comparison.runs]
    seeds = sorted({task.seed for task in tasks if task.seed})
    return report_settings | {
        "planners": "\n".join(dict.fromkeys(task.planner for task in tasks)),
        "baseline": comparison.baseline,
        "weights": ", ".join(f"{weight:g}" for weight in sorted({task.weight for task in tasks})),
        "seeds": ", ".join(map(str, seeds)) or "none needed",
    }


def _get_setting_part(row: PlannerStanding, name: str) -> str | float:
    value: str | float = getattr(row.setting, name)
    return value


def add_line_breaks(label: str) -> Markup:
    """Return a planner's label as HTML with line breaks allowed between its options."""
    return Markup(str(escape(label)).replace(":", ":<wbr>").replace(",", ",<wbr>"))


def format_sort_key(value: float) -> str:
    """Return the sort key of a number in a table; NaN comes last."""
    return f"{value:.9g}" if math.isfinite(value) else "x"


def format_number(value: float) -> str:
    """Return text with four significant digits above 10, three above 1 and two below."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    size = math.floor(math.log10(abs(value)))
    if size < -4:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:,.{1 - size if size < 0 else max(0, min(2, 3 - size))}f}"

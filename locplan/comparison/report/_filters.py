"""The bar of a report that filters what is shown; the page's script makes it work and shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from locplan.comparison._runs import Run, Task
from locplan.comparison.report._data import Case
from locplan.comparison.report._figures import Look
from locplan.comparison.report._html import Html, breakable, element
from locplan.comparison.report._marks import line

KINDS: Mapping[str, str] = {
    "map": "map",
    "config": "field",
    "weight": "weight",
    "planner": "planner",
    "status": "status",
}
"""What can be filtered, by its attribute `data-...`, with its name on the page."""


def of_case(case: Case, weight: float | None = None) -> dict[str, str]:
    """The attributes by which what belongs to a case, and perhaps to a weight, is filtered."""
    own = {"data_map": case[0], "data_config": case[1]}
    return own if weight is None else own | {"data_weight": f"{weight:g}"}


def of_task(task: Task, status: str) -> dict[str, str]:
    """The attributes by which a run is filtered."""
    case = of_case((task.map, task.config), task.weight)
    return case | {"data_planner": task.planner, "data_status": status}


def filter_bar(runs: Sequence[Run], looks: Mapping[str, Look]) -> Iterator[Html]:
    """A button for each value that not all runs share; it is pressed to show only that value."""
    values = {
        "map": dict.fromkeys(run.task.map for run in runs),
        "config": dict.fromkeys(run.task.config for run in runs),
        "weight": dict.fromkeys(f"{run.task.weight:g}" for run in runs),
        "planner": dict.fromkeys(run.task.planner for run in runs),
        "status": dict.fromkeys(run.status for run in runs),
    }
    groups = [_group(kind, list(own), looks) for kind, own in values.items() if len(own) > 1]
    if groups:
        everything = element("button", "show all", type="button", kind="all")
        end = element("div", everything, element("output", aria_live="polite"), kind="end")
        label = {"role": "region", "aria_label": "filters"}
        yield element("div", *groups, end, id="filters", hidden="hidden", **label)


def _group(kind: str, values: Sequence[str], looks: Mapping[str, Look]) -> Html:
    buttons = (_button(kind, value, looks) for value in values)
    name = element("span", KINDS[kind], kind="name")
    return element("div", name, *buttons, role="group", aria_label=KINDS[kind])


def _button(kind: str, value: str, looks: Mapping[str, Look]) -> Html:
    mark = line(looks[value]) if kind == "planner" else ""
    attributes = {"type": "button", "aria_pressed": "false"}
    return element("button", mark, breakable(value), data_kind=kind, data_value=value, **attributes)

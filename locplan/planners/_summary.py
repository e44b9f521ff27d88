"""Plans and fronts as tables, and as JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from locplan._util.tables import finite, table
from locplan.costs import DEGENERATE
from locplan.field import SCALARS, CovarianceField, values_at
from locplan.planners._pareto import ParetoFront
from locplan.planners._result import Plan

_METRICS = (
    ("length", "length", "m", ".2f"),
    ("cost J", "cost", "m", ".2f"),
    ("degenerate, ∫u ds", "integrated_u", "m", ".2f"),
    ("∫e ds", "integrated_e", "m² rad m", ".3g"),
    ("mean e", "mean_e", "m² rad", ".3g"),
    ("max e", "max_e", "m² rad", ".3g"),
    (f"share with u > {DEGENERATE:g}", "degenerate_share", "", ".0%"),
    (f"longest with u > {DEGENERATE:g}", "longest_degenerate", "m", ".2f"),
    ("least clearance", "clearance", "m", ".2f"),
)
"""Rows of a table of plans: label, field of `PathMetrics`, unit and format."""
_PLAIN = (
    *("status", "planner", "start", "goal", "via", "solve_time", "max_e", "budget", "footprint"),
    *("bound", "feasible_from", "minimises", "expanded", "history", "note"),
)
"""Fields of a plan that are written as they are."""


def plans_summary(plans: Mapping[str, Plan]) -> dict[str, Any]:
    """Plans with their metrics and positions [m], fit for JSON.

    Parameters
    ----------
    plans : mapping of str to Plan
        The plans by name.
    """
    return {label: _plan_summary(plan) for label, plan in plans.items()}


def _plan_summary(plan: Plan) -> dict[str, Any]:
    """A plan, fit for JSON."""
    units = {"solve_time": "solve_time_s"}
    heading = None if plan.path is None else plan.path.heading
    return {units.get(name, name): getattr(plan, name) for name in _PLAIN} | {
        "metrics": finite(dataclasses.asdict(plan.metrics)) if plan.metrics else None,
        "xy": plan.path.xy.tolist() if plan.path else None,
        "heading": None if heading is None else heading.tolist(),
    }


def plans_table(plans: Mapping[str, Plan], field: CovarianceField) -> str:
    """Show the metrics of plans side by side, and the deviations of the position in the field.

    Parameters
    ----------
    plans : mapping of str to Plan
        The plans by name.
    field : CovarianceField
        The field of their costmap.
    """
    given = list(plans.values())
    rows = [["status", *map(_status, given)]]
    rows += _metric_rows(given, field.e_unit)
    rows += _deviation_rows(given, field)
    if any(plan.expanded is not None for plan in given):
        rows.append(["expanded cells", *(_text(plan.expanded, ",") for plan in given)])
    notes = [f"{label}: {plan.note}" for label, plan in plans.items() if plan.note]
    return "\n".join([table(["", *plans], rows), *notes])


def _status(plan: Plan) -> str:
    """Text of a plan's status; a path that minimises nothing is said to be any path."""
    return "solved, any path" if plan.status == "solved" and not plan.minimises else plan.status


def _text(value: float | None, spec: str, unit: str = "") -> str:
    """Text of a number; a dash where it is not known."""
    return "–" if value is None else f"{value:{spec}}{unit}"


def _metric_rows(plans: Sequence[Plan], e_unit: str) -> list[list[str]]:
    """The metrics of plans, a row each."""
    rows = []
    for label, name, unit, spec in _METRICS:
        unit = " " + unit.replace("m² rad", e_unit)
        rows.append(
            [label, *(_text(getattr(plan.metrics, name, None), spec, unit) for plan in plans)]
        )
    return rows


def _deviation_rows(plans: Sequence[Plan], field: CovarianceField) -> list[list[str]]:
    """The mean and the greatest deviation of the position along each path."""
    along = [_position_std(plan, field) for plan in plans]
    shown = SCALARS["position_std"]
    rows = []
    for number, label in enumerate(("mean position std", "max position std")):
        values = [None if each is None else shown.factor * each[number] for each in along]
        rows.append([label, *(_text(value, ".3g", f" {shown.unit}") for value in values)])
    return rows


def _position_std(plan: Plan, field: CovarianceField) -> tuple[float, float] | None:
    """Mean and greatest of the largest position deviation along a path [m], if it is known."""
    if plan.path is None:
        return None
    grid = field.grid
    crossed = grid.world_to_grid(*plan.path.resampled(grid.resolution, even=True).xy.T)
    rows, cols = (
        np.clip(np.floor(at).astype(int), 0, size - 1)
        for at, size in zip(crossed, grid.shape, strict=True)
    )
    found = values_at(field, field.scalar("position_std", headings="mean"), rows, cols)
    found = found[grid.free[rows, cols] & np.isfinite(found)]
    return (float(found.mean()), float(found.max())) if found.size else None


def front_summary(front: ParetoFront) -> dict[str, Any]:
    """A Pareto front, fit for JSON.

    Parameters
    ----------
    front : ParetoFront
        The front.
    """
    return {
        "map": front.costs.grid.name,
        "start": list(front.start),
        "goal": list(front.goal),
        "objective": front.objective,
        "status": front.status,
        "epsilon": finite({"epsilon": front.epsilon})["epsilon"],
        "labels": front.labels,
        "solve_time_s": front.solve_time,
        "knee": front.knee if len(front) else None,
        "length_m": front.length.tolist(),
        "integral": front.integral.tolist(),
    }


def front_table(front: ParetoFront, e_unit: str) -> str:
    """Show up to twelve points of a front with what each metre more saves, the knee marked.

    Parameters
    ----------
    front : ParetoFront
        The front.
    e_unit : str
        Unit of e, see `CovarianceField.e_unit`.
    """
    if front.status == "timeout":
        return f"timeout: no path was found within {front.solve_time:.2f} s; raise the time limit"
    if not len(front):
        return "unreachable: no path leads to the goal"
    unit = "m" if front.objective == "u" else f"{e_unit} m"
    lengths = np.linspace(front.length[0], front.length[-1], 12)
    shown = np.abs(front.length[:, None] - lengths).argmin(axis=0)
    rows = []
    for index in sorted({*map(int, shown), front.knee}):
        longer = front.length[index] / front.length[0] - 1
        texts = [f"{front.length[index]:.2f} m", f"+{longer:.1%}"]
        texts += [f"{_up(front.integral[index])} {unit}", "knee" if index == front.knee else ""]
        rows.append([str(index), *texts])
    how = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%} of every path"
    count = f"{len(front)} path{'' if len(front) == 1 else 's'}"
    last = f"{count}, {how}; {front.labels:,} labels, {front.solve_time:.2f} s"
    columns = ["path", "length", "longer", f"∫{front.objective} ds", ""]
    return f"{table(columns, rows)}\n{last}"


def _up(value: float) -> str:
    """A number of four digits that is not below the value, so that it serves as a budget."""
    text = f"{value:.4g}"
    if float(text) < value:
        step = 10.0 ** (math.floor(math.log10(value)) - 3)
        text = f"{float(text) + step:.4g}"
    return text

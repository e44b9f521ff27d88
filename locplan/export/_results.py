"""Fields and plans as tables, as JSON, and as a folder of files."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.files import make_folder, replacing
from locplan._util.tables import age, finite, in_bytes, table, write_csv
from locplan.costs import Costmap, about_costs
from locplan.costs._metrics import DEGENERATE
from locplan.field import CovarianceField, FieldConfig
from locplan.field._cache import CacheEntry
from locplan.planners import ParetoFront, Plan

SATURATED = 1 / 3
"""A larger saturated share makes the table suggest what would resolve it."""
_METRICS = (
    ("length", "length", "m", ".2f"),
    ("cost J", "cost", "m", ".2f"),
    ("degenerate, ∫u ds", "integrated_u", "m", ".2f"),
    ("∫e ds", "integrated_e", "m² rad m", ".3g"),
    ("mean e", "mean_e", "m² rad", ".3g"),
    ("greatest e", "max_e", "m² rad", ".3g"),
    (f"share with u > {DEGENERATE:g}", "degenerate_share", "", ".0%"),
    (f"longest with u > {DEGENERATE:g}", "longest_degenerate", "m", ".2f"),
    ("least clearance", "clearance", "m", ".2f"),
)
"""Rows of a table of plans: label, field of `PathMetrics`, unit and format."""


def field_summary(field: CovarianceField) -> dict[str, Any]:
    """How many cells were evaluated, and how e is distributed over them [m^2 rad].

    Over all headings, where there are several.
    """
    e = field.e[field.evaluated]
    low, median, high = np.percentile(e, (10, 50, 90)) if e.size else (math.nan,) * 3
    return finite(
        {
            "map": field.grid.name,
            "config": field.config.to_json(),
            "cells_evaluated": int(field.evaluated.sum()),
            "e_percentile_10": float(low),
            "e_median": float(median),
            "e_percentile_90": float(high),
            "saturated_share": field.saturated_share,
        }
    )


def field_table(field: CovarianceField) -> str:
    """The summary of a field for people, and what would resolve a saturated one."""
    about = field_summary(field)
    keys = "e_percentile_10", "e_median", "e_percentile_90"
    e = " / ".join("–" if about[key] is None else f"{about[key]:.3g}" for key in keys)
    text = table(
        [],
        [
            ["map", field.grid.name],
            ["estimator", _estimator(field.config)],
            ["cells evaluated", f"{about['cells_evaluated']:,}"],
            ["e, 10 % / median / 90 %", f"{e} {field.e_unit}"],
            ["saturated", f"{about['saturated_share']:.0%} of the cells: e at its least value"],
        ],
    )
    if about["saturated_share"] <= SATURATED:
        return text
    return f"{text}\n{field.config.estimator.remedy}"


def _estimator(config: FieldConfig) -> str:
    headings = "" if config.headings == 1 else f", {config.headings} headings"
    return f"{config.estimator.summary}, range {config.estimator.reach:g} m{headings}"


def fields_table(summaries: Sequence[Mapping[str, Any]]) -> str:
    """The summaries of many fields, one a row, and below them why some failed."""
    rows, errors = [], []
    for about in summaries:
        if about["error"]:
            rows.append([about["map"], "–", "–", "–", "failed"])
            errors.append(f"failed: {about['error']}")
            continue
        e = "–" if about["e_median"] is None else f"{about['e_median']:.3g}"
        cells, saturated = f"{about['cells_evaluated']:,}", f"{about['saturated_share']:.0%}"
        rows.append([about["map"], cells, e, saturated, f"{about['seconds']:.1f} s"])
    return "\n".join([table(["map", "cells", "median e", "saturated", "took"], rows), *errors])


def cache_summary(entries: Sequence[CacheEntry]) -> list[dict[str, Any]]:
    """Cached fields, fit for JSON; times are seconds since the epoch."""
    return [
        {
            "folder": str(entry.folder),
            "map": entry.about.get("map_name"),
            "config": entry.about.get("config"),
            "bytes": entry.size,
            "finished_share": entry.share,
            "computed": entry.computed,
            "used": entry.used,
        }
        for entry in entries
    ]


def cache_table(entries: Sequence[CacheEntry], folder: Path, limit: int) -> str:
    """Cached fields with sizes and ages, and how full the folder is."""
    rows = [
        [
            entry.about.get("map_name", "(damaged)"),
            _unusual(entry.about.get("config", {})),
            in_bytes(entry.size),
            f"{entry.share:.0%}",
            age(entry.computed),
            age(entry.used),
        ]
        for entry in entries
    ]
    total = sum(entry.size for entry in entries)
    count = f"{len(entries)} field{'' if len(entries) == 1 else 's'}"
    last = f"{count}, {in_bytes(total)} of at most {in_bytes(limit)}, in {folder}"
    if not rows:
        return last
    columns = ["map", "config", "size", "finished", "computed", "last used"]
    return f"{table(columns, rows)}\n{last}"


def cleared(removed: Sequence[CacheEntry], busy: Sequence[CacheEntry]) -> str:
    """What became of the fields in the cache, in one line."""
    line = f"removed {len(removed)}, {in_bytes(sum(entry.size for entry in removed))}"
    return line + (f"; being computed, and kept: {len(busy)}" if busy else "")


def plans_summary(plans: Mapping[str, Plan]) -> dict[str, Any]:
    """Plans by name with their metrics and positions [m], fit for JSON."""
    return {
        label: {
            "status": plan.status,
            "planner": plan.planner,
            "start": list(plan.start),
            "goal": list(plan.goal),
            "via": [list(xy) for xy in plan.via],
            "solve_time_s": plan.solve_time,
            "max_e": plan.max_e,
            "budget": plan.budget,
            "footprint": plan.footprint,
            "bound": plan.bound,
            "feasible_from": plan.feasible_from,
            "minimises": plan.minimises,
            "history": plan.history,
            "note": plan.note,
            "metrics": finite(dataclasses.asdict(plan.metrics)) if plan.metrics else None,
            "xy": plan.path.xy.tolist() if plan.path else None,
            "heading": _headings(plan),
        }
        for label, plan in plans.items()
    }


def _headings(plan: Plan) -> list[float] | None:
    if plan.path is None or plan.path.heading is None:
        return None
    return plan.path.heading.tolist()


def plans_table(plans: Mapping[str, Plan], e_unit: str) -> str:
    """The metrics of plans side by side; `e_unit` is `CovarianceField.e_unit`."""
    rows = [["status", *map(_status, plans.values())]]
    for label, name, unit, spec in _METRICS:
        unit = unit.replace("m² rad", e_unit)
        values = [getattr(plan.metrics, name, None) for plan in plans.values()]
        texts = ["–" if value is None else f"{value:{spec}} {unit}" for value in values]
        rows.append([label, *texts])
    notes = [f"{label}: {plan.note}" for label, plan in plans.items() if plan.note]
    return "\n".join([table(["", *plans], rows), *notes])


def _status(plan: Plan) -> str:
    any_path = plan.status == "solved" and not plan.minimises
    return "solved, any path" if any_path else plan.status


def write_plans(
    folder: Path, costs: Costmap, field: CovarianceField, plans: Mapping[str, Plan]
) -> None:
    """Write plan.json, plan.png, and a CSV of positions [m] for each plan that has a path.

    Where the robot's heading matters the CSV holds that, too [rad]. Where a planner improved its
    path there is history.png with its best J over time.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan import plotting

    make_folder(folder)
    for label, plan in plans.items():
        if plan.path and plan.path.heading is not None:
            poses = np.column_stack([plan.path.xy, plan.path.heading])
            write_csv(folder / f"{label}.csv", poses, "x_m,y_m,heading_rad")
        elif plan.path:
            write_csv(folder / f"{label}.csv", plan.path.xy, "x_m,y_m")
        else:
            (folder / f"{label}.csv").unlink(missing_ok=True)
    about = {
        **about_costs(costs),
        "plans": plans_summary(plans),
    }
    with replacing(folder / "plan.json") as temporary:
        temporary.write_text(json.dumps(about, indent=2) + "\n")
    plotting.save_figure(plotting.plan_figure(costs, field, plans), folder / "plan.png")
    if any(len(plan.history) > 1 for plan in plans.values()):
        plotting.save_figure(plotting.history_figure(plans), folder / "history.png")
    else:
        (folder / "history.png").unlink(missing_ok=True)


def export_table(about: Mapping[str, Any]) -> str:
    """What was exported and, of a mask, how exactly a planner will charge it."""
    rows = [["map", str(about["map"])], ["format", str(about["to"])]]
    if "planner" in about:
        parameter = f", {about['parameter']}: {about['value']:.4g}" if about["parameter"] else ""
        rows += [
            ["planner", about["planner"] + parameter],
            ["saturates at weight · u", f"{about['saturates_at_weight_u']:.3f}"],
            ["cells above that", f"{about['saturated_share']:.1%}"],
            ["rounding of weight · u", f"{about['mean_quantisation_error']:.4f} on average"],
            ["", f"{about['largest_quantisation_error']:.4f} at most"],
        ]
    if "nodes" in about:
        rows.append(["nodes, edges", f"{about['nodes']:,}, {about['edges']:,} each way"])
        rows.append(["parts not joined", f"{about['components']:,}"])
    if "length_m" in about:
        rows.append(["length", f"{about['length_m']:.2f} m"])
    return table([], rows)


def front_summary(front: ParetoFront) -> dict[str, Any]:
    """A Pareto front, fit for JSON."""
    return {
        "map": front.costs.grid.name,
        "start": list(front.start),
        "goal": list(front.goal),
        "objective": front.objective,
        "epsilon": front.epsilon,
        "labels": front.labels,
        "solve_time_s": front.solve_time,
        "knee": front.knee if len(front) else None,
        "length_m": front.length.tolist(),
        "integral": front.integral.tolist(),
    }


def front_table(front: ParetoFront, e_unit: str) -> str:
    """Up to twelve points of a front with what each metre more saves, the knee marked."""
    if not len(front):
        return "unreachable: no path leads to the goal"
    unit = "m" if front.objective == "u" else f"{e_unit} m"
    wanted = np.linspace(front.length[0], front.length[-1], 12)
    shown = np.abs(front.length[:, None] - wanted).argmin(axis=0)
    rows = []
    for index in sorted({*map(int, shown), front.knee}):
        longer = front.length[index] / front.length[0] - 1
        rows.append(
            [
                str(index),
                f"{front.length[index]:.2f} m",
                f"+{longer:.1%}",
                f"{front.integral[index]:.4g} {unit}",
                "knee" if index == front.knee else "",
            ]
        )
    how = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%} of every path"
    last = f"{len(front)} paths, {how}; {front.labels:,} labels, {front.solve_time:.2f} s"
    columns = ["path", "length", "longer", f"∫{front.objective} ds", ""]
    return f"{table(columns, rows)}\n{last}"


def write_front(folder: Path, front: ParetoFront, field: CovarianceField) -> None:
    """Write front.json, front.csv, front.png, and a CSV of the positions [m] at the knee.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan import plotting

    make_folder(folder)
    about = front_summary(front) | {
        **about_costs(front.costs.with_weight(0.0)),
    }
    with replacing(folder / "front.json") as temporary:
        temporary.write_text(json.dumps(about, indent=2) + "\n")
    header = f"length_m,integral_{front.objective}"
    write_csv(folder / "front.csv", np.column_stack([front.length, front.integral]), header)
    if len(front):
        path = front.plan(front.knee).path
        assert path is not None
        write_csv(folder / "knee.csv", path.xy, "x_m,y_m")
        figure = plotting.front_figure(front, field.e_unit)
        plotting.save_figure(figure, folder / "front.png")
    else:
        for name in ("knee.csv", "front.png"):
            (folder / name).unlink(missing_ok=True)


def _unusual(config: Mapping[str, Any]) -> str:
    """The settings that are not the default ones."""
    usual = FieldConfig().to_json()
    return ", ".join(f"{k}={v}" for k, v in config.items() if usual.get(k, v) != v) or "default"

"""Fields and plans as tables, as JSON, and as a folder of files."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan.cache import CacheEntry
from locplan.config import FieldConfig
from locplan.costmap import Costmap
from locplan.field import CovarianceField
from locplan.files import make_folder, replacing
from locplan.metrics import DEGRADED
from locplan.planners import Plan

_METRICS = (
    ("length", "length", "m", ".2f"),
    ("cost J", "cost", "m", ".2f"),
    ("blind, ∫u ds", "integrated_u", "m", ".2f"),
    ("∫e ds", "integrated_e", "m² rad m", ".3g"),
    ("mean e", "mean_e", "m² rad", ".3g"),
    ("greatest e", "max_e", "m² rad", ".3g"),
    (f"share with u > {DEGRADED:g}", "degraded_share", "", ".0%"),
    (f"longest with u > {DEGRADED:g}", "longest_degraded", "m", ".2f"),
    ("least clearance", "clearance", "m", ".2f"),
)
"""Rows of a table of plans: label, field of `PathMetrics`, unit and format."""


def field_summary(field: CovarianceField) -> dict[str, Any]:
    """How many cells were evaluated, and how e is distributed over them [m^2 rad]."""
    e = field.e[field.evaluated]
    low, median, high = np.percentile(e, (10, 50, 90)) if e.size else (math.nan,) * 3
    return _finite(
        {
            "map": field.grid.name,
            "config": dataclasses.asdict(field.config),
            "cells_evaluated": int(e.size),
            "e_percentile_10": float(low),
            "e_median": float(median),
            "e_percentile_90": float(high),
            "saturated_share": field.saturated_share,
        }
    )


def field_table(field: CovarianceField) -> str:
    """The summary of a field for people."""
    about = field_summary(field)
    keys = "e_percentile_10", "e_median", "e_percentile_90"
    e = " / ".join("–" if about[key] is None else f"{about[key]:.3g}" for key in keys)
    return _table(
        [],
        [
            ["map", field.grid.name],
            ["cells evaluated", f"{about['cells_evaluated']:,}"],
            ["e, 10 % / median / 90 %", f"{e} {field.e_unit}"],
            ["saturated", f"{about['saturated_share']:.0%} of the cells: e at its least value"],
        ],
    )


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
    return "\n".join([_table(["map", "cells", "median e", "saturated", "took"], rows), *errors])


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
            _bytes(entry.size),
            f"{entry.share:.0%}",
            _age(entry.computed),
            _age(entry.used),
        ]
        for entry in entries
    ]
    total = sum(entry.size for entry in entries)
    count = f"{len(entries)} field{'' if len(entries) == 1 else 's'}"
    last = f"{count}, {_bytes(total)} of at most {_bytes(limit)}, in {folder}"
    if not rows:
        return last
    columns = ["map", "config", "size", "finished", "computed", "last used"]
    return f"{_table(columns, rows)}\n{last}"


def cleared(removed: Sequence[CacheEntry], busy: Sequence[CacheEntry]) -> str:
    """What became of the fields in the cache, in one line."""
    line = f"removed {len(removed)}, {_bytes(sum(entry.size for entry in removed))}"
    return line + (f"; {len(busy)} are being computed and stay" if busy else "")


def plans_summary(plans: Mapping[str, Plan]) -> dict[str, Any]:
    """Plans by name with their metrics and positions [m], fit for JSON."""
    return {
        label: {
            "status": plan.status,
            "planner": plan.planner,
            "start": list(plan.start),
            "goal": list(plan.goal),
            "solve_time_s": plan.solve_time,
            "metrics": _finite(dataclasses.asdict(plan.metrics)) if plan.metrics else None,
            "xy": plan.path.xy.tolist() if plan.path else None,
        }
        for label, plan in plans.items()
    }


def plans_table(plans: Mapping[str, Plan], e_unit: str) -> str:
    """The metrics of plans side by side; `e_unit` is `CovarianceField.e_unit`."""
    rows = [["status", *(plan.status for plan in plans.values())]]
    for label, name, unit, spec in _METRICS:
        unit = unit.replace("m² rad", e_unit)
        values = [getattr(plan.metrics, name, None) for plan in plans.values()]
        texts = ["–" if value is None else f"{value:{spec}} {unit}" for value in values]
        rows.append([label, *texts])
    return _table(["", *plans], rows)


def write_plans(
    folder: Path, costs: Costmap, field: CovarianceField, plans: Mapping[str, Plan]
) -> None:
    """Write plan.json, plan.png, and a CSV of positions [m] for each plan that has a path.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan import plotting

    make_folder(folder)
    for label, plan in plans.items():
        if plan.path:
            with replacing(folder / f"{label}.csv") as temporary:
                np.savetxt(
                    temporary, plan.path.xy, "%.4f", delimiter=",", header="x_m,y_m", comments=""
                )
        else:
            (folder / f"{label}.csv").unlink(missing_ok=True)
    about = {
        "locplan": __version__,
        "map": {"name": costs.grid.name, "digest": costs.grid.digest},
        "config": dataclasses.asdict(field.config),
        "weight": costs.weight,
        "robot_radius": costs.robot_radius,
        "plans": plans_summary(plans),
    }
    with replacing(folder / "plan.json") as temporary:
        temporary.write_text(json.dumps(about, indent=2) + "\n")
    plotting.save_figure(plotting.plan_figure(costs, field, plans), folder / "plan.png")


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """JSON knows neither NaN nor infinity: null stands for both."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, box=box.SIMPLE if columns else None, show_header=bool(columns))
    for row in rows:
        table.add_row(*row)
    console = Console()
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines() if line.strip())


def _unusual(config: Mapping[str, Any]) -> str:
    """The settings that are not the default ones."""
    usual = dataclasses.asdict(FieldConfig())
    return ", ".join(f"{k}={v}" for k, v in config.items() if usual.get(k, v) != v) or "default"


def _bytes(size: float) -> str:
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:,.3g} GB"


def _age(moment: float) -> str:
    seconds = max(0.0, time.time() - moment)
    for size, unit in ((86400, "d"), (3600, "h"), (60, "min")):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit} ago"
    return "just now"

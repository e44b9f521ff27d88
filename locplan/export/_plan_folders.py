"""Plans and fronts as folders of files, with their pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from locplan._util.files import make_folder, replacing
from locplan._util.tables import write_csv
from locplan.costs import Costmap, about_costs
from locplan.field import CovarianceField
from locplan.planners import ParetoFront, Plan
from locplan.planners._summary import front_summary, plans_summary


def write_plans(
    folder: Path, costs: Costmap, field: CovarianceField, plans: Mapping[str, Plan]
) -> None:
    """Write plan.json, plan.png, and a CSV of positions [m] for each plan that has a path.

    Where the robot's heading matters, the CSV holds it, too [rad]. Where a planner improved its
    path, history.png shows its best J over time.
    """
    from locplan import plotting

    make_folder(folder)
    for label, plan in plans.items():
        if plan.path:
            plan.path.save(folder / f"{label}.csv")
        else:
            (folder / f"{label}.csv").unlink(missing_ok=True)
    _write_json(folder / "plan.json", about_costs(costs) | {"plans": plans_summary(plans)})
    plotting.save_figure(plotting.plan_figure(costs, field, plans), folder / "plan.png")
    if any(len(plan.history) > 1 for plan in plans.values()):
        plotting.save_figure(plotting.history_figure(plans), folder / "history.png")
    else:
        (folder / "history.png").unlink(missing_ok=True)


def write_front(folder: Path, front: ParetoFront, field: CovarianceField) -> None:
    """Write front.json, front.csv, front.png, and a CSV of the positions [m] at the knee."""
    from locplan import plotting

    make_folder(folder)
    about = front_summary(front) | about_costs(front.costs.with_weight(0.0))
    _write_json(folder / "front.json", about)
    header = f"length_m,integral_{front.objective}"
    write_csv(folder / "front.csv", np.column_stack([front.length, front.integral]), header)
    if len(front):
        path = front.plan(front.knee).path
        assert path is not None
        path.save(folder / "knee.csv")
        plotting.save_figure(plotting.front_figure(front, field.e_unit), folder / "front.png")
    else:
        for name in ("knee.csv", "front.png"):
            (folder / name).unlink(missing_ok=True)


def _write_json(file: Path, about: Mapping[str, object]) -> None:
    with replacing(file) as temporary:
        temporary.write_text(json.dumps(about, indent=2) + "\n")

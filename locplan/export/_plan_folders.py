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

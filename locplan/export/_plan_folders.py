"""Plans and fronts as folders of files, with their pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from locplan._util.results import ResultFolder, Results
from locplan._util.tables import write_csv
from locplan.costs import Costmap, about_costs
from locplan.field import CovarianceField
from locplan.planners import AWARE, SHORTEST, ParetoFront, Plan, front_summary, plans_summary

if TYPE_CHECKING:
    from locplan.simulation import Verdict

PLAN_FILES = Results("plan", ("plan.json", "plan.png", f"{SHORTEST}.csv", f"{AWARE}.csv"))
"""Files of plans, which `write_plans` writes."""
FRONT_FILES = Results("pareto", ("front.json", "front.csv", "front.png", "knee.csv"))
"""Files of a Pareto front, which `write_front` writes."""


def write_plans(
    results: ResultFolder,
    costs: Costmap,
    field: CovarianceField,
    plans: Mapping[str, Plan],
    verdict: Verdict | None,
    said: str,
) -> None:
    """Write plan.json, plan.png, and a CSV of positions [m] for each plan that has a path.

    Where the robot's heading matters, the CSV holds it, too [rad]. Where a planner improved its
    path, history.png shows its best J over time.

    Parameters
    ----------
    results : ResultFolder
        The folder, from ``PLAN_FILES.into(folder)``, which checks it before the work.
    costs : Costmap
        Costmap on which the paths were planned.
    field : CovarianceField
        The map's field.
    plans : mapping of str to Plan
        The plans by label.
    verdict : Verdict or None
        What is recommended; None if nothing was driven.
    said : str
        The verdict as the picture tells it, or why there is none.

    Raises
    ------
    LocplanError
        If a file cannot be written.
    """
    from locplan import plotting

    with results.writing() as folder:
        for label, plan in plans.items():
            if plan.path:
                plan.path.save(folder / f"{label}.csv")
        about = about_costs(costs) | {"plans": plans_summary(plans)}
        about["verdict"] = verdict.summary() if verdict else None
        (folder / "plan.json").write_text(json.dumps(about, indent=2) + "\n")
        best = verdict.recommended if verdict else None
        figure = plotting.plan_figure(costs, field, plans, recommended=best, verdict=said)
        plotting.save_figure(figure, folder / "plan.png")
        if any(len(plan.history) > 1 for plan in plans.values()):
            plotting.save_figure(plotting.history_figure(plans), folder / "history.png")


def write_front(results: ResultFolder, front: ParetoFront, field: CovarianceField) -> None:
    """Write front.json, front.csv, front.png, and a CSV of the positions [m] at the knee.

    Parameters
    ----------
    results : ResultFolder
        The folder, from ``FRONT_FILES.into(folder)``, which checks it before the work.
    front : ParetoFront
        The front.
    field : CovarianceField
        The map's field.

    Raises
    ------
    LocplanError
        If a file cannot be written.
    """
    from locplan import plotting

    with results.writing() as folder:
        about = front_summary(front) | about_costs(front.costs.with_weight(0.0))
        (folder / "front.json").write_text(json.dumps(about, indent=2) + "\n")
        header = f"length_m,integral_{front.objective}"
        both = np.column_stack([front.length, front.integral])
        # All digits: a budget that is copied from here must not lie below the path's integral.
        write_csv(folder / "front.csv", both, header, "%.17g")
        if len(front):
            path = front.plan(front.knee).path
            assert path is not None
            path.save(folder / "knee.csv")
            plotting.save_figure(plotting.front_figure(front, field.e_unit), folder / "front.png")

"""Fake runs of a comparison, and real runs in a room."""

from __future__ import annotations

import dataclasses
import math
import pickle

import numpy as np

from locplan.comparison import Execution, compare
from locplan.comparison.statistics import PlannerRun, RunTask
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Query


def fake_runs(
    factors, queries=12, maps=("rooms", "office"), weights=(4.0,), seeds=3, noise=0.02, rng=0
) -> list[PlannerRun]:
    """Runs whose J is the planner's factor times the query's; "anytime" planners have seeds."""
    random = np.random.default_rng(rng)
    runs = []
    for map_name in maps:
        for weight in weights:
            for query in range(queries):
                base = float(np.exp(random.normal(3, 0.5)))
                for planner, factor in factors.items():
                    drawn = planner.startswith("anytime")
                    for seed in range(1, seeds + 1) if drawn else (0,):
                        cost = base * factor * float(np.exp(random.normal(0, noise)))
                        task = RunTask(map_name, "6 m", f"q{query}", weight, planner, seed)
                        runs.append(solved_run(task, cost, drawn))
    return runs


def solved_run(task: RunTask, cost: float, anytime: bool = False, **measures) -> PlannerRun:
    values = {"cost": cost, "length": 0.8 * cost, "integrated_u": 0.05 * cost, "turning": 0.0}
    values |= {"degenerate_share": 0.2, "clearance": 0.3, **measures}
    seconds = 2.0 if anytime else 0.03
    history = ((0.1, 1.5 * cost), (0.5, 1.2 * cost), (1.0, cost)) if anytime else ()
    return PlannerRun(task, "solved", seconds, seconds + 0.1, values, history)


def failed_run(task: RunTask, status: str = "timeout") -> PlannerRun:
    return PlannerRun(task, status, 2.0, 2.1, note="nothing found")


QUERIES = [Query("there", (1.5, 1.5), (14.5, 10.5)), Query("back", (14.5, 10.5), (1.5, 1.5))]


def room_with_door(*, door: bool = True) -> Costmap:
    cells = np.full((12, 16), FREE, np.uint8)
    cells[: 8 if door else 12, 8] = OCCUPIED
    u = np.linspace(0.0, 0.9, cells.size).reshape(cells.shape)
    costs = Costmap.from_density(OccupancyGrid(cells, 1.0, name="room"), 1.0 + u)
    return dataclasses.replace(costs, u=u, e=u / 10, weight=1.0)


def run_comparison(planners, queries=QUERIES, *, costs=None, weights=None, seeds=(1,), **execution):
    """The runs of a comparison in a room."""
    settings = {"weights": weights, "seeds": seeds, "execution": Execution(**execution)}
    maps = {"room": room_with_door() if costs is None else costs}
    return list(compare(maps, planners, queries, **settings).runs)


class InlineWorkers:
    """Workers of a comparison in this process; planners are pickled as for processes."""

    def __init__(self, planners, count, **_):
        import cloudpickle

        self.planners = pickle.loads(cloudpickle.dumps(list(planners)))

    def __enter__(self):
        for spec in self.planners:
            spec.planner.prepare()
        return self

    def __exit__(self, *_):
        pass

    def perform_jobs(self, jobs):
        from locplan.comparison.runs import perform_job

        for job in jobs:
            run = perform_job(self.planners[job.planner], job, math.inf)
            yield dataclasses.replace(run, wall_seconds=run.seconds)

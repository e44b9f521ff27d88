"""Runs as a comparison would give them."""

from __future__ import annotations

import numpy as np

from locplan.comparison.statistics import Run, Task


def made_up(
    factors, queries=12, maps=("rooms", "office"), weights=(4.0,), seeds=3, noise=0.02, rng=0
) -> list[Run]:
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
                        task = Task(map_name, "6 m", f"q{query}", weight, planner, seed)
                        runs.append(solved(task, cost, drawn))
    return runs


def solved(task: Task, cost: float, anytime: bool = False, **measures) -> Run:
    values = {"cost": cost, "length": 0.8 * cost, "integrated_u": 0.05 * cost, "turning": 0.0}
    values |= {"degenerate_share": 0.2, "clearance": 0.3, **measures}
    seconds = 2.0 if anytime else 0.03
    history = ((0.1, 1.5 * cost), (0.5, 1.2 * cost), (1.0, cost)) if anytime else ()
    return Run(task, "solved", seconds, seconds + 0.1, values, history)


def failed(task: Task, status: str = "timeout") -> Run:
    return Run(task, status, 2.0, 2.1, note="nothing found")

"""One run of a planner: its outcome, whatever the planner does, within a limit of memory."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from locplan.comparison._orders import Order, weighted_costmap
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import MEASURES, Run, Task
from locplan.costs import Costmap, Path as Route
from locplan.errors import LocplanError
from locplan.planners import Plan, path_faults


def perform(planner: PlannerSpec, order: Order, memory: float) -> Run:
    """Make one run within a limit of memory [bytes]; an exception of the planner is a result."""
    began = time.perf_counter()
    try:
        costs = weighted_costmap(order.costs, order.task.weight)
        with limited_memory(memory):
            result = planner.plan(costs, order.start, order.goal, order.task.seed)
    except MemoryError as error:
        status, note = "out of memory", str(error) or "the planner ran out of memory"
    except LocplanError as error:
        status, note = "error", str(error)
    except BaseException as error:  # sys.exit in a planner shall not end the comparison
        status, note = "error", f"{type(error).__name__}: {error}"
    else:
        run = run_of(order.task, result)
        return dataclasses.replace(run, note=undriven(costs, result.path) or run.note)
    elapsed = time.perf_counter() - began
    return Run(order.task, status, elapsed, elapsed, note=(note.splitlines() or [""])[0])


def run_of(task: Task, result: Plan) -> Run:
    """A plan as a run; the caller measures the wall time and adds it."""
    seconds, path = float(result.solve_time), result.path
    found: dict[str, Any] = {}
    if path is not None:
        names = [name for name in MEASURES if name not in ("seconds", "turning")]
        known = {name: float(getattr(result.metrics, name, math.nan)) for name in names}
        history = ((float(at), float(cost)) for at, cost in result.history)
        found["measures"] = known | {"turning": turning(path)}
        found["history"] = tuple(point for point in history if math.isfinite(sum(point)))
        found["xy"] = tuple(map(tuple, path.xy.tolist()))
    expanded = None if result.expanded is None else int(result.expanded)
    about = {"note": str(result.note or ""), "expanded": expanded, **found}
    return Run(task, str(result.status), seconds, seconds, **about)


def undriven(costs: Costmap, path: Route | None) -> str:
    """Why a robot with an outline or a turning radius cannot drive a path; empty where it can."""
    robot = costs.robot
    if path is None or robot is None or not (robot.outline or robot.kinematics.turning_radius):
        return ""
    faults = path_faults(costs.grid, path, robot)
    found = [f"{each.kind} near {each.x:.2f},{each.y:.2f}" for each in faults]
    return f"{Run.undriven}: {found[0]}" if found else ""


def turning(path: Route) -> float:
    """The sum of all changes of direction along a path [rad].

    >>> round(turning(Route(np.array([(0, 0), (1, 0), (1, 1), (1, 1), (0, 1)]))), 4)
    3.1416
    """
    steps = np.diff(path.xy, axis=0)
    steps = steps[steps.any(axis=1)]
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))).sum())


def forbid_core_files() -> None:
    """Let a crash of this process leave no file, where the system has such limits."""
    with suppress(ModuleNotFoundError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@contextmanager
def limited_memory(extra: float) -> Iterator[None]:
    """Limit the memory that this process may take in addition [bytes], on Linux."""
    used = _data_size()
    try:
        import resource
    except ModuleNotFoundError:
        used = 0  # Windows has no such limits
    if not used or not math.isfinite(extra):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    soft, hard = used + int(extra), before[1]
    soft = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int:
    """The memory that counts against the limit: private and writable, touched or not [bytes]."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)

"""Planners on a costmap, all through `plan`."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from locplan.costmap import Costmap
from locplan.errors import ConfigError
from locplan.metrics import PathMetrics, path_metrics
from locplan.path import Path

_MODULES = {"grid": "locplan.planners.grid"}
"""Where each planner's `solve` is; imported when first used."""


@dataclass(frozen=True)
class Plan:
    """What a planner returned."""

    status: Literal["solved", "unreachable"]
    """Whether there is a path; a goal that cannot be reached is a result, not an error."""
    planner: str
    """The planner's name."""
    start: tuple[float, float]
    """World position [m]."""
    goal: tuple[float, float]
    """World position [m]."""
    path: Path | None
    """The path from start to goal, or None."""
    metrics: PathMetrics | None
    """What the path costs, or None."""
    solve_time: float
    """Time spent planning, without compilation [s]."""

    def measured_on(self, costs: Costmap) -> Plan:
        """The same path with its metrics on another costmap of the same map."""
        if self.path is None:
            return self
        return dataclasses.replace(self, metrics=path_metrics(costs, self.path))


def names() -> tuple[str, ...]:
    """The planners that `plan` knows."""
    return tuple(_MODULES)


def check_planner(name: str) -> None:
    """Raise a ConfigError unless `plan` knows the planner."""
    if name not in _MODULES:
        raise ConfigError(f"planner must be one of {', '.join(names())}, not {name!r}")


def check_ends(costs: Costmap, start: tuple[float, float], goal: tuple[float, float]) -> None:
    """Raise a PoseError, with the nearest free position, unless the robot can stand at both."""
    costs.cell_of(start, "start")
    costs.cell_of(goal, "goal")


def plan(
    costs: Costmap,
    start: tuple[float, float],
    goal: tuple[float, float],
    *,
    planner: str = "grid",
    **options: Any,
) -> Plan:
    """Plan a path of least cost J.

    Parameters
    ----------
    costs : Costmap
        What travel costs.
    start, goal : (x, y)
        World positions [m].
    planner : str
        One of `names`.
    **options
        Of the planner: see the `solve` function of its module.

    Returns
    -------
    Plan
        With status "unreachable" if no path joins start and goal.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If the planner or an option is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.grid import FREE, OccupancyGrid
    >>> grid = OccupancyGrid(np.full((4, 4), FREE), resolution=1.0)
    >>> result = plan(Costmap.from_density(grid, np.ones((4, 4))), (0.5, 0.5), (3.5, 2.5))
    >>> result.path.xy.tolist()
    [[0.5, 0.5], [1.5, 1.5], [2.5, 1.5], [3.5, 2.5]]
    >>> round(result.metrics.cost, 3)
    3.828
    """
    check_planner(planner)
    check_ends(costs, start, goal)
    module = import_module(_MODULES[planner])
    module.prepare()
    solve = module.solve
    unknown = sorted(set(options) - set(solve.__kwdefaults__ or {}))
    if unknown:
        known = ", ".join(solve.__kwdefaults__ or {}) or "none"
        raise ConfigError(f"planner {planner!r} has no option {unknown[0]!r}; it has: {known}")
    started = time.perf_counter()
    path = solve(costs, start, goal, **options)
    elapsed = time.perf_counter() - started
    if path is None:
        return Plan("unreachable", planner, start, goal, None, None, elapsed)
    return Plan("solved", planner, start, goal, path, path_metrics(costs, path), elapsed)

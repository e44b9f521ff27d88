"""Planners of the user's own, which cannot change the costmap that measures their paths."""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias, get_args

import numpy as np

from locplan._util.checks import is_whole, shown
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import LocplanError
from locplan.planners._protocol import Found, Position, Status, Wrapper
from locplan.planners._registry import check_names
from locplan.planners._result import Plan

PlannerFunction: TypeAlias = Callable[..., Plan | Path | Found]
"""A function ``f(costs, start, goal, **options)`` that returns a path, a `Found` or a `Plan`."""


@dataclass(frozen=True)
class FunctionPlanner:
    """A planner written as a function ``f(costs, start, goal, **options)``.

    The function returns a `Path`, a `Found` or a `Plan`. If it has an attribute ``prepare``, that
    is called before anything is timed, so that it can compile there.
    """

    function: PlannerFunction
    """The function that plans."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Keyword arguments that the function is called with; none by default."""
    minimises: ClassVar[str] = "J"

    @property
    def name(self) -> str:
        """The function's name."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    @property
    def space(self) -> str:
        """The function's option "space", or "R2"."""
        return str(self.options.get("space", "R2"))

    @property
    def parameters(self) -> list[str]:
        """The names of the function's options."""
        every = list(inspect.signature(self.function).parameters.values())[3:]
        return [one.name for one in every if one.kind is not one.VAR_KEYWORD]

    def check(self) -> None:
        """Raise a ConfigError unless the function takes the options."""
        every = inspect.signature(self.function).parameters.values()
        if not any(one.kind is one.VAR_KEYWORD for one in every):
            check_names(f"planner {shown(self.name)}", self.options, self.parameters)

    def prepare(self) -> None:
        """Call the function's own ``prepare``, if it has one."""
        getattr(self.function, "prepare", lambda: None)()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Call the function and return what it found. See `locplan.planners.Planner.solve`."""
        result = self.function(costs, start, goal, **self.options)
        if isinstance(result, Path):
            return Found(result)
        if isinstance(result, Plan):
            names = [one.name for one in dataclasses.fields(Found)]
            return Found(**{name: getattr(result, name) for name in names})
        return result


class Guarded(Wrapper):
    """A user's planner that gets a costmap of its own, and whose path is checked."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan on a copy of the costmap, not timing the copying, and check what is returned.

        See `locplan.planners.Planner.solve`.

        Raises
        ------
        LocplanError
            If the planner returns something else than a path that can be driven, or a reason.
        """
        own = costs.copy()
        began = time.perf_counter()
        found = self.planner.solve(own, start, goal)
        elapsed = time.perf_counter() - began
        _check_sound(found, costs, start, goal)
        reported = found.solve_time
        plausible = reported is not None and 0 <= reported <= elapsed
        return found if plausible else dataclasses.replace(found, solve_time=elapsed)


def _check_sound(found: object, costs: Costmap, start: Position, goal: Position) -> None:
    """Raise a LocplanError unless what a planner returned can be driven."""
    statuses = get_args(Status)
    if not isinstance(found, Found) or found.status not in statuses:
        raise LocplanError(
            "the planner must return a locplan.Plan, Path or planners.Found with a status of"
            f" {', '.join(statuses)}, not {type(found).__name__}"
        )
    if found.expanded is not None and not is_whole(found.expanded):
        raise LocplanError(
            f"the planner's number of expanded cells must be whole, not {shown(found.expanded)}"
        )
    if found.path is None:
        if found.status == "solved":
            raise LocplanError("the planner says it has solved the query, but returned no path")
        return
    apart = np.hypot(*(found.path.xy[[0, -1]] - np.array([start[:2], goal[:2]])).T)
    if apart.max() > 1.5 * costs.grid.resolution:
        raise LocplanError("the planner's path does not lead from start to goal")
    if not np.isfinite(path_metrics(costs, found.path).cost):
        raise LocplanError("the planner's path enters cells where the robot cannot be")

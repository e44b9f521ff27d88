"""Make a planner from a caller's request: a name, a function or an object, with limits.

Planners of the user cannot change the costmap that measures their paths.
"""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import is_integer, short_repr
from locplan.errors import ConfigError, LocplanError
from locplan.planning.costmap import Costmap
from locplan.planning.limits import LimitedPlanner
from locplan.planning.metrics import path_metrics
from locplan.planning.pareto import BudgetPlanner
from locplan.planning.path import Path
from locplan.planning.protocol import Planner, PlannerResult, PlannerWrapper, Position, Status
from locplan.planning.registry import check_option_names, planner_from_name, read_option_defaults
from locplan.planning.results import Plan
from locplan.planning.robot_fit import default_planner
from locplan.robots.parts import Footprint
from locplan.robots.robot import Robot

PlannerFunction: TypeAlias = Callable[..., Plan | Path | PlannerResult]
"""A function ``f(costs, start, goal, **options)`` that returns a path, an (n, 2) or (n, 3) array of
its positions, a `PlannerResult` or a `Plan`."""
AnyPlanner: TypeAlias = str | Planner | PlannerFunction
"""A planner as a caller may give it."""


@dataclass(frozen=True)
class FunctionPlanner:
    """A planner written as a function ``f(costs, start, goal, **options)``.

    The function returns a `Path`, an (n, 2) or (n, 3) array, a `PlannerResult` or a `Plan`. If
    it has an attribute ``prepare``, that is called before anything is timed, so that it can compile
    there.
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
        arguments = list(inspect.signature(self.function).parameters.values())[3:]
        return [
            parameter.name for parameter in arguments if parameter.kind is not parameter.VAR_KEYWORD
        ]

    def check(self) -> None:
        """Raise a ConfigError unless the function takes the options."""
        arguments = inspect.signature(self.function).parameters.values()
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in arguments):
            check_option_names(f"planner {short_repr(self.name)}", self.options, self.parameters)

    def prepare(self) -> None:
        """Call the function's attribute ``prepare``, if it has one."""
        getattr(self.function, "prepare", lambda: None)()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Call the function and return its result. See `locplan.planning.Planner.solve`."""
        result = self.function(costs, start, goal, **self.options)
        if isinstance(result, np.ndarray | list):
            result = _path_from_array(result)
        if isinstance(result, Path):
            return PlannerResult(result)
        if isinstance(result, Plan):
            return PlannerResult(
                path=result.path,
                status=result.status,
                note=result.note,
                history=result.history,
                bound=result.bound,
                feasible_from=result.feasible_from,
                expanded=result.expanded,
                solve_time=result.solve_time,
            )
        return result


def _path_from_array(positions: ArrayLike) -> Path:
    """Return the path of an (n, 2) array of positions, or (n, 3) of poses."""
    array = np.asarray(positions)
    has_headings = array.ndim == 2 and array.shape[1] == 3
    return Path(array[:, :2], array[:, 2]) if has_headings else Path(array)


class CheckedPlanner(PlannerWrapper):
    """A user's planner that gets a copy of the costmap, and whose path is checked."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan on a copy of the costmap, check the result, and leave the copying out of the time.

        See `locplan.planning.Planner.solve`.

        Raises
        ------
        LocplanError
            If the planner returns neither a drivable path nor a reason why there is none.
        """
        costs_copy = costs.copy()
        began = time.perf_counter()
        planner_result = self.planner.solve(costs_copy, start, goal)
        elapsed = time.perf_counter() - began
        _check_planner_result(planner_result, costs, start, goal)
        planner_result = dataclasses.replace(planner_result, note=str(planner_result.note or ""))
        reported = planner_result.solve_time
        plausible = reported is not None and 0 <= reported <= elapsed
        return (
            planner_result if plausible else dataclasses.replace(planner_result, solve_time=elapsed)
        )


def _check_planner_result(
    planner_result: object, costs: Costmap, start: Position, goal: Position
) -> None:
    """Raise a LocplanError unless a planner's result can be driven."""
    statuses = get_args(Status)
    if not isinstance(planner_result, PlannerResult) or planner_result.status not in statuses:
        raise LocplanError(
            "the planner must return a locplan.Path, an array of positions, a Plan or a"
            f" planning.PlannerResult with a status of {', '.join(statuses)}, not"
            f" {type(planner_result).__name__}"
        )
    if planner_result.expanded is not None and not is_integer(planner_result.expanded):
        raise LocplanError(
            "the planner's number of expanded cells must be whole, not"
            f" {short_repr(planner_result.expanded)}"
        )
    if planner_result.path is None:
        if planner_result.status == "solved":
            raise LocplanError('the planner returned the status "solved" without a path')
        return
    end_offsets = np.hypot(*(planner_result.path.xy[[0, -1]] - np.array([start[:2], goal[:2]])).T)
    if end_offsets.max() > 1.5 * costs.grid.resolution:
        raise LocplanError("the planner's path does not lead from start to goal")
    if not np.isfinite(path_metrics(costs, planner_result.path).cost):
        raise LocplanError("the planner's path enters cells where the robot cannot be")


def make_planner(
    planner: AnyPlanner | None = None,
    options: Mapping[str, Any] | None = None,
    *,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    budget: float | None = None,
    footprint: Footprint | ArrayLike | None = None,
    robot: Robot | None = None,
) -> Planner:
    """Make the planner, with its options and limits, that `locplan.plan` uses for these arguments.

    Parameters
    ----------
    planner : str, function or Planner, optional
        The planner; by default "grid" with a budget, otherwise the one for the robot.
    options : mapping of str to object, optional
        The planner's options by name, by default all defaults.
    via, max_e, budget, footprint
        Limits that a path must keep; see `locplan.plan`. By default there are none.
    robot : Robot, optional
        The robot of the costmap, which decides the default: "lattice" if it has an outline or a
        turning radius, otherwise "any-angle".

    Returns
    -------
    Planner
        The planner, checked. A planner of the user is wrapped in `CheckedPlanner`.

    Raises
    ------
    ConfigError
        If there is no such planner, or the options and limits do not go together.

    Examples
    --------
    >>> make_planner("any-angle", {"accuracy": "high"})
    AnyAngle(accuracy='high', allow_corner_cutting=False)
    """
    options, stops, outline = options or {}, tuple(via), parse_footprint(footprint)
    if budget is None:
        new_planner = _resolve_planner(
            default_planner(robot) if planner is None else planner, options
        )
    else:
        if planner not in (None, "grid") or stops or outline is not None or max_e is not None:
            raise ConfigError("a budget is for planner 'grid', without via, footprint and max_e")
        budget_options = [name for name in read_option_defaults(BudgetPlanner) if name != "budget"]
        check_option_names("a budget", options, budget_options)
        new_planner = BudgetPlanner(budget, **options)
    if stops or outline is not None or max_e is not None:
        new_planner = LimitedPlanner(new_planner, stops, outline, max_e)
    new_planner.check()
    return new_planner


def parse_footprint(footprint: Footprint | ArrayLike | None) -> Footprint | None:
    """Return a footprint that is given as one or by its corners."""
    if footprint is None or isinstance(footprint, Footprint):
        return footprint
    return Footprint(np.asarray(footprint))


def has_option(planner: Planner, option: str) -> bool:
    """Return whether a planner has an option of this name.

    Parameters
    ----------
    planner : Planner
        The planner.
    option : str
        Name of an option, such as "seed".
    """
    inner = unwrap_planner(planner)
    option_names = (
        inner.parameters
        if isinstance(inner, FunctionPlanner)
        else read_option_defaults(type(inner))
    )
    return option in option_names


def unwrap_planner(planner: Planner) -> Planner:
    """Return the planner without its limits.

    Parameters
    ----------
    planner : Planner
        A planner as `make_planner` makes it.
    """
    while isinstance(planner, PlannerWrapper):
        planner = planner.planner
    return planner


def user_planner(planner: Planner) -> Planner | None:
    """Return the user's planner without its limits, or None if it is one of locplan's.

    Parameters
    ----------
    planner : Planner
        A planner as `make_planner` makes it.
    """
    while isinstance(planner, PlannerWrapper) and not isinstance(planner, CheckedPlanner):
        planner = planner.planner
    return planner.planner if isinstance(planner, CheckedPlanner) else None


def find_changed_options(planner: Planner) -> dict[str, Any]:
    """Return the options and limits of a planner that differ from their defaults.

    Parameters
    ----------
    planner : Planner
        The planner.

    Returns
    -------
    dict of str to object
        Their values by name; all options of a function.
    """
    if isinstance(planner, FunctionPlanner):
        return dict(planner.options)
    inner = find_changed_options(planner.planner) if isinstance(planner, PlannerWrapper) else {}
    defaults = read_option_defaults(type(planner))
    differences = {
        name: getattr(planner, name)
        for name in defaults
        if getattr(planner, name) != defaults[name]
    }
    return inner | differences


def with_options(planner: Planner, **options: Any) -> Planner:
    """Return a copy of a planner with new options.

    Parameters
    ----------
    planner : Planner
        The planner.
    **options
        New values of some options; the rest stays.

    Raises
    ------
    ConfigError
        If the planner does not have one of them.
    """
    if isinstance(planner, PlannerWrapper):
        return dataclasses.replace(planner, planner=with_options(planner.planner, **options))
    if isinstance(planner, FunctionPlanner):
        return dataclasses.replace(planner, options={**planner.options, **options})
    check_option_names(
        f"planner {short_repr(planner.name)}", options, read_option_defaults(type(planner))
    )
    return dataclasses.replace(planner, **options) if options else planner  # type: ignore[type-var]


def _resolve_planner(planner: AnyPlanner, options: Mapping[str, Any]) -> Planner:
    """Return a planner by its name, or the user's planner, which gets a copy of the costmap."""
    if isinstance(planner, str):
        return planner_from_name(planner, options)
    if isinstance(planner, Planner) and not isinstance(planner, type):
        new_planner = with_options(planner, **options)
    elif callable(planner) and not isinstance(planner, type):
        new_planner = FunctionPlanner(planner, options)
    else:
        raise ConfigError(
            "planner must be a name, a function f(costs, start, goal), or an object with name,"
            f" minimises, space, check, prepare and solve, not {short_repr(planner)}"
        )
    is_shipped = type(new_planner).__module__.startswith("locplan.") and not isinstance(
        new_planner, FunctionPlanner
    )
    return new_planner if is_shipped else CheckedPlanner(new_planner)

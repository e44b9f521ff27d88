"""One planner for what a caller asks for: a name, a function or an object, with limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from locplan._util.checks import shown
from locplan.errors import ConfigError
from locplan.planners._budget import BudgetPlanner
from locplan.planners._function import FunctionPlanner, Guarded, PlannerFunction
from locplan.planners._limits import Limited
from locplan.planners._protocol import Planner, Position, Wrapper
from locplan.planners._registry import DEFAULT, check_names, defaults_of, named_planner
from locplan.robots import Footprint

AnyPlanner: TypeAlias = str | Planner | PlannerFunction
"""A planner as a caller may give it."""


def planner_for(
    planner: AnyPlanner | None = None,
    options: Mapping[str, Any] | None = None,
    *,
    via: Sequence[Position] = (),
    max_e: float | None = None,
    budget: float | None = None,
    footprint: Footprint | ArrayLike | None = None,
) -> Planner:
    """Make the planner, with its options and limits, that `locplan.plan` uses for these arguments.

    Parameters
    ----------
    planner : str, function or Planner, optional
        The planner; "any-angle" by default, or "grid" with a budget.
    options : mapping of str to object, optional
        The planner's options by name; those that are left out have their defaults.
    via, max_e, budget, footprint
        Limits that a path must keep; see `locplan.plan`. By default there are none.

    Returns
    -------
    Planner
        The planner, checked. One of the user's own is wrapped in `Guarded`.

    Raises
    ------
    ConfigError
        If there is no such planner, or the options and limits do not go together.

    Examples
    --------
    >>> planner_for("any-angle", {"accuracy": "high"})
    AnyAngle(accuracy='high', allow_corner_cutting=False)
    """
    options, stops, outline = options or {}, tuple(via), outline_of(footprint)
    if budget is None:
        made = _unlimited(DEFAULT if planner is None else planner, options)
    else:
        if planner not in (None, "grid") or stops or outline is not None or max_e is not None:
            raise ConfigError("a budget is for planner 'grid', without via, footprint and max_e")
        known = [name for name in defaults_of(BudgetPlanner) if name != "budget"]
        check_names("a budget", options, known)
        made = BudgetPlanner(budget, **options)
    if stops or outline is not None or max_e is not None:
        made = Limited(made, stops, outline, max_e)
    made.check()
    return made


def outline_of(footprint: Footprint | ArrayLike | None) -> Footprint | None:
    """Return a footprint that is given as one or by its corners."""
    if footprint is None or isinstance(footprint, Footprint):
        return footprint
    return Footprint(np.asarray(footprint))


def takes(planner: Planner, option: str) -> bool:
    """Return whether a planner has an option of this name.

    Parameters
    ----------
    planner : Planner
        The planner.
    option : str
        Name of an option, such as "seed".
    """
    planner = innermost(planner)
    if isinstance(planner, FunctionPlanner):
        return option in planner.parameters
    return option in defaults_of(type(planner))


def innermost(planner: Planner) -> Planner:
    """The planner without its limits.

    Parameters
    ----------
    planner : Planner
        A planner as `planner_for` makes it.
    """
    while isinstance(planner, Wrapper):
        planner = planner.planner
    return planner


def own_planner(planner: Planner) -> Planner | None:
    """The planner of the user's own without its limits, or None if it is one of locplan's.

    Parameters
    ----------
    planner : Planner
        A planner as `planner_for` makes it.
    """
    while isinstance(planner, Wrapper) and not isinstance(planner, Guarded):
        planner = planner.planner
    return planner.planner if isinstance(planner, Guarded) else None


def options_of(planner: Planner) -> dict[str, Any]:
    """The options and limits of a planner that differ from their defaults.

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
    inner = options_of(planner.planner) if isinstance(planner, Wrapper) else {}
    known = defaults_of(type(planner))
    own = {name: getattr(planner, name) for name in known if getattr(planner, name) != known[name]}
    return inner | own


def with_options(planner: Planner, **options: Any) -> Planner:
    """A copy of a planner with other options.

    Parameters
    ----------
    planner : Planner
        The planner.
    **options
        New values of some options; the others stay.

    Raises
    ------
    ConfigError
        If the planner does not have one of them.
    """
    if isinstance(planner, Wrapper):
        return dataclasses.replace(planner, planner=with_options(planner.planner, **options))
    if isinstance(planner, FunctionPlanner):
        return dataclasses.replace(planner, options={**planner.options, **options})
    check_names(f"planner {shown(planner.name)}", options, defaults_of(type(planner)))
    return dataclasses.replace(planner, **options) if options else planner  # type: ignore[type-var]


def _unlimited(planner: AnyPlanner, options: Mapping[str, Any]) -> Planner:
    """A planner by its name, or the user's own, which gets a costmap of its own."""
    if isinstance(planner, str):
        return named_planner(planner, options)
    if isinstance(planner, Planner) and not isinstance(planner, type):
        made = with_options(planner, **options)
    elif callable(planner) and not isinstance(planner, type):
        made = FunctionPlanner(planner, options)
    else:
        raise ConfigError(
            "planner must be a name, a function f(costs, start, goal), or an object with name,"
            f" minimises, space, check, prepare and solve, not {shown(planner)}"
        )
    ours = type(made).__module__.startswith("locplan.") and not isinstance(made, FunctionPlanner)
    return made if ours else Guarded(made)

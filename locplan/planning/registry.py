"""The planners that have a name, with what each minimises, its spaces and its options.

A new planner needs a module and a line in `PLANNERS`.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from locplan._support.checks import format_suggestion, short_repr
from locplan.errors import ConfigError
from locplan.planning.any_angle import AnyAngle
from locplan.planning.grid import AStar, Dijkstra, GridPlanner
from locplan.planning.lattice import Lattice
from locplan.planning.ompl.kinds import KINDS
from locplan.planning.ompl.planner import Ompl
from locplan.planning.protocol import LATTICE, Planner

DEFAULT = "any-angle"
"""The planner that is used if none is named and the robot counts as a circle."""


@dataclass(frozen=True)
class PlannerEntry:
    """A planner that is known by a name."""

    kind: type[Any]
    """The planner's class; if it has a field `name`, it is given the name."""
    minimises: str | None = "J"
    """The quantity that its paths minimise; None if it stops at any path."""
    spaces: tuple[str, ...] = ("R2",)
    """The spaces in which it can plan."""

    def options(self) -> dict[str, Any]:
        """Return the names of the planner's options with their defaults."""
        return read_option_defaults(self.kind)

    def typed_options(self) -> list[str]:
        """Return the names of the options that can be typed in a text."""
        return [name for name in self.options() if name not in ("settings", "progress")]


PLANNERS: dict[str, PlannerEntry] = {
    "grid": PlannerEntry(GridPlanner),
    "astar": PlannerEntry(AStar),
    "dijkstra": PlannerEntry(Dijkstra),
    "any-angle": PlannerEntry(AnyAngle),
    "lattice": PlannerEntry(Lattice, spaces=(LATTICE,)),
    **{
        name: PlannerEntry(Ompl, "J" if kind.minimises else None, kind.spaces)
        for name, kind in KINDS.items()
    },
}
"""The planners by name."""


def list_planner_names() -> tuple[str, ...]:
    """Return the names of the planners that `locplan.plan` knows."""
    return tuple(PLANNERS)


def planner_from_name(
    name: str, options: Mapping[str, Any], planners: Mapping[str, PlannerEntry] | None = None
) -> Planner:
    """Make a planner by its name.

    Parameters
    ----------
    name : str
        The name; case does not count, and RRT* is RRTstar.
    options : mapping of str to object
        The planner's options by name, by default all defaults. OMPL's planners
        also take OMPL's settings, such as range.
    planners : mapping of str to PlannerEntry, optional
        The planners to choose from; by default `PLANNERS`.

    Raises
    ------
    ConfigError
        If none has this name, or it does not take the options.
    """
    planners = PLANNERS if planners is None else planners
    name = normalize_planner_name(name, planners)
    planner_entry, kind = planners[name], planners[name].kind
    list_settings = getattr(kind, "setting_names", None)
    other = {option: options[option] for option in options if option not in planner_entry.options()}
    if other and list_settings:
        check_option_names(
            f"planner {short_repr(name)}",
            other,
            [*planner_entry.typed_options(), *list_settings(name)],
        )
        plain_options = {option: value for option, value in options.items() if option not in other}
        options = {**plain_options, "settings": {**plain_options.get("settings", {}), **other}}
    check_option_names(f"planner {short_repr(name)}", options, planner_entry.options())
    if "name" in inspect.signature(kind).parameters:
        options = {"name": name, **options}
    planner: Planner = kind(**options)
    planner.check()
    return planner


def normalize_planner_name(name: str, valid_names: Iterable[str]) -> str:
    """Return the known spelling of a planner's name; a ConfigError if no planner has the name.

    Parameters
    ----------
    name : str
        The name; case does not count, and RRT* is RRTstar.
    valid_names : iterable of str
        The known names.

    Examples
    --------
    >>> normalize_planner_name("rrt*", PLANNERS), normalize_planner_name("AnyAngle", PLANNERS)
    ('RRTstar', 'any-angle')
    """
    spellings = {_normalize_spelling(planner_name): planner_name for planner_name in valid_names}
    plain = _normalize_spelling(name)
    if plain not in spellings:
        names_known, guess = (
            ", ".join(spellings.values()),
            format_suggestion(name, spellings.values()),
        )
        raise ConfigError(f"planner must be one of {names_known}, not {short_repr(name)}{guess}")
    return spellings[plain]


def _normalize_spelling(name: str) -> str:
    return re.sub(r"[\s_-]", "", name.casefold().replace("*", "star"))


def read_option_defaults(kind: type) -> dict[str, Any]:
    """Return a planner class's options (its dataclass fields) with their defaults."""
    if not dataclasses.is_dataclass(kind):
        return {}
    return {
        option.name: option.default_factory()
        if callable(option.default_factory)
        else option.default
        for option in dataclasses.fields(kind)
        if option.name not in ("name", "planner")  # its own name, and the planner that it wraps
    }


def check_option_names(whose: str, options: Iterable[str], valid_names: Iterable[str]) -> None:
    """Raise a ConfigError unless all options are known."""
    for name in options:
        if name not in valid_names:
            names_known = ", ".join(valid_names) or "none"
            guess = format_suggestion(name, valid_names)
            raise ConfigError(
                f"{whose} has no option {short_repr(name)}; it has: {names_known}{guess}"
            )

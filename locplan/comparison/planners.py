"""Planners of a comparison, given as names with options, functions or objects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from locplan._support.checks import short_repr
from locplan._support.public import require_extra
from locplan.errors import ConfigError, LocplanError
from locplan.planning.costmap import Costmap
from locplan.planning.ompl.planner import Ompl
from locplan.planning.plans import check_ends, run_planner
from locplan.planning.protocol import Planner, Position
from locplan.planning.registry import (
    PLANNERS,
    PlannerEntry,
    list_planner_names,
    normalize_planner_name,
    planner_from_name,
)
from locplan.planning.requests import (
    AnyPlanner,
    FunctionPlanner,
    find_changed_options,
    has_option,
    make_planner,
    unwrap_planner,
    user_planner,
    with_options,
)
from locplan.planning.results import Plan
from locplan.planning.robot_fit import needs_lattice
from locplan.robots.robot import Robot
from locplan.simulation.recommender import RecommendingPlanner


@dataclass(frozen=True)
class PlannerSpec:
    """A planner with its label in a comparison."""

    label: str
    """The planner's name in tables; no two planners of a comparison share it."""
    planner: Planner
    """The planner with its options, see `locplan.planning.requests.make_planner`."""

    @classmethod
    def parse(cls, planner: AnyPlanner | PlannerSpec) -> PlannerSpec:
        """Make a spec from text, a function or a Planner.

        Parameters
        ----------
        planner : str, function, Planner or PlannerSpec
            A name with options, such as "BITstar:time_limit=2,seed=3", whose values are numbers,
            true, false or words. OMPL's planners also accept OMPL's settings. Or a function
            ``f(costs, start, goal, **options)`` with a name, or an object such as
            ``planners.AnyAngle()``.

        Raises
        ------
        ConfigError
            If the planner is unknown, or does not have an option.

        Examples
        --------
        >>> spec = PlannerSpec.parse("RRT*: iterations=500, range=2")
        >>> spec.label, find_changed_options(spec.planner)
        ('RRTstar:iterations=500,range=2', {'iterations': 500, 'settings': {'range': 2}})
        """
        if isinstance(planner, str):
            return _parse_spec(planner)
        if isinstance(planner, PlannerSpec):
            return cls(planner.label, make_planner(planner.planner))
        planner_object = make_planner(planner)
        if planner_object.name == "<lambda>":
            raise ConfigError(
                "a planner must be a name or a function with a name, such as"
                f" PlannerSpec('mine', FunctionPlanner(f)), not {short_repr(planner)}"
            )
        options = ",".join(
            f"{name}={value}" for name, value in find_changed_options(planner_object).items()
        )
        return cls(
            f"{planner_object.name}:{options}" if options else planner_object.name, planner_object
        )

    def with_time_limit(self, limit: float | None) -> PlannerSpec:
        """Return the spec with a time limit, if the planner accepts one and has no limit yet.

        Parameters
        ----------
        limit : float or None
            Time limit [s], above 0; None changes nothing.
        """
        ends = "iterations" in find_changed_options(self.planner)
        return self if ends else self._with_option("time_limit", limit)

    def with_robot(self, robot: Robot | None) -> PlannerSpec:
        """Return the spec with a robot, if the planner needs one and has none.

        Parameters
        ----------
        robot : Robot or None
            The robot; None changes nothing.
        """
        return self._with_option("robot", robot)

    def _with_option(self, option: str, value: Any) -> PlannerSpec:
        is_decided = value is None or option in find_changed_options(self.planner)
        if is_decided or not has_option(self.planner, option):
            return self
        changed = with_options(self.planner, **{option: value})
        changed.check()
        return dataclasses.replace(self, planner=changed)

    @property
    def is_user_planner(self) -> bool:
        """True if the planner is a user's function or class."""
        return user_planner(self.planner) is not None

    @property
    def time_limit(self) -> float | None:
        """The time limit of the planner [s]; None if unknown."""
        planner = unwrap_planner(self.planner)
        if isinstance(planner, Ompl):
            return planner.seconds
        limit = find_changed_options(self.planner).get("time_limit")
        return None if limit is None else float(limit)

    def select_seeds(self, seeds: Sequence[int]) -> tuple[int, ...]:
        """Return the seeds to run the planner with: its option, or 0 if it takes none.

        Parameters
        ----------
        select_seeds : sequence of int
            Seeds of the comparison, 1 to 2^32 - 1.
        """
        planner_seed = find_changed_options(self.planner).get("seed")
        if planner_seed is not None:
            return (int(planner_seed),)
        return tuple(seeds) if has_option(self.planner, "seed") else (0,)

    @property
    def version(self) -> str | None:
        """The version that a user's planner declares; None without one."""
        planner = user_planner(self.planner)
        code = planner.function if isinstance(planner, FunctionPlanner) else planner
        version = getattr(code, "version", None)
        return None if version is None else str(version)

    def identity(self) -> list[Any]:
        """Return everything that determines the planner's paths, as plain data for JSON.

        Users' planners are equal if their names, declared versions and options are equal.
        """
        options, planner = find_changed_options(self.planner), user_planner(self.planner)
        if planner is None:
            return [
                self.planner.name,
                {name: _option_to_json(value) for name, value in options.items()},
            ]
        code: Any = planner.function if isinstance(planner, FunctionPlanner) else type(planner)
        version_text = "no version" if self.version is None else f"version {self.version}"
        texts = {name: short_repr(value) for name, value in options.items()}
        return [getattr(code, "__qualname__", ""), version_text, texts]

    def plan(self, costs: Costmap, start: Position, goal: Position, seed: int) -> Plan:
        """Plan once, and measure the path on the costmap.

        Parameters
        ----------
        costs : Costmap
            The costmap to plan on.
        start, goal : (x, y) or (x, y, heading)
            Positions in the world [m, rad]; planners without headings ignore them.
        seed : int
            Seed of the planner's random numbers, if it has some.

        Raises
        ------
        PoseError
            If the robot cannot stand at start or goal, or a heading is missing.
        LocplanError
            If a user's planner returns anything but a path that can be driven.
        """
        planner = self.planner
        if has_option(planner, "seed"):
            planner = with_options(planner, seed=seed)
        if planner.space == "R2":
            start, goal = start[:2], goal[:2]
        stops = check_ends(costs, start, goal, space=planner.space)
        return run_planner(planner, costs, *stops)


def make_specs(planners: Iterable[AnyPlanner | PlannerSpec]) -> list[PlannerSpec]:
    """Return the checked specs of all planners, with distinct labels.

    Parameters
    ----------
    planners : iterable of str, function, Planner or PlannerSpec
        The planners, at least one; see `PlannerSpec.parse`.

    Raises
    ------
    ConfigError
        If there are no planners, two have the same label, or one is invalid.
    """
    specs = [PlannerSpec.parse(planner) for planner in planners]
    if not specs:
        raise ConfigError("a comparison needs at least one planner")
    labels = [spec.label for spec in specs]
    for spec in specs:
        name = f"planner {short_repr(spec.label)}"
        if labels.count(spec.label) > 1:
            raise ConfigError(f"{name} appears twice; remove or rename one")
        if spec.is_user_planner:  # it is sent to workers by value
            require_extra("cloudpickle", "functions", f"{name}, a custom planner,")
    return specs


def find_costmap_robot(maps: Any) -> Robot | None:
    """Return the first robot of a costmap that needs the lattice planner; None without one."""
    maps_and_costmaps = maps.values() if isinstance(maps, Mapping) else maps
    maps_and_costmaps = (
        maps_and_costmaps if isinstance(maps_and_costmaps, Iterable) else [maps_and_costmaps]
    )
    robots = [costmap.robot for costmap in maps_and_costmaps if isinstance(costmap, Costmap)]
    return next((robot for robot in robots if needs_lattice(robot)), None)


def _parse_spec(text: str) -> PlannerSpec:
    name, _, rest = text.partition(":")
    name = name.strip()
    parts = [part.strip() for part in rest.split(",") if part.strip()]
    options = parse_options(text, rest)
    squeezed = ",".join("=".join(word.strip() for word in part.split("=", 1)) for part in parts)
    label = f"{name}:{squeezed}" if parts else name
    max_e, budget = options.pop("max_e", None), options.pop("budget", None)
    # This planner has a name only in comparisons, since it needs more than a costmap.
    planners_by_name = PLANNERS | {
        "simulated choice": PlannerEntry(RecommendingPlanner, "simulated error")
    }
    if name:
        name = normalize_planner_name(name, planners_by_name)
    try:
        if name in (*list_planner_names(), "") or budget is not None:
            planner = make_planner(name, options, max_e=max_e, budget=budget)
        else:
            planner = planner_from_name(name, options, planners_by_name)
            planner = make_planner(planner, max_e=max_e, budget=budget)
    except LocplanError as error:
        raise ConfigError(f"planner {short_repr(label)}: {error}") from None
    return PlannerSpec(f"{name}:{squeezed}" if parts else name, planner)


def parse_options(planner_text: str, options_text: str) -> dict[str, Any]:
    """Return the options of a planner from the text NAME=VALUE,NAME=VALUE.

    Parameters
    ----------
    planner_text : str
        The planner as it was typed, for errors.
    options_text : str
        The options.
    """
    options: dict[str, Any] = {}
    for part in filter(None, map(str.strip, options_text.split(","))):
        name, equals, value = (word.strip() for word in part.partition("="))
        if not (name and equals and value):
            raise ConfigError(
                f"planner {short_repr(planner_text)}: {short_repr(part)} must be NAME=VALUE, such"
                " as"
                " time_limit=2"
            )
        if name.partition(".")[0] == "settings":
            raise ConfigError(
                f"planner {short_repr(planner_text)}: write OMPL's settings by their names, such"
                " as range=2"
            )
        options[name] = _parse_value(value)
    return options


def _option_to_json(option: Any) -> Any:
    """Return the value of an option as plain data for JSON."""
    return option.summary() if isinstance(option, Robot) else option


def _parse_value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text

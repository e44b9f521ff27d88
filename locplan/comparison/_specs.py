"""Planners as they are named in a comparison: locplan's with options, or functions."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.planners import Plan, check_request, plan
from locplan.planners._result import Position
from locplan.planners.ompl._kinds import KINDS

OWN_STATUSES = get_args(get_type_hints(Plan)["status"])
"""What a planner may say itself."""
NO_OPTIONS = ("planner", "costs", "start", "goal", "via", "footprint", "progress")
"""Of `locplan.plan`, what the text of a planner cannot name."""
TIME_LIMIT = 5.0
"""Of OMPL's planners unless told otherwise [s]."""
WARMING = 0.05
"""Time limit of the query that is thrown away [s]."""


@dataclass(frozen=True)
class PlannerSpec:
    """A planner and its options.

    Parameters
    ----------
    label : str
        What to call it in tables.
    name : str
        locplan's name of the planner; "" for a function.
    options : mapping
        Passed to it.
    function : callable, optional
        ``f(costs, start, goal, **options)`` returns a `Plan`; one with a parameter ``seed`` is
        given it. If it has an attribute ``prepare``, that is called once in every process before
        anything is timed: the place to compile.
    """

    label: str
    name: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    function: Callable[..., Plan] | None = None

    @classmethod
    def of(cls, planner: str | Callable[..., Plan] | PlannerSpec) -> PlannerSpec:
        """From text such as "BITstar:time_limit=2,seed=3", or a function by its name; checked.

        Values are numbers, true, false or words; OMPL's own settings begin with "settings.".

        Raises
        ------
        ConfigError
            If there is no such planner, or it does not take an option.

        Examples
        --------
        >>> spec = PlannerSpec.of("RRTstar: iterations=500, settings.range=2")
        >>> spec.label, dict(spec.options)
        ('RRTstar:iterations=500,settings.range=2', {'iterations': 500, 'settings': {'range': 2}})
        """
        if isinstance(planner, str):
            planner = _parsed(planner)
        elif not isinstance(planner, PlannerSpec):
            planner = _named(planner)
        planner.check()
        return planner

    def check(self) -> None:
        """Raise a ConfigError unless the planner exists and takes its options."""
        if self.function is not None:
            return
        for name in self.options:
            if name in NO_OPTIONS:
                raise ConfigError(f"planner {self.label!r}: {name} is no option here; leave it out")
        try:
            check_request(self.name, **self.options)
        except LocplanError as error:
            raise ConfigError(f"planner {self.label!r}: {error}") from None

    def with_time_limit(self, limit: float | None) -> PlannerSpec:
        """The same with a limit [s], if it can have one and has none of its own."""
        own = {"time_limit", "iterations"} & set(self.options)
        if limit is None or own or not (self.name in KINDS or self._takes("time_limit")):
            return self
        limited = dataclasses.replace(self, options={**self.options, "time_limit": limit})
        limited.check()
        return limited

    @property
    def space(self) -> str:
        """Where it plans; with a heading in all spaces but "R2"."""
        return str(self.options.get("space", "R2"))

    @property
    def time_limit(self) -> float | None:
        """When it ends by itself [s], if that is known."""
        limit = self.options.get("time_limit")
        if limit is None and self.name in KINDS and self.options.get("iterations") is None:
            return TIME_LIMIT
        return None if limit is None else float(limit)

    def seeds(self, seeds: Sequence[int]) -> tuple[int, ...]:
        """Those it is to run with: its own if it has one, 0 if it takes none."""
        if "seed" in self.options:
            return (int(self.options["seed"]),)
        return tuple(seeds) if self._takes_seed() else (0,)

    def identity(self) -> list[Any]:
        """What decides its paths, fit for JSON.

        Of a function what it is, with all that it has closed over, and its whole source file.
        """
        if self.function is None:
            return [self.name, dict(self.options)]
        try:
            import cloudpickle
        except ModuleNotFoundError:
            raise LocplanError(
                f"planner {self.label!r}: a planner of your own needs cloudpickle:"
                " pip install 'locplan[functions]'"
            ) from None
        try:
            source = Path(inspect.getfile(self.function)).read_bytes()
        except (OSError, TypeError):  # of a notebook, or of a callable object
            source = b""
        content = hashlib.blake2b(cloudpickle.dumps(self.function) + source, digest_size=16)
        options = {name: repr(value) for name, value in self.options.items()}
        return [getattr(self.function, "__qualname__", ""), content.hexdigest(), options]

    def plan(self, costs: Costmap, start: Position, goal: Position, seed: int) -> Plan:
        """One run, measured on the costmap.

        Raises
        ------
        LocplanError
            If a function returns what is no plan, or one that cannot be driven.
        """
        options = dict(self.options)
        if self._takes_seed():
            options["seed"] = seed
        if self.space == "R2":
            start, goal = start[:2], goal[:2]
        if self.function is not None:
            began = time.perf_counter()
            result = self.function(costs, start, goal, **options)
            elapsed = time.perf_counter() - began
            return _sound(result, costs, start, goal, elapsed)
        return plan(costs, start, goal, planner=self.name, **options)

    def prepare(self) -> None:
        """Compile and load all that a run needs."""
        if self.function is not None:
            getattr(self.function, "prepare", lambda: None)()
            return
        start, goal = (1.5, 1.5, 0.0), (14.5, 10.5, 0.0)
        options = {**self.options, "time_limit": WARMING} if self.time_limit else self.options
        try:
            hasty = dataclasses.replace(self, options=options)
            hasty.plan(_something_to_try(), start, goal, seed=1)
        except LocplanError:
            pass  # the options may not fit it: then the real query tells

    def _takes_seed(self) -> bool:
        return self.name in KINDS or self._takes("seed")

    def _takes(self, option: str) -> bool:
        """Whether it is a function with such a parameter."""
        return self.function is not None and option in inspect.signature(self.function).parameters


def specs_of(planners: Iterable[str | Callable[..., Plan] | PlannerSpec]) -> list[PlannerSpec]:
    """All of them, checked, each with a label of its own."""
    specs = [PlannerSpec.of(planner) for planner in planners]
    labels = [spec.label for spec in specs]
    for label in labels:
        if labels.count(label) > 1:
            raise ConfigError(f"planner {label!r} is there twice; leave one out, or name it anew")
    if not specs:
        raise ConfigError("a comparison needs at least one planner")
    return specs


def _parsed(text: str) -> PlannerSpec:
    name, _, rest = text.partition(":")
    options: dict[str, Any] = {}
    parts = [part.strip() for part in rest.split(",") if part.strip()]
    for part in parts:
        key, equals, value = (word.strip() for word in part.partition("="))
        if not (key and equals and value):
            raise ConfigError(
                f"planner {text!r}: {part!r} must be NAME=VALUE, such as time_limit=2"
            )
        owner, _, setting = key.rpartition(".")
        home = options.setdefault("settings", {}) if owner == "settings" else options
        if not isinstance(home, dict) or (key == "settings" and not owner):
            raise ConfigError(f"planner {text!r}: write settings one by one, as settings.range=2")
        home[setting if owner == "settings" else key] = _value(value)
    squeezed = ",".join("=".join(word.strip() for word in part.split("=", 1)) for part in parts)
    label = f"{name.strip()}:{squeezed}" if parts else name.strip()
    return PlannerSpec(label, name.strip(), options)


def _value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text


def _named(function: Callable[..., Plan]) -> PlannerSpec:
    name = getattr(function, "__name__", "")
    if not callable(function) or not name or name == "<lambda>":
        raise ConfigError(
            "a planner must be a name or a function with a name, such as"
            f" PlannerSpec('mine', function=f), not {function!r}"
        )
    return PlannerSpec(name, function=function)


def _sound(result: object, costs: Costmap, start: Position, goal: Position, elapsed: float) -> Plan:
    """What a function returned, measured on the costmap, if it can be driven."""
    if not isinstance(result, Plan) or result.status not in OWN_STATUSES:
        raise LocplanError(
            f"the planner must return a locplan.Plan with a status of {', '.join(OWN_STATUSES)},"
            f" not {type(result).__name__}"
        )
    if result.path is None and result.status == "solved":
        raise LocplanError("the planner says it has solved the query, but returned no path")
    if not 0 <= result.solve_time <= elapsed:
        result = dataclasses.replace(result, solve_time=elapsed)
    if result.path is None:
        return result
    apart = np.hypot(*(result.path.xy[[0, -1]] - np.array([start[:2], goal[:2]])).T)
    if apart.max() > 1.5 * costs.grid.resolution:
        raise LocplanError("the planner's path does not lead from start to goal")
    measured = dataclasses.replace(result.measured_on(costs), history=result.history)
    if measured.metrics and not np.isfinite(measured.metrics.cost):
        raise LocplanError("the planner's path enters cells where the robot cannot be")
    return measured


def _something_to_try() -> Costmap:
    """A room with a wall, where costs differ: no planner is done before it has searched."""
    from locplan.maps import FREE, OCCUPIED, OccupancyGrid

    cells = np.full((12, 16), FREE, np.uint8)
    cells[:8, 8] = OCCUPIED
    u = np.linspace(0.0, 0.9, cells.size).reshape(cells.shape)
    costs = Costmap.from_density(OccupancyGrid(cells, 1.0), 1.0 + u)
    return dataclasses.replace(costs, u=u, e=u, weight=1.0)

"""The planning problem of a recommendation: its settings, and paths that keep them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, get_args

import numpy as np

from locplan._support.checks import (
    Settings,
    check_choice,
    check_instance,
    check_integer,
    check_number,
    check_positive,
    set_frozen_fields,
)
from locplan._support.kernels.arrays import Bools, Floats
from locplan.errors import ConfigError
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import Costmap
from locplan.planning.lattice import Lattice
from locplan.planning.metrics import crosses_no_go, path_metrics
from locplan.planning.path import Path
from locplan.planning.path_check import find_path_faults
from locplan.planning.plans import (
    SHORTEST,
    check_ends,
    plan,
    plan_with_adaptive_field,
    plan_with_shortest,
)
from locplan.planning.protocol import Planner, Position
from locplan.planning.requests import make_planner
from locplan.planning.results import Plan
from locplan.planning.robot_fit import needs_lattice
from locplan.robots.amcl import Amcl
from locplan.robots.parts import Footprint
from locplan.robots.presets import SAFE, with_preset
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import CLOSED_DRIVES
from locplan.simulation.verdict import LOOKS

Minimise = Literal["rmse", "lost", "goal-error", "heading"]
"""Quantity that the chosen path has least of."""
MINIMISED: tuple[Minimise, ...] = get_args(Minimise)
SAFE_AMCL = with_preset(Amcl(), SAFE)
"""The safe preset, which needs no recording; the rest is the robot's own."""


@dataclass(frozen=True, kw_only=True, repr=False)
class RecommendationSettings(Settings):
    """Settings of a recommendation.

    Raises
    ------
    ConfigError
        If one is out of its range.

    Examples
    --------
    >>> RecommendationSettings(drives=16, bold=True)
    RecommendationSettings(drives=16, bold=True)
    """

    via: tuple[Position, ...] = ()
    """Positions that all candidates visit in this order [m]."""
    max_e: float | None = None
    """Maximum e of the cells that a candidate enters, above 0 [m^2 rad]; None sets no limit."""
    budget: float | None = None
    """Maximum integral of u of a candidate, >= 0 [m]; None sets no limit."""
    longest: float = 1.5
    """Maximum length of a candidate, in lengths of the shortest path, >= 1. The aware path of the
    default weight and all that you ask for may be longer; in the race their length beyond this
    counts as much as the error."""
    front: bool = False
    """Whether up to 5 paths of the Pareto front of length against degeneracy are candidates."""
    weight: float | None = None
    """Weight of the aware path that is planned where nothing is driven, by default the
    estimator's own, and of a further candidate where the robot is driven, >= 0."""
    criterion: str | None = None
    """Value that u is made of; None takes the estimator's own, see `Costmap.from_field`."""
    minimise: Minimise = "rmse"
    """Error that decides: "rmse" of the position, "goal-error" (that of the last metre), "heading",
    or "lost": in the race first of all few lost drives."""
    price: float = 0.3
    """What counts in the race beside the logarithm of the error: so much of that of the length,
    >= 0."""
    drives: int = 64
    """Maximum number of confirming drives of a path, 2 to 1024; 0 drives no path."""
    bold: bool = False
    """Whether an undecided path is recommended, too, if its ratio of errors is at most 0.9."""
    thorough: bool = False
    """Whether 40 closed-loop drives of the path to take and of the shortest show how often each
    arrives, rather than 16."""
    time_limit: float | None = None
    """Time after which no further round of confirming drives begins, above 0 [s]; None sets
    none."""

    filter_map: OccupancyGrid | None = dataclasses.field(default=None, compare=False)
    """The filter's map in the same frame, where it differs from the one that is driven in."""
    rival: Amcl | None = SAFE_AMCL
    """Filter that is driven along the shortest path, too, to tell whether settings gain more than
    paths; None drives none, nor is one driven beside a filter that is no AMCL. The default stands
    for the robot's own filter with the safe preset, see `locplan.robots.presets`."""

    def compute_length_handicaps(self, ratios: Sequence[float]) -> Floats:
        """Return the race's penalty on the log error of candidates for their lengths.

        Parameters
        ----------
        ratios : sequence of float
            Length of each candidate, in lengths of the shortest path.
        """
        log_excess = np.log(np.maximum(np.array(ratios) / self.longest, 1.0))
        return self.price * (np.log(ratios) - log_excess) + max(self.price, 1.0) * log_excess

    def __post_init__(self) -> None:
        set_frozen_fields(
            self, via=tuple(self.via), longest=check_number("longest", self.longest, 1.0)
        )
        set_frozen_fields(self, price=check_number("price", self.price, 0.0))
        check_choice("minimise", self.minimise, MINIMISED)
        for name in ("front", "bold", "thorough"):
            check_instance(name, getattr(self, name), bool, "give true or false")
        if self.drives != 0:
            check_integer("drives, unless 0,", self.drives, 2, LOOKS[-1])
        for name in ("max_e", "time_limit"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name))
        for name in ("budget", "weight"):
            if getattr(self, name) is not None:
                check_number(name, getattr(self, name), 0.0)

    def find_rival_settings(self, robot_filter: object) -> Amcl | None:
        """Return the rival of the robot's filter; None without one, for equal settings or no AMCL.

        Parameters
        ----------
        robot_filter : Filter
            The robot's filter, of any kind.
        """
        if not isinstance(robot_filter, Amcl):  # what gains is advised as AMCL's parameters
            return None
        rival = with_preset(robot_filter, SAFE) if self.rival == SAFE_AMCL else self.rival
        return None if rival == robot_filter else rival

    @property
    def closed_drives(self) -> int:
        """Number of closed-loop drives of the path to take and of the shortest."""
        return 40 if self.thorough else CLOSED_DRIVES

    @property
    def is_limited(self) -> bool:
        """Whether paths keep limits that a field sets."""
        return self.max_e is not None or self.budget is not None


def normalize_settings(settings: RecommendationSettings | None) -> RecommendationSettings:
    """Return the settings, or the default ones; a ConfigError if they are of another kind."""
    if settings is None:
        return RecommendationSettings()
    check_instance("settings", settings, RecommendationSettings)
    return settings


MAX_PLACE_DISTANCE = 0.5
"""Maximum distance of a path's ends and of waypoints from where they should be [m]."""


class FieldFunction(Protocol):
    """A function that gives the field of a map, or its values at some lattice points."""

    def __call__(self, grid: OccupancyGrid, points: Bools | None = None, /) -> CovarianceField: ...


@dataclass(frozen=True)
class PlanningProblem:
    """What is asked: two places on a map, the limits of the paths, the robot, and its costs."""

    grid: OccupancyGrid
    """The map."""
    start: Position
    """Position of the start [m, rad]."""
    goal: Position
    """Position of the goal [m, rad]."""
    settings: RecommendationSettings
    """The limits."""
    robot: Robot
    """The robot."""
    user_costmap: Costmap | None
    """The costmap that was given."""
    config: FieldConfig
    """Settings of the field that the costmap is made of otherwise."""
    compute_field: FieldFunction
    """Gives that field."""
    zones: Zones = dataclasses.field(default_factory=Zones)
    """The zones; those of the costmap if one was given."""

    @cached_property
    def blank_costmap(self) -> Costmap:
        """Costmap with equal costs of all metres and the blocked cells of the given costmap."""
        if self.user_costmap is None:
            return Costmap.blank(self.grid, robot=self.robot, zones=self.zones)
        density = np.where(np.isfinite(self.user_costmap.density), 1.0, np.inf)
        costs = Costmap.from_density(self.grid, density, zones=self.zones.no_go_zones)
        return dataclasses.replace(costs, robot_radius=self.user_costmap.robot_radius)

    @property
    def is_lattice_needed(self) -> bool:
        """Whether the robot has an outline or turns on a radius, so that the lattice plans all."""
        return needs_lattice(self.robot) and self.settings.budget is None

    def _adapt_planner(
        self, costs: Costmap, planner: Planner | None
    ) -> tuple[PlanningProblem, Costmap, Planner | None]:
        """Return the problem, the costmap with the robot, and the planner.

        The problem has no headings if the planner has none. The lattice replaces planners that
        cannot plan for the robot.
        """
        if planner is None and self.is_lattice_needed:
            planner = Lattice()
        costs = dataclasses.replace(costs, robot=self.robot)
        if planner is not None and planner.space != "R2":
            return self, costs, planner
        places = [place[:2] for place in (self.start, *self.settings.via, self.goal)]
        return self._replace_places(places), costs, planner

    def _replace_places(self, places: Sequence[Position]) -> PlanningProblem:
        """Return the problem between new places."""
        start, *via, goal = places
        settings = dataclasses.replace(self.settings, via=tuple(via))
        return dataclasses.replace(self, start=start, goal=goal, settings=settings)

    def with_checked_places(self, planner_space: str) -> PlanningProblem:
        """The same with places that were checked in a planner's space.

        Raises
        ------
        LocplanError
            If the robot cannot stand there, or the limits do not go together or with the costmap.
        """
        places = check_ends(
            self.blank_costmap, self.start, self.goal, self.settings.via, space=planner_space
        )
        problem = self._replace_places(places)
        make_planner(
            None,
            via=problem.settings.via,
            max_e=problem.settings.max_e,
            budget=problem.settings.budget,
            footprint=problem._outline,
        )
        if (
            self.user_costmap is not None
            and self.settings.is_limited
            and math.isnan(self.user_costmap.weight)
        ):
            raise ConfigError(
                "a costmap without a field has no e or u to limit; give one of a field, or leave"
                " out max_e and budget"
            )
        return problem

    def compute_costmap(
        self, plan_paths_on: Callable[[Costmap], Iterable[Path]]
    ) -> tuple[Costmap, CovarianceField | None]:
        """Return the costmap with its field; slow fields are fine near some paths only."""
        if self.user_costmap:
            return self.user_costmap, None

        def make_costmap(field: CovarianceField) -> Costmap:
            return Costmap.from_field(
                field,
                weight=self.settings.weight,
                criterion=self.settings.criterion,
                robot=self.robot.radius,
                zones=self.zones,
            )

        if not self.config.estimator.casts_rays or self.config.stride != FieldConfig.stride:
            field = self.compute_field(self.grid)
            return make_costmap(field), field

        def compute_field(points: Bools) -> CovarianceField:
            return self.compute_field(self.grid, points)

        field, costs = plan_with_adaptive_field(
            self.grid, self.config, compute_field, make_costmap, plan_paths_on
        )
        return costs, field

    def plan_least_cost(
        self, costs: Costmap, planner: Planner | None = None, *, limited: bool = True
    ) -> Plan:
        """The plan of least cost over the waypoints, for the outline; without limits of e or u
        unless it is to be limited."""
        problem, costs, planner = self._adapt_planner(costs, planner)
        max_e, budget = problem._get_limits(limited)
        return plan(
            costs,
            problem.start,
            problem.goal,
            planner=planner,
            via=problem.settings.via,
            max_e=max_e,
            budget=budget,
            footprint=problem._outline,
        )

    def plan_shortest(self, costs: Costmap) -> Path | None:
        """Return the shortest path without limits, to compare with an aware path."""
        if math.isnan(costs.weight):
            return None
        return self.plan_aware_and_shortest(costs, limited=False)[SHORTEST].path

    def plan_aware_and_shortest(
        self, costs: Costmap, planner: Planner | None = None, *, limited: bool = True
    ) -> dict[str, Plan]:
        """The aware plan, within all limits if it is to be limited, and the shortest one."""
        planner = planner if self.settings.budget is None else None
        problem, costs, planner = self._adapt_planner(costs, planner)
        max_e, budget = problem._get_limits(limited)
        return plan_with_shortest(
            costs,
            problem.start,
            problem.goal,
            planner=planner,
            via=problem.settings.via,
            max_e=max_e,
            budget=budget,
            footprint=problem._outline,
        )

    def _get_limits(self, limited: bool) -> tuple[float | None, float | None]:
        """Return the maximum of e and the budget; None and None if plans are not limited."""
        return (self.settings.max_e, self.settings.budget) if limited else (None, None)

    @property
    def _outline(self) -> Footprint | None:
        """The robot's outline; None with a budget, which takes the circle within the outline."""
        return self.robot.outline if self.settings.budget is None else None

    def find_violated_limit(self, path: Path, costs: Costmap) -> str:
        """Which limit a path does not keep; empty if it keeps all."""
        settings = self.settings
        for x, y, *_ in settings.via:
            if (
                not len(path)
                or compute_distances_to_path(np.array([[x, y]]), path)[0] > MAX_PLACE_DISTANCE
            ):
                return f"does not visit {x:g},{y:g}"
        if crosses_no_go(self.zones, self.grid, path):
            return "crosses a no-go zone"
        if self.is_lattice_needed:
            for fault in find_path_faults(self.grid, path, self.robot):
                return f"cannot be driven: {fault.kind} near {fault.x:.2f},{fault.y:.2f}"
        if settings.max_e is None and settings.budget is None:
            return ""
        metrics = path_metrics(costs, path)
        if settings.max_e is not None and not metrics.max_e <= settings.max_e:
            return f"enters cells with e above {settings.max_e:g} m² rad"
        if settings.budget is not None and not metrics.integrated_u <= settings.budget * (1 + 1e-6):
            return f"has more than {settings.budget:g} degenerate metres"
        return ""


def compute_distances_to_path(points: Floats, path: Path) -> Floats:
    """Distance of each point to a path, to a few centimetres [m]."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(path.resample(0.1).xy).query(points)[0])

"""Candidate paths of a recommendation: paths of least cost on a few densities, and the user's."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import short_repr
from locplan.errors import ConfigError
from locplan.field.beams import LidarEstimator
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.field.fisher import Fused
from locplan.field.sad import Sad
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import Costmap
from locplan.planning.pareto import pareto_front
from locplan.planning.path import Path
from locplan.planning.plans import SHORTEST
from locplan.planning.protocol import Planner
from locplan.planning.requests import make_planner
from locplan.planning.results import ParetoFront, Plan
from locplan.robots.lidar import Lidar
from locplan.robots.robot import Robot
from locplan.simulation.problem import (
    MAX_PLACE_DISTANCE,
    PlanningProblem,
    compute_distances_to_path,
)
from locplan.simulation.worlds import (
    Window,
    compute_inflated_density,
    make_path_poses,
    make_window_around,
)

AWARE_WEIGHTS = tuple(share * LidarEstimator.weight for share in (0.5, 1.0, 1.5))
"""Weights of the degeneracy u of the aware paths, about the default one."""


@dataclass(frozen=True)
class PlanningArea:
    """A map, or a part of one, and what densities of candidates are made of there."""

    grid: OccupancyGrid
    """The map."""
    u: NDArray[np.float64]
    """Degeneracy of each cell."""
    robot: Robot
    """The robot."""
    accepted: dict[str, Path]
    """Candidates until now, the shortest first."""

    @cached_property
    def wall_avoiding_density(self) -> NDArray[np.float64]:
        """Density that keeps off the walls."""
        return 1 + 3 * np.exp(-(self.grid.clearance - self.robot.radius) / 0.4)

    @property
    def inflated_density(self) -> NDArray[np.float64]:
        """Density that Nav2's planners see in an inflated costmap."""
        return compute_inflated_density(self.grid.clearance, self.robot)

    @property
    def candidate_proximity(self) -> NDArray[np.float64]:
        """1 on the candidates until now, falling to 1/e at 1 m from them."""
        return np.exp(-(self._compute_distances(*self.accepted.values()) ** 2))

    @property
    def is_near_shortest_middle(self) -> NDArray[np.bool_]:
        """Cells within 1.5 m of the middle of the shortest path."""
        shortest = self.accepted[SHORTEST]
        middle = [np.interp(shortest.length / 2, shortest.distance, v) for v in shortest.xy.T]
        return self._compute_distances(Path(np.array([middle]))) < 1.5

    def _compute_distances(self, *paths: Path) -> NDArray[np.float64]:
        import cv2

        off_path = np.ones(self.grid.shape, np.uint8)
        for path in paths:
            fine = path.resample(self.grid.resolution / 2) if path.length else path
            cells = np.floor(self.grid.world_to_grid(*fine.xy.T)).astype(np.int64)
            off_path[tuple(np.clip(cells, 0, np.array(off_path.shape)[:, None] - 1))] = 0
        cells = cv2.distanceTransform(off_path, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(cells * self.grid.resolution, np.float64)


def field_config_from_cost_summary(
    cost_summary: Mapping[str, Any], lidar: Lidar | None
) -> FieldConfig:
    """Return the settings of the field in a costmap's summary, or the default settings."""
    if "config" in cost_summary:
        return FieldConfig.from_json(cost_summary["config"])
    return FieldConfig(Fused(lidar) if lidar else Sad())


def rebuild_costmap(cost_summary: Mapping[str, Any], field: CovarianceField) -> Costmap:
    """Return the costmap with these settings on a field; raise ConfigError for another map."""
    if field.grid.digest != cost_summary["map"]["digest"]:
        raise ConfigError(
            f"the recommendation is for another map, {cost_summary['map']['name'] or 'unnamed'}"
        )
    zones = Zones.from_json(cost_summary["zones"]) if "zones" in cost_summary else None
    return Costmap.from_field(
        field,
        weight=cost_summary.get("weight"),
        robot=cost_summary["robot_radius"],
        law=cost_summary.get("law") or "logarithmic",
        criterion=cost_summary.get("criterion"),
        headings=cost_summary.get("headings") or "mean",
        zones=zones,
    )


def make_candidate_costmap(
    costs: Costmap, candidates: Mapping[str, Path], name: str, robot: Robot, max_e: float | None
) -> Costmap:
    """Return a costmap with the density of a candidate instead of the field's density.

    Its weight is the greatest density above 1, and its u the density above 1 divided by it.
    """
    density, blocked = (
        compute_candidate_density(costs, candidates, name, robot),
        find_blocked_cells(costs, max_e),
    )
    max_excess = float(density[~blocked].max(initial=1.0)) - 1
    u = np.where(costs.grid.free, np.clip((density - 1) / (max_excess or 1.0), 0.0, 1.0), np.nan)
    values = np.where(blocked, np.inf, 1 + max_excess * u + costs.zones.cost_per_metre(costs.grid))
    return dataclasses.replace(
        costs, density=values, weight=max_excess, u=u, of_heading=None, settings=None
    )


def find_blocked_cells(
    costs: Costmap, max_e: float | None, window: Window = np.s_[:, :]
) -> NDArray[np.bool_]:
    """Cells of a map, or of a part of it, that no candidate may enter."""
    blocked = ~np.isfinite(costs.density[window])
    return blocked if max_e is None else blocked | (costs.e[window] > max_e)


DensityFunction: TypeAlias = Callable[[PlanningArea], NDArray[np.float64]]
"""Cost per metre of each cell of a part of a map."""


AWARE_NAME = "aware, weight "
"""Beginning of the names of aware paths; their weight follows."""


def make_named_aware_density(weight: float) -> dict[str, DensityFunction]:
    return {f"{AWARE_NAME}{weight:g}": lambda part: 1 + weight * part.u}


INFLATED_DENSITIES: dict[str, DensityFunction] = {"inflated": lambda part: part.inflated_density}
"""That of the robot's own inflated costmap, on which its navigation would plan."""
FIELDLESS_DENSITIES: dict[str, DensityFunction] = {
    "clear of walls": lambda part: part.wall_avoiding_density,
    "along walls": lambda part: 1 + 3 * np.minimum(abs(part.grid.clearance - 0.6), 1.5),
    "a metre off walls": lambda part: 1 + 2 * np.minimum(abs(part.grid.clearance - 1), 2),
    "detour 1": lambda part: part.wall_avoiding_density + 50 * part.is_near_shortest_middle,
    "detour 2": lambda part: 1 + 1.2 * part.candidate_proximity,
    "detour 3": lambda part: 1 + 2.5 * part.candidate_proximity,
    "detour 4": lambda part: part.wall_avoiding_density + 1.2 * part.candidate_proximity,
    "detour 5": lambda part: part.wall_avoiding_density + 2.5 * part.candidate_proximity,
}
"""Those that need no field, whose paths must be others than those before. They were found to lower
the error of filters; the first is the best of them."""
AWARE_DENSITIES: dict[str, DensityFunction] = {
    **{
        name: density
        for weight in AWARE_WEIGHTS
        for name, density in make_named_aware_density(weight).items()
    },
    "aware and clear": lambda part: part.wall_avoiding_density + 8 * part.u,
}
"""Those that need a field, whose paths are candidates however near another one they are."""


def compute_candidate_density(
    costs: Costmap, candidates: Mapping[str, Path], name: str, robot: Robot
) -> NDArray[np.float64]:
    """The density on a whole map whose cheapest path a candidate is, 1 or more, (H, W).

    Of a path that was given, or that another planner found, it is 1 there and rises to 9 within
    two metres of it.

    Parameters
    ----------
    costs : Costmap
        The costmap of the map, with a field or without one.
    candidates : mapping of str to Path
        The candidates in their order.
    name : str
        Name of the candidate.
    robot : Robot
        The robot.
    """
    before = dict(itertools.takewhile(lambda pair: pair[0] != name, candidates.items()))
    area = PlanningArea(costs.grid, costs.u, robot, before)
    if name == SHORTEST:
        return np.ones(costs.grid.shape)
    if density := {**INFLATED_DENSITIES, **FIELDLESS_DENSITIES, **AWARE_DENSITIES}.get(name):
        return density(area)
    if name.startswith(AWARE_NAME):
        return 1 + float(name.removeprefix(AWARE_NAME)) * costs.u
    single_area = dataclasses.replace(area, accepted={name: candidates[name]})
    return 1 + 8 * (1 - single_area.candidate_proximity)


def compute_path_deviation(path: Path, field: CovarianceField) -> tuple[float, float]:
    """Mean and greatest of the largest position deviation in a field along a path [m]."""
    deviation = field.at(path.resample(field.grid.resolution, even=True).xy, "position_std")
    deviation = deviation[np.isfinite(deviation)]
    if not deviation.size:
        return math.nan, math.nan
    return float(deviation.mean()), float(deviation.max())


REGION_MARGIN = 3.0
"""Margin of the part of the map that paths are planned on; clearance counts up to there [m]."""


@dataclass(frozen=True)
class SearchRegion(PlanningArea):
    """The part of a map that paths between two places may use, with its costmap."""

    costs: Costmap
    """Costmap of the whole map, with a field or without one."""
    window: Window
    """Rows and columns of the part."""
    problem: PlanningProblem
    """What is asked."""
    longest: float
    """Maximum length of a candidate [m]."""

    @classmethod
    def around_path(cls, costs: Costmap, shortest: Path, problem: PlanningProblem) -> SearchRegion:
        """The part of a costmap in which all paths up to the maximum length lie."""
        start, goal = shortest.xy[0], shortest.xy[-1]
        longest = problem.settings.longest * shortest.length
        # They lie in an ellipse about both ends, of which a and b are half the axes.
        a = longest / 2
        b = math.sqrt(max(0.0, a**2 - float(np.sum((goal - start) ** 2)) / 4))
        turn, round_it = math.atan2(*(goal - start)[::-1]), np.linspace(0, 2 * np.pi, 64)
        along, across = a * np.cos(round_it), b * np.sin(round_it)
        x = along * math.cos(turn) - across * math.sin(turn)
        y = along * math.sin(turn) + across * math.cos(turn)
        xy = (start + goal) / 2 + np.column_stack([x, y])
        cells = np.column_stack(costs.grid.world_to_grid(*xy.T))
        window = make_window_around(costs.grid, cells, REGION_MARGIN / costs.grid.resolution)
        grid, u = costs.grid.crop(*window), costs.u[window]
        return cls(grid, u, problem.robot, {SHORTEST: shortest}, costs, window, problem, longest)

    @cached_property
    def whole_map(self) -> SearchRegion:
        """Region of the whole map, without a limit of length."""
        costs = self.costs
        return SearchRegion(
            costs.grid,
            costs.u,
            self.robot,
            self.accepted,
            costs,
            window=np.s_[:, :],
            problem=self.problem,
            longest=math.inf,
        )

    @property
    def requested_weights(self) -> list[float]:
        """Weights whose aware paths race at any length: the costmap's, and the one asked for."""
        weights = self.costs.weight, self.problem.settings.weight
        return [weight for weight in weights if weight is not None and not math.isnan(weight)]

    def plan_candidate(self, density: NDArray[np.float64]) -> Path | str:
        """Return the path of least cost on a density of the part, or why it is no candidate."""
        costs = self.costs
        blocked = find_blocked_cells(costs, self.problem.settings.max_e, self.window)
        charge = np.broadcast_to(costs.zones.cost_per_metre(costs.grid), costs.grid.shape)[
            self.window
        ]
        layer = Costmap.from_density(self.grid, np.where(blocked, np.inf, density + charge))
        result = self.problem.plan_least_cost(layer, limited=False)
        path = result.path
        if path is None:
            return format_failure(result)
        if path.length > self.longest:
            ratio = self.problem.settings.longest
            return f"{path.length:.1f} m, more than {ratio:g} times the shortest path"
        return self.problem.find_violated_limit(path, costs) or path

    def plan_aware(self, weight: float) -> Path | str:
        """Return the aware path of a weight, or why it is no candidate."""
        area = self.whole_map if weight in self.requested_weights else self
        return area.plan_candidate(1 + weight * area.u)

    def plan_aware_paths(self, weights: Iterable[float]) -> list[Path]:
        """The shortest path, and the aware paths of some weights and of the requested ones."""
        paths = map(self.plan_aware, sorted({*weights, *self.requested_weights}))
        return [self.accepted[SHORTEST], *(path for path in paths if isinstance(path, Path))]


def generate_candidates(
    region: SearchRegion, user_candidates: UserCandidates
) -> tuple[dict[str, Path], dict[str, str]]:
    """Return all candidates by name, the shortest first, and why each rejected path is none."""
    accepted, left_out = region.accepted, dict[str, str]()
    user_paths = {
        name: path
        for name, path in user_candidates.items()
        if isinstance(path, Path) and not region.problem.find_violated_limit(path, region.costs)
    }
    densities: dict[str, DensityFunction] = {**INFLATED_DENSITIES, **FIELDLESS_DENSITIES}
    requested: dict[str, DensityFunction] = {}
    if not math.isnan(region.costs.weight):
        for weight in region.requested_weights:
            requested |= make_named_aware_density(weight)
        densities |= AWARE_DENSITIES | requested
    for name, density in densities.items():
        area = region.whole_map if name in requested else region
        path = area.plan_candidate(density(area))
        # Up to 0.1 m two paths are one; another one has a tenth of its points 0.35 m away from all.
        # What Nav2 would drive is shown beside, and takes no other path's place.
        limits = (0.35, 0.1) if name in FIELDLESS_DENSITIES else (0.1, 0.0)
        if isinstance(path, str):
            left_out[name] = path
        elif twin := find_similar_path_name(path, {**accepted, **user_paths}, 0.1, 0.0):
            left_out[name] = f"same path as {short_repr(twin)}"
        elif twin := find_similar_path_name(
            path, _drop_paths(accepted, INFLATED_DENSITIES), *limits
        ):
            left_out[name] = f"nearly the same path as {short_repr(twin)}"
        else:
            accepted[name] = path
    reserved = {*INFLATED_DENSITIES, *FIELDLESS_DENSITIES, *AWARE_DENSITIES, *densities}
    add_user_candidates(
        user_candidates, accepted, left_out, region.costs, region.problem, reserved_names=reserved
    )
    return accepted, left_out


def _drop_paths(paths: Mapping[str, Path], names: Collection[str]) -> dict[str, Path]:
    return {name: path for name, path in paths.items() if name not in names}


def find_similar_path_name(
    path: Path, other_paths: Mapping[str, Path], max_distance: float, max_far_share: float
) -> str:
    """Name of the first path that all but a share of a path's points are near [m], or none."""
    points = path.resample(0.25, even=True).xy
    for name, other in other_paths.items():
        if float((compute_distances_to_path(points, other) > max_distance).mean()) <= max_far_share:
            return name
    return ""


AnyCandidate: TypeAlias = str | Planner | Path | Plan | ParetoFront | ArrayLike
"""A planner by name or as an object, a path, a plan, a front, or positions (n, 2) [m]."""
Candidates: TypeAlias = Mapping[str, AnyCandidate] | Sequence[AnyCandidate]
UserCandidates: TypeAlias = dict[str, Path | Planner | str]
"""Candidates of a user's by name: a path, a planner, or why there is no path."""


def parse_user_candidates(candidates: Candidates) -> UserCandidates:
    """What a user gives as candidates.

    Raises
    ------
    ConfigError
        If a candidate is none, or two have one name.
    """
    if isinstance(candidates, (str, Planner, Path, Plan, ParetoFront)):
        candidates = [candidates]
    candidates_by_name: Iterable[tuple[str, AnyCandidate]]
    if isinstance(candidates, Mapping):
        candidates_by_name = candidates.items()
    elif isinstance(candidates, Iterable):
        candidates_by_name = [
            (_choose_candidate_name(candidate, n), candidate)
            for n, candidate in enumerate(candidates, 1)
        ]
    else:
        raise ConfigError(
            "candidates must be a sequence or a mapping of paths, plans, fronts or planners,"
            f" not {short_repr(candidates)}"
        )
    user_candidates: UserCandidates = {}
    for name, candidate_like in candidates_by_name:
        for label, candidate in _iterate_paths(name, candidate_like):
            if label in user_candidates:
                raise ConfigError(f"two candidates are called {short_repr(label)}; name them")
            user_candidates[label] = candidate
    return user_candidates


def _choose_candidate_name(candidate: AnyCandidate, number: int) -> str:
    if isinstance(candidate, str):
        return candidate
    if isinstance(candidate, ParetoFront):
        return "front"
    if isinstance(candidate, Plan):
        return f"plan {number}, {candidate.planner}"
    return candidate.name if isinstance(candidate, Planner) else f"path {number}"


def _iterate_paths(
    name: str, candidate_like: AnyCandidate
) -> Iterator[tuple[str, Path | Planner | str]]:
    """Yield the named paths of a user's candidate, its planner, or why it has no path."""
    if isinstance(candidate_like, (str, Planner)):
        yield name, make_planner(candidate_like)
    elif isinstance(candidate_like, Plan):
        yield name, candidate_like.path or candidate_like.note or candidate_like.status
    elif not isinstance(candidate_like, ParetoFront):
        yield (
            name,
            candidate_like
            if isinstance(candidate_like, Path)
            else Path(np.asarray(candidate_like)),
        )
    elif len(candidate_like):  # five, from its shortest to its longest
        indices = np.unique(np.linspace(0, len(candidate_like) - 1, 5).round()).astype(int).tolist()
        for n, index in enumerate(indices, 1):
            front_plan = candidate_like.plan(index)
            yield f"{name} {n}", front_plan.path or front_plan.status
    else:
        yield name, "has no path"


def check_user_candidates(user_candidates: UserCandidates, problem: PlanningProblem) -> None:
    """Check a user's paths, before long work.

    Raises
    ------
    LocplanError
        If one does not join start and goal, or leaves the free cells.
    """
    paths = {name: path for name, path in user_candidates.items() if isinstance(path, Path)}
    for name, path in paths.items():
        for end, at, (x, y) in (
            ("start", problem.start, path.xy[0]),
            ("goal", problem.goal, path.xy[-1]),
        ):
            if math.hypot(x - at[0], y - at[1]) > MAX_PLACE_DISTANCE:
                raise ConfigError(
                    f"candidate {short_repr(name)} has its {end} at {x:.2f},{y:.2f}, more than"
                    f" {MAX_PLACE_DISTANCE:g} m from the {end} that was asked for"
                )
    for name, path in paths.items():
        make_path_poses(path, problem.grid, f"candidate {name}")


def add_user_candidates(
    user_candidates: UserCandidates,
    accepted: dict[str, Path],
    left_out: dict[str, str],
    costs: Costmap,
    problem: PlanningProblem,
    *,
    reserved_names: Collection[str] = (),
    skipped_planner: Planner | None = None,
) -> None:
    """Add a user's paths that keep the limits, and record why the rest do not.

    Users cannot take reserved names. The path of the planner `skipped_planner` is there already.
    """
    settings, new_candidates = problem.settings, dict(user_candidates)
    if settings.front:
        new_candidates.update(
            _iterate_paths("front", pareto_front(costs, problem.start[:2], problem.goal[:2]))
        )
    for name, path in new_candidates.items():
        if path is skipped_planner:
            continue
        if isinstance(path, Planner):
            candidate_plan = problem.plan_least_cost(costs, path, limited=settings.budget is None)
            path = candidate_plan.path or format_failure(candidate_plan)
        fault = path if isinstance(path, str) else problem.find_violated_limit(path, costs)
        while name in (*accepted, *left_out, *reserved_names):
            name = f"own {name}"
        if isinstance(path, str) or fault:
            left_out[name] = fault
        else:
            accepted[name] = path


def format_failure(failed_plan: Plan) -> str:
    """Why a plan has no path."""
    return f"{failed_plan.status}: {failed_plan.note}" if failed_plan.note else failed_plan.status

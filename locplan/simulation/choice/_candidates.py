"""Candidates of a choice: paths of least cost on a few densities of a map, and a user's own."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import shown
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField
from locplan.planners import SHORTEST, ParetoFront, Plan, Planner, pareto_front, planner_for
from locplan.simulation._worlds import Window, poses_along, window_about
from locplan.simulation.choice._ask import NEAR, Ask, distances_to
from locplan.simulation.choice._densities import (
    AWARE,
    DENSITIES,
    INFLATED,
    Density,
    Ground,
    aware,
    blocked_of,
)


def deviation_along(path: Path, field: CovarianceField) -> tuple[float, float]:
    """Mean and greatest of the largest position deviation in a field along a path [m]."""
    deviation = field.at(path.resampled(field.grid.resolution, even=True).xy, "position_std")
    deviation = deviation[np.isfinite(deviation)]
    if not deviation.size:
        return math.nan, math.nan
    return float(deviation.mean()), float(deviation.max())


MARGIN = 3.0
"""Margin of the part of the map that paths are planned on; clearance counts up to there [m]."""


@dataclass(frozen=True)
class Part(Ground):
    """The part of a map that paths between two places may take, and what is known there."""

    costs: Costmap
    """Costmap of the whole map, with a field or without one."""
    window: Window
    """Rows and columns of the part."""
    ask: Ask
    """What is asked."""
    longest: float
    """Maximum length of a candidate [m]."""

    @classmethod
    def about(cls, costs: Costmap, shortest: Path, ask: Ask) -> Part:
        """The part of a costmap in which all paths up to the maximum length lie."""
        start, goal = shortest.xy[0], shortest.xy[-1]
        longest = ask.settings.longest * shortest.length
        # They lie in an ellipse about both ends, of which a and b are half the axes.
        a = longest / 2
        b = math.sqrt(max(0.0, a**2 - float(np.sum((goal - start) ** 2)) / 4))
        turn, round_it = math.atan2(*(goal - start)[::-1]), np.linspace(0, 2 * np.pi, 64)
        along, across = a * np.cos(round_it), b * np.sin(round_it)
        x = along * math.cos(turn) - across * math.sin(turn)
        y = along * math.sin(turn) + across * math.cos(turn)
        xy = (start + goal) / 2 + np.column_stack([x, y])
        cells = np.column_stack(costs.grid.world_to_grid(*xy.T))
        window = window_about(costs.grid, cells, MARGIN / costs.grid.resolution)
        grid, u = costs.grid.part(*window), costs.u[window]
        return cls(grid, u, ask.robot, {SHORTEST: shortest}, costs, window, ask, longest)

    @cached_property
    def whole_map(self) -> Part:
        """The whole map, on which a path may be of any length."""
        costs = self.costs
        same: Any = {"window": np.s_[:, :], "ask": self.ask, "longest": math.inf}
        return Part(costs.grid, costs.u, self.robot, self.accepted, costs, **same)

    @property
    def requested_weights(self) -> list[float]:
        """Weights whose aware paths race at any length: the costmap's, and the one asked for."""
        weights = self.costs.weight, self.ask.settings.weight
        return [weight for weight in weights if weight is not None and not math.isnan(weight)]

    def plan_on(self, density: NDArray[np.float64]) -> Path | str:
        """Return the path of least cost on a density of the part, or why it is no candidate."""
        costs = self.costs
        blocked = blocked_of(costs, self.ask.settings.max_e, self.window)
        layer = Costmap.from_density(self.grid, np.where(blocked, np.inf, density))
        result = self.ask.planned(layer, limited=False)
        path = result.path
        if path is None:
            return why_without(result)
        if path.length > self.longest:
            ratio = self.ask.settings.longest
            return f"{path.length:.1f} m, more than {ratio:g} times the shortest"
        return self.ask.fault_of(path, costs) or path

    def plan_aware(self, weight: float) -> Path | str:
        """Return the aware path of a weight, or why it is no candidate."""
        ground = self.whole_map if weight in self.requested_weights else self
        return ground.plan_on(1 + weight * ground.u)

    def aware_paths(self, weights: Iterable[float]) -> list[Path]:
        """The shortest path, and the aware paths of some weights and of the requested ones."""
        paths = map(self.plan_aware, sorted({*weights, *self.requested_weights}))
        return [self.accepted[SHORTEST], *(path for path in paths if isinstance(path, Path))]


def candidates_of(part: Part, own: Own) -> tuple[dict[str, Path], dict[str, str]]:
    """All candidates by name, the shortest first, and why others are none."""
    found, left_out = part.accepted, dict[str, str]()
    user_paths = {
        name: path
        for name, path in own.items()
        if isinstance(path, Path) and not part.ask.fault_of(path, part.costs)
    }
    densities: dict[str, Density] = {**INFLATED, **DENSITIES}
    requested: dict[str, Density] = {}
    if not math.isnan(part.costs.weight):
        for weight in part.requested_weights:
            requested |= aware(weight)
        densities |= AWARE | requested
    for name, density in densities.items():
        ground = part.whole_map if name in requested else part
        path = ground.plan_on(density(ground))
        # Up to 0.1 m two paths are one; another one has a tenth of its points 0.35 m off all.
        # What Nav2 would drive is shown beside, and takes no other path's place.
        limits = (0.35, 0.1) if name in DENSITIES else (0.1, 0.0)
        if isinstance(path, str):
            left_out[name] = path
        elif twin := twin_of(path, {**found, **user_paths}, 0.1, 0.0):
            left_out[name] = f"the same path as {shown(twin)}"
        elif twin := twin_of(path, _without(found, INFLATED), *limits):
            left_out[name] = f"nearly the same path as {shown(twin)}"
        else:
            found[name] = path
    reserved = {*INFLATED, *DENSITIES, *AWARE, *densities}
    add_own(own, found, left_out, part.costs, part.ask, reserved=reserved)
    return found, left_out


def _without(paths: Mapping[str, Path], names: Collection[str]) -> dict[str, Path]:
    return {name: path for name, path in paths.items() if name not in names}


def twin_of(path: Path, others: Mapping[str, Path], distance: float, share: float) -> str:
    """Name of the first path that all but a share of a path's points are near [m], or none."""
    points = path.resampled(0.25, even=True).xy
    for name, other in others.items():
        if float((distances_to(points, other) > distance).mean()) <= share:
            return name
    return ""


AnyCandidate: TypeAlias = str | Planner | Path | Plan | ParetoFront | ArrayLike
"""A planner by name or as an object, a path, a plan, a front, or positions (n, 2) [m]."""
Candidates: TypeAlias = Mapping[str, AnyCandidate] | Sequence[AnyCandidate]
Own: TypeAlias = dict[str, Path | Planner | str]
"""Candidates of a user's by name: a path, a planner, or why there is no path."""


def own_of(candidates: Candidates) -> Own:
    """What a user gives as candidates.

    Raises
    ------
    ConfigError
        If a candidate is none, or two have one name.
    """
    if isinstance(candidates, (str, Planner, Path, Plan, ParetoFront)):
        candidates = [candidates]
    named: Iterable[tuple[str, AnyCandidate]]
    if isinstance(candidates, Mapping):
        named = candidates.items()
    elif isinstance(candidates, Iterable):
        named = [(_name_of(each, n), each) for n, each in enumerate(candidates, 1)]
    else:
        raise ConfigError(
            "candidates must be a sequence or a mapping of paths, plans, fronts or planners,"
            f" not {shown(candidates)}"
        )
    own: Own = {}
    for name, given in named:
        for label, each in _paths_of(name, given):
            if label in own:
                raise ConfigError(f"two candidates are called {shown(label)}; name them")
            own[label] = each
    return own


def _name_of(candidate: AnyCandidate, number: int) -> str:
    if isinstance(candidate, str):
        return candidate
    if isinstance(candidate, ParetoFront):
        return "front"
    if isinstance(candidate, Plan):
        return f"plan {number}, {candidate.planner}"
    return candidate.name if isinstance(candidate, Planner) else f"path {number}"


def _paths_of(name: str, given: AnyCandidate) -> Iterator[tuple[str, Path | Planner | str]]:
    """The paths of what is given, its planner, or why it has no path."""
    if isinstance(given, (str, Planner)):
        yield name, planner_for(given)
    elif isinstance(given, Plan):
        yield name, given.path or given.note or given.status
    elif not isinstance(given, ParetoFront):
        yield name, given if isinstance(given, Path) else Path(np.asarray(given))
    elif len(given):  # five, from its shortest to its longest
        indices = np.unique(np.linspace(0, len(given) - 1, 5).round()).astype(int).tolist()
        for n, index in enumerate(indices, 1):
            made = given.plan(index)
            yield f"{name} {n}", made.path or made.status
    else:
        yield name, "has no path"


def check_own(own: Own, ask: Ask) -> None:
    """Check a user's paths, before long work.

    Raises
    ------
    LocplanError
        If one does not join start and goal, or leaves the free cells.
    """
    paths = {name: path for name, path in own.items() if isinstance(path, Path)}
    for name, path in paths.items():
        for end, at, (x, y) in (("start", ask.start, path.xy[0]), ("goal", ask.goal, path.xy[-1])):
            if math.hypot(x - at[0], y - at[1]) > NEAR:
                raise ConfigError(
                    f"candidate {shown(name)} has its {end} at {x:.2f},{y:.2f}, more than"
                    f" {NEAR:g} m from the {end} that was asked for"
                )
    for name, path in paths.items():
        poses_along(path, ask.grid, f"candidate {name}")


def add_own(
    own: Own,
    found: dict[str, Path],
    left_out: dict[str, str],
    costs: Costmap,
    ask: Ask,
    *,
    reserved: Collection[str] = (),
    but: Planner | None = None,
) -> None:
    """Add a user's paths that keep the limits to others, and why the rest do not.

    Reserved names belong to others. The path of one planner may be there already, `but`.
    """
    asked, given = ask.settings, dict(own)
    if asked.front:
        given.update(_paths_of("front", pareto_front(costs, ask.start[:2], ask.goal[:2])))
    for name, path in given.items():
        if path is but:
            continue
        if isinstance(path, Planner):
            made = ask.planned(costs, path, limited=asked.budget is None)
            path = made.path or why_without(made)
        fault = path if isinstance(path, str) else ask.fault_of(path, costs)
        while name in (*found, *left_out, *reserved):
            name = f"own {name}"
        if isinstance(path, str) or fault:
            left_out[name] = fault
        else:
            found[name] = path


def why_without(made: Plan) -> str:
    """Why a plan has no path."""
    return f"{made.status}: {made.note}" if made.note else made.status

"""Candidates of a choice: paths of least cost on a few densities of a map, and a user's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import shown
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField, values_at
from locplan.maps import OccupancyGrid
from locplan.planners import SHORTEST, ParetoFront, Plan, Planner, pareto_front, planner_for
from locplan.simulation._worlds import Window, inflated, window_about
from locplan.simulation.choice._ask import NEAR, Ask, distances_to
from locplan.simulation.choice._driven import lines_along


def deviation_along(path: Path, field: CovarianceField) -> tuple[float, float]:
    """Mean and greatest of the largest position deviation in a field along a path [m]."""
    grid = field.grid
    at = grid.world_to_grid(*path.resampled(grid.resolution, even=True).xy.T)
    rows, cols = (
        np.clip(np.floor(each).astype(int), 0, size - 1)
        for each, size in zip(at, grid.shape, strict=True)
    )
    found = values_at(field, field.scalar("position_std", headings="mean"), rows, cols)
    found = found[grid.free[rows, cols] & np.isfinite(found)]
    return (float(found.mean()), float(found.max())) if found.size else (math.nan, math.nan)


MARGIN = 3.0
"""Margin of the part of the map that paths are planned on; clearance counts up to there [m]."""
WEIGHTS = (4.0, 8.0, 12.0)
"""Weights of the degeneracy u of the aware paths."""


@dataclass(frozen=True)
class Part:
    """The part of a map that paths between two places may take, and what is known there."""

    costs: Costmap
    """Costmap of the whole map, with a field or without one."""
    window: Window
    """Rows and columns of the part."""
    grid: OccupancyGrid
    """The part."""
    ask: Ask
    """What is asked."""
    longest: float
    """Maximum length of a candidate [m]."""
    accepted: dict[str, Path]
    """Candidates until now, the shortest first."""

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
        return cls(costs, window, costs.grid.part(*window), ask, longest, {SHORTEST: shortest})

    @property
    def u(self) -> NDArray[np.float64]:
        """Degeneracy of each cell."""
        return self.costs.u[self.window]

    @cached_property
    def clear(self) -> NDArray[np.float64]:
        """Density that keeps off the walls."""
        return 1 + 3 * np.exp(-(self.grid.clearance - self.ask.robot.radius) / 0.4)

    @property
    def inflated(self) -> NDArray[np.float64]:
        """Density that Nav2's planners see in an inflated costmap."""
        return inflated(self.grid.clearance, self.ask.robot)

    @property
    def beside(self) -> NDArray[np.float64]:
        """1 on the candidates until now, falling to 1/e at 1 m from them."""
        return np.exp(-(self._distance_to(*self.accepted.values()) ** 2))

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Cells within 1.5 m of the middle of the shortest path."""
        shortest = self.accepted[SHORTEST]
        middle = [np.interp(shortest.length / 2, shortest.distance, v) for v in shortest.xy.T]
        return self._distance_to(Path(np.array([middle]))) < 1.5

    def planned(self, density: NDArray[np.float64]) -> Path | None:
        """The path of least cost on a density of the part, if it keeps all limits."""
        costs, asked = self.costs, self.ask.settings
        blocked = ~np.isfinite(costs.density[self.window])
        if asked.max_e is not None:
            blocked |= costs.e[self.window] > asked.max_e
        layer = Costmap.from_density(self.grid, np.where(blocked, np.inf, density))
        path = self.ask.planned(layer, limited=False).path
        if path is None or path.length > self.longest or self.ask.fault_of(path, costs):
            return None
        return path

    def aware_paths(self, weights: Iterable[float]) -> list[Path]:
        """The shortest path, and the aware paths of some weights."""
        found = [self.planned(1 + weight * self.u) for weight in weights]
        return [self.accepted[SHORTEST], *(path for path in found if path is not None)]

    def _distance_to(self, *paths: Path) -> NDArray[np.float64]:
        import cv2

        away = np.ones(self.grid.shape, np.uint8)
        for path in paths:
            fine = path.resampled(self.grid.resolution / 2) if path.length else path
            cells = np.floor(self.grid.world_to_grid(*fine.xy.T)).astype(np.int64)
            away[tuple(np.clip(cells, 0, np.array(away.shape)[:, None] - 1))] = 0
        cells = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(cells * self.grid.resolution, np.float64)


Density: TypeAlias = Callable[[Part], NDArray[np.float64]]
"""Cost per metre of each cell of a part of a map."""


def _aware(weight: float) -> dict[str, Density]:
    return {f"aware, weight {weight:g}": lambda part: 1 + weight * part.u}


INFLATED: dict[str, Density] = {"inflated": lambda part: part.inflated}
"""That of the robot's own inflated costmap, on which its navigation would plan."""
DENSITIES: dict[str, Density] = {
    "clear of walls": lambda part: part.clear,
    "along walls": lambda part: 1 + 3 * np.minimum(abs(part.grid.clearance - 0.6), 1.5),
    "a metre off walls": lambda part: 1 + 2 * np.minimum(abs(part.grid.clearance - 1), 2),
    "detour": lambda part: part.clear + 50 * part.cut,
    "way around 1": lambda part: 1 + 1.2 * part.beside,
    "way around 2": lambda part: 1 + 2.5 * part.beside,
    "clear way around 1": lambda part: part.clear + 1.2 * part.beside,
    "clear way around 2": lambda part: part.clear + 2.5 * part.beside,
}
"""Those that need no field, whose paths must be others than those before. They were found to lower
the error of filters; the first is the best of them."""
AWARE: dict[str, Density] = {
    **{name: density for weight in WEIGHTS for name, density in _aware(weight).items()},
    "aware and clear": lambda part: part.clear + 8 * part.u,
}
"""Those that need a field, whose paths are candidates however near another one they are."""


def candidates_of(part: Part, own: Own) -> tuple[dict[str, Path], dict[str, str]]:
    """All candidates by name, the shortest first, and why others are none."""
    found, weight = part.accepted, part.ask.settings.weight
    densities = {**INFLATED, **DENSITIES}
    if not math.isnan(part.costs.weight):
        densities |= AWARE
        if weight is not None:
            densities |= _aware(weight)
    for name, density in densities.items():
        path = part.planned(density(part))
        if path is None or not is_beside(path, found.values(), 0.1, 0.0):
            continue
        # Up to 0.1 m two paths are one; another one has a tenth of its points 0.35 m off all.
        # What Nav2 would drive is shown beside, and takes no other path's place.
        others = [each for label, each in found.items() if label not in INFLATED]
        if name not in DENSITIES or is_beside(path, others, 0.35, 0.1):
            found[name] = path
    left_out: dict[str, str] = {}
    reserved = {**INFLATED, **DENSITIES, **AWARE}
    add_own(own, found, left_out, part.costs, part.ask, reserved=reserved)
    return found, left_out


def is_beside(path: Path, others: Iterable[Path], distance: float, share: float) -> bool:
    """Whether more than a share of a path's points are farther from each other path [m]."""
    points = path.resampled(0.25, even=True).xy
    return all(float((distances_to(points, each) > distance).mean()) > share for each in others)


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
    lines_along(paths, ask.grid)


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
    limit = asked.longest * found[SHORTEST].length if SHORTEST in found else math.inf
    for name, path in given.items():
        if path is but:
            continue
        if isinstance(path, Planner):
            made = ask.planned(costs, path, limited=asked.budget is None)
            path = made.path or why_without(made)
        fault = path if isinstance(path, str) else ask.fault_of(path, costs)
        if isinstance(path, str) or fault:
            left_out[name] = fault
        elif path.length > limit and not isinstance(own.get(name), Path):
            left_out[name] = f"is longer than {limit:.1f} m, {asked.longest:g} times the shortest"
        else:
            while name in (*found, *reserved):
                name = f"own {name}"
            found[name] = path


def why_without(made: Plan) -> str:
    """Why a plan has no path."""
    return f"{made.status}: {made.note}" if made.note else made.status

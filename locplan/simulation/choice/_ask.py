"""What is asked of a choice: two places and the limits between them, and a user's own paths."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import shown
from locplan._util.poses import Poses
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, LocplanError
from locplan.maps import OccupancyGrid
from locplan.planners import (
    SHORTEST,
    ParetoFront,
    Plan,
    Planner,
    Position,
    pareto_front,
    plan,
    plan_beside_shortest,
    planner_for,
)
from locplan.robots import Robot
from locplan.simulation._worlds import poses_along
from locplan.simulation.choice._settings import ChoiceSettings

AnyCandidate: TypeAlias = str | Planner | Path | Plan | ParetoFront | ArrayLike
"""A planner by name or as an object, a path, a plan, a front, or positions (n, 2) [m]."""
Candidates: TypeAlias = Mapping[str, AnyCandidate] | Sequence[AnyCandidate]
NEAR = 0.5
"""Maximum distance of a path's ends from start and goal [m]."""


@dataclass(frozen=True)
class Ask:
    """What is asked: two places on a map, the limits of the paths, and the robot."""

    grid: OccupancyGrid
    """The map."""
    start: Position
    """Position of the start, checked [m, rad]."""
    goal: Position
    """Position of the goal, checked [m, rad]."""
    settings: ChoiceSettings
    """The limits, with waypoints that were checked."""
    robot: Robot
    """The robot."""

    @property
    def flat(self) -> Ask:
        """The same without headings."""
        via = tuple(each[:2] for each in self.settings.via)
        settings = dataclasses.replace(self.settings, via=via)
        return dataclasses.replace(
            self, start=self.start[:2], goal=self.goal[:2], settings=settings
        )

    def check(self, costs: Costmap | None) -> None:
        """Raise a ConfigError unless the limits go together, and with a costmap that is given."""
        planner_for(None, **self._limits(limited=True))
        if costs is not None and self.settings.is_limited and math.isnan(costs.weight):
            raise ConfigError(
                "a costmap without a field has no e or u to limit; give one of a field, or leave"
                " out max_e and budget"
            )

    def planned(
        self, costs: Costmap, planner: Planner | None = None, *, limited: bool = True
    ) -> Plan:
        """The plan of least cost over the waypoints, for the outline; without limits of e or u
        unless it is to be limited."""
        return plan(costs, self.start, self.goal, planner=planner, **self._limits(limited))

    def shortest(self, costs: Costmap) -> Path | None:
        """The shortest path without limits, as others that are shown beside an aware one."""
        if math.isnan(costs.weight):
            return None
        limits = self._limits(limited=False)
        return plan_beside_shortest(costs, self.start, self.goal, **limits)[SHORTEST].path

    def beside_shortest(self, costs: Costmap, planner: Planner | None = None) -> dict[str, Plan]:
        """The aware plan within all limits, and the shortest one."""
        limits = self._limits(limited=True)
        planner = planner if self.settings.budget is None else None
        return plan_beside_shortest(costs, self.start, self.goal, planner=planner, **limits)

    def _limits(self, limited: bool) -> dict[str, Any]:
        asked = self.settings
        # With a budget the robot counts as the circle within its outline.
        outline = self.robot.outline if asked.budget is None else None
        every: dict[str, Any] = {"via": asked.via, "footprint": outline}
        return every | ({"max_e": asked.max_e, "budget": asked.budget} if limited else {})

    def fault_of(self, path: Path, costs: Costmap) -> str:
        """Which limit a path does not keep; empty if it keeps all."""
        asked, outline = self.settings, self.robot.outline
        for x, y, *_ in asked.via:
            if not len(path) or distances_to(np.array([[x, y]]), path)[0] > NEAR:
                return f"does not visit {x:g},{y:g}"
        if asked.budget is None and outline is not None:
            collision = outline.first_collision(self.grid, path)
            if collision:
                return "the robot's outline meets a wall near {:.2f},{:.2f}".format(*collision)
        if asked.max_e is None and asked.budget is None:
            return ""
        metrics = path_metrics(costs, path)
        if asked.max_e is not None and not metrics.max_e <= asked.max_e:
            return f"enters cells with e above {asked.max_e:g} m² rad"
        if asked.budget is not None and not metrics.integrated_u <= asked.budget * (1 + 1e-6):
            return f"has more than {asked.budget:g} degenerate metres"
        return ""


def distances_to(points: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """Distance of each point to a path, to a few centimetres [m]."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(path.resampled(0.1).xy).query(points)[0])


@dataclass(frozen=True)
class Own:
    """Candidates of a user's."""

    paths: Mapping[str, Path]
    """Paths by name."""
    planners: Mapping[str, Planner]
    """Planners by name, whose paths are candidates, too."""
    without: Mapping[str, str]
    """Why a plan or a front has no path, by its name."""

    @classmethod
    def of(cls, candidates: Candidates) -> Own:
        """What was given as candidates.

        Raises
        ------
        ConfigError
            If a candidate is none, or two have one name.
        """
        if isinstance(candidates, (str, Planner, Path, Plan, ParetoFront)):
            candidates = [candidates]
        paths: dict[str, Path] = {}
        planners: dict[str, Planner] = {}
        without: dict[str, str] = {}
        for name, given in _named(candidates):
            if isinstance(given, (str, Planner)):
                found: dict[str, Any] = {name: planner_for(given)}
            else:
                found = dict(_paths_of(name, given))
            if not found:
                without[name] = given.note if isinstance(given, Plan) else "has no path"
            for label, each in found.items():
                if label in paths or label in planners:
                    raise ConfigError(f"two candidates are called {shown(label)}; name them")
                if isinstance(each, Path):
                    paths[label] = each
                else:
                    planners[label] = each
        return cls(paths, planners, without)

    @property
    def planner(self) -> Planner | None:
        """The first planner; None without one."""
        return next(iter(self.planners.values()), None)

    @property
    def space(self) -> str:
        """The space in which the planners plan."""
        return next((each.space for each in self.planners.values() if each.space != "R2"), "R2")

    def check(self, ask: Ask) -> None:
        """Check the paths, before long work.

        Raises
        ------
        LocplanError
            If one does not join start and goal, or leaves the free cells.
        """
        for label, path in self.paths.items():
            for end, at in (("start", ask.start), ("goal", ask.goal)):
                x, y = path.xy[0 if end == "start" else -1]
                if math.hypot(x - at[0], y - at[1]) > NEAR:
                    raise ConfigError(
                        f"candidate {shown(label)} has its {end} at {x:.2f},{y:.2f}, more than"
                        f" {NEAR:g} m from the {end} that was asked for"
                    )
        lines_along(self.paths, ask.grid)

    def add_to(
        self,
        found: dict[str, Path],
        left_out: dict[str, str],
        costs: Costmap,
        ask: Ask,
        *,
        reserved: Collection[str] = (),
        but: Planner | None = None,
    ) -> None:
        """Add the paths that keep the limits to others, and why the rest do not.

        Reserved names belong to others. The path of one planner may be there already, `but`.
        """
        left_out.update(self.without)
        paths = dict(self.paths)
        for name, planner in self.planners.items():
            if planner is but:
                continue
            made = ask.planned(costs, planner, limited=ask.settings.budget is None)
            if made.path is None:
                left_out[name] = why_without(made)
            else:
                paths[name] = made.path
        if ask.settings.front:
            paths.update(_paths_of("front", pareto_front(costs, ask.start, ask.goal)))
        limit = ask.settings.longest * found[SHORTEST].length if SHORTEST in found else math.inf
        for name, path in paths.items():
            fault = ask.fault_of(path, costs)
            if path.length > limit and not fault and name not in self.paths:
                fault = f"is longer than {limit:.1f} m, {ask.settings.longest:g} times the shortest"
            if fault:
                left_out[name] = fault
                continue
            while name in (*found, *reserved):
                name = f"own {name}"
            found[name] = path


def why_without(made: Plan) -> str:
    """Why a plan has no path."""
    return f"{made.status}: {made.note}" if made.note else made.status


def note_on(made: Plan) -> str:
    """What a plan says of its path beside its metrics."""
    said = [made.note] if made.note else []
    if not made.minimises:
        said.append("any path, since its planner minimises nothing")
    if made.bound is not None:
        said.append(f"no path within the budget is shorter than {made.bound:.2f} m")
    return "; ".join(said)


def lines_along(paths: Mapping[str, Path], grid: OccupancyGrid) -> dict[str, Poses]:
    """Poses along each path; a LocplanError names the candidate that cannot be driven."""
    lines = {}
    for name, path in paths.items():
        try:
            lines[name] = poses_along(path, grid)
        except LocplanError as error:
            raise LocplanError(f"candidate {name}: {error}") from None
    return lines


def _named(candidates: Candidates) -> Iterable[tuple[str, AnyCandidate]]:
    if isinstance(candidates, Mapping):
        return candidates.items()
    if not isinstance(candidates, Iterable):
        raise ConfigError(
            "candidates must be a sequence or a mapping of paths, plans, fronts or planners,"
            f" not {shown(candidates)}"
        )
    return [(_name_of(each, n), each) for n, each in enumerate(candidates, 1)]


def _name_of(candidate: AnyCandidate, number: int) -> str:
    if isinstance(candidate, str):
        return candidate
    if isinstance(candidate, ParetoFront):
        return "front"
    if isinstance(candidate, Plan):
        return f"plan {number}, {candidate.planner}"
    return candidate.name if isinstance(candidate, Planner) else f"path {number}"


def _paths_of(name: str, given: AnyCandidate) -> Iterable[tuple[str, Path]]:
    if isinstance(given, ParetoFront):
        if len(given):
            # from its shortest to its longest
            indices = np.unique(np.linspace(0, len(given) - 1, 5).round()).tolist()
            for n, index in enumerate(indices, 1):
                point = given.plan(int(index)).path
                assert point is not None
                yield f"{name} {n}", point
        return
    path: Any = given.path if isinstance(given, Plan) else given
    if path is not None:
        yield name, path if isinstance(path, Path) else Path(np.asarray(path))

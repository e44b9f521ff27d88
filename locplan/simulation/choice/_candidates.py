"""Paths of a user's own among the candidates of a choice: paths, plans, planners, fronts."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from locplan._util.checks import shown
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.planners import ParetoFront, Plan, Planner, Position, plan

AnyCandidate: TypeAlias = str | Planner | Path | Plan | ParetoFront | ArrayLike
"""A planner by name or as an object, a path, a plan, a front, or positions (n, 2) [m]."""
Candidates: TypeAlias = Mapping[str, AnyCandidate] | Sequence[AnyCandidate]
FRONT_PATHS = 5
"""Number of paths that are taken of a Pareto front, from its shortest to its longest."""
NEAR = 0.5
"""Greatest distance of a path's ends from start and goal [m]."""


class CandidateWarning(UserWarning):
    """Warning that a candidate of the user's has no path."""


def own_paths(
    costs: Costmap, start: Position, goal: Position, candidates: Candidates
) -> dict[str, Path]:
    """Paths of a user's candidates by name; those of which there is none are warned of.

    Raises
    ------
    ConfigError
        If a candidate is none, two have one name, or a path does not join start and goal.
    """
    if isinstance(candidates, (str, Planner, Path, Plan, ParetoFront)):
        candidates = [candidates]
    found: dict[str, Path] = {}
    for name, given in _named(candidates):
        paths = dict(_paths_of(name, given, costs, start, goal))
        if not paths:
            warnings.warn(CandidateWarning(f"candidate {shown(name)} has no path"), stacklevel=3)
        for label, path in paths.items():
            if label in found:
                raise ConfigError(f"two candidates are called {shown(label)}; name them")
            for end, at in (("start", start), ("goal", goal)):
                xy = path.xy[0 if end == "start" else -1]
                if np.hypot(*(xy - at[:2])) > NEAR:
                    x, y = xy
                    raise ConfigError(
                        f"candidate {shown(label)} has its {end} at {x:.2f},{y:.2f}, more than"
                        f" {NEAR:g} m from the {end} that was asked for"
                    )
            found[label] = path
    return found


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


def _paths_of(
    name: str, given: AnyCandidate, costs: Costmap, start: Position, goal: Position
) -> Iterable[tuple[str, Path]]:
    if isinstance(given, ParetoFront):
        if len(given):
            indices = np.unique(np.linspace(0, len(given) - 1, FRONT_PATHS).round()).tolist()
            for n, index in enumerate(indices, 1):
                point = given.plan(int(index)).path
                assert point is not None
                yield f"{name} {n}", point
        return
    path: Any = given
    if isinstance(given, (str, Planner)):
        path = plan(costs, start, goal, planner=given)
    if isinstance(path, Plan):
        path = path.path
    if path is not None:
        yield name, path if isinstance(path, Path) else Path(np.asarray(path))

"""One run of one of OMPL's planners, from a costmap to a path."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import ConfigError, LocplanError
from locplan.planners._any_angle import prepare as prepare_any_angle
from locplan.planners._any_angle import straightened
from locplan.planners._grid import cheapest_cells, through_centres
from locplan.planners._spaces import check_space
from locplan.planners.ompl._bindings import base, util
from locplan.planners.ompl._kinds import KINDS, able
from locplan.planners.ompl._leading import lead
from locplan.planners.ompl._logs import logged
from locplan.planners.ompl._motions import Motions
from locplan.planners.ompl._roadmap import ROADMAPS, grow_roadmap
from locplan.planners.ompl._settings import check_settings, planner_of
from locplan.planners.ompl._setup import OPTIMAL, poses_of, problem_definition, space_information
from locplan.planners.ompl._stopping import SETTLED_AFTER, Limits, check_whole

EDGES_OF_A_BATCH = 30_000
"""Iterations of BITstar are edges: so many at least before it may count as converged."""
JOINED = 4
"""Neighbours by which free cells hold together: who may not cut corners has no others."""


def solve(
    costs: Costmap,
    start: Sequence[float],
    goal: Sequence[float],
    *,
    planner: str,
    space: str = "R2",
    turning_radius: float | None = None,
    time_limit: float | None = None,
    iterations: int | None = None,
    convergence: float | None = None,
    seed: int = 1,
    from_grid: bool = False,
    improve: bool = False,
    settings: Mapping[str, Any] | None = None,
    progress: ProgressCallback | None = None,
) -> dict[str, Any]:
    """A path by one of OMPL's planners, and how its cost fell.

    Parameters
    ----------
    costs : Costmap
        What travel costs.
    start, goal : (x, y) or (x, y, heading)
        World positions [m]; in all spaces but "R2" with a heading [rad].
    planner : str
        OMPL's name of it. RRT, RRTConnect, KPIECE1, BKPIECE1 and LBKPIECE1 do not look at costs
        and stop at the first path.
    space : str
        "R2"; "SE2", turning on the spot for nothing; "Dubins", curves driven forward;
        "ReedsShepp", curves that may reverse.
    turning_radius : float, optional
        Least radius of the curves [m].
    time_limit : float, optional
        The search ends after this [s]; 5 unless `iterations` are given.
    iterations : int, optional
        The search ends after so many; with the same seed it finds the same path.
    convergence : float, optional
        The search ends when J fell by less than this share over the latter half of its iterations.
    seed : int
        Of OMPL's random numbers, at least 1.
    from_grid : bool
        Begin with the grid planner's path: RRTstar and its kin grow their tree along it, roadmaps
        hold it, and what comes of it costs no more. In "R2" only.
    improve : bool
        Straighten the path at last as the any-angle planner does. In "R2" only.
    settings : mapping, optional
        OMPL's settings of the planner, such as ``{"range": 2.0}`` for its `setRange`.
    progress : callable, optional
        Called with what passed of the limit and the limit, in milliseconds or iterations.

    Returns
    -------
    dict
        Fields of `Plan`: "path" or, unless nothing joins start and goal, "status" "timeout"; and
        "history".
    """
    motions = Motions(costs, space, turning_radius)
    if not _joined(costs, start, goal):
        return {}  # what no path over the grid joins, no motion does
    direct = motions.path(np.array([start, goal]))
    if motions.cost(start, goal) <= direct.length * (1 + OPTIMAL) + OPTIMAL:
        return {"path": direct, "history": ((0.0, path_metrics(costs, direct).cost),)}
    ahead = None
    if from_grid:
        cells = cheapest_cells(costs, start, goal, allow_corner_cutting=False)
        assert cells is not None
        ahead = through_centres(costs, cells, start, goal, trim=True)
    limits = Limits(time_limit, iterations, convergence, progress)
    began = time.perf_counter()
    search = _by_roadmap if planner in ROADMAPS else _by_tree
    poses = search(planner, motions, start, goal, limits, seed, settings or {}, ahead)
    found = [] if poses is None else [motions.path(poses)]
    found += [ahead] if ahead else []
    if not found:
        note = (
            f"no path found within {limits.description()}; more of it or another seed may find one"
        )
        return {"status": "timeout", "note": note}
    path = min(found, key=lambda one: path_metrics(costs, one).cost)
    history = (*limits.history, (time.perf_counter() - began, path_metrics(costs, path).cost))
    return {"path": straightened(costs, path) if improve else path, "history": history}


def check_options(
    *,
    planner: str,
    space: str = "R2",
    turning_radius: float | None = None,
    time_limit: float | None = None,
    iterations: int | None = None,
    convergence: float | None = None,
    seed: int = 1,
    from_grid: bool = False,
    improve: bool = False,
    settings: Mapping[str, Any] | None = None,
    progress: ProgressCallback | None = None,
) -> None:
    """Raise a ConfigError unless `solve` takes these."""
    kind = KINDS[planner]
    check_space(space, turning_radius)
    if space not in kind.spaces:
        raise ConfigError(f"{planner} cannot plan in {space}; {able(space=space)} can")
    if from_grid and not (kind.from_grid and space == "R2"):
        raise ConfigError(f"from_grid is for {able(from_grid=True)}, in space R2")
    if improve and space != "R2":
        raise ConfigError("improve is for space R2: straight lines keep no turning radius")
    Limits(time_limit, iterations, convergence, progress)
    if convergence is not None and not kind.anytime:
        raise ConfigError(f"convergence is for {able(anytime=True)}")
    check_whole("seed", seed)
    check_settings(planner, settings or {})


def prepare(*, planner: str, space: str = "R2", **_: Any) -> None:
    """Compile the kernels, so that the first plan is not timed with them."""
    from locplan.maps import FREE, OccupancyGrid

    prepare_any_angle()
    costs = Costmap.blank(OccupancyGrid(np.full((3, 9), FREE), 1.0))
    # The kernels are the same for all spaces: one call compiles them for all.
    motions = Motions(costs, "Dubins", 1.0)
    poses = np.array([[0.5, 1.5, 0.0], [7.5, 1.5, 0.0]])
    motions.cost(*poses)
    motions.costs_between(poses, np.array([[0, 1]]))
    motions.path(poses)
    motions.is_free(*poses[0, :2])


def _joined(costs: Costmap, start: Sequence[float], goal: Sequence[float]) -> bool:
    """Whether any path over free cells joins two positions."""
    import cv2

    free = np.isfinite(costs.density).astype(np.uint8)
    _, part = cv2.connectedComponents(free, connectivity=JOINED)
    one, other = (part[costs.grid.world_to_cell(*pose[:2])] for pose in (start, goal))
    return bool(one == other)


def _by_tree(
    planner: str,
    motions: Motions,
    start: Sequence[float],
    goal: Sequence[float],
    limits: Limits,
    seed: int,
    settings: Mapping[str, Any],
    ahead: Path | None,
) -> NDArray[np.float64] | None:
    """The poses (n, 3) that the path's motions join, or None."""
    with logged():
        util.RNG.setSeed(seed)
        information = space_information(motions)
        problem = problem_definition(information, motions, start, goal)
        tree = planner_of(planner, information, settings)
        tree.setProblemDefinition(problem)
        tree.setup()
        best_cost = (lambda: tree.bestCost().value()) if hasattr(tree, "bestCost") else None
        least = EDGES_OF_A_BATCH if planner == "BITstar" else SETTLED_AFTER
        ends = limits.condition(best_cost, settled_after=least)
        if ahead is not None:
            ends = lead(tree, information, problem, ahead.xy, goal, ends)
        status = tree.solve(base.PlannerTerminationCondition(ends))
        kinds = base.PlannerStatus.PlannerStatusType
        if status.getStatus() in (kinds.INVALID_START, kinds.INVALID_GOAL):
            raise LocplanError(
                f"OMPL refuses {tuple(start)} or {tuple(goal)} as a state in {motions.space}"
            )
        if status.getStatus() != kinds.EXACT_SOLUTION:
            return None
        poses = poses_of(problem.getSolutionPath(), motions.space)
    poses[[0, -1], : len(start)] = start, goal
    return poses


def _by_roadmap(
    planner: str,
    motions: Motions,
    start: Sequence[float],
    goal: Sequence[float],
    limits: Limits,
    seed: int,
    settings: Mapping[str, Any],
    ahead: Path | None,
) -> NDArray[np.float64] | None:
    positions = ahead.xy if ahead else None
    roadmap = grow_roadmap(
        motions, planner=planner, limits=limits, seed=seed, settings=settings, ahead=positions
    )
    return roadmap.poses_between(start, goal)

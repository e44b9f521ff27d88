"""One run of one of OMPL's planners, from a costmap to a path."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import LocplanError
from locplan.planners._any_angle import AnyAngle, straightened
from locplan.planners._grid import cheapest_cells, through_centres
from locplan.planners._protocol import Found, Position
from locplan.planners.ompl._bindings import base, util
from locplan.planners.ompl._leading import lead
from locplan.planners.ompl._logs import logged
from locplan.planners.ompl._motions import Motions
from locplan.planners.ompl._options import Options
from locplan.planners.ompl._roadmap import ROADMAPS, grow_roadmap
from locplan.planners.ompl._settings import planner_of
from locplan.planners.ompl._setup import OPTIMAL, poses_of, problem_definition, space_information
from locplan.planners.ompl._stopping import SEED, SETTLED_AFTER, Limits

EDGES_OF_A_BATCH = 30_000
"""Iterations of BITstar are edges: so many at least before it may count as converged."""
JOINED = 4
"""Neighbours by which free cells hold together: who may not cut corners has no others."""


def solve(planner: Options, costs: Costmap, start: Position, goal: Position) -> Found:
    """A path by one of OMPL's planners, and how its cost fell."""
    motions = Motions(costs, planner.space, planner.turning_radius)
    if not _joined(costs, start, goal):
        return Found()  # what no path over the grid joins, no motion does
    direct = motions.path(np.array([start, goal]))
    if motions.cost(start, goal) <= direct.length * (1 + OPTIMAL) + OPTIMAL:
        return Found(direct, history=((0.0, path_metrics(costs, direct).cost),))
    ahead = None
    if planner.from_grid:
        cells = cheapest_cells(costs, start, goal, allow_corner_cutting=False)
        assert cells is not None
        ahead = through_centres(costs, cells, start, goal, trim=True)
    limits = planner.limits
    began = time.perf_counter()
    search = _by_roadmap if planner.name in ROADMAPS else _by_tree
    poses = search(planner, motions, start, goal, limits, ahead)
    found = [] if poses is None else [motions.path(poses)]
    found += [ahead] if ahead else []
    if not found:
        note = (
            f"no path found within {limits.description()}; more of it or another seed may find one"
        )
        return Found(status="timeout", note=note)
    path = min(found, key=lambda one: path_metrics(costs, one).cost)
    history = (*limits.history, (time.perf_counter() - began, path_metrics(costs, path).cost))
    return Found(straightened(costs, path) if planner.improve else path, history=history)


def prepare() -> None:
    """Compile the kernels, so that the first plan is not timed with them."""
    from locplan.maps import FREE, OccupancyGrid

    AnyAngle().prepare()
    costs = Costmap.blank(OccupancyGrid(np.full((3, 9), FREE), 1.0))
    # The kernels are the same for all spaces: one call compiles them for all.
    motions = Motions(costs, "Dubins", 1.0)
    poses = np.array([[0.5, 1.5, 0.0], [7.5, 1.5, 0.0]])
    motions.cost(*poses)
    motions.costs_between(poses, np.array([[0, 1]]))
    motions.path(poses)
    motions.is_free(*poses[0, :2])


def _joined(costs: Costmap, start: Position, goal: Position) -> bool:
    """Whether any path over free cells joins two positions."""
    import cv2

    free = np.isfinite(costs.density).astype(np.uint8)
    _, part = cv2.connectedComponents(free, connectivity=JOINED)
    one, other = (part[costs.grid.world_to_cell(*pose[:2])] for pose in (start, goal))
    return bool(one == other)


def _by_tree(
    planner: Options,
    motions: Motions,
    start: Position,
    goal: Position,
    limits: Limits,
    ahead: Path | None,
) -> NDArray[np.float64] | None:
    """The poses (n, 3) that the path's motions join, or None."""
    with logged():
        util.RNG.setSeed(planner.seed or SEED)
        information = space_information(motions)
        problem = problem_definition(information, motions, start, goal)
        tree = planner_of(planner.name, information, planner.settings)
        tree.setProblemDefinition(problem)
        tree.setup()
        best_cost = (lambda: tree.bestCost().value()) if hasattr(tree, "bestCost") else None
        least = EDGES_OF_A_BATCH if planner.name == "BITstar" else SETTLED_AFTER
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
    planner: Options,
    motions: Motions,
    start: Position,
    goal: Position,
    limits: Limits,
    ahead: Path | None,
) -> NDArray[np.float64] | None:
    roadmap = grow_roadmap(
        motions,
        planner=planner.name,
        limits=limits,
        seed=planner.seed or SEED,
        settings=planner.settings,
        ahead=ahead.xy if ahead else None,
    )
    return roadmap.poses_between(start, goal)

"""Probabilistic roadmaps, grown by OMPL's PRM and PRMstar, searched here, kept for more queries.

In OMPL's Python bindings the search of PRM waits forever on an objective written in Python; its
growth does not. An edge here also has a separate cost, or none, in each direction.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from locplan._support.checks import check_choice, check_integer
from locplan._support.kernels.arrays import Floats, Ints
from locplan.planning.ompl.kinds import KINDS
from locplan.planning.ompl.motions import Motions
from locplan.planning.ompl.settings import (
    base,
    check_settings,
    log_messages,
    make_ompl_planner,
    util,
)
from locplan.planning.ompl.setup import make_pose_reader, space_information
from locplan.planning.ompl.stopping import SearchLimits
from locplan.planning.protocol import CURVED, PlannerResult, Position
from locplan.planning.results import Plan, make_plan


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Poses and the costs of the motions between them; made by `grow_roadmap`."""

    motions: Motions
    """The costmap and the kind of motion."""
    poses: Floats = field(repr=False)
    """Poses (n, 3) of x, y, heading in the world [m, m, rad]; in "R2" the heading is 0."""
    graph: csr_array = field(repr=False)
    """Cost J (n, n) of the motion from one pose to another [m], where there is one."""

    def plan(self, start: Position, goal: Position) -> Plan:
        """Plan the cheapest path over the roadmap.

        Parameters
        ----------
        start, goal : (x, y) or (x, y, heading)
            Poses in the world [m, rad], with a heading in all spaces but "R2".

        Returns
        -------
        Plan
            The plan, with status "not found" if the roadmap does not join start and goal.

        Raises
        ------
        PoseError
            If the robot cannot stand at start or goal, or a heading is missing.
        """
        costs = self.motions.costs
        start, goal = (
            self.motions.validate_pose(start, "start"),
            self.motions.validate_pose(goal, "goal"),
        )
        began = time.perf_counter()
        poses = self.find_path_poses(start, goal)
        planner_result = PlannerResult(
            note="the roadmap does not join start and goal; a larger one may"
        )
        if poses is not None:
            planner_result = PlannerResult(self.motions.path(poses))
        return make_plan("roadmap", costs, start, goal, planner_result, time.perf_counter() - began)

    def find_path_poses(self, start: Sequence[float], goal: Sequence[float]) -> Floats | None:
        """Return the poses of the cheapest path from start to goal.

        Parameters
        ----------
        start, goal : (x, y) or (x, y, heading)
            Poses in the world [m, rad]; a heading that is left out is 0.

        Returns
        -------
        (k, 3) array or None
            x, y and heading of each pose [m, m, rad], start and goal included; None if the roadmap
            does not join them.
        """
        count = len(self.poses)
        ends = np.array([(*start, 0.0)[:3], (*goal, 0.0)[:3]])
        poses = np.vstack([self.poses, ends])
        leaving, entering = (self._find_neighbours(end) for end in ends)
        # The last way home leads straight from the start.
        entering = np.append(entering, count)
        start_costs, goal_costs = (
            self.motions.compute_motion_costs(poses, np.column_stack(np.broadcast_arrays(*pair)))
            for pair in ((count, leaving), (entering, count + 1))
        )
        # The start as one more row; the goal is reached from the poses around it.
        free = np.isfinite(start_costs)
        graph = csr_array(
            (
                np.concatenate([self.graph.data, start_costs[free]]),
                np.concatenate([self.graph.indices, leaving[free]]),
                np.append(self.graph.indptr, self.graph.nnz + free.sum()),
            ),
            shape=(count + 1, count + 1),
        )
        cost, before = dijkstra(graph, indices=count, return_predecessors=True)
        total = cost[entering] + goal_costs
        if not np.isfinite(total).any():
            return None
        visited = [count + 1, int(entering[np.argmin(total)])]
        while visited[-1] != count:
            visited.append(int(before[visited[-1]]))
        return poses[visited[::-1]]

    def _find_neighbours(self, pose: Floats) -> Ints:
        """Return the poses around one, as many as PRM* joins, or more where headings differ."""
        curved = self.motions.space in CURVED
        n_neighbours = math.ceil((12 if curved else 1.5) * math.e * math.log(len(self.poses) + 1))
        distances = np.hypot(*(self.poses[:, :2] - pose[:2]).T)
        return np.argsort(distances, kind="stable")[:n_neighbours]


def grow_roadmap(
    motions: Motions,
    planner: str = "PRMstar",
    *,
    limits: SearchLimits | None = None,
    seed: int = 1,
    settings: Mapping[str, Any] | None = None,
    seed_path: Floats | None = None,
) -> Roadmap:
    """Grow a roadmap over a costmap.

    Parameters
    ----------
    motions : Motions
        The costmap and the kind of motion.
    planner : str, default "PRMstar"
        "PRM" joins each pose to its nearest few, "PRMstar" to ever more.
    limits : Limits, optional
        Limits of the growth, which include reading the roadmap; 5 s by default. A larger roadmap
        has better paths.
    seed : int, default 1
        Seed of OMPL's random numbers, at least 1.
    settings : mapping of str to object, optional
        OMPL's settings of the planner by their names; OMPL's defaults without them.
    seed_path : (k, 2) array, optional
        Positions x, y of a path that the roadmap contains as well [m]; none by default.

    Returns
    -------
    Roadmap
        The poses and the costs of the motions between them, for any number of plans.

    Raises
    ------
    ConfigError
        If there is no such planner or setting, or a value is out of its range.
    """
    check_choice("planner", planner, [name for name, kind in KINDS.items() if kind.roadmap])
    check_integer("seed", seed)
    check_settings(planner, settings or {})
    limits = limits or SearchLimits()
    with log_messages():
        util.RNG.setSeed(seed)
        information = space_information(motions)
        growing = make_ompl_planner(planner, information, settings or {})
        growing.setProblemDefinition(base.ProblemDefinition(information))
        growing.setup()
        # Reading the roadmap and its costs takes most of the rest.
        ends = limits.make_stop_condition(share=0.5)
        growing.growRoadmapPtc(base.PlannerTerminationCondition(ends))
        poses, pairs = _read_roadmap(growing, information, motions.space)
    if seed_path is not None:
        along = np.arange(len(poses), len(poses) + len(seed_path))
        poses = np.vstack([poses, np.column_stack([seed_path, np.zeros(len(seed_path))])])
        pairs = np.vstack([pairs, np.column_stack([along[:-1], along[1:]])])
        pairs = np.vstack([pairs, pairs[-len(along) + 1 :, ::-1]])
    cost = motions.compute_motion_costs(poses, pairs)
    free = np.isfinite(cost)
    row, col = pairs[free].T
    graph = csr_array(coo_array((cost[free], (row, col)), shape=(len(poses), len(poses))))
    return Roadmap(motions, poses, graph)


def _read_roadmap(
    planner: base.Planner, information: base.SpaceInformation, space: str
) -> tuple[Floats, Ints]:
    """Return the poses (n, 3) of a roadmap, and its pairs (m, 2) in both directions."""
    data = base.PlannerData(information)
    planner.getPlannerData(data)
    pose = make_pose_reader(space)
    count = data.numVertices()
    poses = np.array([pose(data.getVertex(n).getState()) for n in range(count)]).reshape(count, 3)
    neighbours = [data.getEdges(n) for n in range(count)]
    ends = np.repeat(np.arange(count), [len(other) for other in neighbours])
    pairs = np.column_stack([ends, np.concatenate([*neighbours, []]).astype(np.int64)])
    return poses, pairs

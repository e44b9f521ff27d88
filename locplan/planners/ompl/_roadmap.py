"""Probabilistic roadmaps: grown by OMPL's PRM and PRMstar, searched here, kept for more queries.

In OMPL's Python bindings the search of PRM itself waits for ever on an objective written in
Python; its growth does not. Here an edge has its own cost, or none, in either direction, too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from locplan._util.checks import whole
from locplan.errors import ConfigError
from locplan.planners._protocol import Found, Position
from locplan.planners._result import Plan, finished
from locplan.planners._spaces import CURVED
from locplan.planners.ompl._bindings import base, util
from locplan.planners.ompl._logs import logged
from locplan.planners.ompl._motions import Motions
from locplan.planners.ompl._settings import check_settings, planner_of
from locplan.planners.ompl._setup import pose_reader, space_information
from locplan.planners.ompl._stopping import SEED, Limits

ROADMAPS = ("PRM", "PRMstar")
GROWTH = 0.5
"""Share of the time limit for growth; reading the roadmap and its costs takes most of the rest."""


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Poses and the costs of the motions between them; made by `grow_roadmap`."""

    motions: Motions
    """The costmap and the kind of motion."""
    poses: NDArray[np.float64] = field(repr=False)
    """(n, 3) of x, y, heading in the world [m, m, rad]; in "R2" the heading is 0."""
    graph: csr_array = field(repr=False)
    """(n, n): J of the motion from one pose to another [m], where there is one."""

    def plan(self, start: Position, goal: Position) -> Plan:
        """The cheapest path over the roadmap, measured; "timeout" if it does not join the ends.

        Raises
        ------
        PoseError
            If start or goal lies outside the map or in a blocked cell.
        """
        costs = self.motions.costs
        start, goal = self.motions.checked(start, "start"), self.motions.checked(goal, "goal")
        began = time.perf_counter()
        poses = self.poses_between(start, goal)
        note = "the roadmap does not join start and goal; a larger one may"
        found = Found(status="timeout", note=note)
        if poses is not None:
            found = Found(self.motions.path(poses))
        return finished("roadmap", costs, start, goal, found, time.perf_counter() - began)

    def poses_between(
        self, start: Sequence[float], goal: Sequence[float]
    ) -> NDArray[np.float64] | None:
        """The poses (k, 3) of the cheapest path from start to goal, or None if none joins them."""
        count = len(self.poses)
        ends = np.array([(*start, 0.0)[:3], (*goal, 0.0)[:3]])
        poses = np.vstack([self.poses, ends])
        leaving, entering = (self._near(end) for end in ends)
        first, direct = count, np.array([[count, count + 1]])
        away = self._costs(poses, np.column_stack([np.full(len(leaving), first), leaving]))
        home = self._costs(poses, np.column_stack([entering, np.full(len(entering), count + 1)]))
        # The start as one more row; the goal is reached from the poses around it.
        free = np.isfinite(away)
        graph = csr_array(
            (
                np.concatenate([self.graph.data, away[free]]),
                np.concatenate([self.graph.indices, leaving[free]]),
                np.append(self.graph.indptr, self.graph.nnz + free.sum()),
            ),
            shape=(count + 1, count + 1),
        )
        cost, before = dijkstra(graph, indices=first, return_predecessors=True)
        entering, home = np.append(entering, first), np.append(home, self._costs(poses, direct))
        total = cost[entering] + home
        if not np.isfinite(total).any():
            return None
        visited = [count + 1, int(entering[np.argmin(total)])]
        while visited[-1] != first:
            visited.append(int(before[visited[-1]]))
        return poses[visited[::-1]]

    def _near(self, pose: NDArray[np.float64]) -> NDArray[np.int64]:
        """The poses around one: as many as PRM* joins, or more where their headings differ."""
        curved = self.motions.space in CURVED
        most = math.ceil((12 if curved else 1.5) * math.e * math.log(len(self.poses) + 1))
        apart = np.hypot(*(self.poses[:, :2] - pose[:2]).T)
        return np.argsort(apart, kind="stable")[:most]

    def _costs(self, poses: NDArray[np.float64], pairs: NDArray[np.int64]) -> NDArray[np.float64]:
        return self.motions.costs_between(poses, pairs)


def grow_roadmap(
    motions: Motions,
    *,
    planner: str = "PRMstar",
    limits: Limits | None = None,
    seed: int = SEED,
    settings: Mapping[str, Any] | None = None,
    ahead: NDArray[np.float64] | None = None,
) -> Roadmap:
    """Grow a roadmap over a costmap.

    Parameters
    ----------
    motions : Motions
        The costmap and the kind of motion.
    planner : str
        "PRM", which joins each pose to its nearest few, or "PRMstar", to ever more.
    limits : Limits, optional
        When to stop; 5 s unless told otherwise, reading the roadmap included.
    seed : int
        Of OMPL's random numbers, at least 1.
    settings : mapping, optional
        OMPL's settings of the planner by their names.
    ahead : (k, 2) array, optional
        Positions of a path that the roadmap shall hold besides [m].

    Raises
    ------
    ConfigError
        If the planner, the seed or a setting is impossible.
    """
    if planner not in ROADMAPS:
        raise ConfigError(f"planner must be one of {', '.join(ROADMAPS)}, not {planner!r}")
    whole("seed", seed)
    check_settings(planner, settings or {})
    limits = limits or Limits()
    with logged():
        util.RNG.setSeed(seed)
        information = space_information(motions)
        growing = planner_of(planner, information, settings or {})
        growing.setProblemDefinition(base.ProblemDefinition(information))
        growing.setup()
        ends = limits.condition(share=GROWTH)
        growing.growRoadmapPtc(base.PlannerTerminationCondition(ends))
        poses, pairs = _vertices_and_edges(growing, information, motions.space)
    if ahead is not None:
        along = np.arange(len(poses), len(poses) + len(ahead))
        poses = np.vstack([poses, np.column_stack([ahead, np.zeros(len(ahead))])])
        pairs = np.vstack([pairs, np.column_stack([along[:-1], along[1:]])])
        pairs = np.vstack([pairs, pairs[-len(along) + 1 :, ::-1]])
    cost = motions.costs_between(poses, pairs)
    free = np.isfinite(cost)
    row, col = pairs[free].T
    graph = csr_array(coo_array((cost[free], (row, col)), shape=(len(poses), len(poses))))
    return Roadmap(motions, poses, graph)


def _vertices_and_edges(
    planner: base.Planner, information: base.SpaceInformation, space: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Poses (n, 3), and pairs (m, 2) of them in both directions."""
    data = base.PlannerData(information)
    planner.getPlannerData(data)
    pose = pose_reader(space)
    count = data.numVertices()
    poses = np.array([pose(data.getVertex(n).getState()) for n in range(count)]).reshape(count, 3)
    others = [data.getEdges(n) for n in range(count)]
    ends = np.repeat(np.arange(count), [len(other) for other in others])
    pairs = np.column_stack([ends, np.concatenate([*others, []]).astype(np.int64)])
    return poses, pairs

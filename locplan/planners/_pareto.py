"""All best trade-offs between the length of a path and the integral of u or e along it."""

from __future__ import annotations

import math
import time
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, check_costs
from locplan.planners._front import ParetoFront
from locplan.planners._grid import cells_of
from locplan.planners._protocol import Position
from locplan.planners._trade_offs import (
    GAIN,
    OutOfTime,
    Problem,
    Search,
    check_front_limits,
    prepare,
)

SUPPORTED = 24
"""Number of paths of least weighted sums that complete a front whose search was cut short."""
COMPLETION = 0.25
"""Greatest share of the time limit that is kept for them."""
MAX_POINTS = 100_000
"""Greatest number of points of a front."""
Point: TypeAlias = tuple[float, float, NDArray[np.int64]]
"""Both costs of a path in whole units, and its cells (n, 2)."""


def pareto_front(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    objective: str = "u",
    allow_corner_cutting: bool = False,
    time_limit: float = 30.0,
    max_labels: int = 20_000_000,
) -> ParetoFront:
    """The exact front of length against an integral along the path, over 8 neighbours.

    A path leads from the start to the centre of its cell, over centres, and to the goal. Where
    time or labels run out, paths of least weighted sums complete the front, and `epsilon` says
    how good it is for certain. Before the exact search come two searches over all cells, for the
    front's ends; if the time does not suffice for these, the front is empty, with the status
    "timeout".

    Parameters
    ----------
    costs : Costmap
        Costmap made from a field; its weight does not matter.
    start, goal : (x, y)
        Positions in the world [m].
    objective : str, default "u"
        The layer to integrate: "u" gives degenerate metres [m], "e" gives [m^2 rad m].
    allow_corner_cutting : bool, default False
        True lets a diagonal step pass the corner of a blocked cell. Set it to compare with a
        planner that does so.
    time_limit : float, default 30.0
        Time for all searches together [s], above 0; of it, at most a quarter is kept for
        completing the front. It may be exceeded by a tenth of a second. Raise it on a large map
        where `epsilon` is above 0.
    max_labels : int, default 20_000_000
        Greatest number of partial paths that are kept, above 0; each takes 48 bytes. Lower it
        where memory is short.

    Returns
    -------
    ParetoFront
        The front, empty if the goal is unreachable or time ran out at once. Its lengths and
        integrals are those of the plans' metrics. Paths that lower the integral by no more than
        1e-9 of the layer's greatest value times the length of the path of least integral are left
        out, which is also how far a path may exceed a budget.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If an option is out of its range, or the costmap has no field.
    """
    check_costs(costs)
    check_front_limits(objective, time_limit, max_labels)
    prepare()
    began = time.perf_counter()
    until = began + time_limit
    problem = Problem.between(costs, start, goal, objective, allow_corner_cutting, until)
    searching = time.perf_counter()
    points: list[Point] = []
    epsilon, labels = 0.0, 0
    short = frugal = None
    try:
        second_to_go, frugal = problem.to_go(0, 1)
        first_to_go, short = problem.to_go(1, 0)
    except OutOfTime:
        epsilon = math.inf
    if short is not None and frugal is not None:
        search = Search(problem, first_to_go, second_to_go, max_labels=max_labels)
        completing = SUPPORTED * (time.perf_counter() - searching) / 2
        completing = min(completing, COMPLETION * time_limit)
        found, to_come = search.run(MAX_POINTS, until - completing)
        labels = search.labels
        for label, first, second in zip(found, *search.costs_of(found), strict=True):
            points.append((float(first), float(second), search.cells_of(int(label))))
        exact = math.isinf(to_come)
        bounds = [] if exact else _weighted_sums(problem, points, short, frugal)
        longest = problem.measured(frugal)[0]
        points = _undominated(points, longest, problem.tolerance(frugal))
        epsilon = 0.0 if exact else _epsilon(points, to_come, second_to_go[problem.source], bounds)
    measures = np.reshape([problem.unrounded(cells) for *_, cells in points], (-1, 2))
    return ParetoFront(
        costs=costs,
        start=start,
        goal=goal,
        objective=objective,
        length=measures[:, 0],
        integral=measures[:, 1],
        epsilon=epsilon,
        labels=labels,
        solve_time=time.perf_counter() - began,
        cells=tuple(cells for *_, cells in points),
    )


def _undominated(points: list[Point], longest: float, tolerance: float) -> list[Point]:
    """The points that no other dominates, by rising first cost up to `longest`.

    A second cost must be less than that of every shorter path by more than the tolerance, so that
    a budget of that much never lets one of them in.
    """
    best: list[Point] = []
    least = math.inf
    for point in sorted(points, key=lambda point: point[:2]):
        if point[0] <= longest and point[1] < least - tolerance:
            best.append(point)
        least = min(least, point[1])
    return best


def _epsilon(
    points: list[Point], to_come: float, least_second: float, bounds: list[tuple[float, float]]
) -> float:
    """The greatest relative gain over all points of a path that may have been missed.

    Its first cost is at least `to_come`, its second at least `least_second`, and first +
    multiplier * second at least value, for each (multiplier, value) of `bounds`.
    """
    first, second = (np.array([point[i] for point in points]) for i in (0, 1))
    edges = np.linspace(min(to_come, first[-1]), first[-1], 4001)
    below = np.full(edges.size, float(least_second))
    for multiplier, value in bounds:
        below = np.maximum(below, (value - edges) / multiplier)
    # From one edge to the next the bound on the second cost falls; both ends count at worst.
    over_first = first[:, None] / np.maximum(edges[None, :-1], 1e-300)
    over_second = np.maximum(second[:, None], 1e-9) / np.maximum(below[None, 1:], 1e-9)
    worst = np.maximum(over_first, over_second).min(axis=0).max()
    return max(0.0, float(worst) - 1)


def _weighted_sums(
    problem: Problem, points: list[Point], short: NDArray[np.int64], frugal: NDArray[np.int64]
) -> list[tuple[float, float]]:
    """Add paths of least weighted sums to the points, the widest gaps first.

    For each (multiplier, value) that is returned, all paths have first + multiplier * second of at
    least value.
    """
    bounds: list[tuple[float, float]] = []
    left, right = problem.measured(short), problem.measured(frugal)
    points.append((*left, cells_of(short, problem.columns)))
    points.append((*right, cells_of(frugal, problem.columns)))
    gaps = [(left, right)]
    while gaps and len(bounds) < SUPPORTED and not (bounds and time.perf_counter() > problem.until):
        gaps.sort(key=lambda gap: (gap[1][0] - gap[0][0]) * (gap[0][1] - gap[1][1]))
        left, right = gaps.pop()
        if not (right[0] > left[0] and left[1] > right[1]):
            continue
        multiplier = (right[0] - left[0]) / (left[1] - right[1])
        try:
            to_go, flat = problem.to_go(1, multiplier)
        except OutOfTime:
            break
        assert flat is not None
        bounds.append((multiplier, float(to_go[problem.source])))
        middle = problem.measured(flat)
        line = left[0] + multiplier * left[1]
        if line - (middle[0] + multiplier * middle[1]) > GAIN * line:
            points.append((*middle, cells_of(flat, problem.columns)))
            gaps += [(left, middle), (middle, right)]
    return bounds

"""Kernels that thin a route graph to lanes: a spanner, lines that do not cross, what nodes see.

`half`, `columns` and `frame` are as in `locplan._kernels.route`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.route import line_cost


@njit(nogil=True, cache=True)
def spanner(
    pairs: NDArray[Any], cost: NDArray[Any], count: int, detour: float, sure: int
) -> NDArray[np.bool_]:
    """True for the pairs to keep, of pairs in order; the first `sure` ones are kept in any case.

    Another is left out if a way over pairs kept before it costs at most `detour` times as much.
    """
    kept = np.zeros(len(pairs), np.bool_)
    last = np.full(count, -1)  # each node's half-edges are a chain; 2 n and 2 n + 1 are pair n's
    before = np.full(2 * len(pairs), -1)
    away = np.full(count, np.inf)
    waiting = np.zeros(count, np.bool_)
    for n, (i, j) in enumerate(pairs):
        if cost[n] == np.inf:
            continue
        if n >= sure:
            limit, head, queue, reached = detour * cost[n], 0, [i], [i]
            away[i] = 0.0
            while head < len(queue):
                node = queue[head]
                head += 1
                waiting[node] = False
                edge = last[node]
                while edge >= 0:
                    other, total = pairs[edge // 2, 1 - edge % 2], away[node] + cost[edge // 2]
                    if total <= limit and total < min(away[other], away[j]):
                        if away[other] == np.inf:
                            reached.append(other)
                        away[other] = total
                        if not waiting[other]:
                            waiting[other] = True
                            queue.append(other)
                    edge = before[edge]
            replaced = away[j] <= limit
            for node in reached:
                away[node] = np.inf
            if replaced:
                continue
        kept[n] = True
        before[2 * n], before[2 * n + 1] = last[i], last[j]
        last[i], last[j] = 2 * n, 2 * n + 1
    return kept


@njit(nogil=True, cache=True)
def cross(a: NDArray[Any], b: NDArray[Any], c: NDArray[Any], d: NDArray[Any]) -> bool:
    """Whether the lines a-b and c-d have a point in common that is no end of either."""
    ab0, ab1, cd0, cd1 = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    side_c = ab0 * (c[1] - a[1]) - ab1 * (c[0] - a[0])
    side_d = ab0 * (d[1] - a[1]) - ab1 * (d[0] - a[0])
    side_a = cd0 * (a[1] - c[1]) - cd1 * (a[0] - c[0])
    side_b = cd0 * (b[1] - c[1]) - cd1 * (b[0] - c[0])
    return min(side_a, side_b) < 0 < max(side_a, side_b) and (
        min(side_c, side_d) < 0 < max(side_c, side_d)
    )


@njit(nogil=True, cache=True)
def uncrossed(xy: NDArray[Any], pairs: NDArray[Any], size: float) -> NDArray[np.bool_]:
    """True for the pairs (m, 2) of positions whose lines cross none of those kept before them.

    `size` is the edge of the squares that lines are sorted into, which only speed depends on.
    """
    kept = np.zeros(len(pairs), np.bool_)
    if len(pairs) == 0:
        return kept
    left, low = xy[:, 0].min(), xy[:, 1].min()
    across = int((xy[:, 0].max() - left) / size) + 1
    up = int((xy[:, 1].max() - low) / size) + 1
    last = np.full(across * up, -1)  # each square's lines are a chain
    before, line = [-1], [-1]
    for n, (i, j) in enumerate(pairs):
        a, b = xy[i], xy[j]
        cols = range(int((min(a[0], b[0]) - left) / size), int((max(a[0], b[0]) - left) / size) + 1)
        rows = range(int((min(a[1], b[1]) - low) / size), int((max(a[1], b[1]) - low) / size) + 1)
        free = True
        for row in rows:
            for col in cols:
                entry = last[row * across + col]
                while entry >= 0 and free:
                    c, d = pairs[line[entry]]
                    free = not cross(a, b, xy[c], xy[d])
                    entry = before[entry]
        if free:
            kept[n] = True
            for row in rows:
                for col in cols:
                    line.append(n)
                    before.append(last[row * across + col])
                    last[row * across + col] = len(line) - 1
    return kept


@njit(nogil=True, cache=True)
def sights(
    half: NDArray[Any],
    columns: int,
    frame: tuple[Any, ...],
    points: NDArray[Any],
    xy: NDArray[Any],
    within: float,
    most: int,
) -> NDArray[np.int64]:
    """Pairs (m, 2) of a point and a position that is less than `within` [m] away and seen.

    Of each point at most `most` are found, those of the square around it first.
    """
    found = [0]
    found.clear()
    if len(xy) == 0:
        return np.empty((0, 2), np.int64)
    left, low = xy[:, 0].min(), xy[:, 1].min()
    across = int((xy[:, 0].max() - left) / within) + 1
    up = int((xy[:, 1].max() - low) / within) + 1
    last, before = np.full(across * up, -1), np.full(len(xy), -1)
    for n in range(len(xy)):
        square = int((xy[n, 1] - low) / within) * across + int((xy[n, 0] - left) / within)
        before[n], last[square] = last[square], n
    for n, point in enumerate(points):
        col, row = int((point[0] - left) // within), int((point[1] - low) // within)
        missing = most
        for square in range(4, 13):  # its own first, which is the fifth of the nine
            r, c = row - 1 + square % 9 // 3, col - 1 + square % 3
            if not (0 <= r < up and 0 <= c < across):
                continue
            other = last[r * across + c]
            while other >= 0 and missing > 0:
                away = np.hypot(xy[other, 0] - point[0], xy[other, 1] - point[1])
                if away < within and line_cost(half, columns, frame, point, xy[other]) < np.inf:
                    found.append(n)
                    found.append(other)
                    missing -= 1
                other = before[other]
    return np.array(found).reshape(-1, 2)

"""Kernels of route graphs: nodes over the free space, lines between them, and how they are thinned.

Cells are flat indices into a grid with a blocked border of one cell; positions are in the world
[m]. `frame` holds the cosine and the sine of the grid's yaw, both per cell [1/m], and the world's
x and y of its origin. `half` is half the density, see `locplan._kernels.search`. A graph's edges
are in compressed rows (`indptr`, `indices`), both directions.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from locplan._kernels.arrays import Array, Bools, Ints, Numbers
from locplan._kernels.rays import TOUCH, segment_cost


@njit(nogil=True, cache=True)
def cover(inside: Array, columns: int, cells: Array, reach: float) -> Array:
    """Cells, in their order, that are not connected within `reach` to one taken before."""
    covered = np.zeros(len(inside), np.bool_)
    seen = np.full(len(inside), -1, np.int32)
    queue = np.empty(len(inside), np.int64)
    nodes: list[int] = []
    for node in cells:
        if covered[node]:
            continue
        queue[0], seen[node], head, tail = node, len(nodes), 0, 1
        while head < tail:
            cell = queue[head]
            head += 1
            covered[cell] = True
            for other in (cell - columns, cell - 1, cell + 1, cell + columns):
                if inside[other] and seen[other] != len(nodes):
                    seen[other] = len(nodes)
                    up = other // columns - node // columns
                    across = other % columns - node % columns
                    if up * up + across * across < reach * reach:
                        queue[tail] = other
                        tail += 1
        nodes.append(node)
    return np.array(nodes)


@njit(nogil=True, cache=True)
def owners(inside: Array, columns: int, nodes: Array) -> Array:
    """Node nearest to each cell by steps of which every other may be diagonal, or -1."""
    owner = np.full(len(inside), -1, np.int32)
    queue = np.empty(len(inside), np.int32)
    owner[nodes] = np.arange(len(nodes))
    queue[: len(nodes)] = nodes
    head, tail, diagonal = 0, len(nodes), False
    while head < tail:
        for cell in queue[head:tail].copy():
            for up in (-columns, 0, columns):
                for across in (-1, 0, 1):
                    other = cell + up + across
                    passes = diagonal and inside[cell + up] and inside[cell + across]
                    if inside[other] and owner[other] < 0 and (passes or not (up and across)):
                        owner[other] = owner[cell]
                        queue[tail] = other
                        tail += 1
            head += 1
        diagonal = not diagonal
    return owner


@njit(nogil=True, cache=True)
def clearances(occupied: Array, rows: Array, cols: Array, reach: int) -> Array:
    """Distances of cells' centres to the edge of the nearest occupied cell (row, col) [cells].

    Infinite where none is within `reach` rows and columns.
    """
    found = np.empty(len(rows))
    for n in range(len(rows)):
        row, col, least = rows[n], cols[n], np.inf
        for ring in range(reach + 1):
            edge = max(2 * ring - 1, 0)  # of the ring's cells, in half cells
            if edge * edge >= least:
                break
            for up in range(max(-ring, -row), min(ring, len(occupied) - 1 - row) + 1):
                whole = abs(up) == ring
                for across in range(-ring, ring + 1, 1 if whole else 2 * ring):
                    if 0 <= col + across < occupied.shape[1] and occupied[row + up, col + across]:
                        aside = max(2 * min(abs(up), abs(across)) - 1, 0)
                        least = min(least, edge * edge + aside * aside)
        found[n] = np.sqrt(least) / 2
    return found


@njit(nogil=True, cache=True)
def line_cost(half: Array, columns: int, frame: Numbers, a: Array, b: Array) -> float:
    """Integral along the line between two positions, the costlier way [density x cells].

    Infinite where it is blocked either way, or an end lies outside the grid or at a blocked cell.
    """
    along, across, x, y = frame
    row0 = along * (a[1] - y) - across * (a[0] - x) + 1
    row1 = along * (b[1] - y) - across * (b[0] - x) + 1
    col0 = along * (a[0] - x) + across * (a[1] - y) + 1
    col1 = along * (b[0] - x) + across * (b[1] - y) + 1
    for row, col in ((row0, col0), (row1, col1)):
        if not (1 <= row < len(half) // columns - 1 and 1 <= col < columns - 1):
            return np.inf
        for up in (-TOUCH, TOUCH):
            for right in (-TOUCH, TOUCH):
                if half[int(row + up) * columns + int(col + right)] == np.inf:
                    return np.inf
    there = segment_cost(half, columns, row0, col0, row1, col1, False)
    return max(there, segment_cost(half, columns, row1, col1, row0, col0, False))


@njit(nogil=True, cache=True)
def line_costs(half: Array, columns: int, frame: Numbers, xy: Array, pairs: Array) -> Array:
    """Costs, by `line_cost`, of the lines between pairs (m, 2) of positions (n, 2)."""
    result = np.empty(len(pairs))
    for n, (i, j) in enumerate(pairs):
        result[n] = line_cost(half, columns, frame, xy[i], xy[j])
    return result


@njit(nogil=True, cache=True)
def usage(order: Array, before: Array, indptr: Array, indices: Array) -> Array:
    """Number of routes over each of a node's edges, without those that begin or end at the node."""
    use = np.zeros(len(indices))
    for nodes, parents in zip(order, before):  # noqa: B905, which numba does not know
        beyond = np.zeros(len(nodes))
        for node in nodes[::-1]:
            parent = parents[node]
            if parent >= 0:
                beyond[parent] += beyond[node] + 1
                for n in range(indptr[parent], indptr[parent + 1]):
                    use[n] += (beyond[node] + 1) * (indices[n] == node and parents[parent] >= 0)
                for n in range(indptr[node], indptr[node + 1]):
                    use[n] += beyond[node] * (indices[n] == parent)
    return use


@njit(nogil=True, cache=True)
def moved(
    half: Array,
    columns: int,
    frame: Numbers,
    xy: Array,
    indptr: Array,
    indices: Array,
    use: Array,
    shift: float,
    apart: float,
) -> Array:
    """Positions of nodes, moved one after the other so that the routes through each cost less.

    Each stays within `shift` of where it was, and goes no closer to a neighbour than `apart`, both
    in cells. All edges stay free.
    """
    xy, cell = xy.copy(), 1 / np.hypot(frame[0], frame[1])
    trial, best = np.empty(2), np.empty(2)
    for node in range(len(xy)):
        home, edges = xy[node].copy(), range(indptr[node], indptr[node + 1])
        least = 0.0
        for n in edges:
            least += use[n] * line_cost(half, columns, frame, home, xy[indices[n]])
        step = shift / 2
        while step >= 0.5:
            best[:] = xy[node]
            for eighth in range(8):
                angle = eighth * np.pi / 4
                trial[0] = np.float32(xy[node, 0] + step * cell * np.cos(angle))
                trial[1] = np.float32(xy[node, 1] + step * cell * np.sin(angle))
                if np.hypot(trial[0] - home[0], trial[1] - home[1]) > shift * cell:
                    continue
                total = 0.0
                for n in edges:
                    end = xy[indices[n]]
                    now = np.hypot(end[0] - trial[0], end[1] - trial[1])
                    then = np.hypot(end[0] - xy[node, 0], end[1] - xy[node, 1])
                    if now < min(apart * cell, then):
                        total = np.inf
                    if total < least:
                        total += use[n] * line_cost(half, columns, frame, trial, end)
                if total < least * (1 - 1e-6):
                    least = total
                    best[:] = trial
            if best[0] == xy[node, 0] and best[1] == xy[node, 1]:
                step /= 2
            xy[node] = best
    return xy


@njit(nogil=True, cache=True)
def spanner(pairs: Array, cost: Array, count: int, detour: float, sure: int) -> Bools:
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
def cross(a: Array, b: Array, c: Array, d: Array) -> bool:
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
def uncrossed(xy: Array, pairs: Array, size: float) -> Bools:
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
    half: Array, columns: int, frame: Numbers, points: Array, xy: Array, within: float, most: int
) -> Ints:
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

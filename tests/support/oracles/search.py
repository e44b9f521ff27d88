"""Least costs over cells, and paths through them."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from support.oracles.lines import line_integral, touches


def shortest_costs(density, start, corner_cutting):
    """Dijkstra with a heap from (row, col) over 8 neighbours, (H, W)."""
    rows, cols = density.shape
    cost = np.full(density.shape, np.inf)
    if not np.isfinite(density[start]):
        return cost
    cost[start] = 0.0
    heap = [(0.0, start)]

    def blocked(row, col):
        return not (0 <= row < rows and 0 <= col < cols) or density[row, col] == np.inf

    while heap:
        reached, (row, col) = heapq.heappop(heap)
        if reached > cost[row, col]:
            continue
        for drow in (-1, 0, 1):
            for dcol in (-1, 0, 1):
                there = row + drow, col + dcol
                if (drow, dcol) == (0, 0) or blocked(*there):
                    continue
                diagonal = drow != 0 and dcol != 0
                if (
                    diagonal
                    and not corner_cutting
                    and (blocked(row + drow, col) or blocked(row, col + dcol))
                ):
                    continue
                step = math.hypot(drow, dcol) * (density[row, col] + density[there]) / 2
                if reached + step < cost[there]:
                    cost[there] = reached + step
                    heapq.heappush(heap, (cost[there], there))
    return cost


def steps_back(density, cost, tolerance):
    """Bits of the steps that cost at most so much more than the cheapest way, cell by cell."""
    steps = np.zeros(density.shape, np.uint8)
    for row, col in np.ndindex(density.shape):
        around = [d for d in itertools.product((-1, 0, 1), repeat=2) if d != (0, 0)]
        for bit, (vertical, horizontal) in enumerate(around):
            at = row + vertical, col + horizontal
            if not (0 <= at[0] < density.shape[0] and 0 <= at[1] < density.shape[1]):
                continue
            corners = density[at[0], col], density[row, at[1]]
            if math.isinf(cost[row, col]) or (vertical and horizontal and math.inf in corners):
                continue
            step = (density[row, col] / 2 + density[at] / 2) * math.hypot(vertical, horizontal)
            if cost[at] + step <= cost[row, col] + tolerance:
                steps[row, col] |= 1 << bit
    return steps


def shortcut(density, positions, lookahead):
    """Least cost over a path's own positions, each within `lookahead` of the one before."""
    best = [0.0]
    for j in range(1, len(positions)):
        best.append(
            min(
                best[i] + line_integral(density, *positions[i], *positions[j])
                for i in range(max(0, j - lookahead), j)
            )
        )
    return best[-1]


def shift(density, positions, step, sweeps):
    """Inner positions moved sideways by a step, in turn, while that costs less."""
    shifted = [tuple(position) for position in positions]
    for _ in range(sweeps):
        before = list(shifted)
        for k in range(1, len(shifted) - 1):
            (row0, col0), (row, col), (row1, col1) = shifted[k - 1 : k + 2]
            along = math.hypot(row1 - row0, col1 - col0)
            if along == 0:
                continue
            aside = step * (col0 - col1) / along, step * (row1 - row0) / along
            tried = [(row + s * aside[0], col + s * aside[1]) for s in (0, -1, 1)]
            shifted[k] = min(
                tried,
                key=lambda at: (
                    line_integral(density, row0, col0, *at)
                    + line_integral(density, *at, row1, col1)
                ),
            )
        if shifted == before:
            break
    return shifted


def cheapest_moves(density, start, goal, reach):
    """Least cost from cell to cell over all moves to centres up to `reach` cells away."""
    moves = [
        move
        for move in itertools.product(range(-reach, reach + 1), repeat=2)
        if math.gcd(*move) == 1
    ]
    cost, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        reached, cell = heapq.heappop(heap)
        if cell == goal:
            return reached
        if reached > cost[cell]:
            continue
        for move in moves:
            there = cell[0] + move[0], cell[1] + move[1]
            line = [v + 0.5 for v in (*cell, *there)]
            around = itertools.product(
                *(range(min(a, b) - 1, max(a, b) + 2) for a, b in zip(cell, there, strict=True))
            )
            blocked = any(
                level_of(density, row, col) == math.inf and touches(*line, row, col, margin=-1e-9)
                for row, col in around
            )
            step = math.inf if blocked else line_integral(density, *line)
            if reached + step < cost.get(there, math.inf):
                cost[there] = reached + step
                heapq.heappush(heap, (cost[there], there))
    return math.inf


def level_of(density, row, col):
    inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
    return density[row, col] if inside else math.inf


def pareto_front(layer, free, start, goal, corner_cutting):
    """All non-dominated (length, integral) from cell to cell, by correcting labels."""
    labels = {start: [(0.0, 0.0)]}
    queue = [(start, (0.0, 0.0))]
    while queue:
        (row, col), (length, integral) = queue.pop(0)
        if (length, integral) not in labels[row, col]:
            continue
        for drow, dcol in itertools.product((-1, 0, 1), repeat=2):
            there = row + drow, col + dcol
            if (drow, dcol) == (0, 0) or level_of(free, *there) != 1:
                continue
            beside = level_of(free, row + drow, col), level_of(free, row, col + dcol)
            if drow and dcol and not corner_cutting and beside != (1, 1):
                continue
            step = math.hypot(drow, dcol)
            new = length + step, integral + step * (layer[row, col] + layer[there]) / 2
            known = labels.setdefault(there, [])
            if any(a <= new[0] + 1e-9 and b <= new[1] + 1e-9 for a, b in known):
                continue
            known[:] = [(a, b) for a, b in known if a < new[0] - 1e-9 or b < new[1] - 1e-9]
            known.append(new)
            queue.append((there, new))
    return sorted(labels.get(goal, []))


def costs_between_states(edges, starts):
    """Least cost from any start to each state, over edges {state: [(other, cost), ...]}."""
    cost = dict.fromkeys(starts, 0.0)
    waiting = [(0.0, state) for state in starts]
    heapq.heapify(waiting)
    while waiting:
        here, state = heapq.heappop(waiting)
        if here > cost[state]:
            continue
        for other, step in edges.get(state, ()):
            if here + step < cost.get(other, math.inf):
                cost[other] = here + step
                heapq.heappush(waiting, (here + step, other))
    return cost

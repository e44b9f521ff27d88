"""Motions of the lattice planner, and searches over all of its states."""

from __future__ import annotations

import itertools

import numpy as np

from support.oracles.search import costs_between_states


def widened(plane, level):
    """Whether any of the next 2 ** level cells of the row is set, cell by cell."""
    return np.array(
        [[any(row[col : col + 2**level]) for col in range(len(row))] for row in plane.tolist()]
    )


def add_runs(plane, runs, shape):
    """Cells of the map from which any cell of the runs (row, first column, number) is set."""
    (rows, columns), margin = shape, (plane.shape[0] - shape[0]) // 2
    met = np.zeros(shape, bool)
    for row, col, (away, begin, count) in itertools.product(range(rows), range(columns), runs):
        first = col + begin + margin
        met[row, col] |= plane[row + away + margin, first : first + count].any()
    return met


def motions_between_cells(graph):
    """All free motions of a graph: (row, col), the motion, the other cell, and the cost."""
    ground, moves, _ = graph
    size = ground.rows, ground.columns
    for row, col, move in itertools.product(*map(range, size), range(len(moves.row))):
        there = row + int(moves.row[move]), col + int(moves.col[move])
        if not (0 <= there[0] < size[0] and 0 <= there[1] < size[1]):
            continue
        at = there if moves.at_end[move] else (row, col)
        word = ground.masks[moves.mask_heading[move], at[0], at[1] // 64, moves.slot[move]]
        if int(word) >> (at[1] % 64) & 1:
            continue
        cost = moves.extra[move]
        for k in range(moves.cells[move]):
            cell = row * ground.columns + col + moves.crossed[move, k]
            cost += moves.lengths[move, k] * ground.half[cell]
        yield (row, col), move, there, cost


def project(graph, goal):
    """Least cost from each cell to the goal's, of motions of any heading."""
    backward = {}
    for here, _, there, cost in motions_between_cells(graph):
        backward.setdefault(there, []).append((here, cost))
    return costs_between_states(backward, [goal])


def explore(graph, starts):
    """Least cost from any start to each state (row, col, heading, gear)."""
    moves, terms, edges = graph.moves, graph.terms, {}
    for here, move, there, cost in motions_between_cells(graph):
        for gear in range(terms.gears):
            keeps = moves.gear[move] == 2 or terms.gears == 1
            to_gear = gear if keeps else moves.gear[move]
            change = terms.gear_change if to_gear != gear else 0.0
            state = (*here, moves.source[move], gear)
            other = (*there, moves.target[move], to_gear)
            edges.setdefault(state, []).append((other, cost + change))
    return costs_between_states(edges, starts)

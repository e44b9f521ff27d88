"""Cheapest paths from the steps that a search leaves behind, one byte a cell.

Rounding makes paths of equal cost differ, and a planner's choice depends on the end that it
searches from. The bytes hold all steps that may be on the cheapest path from either end. Among
these few cells, the costs from the start are summed again in the order of the planner's search.

Grids are flat with a blocked border and hold half of each cell's density, see
`locplan._support.kernels.search`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Octets
from locplan._support.kernels.search import COLUMNS, LENGTHS, ROWS, SQRT2, TIE

ROOM = 256
"""Number of cells, and of pages, for which there is room at first."""
PAGE = 6
IN_PAGE = (1 << PAGE) - 1
"""A cell's place stands in a page of 2^6 cells of a row; a path needs few pages of a map."""


def compute_tolerance(cost: Floats, cheapest: float) -> float:
    """Return the rounding error of the costs of cheapest paths, for `find_backward_steps`.

    It bounds the rounding of sums of steps that cost at least `cheapest`, from either end. It stays
    below half a step, so that the steps always lead towards the start.
    """
    greatest = find_greatest_cost(cost)
    rounding = 4 * 2.0**-53 * greatest / cheapest  # a sum errs by 2^-53 at most
    return min(greatest * min(rounding, TIE), cheapest / 2)


@njit(nogil=True, cache=True)
def find_greatest_cost(cost: Floats) -> float:
    """Return the maximum finite cost of a search, whose costs may be negative."""
    bits, infinity_bits = cost.view(np.int64), np.int64(0x7FF0000000000000)  # that of infinity
    greatest = np.zeros(1, np.int64)
    for k in range(bits.size):  # whole numbers are compared in vectors; they sort as the costs do
        value = bits[k] & np.int64(0x7FFFFFFFFFFFFFFF)
        greatest[0] = max(greatest[0], value if value < infinity_bits else 0)
    return float(greatest.view(np.float64)[0])


@njit(nogil=True, cache=True, error_model="numpy")
def find_backward_steps(
    half_density: Floats, columns: int, cost: Floats, tolerance: float
) -> Array:
    """Return the steps from each cell that lie on a cheapest path to the start, within `tolerance`.

    `cost` is the result of a finished search without a goal and without cut corners. The result has
    a bit for each of the eight steps, in the order of rows and columns.
    """
    steps = np.zeros(half_density.size, np.uint8)
    count = columns - 2
    for first in range(columns + 1, half_density.size - columns, columns):
        cell_costs, cell_halves = cost[first : first + count], half_density[first : first + count]
        cell_steps = steps[first : first + count]
        for n in range(8):  # one plain loop over a row for each step: it runs in vectors
            vertical, horizontal = first + ROWS[n] * columns, first + COLUMNS[n]
            at, bit = vertical + COLUMNS[n], np.uint8(1 << n)
            neighbour_costs, neighbour_halves = cost[at : at + count], half_density[at : at + count]
            if ROWS[n] == 0 or COLUMNS[n] == 0:
                for k in range(count):
                    through = abs(neighbour_costs[k]) + (cell_halves[k] + neighbour_halves[k])
                    max_cost = abs(cell_costs[k]) + tolerance
                    cell_steps[k] |= bit * np.uint8((through <= max_cost) & (through < np.inf))
                continue
            vertical_halves, horizontal_halves = (
                half_density[vertical : vertical + count],
                half_density[horizontal : horizontal + count],
            )
            for k in range(count):
                through = abs(neighbour_costs[k]) + SQRT2 * (cell_halves[k] + neighbour_halves[k])
                max_cost, free = (
                    abs(cell_costs[k]) + tolerance,
                    vertical_halves[k] + horizontal_halves[k] < np.inf,
                )
                cell_steps[k] |= bit * np.uint8((through <= max_cost) & (through < np.inf) & free)
    return steps


@njit(nogil=True, cache=True)
def trace_path(
    half_density: Floats, columns: int, cost: Floats, goal: int, corner_cutting: bool
) -> Array:
    """Return the cells from a search's start to `goal`, each on the cheapest path to the next.

    Of several cells with the same cost, the path takes the first one.
    """
    corner = np.nan if corner_cutting else np.inf  # nothing equals NaN
    cells = [goal]
    while abs(cost[cells[-1]]) > 0:
        cell, min_cost, before = cells[-1], np.inf, -1
        for n in range(8):
            neighbour = cell + ROWS[n] * columns + COLUMNS[n]
            if half_density[cell + ROWS[n] * columns] + half_density[cell + COLUMNS[n]] == corner:
                continue
            through = abs(cost[neighbour]) + LENGTHS[n] * (
                half_density[cell] + half_density[neighbour]
            )
            if through < min_cost:
                min_cost, before = through, neighbour
        cells.append(before)
    return np.array(cells[::-1])


class PathCells(NamedTuple):
    """The few cells on cheapest paths, numbered in the order of discovery."""

    cells: Ints
    """The cells; the first one is the tip."""
    table: NDArray[np.int32]
    """Page of each 2^6 cells of the map; page 0 is empty."""
    pages: NDArray[np.int32]
    """Number of each cell and 1, or 0."""


@njit(nogil=True, cache=True, error_model="numpy")
def trace_cheapest_path(
    half_density: Floats, columns: int, steps: Octets, root: int, tip: int, from_root: bool
) -> Array:
    """Return the cells of the cheapest path between `root`, the start of the search, and `tip`.

    The result is identical to a search from its first cell to its last one, followed by
    `trace_path`. It leads from `root` to `tip` if `from_root`, otherwise from `tip` to `root`.
    `steps` are the result of `find_backward_steps`, and lead from `tip` to `root`.
    """
    path_cells, order = _find_path_cells(half_density.size, columns, steps, tip)
    start, goal = (root, tip) if from_root else (tip, root)
    cost = _sum_costs(half_density, columns, steps, path_cells, order, start, from_root)
    # As `trace`, but costs are known of few cells.
    path = [goal]
    while path[-1] != start and len(path) < cost.size:
        cell, min_cost, before = path[-1], np.inf, -1
        for n in range(8):
            neighbour = cell + ROWS[n] * columns + COLUMNS[n]
            place = find_path_cell_index(path_cells, neighbour)
            free = half_density[cell + ROWS[n] * columns] + half_density[cell + COLUMNS[n]] < np.inf
            if place >= 0 and free:
                through = cost[place] + LENGTHS[n] * (half_density[cell] + half_density[neighbour])
                if through < min_cost:
                    min_cost, before = through, neighbour
        path.append(before)
    return np.array(path[::-1])


@njit(nogil=True, cache=True)
def _find_path_cells(size: int, columns: int, steps: Octets, tip: int) -> tuple[PathCells, Ints]:
    """Return the cells that steps lead to from `tip`, and their indices in topological order.

    Each cell comes after all cells with a step to it; the last one is the root.
    """
    table, pages = np.zeros((size >> PAGE) + 1, np.int32), np.zeros(ROOM << PAGE, np.int32)
    # Number of steps to each cell that are not in the order yet.
    cells, waits = np.empty(ROOM, np.int64), np.zeros(ROOM, np.int8)
    table[tip >> PAGE], n_pages = 1, 2
    pages[(1 << PAGE) + (tip & IN_PAGE)] = 1
    cells[0], used, at = tip, 1, 0
    while at < used:
        if used + 8 > cells.size:
            cells = np.concatenate((cells, np.empty_like(cells)))
            waits = np.concatenate((waits, np.zeros_like(waits)))
        if (n_pages + 8) << PAGE > pages.size:
            pages = np.concatenate((pages, np.zeros_like(pages)))
        cell = cells[at]
        for n in range(8):
            if steps[cell] >> n & 1:
                neighbour = cell + ROWS[n] * columns + COLUMNS[n]
                if table[neighbour >> PAGE] == 0:
                    table[neighbour >> PAGE] = n_pages
                    n_pages += 1
                at_page = (table[neighbour >> PAGE] << PAGE) + (neighbour & IN_PAGE)
                if pages[at_page] == 0:
                    cells[used] = neighbour
                    used += 1
                    pages[at_page] = used
                waits[pages[at_page] - 1] += 1
        at += 1
    path_cells, order = PathCells(cells[:used], table, pages), np.zeros(used, np.int64)
    n_ordered, at = 1, 0
    while at < n_ordered:
        cell = cells[order[at]]
        for n in range(8):
            if steps[cell] >> n & 1:
                place = find_path_cell_index(path_cells, cell + ROWS[n] * columns + COLUMNS[n])
                waits[place] -= 1
                if waits[place] == 0:
                    order[n_ordered] = place
                    n_ordered += 1
        at += 1
    return path_cells, order


@njit(nogil=True, cache=True, error_model="numpy")
def _sum_costs(
    half_density: Floats,
    columns: int,
    steps: Octets,
    path_cells: PathCells,
    order: Ints,
    start: int,
    from_root: bool,
) -> Floats:
    """Return the costs from `start`, summed in the order of a search from there."""
    # Sums of floats depend on their order: only so are they those of the planner's own search.
    used = order.size
    cost = np.empty(used)
    for k in range(used):
        cost[k] = np.inf
    cost[find_path_cell_index(path_cells, start)] = 0.0
    for at in range(used):
        k = order[used - 1 - at] if from_root else order[at]
        cell = path_cells.cells[k]
        bits = steps[cell]
        for n in range(8):
            if bits >> n & 1:
                neighbour = cell + ROWS[n] * columns + COLUMNS[n]
                step, m = (
                    LENGTHS[n] * (half_density[cell] + half_density[neighbour]),
                    find_path_cell_index(path_cells, neighbour),
                )
                if from_root:
                    cost[k] = min(cost[k], cost[m] + step)
                else:
                    cost[m] = min(cost[m], cost[k] + step)
    return cost


@njit(inline="always")
def find_path_cell_index(path_cells: PathCells, cell: int) -> int:
    """Return the number of a cell on cheapest paths, -1 if it is not on one."""
    page = path_cells.table[cell >> PAGE]
    return int(path_cells.pages[(page << PAGE) + (cell & IN_PAGE)]) - 1

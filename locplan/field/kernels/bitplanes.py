"""A map as two bit planes, *free* and *occupied*, in squares of cells, and bounds from its blocks.

A *strip* holds, for one column, the byte of the eight cells from that column on, row by row, so
that the square at any row and column is one unaligned 64-bit load. Positions (row, col) are
indices of the whole map's lattice, also beyond its edges, where everything is unknown.

A lower bound of the mismatch rejects whole lines of offsets without comparing cells. Within any
block of cells, template and map differ in at least as many cells as their numbers of free cells
do, and likewise of occupied ones. The sum of these differences over blocks that lie within the disc
is at most S / 127. A *line* is the offsets in y at one offset in x and one heading; they are the
lanes of the vectors. Large blocks reject most lines, and smaller ones, whose bound is closer, are
asked about the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import STOP, Bools, Floats, Ints, Octets, Shorts, Words
from locplan._support.kernels.simd import (
    SHORTS,
    add_distances,
    flag_small_lanes,
    load_word,
    popcount,
    zero_shorts,
)

SQUARE = 8
"""Edge of a word's square of cells."""
PLANES = 2


@njit(nogil=True, cache=True)
def cut_rotated_strips(
    levels: Octets,
    row0: int,
    col0: int,
    centre_row: float,
    centre_col: float,
    cos: Floats,
    sin: Floats,
    first_rows: Ints,
    first_cols: Ints,
    octets: Octets,
) -> None:
    """Turn the map by each heading about (centre_row, centre_col) and cut it into strips.

    `levels` is a part of the map whose cell (0, 0) is (row0, col0) of the whole. The strips,
    `octets` (heading, plane, col, row), are filled in from `first_rows` and `first_cols` on.
    """
    cols, rows = octets.shape[2], octets.shape[3]
    for k in range(cos.size):
        for i in range(cols - 1, -1, -1):
            free, occupied = octets[k, 0, i], octets[k, 1, i]
            dx = first_cols[k] + i - centre_col
            for j in range(rows):
                dy = first_rows[k] + j - centre_row
                row = int(np.floor(cos[k] * dy - sin[k] * dx + centre_row + 0.5)) - row0
                col = int(np.floor(sin[k] * dy + cos[k] * dx + centre_col + 0.5)) - col0
                level = 127
                if 0 <= row < levels.shape[0] and 0 <= col < levels.shape[1]:
                    level = levels[row, col]
                free[j] = level == 254
                occupied[j] = level == 0
            if i + 1 < cols:
                next_free, next_occupied = octets[k, 0, i + 1], octets[k, 1, i + 1]
                for j in range(rows):
                    free[j] |= next_free[j] << 1
                    occupied[j] |= next_occupied[j] << 1


@njit(nogil=True, cache=True)
def lay_out_words(
    octets: Octets, top: int, left: int, rows: int, unit: int, words: Words, below: Ints
) -> None:
    """Lay the map out so that the squares at neighbouring offsets in y are contiguous.

    `octets` are the map's strips, (plane, col, row), of which every `unit`-th column and `rows`
    such rows are taken from (left, top) on. `words` and `below`, (plane, col, row mod step, row
    div step), are filled in: the word of the square there, and the cells set in its strip's rows
    below.
    """
    step = words.shape[2]
    for plane in range(PLANES):
        for q in range(words.shape[1]):
            strip = octets[plane, left + q * unit]
            ones = 0
            for p in range(rows):
                at = top + p * unit
                words[plane, q, p % step, p // step] = load_word(strip, at)
                below[plane, q, p % step, p // step] = ones
                for row in range(at, at + unit):
                    ones += popcount(np.uint64(strip[row]))


@njit(nogil=True, cache=True)
def fill_disc_sums(
    octets: Octets,
    top: int,
    left: int,
    radius: int,
    unit: int,
    rows: int,
    sums: Ints,
) -> None:
    """Fill in the cells set in discs, (plane, col, row), of the first rows.

    The discs' centres are every `unit`-th cell, and begin `radius` further on than (left, top).
    """
    diameter = 2 * radius + 1
    # Cells set before each row, (col, row + 1), in all columns and rows that the discs reach.
    reached = diameter + (sums.shape[1] - 1) * unit, diameter + (rows - 1) * unit + 1
    below = np.empty(reached, np.int32)
    for plane in range(PLANES):
        for i in range(below.shape[0]):
            ones = 0
            below[i, 0] = 0
            for j in range(below.shape[1] - 1):
                ones += octets[plane, left + i, top + j] & 1
                below[i, j + 1] = ones
        for q in range(sums.shape[1]):
            for p in range(rows):
                sums[plane, q, p] = 0
            for u in range(diameter):
                half = int(np.sqrt(float(radius * radius - (u - radius) * (u - radius))))
                line = below[q * unit + u]
                for p in range(rows):
                    centre = radius + p * unit
                    sums[plane, q, p] += line[centre + half + 1] - line[centre - half]


class BlockCounts(NamedTuple):
    """Blocks of all edge lengths, concatenated, and the numbers of the map's cells in them.

    `counts` are mod 2^16, (edge, plane, col, row mod step, row div step), flat, counted in the
    window's units.
    """

    counts: Shorts
    edges: Ints  # (edge,) [cells]
    starts: Ints  # (edge + 1,): the first block of each edge, and their number
    corners: Ints  # (block,): place in a summed table, from the disc's first cell on
    addresses: Ints  # (row mod step, block): place in `counts` of the free cells
    rests: Ints  # (cell,): rows mod step at which the cells' templates begin at the first offset
    places: Ints  # (cell,): places in `counts` at which they do
    line_stride: int  # between neighbouring offsets in x
    plane_stride: int


@njit(nogil=True, cache=True)
def fill_summed_table(octets: Octets, table: Shorts) -> None:
    """Fill in the number of cells set before each column and row mod 2^16, (plane, col + 1, row +
    1).

    `octets` are strips, (plane, col, row).
    """
    cols, rows = octets.shape[1], octets.shape[2]
    for plane in range(PLANES):
        for j in range(rows + 1):
            table[plane, 0, j] = 0
        for i in range(cols):
            table[plane, i + 1, 0] = 0
            below = 0
            for j in range(rows):  # the sum is taken mod 2^16 when it is stored
                below += octets[plane, i, j] & 1
                table[plane, i + 1, j + 1] = table[plane, i, j + 1] + below


@njit(nogil=True, cache=True)
def count_blocks(table: Shorts, top: int, left: int, edge: int, unit: int, counts: Shorts) -> None:
    """Fill in the number of cells set in each block, (plane, col, row mod step, row div step).

    Blocks begin at every `unit`-th row and column of the table from (left, top) on; blocks that end
    beyond it are 0.
    """
    step_units = counts.shape[2]
    for plane in range(PLANES):
        for q in range(counts.shape[1]):
            near = left + q * unit
            far = near + edge
            for p in range(step_units * counts.shape[3]):
                low, count = top + p * unit, np.uint16(0)
                high = low + edge
                if far < table.shape[1] and high < table.shape[2]:
                    count = np.uint16(
                        table[plane, far, high]
                        - table[plane, far, low]
                        - table[plane, near, high]
                        + table[plane, near, low]
                    )
                counts[plane, q, p % step_units, p // step_units] = count


class TemplateCounts(NamedTuple):
    """Numbers of a template's cells in each block, and the places of the blocks' counts."""

    free: Shorts  # (block,)
    occupied: Shorts
    places: Ints


@njit(nogil=True, cache=True)
def mark_kept_lines(
    blocks: BlockCounts,
    table: Shorts,
    corners: Ints,
    limit: int,
    shift: int,
    is_kept: Bools,
    control: Ints,
) -> None:
    """Fill in which lines of a heading have an offset with a bound of at most ``limit << shift``.

    Each difference is rounded down to a multiple of ``1 << shift``, which leaves a lower bound.

    Parameters
    ----------
    blocks : Blocks
        The blocks, and the numbers of the map's cells in them.
    table : (plane, col + 1, row + 1) array of uint16
        Result of `sum_up` for the map turned by the heading.
    corners : (n,) array of int64
        Places in the table of the first cells of the discs.
    limit, shift : int
        The limit is below 65,535.
    is_kept : (n, dx) array of bool
        The result.
    control : (2,) array of int64
        Nothing more is done once ``control[STOP]`` is set.
    """
    n_blocks = blocks.corners.size
    template_counts = TemplateCounts(
        np.empty(n_blocks, np.uint16), np.empty(n_blocks, np.uint16), np.empty(n_blocks, np.int64)
    )
    for n in range(len(is_kept)):
        if control[STOP]:
            return
        for i in range(is_kept.shape[1]):
            is_kept[n, i] = True
        has_lines, size = True, 0
        while has_lines and size < blocks.edges.size:
            count_template_cells(blocks, size, blocks.rests[n], table, corners[n], template_counts)
            has_lines = reject_lines(
                blocks, size, blocks.places[n], limit, shift, template_counts, is_kept[n]
            )
            size += 1


@njit(inline="always")
def count_template_cells(
    blocks: BlockCounts,
    edge_index: int,
    rest: int,
    table: Shorts,
    corner: int,
    template_counts: TemplateCounts,
) -> None:
    """Write the numbers of a template's cells in the blocks of one edge, and the blocks' places."""
    sums, up = table.reshape(-1), blocks.edges[edge_index]
    across, plane_size = up * table.shape[2], sums.size // PLANES
    corners, addresses = blocks.corners, blocks.addresses
    free, occupied, places = template_counts
    # Blocks in which the template is unknown differ least, and come last: most lines are rejected
    # before they are reached.
    front, back = blocks.starts[edge_index], blocks.starts[edge_index + 1]
    for b in range(blocks.starts[edge_index], blocks.starts[edge_index + 1]):
        at = corner + corners[b]
        n_free = sums[at + across + up] - sums[at + across] - sums[at + up] + sums[at]
        at += plane_size
        n_occupied = sums[at + across + up] - sums[at + across] - sums[at + up] + sums[at]
        if np.uint16(n_free | n_occupied) != 0:
            to = front
            front += 1
        else:
            back -= 1
            to = back
        free[to], occupied[to], places[to] = n_free, n_occupied, addresses[rest, b]


@njit(inline="always")
def reject_lines(
    blocks: BlockCounts,
    edge_index: int,
    address: int,
    limit: int,
    shift: int,
    template_counts: TemplateCounts,
    is_kept: Bools,
) -> bool:
    """Unmark lines without an offset up to the limit; return True if any is left."""
    free, occupied, places = template_counts
    counts, line_stride, plane_stride = blocks.counts, blocks.line_stride, blocks.plane_stride
    first, last, offsets = blocks.starts[edge_index], blocks.starts[edge_index + 1], is_kept.size
    has_lines = False
    for i in range(offsets):
        if not is_kept[i]:
            continue
        is_kept[i] = False
        line = address + i * line_stride
        for group in range(0, offsets, SHORTS):
            within = np.uint64(0xFFFF_FFFF)
            if offsets - group < SHORTS:
                within >>= np.uint64(SHORTS - offsets + group)
            total = zero_shorts()
            start = first
            while start < last and within != 0:
                # The limit is looked at once for so many blocks: each look waits for the sums.
                stop = min(start + 16, last)
                for b in range(start, stop):
                    block_place = line + group + places[b]
                    total = add_distances(total, counts, block_place, free[b], shift)
                    total = add_distances(
                        total, counts, block_place + plane_stride, occupied[b], shift
                    )
                start = stop
                within &= flag_small_lanes(total, limit)
            if within != 0:
                is_kept[i] = has_lines = True
                break
    return has_lines

"""A lower bound of the mismatch that rejects whole lines of offsets without comparing cells.

Within any block of cells, template and map differ in at least as many cells as their numbers of
free cells do, and likewise of occupied ones. The sum of these differences over blocks that lie
within the disc is at most S / 127. A *line* is the offsets in y at one offset in x and one
heading; they are the lanes of the vectors. Large blocks reject most lines, and smaller ones, whose
bound is closer, are asked about the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.bitplanes import PLANES
from locplan._kernels.sad import DONE, STOP
from locplan._kernels.simd import SHORTS, add_distances, lanes_within, zero_shorts


class Blocks(NamedTuple):
    """Blocks of one edge after the other, and the numbers of the map's cells in them.

    `counts` are mod 2^16, (edge, plane, col, row mod step, row div step), flat, counted in the
    window's units.
    """

    counts: NDArray[np.uint16]
    edges: NDArray[np.int64]  # (edge,) [cells]
    starts: NDArray[np.int64]  # (edge + 1,): the first block of each edge, and their number
    corners: NDArray[np.int64]  # (block,): place in a summed table, from the disc's first cell on
    addresses: NDArray[np.int64]  # (row mod step, block): place in `counts` of the free cells
    line_stride: int  # between neighbouring offsets in x
    plane_stride: int


@njit(nogil=True, cache=True)
def sum_up(octets: NDArray[np.uint8], table: NDArray[np.uint16]) -> None:
    """Fill in the cells set before each column and row mod 2^16, (plane, col + 1, row + 1).

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
def count_blocks(
    table: NDArray[np.uint16],
    top: int,
    left: int,
    edge: int,
    unit: int,
    counts: NDArray[np.uint16],
) -> None:
    """Fill in the cells set in each block, (plane, col, row mod step, row div step).

    Blocks begin at every `unit`-th row and column of the table from (left, top) on; those that end
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


@njit(nogil=True, cache=True)
def keep_lines(
    blocks: Blocks,
    table: NDArray[np.uint16],
    corners: NDArray[np.int64],
    rests: NDArray[np.int64],
    addresses: NDArray[np.int64],
    limit: int,
    shift: int,
    kept: NDArray[np.bool_],
    control: NDArray[np.int64],
    due: int,
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
        Places in the table at which the cells' discs begin.
    rests, addresses : (n,) arrays of int64
        Rows mod step, and places in ``blocks.counts``, at which they begin at the first offset.
    limit, shift : int
        The limit is below 65,535.
    kept : (n, dx) array of bool
        The result.
    control, due
        ``control[DONE]`` grows by `due` on the way; nothing is done once ``control[STOP]`` is set.
    """
    sums, table_rows = table.reshape(-1), table.shape[2]
    offsets = kept.shape[1]
    free = np.empty(blocks.corners.size, np.uint16)
    occupied = np.empty(blocks.corners.size, np.uint16)
    places = np.empty(blocks.corners.size, np.int64)
    done = control[DONE] if control.size > DONE else 0
    for n in range(len(kept)):
        if control[STOP]:
            return
        asked = True
        for i in range(offsets):
            kept[n, i] = True
        for size in range(blocks.edges.size):
            if not asked:
                break
            read_template(
                blocks, size, rests[n], sums, table_rows, corners[n], free, occupied, places
            )
            asked = reject_lines(
                blocks, size, addresses[n], limit, shift, free, occupied, places, kept[n]
            )
        if control.size > DONE:
            control[DONE] = done + due * (n + 1) // len(kept)


@njit(inline="always")
def read_template(
    blocks: Blocks,
    size: int,
    rest: int,
    sums: NDArray[np.uint16],
    table_rows: int,
    corner: int,
    free: NDArray[np.uint16],
    occupied: NDArray[np.uint16],
    places: NDArray[np.int64],
) -> None:
    """Write the numbers of a template's cells in the blocks of one edge, and the blocks' places."""
    up, plane_size = blocks.edges[size], sums.size // PLANES
    corners, addresses = blocks.corners, blocks.addresses
    across = up * table_rows
    # Blocks in which the template is unknown differ least, and come last: most lines are rejected
    # before they are reached.
    front, back = blocks.starts[size], blocks.starts[size + 1]
    for b in range(blocks.starts[size], blocks.starts[size + 1]):
        at = corner + corners[b]
        some = sums[at + across + up] - sums[at + across] - sums[at + up] + sums[at]
        at += plane_size
        more = sums[at + across + up] - sums[at + across] - sums[at + up] + sums[at]
        if np.uint16(some | more) != 0:
            to = front
            front += 1
        else:
            back -= 1
            to = back
        free[to], occupied[to], places[to] = some, more, addresses[rest, b]


@njit(inline="always")
def reject_lines(
    blocks: Blocks,
    size: int,
    address: int,
    limit: int,
    shift: int,
    free: NDArray[np.uint16],
    occupied: NDArray[np.uint16],
    places: NDArray[np.int64],
    kept: NDArray[np.bool_],
) -> bool:
    """Take the marks off lines without an offset up to the limit; return whether any is left."""
    counts, line_stride, plane_stride = blocks.counts, blocks.line_stride, blocks.plane_stride
    first, last, offsets = blocks.starts[size], blocks.starts[size + 1], kept.size
    asked = False
    for i in range(offsets):
        if not kept[i]:
            continue
        kept[i] = False
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
                    here = line + group + places[b]
                    total = add_distances(total, counts, here, free[b], shift)
                    total = add_distances(total, counts, here + plane_stride, occupied[b], shift)
                start = stop
                within &= lanes_within(total, limit)
            if within != 0:
                kept[i] = asked = True
                break
    return asked

"""The blocks of cells whose counts reject offsets, for the disc and the map around some cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field.estimators._sad_tiles import Due, Group, Layout

EDGES = (64, 32)
"""Edges of the blocks, the large ones first [cells]."""
SMALL_EDGES = (32, 16)
"""Edges of the blocks of small discs [cells]."""
SMALL = 180
"""Radius below which a disc is small [cells]."""


def disc_blocks(radius: int, edge: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First rows and columns of blocks within a disc, from the disc's own on, (block,) each.

    They begin at whole squares and do not overlap. The outer ones, which differ most when the map
    is turned, come first.
    """
    from locplan._kernels.bitplanes import SQUARE

    def columns(start: int) -> list[tuple[int, int]]:
        found = []
        for left in range(start, 2 * radius + 2 - edge, edge):
            across = max(abs(left - radius), abs(left + edge - 1 - radius))
            half = math.isqrt(radius**2 - across**2)
            low = -(-(radius - half) // SQUARE) * SQUARE
            number = (radius + half + 1 - low) // edge
            found += [(low + n * edge, left) for n in range(number)]
        return found

    best = max((columns(start) for start in range(0, edge, SQUARE)), key=len)
    centre = radius - (edge - 1) / 2
    best.sort(key=lambda block: -math.hypot(block[0] - centre, block[1] - centre))
    places = np.array(best, np.int64).reshape(-1, 2)
    return places[:, 0], places[:, 1]


def scaled(greatest: int) -> tuple[int, int]:
    """Limit below 65,535 for sums of numbers shifted to the right by so many bits, and the bits."""
    from locplan._kernels.simd import MAX_SHORT

    shift = max(0, greatest.bit_length() - MAX_SHORT.bit_length())
    shift += greatest >> shift >= MAX_SHORT
    return greatest >> shift, shift


def kept_lines(
    layout: Layout,
    groups: list[Group],
    negligible: int,
    due: Due,
) -> list[NDArray[np.bool_]]:
    """Lines of offsets that may have an S / 127 of at most `negligible`.

    Of each group of cells, (theta, n, dx).
    """
    from locplan._kernels import bitplanes

    control, headings = layout.part.control, layout.window.angles.size
    limit, shift = scaled(negligible)
    kept = [np.ones((headings, group.cells.size, layout.offsets), bool) for group in groups]
    still = np.empty((2, *(size + 1 for size in layout.still.shape[1:])), np.uint16)
    bitplanes.sum_up(layout.still, still)
    table = np.empty((2, *(size + 1 for size in layout.turned.shape[2:])), np.uint16)
    laid_out = [_lay_out(layout, group, still, table.shape[2]) for group in groups]
    for k in range(headings):
        bitplanes.sum_up(layout.turned[k], table)
        corners = layout.lefts[:, k] * table.shape[2] + layout.tops[:, k]
        for group, (blocks, rests, addresses), lines in zip(groups, laid_out, kept, strict=True):
            bitplanes.keep_lines(
                blocks,
                table,
                corners[group.cells],
                rests,
                addresses,
                limit,
                shift,
                lines[k],
                control,
                due.for_steps(group.cells.size),
            )
    return kept


def beside(lines: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Lines that are kept, and those next to them along x, (theta, n, dx)."""
    wide = lines.copy()
    wide[:, :, 1:] |= lines[:, :, :-1]
    wide[:, :, :-1] |= lines[:, :, 1:]
    return wide


def _lay_out(
    layout: Layout, group: Group, still: NDArray[np.uint16], table_rows: int
) -> tuple[Any, NDArray[np.int64], NDArray[np.int64]]:
    """The blocks around a group of cells; rows mod step and places at which the cells begin."""
    from locplan._kernels import bitplanes
    from locplan._kernels.simd import SHORTS

    edges = SMALL_EDGES if layout.radius < SMALL else EDGES
    places = [disc_blocks(layout.radius, edge) for edge in edges]
    unit, more = group.unit, max(0, 2 * layout.radius + 1 - min(edges))
    step_units = layout.window.step_cells // unit
    rows, cols = (span + more // unit for span in group.spans(unit, layout.window.reach))
    lanes = -(-rows // step_units) + -(-layout.offsets // SHORTS) * SHORTS
    counts = np.empty((len(edges), 2, cols, step_units, lanes), np.uint16)
    col_stride, plane_stride = step_units * lanes, cols * step_units * lanes
    addresses, corners, rest = [], [], np.arange(step_units)[:, None]
    for n, (edge, (block_rows, block_cols)) in enumerate(zip(edges, places, strict=True)):
        bitplanes.count_blocks(still, group.top, group.left, edge, unit, counts[n])
        p, q = rest + block_rows // unit, block_cols // unit
        address = p % step_units * lanes + p // step_units + q * col_stride
        addresses.append(address + n * 2 * plane_stride)
        corners.append(block_cols * table_rows + block_rows)
    blocks = bitplanes.Blocks(
        counts=counts.reshape(-1),
        edges=np.array(edges),
        starts=np.cumsum([0, *(len(block_rows) for block_rows, _ in places)]),
        corners=np.concatenate(corners),
        addresses=np.concatenate(addresses, axis=1),
        line_stride=step_units * col_stride,
        plane_stride=plane_stride,
    )
    p, q = group.rows // unit, group.cols // unit
    return blocks, p % step_units, q * col_stride + p // step_units

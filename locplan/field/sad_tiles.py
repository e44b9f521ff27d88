"""Layouts of the map and its turned copies for the kernels of `sad`, for many cells at once.

Blocks of cells, whose counts reject offsets, are laid out likewise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets, Shorts
from locplan._support.kernels.simd import MAX_SHORT, SHORTS
from locplan.field.estimator import MapPart
from locplan.field.kernels import bitplanes, sad, templates
from locplan.field.kernels.bitplanes import PLANES, SQUARE
from locplan.field.search_window import OffsetLattice
from locplan.field.templates import (
    BEHIND,
    compute_map_centre,
    count_template_rays,
    find_cell_ray_indices,
    make_disc_mask,
)


class CellGroup(NamedTuple):
    """Cells whose covariances share one layout of the map."""

    cells: NDArray[np.intp]  # indices of the cells in their part of the map, (n,)
    rows: Ints  # rows of the cells, from the first one's on, (n,)
    cols: Ints  # columns of the cells, from the first one's on, (n,)
    top: int  # row of the layout's strips at which the discs of the first row begin, at any offset
    left: int  # column of the layout's strips at which the discs of the first column begin
    # Greatest common divisor of the cells' distances and the step of the offsets [cells].
    spacing: int

    @property
    def common_spacing(self) -> int:
        """Greatest common divisor of the spacing and a square's edge [cells]."""
        return math.gcd(self.spacing, SQUARE)

    def count_spans(self, unit: int, reach: int) -> tuple[int, int]:
        """Number of rows and columns, `unit` cells apart, of the cells and `reach` around them."""
        rows, cols = int(self.rows.max()), int(self.cols.max())
        return (rows + 2 * reach) // unit + 1, (cols + 2 * reach) // unit + 1


@dataclass(frozen=True, eq=False)
class MapLayout:
    """The map around some cells and its turned copies, as the kernels read them."""

    part: MapPart  # the cells, and the part of the map that they depend on
    # Levels of the part, one type of array, so that kernels are compiled once.
    levels: Octets
    window: OffsetLattice  # offsets at which the template is compared
    radius: int  # radius of the template disc [cells]
    disc: templates.DiscSquares  # the disc in squares
    first: tuple[int, int]  # row and column of the whole map at which `still` begins
    unrotated_octets: Octets  # strips of the map, (plane, col, row)
    # Strips of the map turned by each heading, (heading, plane, col, row).
    rotated_strips: Octets
    tops: Ints  # rows of `turned` at which the cells' discs begin, (n, heading)
    lefts: Ints  # columns of `turned` at which the cells' discs begin, (n, heading)

    @classmethod
    def from_part(cls, part: MapPart, radius: int, window: OffsetLattice) -> MapLayout:
        """Lay out the map and its turned copies."""
        levels = np.array(part.levels, order="C")
        squares = templates.make_disc_squares(make_disc_mask(radius))
        diameter = squares.rows * SQUARE
        centre_row, centre_col = compute_map_centre(part.map_shape)
        cos, sin = np.cos(window.angles), np.sin(window.angles)

        # The templates: the turned maps around the cells' turned and rounded places.
        dy, dx = (part.rows - centre_row)[:, None], (part.cols - centre_col)[:, None]
        rows = np.floor(sin * dx + cos * dy + centre_row + 0.5).astype(np.int64)
        cols = np.floor(cos * dx - sin * dy + centre_col + 0.5).astype(np.int64)
        first_rows, first_cols = rows.min(axis=0), cols.min(axis=0)
        tops, lefts = rows - first_rows, cols - first_cols
        spans = int(lefts.max()) + diameter, int(tops.max()) + diameter
        rotated_strips = np.empty((window.angles.size, PLANES, *spans), np.uint8)
        middle = centre_row, centre_col
        first_rows, first_cols = first_rows - radius, first_cols - radius
        bitplanes.cut_rotated_strips(
            levels, *part.corner, *middle, cos, sin, first_rows, first_cols, rotated_strips
        )

        # The map: the rows and columns of the discs of any cell at any offset, in whole squares.
        around = radius + window.reach
        first = int(part.rows.min()) - around, int(part.cols.min()) - around
        extra_cells = diameter + 2 * window.reach + 2 * SQUARE
        spans = int(np.ptp(part.cols)) + extra_cells, int(np.ptp(part.rows)) + extra_cells
        still = np.empty((1, PLANES, *spans), np.uint8)
        no_turn = np.ones(1), np.zeros(1), np.array(first[:1]), np.array(first[1:])
        bitplanes.cut_rotated_strips(levels, *part.corner, 0.0, 0.0, *no_turn, still)
        return cls(
            part, levels, window, radius, squares, first, still[0], rotated_strips, tops, lefts
        )

    @property
    def n_offsets(self) -> int:
        """Number of offsets in x, and also in y."""
        return 2 * self.window.half_steps + 1

    def groups(self) -> list[CellGroup]:
        """Return the cells in groups that share a layout of the map, as thin as possible.

        A layout has every row and column that may be the first of a square, for any cell and
        offset. Cells are in one group if their rows and columns leave the same remainders after
        division by the common unit of the offsets' step and a square's edge.
        """
        unit = math.gcd(self.window.step_cells, SQUARE)
        over = self.part.rows % unit * unit + self.part.cols % unit
        return [
            self._make_group(np.flatnonzero(over == remainder)) for remainder in np.unique(over)
        ]

    def _make_group(self, cells: NDArray[np.intp]) -> CellGroup:
        """Return the group of some cells."""
        around, step = self.radius + self.window.reach, self.window.step_cells
        rows, cols = self.part.rows[cells], self.part.cols[cells]
        top, left = int(rows.min()), int(cols.min())
        rows, cols = rows - top, cols - left
        return CellGroup(
            cells=cells,
            rows=rows,
            cols=cols,
            top=top - around - self.first[0],
            left=left - around - self.first[1],
            spacing=math.gcd(step, int(np.gcd.reduce(rows)), int(np.gcd.reduce(cols))),
        )

    def make_tile_layout(self, group: CellGroup) -> templates.TileLayout:
        """Lay out the tile of a group of cells."""
        unit = group.common_spacing
        step_units, square_units = self.window.step_cells // unit, SQUARE // unit
        diameter = self.disc.rows * SQUARE
        rows, cols = (
            span + diameter // unit for span in group.count_spans(unit, self.window.reach)
        )
        lanes = -(-rows // step_units) + -(-self.n_offsets // sad.GROUP) * sad.GROUP
        words = np.zeros((PLANES, cols, step_units, lanes), np.uint64)
        below = np.zeros(words.shape, np.int64)
        bitplanes.lay_out_words(
            self.unrotated_octets, group.top, group.left, rows, unit, words, below
        )
        col_words, p = step_units * lanes, group.rows // unit
        further = np.arange(step_units)[:, None] + square_units * np.arange(self.disc.rows + 1)

        sums = self._compute_disc_sums(group)
        sum_steps, sum_lanes = sums.shape[2:]
        sum_row, sum_col = group.rows // group.spacing, group.cols // group.spacing
        sum_places = (sum_col * sum_steps + sum_row % sum_steps) * sum_lanes + sum_row // sum_steps

        strip_rows, strip_plane = self.rotated_strips.shape[3], self.rotated_strips[0, 0].size
        heading = PLANES * strip_plane * np.arange(self.window.angles.size)
        return templates.TileLayout(
            words=words.reshape(-1),
            below=below.reshape(-1),
            disc_sums=sums.reshape(-1),
            octets=self.rotated_strips.reshape(-1),
            corners=heading + self.lefts[group.cells] * strip_rows + self.tops[group.cells],
            rests=p % step_units,
            places=group.cols // unit * col_words + p // step_units,
            sum_places=sum_places,
            row_places=further % step_units * lanes + further // step_units,
            strip_rows=strip_rows,
            strip_plane=strip_plane,
            square_col=square_units * col_words,
            line=step_units * col_words,
            plane=cols * col_words,
            sum_line=sum_steps * sum_steps * sum_lanes,
            sum_plane=sums[0].size,
            offsets=self.n_offsets,
            disc=self.disc,
        )

    def _compute_disc_sums(self, group: CellGroup) -> Ints:
        """Compute disc sums of a group at all offsets, (plane, col, row mod step, row div step).

        Their rows and columns are as far apart as the cells are.
        """
        spacing = group.spacing
        rows, cols = group.count_spans(spacing, self.window.reach)
        steps = self.window.step_cells // spacing
        sums = np.zeros((PLANES, cols, -(-rows // steps) * steps), np.int64)
        corner = group.top, group.left
        bitplanes.fill_disc_sums(self.unrotated_octets, *corner, self.radius, spacing, rows, sums)
        return sums.reshape(PLANES, cols, -1, steps).swapaxes(2, 3)

    def make_sight_rays(self, group: CellGroup) -> templates.SightRays:
        """Return the rays of the visible templates of a group of cells."""
        return _make_rays(self.radius, self.window)._replace(
            levels=self.levels,
            rows=self.part.rows[group.cells] - self.part.corner[0],
            cols=self.part.cols[group.cells] - self.part.corner[1],
        )


@lru_cache(maxsize=4)
def _make_rays(radius: int, window: OffsetLattice) -> templates.SightRays:
    """Return the rays of visible templates, without cells."""
    angles = 2 * np.pi * np.arange(count_template_rays(radius)) / count_template_rays(radius)
    offset = 2 * np.arange(-radius, radius + 1, dtype=np.int32)
    beams = [find_cell_ray_indices(radius, theta).astype(np.int32) for theta in window.angles]
    nowhere = np.empty(0, np.int64)
    return templates.SightRays(
        cos=np.cos(angles),
        sin=np.sin(angles),
        beam=np.array([templates.order_by_squares(beam) for beam in beams]),
        distance=templates.order_by_squares(offset[:, None] ** 2 + offset[None, :] ** 2),
        behind=BEHIND,
        radius=radius,
        levels=np.empty((0, 0), np.uint8),
        rows=nowhere,
        cols=nowhere,
    )


def find_disc_blocks(radius: int, edge: int) -> tuple[Ints, Ints]:
    """Return first rows and columns of the blocks within a disc, (block,) each.

    They begin at whole squares and do not overlap. The outer ones, which differ most when the map
    is turned, come first.
    """

    def columns(start: int) -> list[tuple[int, int]]:
        blocks = []
        for left in range(start, 2 * radius + 2 - edge, edge):
            across = max(abs(left - radius), abs(left + edge - 1 - radius))
            half = math.isqrt(radius**2 - across**2)
            low = -(-(radius - half) // SQUARE) * SQUARE
            number = (radius + half + 1 - low) // edge
            blocks += [(low + n * edge, left) for n in range(number)]
        return blocks

    best = max((columns(start) for start in range(0, edge, SQUARE)), key=len)
    centre = radius - (edge - 1) / 2
    best.sort(key=lambda block: -math.hypot(block[0] - centre, block[1] - centre))
    places = np.array(best, np.int64).reshape(-1, 2)
    return places[:, 0], places[:, 1]


def compute_short_scaling(greatest: int) -> tuple[int, int]:
    """Return a limit below 65,535 and the number of bits by which to shift sums to the right."""
    shift = max(0, greatest.bit_length() - MAX_SHORT.bit_length())
    shift += greatest >> shift >= MAX_SHORT
    return greatest >> shift, shift


def find_kept_lines(layout: MapLayout, groups: list[CellGroup], negligible: int) -> list[Bools]:
    """Mark the lines of offsets that may have an S / 127 of at most `negligible`.

    Of each group of cells, (theta, n, dx).
    """
    control, headings = layout.part.control, layout.window.angles.size
    limit, shift = compute_short_scaling(negligible)
    line_masks = [np.ones((headings, group.cells.size, layout.n_offsets), bool) for group in groups]
    still = np.empty((2, *(size + 1 for size in layout.unrotated_octets.shape[1:])), np.uint16)
    bitplanes.fill_summed_table(layout.unrotated_octets, still)
    table = np.empty((2, *(size + 1 for size in layout.rotated_strips.shape[2:])), np.uint16)
    laid_out = [_count_group_blocks(layout, group, still, table.shape[2]) for group in groups]
    for k in range(headings):
        bitplanes.fill_summed_table(layout.rotated_strips[k], table)
        corners = layout.lefts[:, k] * table.shape[2] + layout.tops[:, k]
        for group, blocks, lines in zip(groups, laid_out, line_masks, strict=True):
            cell_corners = corners[group.cells]
            bitplanes.mark_kept_lines(blocks, table, cell_corners, limit, shift, lines[k], control)
    return line_masks


def _count_group_blocks(
    layout: MapLayout, group: CellGroup, unrotated_table: Shorts, table_rows: int
) -> bitplanes.BlockCounts:
    """Count the map's cells in the blocks around a group of cells."""
    edges = (32, 16) if layout.radius < 180 else (64, 32)  # [cells], the large ones first
    places = [find_disc_blocks(layout.radius, edge) for edge in edges]
    unit, extra_cells = group.common_spacing, max(0, 2 * layout.radius + 1 - min(edges))
    step_units = layout.window.step_cells // unit
    rows, cols = (
        span + extra_cells // unit for span in group.count_spans(unit, layout.window.reach)
    )
    lanes = -(-rows // step_units) + -(-layout.n_offsets // SHORTS) * SHORTS
    counts = np.empty((len(edges), 2, cols, step_units, lanes), np.uint16)
    col_stride, plane_stride = step_units * lanes, cols * step_units * lanes
    addresses, corners, rest = [], [], np.arange(step_units)[:, None]
    for n, (edge, (block_rows, block_cols)) in enumerate(zip(edges, places, strict=True)):
        bitplanes.count_blocks(unrotated_table, group.top, group.left, edge, unit, counts[n])
        p, q = rest + block_rows // unit, block_cols // unit
        address = p % step_units * lanes + p // step_units + q * col_stride
        addresses.append(address + n * 2 * plane_stride)
        corners.append(block_cols * table_rows + block_rows)
    p, q = group.rows // unit, group.cols // unit
    return bitplanes.BlockCounts(
        counts=counts.reshape(-1),
        edges=np.array(edges),
        starts=np.cumsum([0, *(len(block_rows) for block_rows, _ in places)]),
        corners=np.concatenate(corners),
        addresses=np.concatenate(addresses, axis=1),
        rests=p % step_units,
        places=q * col_stride + p // step_units,
        line_stride=step_units * col_stride,
        plane_stride=plane_stride,
    )


def compute_step_covariances(
    layout: MapLayout, weights: Floats, places: Floats, negligible: int | None, visible: bool
) -> Floats:
    """Compute covariances [lattice steps], (n, 3, 3); NaN if the computation was stopped.

    `places` are the places of the lattice's offsets among the layout's; offsets with an S / 127
    above `negligible` are left out. With `visible`, only the visible part of the disc counts.
    """
    part, groups = layout.part, layout.groups()
    cells, headings = len(part.rows), layout.window.angles.size
    all_lines = np.ones((headings, 1, layout.n_offsets), bool)
    line_masks = [all_lines] * len(groups)
    if negligible is not None:
        line_masks = find_kept_lines(layout, groups, negligible)
        if (places % 1).any():  # what lies beside a kept line along x is read from both
            for lines in line_masks:
                wide = lines.copy()
                wide[:, :, 1:] |= lines[:, :, :-1]
                wide[:, :, :-1] |= lines[:, :, 1:]
                lines[:] = wide
    scratch = sad.make_cell_buffers(layout.n_offsets, headings, layout.disc, masked=visible)
    result = np.full((cells, 3, 3), np.nan)
    for group, lines in zip(groups, line_masks, strict=True):
        covariances = np.full((group.cells.size, 3, 3), np.nan)
        tile, sight = (
            layout.make_tile_layout(group),
            layout.make_sight_rays(group) if visible else None,
        )
        sad.fill_tile_covariances(
            tile, sight, lines, weights, places, scratch, part.control, covariances
        )
        result[group.cells] = covariances
    return result

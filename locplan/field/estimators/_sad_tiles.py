"""Laying out the map and its turned copies for the kernels of `sad`, for many cells at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field._estimator import MapPart
from locplan.field._search_window import OffsetLattice
from locplan.field.templates import BEHIND, beam_count, beam_of_cell, disc, map_centre


def template_radius(reach: float, window: OffsetLattice, map_shape: tuple[int, int]) -> int:
    """Radius of the disc in whole cells, at least one, for a range of `reach` metres.

    Cells that are further away than the map is long are unknown at every offset and add no
    mismatch, so that a larger disc gives the same sums.
    """
    whole_map = math.ceil(math.hypot(*map_shape) + math.sqrt(2) * window.reach) + 2
    return max(1, min(math.floor(reach / window.resolution + 1e-9), whole_map))


@dataclass
class Due:
    """Shares of a number of cells, in whole cells, for the parts of some work."""

    cells: int
    """Number of cells for all of the work."""
    steps: int
    """Number of steps of all of the work."""
    done: int = 0
    """Number of steps done."""

    def for_steps(self, steps: int) -> int:
        """Number of cells for the next steps."""
        before = self.cells * self.done // self.steps
        self.done += steps
        return self.cells * self.done // self.steps - before


class Group(NamedTuple):
    """Cells whose covariances share one layout of the map."""

    cells: NDArray[np.intp]
    """Indices of the cells in their part of the map, (n,)."""
    rows: NDArray[np.int64]
    """Rows of the cells, from the first one's on, (n,)."""
    cols: NDArray[np.int64]
    """Columns of the cells, from the first one's on, (n,)."""
    top: int
    """Row of the layout's strips at which the discs of the first row begin, at any offset."""
    left: int
    """Column of the layout's strips at which the discs of the first column begin."""
    spacing: int
    """Greatest common divisor of the cells' distances and the step of the offsets [cells]."""

    @property
    def unit(self) -> int:
        """What the spacing has in common with a square's edge [cells]."""
        from locplan._kernels.bitplanes import SQUARE

        return math.gcd(self.spacing, SQUARE)

    def spans(self, unit: int, reach: int) -> tuple[int, int]:
        """Number of rows and columns, `unit` cells apart, of the cells and `reach` around them."""
        rows, cols = int(self.rows.max()), int(self.cols.max())
        return (rows + 2 * reach) // unit + 1, (cols + 2 * reach) // unit + 1


@dataclass(frozen=True, eq=False)
class Layout:
    """The map around some cells and its turned copies, as the kernels read them."""

    part: MapPart
    """The cells, and the part of the map that they depend on."""
    levels: NDArray[np.uint8]
    """Levels of the part, one type of array, so that kernels are compiled once."""
    window: OffsetLattice
    """Offsets at which the template is compared."""
    radius: int
    """Radius of the template disc [cells]."""
    disc: Any
    """The disc in squares."""
    first: tuple[int, int]
    """Row and column of the whole map at which `still` begins."""
    still: NDArray[np.uint8]
    """Strips of the map, (plane, col, row)."""
    turned: NDArray[np.uint8]
    """Strips of the map turned by each heading, (heading, plane, col, row)."""
    tops: NDArray[np.int64]
    """Rows of `turned` at which the cells' discs begin, (n, heading)."""
    lefts: NDArray[np.int64]
    """Columns of `turned` at which the cells' discs begin, (n, heading)."""

    @classmethod
    def of(cls, part: MapPart, radius: int, window: OffsetLattice) -> Layout:
        """Lay out the map and its turned copies."""
        from locplan._kernels import bitplanes, templates

        levels = np.array(part.levels, order="C")
        squares = templates.disc_squares(disc(radius))
        diameter = squares.rows * bitplanes.SQUARE
        centre_row, centre_col = map_centre(part.map_shape)
        cos, sin = np.cos(window.angles), np.sin(window.angles)

        # The templates: the turned maps around the cells' turned and rounded places.
        dy, dx = (part.rows - centre_row)[:, None], (part.cols - centre_col)[:, None]
        rows = np.floor(sin * dx + cos * dy + centre_row + 0.5).astype(np.int64)
        cols = np.floor(cos * dx - sin * dy + centre_col + 0.5).astype(np.int64)
        first_rows, first_cols = rows.min(axis=0), cols.min(axis=0)
        tops, lefts = rows - first_rows, cols - first_cols
        spans = int(lefts.max()) + diameter, int(tops.max()) + diameter
        turned = np.empty((window.angles.size, bitplanes.PLANES, *spans), np.uint8)
        middle = centre_row, centre_col
        first_rows, first_cols = first_rows - radius, first_cols - radius
        bitplanes.cut_strips(
            levels, *part.corner, *middle, cos, sin, first_rows, first_cols, turned
        )

        # The map: the rows and columns of the discs of any cell at any offset, in whole squares.
        around = radius + window.reach
        first = int(part.rows.min()) - around, int(part.cols.min()) - around
        more = diameter + 2 * window.reach + 2 * bitplanes.SQUARE
        spans = int(np.ptp(part.cols)) + more, int(np.ptp(part.rows)) + more
        still = np.empty((1, bitplanes.PLANES, *spans), np.uint8)
        no_turn = np.ones(1), np.zeros(1), np.array(first[:1]), np.array(first[1:])
        bitplanes.cut_strips(levels, *part.corner, 0.0, 0.0, *no_turn, still)
        return cls(part, levels, window, radius, squares, first, still[0], turned, tops, lefts)

    @property
    def offsets(self) -> int:
        """Number of offsets in x, and also in y."""
        return 2 * self.window.half_steps + 1

    def groups(self) -> list[Group]:
        """The cells in groups that share a layout of the map, which is thin where they can.

        It has every row and column at which a square may begin, of any cell at any offset. Cells
        are in one group if they leave over the same when divided by what the step of the offsets
        has in common with a square's edge.
        """
        from locplan._kernels.bitplanes import SQUARE

        unit = math.gcd(self.window.step_cells, SQUARE)
        over = self.part.rows % unit * unit + self.part.cols % unit
        return [self._group(np.flatnonzero(over == each)) for each in np.unique(over)]

    def _group(self, cells: NDArray[np.intp]) -> Group:
        around, step = self.radius + self.window.reach, self.window.step_cells
        rows, cols = self.part.rows[cells], self.part.cols[cells]
        top, left = int(rows.min()), int(cols.min())
        rows, cols = rows - top, cols - left
        return Group(
            cells=cells,
            rows=rows,
            cols=cols,
            top=top - around - self.first[0],
            left=left - around - self.first[1],
            spacing=math.gcd(step, int(np.gcd.reduce(rows)), int(np.gcd.reduce(cols))),
        )

    def tile(self, group: Group) -> Any:
        """The tile of a group of cells."""
        from locplan._kernels import bitplanes, sad

        unit = group.unit
        step_units, square_units = self.window.step_cells // unit, bitplanes.SQUARE // unit
        diameter = self.disc.rows * bitplanes.SQUARE
        rows, cols = (span + diameter // unit for span in group.spans(unit, self.window.reach))
        lanes = -(-rows // step_units) + -(-self.offsets // sad.GROUP) * sad.GROUP
        words = np.zeros((bitplanes.PLANES, cols, step_units, lanes), np.uint64)
        below = np.zeros(words.shape, np.int64)
        bitplanes.lay_out_words(self.still, group.top, group.left, rows, unit, words, below)
        col_words, p = step_units * lanes, group.rows // unit
        further = np.arange(step_units)[:, None] + square_units * np.arange(self.disc.rows + 1)

        sums = self._disc_sums(group)
        sum_steps, sum_lanes = sums.shape[2:]
        sum_row, sum_col = group.rows // group.spacing, group.cols // group.spacing
        sum_places = (sum_col * sum_steps + sum_row % sum_steps) * sum_lanes + sum_row // sum_steps

        strip_rows, strip_plane = self.turned.shape[3], self.turned[0, 0].size
        heading = bitplanes.PLANES * strip_plane * np.arange(self.window.angles.size)
        return sad.Tile(
            words=words.reshape(-1),
            below=below.reshape(-1),
            disc_sums=sums.reshape(-1),
            octets=self.turned.reshape(-1),
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
            offsets=self.offsets,
            disc=self.disc,
        )

    def _disc_sums(self, group: Group) -> NDArray[np.int64]:
        """Disc sums of a group of cells at all offsets, (plane, col, row mod step, row div step).

        Their rows and columns are as far apart as the cells are.
        """
        from locplan._kernels import bitplanes

        spacing, diameter = group.spacing, 2 * self.radius + 1
        rows, cols = group.spans(spacing, self.window.reach)
        steps = self.window.step_cells // spacing
        sums = np.zeros((bitplanes.PLANES, cols, -(-rows // steps) * steps), np.int64)
        reached = diameter + (cols - 1) * spacing, diameter + (rows - 1) * spacing + 1
        bitplanes.disc_sums(
            self.still,
            group.top,
            group.left,
            self.radius,
            spacing,
            rows,
            np.empty(reached, np.int32),
            sums,
        )
        return sums.reshape(bitplanes.PLANES, cols, -1, steps).swapaxes(2, 3)

    def sight(self, group: Group) -> Any:
        """Rays of the visible templates of a group of cells."""
        return _rays(self.radius, self.window)._replace(
            levels=self.levels,
            rows=self.part.rows[group.cells] - self.part.corner[0],
            cols=self.part.cols[group.cells] - self.part.corner[1],
        )


@lru_cache(maxsize=4)
def _rays(radius: int, window: OffsetLattice) -> Any:
    """Rays of the visible templates of no cells."""
    from locplan._kernels.templates import Sight, by_squares

    angles = 2 * np.pi * np.arange(beam_count(radius)) / beam_count(radius)
    offset = 2 * np.arange(-radius, radius + 1, dtype=np.int32)
    beams = [beam_of_cell(radius, theta).astype(np.int32) for theta in window.angles]
    nowhere = np.empty(0, np.int64)
    return Sight(
        cos=np.cos(angles),
        sin=np.sin(angles),
        beam=np.array([by_squares(beam) for beam in beams]),
        distance=by_squares(offset[:, None] ** 2 + offset[None, :] ** 2),
        behind=BEHIND,
        radius=radius,
        levels=np.empty((0, 0), np.uint8),
        rows=nowhere,
        cols=nowhere,
    )

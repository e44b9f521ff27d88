"""Laying out the map and its turned copies for the kernels of `sad`, for many cells at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._estimator import MapPart
from locplan.field._search_window import OffsetLattice
from locplan.field._template import BEHIND, beam_count, beam_of_cell, disc, map_centre


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


@dataclass(frozen=True, eq=False)
class Layout:
    """The map around some cells and its turned copies, as the kernels read them."""

    part: MapPart
    """The cells, and the part of the map that they depend on."""
    window: OffsetLattice
    """Offsets at which the template is compared."""
    radius: int
    """Radius of the template disc [cells]."""
    first: tuple[int, int]
    """Row and column of the whole map at which `still` begins."""
    still: NDArray[np.uint8]
    """Strips of the map, (plane, col, row)."""
    turned: Any
    """Strips of the map turned by each heading."""
    turned_at: tuple[NDArray[np.int64], NDArray[np.int64]]
    """Rows and columns of the cells in the turned maps, (n, heading)."""
    disc: Any
    """The disc in squares."""

    @classmethod
    def of(cls, part: MapPart, radius: int, window: OffsetLattice) -> Layout:
        """Lay out the map and its turned copies."""
        from locplan._kernels import bitplanes, templates

        levels = np.array(part.levels, order="C")  # one type of array, for kernels compiled once
        squares = templates.disc_squares(disc(radius))
        diameter = squares.rows * bitplanes.SQUARE
        centre_row, centre_col = map_centre(part.map_shape)
        cos, sin = np.cos(window.angles), np.sin(window.angles)

        # The templates: the turned maps around the cells' turned and rounded places.
        dy, dx = (part.rows - centre_row)[:, None], (part.cols - centre_col)[:, None]
        rows = np.floor(sin * dx + cos * dy + centre_row + 0.5).astype(np.int64)
        cols = np.floor(cos * dx - sin * dy + centre_col + 0.5).astype(np.int64)
        turned = bitplanes.cut_strips(
            levels,
            *part.corner,
            centre_row,
            centre_col,
            cos,
            sin,
            rows.min(axis=0) - radius,
            cols.min(axis=0) - radius,
            int(np.ptp(rows, axis=0).max()) + diameter,
            int(np.ptp(cols, axis=0).max()) + diameter,
        )

        # The map: the rows and columns of the discs of any cell at any offset, in whole squares.
        around = radius + window.reach
        first = int(part.rows.min()) - around, int(part.cols.min()) - around
        more = diameter + 2 * window.reach + 2 * bitplanes.SQUARE
        still = bitplanes.cut_strips(
            levels,
            *part.corner,
            0.0,
            0.0,
            np.ones(1),
            np.zeros(1),
            *(np.array([each]) for each in first),
            *(int(np.ptp(each)) + more for each in (part.rows, part.cols)),
        )
        return cls(
            part,
            window,
            radius,
            (first[0], first[1]),
            still.octets[0],
            turned,
            (rows, cols),
            squares,
        )

    @property
    def units(self) -> int:
        """Greatest spacing of rows and columns to which a layout of the map can be thinned."""
        from locplan._kernels.bitplanes import SQUARE

        return math.gcd(self.window.step_cells, SQUARE)

    def groups(self) -> list[NDArray[np.intp]]:
        """Indices of the cells by what they leave over when divided by `units`."""
        over = self.part.rows % self.units * self.units + self.part.cols % self.units
        return [np.flatnonzero(over == each) for each in np.unique(over)]

    def place(self, group: NDArray[np.intp]) -> tuple[int, int, int, int]:
        """Row and column of the whole map at which a group's discs begin, and their spans."""
        rows, cols, reach = self.part.rows[group], self.part.cols[group], self.window.reach
        return (
            int(rows.min()) - self.radius - reach,
            int(cols.min()) - self.radius - reach,
            int(np.ptp(rows)) + 2 * reach,
            int(np.ptp(cols)) + 2 * reach,
        )

    def spacing(self, group: NDArray[np.intp]) -> int:
        """Greatest common divisor of a group's distances and the offsets' [cells]."""
        rows, cols = self.part.rows[group], self.part.cols[group]
        apart = np.concatenate([rows - rows[0], cols - cols[0], [self.window.step_cells]])
        return int(np.gcd.reduce(apart))

    def tile(self, group: NDArray[np.intp]) -> Any:
        """The tile of a group of cells."""
        from locplan._kernels import bitplanes, sad

        top, left, row_span, col_span = self.place(group)
        spacing = self.spacing(group)
        around = bitplanes.lay_out_window(
            self.still,
            top - self.first[0],
            left - self.first[1],
            top,
            left,
            row_span,
            col_span,
            self.radius,
            self.disc.rows * bitplanes.SQUARE,
            self.window.step_cells,
            spacing,
            math.gcd(spacing, bitplanes.SQUARE),
            -(-(2 * self.window.half_steps + 1) // sad.GROUP) * sad.GROUP,
        )
        return sad.Tile(
            window=around,
            turned=self.turned,
            rows=self.part.rows[group],
            cols=self.part.cols[group],
            turned_rows=self.turned_at[0][group],
            turned_cols=self.turned_at[1][group],
            disc=self.disc,
            radius=self.radius,
            step=self.window.step_cells,
            half_steps=self.window.half_steps,
        )

    def sight(self, group: NDArray[np.intp]) -> Any:
        """Rays of the visible templates of a group of cells."""
        rays = _rays(self.radius, self.window)
        return rays._replace(
            levels=np.array(self.part.levels, order="C"),
            rows=self.part.rows[group] - self.part.corner[0],
            cols=self.part.cols[group] - self.part.corner[1],
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
        levels=np.empty((0, 0), np.uint8),
        rows=nowhere,
        cols=nowhere,
    )

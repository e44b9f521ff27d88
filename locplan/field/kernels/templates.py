"""Parts of a template to compare: its squares of 8 x 8 cells, sorted into empty, partly set and
full.

The kernel needs |T and M| over the disc, for each plane T of a template. Squares without
a cell of T add nothing. A vertical run of full squares adds the difference of two prefix sums of
the map. The remaining squares lie along walls and along the
disc's rim. If N, the disc without T, leaves fewer of them, N is listed instead, since |T and M| =
|M| - |N and M|.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Bools, Floats, Ints, Octets, Words
from locplan._support.kernels.simd import (
    LANES,
    WORD,
    find_lowest_bit,
    full_lanes,
    load_word,
    popcount,
    set_lanes,
)
from locplan.field.kernels.bitplanes import PLANES, SQUARE

FLIPS = (np.uint64(0), np.uint64(0xFFFF_FFFF_FFFF_FFFF))
"""What makes the squares of T, and of N, of those of T."""


class DiscSquares(NamedTuple):
    """The disc in squares, flat (col, row); columns are rounded up to whole vectors."""

    words: Words
    cols: int
    rows: int
    cells: int


class SightRays(NamedTuple):
    """Rays of visible templates, and the ray towards each cell of the disc."""

    cos: Floats  # (ray,)
    sin: Floats
    beam: NDArray[np.int32]  # (heading, square, bit)
    distance: NDArray[np.int32]  # (square, bit): squared distance, in half cells
    behind: int  # cells seen behind the one that a ray hits
    radius: int  # of the disc
    levels: Octets  # the part of the map that the rays see
    rows: Ints  # (n,) rows of the cells in `levels`
    cols: Ints


class TemplateSquares(NamedTuple):
    """Squares and runs of one cell's templates, for all headings in turn.

    Addresses are into the window's words, for the offsets that are first in x and y.
    """

    squares: Words
    addresses: Ints
    run_starts: Ints
    run_ends: Ints
    bounds: Words  # (heading, by T or by N, squares from, to, runs from, to)
    ones: Ints  # (heading,): |T| of both planes together
    signs: Ints  # (heading, plane): 1 where T is listed, -1 where N is, 0 both
    partly: Words  # (plane, side, chunk) scratch: a bit for each square of a column
    full: Words


class TileLayout(NamedTuple):
    """Cells whose covariances share one layout of the map.

    A cell's *place* is the place of its disc's first square, or of its disc sum, at the first
    offset.
    """

    words: Words  # (plane, col, row mod step, row div step), flat: the map's squares
    below: Ints  # laid out like words: cells set in the strip's rows below
    disc_sums: Ints  # (plane, col, row mod step, row div step), flat
    octets: Octets  # (heading, plane, col, row), flat: strips of the turned maps
    corners: Ints  # (n, heading) places of the cells in octets
    rests: Ints  # (n,) rows of the cells mod step
    places: Ints  # (n,) places of the cells in words
    sum_places: Ints  # (n,) places of the cells in disc_sums
    row_places: Ints  # (row mod step, row of squares): further on in words
    strip_rows: int  # number of octets from a column to the next
    strip_plane: int
    square_col: int  # number of words from a square to the next in its row
    line: int  # number of words from an offset in x to the next
    plane: int
    sum_line: int
    sum_plane: int
    offsets: int  # number of offsets in x, and also in y
    disc: DiscSquares


def make_disc_squares(mask: Bools) -> DiscSquares:
    """Return a disc, a mask of (2r + 1, 2r + 1) cells, in squares."""
    bits = order_by_squares(mask.astype(np.uint8))
    words = np.packbits(bits, axis=1, bitorder="little").view(np.uint64)[:, 0]
    cols = -(-len(mask) // SQUARE)
    return DiscSquares(words, cols, words.size // cols, int(np.count_nonzero(mask)))


def order_by_squares(values: Array) -> Array:
    """Reorder values of (2r + 1, 2r + 1) cells by a disc's squares and bits, padded by 0."""
    size = len(values)
    cols = -(-size // SQUARE)
    rows = -(-cols // LANES) * LANES
    padded = np.zeros((SQUARE * rows, SQUARE * cols), values.dtype)
    padded[:size, :size] = values
    squares = padded.reshape(rows, SQUARE, cols, SQUARE).transpose(2, 0, 1, 3)
    return np.ascontiguousarray(squares).reshape(rows * cols, SQUARE * SQUARE)


def make_template_squares(headings: int, disc: DiscSquares) -> TemplateSquares:
    """Return an empty buffer for the templates of one cell."""
    room = 2 * headings * PLANES * disc.words.size + 1
    chunks = disc.cols * -(-disc.rows // WORD)
    return TemplateSquares(
        np.empty(room, np.uint64),
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.empty((headings, 2, 4), np.uint64),
        np.empty(headings, np.int64),
        np.empty((headings, PLANES), np.int64),
        np.empty((PLANES, 2, chunks), np.uint64),
        np.empty((PLANES, 2, chunks), np.uint64),
    )


@njit(nogil=True, cache=True)
def list_templates(
    template: TemplateSquares, tile: TileLayout, cell: int, masks: Words, is_kept: Bools
) -> None:
    """List a cell's squares and runs at the headings with a line that `is_kept`, (theta, dx).

    `masks` (heading, square) are the cells of the disc that count at each heading. If it is
    empty, all cells count, and T or N is listed, whichever is less work; otherwise both are.
    """
    bounds, all_ones, signs, masked = template.bounds, template.ones, template.signs, len(masks) > 0
    square = run = 0
    for k in range(len(is_kept)):
        if not is_kept[k].any():
            continue
        mask = masks[k] if masked else tile.disc.words

        for plane in range(PLANES):
            corner = tile.corners[cell, k] + plane * tile.strip_plane
            by_t = classify_squares(template, tile, corner, mask, plane, 0)
            by_n = classify_squares(template, tile, corner, mask, plane, 1)
            signs[k, plane] = 0 if masked else 1 if by_t <= by_n else -1

        all_ones[k] = 0
        for side in range(2):
            bounds[k, side, 0], bounds[k, side, 2] = square, run
            for plane in range(PLANES):
                if signs[k, plane] == 2 * side - 1:
                    continue
                square, run, ones = list_squares(
                    template, tile, cell, k, mask, plane, side, square, run
                )
                if signs[k, plane] < 0:
                    all_ones[k] += tile.disc.cells - ones
                elif side == 0:
                    all_ones[k] += ones
            bounds[k, side, 1], bounds[k, side, 3] = square, run


# These are inlined, since LLVM optimises a function again within each caller. Arrays have
# local names in them: numba counts references to those that are passed on.
@njit(inline="always")
def classify_squares(
    template: TemplateSquares, tile: TileLayout, corner: int, mask: Words, plane: int, side: int
) -> int:
    """Mark the squares that T, or N, has partly or in full, and return the cost of comparing them.

    The disc's first square begins at `corner` of the tile's octets.
    """
    octets, rows, work, flip = tile.octets, tile.disc.rows, 0, FLIPS[side]
    partly, full = template.partly, template.full
    chunks = -(-rows // WORD)
    for chunk in range(tile.disc.cols * chunks):
        j, first = chunk // chunks, chunk % chunks * WORD
        at = corner + SQUARE * (j * tile.strip_rows + first)
        touched_bits, full_bits = np.uint64(0), np.uint64(0)
        for i in range(0, min(WORD, rows - first), LANES):
            address, place = at + SQUARE * i, j * rows + first + i
            shift = np.uint64(i)
            touched_bits |= set_lanes(octets, address, flip, mask, place) << shift
            full_bits |= full_lanes(octets, address, flip, mask, place) << shift
        partly[plane, side, chunk], full[plane, side, chunk] = touched_bits & ~full_bits, full_bits
        work += popcount(touched_bits & ~full_bits)
        # A run takes about as long to compare as two squares.
        work += 2 * popcount(full_bits & ~(full_bits << np.uint64(1)))
    return work


@njit(inline="always")
def list_squares(
    template: TemplateSquares,
    tile: TileLayout,
    cell: int,
    heading_index: int,
    mask: Words,
    plane: int,
    side: int,
    square: int,
    run: int,
) -> tuple[int, int, int]:
    """List a plane's marked squares at heading `heading_index`, from a square and a run on.

    Returns the square and the run that follow, and the number of cells set in all of them.
    """
    squares, addresses, run_starts, run_ends, _, _, _, partly, full = template
    octets, row_places = tile.octets, tile.row_places[tile.rests[cell]]
    rows, flip, ones = tile.disc.rows, FLIPS[side], 0
    corner = tile.corners[cell, heading_index] + plane * tile.strip_plane
    chunks = -(-rows // WORD)
    for chunk in range(tile.disc.cols * chunks):
        j, first = chunk // chunks, chunk % chunks * WORD
        at = corner + SQUARE * (j * tile.strip_rows + first)
        column = plane * tile.plane + j * tile.square_col
        partial_bits = partly[plane, side, chunk]
        while partial_bits:
            i = find_lowest_bit(partial_bits)
            word = (load_word(octets, at + SQUARE * i) ^ flip) & mask[j * rows + first + i]
            squares[square] = word
            addresses[square] = column + row_places[first + i]
            ones += popcount(word)
            square += 1
            partial_bits &= partial_bits - np.uint64(1)
        full_bits = full[plane, side, chunk]
        while full_bits:  # a run ends below the first square that is not full
            start = find_lowest_bit(full_bits)
            above = ~(full_bits >> np.uint64(start))
            length = find_lowest_bit(above) if above else WORD - start
            run_starts[run] = column + row_places[first + start]
            run_ends[run] = column + row_places[first + start + length]
            ones += SQUARE * SQUARE * length
            run += 1
            # The sum carries over the run into the bit above it, which was 0 before.
            full_bits &= full_bits + (np.uint64(1) << np.uint64(start))
    return square, run, ones

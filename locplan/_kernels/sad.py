"""Sums of absolute differences over the search window, counted in bits.

Two bit planes, *free* and *occupied*, hold the three levels, and ``|T - M|`` is 127 times the
number of planes in which template and map differ. Over the disc, for each plane,

    |T xor M| = |T| + |M| - 2 |T and M|        (or, with N = disc and not T,
    |T xor M| = |T| - |M| + 2 |N and M|        whichever of T and N is sparser)

``|M|`` is a disc sum of the map, the same for all headings; ``|T|`` is one number a heading. What
remains, the popcount of an AND, is done on words of 8 x 8 cells, because a wall crosses far fewer
squares than rows of 64 cells: only squares in which T (or N) has a cell are listed and visited,
and the offsets in y are the lanes of the vectors.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.bitplanes import PLANES, SQUARE, Strips, Window
from locplan._kernels.simd import add_matches, load_word, popcount, store, subtract, zeros

GROUP = 24
"""Offsets in y that are counted together: three vectors."""


@njit(nogil=True, cache=True)
def list_squares(
    octets: NDArray[np.uint8],
    first_row: int,
    first_col: int,
    disc_words: NDArray[np.uint64],
    row_addresses: NDArray[np.int64],
    col_stride: int,
    plane_stride: int,
    words: NDArray[np.uint64],
    addresses: NDArray[np.int64],
    start: int,
) -> tuple[int, int, int, int, int]:
    """Append the template's squares that must be visited, those to be added before the others.

    Returns where the added ones and where the subtracted ones end, the number of cells set in
    both planes, and for each plane the sign of its disc sum.
    """
    blocks = disc_words.shape[0]
    ones = 0
    sparse = np.empty(PLANES, np.bool_)
    for plane in range(PLANES):
        set_squares = unset_squares = 0
        for j in range(blocks):
            strip = octets[plane, first_col + SQUARE * j]
            for i in range(blocks):
                word = load_word(strip, first_row + SQUARE * i) & disc_words[j, i]
                ones += popcount(word)
                set_squares += word != 0
                unset_squares += word != disc_words[j, i]
        sparse[plane] = set_squares <= unset_squares
    end = start
    middle = start
    for wanted in (True, False):
        for plane in range(PLANES):
            if sparse[plane] != wanted:
                continue
            for j in range(blocks):
                strip = octets[plane, first_col + SQUARE * j]
                address = plane * plane_stride + j * col_stride
                for i in range(blocks):
                    word = load_word(strip, first_row + SQUARE * i)
                    word = (word if wanted else ~word) & disc_words[j, i]
                    words[end] = word
                    addresses[end] = address + row_addresses[i]
                    end += word != 0
        if wanted:
            middle = end
    return middle, end, ones, 1 if sparse[0] else -1, 1 if sparse[1] else -1


@njit(nogil=True, cache=True)
def mismatch_counts(
    window: Window,
    turned: Strips,
    turned_rows: NDArray[np.int64],
    turned_cols: NDArray[np.int64],
    row: int,
    col: int,
    radius: int,
    step: int,
    half_steps: int,
    disc_words: NDArray[np.uint64],
    counts: NDArray[np.int64],
    words: NDArray[np.uint64],
    addresses: NDArray[np.int64],
) -> None:
    """S / 127 at one cell for all offsets, into ``counts`` (dx, theta, dy rounded up).

    `turned` holds the strips of the map at each heading, `turned_rows` and `turned_cols` where
    the cell lies in the map turned so. `words` and `addresses` are scratch space for the squares
    of all headings.
    """
    blocks = disc_words.shape[0]
    step_units = step // window.unit
    col_words = step_units * window.lanes
    square_units = SQUARE // window.unit
    p0 = (row - radius - half_steps * step - window.first_row) // window.unit
    q0 = (col - radius - half_steps * step - window.first_col) // window.unit
    row_addresses = np.empty(blocks, np.int64)
    for i in range(blocks):
        p = p0 + i * square_units
        row_addresses[i] = (p % step_units) * window.lanes + p // step_units

    angles = turned_rows.size
    bounds = np.empty((angles, 3), np.int64)
    ones = np.empty(angles, np.int64)
    signs = np.empty((angles, PLANES), np.int64)
    end = 0
    for k in range(angles):
        bounds[k, 0] = end
        middle, end, ones[k], signs[k, 0], signs[k, 1] = list_squares(
            turned.octets[k],
            turned_rows[k] - radius - turned.first_rows[k],
            turned_cols[k] - radius - turned.first_cols[k],
            disc_words,
            row_addresses,
            square_units * col_words,
            window.cols * col_words,
            words,
            addresses,
            end,
        )
        bounds[k, 1] = middle
        bounds[k, 2] = end

    offsets = 2 * half_steps + 1
    sum_row = p0 * window.unit // window.sum_unit
    sum_col = q0 * window.unit // window.sum_unit
    sum_step = step // window.sum_unit
    for i in range(offsets):
        base = (q0 + i * step_units) * col_words
        sums = window.disc_sums[:, sum_col + i * sum_step]
        for k in range(angles):
            for group in range(0, counts.shape[2], GROUP):
                at = base + group
                a = b = c = zeros()
                for m in range(bounds[k, 0], bounds[k, 1]):
                    word, here = words[m], at + addresses[m]
                    a = add_matches(a, word, window.words, here)
                    b = add_matches(b, word, window.words, here + 8)
                    c = add_matches(c, word, window.words, here + 16)
                d = e = f = zeros()
                for m in range(bounds[k, 1], bounds[k, 2]):
                    word, here = words[m], at + addresses[m]
                    d = add_matches(d, word, window.words, here)
                    e = add_matches(e, word, window.words, here + 8)
                    f = add_matches(f, word, window.words, here + 16)
                line = counts[i, k]
                store(subtract(d, a), line, group)
                store(subtract(e, b), line, group + 8)
                store(subtract(f, c), line, group + 16)
            for v in range(offsets):
                p = sum_row + v * sum_step
                counts[i, k, v] = (
                    ones[k]
                    + signs[k, 0] * sums[0, p]
                    + signs[k, 1] * sums[1, p]
                    + 2 * counts[i, k, v]
                )


@njit(nogil=True, cache=True)
def weighted_covariance(
    counts: NDArray[np.int64], weight_of_count: NDArray[np.float64], offsets: int
) -> NDArray:
    """Covariance of (dx, dy, theta) in steps of the lattice, about the weighted mean, (3, 3).

    Moments are taken about the zero lag, which no offset outweighs: its sums are exact where all
    weights are equal, and nothing cancels where all others vanish.
    """
    half_steps, half_angles = (offsets - 1) // 2, (counts.shape[1] - 1) // 2
    total = 0.0
    first = np.zeros(3)
    second = np.zeros((3, 3))
    for i in range(offsets):
        x = float(i - half_steps)
        for k in range(counts.shape[1]):
            t = float(k - half_angles)
            weight = weight_y = weight_yy = 0.0
            for v in range(offsets):
                w = weight_of_count[counts[i, k, v]]
                y = float(v - half_steps)
                weight += w
                weight_y += w * y
                weight_yy += w * y * y
            total += weight
            first[0] += weight * x
            first[1] += weight_y
            first[2] += weight * t
            second[0, 0] += weight * x * x
            second[0, 1] += weight_y * x
            second[0, 2] += weight * x * t
            second[1, 1] += weight_yy
            second[1, 2] += weight_y * t
            second[2, 2] += weight * t * t
    covariance = np.empty((3, 3))
    for i in range(3):
        for j in range(i, 3):
            covariance[i, j] = second[i, j] / total - (first[i] / total) * (first[j] / total)
            covariance[j, i] = covariance[i, j]
    return covariance


@njit(nogil=True, cache=True)
def tile_mismatch_counts(
    window: Window,
    turned: Strips,
    turned_rows: NDArray[np.int64],
    turned_cols: NDArray[np.int64],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    step: int,
    half_steps: int,
    disc_words: NDArray[np.uint64],
) -> NDArray:
    """S / 127 at many cells, (n, dx, theta, dy)."""
    offsets, angles = 2 * half_steps + 1, turned.first_rows.size
    counts, words, addresses = scratch(offsets, angles, disc_words.size)
    result = np.empty((rows.size, offsets, angles, offsets), np.int64)
    for n in range(rows.size):
        mismatch_counts(
            window,
            turned,
            turned_rows[n],
            turned_cols[n],
            rows[n],
            cols[n],
            radius,
            step,
            half_steps,
            disc_words,
            counts,
            words,
            addresses,
        )
        result[n] = counts[:, :, :offsets]
    return result


@njit(nogil=True, cache=True)
def tile_covariances(
    window: Window,
    turned: Strips,
    turned_rows: NDArray[np.int64],
    turned_cols: NDArray[np.int64],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    step: int,
    half_steps: int,
    disc_words: NDArray[np.uint64],
    weight_of_count: NDArray[np.float64],
) -> NDArray:
    """Weighted covariances in steps of the lattice at many cells, (n, 3, 3)."""
    offsets, angles = 2 * half_steps + 1, turned.first_rows.size
    counts, words, addresses = scratch(offsets, angles, disc_words.size)
    result = np.empty((rows.size, 3, 3))
    for n in range(rows.size):
        mismatch_counts(
            window,
            turned,
            turned_rows[n],
            turned_cols[n],
            rows[n],
            cols[n],
            radius,
            step,
            half_steps,
            disc_words,
            counts,
            words,
            addresses,
        )
        result[n] = weighted_covariance(counts, weight_of_count, offsets)
    return result


@njit(nogil=True, cache=True)
def scratch(offsets: int, angles: int, squares: int) -> tuple[NDArray, NDArray, NDArray]:
    """Space for one cell: counts (dx, theta, dy rounded up to a group), words, addresses."""
    groups = -(-offsets // GROUP)
    room = angles * PLANES * squares + 1
    return (
        np.zeros((offsets, angles, groups * GROUP), np.int64),
        np.empty(room, np.uint64),
        np.empty(room, np.int64),
    )

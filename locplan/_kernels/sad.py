"""Sums of absolute differences over the search window, counted in bits.

Two bit planes, *free* and *occupied*, hold the three levels, and ``|T - M|`` is 127 times the
number of planes in which template and map differ. Over the disc, for each plane,

    |T xor M| = |T| + |M| - 2 |T and M|        (or, with N = disc and not T,
    |T xor M| = |T| - |M| + 2 |N and M|        whichever of T and N is less work)

``|M|`` is a disc sum of the map, the same for all headings; ``|T|`` is one number a heading. What
remains, the popcount of an AND, is done on words of 8 x 8 cells, because a wall crosses far fewer
squares than rows of 64 cells, and only on those that `templates` lists. The offsets in y are the
lanes of the vectors.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.bitplanes import PLANES, SQUARE, Strips, Window
from locplan._kernels.sight import see
from locplan._kernels.simd import LANES, add_difference, add_matches, add_to, store_negative, zeros
from locplan._kernels.templates import Disc, Sight, Template, empty_template, list_templates

STOP, DONE = 0, 1
GROUP = 3 * LANES
"""Number of offsets in y that are counted together."""


class Tile(NamedTuple):
    """Cells whose covariances share one layout of the map."""

    window: Window
    turned: Strips  # strips of the map at each heading
    rows: NDArray[np.int64]  # (n,) rows of the cells
    cols: NDArray[np.int64]
    turned_rows: NDArray[np.int64]  # (n, heading) rows of the cells in the turned maps
    turned_cols: NDArray[np.int64]
    disc: Disc
    radius: int
    step: int
    half_steps: int


@njit(nogil=True, cache=True)
def mismatch_counts(
    tile: Tile,
    n: int,
    counts: NDArray[np.int64],
    template: Template,
    masks: NDArray[np.uint64],
    kept: NDArray[np.bool_],
) -> None:
    """Write S / 127 at the tile's n-th cell into ``counts`` (dx, theta, dy rounded up), flat.

    Only the lines that are `kept`, (theta, dx), are written. `masks` (heading, square) are the
    visible cells; if it is empty the whole disc counts. `template` is scratch space.
    """
    window, turned, disc = tile.window, tile.turned, tile.disc
    row, col, radius = tile.rows[n], tile.cols[n], tile.radius
    step, half_steps = tile.step, tile.half_steps
    turned_rows, turned_cols = tile.turned_rows[n], tile.turned_cols[n]
    headings, offsets = turned_rows.size, 2 * half_steps + 1
    step_units = step // window.unit
    col_words, plane_stride = step_units * window.lanes, window.plane_stride
    square_units = SQUARE // window.unit
    p0 = (row - radius - half_steps * step - window.first_row) // window.unit
    q0 = (col - radius - half_steps * step - window.first_col) // window.unit
    row_addresses = np.empty(disc.rows + 1, np.int64)
    for i in range(row_addresses.size):
        p = p0 + i * square_units
        row_addresses[i] = (p % step_units) * window.lanes + p // step_units
    strip_rows = turned.octets.shape[3]
    plane_octets = turned.octets.shape[2] * strip_rows
    corners, wanted = np.empty(headings, np.int64), np.empty(headings, np.bool_)
    for k in range(headings):
        wanted[k] = False
        for i in range(offsets):
            wanted[k] |= kept[k, i]
        top = turned_rows[k] - radius - turned.first_rows[k]
        left = turned_cols[k] - radius - turned.first_cols[k]
        corners[k] = k * PLANES * plane_octets + left * strip_rows + top
    list_templates(
        template,
        turned.octets.reshape(-1),
        corners,
        strip_rows,
        plane_octets,
        disc,
        masks,
        wanted,
        row_addresses,
        square_units * col_words,
        plane_stride,
    )

    words, below = window.words, window.below
    squares, addresses, run_starts, run_ends, bounds, ones, signs = template
    sum_row = p0 * window.unit // window.sum_unit
    sum_col = q0 * window.unit // window.sum_unit
    sum_step = step // window.sum_unit
    # Where both are listed, |T xor M| is |T| - |T and M| + |N and M|, with N within the mask.
    factor = 1 if len(masks) else 2
    line_size = counts.size // (offsets * headings)
    free_sums, occupied_sums = np.empty(offsets, np.int64), np.empty(offsets, np.int64)
    for i in range(offsets):
        base = (q0 + i * step_units) * col_words
        for v in range(offsets):
            place = sum_col + i * sum_step, sum_row + v * sum_step
            free_sums[v] = window.disc_sums[0, place[0], place[1]]
            occupied_sums[v] = window.disc_sums[1, place[0], place[1]]
        for k in range(headings):
            if not kept[k, i]:
                continue
            line = (i * headings + k) * line_size
            for group in range(0, line_size, GROUP):
                at = base + group
                for side in range(2):
                    a = b = c = zeros()
                    for n in range(bounds[k, side, 0], bounds[k, side, 1]):
                        word, here = squares[n], at + addresses[n]
                        a = add_matches(a, word, words, here)
                        b = add_matches(b, word, words, here + 8)
                        c = add_matches(c, word, words, here + 16)
                    for n in range(bounds[k, side, 2], bounds[k, side, 3]):
                        here, there = at + run_starts[n], at + run_ends[n]
                        a = add_difference(a, below, there, here)
                        b = add_difference(b, below, there + 8, here + 8)
                        c = add_difference(c, below, there + 16, here + 16)
                    to = line + group
                    if side == 0:
                        store_negative(a, counts, to)
                        store_negative(b, counts, to + 8)
                        store_negative(c, counts, to + 16)
                    else:
                        add_to(counts, to, a)
                        add_to(counts, to + 8, b)
                        add_to(counts, to + 16, c)
            free_sign, occupied_sign, cells = signs[k, 0], signs[k, 1], ones[k]
            for v in range(np.uint64(offsets)):
                differing = free_sign * free_sums[v] + occupied_sign * occupied_sums[v] + cells
                counts[np.uint64(line) + v] = differing + factor * counts[np.uint64(line) + v]


@njit(nogil=True, cache=True)
def write_covariance(
    counts: NDArray[np.int64],
    weight_of_count: NDArray[np.float64],
    offsets: int,
    kept: NDArray[np.bool_],
    covariance: NDArray[np.float64],
) -> None:
    """Write the covariance of (dx, dy, theta) about the weighted mean, (3, 3) [lattice steps].

    `counts` are (dx, theta, dy rounded up), flat; lines that are not `kept` weigh nothing.

    Moments are taken about the zero lag, which no offset outweighs: its sums are exact where all
    weights are equal, and nothing cancels where all others vanish.
    """
    headings = len(kept)
    half_steps, half_angles = (offsets - 1) // 2, (headings - 1) // 2
    line_size = counts.size // (offsets * headings)
    total = sum_x = sum_y = sum_t = 0.0
    sum_xx = sum_xy = sum_xt = sum_yy = sum_yt = sum_tt = 0.0
    for i in range(offsets):
        x = float(i - half_steps)
        for k in range(headings):
            if not kept[k, i]:
                continue
            t = float(k - half_angles)
            line = (i * headings + k) * line_size
            weight = weight_y = weight_yy = 0.0
            for v in range(offsets):
                w = weight_of_count[counts[line + v]]
                y = float(v - half_steps)
                weight += w
                weight_y += w * y
                weight_yy += w * y * y
            total += weight
            sum_x += weight * x
            sum_y += weight_y
            sum_t += weight * t
            sum_xx += weight * x * x
            sum_xy += weight_y * x
            sum_xt += weight * x * t
            sum_yy += weight_yy
            sum_yt += weight_y * t
            sum_tt += weight * t * t
    mean_x, mean_y, mean_t = sum_x / total, sum_y / total, sum_t / total
    covariance[0, 0] = sum_xx / total - mean_x * mean_x
    covariance[1, 1] = sum_yy / total - mean_y * mean_y
    covariance[2, 2] = sum_tt / total - mean_t * mean_t
    covariance[0, 1] = covariance[1, 0] = sum_xy / total - mean_x * mean_y
    covariance[0, 2] = covariance[2, 0] = sum_xt / total - mean_x * mean_t
    covariance[1, 2] = covariance[2, 1] = sum_yt / total - mean_y * mean_t


@njit(nogil=True, cache=True)
def tile_covariances(
    tile: Tile,
    sight: Sight | None,
    kept: NDArray[np.bool_],
    weight_of_count: NDArray[np.float64],
    control: NDArray[np.int64],
    due: int,
    result: NDArray[np.float64],
) -> None:
    """Fill in the weighted covariances at all cells of a tile, (n, 3, 3) [lattice steps].

    `kept` (theta, n, dx) marks the lines that count; a single cell's marks are those of all.
    ``control[DONE]`` grows by `due` on the way; once another thread sets ``control[STOP]`` the
    rest is left as it is.
    """
    cells, headings = tile.turned_rows.shape
    offsets = 2 * tile.half_steps + 1
    counts, template = empty_counts(offsets, headings), empty_template(headings, tile.disc)
    masks = np.empty((0 if sight is None else headings, tile.disc.words.size), np.uint64)
    done = control[DONE] if control.size > DONE else 0
    for n in range(cells):
        if control[STOP]:
            break
        if sight is not None:
            see(sight, n, tile.radius, tile.disc, masks)
        lines = kept[:, n if kept.shape[1] > 1 else 0]
        mismatch_counts(tile, n, counts, template, masks, lines)
        write_covariance(counts, weight_of_count, offsets, lines, result[n])
        if control.size > DONE:
            control[DONE] = done + due * (n + 1) // cells


@njit(nogil=True, cache=True)
def empty_counts(offsets: int, headings: int) -> NDArray[Any]:
    """Room for the counts of one cell, (dx, theta, dy rounded up to whole groups), flat."""
    return np.empty(offsets * headings * -(-offsets // GROUP) * GROUP, np.int64)

"""Sums of absolute differences over the search window, counted in bits.

Two bit planes, *free* and *occupied*, hold the three levels, and ``|T - M|`` is 127 times the
number of planes in which template and map differ. Over the disc, for each plane,

    |T xor M| = |T| + |M| - 2 |T and M|        (or, with N = disc and not T,
    |T xor M| = |T| - |M| + 2 |N and M|        whichever of T and N is less work)

``|M|`` is a disc sum of the map, the same for all headings; ``|T|`` is one number a heading. What
remains, the popcount of an AND, is done on words of 8 x 8 cells, because a wall crosses far fewer
squares than rows of 64 cells, and only on squares that `templates` lists. The offsets in y are the
lanes of the vectors. The part of the disc that is visible from a cell is found in the same squares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import N_DONE, STOP, Bools, Floats, Ints, Words
from locplan._support.kernels.simd import (
    LANES,
    add_difference,
    add_matches,
    add_to,
    store_negative,
    zeros,
)
from locplan.field.kernels.bitplanes import SQUARE
from locplan.field.kernels.templates import (
    DiscSquares,
    SightRays,
    TemplateSquares,
    TileLayout,
    list_templates,
    make_template_squares,
)

GROUP = 3 * LANES
"""Number of offsets in y that are counted together."""


@njit(nogil=True, cache=True)
def write_covariance(
    counts: Ints,
    weight_of_count: Floats,
    places: Floats,
    offsets: int,
    is_kept: Bools,
    covariance: Floats,
) -> None:
    """Write the covariance of (dx, dy, theta) about the weighted mean, (3, 3) [steps].

    `counts` are (dx, theta, dy rounded up), flat, of `offsets` in x and y; the poses are one step
    apart, at `places` among these. Counts between offsets are interpolated. Counts at or next to a
    line that is not `is_kept` weigh nothing.

    Moments are taken about the zero lag, which no offset outweighs: its sums are exact if all
    weights are equal, and nothing cancels if all weights but one vanish.
    """
    headings, poses = len(is_kept), places.size
    half_steps, half_angles = (poses - 1) // 2, (headings - 1) // 2
    line_size = counts.size // (offsets * headings)
    low = np.empty(poses, np.int64)
    part = np.empty(poses)
    has_whole_places = True
    for v in range(poses):
        low[v] = int(places[v])
        part[v] = places[v] - low[v]
        has_whole_places = has_whole_places and part[v] == 0.0
    total = sum_x = sum_y = sum_t = 0.0
    sum_xx = sum_xy = sum_xt = sum_yy = sum_yt = sum_tt = 0.0
    for i in range(poses):
        x, first, across = float(i - half_steps), low[i], part[i]
        second = first + 1 if across > 0.0 else first
        for k in range(headings):
            if not (is_kept[k, first] and is_kept[k, second]):
                continue
            t = float(k - half_angles)
            line, next_line = (
                (first * headings + k) * line_size,
                (second * headings + k) * line_size,
            )
            weight = weight_y = weight_yy = 0.0
            for v in range(poses):
                address = line + low[v]
                count = counts[address]
                if not has_whole_places:
                    next_address = next_line + low[v]
                    along = part[v]
                    step = 1 if along > 0.0 else 0
                    near = count + along * (counts[address + step] - count)
                    far = counts[next_address] + along * (
                        counts[next_address + step] - counts[next_address]
                    )
                    count = int(near + across * (far - near) + 0.5)
                w = weight_of_count[count]
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


class CellBuffers(NamedTuple):
    """Buffers for one cell: its counts, its templates, and its masks if there are any."""

    counts: Ints  # S / 127 (dx, theta, dy rounded up) of the kept lines, flat
    template: TemplateSquares
    masks: Words  # (heading, square)


@njit(nogil=True, cache=True)
def fill_tile_covariances(
    tile: TileLayout,
    sight_rays: SightRays | None,
    is_kept: Bools,
    weight_of_count: Floats,
    offset_places: Floats,
    scratch: CellBuffers,
    control: Ints,
    result: Floats,
) -> None:
    """Fill in the weighted covariances at all cells of a tile, (n, 3, 3) [steps].

    `is_kept` (theta, n, dx) marks the lines that count; the marks of a single cell hold for all
    cells. `offset_places` are the places of the poses among the offsets, see `write_covariance`.
    The buffers hold the data of the last cell. Without `sight_rays` there is no mask, and the whole
    disc counts. ``control[DONE]`` counts the cells; once another thread sets ``control[STOP]`` the
    rest is left as it is.
    """
    counts, template, masks = scratch
    for cell in range(len(tile.rests)):
        if control[STOP]:
            break
        if sight_rays is not None:
            mark_visible_cells(sight_rays, cell, tile.disc, masks)
        lines = is_kept[:, cell if is_kept.shape[1] > 1 else 0]
        list_templates(template, tile, cell, masks, lines)
        # Where both are listed, |T xor M| is |T| - |T and M| + |N and M|, with N within the mask.
        compute_line_mismatches(tile, template, cell, lines, counts, 1 if len(masks) else 2)
        write_covariance(counts, weight_of_count, offset_places, tile.offsets, lines, result[cell])
        control[N_DONE] += 1


# Inlined, since LLVM optimises a function again within each caller.
@njit(inline="always")
def compute_line_mismatches(
    tile: TileLayout, template: TemplateSquares, cell: int, lines: Bools, counts: Ints, factor: int
) -> None:
    """Write S / 127 of a cell's lines (theta, dx) into `counts`.

    The listed squares leave a difference ``|N and M| - |T and M|``, which counts `factor` times.
    """
    # All arrays have local names: numba counts references to those that are passed on.
    words, below, disc_sums = tile.words, tile.below, tile.disc_sums
    squares, addresses, run_starts, run_ends, bounds, ones, signs, _, _ = template
    offsets, headings = tile.offsets, len(lines)
    line_size = counts.size // (offsets * headings)
    for i in range(offsets):
        base = tile.places[cell] + i * tile.line
        free = np.uint64(tile.sum_places[cell] + i * tile.sum_line)
        occupied = free + np.uint64(tile.sum_plane)
        for k in range(headings):
            if not lines[k, i]:
                continue
            line = (i * headings + k) * line_size
            for group in range(0, line_size, GROUP):
                at = base + group
                for side in range(2):
                    # Three vectors at once: the loads of one wait while the others are counted.
                    a = b = c = zeros()
                    for n in range(bounds[k, side, 0], bounds[k, side, 1]):
                        word, address = squares[n], at + addresses[n]
                        a = add_matches(a, word, words, address)
                        b = add_matches(b, word, words, address + 8)
                        c = add_matches(c, word, words, address + 16)
                    for n in range(bounds[k, side, 2], bounds[k, side, 3]):
                        address, end_address = at + run_starts[n], at + run_ends[n]
                        a = add_difference(a, below, end_address, address)
                        b = add_difference(b, below, end_address + 8, address + 8)
                        c = add_difference(c, below, end_address + 16, address + 16)
                    to = line + group
                    if side == 0:
                        store_negative(a, counts, to)
                        store_negative(b, counts, to + 8)
                        store_negative(c, counts, to + 16)
                    else:
                        add_to(counts, to, a)
                        add_to(counts, to + 8, b)
                        add_to(counts, to + 16, c)
            free_sign, occupied_sign, total = signs[k, 0], signs[k, 1], ones[k]
            for v in range(np.uint64(offsets)):
                differing = free_sign * disc_sums[free + v] + total
                differing += occupied_sign * disc_sums[occupied + v]
                counts[np.uint64(line) + v] = differing + factor * counts[np.uint64(line) + v]


def make_cell_buffers(
    offsets: int, headings: int, disc: DiscSquares, *, masked: bool
) -> CellBuffers:
    """Return buffers for one cell, with masks if requested."""
    counts = np.empty(offsets * headings * -(-offsets // GROUP) * GROUP, np.int64)
    masks = np.empty((headings if masked else 0, disc.words.size), np.uint64)
    return CellBuffers(counts, make_template_squares(headings, disc), masks)


@njit(nogil=True, cache=True)
def mark_visible_cells(sight_rays: SightRays, n: int, disc: DiscSquares, masks: Words) -> None:
    """Write the cells of the disc seen from the n-th cell, turned to each heading, as bits."""
    radius, levels = sight_rays.radius, sight_rays.levels
    row, col = sight_rays.rows[n], sight_rays.cols[n]
    reach = np.empty(sight_rays.cos.size, np.int64)
    for b in range(reach.size):
        first = 2 * radius
        for step in range(1, 2 * radius + 1):
            i = row + int(np.floor(sight_rays.sin[b] * (step / 2) + 0.5))
            j = col + int(np.floor(sight_rays.cos[b] * (step / 2) + 0.5))
            inside = 0 <= i < levels.shape[0] and 0 <= j < levels.shape[1]
            if (i != row or j != col) and not (inside and levels[i, j] == 254):
                first = step
                break
        reach[b] = (first + 1 + 2 * sight_rays.behind) ** 2
    for k in range(masks.shape[0]):
        for n in range(disc.words.size):
            word = np.uint64(0)
            if disc.words[n] != 0:
                for bit in range(SQUARE * SQUARE):
                    is_visible = sight_rays.distance[n, bit] <= reach[sight_rays.beam[k, n, bit]]
                    word |= np.uint64(is_visible) << np.uint64(bit)
            masks[k, n] = word & disc.words[n]

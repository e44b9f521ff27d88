"""Matching of single scans: over the search window, and with a database of ranges.

The database's ranges are codes of one byte, counted modulo 256, of beams all round in the map's own
axes. A robot that stands at a place with a turn of t steps sees with beam b what the place's beam
b + t meets. Sixty-four places are compared at once.
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Octets, Shorts
from locplan._support.kernels.lidar import LidarBeams, compute_lidar_offset, write_scan_ends
from locplan._support.kernels.likelihood import (
    TOP,
    LikelihoodField,
    ScanLattice,
    make_weight_tables,
)
from locplan._support.kernels.posterior import compute_posterior
from locplan._support.kernels.simd import (
    MAX_OCTET,
    MAX_SHORT,
    OCTETS,
    add_gaps,
    add_octets_to,
    find_lowest_bit,
    lanes_below,
    zero_octets,
)


@njit(nogil=True, cache=True)
def write_recorded_posteriors(
    field: LikelihoodField,
    lattice: ScanLattice,
    cells: Ints,
    ends: Floats,
    temperature: float,
    mean: Floats,
    covariance: Floats,
    best: Ints,
    summary: Floats,
) -> None:
    """Write the posteriors of n scans over the offsets from their poses into arrays.

    Parameters
    ----------
    field, lattice
        Likelihood field of the map, and offsets of the search window.
    cells : (n, 2) array
        Row and column of the robot's cell at each scan.
    ends : (n, beam, 2) array
        Ends of the beams, columns and rows from that cell's centre [cells], in the map's axes; NaN
        without a return.
    temperature : float
        Factor on the log-likelihood.
    mean : (n, 3) array
        Filled with the mean of (dx, dy, theta) in steps of the lattice.
    covariance : (n, 3, 3) array
        Filled with the covariance about it.
    best : (n, 3) array
        Filled with the most probable offset in steps.
    summary : (n, 3) array
        Filled with entropy [nat], ambiguity, and the log-likelihood a return at the best offset.
    """
    beams = ends.shape[1]
    weights = make_weight_tables(temperature * field.nats, beams * TOP)
    rows, half_headings = lattice.plane // lattice.width, (lattice.cos.size - 1) // 2
    costs = np.empty_like(lattice.empty)
    for n in range(len(cells)):
        row, col = cells[n, 0], cells[n, 1]
        summary[n, 0], summary[n, 1] = compute_posterior(
            field, lattice, weights, row, col, ends[n], costs, mean[n], covariance[n]
        )
        at = np.argmin(costs)
        line, left = at // lattice.width, at % lattice.width
        best[n, 0] = left - lattice.half_steps
        best[n, 1] = line % rows - lattice.half_steps
        best[n, 2] = line // rows - half_headings
        returns = np.sum(~np.isnan(ends[n, :, 0]))
        summary[n, 2] = -field.nats * costs[at] / max(returns, 1)


TURNS = 96
"""Number of beams all round, and of the turns that are tried; a multiple of 4."""


@njit(nogil=True, cache=True)
def sift_down(scores: Shorts, pairs: Ints, index: int) -> None:
    """Restore the heap, the greatest (score, place) first, below an entry that has shrunk."""
    while True:
        child = 2 * index + 1
        if child >= scores.size:
            return
        sibling = child + 1
        if sibling < scores.size and (scores[sibling], pairs[sibling]) > (
            scores[child],
            pairs[child],
        ):
            child = sibling
        if (scores[child], pairs[child]) <= (scores[index], pairs[index]):
            return
        scores[child], scores[index] = scores[index], scores[child]
        pairs[child], pairs[index] = pairs[index], pairs[child]
        index = child


@njit(nogil=True, cache=True)
def score_block(
    codes: Octets,
    block_start: int,
    beam_numbers: Ints,
    scan_codes: Octets,
    max_gap: int,
    max_score: int,
    scores: Shorts,
) -> None:
    """Write the scores of sixty-four places at all turns into `scores`, (TURNS x 64,).

    Scores of turns at which none of the places is below `max_score` may be less than they are, but
    not below it.
    """
    stretch = MAX_OCTET // max_gap
    cap, bound = np.uint8(max_gap), np.uint16(max_score)
    scores[:] = 0
    for turn in range(0, TURNS, 4):  # so many turns are compared at once
        begin = 0
        row = turn * OCTETS
        while begin < beam_numbers.size:
            end = min(begin + stretch, beam_numbers.size)
            first_sums = second_sums = third_sums = fourth_sums = zero_octets()
            for n in range(begin, end):
                at = block_start + (beam_numbers[n] + turn) * OCTETS
                first_sums = add_gaps(first_sums, codes, at, scan_codes[n], cap)
                second_sums = add_gaps(second_sums, codes, at + OCTETS, scan_codes[n], cap)
                third_sums = add_gaps(third_sums, codes, at + 2 * OCTETS, scan_codes[n], cap)
                fourth_sums = add_gaps(fourth_sums, codes, at + 3 * OCTETS, scan_codes[n], cap)
            add_octets_to(scores, row, first_sums)
            add_octets_to(scores, row + OCTETS, second_sums)
            add_octets_to(scores, row + 2 * OCTETS, third_sums)
            add_octets_to(scores, row + 3 * OCTETS, fourth_sums)
            begin = end
            low = np.uint64(0)
            for k in range(4):
                low |= lanes_below(scores, row + k * OCTETS, bound)
            if low == 0:
                break


@njit(nogil=True, cache=True)
def find_best_place_turn_pairs(
    codes: Octets, n_places: int, beam_numbers: Ints, scan_codes: Octets, max_gap: int, n_pairs: int
) -> tuple[Array, Array]:
    """Find the `n_pairs` best pairs of a place and a turn that is better than the turns next to it.

    Parameters
    ----------
    codes : (blocks x 2 TURNS x 64,) array of uint8
        Codes of the ranges of sixty-four places each; the beams follow each other twice, so that
        no turn has to begin anew.
    n_places : int
        Number of places; the last block may be filled up.
    beam_numbers : (k,) array of int64
        Numbers of the scan's beams that count.
    scan_codes : (k,) array of uint8
        Codes of their ranges.
    max_gap : int
        Gap at which a beam costs no more [codes].
    n_pairs : int
        Number of pairs.

    Returns
    -------
    scores : (n,) array of uint16
        Sum of the gaps, the least first; of equal ones the one with the lower index.
    where : (n,) array of int64
        Index of the place times `TURNS`, plus the turn.
    """
    best = np.full(n_pairs, MAX_SHORT, np.uint16)  # of a place in the list that is not filled yet
    pairs = np.full(n_pairs, n_places * TURNS, np.int64)
    scores = np.empty(TURNS * OCTETS, np.uint16)
    for block in range(-(-n_places // OCTETS)):
        first = block * 2 * TURNS * OCTETS
        score_block(codes, first, beam_numbers, scan_codes, max_gap, int(best[0]), scores)
        for turn in range(TURNS):
            row = turn * OCTETS
            before, after = (turn - 1) % TURNS * OCTETS, (turn + 1) % TURNS * OCTETS
            low = lanes_below(scores, row, best[0])
            while low:
                lane = find_lowest_bit(low)
                low &= low - np.uint64(1)
                place, score = block * OCTETS + lane, scores[row + lane]
                if place >= n_places or score >= best[0]:
                    continue
                if score < scores[before + lane] and score <= scores[after + lane]:
                    best[0], pairs[0] = score, place * TURNS + turn
                    sift_down(best, pairs, 0)
    order = np.argsort(best.astype(np.int64) * (n_places * TURNS + 1) + pairs)
    count = int((best != MAX_SHORT).sum())
    return best[order[:count]], pairs[order[:count]]


@njit(nogil=True, cache=True, error_model="numpy")
def cast_ranges(
    squares: Octets, resolution: float, poses: Floats, lidar: LidarBeams, ranges: Floats
) -> None:
    """Write the ranges of scans at poses (row, col, heading) into `ranges`, (n, beam) [m].

    A range is that of the middle of the beam's way through the cell that stops it; infinite
    without a return.
    """
    ends = np.empty((lidar.angles.size, 2))
    for n in range(len(poses)):
        row, col, heading = poses[n]
        write_scan_ends(squares, resolution, row, col, heading, lidar, ends)
        lever_x, lever_y = compute_lidar_offset(lidar, heading, resolution)
        for b in range(lidar.angles.size):
            distance = np.hypot(ends[b, 0] - lever_x, ends[b, 1] - lever_y)
            ranges[n, b] = np.inf if np.isnan(distance) else distance * resolution

"""Posteriors of simulated scans over the search window: correlative scan matching, in vectors.

For each heading, the endpoints of a scan are turned about the robot, rounded to cells, and shifted
by each offset. The sum of their costs (`likelihood`) is the loss of log-likelihood. Offsets are
whole steps of the lattice. The field keeps every `step`-th column together, so the offsets in x of
an endpoint are adjacent: one vector. Sums are of whole numbers and thus independent of their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import N_DONE, STOP, Array, Floats, Ints, Octets, Words
from locplan._support.kernels.lidar import LidarBeams, add_end_noise, write_scan_ends
from locplan._support.kernels.likelihood import (
    FINE,
    GROUP,
    NOWHERE,
    TOP,
    LikelihoodField,
    ScanLattice,
    WeightTables,
    make_weight_tables,
)
from locplan._support.kernels.simd import (
    SHORTS,
    WORD,
    add_shorts,
    add_shorts_to,
    lanes_at_most,
    zero_shorts,
)

CONNECTED = 0.01
"""Minimum probability of an offset in the central mode, relative to the centre."""


class LatticePosteriors(NamedTuple):
    """Posteriors at n cells x m headings: moments of (dx, dy, theta) in steps of the lattice."""

    mean: Floats  # (n, m, 3)
    covariance: Floats  # (n, m, 3, 3), about the mean
    entropy: Floats  # (n, m) [nat]
    ambiguity: Floats  # (n, m) probability outside the central mode


@njit(nogil=True, cache=True)
def score_scan(
    field: LikelihoodField,
    lattice: ScanLattice,
    row: int,
    col: int,
    ends: Floats,
    costs: NDArray[np.uint32],
) -> None:
    """Write the costs of a scan's endpoints at all offsets into ``costs`` (theta, dy, dx), flat.

    ``ends`` (beam, 2) holds x, y from the robot [cells], NaN for beams without a return. Entries of
    `costs` between the offsets are at least `NOWHERE`; their exact values have no meaning.
    """
    for k in range(costs.size):
        costs[k] = lattice.empty[k]
    batch_size = 65535 // TOP  # beams whose summed costs fit into sixteen bits
    xs, ys, count = np.empty(len(ends)), np.empty(len(ends)), 0
    for n in range(len(ends)):
        if not np.isnan(ends[n, 0]):
            xs[count], ys[count] = ends[n, 0], ends[n, 1]
            count += 1
    starts = np.empty(count, np.int64)
    planes, plane, stride = field.costs, float(field.plane), field.width
    last_row, last_col = float(field.last_row), float(field.last_col)
    step, width = float(field.step), float(field.width)
    share = 1.0 / step
    from_here = -lattice.half_steps * field.step - field.first
    for k in range(lattice.cos.size):
        cos, sin = lattice.cos[k], lattice.sin[k]
        # Where each turned endpoint's cost at its first offset is. All of this is exact in floating
        # point; vectors cannot divide integers.
        for n in range(starts.size):
            at_row = np.floor(sin * xs[n] + cos * ys[n] + 0.5) + (row + from_here)
            at_col = np.floor(cos * xs[n] - sin * ys[n] + 0.5) + (col + from_here)
            # An endpoint beyond the layout is near no wall at any offset, however far away it is.
            at_row, at_col = min(max(at_row, 0.0), last_row), min(max(at_col, 0.0), last_col)
            i, j = np.floor((at_row + 0.5) * share), np.floor((at_col + 0.5) * share)
            remainders = (at_row - i * step) * step + (at_col - j * step)
            starts[n] = np.int64(remainders * plane + i * width + j)
        for row_at in range(0, lattice.offsets, GROUP):
            for col_at in range(0, lattice.width, SHORTS):
                base = row_at * stride + col_at
                to = k * lattice.plane + row_at * lattice.width + col_at
                for batch in range(0, starts.size, batch_size):
                    a = b = c = zero_shorts()
                    for n in range(batch, min(batch + batch_size, starts.size)):
                        at = base + starts[n]
                        a = add_shorts(a, planes, at)
                        b = add_shorts(b, planes, at + stride)
                        c = add_shorts(c, planes, at + 2 * stride)
                    add_shorts_to(costs, to, a)
                    add_shorts_to(costs, to + lattice.width, b)
                    add_shorts_to(costs, to + 2 * lattice.width, c)


@njit(nogil=True, cache=True)
def dilate_bits(bits: Words, distance: int, guard: int, to: Words) -> None:
    """Write ``bits | bits << distance | bits >> distance`` of one long number into `to`.

    The `guard` words at either end are left out.
    """
    unit, left = np.uint64(1), np.uint64(distance % WORD)
    right, words = np.uint64(WORD - 1) - left, np.uint64(distance // WORD)
    for n in range(np.uint64(guard), np.uint64(bits.size - guard)):
        up = bits[n - words] << left | bits[n - words - unit] >> unit >> right
        down = bits[n + words] >> left | bits[n + words + unit] << unit << right
        to[n] = bits[n] | up | down


@njit(nogil=True, cache=True)
def find_central_mode(
    lattice: ScanLattice, costs: NDArray[np.uint32], excess: float, bits: Words
) -> Array:
    """Return the offsets of the central mode, one bit for each of `costs` in words of 64.

    An offset belongs to the mode if it is connected to the zero offset through any of 26 neighbours
    and costs at most `excess` more. All neighbours of these offsets belong to the mode as well,
    which includes its tails. ``bits`` (4, words) is scratch space.
    """
    centre = (lattice.cos.size - 1) // 2 * lattice.plane + lattice.half_steps * (lattice.width + 1)
    limit = np.uint32(min(costs[centre] + excess, NOWHERE - 1.0))
    guard = lattice.plane // WORD + 2
    bits[:] = 0
    passable, inside, grown, between = bits
    for n in range(0, costs.size, WORD):
        high = lanes_at_most(costs, n + SHORTS, limit) << np.uint64(SHORTS)
        passable[guard + n // WORD] = lanes_at_most(costs, n, limit) | high
    inside[guard + centre // WORD] = np.uint64(1) << np.uint64(centre % WORD)
    growing = True
    while growing:
        dilate_bits(inside, np.int64(1), guard, grown)
        dilate_bits(grown, lattice.width, guard, between)
        dilate_bits(between, lattice.plane, guard, grown)
        growing = False
        for n in range(inside.size):
            now = grown[n] & passable[n]
            growing |= now != inside[n]
            inside[n] = now
    return grown[guard:]


@njit(nogil=True, cache=True)
def compute_moments(
    lattice: ScanLattice,
    weights: WeightTables,
    costs: NDArray[np.uint32],
    mode: Words,
    mean: Floats,
    covariance: Floats,
) -> tuple[float, float]:
    """Write mean and covariance, in steps, into arrays; return entropy [nat] and ambiguity.

    Moments are taken about the zero offset: sums are exact if all weights are equal, and nothing
    cancels if only one weight is positive.
    """
    rows, half_headings = lattice.plane // lattice.width, (lattice.cos.size - 1) // 2
    min_cost = costs[0]
    for k in range(costs.size):
        min_cost = min(min_cost, costs[k])
    total = total_loss = total_outside = 0.0
    for i in range(3):
        mean[i] = 0.0
        for j in range(3):
            covariance[i, j] = 0.0
    coarse, fine, limit = weights.coarse, weights.fine, np.uint64(weights.limit)
    for at in range(0, costs.size, SHORTS):
        if not lanes_at_most(costs, at, min_cost + weights.limit):
            continue
        row, left = at // lattice.width, at % lattice.width
        outside_bits = ~mode[at // WORD] >> np.uint64(at % WORD)
        w = wx = wxx = loss = outside = 0.0
        for i in range(np.uint64(min(SHORTS, lattice.offsets - left))):
            cost = np.uint64(costs[np.uint64(at) + i] - min_cost)
            if cost <= limit:
                weight = coarse[cost // np.uint64(FINE)] * fine[cost % np.uint64(FINE)]
                x = np.float64(np.int64(i) + left - lattice.half_steps)
                w += weight
                wx += weight * x
                wxx += weight * x * x
                loss += weight * np.float64(np.int64(cost))
                if outside_bits >> i & np.uint64(1):
                    outside += weight
        y, t = float(row % rows - lattice.half_steps), float(row // rows - half_headings)
        total += w
        total_loss += loss
        total_outside += outside
        mean[0] += wx
        mean[1] += w * y
        mean[2] += w * t
        covariance[0, 0] += wxx
        covariance[0, 1] += wx * y
        covariance[0, 2] += wx * t
        covariance[1, 1] += w * y * y
        covariance[1, 2] += w * y * t
        covariance[2, 2] += w * t * t
    for i in range(3):
        mean[i] /= total
    for i in range(3):
        for j in range(i, 3):
            covariance[i, j] = covariance[i, j] / total - mean[i] * mean[j]
            covariance[j, i] = covariance[i, j]
    return np.log(total) + weights.nats * total_loss / total, total_outside / total


@njit(nogil=True, cache=True)
def compute_posterior(
    field: LikelihoodField,
    lattice: ScanLattice,
    weights: WeightTables,
    row: int,
    col: int,
    ends: Floats,
    costs: NDArray[np.uint32],
    mean: Floats,
    covariance: Floats,
) -> tuple[float, float]:
    """Compute the moments of a scan with beam ends `ends` (beam, 2) and `score_scan` costs."""
    score_scan(field, lattice, row, col, ends, costs)
    words = costs.size // WORD + 2 * (lattice.plane // WORD + 2)
    excess = -np.log(CONNECTED) / weights.nats
    mode = find_central_mode(lattice, costs, excess, np.empty((4, words), np.uint64))
    return compute_moments(lattice, weights, costs, mode, mean, covariance)


@njit(nogil=True, cache=True)
def compute_scan_posteriors(
    field: LikelihoodField,
    lattice: ScanLattice,
    squares: Octets,
    resolution: float,
    rows: Ints,
    cols: Ints,
    headings: Floats,
    lidar: LidarBeams,
    noise: Floats,
    temperature: float,
    control: Ints,
) -> LatticePosteriors:
    """Compute the posteriors of the scans at n cells in m headings of the robot.

    Parameters
    ----------
    field, lattice
        Likelihood field of the map, and offsets of the search window.
    squares : (4, H + 2, W + 2) array of uint8
        The map as `rays.compute_empty_squares`.
    resolution : float
        Edge of a cell [m].
    rows, cols : (n,) arrays
        The robot's cells; it stands at their centres.
    headings : (m,) array
        Headings of the robot, from the columns' axis towards the rows' axis [rad].
    lidar : LidarBeams
        Beams and mount of the lidar.
    noise : (beam, 2) array
        Noise of the beams' ends, see `lidar.add_end_noise`.
    temperature : float
        Factor on the log-likelihood.
    control : (2,) array
        ``control[N_DONE]`` counts the finished cells. After another thread sets
        ``control[STOP]``, the remaining cells are NaN.
    """
    shape = rows.size, headings.size
    result = LatticePosteriors(
        np.full((*shape, 3), np.nan),
        np.full((*shape, 3, 3), np.nan),
        np.full(shape, np.nan),
        np.full(shape, np.nan),
    )
    weights = make_weight_tables(temperature * field.nats, lidar.angles.size * TOP)
    ends, costs = np.empty((lidar.angles.size, 2)), np.empty_like(lattice.empty)
    for n in range(rows.size):
        if control[STOP]:
            break
        for m in range(headings.size):
            row, col = rows[n] + 0.5, cols[n] + 0.5
            write_scan_ends(squares, resolution, row, col, headings[m], lidar, ends)
            add_end_noise(resolution, headings[m], lidar, noise, ends)
            cell, moments_here = (rows[n], cols[n]), (result.mean[n, m], result.covariance[n, m])
            result.entropy[n, m], result.ambiguity[n, m] = compute_posterior(
                field, lattice, weights, *cell, ends, costs, *moments_here
            )
        control[N_DONE] += 1
    return result

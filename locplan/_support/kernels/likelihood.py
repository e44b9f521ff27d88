"""Likelihood field of a map, laid out so that adjacent offsets of an endpoint form vectors.

A beam that ends at distance d from the nearest wall, from cell centre to cell centre, has the
likelihood of AMCL's likelihood-field model, ``z_hit exp(-d^2 / (2 sigma_hit^2)) + z_rand`` with
``z_hit = 1 - z_rand``. The field holds it as a *cost*: the loss of its logarithm against d = 0, in
whole steps. A beam that ends far from all walls costs `TOP` steps.

Unlike in AMCL, walls are hollow: an occupied cell with only occupied neighbours is no wall.
Otherwise, if a map paints unknown space black, endpoints could be pushed into a wall at no cost.

The offsets of the search window form vectors in memory as well. Two tables turn their costs into
weights.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Octets, Shorts
from locplan._support.kernels.simd import SHORTS

TOP = 4095
"""Greatest cost: that of a beam whose endpoint is explained only by `z_rand`."""
GROUP = 3
"""Number of offsets in y that are scored together."""
FINE = 1024
"""Size of the fine one of two tables of exponentials; the coarse one is at multiples of it."""
NOWHERE = np.uint32(1 << 31)
"""Cost where the arrays of costs hold no offset."""


class LikelihoodField(NamedTuple):
    """Costs of the map and its surroundings, with every `step`-th row and column together.

    Endpoints beyond the layout are near no wall at any offset.
    """

    costs: Shorts  # (row mod step, col mod step, row div step, col div step), flat
    first: int  # row, and also column, of the map where the layout begins
    last_row: int  # the last row of the layout that an endpoint may have at its first offset
    last_col: int  # the last column
    step: int
    width: int  # number of costs in a row
    plane: int  # number of costs of one pair of remainders
    nats: float  # log-likelihood of one step of cost


def compute_likelihood_reach(resolution: float, sigma_hit: float, z_rand: float) -> int:
    """Return the distance from a wall below which the cost may be less than `TOP` [cells]."""
    # At this distance the likelihood is half a step of cost above z_rand.
    excess = z_rand * math.expm1(-math.log(z_rand) / TOP / 2) / (1 - z_rand)
    return math.ceil(sigma_hit * math.sqrt(-2 * math.log(excess)) / resolution)


def tabulate_costs(resolution: float, sigma_hit: float, z_rand: float) -> Shorts:
    """Return the costs at squared distances of 0, 1, ... cells^2; the last one is `TOP`."""
    reach = compute_likelihood_reach(resolution, sigma_hit, z_rand)
    squared = np.arange(reach**2 + 1) * resolution**2
    likelihood = (1 - z_rand) * np.exp(-squared / (2 * sigma_hit**2)) + z_rand
    return np.rint(np.log(likelihood) / math.log(z_rand) * TOP).astype(np.uint16)


@njit(nogil=True, cache=True)
def compute_column_distances(walls: Octets, reach: int) -> Array:
    """Return the number of rows to the nearest wall in the same column, at most ``reach + 1``.

    The result has `reach` more rows on either side of the map, (H + 2 reach, W).
    """
    rows, cols = walls.shape
    distance = np.full((rows + 2 * reach, cols), reach + 1, np.uint16)
    for i in range(rows):
        for j in range(cols):
            if walls[i, j]:
                distance[reach + i, j] = 0
    row_step = np.uint16(1)
    for i in range(1, len(distance)):
        for j in range(cols):
            distance[i, j] = min(distance[i, j], np.uint16(distance[i - 1, j] + row_step))
    for i in range(len(distance) - 2, -1, -1):
        for j in range(cols):
            distance[i, j] = min(distance[i, j], np.uint16(distance[i + 1, j] + row_step))
    return distance


@njit(nogil=True, cache=True, error_model="numpy")
def write_cost_planes(
    walls: Octets, costs: Shorts, reach: int, margin: int, planes: Shorts
) -> None:
    """Write the costs around all walls into the planes, with the map `margin` cells inside.

    The planes are (row mod step, col mod step, row div step, col div step).
    """
    step = len(planes)
    along_columns = compute_column_distances(walls, reach)
    cols, furthest = walls.shape[1], np.int32(costs.size - 1)
    squared, nearest = np.empty(cols, np.int32), np.empty(cols + 2 * reach, np.int32)
    for i in range(len(along_columns)):
        row = margin - reach + i
        for j in range(cols):
            squared[j] = np.int32(along_columns[i, j]) ** 2
        nearest[:] = furthest
        for shift in range(-reach, reach + 1):
            around, column_square = (
                nearest[reach + shift : reach + shift + cols],
                np.int32(shift * shift),
            )
            for j in range(cols):
                around[j] = min(around[j], np.int32(squared[j] + column_square))
        for remainder in range(step):
            for j in range((remainder - margin + reach) % step, nearest.size, step):
                col = (margin - reach + j) // step
                planes[row % step, remainder, row // step, col] = costs[nearest[j]]


class ScanLattice(NamedTuple):
    """Lattice of the search window: its offsets, and the memory layout of their costs."""

    half_steps: int
    cos: Floats  # (heading,)
    sin: Floats
    offsets: int  # number of offsets in x, and also in y
    width: int  # number of costs of the offsets in x, in whole vectors
    plane: int  # number of costs of a heading
    empty: NDArray[np.uint32]  # (theta, dy, dx), flat: 0 at the offsets, NOWHERE between them


class WeightTables(NamedTuple):
    """Two tables whose product is exp(-nats * cost)."""

    coarse: Floats  # at multiples of FINE
    fine: Floats  # at 0 .. FINE - 1
    limit: int  # maximum cost in the tables; beyond it weights are negligible
    nats: float  # log-likelihood of one step of cost


@njit(nogil=True, cache=True)
def make_scan_lattice(half_steps: int, angles: Floats) -> ScanLattice:
    """Return the lattice of ``2 * half_steps + 1`` offsets along x and y, and headings [rad]."""
    offsets = 2 * half_steps + 1
    width = -(-offsets // SHORTS) * SHORTS
    # At least a row and a column without offsets separate costs that are no neighbours. An even
    # number of rows makes whole words of bits.
    rows = -(-(offsets + 1) // (2 * GROUP)) * 2 * GROUP
    empty = np.full((angles.size, rows, width), NOWHERE)
    empty[:, :offsets, :offsets] = 0
    plane = rows * width
    return ScanLattice(
        half_steps, np.cos(angles), np.sin(angles), offsets, width, plane, empty.reshape(-1)
    )


@njit(nogil=True, cache=True)
def make_weight_tables(nats_per_cost: float, max_cost: int) -> WeightTables:
    """Return tables of weights for costs up to `max_cost`, or until weights are negligible."""
    # Offsets whose log-probability is 30 nats below the greatest are left out.
    multiples = int(min(30.0 / nats_per_cost, float(max_cost))) // FINE + 1
    coarse, fine = np.empty(multiples), np.empty(FINE)
    for n in range(multiples):
        coarse[n] = np.exp(-nats_per_cost * FINE * n)
    for n in range(FINE):
        fine[n] = np.exp(-nats_per_cost * n)
    return WeightTables(coarse, fine, multiples * FINE - 1, nats_per_cost)

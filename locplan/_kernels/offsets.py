"""The offsets of the search window as they lie in memory, and the weights of their costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.likelihood import GROUP
from locplan._kernels.simd import SHORTS

NEGLIGIBLE = 30.0
"""Offsets whose log-probability is this much below the greatest are left out [nat]."""
FINE = 1024
"""Size of the fine one of two tables of exponentials; the coarse one is at multiples of it."""
NOWHERE = np.uint32(1 << 31)
"""Cost where the arrays of costs hold no offset."""


class Lattice(NamedTuple):
    """Offsets of the search window, and how the costs of all of them lie in memory."""

    half_steps: int
    cos: NDArray[np.float64]  # (heading,)
    sin: NDArray[np.float64]
    offsets: int  # number of offsets in x, and also in y
    width: int  # number of costs of the offsets in x, in whole vectors
    plane: int  # number of costs of a heading
    empty: NDArray[np.uint32]  # (theta, dy, dx), flat: 0 at the offsets, else NOWHERE


class Weights(NamedTuple):
    """Two tables whose product is exp(-nats * cost)."""

    coarse: NDArray[np.float64]  # at multiples of FINE
    fine: NDArray[np.float64]  # at 0 .. FINE - 1
    limit: int  # the greatest cost that they cover; beyond it weights are negligible
    nats: float  # log-likelihood of one step of cost


@njit(nogil=True, cache=True)
def make_lattice(half_steps: int, angles: NDArray[np.float64]) -> Lattice:
    """The lattice of ``2 * half_steps + 1`` offsets along x and y, and headings [rad]."""
    offsets = 2 * half_steps + 1
    width = -(-offsets // SHORTS) * SHORTS
    # At least a row and a column without offsets separate costs that are no neighbours. An even
    # number of rows makes whole words of bits.
    rows = -(-(offsets + 1) // (2 * GROUP)) * 2 * GROUP
    empty = np.full((angles.size, rows, width), NOWHERE)
    empty[:, :offsets, :offsets] = 0
    plane = rows * width
    return Lattice(
        half_steps, np.cos(angles), np.sin(angles), offsets, width, plane, empty.reshape(-1)
    )


@njit(nogil=True, cache=True)
def make_weights(nats: float, most: int) -> Weights:
    """Tables of weights for costs up to `most`, or up to where weights are negligible."""
    multiples = int(min(NEGLIGIBLE / nats, float(most))) // FINE + 1
    coarse = np.exp(-nats * FINE * np.arange(multiples))
    return Weights(coarse, np.exp(-nats * np.arange(FINE)), multiples * FINE - 1, nats)

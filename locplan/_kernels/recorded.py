"""Posteriors of recorded scans over the search window about their poses."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.likelihood import TOP, LikelihoodField
from locplan._kernels.offsets import Lattice, make_weights
from locplan._kernels.posterior import CONNECTED, WORD, central_mode, moments, score


@njit(nogil=True, cache=True)
def recorded_posteriors(
    field: LikelihoodField,
    lattice: Lattice,
    cells: NDArray[np.int64],
    ends: NDArray[np.float64],
    effective_beams: float,
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    best: NDArray[np.int64],
    summary: NDArray[np.float64],
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
    effective_beams : float
        Number of independent beams that tell as much as all.
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
    weights = make_weights(min(1.0, effective_beams / beams) * field.nats, beams * TOP)
    words = lattice.empty.size // WORD + 2 * (lattice.plane // WORD + 2)
    bits = np.empty((4, words), np.uint64)
    excess = -np.log(CONNECTED) / weights.nats
    rows, half_headings = lattice.plane // lattice.width, (lattice.cos.size - 1) // 2
    for n in range(len(cells)):
        costs = lattice.empty.copy()
        score(field, lattice, cells[n, 0], cells[n, 1], ends[n], costs)
        mode = central_mode(lattice, costs, excess, bits)
        summary[n, 0], summary[n, 1] = moments(
            lattice, weights, costs, mode, mean[n], covariance[n]
        )
        at = np.argmin(costs)
        row, left = at // lattice.width, at % lattice.width
        best[n, 0] = left - lattice.half_steps
        best[n, 1] = row % rows - lattice.half_steps
        best[n, 2] = row // rows - half_headings
        returns = np.sum(~np.isnan(ends[n, :, 0]))
        summary[n, 2] = -field.nats * costs[at] / max(returns, 1)

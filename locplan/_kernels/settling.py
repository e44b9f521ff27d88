"""The least loss of a scan around a pose that a search with small steps may have missed."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.scan_losses import LossTables, fits, loss_at, refine

ROUNDS = 6
"""Greatest number of times that a pose moves to a better one of the lattice around it."""


@njit(nogil=True, cache=True, error_model="numpy")
def settle(
    tables: LossTables,
    ends: NDArray[np.float32],
    lever: float,
    half_steps: int,
    step: float,
    half_turns: int,
    turn: float,
    pose: NDArray[np.float64],
) -> float:
    """Move a pose to the least loss of all offsets on a lattice about it, refined; return it.

    That is repeated about the pose that was found, as long as the lattice has a lower loss. It is
    the loss at the least deviation. The robot fits at all positions but perhaps the first.

    Parameters
    ----------
    tables, ends, lever
        See `locplan._kernels.scan_losses.refine`.
    half_steps, step : int, float
        Number of steps of the lattice to each side in x and y, and their length [cells].
    half_turns, turn : int, float
        Number of its turns to each side, and their angle [rad].
    pose : (3,) array
        x, y [cells] and heading [rad]; it is changed.
    """
    last = len(tables.corners) - 1
    best = refine(tables, last, ends, lever, pose)
    found = np.empty(3)
    for _ in range(ROUNDS):
        least = best
        for k in range(-half_turns, half_turns + 1):
            heading = pose[2] + k * turn
            for j in range(-half_steps, half_steps + 1):
                y = pose[1] + j * step
                for i in range(-half_steps, half_steps + 1):
                    x = pose[0] + i * step
                    if fits(tables, x, y):
                        loss = loss_at(tables, last, ends, x, y, heading)
                        if loss < least:
                            least = loss
                            found[0], found[1], found[2] = x, y, heading
        if least >= best:
            break
        pose[:] = found
        best = refine(tables, last, ends, lever, pose)
    return best

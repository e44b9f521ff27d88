"""Matching of single scans, simulated or recorded, over the search window without a filter."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.lidar import BeamDisturbances, Lidar, measured_ends
from locplan._kernels.likelihood import NOWHERE, TOP, Lattice, LikelihoodField, make_weights
from locplan._kernels.posterior import posterior_of, score


@njit(nogil=True, cache=True)
def one_of_least(random: np.random.Generator, costs: NDArray[np.uint32]) -> int:
    """Index of the least cost; a random one if several are equal."""
    least = costs.min()
    ties = 0
    for n in range(costs.size):
        ties += costs[n] == least
    chosen = random.integers(0, ties)
    for n in range(costs.size):
        if costs[n] == least:
            if chosen == 0:
                return n
            chosen -= 1
    return 0


@njit(nogil=True, cache=True, error_model="numpy")
def match(
    random: np.random.Generator,
    field: LikelihoodField,
    lattice: Lattice,
    angles: NDArray[np.float64],
    squares: NDArray[np.uint8],
    resolution: float,
    row: int,
    col: int,
    lidar: Lidar,
    disturbances: BeamDisturbances,
    errors: NDArray[np.float64],
) -> None:
    """Match n scans from a cell, and write the errors of the most likely poses into `errors`.

    The robot's position in the cell and its heading are random. The window's middle is the cell's
    centre and a heading within half a step of the robot's.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of all random numbers.
    field, lattice
        Likelihood field of the map, and the window's offsets of whole steps.
    angles : (heading,) array
        Headings of the window, relative to its middle [rad].
    squares : (4, H + 2, W + 2) array of uint8
        The world as `rays.empty_squares`.
    resolution : float
        Edge of a cell [m].
    row, col : int
        The robot's cell.
    lidar, disturbances
        The lidar, and what disturbs it.
    errors : (n, 3) array
        Filled with x, y [cells] and heading [rad] of the match minus the true ones.
    """
    turn_step = angles[1] - angles[0] if angles.size > 1 else 0.0
    measured, ends = np.empty((lidar.angles.size, 2)), np.empty((lidar.angles.size, 2))
    pose, costs = np.empty(3), np.empty_like(lattice.empty)
    for n in range(len(errors)):
        pose[0], pose[1] = row + random.random(), col + random.random()
        pose[2] = (2 * random.random() - 1) * np.pi
        aside = (random.random() - 0.5) * turn_step  # offset of the window's heading
        measured_ends(random, squares, resolution, pose, lidar, disturbances, measured)
        cos, sin = np.cos(pose[2] + aside), np.sin(pose[2] + aside)
        for b in range(len(ends)):
            ends[b, 0] = cos * measured[b, 0] - sin * measured[b, 1]
            ends[b, 1] = sin * measured[b, 0] + cos * measured[b, 1]
        for k in range(costs.size):
            costs[k] = lattice.empty[k]
        score(field, lattice, row, col, ends, costs)
        for k in range(costs.size):
            if lattice.empty[k] == NOWHERE:
                costs[k] = NOWHERE
        best = one_of_least(random, costs)
        heading, rest = best // lattice.plane, best % lattice.plane
        dy = rest // lattice.width - lattice.half_steps
        dx = rest % lattice.width - lattice.half_steps
        errors[n, 0] = col + 0.5 + dx * field.step - pose[1]
        errors[n, 1] = row + 0.5 + dy * field.step - pose[0]
        errors[n, 2] = angles[heading] + aside


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
    rows, half_headings = lattice.plane // lattice.width, (lattice.cos.size - 1) // 2
    costs = np.empty_like(lattice.empty)
    for n in range(len(cells)):
        row, col = cells[n, 0], cells[n, 1]
        summary[n, 0], summary[n, 1] = posterior_of(
            field, lattice, weights, row, col, ends[n], costs, mean[n], covariance[n]
        )
        at = np.argmin(costs)
        line, left = at // lattice.width, at % lattice.width
        best[n, 0] = left - lattice.half_steps
        best[n, 1] = line % rows - lattice.half_steps
        best[n, 2] = line // rows - half_headings
        returns = np.sum(~np.isnan(ends[n, :, 0]))
        summary[n, 2] = -field.nats * costs[at] / max(returns, 1)

"""A filter along a recorded drive: particles forwards, samples backwards, and the likeliest way.

Poses are (x, y, heading) in the map's own axes [m, m, rad]. A *move* is what odometry says of the
way from one pose to the next, ahead and to the left of the first one, and the turn [m, m, rad]; it
has a standard deviation for each of these.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from locplan._kernels.arrays import Array, Floats, Ints, Random, Singles
from locplan._kernels.particles import wrapped

SKIRT, WIDER = 0.15, 2.5
"""Share of the moves that err more, and how much more."""
SLIP, SLIP_NEAR, SLIP_FAR, SLIP_TURN = 0.01, 1.0, 3.0, 0.4
"""Share of slips, and deviations of short and of long ones [m], and of their turns [rad]."""


@njit(nogil=True, cache=True)
def density_of(error: Array, deviation: Array, kidnapped: float) -> float:
    """Density of a move that errs so, (3,): a body with a skirt, slips, and a robot carried away.

    `kidnapped` is the density of being put anywhere.
    """
    away = error[0] ** 2 + error[1] ** 2
    if away > 16 * SLIP_FAR**2:
        return kidnapped
    density, square, size = kidnapped, 0.0, (2 * np.pi) ** 1.5
    for axis in range(3):
        square += (error[axis] / deviation[axis]) ** 2
        size *= deviation[axis]
    if square < 60:  # beyond it the skirt alone counts
        density += (1 - SKIRT - SLIP) * np.exp(-0.5 * square) / size
    if square < 60 * WIDER**2:
        density += SKIRT * np.exp(-0.5 * square / WIDER**2) / (size * WIDER**3)
    slip = np.exp(-0.5 * away / SLIP_NEAR**2) / SLIP_NEAR**2
    slip += np.exp(-0.5 * away / SLIP_FAR**2) / SLIP_FAR**2
    slip *= np.exp(-0.5 * (error[2] / SLIP_TURN) ** 2) / (SLIP_TURN * (2 * np.pi) ** 1.5)
    return density + 0.5 * SLIP * slip


@njit(nogil=True, cache=True)
def error_of(first: Array, second: Array, move: Floats, error: Floats) -> None:
    """Write the way between two poses (3,) minus a move into `error` (3,)."""
    dx, dy = second[0] - first[0], second[1] - first[1]
    cos, sin = np.cos(first[2]), np.sin(first[2])
    error[0] = cos * dx + sin * dy - move[0]
    error[1] = cos * dy - sin * dx - move[1]
    error[2] = wrapped(second[2] - first[2] - move[2])


@njit(nogil=True, cache=True)
def spread(random: Random, cloud: Singles, move: Floats, deviation: Floats, poses: Floats) -> None:
    """Fill `poses` (3, m) with moved particles of a cloud (3, n), each taken equally often."""
    count, most = cloud.shape[1], poses.shape[1]
    for n in range(most):
        at = n * count // most if most >= count else n
        kind = random.random()
        wide = WIDER if kind < SKIRT else 1.0
        ahead = move[0] + wide * deviation[0] * random.standard_normal()
        left = move[1] + wide * deviation[1] * random.standard_normal()
        turn = move[2] + wide * deviation[2] * random.standard_normal()
        if kind > 1 - SLIP:
            slip = SLIP_NEAR if kind > 1 - SLIP / 2 else SLIP_FAR
            ahead += slip * random.standard_normal()
            left += slip * random.standard_normal()
            turn += SLIP_TURN * random.standard_normal()
        cos, sin = np.cos(cloud[2, at]), np.sin(cloud[2, at])
        poses[0, n] = cloud[0, at] + cos * ahead - sin * left
        poses[1, n] = cloud[1, at] + sin * ahead + cos * left
        poses[2, n] = cloud[2, at] + turn


@njit(nogil=True, cache=True)
def draw_evenly(random: Random, poses: Floats, weights: Floats, cloud: Singles) -> None:
    """Fill a cloud (3, n) with particles drawn systematically by their weights."""
    total, count = weights.sum(), cloud.shape[1]
    step = total / count
    mark, at, so_far = random.random() * step, 0, weights[0]
    for n in range(count):
        while so_far < mark and at < len(weights) - 1:
            at += 1
            so_far += weights[at]
        for axis in range(3):
            cloud[axis, n] = poses[axis, at]
        mark += step


@njit(nogil=True, cache=True)
def sample_backwards(
    random: Random,
    clouds: Singles,
    moves: Floats,
    deviations: Floats,
    kidnapped: float,
    trajectories: Floats,
) -> None:
    """Draw trajectories (s, k, 3) from the clouds (k, 3, n) of a filter, from the last one back.

    `moves` and `deviations` (k, 3) lead to each cloud from the one before.
    """
    count = clouds.shape[2]
    shares, error, at = np.empty(count), np.empty(3), np.empty(3)
    for s in range(len(trajectories)):
        for k in range(len(clouds) - 1, -1, -1):
            if k == len(clouds) - 1:
                chosen = int(random.integers(0, count))
            else:
                total, later = 0.0, trajectories[s, k + 1]
                for n in range(count):
                    for axis in range(3):
                        at[axis] = clouds[k, axis, n]
                    error_of(at, later, moves[k + 1], error)
                    total += density_of(error, deviations[k + 1], kidnapped)
                    shares[n] = total
                chosen = min(int(np.searchsorted(shares, random.random() * total)), count - 1)
            for axis in range(3):
                trajectories[s, k, axis] = clouds[k, axis, chosen]


@njit(nogil=True, cache=True)
def best_way(
    candidates: Floats, gains: Floats, moves: Floats, deviations: Floats, kidnapped: float
) -> Ints:
    """Index of the candidate at each of k scans, (k,), of the likeliest way (Viterbi).

    `candidates` (c, k, 3) have log-likelihoods `gains` (c, k).
    """
    many, count = gains.shape
    came = np.empty((count, many), np.int64)
    best, after, error = gains[:, 0].copy(), np.empty(many), np.empty(3)
    for k in range(1, count):
        for c in range(many):
            after[c], came[k, c] = -np.inf, 0
            for b in range(many):
                error_of(candidates[b, k - 1], candidates[c, k], moves[k], error)
                total = best[b] + np.log(density_of(error, deviations[k], kidnapped))
                if total > after[c]:
                    after[c], came[k, c] = total, b
        for c in range(many):
            best[c] = after[c] + gains[c, k]
    way = np.empty(count, np.int64)
    way[count - 1] = np.argmax(best)
    for k in range(count - 1, 0, -1):
        way[k - 1] = came[k, way[k]]
    return way

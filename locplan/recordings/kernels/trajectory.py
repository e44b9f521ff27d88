"""A filter along a recorded drive: particles forwards, samples backwards, and the likeliest way.

Poses are (x, y, heading) in the map's own axes [m, m, rad]. A *move* is what odometry says of the
way from one pose to the next, ahead and to the left of the first one, and the turn [m, m, rad]; it
has a standard deviation for each of these.
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Random, Singles
from locplan._support.kernels.particles import wrap_angle

SKIRT, WIDER = 0.15, 2.5
"""Share of the moves that err more, and how much more."""
SLIP, SLIP_NEAR, SLIP_FAR, SLIP_TURN = 0.01, 1.0, 3.0, 0.4
"""Share of slips, and deviations of short and of long ones [m], and of their turns [rad]."""
FARTHEST_SLIP = 4 * SLIP_FAR
"""Maximum distance of a slip [m]; a robot that is farther off was carried."""
MOST_SQUARE = 60 * WIDER**2
"""Squared error in deviations from which on it is a slip."""
PER_SQUARE, PER_SQUARE_METRE, PER_RADIAN = 16, 32, 256
"""Entries of the tables by squared error, squared distance and turn."""


def _tabulate_error_densities() -> Floats:
    """Density of errors that are no slips by their squares, in units of the deviations."""
    squares = np.arange(MOST_SQUARE * PER_SQUARE + 2) / PER_SQUARE
    body = np.where(squares < 60, np.exp(-0.5 * squares), 0.0)  # beyond it the skirt alone counts
    skirt = np.exp(-0.5 * squares / WIDER**2) / WIDER**3
    return np.asarray(((1 - SKIRT - SLIP) * body + SKIRT * skirt) / (2 * np.pi) ** 1.5)


def _tabulate_slip_densities() -> Floats:
    """Density of the distances of slips by their squares [1 / m^2]."""
    squares = np.arange(FARTHEST_SLIP**2 * PER_SQUARE_METRE + 2) / PER_SQUARE_METRE
    near, far = (np.exp(-0.5 * squares / d**2) / d**2 for d in (SLIP_NEAR, SLIP_FAR))
    return np.asarray(0.5 * SLIP * (near + far) / (2 * np.pi))


def _tabulate_slip_turn_densities() -> Floats:
    """Density of the turns of slips by their size [1 / rad]."""
    turns = np.arange(np.pi * PER_RADIAN + 2) / PER_RADIAN
    return np.asarray(np.exp(-0.5 * (turns / SLIP_TURN) ** 2) / (SLIP_TURN * (2 * np.pi) ** 0.5))


ERRORS, SLIPS, SLIP_TURNS = (
    _tabulate_error_densities(),
    _tabulate_slip_densities(),
    _tabulate_slip_turn_densities(),
)
"""Tables that take the place of exponentials, which took most of the smoother's time."""


@njit(nogil=True, cache=True)
def compute_motion_density(error: Array, deviation: Array, kidnap_density: float) -> float:
    """Density of a move that errs so, (3,): a body with a skirt, slips, and a robot carried away.

    `kidnap_density` is the density of being put anywhere. The density is right to a thousandth.
    """
    square, size = 0.0, 1.0
    for axis in range(3):
        square += (error[axis] / deviation[axis]) ** 2
        size *= deviation[axis]
    return _compute_error_density(
        square, error[0] ** 2 + error[1] ** 2, error[2], size, kidnap_density
    )


@njit(nogil=True, cache=True, error_model="numpy")
def _compute_error_density(
    squared_error: float,
    squared_distance: float,
    turn: float,
    deviation_product: float,
    kidnap_density: float,
) -> float:
    """Density of an error by its square in deviations, squared distance [m^2] and turn [rad].

    `deviation_product` is the product of the deviations.
    """
    if squared_distance >= FARTHEST_SLIP**2:
        return kidnap_density
    slip = _interpolate_table(SLIPS, squared_distance * PER_SQUARE_METRE) * _interpolate_table(
        SLIP_TURNS, abs(turn) * PER_RADIAN
    )
    if squared_error >= MOST_SQUARE:
        return kidnap_density + slip
    return (
        kidnap_density
        + slip
        + _interpolate_table(ERRORS, squared_error * PER_SQUARE) / deviation_product
    )


@njit(nogil=True, cache=True)
def _interpolate_table(table: Floats, position: float) -> float:
    """Value of a table between its entries."""
    n = int(position)
    return table[n] + (position - n) * (table[n + 1] - table[n])


@njit(nogil=True, cache=True)
def write_motion_error(first: Array, second: Array, move: Floats, error: Floats) -> None:
    """Write the way between two poses (3,) minus a move into `error` (3,)."""
    dx, dy = second[0] - first[0], second[1] - first[1]
    cos, sin = np.cos(first[2]), np.sin(first[2])
    error[0] = cos * dx + sin * dy - move[0]
    error[1] = cos * dy - sin * dx - move[1]
    error[2] = wrap_angle(second[2] - first[2] - move[2])


@njit(nogil=True, cache=True)
def spread_particles(
    random: Random, cloud: Singles, move: Floats, deviation: Floats, poses: Floats
) -> None:
    """Fill `poses` (3, m) with moved particles of a cloud (3, n), each taken equally often."""
    count, n_poses = cloud.shape[1], poses.shape[1]
    for n in range(n_poses):
        at = n * count // n_poses if n_poses >= count else n
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
def resample_evenly(random: Random, poses: Floats, weights: Floats, cloud: Singles) -> None:
    """Fill a cloud (3, n) with particles drawn systematically by their weights."""
    total, count = weights.sum(), cloud.shape[1]
    step = total / count
    mark, at, weight_sum = random.random() * step, 0, weights[0]
    for n in range(count):
        while weight_sum < mark and at < len(weights) - 1:
            at += 1
            weight_sum += weights[at]
        for axis in range(3):
            cloud[axis, n] = poses[axis, at]
        mark += step


@njit(nogil=True, cache=True, error_model="numpy")
def sample_trajectories_backwards(
    random: Random,
    clouds: Singles,
    moves: Floats,
    deviations: Floats,
    kidnap_density: float,
    trajectories: Floats,
) -> None:
    """Draw trajectories (s, k, 3) from the clouds (k, 3, n) of a filter, from the last one back.

    `moves` and `deviations` (k, 3) lead to each cloud from the one before.
    """
    last, count = len(clouds) - 1, clouds.shape[2]
    marks = np.empty((last, len(trajectories)))
    for s in range(len(trajectories)):
        particle = int(random.integers(0, count))
        for axis in range(3):
            trajectories[s, last, axis] = clouds[last, axis, particle]
        for k in range(last - 1, -1, -1):
            marks[k, s] = random.random()
    cos, sin, shares = np.empty(count), np.empty(count), np.empty(count)
    expected = np.empty((3, count))
    for k in range(last - 1, -1, -1):
        move, deviation = moves[k + 1], deviations[k + 1]
        size = deviation[0] * deviation[1] * deviation[2]
        for n in range(count):
            cos[n], sin[n] = np.cos(clouds[k, 2, n]), np.sin(clouds[k, 2, n])
            expected[0, n] = clouds[k, 0, n] + cos[n] * move[0] - sin[n] * move[1]
            expected[1, n] = clouds[k, 1, n] + sin[n] * move[0] + cos[n] * move[1]
            expected[2, n] = clouds[k, 2, n] + move[2]
        for s in range(len(trajectories)):
            x, y = trajectories[s, k + 1, 0], trajectories[s, k + 1, 1]
            heading = trajectories[s, k + 1, 2]
            total = 0.0
            for n in range(count):
                dx, dy, turn = x - expected[0, n], y - expected[1, n], heading - expected[2, n]
                turn -= 2 * np.pi * np.floor(turn / (2 * np.pi) + 0.5)
                square = ((cos[n] * dx + sin[n] * dy) / deviation[0]) ** 2
                square += ((cos[n] * dy - sin[n] * dx) / deviation[1]) ** 2
                square += (turn / deviation[2]) ** 2
                total += _compute_error_density(
                    square, dx * dx + dy * dy, turn, size, kidnap_density
                )
                shares[n] = total
            particle = min(int(np.searchsorted(shares, marks[k, s] * total)), count - 1)
            for axis in range(3):
                trajectories[s, k, axis] = clouds[k, axis, particle]


@njit(nogil=True, cache=True)
def find_likeliest_candidates(
    candidates: Floats,
    log_likelihoods: Floats,
    moves: Floats,
    deviations: Floats,
    kidnap_density: float,
) -> Ints:
    """Index of the candidate at each of k scans, (k,), of the likeliest way (Viterbi).

    `candidates` (c, k, 3) have log-likelihoods `log_likelihoods` (c, k).
    """
    n_candidates, count = log_likelihoods.shape
    came = np.empty((count, n_candidates), np.int64)
    best, after, error = log_likelihoods[:, 0].copy(), np.empty(n_candidates), np.empty(3)
    for k in range(1, count):
        for c in range(n_candidates):
            after[c], came[k, c] = -np.inf, 0
            for b in range(n_candidates):
                write_motion_error(candidates[b, k - 1], candidates[c, k], moves[k], error)
                total = best[b] + np.log(
                    compute_motion_density(error, deviations[k], kidnap_density)
                )
                if total > after[c]:
                    after[c], came[k, c] = total, b
        for c in range(n_candidates):
            best[c] = after[c] + log_likelihoods[c, k]
    way = np.empty(count, np.int64)
    way[count - 1] = np.argmax(best)
    for k in range(count - 1, 0, -1):
        way[k - 1] = came[k, way[k]]
    return way

"""Steps of a particle filter as in AMCL: move, weigh, resample, find the heaviest cluster.

Source: nav2_amcl of Navigation2, which follows S. Thrun, W. Burgard and D. Fox, "Probabilistic
Robotics" (2005): sample_motion_odometry, likelihood_field_range_finder_model, and KLD sampling.

Poses are (x, y, heading) in the axes of the map, in metres along its columns and rows [m, m, rad];
headings are not wrapped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats, Ints, Random, Singles

STILL = 0.01
"""Distance below which the direction of a movement is ignored [m]."""
FREE = -1
EXTENT = 1 << 20
"""Number of bins on either side of zero along each axis."""


@njit(nogil=True, cache=True)
def index_cumulative_shares(shares: Floats) -> Ints:
    """Return the index of the first share above each of n + 1 equal steps up to the last."""
    count = len(shares)
    guide = np.full(count + 1, count - 1)
    step = 0
    for n in range(count):
        while step <= count and step * shares[-1] < shares[n] * count:
            guide[step] = n
            step += 1
    return guide


@njit(nogil=True, cache=True)
def find_first_above(value: float, shares: Floats, first_guess: int) -> int:
    """Return the index of the first share above a value, or the last; search from `first_guess`."""
    at = first_guess
    while at > 0 and shares[at - 1] > value:
        at -= 1
    while at < len(shares) - 1 and shares[at] <= value:
        at += 1
    return at


class FilterSettings(NamedTuple):
    """AMCL's parameters under the same names; a boolean replaces the name of the motion model."""

    alpha1: float
    alpha2: float
    alpha3: float
    alpha4: float
    alpha5: float
    omnidirectional: bool
    min_particles: int
    max_particles: int
    pf_err: float
    pf_z: float
    resample_interval: int
    update_min_d: float
    update_min_a: float
    recovery_alpha_slow: float
    recovery_alpha_fast: float


class BeamScores(NamedTuple):
    """Scores that a beam adds to a particle, by the cell of the beam's end."""

    values: Singles  # (H + 2) (W + 2), flat: the map, in a ring that stands for everything outside
    rows: int  # including the ring
    cols: int
    resolution: float
    product: bool  # True if scores are logarithms of factors
    shift: float  # added to a position to find its cell: the ring, and half a cell as Nav2 [cells]
    free: Ints = np.empty(0, np.int64)  # flat indices of free cells, without the ring, for recovery


class PoseHistogram(NamedTuple):
    """Occupied bins, found by a hash table with open addressing."""

    bin_of: Ints  # (slots,) FREE or the bin; slots are a power of two
    keys: Ints  # (bins,)
    slots: Ints  # (bins,)
    cluster: Ints  # (bins,) FREE, or the cluster
    of_particle: Ints  # (particles,) the bin of each particle


@njit(nogil=True, cache=True)
def make_histogram(max_particles: int) -> PoseHistogram:
    """Return an empty histogram for at most `max_particles` particles."""
    slots = 4
    while slots < 4 * max_particles:
        slots *= 2
    return PoseHistogram(
        np.full(slots, FREE, np.int64),
        np.empty(max_particles, np.int64),
        np.empty(max_particles, np.int64),
        np.empty(max_particles, np.int64),
        np.empty(max_particles, np.int64),
    )


@njit(nogil=True, cache=True)
def find_hash_slot(histogram: PoseHistogram, key: int) -> int:
    """Return the slot of a bin in the hash table, or the free slot for a new bin."""
    mask = histogram.bin_of.size - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = int(np.int64(mixed >> np.uint64(32))) & mask
    while histogram.bin_of[slot] != FREE and histogram.keys[histogram.bin_of[slot]] != key:
        slot = (slot + 1) & mask
    return slot


@njit(nogil=True, cache=True)
def compute_bin_key(x: float, y: float, heading: float) -> int:
    """Return the key of a pose's bin; bins are AMCL's, of 0.5 m and 10 degrees."""
    i = int(np.floor(x / 0.5)) + EXTENT
    j = int(np.floor(y / 0.5)) + EXTENT
    k = int(np.floor(heading / (10 * np.pi / 180))) + EXTENT
    return (i * (2 * EXTENT) + j) * (2 * EXTENT) + k


@njit(nogil=True, cache=True)
def clear_histogram(histogram: PoseHistogram, n_bins: int) -> None:
    """Empty a histogram of `n_bins` bins."""
    for n in range(n_bins):
        histogram.bin_of[histogram.slots[n]] = FREE


@njit(nogil=True, cache=True)
def insert_particle(
    histogram: PoseHistogram, n_bins: int, particle: int, x: float, y: float, heading: float
) -> int:
    """Put a particle into its bin; return the new number of bins."""
    key = compute_bin_key(x, y, heading)
    slot = find_hash_slot(histogram, key)
    if histogram.bin_of[slot] == FREE:
        histogram.bin_of[slot] = n_bins
        histogram.keys[n_bins] = key
        histogram.slots[n_bins] = slot
        n_bins += 1
    histogram.of_particle[particle] = histogram.bin_of[slot]
    return n_bins


@njit(nogil=True, cache=True)
def label_clusters(histogram: PoseHistogram, n_bins: int) -> int:
    """Label clusters of bins that touch, also at corners; return the number of clusters."""
    for n in range(n_bins):
        histogram.cluster[n] = FREE
    waiting = np.empty(n_bins, np.int64)
    clusters = 0
    for first in range(n_bins):
        if histogram.cluster[first] != FREE:
            continue
        histogram.cluster[first] = clusters
        waiting[0], left = first, 1
        while left:
            left -= 1
            key = histogram.keys[waiting[left]]
            for n in range(27):
                i, j, k = n // 9 - 1, n // 3 % 3 - 1, n % 3 - 1
                other = key + (i * (2 * EXTENT) + j) * (2 * EXTENT) + k
                near = histogram.bin_of[find_hash_slot(histogram, other)]
                if near != FREE and histogram.cluster[near] == FREE:
                    histogram.cluster[near] = clusters
                    waiting[left] = near
                    left += 1
        clusters += 1
    return clusters


@njit(nogil=True, cache=True)
def compute_heaviest_mean(
    histogram: PoseHistogram, bins: int, poses: Floats, count: int
) -> tuple[float, float, float]:
    """Return the mean pose of the cluster with most of the `count` equal particles."""
    sums = np.zeros((label_clusters(histogram, bins), 5))
    for n in range(count):
        x, y, heading = poses[0, n], poses[1, n], poses[2, n]
        total = sums[histogram.cluster[histogram.of_particle[n]]]
        total[0] += 1.0
        total[1] += x
        total[2] += y
        total[3] += np.cos(heading)
        total[4] += np.sin(heading)
    heaviest = 0
    for cluster in range(1, len(sums)):
        if sums[cluster, 0] > sums[heaviest, 0]:
            heaviest = cluster
    best = sums[heaviest]
    return best[1] / best[0], best[2] / best[0], np.arctan2(best[4], best[3])


@njit(nogil=True, cache=True)
def compute_kld_sample_size(bins: int, settings: FilterSettings) -> int:
    """Return the KLD sample size: the number of particles for `bins` occupied bins (Fox, 2003)."""
    if bins <= 1:
        return settings.max_particles
    share = 2 / (9 * (bins - 1.0))
    root = 1 - share + np.sqrt(share) * settings.pf_z
    size = int(np.ceil((bins - 1) / (2 * settings.pf_err) * root**3))
    return min(max(size, settings.min_particles), settings.max_particles)


@njit(nogil=True, cache=True)
def wrap_angle(angle: float) -> float:
    """Return the angle wrapped into [-pi, pi) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@njit(nogil=True, cache=True)
def move_particles(
    random: Random,
    poses: Floats,
    count: int,
    dx: float,
    dy: float,
    turn: float,
    heading: float,
    settings: FilterSettings,
) -> None:
    """Move each of `count` particles of (3, n) by the reported odometry, with independent noise.

    The model is AMCL's differential or omnidirectional one. `dx`, `dy` [m] and `turn` [rad] are in
    the axes of odometry; `heading` [rad] is the robot's heading before the move in these axes.
    """
    way = np.hypot(dx, dy)
    if settings.omnidirectional:
        bearing = np.arctan2(dy, dx) - heading  # from the robot's heading
        way_sd = np.sqrt(settings.alpha3 * way**2 + settings.alpha4 * turn**2)
        turn_sd = np.sqrt(settings.alpha1 * turn**2 + settings.alpha2 * way**2)
        lateral_sd = np.sqrt(settings.alpha4 * turn**2 + settings.alpha5 * way**2)
        for n in range(count):
            noisy_way = way + way_sd * random.standard_normal()
            noisy_turn = turn + turn_sd * random.standard_normal()
            lateral = lateral_sd * random.standard_normal()
            cos, sin = np.cos(poses[2, n] + bearing), np.sin(poses[2, n] + bearing)
            poses[0, n] += noisy_way * cos + lateral * sin
            poses[1, n] += noisy_way * sin - lateral * cos
            poses[2, n] += noisy_turn
        return
    first = wrap_angle(np.arctan2(dy, dx) - heading) if way >= STILL else 0.0
    second = wrap_angle(turn - first)
    # Driving backwards does not count as turning round.
    first_size = min(abs(first), abs(wrap_angle(first - np.pi)))
    second_size = min(abs(second), abs(wrap_angle(second - np.pi)))
    first_sd = np.sqrt(settings.alpha1 * first_size**2 + settings.alpha2 * way**2)
    second_sd = np.sqrt(settings.alpha1 * second_size**2 + settings.alpha2 * way**2)
    way_sd = np.sqrt(settings.alpha3 * way**2 + settings.alpha4 * (first_size**2 + second_size**2))
    for n in range(count):
        noisy_first = first - first_sd * random.standard_normal()
        noisy_way = way - way_sd * random.standard_normal()
        noisy_second = second - second_sd * random.standard_normal()
        poses[0, n] += noisy_way * np.cos(poses[2, n] + noisy_first)
        poses[1, n] += noisy_way * np.sin(poses[2, n] + noisy_first)
        poses[2, n] += noisy_first + noisy_second


@njit(nogil=True, cache=True)
def add_scores(scores: BeamScores, ends: Floats, poses: Floats, count: int, sums: Floats) -> None:
    """Write the sums of the beams' scores at the first `count` of the poses (3, n) into `sums`.

    `ends` (beam, 2) are ahead and to the left of the robot [cells]; NaN, without a return, is
    ignored.
    """
    ahead, left, n_returned = np.empty(len(ends)), np.empty(len(ends)), 0
    for b in range(len(ends)):
        if not np.isnan(ends[b, 0]):
            ahead[n_returned], left[n_returned] = ends[b, 0], ends[b, 1]
            n_returned += 1
    last_row, last_col = scores.rows - 1.0, scores.cols - 1.0
    cells = np.empty(n_returned, np.int64)
    for n in range(count):
        cos, sin = np.cos(poses[2, n]), np.sin(poses[2, n])
        x = poses[0, n] / scores.resolution + scores.shift
        y = poses[1, n] / scores.resolution + scores.shift
        # Cells come first, since the compiler takes several beams at once only without look-ups;
        # processors without AVX-512 turn such numbers into integers of 32 bits alone.
        for b in range(len(cells)):
            col = x + cos * ahead[b] - sin * left[b]
            row = y + sin * ahead[b] + cos * left[b]
            i = np.int32(min(max(row, 0.0), last_row))
            j = np.int32(min(max(col, 0.0), last_col))
            cells[b] = np.int64(i) * scores.cols + j
        score = 0.0
        for b in range(len(cells)):
            score += scores.values[np.uintp(cells[b])]
        sums[n] = score


@njit(nogil=True, cache=True)
def weigh_particles(
    scores: BeamScores, ends: Floats, poses: Floats, count: int, weights: Floats
) -> float:
    """Multiply the weights (n,) of the first `count` particles (3, n) by the scores of the beams.

    The weights are then scaled to a sum of 1; if no particle fits, they become equal. Return their
    mean before the scaling.
    """
    sums = np.empty(count)
    add_scores(scores, ends, poses, count, sums)
    total = 0.0
    for n in range(count):
        weights[n] *= np.exp(sums[n]) if scores.product else 1 + sums[n]
        total += weights[n]
    for n in range(count):
        weights[n] = weights[n] / total if total > 0 else 1.0 / count
    return total / count


@njit(nogil=True, cache=True)
def resample_particles(
    random: Random,
    poses: Floats,
    weights: Floats,
    count: int,
    settings: FilterSettings,
    histogram: PoseHistogram,
    bins: int,
    new_poses: Floats,
    scores: BeamScores,
    lost: float,
) -> tuple[int, int]:
    """Draw particles by their weights into ``new_poses`` (3, n), up to the KLD sample size.

    A share ``lost`` of them is drawn from the map's free cells instead.

    Returns
    -------
    count, bins : int
        Number of drawn particles, and of bins, which the histogram now holds.
    """
    clear_histogram(histogram, bins)
    shares, total = np.empty(count), 0.0
    for n in range(count):
        total += weights[n]
        shares[n] = total
    guide = index_cumulative_shares(shares)
    bins = n_drawn = size = int(np.int64(0))  # the constant 0 has a type of its own
    while n_drawn < settings.max_particles:
        # Without recovery no number is drawn for it.
        if lost > 0 and len(scores.free) and random.random() < lost:
            cell = scores.free[int(random.random() * len(scores.free))]
            x = (cell % (scores.cols - 2) + 0.5) * scores.resolution
            y = (cell // (scores.cols - 2) + 0.5) * scores.resolution
            heading = (2 * random.random() - 1) * np.pi
        else:
            share = random.random()
            at = find_first_above(share * shares[-1], shares, guide[int(share * count)])
            x, y, heading = poses[0, at], poses[1, at], poses[2, at]
        new_poses[0, n_drawn], new_poses[1, n_drawn], new_poses[2, n_drawn] = x, y, heading
        before, bins = bins, insert_particle(histogram, bins, n_drawn, x, y, heading)
        n_drawn += 1
        if bins > before:
            size = compute_kld_sample_size(bins, settings)
        if n_drawn > size:
            break
    return n_drawn, bins

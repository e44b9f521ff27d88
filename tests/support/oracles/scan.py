"""Losses of scan endpoints at every offset, and their moments."""

from __future__ import annotations

import itertools
import math

import numpy as np


def walls(levels):
    """Occupied cells that do not lie among none but occupied ones, (row, col)."""
    around = np.pad(levels, 1, constant_values=127)
    return [
        (row, col)
        for row, col in np.ndindex(levels.shape)
        if levels[row, col] == 0 and around[row : row + 3, col : col + 3].any()
    ]


def squared_distance(walls, row, col):
    """To the centre of the nearest wall, from anywhere [cells^2]."""
    return min((row - r) ** 2 + (col - c) ** 2 for r, c in walls) if walls else math.inf


def loss(squared, resolution, sigma_hit, z_rand):
    """Log-likelihood that an endpoint loses by its distance [nat]."""
    near = math.exp(-squared * resolution**2 / (2 * sigma_hit**2))
    return -math.log((1 - z_rand) * near + z_rand)


def score(levels, row, col, ends, step, half_steps, angles, cost):
    """Sum of ``cost(squared distance)`` over the endpoints at every offset, (theta, dy, dx)."""
    near, offsets = walls(levels), range(-half_steps, half_steps + 1)
    result = np.zeros((len(angles), len(offsets), len(offsets)))
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        for x, y in ends:
            if math.isnan(x):
                continue
            r = row + math.floor(sin * x + cos * y + 0.5)
            c = col + math.floor(cos * x - sin * y + 0.5)
            for j, dy in enumerate(offsets):
                for i, dx in enumerate(offsets):
                    result[k, j, i] += cost(squared_distance(near, r + dy * step, c + dx * step))
    return result


def recorded_posteriors(levels, cells, ends, step, half_steps, angles, cost, share, excess):
    """Mean, covariance, best offset in steps, entropy, ambiguity and mean loss of each scan.

    ``share`` of what a beam tells counts, and modes are connected up to `excess` more of it.
    """
    found = []
    for (row, col), scan in zip(cells, ends, strict=True):
        losses = score(levels, row, col, scan, step, half_steps, angles, cost)
        mode = find_central_mode(losses * share, excess)
        mean, covariance, entropy, ambiguity = moments(losses * share, mode)
        k, j, i = np.unravel_index(np.argmin(losses), losses.shape)
        best = (i - half_steps, j - half_steps, k - len(angles) // 2)
        returns = sum(not math.isnan(x) for x, _ in scan)
        found.append((mean, covariance, best, entropy, ambiguity, -losses.min() / max(returns, 1)))
    return found


def moments(losses, mode):
    """Mean and covariance of (dx, dy, theta) in steps, entropy [nat], mass outside the mode."""
    weights = np.exp(-(losses - losses.min()))
    weights /= math.fsum(weights.ravel())
    half = [size // 2 for size in losses.shape]
    poses = [(i - half[2], j - half[1], k - half[0]) for k, j, i in np.ndindex(losses.shape)]
    poses, weights = np.array(poses, float), weights.ravel()
    mean = np.array([math.fsum(weights * axis) for axis in poses.T])
    covariance = np.empty((3, 3))
    for a, b in np.ndindex(3, 3):
        covariance[a, b] = math.fsum(weights * (poses[:, a] - mean[a]) * (poses[:, b] - mean[b]))
    entropy = -math.fsum(w * math.log(w) for w in weights if w > 0)
    return mean, covariance, entropy, math.fsum(weights[~mode.ravel()])


def find_central_mode(losses, excess):
    """Offsets reached from zero by steps to 26 neighbours, and their neighbours, (theta, dy, dx).

    A step starts from what loses at most `excess` more than zero does.
    """
    centre = tuple(size // 2 for size in losses.shape)
    inside = np.zeros(losses.shape, bool)
    inside[centre] = True
    queue = [centre]
    while queue:
        at = queue.pop()
        if losses[at] > losses[centre] + excess:
            continue
        near = (
            range(max(n - 1, 0), min(n + 2, size)) for n, size in zip(at, losses.shape, strict=True)
        )
        for there in itertools.product(*near):
            if not inside[there]:
                inside[there] = True
                queue.append(there)
    return inside

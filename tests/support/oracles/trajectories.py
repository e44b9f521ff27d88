"""The likeliest trajectories of a recorded drive, by trying all of them."""

from __future__ import annotations

import itertools
import math

import numpy as np


def density_of(error, deviation, kidnapped):
    """Body, skirt and slips of a move's error, and a robot that was put anywhere."""

    def normal(values, sigmas):
        scaled = [v / s for v, s in zip(values, sigmas, strict=True)]
        size = math.prod(sigmas) * (2 * math.pi) ** (len(sigmas) / 2)
        return math.exp(-0.5 * sum(v * v for v in scaled)) / size

    body = normal(error, deviation)
    skirt = normal(error, [2.5 * d for d in deviation])
    slips = [normal(error, (far, far, 0.4)) for far in (1.0, 3.0)]
    return 0.84 * body + 0.15 * skirt + 0.01 * sum(slips) / 2 + kidnapped


def distance_between(walls, x, y, resolution):
    """Distance from walls at a position, bilinear between cell centres, 2 m at most."""
    cells = [(r, c) for r in range(len(walls)) for c in range(len(walls[0])) if walls[r][c]]

    def at(row, col):
        if not (0 <= row < len(walls) and 0 <= col < len(walls[0])):
            return 2.0
        return min([2.0] + [resolution * math.hypot(row - r, col - c) for r, c in cells])

    u, v = x / resolution - 0.5, y / resolution - 0.5
    j, i = math.floor(u), math.floor(v)
    a, c = u - j, v - i
    low = (1 - a) * at(i, j) + a * at(i, j + 1)
    high = (1 - a) * at(i + 1, j) + a * at(i + 1, j + 1)
    return (1 - c) * low + c * high


def fit_of(walls, resolution, sigma, anywhere, ends, pose):
    """Mean log-likelihood of a scan's ends at a pose."""
    logs = []
    for ahead, left in ends:
        if not math.isnan(ahead):
            x = pose[0] + math.cos(pose[2]) * ahead - math.sin(pose[2]) * left
            y = pose[1] + math.sin(pose[2]) * ahead + math.cos(pose[2]) * left
            away = distance_between(walls, x, y, resolution)
            hit = (1 - anywhere) * math.exp(-0.5 * (away / sigma) ** 2)
            logs.append(math.log(hit + anywhere))
    return sum(logs) / len(logs)


def error_of(first, second, move):
    """The way between two poses minus a move."""
    dx, dy = second[0] - first[0], second[1] - first[1]
    turn = (second[2] - first[2] - move[2] + math.pi) % (2 * math.pi) - math.pi
    cos, sin = math.cos(first[2]), math.sin(first[2])
    return cos * dx + sin * dy - move[0], cos * dy - sin * dx - move[1], turn


def best_way(candidates, gains, moves, deviations, kidnapped):
    """The likeliest of all ways over candidates, by trying each."""
    many, count = gains.shape

    def likelihood(way):
        total = sum(gains[c, k] for k, c in enumerate(way))
        for k in range(1, count):
            poses = candidates[way[k - 1], k - 1], candidates[way[k], k]
            density = density_of(error_of(*poses, moves[k]), deviations[k], kidnapped)
            total += math.log(density)
        return total

    return max(itertools.product(range(many), repeat=count), key=likelihood)


def sample_backwards(random, clouds, moves, deviations, kidnapped, count):
    """Trajectories drawn from clouds of particles, one after the other from its end."""
    trajectories = []
    for _ in range(count):
        poses = [clouds[-1].T[random.integers(0, clouds.shape[2])]]
        for k in range(len(clouds) - 2, -1, -1):
            errors = [error_of(particle, poses[0], moves[k + 1]) for particle in clouds[k].T]
            shares = [density_of(error, deviations[k + 1], kidnapped) for error in errors]
            mark, chosen, so_far = random.random() * sum(shares), 0, shares[0]
            while so_far < mark:
                chosen += 1
                so_far += shares[chosen]
            poses.insert(0, clouds[k].T[chosen])
        trajectories.append(poses)
    return np.array(trajectories)


def whole_matrix(diagonal, beside):
    """The matrix that block-tridiagonal equations stand for."""
    count = len(diagonal)
    matrix = np.zeros((3 * count, 3 * count))
    for n in range(count):
        here = slice(3 * n, 3 * n + 3)
        matrix[here, here] = diagonal[n]
        if n:
            before = slice(3 * n - 3, 3 * n)
            matrix[here, before], matrix[before, here] = beside[n], beside[n].T
    return matrix

"""The rigid move of a drive that takes the ends of its beams to a map's walls."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.maps import OccupancyGrid

FINEST = 0.2
"""Least edge of the cells of the search at all turns [m]."""
WIDEST = 224
"""Greatest number of these cells along a side of the map or of the drive."""
MAX_TURNS = 720
CANDIDATES = 12
"""Number of moves that are refined."""
NEARBY = 0.4
"""First step of the search around a move [m]."""
BLUR = 0.1
"""Least deviation of the walls' blur at which moves are compared [m]."""
ROUNDS = 30
Move = tuple[float, float, float]


def everywhere(
    grid: OccupancyGrid, ends: Numbers, places: Numbers, progress: ProgressCallback | None = None
) -> list[Move]:
    """The moves that fit best of all turns and shifts, about the origin [m, m, rad].

    The ends, rotated, are correlated with the walls by the Fourier transform; so are the places
    of the robot with the free space, which tells walls from clutter.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    ends : (k, 2) array
        Ends of beams in the map's frame [m].
    places : (n, 2) array
        Positions of the robot [m].
    progress : callable, optional
        Called with (done, total) turns.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    middle = places.mean(0)
    out, stood = ends - middle, places - middle
    reach = float(np.abs(np.concatenate([out, stood])).max())
    side = max(max(grid.shape) * grid.resolution, 2 * reach)
    cell = max(FINEST, side / WIDEST, grid.resolution)
    walls, free = _coarse(grid, cell)
    half = math.ceil(math.hypot(reach, reach) / cell) + 1
    shape = tuple(next_fast_len(each + 2 * half + 1, real=True) for each in walls.shape)
    of_walls, of_free = (np.conj(rfft2(each, shape)) for each in (walls, free))
    radius = math.sqrt(float((out**2).sum(1).mean()))
    turns = 4 * max(1, min(math.ceil(2 * math.pi * radius / cell / 4), MAX_TURNS // 4))
    found: list[tuple[float, float, float, float]] = []
    for n in range(turns):
        turn = 2 * math.pi * n / turns
        rasters = (_raster(_rotated(each, turn), cell, half) for each in (out, stood))
        hits, stands = (rfft2(each / each.sum(), shape) for each in rasters)
        score = irfft2(np.conj(hits * of_walls + 0.5 * stands * of_free), shape)
        for _ in range(2):
            row, col = divmod(int(np.argmax(score)), shape[1])
            found.append((float(score[row, col]), turn, float(row), float(col)))
            score[max(0, row - 3) : row + 4, max(0, col - 3) : col + 4] = -1.0
        if progress:
            progress(n + 1, turns)
    moves: list[Move] = []
    for _, turn, *at in sorted(found, reverse=True):
        # The raster's cell (half, half) holds the drive's middle.
        shift = [
            each - size if each > size / 2 else each for each, size in zip(at, shape, strict=True)
        ]
        rows, cols = ((each + half + 0.5) * cell / grid.resolution for each in shift)
        x, y = grid.grid_to_world(rows, cols)
        move = _about_origin((float(x), float(y)), middle, turn + grid.origin[2])
        if all(_apart(move, other, middle) > 2 * cell for other in moves):
            moves.append(move)
        if len(moves) == CANDIDATES:
            break
    return moves


def nearby(grid: OccupancyGrid, ends: Numbers, places: Numbers, starts: list[Move]) -> Move:
    """The best move around some: steps in x, y and turn are halved until none is better."""
    middle = places.mean(0)
    out, stood = ends - middle, places - middle
    radius = max(math.sqrt(float((out**2).sum(1).mean())), grid.resolution)
    clearance = grid.clearance
    best, best_score = (0.0, 0.0, 0.0), -1.0
    for start in starts:
        at = _about(start, middle)
        step = NEARBY
        while step > grid.resolution / 4:
            blur = max(BLUR, grid.resolution, step)
            at = _climbed(grid, clearance, out, stood, at, step, radius, blur)
            step /= 2
        score = _score(grid, clearance, out, stood, at, max(BLUR, grid.resolution))
        if score > best_score:
            best, best_score = _about_origin(at[:2], middle, at[2]), score
    return best


def _climbed(
    grid: OccupancyGrid,
    clearance: Numbers,
    out: Numbers,
    stood: Numbers,
    at: Move,
    step: float,
    radius: float,
    blur: float,
) -> Move:
    """The move from which no step of this size leads to a better one."""
    score = _score(grid, clearance, out, stood, at, blur)
    for _ in range(ROUNDS):
        tried = []
        for x, y, turn in itertools.product((-1, 0, 1), repeat=3):
            other = (at[0] + x * step, at[1] + y * step, at[2] + turn * step / radius)
            tried.append((_score(grid, clearance, out, stood, other, blur), other))
        better, there = max(tried)
        if better <= score:
            break
        score, at = better, there
    return at


def _score(
    grid: OccupancyGrid, clearance: Numbers, out: Numbers, stood: Numbers, at: Move, blur: float
) -> float:
    """Mean nearness of the ends to walls, 0 to 1, and half the share of places in free cells."""
    middle = np.array(at[:2])
    distance = _looked_up(grid, clearance, middle + _rotated(out, at[2]), np.inf)
    free = _looked_up(grid, grid.free, middle + _rotated(stood, at[2]), 0.0)
    return float(np.exp(-0.5 * (distance / blur) ** 2).mean() + 0.5 * free.mean())


def _looked_up(
    grid: OccupancyGrid, values: NDArray[np.float64] | NDArray[np.bool_], xy: Numbers, beyond: float
) -> Numbers:
    row, col = (np.floor(part).astype(np.int64) for part in grid.world_to_grid(*xy.T))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    return np.where(inside, values[np.where(inside, row, 0), np.where(inside, col, 0)], beyond)


def _coarse(grid: OccupancyGrid, cell: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Nearness to walls, and free space, in coarser cells along the map's own axes."""
    rows, cols = (math.ceil(each * grid.resolution / cell) for each in grid.shape)
    row = np.minimum((np.arange(rows) + 0.5) * cell / grid.resolution, grid.shape[0] - 1)
    col = np.minimum((np.arange(cols) + 0.5) * cell / grid.resolution, grid.shape[1] - 1)
    at = np.ix_(row.astype(np.int64), col.astype(np.int64))
    walls = np.exp(-0.5 * (grid.clearance[at] / (0.75 * cell)) ** 2)
    return walls.astype(np.float32), grid.free[at].astype(np.float32)


def _raster(xy: Numbers, cell: float, half: int) -> NDArray[np.float32]:
    """Number of points in each cell around the middle, (2 half + 1, 2 half + 1)."""
    size = 2 * half + 1
    col, row = (np.floor(part / cell + 0.5).astype(np.int64) + half for part in xy.T)
    counts = np.bincount(row * size + col, minlength=size * size)
    return counts.reshape(size, size).astype(np.float32)


def _rotated(xy: Numbers, turn: float) -> Numbers:
    cos, sin = math.cos(turn), math.sin(turn)
    return np.column_stack([cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]])


def _about_origin(to: tuple[float, ...], middle: Numbers, turn: float) -> Move:
    """The move that takes `middle` to a place with a turn, as a turn about the origin first."""
    x, y = _rotated(middle[None], turn)[0]
    return to[0] - float(x), to[1] - float(y), (turn + math.pi) % (2 * math.pi) - math.pi


def _about(move: Move, middle: Numbers) -> Move:
    """Where a move takes `middle`, and its turn."""
    x, y = _rotated(middle[None], move[2])[0]
    return float(x) + move[0], float(y) + move[1], move[2]


def _apart(one: Move, other: Move, middle: Numbers) -> float:
    (x, y, turn), (u, v, angle) = _about(one, middle), _about(other, middle)
    between = abs((turn - angle + math.pi) % (2 * math.pi) - math.pi)
    return math.hypot(x - u, y - v) + (math.inf if between > 0.1 else 0.0)

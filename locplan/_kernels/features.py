"""Which poses of a robot see which objects, and what it sees where parts of a map are away.

Objects only shorten rays: what is hidden on the map stays hidden beside any others. Rays, hits and
sums are those of `landmarks`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats, Ints, Singles
from locplan._kernels.landmarks import (
    NORMAL_X,
    NORMAL_Y,
    RANGE,
    TURN,
    Outline,
    Rays,
    Surfaces,
    entry,
    meeting,
    write_hit,
)


class Sightings(NamedTuple):
    """The poses that see each object, in order, and their rays that meet it."""

    starts: Ints  # (m + 1,) where those of each object begin
    poses: NDArray[np.int32]  # (k,) the pose
    rays: NDArray[np.int16]  # (k, 2) the first ray and how many follow it, itself counted


@njit(nogil=True, cache=True, error_model="numpy")
def seeing_rays(
    hits: Singles, rays: Rays, n: int, outline: Outline, x: float, y: float, heading: float
) -> tuple[int, int]:
    """First ray of a pose that an object at (x, y) shortens, and how many up to the last; or 0."""
    begin, count = meeting(rays, n, outline, x, y)
    from_x, from_y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
    cos, sin = np.cos(heading), np.sin(heading)
    first, last = -1, -1
    for k in range(count):
        b = (begin + k) % rays.beams
        bearing = rays.first[n] + b * rays.step
        dx, dy = np.cos(bearing), np.sin(bearing)
        at, _, _ = entry(outline, cos, sin, from_x - x, from_y - y, dx, dy)
        if at < hits[n, b, RANGE] and at <= rays.most:
            first, last = k if first < 0 else first, k
    if first < 0:
        return 0, 0
    return (begin + first) % rays.beams, last - first + 1


@njit(nogil=True, cache=True, error_model="numpy")
def find_sightings(
    candidates: Floats,
    begin: int,
    end: int,
    hits: Singles,
    rays: Rays,
    outline: Outline,
    sightings: Sightings,
    counts: Ints,
) -> None:
    """Fill how many poses see each candidate x, y, heading from `begin` to `end`, (m,).

    Sightings that have room are filled, too. They are found twice, since as many as there are may
    not fit the memory.
    """
    has_room = sightings.poses.size > 0
    for m in range(begin, end):
        x, y, heading = candidates[m, 0], candidates[m, 1], candidates[m, 2]
        at = sightings.starts[m]
        for n in range(rays.first.size):
            first, count = seeing_rays(hits, rays, n, outline, x, y, heading)
            if count > 0:
                if has_room:
                    sightings.poses[at] = n
                    sightings.rays[at, 0], sightings.rays[at, 1] = first, count
                at += 1
        counts[m] = at - sightings.starts[m]


@njit(nogil=True, cache=True, error_model="numpy")
def look(
    surfaces: Surfaces,
    labels: NDArray[np.int32],
    silent: Bools,
    rays: Rays,
    asked: Ints,
    hits: Singles,
    cells: Ints,
) -> None:
    """Fill the hits (k, 4) of some rays, and the cells that they meet (k,); -1 for none.

    Parameters
    ----------
    surfaces, rays
        See `landmarks.hits_of_map`.
    labels : (H, W) array
        Number of the feature that a cell belongs to, or -1.
    silent : (m,) array of bool
        Features that stop rays without a return.
    asked : (k,) array
        The rays: pose * beams + beam. A cell is row * W + col.
    """
    for k in range(asked.size):
        n, b = asked[k] // rays.beams, asked[k] % rays.beams
        row, col, counts = write_hit(surfaces, rays, n, b, hits[k])
        cells[k] = row * labels.shape[1] + col if row >= 0 else -1
        if counts and labels[row, col] >= 0 and silent[labels[row, col]]:
            hits[k, RANGE] = np.inf
            hits[k, NORMAL_X] = hits[k, NORMAL_Y] = hits[k, TURN] = 0.0

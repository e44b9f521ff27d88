"""Which poses of a robot see which objects on a map, and by which rays.

Objects only shorten rays: what is hidden on the map stays hidden beside any others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.landmarks import RANGE, Outline, Rays, entry, meeting


class Sightings(NamedTuple):
    """The poses that see each object, in order, and their rays that meet it."""

    starts: NDArray[np.int64]  # (m + 1,) where those of each object begin
    poses: NDArray[np.int32]  # (k,) the pose
    rays: NDArray[np.int16]  # (k, 2) the first ray and how many follow it, itself counted


@njit(nogil=True, cache=True, error_model="numpy")
def seeing_rays(
    hits: NDArray[np.float32],
    rays: Rays,
    n: int,
    outline: Outline,
    x: float,
    y: float,
    heading: float,
) -> tuple[int, int]:
    """First ray of a pose that an object at (x, y) shortens, and how many up to the last; or 0."""
    begin, count = meeting(rays, n, outline, x, y)
    from_x, from_y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
    first, last = -1, -1
    for k in range(count):
        b = (begin + k) % rays.beams
        bearing = rays.first[n] + b * rays.step
        at, _, _ = entry(outline, heading, from_x - x, from_y - y, np.cos(bearing), np.sin(bearing))
        if at < hits[n, b, RANGE] and at <= rays.most:
            first, last = k if first < 0 else first, k
    if first < 0:
        return 0, 0
    return (begin + first) % rays.beams, last - first + 1


@njit(nogil=True, cache=True, error_model="numpy")
def count_sightings(
    candidates: NDArray[np.float64],
    begin: int,
    end: int,
    hits: NDArray[np.float32],
    rays: Rays,
    outline: Outline,
    counts: NDArray[np.int64],
) -> None:
    """Fill how many poses see each candidate x, y, heading from `begin` to `end`, (m,)."""
    for m in range(begin, end):
        seen = 0
        for n in range(rays.first.size):
            _, count = seeing_rays(
                hits, rays, n, outline, candidates[m, 0], candidates[m, 1], candidates[m, 2]
            )
            seen += count > 0
        counts[m] = seen


@njit(nogil=True, cache=True, error_model="numpy")
def fill_sightings(
    candidates: NDArray[np.float64],
    begin: int,
    end: int,
    hits: NDArray[np.float32],
    rays: Rays,
    outline: Outline,
    sightings: Sightings,
) -> None:
    """Fill the sightings of the candidates from `begin` to `end`; `starts` are known."""
    for m in range(begin, end):
        at = sightings.starts[m]
        for n in range(rays.first.size):
            first, count = seeing_rays(
                hits, rays, n, outline, candidates[m, 0], candidates[m, 1], candidates[m, 2]
            )
            if count > 0:
                sightings.poses[at] = n
                sightings.rays[at, 0], sightings.rays[at, 1] = first, count
                at += 1

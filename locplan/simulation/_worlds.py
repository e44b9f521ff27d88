"""The part of a map that drives take place in, and their worlds: one a drive, made when driven."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import random_of
from locplan.maps import OccupancyGrid
from locplan.simulation._arguments import DriveArguments, Line

DRIVE, WORLD = 0, 2
"""Streams of random numbers of drives and of their worlds."""
MARGIN = 2.0
"""Distance beyond the range of the lidar that a part of a map holds [m]."""

Window = tuple[slice, slice]


def window_about(grid: OccupancyGrid, cells: NDArray[np.float64], margin: float) -> Window:
    """Rows and columns of a map around positions.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    cells : (n, 2) array
        Row and column of the positions, one at least in the map [cells].
    margin : float
        Distance around them [cells].
    """
    rows, cols = (
        slice(max(0, math.floor(at.min() - margin)), min(size, math.ceil(at.max() + margin)))
        for at, size in zip(cells.T, grid.shape, strict=True)
    )
    return rows, cols


@dataclass(frozen=True)
class Stage:
    """The part of a map that some lines need: the range of the lidar around them, and a margin."""

    resolution: float
    """Edge of a cell [m]."""
    window: Window
    """Rows and columns of the part."""
    stops: NDArray[np.bool_]
    """Cells that are occupied in the part."""
    boundary: NDArray[np.bool_]
    """Cells of the part in which worlds may differ from the map."""
    noise: float
    """Share of these cells in which they do."""
    seed: int
    """Seed of all random numbers."""

    def world(self, stream: int, number: int) -> NDArray[np.uint8]:
        """Empty squares of the world of a drive, see `locplan._kernels.rays.empty_squares`."""
        from locplan._kernels.rays import empty_squares

        stops = self.stops
        if self.noise:
            random = random_of(self.seed, WORLD, stream, number)
            flips = random.random(stops.shape, np.float32) < self.noise
            stops = stops ^ (flips & self.boundary)
        squares: NDArray[np.uint8] = empty_squares(stops)
        return squares

    def drive(
        self,
        line: Line,
        world: NDArray[np.uint8],
        stream: int,
        number: int,
        arguments: DriveArguments,
    ) -> NDArray[np.float64]:
        """The filter's errors on a drive, (n, 3) in the own axes of its map [m, m, rad].

        Parameters
        ----------
        line : Line
            The poses.
        world : array
            What `world` gave for this drive.
        stream, number : int
            The stream of random numbers, and the drive's number.
        arguments : DriveArguments
            Arguments of the kernel.
        """
        from locplan._kernels.drives import World, drive

        cells = line.cells - [self.window[0].start, self.window[1].start, 0.0]
        errors = np.empty_like(line.truth)
        random = random_of(self.seed, DRIVE, stream, number)
        drive(random, line.truth, World(world, self.resolution, cells), *arguments, errors)
        return errors


class SharedWorlds:
    """Worlds that some drives share: each is made for the first of them, and kept to the last.

    Parameters
    ----------
    make : callable
        Gives the world of a number.
    users : int
        Number of drives in each world.
    """

    def __init__(self, make: Callable[[int], NDArray[np.uint8]], users: int) -> None:
        self._make, self._users = make, users
        self._lock = Lock()
        self._kept: dict[int, _Kept] = {}

    @contextmanager
    def of(self, number: int) -> Iterator[NDArray[np.uint8]]:
        """The world of a number, for one of its drives."""
        with self._lock:
            kept = self._kept.setdefault(number, _Kept(self._users))
        with kept.lock:  # others wait for the one that makes it
            if kept.world is None:
                kept.world = self._make(number)
        yield kept.world
        with self._lock:
            kept.left -= 1
            if not kept.left:
                del self._kept[number]


@dataclass
class _Kept:
    """A world, and how many drives are still to take place in it."""

    left: int
    world: NDArray[np.uint8] | None = None
    lock: Lock = dataclasses.field(default_factory=Lock)


def turned(errors: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Errors turned from the map's own axes into the world's, (..., 3)."""
    if not yaw:
        return errors
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = errors[..., 0], errors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, errors[..., 2]], axis=-1)

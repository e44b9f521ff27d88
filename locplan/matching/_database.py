"""What a robot's lidar sees at every place of a map, for comparing scans with all of them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Octets
from locplan._util.poses import wrapped
from locplan.errors import ConfigError
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.matching._matching import TURNS, Matching, loss_tables

BAND = 1 << 20
"""Number of cells that are looked through at once, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class Database:
    """The ranges at every reachable place of a map, and the losses of beams' ends around it.

    `ScanDatabase` is what users keep: it makes one of these when it is needed.
    """

    grid: OccupancyGrid
    """The map."""
    matching: Matching
    """The lidar, and how scans are matched."""
    fits: Bools
    """Mask of the cells where the robot may stand, (H, W)."""
    positions: Floats
    """Positions of the lidar that scans are compared with, x and y (n, 2) [cells]."""
    codes: Octets
    """Codes of the ranges, in blocks of 64 places."""
    tables: Any
    """The losses of beams' ends around the map, as the kernels take them."""
    squares: Octets
    """The map, with the empty squares about its cells, as the kernels take it."""

    @cached_property
    def lever(self) -> tuple[float, float]:
        """Position of the lidar ahead and to the left of the robot's centre [cells]."""
        lidar, resolution = self.matching.lidar, self.grid.resolution
        return lidar.mount_x / resolution, lidar.mount_y / resolution

    def scans_at(self, poses: Floats) -> Floats:
        """Ranges at the robot's poses, x, y [cells] and heading [rad], (n, 96) [m].

        They belong to `Matching.bearings`: infinite without a return, NaN out of the view.

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading on the map [cells, cells, rad].
        """
        lidar = self.matching.lidar
        ranges = _ranges(self, poses, lidar.mount_x, lidar.mount_y)
        ranges[:, ~self.matching.seen] = np.nan
        return ranges

    def codes_of(self, ranges: Floats) -> Octets:
        """Codes of ranges, of which 16 are a metre; they begin anew after 16 m.

        Parameters
        ----------
        ranges : array
            Ranges, infinite without a return [m].
        """
        # No return lies two metres behind the lidar's range, which no wall does.
        none = 16 * self.matching.lidar.range + 32
        counts = np.where(np.isfinite(ranges), 16 * ranges, none)
        return np.asarray(np.floor(counts).astype(np.int64) % 256, np.uint8)

    def in_world(self, poses: Floats) -> Floats:
        """Poses in the world, (n, 3) [m, m, rad].

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading on the map [cells, cells, rad].
        """
        x, y = self.grid.grid_to_world(poses[:, 1], poses[:, 0])
        heading = wrapped(poses[:, 2] + self.grid.origin[2])
        return np.column_stack([x, y, heading])


def make_database(grid: OccupancyGrid, matching: Matching) -> Database:
    """Cast the beams of a lidar at every reachable place of a map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    matching : Matching
        The lidar, and how scans are matched.

    Raises
    ------
    ConfigError
        If the robot fits nowhere, or the map has no wall.
    """
    from locplan._kernels.rays import empty_squares

    occupied = grid.cells == OCCUPIED
    if not occupied.any():
        raise ConfigError(f"{grid.name or 'the map'} has no occupied cell that a beam could meet")
    fits = reachable(grid, matching.robot_radius)
    if not fits.any():
        raise ConfigError(
            f"a robot of radius {matching.robot_radius:g} m fits nowhere in"
            f" {grid.name or 'the map'}; give a smaller radius"
        )
    tables = loss_tables(grid, matching, fits)
    positions = places_every(0.4, _of_lidar(grid, matching, fits), grid.resolution)
    squares = empty_squares(occupied)
    made = Database(grid, matching, fits, positions, np.empty(0, np.uint8), tables, squares)
    return dataclasses.replace(made, codes=_all_codes(made))


def _all_codes(database: Database) -> Octets:
    """Codes of the ranges at all places, as `Database.codes` has them."""
    count = len(database.positions)
    codes = np.empty((count, TURNS), np.uint8)
    for first in range(0, count, 1 << 14):  # in blocks, which bounds the memory
        some = database.positions[first : first + (1 << 14)]
        poses = np.column_stack([some, np.zeros(len(some))])
        ranges = _ranges(database, poses, 0.0, 0.0)
        codes[first : first + len(some)] = database.codes_of(ranges)
    return in_blocks(np.hstack([codes, codes]))


def in_blocks(codes: Octets) -> Octets:
    """Codes of n places, (n, turns), as `Database.codes` has them."""
    from locplan._kernels.simd import OCTETS

    blocks = -(-len(codes) // OCTETS)
    padded = np.zeros((blocks * OCTETS, codes.shape[1]), np.uint8)
    padded[: len(codes)] = codes
    return padded.reshape(blocks, OCTETS, -1).transpose(0, 2, 1).reshape(-1)


def reachable(grid: OccupancyGrid, robot_radius: float) -> Bools:
    """Mask of the free cells where the robot fits, (H, W), without small regions of them."""
    import cv2

    fits = (grid.free & ~grid.closer_than(robot_radius - 1e-9)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(fits, connectivity=4)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    large = areas >= max(1.0, 0.1 * areas.max())
    large[0] = False
    return np.asarray(large[labels])


def places_every(spacing: float, fits: Bools, resolution: float) -> Floats:
    """Centres of cells, the one next to the middle of each square that has any, x and y (n, 2).

    Parameters
    ----------
    spacing : float
        Edge of the squares [m].
    fits : (H, W) array of bool
        The cells.
    resolution : float
        Edge of a cell [m].
    """
    edge = max(1, round(spacing / resolution))
    height, width = fits.shape
    rows = edge * max(1, BAND // (edge * width))
    found = [np.empty((0, 2))]
    for top in range(0, height, rows):
        found.append(_middles(fits[top : top + rows], edge))
        found[-1][:, 1] += top
    return np.concatenate(found) + 0.5


def _middles(fits: Bools, edge: int) -> Floats:
    """Columns and rows (n, 2) of the cells next to the middles of squares."""
    rows, cols = np.nonzero(fits)
    block = (rows // edge) * (fits.shape[1] // edge + 1) + cols // edge
    aside = (2 * (rows % edge) + 1 - edge) ** 2 + (2 * (cols % edge) + 1 - edge) ** 2
    order = np.lexsort([aside, block])  # cells that are as near stay in the order of their rows
    block = block[order]
    chosen = order[np.concatenate([block[:1] >= 0, block[1:] != block[:-1]])]
    return np.column_stack([cols[chosen], rows[chosen]]).astype(np.float64)


def _of_lidar(grid: OccupancyGrid, matching: Matching, fits: Bools) -> Bools:
    """Mask of the cells where the lidar may be."""
    import cv2

    lidar = matching.lidar
    reach = math.ceil(math.hypot(lidar.mount_x, lidar.mount_y) / grid.resolution)
    if reach == 0:
        return fits
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near = cv2.dilate(fits.astype(np.uint8), around)
    return np.asarray((near > 0) & (grid.cells != OCCUPIED))


def _ranges(database: Database, poses: Floats, forward: float, left: float) -> Floats:
    """Ranges all round of a lidar so mounted at poses x, y, heading, (n, 96) [m]."""
    from locplan._kernels.matches import ranges_from

    beams = database.matching.beams(forward, left)
    ranges = np.empty((len(poses), TURNS))
    at = np.ascontiguousarray(poses[:, [1, 0, 2]])
    ranges_from(database.squares, database.grid.resolution, at, beams, ranges)
    return ranges

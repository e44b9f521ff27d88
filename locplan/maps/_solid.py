"""Walls that are black inside: whether they mislead a filter, and the map without their inside."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Octets, Singles
from locplan.maps._grid import OccupancyGrid, check_grid
from locplan.maps._occupancy import FREE, OCCUPIED, UNKNOWN

RANGE, BEAMS, SIGMA, OUTLIERS = 3.5, 60, 0.02, 0.1
"""Range [m] and beams of the lidar of the check, deviation of a range [m], share of outliers."""
SCANS, POSES, TRIES, WHOLE = 80, 1500, 600, 2**22
"""Numbers of the scans, of the wrong poses of each, of the places that are tried for them, and of
the cells up to which a map is scored as a whole."""
NEAREST, FARTHEST, MAX_TURN = 0.5, 3.0, 20.0
"""Distances of the wrong poses [m], and their greatest turn [deg]."""
CLEARANCE = 0.25
"""Minimum distance of a scan's place from a wall [m]."""
SIGMA_HIT, Z_RAND, MAX_DISTANCE = 0.2, 0.5, 2.0
"""Nav2's defaults of AMCL's likelihood field."""
AROUND = FARTHEST + RANGE + 1.0
"""Distance around a scan's place that its fits depend on [m]."""
DEPTH = 0.5
"""Depth from which on black behind a surface misleads a filter [m]."""


@dataclass(frozen=True)
class Solidity:
    """What the inside of a map's walls does to scans."""

    wins: float
    """Share of noisy scans that some wrong pose fits better than the true one, 0..1."""
    wins_hollowed: float
    """The same with the walls hollowed."""
    depth: float
    """Share of the walls' surface with over 0.5 m of black behind it, 0..1."""

    @property
    def misleads(self) -> bool:
        """True if wrong poses win a fifth of the scans, and hollowing at least halves that."""
        return self.wins >= 0.2 and self.wins_hollowed <= self.wins / 2

    @property
    def is_solid(self) -> bool:
        """True if walls mislead because they are deep: not smeared or inflated ones."""
        return self.misleads and self.depth >= 0.15


def hollowed(grid: OccupancyGrid) -> OccupancyGrid:
    """The map with the inside of its walls unknown: each cell whose 8 neighbours are occupied.

    A filter needs the surfaces only. Inside of black a particle explains every beam; in unknown
    space it explains none, and no path leads there. A rim of one cell stays.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Examples
    --------
    >>> block = OccupancyGrid([[0, 0, 0], [0, 0, 0], [0, 0, 0]], 0.05)
    >>> hollowed(block).cells.tolist()
    [[0, 0, 0], [0, 127, 0], [0, 0, 0]]
    """
    check_grid(grid)
    return replace(grid, cells=np.where(inside_of_walls(grid), np.uint8(UNKNOWN), grid.cells))


def inside_of_walls(grid: OccupancyGrid) -> Bools:
    """The occupied cells whose 8 neighbours are occupied, (H, W); outside the map none is."""
    import cv2

    occupied = (grid.cells == OCCUPIED).view(np.uint8)
    inner = cv2.erode(
        occupied, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return np.asarray(inner.view(np.bool_))


def solidity(grid: OccupancyGrid) -> Solidity:
    """Whether the inside of a map's walls misleads a filter, by scans that are simulated.

    Each of 80 noisy scans of a lidar of 3.5 m is compared with 1,500 poses 0.5 to 3 m and up to
    20 deg off, by the score of AMCL's likelihood field. The longer the lidar reaches, the less a
    check would show; filters get lost all the same.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    return _solidity(grid)


@lru_cache(32)  # of the maps that are equal by value; the check takes tenths of a second
def _solidity(grid: OccupancyGrid) -> Solidity:
    from locplan._kernels.walls import surface_depths

    deep = int(DEPTH / grid.resolution) + 1
    faces, deep_faces = surface_depths(grid.cells, FREE, OCCUPIED, deep)
    inside = inside_of_walls(grid)
    if not inside.any():
        return Solidity(0.0, 0.0, 0.0)
    wins, count, moves = np.zeros(2), 0, _moves(grid.resolution)
    before, both = (slice(0), slice(0)), [np.empty((0, 0), np.float32)]
    for around, pose, ends in _scans(grid):
        if around != before:
            occupied = grid.cells[around] == OCCUPIED
            rims, before = occupied & ~inside[around], around
            both = [_scores(each.view(np.uint8), grid.resolution) for each in (occupied, rims)]
        if both[0][int(pose[0]) + 1, int(pose[1]) + 1] > _score(np.float64(CLEARANCE)):
            continue
        wins += [_wrong_pose_wins(each, ends, pose, moves) for each in both]
        count += 1
        if count == SCANS:
            break
    if count < SCANS / 4:  # hardly any place shows a wall to a lidar
        wins[:] = 0.0
    as_is, mended = (wins / max(count, 1)).tolist()
    return Solidity(as_is, mended, deep_faces / max(faces, 1))


def _wrong_pose_wins(scores: Singles, ends: Floats, pose: Floats, moves: Floats) -> bool:
    """Whether a scan fits better after one of the moves than at its true pose."""
    from locplan._kernels.particles import BeamScores, add_scores

    # Cells of the window in the ring, counted from its corner.
    rows, cols = scores.shape
    own = BeamScores(scores.ravel(), rows, cols, resolution=1.0, product=False, shift=1.0)
    sums = np.empty(len(moves) + 1)
    poses = pose[[1, 0, 2], None] + np.column_stack([np.zeros(3), moves.T])
    add_scores(own, ends, poses, len(sums), sums)
    return bool(sums[1:].max() > sums[0])


def _moves(resolution: float) -> Floats:
    """From the true pose to wrong ones: columns, rows [cells] and turn [rad], (POSES, 3)."""
    random = np.random.default_rng(1)
    distance = random.uniform(NEAREST, FARTHEST, POSES) / resolution
    bearing = random.uniform(-np.pi, np.pi, POSES)
    turn = np.radians(random.uniform(-MAX_TURN, MAX_TURN, POSES))
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), turn])


def _scans(grid: OccupancyGrid) -> Iterator[tuple[tuple[slice, slice], Floats, Floats]]:
    """Noisy scans of which a third of the beams return, with the part of the map around each.

    Poses (row, column, heading) are within the part [cells, cells, rad], ends are ahead and to the
    left of the robot [cells].
    """
    from locplan._kernels.lidar import BeamDisturbances, Lidar, measured_ends
    from locplan._kernels.rays import empty_squares

    random = np.random.default_rng(0)
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    lidar = Lidar(angles, 0.0, 0.0, 0.0, SIGMA, 0.0, RANGE)
    noise = BeamDisturbances(OUTLIERS, 0.2, np.radians(20.0), 0.5, 2.0)
    before, squares = (slice(0), slice(0)), np.empty((0, 0), np.uint8)
    for row, col in _places(grid, random):
        seen, pose = _window(grid, row, col, RANGE), np.empty(3)
        first = seen[0].start, seen[1].start
        pose[:] = row - first[0], col - first[1], random.uniform(-np.pi, np.pi)
        ends = np.empty((BEAMS, 2))
        if seen != before:
            before, squares = seen, empty_squares(grid.cells[seen] == OCCUPIED)
        measured_ends(random, squares, grid.resolution, pose, lidar, noise, ends)
        if np.isfinite(ends[:, 0]).sum() < BEAMS / 3:
            continue
        around = _window(grid, row, col, AROUND)
        pose[:2] += first[0] - around[0].start, first[1] - around[1].start
        yield around, pose, ends


def _places(grid: OccupancyGrid, random: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Positions in free cells, drawn at random [cells]; fewer than TRIES where few are free."""
    drawn = random.random((100 * TRIES, 2)) * grid.shape
    rows, cols = drawn.astype(np.int64).T
    for row, col in drawn[grid.cells[rows, cols] == FREE][:TRIES]:
        yield float(row), float(col)


def _window(grid: OccupancyGrid, row: float, col: float, reach: float) -> tuple[slice, slice]:
    """Rows and columns around a position [cells], as far as so many metres, or the whole map.

    The whole of a map costs less than the windows of all scans, unless it is large.
    """
    far = int(reach / grid.resolution) + 1 if grid.cells.size > WHOLE else max(grid.shape)
    rows, cols = (
        slice(max(0, int(at) - far), min(size, int(at) + far + 1))
        for at, size in zip((row, col), grid.shape, strict=True)
    )
    return rows, cols


def _scores(occupied: Octets, resolution: float) -> Singles:
    """What a beam adds that ends in each cell, in a ring for all outside."""
    import cv2

    distance = np.full(occupied.shape, MAX_DISTANCE, np.float32)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distance = np.minimum(cells * np.float32(resolution), distance)
    return _score(np.pad(distance, 1, constant_values=MAX_DISTANCE))


def _score(distance: Singles | np.float64) -> Singles:
    """The cube of a beam's likelihood at a distance from a wall [m], as AMCL adds it."""
    hit = (1 - Z_RAND) * np.exp(-(distance**2) / (2 * SIGMA_HIT**2))
    return np.asarray((hit + Z_RAND / RANGE) ** 3, np.float32)

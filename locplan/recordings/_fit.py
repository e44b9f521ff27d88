"""Whether a map fits a recorded drive: the share of beams that end at its walls."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import instance
from locplan._util.poses import Numbers, ends_in_map, moved, wrapped
from locplan._util.progress import ProgressCallback
from locplan.errors import RecordingError
from locplan.maps import OCCUPIED, OccupancyGrid, check_grid
from locplan.recordings._fit_search import everywhere, nearby
from locplan.recordings._matches import MIN_RETURNS
from locplan.recordings._recording import Recording

NEAR_CELLS, NEAR = 2.0, 0.1
"""Distance from a wall within which a beam ends at it: two cells, but at least 0.1 m. A cell's
worth is lost by the map's and the end's own rounding, another one by the wall's thickness in a map
of many scans; and 0.1 m is three deviations of a lidar's noise."""
BLOCK = 512
"""Number of scans that are compared with the map at once, which saves memory."""
SCANS, BEAMS = 100, 60
"""Greatest numbers of scans, and of beams of each, that are compared, evenly spaced."""
FITS = 0.6
"""Share of the beams that end at walls from which a map fits. Six real logs have .91 to 1.00 on the
maps made of them, and at most .41 on those of each other, wherever the drive is moved."""
BETTER = 0.1
"""Gain in the share for which a move of the map is suggested."""
FAR, TURNED = 0.1, math.radians(0.5)
"""Shift [m] and turn [rad] of the drive below which a map counts as in its place."""


@dataclass(frozen=True)
class MapFit:
    """How well a recorded drive fits a map where it is, and where it would fit best."""

    share: float
    """Share of the beams with a return that end within `distance` of a wall, 0..1."""
    best_share: float
    """The same after `move`."""
    move: tuple[float, float, float]
    """The move of the drive that fits best: a turn about the map frame's origin, then a shift
    [m, m, rad]; `Recording.moved` does it."""
    distance: float
    """Distance within which a beam ends at a wall [m]."""
    origin: tuple[float, float, float]
    """Origin of the map with which the drive fits best as it is [m, m, rad]."""
    mount: str = field(default="")
    """How the lidar seems to be mounted instead, if that explains a bad fit; else empty."""

    @property
    def fits(self) -> bool:
        """True if the map fits as it is."""
        return self.share >= FITS and not self.shifted

    @property
    def shifted(self) -> bool:
        """True if the map would fit, or fit clearly better, after a move."""
        x, y, turn = self.move
        away = math.hypot(x, y) > FAR or abs(turn) > TURNED
        return away and self.best_share >= FITS and self.best_share >= self.share + BETTER

    @property
    def sentence(self) -> str:
        """Whether the map fits, and what to do if it does not."""
        now = f"{self.share:.0%} of the beams end within {self.distance:.2g} m of a wall"
        if self.fits:
            return f"The map fits: {now}."
        if self.mount:
            return f"The lidar seems to be {self.mount}: {now}; give its mount= when reading."
        if self.shifted:
            x, y, turn = self.move
            origin = ", ".join(f"{value:.3f}" for value in self.origin)
            return (
                f"The map seems shifted: {now}, and {self.best_share:.0%} with the drive turned by"
                f" {math.degrees(turn):.1f} deg about the origin and moved by {x:.2f},{y:.2f} m;"
                f" set origin: [{origin}] in the map's YAML, or take"
                f" drive.moved({x:.3f}, {y:.3f}, {turn:.4f})."
            )
        return (
            f"The map does not fit: {now}, and {self.best_share:.0%} at best wherever the drive is"
            " moved; take the map of this place and time, and check the lidar's mount, and that the"
            " poses are not odometry alone."
        )


class _Sample(NamedTuple):
    """Some beams of some scans."""

    on_robot: Numbers  # (n, beams, 2), NaN without return [m]
    poses: Numbers  # (n, 3)

    def ends(self) -> Numbers:
        """Ends of the returns in the map's frame, (k, 2) [m]."""
        ends = ends_in_map(self.on_robot, self.poses).reshape(-1, 2)
        return ends[np.isfinite(ends[:, 0])]


def fit_to_map(
    recording: Recording, grid: OccupancyGrid, *, progress: ProgressCallback | None = None
) -> MapFit:
    """Tell how well a recorded drive fits a map, and find where it would fit best.

    Where fewer than 60 % of the beams end at walls, the whole drive is moved: it is correlated with
    the walls at all turns and shifts, coarsely, and the best of these are refined. Else only the
    surroundings are searched.

    Parameters
    ----------
    recording : Recording
        The drive; up to 100 scans and 60 beams of each are compared.
    grid : OccupancyGrid
        The map.
    progress : callable, optional
        Called with (done, total) turns of the search.

    Returns
    -------
    MapFit
        The shares, the best move, and a sentence.

    Raises
    ------
    RecordingError
        If the map has no walls.

    Examples
    --------
    >>> from locplan.robots import Lidar
    >>> from locplan.maps import environments
    >>> grid = environments.make("two_corridors", resolution=0.1)
    >>> lidar = Lidar(range=4.0, field_of_view_deg=180.0, beams=2)
    >>> drive = Recording([[1.05, 1.05]] * 2, lidar, [[10.0, 3.0, 0.0], [11.0, 3.0, 0.0]])
    >>> print(fit_to_map(drive, grid).sentence)
    The map fits: 100% of the beams end within 0.2 m of a wall.
    """
    instance("recording", recording, Recording)
    check_grid(grid)
    if not (grid.cells == OCCUPIED).any():
        raise RecordingError(
            f"{grid.name or 'the map'} has no walls, that beams could end at; take another map"
        )
    distance = max(NEAR_CELLS * grid.resolution, NEAR)
    near = grid.closer_than(distance)
    sample = _sample(recording)
    ends = sample.ends()
    share = _share(grid, near, ends)
    starts = [(0.0, 0.0, 0.0)]
    if share < FITS:
        starts += everywhere(grid, ends, sample.poses[:, :2], progress)
    move = nearby(grid, ends, sample.poses[:, :2], starts)
    best = _share(grid, near, sample._replace(poses=moved(sample.poses, move)).ends())
    if best <= share:
        move, best = (0.0, 0.0, 0.0), share
    mount = _mount(grid, near, sample, best) if best < FITS else ""
    return MapFit(share, best, move, distance, _origin(grid, move), mount)


def _sample(recording: Recording) -> _Sample:
    """Scans and beams that are evenly spaced."""
    scans = np.unique(np.linspace(0, len(recording) - 1, SCANS).astype(np.int64))
    beams = np.unique(np.linspace(0, recording.lidar.beams - 1, BEAMS).astype(np.int64))
    ends = recording[scans].ends_on_robot()
    if np.isfinite(ends[:, beams]).any():
        ends = ends[:, beams]
    return _Sample(ends, recording.poses[scans])


def _share(grid: OccupancyGrid, near: NDArray[np.bool_], ends: Numbers) -> float:
    """Share of points that lie in the cells of a mask."""
    row, col = (np.floor(part).astype(np.int64) for part in grid.world_to_grid(*ends.T))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    return float((inside & near[np.where(inside, row, 0), np.where(inside, col, 0)]).mean())


def _origin(grid: OccupancyGrid, move: tuple[float, float, float]) -> tuple[float, float, float]:
    """Origin of the map after the move the other way."""
    (x, y, yaw), (dx, dy, turn) = grid.origin, move
    cos, sin = math.cos(turn), math.sin(turn)
    u, v = x - dx, y - dy
    return cos * u + sin * v, cos * v - sin * u, float(wrapped(yaw - turn))


def _mount(grid: OccupancyGrid, near: NDArray[np.bool_], sample: _Sample, best: float) -> str:
    """How the lidar is mounted if another mount explains the scans at the recorded poses."""
    x, y = sample.on_robot[..., 0], sample.on_robot[..., 1]
    others = {
        "turned by 90 deg": (-y, x),
        "turned by 180 deg": (-x, -y),
        "turned by -90 deg": (y, -x),
        "upside down": (x, -y),
    }
    for words, ends in others.items():
        share = _share(grid, near, sample._replace(on_robot=np.stack(ends, axis=-1)).ends())
        if share >= max(FITS, best + BETTER):
            return words
    return ""


def scans_unlike(
    recording: Recording, grid: OccupancyGrid, scans: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell which scans of a recorded drive are unlike a map.

    They are those of which fewer than 60 % of the returns end within two cells of a wall, at least
    0.1 m. One with fewer than 10 returns is not judged.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    scans : (n,) array of int
        Indices of the scans.

    Returns
    -------
    (n,) array of bool
        True for each of these scans that is unlike the map.
    """
    unlike = np.zeros(len(scans), np.bool_)
    near = grid.closer_than(max(NEAR_CELLS * grid.resolution, NEAR))
    for first in range(0, len(scans), BLOCK):
        some = scans[first : first + BLOCK]
        if np.isfinite(recording.ranges[some]).any():
            unlike[first : first + BLOCK] = _unlike(recording[some], grid, near)
    return unlike


def _unlike(some: Recording, grid: OccupancyGrid, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each scan is unlike the map whose cells near walls are given."""
    ends = some.ends()
    returned = np.isfinite(ends[..., 0])
    row, col = grid.world_to_grid(*np.moveaxis(np.where(returned[..., None], ends, 0.0), -1, 0))
    inside = returned & (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    cells = (np.where(inside, each, 0).astype(np.int64) for each in (row, col))
    hits = (inside & near[tuple(cells)]).sum(axis=1)
    count = returned.sum(axis=1)
    unlike: NDArray[np.bool_] = (count >= MIN_RETURNS) & (hits < FITS * count)
    return unlike

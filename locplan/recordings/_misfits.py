"""Places where recorded scans do not fit the map: walls that they see through, or miss."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import instance
from locplan._util.poses import ends_in_map
from locplan.errors import RecordingError
from locplan.field import position_axes
from locplan.maps import FREE, OCCUPIED, MapFault, OccupancyGrid, boxes_of
from locplan.recordings._matches import at_walls, match_scans
from locplan.recordings._recording import Recording

CROSSED, TIMES, HITS = 5, 3, 3
"""Number of scans that see through a wall that is none, in times of those that end there; and of
scans that end at a wall that is missing, or see through one without passing another."""
SEEN_THROUGH, LENGTH = 0.02, 1.0
"""Maximum share of the walls in view that scans see through on a true map, and maximum length of
the walls that they miss there [m]."""
BAD_POSES = 0.04
"""Deviation of the poses, in directions that walls fix, from which on no place is named [m]."""
SURE = 0.05
"""Maximum deviation of a match in its best direction to judge a pose by [m]."""
SCANS, BEAMS = 4000, 180
"""Numbers of the scans of a drive, and of the beams of each, that are used."""


@dataclass(frozen=True, eq=False, repr=False)
class Misfits:
    """Cells of a map that recorded scans contradict."""

    false: Bools
    """Occupied cells that scans see through, (H, W)."""
    missing: Bools
    """Cells where scans end and the map has no wall near, (H, W)."""
    seen_through: float
    """Share of the wall cells in view that are false, 0..1."""
    at_walls: float
    """Share of the beams that end at walls of the map, 0..1."""

    def faults(self, grid: OccupancyGrid) -> Iterator[MapFault]:
        """Yield the faults of the map with their places, the largest first; none on a true map.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        remedy = "here the scans do not fit the map: see what stands there, and map it again"
        if self.seen_through > SEEN_THROUGH:
            what = f"{self.seen_through:.1%} of the walls in view are seen through"
            boxes = boxes_of(grid, self.false)
            yield MapFault("false walls", what, remedy, sure=True, boxes=boxes)
        if self.missing.sum() * grid.resolution > LENGTH:
            what = f"{1 - self.at_walls:.0%} of the beams end at no wall"
            boxes = boxes_of(grid, self.missing)
            yield MapFault("missing walls", what, remedy, sure=True, boxes=boxes)


@dataclass(frozen=True, eq=False)
class _Beams:
    """Beams of scans on a map [cells]."""

    origins: Floats  # (n, 2)
    ends: Floats  # (n, beams, 2), NaN without return


def find_misfits(grid: OccupancyGrid, recordings: Sequence[Recording]) -> Misfits:
    """Find the places where recorded scans do not fit the map.

    A wall is false if five scans or more see through it, over three times as many as end there.
    A wall is missing where three scans end.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recordings : sequence of Recording
        The drives, whose poses count as true.

    Returns
    -------
    Misfits
        The cells of false and of missing walls.

    Raises
    ------
    RecordingError
        If the poses are off by so much that walls would seem to be wrong.
    """
    for each in recordings:
        instance("recording", each, Recording, "read one with locplan.recordings.read_recording")
    deviation = max(_pose_deviation(grid, each) for each in recordings)
    name = grid.name or "the map"
    if math.isinf(deviation):
        raise RecordingError(
            f"no scan fits {name} near its pose; give a drive of this map, with poses on it"
        )
    if deviation > BAD_POSES:
        raise RecordingError(
            f"the poses are off by {deviation:.2f} m from where their scans fit {name},"
            f" too much to tell false walls by (at most {BAD_POSES:g} m);"
            " find the ground truth with locplan recording FILE MAP -o drive.npz"
        )
    parts = [_beams(grid, each) for each in recordings]
    beams = _Beams(
        np.concatenate([each.origins for each in parts]),
        np.concatenate([each.ends for each in parts]),
    )
    return Misfits(*_contradicted(grid, beams), _at_walls(grid, beams))


def _beams(grid: OccupancyGrid, recording: Recording) -> _Beams:
    """The beams of up to so many scans of a drive that are evenly spaced, in the map's cells."""
    scans = np.unique(np.linspace(0, len(recording) - 1, SCANS).astype(np.int64))
    beams = np.unique(np.linspace(0, recording.lidar.beams - 1, BEAMS).astype(np.int64))
    recording = recording[scans]
    lidar = np.array([[[recording.lidar.mount_x, recording.lidar.mount_y]]])
    lidars = np.repeat(lidar, len(scans), axis=0)
    ends = ends_in_map(recording.ends_on_robot()[:, beams], recording.poses)
    origins = ends_in_map(lidars, recording.poses)[:, 0]
    own = [np.stack(grid.world_to_grid(each[..., 0], each[..., 1]), -1) for each in (origins, ends)]
    return _Beams(own[0], own[1])


def _pose_deviation(grid: OccupancyGrid, recording: Recording) -> float:
    """Median distance of the poses from where scans fit, along x or y or as each fits best [m].

    The largest of the three counts. A map that is wrong somewhere has walls enough elsewhere; along
    a corridor no pose is judged.
    """
    some = np.unique(np.linspace(0, len(recording) - 1, 100).astype(np.int64))
    found = match_scans(recording[some], grid, threads=1)
    _, minor, direction = position_axes(found.covariance)
    # A few scans fit any map somewhere.
    deviations = [] if (found.judged & (minor < SURE)).sum() > 5 else [math.inf]
    x, y = np.sqrt(found.covariance[:, 0, 0]), np.sqrt(found.covariance[:, 1, 1])
    for across, sigma in ((0.0, x), (math.pi / 2, y), (direction + math.pi / 2, minor)):
        off = found.mean[:, 0] * np.cos(across) + found.mean[:, 1] * np.sin(across)
        sure = found.judged & (sigma < SURE)
        if sure.sum() > 5:
            deviations.append(float(np.median(np.abs(off[sure]))))
    return max(deviations, default=0.0)


def _contradicted(grid: OccupancyGrid, beams: _Beams) -> tuple[Bools, Bools, float]:
    """Cells of false and of missing walls, and the share of the walls in view that are false.

    A beam that passes a wall at which others end is wrong from there on. Without such beams three
    scans tell what else takes five, and one scan tells of what is connected with that.
    """
    import cv2

    walls = grid.cells == OCCUPIED
    passed, hit, around = _counted(grid, np.zeros_like(walls), beams)
    kept = walls & ((passed < CROSSED) | (passed <= TIMES * around))
    cells = np.where(walls & ~kept, np.uint8(FREE), grid.cells)
    _, beside = at_walls(replace(grid, cells=cells))
    missing = (hit >= HITS) & (passed <= TIMES * hit) & ~beside & ~walls
    met = (around >= HITS) & (passed <= TIMES * around)
    passed, _, around = _counted(grid, missing | (walls & met), beams)
    seen = walls & (passed > TIMES * around)
    _, labels = cv2.connectedComponents(seen.view(np.uint8), connectivity=8)
    false = seen & np.isin(labels, labels[seen & (passed >= HITS)])
    in_view = np.count_nonzero(walls & ((passed > 0) | (around > 0)))
    return false, missing, float(false.sum() / max(in_view, 1))


def _counted(grid: OccupancyGrid, stops: Bools, beams: _Beams) -> tuple[Ints, Ints, Floats]:
    """Numbers of the scans that pass each cell, that end in it, and that end in it or beside it."""
    import cv2

    from locplan._kernels.walls import count_scans

    margin = at_walls(grid)[0] / grid.resolution
    passed, hit = count_scans(stops, beams.origins, beams.ends, margin)
    # A beam ends a cell beside the one that it met, by its noise and by the map's rounding.
    return passed, hit, cv2.boxFilter(hit.astype(np.float64), -1, (3, 3), normalize=False)


def _at_walls(grid: OccupancyGrid, beams: _Beams) -> float:
    """Share of the beams that end at walls, whatever they pass."""
    ends = beams.ends[np.isfinite(beams.ends[..., 0])]
    row, col = np.floor(ends).astype(np.int64).T
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    _, near = at_walls(grid)
    return float((near[row * inside, col * inside] & inside).mean())

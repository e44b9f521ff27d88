"""Walls that recorded drives see through or miss, and whether changing them explains more scans."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import instance
from locplan._util.intervals import Interval, blocks_along, in_percent, mean_interval
from locplan._util.poses import ends_in_map
from locplan.errors import RecordingError
from locplan.field import position_axes
from locplan.maps import FREE, OCCUPIED, MapFault, OccupancyGrid, boxes_of
from locplan.recordings import RangeFit, Recording, at_walls, match_scans, range_fit

CROSSED, TIMES, HITS = 5, 3, 3
"""Number of scans that see through a wall that is none, in times of those that end there; and of
scans that end at a wall that is missing, or see through one without passing another."""
BLOCK = 5.0
"""Length of the pieces of a drive that are held out in turn [m]."""
BAD_POSES = 0.04
"""Deviation of the poses, in directions that walls fix, from which on nothing is mended [m]."""
SURE = 0.05
"""Maximum deviation of a match in its best direction to judge a pose by [m]."""
SCANS, BEAMS = 4000, 180
"""Numbers of the scans of a drive, and of the beams of each, that are used."""


@dataclass(frozen=True, eq=False, repr=False)
class WallUpdate:
    """What recorded drives say of a map's walls."""

    added: Bools
    """Cells where scans end and the map has no wall near, (H, W)."""
    removed: Bools
    """Occupied cells that scans see through, (H, W)."""
    at_walls: float
    """Share of the beams that end at walls of the map, 0..1."""
    crossed: float
    """Share of the wall cells in view that are seen through, 0..1; up to .02 on a true map."""
    pose_deviation: float
    """Deviation of the poses from where their scans fit the map, in the worst of x, y and the
    direction that fits best [m]."""
    explained: Interval
    """Share of the beams held out that the map explains, 0..1: they end at walls, and pass none."""
    gain: Interval
    """The mended map's share minus that of the map, with scans held out."""
    ranges: RangeFit
    """Factor on the ranges, and depth at which beams end behind the map's surfaces."""

    @property
    def is_better(self) -> bool:
        """True if the mended map explains more of the scans held out, and there is a change.

        Nothing is drawn on a map whose resolution is wrong, which explains everything.
        """
        changes = self.added.any() or self.removed.any()
        # Maps of real logs that seem true gain up to .001 by what the mapping rounded.
        seems_true = self.at_walls >= 0.9 and self.crossed <= 0.02
        return self.gain.low > 0.002 * seems_true and bool(changes) and not self.ranges.is_scaled

    @property
    def sentence(self) -> str:
        """What the drives see, without a full stop."""
        shares = (
            f"{self.at_walls:.0%} of the beams end at walls, and {self.crossed:.1%} of the walls in"
            " view are seen through"
        )
        if math.isnan(self.gain.low):
            return f"{shares}; the drives are too short to tell: five pieces of {BLOCK:g} m needed"
        said = (
            f"{shares}; with {self.removed.sum():,} cells erased and {self.added.sum():,} drawn the"
            f" map explains {_in_points(self.gain)} of beams held out more than"
            f" {in_percent(self.explained)}"
        )
        return said if self.is_better else f"{said}: walls stay as they are"

    def faults(self, grid: OccupancyGrid) -> Iterator[MapFault]:
        """The faults of the map that the drives tell, the ranges' first.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        yield from self.ranges.faults(grid)
        too_short = math.isnan(self.gain.low) and self.crossed > 0.02
        if not (self.is_better or too_short):
            return
        said = (
            (
                *("false walls", self.removed, "erased"),
                f"{self.crossed:.1%} of the walls in view are seen through",
                "a filter's error grows by up to 2.4 times",
            ),
            (
                *("missing walls", self.added, "drawn"),
                f"{1 - self.at_walls:.0%} of the beams end at no wall",
                "without a quarter of the walls a filter gets lost in up to two of three drives",
            ),
        )
        for kind, cells, done, what, costs in said:
            mend = f"{done} on the map for the filter; see what stands there"
            if too_short:
                mend = "record a longer drive, by which the map can be judged"
            # Of true maps up to .02 of the walls are seen through, and less than a metre is drawn.
            if self.crossed > 0.02 if kind == "false walls" else cells.sum() > 1 / grid.resolution:
                boxes = boxes_of(grid, cells)
                yield MapFault(kind, what, mend, costs, self.is_better, boxes)

    def on(self, grid: OccupancyGrid) -> OccupancyGrid:
        """A map with these walls erased and drawn; as it is where that explains no more.

        Parameters
        ----------
        grid : OccupancyGrid
            The map, or one mended otherwise, of the same cells.
        """
        return _changed(grid, self.added, self.removed) if self.is_better else grid

    def summary(self) -> dict[str, object]:
        """Shares and numbers of cells, fit for JSON."""
        return {
            "added_cells": int(self.added.sum()),
            "removed_cells": int(self.removed.sum()),
            "beams_at_walls": self.at_walls,
            "walls_crossed": self.crossed,
            "pose_deviation": self.pose_deviation,
            "explained": self.explained._asdict(),
            "gain": self.gain._asdict(),
            "range_factor": self.ranges.factor._asdict(),
            "depth": self.ranges.depth._asdict(),
        }


def _in_points(gain: Interval) -> str:
    """A gain of a share and its interval in percentage points."""
    value, low, high = (100 * each for each in gain)
    return f"{value:+.1f} [{low:+.1f}, {high:+.1f}] points"


@dataclass(frozen=True, eq=False)
class _Beams:
    """Beams of scans on a map [cells], and the piece of a drive that each scan belongs to."""

    origins: Floats  # (n, 2)
    ends: Floats  # (n, beams, 2), NaN without return
    blocks: Ints  # (n,)

    def of(self, chosen: Bools) -> _Beams:
        return _Beams(self.origins[chosen], self.ends[chosen], self.blocks[chosen])


def update_walls(grid: OccupancyGrid, recordings: Sequence[Recording]) -> WallUpdate:
    """Find walls that drives see through, and those that they meet where the map has none.

    A wall is none if five scans or more see through it, over three times as many as end there.
    One is missing where three scans end. What half of the pieces of the drives say of walls is
    judged by the scans of the other half.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recordings : sequence of Recording
        The drives, whose poses count as true.

    Raises
    ------
    RecordingError
        If the poses are off by so much that walls would be drawn beside their places.
    """
    for each in recordings:
        instance("recording", each, Recording, "read one with locplan.recordings.read_drive")
    deviation = max(_pose_deviation(grid, each) for each in recordings)
    name = grid.name or "the map"
    if math.isinf(deviation):
        raise RecordingError(
            f"no scan fits {name} near its pose, so that no wall can be drawn;"
            " give a drive of this map, with poses on it"
        )
    if deviation > BAD_POSES:
        raise RecordingError(
            f"the poses are off by {deviation:.2f} m from where their scans fit {name},"
            f" too much to draw walls by (at most {BAD_POSES:g} m);"
            " smooth them (--reference smoothed), or check with locplan trajectory"
        )
    parts = [_beams(grid, each) for each in recordings]
    firsts = np.cumsum([0, *(int(each.blocks.max()) + 1 for each in parts)])
    beams = _Beams(
        np.concatenate([each.origins for each in parts]),
        np.concatenate([each.ends for each in parts]),
        np.concatenate([n + each.blocks for n, each in zip(firsts.tolist(), parts, strict=False)]),
    )
    added, removed, crossed = _changes(grid, beams)
    before, gain = np.empty(len(beams.blocks)), np.empty(len(beams.blocks))
    for half in range(2):
        held_out = beams.blocks % 2 == half
        mended = _changed(grid, *_changes(grid, beams.of(~held_out))[:2])
        before[held_out] = _explained(grid, beams.of(held_out))
        gain[held_out] = _explained(mended, beams.of(held_out)) - before[held_out]
    known = np.isfinite(before)
    near = _at_walls(grid, beams)
    blocks = beams.blocks[known]
    return WallUpdate(
        *(added, removed, near, crossed, deviation),
        mean_interval(before[known], blocks),
        mean_interval(gain[known], blocks),
        range_fit(grid, recordings),
    )


def _beams(grid: OccupancyGrid, recording: Recording) -> _Beams:
    """The beams of up to so many scans of a drive that are evenly spaced, in the map's cells."""
    scans = np.unique(np.linspace(0, len(recording) - 1, SCANS).astype(np.int64))
    beams = np.unique(np.linspace(0, recording.lidar.beams - 1, BEAMS).astype(np.int64))
    blocks, recording = blocks_along(recording.poses, BLOCK)[scans], recording[scans]
    lidar = np.array([[[recording.lidar.mount_x, recording.lidar.mount_y]]])
    lidars = np.repeat(lidar, len(scans), axis=0)
    ends = ends_in_map(recording.ends_on_robot()[:, beams], recording.poses)
    origins = ends_in_map(lidars, recording.poses)[:, 0]
    own = [np.stack(grid.world_to_grid(each[..., 0], each[..., 1]), -1) for each in (origins, ends)]
    return _Beams(own[0], own[1], blocks)


def _pose_deviation(grid: OccupancyGrid, recording: Recording) -> float:
    """Median distance of the poses from where scans fit, along x or y or as each fits best [m].

    The largest of the three counts. A map that is wrong somewhere has walls enough elsewhere; along
    a corridor no pose is judged.
    """
    some = np.unique(np.linspace(0, len(recording) - 1, 100).astype(np.int64))
    found = match_scans(recording[some], grid, threads=1)
    _, minor, direction = position_axes(found.covariance)
    deviations = [math.inf] if not (found.judged & (minor < SURE)).any() else []
    x, y = np.sqrt(found.covariance[:, 0, 0]), np.sqrt(found.covariance[:, 1, 1])
    for across, sigma in ((0.0, x), (math.pi / 2, y), (direction + math.pi / 2, minor)):
        off = found.mean[:, 0] * np.cos(across) + found.mean[:, 1] * np.sin(across)
        sure = found.judged & (sigma < SURE)
        if sure.sum() > 5:
            deviations.append(float(np.median(np.abs(off[sure]))))
    return max(deviations, default=0.0)


def _changes(grid: OccupancyGrid, beams: _Beams) -> tuple[Bools, Bools, float]:
    """Cells of missing and of false walls, and the share of the walls in view that are such.

    A beam that passes a wall at which others end is wrong from there on. Without such beams three
    scans tell what else takes five, and one scan tells of what is connected with that.
    """
    import cv2

    walls = grid.cells == OCCUPIED
    passed, hit, around = _counted(grid, np.zeros_like(walls), beams)
    kept = walls & ((passed < CROSSED) | (passed <= TIMES * around))
    _, beside = at_walls(_changed(grid, kept, walls))
    missing = (hit >= HITS) & (passed <= TIMES * hit) & ~beside & ~walls
    met = (around >= HITS) & (passed <= TIMES * around)
    passed, _, around = _counted(grid, missing | (walls & met), beams)
    seen = walls & (passed > TIMES * around)
    _, labels = cv2.connectedComponents(seen.view(np.uint8), connectivity=8)
    false = seen & np.isin(labels, labels[seen & (passed >= HITS)])
    in_view = np.count_nonzero(walls & ((passed > 0) | (around > 0)))
    return missing, false, float(false.sum() / max(in_view, 1))


def _counted(grid: OccupancyGrid, stops: Bools, beams: _Beams) -> tuple[Ints, Ints, Floats]:
    """Numbers of the scans that pass each cell, that end in it, and that end in it or beside it."""
    import cv2

    from locplan._kernels.walls import count_scans

    margin = at_walls(grid)[0] / grid.resolution
    passed, hit = count_scans(stops, beams.origins, beams.ends, margin)
    # A beam ends a cell beside the one that it met, by its noise and by the map's rounding.
    return passed, hit, cv2.boxFilter(hit.astype(np.float64), -1, (3, 3), normalize=False)


def _changed(grid: OccupancyGrid, added: Bools, removed: Bools) -> OccupancyGrid:
    cells = grid.cells.copy()
    cells[removed], cells[added] = FREE, OCCUPIED
    return replace(grid, cells=cells)


def _explained(grid: OccupancyGrid, beams: _Beams) -> Floats:
    """Share of the beams of each scan that a map explains; NaN without a return."""
    from locplan._kernels.walls import explained_beams

    margin, near = at_walls(grid)
    found, returns = explained_beams(
        grid.cells == OCCUPIED, near, beams.origins, beams.ends, margin / grid.resolution
    )
    with np.errstate(invalid="ignore"):
        return np.asarray(found / returns)


def _at_walls(grid: OccupancyGrid, beams: _Beams) -> float:
    """Share of the beams that end at walls, whatever they pass."""
    ends = beams.ends[np.isfinite(beams.ends[..., 0])]
    row, col = np.floor(ends).astype(np.int64).T
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    _, near = at_walls(grid)
    return float((near[row * inside, col * inside] & inside).mean())

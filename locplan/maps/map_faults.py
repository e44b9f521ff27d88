"""Faults of a map that mislead a planner, a filter or its user."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from locplan._support.kernels.arrays import Bools, Floats, Octets, Singles
from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan.errors import ConfigError
from locplan.maps.files import DARK, ROWS, MapSource, with_corrected_thresholds
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN

if TYPE_CHECKING:
    from matplotlib.figure import Figure


RANGE, BEAMS, SIGMA, OUTLIERS = 3.5, 60, 0.02, 0.1
"""Range [m] and beams of the lidar of the check, deviation of a range [m], share of outliers."""
SCANS, POSES, MAX_POSITIONS, MAX_SCORED_CELLS = 80, 1500, 600, 2**22
"""Numbers of the scans, of the wrong poses of each, of the places that are tried for them, and of
the cells up to which a map is scored as a whole."""
NEAREST, FARTHEST, MAX_TURN = 0.5, 3.0, 20.0
"""Distances of the wrong poses [m], and their greatest turn [deg]."""
CLEARANCE = 0.25
"""Minimum distance of a scan's place from a wall [m]."""
SIGMA_HIT, Z_RAND, MAX_DISTANCE = 0.2, 0.5, 2.0
"""Nav2's defaults of AMCL's likelihood field."""
SCORED_REACH = FARTHEST + RANGE + 1.0
"""Distance around a scan's place that its fits depend on [m]."""
MISLEADING_DEPTH = 0.5
"""Depth from which on black behind a surface misleads a filter [m]."""


@dataclass(frozen=True)
class WallSolidity:
    """Effect of the inside of a map's walls on scans."""

    wrong_pose_share: float
    """Share of noisy scans that some wrong pose fits better than the true one, 0..1."""
    hollowed_wrong_pose_share: float
    """The same with the walls hollowed."""
    deep_surface_share: float
    """Share of the walls' surface with over 0.5 m of black behind it, 0..1."""

    @property
    def is_misleading(self) -> bool:
        """True if wrong poses win a fifth of the scans, and hollowing at least halves that."""
        return (
            self.wrong_pose_share >= 0.2
            and self.hollowed_wrong_pose_share <= self.wrong_pose_share / 2
        )

    @property
    def is_solid(self) -> bool:
        """True if walls mislead because they are deep, and are not just smeared or inflated."""
        return self.is_misleading and self.deep_surface_share >= 0.15


def hollow_walls(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the map with the inside of its walls unknown: cells whose 8 neighbours are occupied.

    A filter needs the surfaces only. Inside of black a particle explains every beam; in unknown
    space it explains none, and no path leads there. A rim of one cell stays.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Examples
    --------
    >>> block = OccupancyGrid([[0, 0, 0], [0, 0, 0], [0, 0, 0]], 0.05)
    >>> hollow_walls(block).cells.tolist()
    [[0, 0, 0], [0, 127, 0], [0, 0, 0]]
    """
    check_grid(grid)
    return replace(
        grid, cells=np.where(mark_enclosed_wall_cells(grid), np.uint8(UNKNOWN), grid.cells)
    )


def mark_enclosed_wall_cells(grid: OccupancyGrid) -> Bools:
    """Mark the occupied cells whose 8 neighbours are occupied, (H, W); beyond the map none is."""
    import cv2

    occupied = (grid.cells == OCCUPIED).view(np.uint8)
    inner = cv2.erode(
        occupied, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return np.asarray(inner.view(np.bool_))


def measure_solidity(grid: OccupancyGrid) -> WallSolidity:
    """Measure by simulated scans if the inside of a map's walls misleads a filter.

    Each of 80 noisy scans of a lidar of 3.5 m is compared with 1,500 poses 0.5 to 3 m and up to
    20 deg off, by the score of AMCL's likelihood field. A longer range would hide the effect,
    although filters still get lost.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    return _compute_solidity(grid)


@lru_cache(32)  # of the maps that are equal by value; the check takes tenths of a second
def _compute_solidity(grid: OccupancyGrid) -> WallSolidity:
    """Compute the solidity of a map's walls, see `measure_solidity`."""
    from locplan._support.kernels.walls import count_deep_faces

    deep = int(MISLEADING_DEPTH / grid.resolution) + 1
    faces, deep_faces = count_deep_faces(grid.cells, FREE, OCCUPIED, deep)
    inside = mark_enclosed_wall_cells(grid)
    if not inside.any():
        return WallSolidity(0.0, 0.0, 0.0)
    wins, count, moves = np.zeros(2), 0, _draw_pose_errors(grid.resolution)
    before, window_scores = (slice(0), slice(0)), [np.empty((0, 0), np.float32)]
    for around, pose, ends in _simulate_scans(grid):
        if around != before:
            occupied = grid.cells[around] == OCCUPIED
            rims, before = occupied & ~inside[around], around
            window_scores = [
                _score_cells(layer.view(np.uint8), grid.resolution) for layer in (occupied, rims)
            ]
        if window_scores[0][int(pose[0]) + 1, int(pose[1]) + 1] > _score_distance(
            np.float64(CLEARANCE)
        ):
            continue
        wins += [_fits_wrong_pose_better(layer, ends, pose, moves) for layer in window_scores]
        count += 1
        if count == SCANS:
            break
    if count < SCANS / 4:  # hardly any place shows a wall to a lidar
        wins[:] = 0.0
    as_is, mended = (wins / max(count, 1)).tolist()
    return WallSolidity(as_is, mended, deep_faces / max(faces, 1))


def _fits_wrong_pose_better(scores: Singles, ends: Floats, pose: Floats, moves: Floats) -> bool:
    """True if a scan fits better after one of the moves than at its true pose."""
    from locplan._support.kernels.particles import BeamScores, add_scores

    # Cells of the window in the ring, counted from its corner.
    rows, cols = scores.shape
    beam_scores = BeamScores(scores.ravel(), rows, cols, resolution=1.0, product=False, shift=1.0)
    sums = np.empty(len(moves) + 1)
    # The filter passes poses in C order, and numba compiles the kernel again for another order.
    poses = np.ascontiguousarray((pose[[1, 0, 2]] + np.vstack([np.zeros(3), moves])).T)
    add_scores(beam_scores, ends, poses, len(sums), sums)
    return bool(sums[1:].max() > sums[0])


def _draw_pose_errors(resolution: float) -> Floats:
    """Draw moves from the true pose to wrong ones, (POSES, 3) [cells, cells, rad]."""
    random = np.random.default_rng(1)
    distance = random.uniform(NEAREST, FARTHEST, POSES) / resolution
    bearing = random.uniform(-np.pi, np.pi, POSES)
    turn = np.radians(random.uniform(-MAX_TURN, MAX_TURN, POSES))
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), turn])


def _simulate_scans(grid: OccupancyGrid) -> Iterator[tuple[tuple[slice, slice], Floats, Floats]]:
    """Yield the map window around each simulated scan, its pose and its ends.

    Poses (row, column, heading) are within the part [cells, cells, rad], ends are ahead and to the
    left of the robot [cells].
    """
    from locplan._support.kernels.lidar import BeamDisturbances, LidarBeams, simulate_measured_ends
    from locplan._support.kernels.rays import compute_empty_squares

    random = np.random.default_rng(0)
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    lidar = LidarBeams(angles, 0.0, 0.0, 0.0, SIGMA, 0.0, RANGE)
    noise = BeamDisturbances(OUTLIERS, 0.2, np.radians(20.0), 0.5, 2.0)
    before, squares = (slice(0), slice(0)), np.empty((0, 0), np.uint8)
    for row, col in _draw_positions(grid, random):
        window, pose = _select_window(grid, row, col, RANGE), np.empty(3)
        first = window[0].start, window[1].start
        pose[:] = row - first[0], col - first[1], random.uniform(-np.pi, np.pi)
        ends = np.empty((BEAMS, 2))
        if window != before:
            before, squares = window, compute_empty_squares(grid.cells[window] == OCCUPIED)
        simulate_measured_ends(random, squares, grid.resolution, pose, lidar, noise, ends)
        if np.isfinite(ends[:, 0]).sum() < BEAMS / 3:
            continue
        around = _select_window(grid, row, col, SCORED_REACH)
        pose[:2] += first[0] - around[0].start, first[1] - around[1].start
        yield around, pose, ends


def _draw_positions(
    grid: OccupancyGrid, random: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Yield random positions in free cells [cells]; fewer than MAX_POSITIONS if few are free."""
    positions = random.random((100 * MAX_POSITIONS, 2)) * grid.shape
    rows, cols = positions.astype(np.int64).T
    for row, col in positions[grid.cells[rows, cols] == FREE][:MAX_POSITIONS]:
        yield float(row), float(col)


def _select_window(
    grid: OccupancyGrid, row: float, col: float, reach: float
) -> tuple[slice, slice]:
    """Return rows and columns within `reach` metres of a position [cells], or the whole map.

    The whole of a map costs less than the windows of all scans, unless it is large.
    """
    far = (
        int(reach / grid.resolution) + 1 if grid.cells.size > MAX_SCORED_CELLS else max(grid.shape)
    )
    rows, cols = (
        slice(max(0, int(at) - far), min(size, int(at) + far + 1))
        for at, size in zip((row, col), grid.shape, strict=True)
    )
    return rows, cols


def _score_cells(occupied: Octets, resolution: float) -> Singles:
    """Return the score of a beam that ends in each cell, with a ring for all outside."""
    import cv2

    distance = np.full(occupied.shape, MAX_DISTANCE, np.float32)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distance = np.minimum(cells * np.float32(resolution), distance)
    return _score_distance(np.pad(distance, 1, constant_values=MAX_DISTANCE))


def _score_distance(distance: Singles | np.float64) -> Singles:
    """Return the cube of a beam's likelihood at a distance from a wall [m], as AMCL adds it."""
    hit = (1 - Z_RAND) * np.exp(-(distance**2) / (2 * SIGMA_HIT**2))
    return np.asarray((hit + Z_RAND / RANGE) ** 3, np.float32)


MIN_SHARE = 0.01
"""Minimum share of the pixels, or of the image's edge, that is worth a sentence."""
SPECK, SPECKS, COARSE = 3, 1.0, 0.5
"""Maximum size of a speck [cells], the number of specks a square metre that is too many, and the
size of cells from which on they are coarse [m]."""

PAINTED, NO_UNKNOWN = 0.3, 0.001
"""Minimum share of the cells that are black inside, and maximum share of unknown ones, of a map
whose unknown space seems painted black. Real ones have .54 to .85; of the others none has .14."""


@dataclass(frozen=True)
class MapFault:
    """A fault of a map that misleads a robot or its user."""

    kind: str
    """Kind of the fault: "mask", "costmap", "thresholds", "cells", "coarse cells", "open boundary",
    "solid walls", "thick walls", "painted unknown", "specks" or "origin"; by recorded drives
    "resolution", "deep walls", "false walls" or "missing walls"."""
    message: str
    """The fault as a sentence, without a full stop."""
    remedy: str = ""
    """Instruction to remove the fault; empty if the message contains it."""
    impact: str = ""
    """Measured effect on a robot; empty if it was not measured."""
    is_certain: bool = False
    """True if the map or the drive proves it; otherwise confirm it, or drive longer."""
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    """Places of the fault, largest first: the least and greatest x, then y, of each one [m]; empty
    if the fault is everywhere."""

    @property
    def place_text(self) -> str:
        """The largest places as text, with the middle and size of each [m]; empty without any."""
        place_texts = [
            f"{(left + right) / 2:.1f},{(low + top) / 2:.1f}"
            f" ({right - left:.1f} x {top - low:.1f} m)"
            for left, right, low, top in self.boxes[:3]
        ]
        omitted = [f"{len(self.boxes) - 3} more places"] if len(self.boxes) > 3 else []
        return ", ".join([*place_texts, *omitted])

    @property
    def sentence(self) -> str:
        """The whole fault in one sentence, without a full stop."""
        message = f"{self.message}, at {self.place_text}" if self.boxes else self.message
        return "; ".join(clause for clause in (message, self.impact, self.remedy) if clause)


def _make_fault(kind: str, sentence: str, *, is_certain: bool = False) -> MapFault:
    """Make a fault from a sentence that ends in the remedy."""
    message, _, remedy = sentence.rpartition("; ")
    return MapFault(kind, message or remedy, remedy if message else "", is_certain=is_certain)


def find_threshold_faults(grid: OccupancyGrid, source: MapSource) -> Iterator[MapFault]:
    """Find faults of the thresholds and of the values of pixels."""
    free, occupied = source.free_thresh, source.occupied_thresh
    if source.light_free > MIN_SHARE * source.pixels:
        lower = 0.196 if free > 0.196 else 0.15
        yield _make_fault(
            "thresholds",
            f"{source.light_free:,} pixels ({source.light_free / source.pixels:.0%}) of a light"
            f" grey, mostly {source.light_value}, are read as free, while map_saver's 205 means"
            f" unknown; if they are unknown, lower free_thresh to {lower:g} (it is {free:g})",
        )
    if source.costmap_pixels:
        yield _make_fault(
            "costmap",
            f"this is a costmap, not a map: {source.costmap_pixels:,} pixels"
            f" ({source.costmap_pixels / source.pixels:.0%}) are 253 or 254, the costs of"
            " obstacles, and"
            " are read as free; take the map that it was made of",
            is_certain=True,
        )
    if source.has_dark_walls:
        yield _make_fault(
            "thresholds",
            f"{source.dark_unknown:,} dark grey pixels are read as unknown, beside"
            f" {source.occupied:,} occupied ones; if they are walls, lower occupied_thresh to"
            f" {DARK:g} (it is {occupied:g})",
        )
    if free == occupied:
        yield _make_fault(
            "thresholds",
            f"free_thresh and occupied_thresh are both {free:g}, so that no grey is unknown;"
            " map_saver writes 0.25 or 0.196, and 0.65",
        )
    if source.over_100 > MIN_SHARE * source.pixels:
        yield _make_fault(
            "thresholds",
            f"{source.over_100:,} pixels ({source.over_100 / source.pixels:.0%}) are above 100 and"
            " read as unknown, since pixels are per cent in mode raw; for an ordinary image set"
            " mode: trinary",
        )


def find_mask_faults(grid: OccupancyGrid, source: MapSource) -> Iterator[MapFault]:
    """Find signs that the map is a mask for a costmap filter.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    source : MapSource
        How its pixels were read, see `read_map`.

    Yields
    ------
    MapFault
        At most one fault, if the name or two further signs indicate a mask.
    """
    signs = []
    words = " ".join(re.findall(r"[a-z]+", f"{grid.name} {Path(source.image).name}".lower()))
    name_match = re.search(r"\b(filter|keepout|limit|mask|speed|virtual walls?)\b", words)
    if name_match:
        signs.append(f"its name has the word {name_match[0]}")
    if source.mode != "trinary":
        signs.append(f"its mode is {source.mode}")
    if source.free_thresh <= 0.05 and source.occupied_thresh >= 0.95:
        signs.append(
            f"only the ends of its scale are free or occupied (thresholds {source.free_thresh:g}"
            f" and {source.occupied_thresh:g})"
        )
    if name_match or len(signs) >= 2:
        yield _make_fault(
            "mask",
            f"this seems to be a mask for a costmap filter, not a map: {', '.join(signs)};"
            " plan on the map that it belongs to",
            is_certain=True,
        )


def find_cell_faults(grid: OccupancyGrid) -> Iterator[MapFault]:
    """Find faults of the cells."""
    import cv2

    cells = grid.cells
    if not (cells == FREE).any():
        yield _make_fault(
            "cells", "no cell is free, so that the robot can stand nowhere; check the thresholds"
        )
        return
    if grid.resolution > COARSE:
        yield _make_fault(
            "coarse cells",
            f"cells of {grid.resolution:g} m are coarse for a lidar, which measures to some"
            " centimetres; check resolution in the map's YAML (0.05 is usual), or map the site"
            " again",
        )
    rim = np.concatenate([cells[0], cells[-1], cells[1:-1, 0], cells[1:-1, -1]]) == FREE
    if rim.mean() > MIN_SHARE:
        yield _make_fault(
            "open boundary",
            f"free space runs out of the image along {rim.sum() * grid.resolution:.3g} m"
            f" ({rim.mean():.0%} of its edge); what lies outside counts as unknown",
        )
    if not (cells == OCCUPIED).any():
        yield _make_fault(
            "cells", "no cell is occupied, so that a lidar sees nothing; check the thresholds"
        )
        return
    kernel = np.ones((7, 7), np.uint8)  # SLAM maps have a fringe of three unknown cells at walls
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    count = np.zeros(2, np.int64)  # of the boundary's cells, and of the open ones
    for top in range(0, len(cells), ROWS):
        first = max(top - 3, 0)
        around, band_rows = cells[first : top + ROWS + 3], slice(top - first, top - first + ROWS)
        free, occupied = ((around == level).astype(np.uint8) for level in (FREE, OCCUPIED))
        inner = cv2.erode(free, cross, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        edge = (free > inner)[band_rows]
        open_ = edge & (cv2.dilate(occupied, kernel)[band_rows] == 0)
        count += np.count_nonzero(edge), np.count_nonzero(open_)
    share = count[1] / count[0]
    if share > 0.5:
        yield _make_fault(
            "open boundary",
            f"{share:.0%} of the free space's boundary is open to the unknown instead of walled;"
            " no lidar sees that boundary",
        )


def find_origin_faults(grid: OccupancyGrid) -> Iterator[MapFault]:
    """Find an unusual yaw of the origin."""
    yaw = grid.origin[2]
    if abs(yaw) > 2 * math.pi:
        yield _make_fault(
            "origin", f"the origin's yaw of {yaw:g} is in radians, and looks like degrees"
        )
    elif yaw:
        yield _make_fault(
            "origin",
            f"the origin's yaw of {math.degrees(yaw):.4g} deg counts in all coordinates here; Nav2"
            " and ROS 1 ignore it",
        )


def find_specks(grid: OccupancyGrid) -> Bools:
    """Mark the specks: groups of up to 3 occupied cells surrounded by free space, (H, W)."""
    import cv2

    is_speck = np.zeros(grid.shape, np.bool_)
    for top in range(0, len(is_speck), ROWS):
        first = max(top - SPECK - 1, 0)
        around = grid.cells[first : top + ROWS + SPECK + 1]
        occupied = (around == OCCUPIED).view(np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(occupied, connectivity=8)
        floats = np.bincount(labels[_find_cells_near_unknown(around)], minlength=count) == 0
        small = floats & (stats[:, cv2.CC_STAT_AREA] <= SPECK)
        small[0] = False
        band_rows = slice(top - first, top - first + ROWS)
        is_speck[top : top + ROWS] = small[labels[band_rows]]
    return is_speck


def _find_cells_near_unknown(cells: Octets) -> Bools:
    """Mark the cells that are unknown or have an unknown neighbour."""
    import cv2

    unknown = ((cells != OCCUPIED) & (cells != FREE)).view(np.uint8)
    return np.asarray(cv2.dilate(unknown, np.ones((3, 3), np.uint8)).view(np.bool_))


def find_bounding_boxes(
    grid: OccupancyGrid, cells: Bools, gap: float = 0.5
) -> tuple[tuple[float, float, float, float], ...]:
    """Return boxes around groups of cells, in the form of `MapFault.boxes`.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    cells : (H, W) array of bool
        The cells.
    gap : float, default 0.5
        Distance from which on cells are two places [m].
    """
    import cv2

    size = 2 * int(gap / grid.resolution / 2) + 1
    near = cv2.dilate(cells.view(np.uint8), np.ones((size, size), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    rows, cols = np.nonzero(cells)
    cell_labels = labels[rows, cols]
    places = []
    for n in np.argsort(-np.bincount(cell_labels, minlength=count), kind="stable")[
        : len(np.unique(cell_labels))
    ]:
        row, col = rows[cell_labels == n], cols[cell_labels == n]
        corners = np.ix_((row.min(), row.max() + 1.0), (col.min(), col.max() + 1.0))
        x, y = grid.grid_to_world(*map(np.ravel, np.broadcast_arrays(*corners)))
        places.append((float(x.min()), float(x.max()), float(y.min()), float(y.max())))
    return tuple(places)


def find_painted_unknown_faults(grid: OccupancyGrid) -> Iterator[MapFault]:
    """Find unknown space that was painted black."""
    unknown = np.count_nonzero(~grid.free & (grid.cells != OCCUPIED)) / grid.cells.size
    inside = float(mark_enclosed_wall_cells(grid).mean())
    if unknown <= NO_UNKNOWN and inside >= PAINTED:
        yield MapFault(
            "painted unknown",
            f"no cell is unknown, and {inside:.0%} of all are black inside of walls, as if unknown"
            " space were painted black",
            "save it as unknown, as map_saver does, or take the map that locplan repair writes",
        )


def find_wall_faults(grid: OccupancyGrid, wall_solidity: WallSolidity) -> Iterator[MapFault]:
    """Find walls that mislead a particle filter."""
    if wall_solidity.is_misleading:
        yield MapFault(
            "solid walls" if wall_solidity.is_solid else "thick walls",
            "walls are black inside: a wrong pose explains"
            f" {wall_solidity.wrong_pose_share:.0%} of noisy scans better than the true one, and"
            f" {wall_solidity.hollowed_wrong_pose_share:.0%} with hollow walls",
            "give AMCL, of ROS 1 or 2, the map that locplan repair writes, and plan on this one"
            if wall_solidity.is_solid
            else f"hardly any is over {MISLEADING_DEPTH:g} m deep, so that they may be smeared or"
            " inflated, and hollowing may harm; draw the walls from a recorded drive",
            "on such maps Nav2's default filter loses most drives"
            if wall_solidity.is_solid
            else "",
            wall_solidity.is_solid,
        )
    area = np.count_nonzero(grid.free) * grid.resolution**2
    count = _count_specks(grid, SPECKS * area)
    if count > SPECKS * area > 0:
        yield MapFault(
            "specks",
            f"{count:,} specks of up to {SPECK} cells float in free space, {count / area:.1f} a"
            " square metre",
            "erase them if nothing stands there",
            "a filter's error grows by up to 1.8 times",
        )


def _count_specks(grid: OccupancyGrid, limit: float) -> int:
    """Count the specks, or their cells if these are no more than a limit."""
    import cv2

    specks = find_specks(grid)
    cells = int(np.count_nonzero(specks))
    if cells <= limit:  # each has a cell at least
        return cells
    return int(cv2.connectedComponents(specks.view(np.uint8), connectivity=8)[0]) - 1


@dataclass(frozen=True, eq=False, repr=False)
class MapFaults(Result):
    """The faults of a map; made by `find_faults`."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "faults", ("faults.json", "faults.png", "faults.csv")
    )

    grid: OccupancyGrid
    """The map."""
    faults: tuple[MapFault, ...]
    """The faults, the most important first."""
    corrected_map: OccupancyGrid
    """The map with corrected thresholds; the faults of walls and cells are found in it."""

    def __repr__(self) -> str:
        kinds = ", ".join(fault.kind for fault in self) or "none"
        return f"MapFaults({self.grid.name or 'map'}: {kinds})"

    def __iter__(self) -> Iterator[MapFault]:
        return iter(self.faults)

    def __len__(self) -> int:
        return len(self.faults)

    @property
    def is_solid(self) -> bool:
        """True if walls are black inside so that a filter gets lost, and hollowing them helps."""
        return any(fault.kind == "solid walls" for fault in self)

    @cached_property
    def cells(self) -> Bools:
        """Cells of walls black inside, of painted unknown space and of specks, (H, W)."""
        is_faulty, kinds = (
            np.zeros(self.corrected_map.shape, np.bool_),
            {fault.kind for fault in self},
        )
        if kinds & {"solid walls", "thick walls", "painted unknown"}:
            is_faulty |= mark_enclosed_wall_cells(self.corrected_map)
        if "specks" in kinds:
            is_faulty |= self.specks
        return is_faulty

    @cached_property
    def specks(self) -> Bools:
        """Cells of specks, (H, W), see `find_specks`."""
        return find_specks(self.corrected_map)

    @property
    def repaired_map(self) -> OccupancyGrid:
        """The map for a filter: thresholds corrected, specks removed, solid walls hollowed."""
        grid, kinds = self.corrected_map, {fault.kind for fault in self}
        if "specks" in kinds:
            grid = replace(grid, cells=np.where(self.specks, np.uint8(FREE), grid.cells))
        # Where beams end deep in the walls the truth lies inside, and hollowing may harm.
        return hollow_walls(grid) if self.is_solid and "deep walls" not in kinds else grid

    def without_repair_remedies(self) -> MapFaults:
        """Return the faults without the advice to repair the map for the filter."""
        repaired_kinds = {"solid walls", "painted unknown"}
        faults = (
            replace(fault, remedy="") if fault.kind in repaired_kinds else fault for fault in self
        )
        return replace(self, faults=tuple(faults))

    def check_is_no_mask(self) -> None:
        """Raise a ConfigError if the map is a mask for a costmap filter."""
        for fault in self:
            if fault.kind == "mask":
                raise ConfigError(f"{self.grid.name or 'the map'}: {fault.sentence}")

    def summary(self) -> dict[str, object]:
        """Return the faults as plain data for JSON."""
        return {
            "map": {"name": self.grid.name, "digest": self.grid.digest},
            "faults": [
                {**row, "boxes": [list(box) for box in fault.boxes]}
                for row, fault in zip(self.table().records(), self, strict=True)
            ],
        }

    def table(self) -> Table:
        """Return a table with one row per fault."""
        columns = [
            TableColumn("kind", title="fault"),
            TableColumn("what", title="what", value=attrgetter("message")),
            TableColumn("where", title="where", value=attrgetter("place_text")),
            TableColumn("costs", title="costs", value=attrgetter("impact")),
            TableColumn("mend", title="mend", value=attrgetter("remedy")),
            TableColumn("sure", value=attrgetter("is_certain")),
        ]
        return Table.from_records(columns, self)

    def figure(self) -> Figure:
        """Draw the map with the cells of its faults in colour, and the faults' kinds."""
        from locplan.maps.figures import faults_figure

        return faults_figure(self)

    def report(self) -> str:
        """Return one sentence per fault."""
        return format_faults(self)


def format_faults(faults: MapFaults) -> str:
    """Return one sentence per fault."""
    if not faults.faults:
        return f"{faults.grid.name or 'the map'}: no fault that the map alone shows"
    return "\n".join(f"{fault.kind}: {fault.sentence}" for fault in faults)


def faults(grid: OccupancyGrid, source: MapSource | None = None) -> MapFaults:
    """Find what misleads: solid walls, painted unknown, specks, thresholds, open edges, masks.

    Solid walls are found by simulated scans, in some tenths of a second the first time that a map
    is seen by a process; no drive is needed.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    source : MapSource, optional
        How its pixels were read, see `read_map`; without it only the cells are looked at.

    Returns
    -------
    MapFaults
        The faults, the most important first; none if all seems well.

    Raises
    ------
    MapError
        If it is no map.

    See Also
    --------
    hollowed : The map without the inside of its walls.

    Examples
    --------
    >>> len(faults(OccupancyGrid([[127, 0, 0, 0], [127, 0, 254, 0], [127, 0, 0, 0]], 0.05)))
    0
    """
    check_grid(grid)
    file_faults = (
        (*find_mask_faults(grid, source), *find_threshold_faults(grid, source)) if source else ()
    )
    # No filter has a mask for its map, whose areas are no walls.
    is_mask = any(fault.kind == "mask" for fault in file_faults)
    corrected_map = grid if is_mask else with_corrected_thresholds(grid, source)
    walls = (
        ()
        if is_mask
        else (
            *find_wall_faults(corrected_map, measure_solidity(corrected_map)),
            *find_painted_unknown_faults(corrected_map),
        )
    )
    return MapFaults(
        grid,
        (*file_faults, *walls, *find_cell_faults(corrected_map), *find_origin_faults(grid)),
        corrected_map,
    )

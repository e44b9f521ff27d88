"""Scan matching: find the poses that explain a scan, on a whole map or near a pose."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import (
    Settings,
    check_instance,
    check_number,
    check_positive,
    checked_setting,
    set_frozen_fields,
)
from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets, Singles
from locplan._support.poses import make_rotation_matrix, move_ends_to_poses, wrap_angles
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError
from locplan.field.beams import find_wall_surface_cells
from locplan.field.scan import Scan
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import OCCUPIED
from locplan.robots.lidar import Lidar

TURNS = 96
"""Number of beams in a full circle, and of turns at which a scan is compared with the map."""
STEP = 2 * math.pi / TURNS
"""Angle between beams [rad]."""
GLOBAL_EFFECTIVE_BEAMS = 36.0
"""Number of independent beams in a full circle, fitted to global matches of simulated scans."""


@dataclass(frozen=True, kw_only=True, repr=False)
class MatchingSettings(Settings):
    """Settings for matching scans of a lidar with a whole map.

    The loss of a pose is ``global_effective_beams / 96`` times the sum over all returns of
    ``-ln((1 - z_rand) exp(-D^2 / 2 sigma_hit^2) + z_rand)``, with D the distance of the beam's end
    from the nearest wall. A full circle has 96 beams; a narrower field of view has fewer.

    Raises
    ------
    ConfigError
        If a value is out of range.
    """

    lidar: Lidar
    """The lidar with its range, field of view and mount; its number of beams is not used."""
    global_effective_beams: float = checked_setting(GLOBAL_EFFECTIVE_BEAMS, check_positive, "beams")
    """Number of independent beams in a full circle, above 0."""
    sigma_hit: float = checked_setting(0.1, check_positive, "m")
    """Standard deviation of the distance between a beam's end and a wall [m], above 0; at least a
    cell is used."""
    z_rand: float = checked_setting(0.05, check_positive)
    """Share of beams that end anywhere, above 0 and below 1."""
    robot_radius: float = checked_setting(0.25, 0.0)
    """Minimum distance of a pose from walls [m], >= 0."""
    shortlisted: int = checked_setting(600, 1, 100_000)
    """Number of pairs of a place and a turn to refine, before similar pairs are dropped, 1 to
    100,000."""

    def __post_init__(self) -> None:
        check_instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        super().__post_init__()
        if self.z_rand >= 1:
            raise ConfigError(f"z_rand must be below 1, not {self.z_rand:g}")

    def sigmas(self, resolution: float) -> Floats:
        """Return the decreasing standard deviations for refining a pose, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of the map's cells [m].
        """
        levels = [max(factor * self.sigma_hit, resolution) for factor in (4, 2, 1)]
        return np.array(sorted(set(levels), reverse=True))

    @property
    def bearings(self) -> Floats:
        """Directions of the compared beams, relative to the robot's heading, (96,) [rad]."""
        return np.arange(TURNS, dtype=np.float64) * STEP

    @property
    def is_in_view(self) -> Bools:
        """Mask of the bearings in the lidar's field of view, (96,)."""
        angle_offsets = (self.bearings - self.lidar.mount_yaw + math.pi) % (2 * math.pi) - math.pi
        half = math.radians(self.lidar.field_of_view_deg) / 2
        return np.asarray(np.abs(angle_offsets) <= half + 1e-9)

    def select_ranges(self, ranges: Floats) -> Floats:
        """Select the ranges of scans at `bearings`.

        Parameters
        ----------
        ranges : (n, beams) array
            Distances along all the lidar's beams [m], in the order of ``lidar.angles``.

        Returns
        -------
        (n, 96) array
            Range of the beam nearest to each bearing [m]; infinite without a return within the
            lidar's limits, NaN outside of the field of view.
        """
        beams = self.lidar.angles + self.lidar.mount_yaw
        angle_offsets = (self.bearings[:, None] - beams + math.pi) % (2 * math.pi) - math.pi
        bearing_ranges = ranges[:, np.abs(angle_offsets).argmin(axis=1)]
        returns = (bearing_ranges > self.lidar.min_range) & (bearing_ranges <= self.lidar.range)
        return np.where(self.is_in_view, np.where(returns, bearing_ranges, np.inf), np.nan)

    def make_beams(self, forward: float, left: float) -> Any:
        """Make the compared beams of a lidar with this mount, for the kernels.

        Parameters
        ----------
        forward, left : float
            Mount of the lidar ahead and to the left of the robot's centre [m].
        """
        mounted = {"forward": forward, "left": left, "yaw": 0.0}
        return self.lidar.to_kernel_settings()._replace(angles=self.bearings, **mounted)

    @property
    def max_loss_nats(self) -> float:
        """Maximum loss of one beam [nats]."""
        return -math.log(self.z_rand) * self.global_effective_beams / TURNS


BAND = 1 << 20
"""Number of cells of a strip, which limits memory."""


def make_loss_tables(grid: OccupancyGrid, matching: MatchingSettings, can_stand: Bools) -> Any:
    """Make tables of the losses around the map at each standard deviation, for the kernels."""
    import cv2

    from locplan.recordings.kernels.scan_losses import LossTables

    sigmas, resolution = matching.sigmas(grid.resolution), grid.resolution
    margin = math.ceil(4 * sigmas[0] / resolution) + 2
    clear = 1 - np.pad(find_wall_surface_cells(grid.cells == OCCUPIED), margin)
    height, width = clear.shape
    levels = _tabulate_losses(sigmas, matching.z_rand, resolution, math.hypot(height, width))
    far = levels.shape[1] - 1
    reach = math.isqrt(far) + 1
    corners = np.empty((len(sigmas), height, width), np.uint32)
    rows = max(reach, BAND // width)
    for top in range(0, height, rows):
        above = max(0, top - reach)  # walls farther away have no effect
        part = clear[above : top + rows + 1 + reach]
        part = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        part = np.minimum(part[top - above : top - above + rows + 1], reach)
        count = min(rows, height - top)
        squares = np.full((count + 1, width + 1), far)
        squares[: len(part), :-1] = np.minimum(np.rint(part * part), far)
        for level, words in zip(levels, corners[:, top : top + count], strict=True):
            steps = level[squares]
            words[:] = steps[:-1, :-1]
            for n, neighbour_steps in enumerate((steps[:-1, 1:], steps[1:, :-1], steps[1:, 1:]), 1):
                words |= neighbour_steps << np.uint32(8 * n)
    # Steps of the refinement: several only at the smallest standard deviation.
    steps = sigmas[:, None] / resolution * (0.5, 0.25, 0.125)
    steps[:-1, 1:] = 0
    return LossTables(
        corners.reshape(len(sigmas), -1),
        can_stand.astype(np.uint8),
        margin=margin,
        width=width,
        height=height,
        steps=steps,
    )


def _tabulate_losses(
    sigmas: Floats, z_rand: float, resolution: float, max_distance: float
) -> NDArray[np.uint32]:
    """Tabulate losses by squared distance, 0, 1, ... cells^2, for each standard deviation.

    The last loss is `TOP`; `max_distance` is the maximum distance on the map [cells].
    """
    from locplan.recordings.kernels.scan_losses import TOP

    # The reach ends where a hit is half a step of loss above z_rand.
    excess = z_rand * math.expm1(-math.log(z_rand) / TOP / 2) / (1 - z_rand)
    reach = float(sigmas[0]) * math.sqrt(max(0.0, -2 * math.log(excess))) / resolution
    squares = np.arange(math.ceil(min(reach + 1, max_distance)) ** 2 + 2)
    distance = np.sqrt(squares.astype(np.float32)) * np.float32(resolution)
    hit = (1 - z_rand) * np.exp(-0.5 * (distance / sigmas[:, None]) ** 2)
    losses = np.rint(TOP * np.log(hit + z_rand) / math.log(z_rand)).astype(np.uint32)
    losses[:, -1] = TOP
    return losses


class PosePosteriors(NamedTuple):
    """Posteriors of n scans around n poses, in world coordinates."""

    mean: Floats
    """Mean offset from the pose, (n, 3) [m, m, rad]."""
    covariance: Floats
    """Covariance around the mean, (n, 3, 3) [m, m, rad]."""
    best: Floats
    """Most probable offset, (n, 3) [m, m, rad]."""
    summary: Floats
    """Entropy [nat], ambiguity, and log-likelihood per return at the best offset, (n, 3)."""


class ScanMatcher:
    """Matcher of scans around poses, with the likelihood field of a map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    settings : Scan
        The search window, and the likelihood of beams.
    """

    def __init__(self, grid: OccupancyGrid, settings: Scan) -> None:
        self.grid, self.settings = grid, settings
        self.window = settings.lattice(grid.resolution)

    @classmethod
    def for_lidar(cls, grid: OccupancyGrid, lidar: Lidar) -> ScanMatcher:
        """Make a matcher with the default settings for a lidar.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        lidar : Lidar
            The lidar, with its mount on the robot.
        """
        # A scan of 180 deg counts as this number of independent beams.
        return cls(grid, Scan(lidar, effective_beams=15.0))

    @cached_property
    def kernel_arguments(self) -> Any:
        """Likelihood field and offsets in the form of the kernels."""
        from locplan._support.kernels.likelihood import make_scan_lattice

        field = self.settings.prepare(self.grid.cells, self.grid.resolution).likelihood
        return field, make_scan_lattice(self.window.half_steps, self.window.angles)

    def compute_posteriors(self, on_robot: Floats, poses: Floats) -> PosePosteriors:
        """Compute the posteriors of scans around poses, from the centre of each pose's cell.

        Parameters
        ----------
        on_robot : (n, beams, 2) array
            Ends of all beams in the robot's frame [m]; NaN without a return.
        poses : (n, 3) array
            Poses in the world, on the map [m, m, rad].
        """
        from locplan.recordings.kernels.matches import write_recorded_posteriors

        count, compared = len(poses), self.settings.nearest_beam_indices
        ends = move_ends_to_poses(on_robot[:, compared], poses)
        row, col = self.grid.world_to_grid(*poses[:, :2].T)
        cells = np.column_stack([np.floor(row), np.floor(col)]).astype(np.int64)
        ends_row, ends_col = self.grid.world_to_grid(*np.moveaxis(ends, -1, 0))
        middle = cells + 0.5
        from_cell = np.stack([ends_col - middle[:, 1, None], ends_row - middle[:, 0, None]], -1)
        mean, covariance = np.empty((count, 3)), np.empty((count, 3, 3))
        best, summary = np.zeros((count, 3), np.int64), np.empty((count, 3))
        posterior_arrays = mean, covariance, best, summary
        field, lattice = self.kernel_arguments
        write_recorded_posteriors(
            field, lattice, cells, from_cell, self.settings.temperature, *posterior_arrays
        )
        turn, steps = make_rotation_matrix(self.grid.origin[2]), self.window.steps
        return PosePosteriors(
            mean * steps @ turn.T,
            turn @ (covariance * np.outer(steps, steps)) @ turn.T,
            best * steps @ turn.T,
            summary,
        )


BLOCK_BAND = 1 << 20
"""Number of cells that are searched at once, which limits memory."""


@dataclass(frozen=True, eq=False)
class RangeDatabase:
    """Expected ranges at all reachable places of a map, and tables of losses.

    Users keep a `ScanDatabase`, which computes this when it is needed.
    """

    grid: OccupancyGrid
    """The map."""
    matching: MatchingSettings
    """The lidar, and the settings of matching."""
    fits: Bools
    """Mask of the reachable cells of the robot's centre, (H, W)."""
    positions: Floats
    """Positions x, y of the lidar with known ranges, (n, 2) [cells]."""
    codes: Octets
    """Encoded ranges, in blocks of 64 places."""
    tables: Any
    """Tables of losses in the form of the kernels."""
    squares: Octets
    """Empty squares around the map's cells, in the form of the kernels."""

    @cached_property
    def lidar_position(self) -> tuple[float, float]:
        """Position of the lidar in the robot's frame, forward and left [cells]."""
        lidar, resolution = self.matching.lidar, self.grid.resolution
        return lidar.mount_x / resolution, lidar.mount_y / resolution

    def simulate_scans(self, poses: Floats) -> Floats:
        """Compute the expected ranges at poses, (n, 96) [m].

        Ranges are at the bearings of the settings; infinite without a return, NaN outside of the
        field of view.

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading on the map [cells, cells, rad].
        """
        lidar = self.matching.lidar
        ranges = _cast_ranges(self, poses, lidar.mount_x, lidar.mount_y)
        ranges[:, ~self.matching.is_in_view] = np.nan
        return ranges

    def encode_ranges(self, ranges: Floats) -> Octets:
        """Encode ranges as bytes in steps of 1/16 m, modulo 16 m.

        Parameters
        ----------
        ranges : array
            Ranges, infinite without a return [m].
        """
        # No return is encoded 2 m beyond the lidar's range, where no wall is seen.
        no_return = 16 * self.matching.lidar.range + 32
        counts = np.where(np.isfinite(ranges), 16 * ranges, no_return)
        return np.asarray(np.floor(counts).astype(np.int64) % 256, np.uint8)

    def convert_to_world(self, poses: Floats) -> Floats:
        """Convert poses on the map to world coordinates, (n, 3) [m, m, rad].

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading on the map [cells, cells, rad].
        """
        x, y = self.grid.grid_to_world(poses[:, 1], poses[:, 0])
        heading = wrap_angles(poses[:, 2] + self.grid.origin[2])
        return np.column_stack([x, y, heading])


def make_range_database(grid: OccupancyGrid, matching: MatchingSettings) -> RangeDatabase:
    """Compute the expected ranges of a lidar at all reachable places of a map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    matching : MatchingSettings
        The lidar, and the settings of matching.

    Raises
    ------
    ConfigError
        If the robot fits nowhere on the map, or the map has no walls.
    """
    from locplan._support.kernels.rays import compute_empty_squares

    occupied = grid.cells == OCCUPIED
    if not occupied.any():
        raise ConfigError(f"{grid.name or 'the map'} has no walls; use another map")
    fits = find_reachable_cells(grid, matching.robot_radius)
    if not fits.any():
        raise ConfigError(
            f"a robot of radius {matching.robot_radius:g} m fits nowhere on"
            f" {grid.name or 'the map'}; use a smaller radius"
        )
    tables = make_loss_tables(grid, matching, fits)
    positions = select_spaced_places(0.4, _find_lidar_cells(grid, matching, fits), grid.resolution)
    squares = compute_empty_squares(occupied)
    range_database = RangeDatabase(
        grid, matching, fits, positions, np.empty(0, np.uint8), tables, squares
    )
    return dataclasses.replace(range_database, codes=_encode_all_places(range_database))


def _encode_all_places(database: RangeDatabase) -> Octets:
    """Encode the ranges at all places, for `RangeDatabase.codes`."""
    count = len(database.positions)
    codes = np.empty((count, TURNS), np.uint8)
    for first in range(0, count, 1 << 14):  # blocks limit memory
        positions = database.positions[first : first + (1 << 14)]
        poses = np.column_stack([positions, np.zeros(len(positions))])
        ranges = _cast_ranges(database, poses, 0.0, 0.0)
        codes[first : first + len(positions)] = database.encode_ranges(ranges)
    return arrange_in_blocks(np.hstack([codes, codes]))


def arrange_in_blocks(codes: Octets) -> Octets:
    """Arrange codes of n places, (n, turns), in blocks for `RangeDatabase.codes`."""
    from locplan._support.kernels.simd import OCTETS

    blocks = -(-len(codes) // OCTETS)
    padded = np.zeros((blocks * OCTETS, codes.shape[1]), np.uint8)
    padded[: len(codes)] = codes
    return padded.reshape(blocks, OCTETS, -1).transpose(0, 2, 1).reshape(-1)


def find_reachable_cells(grid: OccupancyGrid, robot_radius: float) -> Bools:
    """Find the free cells where the robot fits, without small regions, (H, W)."""
    import cv2

    fits = (grid.free & ~grid.cells_near_walls(robot_radius - 1e-9)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(fits, connectivity=4)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    large = areas >= max(1.0, 0.1 * areas.max())
    large[0] = False
    return np.asarray(large[labels])


def select_spaced_places(spacing: float, is_marked: Bools, resolution: float) -> Floats:
    """Select one marked cell per square, next to the square's middle; return centres (n, 2).

    Parameters
    ----------
    spacing : float
        Edge of the squares [m].
    is_marked : (H, W) array of bool
        The cells.
    resolution : float
        Edge of a cell [m].
    """
    block_edge = max(1, round(spacing / resolution))
    height, width = is_marked.shape
    rows = block_edge * max(1, BLOCK_BAND // (block_edge * width))
    places = [np.empty((0, 2))]
    for top in range(0, height, rows):
        places.append(_pick_cell_per_block(is_marked[top : top + rows], block_edge))
        places[-1][:, 1] += top
    return np.concatenate(places) + 0.5


def _pick_cell_per_block(is_marked: Bools, block_edge: int) -> Floats:
    """Find the marked cells next to the middles of squares, as columns and rows (n, 2)."""
    rows, cols = np.nonzero(is_marked)
    block = (rows // block_edge) * (is_marked.shape[1] // block_edge + 1) + cols // block_edge
    offsets = (2 * (rows % block_edge) + 1 - block_edge) ** 2 + (
        2 * (cols % block_edge) + 1 - block_edge
    ) ** 2
    order = np.lexsort([offsets, block])  # equally near cells keep the order of their rows
    block = block[order]
    middle_cell_indices = order[np.concatenate([block[:1] >= 0, block[1:] != block[:-1]])]
    return np.column_stack([cols[middle_cell_indices], rows[middle_cell_indices]]).astype(
        np.float64
    )


def _find_lidar_cells(grid: OccupancyGrid, matching: MatchingSettings, can_stand: Bools) -> Bools:
    """Find the cells that the lidar can reach."""
    import cv2

    lidar = matching.lidar
    reach = math.ceil(math.hypot(lidar.mount_x, lidar.mount_y) / grid.resolution)
    if reach == 0:
        return can_stand
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near = cv2.dilate(can_stand.astype(np.uint8), around)
    return np.asarray((near > 0) & (grid.cells != OCCUPIED))


def _cast_ranges(database: RangeDatabase, poses: Floats, forward: float, left: float) -> Floats:
    """Cast a full circle of beams at poses x, y, heading, (n, 96) [m]."""
    from locplan.recordings.kernels.matches import cast_ranges

    beams = database.matching.make_beams(forward, left)
    ranges = np.empty((len(poses), TURNS))
    at = np.ascontiguousarray(poses[:, [1, 0, 2]])
    cast_ranges(database.squares, database.grid.resolution, at, beams, ranges)
    return ranges


CLEARANCE = 0.1
"""Default minimum distance of a pose from walls [m]; less than the radius of robots, because
recorded poses and maps have errors."""


@dataclass(frozen=True, eq=False, repr=False)
class ScanDatabase:
    """Expected scans of a lidar at all places of a map, computed when they are first needed.

    `locate` and `find_ambiguous_places` make one by default, and keep the last four.

    Raises
    ------
    ConfigError
        If a value is out of range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> ScanDatabase(grid, locplan.Lidar(range=8.0))
    ScanDatabase(places, lidar, 8 m, 360°)
    """

    grid: OccupancyGrid
    """The map."""
    lidar: Lidar
    """The lidar, with its mount on the robot."""
    clearance: float = CLEARANCE
    """Minimum distance of the robot's centre from walls [m], >= 0."""

    def __post_init__(self) -> None:
        check_grid(self.grid)
        check_instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        set_frozen_fields(self, clearance=check_number("clearance", self.clearance, 0.0))

    def __repr__(self) -> str:
        return f"ScanDatabase({self.grid.name or 'map'}, {self.lidar.title})"

    @cached_property
    def full_database(self) -> RangeDatabase:
        """Expected ranges at all places.

        Raises
        ------
        ConfigError
            If the map has no walls, or no place with this clearance.
        """
        return make_range_database(
            self.grid, MatchingSettings(lidar=self.lidar, robot_radius=self.clearance)
        )

    @cached_property
    def matcher(self) -> ScanMatcher:
        """Matcher for the covariance of a match."""
        return ScanMatcher.for_lidar(self.grid, self.lidar)

    @cached_property
    def max_loss_nats(self) -> float:
        """Maximum loss of one compared beam [nats]."""
        matching = self.full_database.matching
        beams = len(self.matcher.settings.nearest_beam_indices)
        return matching.max_loss_nats * float(matching.is_in_view.sum()) / beams

    def select_compared_ends(self, on_robot: Floats) -> Singles:
        """Select the returns among the beams that `locplan.Scan` compares, (2, k) [cells].

        Parameters
        ----------
        on_robot : (beams, 2) array
            Ends of all beams in the robot's frame [m]; NaN without a return.
        """
        ends = on_robot[self.matcher.settings.nearest_beam_indices] / self.grid.resolution
        return np.ascontiguousarray(ends[np.isfinite(ends[:, 0])].T, np.float32)

    def select_nearby(self, xy: Floats, within: float) -> RangeDatabase:
        """Select the expected ranges at places near some positions.

        Parameters
        ----------
        xy : (n, 2) array
            Positions in the world [m].
        within : float
            Maximum distance between a place and a position [m].

        Raises
        ------
        ConfigError
            If the robot fits nowhere within this distance.
        """
        grid, full_database = self.grid, self.full_database
        is_near = full_database.fits & (_compute_distances(grid, xy) <= within)
        if not is_near.any():
            raise ConfigError(
                f"the robot fits nowhere within {within:g} m of the {len(xy)} positions; check that"
                f" they are in the frame of {grid.name or 'the map'}"
            )
        return _restrict_database(full_database, is_near)


@lru_cache(maxsize=4)
def get_database(grid: OccupancyGrid, lidar: Lidar, clearance: float) -> ScanDatabase:
    """Return the cached database of a map and a lidar, or a new one."""
    return ScanDatabase(grid, lidar, clearance)


def resolve_database(
    grid: OccupancyGrid, lidar: Lidar, clearance: float, database: ScanDatabase | None
) -> ScanDatabase:
    """Check a database, or by default return a cached or new one.

    Parameters
    ----------
    grid : OccupancyGrid
        The map of the database.
    lidar : Lidar
        The lidar of the database.
    clearance : float
        Clearance of a default database [m].
    database : ScanDatabase, optional
        The database to check.

    Raises
    ------
    ConfigError
        If the database is for another map or lidar, or the clearance is out of range.
    """
    if database is None:
        database = get_database(grid, lidar, check_number("clearance", clearance, 0.0))
    check_instance("database", database, ScanDatabase)
    if database.grid != grid or database.lidar != lidar:
        raise ConfigError("the database is for another map or lidar; use ScanDatabase(grid, lidar)")
    return database


def _compute_distances(grid: OccupancyGrid, xy: Floats) -> Singles:
    """Compute the distance of each cell from the nearest position, (H, W) [m]."""
    import cv2

    row, col = (np.floor(coordinate).astype(np.int64) for coordinate in grid.world_to_grid(*xy.T))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    is_elsewhere = np.ones(grid.shape, np.uint8)
    is_elsewhere[row[inside], col[inside]] = 0
    if not inside.any():
        return np.full(grid.shape, np.inf, np.float32)
    cells = cv2.distanceTransform(is_elsewhere, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells * np.float32(grid.resolution))


def _restrict_database(database: RangeDatabase, can_stand: Bools) -> RangeDatabase:
    """Restrict a database to robot positions in a mask of cells (H, W)."""
    from locplan._support.kernels.simd import OCTETS

    near = _find_lidar_cells(database.grid, database.matching, can_stand)
    col, row = np.floor(database.positions.T).astype(np.int64)
    place_numbers = np.flatnonzero(near[row, col])
    places = database.codes.reshape(-1, 2 * TURNS, OCTETS).transpose(0, 2, 1)
    return dataclasses.replace(
        database,
        fits=can_stand,
        positions=database.positions[place_numbers],
        codes=arrange_in_blocks(places.reshape(-1, 2 * TURNS)[place_numbers]),
        tables=database.tables._replace(fits=can_stand.astype(np.uint8)),
    )


BatchResult = TypeVar("BatchResult")
MIN_RETURNS = 5
"""Minimum number of returns to match a scan."""
MODE_DISTANCE, MODE_TURN = 0.8, 0.5
"""Minimum distance [m] and angle [rad] between two modes."""
MAX_MODE_EXCESS = 8.0
"""Maximum excess of a mode over the best one [nats]."""
WRONG_DISTANCE = 2.0
"""Maximum distance of a correct match from the true position [m]."""


@dataclass(frozen=True, eq=False)
class ScanModes:
    """Local optima of the pose of a scan on a map, the best first."""

    poses: Floats
    """x, y [cells] and heading [rad] of each mode on the map, (n, 3)."""
    losses: Floats
    """Loss of each mode, (n,) [nats]."""
    n_returns: int
    """Number of returns of the scan; below `MIN_RETURNS` there are no modes."""


@dataclass(frozen=True, eq=False)
class ScanOnMap:
    """A scan to be matched with a whole map.

    Poses are x, y [cells] and heading [rad] on the map.
    """

    database: RangeDatabase
    """Expected ranges at all places of the map."""
    ranges: Floats
    """Ranges at the bearings of the settings, (96,) [m]; infinite without a return, NaN outside of
    the field of view."""

    @cached_property
    def has_return(self) -> Bools:
        """Mask of the beams with a return, (96,)."""
        return np.isfinite(self.ranges)

    @cached_property
    def ends(self) -> Singles:
        """Ends of the returns in the robot's frame, forward and left, (2, k) [cells]."""
        database = self.database
        bearing = database.matching.bearings[self.has_return]
        distances = self.ranges[self.has_return] / database.grid.resolution
        forward, left = database.lidar_position
        ends = np.array([forward + distances * np.cos(bearing), left + distances * np.sin(bearing)])
        return ends.astype(np.float32)

    @cached_property
    def turn_lever(self) -> float:
        """Root mean square of the ranges, to compare turns with shifts [cells]."""
        distances = self.ranges[self.has_return] / self.database.grid.resolution
        return max(1.0, math.sqrt(float((distances**2).mean())))

    @property
    def _nats_per_step(self) -> float:
        """Size of one step of the kernels' losses [nats]."""
        from locplan.recordings.kernels.scan_losses import TOP

        return self.database.matching.max_loss_nats / TOP

    def find_modes(self, home: Floats | None = None) -> ScanModes:
        """Find the modes of the scan on the whole map.

        Parameters
        ----------
        home : (3,) array, optional
            An additional start. The best mode more than 2 m away from it is always found.
        """
        return self.refine_starts(self.shortlist_starts(), home)

    def shortlist_starts(self) -> Floats:
        """Select the poses whose expected ranges are most similar to the scan, (n, 3)."""
        from locplan.recordings.kernels.matches import find_best_place_turn_pairs
        from locplan.recordings.kernels.scan_losses import find_distinct_poses

        database, returns = self.database, self.has_return
        matching, resolution = database.matching, database.grid.resolution
        if returns.sum() < MIN_RETURNS:
            return np.empty((0, 3))
        # Every fourth beam first, so that the first beams cover all directions.
        order = np.concatenate([np.arange(first, TURNS, 4) for first in (0, 2, 1, 3)])
        compared = order[returns[order]]
        codes = database.encode_ranges(self.ranges)[compared]
        count = len(database.positions)
        # The cost of a beam is bounded at a difference of eight codes, half a metre.
        _, pairs = find_best_place_turn_pairs(
            database.codes, count, compared, codes, 8, matching.shortlisted
        )
        place, turn = np.divmod(pairs, TURNS)
        heading = turn * STEP
        forward, left = database.lidar_position
        cos, sin = np.cos(heading), np.sin(heading)
        levers = np.column_stack([cos * forward - sin * left, sin * forward + cos * left])
        starts = np.column_stack([database.positions[place] - levers, heading])
        # A pair within 0.6 m and 0.25 rad of a better one is not refined.
        return np.asarray(
            starts[find_distinct_poses(starts, np.arange(len(starts)), 0.6 / resolution, 0.25)]
        )

    def refine_starts(self, starts: Floats, home: Floats | None = None) -> ScanModes:
        """Refine starts to modes.

        Parameters
        ----------
        starts : (n, 3) array
            The poses from `shortlist_starts`.
        home : (3,) array, optional
            See `find_modes`.
        """
        from locplan.recordings.kernels.scan_losses import find_modes

        resolution = self.database.grid.resolution
        count = int(self.has_return.sum())
        if count < MIN_RETURNS:
            return ScanModes(np.empty((0, 3)), np.empty(0), count)
        poses, losses = find_modes(
            self.database.tables,
            self.ends,
            starts if home is None else np.concatenate([home[None], starts]),
            self.turn_lever,
            MAX_MODE_EXCESS / self._nats_per_step,
            8 / self._nats_per_step,  # maximum gain of the first refinement
            np.full(2, np.nan) if home is None else home[:2],
            WRONG_DISTANCE / resolution,
            MODE_DISTANCE / resolution,
            MODE_TURN,
        )
        losses = losses * self._nats_per_step
        order = np.argsort(losses, kind="stable")
        return ScanModes(poses[order], losses[order], count)


def run_in_batches(
    work: Callable[[Ints], Sequence[BatchResult]],
    count: int,
    threads: int,
    progress: ProgressCallback | None = None,
    batch_size: int = 16,
) -> list[BatchResult]:
    """Compute results for the numbers 0 to count - 1 in batches, by threads.

    Parameters
    ----------
    work : callable
        Returns the results for an array of numbers.
    count : int
        Number of results.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with (done, total) numbers.
    batch_size : int, default 16
        Number of results of a batch.
    """
    results: list[BatchResult] = []
    batches = np.array_split(np.arange(count), max(1, -(-count // batch_size)))
    with ThreadPoolExecutor(threads) as pool:
        for batch_results in pool.map(work, batches):
            results.extend(batch_results)
            if progress:
                progress(len(results), count)
    return results

"""Fit of a map to recorded drives: position, resolution, and walls that contradict the scans."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_instance, make_printable
from locplan._support.intervals import Interval, assign_blocks, bootstrap_statistics
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.poses import (
    apply_motions,
    compute_motions,
    move_ends_to_poses,
    move_poses,
    wrap_angles,
)
from locplan._support.progress import ProgressCallback, split_progress
from locplan.errors import RecordingError
from locplan.field.covariance import position_axes
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.map_faults import MapFault, find_bounding_boxes
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.recordings.calibration import MAD, RecordingRangeMatcher
from locplan.recordings.evaluation import (
    MIN_FIT_SHARE,
    find_cells_near_walls,
    look_up_cells,
    match_scans,
)
from locplan.recordings.location import locate_drive
from locplan.recordings.matching import ScanDatabase
from locplan.recordings.recording import Recording

RANGE_SCANS, MIN_BEAMS = 100, 12
"""Number of compared scans of a drive, and minimum number of beams of a scan."""
FAR, FAR_CELLS, FAR_OFF = 0.2, 4, 0.06
"""Maximum difference between measured and expected range: metres or cells, plus a share of the
range."""
GRAZING = 2.0
"""Maximum change of a range per movement of the robot across the wall, to drop grazing beams."""
OFF, SURELY_OFF = 0.007, 0.005
"""Minimum difference of the factor from 1 for a wrong resolution, and of its whole interval."""
DEEP = 1.5
"""Depth of beams' ends behind the map's surfaces above which the walls are too thick [cells]."""


@dataclass(frozen=True)
class RangeFit:
    """Scale and depth of measured ranges against a map, with 95 % intervals over blocks of 10 m."""

    factor: Interval
    """Ratio of measured to expected ranges."""
    depth: Interval
    """Distance of beams' ends behind the map's surfaces, across the walls [m]."""

    @property
    def is_scaled(self) -> bool:
        """True if the map's resolution is significantly wrong."""
        value, low, high = (bound - 1 for bound in self.factor)
        return abs(value) >= OFF and (low > SURELY_OFF or high < -SURELY_OFF)

    def faults(self, grid: OccupancyGrid) -> Iterator[MapFault]:
        """Yield the faults of the map that the ranges show.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        if self.is_scaled:
            value, low, high = (100 * (bound - 1) for bound in self.factor)
            true = grid.resolution * self.factor.value
            yield MapFault(
                "resolution",
                f"ranges differ from the map by {value:+.1f} % [{low:+.1f}, {high:+.1f}]:"
                f" resolution {grid.resolution:.4g} should be {true:.3g}",
                f"if the lidar's ranges are right, set resolution: {true:.3g} in the map's YAML and"
                " scale its origin by the same factor",
                is_certain=True,
            )
        cells, low, _ = (bound / grid.resolution for bound in self.depth)
        if cells >= DEEP and low > 1:
            yield MapFault(
                "deep walls",
                f"beams end {cells:.1f} cells ({100 * self.depth.value:.0f} cm) behind the map's"
                " surfaces: walls are inflated, or blurred by mapping",
                "give the filter a map without inflated walls; these walls are not hollowed,"
                " because the true surfaces are inside",
                is_certain=True,
            )


def fit_ranges(grid: OccupancyGrid, recordings: Sequence[Recording]) -> RangeFit:
    """Compare measured with expected ranges, at the best pose of each scan.

    A measured range is the expected range times a factor, plus a depth behind the map's surfaces.
    Errors of the poses are fitted as well.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recordings : sequence of Recording
        The drives, with poses accurate to about 0.1 m.
    """
    once, _ = _collect_equations(grid, recordings, 1.0)
    if not once:
        nothing = Interval(math.nan, math.nan, math.nan)
        return RangeFit(nothing, nothing)
    # Repeat with nearly correct ranges: at first, the poses absorb part of the factor.
    first = 1 + float(_solve_least_squares(once, np.ones(len(once)))[0])
    scan_equations, blocks = _collect_equations(grid, recordings, first)
    factor, depth = bootstrap_statistics(
        lambda weights: _solve_least_squares(scan_equations, weights), blocks, 200
    )
    return RangeFit(Interval(*(first * (1 + value) for value in factor)), depth)


def _collect_equations(
    grid: OccupancyGrid, recordings: Sequence[Recording], range_factor: float
) -> tuple[list[Floats], Ints]:
    """Collect the equations of all scans with ranges divided by a factor, and their blocks."""
    parts, blocks, first = [], [], 0
    for recording in recordings:
        drive_equations, of_scan = _build_equations(grid, recording, range_factor)
        parts += drive_equations
        blocks += (first + of_scan).tolist()
        first = max([first, *blocks]) + 1
    reduced = _eliminate_poses(parts)
    for _ in range(2 * bool(parts)):
        # Drop beams beyond three standard deviations: blocked, or at a wall that is not mapped.
        at = _solve_least_squares(reduced, np.ones(len(reduced)))
        off = [
            np.abs(scan_equations[:, 2] - scan_equations[:, :2] @ at) for scan_equations in reduced
        ]
        bound = max(3 * MAD * float(np.median(np.concatenate(off))), 0.5 * grid.resolution)
        parts = [
            scan_equations[far < bound] for scan_equations, far in zip(parts, off, strict=True)
        ]
        reduced = _eliminate_poses(parts)
    return reduced, np.array(blocks, np.int64)


def _build_equations(
    grid: OccupancyGrid, recording: Recording, range_factor: float
) -> tuple[list[Floats], Ints]:
    """Build the equations of each scan with enough beams at walls, and return the scans' blocks.

    A row is (range, 1, difference, derivatives by the pose (x, y, heading)), across the wall.
    """
    walls, rows, used = RecordingRangeMatcher(grid, recording), [], []
    far = max(FAR, FAR_CELLS * grid.resolution)
    scan_numbers = np.unique(np.linspace(0, len(recording) - 1, RANGE_SCANS).astype(np.int64))
    steps = np.diag([grid.resolution, grid.resolution, math.radians(0.5)])
    for scan in scan_numbers.tolist():
        measured = recording.ranges[scan, :: walls.beam_step].astype(np.float64) / range_factor
        pose = walls.match_pose(recording.poses[scan], measured)
        expected = walls.cast_ranges(pose, walls.sparse_beams)
        with np.errstate(invalid="ignore"):
            ways = np.column_stack(
                [
                    (
                        walls.cast_ranges(pose + step, walls.sparse_beams)
                        - walls.cast_ranges(pose - step, walls.sparse_beams)
                    )
                    / (2 * step.sum())
                    for step in steps
                ]
            )
            steep, off = np.hypot(ways[:, 0], ways[:, 1]), measured - expected
            good = (steep > 0.9) & (steep < GRAZING) & np.isfinite(ways[:, 2])
            good &= np.abs(off) < far + FAR_OFF * expected
        if good.sum() >= MIN_BEAMS:
            of_beams = np.column_stack([expected, steep, off, ways])[good]
            rows.append(of_beams / steep[good, None])
            used.append(scan)
    return rows, assign_blocks(recording.poses)[np.array(used, np.int64)]


def _eliminate_poses(parts: list[Floats]) -> list[Floats]:
    """Reduce equations to their first three columns by eliminating the pose of each scan."""
    reduced = []
    for scan_equations in parts:
        base, _ = np.linalg.qr(scan_equations[:, 3:])
        reduced.append(scan_equations[:, :3] - base @ (base.T @ scan_equations[:, :3]))
    return reduced


def _solve_least_squares(parts: list[Floats], weights: Floats) -> Floats:
    """Solve weighted least squares for the factor minus 1 and the depth [m], (2,)."""
    sums = np.tensordot(
        weights, np.array([scan_equations.T @ scan_equations for scan_equations in parts]), 1
    )
    return np.asarray(np.linalg.lstsq(sums[:2, :2], sums[:2, 2], rcond=None)[0])


Move = tuple[float, float, float]
MIN_GAIN = 0.1
"""Minimum gain in the share of fitting beams to suggest a move of the map."""
FINEST = 0.2
"""Minimum edge of the cells in the search over all turns [m]."""
BLUR = 0.1
"""Minimum standard deviation of the walls' blur when moves are compared [m]."""
PLACES, STEPS, STEP = 8, 6, 1.0
"""Number of places from which a drive is followed on a map, and number and length [m] of the
steps in both directions."""
AGREES = 0.3
"""Maximum difference between agreeing measured and expected ranges [m]."""
TURNS = (0.0, math.radians(8.0), math.radians(-8.0))
"""Turns from the expected heading at which a scan is compared [rad]."""
SAME_PLACE = 0.66
"""Minimum mean share of agreeing ranges if a recording fits a map. Six real recordings have 0.76 to
0.95 on their maps, and 0.24 to 0.59 on any other of these maps."""


@dataclass(frozen=True)
class MapFit:
    """Fit of a recorded drive to a map, as recorded and after the best move."""

    share: float
    """Share of the returns that end within `distance` of a wall, 0..1."""
    best_share: float
    """Share of the returns that end within `distance` of a wall after `move`, 0..1."""
    move: Move
    """Move of the drive with the best fit: a turn about the map frame's origin, then a shift
    [m, m, rad], as `Recording.move` takes it."""
    distance: float
    """Maximum distance between a wall and a beam that ends at it [m]."""
    origin: tuple[float, float, float]
    """Origin of the map with the best fit to the unmoved drive [m, m, rad]."""
    mount: str = field(default="")
    """Actual mount of the lidar, if a wrong mount explains a bad fit; otherwise empty."""
    ranges: RangeFit | None = None
    """Fit of the ranges, if a wrong resolution explains a bad fit."""

    @property
    def fits(self) -> bool:
        """True if the map fits without a move."""
        return self.share >= MIN_FIT_SHARE and not self.is_shifted

    @property
    def is_shifted(self) -> bool:
        """True if the map fits only after a move, or fits clearly better."""
        x, y, turn = self.move
        is_far = math.hypot(x, y) > 0.1 or abs(turn) > math.radians(0.5)
        return (
            is_far and self.best_share >= MIN_FIT_SHARE and self.best_share >= self.share + MIN_GAIN
        )

    @property
    def sentence(self) -> str:
        """Sentence for people: whether the map fits, and the remedy otherwise."""
        now = f"{self.share:.0%} of the beams end within {self.distance:.2g} m of a wall"
        if self.fits:
            return f"The map fits: {now}."
        if self.mount:
            return f"The lidar seems to be {self.mount}: {now}. Set mount= when reading the drive."
        if self.is_shifted:
            x, y, turn = self.move
            origin = ", ".join(f"{value:.3f}" for value in self.origin)
            return (
                f"The map seems shifted: {now}, and {self.best_share:.0%} with the drive turned by"
                f" {math.degrees(turn):.1f} deg about the origin and moved by {x:.2f},{y:.2f} m."
                f" Set origin: [{origin}] in the map's YAML, or use"
                f" drive.move({x:.3f}, {y:.3f}, {turn:.4f})."
            )
        if self.ranges:
            return (
                f"The map's resolution seems wrong: {now}. If the lidar's ranges are right,"
                f" multiply resolution and origin in its YAML by {self.ranges.factor.value:.4f}."
            )
        return (
            f"The map does not fit: {now}, and {self.best_share:.0%} after the best move. Use a"
            " current map of this building, and check the lidar's mount and the source of the"
            " poses."
        )


class _BeamSample(NamedTuple):
    """Sample of beams and scans of a drive."""

    on_robot: Floats  # (n, beams, 2), NaN without return [m]
    poses: Floats  # (n, 3)

    def ends(self) -> Floats:
        """Return the ends of the returns in the map's frame, (k, 2) [m]."""
        ends = move_ends_to_poses(self.on_robot, self.poses).reshape(-1, 2)
        return ends[np.isfinite(ends[:, 0])]


def fit_to_map(
    recording: Recording, grid: OccupancyGrid, *, progress: ProgressCallback | None = None
) -> MapFit:
    """Measure how well a recorded drive fits a map, and find the move with the best fit.

    If fewer than 60 % of the beams end at walls, all turns and shifts are searched: the drive is
    correlated with the walls on a coarse grid, and the best moves are refined. Otherwise only small
    moves are searched.

    Parameters
    ----------
    recording : Recording
        The drive; up to 100 scans with 60 beams are compared.
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
    check_instance("recording", recording, Recording)
    check_grid(grid)
    if not (grid.cells == OCCUPIED).any():
        raise RecordingError(f"{grid.name or 'the map'} has no walls; use another map")
    distance, near = find_cells_near_walls(grid)
    sample = _select_beam_sample(recording)
    ends = sample.ends()
    share = _compute_share_near_walls(grid, near, ends)
    search, starts = _MoveSearch(grid, ends, sample.poses[:, :2]), [(0.0, 0.0, 0.0)]
    if share < MIN_FIT_SHARE:
        starts += search.search_all_moves(progress)
    move = search.refine_moves(starts)
    best = _compute_share_near_walls(
        grid, near, sample._replace(poses=move_poses(sample.poses, move)).ends()
    )
    if best <= share:
        move, best = (0.0, 0.0, 0.0), share
    mount = _find_actual_mount(grid, near, sample, best) if best < MIN_FIT_SHARE else ""
    ranges = (
        None
        if best >= MIN_FIT_SHARE or mount
        else _find_explaining_range_fit(grid, near, recording)
    )
    return MapFit(share, best, move, distance, _move_origin(grid, move), mount, ranges)


def check_recording_on_map(
    recording: Recording, grid: OccupancyGrid, *, database: ScanDatabase | None = None
) -> None:
    """Raise a RecordingError if a recording was not taken on a map, independent of its poses.

    Eight scans start at their recorded poses if these fit the map; otherwise they are located on
    the whole map. From each of them, odometry and scans are followed over 6 m in both directions.
    In another building, single scans may fit, but ranges along the drive do not.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    database : ScanDatabase, optional
        The scans at all places of this map, to reuse them between calls.

    Raises
    ------
    RecordingError
        If less than 66 % of the ranges agree with the map.

    Examples
    --------
    >>> from locplan.maps import load_map
    >>> from locplan.recordings import read_recording
    >>> recording = read_recording("two_corridors")
    >>> check_recording_on_map(recording, load_map("two_corridors"))
    """
    check_instance("recording", recording, Recording)
    check_grid(grid)
    if not (grid.cells == OCCUPIED).any():
        return  # functions that use the recording reject this map
    share = _measure_range_agreement(recording, grid, database)
    if not share < SAME_PLACE:
        return
    name = make_printable(recording.source.file) or "the recording"
    fault = _find_lidar_fault(recording, grid) if recording.has_poses else ""
    raise RecordingError(
        f"{name} does not fit {grid.name or 'the map'}: "
        + (
            fault
            or f"only {share:.0%} of its ranges agree with the walls ({SAME_PLACE:.0%} are needed);"
            " use the map of the building where it was recorded"
        )
    )


def _find_lidar_fault(recording: Recording, grid: OccupancyGrid) -> str:
    """Explain a bad fit by a wrong mount or wrong ranges; return an empty text otherwise."""
    distance, near = find_cells_near_walls(grid)
    sample = _select_beam_sample(recording)
    share = _compute_share_near_walls(grid, near, sample.ends())
    mount = _find_actual_mount(grid, near, sample, share)
    ranges = None if mount else _find_explaining_range_fit(grid, near, recording)
    if not mount and ranges is None:
        return ""
    fit = MapFit(share, share, (0.0, 0.0, 0.0), distance, grid.origin, mount, ranges)
    return fit.sentence.rstrip(".")


def _measure_range_agreement(
    recording: Recording, grid: OccupancyGrid, database: ScanDatabase | None
) -> float:
    """Compute the mean share of agreeing ranges along a drive; NaN if no scan can be located."""
    motion = recording.poses if recording.odometry is None else recording.odometry
    step_lengths = np.hypot(*np.diff(motion[:, :2], axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(np.nan_to_num(step_lengths))])  # NaN without poses
    reach = min(STEPS * STEP, way[-1] / 2)
    at = np.linspace(reach, way[-1] - reach, PLACES) if way[-1] else np.zeros(1)
    scans = np.unique(np.searchsorted(way, at))
    poses = _find_start_poses(recording, grid, scans, database)
    is_located = np.isfinite(poses).all(axis=1)
    walls = RecordingRangeMatcher(grid, recording)
    steps = STEP * np.arange(1, STEPS + 1)
    shares = []
    for scan, start in zip(scans[is_located], poses[is_located], strict=True):
        first, share = _compare_ranges(walls, recording, scan, start)
        along = [share]
        for side in (steps, -steps) if way[-1] else ():
            pose, before = first, scan
            for next_scan in np.searchsorted(way, np.clip(way[scan] + side, 0.0, way[-1])):
                pose = apply_motions(pose, compute_motions(motion[before], motion[next_scan]))
                pose, share = _compare_ranges(walls, recording, next_scan, pose)
                along.append(share)
                before = next_scan
        shares.append(np.nanmean(along))
    return float(np.mean(shares)) if shares else math.nan


def _find_start_poses(
    recording: Recording, grid: OccupancyGrid, scans: Ints, database: ScanDatabase | None
) -> Floats:
    """Find poses of scans on a map: recorded poses if they fit, otherwise located; NaN if lost."""
    near = find_cells_near_walls(grid)[1]
    if (
        recording.has_poses
        and _compute_share_near_walls(grid, near, _select_beam_sample(recording).ends())
        >= MIN_FIT_SHARE
    ):
        return recording.poses[scans]
    try:
        return locate_drive(recording[scans], grid, count=1, database=database).poses
    except RecordingError:  # too few returns in all scans
        return np.full((len(scans), 3), np.nan)


def _compare_ranges(
    walls: RecordingRangeMatcher, recording: Recording, scan: int, pose: Floats
) -> tuple[Floats, float]:
    """Find the best pose of a scan near a start, and its share of agreeing ranges."""
    ranges = recording.ranges[scan]
    returned = np.isfinite(ranges)
    if not returned.any():
        return pose, math.nan
    best, best_share = pose, -1.0
    for turn in TURNS:  # odometry may have a wrong turn
        settled_pose = walls.match_pose(
            pose + np.array([0.0, 0.0, turn]), ranges[:: walls.beam_step]
        )
        off = np.abs(ranges[returned] - walls.cast_ranges(settled_pose, walls.beams)[returned])
        share = float((off < AGREES).mean())
        if share > best_share:
            best, best_share = settled_pose, share
        if share >= SAME_PLACE:
            break
    return best, best_share


def _find_explaining_range_fit(
    grid: OccupancyGrid, is_near_wall: NDArray[np.bool_], recording: Recording
) -> RangeFit | None:
    """Return the fit of the ranges if a scale factor explains a bad fit."""
    ranges = fit_ranges(grid, [recording])
    if not ranges.is_scaled:
        return None
    scaled = replace(recording, ranges=recording.ranges / ranges.factor.value)
    return (
        ranges
        if _compute_share_near_walls(grid, is_near_wall, _select_beam_sample(scaled).ends())
        >= MIN_FIT_SHARE
        else None
    )


def _select_beam_sample(recording: Recording) -> _BeamSample:
    """Select evenly spaced scans and beams."""
    scans = np.unique(np.linspace(0, len(recording) - 1, 100).astype(np.int64))
    beams = np.unique(np.linspace(0, recording.lidar.beams - 1, 60).astype(np.int64))
    ends = recording[scans].ends_on_robot()
    if np.isfinite(ends[:, beams]).any():
        ends = ends[:, beams]
    return _BeamSample(ends, recording.poses[scans])


def _compute_share_near_walls(
    grid: OccupancyGrid, is_near_wall: NDArray[np.bool_], ends: Floats
) -> float:
    """Compute the share of points that lie in the cells of a mask."""
    return float(look_up_cells(grid, is_near_wall, ends, False).mean())


def _move_origin(grid: OccupancyGrid, move: Move) -> Move:
    """Compute the map's origin after the inverse move."""
    (x, y, yaw), (dx, dy, turn) = grid.origin, move
    cos, sin = math.cos(turn), math.sin(turn)
    u, v = x - dx, y - dy
    return cos * u + sin * v, cos * v - sin * u, float(wrap_angles(yaw - turn))


def _find_actual_mount(
    grid: OccupancyGrid, is_near_wall: NDArray[np.bool_], sample: _BeamSample, best_share: float
) -> str:
    """Find a different mount of the lidar that explains the scans; empty if there is none."""
    x, y = sample.on_robot[..., 0], sample.on_robot[..., 1]
    mounts = {
        "turned by 90 deg": (-y, x),
        "turned by 180 deg": (-x, -y),
        "turned by -90 deg": (y, -x),
        "upside down": (x, -y),
    }
    for words, ends in mounts.items():
        share = _compute_share_near_walls(
            grid, is_near_wall, sample._replace(on_robot=np.stack(ends, axis=-1)).ends()
        )
        if share >= max(MIN_FIT_SHARE, best_share + MIN_GAIN):
            return words
    return ""


class _MoveSearch:
    """Search for the rigid move of a drive that brings its beams' ends to a map's walls.

    Beams' ends (k, 2) and places of the robot (n, 2) are in the map's frame [m].
    """

    def __init__(self, grid: OccupancyGrid, ends: Floats, places: Floats) -> None:
        self.grid, self.middle = grid, places.mean(0)
        self.relative_ends, self.relative_places = ends - self.middle, places - self.middle
        self.radius = math.sqrt(float((self.relative_ends**2).sum(1).mean()))

    def search_all_moves(self, progress: ProgressCallback | None = None) -> list[Move]:
        """Search all turns and shifts for the best moves, about the origin [m, m, rad].

        The rotated ends are correlated with the walls by the Fourier transform, and the places of
        the robot with free space. `progress` is called with (done, total) turns.
        """
        from scipy.fft import irfft2, next_fast_len, rfft2

        grid = self.grid
        reach = float(np.abs(np.concatenate([self.relative_ends, self.relative_places])).max())
        side = max(max(grid.shape) * grid.resolution, 2 * reach)
        cell = max(FINEST, side / 224, grid.resolution)  # at most 224 cells along a side
        walls, free = self._coarsen_map(cell)
        half = math.ceil(math.hypot(reach, reach) / cell) + 1
        shape = tuple(next_fast_len(length + 2 * half + 1, real=True) for length in walls.shape)
        of_walls, of_free = (np.conj(rfft2(layer, shape)) for layer in (walls, free))
        turns = 4 * max(1, min(math.ceil(2 * math.pi * self.radius / cell / 4), 180))
        (report_progress,) = split_progress(progress, [turns])
        peaks: list[tuple[float, float, float, float]] = []
        for n in range(turns):
            turn = 2 * math.pi * n / turns
            rotated = (_rotate(xy, turn) for xy in (self.relative_ends, self.relative_places))
            rasters = (_count_points_per_cell(xy, cell, half) for xy in rotated)
            hits, stands = (rfft2(raster / raster.sum(), shape) for raster in rasters)
            score = irfft2(np.conj(hits * of_walls + 0.5 * stands * of_free), shape)
            for _ in range(2):
                row, col = divmod(int(np.argmax(score)), shape[1])
                peaks.append((float(score[row, col]), turn, float(row), float(col)))
                score[max(0, row - 3) : row + 4, max(0, col - 3) : col + 4] = -1.0
            report_progress(n + 1, turns)
        moves: list[Move] = []
        for _, turn, *at in sorted(peaks, reverse=True):
            # The raster's cell (half, half) holds the drive's middle; the transform is periodic.
            shift = (s - n if s > n / 2 else s for s, n in zip(at, shape, strict=True))
            rows, cols = ((offset + half + 0.5) * cell / grid.resolution for offset in shift)
            x, y = map(float, grid.grid_to_world(rows, cols))
            move = self._convert_to_turn_about_origin((x, y, turn + grid.origin[2]))
            if all(self._measure_distance(move, other) > 2 * cell for other in moves):
                moves.append(move)
            if len(moves) == 12:
                break
        return moves

    def refine_moves(self, starts: list[Move]) -> Move:
        """Refine moves by halving steps in x, y and turn, and return the best one."""
        size = self.grid.resolution
        best, best_score = (0.0, 0.0, 0.0), -1.0
        for start in starts:
            at, step = self._convert_to_turn_about_middle(start), 0.4
            while step > size / 4:
                at = self._improve_move(at, step, max(BLUR, size, step))
                step /= 2
            score = self._score_move(at, max(BLUR, size))
            if score > best_score:
                best, best_score = self._convert_to_turn_about_origin(at), score
        return best

    def _improve_move(self, move: Move, step: float, blur: float) -> Move:
        """Improve a move by steps of a fixed size until no step improves it."""
        score, turning = self._score_move(move, blur), step / max(self.radius, self.grid.resolution)
        steps = np.array([*itertools.product((-1, 0, 1), repeat=3)]) * (step, step, turning)
        for _ in range(30):
            neighbours = [
                (move[0] + x, move[1] + y, move[2] + turn) for x, y, turn in steps.tolist()
            ]
            best_score, best_move = max(
                (self._score_move(other, blur), other) for other in neighbours
            )
            if best_score <= score:
                break
            score, move = best_score, best_move
        return move

    def _score_move(self, move: Move, blur: float) -> float:
        """Score a move: mean nearness of ends to walls, plus half the share of free places."""
        grid, to = self.grid, np.array(move[:2])
        distance = look_up_cells(
            grid, grid.clearance, to + _rotate(self.relative_ends, move[2]), np.inf
        )
        free = look_up_cells(grid, grid.free, to + _rotate(self.relative_places, move[2]), 0.0)
        return float(np.exp(-0.5 * (distance / blur) ** 2).mean() + 0.5 * free.mean())

    def _coarsen_map(self, cell_size: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Compute nearness to walls and free space in coarser cells."""
        grid = self.grid
        counts = (math.ceil(edge * grid.resolution / cell_size) for edge in grid.shape)
        at = np.ix_(
            *(
                np.minimum((np.arange(n) + 0.5) * cell_size / grid.resolution, side - 1).astype(
                    np.int64
                )
                for n, side in zip(counts, grid.shape, strict=True)
            )
        )
        walls = np.exp(-0.5 * (grid.clearance[at] / (0.75 * cell_size)) ** 2)
        return walls.astype(np.float32), grid.free[at].astype(np.float32)

    def _convert_to_turn_about_origin(self, move: Move) -> Move:
        """Convert a move from a turn about the drive's middle to a turn about the origin."""
        x, y = _rotate(self.middle[None], move[2])[0]
        return move[0] - float(x), move[1] - float(y), (move[2] + math.pi) % (2 * math.pi) - math.pi

    def _convert_to_turn_about_middle(self, move: Move) -> Move:
        """Convert a move from a turn about the origin to a turn about the drive's middle."""
        x, y = _rotate(self.middle[None], move[2])[0]
        return float(x) + move[0], float(y) + move[1], move[2]

    def _measure_distance(self, *moves: Move) -> float:
        """Measure the distance between the drive's middles after two moves [m].

        The distance is infinite if the turns differ.
        """
        (x, y, turn), (u, v, angle) = map(self._convert_to_turn_about_middle, moves)
        between = abs((turn - angle + math.pi) % (2 * math.pi) - math.pi)
        return math.hypot(x - u, y - v) + (math.inf if between > 0.1 else 0.0)


def _count_points_per_cell(xy: Floats, cell_size: float, half_size: int) -> NDArray[np.float32]:
    """Count the points in each cell around the middle, (2 half + 1, 2 half + 1)."""
    size = 2 * half_size + 1
    col, row = (np.floor(part / cell_size + 0.5).astype(np.int64) + half_size for part in xy.T)
    counts = np.bincount(row * size + col, minlength=size * size)
    return counts.reshape(size, size).astype(np.float32)


def _rotate(xy: Floats, turn: float) -> Floats:
    """Rotate points about zero."""
    cos, sin = math.cos(turn), math.sin(turn)
    return np.column_stack([cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]])


CROSSED, TIMES, HITS = 5, 3, 3
"""Minimum number of scans through a false wall, minimum ratio to the scans that end there, and
minimum number of scans that end at a missing wall."""
MAX_FALSE_SHARE, MAX_MISSING_LENGTH = 0.02, 1.0
"""Maximum share of false walls in view, and maximum length of missing walls, on a correct map
[m]."""
BAD_POSES = 0.04
"""Maximum error of the poses across walls to find wrong walls [m]."""
MAX_MATCH_STD = 0.05
"""Maximum standard deviation of a match across walls to measure the error of a pose [m]."""
MISFIT_SCANS, BEAMS = 4000, 180
"""Maximum number of scans of a drive, and of beams of a scan."""


@dataclass(frozen=True, eq=False, repr=False)
class MapMisfits:
    """Cells of a map that recorded scans contradict."""

    false: Bools
    """Occupied cells that scans see through, (H, W)."""
    missing: Bools
    """Cells where scans end far from the map's walls, (H, W)."""
    false_share: float
    """Share of false cells among the wall cells in view, 0..1."""
    share_at_walls: float
    """Share of beams that end at walls of the map, 0..1."""

    def faults(self, grid: OccupancyGrid) -> Iterator[MapFault]:
        """Yield the faults of the map with their places, the largest first.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        remedy = "check these places, and map them again"
        if self.false_share > MAX_FALSE_SHARE:
            description = f"scans pass through {self.false_share:.1%} of the walls in view"
            boxes = find_bounding_boxes(grid, self.false)
            yield MapFault("false walls", description, remedy, is_certain=True, boxes=boxes)
        if self.missing.sum() * grid.resolution > MAX_MISSING_LENGTH:
            description = f"{1 - self.share_at_walls:.0%} of the beams end away from walls"
            boxes = find_bounding_boxes(grid, self.missing)
            yield MapFault("missing walls", description, remedy, is_certain=True, boxes=boxes)


@dataclass(frozen=True, eq=False)
class _MapBeams:
    """Beams of scans on a map [cells]."""

    origins: Floats  # (n, 2)
    ends: Floats  # (n, beams, 2), NaN without return


def find_misfits(grid: OccupancyGrid, recordings: Sequence[Recording]) -> MapMisfits:
    """Find the places where recorded scans do not fit the map.

    A wall is false if at least five scans pass through it, over three times as many as end there.
    A wall is missing where at least three scans end.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recordings : sequence of Recording
        The drives, with ground-truth poses.

    Returns
    -------
    Misfits
        The cells of false and of missing walls.

    Raises
    ------
    RecordingError
        If the poses are too inaccurate to find wrong walls.
    """
    for recording in recordings:
        check_instance(
            "recording", recording, Recording, "read one with locplan.recordings.read_recording"
        )
    deviation = max(_measure_pose_deviation(grid, recording) for recording in recordings)
    name = grid.name or "the map"
    if math.isinf(deviation):
        raise RecordingError(
            f"no scan fits {name} near its pose; use a drive on this map, with poses in its frame"
        )
    if deviation > BAD_POSES:
        raise RecordingError(
            f"the poses are {deviation:.2f} m away from where their scans fit {name}, too far to"
            f" find wrong walls (at most {BAD_POSES:g} m); compute the ground truth with locplan"
            " recording FILE MAP -o drive.npz"
        )
    parts = [_place_beams_on_map(grid, recording) for recording in recordings]
    beams = _MapBeams(
        np.concatenate([part.origins for part in parts]),
        np.concatenate([part.ends for part in parts]),
    )
    return MapMisfits(*_find_contradictions(grid, beams), _compute_share_at_walls(grid, beams))


def _place_beams_on_map(grid: OccupancyGrid, recording: Recording) -> _MapBeams:
    """Convert beams of evenly spaced scans of a drive to the map's cells."""
    scans = np.unique(np.linspace(0, len(recording) - 1, MISFIT_SCANS).astype(np.int64))
    beams = np.unique(np.linspace(0, recording.lidar.beams - 1, BEAMS).astype(np.int64))
    recording = recording[scans]
    lidar = np.array([[[recording.lidar.mount_x, recording.lidar.mount_y]]])
    lidars = np.repeat(lidar, len(scans), axis=0)
    ends = move_ends_to_poses(recording.ends_on_robot()[:, beams], recording.poses)
    origins = move_ends_to_poses(lidars, recording.poses)[:, 0]
    cell_positions = [
        np.stack(grid.world_to_grid(positions[..., 0], positions[..., 1]), -1)
        for positions in (origins, ends)
    ]
    return _MapBeams(cell_positions[0], cell_positions[1])


def _measure_pose_deviation(grid: OccupancyGrid, recording: Recording) -> float:
    """Measure the error of poses as their median distance from the best poses of scans [m].

    Distances along x, along y, and along the best-known direction of each scan are measured, and
    the largest median counts. Poses in corridors do not count along the corridor.
    """
    scan_numbers = np.unique(np.linspace(0, len(recording) - 1, 100).astype(np.int64))
    scan_matches = match_scans(recording[scan_numbers], grid, threads=1)
    _, minor, direction = position_axes(scan_matches.covariance)
    # A few scans fit somewhere on any map.
    deviations = [] if (scan_matches.is_matched & (minor < MAX_MATCH_STD)).sum() > 5 else [math.inf]
    x, y = np.sqrt(scan_matches.covariance[:, 0, 0]), np.sqrt(scan_matches.covariance[:, 1, 1])
    for across, sigma in ((0.0, x), (math.pi / 2, y), (direction + math.pi / 2, minor)):
        off = scan_matches.mean[:, 0] * np.cos(across) + scan_matches.mean[:, 1] * np.sin(across)
        is_sure = scan_matches.is_matched & (sigma < MAX_MATCH_STD)
        if is_sure.sum() > 5:
            deviations.append(float(np.median(np.abs(off[is_sure]))))
    return max(deviations, default=0.0)


def _find_contradictions(grid: OccupancyGrid, beams: _MapBeams) -> tuple[Bools, Bools, float]:
    """Find cells of false and missing walls, and the share of false walls in view.

    Beams through confirmed walls are cut off there. With the remaining beams, three scans suffice
    instead of five, and one scan for cells connected with a false wall.
    """
    import cv2

    walls = grid.cells == OCCUPIED
    passed, hit, around = _count_scans(grid, np.zeros_like(walls), beams)
    is_confirmed = walls & ((passed < CROSSED) | (passed <= TIMES * around))
    cells = np.where(walls & ~is_confirmed, np.uint8(FREE), grid.cells)
    _, is_near_wall = find_cells_near_walls(replace(grid, cells=cells))
    missing = (hit >= HITS) & (passed <= TIMES * hit) & ~is_near_wall & ~walls
    met = (around >= HITS) & (passed <= TIMES * around)
    passed, _, around = _count_scans(grid, missing | (walls & met), beams)
    is_crossed = walls & (passed > TIMES * around)
    _, labels = cv2.connectedComponents(is_crossed.view(np.uint8), connectivity=8)
    false = is_crossed & np.isin(labels, labels[is_crossed & (passed >= HITS)])
    in_view = np.count_nonzero(walls & ((passed > 0) | (around > 0)))
    return false, missing, float(false.sum() / max(in_view, 1))


def _count_scans(grid: OccupancyGrid, stops: Bools, beams: _MapBeams) -> tuple[Ints, Ints, Floats]:
    """Count the scans that pass each cell, end in it, and end in it or next to it."""
    import cv2

    from locplan._support.kernels.walls import count_scans

    margin = find_cells_near_walls(grid)[0] / grid.resolution
    passed, hit = count_scans(stops, beams.origins, beams.ends, margin)
    # Noise and rounding of the map move a beam's end by a cell.
    return passed, hit, cv2.boxFilter(hit.astype(np.float64), -1, (3, 3), normalize=False)


def _compute_share_at_walls(grid: OccupancyGrid, beams: _MapBeams) -> float:
    """Compute the share of beams that end at walls."""
    ends = beams.ends[np.isfinite(beams.ends[..., 0])]
    row, col = np.floor(ends).astype(np.int64).T
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    _, near = find_cells_near_walls(grid)
    return float((near[row * inside, col * inside] & inside).mean())

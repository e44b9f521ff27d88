"""Smoothing: the ground truth of a recorded drive from its scans, its odometry and the map."""

from __future__ import annotations

import hashlib
import itertools
import math
import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import check_choice, check_instance, check_integer, short_repr
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.poses import apply_motions, compute_motions, make_rotation_matrix, wrap_angles
from locplan._support.progress import ProgressCallback, scale_progress, split_progress
from locplan.errors import ConfigError, RecordingError
from locplan.field.cache import load_or_compute_result
from locplan.field.covariance import position_axes
from locplan.maps.grid import OccupancyGrid, check_grid, format_extent, world_to_map_frame
from locplan.maps.occupancy import OCCUPIED
from locplan.recordings.filter_pass import (
    BEAMS,
    SIGMA,
    UNEXPLAINED,
    FilterPass,
    WallDistances,
    make_beam_model,
)
from locplan.recordings.matching import CLEARANCE, ScanDatabase, resolve_database
from locplan.recordings.recording import Recording
from locplan.recordings.trajectory import (
    AMBIGUOUS,
    BAD_FIT,
    CARRIED,
    JUMPED,
    MAP_MOVED,
    SMOOTHED,
    UNCERTAIN,
    OdometryModel,
    OdometryMoves,
    Trajectory,
    classify_jump,
    compute_moves_with_variances,
)
from locplan.robots.robot import Robot

KEY_WAY, KEY_TURN = 0.3, 0.2
"""Distance [m] and turn [rad] from one key scan to the next."""
SCAN_BEAMS = 180
"""Maximum number of beams of a scan that least squares use."""
FINE, FINE_BEAMS = 0.1, 150.0
"""Standard deviation of beams' ends [m], and number of independent beams of a scan, for the least
squares."""
COVARIANCE_BEAMS = 30.0
"""Number of independent beams of a scan for covariances: fewer, because maps have faults."""
UNCERTAIN_STD, UNCERTAIN_TURN = 0.15, math.radians(4)
"""Standard deviations of position [m] and heading [rad] above which a pose is uncertain."""
SCATTER = 0.1
"""Distance between the proposed and the best trajectory above which a pose is ambiguous [m]."""
BAD_FIT_BELOW, BRIDGED_WAY = -0.8, 2.0
"""Log-likelihood per beam below which a scan does not fit the map, and maximum distance between
its neighbours over which odometry bridges such a scan [m]."""
JUMP_WAY = 1.0
"""Distance after a jump on which poses are doubtful [m]."""
DISPLACED_SHIFT, DISPLACED_TURN, DISPLACED_LENGTH = 0.2, 0.1, 40.0
"""Minimum shift [m], minimum turn [rad] and maximum length [m] of a displaced part of the map."""


def smooth(
    grid: OccupancyGrid,
    recording: Recording,
    robot: Robot | None = None,
    start: ArrayLike | str | None = None,
    *,
    folder: Path | None = None,
    seed: int = 1,
    progress: ProgressCallback | None = None,
) -> Trajectory:
    """Compute the ground truth of a recorded drive from its scans, its odometry and the map.

    The recorded poses replace missing odometry, and are the start if that is "log". Otherwise they
    are not used.

    1. Choose key scans, every 0.3 m or 0.2 rad.
    2. Run a particle filter along the key scans in both directions. It searches the whole map
       when it is lost. Sample trajectories from its particles and refine them by least squares.
    3. Combine the most probable trajectory from the samples.
    4. Place the scans between key scans by odometry.
    5. Refine all poses by least squares, alternating with the errors of odometry.
    6. Compute covariances from the least squares and the fit of the map.
    7. Mark doubtful poses.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    recording : Recording
        The drive.
    robot : Robot, optional
        The robot. Large errors of its odometry widen the error model.
    start : (x, y, heading) or "log", optional
        Pose of the first scan in the world [m, m, rad], accurate to 0.5 m and 10 deg; "log" uses
        the recorded pose. By default the whole map is searched.
    folder : path, optional
        Folder for intermediate results; an interrupted call resumes from them.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    Trajectory
        The poses at all scans, their covariances, and the doubtful poses.

    Raises
    ------
    RecordingError
        If the map has no walls, or the drive has fewer than ten scans.
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=8.0, beams=180))
    >>> drive = record_drive(grid, locplan.Path([[13.0, 5.5], [20.0, 5.5]]), robot)
    >>> trajectory = smooth(grid, drive)
    >>> bool(trajectory.deviation.max() < 0.1)
    True
    """
    _check_drive(grid, recording, seed)
    first_pose = _parse_first_pose(grid, recording, start)
    drive = _DriveOnMap.prepare(grid, recording)
    model = OdometryModel.make_prior(recording.robot(robot).odometry)
    keys = drive.make_chain(drive.choose_key_scans(), model)
    keys, candidates = _propose_trajectories(drive, keys, first_pose, seed, folder, progress)
    key_poses, is_bridged = keys.bridge_excursions(keys.find_likeliest_trajectory(candidates))
    scatter = _compute_scatter(keys, key_poses, candidates)
    chain, poses, key_of_scan = _interpolate_between_key_scans(drive, keys, key_poses)
    chain, poses = _refine_all_poses(chain, poses)
    fits = chain.compute_fits(poses[None])[0]
    covariances = _compute_covariances(grid, chain, poses, fits)
    doubts = _find_doubts(
        chain, poses, covariances, fits, scatter[key_of_scan], is_bridged[key_of_scan]
    )
    return _make_trajectory(drive, chain, poses, covariances, doubts, fits)


def _check_drive(grid: OccupancyGrid, recording: Recording, seed: int) -> None:
    """Raise an error if a drive cannot be smoothed."""
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_grid(grid)
    check_integer("seed", seed, 0)
    if len(recording) < 10:
        raise RecordingError(f"the drive has only {len(recording)} scans; at least 10 are needed")
    if not (grid.cells == OCCUPIED).any():
        raise RecordingError(f"{grid.name or 'the map'} has no walls; use another map")


def _parse_first_pose(
    grid: OccupancyGrid, recording: Recording, start: ArrayLike | str | None
) -> Floats | None:
    """Return the pose of the first scan in the map frame; None if it is unknown."""
    if start is None:
        return None
    try:
        is_log = isinstance(start, str) and start == "log"
        pose = recording.poses[0] if is_log else np.array(start, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigError(
            f'start must be x, y, heading [m, m, rad], or "log", not {short_repr(start)}'
        )
    on_map = np.asarray(world_to_map_frame(grid, pose[None])[0])
    if not grid.contains(*(int(on_map[axis] // grid.resolution) for axis in (1, 0))):
        raise ConfigError(
            f"start {pose[0]:g},{pose[1]:g} lies outside {grid.name or 'the map'}, which reaches"
            f" from {format_extent(grid)}"
        )
    return on_map


@dataclass(frozen=True, eq=False)
class _DriveOnMap:
    """A recorded drive prepared for smoothing on its map; poses are in the map frame."""

    grid: OccupancyGrid
    recording: Recording
    walls: WallDistances
    database: ScanDatabase
    """Scans at all places of the map, for global localization of a lost filter."""
    odometry: Floats
    """Poses by odometry, or recorded poses without odometry, (n, 3) [m, m, rad]."""
    ends: Floats
    """Ends of up to 180 beams of each scan on the robot, (n, b, 2) [m]; NaN without a return."""

    @classmethod
    def prepare(cls, grid: OccupancyGrid, recording: Recording) -> _DriveOnMap:
        """Prepare a recording for smoothing."""
        database = resolve_database(grid, recording.lidar, CLEARANCE, None)
        _ = database.full_database  # computed before the work that reports progress
        odometry = recording.poses if recording.odometry is None else recording.odometry
        lidar, ranges = recording.lidar, recording.ranges
        beams = np.unique(np.linspace(0, lidar.beams - 1, SCAN_BEAMS).astype(np.int64))
        # In blocks of scans, which saves memory.
        blocks = (ranges[n : n + 256] for n in range(0, len(ranges), 256))
        ends = np.concatenate([lidar.compute_ends_on_robot(block)[:, beams] for block in blocks])
        return cls(grid, recording, WallDistances(grid), database, odometry, ends)

    def choose_key_scans(self) -> Ints:
        """Choose the scans for the filter: the first and last one, and some in between."""
        moves = OdometryMoves.from_odometry(self.odometry, np.arange(len(self.odometry)))
        way, turn_sums, keys = np.cumsum(moves.lengths), np.cumsum(moves.turn_sums), [0]
        for n in range(1, len(way)):
            is_far = (
                way[n] - way[keys[-1]] >= KEY_WAY or turn_sums[n] - turn_sums[keys[-1]] >= KEY_TURN
            )
            if is_far or n == len(way) - 1:
                keys.append(n)
        return np.array(keys)

    def make_chain(self, scans: Ints, model: OdometryModel) -> ScanChain:
        """Make the chain of the selected scans."""
        return ScanChain(
            self.walls,
            scans,
            self.ends[scans],
            OdometryMoves.from_odometry(self.odometry, scans),
            model,
        )

    def run_filter(
        self,
        keys: ScanChain,
        first_pose: Floats | None,
        seed: int,
        folder: Path | None,
        progress: ProgressCallback,
        *,
        number: int,
        is_backwards: bool = False,
    ) -> Floats:
        """Sample trajectories (16, k, 3) from a filter that runs along the key scans."""
        ends, ranges = keys.ends[:, ::3], self.recording.ranges[keys.scans]
        ways, deviations = (
            keys.model.correct_ways(keys.moves),
            keys.model.compute_deviations(keys.moves),
        )
        if is_backwards:
            ends, ranges = ends[::-1], ranges[::-1]
            ways[1:] = compute_motions(ways[1:], np.zeros_like(ways[1:]))[::-1]
            deviations[1:] = deviations[:0:-1].copy()
        filter_pass = FilterPass(
            self.walls, self.database, ranges, ends, ways, deviations, first_pose, seed, number
        )
        samples = filter_pass.sample_trajectories(folder, progress)
        return np.ascontiguousarray(samples[:, ::-1]) if is_backwards else samples


def _propose_trajectories(
    drive: _DriveOnMap,
    keys: ScanChain,
    first_pose: Floats | None,
    seed: int,
    folder: Path | None,
    progress: ProgressCallback | None,
) -> tuple[ScanChain, Floats]:
    """Sample trajectories from a filter in both directions, and refine them by least squares.

    Returns the key scans with the learned odometry model, and the trajectories (32, k, 3).
    """
    report_forth, report_back = (
        scale_progress(part, 500) for part in split_progress(progress, [500, 500])
    )
    samples = drive.run_filter(keys, first_pose, seed, folder, report_forth, number=0)
    forth = keys.refine_samples(samples)
    learned = keys.refit_odometry_model(keys.find_likeliest_trajectory(forth))
    samples = drive.run_filter(
        learned, None, seed, folder, report_back, number=1, is_backwards=True
    )
    back = learned.refine_samples(samples)
    # If odometry is much worse than assumed, repeat the first pass with the learned model.
    wider = learned.model.compute_deviations(keys.moves) / keys.model.compute_deviations(keys.moves)
    if np.median(wider[1:], axis=0).max() > 1.3:
        samples = drive.run_filter(learned, first_pose, seed, folder, report_back, number=2)
        forth = learned.refine_samples(samples)
    return learned, np.concatenate([forth, back])


def _compute_scatter(keys: ScanChain, key_poses: Floats, candidates: Floats) -> Floats:
    """Compute the root mean square distance of candidates from the best poses, (k,) [m].

    Candidates are refined until they converge, so that the remaining distances show other places.
    """
    refined = np.array([keys.refine(candidate, 10) for candidate in candidates])
    return np.asarray(np.sqrt(((refined - key_poses)[..., :2] ** 2).sum(axis=2).mean(axis=0)))


def _interpolate_between_key_scans(
    drive: _DriveOnMap, keys: ScanChain, key_poses: Floats
) -> tuple[ScanChain, Floats, Ints]:
    """Compute the poses of all scans from the key scans by odometry.

    Scans follow odometry from the previous key scan. If odometry jumps before the next key scan,
    scans after the jump follow odometry backwards from the next key scan. The jump is placed so
    that the scans fit best. Returns the chain of all scans, their poses, and their key scans.
    """
    scans = np.arange(len(drive.odometry))
    chain = drive.make_chain(scans, keys.model)
    before = np.searchsorted(keys.scans, scans, side="right") - 1
    after = np.searchsorted(keys.scans, scans)
    forth, back = (
        apply_motions(
            key_poses[key], compute_motions(drive.odometry[keys.scans[key]], drive.odometry)
        )
        for key in (before, after)
    )
    gains, jumps = np.nan_to_num(chain.compute_fits(np.array([forth, back]))), []
    for key in keys.find_jumps(key_poses):
        begin, end = keys.scans[key - 1] + 1, keys.scans[key]
        sums = [gains[0, begin:n].sum() + gains[1, n:end].sum() for n in range(begin, end + 1)]
        jump = int(begin + np.argmax(sums))
        forth[jump:end], before[jump:end] = back[jump:end], key
        jumps.append(jump)
    return replace(chain, jumps=tuple(jumps)), forth, before


def _refine_all_poses(chain: ScanChain, poses: Floats) -> tuple[ScanChain, Floats]:
    """Refine all poses by least squares, alternating with the error model of odometry."""
    poses = chain.refine(poses, 15)
    for _ in range(2):
        chain = chain.refit_odometry_model(poses)
        poses = chain.refine(poses, 20)
    return chain, poses


def _compute_covariances(
    grid: OccupancyGrid, chain: ScanChain, poses: Floats, fits: Floats
) -> Floats:
    """Compute covariances of poses, (n, 3, 3) [m, m, rad]; a bad fit of the map widens them."""
    misfit = np.nan_to_num(np.maximum(np.nanmedian(fits) - fits, 0.0))
    position = (0.2 * grid.resolution) ** 2 + 0.01**2 + (0.1 * misfit) ** 2
    turn = np.full(len(fits), math.radians(0.2) ** 2)
    added = np.stack([position, position, turn], axis=1)[:, :, None] * np.eye(3)
    return chain.compute_covariances(poses, COVARIANCE_BEAMS)[0] + added


def _find_doubts(
    chain: ScanChain,
    poses: Floats,
    covariances: Floats,
    fits: Floats,
    scatter: Floats,
    is_bridged: Bools,
) -> Ints:
    """Return the doubt about each pose as an index of `DOUBTS`, (n,).

    If several doubts apply, the last one counts. `scatter` is the distance of the proposed
    trajectories from the best one [m].
    """
    doubts, way = np.zeros(len(poses), np.int64), np.cumsum(chain.moves.lengths)
    doubts[chain.find_displaced_poses(poses)] = MAP_MOVED
    doubts[scatter > SCATTER] = AMBIGUOUS
    doubts[_mark_misfitting_scans(fits, way) | is_bridged] = BAD_FIT
    is_certain = position_axes(covariances)[0] <= UNCERTAIN_STD
    is_certain &= np.sqrt(covariances[:, 2, 2]) <= UNCERTAIN_TURN
    doubts[~is_certain] = UNCERTAIN
    for jump in chain.jumps:
        end = int(np.searchsorted(way, way[jump] + JUMP_WAY))
        doubts[max(0, jump - 1) : max(jump + 1, end)] = JUMPED
    return doubts


def _mark_misfitting_scans(fits: Floats, travel_distances: Floats) -> Bools:
    """Return the mask of scans that do not fit the map.

    A single scan between two fitting scans is not marked, because odometry bridges it.
    """
    is_fitting = np.concatenate([[False], fits >= BAD_FIT_BELOW, [False]])
    around = np.concatenate([[-np.inf], travel_distances, [np.inf]])
    is_bridged = is_fitting[:-2] & is_fitting[2:] & (around[2:] - around[:-2] <= BRIDGED_WAY)
    return np.asarray((fits < BAD_FIT_BELOW) & ~is_bridged)


def _make_trajectory(
    drive: _DriveOnMap,
    chain: ScanChain,
    poses: Floats,
    covariances: Floats,
    doubts: Ints,
    fits: Floats,
) -> Trajectory:
    """Make the trajectory in world coordinates."""
    grid, recording = drive.grid, drive.recording
    x, y = grid.grid_to_world(poses[:, 1] / grid.resolution, poses[:, 0] / grid.resolution)
    world = np.column_stack([x, y, wrap_angles(poses[:, 2] + grid.origin[2])])
    turn, errors = make_rotation_matrix(grid.origin[2]), chain.compute_errors(poses)
    return Trajectory(
        poses=world,
        covariances=turn @ covariances @ turn.T,
        doubts=doubts,
        fits=fits,
        jumps=tuple(classify_jump(n, world[n], errors[n], recording.times) for n in chain.jumps),
        odometry=None if recording.odometry is None else chain.model,
        recorded=recording.poses,
        times=recording.times,
        drive=recording.source.file,
        map=grid.name,
        grid=grid,
    )


@dataclass(frozen=True, eq=False)
class ScanChain:
    """Chain of successive scans, whose poses are estimated by least squares."""

    walls: WallDistances
    scans: Ints
    """Indices of the scans in the drive, (n,)."""
    ends: Floats
    """Ends of the beams in the robot's frame, (n, b, 2) [m]; NaN without a return."""
    moves: OdometryMoves
    """Moves between the scans by odometry."""
    model: OdometryModel
    """Error model of odometry."""
    jumps: tuple[int, ...] = ()
    """Scans before which odometry jumps."""

    @cached_property
    def _kernel_scans(self) -> Any:
        """Scans and odometry in the form of the kernels."""
        from locplan.recordings.kernels.least_squares import DriveScans

        # Scans from almost the same place share their weight.
        shares = np.minimum(1.0, self.moves.lengths / 0.5)
        shares[0] = 1.0
        deviations = self.model.compute_deviations(self.moves)
        deviations[list(self.jumps)] = np.inf
        return DriveScans(self.ends, shares, self.model.correct_ways(self.moves), deviations)

    def refine(self, poses: Floats, n_rounds: int) -> Floats:
        """Refine poses by rounds of least squares."""
        from locplan.recordings.kernels.least_squares import refine_poses

        poses = np.array(poses)
        beams = make_beam_model(FINE, FINE_BEAMS)
        refine_poses(self.walls.distances, beams, self._kernel_scans, poses, n_rounds)
        return poses

    def refine_samples(self, samples: Floats) -> Floats:
        """Refine samples of a filter, (s, n, 3)."""
        return np.array([self.refine(sample, 3) for sample in samples])

    def compute_fits(self, candidates: Floats) -> Floats:
        """Compute log-likelihoods per beam at poses (c, n, 3), (c, n); NaN without returns."""
        from locplan.recordings.kernels.least_squares import evaluate_fits

        fits = np.empty(candidates.shape[:2])
        evaluate_fits(
            self.walls.distances, make_beam_model(SIGMA, BEAMS), self.ends, candidates, fits
        )
        return fits

    def find_likeliest_trajectory(self, candidates: Floats) -> Floats:
        """Combine the most probable trajectory (n, 3) from candidates (c, n, 3)."""
        from locplan.recordings.kernels.trajectory import find_likeliest_candidates

        gains = BEAMS * np.maximum(np.nan_to_num(self.compute_fits(candidates)), UNEXPLAINED)
        _, _, moves, deviations = self._kernel_scans
        choice = find_likeliest_candidates(
            candidates, gains, moves, deviations, self.walls.kidnap_density
        )
        return np.asarray(candidates[choice, np.arange(len(choice))])

    def compute_covariances(self, poses: Floats, n_effective_beams: float) -> tuple[Floats, Floats]:
        """Compute the covariances of poses, and of each pose with the previous one.

        `n_effective_beams` is the number of independent beams of a scan.
        """
        from locplan.recordings.kernels.least_squares import (
            NormalEquations,
            write_covariances,
            write_normal_equations,
        )

        blocks = np.empty((4, len(poses), 3, 3))
        equations = NormalEquations(blocks[0], blocks[1], np.empty((len(poses), 3)))
        model = make_beam_model(FINE, n_effective_beams)
        write_normal_equations(self.walls.distances, model, self._kernel_scans, poses, equations)
        write_covariances(equations, blocks[2], blocks[3])
        return blocks[2], blocks[3]

    def refit_odometry_model(self, poses: Floats) -> ScanChain:
        """Return the chain with the odometry model refitted to poses."""
        covariances, across = self.compute_covariances(poses, FINE_BEAMS)
        is_used = np.ones(len(poses))
        is_used[[0, *self.jumps]] = 0.0
        model = self.model.refit(
            self.moves, *compute_moves_with_variances(poses, covariances, across), is_used
        )
        return replace(self, model=model)

    def compute_errors(self, poses: Floats) -> Floats:
        """Compute the error of odometry from each pose to the next, (n, 3) [m, m, rad]."""
        errors = np.zeros((len(poses), 3))
        errors[1:] = (
            compute_motions(poses[:-1], poses[1:]) - self.model.correct_ways(self.moves)[1:]
        )
        errors[:, 2] = wrap_angles(errors[:, 2])
        return errors

    def find_jumps(self, poses: Floats) -> tuple[int, ...]:
        """Find the scans before which odometry jumps, by large and improbable errors."""
        errors = self.compute_errors(poses)
        square = ((errors / self.model.compute_deviations(self.moves)) ** 2).sum(axis=1)
        is_far = (np.hypot(errors[:, 0], errors[:, 1]) > 0.5) | (np.abs(errors[:, 2]) > 0.5)
        return tuple(map(int, np.flatnonzero(is_far & (square > 40.0))))

    def bridge_excursions(self, poses: Floats) -> tuple[Floats, Bools]:
        """Replace poses between two opposite jumps by odometry; return the poses and their mask.

        A robot that seems to be carried away and back along its odometry has not left: the scans
        were matched at a similar place.
        """
        bridged, is_bridged = poses.copy(), np.zeros(len(poses), np.bool_)
        errors, ways = self.compute_errors(poses), self.model.correct_ways(self.moves)
        far = [n for n in self.find_jumps(poses) if np.hypot(*errors[n, :2]) > CARRIED]
        for begin, end in itertools.combinations(far, 2):
            across = poses[begin - 1 : end + 1].copy()
            for n in range(begin, end + 1):
                across[n - begin + 1] = apply_motions(across[n - begin], ways[n])
            closing = poses[end] - across[-1]
            closing[2] = wrap_angles(closing[2])
            is_closed = np.hypot(*closing[:2]) < CARRIED / 2
            if is_closed and not is_bridged[begin - 1 : end + 1].any():
                share = np.arange(1, end - begin + 1) / (end - begin + 1)
                bridged[begin:end] = across[1:-1] + share[:, None] * closing
                is_bridged[begin:end] = True
        return bridged, is_bridged

    def find_displaced_poses(self, poses: Floats) -> Bools:
        """Find poses on displaced parts of the map, between opposite errors of odometry.

        Poses on a displaced part are shifted at its beginning, and shifted back at its end. If the
        part is turned, odometry jumps at one of them.
        """
        way, is_displaced = np.cumsum(self.moves.lengths), np.zeros(len(poses), np.bool_)
        shifts = itertools.combinations(self._find_shifts(poses, way), 2)
        # Turns accumulate within the stretch as well, so that a larger rest may remain.
        for (entering, leaving), rest in itertools.chain(
            ((pair, 0.5) for pair in shifts),
            ((pair, 1.0) for pair in self._find_turn_error_pairs(poses)),
        ):
            begin, end = entering.end, leaving.begin
            is_near = begin <= end and way[end] - way[begin] < DISPLACED_LENGTH
            if is_near and math.hypot(*(entering.error + leaving.error)) < rest * min(
                math.hypot(*entering.error), math.hypot(*leaving.error)
            ):
                is_displaced[begin : end + 1] = True
        return is_displaced

    def _find_shifts(self, poses: Floats, way: Floats) -> list[_OdometryShift]:
        """Find stretches of up to 4 m without jumps with a significant shift of odometry."""
        before = np.zeros((len(poses), 3))
        before[1:, 2] = poses[:-1, 2]
        errors = apply_motions(before, self.compute_errors(poses))[:, :2]
        errors[list(self.jumps)] = 0.0
        squares = self.model.compute_deviations(self.moves)[:, :2] ** 2
        sums, variances = np.cumsum(errors, axis=0), np.cumsum(squares.mean(axis=1))
        marks = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], 1.0))).tolist()
        spans = sorted(span for n in range(1, 5) for span in zip(marks, marks[n:], strict=False))
        shifts = (_OdometryShift(begin, end, sums[end] - sums[begin]) for begin, end in spans)
        return [
            shift
            for shift in shifts
            if math.hypot(*shift.error) > DISPLACED_SHIFT
            and (shift.error**2).sum() > 25 * (variances[shift.end] - variances[shift.begin])
        ]

    def _find_turn_error_pairs(self, poses: Floats) -> list[tuple[_OdometryShift, _OdometryShift]]:
        """Find pairs of scans with a significant turn error, if at least one is a jump."""
        errors = self.compute_errors(poses)[:, 2:]
        size, deviations = np.abs(errors[:, 0]), self.model.compute_deviations(self.moves)[:, 2]
        turns = np.flatnonzero((size > DISPLACED_TURN) & (size > 5 * deviations)).tolist()
        return [
            (
                _OdometryShift(first - 1, first, errors[first]),
                _OdometryShift(second - 1, second, errors[second]),
            )
            for first, second in itertools.combinations(turns, 2)
            if first in self.jumps or second in self.jumps
        ]


class _OdometryShift(NamedTuple):
    """Error of odometry between two scans."""

    begin: int
    end: int
    error: Floats
    """Shift along x and y [m], or turn [rad]."""


VERSION = 4
"""Version of the results of `smooth`; increase it when results change."""


def load_or_smooth(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    start: ArrayLike | str | None = None,
    seed: int = 1,
    cache_dir: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> Trajectory:
    """Load the trajectory of a recording from the cache, or compute it by `smooth`.

    An interrupted computation resumes.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    robot, start, seed, progress
        See `smooth`.
    cache_dir : path, optional
        Cache folder; by default LOCPLAN_CACHE of the environment, or the user's cache.

    Raises
    ------
    LocplanError
        As for `smooth`.
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_grid(grid)

    def compute_trajectory(parts_folder: Path | None) -> Trajectory:
        return smooth(
            grid, recording, robot, start, folder=parts_folder, seed=seed, progress=progress
        )

    def save_trajectory(file: Path, trajectory: Trajectory) -> None:
        trajectory.write(file)

    key = _compute_digest(recording, grid, robot, start, seed)
    trajectory = load_or_compute_result(
        key, Trajectory.load, compute_trajectory, save_trajectory, cache_dir=cache_dir
    )
    # The names are not in the digest.
    return replace(trajectory, grid=grid, map=grid.name, drive=recording.source.file)


def with_ground_truth(
    recording: Recording,
    grid: OccupancyGrid,
    reference: str | None = None,
    robot: Robot | None = None,
    *,
    cache_dir: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> Recording:
    """Return the recording with ground-truth poses.

    Scans with doubtful smoothed poses are dropped.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    reference : {"log", "smoothed"}, optional
        The recorded poses, or poses from `smooth`. By default, bags are smoothed, because their
        poses may come from a filter, and other files keep their poses.
    robot, cache_dir, progress
        See `load_or_smooth`.

    Raises
    ------
    LocplanError
        As for `load_or_smooth`.
    """
    if reference is not None:
        check_choice("reference", reference, ("log", SMOOTHED))
    of_bag = bool(recording.source.lidar_frame)  # other files name none
    if recording.source.poses == SMOOTHED or (reference or ("log", SMOOTHED)[of_bag]) == "log":
        return recording
    drive_trajectory = load_or_smooth(
        recording, grid, robot, cache_dir=cache_dir, progress=progress
    )
    return drive_trajectory.replace_poses(recording)


def _compute_digest(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None,
    start: ArrayLike | str | None,
    seed: int,
) -> str:
    """Compute the cache key of a trajectory from all its inputs."""
    odometry = recording.robot(robot).odometry
    inputs = VERSION, grid.digest, repr(recording.lidar), repr(odometry), repr(start), seed
    digest = hashlib.sha256(repr(inputs).encode())
    for array in (recording.ranges, recording.poses, recording.times, recording.odometry):
        digest.update(b"-" if array is None else array.tobytes())
    return digest.hexdigest()[:32]

"""Replays of AMCL on the odometry and scans of a recorded drive."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_instance, check_integer, check_memory, check_threads
from locplan._support.intervals import (
    Interval,
    assign_blocks,
    estimate_block_mean,
    format_metres,
    format_percent,
    make_generator,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.output import ResultFiles
from locplan._support.poses import (
    compute_motions,
    compute_path_length,
    find_update_poses,
    make_rotation_matrix,
    wrap_angles,
)
from locplan._support.progress import ProgressCallback
from locplan._support.records import Result, Table, TableColumn, extract_values
from locplan._support.tables import REPORT_WIDTH, format_table, nan_to_none
from locplan.errors import RecordingError
from locplan.field.covariance import scalar
from locplan.maps.grid import OccupancyGrid, check_grid, format_extent, world_to_map_frame
from locplan.recordings.matching import run_in_batches
from locplan.recordings.recording import Recording
from locplan.robots.amcl import Amcl
from locplan.robots.particles import compute_compared_ends
from locplan.robots.robot import Robot
from locplan.simulation.amcl_parameters import has_default_preset_parameters
from locplan.simulation.drives import (
    DRIVE_COLUMNS,
    LOST_TEXT,
    PROFILE_COLUMNS,
    RATE_COLUMNS,
    DriveArguments,
    Drives,
    make_drive_arguments,
)
from locplan.simulation.worlds import check_filter_map, summarize_filter_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


REPLAY = 14
"""Stream of random numbers of replays."""


def find_sparse_scan_notes(recording: Recording, amcl: Amcl) -> tuple[str, ...]:
    """Return a note if the scans are too sparse for the updates of the filter; otherwise nothing.

    Updates must also be rarer than with Nav2's defaults, so that frequent updates in the settings
    do not make every log sparse.

    Parameters
    ----------
    recording : Recording
        The recording, with odometry.
    amcl : Amcl
        The filter's settings.
    """
    assert recording.odometry is not None
    updates = find_update_poses(recording.odometry, amcl.update_min_d, amcl.update_min_a)
    at = recording.odometry[updates, :2]
    steps = np.hypot(*np.diff(at, axis=0).T)
    spacing = float(np.median(steps)) if len(steps) else 0.0
    if spacing <= 1.5 * max(amcl.update_min_d, Amcl().update_min_d):
        return ()
    return (
        f"the log has a scan only every {spacing:.2g} m, but AMCL updates every"
        f" {amcl.update_min_d:g} m, so expect a smaller error with all scans",
    )


class ReplayInputs:
    """Inputs of the filter from a recorded drive, in the map frame.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or its first pose is outside of the map.
    """

    def __init__(self, recording: Recording, grid: OccupancyGrid) -> None:
        self.recording, self.grid = recording, grid
        if recording.odometry is None:
            raise RecordingError(
                f"{recording.source.file or 'the recording'} has no odometry, which a replay needs;"
                " record it as well, or set its topic with odom_topic="
            )
        recorded_length, reported_length = recording.length, compute_path_length(recording.odometry)
        if reported_length < 0.1 * recorded_length:
            raise RecordingError(
                f"the odometry moves by only {reported_length:.1f} m, but the poses by"
                f" {recorded_length:.1f} m; check the topic of odometry"
            )
        x, y, _ = recording.poses[0].tolist()
        if not grid.contains(*grid.cell((x, y))):
            raise RecordingError(
                f"the drive begins at {x:.2f},{y:.2f}, outside of {grid.name or 'the map'}, which"
                f" reaches from {format_extent(grid)}. Check the map with"
                " locplan.recordings.fit_to_map"
            )
        self.odometry: Floats = recording.odometry
        self.truth = world_to_map_frame(grid, recording.poses)
        self._turn = make_rotation_matrix(grid.origin[2])

    def make_arguments(
        self, robot: Robot, scores: NDArray[np.float32] | None = None
    ) -> DriveArguments:
        """Make the arguments of the kernels for a robot."""
        robot = replace(robot, lidar=self.recording.lidar)
        return make_drive_arguments(self.grid, robot, scores=scores)

    def select_amcl_ends(self, amcl: Amcl) -> Floats:
        """Select ends of the beams that AMCL uses, (n, beams, 2) [cells]; NaN without a return."""
        ends = compute_compared_ends(amcl, self.recording.lidar, self.recording.ranges)
        return ends / self.grid.resolution

    def run_filter(
        self,
        random: np.random.Generator,
        ends: Floats,
        arguments: DriveArguments,
    ) -> tuple[Floats, Floats]:
        """Run the filter once; return errors (n, 3) and covariances (n, 3, 3) in the world."""
        from locplan._support.kernels.drives import replay_filter as kernel

        truth = self.truth
        poses, covariances = np.empty_like(truth), np.empty((len(truth), 3, 3))
        drive = truth[0].copy(), np.ascontiguousarray(self.odometry), ends
        settings = arguments.scores, arguments.start, arguments.filter
        kernel(random, *drive, *settings, poses, covariances)
        errors = poses - truth
        errors[:, 2] = wrap_angles(errors[:, 2])
        return errors @ self._turn.T, self._turn @ covariances @ self._turn.T


def remove_jumps(
    poses: Floats, odometry: Floats, is_faulty: NDArray[np.bool_] | None = None
) -> tuple[Floats, Floats, int]:
    """Remove jumps between poses and odometry by standing still; return both, and their number.

    Otherwise, a jump would outweigh all noise of a drive. Faulty steps are removed as well.

    Parameters
    ----------
    poses, odometry : (n, 3) arrays
        Recorded poses, and poses by odometry, in separate frames [m, m, rad].
    is_faulty : (n - 1,) array of bool, optional
        Mask of the steps of odometry that are wrong.

    Examples
    --------
    >>> poses = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> shifted = poses + [[5.0, 0, 0], [5.0, 0, 0], [0, 0, 0]]
    >>> still, odometry, jumps = remove_jumps(poses, shifted)
    >>> still[:, 0].tolist(), odometry[:, 0].tolist(), jumps
    ([0.0, 1.0, 1.0], [5.0, 6.0, 6.0], 1)
    """
    true, reported = (compute_motions(track[:-1], track[1:]) for track in (poses, odometry))
    off = reported - true
    step_error, true_way, way = (
        np.hypot(motions[:, 0], motions[:, 1]) for motions in (off, true, reported)
    )
    # A jump exceeds 0.5 m or 0.5 rad, plus 30 % of the step.
    far = step_error > 0.5 + 0.3 * np.minimum(true_way, way)
    far |= np.abs(wrap_angles(off[:, 2])) > 0.5 + 0.3 * np.abs(wrap_angles(true[:, 2]))
    left_out = far if is_faulty is None else far | is_faulty
    if not left_out.any():
        return poses, odometry, 0
    tracks = (
        _chain_motions(poses[0], true, left_out),
        _chain_motions(odometry[0], reported, left_out),
    )
    return *tracks, int(far.sum())


def _chain_motions(first_pose: Floats, motions: Floats, is_left_out: NDArray[np.bool_]) -> Floats:
    """Chain motions from the first pose, without the ones left out."""
    ahead, left, turn = np.where(is_left_out[:, None], 0.0, motions).T
    heading = first_pose[2] + np.append(0.0, np.cumsum(turn))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = first_pose[0] + np.append(0.0, np.cumsum(cos * ahead - sin * left))
    y = first_pose[1] + np.append(0.0, np.cumsum(sin * ahead + cos * left))
    return np.column_stack([x, y, wrap_angles(heading)])


@dataclass(frozen=True)
class FilterConsistency:
    """Consistency of the filter's covariances with its errors, at updates with resampling.

    The interval comes from a bootstrap over blocks of 10 m of the drive; NaN with fewer than five
    blocks.
    """

    share_within: Interval
    """Share of recorded positions within the filter's 95 % ellipse, 0..1."""
    ellipse_factor: float
    """Factor on the size of the filter's ellipses that makes them correct: half of the positions
    lie within the 50 % ellipses then."""
    filter_std: float
    """Median of the filter's rms deviation of the position [m]."""
    error: float
    """Median distance from the recorded position, at the same scans [m]."""
    updates: int
    """Number of updates; without any, all other values are NaN."""

    @property
    def sentence(self) -> str:
        """Verdict on the covariances, for people."""
        if self.updates < 10:
            return (
                f"The filter resampled its particles at only {self.updates} scans, too few to"
                " evaluate its covariance."
            )
        share = f"{self.share_within.value:.0%} of the recorded positions are in its 95 % ellipse"
        if self.share_within.value < 0.85:
            return (
                f"The filter is overconfident: {share}, which should be {self.ellipse_factor:.1f}"
                " times as wide, unless the recorded poses are inaccurate."
            )
        if self.share_within.value > 0.98 and self.ellipse_factor < 0.7:
            return (
                f"The filter overestimates its error: {share}, which could be"
                f" {self.ellipse_factor:.1f} times as wide."
            )
        return f"The filter's covariance agrees with its errors: {share}."


@dataclass(frozen=True, eq=False, repr=False)
class Replay(Result):
    """Runs of AMCL on one recorded drive with different random numbers."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "replay",
        ("replay.json", "replay.png", "errors.csv"),
        purposes={
            "replay.png": "the picture",
            "errors.csv": "the errors along the drive",
        },
    )

    recording: Recording
    """The drive."""
    grid: OccupancyGrid
    """The map."""
    robot: Robot
    """The robot, with the recording's lidar."""
    seed: int
    """Seed of all random numbers."""
    errors: Floats
    """The filter's pose minus the recorded pose, (runs, n, 3), in the world [m, m, rad]."""
    covariances: Floats
    """Covariance of the particles as AMCL publishes it, (runs, n, 3, 3), in the world; NaN without
    resampling."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it is not `grid`."""

    def __repr__(self) -> str:
        return f"Replay({self.grid.name or 'map'}, {self.drives!r})"

    @cached_property
    def drives(self) -> Drives:
        """The runs as drives, with the same statistics as simulated drives."""
        return Drives(self.recording.poses, self.errors)

    @property
    def poses(self) -> Floats:
        """The filter's poses, (runs, n, 3), in the world [m, m, rad]."""
        return np.asarray(self.recording.poses + self.errors)

    @property
    def is_updated(self) -> NDArray[np.bool_]:
        """Mask of the scans at which the filter resampled its particles, (n,)."""
        return np.isfinite(self.covariances[0, :, 0, 0])

    @property
    def nees(self) -> Floats:
        """Normalized estimation error squared (NEES) of the position, (runs, n).

        NaN without resampling. The mean is 2 if the covariances are correct.
        """
        # Add 0.1 mm, so that no covariance is singular.
        covariance = self.covariances[..., :2, :2] + 1e-8 * np.eye(2)
        error = self.errors[..., :2]
        a, b, c = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
        x, y = error[..., 0], error[..., 1]
        return np.asarray((c * x**2 - 2 * b * x * y + a * y**2) / (a * c - b**2))

    @property
    def filter_std(self) -> Floats:
        """Rms deviation of the position that the filter reports, median over runs, (n,) [m]."""
        return np.asarray(np.median(scalar(self.covariances, "position_rms"), axis=0))

    @cached_property
    def consistency(self) -> FilterConsistency:
        """Consistency of the filter's covariances with its errors."""
        at = self.is_updated
        if not at.any():
            unknown = math.nan
            return FilterConsistency(
                Interval(unknown, unknown, unknown), unknown, unknown, unknown, 0
            )
        # With correct covariances, the NEES has a chi-square distribution of two degrees of
        # freedom: 95 % are below -2 ln 0.05, and half are below 2 ln 2.
        squares = self.nees[:, at]
        inside = (squares <= -2 * math.log(0.05)).mean(axis=0)
        return FilterConsistency(
            estimate_block_mean(inside, assign_blocks(self.recording.poses)[at]),
            math.sqrt(float(np.median(squares)) / (2 * math.log(2))),
            float(np.median(scalar(self.covariances[:, at], "position_rms"))),
            float(np.median(self.drives.position_error[:, at])),
            int(at.sum()),
        )

    @property
    def verdict(self) -> str:
        """Verdict for people: whether the filter gets lost, or the consistency of its errors."""
        drives, lost = self.drives, self.drives.lost_rate.value
        if self.is_sparse:
            note = self.notes[0]
            if not drives.lost.any():
                return f"The filter was never {LOST_TEXT}, although {note}."
            return (
                f"This log has too few scans to measure how often the filter gets lost: {note}."
                " Record every scan."
            )
        if lost < 0.05:
            return self.consistency.sentence
        sentence = (
            f"The filter is {LOST_TEXT} at some time in {lost:.0%} of the runs, and on"
            f" {drives.lost_way.value:.0%} of the path."
        )
        if math.isfinite(drives.first_loss):
            at = int(np.searchsorted(drives.distance, drives.first_loss))
            x, y, _ = self.recording.poses[at].tolist()
            sentence += (
                f" It first gets lost after {drives.first_loss:.0f} m, near {x:.1f},{y:.1f}."
            )
        if has_default_preset_parameters(self.robot.amcl):
            return f"{sentence} Run locplan tune --recording to find better settings."
        return f"{sentence} Check the map and the odometry there (locplan recording FILE MAP)."

    @property
    def is_sparse(self) -> bool:
        """True if the log has too few scans to measure how often the filter gets lost."""
        return bool(find_sparse_scan_notes(self.recording, self.robot.amcl))

    @property
    def notes(self) -> tuple[str, ...]:
        """Limits of the replay, as sentences without a full stop."""
        return find_sparse_scan_notes(self.recording, self.robot.amcl)

    def summary(self) -> dict[str, object]:
        """Return all results for JSON."""
        consistency = self.consistency
        content: dict[str, object] = {
            "drive": self.recording.summary(),
            "map": {"name": self.grid.name, "digest": self.grid.digest},
            "runs": len(self.errors),
            "updates": consistency.updates,
            "errors": extract_values(DRIVE_COLUMNS, self.drives),
            "consistency": {
                "within_95_ellipse": list(consistency.share_within),
                "wider_by": consistency.ellipse_factor,
                "filter_std": consistency.filter_std,
                "error": consistency.error,
            },
            "verdict": self.verdict,
            "notes": list(self.notes),
            "seed": self.seed,
            "robot": self.robot.summary(),
            **summarize_filter_map(self.filter_map),
        }
        return nan_to_none(content)

    def table(self) -> Table:
        """Return a row per scan: recorded pose, errors, and the filter's reported deviation."""
        rows = np.column_stack([self.drives.profile(), self.filter_std]).tolist()
        return Table((*PROFILE_COLUMNS, TableColumn("filter_std", "m")), tuple(map(tuple, rows)))

    def figure(self) -> Figure:
        """Draw the recorded path and the filter's on the map, and the error along the drive."""
        from locplan.recordings.figures import replay_figure

        return replay_figure(self)

    def report(self) -> str:
        """Return a table of the errors and of the filter's consistency, with a verdict."""
        return replay_report(self)


REPLAY_RUNS = 20
"""Default number of runs of `replay`."""


def replay(
    recording: Recording,
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    runs: int = REPLAY_RUNS,
    filter_map: OccupancyGrid | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Replay:
    """Run AMCL on the odometry and the scans of a recorded drive.

    The filter is the same as in simulated drives and follows Nav2's AMCL. It gets odometry only at
    the scans, and starts near the first recorded pose, with a random error as in simulation.

    Parameters
    ----------
    recording : Recording
        The drive, with odometry; its poses are the reference.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    robot : Robot, optional
        The robot, with its filter and the error of the filter's first pose; by default Nav2's
        settings.
    runs : int, default 20
        Number of runs with different random numbers, 1 to 10,000. Raise it to measure how often
        the filter gets lost.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, on any number of threads.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) runs.

    Returns
    -------
    Replay
        The errors and covariances of all runs, and a verdict.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or its first pose is outside of the map.
    ConfigError
        If a number is out of range.

    Examples
    --------
    >>> import numpy as np, locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> lidar = locplan.Lidar(range=5.0, field_of_view_deg=180.0, beams=5)
    >>> poses = [[2.0 + n / 4, 3.0, 0.0] for n in range(9)]
    >>> drive = Recording(np.full((9, 5), 1.0), lidar, poses, odometry=poses)
    >>> replay(drive, grid, runs=2).errors.shape
    (2, 9, 3)
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_grid(grid)
    robot = recording.robot(robot)
    check_integer("runs", runs, 1, 10_000)
    check_integer("seed", seed, 0)
    workers = check_threads(threads)
    check_memory(f"{runs} runs of {len(recording)} scans", 12 * 8 * runs * len(recording), "fewer")
    tracks = ReplayInputs(recording, check_filter_map(filter_map, grid))
    arguments = tracks.make_arguments(robot)
    errors = np.empty((runs, len(recording), 3))
    covariances = np.empty((runs, len(recording), 3, 3))
    ends = tracks.select_amcl_ends(robot.amcl)

    def run(run_numbers: NDArray[np.int64]) -> list[int]:
        numbers: list[int] = run_numbers.tolist()
        for n in numbers:
            errors[n], covariances[n] = tracks.run_filter(
                make_generator(seed, REPLAY, n), ends, arguments
            )
        return numbers

    run_in_batches(run, runs, workers, progress, batch_size=1)
    return Replay(recording, grid, robot, seed, errors, covariances, filter_map)


def replay_report(replay: Replay) -> str:
    """Return a table of the errors and of the filter's consistency, with a verdict."""
    consistency, within = replay.consistency, replay.consistency.share_within
    share = f"{within.value:.0%}" if np.isnan(within.low) else format_percent(within)
    # With sparse scans, rates of losses describe the log, not the filter.
    columns = [
        column for column in DRIVE_COLUMNS if column not in RATE_COLUMNS or not replay.is_sparse
    ]
    of_filter = [
        ("within the 95 % ellipse", share),
        ("rms deviation reported by the filter", format_metres(consistency.filter_std)),
    ]
    rows = [
        ("map", replay.grid.name),
        ("drive", repr(replay.recording)),
        ("runs", f"{len(replay.errors)}, each of {consistency.updates} updates"),
        *Table.from_records(columns, [replay.drives]).format_transposed(),
        *(of_filter if consistency.updates and not replay.is_sparse else ()),
    ]
    caption = (
        "errors against the recorded positions [95 % interval over runs; for the ellipse, over"
        f" blocks of\n10 m], with {replay.robot.title}"
    )
    verdict_text = textwrap.fill(replay.verdict, REPORT_WIDTH, break_on_hyphens=False)
    lines = (
        [verdict_text, format_table([], rows), caption]
        if replay.is_sparse
        else [format_table([], rows), caption, verdict_text]
    )
    return "\n".join(lines)


RUNS = 12
"""Number of runs of a filter over a drive: settings that lose 10 % of the runs lose at least one of
12 runs with a probability of 72 %."""
SHORTEST = 30.0
"""Minimum length of a drive to compare settings [m]."""


@dataclass(frozen=True, eq=False)
class ReplayedDrive:
    """A recorded drive on its map, to replay different filter settings."""

    name: str
    """Name in tables."""
    recording: Recording
    """The drive, with odometry and ground-truth poses."""
    grid: OccupancyGrid
    """The map."""
    robot: Robot
    """The robot; its filter is replaced by the replayed settings."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it is not `grid`."""
    runs: int = RUNS
    """Number of runs."""
    seed: int = 1
    """Seed of all random numbers; equal settings have equal runs."""
    threads: int | None = None
    """Number of threads; all cores by default."""

    def replay(self, amcl: Amcl) -> Drives:
        """Replay filter settings over the whole drive.

        Parameters
        ----------
        amcl : Amcl
            The settings.
        """
        return replay(
            self.recording,
            self.grid,
            replace(self.robot, filter=amcl),
            runs=self.runs,
            filter_map=self.filter_map,
            seed=self.seed,
            threads=self.threads,
        ).drives


def find_replay_obstacle(recording: Recording) -> str:
    """Return the reason why a recording is unsuitable to compare settings; empty if suitable.

    Parameters
    ----------
    recording : Recording
        The recording.

    Examples
    --------
    >>> import numpy as np, locplan
    >>> poses = [[n / 4, 0.0, 0.0] for n in range(9)]
    >>> lidar = locplan.Lidar(range=5.0, beams=5)
    >>> drive = Recording(np.full((9, 5), 1.0), lidar, poses, odometry=poses)
    >>> find_replay_obstacle(drive)
    'it is only 2 m long; at least 30 m are needed to compare settings'
    """
    if recording.odometry is None:
        return "it has no odometry, which the filter needs"
    length = compute_path_length(recording.poses)
    if length < SHORTEST:
        return (
            f"it is only {length:.2g} m long; at least {SHORTEST:g} m are needed to compare"
            " settings"
        )
    return ""

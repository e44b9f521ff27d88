"""Evaluation of estimators on a recorded drive: predicted against measured standard deviations."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_instance, check_threads
from locplan._support.intervals import (
    BootstrapResamples,
    Interval,
    RankStatistics,
    assign_blocks,
    compute_rank_statistics,
    count_block_draws,
    estimate_block_mean,
    format_decimal,
    format_ratio,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import move_ends_to_poses
from locplan._support.progress import ProgressCallback
from locplan._support.public import DrawableResult
from locplan._support.records import POSE, Table, TableColumn
from locplan._support.tables import REPORT_WIDTH, format_table
from locplan.errors import RecordingError
from locplan.field.config import FieldConfig
from locplan.field.covariance import position_axes, scalar
from locplan.field.estimator import Estimator
from locplan.field.fisher import Fisher, Fused
from locplan.field.sad import Sad
from locplan.field.scan import Scan
from locplan.field.store import covariance_field
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import OCCUPIED
from locplan.recordings.matching import ScanMatcher, run_in_batches
from locplan.recordings.recording import Recording
from locplan.robots.lidar import Lidar

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MIN_RETURNS = 10
"""Minimum number of returns to match a scan."""
MIN_FIT_SHARE = 0.6
"""Minimum share of beams that end at walls if a map fits. Six real logs have 0.91 to 1.00 on their
maps, and at most 0.41 on any other of these maps, even after the best move."""


def check_scan_counts(n_fitting: int, n_scans: int) -> None:
    """Raise a RecordingError if fewer than ten scans of a drive fit the map."""
    if n_scans < 10:
        raise RecordingError(
            f"the drive has only {n_scans} scans; at least 10 are needed. Lower every=, or record a"
            " longer drive"
        )
    if n_fitting < 10:
        raise RecordingError(
            f"only {n_fitting} of {n_scans} scans fit the map and lie in its free space. Check the"
            " map and the frame of the poses with locplan.recordings.fit_to_map"
        )


@dataclass(frozen=True, eq=False, repr=False)
class ScanMatches:
    """Posteriors of n scans around their recorded poses, in world coordinates."""

    recording: Recording
    """The scans, with their poses."""
    grid: OccupancyGrid
    """The map."""
    settings: Scan
    """The search window, and the likelihood of beams."""
    mean: Floats
    """Mean offset from the recorded pose, (n, 3) [m, m, rad]."""
    best: Floats
    """Most probable offset, (n, 3) [m, m, rad]."""
    covariance: Floats
    """Covariance around the mean, (n, 3, 3) [m, m, rad]; NaN for scans with too few returns."""
    ambiguity: Floats
    """Probability outside the central mode, (n,), 0..1."""
    entropy: Floats
    """Entropy of the posterior, (n,) [nat]."""
    score: Floats
    """Log-likelihood per return at the most probable offset, (n,); 0 if all ends lie on walls."""
    n_returns: NDArray[np.int64]
    """Number of returns among the compared beams, (n,)."""

    def __repr__(self) -> str:
        median = float(np.nanmedian(self.position_std)) if self.is_matched.any() else math.nan
        return f"ScanMatches({len(self)} scans, median position_std {100 * median:.1f} cm)"

    def __len__(self) -> int:
        return len(self.score)

    @property
    def is_matched(self) -> NDArray[np.bool_]:
        """Mask of the scans with enough returns, on the map, (n,)."""
        return np.asarray(np.isfinite(self.covariance[:, 0, 0]))

    @cached_property
    def stray_share(self) -> Floats:
        """Share of the returns that end away from walls at the most probable offset, (n,).

        Such a return ends beyond three cells, at least 0.25 m, and 2 % of the beam's length from
        the nearest wall. Coarse cells and long beams explain smaller distances.
        """
        import cv2

        clear = np.asarray(self.grid.cells != OCCUPIED, np.uint8)
        distance = self.grid.resolution * cv2.distanceTransform(clear, cv2.DIST_L2, 5)
        min_distance, share = max(3 * self.grid.resolution, 0.25), np.zeros(len(self))
        for first in range(0, len(self), 512):  # blocks save memory
            block = slice(first, first + 512)
            ends = self.recording[block].ends_on_robot()
            at = look_up_cells(
                self.grid,
                distance,
                move_ends_to_poses(ends, self.recording.poses[block] + self.best[block]),
                math.inf,
            )
            is_stray = at > min_distance + np.hypot(*ends.T).T / 50  # False without a return
            share[block] = is_stray.sum(axis=1) / np.maximum(
                np.isfinite(ends[..., 0]).sum(axis=1), 1
            )
        return share

    @property
    def position_std(self) -> Floats:
        """Largest standard deviation of the position, (n,) [m]."""
        return scalar(self.covariance, "position_std")

    @property
    def direction(self) -> Floats:
        """Direction of the largest standard deviation in the world, (n,) [rad]."""
        return position_axes(self.covariance)[2]


def match_scans(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    settings: Scan | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> ScanMatches:
    """Match each scan of a drive with a map, around its recorded pose.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    settings : Scan, optional
        The search window and the likelihood of beams; its `lidar` must be the recording's. By
        default +-1.5 m in 0.1 m and +-4 deg in 1 deg, with 180 beams that count as 15.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Returns
    -------
    Matches
        The posterior of each scan; NaN for scans with fewer than 10 returns, or outside the map.

    Raises
    ------
    RecordingError
        If no scan on the map has enough returns.
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_grid(grid)
    workers = check_threads(threads)
    matcher = (
        ScanMatcher(grid, settings) if settings else ScanMatcher.for_lidar(grid, recording.lidar)
    )
    settings = matcher.settings
    count, beams = len(recording), settings.beams_compared
    row, col = grid.world_to_grid(*recording.poses[:, :2].T)
    cells = np.column_stack([np.floor(row), np.floor(col)])
    mean, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    best, summary = np.zeros((count, 3)), np.full((count, 3), np.nan)
    returns = np.isfinite(recording.ranges[:, settings.nearest_beam_indices]).sum(axis=1)
    inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    usable_scans = np.flatnonzero(inside & (returns >= min(MIN_RETURNS, beams)))
    if not usable_scans.size:
        raise RecordingError(
            "no scan on this map has enough returns. Check the map and the poses with"
            " locplan.recordings.fit_to_map"
        )
    _ = matcher.kernel_arguments  # computed once, before threads need it

    def match(numbers: NDArray[np.int64]) -> list[int]:
        scan_numbers = usable_scans[numbers]
        posteriors = matcher.compute_posteriors(
            recording[scan_numbers].ends_on_robot(), recording.poses[scan_numbers]
        )
        mean[scan_numbers], covariance[scan_numbers], best[scan_numbers], summary[scan_numbers] = (
            posteriors
        )
        return list(scan_numbers)

    run_in_batches(match, usable_scans.size, workers, progress, batch_size=64)
    entropy, ambiguity, score = summary.T
    posterior_parts = mean, best, covariance, ambiguity, entropy, score
    return ScanMatches(recording, grid, settings, *posterior_parts, returns)


def find_cells_near_walls(grid: OccupancyGrid) -> tuple[float, NDArray[np.bool_]]:
    """Return the maximum distance between a wall and a beam that ends at it [m], and a mask of
    the cells within it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    # Rounding of map and beam takes a cell, the thickness of mapped walls another one; 0.1 m is
    # three standard deviations of a lidar's noise.
    distance = max(2 * grid.resolution, 0.1)
    return distance, grid.cells_near_walls(distance)


def look_up_cells(
    grid: OccupancyGrid, values: NDArray[Any], xy: Floats, outside_value: float
) -> Floats:
    """Look up values of cells at points (..., 2) [m]; outside_value off the map and for NaN."""
    row, col = (np.floor(coordinate) for coordinate in grid.world_to_grid(xy[..., 0], xy[..., 1]))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    at = tuple(np.where(inside, coordinate, 0).astype(np.int64) for coordinate in (row, col))
    return np.where(inside, values[at], outside_value)


@dataclass(frozen=True)
class PredictionAgreement:
    """Agreement between predicted and measured standard deviations of an estimator.

    Intervals come from a bootstrap over blocks of 10 m of the drive; NaN with fewer than five
    blocks.
    """

    rank: RankStatistics
    """Rank correlation, -1..1, and AUC for the worst fifth of the scans, 0..1."""
    aligned: Interval
    """Share of elongated ellipses with a direction within 15 deg, 0..1; NaN without any."""
    factor: Interval
    """Ratio of predicted to measured standard deviation of the position, geometric mean."""

    @property
    def table_cells(self) -> list[str]:
        """Cells of a table row: rank correlation, AUC, direction, and factor."""
        aligned = "-" if math.isnan(self.aligned.value) else f"{self.aligned.value:.0%}"
        return [
            format_ratio(self.rank.spearman),
            format_ratio(self.rank.auc),
            aligned,
            format_ratio(self.factor),
        ]


def compute_agreement(
    criterion: Floats, predicted: Floats, measured: Floats, blocks: NDArray[np.int64]
) -> PredictionAgreement:
    """Compare predicted with measured covariances at n scans.

    Parameters
    ----------
    criterion : (n,) array
        The estimator's criterion, which ranks places.
    predicted, measured : (n, d, d) arrays
        Covariances [m, m, rad].
    blocks : (n,) array of int
        The block of the drive of each scan.
    """
    resamples = count_block_draws(blocks)
    major, minor, direction = position_axes(measured)
    predicted_major, _, towards = position_axes(predicted)
    direction_error = np.abs((towards - direction + np.pi / 2) % np.pi - np.pi / 2)
    elongated = (major > 3 * minor).astype(float)  # the direction of a round ellipse is arbitrary
    return PredictionAgreement(
        compute_rank_statistics(
            [criterion], [major], BootstrapResamples([resamples], np.ones((len(resamples), 1)))
        ),
        estimate_block_mean((direction_error < math.radians(15)).astype(float), blocks, elongated),
        Interval(*np.exp(estimate_block_mean(np.log(predicted_major / major), blocks)).tolist()),
    )


PREFERRED = ("fused", "scan", "fisher", "sad")
"""Estimators in the order of preference in verdicts."""

MAX_OUTDATED = 0.3
"""Maximum share of scans that do not match the map for a comparison of estimators."""
LEGEND = (
    "predicted against measured standard deviations of the position [95 % interval, blocks of 10 m]"
    "\nAUC: for the worst fifth; direction: long ellipses within 15 deg; factor: predicted /"
    " measured"
)
"""Explanation of the columns of the report's table."""


@dataclass(frozen=True, eq=False, repr=False)
class DriveEvaluation(DrawableResult):
    """Measured and predicted standard deviations along a recorded drive."""

    matches: ScanMatches
    """Posteriors of the scans: the measured covariances."""
    predicted: Mapping[str, Floats]
    """Predicted covariances at the scans by estimator, (n, d, d) in the world [m, m, rad]; d is 2
    or 3; NaN outside of the field."""
    criteria: Mapping[str, str]
    """The scalar of each estimator that ranks places, such as "position_std"."""

    def __repr__(self) -> str:
        return f"DriveEvaluation({len(self.matches)} scans, {', '.join(self.predicted)})"

    @cached_property
    def is_outdated(self) -> NDArray[np.bool_]:
        """Mask of scans that do not match the map, (n,): people, changes, plants."""
        # Log-likelihood of a scan with a sixth of its returns away from walls.
        poor = self.matches.is_matched & (self.matches.score < -0.5)
        if poor.sum() > MAX_OUTDATED * len(poor):  # the map, the poses or the mount are wrong
            return np.asarray(poor)
        # Coarse cells, long beams and plants also cause poor fits, but few stray returns.
        return np.asarray(poor & (self.matches.stray_share > 1 / 6))

    @cached_property
    def is_compared(self) -> NDArray[np.bool_]:
        """Mask of scans with a measured and all predicted covariances, (n,)."""
        has_values = self.matches.is_matched & ~self.is_outdated
        for covariances in self.predicted.values():
            has_values &= np.isfinite(covariances[:, 0, 0])
        return np.asarray(has_values)

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """Index of the 10 m block of the drive of each scan, (n,)."""
        return assign_blocks(self.matches.recording.poses)

    @cached_property
    def agreements(self) -> dict[str, PredictionAgreement]:
        """Agreement of each estimator with the measurement, at the compared scans."""
        scans = self.is_compared
        return {
            name: compute_agreement(
                scalar(covariance[scans], self.criteria[name]),
                covariance[scans],
                self.matches.covariance[scans],
                self.blocks[scans],
            )
            for name, covariance in self.predicted.items()
        }

    @property
    def verdict(self) -> list[str]:
        """Two sentences: which field predicts the measured uncertainty, and the worst place."""
        n_outdated = int(self.is_outdated.sum())
        if n_outdated > MAX_OUTDATED * len(self.is_outdated):
            return [
                f"{n_outdated} of {len(self.is_outdated)} scans do not fit the map at their"
                " poses: check the mount of the lidar, the poses, and that the map is current.",
                "The comparison with the fields is meaningless until the scans fit.",
            ]
        return [
            _describe_fields(self.agreements),
            f"{self._describe_worst_place()}{self._describe_map_changes()}.",
        ]

    def _describe_worst_place(self) -> str:
        """Describe the 10 m with the largest measured standard deviation."""
        compared, blocks, std = self.is_compared, self.blocks, self.matches.position_std
        nine_of_ten = float(np.quantile(std[compared], 0.9))
        if nine_of_ten <= 0.1:
            return (
                f"In 90 % of the scans, the standard deviation of the position is below"
                f" {100 * nine_of_ten:.0f} cm, so other routes gain little"
            )
        block_numbers, number, counts = np.unique(
            blocks[compared], return_inverse=True, return_counts=True
        )
        worst = block_numbers[np.argmax(np.bincount(number, np.log(std[compared])) / counts)]
        is_worst = compared & (blocks == worst)
        count, median = int(is_worst.sum()), float(np.median(std[is_worst]))
        scans = "the only compared scan has" if count == 1 else f"{count} scans have"
        n_blocks = len(np.unique(blocks))
        left = n_blocks - len(block_numbers)
        without = f"; {left} of {n_blocks} blocks of 10 m have no compared scan" if left else ""
        return (
            f"The worst 10 m are around {self._format_mean_position(is_worst)}: {scans} a"
            f" standard deviation of {100 * median:.0f} cm along"
            f" {_compute_mean_axis_degrees(self.matches.direction[is_worst])}°{without}"
        )

    def _describe_map_changes(self) -> str:
        """Describe where the map is outdated; empty if few scans differ from it."""
        outdated, blocks = self.is_outdated, self.blocks
        if outdated.sum() < max(1, 0.05 * len(outdated)):
            return ""
        block_numbers, counts = np.unique(blocks[outdated], return_counts=True)
        is_worst = outdated & (blocks == block_numbers[np.argmax(counts)])
        return (
            f"; {outdated.sum()} of {len(outdated)} scans do not match the map, most around"
            f" {self._format_mean_position(is_worst)}: people, changes, or plants"
        )

    def _format_mean_position(self, is_chosen: NDArray[np.bool_]) -> str:
        """Format the mean position of some scans, without -0.0."""
        middle = self.matches.recording.poses[is_chosen, :2].mean(axis=0)
        return ",".join(f"{round(float(value), 1) + 0.0:.1f}" for value in middle)

    def report(self) -> str:
        """Return the drive, the agreement of each estimator, and the verdict as text."""
        matches, compared = self.matches, self.is_compared
        low, middle, high = 100 * np.quantile(matches.position_std[compared], (0.1, 0.5, 0.9))
        n_outdated = int(self.is_outdated.sum())
        n_off = len(matches) - int(compared.sum()) - n_outdated
        rows = [
            ("map", matches.grid.name),
            ("drive", repr(matches.recording)),
            ("scans compared", f"{compared.sum()} of {len(matches)}"),
            (
                "excluded",
                f"{n_outdated} that do not match the map, {n_off} outside of free space",
            ),
            ("std. deviation", f"median {middle:.1f} cm, 10 to 90 %: {low:.1f} to {high:.1f} cm"),
        ]
        columns = ["", "rank correlation", "AUC", "direction", "factor"]
        estimators = [[name, *agreement.table_cells] for name, agreement in self.agreements.items()]
        verdict = textwrap.fill(" ".join(self.verdict), REPORT_WIDTH, break_on_hyphens=False)
        return "\n".join(
            [format_table([], rows), format_table(columns, estimators), LEGEND, verdict]
        )

    def table(self) -> Table:
        """Return a row per scan: pose, measured and predicted standard deviations."""
        matches, drive = self.matches, self.matches.recording
        major, minor, direction = position_axes(matches.covariance)
        unknown = np.full(len(drive), np.nan)
        values: dict[TableColumn, NDArray[Any]] = {
            TableColumn("scan"): np.arange(len(drive)),
            TableColumn("time", "s"): unknown
            if drive.times is None
            else drive.times - drive.times[0],
            **dict(zip(POSE, drive.poses.T, strict=True)),
            TableColumn("judged"): matches.is_matched,
            TableColumn("outdated"): self.is_outdated,
            TableColumn("score"): matches.score,
            TableColumn("returns"): matches.n_returns,
            TableColumn("offset_x", "m"): matches.best[:, 0],
            TableColumn("offset_y", "m"): matches.best[:, 1],
            TableColumn("offset_heading", "rad"): matches.best[:, 2],
            TableColumn("major_std", "m"): major,
            TableColumn("minor_std", "m"): minor,
            TableColumn("major_axis", "rad"): direction,
            TableColumn("heading_std", "rad"): np.sqrt(matches.covariance[:, 2, 2]),
            TableColumn("ambiguity"): matches.ambiguity,
        }
        for name, covariance in self.predicted.items():
            predicted_major, _, towards = position_axes(covariance)
            values[TableColumn(f"{name}_major_std", "m")] = predicted_major
            values[TableColumn(f"{name}_major_axis", "rad")] = towards
        rows = np.column_stack([*values.values()]).astype(float).tolist()
        return Table(tuple(values), tuple(map(tuple, rows)))

    def figure(self) -> Figure:
        """Draw the drive on the map, and its standard deviations along the path.

        The wide line shows the predicted standard deviation, the narrow line the measured one.
        Ellipses compare both at some poses. Crosses mark scans that do not match the map.
        """
        from locplan.recordings.figures import drive_figure

        return drive_figure(self)


def evaluate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    estimators: Mapping[str, Estimator] | None = None,
    settings: Scan | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> DriveEvaluation:
    """Compare predicted standard deviations of fields with measured ones along a drive.

    Scans are excluded if over a sixth of their returns end away from all walls, because they do not
    match the map.

    Parameters
    ----------
    recording : Recording
        The drive; its poses are the reference.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    estimators : mapping of str to Estimator, optional
        The estimators by name; by default all of them with the recording's lidar.
    settings : Scan, optional
        The search window and the likelihood of the measurement, see `match_scans`.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) fields and matchings.

    Returns
    -------
    DriveEvaluation
        Measured and predicted standard deviations, their agreement, and a verdict.

    Raises
    ------
    RecordingError
        If too few scans fit the map.
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_scan_counts(len(recording), len(recording))
    if estimators is None:
        estimators = make_estimators(recording.lidar)
    report_progress = progress or (lambda n_done, total: None)
    matches = match_scans(recording, grid, settings=settings, threads=threads)
    report_progress(1, len(estimators) + 1)
    predicted = {}
    for n, (name, estimator) in enumerate(estimators.items(), start=2):
        config = FieldConfig(estimator)
        points = config.lattice_points(grid, recording.poses)
        field = covariance_field(grid, config, points=points, threads=threads)
        predicted[name] = field.at(recording.poses, "covariance")
        report_progress(n, len(estimators) + 1)
    criteria = {name: predictor.criterion for name, predictor in estimators.items()}
    result = DriveEvaluation(matches, predicted, criteria)
    check_scan_counts(int(result.is_compared.sum()), len(recording))
    return result


def make_estimators(lidar: Lidar) -> dict[str, Estimator]:
    """Return all estimators by name, for a recording's lidar.

    Parameters
    ----------
    lidar : Lidar
        The lidar.
    """
    return {"sad": Sad(), "fisher": Fisher(lidar), "scan": Scan(lidar), "fused": Fused(lidar)}


def _describe_fields(agreements: Mapping[str, PredictionAgreement]) -> str:
    """Return the verdict on the best field, in one sentence."""
    names = [name for name in PREFERRED if name in agreements]
    names += [name for name in agreements if name not in names]
    ranks = {name: agreements[name].rank for name in names}
    significant = [
        name
        for name, field_rank in ranks.items()
        if field_rank.spearman.low > 0 and field_rank.auc.value > 0.5
    ]
    for name in significant:
        rank, factor = ranks[name], agreements[name].factor
        if rank.spearman.value >= 0.5:  # good enough to plan by
            return (
                f"On this drive, `{name}` predicts where scans leave the pose uncertain: rank"
                f" correlation {format_ratio(rank.spearman)}, AUC {format_ratio(rank.auc)} for the"
                f" worst fifth. Its standard deviations are {format_decimal(factor.value)} times"
                " the measured ones."
            )
    best = max(names, key=lambda name: ranks[name].spearman.value)
    rank = ranks[best]
    if math.isnan(rank.spearman.low):
        return (
            f"The drive is too short to evaluate fields: `{best}` has a rank correlation of"
            f" {format_decimal(rank.spearman.value)}, but less than 50 m were compared."
        )
    if best in significant:
        return (
            f"The fields rank the scans of this drive only slightly better than chance (`{best}`"
            f" {format_ratio(rank.spearman)}, AUC {format_ratio(rank.auc)}): look at the picture"
            " before you plan with one."
        )
    return (
        f"No field ranks the scans of this drive better than chance (`{best}`"
        f" {format_ratio(rank.spearman)}): find out why before you plan with a field here."
    )


def _compute_mean_axis_degrees(directions: NDArray[np.float64]) -> int:
    """Compute the mean of undirected axes, in whole degrees from 0 to 179."""
    return round(math.degrees(float(np.angle(np.exp(2j * directions).mean()))) / 2) % 180

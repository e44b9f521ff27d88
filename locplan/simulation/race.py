"""Race and confirmation of candidate paths by their simulated drives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan._support.checks import set_frozen_fields
from locplan._support.intervals import (
    Interval,
    compute_wilson_interval,
    estimate_geometric_mean,
    estimate_mean,
)
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.poses import Poses
from locplan._support.progress import ProgressCallback
from locplan._support.records import TableColumn
from locplan._support.saved import EqualByValue
from locplan.planning.metrics import METRICS, PathMetrics
from locplan.planning.path import Path
from locplan.simulation.arrivals import ARRIVAL_COLUMNS, Arrivals
from locplan.simulation.driver import (
    FIRST_CHOOSING_DRIVE,
    compute_route_key,
    drive_closed,
    drive_open,
)
from locplan.simulation.drives import MIN_MEAN_SQUARE, RATE_COLUMNS, Drives
from locplan.simulation.problem import Minimise, RecommendationSettings
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import (
    BETTER,
    NO_DIFFERENCE,
    UNDECIDED,
    VERDICT_WORDS,
    compute_student_interval,
    evaluate_look,
    plan_looks,
)

ROUNDS: tuple[int, int] = (4, 8)
"""Drives of all paths, and of those that are kept, in the race."""
MAX_RACING, MAX_FINALISTS = 5, 3
"""Maximum numbers of paths beside the shortest that are kept in the race, and confirmed."""
RACE_ELIMINATION_LEVEL, FINAL_ELIMINATION_LEVEL = 0.07, 0.3
"""Probability, one-sided, at which a path counts as surely worse than the leader: in the race, and
when finalists are confirmed."""
REQUIRED_LEAD = math.log(0.99)
"""Difference of the mean scores by which a path must lead the shortest in the race.

These five were found by tests/benchmarks/power_of_choices.py: among ten candidates a path of .8 of
the shortest's error is found in 91 % of the choices."""
_FORMER_WORDS = {"clearly better": BETTER, "no worthwhile difference": NO_DIFFERENCE}
"""Verdicts by how files before version 3 of a choice name them; their others are undecided."""
WORTHWHILE_LOG_RATIO = math.log(0.9)
"""Logarithm of the ratio of errors from which on a path is worth leaving the shortest."""


class DriveScores(NamedTuple):
    """What drives are judged by."""

    log_error: Floats
    """Logarithm of the error of each drive, (paths, drives)."""
    lost: Bools
    """True for the drives that were lost, (paths, drives)."""

    def join(self, later: DriveScores) -> DriveScores:
        """These drives and later ones of the same paths.

        Parameters
        ----------
        later : Scores
            Scores of the later drives.
        """
        pairs = zip(self, later, strict=True)
        return DriveScores(*(np.concatenate(pair, axis=1) for pair in pairs))

    def select(self, paths: Sequence[int]) -> DriveScores:
        """The drives of some of the paths.

        Parameters
        ----------
        paths : sequence of int
            Numbers of the paths.
        """
        return DriveScores(self.log_error[paths], self.lost[paths])


DriveCandidates = Callable[[Sequence[int], range], DriveScores]
"""Drives paths of some numbers, with the drives of some numbers."""


@dataclass(frozen=True, eq=False)
class RaceResult(EqualByValue):
    """The path that won the race, and its verdict from fresh drives of it and of the shortest."""

    leader: int
    """Number of the path; 0 if none leads clearly, and then nothing is confirmed."""
    verdict: str
    """The verdict on the leader, see `locplan.simulation.verdict`."""
    ratio: Interval
    """Ratio of the leader's error to the shortest's, with the interval that decides; NaN where
    nothing was confirmed."""
    drives: range
    """Numbers of the drives that are shown of the leader and of the shortest."""
    more_lost: bool = False
    """Whether the leader lost more drives than the shortest path, in the race and after it."""

    def __post_init__(self) -> None:
        if self.verdict not in VERDICT_WORDS:  # of an older file
            set_frozen_fields(self, verdict=_FORMER_WORDS.get(self.verdict, UNDECIDED))

    @property
    def is_worthwhile(self) -> bool:
        """True if the leader errs so little that a detour is worth it, and loses no more drives."""
        return not self.more_lost and self.ratio.value <= math.exp(WORTHWHILE_LOG_RATIO)

    def recommends_leader(self, bold: bool) -> bool:
        """True if the leader replaces the shortest path.

        Parameters
        ----------
        bold : bool
            Whether an undecided leader is also recommended.
        """
        words = (BETTER, UNDECIDED) if bold else (BETTER,)
        return self.is_worthwhile and self.verdict in words


def run_race(
    drive: DriveCandidates,
    handicaps: Floats,
    loss_penalty: float,
    n_drives: int,
    is_time_up: Callable[[], bool] | None = None,
) -> RaceResult:
    """Race paths, and confirm that the winner is better than the shortest.

    Parameters
    ----------
    drive : callable
        Drives some of the paths.
    handicaps : (paths,) array
        Penalty on the score of each path in the race, such as the price of its length.
    loss_penalty : float
        Penalty of a lost drive on its score, added to the logarithm of its error.
    n_drives : int
        Maximum number of confirming drives of each path.
    is_time_up : callable, optional
        Whether time is up, asked before each look but the first.
    """
    finalists, lost = select_finalists(drive, handicaps, loss_penalty)
    if not finalists:
        no_ratio, reported_numbers = Interval(math.nan, math.nan, math.nan), range(ROUNDS[-1])
        drive([0], reported_numbers)  # the race's drives are not those that other commands report
        return RaceResult(0, UNDECIDED, no_ratio, reported_numbers)
    return confirm_finalists(drive, finalists, lost, n_drives, handicaps, is_time_up)


def select_finalists(
    drive: DriveCandidates, handicaps: Floats, loss_penalty: float
) -> tuple[list[int], Ints]:
    """The paths that may be best and lead the shortest, and how many drives each path lost."""

    def score(paths: list[int], path_scores: DriveScores) -> Floats:
        return path_scores.log_error + loss_penalty * path_scores.lost + handicaps[paths][:, None]

    def find_remaining_paths(paths: list[int], round_scores: DriveScores) -> list[int]:
        return [paths[n] for n in _find_contenders(score(paths, round_scores))]

    n_first, n_all = ROUNDS
    all_paths = [*range(len(handicaps))]
    numbers = range(FIRST_CHOOSING_DRIVE, FIRST_CHOOSING_DRIVE + n_all)
    raced_scores = drive(all_paths, numbers[:n_first])
    remaining = sorted({0, *find_remaining_paths(all_paths, raced_scores)[:MAX_RACING]})
    raced_scores = raced_scores.select(remaining).join(drive(remaining, numbers[n_first:]))
    lost = np.zeros(len(all_paths), np.int64)
    lost[remaining] = raced_scores.lost.sum(axis=1)
    scores = dict(zip(remaining, score(remaining, raced_scores).mean(axis=1), strict=True))
    leading = [
        path
        for path in find_remaining_paths(remaining, raced_scores)
        if scores[path] <= scores[0] + REQUIRED_LEAD
    ]
    return leading[:MAX_FINALISTS], lost


def _find_contenders(scores: Floats) -> list[int]:
    """Rows of the scores of paths that may be as good as the leader, the best first."""
    from scipy.special import stdtrit

    prior_std, weight = 0.35, 4  # four drives alone would estimate the deviation too badly
    behind = scores - scores[np.argmin(scores.mean(axis=1))]
    count = scores.shape[1]
    freedom = weight + count - 1
    squares = weight * prior_std**2 + (count - 1) * behind.var(axis=1, ddof=1)
    close = behind.mean(axis=1) <= stdtrit(freedom, 1 - RACE_ELIMINATION_LEVEL) * np.sqrt(
        squares / freedom / count
    )
    return [int(n) for n in np.argsort(scores.mean(axis=1), kind="stable") if close[n]]


def confirm_finalists(
    drive: DriveCandidates,
    finalists: list[int],
    lost_counts: Ints,
    n_drives: int,
    handicaps: Floats,
    is_time_up: Callable[[], bool] | None = None,
) -> RaceResult:
    """Drive the finalists and the shortest afresh, until a difference is known or none is."""
    paths, count, drive_scores = [0, *finalists], 0, None
    looks = plan_looks(n_drives)
    while True:
        before, count = count, looks.pop(0)
        new = drive(paths, range(before, count))
        drive_scores = new if drive_scores is None else drive_scores.join(new)
        log_ratios = drive_scores.log_error[1:] - drive_scores.log_error[0]
        # Choosing the best of several promises too much, not too little: they share the level.
        interim = evaluate_look(
            log_ratios,
            drive_scores.lost[0],
            drive_scores.lost[1:],
            looks_left=len(looks),
            n_alternatives=len(finalists),
        )
        all_lost = lost_counts[paths] + drive_scores.lost.sum(axis=1)
        losing = all_lost[1:] > all_lost[0]
        safe = ~losing & (interim.mean <= WORTHWHILE_LOG_RATIO)
        clear = safe & interim.is_better
        leads = next(group for group in (clear, safe, interim.mean < math.inf) if group.any())
        # The price of length decides between finalists as in the race, and not on the verdict.
        scores = interim.mean + handicaps[paths[1:]]
        best = int(np.argmin(np.where(leads, scores, math.inf)))
        is_futile = (interim.low > WORTHWHILE_LOG_RATIO).all()
        if clear.any() or is_futile or not looks or (is_time_up and is_time_up()):
            ratio = Interval(*(math.exp(end[best]) for end in interim[:3]))
            word, loses_more = interim.words[best], bool(losing[best])
            return RaceResult(paths[best + 1], word, ratio, range(count), loses_more)
        # Finalists that seem worse than the best one, or than what is worthwhile, stay behind: that
        # costs no error, since none of them can be recommended any more.
        _, behind_low, _ = compute_student_interval(
            log_ratios - log_ratios[best], FINAL_ELIMINATION_LEVEL
        )
        _, ratio_low, _ = compute_student_interval(log_ratios, FINAL_ELIMINATION_LEVEL)
        going = np.append(True, ~((behind_low > 0) | (ratio_low > WORTHWHILE_LOG_RATIO)))
        going[best + 1] = True
        rows = np.flatnonzero(going).tolist()
        paths, drive_scores = [paths[row] for row in rows], drive_scores.select(rows)


def compute_log_errors(
    distance: Floats, errors: Floats, minimise: Minimise, max_error: float
) -> Floats:
    """Return the logarithm of the root mean square error of each drive, (drives,).

    Parameters
    ----------
    distance : (n,) array
        Distance driven up to each pose [m].
    errors : (drives, n, 3) array
        The filter's pose minus the true one [m, m, rad].
    minimise : str
        "heading" takes the heading error [rad], "goal-error" the position error over the last
        metre [m], "rmse" and "lost" the position error [m].
    max_error : float
        Upper limit of the errors; larger errors count as this [m, or rad].
    """
    if minimise == "heading":
        squares = errors[..., 2] ** 2
    else:
        squares = errors[..., 0] ** 2 + errors[..., 1] ** 2
    if minimise == "goal-error":
        squares = squares[:, distance >= distance[-1] - 1.0]
    return np.asarray(
        0.5 * np.log(np.minimum(squares.mean(axis=1), max_error**2) + MIN_MEAN_SQUARE)
    )


def compute_max_error(shape: tuple[int, int], resolution: float) -> float:
    """Error of a position as which larger ones count: the length of the map's diagonal [m]."""
    return math.hypot(*shape) * resolution


@dataclass(frozen=True, eq=False)
class DriveStatistics(EqualByValue):
    """How the drives went whose figures are shown of a candidate."""

    derived: ClassVar[tuple[str, ...]] = ("error", "lost_rate", "off_at_end_rate")
    former: ClassVar[tuple[str, ...]] = ("off", "off_at_goal")  # with a limit of 0.5 m

    numbers: range
    """Numbers of the drives; those of the same number are pairs."""
    log_error: Floats
    """Logarithm of the error of each drive, (drives,) [ln m, or ln rad]."""
    lost: Bools
    """True for each drive that was lost, (drives,)."""
    ratio: Interval
    """Ratio of the error to the shortest path's."""
    profile: Floats
    """Distance along the path, and the median, the 10 % and the 90 % quantile over the drives of
    the error of the position there, (n, 4) [m]."""
    off_at_end: Bools = dataclasses.field(default_factory=lambda: np.zeros(0, bool))
    """True for each drive that was off at the end, (drives,)."""

    @classmethod
    def from_drives(
        cls, drives: Drives, numbers: range, log_error: Floats, ratio: Interval
    ) -> DriveStatistics:
        """What is kept of some drives.

        Parameters
        ----------
        drives : Drives
            The drives along one path.
        numbers : range
            Numbers of these drives.
        log_error : (drives,) array
            Logarithm of the error of each drive [ln m, or ln rad].
        ratio : Interval
            Ratio of the error to the shortest path's.
        """
        at = np.unique(np.linspace(0, len(drives.poses) - 1, 200).round().astype(int))
        low, median, high = np.quantile(drives.position_error[:, at], (0.1, 0.5, 0.9), axis=0)
        profile = np.column_stack([drives.distance[at], median, low, high])
        return cls(numbers, log_error, drives.lost, ratio, profile, drives.off_at_end)

    @property
    def error(self) -> Interval:
        """Error of a typical drive: the geometric mean [m, or rad]."""
        return Interval(*np.exp(estimate_mean(self.log_error)).tolist())

    @property
    def lost_rate(self) -> Interval:
        """Share of the drives that were lost."""
        return compute_wilson_interval(float(self.lost.mean()), len(self.lost))

    @property
    def off_at_end_rate(self) -> Interval:
        """Share of the drives that were off at the end."""
        if not len(self.off_at_end):  # loaded from a file of an older locplan
            return NO_INTERVAL
        return compute_wilson_interval(float(self.off_at_end.mean()), len(self.off_at_end))


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(EqualByValue):
    """A path that may be taken."""

    name: str
    """Name of the path, such as "shortest" or "clear of walls"."""
    path: Path
    """The path from start to goal."""
    metrics: PathMetrics
    """Metrics of the path on the costmap."""
    driven: DriveStatistics | None = None
    """How its drives went; None where nothing was driven."""
    deviation: tuple[float, float] = (math.nan, math.nan)
    """Mean and greatest deviation of the position in the field along the path [m]; NaN where that
    is not known."""
    planner: str = ""
    """Name of its planner; empty of a path that was given."""
    note: str = ""
    """What the planner says of it."""
    history: tuple[tuple[float, float], ...] = ()
    """Time since a sampling planner began [s] and its best J [m], whenever that fell."""
    arrivals: Arrivals | None = None
    """Closed-loop drives, of the path to take and of the shortest, which may be one."""

    def __repr__(self) -> str:
        return f"Candidate({self.name}, {self.path.length:.2f} m)"


NO_INTERVAL = Interval(math.nan, math.nan, math.nan)


def _make_metric_column(name: str, title: str | None = None, digits: int = 2) -> TableColumn:
    unit = next(column.unit for column in METRICS if column.name == name)
    return TableColumn(
        name, unit, title, digits, value=lambda candidate: getattr(candidate.metrics, name)
    )


def _make_drive_column(
    name: str, unit: str, title: str, digits: int = 2, people: str = ""
) -> TableColumn:
    def value(candidate: Candidate) -> Any:
        return getattr(candidate.driven, name)

    return TableColumn(name, unit, title, digits, people, interval=True, value=value)


def _adapt_rate_column(column: TableColumn) -> TableColumn:
    return dataclasses.replace(
        column, value=lambda candidate: getattr(candidate.driven, column.name)
    )


def _adapt_arrival_column(column: TableColumn) -> TableColumn:
    def value(candidate: Candidate) -> Any:
        missing = NO_INTERVAL if column.interval else math.nan
        return column.extract_value(candidate.arrivals) if candidate.arrivals else missing

    return dataclasses.replace(column, title=None, value=value)


_NAME_COLUMNS = (TableColumn("name", title="path"), _make_metric_column("length", "length", 1))
_OTHER_METRICS = tuple(
    _make_metric_column(column.name)
    for column in METRICS
    if column.name not in ("length", "cost", "integrated_u", "integrated_e")
)
PLAN_COLUMNS: tuple[TableColumn, ...] = (
    *_NAME_COLUMNS,
    _make_metric_column("cost"),
    _make_metric_column("integrated_u", "degenerate", 1),
    _make_metric_column("integrated_e", "∫e ds", 3),
    *_OTHER_METRICS,
    TableColumn(
        "position_std", "m", "mean std", 1, "cm", value=lambda candidate: candidate.deviation[0]
    ),
    TableColumn(
        "max_position_std", "m", "max std", 1, "cm", value=lambda candidate: candidate.deviation[1]
    ),
)
"""Columns of candidates that were not driven."""
CANDIDATE_COLUMNS: tuple[TableColumn, ...] = (
    *_NAME_COLUMNS,
    _make_drive_column("error", "m", "error"),
    _make_drive_column("ratio", "", "ratio"),
    *map(_adapt_rate_column, RATE_COLUMNS),
    TableColumn("drives", value=lambda candidate: len(candidate.driven.numbers)),
    _make_metric_column("cost"),
    _make_metric_column("integrated_u"),
    _make_metric_column("integrated_e"),
    *_OTHER_METRICS,
    *map(_adapt_arrival_column, ARRIVAL_COLUMNS),
)
"""Columns of candidates that were driven."""


RIVAL_DRIVES = 8
"""Number of drives of the shortest path with the rival's settings."""


class CandidateRunner:
    """What is remembered of the drives of candidates, by path and number.

    Parameters
    ----------
    simulator : Simulator
        The map, the robot and the seed.
    paths : mapping of str to Path
        The candidates, the shortest first.
    settings : RecommendationSettings
        What counts.
    progress : callable, optional
        Called with (done, total) drives.
    """

    def __init__(
        self,
        simulator: Simulator,
        paths: dict[str, Path],
        settings: RecommendationSettings,
        progress: ProgressCallback | None,
    ) -> None:
        self._paths = [*paths.items()]
        # All candidates lead along one route, though those of a user may end a little off.
        self._route = compute_route_key(self._paths[0][1])
        self._simulator = simulator
        self._settings, self._progress = settings, progress
        self._poses: dict[int, Poses] = {}
        self._errors: list[dict[int, Floats]] = [{} for _ in paths]
        self._max_error = math.pi
        if settings.minimise != "heading":
            self._max_error = compute_max_error(simulator.grid.shape, simulator.grid.resolution)
        n_kept = min(len(paths), MAX_RACING + 1)
        self._n_done, self._total = 0, ROUNDS[0] * len(paths) + (ROUNDS[1] - ROUNDS[0]) * n_kept
        self._total += min(len(paths), MAX_FINALISTS + 1) * settings.drives + RIVAL_DRIVES
        self._closed_loop_numbers = range(settings.closed_drives)
        self._total += 2 * len(self._closed_loop_numbers)

    def __call__(self, paths: Sequence[int], numbers: range) -> DriveScores:
        """Drive some paths with the drives of some numbers."""
        for path, drives in zip(
            paths, self._drive_paths(self._simulator, paths, numbers), strict=True
        ):
            self._poses[path] = drives.poses
            self._errors[path].update(zip(numbers, drives.errors, strict=True))
        return DriveScores(
            np.array([self._get_log_errors(path, numbers) for path in paths]),
            np.array([self._get_drives(path, numbers).lost for path in paths]),
        )

    def summarize_drives(self, path_number: int, race_result: RaceResult) -> DriveStatistics:
        """Return a candidate's statistics over the drives from 0 on, or over the race."""
        numbers = range(FIRST_CHOOSING_DRIVE, FIRST_CHOOSING_DRIVE + ROUNDS[-1])
        if leads := path_number in (0, race_result.leader):
            numbers = race_result.drives
        numbers = numbers[: sum(number in self._errors[path_number] for number in numbers)]
        ratio = NO_INTERVAL
        if path_number:
            log_ratios = self._get_log_errors(path_number, numbers) - self._get_log_errors(
                0, numbers
            )
            ratio = race_result.ratio if leads else estimate_geometric_mean(np.exp(log_ratios))
        errors = self._get_log_errors(path_number, numbers)
        return DriveStatistics.from_drives(
            self._get_drives(path_number, numbers), numbers, errors, ratio
        )

    def drive_closed_loop(self, race_result: RaceResult) -> dict[int, Arrivals]:
        """Closed-loop drives of the path to take and of the shortest, which may be one."""
        leader = race_result.leader if race_result.recommends_leader(self._settings.bold) else 0
        path_numbers = [*dict.fromkeys((0, leader))]
        paths_by_name = dict(self._paths[path] for path in path_numbers)
        arrivals_by_name = drive_closed(
            self._simulator,
            paths_by_name,
            self._closed_loop_numbers,
            route=self._route,
            progress=self._report_progress,
        )
        self._n_done += len(path_numbers) * len(self._closed_loop_numbers)
        return dict(zip(path_numbers, arrivals_by_name.values(), strict=True))

    def drive_with_rival_filter(self, race_result: RaceResult) -> DriveStatistics | None:
        """Drive the shortest path with the rival's filter, paired with the reported drives."""
        rival = self._settings.find_rival_settings(self._simulator.robot.filter)
        if rival is None:
            return None
        numbers = race_result.drives[:RIVAL_DRIVES]
        base = self._simulator
        robot = dataclasses.replace(base.robot, filter=rival)
        simulator = Simulator(
            base.grid, robot, filter_map=base.filter_map, seed=base.seed, threads=base.threads
        )
        (drives,) = self._drive_paths(simulator, [0], numbers)
        errors = self._score_drives(drives)
        ratio = estimate_geometric_mean(np.exp(errors - self._get_log_errors(0, numbers)))
        if self._progress:
            self._progress(self._total, self._total)
        return DriveStatistics.from_drives(drives, numbers, errors, ratio)

    def _drive_paths(
        self, simulator: Simulator, paths: Sequence[int], numbers: range
    ) -> list[Drives]:
        paths_by_name = dict(self._paths[path] for path in paths)
        drives_by_name = drive_open(
            simulator, paths_by_name, numbers, route=self._route, progress=self._report_progress
        )
        self._n_done += len(paths) * len(numbers)
        return [*drives_by_name.values()]

    def _report_progress(self, n_done: int, _: int) -> None:
        if self._progress:
            self._progress(self._n_done + n_done, self._total)

    def _get_drives(self, path_number: int, numbers: range) -> Drives:
        errors = [self._errors[path_number][number] for number in numbers]
        return Drives(self._poses[path_number], np.array(errors))

    def _get_log_errors(self, path_number: int, numbers: range) -> Floats:
        return self._score_drives(self._get_drives(path_number, numbers))

    def _score_drives(self, drives: Drives) -> Floats:
        return compute_log_errors(
            drives.distance, drives.errors, self._settings.minimise, self._max_error
        )

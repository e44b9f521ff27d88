"""The result of a recommendation: the path, the verdict, and the drives behind it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from locplan._support.checks import short_repr
from locplan._support.intervals import MIN_SAMPLES, Interval, choose_digits
from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan._support.saved import StoredResult
from locplan._support.tables import format_aligned_table, make_file_name, wrap_lines, write_csv_rows
from locplan.errors import ConfigError
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.protocol import Position
from locplan.planning.results import Plan
from locplan.robots.amcl import Amcl, Filter
from locplan.robots.presets import SAFE, describe_preset
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import FOLLOWER_FAULT, WORLD_FAULT, Arrivals
from locplan.simulation.candidates import (
    field_config_from_cost_summary,
    make_candidate_costmap,
    rebuild_costmap,
)
from locplan.simulation.drives import LOST_SHORT_TEXT
from locplan.simulation.problem import SAFE_AMCL, RecommendationSettings
from locplan.simulation.race import (
    CANDIDATE_COLUMNS,
    PLAN_COLUMNS,
    ROUNDS,
    WORTHWHILE_LOG_RATIO,
    Candidate,
    DriveStatistics,
    RaceResult,
)
from locplan.simulation.verdict import (
    BETTER,
    NO_DIFFERENCE,
    UNDECIDED,
    WORSE,
    DriveSet,
    Verdict,
    compare_drives,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOSTLY_LOST = 0.5
"""Share of lost drives from which a path, or a filter, is no remedy."""
SMALL_GAIN = 0.02
"""Difference of the errors below which a recommended path gains little [m]."""
SMALLEST_SAVING = 0.05
"""Degenerate metres that an aware path must save if nothing is driven: the table rounds to .1 m."""

NO_PATH = {
    "unreachable": "The goal is unreachable: {note}.",
    "infeasible": "No path keeps the limits: {note}.",
    "timeout": "Time was up before a path was found: {note}.",
    "not found": "No path was found: {note}.",
}
"""Answers without a path, by the status of the recommendation."""
UNTESTED = (
    "Untested: take {name} ({length}). It has {u:.1f} degenerate metres, the shortest path"
    " ({shortest}) has {shortest_u:.1f}."
)
UNTESTED_SHORTEST = "Untested: take the shortest path ({shortest})."

TAKE_BETTER = "Take {name} ({length}): {change} than on the shortest path, {extra_length}."
TAKE_LESS_LOST = (
    "Take {name} ({length}): the robot gets lost in {lost} of {n} drives, on the shortest path"
    " in {shortest_lost} of {n}. It is {extra_length}."
)
TAKE_UNDECIDED = (
    "Take {name} ({length}), undecided after {n} drives: {change} than on the shortest path,"
    " {extra_length}."
)
KEEP_ALONE = "Take the shortest path ({shortest}). There is no other candidate."
KEEP_LEADER = (
    "Take the shortest path ({shortest}). No other candidate was better in up to {n} drives each."
)
KEEP_EQUAL = (
    "Take the shortest path ({shortest}). Path {name} ({length}) makes no difference: {change}."
)
KEEP_BEST = "Take the shortest path ({shortest}). Path {name} ({length}) is worse: {change}."
KEEP_SMALL_GAIN = (
    "Take the shortest path ({shortest}). Path {name} ({length}) gains too little: {change}."
)
KEEP_MORE_LOST = (
    "Take the shortest path ({shortest}). Path {name} ({length}) has {change}, but the"
    " robot gets lost more often."
)
KEEP_FEWER_REACH = (
    "Take the shortest path ({shortest}). Path {name} ({length}) has {change}, but the"
    " robot reaches the goal less often."
)
KEEP_UNDECIDED = (
    "Take the shortest path ({shortest}). Path {name} ({length}) is undecided after"
    " {n} drives: {change}."
)
KEEP_TIME_UP = (
    "Take the shortest path ({shortest}). Time was up after {n} drives. Path {name} ({length}) is"
    " undecided: {change}."
)

LEAST_BAD = "The least bad path is"
"""Replaces *Take* if no closed-loop drive reaches the goal."""

REACHED = "In closed loop, the robot reaches the goal in {count} of {n} drives."
REACHED_BOTH = (
    "In closed loop, the robot reaches the goal in {count} of {n} drives, on the {other_path} in"
    " {other_count} of {n}."
)
FEWER_REACH = (
    "But in closed loop, fewer drives reach the goal: {count} of {n}, on the {other_path}"
    " {other_count} of {n}."
)
FAULTS = {
    FOLLOWER_FAULT: "Drives that fail even with perfect localization: {count}. Check the footprint"
    " and the narrow passages.",
    WORLD_FAULT: "Drives without a way to the goal in their simulated world: {count}.",
}
TUNE_FIRST = (
    "Tune the filter first: with {settings}, the shortest path ({shortest}) has {change} than with"
    " the current settings."
)
TUNE_BEFORE_DETOUR = TUNE_FIRST + " That is also less error than on path {name} without tuning."
UNTUNED = "Without tuning, {answer}"
TUNING_FAILS = (
    "Tuning alone does not help: with {settings}, the robot gets lost in {lost} of {n} drives on"
    " the shortest path."
)
BLIND = "The lidar sees too few walls on {share:.0f} % of the shortest path."
STILL_LOST = "The robot still gets lost in at least half of the drives."
RUN_CHECK = "Run `locplan check`."
"""The next command after `STILL_LOST`; the page of the explorer has no commands."""
LITTLE = "The gain is less than 2 cm, and the robot never gets lost on the shortest path either."


@dataclass(frozen=True)
class PathDecision:
    """The recommended path among the candidates, and its drives; see `Recommendation`."""

    candidates: tuple[Candidate, ...]
    """Candidates, the shortest path first; none if no path leads to the goal."""
    best: int
    """Index of the recommended one."""
    judgement: RaceResult | None
    """The race and its confirmation; None if nothing was driven."""
    rival: DriveStatistics | None
    """Drives along the shortest path with the tuned filter."""
    settings: RecommendationSettings
    """Settings of the decision."""
    filter: Filter
    """The robot's filter."""
    status: str
    """"solved", or why there is no path."""
    note: str
    """Why nothing was driven, or why there is no path."""

    @property
    def shortest(self) -> Candidate | None:
        """The shortest path; None if there is no path."""
        return self.candidates[0] if self.candidates else None

    @property
    def recommended_candidate(self) -> Candidate | None:
        """The recommended path; None if there is no path."""
        return self.candidates[self.best] if self.candidates else None

    @property
    def leader(self) -> Candidate | None:
        """The path that the verdict is on, or the recommended one if nothing was driven."""
        return (
            self.candidates[self.judgement.leader] if self.judgement else self.recommended_candidate
        )

    @property
    def never_reaches_goal(self) -> bool:
        """True if no closed-loop drive along the recommended path reaches the goal."""
        recommended = self.recommended_candidate
        arrivals = recommended.arrivals if recommended else None
        return arrivals is not None and arrivals.n_reached == 0


def format_answer(decision: PathDecision) -> str:
    """Return which path to take, in one sentence or two."""
    shortest, leader = decision.shortest, decision.leader
    if shortest is None or leader is None:
        return NO_PATH[decision.status].format(note=decision.note or "the planner gives no reason")
    judgement, recommended = decision.judgement, decision.recommended_candidate
    values: dict[str, object] = {
        "name": short_repr(leader.name),
        "length": format_length(leader),
        "shortest": format_length(shortest),
        "extra_length": _format_extra_length(leader, shortest),
        "u": leader.metrics.integrated_u,
        "shortest_u": shortest.metrics.integrated_u,
    }
    if judgement is None:
        template = UNTESTED_SHORTEST if recommended is shortest else UNTESTED
        return template.format_map(values)
    values["n"] = len(judgement.drives)
    ratio = judgement.ratio
    if len(judgement.drives) < MIN_SAMPLES:
        ratio = Interval(ratio.value, math.nan, math.nan)
    values["change"] = format_error_change(ratio, decision.settings.minimise)
    if leader.driven and shortest.driven:
        values["lost"] = int(leader.driven.lost.sum())
        values["shortest_lost"] = int(shortest.driven.lost.sum())
    template = _choose_verdict_template(decision)
    if decision.never_reaches_goal:
        template = template.replace("Take", LEAST_BAD, 1)
    return template.format_map(values)


def _choose_verdict_template(decision: PathDecision) -> str:
    """Return the template of the verdict on the leader of the race."""
    judgement, settings = decision.judgement, decision.settings
    assert judgement is not None
    verdict, ratio = judgement.verdict, judgement.ratio
    if judgement.leader == 0:
        return KEEP_ALONE if len(decision.candidates) == 1 else KEEP_LEADER
    if decision.best:
        if verdict == UNDECIDED:
            return TAKE_UNDECIDED
        return TAKE_LESS_LOST if ratio.high >= 1 else TAKE_BETTER
    if judgement.recommends_leader(settings.bold):
        return KEEP_FEWER_REACH
    if judgement.more_lost and (verdict != NO_DIFFERENCE) and ratio.low <= 1:
        return KEEP_MORE_LOST
    is_time_up = settings.time_limit is not None and len(judgement.drives) < settings.drives
    is_open = ratio.low <= math.exp(WORTHWHILE_LOG_RATIO)
    templates = {
        BETTER: KEEP_SMALL_GAIN,
        WORSE: KEEP_BEST,
        NO_DIFFERENCE: KEEP_EQUAL,
        UNDECIDED: KEEP_TIME_UP if is_time_up and is_open else KEEP_UNDECIDED,
    }
    return templates[verdict]


def _format_extra_length(candidate: Candidate, shortest: Candidate) -> str:
    """Return how much longer or shorter a candidate is than the shortest path, in words."""
    extra = candidate.path.length - shortest.path.length
    if abs(extra) < 0.05:
        return "equally long"
    return f"{abs(extra):.1f} m {'longer' if extra > 0 else 'shorter'}"


def format_length(candidate: Candidate) -> str:
    """Return the length of a candidate, such as 37.3 m."""
    return f"{candidate.path.length:.1f} m"


def format_error_change(ratio: Interval, minimise: str) -> str:
    """Return the change of an error in words, such as 97 % [96, 99] less localization error.

    Parameters
    ----------
    ratio : Interval
        Ratio of the error to the baseline's error.
    minimise : str
        The error, see `RecommendationSettings.minimise`.
    """
    error = {"heading": "heading error", "goal-error": "localization error at the goal"}
    is_less = ratio.value <= 1
    ends = (1 - ratio.high, 1 - ratio.low) if is_less else (ratio.low - 1, ratio.high - 1)
    share = format_share(Interval(abs(1 - ratio.value), *ends))
    return f"{share} {'less' if is_less else 'more'} {error.get(minimise, 'localization error')}"


def format_share(share: Interval) -> str:
    """Return a share with its interval, such as 97 % [96, 99]."""
    value, low, high = (100 * bound for bound in share)
    return f"{value:.0f} %" if math.isnan(low) else f"{value:.0f} % [{low:z.0f}, {high:z.0f}]"


def format_reached_goals(decision: PathDecision) -> str:
    """Return how many robots reach the goal in closed-loop drives; empty if none was driven."""
    recommended = decision.recommended_candidate
    reached = recommended.arrivals if recommended else None
    if reached is None:
        return ""
    other_arrivals = [
        candidate.arrivals
        for candidate in decision.candidates
        if candidate.arrivals and candidate is not recommended
    ]
    if not other_arrivals:
        return REACHED.format(count=reached.n_reached, n=len(reached.drives))
    (other,) = other_arrivals
    template = (
        FEWER_REACH if decision.best and reached.n_reached < other.n_reached else REACHED_BOTH
    )
    return template.format(
        count=reached.n_reached,
        n=len(reached.drives),
        other_count=other.n_reached,
        other_path="shortest path" if decision.best else "best other candidate",
    )


def list_advice(decision: PathDecision) -> list[str]:
    """Return sentences on faults that may matter more than the path, tuning first."""
    return [sentence for sentence in _iterate_advice(decision) if sentence]


def _iterate_advice(decision: PathDecision) -> Iterator[str]:
    recommended, shortest = decision.recommended_candidate, decision.shortest
    if not (recommended and shortest and recommended.driven and shortest.driven):
        return
    yield format_tuning_advice(decision)
    if recommended.driven.lost_rate.value >= MOSTLY_LOST and not format_tuning_advice(decision):
        yield f"{STILL_LOST} {RUN_CHECK}"
        yield explain_tuning_failure(decision)
    gain = shortest.driven.error.value - recommended.driven.error.value
    if decision.best and decision.settings.minimise == "rmse" and gain < SMALL_GAIN:
        yield "" if shortest.driven.lost.any() else LITTLE
    faults = [
        drive.fault
        for candidate in decision.candidates
        if candidate.arrivals
        for drive in candidate.arrivals.drives
    ]
    for fault, template in FAULTS.items():
        yield template.format(count=faults.count(fault)) if fault in faults else ""


def format_tuning_advice(decision: PathDecision) -> str:
    """Return the advice to tune the filter before the path; empty if that gains no more."""
    verdict, shortest = compare_tuned_settings(decision), decision.shortest
    if verdict is None or shortest is None:
        return ""
    template = (
        TUNE_BEFORE_DETOUR if decision.best and decision.recommended_candidate else TUNE_FIRST
    )
    return template.format(
        name=short_repr((decision.recommended_candidate or shortest).name),
        settings=format_tuned_settings(decision),
        shortest=format_length(shortest),
        change=format_error_change(verdict.ratio, decision.settings.minimise),
    )


def explain_tuning_failure(decision: PathDecision) -> str:
    """Return why tuning the filter does not help either; empty if that is not known."""
    rival, shortest = decision.rival, decision.shortest
    if rival is None or shortest is None or rival.lost_rate.value < MOSTLY_LOST:
        return ""
    sentence = TUNING_FAILS.format(
        settings=format_tuned_settings(decision), lost=int(rival.lost.sum()), n=len(rival.lost)
    )
    share = 100 * shortest.metrics.degenerate_share
    return f"{sentence} {BLIND.format(share=share)}" if share >= 100 * MOSTLY_LOST else sentence


def compare_tuned_settings(decision: PathDecision) -> Verdict | None:
    """Return the verdict on tuned settings on the shortest path; None if a path gains as much.

    Tuned settings must beat the robot's settings there and on the recommended path. The comparison
    uses the drives that all have in common: same worlds, same random numbers.
    """
    recommended, shortest, rival = decision.recommended_candidate, decision.shortest, decision.rival
    if not (rival and recommended and shortest and recommended.driven and shortest.driven):
        return None
    if rival.lost_rate.value >= MOSTLY_LOST:
        return None
    alternative = DriveSet(rival.log_error, rival.lost)
    verdicts = []
    for statistics in (shortest.driven, recommended.driven):
        if statistics.numbers[: len(rival.numbers)] != rival.numbers:  # of an older file
            return None
        count = len(rival.lost)
        verdicts.append(
            compare_drives(
                DriveSet(statistics.log_error[:count], statistics.lost[:count]), alternative
            )
        )
    is_worthwhile = all(
        verdict.ratio.value <= math.exp(WORTHWHILE_LOG_RATIO) for verdict in verdicts
    )
    is_better = all(verdict.word == BETTER for verdict in verdicts)
    return verdicts[0] if is_better and is_worthwhile else None


def format_tuned_settings(decision: PathDecision) -> str:
    """Return the tuned settings of the filter as text."""
    rival = decision.settings.rival
    if rival not in (None, SAFE_AMCL):
        return rival.title
    prefix = "" if isinstance(decision.filter, Amcl) else "AMCL, "
    return f"{prefix}safe settings ({describe_preset(SAFE)})"


def list_answer_lines(decision: PathDecision) -> list[str]:
    """Return the whole answer, a line each: what gains most is the first."""
    answer, reached = format_answer(decision), format_reached_goals(decision)
    first, *advice = list_advice(decision) or [""]
    if first and first == format_tuning_advice(decision):
        untuned = UNTUNED.format(answer=f"{answer[:1].lower()}{answer[1:]}")
        lines = [first, untuned, reached, *advice]
    else:
        note = decision.note if decision.candidates else ""
        lines = [answer, reached, note, first, *advice]
    return [line for line in lines if line]


INTERVAL_NOTE = f"[low, high]: 95 % interval; lost: {LOST_SHORT_TEXT} at some time"
"""Explains the columns of the drives."""
LOOP_NOTE = (
    "the robot follows the path exactly in these drives; in closed loop, the pose of its filter"
    " steers it"
)
"""Explains how the drives of the table and those in closed loop differ."""
NAME_NOTES = {
    "detour": "detour N: avoids the shortest path and the detours before N",
    "aware": "aware: avoids places with few features in the lidar's range",
}
"""Explains names of candidates, by their beginning."""
RACE_NOTE = (
    f"~: rough estimate; dropped after {ROUNDS[0]} or {ROUNDS[1]} drives, because it is too"
    " inaccurate or too long"
)
"""Explains the mark of errors that are scaled."""


def format_candidate_table(decision: PathDecision) -> str:
    """Return the drives of each candidate as a table, the recommended path first; empty without."""
    shortest, recommended = decision.shortest, decision.recommended_candidate
    if shortest is None or recommended is None or shortest.driven is None:
        return ""
    ordered = [
        recommended,
        *(candidate for candidate in decision.candidates if candidate is not recommended),
    ]
    rows = [(candidate.name, candidate, candidate.driven) for candidate in ordered]
    if decision.rival is not None:
        at = 1 + ordered.index(shortest)
        rows.insert(at, (f"{shortest.name}, tuned", shortest, decision.rival))
    has_off = _is_any_off_at_end(decision)
    is_angle = decision.settings.minimise == "heading"
    error_titles = {"heading": "heading error [deg]", "goal-error": "error at the goal [m]"}
    heads = ["  path", "length", error_titles.get(decision.settings.minimise, "error [m]"), "lost"]
    heads += [*(["off at the end"] if has_off else []), "drives"]
    texts = []
    for name, candidate, statistics in rows:
        if statistics is None:
            continue
        is_shared = statistics.numbers.start == shortest.driven.numbers.start
        error = _format_error(statistics.error, is_angle)
        if not is_shared:
            rescaled_error = _rescale_error_to_shortest(statistics, shortest.driven)
            error = f"~{_format_error(rescaled_error, is_angle)}"
        mark = ">" if candidate is recommended and statistics is not decision.rival else " "
        off = [f"{statistics.off_at_end_rate.value:.0%}".replace("%", " %")] * has_off
        cells = [f"{mark} {name}", format_length(candidate), error]
        texts.append(
            (*cells, format_share(statistics.lost_rate), *off, str(len(statistics.numbers)))
        )
    return format_aligned_table(heads, texts)


def _is_any_off_at_end(decision: PathDecision) -> bool:
    """True if the estimate was off at the end of any drive, so that the table has the column."""
    driven = [*(candidate.driven for candidate in decision.candidates), decision.rival]
    return any(statistics is not None and statistics.off_at_end.any() for statistics in driven)


def list_table_notes(decision: PathDecision) -> list[str]:
    """Return the legend of the table's marks."""
    starts = {
        candidate.driven.numbers.start for candidate in decision.candidates if candidate.driven
    }
    notes = [INTERVAL_NOTE, LOOP_NOTE] if starts else []
    if _is_any_off_at_end(decision):
        notes[:1] = [f"{INTERVAL_NOTE}; off at the end: still so when the drive ends"]
    names = [candidate.name for candidate in decision.candidates]
    name_notes = [
        note
        for beginning, note in NAME_NOTES.items()
        if any(name.startswith(beginning) for name in names)
    ]
    notes += ["; ".join(name_notes)] if starts and name_notes else []
    notes += [RACE_NOTE] if len(starts) > 1 else []
    if decision.rival is not None:
        notes.append(f"tuned: {format_tuned_settings(decision)}")
    return notes


def _rescale_error_to_shortest(statistics: DriveStatistics, shortest: DriveStatistics) -> Interval:
    """Return the error scaled to the shortest path's drives, without an interval."""
    return Interval(statistics.ratio.value * shortest.error.value, math.nan, math.nan)


def _format_error(error: Interval, is_angle: bool) -> str:
    digits = 1 if is_angle else choose_digits(error.value)
    scale = math.degrees(1.0) if is_angle else 1.0
    value, low, high = (f"{scale * bound:.{digits}f}" for bound in error)
    return value if math.isnan(error.low) else f"{value} [{low}, {high}]"


@dataclass(frozen=True, eq=False, repr=False)
class Recommendation(Result, StoredResult):
    """The recommended path between two places, and the candidates that it was chosen from."""

    kind: ClassVar[str] = "choice"
    suffix: ClassVar[str] = ".json"
    version: ClassVar[int] = 4
    derived: ClassVar[tuple[str, ...]] = (
        *("recommended_name", "verdict", "sentence", "reached_text", "advice", "answer"),
    )
    former: ClassVar[tuple[str, ...]] = ("taken", "arrives")

    files: ClassVar[ResultFiles] = ResultFiles(
        "choice",
        ("choice.json", "choice.png", "candidates.csv", "chosen.csv", "errors.csv"),
        purposes={
            "chosen.csv": "the recommended path, x and y in metres, for export --path",
            "choice.png": "the picture",
            "candidates.csv": "all candidates with length, degeneracy and error",
            "choice.json": "everything in numbers, for export --choice",
            "[0-9]*.csv": "a candidate path",
        },
    )

    about: Mapping[str, Any]
    """Version, map and settings of the costmap, see `locplan.planning.costmap.summarize_costs`."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    candidates: tuple[Candidate, ...]
    """Candidates, the shortest path first; none if no path leads to the goal."""
    settings: RecommendationSettings
    """Limits of the candidates, and settings of the decision."""
    robot: Robot
    """The robot, which was driven if its lidar is known."""
    seed: int
    """Seed of all random numbers."""
    status: Literal["solved", "unreachable", "infeasible", "timeout", "not found"]
    """"solved", or why there is no path, see `Plan.status`."""
    note: str = ""
    """Why nothing was driven, or why there is no path; otherwise empty."""
    left_out: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Why each other path that was planned or given is no candidate, by its name."""
    judgement: RaceResult | None = None
    """The race and its confirmation; None if nothing was driven."""
    rival: DriveStatistics | None = None
    """Drives along the shortest path with the filter of `RecommendationSettings.rival`."""
    costs: Costmap | None = dataclasses.field(default=None, compare=False)
    """Costmap that the paths were measured on; None if the recommendation was loaded."""

    def __repr__(self) -> str:
        return f"Recommendation({self.map['name'] or 'map'}, {self.sentence})"

    def __eq__(self, other: object) -> bool:  # a filter of one's own is loaded as its name
        return isinstance(other, Recommendation) and self.summary() == other.summary()

    def __hash__(self) -> int:
        return hash(self.map["digest"])

    @property
    def map(self) -> Mapping[str, str]:
        """Name and digest of the map."""
        map_summary: Mapping[str, str] = self.about["map"]
        return map_summary

    @property
    def verdict(self) -> str:
        """The verdict on the winner of the race; empty if nothing was driven."""
        return self.judgement.verdict if self.judgement else ""

    @property
    def best(self) -> int:
        """Index of the recommended candidate.

        If nothing was driven, it is the field's aware path, if that is less degenerate than the
        shortest one.
        """
        if self.judgement is None:
            return int(self._avoids_degenerate_metres)
        takes = (
            self.judgement.recommends_leader(self.settings.bold) and not self._has_fewer_arrivals
        )
        return self.judgement.leader if takes else 0

    @property
    def _avoids_degenerate_metres(self) -> bool:
        """True if the field's aware path has fewer degenerate metres than the shortest one."""
        if len(self.candidates) < 2 or not self.candidates[1].planner:
            return False
        shortest, aware = (candidate.metrics.integrated_u for candidate in self.candidates[:2])
        return shortest - aware >= SMALLEST_SAVING

    @property
    def _arrivals(self) -> list[Arrivals]:
        """Closed-loop drives of the shortest path, and of the leader if it was better."""
        return [
            candidate.arrivals for candidate in self.candidates if candidate.arrivals is not None
        ]

    @property
    def _has_fewer_arrivals(self) -> bool:
        """True if the robot reaches the goal too rarely on the winner of the race."""
        if len(self._arrivals) < 2:
            return False
        shortest, leader = self._arrivals
        # It may fail in an eighth of the drives more than the shortest.
        return shortest.n_reached - leader.n_reached > len(leader.drives) / 8

    @property
    def shortest(self) -> Candidate | None:
        """Candidate that is the shortest path; None if there is no path."""
        return self.candidates[0] if self.candidates else None

    @property
    def recommended_candidate(self) -> Candidate | None:
        """The recommended candidate; None if there is no path."""
        return self.candidates[self.best] if self.candidates else None

    @property
    def recommended_name(self) -> str:
        """Name of the recommended candidate; empty if there is no path."""
        return self.recommended_candidate.name if self.recommended_candidate else ""

    @property
    def path(self) -> Path | None:
        """The recommended path; None if there is none."""
        return self.recommended_candidate.path if self.recommended_candidate else None

    @property
    def _decision(self) -> PathDecision:
        return PathDecision(
            self.candidates,
            self.best,
            self.judgement,
            self.rival,
            self.settings,
            self.robot.filter,
            self.status,
            self.note,
        )

    @property
    def leader(self) -> Candidate | None:
        """Candidate that the verdict is on, or the recommended one if nothing was driven."""
        return self._decision.leader

    @property
    def sentence(self) -> str:
        """The recommended path in one or two sentences."""
        return format_answer(self._decision)

    @property
    def reached_text(self) -> str:
        """Sentence on the closed-loop drives that reach the goal; empty if none was driven."""
        return format_reached_goals(self._decision)

    @property
    def advice(self) -> list[str]:
        """Sentences on faults that may matter more than the path, tuning first."""
        return list_advice(self._decision)

    @property
    def answer(self) -> list[str]:
        """All sentences of the answer, the largest gain first."""
        return list_answer_lines(self._decision)

    @property
    def is_tuning_first(self) -> bool:
        """True if tuned settings of the filter gain more than any path."""
        return compare_tuned_settings(self._decision) is not None

    @property
    def role(self) -> str:
        """Role of the recommended path in pictures: how far the simulation supports it."""
        if self.judgement is None:
            return "untested"
        if self.is_tuning_first:
            return "best without tuning"
        return "least bad" if self._decision.never_reaches_goal else "recommended"

    @property
    def is_undecided(self) -> bool:
        """True if the shortest path is kept because more drives may show another to be better."""
        return self.best == 0 and self.verdict == UNDECIDED and self.leader is not self.shortest

    @property
    def drives_text(self) -> str:
        """Text on the shown drives and their robot."""
        if self.judgement is None:
            return ""
        return f"Simulated drives with {self.robot.title}; seed {self.seed}"

    @property
    def config(self) -> FieldConfig:
        """Settings of the field that the paths were measured on, or would be without one."""
        return field_config_from_cost_summary(self.about, self.robot.lidar)

    def with_field(self, field: CovarianceField) -> Recommendation:
        """Return a loaded recommendation with the costmap of a field, to draw or export it.

        Parameters
        ----------
        field : CovarianceField
            The field of the map, of the settings `config`.

        Raises
        ------
        ConfigError
            If the field belongs to another map.
        """
        return dataclasses.replace(self, costs=rebuild_costmap(self.about, field))

    def costmap(self) -> Costmap:
        """Return the costmap on which the recommended path is cheapest, such as to export it.

        On a user's path, or a path of a user's planner, a metre costs 1, and 9 off it.

        Raises
        ------
        ConfigError
            If there is no path, or no costmap because the recommendation was loaded; call
            `with_field` first.
        """
        recommended, costs = self.recommended_candidate, self.costs
        if recommended is None:
            raise ConfigError(f"the recommendation has no path: {self.sentence}")
        if costs is None:
            raise ConfigError(
                "a loaded recommendation has no costmap; call with_field(field) first"
            )
        if recommended.planner and recommended is not self.shortest:
            return costs
        paths = {candidate.name: candidate.path for candidate in self.candidates}
        return make_candidate_costmap(
            costs, paths, recommended.name, self.robot, self.settings.max_e
        )

    def table(self) -> Table:
        """Return a row per candidate; the first column marks the recommended one if driven."""
        columns = CANDIDATE_COLUMNS if self.judgement else PLAN_COLUMNS
        if self.settings.minimise == "heading":
            columns = tuple(
                dataclasses.replace(column, unit="rad", people="deg", digits=1)
                if column.name == "error"
                else column
                for column in columns
            )
        marks = TableColumn(
            "chosen",
            title="",
            value=lambda candidate: ">" if candidate is self.recommended_candidate else "",
        )
        return Table.from_records((marks, *columns) if self.judgement else columns, self.candidates)

    def report(self, *related_results: Any, **details: Any) -> str:
        """Return the answer, the table of the drives, and why paths are no candidates.

        Parameters
        ----------
        *related_results, **details
            Accepted as by `save`, and ignored.
        """
        if not self.candidates:
            return self.sentence
        evidence = [*wrap_lines([f"{self.drives_text}:"])] if self.judgement else []
        evidence.append(format_candidate_table(self._decision) or str(self.table()))
        notes = list_table_notes(self._decision)
        notes += [
            f"{candidate.name}: {candidate.note}" for candidate in self.candidates if candidate.note
        ]
        limit = self.settings.longest
        notes += [
            f"{candidate.name}: may be longer than {limit:g} times the shortest path"
            for candidate in self.candidates
            if candidate.path.length > limit * self.candidates[0].path.length
        ]
        names: dict[str, list[str]] = {}
        for name, reason in self.left_out.items():
            names.setdefault(reason, []).append(name)
        notes += [f"left out ({reason}): {'; '.join(group)}" for reason, group in names.items()]
        if self.costs is not None and self.costs.estimator_note:
            notes.append(self.costs.estimator_note)
        if self.costs is not None and not self.costs.has_weak_spots:
            notes.append("this lidar has no weak spot on the map: u is 0 throughout")
        return "\n".join([*wrap_lines(self.answer), "", *evidence, *wrap_lines(notes)])

    def _write(self, folder: File, *related_results: Any) -> None:
        """Write the paths, the table and the errors along the paths."""
        self.table().write_csv(folder / "candidates.csv")
        if self.path:
            self.path.save(folder / "chosen.csv")
        for number, candidate in enumerate(self.candidates, 1):
            candidate.path.save(folder / f"{number:02}-{make_file_name(candidate.name)[:60]}.csv")
        columns = ["path", "distance", "error_median", "error_low", "error_high"]
        rows = (
            [candidate.name, *at]
            for candidate in self.candidates
            if candidate.driven
            for at in candidate.driven.profile.tolist()
        )
        write_csv_rows(folder / "errors.csv", columns, rows)
        sampled_candidates = [
            candidate for candidate in self.candidates if len(candidate.history) > 1
        ]
        if sampled_candidates:
            from locplan._support.drawing import save_figure
            from locplan.planning.figures import history_figure

            plans = {
                candidate.name: self._plan_from_candidate(candidate)
                for candidate in sampled_candidates
            }
            save_figure(history_figure(plans), folder / "history.png")

    def _plan_from_candidate(self, candidate: Candidate) -> Plan:
        """Return a candidate as a plan, for the figure of its search."""
        costs, history = self.costs, candidate.history
        return Plan(
            *(
                "solved",
                candidate.planner,
                self.start,
                self.goal,
                candidate.path,
                candidate.metrics,
            ),
            solve_time=history[-1][0],
            history=history,
            costs=costs,
        )

    def figure(self) -> Figure:
        """Draw the candidates over the map, the recommended path strongest, and the errors along
        it.

        If nothing was driven, draw the degeneracy u along the paths instead. A loaded
        recommendation has no map to draw.
        """
        from locplan.simulation.figures import recommendation_figure

        return recommendation_figure(self)

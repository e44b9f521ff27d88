"""The answer of a choice in sentences, one template per verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from locplan._util.intervals import Interval
from locplan.robots import Amcl, Filter
from locplan.robots.presets import SAFE, describe_preset
from locplan.simulation._arrivals import FOLLOWER, WORLD
from locplan.simulation.choice._ask import TUNED, ChoiceSettings
from locplan.simulation.choice._driven import Candidate, Driven
from locplan.simulation.choice._race import WORTHWHILE, Judgement
from locplan.simulation.verdict import (
    BETTER,
    NO_DIFFERENCE,
    UNDECIDED,
    WORSE,
    DriveSet,
    Verdict,
    compare,
)

MOSTLY_LOST = 0.5
"""Share of lost drives from which a path, or a filter, is no remedy."""
SLIGHT = 0.02
"""Difference of the errors below which a recommended path gains little [m]."""

NO_PATH = {
    "unreachable": "The goal is unreachable: {note}.",
    "infeasible": "No path keeps the limits: {note}.",
    "timeout": "Time is up before a path is found: {note}.",
    "not found": "No path is found: {note}.",
}
"""Answers without a path, by the choice's status."""
UNTESTED = (
    "Untested: the {name} path is {length} long ({u:.1f} m degenerate), the shortest path"
    " {shortest} ({shortest_u:.1f} m)."
)
UNTESTED_SHORTEST = "Untested: the shortest path is {shortest} long."

TAKE_BETTER = "Take the {kind}: {lengths}, with {change}."
TAKE_LESS_LOST = (
    "Take the {kind}: {lengths}. {lost} of {n} robots get lost; on the shortest path,"
    " {shortest_lost} of {n}."
)
TAKE_UNDECIDED = "Take the {kind}, undecided after {n} drives: {lengths}, with {change}."
KEEP_ALONE = "Take the shortest path: {shortest}. No other path is a candidate."
KEEP_LEADER = "Take the shortest path: {shortest}. No other path beats it in {n} drives."
KEEP_EQUAL = (
    "Take the shortest path: {shortest}. The best other path ({length}) makes no difference:"
    " {change}."
)
KEEP_BEST = "Take the shortest path: {shortest}. The best other path ({length}) has {change}."
KEEP_SMALL_GAIN = (
    "Take the shortest path: {shortest}. The best other path ({length}) gains too little: {change}."
)
KEEP_MORE_LOST = (
    "Take the shortest path: {shortest}. On the best other path ({length}), with {change}, more"
    " robots get lost."
)
KEEP_FEWER_REACH = (
    "Take the shortest path: {shortest}. On the best other path ({length}), with {change}, fewer"
    " robots reach the goal."
)
KEEP_UNDECIDED = (
    "Take the shortest path: {shortest}. After {n} drives the best other path ({length}) is"
    " undecided: {change}."
)
KEEP_TIME_UP = (
    "Take the shortest path: {shortest}. Time was up after {n} drives, with the best other path"
    " ({length}) undecided: {change}."
)

REACHED = "In closed loop, {count} of {n} robots reach the goal."
REACHED_BOTH = (
    "In closed loop, {count} of {n} robots reach the goal; on {other}, {other_count} of {n}."
)
FEWER_REACH = (
    "But fewer robots reach the goal in closed loop: {count} of {n}; on {other}, {other_count} of"
    " {n}."
)
FAULTS = {
    FOLLOWER: "Robots that fail even with perfect localization: {count}. Check the footprint and"
    " the narrow passages.",
    WORLD: "Robots without a way to the goal in their worlds: {count}.",
}
TUNE_FIRST = "Tune the filter first: with {settings}, the shortest path ({shortest}) has {change}."
TUNE_BEFORE_DETOUR = (
    "Tune the filter first: with {settings}, the shortest path ({shortest}) has {change}, and a"
    " smaller error than the {kind} without tuning."
)
UNTUNED = "With the filter as it is, {answer}"
TUNING_FAILS = (
    "Tuning alone does not help: with {settings}, {lost} of {n} robots get lost on the shortest"
    " path."
)
BLIND = "The lidar sees too little on {share:.0f} % of the shortest path."
STILL_LOST = "At least half of the robots still get lost: find the cause with `locplan check`."
LITTLE = "The gain is under 2 cm, and no robot gets lost on the shortest path either."


@dataclass(frozen=True)
class Decision:
    """The recommended path among the candidates, and the drives that say so; see `Choice`."""

    candidates: tuple[Candidate, ...]
    """Candidates, the shortest path first; none if no path leads to the goal."""
    best: int
    """Index of the recommended one."""
    judgement: Judgement | None
    """The race and its confirmation; None if nothing was driven."""
    rival: Driven | None
    """Drives along the shortest path with the tuned filter."""
    settings: ChoiceSettings
    """What decided."""
    filter: Filter
    """The robot's own filter."""
    status: str
    """"solved", or why there is no path."""
    note: str
    """Why nothing was driven, or why there is no path."""

    @property
    def shortest(self) -> Candidate | None:
        """The shortest path; None if there is no path."""
        return self.candidates[0] if self.candidates else None

    @property
    def chosen(self) -> Candidate | None:
        """The recommended path; None if there is no path."""
        return self.candidates[self.best] if self.candidates else None

    @property
    def leader(self) -> Candidate | None:
        """The path that the verdict is on, or the recommended one if nothing was driven."""
        return self.candidates[self.judgement.leader] if self.judgement else self.chosen


def format_answer(decision: Decision) -> str:
    """Return which path to take, in one sentence or two."""
    shortest, leader = decision.shortest, decision.leader
    if shortest is None or leader is None:
        return NO_PATH[decision.status].format(note=decision.note or "the planner gives no reason")
    judgement, chosen = decision.judgement, decision.chosen
    values = {
        "name": leader.name,
        "kind": _kind(leader, shortest),
        "length": format_length(leader),
        "shortest": format_length(shortest),
        "lengths": _lengths(leader, shortest),
        "u": leader.metrics.integrated_u,
        "shortest_u": shortest.metrics.integrated_u,
    }
    if judgement is None:
        template = UNTESTED_SHORTEST if chosen is shortest else UNTESTED
        return template.format(**values)
    values["n"] = len(judgement.drives)
    values["change"] = format_change(judgement.ratio, decision.settings.minimise)
    if leader.driven and shortest.driven:
        values["lost"] = int(leader.driven.lost.sum())
        values["shortest_lost"] = int(shortest.driven.lost.sum())
    return _driven_template(decision).format(**values)


def _driven_template(decision: Decision) -> str:
    """The template of the verdict on candidates that were driven."""
    judgement, settings = decision.judgement, decision.settings
    assert judgement is not None
    verdict, ratio = judgement.verdict, judgement.ratio
    if judgement.leader == 0:
        return KEEP_ALONE if len(decision.candidates) == 1 else KEEP_LEADER
    if decision.best:
        if verdict == UNDECIDED:
            return TAKE_UNDECIDED
        return TAKE_LESS_LOST if ratio.high >= 1 else TAKE_BETTER
    if judgement.takes(settings.bold):
        return KEEP_FEWER_REACH
    if judgement.more_lost and (verdict != NO_DIFFERENCE) and ratio.low <= 1:
        return KEEP_MORE_LOST
    is_time_up = settings.time_limit is not None and len(judgement.drives) < settings.drives
    is_open = ratio.low <= math.exp(WORTHWHILE)
    templates = {
        BETTER: KEEP_SMALL_GAIN,
        WORSE: KEEP_BEST,
        NO_DIFFERENCE: KEEP_EQUAL,
        UNDECIDED: KEEP_TIME_UP if is_time_up and is_open else KEEP_UNDECIDED,
    }
    return templates[verdict]


def _kind(candidate: Candidate, shortest: Candidate) -> str:
    """What a candidate is called beside the shortest path; a user's may be shorter."""
    extra = candidate.path.length - shortest.path.length
    if abs(extra) < 0.05:
        return "other path"
    return "detour" if extra > 0 else "shorter path"


def _lengths(candidate: Candidate, shortest: Candidate) -> str:
    if abs(candidate.path.length - shortest.path.length) < 0.05:
        return f"{format_length(candidate)}, as long as the shortest path"
    return f"{format_length(candidate)} instead of {format_length(shortest)}"


def format_length(candidate: Candidate) -> str:
    """Return the length of a candidate, such as 37.3 m."""
    return f"{candidate.path.length:.1f} m"


def format_change(ratio: Interval, minimise: str) -> str:
    """Return the change of an error in words, such as 97 % [96, 99] less localization error.

    Parameters
    ----------
    ratio : Interval
        Ratio of the error to that of the baseline.
    minimise : str
        The error, see `ChoiceSettings.minimise`.
    """
    error = {"heading": "heading error", "goal-error": "localization error at the goal"}
    is_less = ratio.value <= 1
    ends = (1 - ratio.high, 1 - ratio.low) if is_less else (ratio.low - 1, ratio.high - 1)
    share = format_share(Interval(abs(1 - ratio.value), *ends))
    return f"{share} {'less' if is_less else 'more'} {error.get(minimise, 'localization error')}"


def format_share(share: Interval) -> str:
    """Return a share with its interval, such as 97 % [96, 99]."""
    value, low, high = (100 * each for each in share)
    return f"{value:.0f} %" if math.isnan(low) else f"{value:.0f} % [{low:z.0f}, {high:z.0f}]"


def format_reached(decision: Decision) -> str:
    """Return how many robots reach the goal in closed-loop drives; empty if none was driven."""
    arrivals = {each.name: each.arrivals for each in decision.candidates if each.arrivals}
    reached = arrivals.pop(decision.chosen.name if decision.chosen else "", None)
    if reached is None:
        return ""
    values = {"count": reached.count, "n": len(reached.drives)}
    for other in arrivals.values():
        name = "the shortest path" if decision.best else "the best other path"
        template = FEWER_REACH if decision.best and reached.count < other.count else REACHED_BOTH
        return template.format(other=name, other_count=other.count, **values)
    return REACHED.format(**values)


def list_advice(decision: Decision) -> list[str]:
    """Return sentences on what may matter more than the path, the one to tune first at first."""
    return [sentence for sentence in _advice(decision) if sentence]


def _advice(decision: Decision) -> Iterator[str]:
    chosen, shortest = decision.chosen, decision.shortest
    if not (chosen and shortest and chosen.driven and shortest.driven):
        return
    yield format_tune_first(decision)
    if chosen.driven.lost_rate.value >= MOSTLY_LOST and not format_tune_first(decision):
        yield STILL_LOST
        yield format_tuning_fails(decision)
    gain = shortest.driven.error.value - chosen.driven.error.value
    if decision.best and decision.settings.minimise == "rmse" and gain < SLIGHT:
        yield "" if shortest.driven.lost.any() else LITTLE
    faults = [
        one.fault for each in decision.candidates if each.arrivals for one in each.arrivals.drives
    ]
    for fault, template in FAULTS.items():
        yield template.format(count=faults.count(fault)) if fault in faults else ""


def format_tune_first(decision: Decision) -> str:
    """Return the advice to tune the filter before the path; empty if that gains no more."""
    verdict, shortest = compare_tuning(decision), decision.shortest
    if verdict is None or shortest is None:
        return ""
    template = TUNE_BEFORE_DETOUR if decision.best and decision.chosen else TUNE_FIRST
    return template.format(
        kind=_kind(decision.chosen or shortest, shortest),
        settings=name_tuned_settings(decision),
        shortest=format_length(shortest),
        change=format_change(verdict.ratio, decision.settings.minimise),
    )


def format_tuning_fails(decision: Decision) -> str:
    """Return why tuning the filter does not help either; empty if that is not known."""
    tuned, shortest = decision.rival, decision.shortest
    if tuned is None or shortest is None or tuned.lost_rate.value < MOSTLY_LOST:
        return ""
    values = {"lost": int(tuned.lost.sum()), "n": len(tuned.lost)}
    share = 100 * shortest.metrics.degenerate_share
    blind = BLIND.format(share=share) if share >= 100 * MOSTLY_LOST else ""
    return (
        f"{TUNING_FAILS.format(settings=name_tuned_settings(decision), **values)} {blind}".rstrip()
    )


def compare_tuning(decision: Decision) -> Verdict | None:
    """Return the verdict on tuned settings on the shortest path; None if a path gains as much.

    Tuned settings must be better than the robot's own there, and on the recommended path. They are
    compared in the drives that all have in common: same worlds, same random numbers.
    """
    chosen, shortest, tuned = decision.chosen, decision.shortest, decision.rival
    if not (tuned and chosen and shortest and chosen.driven and shortest.driven):
        return None
    if tuned.lost_rate.value >= MOSTLY_LOST:
        return None
    alternative = DriveSet(tuned.log_error, tuned.lost)
    verdicts = []
    for driven in (shortest.driven, chosen.driven):
        if driven.numbers[: len(tuned.numbers)] != tuned.numbers:  # of an older file
            return None
        count = len(tuned.lost)
        verdicts.append(
            compare(DriveSet(driven.log_error[:count], driven.lost[:count]), alternative)
        )
    is_worthwhile = all(each.ratio.value <= math.exp(WORTHWHILE) for each in verdicts)
    is_better = all(each.word == BETTER for each in verdicts)
    return verdicts[0] if is_better and is_worthwhile else None


def name_tuned_settings(decision: Decision) -> str:
    """Return the settings of the filter that was driven next to the robot's own."""
    rival = decision.settings.rival
    if rival not in (None, TUNED):
        return rival.title
    own = "" if isinstance(decision.filter, Amcl) else "AMCL, "
    return f"{own}safe settings ({describe_preset(SAFE)})"


def list_answer(decision: Decision) -> list[str]:
    """Return the whole answer, a line each: what gains most is the first."""
    answer, reached = format_answer(decision), format_reached(decision)
    first, *advice = list_advice(decision) or [""]
    if first and first == format_tune_first(decision):
        untuned = UNTUNED.format(answer=f"{answer[:1].lower()}{answer[1:]}")
        lines = [first, untuned, reached, *advice]
    else:
        note = decision.note if decision.candidates else ""
        lines = [answer, reached, note, first, *advice]
    return [line for line in lines if line]

"""Output of a check in at most 25 lines: failures, weak spots, routes, fixes, next step."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as Folder
from typing import Any, NamedTuple

from locplan._support.intervals import Interval, format_metres, format_rate
from locplan._support.records import Table, TableColumn
from locplan._support.tables import wrap_lines
from locplan.advice.check_result import Check
from locplan.advice.driving import Scenario
from locplan.advice.failures import LETTERS, FailurePassage
from locplan.advice.fixes import SETTINGS
from locplan.advice.next_step import choose_next_action, describe_remaining_failures
from locplan.advice.rates import DriveRates, FixResult, RouteResult
from locplan.advice.weak_spots import NO_HEADING, WeakSpot
from locplan.maps.map_faults import MapFaults
from locplan.simulation.arrivals import ABORTED, ELSEWHERE, FOLLOWER_FAULT, TIMED_OUT, WORLD_FAULT
from locplan.simulation.drives import LOST_DISTANCE
from locplan.simulation.verdict import BETTER


def format_fault_finding(map_faults: MapFaults) -> str:
    """Return the sentence on the map's faults."""
    kinds = "; ".join(f"{fault.kind}: {fault.message}" for fault in map_faults)
    return f"map: {kinds or 'no faults found'}"


def format_spots(weak_spots: Sequence[WeakSpot]) -> str:
    """Return the sentence on the worst weak spot and the number of further ones."""
    if not weak_spots:
        return "weak spots: none"
    first = weak_spots[0]
    rest_text = f", and {len(weak_spots) - 1} more" if len(weak_spots) > 1 else ""
    return f"weak spots: {first.size} at {first.place}, {first.missing}{rest_text}"


def format_baseline(rates: DriveRates) -> str:
    """Report the rates of the baseline."""
    rate = format_rate(rates.lost)
    lost = f"lost (error > {LOST_DISTANCE:g} m) in {rate} of {rates.n_drives} drives"
    return f"baseline: {lost}; {format_rate(rates.reached)} reach the goal"


def format_fix(result: FixResult, before: DriveRates) -> str:
    """Report the gain of a fix that is better."""
    return f"{result.title}: lost {format_rate(before.lost)} -> {format_rate(result.rates.lost)}"


MAX_LINES = 25
"""Maximum number of lines of the output."""
ROW_COUNTS = (
    (3, 3, 4, 4, 2),
    (2, 3, 3, 4, 2),
    (2, 2, 3, 3, 2),
    (1, 2, 3, 3, 2),
    (1, 1, 3, 2, 2),
    (0, 1, 3, 2, 2),
    (0, 1, 3, 2, 1),
    (0, 1, 2, 1, 1),
    (0, 1, 1, 1, 1),
    (0, 1, 1, 1, 0),
)
"""Numbers of notes, weak spots, routes and fixes, and the level of detail. The output has the first
row that fits. Detail 1 omits the legend, objections to presets, and simulated rows next to replays.
Detail 0 also omits the advice on recordings and the hardest level. Findings are never omitted."""
NARROW = 100
"""Width of a terminal below which columns have short titles."""
ENDING_TEXTS = {
    ELSEWHERE: "stops in the wrong place",
    ABORTED: "is aborted",
    TIMED_OUT: "runs out of time",
    FOLLOWER_FAULT: "fails even with perfect localization",
    WORLD_FAULT: "finds no way to the goal",
}
"""Failure of a closed-loop drive in words, by its outcome or fault."""


def headline_sentences(check: Check) -> tuple[str, ...]:
    """Return the first sentences: rates of lost drives and of reached goals."""
    rates = check.baseline
    lost = (
        f"Your robot gets lost (error > {LOST_DISTANCE:g} m) in {format_rate(rates.lost)} of"
        f" {rates.n_drives}"
        f" simulated drives. It is off at the end in {format_rate(rates.off_at_end)}."
    )
    if not rates.n_closed:
        return (lost,)
    steered = "In closed loop (the estimate steers)"
    reached = f"{steered} it reaches the goal in {format_rate(rates.reached)}."
    if not rates.endings:
        return lost, reached
    usually = "usually " if len(rates.endings) > 1 else ""
    return lost, f"{reached} If it fails, it {usually}{ENDING_TEXTS[_find_main_ending(rates)]}."


def _find_main_ending(rates: DriveRates) -> str:
    return max(rates.endings, key=lambda ending: rates.endings[ending])


def problem_text(route: RouteResult, explained: str = LETTERS) -> str:
    """Return the failures along a route with their places; empty if no drive fails.

    Only letters in `explained` are named.
    """
    rates, problems = route.rates, []
    if rates.lost.value > 0:
        problems.append(_append_place_letters("lost", route.lost_near, explained))
    if rates.endings:
        ending = ENDING_TEXTS[_find_main_ending(rates)]
        problems.append(_append_place_letters(ending, route.stopped_near, explained))
    return ", ".join(problems)


def _append_place_letters(problem: str, letters: str, explained: str) -> str:
    named = [letter for letter in letters.split(", ") if letter and letter in explained]
    return f"{problem} at {', '.join(named)}" if named else problem


def spot_text(spot: WeakSpot) -> str:
    """Return the line on a weak spot: place, size, and reason.

    Parameters
    ----------
    spot : WeakSpot
        The spot.
    """
    name = f"Weak spot {spot.letter}".strip()
    if spot.stopped:
        return f"{name} at {spot.place}: {spot.stopped} {spot.missing}"
    if not spot.rings:
        lost = "1 drive gets lost" if spot.lost == 1 else f"{spot.lost} drives get lost"
        return f"{name} at {spot.place}: {lost}, {spot.missing}"
    uncertain = "heading" if spot.missing == NO_HEADING else "position"
    details = f"{spot.missing}, {uncertain} uncertain by {spot.deviation}"
    return f"{name} at {spot.place}, {spot.size}: {details}"


def passage_text(passage: FailurePassage) -> str:
    """Return the sentence on the place where drives fail even with perfect localization.

    Parameters
    ----------
    passage : Passage
        The passage.
    """
    place = f"({passage.x:.1f}, {passage.y:.1f})"
    fail = f"{passage.n_drives} drives fail near it even with perfect localization"
    if passage.is_narrow:
        sizes = f"{passage.width:.2f} m wide, the robot {passage.robot_width:.2f} m"
        return f"The passage at {place} is {sizes}: {fail}"
    return f"The place at {place} is not narrow, but {fail}"


class FixRow(NamedTuple):
    """A row of the table of fixes."""

    title: str
    """The fix, or several; "none" for the baseline."""
    detail: str
    """The exact change."""
    rates: DriveRates
    """Rates of the drives."""
    change: str
    """Change of the error, or the verdict if it is not better."""
    is_recommended: bool = False
    """True for the recommended fixes, whose drives are fresh."""

    @property
    def error(self) -> str:
        """Error, and its change."""
        error = format_metres(self.rates.error.value)
        return f"{error} ({self.change})" if self.change else error


def make_fix_rows(check: Check) -> list[FixRow]:
    """Return the rows of the baseline, of the recommended fixes together, and of each fix.

    Parameters
    ----------
    check : Check
        The check.
    """
    rows = [FixRow("none", "", check.baseline, "")]
    if check.confirmation:
        titles, details = (
            " + ".join(getattr(fix, name) for fix in check.recommended_fixes)
            for name in ("title", "detail")
        )
        change = _format_change(check.confirmation.word, check.confirmation.ratio)
        rows.append(FixRow(titles, details, check.after, change, True))
    return rows + [
        FixRow(fix.title, fix.detail, fix.rates, _format_change(fix.verdict, fix.ratio))
        for fix in check.fixes
        if check.recommended != (fix.kind,)
    ]


def _format_change(verdict: str, ratio: Interval) -> str:
    """Return the change of the error if a fix is better, otherwise the verdict."""
    if verdict != BETTER:
        return verdict
    return f"-{100 * (1 - ratio.value):.0f} %" if ratio.value < 1 else "fewer lost"


def check_report(check: Check, folder: Folder | None = None, *related_results: Any) -> str:
    """Return the output of a check, in at most 25 lines.

    Parameters
    ----------
    check : Check
        The check.
    folder : path, optional
        The folder that its files are in.
    *related_results
        See `choose_next_action`.
    """
    action = choose_next_action(check, folder, *related_results)
    last = wrap_lines([f"Next: {action.sentence}" if action.command else action.sentence])
    last += [f"  {line}" for line in action.command.splitlines()]
    lost, *reached = headline_sentences(check)
    first = wrap_lines([f"{lost} Brackets: 95 % intervals.", *reached, *_list_remarks(check)])
    findings = [f"map: {fault.sentence}" for fault in check.faults if fault.boxes]
    findings += check.recording_findings
    notes = [text for text in check.recording_sentences if text not in check.recording_findings]
    notes += [f"map: {fault.sentence}" for fault in check.faults if not fault.boxes]
    passage = [passage_text(check.passage)] if check.passage else []
    remaining = wrap_lines([*filter(None, [describe_remaining_failures(check)])])
    blocks: list[list[str]] = []
    for n_notes, n_spots, n_routes, n_fixes, detail in ROW_COUNTS:
        spots = _select_spots(check, n_spots, n_routes if detail else 0)
        explained = "".join(spot.letter for spot in spots)
        blocks = [
            first,
            wrap_lines([*findings, *notes[:n_notes], *passage]),
            wrap_lines(_list_spot_sentences(check, spots)),
            [
                *wrap_lines([_describe_drives(check.baseline)] if detail == 2 else []),
                *_format_route_table(check, n_routes, explained),
            ],
            [*_format_fix_table(check, n_fixes), *remaining],
            [
                *wrap_lines([*settings_sentences(check, detail)]),
                *_format_replay_table(check, is_complete=detail == 2),
            ],
            last,
        ]
        if sum(map(len, blocks)) + sum(map(bool, blocks)) - 1 <= MAX_LINES:
            break
    return "\n\n".join("\n".join(block) for block in blocks if block)


def _select_spots(check: Check, n_spots: int, n_routes: int) -> list[WeakSpot]:
    """Return the worst weak spots, and those that the first rows of the routes name."""
    near = "".join(route.lost_near + route.stopped_near for route in check.routes[:n_routes])
    return [
        spot
        for n, spot in enumerate(check.spots)
        if n < n_spots or (spot.letter and spot.letter in near)
    ]


def _list_spot_sentences(check: Check, spots: Sequence[WeakSpot]) -> list[str]:
    """Return the sentences on some weak spots; the last one also names the other letters."""
    others = [spot.letter for spot in check.spots if spot.letter and spot not in spots]
    sentences = [*map(spot_text, spots)] or ["No weak spot"]
    if others:
        sentences[-1] += f". Also drawn: {', '.join(others)}"
    return sentences


def settings_sentences(check: Check, detail: int = 2) -> tuple[str, ...]:
    """Return the sentences on the choice of AMCL's settings.

    Parameters
    ----------
    check : Check
        The check.
    detail : int, default 2
        Amount of details, see `ROWS`.
    """
    choice = check.preset_choice
    if choice is None:
        return ()
    advice = choice.advise_recording()
    is_contradicted = choice.recordings or any(
        verdict.word == BETTER and name in choice.objections
        for name, verdict in choice.verdicts.items()
    )
    objections = choice.objections.values() if is_contradicted and detail == 2 else ()
    texts = [f"{text[:1].upper()}{text[1:]}." for text in objections]
    if choice.is_preset and SETTINGS in check.recommended:
        hardest = [choice.hardest_level] if detail and choice.hardest_level else []
        name = f"{choice.name[:1].upper()}{choice.name[1:]}"
        texts = [f"{name} settings: {choice.changes}.", *hardest, *texts]
    return (*texts, advice) if advice and detail else tuple(texts)


def _format_replay_table(check: Check, *, is_complete: bool) -> list[str]:
    """Return the lines of the table of settings; none without recordings."""
    choice = check.preset_choice
    if choice is None or not choice.recordings:
        return []
    columns = (
        TableColumn("settings", value=lambda result: result.settings),
        TableColumn("case", title="drives", value=lambda result: result.case),
        TableColumn("error", title="error", value=lambda result: format_metres(result.error.value)),
        TableColumn("lost", title="lost", value=lambda result: _format_share(result.lost)),
        TableColumn(
            "off_at_end",
            title="off at the end",
            value=lambda result: _format_share(result.off_at_end),
        ),
    )
    results = [
        result for result in choice.results if is_complete or result.case in choice.recordings
    ]
    return _format_table_lines(columns, "settings", results)


def _describe_drives(rates: DriveRates) -> str:
    """Return the legend of the columns: numbers of drives."""
    lost = f"Lost, off at the end: share of {rates.n_drives} open-loop drives."
    reached = f" Reaches the goal: share of {rates.n_closed} closed-loop drives."
    return lost + (reached if rates.n_closed else "")


def _list_remarks(check: Check) -> list[str]:
    """Return remarks on an assumed lidar, and on a filter map of another size."""
    remarks = []
    if check.is_lidar_assumed:
        remarks.append(
            f"The lidar is assumed: {check.scenario.robot.title}. Name yours with --lidar."
        )
    return [*remarks, *filter(None, [_describe_map_sizes(check.scenario)])]


def _describe_map_sizes(scenario: Scenario) -> str:
    """Return the sizes of the map and of the filter's map; empty if they are equal."""
    (width, height), (filter_width, filter_height) = (
        (grid.shape[1] * grid.resolution, grid.shape[0] * grid.resolution)
        for grid in (scenario.world, scenario.filter_map)
    )
    if math.isclose(width, filter_width) and math.isclose(height, filter_height):
        return ""
    return (
        f"The map measures {width:.2f} x {height:.2f} m, the filter's map"
        f" {filter_width:.2f} x {filter_height:.2f} m."
    )


def _make_rate_columns() -> tuple[TableColumn, TableColumn, TableColumn]:
    is_narrow = _measure_width() < NARROW
    off_at_end, reached = "off at the end", "reaches the goal"
    if is_narrow:
        off_at_end, reached = "off at end", "at goal"
    return (
        TableColumn("lost", title="lost", value=lambda row: _format_share(row.rates.lost)),
        TableColumn(
            "off_at_end", title=off_at_end, value=lambda row: _format_share(row.rates.off_at_end)
        ),
        TableColumn("reached", title=reached, value=lambda row: _format_share(row.rates.reached)),
    )


def _measure_width() -> int:
    """Return the width of the terminal, or of text in a file."""
    return shutil.get_terminal_size((NARROW, 24)).columns


def _format_share(rate: Interval) -> str:
    return _make_unbreakable(format_rate(rate))


def _make_unbreakable(text: str) -> str:
    """Return a text that `_table` does not break."""
    return text.replace(" ", "\u00a0")


def _format_route_table(check: Check, n_rows: int, explained: str) -> list[str]:
    """Return the lines of the worst routes, with the letters that the text explains."""
    lost, _, reached = _make_rate_columns()
    columns = (
        TableColumn("route", value=lambda route: route.name),
        *(lost, reached),
        TableColumn("problem", title="", value=lambda route: problem_text(route, explained)),
    )
    title = _format_first_heading("route", "routes", n_rows, len(check.routes))
    return _format_table_lines(columns, title, check.routes[:n_rows])


def _format_fix_table(check: Check, n_rows: int) -> list[str]:
    """Return the lines of the baseline and of the best fixes."""
    columns = (
        TableColumn("fix", value=lambda row: row.title),
        *_make_rate_columns(),
        TableColumn("error", title="error", value=lambda row: _make_unbreakable(row.error)),
    )
    rows = make_fix_rows(check)
    title = _format_first_heading("fix", "fixes", n_rows, len(rows) - 1)
    return _format_table_lines(columns, title, rows[: n_rows + 1]) if check.fixes else []


def _format_first_heading(name: str, plural: str, n_rows: int, n_all: int) -> str:
    """Return the heading of a first column, with the number of rows if some are left out."""
    return f"{n_rows} of {n_all} {plural}" if n_rows < n_all else name


def _format_table_lines(
    columns: Sequence[TableColumn], title: str, records: Sequence[Any]
) -> list[str]:
    """Return the lines of a table."""
    name, *further_columns = columns
    table = Table.from_records([replace(name, title=title), *further_columns], records)
    text = table.text(width=_measure_width())
    lines = [line.rstrip().replace("\u00a0", " ") for line in text.splitlines()]
    return [line for line in lines if line.strip(" \u2500")]

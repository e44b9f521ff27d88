"""A check in at most 25 lines for people, and the one thing to do next."""

from __future__ import annotations

import shlex
import textwrap
from pathlib import Path as Folder
from typing import Any, NamedTuple

from locplan._util.intervals import in_metres
from locplan._util.records import Column, Table
from locplan._util.tables import REPORT_WIDTH
from locplan.diagnosis._cures import CHEAP, LANDMARKS, MEND, PATHS, REACH, SETTINGS, WALLS
from locplan.diagnosis._driving import NO_DIFFERENCE, STOPPED, WORSE
from locplan.diagnosis._in_short import share
from locplan.diagnosis._result import Check, Cure, Rates, is_better, is_seldom, keeps_place
from locplan.simulation import LOST

SHOWN = {"spots": 3, "trips": 3, "cures": 4}
"""Number of rows of each table in the text; the report has all."""


class Action(NamedTuple):
    """The one thing to do next."""

    sentence: str
    """What to do, and what it gains."""
    command: str
    """A command to copy; empty without one."""
    files: dict[str, str]
    """The files that are written for it, and what each is."""


def verdict(check: Check) -> str:
    """What there is to say first."""
    rates, few = check.as_is, check.as_is.drives
    said = (
        f"{share(rates.lost)} of {few} simulated drives are off by over {LOST:g} m at some time;"
        f" {share(rates.arrives)} arrive where they should"
    )
    if check.is_fine:
        return f"The robot keeps its place: {said}."
    if keeps_place(rates):
        return f"The robot keeps its place, but its error can be lowered: {said}."
    if not check.recommended:
        return f"The robot gets lost, and nothing that was tried clearly helps: {said}."
    if check.is_by_error:
        return f"The robot gets lost, and its error can be lowered: {said}."
    return f"The robot gets lost, and it can be cured: {said}."


def next_action(
    check: Check, folder: Folder | None = None, params: Folder | None = None, *_: Any
) -> Action:
    """The one thing to do next.

    Parameters
    ----------
    check : Check
        The check.
    folder : path, optional
        The folder that its files are in.
    params : path, optional
        The user's parameters of Nav2, of which a copy was changed; else only a section is written.
    """
    if check.is_fine:
        cheap = (each for each in check.cures if is_better(each) and each.kind in CHEAP)
        best = next(cheap, None)
        more = f" ({_would(best, check.as_is)})" if best else ""
        return Action(f"Nothing to do{more}.", "", {})
    map_file = shlex.quote(str(Folder(check.source.file).resolve())) if check.source else "MAP"
    if not check.recommended:
        return Action(
            "None of the cures is clearly better. Record a drive, and see whether the map and the"
            " robot's settings are those of the site.",
            f"locplan calibrate {map_file} --drive DRIVE",
            {},
        )
    doing = " and ".join(DO[kind].format(cure=each) for kind, each in _named(check))
    before, after = check.before, check.after
    gains = f"off by over {LOST:g} m {share(before.lost)} -> {share(after.lost)}"
    if check.is_by_error:  # then the shares of lost drives alone do not show it
        errors = " -> ".join(in_metres(each.error.value) for each in (before, after))
        gains = f"the usual error {errors}, {gains}"
    gains += f", arrive {share(before.arrives)} -> {share(after.arrives)}"
    left = "" if is_seldom(check.after.lost) else " Some drives still get lost."
    if check.after.lost.value >= 0.5:
        left = " Half of the drives or more still get lost: that alone is no cure."
    sentence = f"{doing[:1].upper()}{doing[1:]}: {gains}.{left}"
    files = check.written(params)
    if folder is None:
        return Action(sentence, "the same command with -o FOLDER writes the files for it", files)
    return Action(sentence, _commands(check, folder, map_file, params), files)


DO = {
    WALLS: "set in the map's YAML {cure.title}",
    MEND: "give the filter the mended map",
    REACH: "let the filter read {cure.title}",
    SETTINGS: "change the filter's {cure.title}",
    PATHS: "give Nav2 {cure.title}",
    LANDMARKS: "put {cure.title}",
}
"""What to do, of each kind of cure."""


def _named(check: Check) -> list[tuple[str, Cure]]:
    return [(each.kind, each) for each in check.advised]


def _would(cure: Cure, before: Rates) -> str:
    """What a cure would lower where hardly a drive is lost."""
    error = f"{in_metres(before.error.value)} to {in_metres(cure.rates.error.value)}"
    return f"{cure.title} would lower the usual error from {error}"


def _commands(check: Check, folder: Folder, map_file: str, params: Folder | None) -> str:
    """Commands that put what is recommended in force, a line each."""
    taken, own = {*check.recommended}, folder.resolve()

    def file(name: str) -> str:
        return shlex.quote(str(own / name))

    lines = []
    if MEND in taken:  # before AMCL, which waits for its map
        lines.append(f"ros2 launch {file('localizability.launch.xml')}")
    if {WALLS, LANDMARKS} & taken:
        map_file = file("map_with_landmarks.yaml" if LANDMARKS in taken else "map.yaml")
    arguments = [f"map:={map_file}"]
    is_whole = params is not None and {REACH, SETTINGS} & taken
    if is_whole:
        arguments.append(f"params_file:={file('nav2_params.yaml')}")
    if is_whole or {WALLS, LANDMARKS} & taken:
        lines.append(f"ros2 launch nav2_bringup bringup_launch.py {' '.join(arguments)}")
    if PATHS in taken and check.made[PATHS]:
        lines.append(f"ros2 launch {file('mask/localizability.launch.xml')}")
    elif PATHS in taken:
        paths = " ".join(f"--path {file(name)}" for name in check.changed_paths)
        lines.append(f"locplan export {map_file} --to nav2-routes {paths} -o {file('routes')}")
    return "\n".join(lines)


def check_report(check: Check, folder: Folder | None = None, *about: Any) -> str:
    """The check in at most 25 lines.

    Parameters
    ----------
    check : Check
        The check.
    folder : path, optional
        The folder that its files are in.
    *about
        See `next_action`.
    """
    action = next_action(check, folder, *about)
    last = [*_filled(f"Next: {action.sentence}"), *_indented(action.command)]
    if action.files:
        last.append("  " + "; ".join(f"{name}: {text}" for name, text in action.files.items()))
    robot = f"{check.site.robot.title}{' (assumed: name yours)' if check.assumed else ''}"
    return "\n".join(
        [
            *_filled(verdict(check)),
            _short(f"with {robot}"),
            *(_short(f"map: {each.what}") for each in [*check.faults][:1]),
            *map(_short, check.recorded[:2]),
            *([_short(check.start)] if check.start else []),
            *_spots(check),
            *_trips(check),
            *_cures(check),
            *last,
        ]
    )


def _indented(text: str) -> list[str]:
    return [f"  {line}" for line in text.splitlines()]


def _filled(text: str) -> list[str]:
    return textwrap.wrap(text, REPORT_WIDTH, break_on_hyphens=False, break_long_words=False)


def _short(text: str, width: int = REPORT_WIDTH) -> str:
    return textwrap.shorten(text, width, placeholder=" ...")


def _spots(check: Check) -> list[str]:
    """The worst weak spots."""
    count = len(check.trips)
    columns = (
        Column("letter", title="spot"),
        Column("place", title="at x,y"),
        Column("size", title="size"),
        Column("deviation", title="off by"),
        Column("missing", title="what is missing"),
        Column("trips", title="trips", value=lambda each: f"{len(each.trips)} of {count}"),
    )
    few = check.spots[: SHOWN["spots"]]
    return _lines(Table.of(columns, few)) if few else ["no weak spot of a square metre or more"]


def _trips(check: Check) -> list[str]:
    """The worst trips."""
    columns = (
        Column("name", title="trip", value=lambda each: _short(each.name, 24)),
        Column("length", "m", "length", 0, value=lambda each: each.path.length),
        Column("lost", title=f"off by over {LOST:g} m", value=lambda each: share(each.rates.lost)),
        Column("near", title="lost near", value=lambda each: each.lost_near or "-"),
        Column("arrives", title="arrives", value=lambda each: share(each.rates.arrives)),
    )
    worst = sorted(check.trips, key=lambda each: -each.rates.lost.value)
    return _lines(Table.of(columns, worst[: SHOWN["trips"]]))


def _cures(check: Check) -> list[str]:
    """The cures that were tried."""
    before = f"{100 * check.as_is.lost.value:.0f} -> "

    columns = (
        Column("title", title="cure", value=lambda each: _short(each.title, 28)),
        Column(
            "lost",
            title=f"off by over {LOST:g} m",
            value=lambda each: before + share(each.rates.lost),
        ),
        Column("arrives", title="arrives", value=lambda each: share(each.rates.arrives)),
        Column("verdict", title="", value=said),
    )
    few = check.cures[: SHOWN["cures"]]
    return _lines(Table.of(columns, few)) if few else ["no cure suits: nothing was tried"]


SAID = {NO_DIFFERENCE: "no better", WORSE: "worse", STOPPED: "no better"}
"""Verdicts in few words."""


def said(cure: Cure) -> str:
    """The verdict on a cure in few words; of one that lowers the error alone by how much."""
    if not is_better(cure):
        return SAID[cure.verdict]
    return "better" if cure.gain.low > 0 else f"error {cure.ratio.value - 1:+.0%}"


def _lines(table: Table) -> list[str]:
    return [line.rstrip() for line in str(table).splitlines()]

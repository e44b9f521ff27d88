"""A check in at most 25 lines for people, and the one thing to do next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as Folder
from typing import Any, NamedTuple

from locplan._util.intervals import in_metres
from locplan._util.records import Column, Table
from locplan._util.runs import typed
from locplan._util.tables import wrapped
from locplan.diagnosis._cures import CHEAP, LANDMARKS, MEND, PATHS, REACH, SETTINGS, WALLS
from locplan.diagnosis._driving import Site
from locplan.diagnosis._files import Params, as_files, has_amcl
from locplan.diagnosis._in_short import share
from locplan.diagnosis._result import (
    NOTHING,
    Check,
    Cure,
    Rates,
    is_better,
    is_seldom,
    keeps_place,
)
from locplan.simulation import LOST

LINES, HALF = 25, 0.5
"""Maximum number of lines of the text, and share of lost drives that is no cure."""
ROWS = (
    (3, 3, 3, 4),
    (2, 3, 3, 3),
    (1, 3, 3, 2),
    (1, 3, 2, 2),
    (1, 3, 1, 2),
    (0, 3, 1, 2),
    (0, 2, 1, 1),
)
"""Numbers of notes, places, trips and cures, of which the text has the first that fit."""


class Action(NamedTuple):
    """The one thing to do next."""

    sentence: str
    """What to do, and what it gains."""
    command: str
    """A command to copy; empty without one."""
    files: dict[str, str]
    """The files that are written for it, and what each is."""


def verdict(check: Check) -> str:
    """What there is to say first: whether the robot gets lost, how often, and where."""
    rates = check.as_is
    worst = next((each for each in check.spots if each.lost), None)
    most = f", most at {worst.letter} ({worst.place})" if worst else ""
    lost = (
        f"{share(rates.lost)} of {rates.drives} simulated drives get lost (off by over {LOST:g} m"
    )
    ends = f"; else it mostly {rates.ends}" if rates.ends else ""
    arrives = f" Steered by its filter, the robot arrives in {share(rates.arrives)}{ends}."
    said = f"{lost} at some time){most}.{'' if math.isnan(rates.arrives.value) else arrives}"
    if check.is_fine:
        return f"The robot keeps its place: {said}"
    if keeps_place(rates):
        shown = any(map(is_better, check.advised))
        but = "its error can be lowered" if shown else "its map's file is wrong"
        return f"The robot keeps its place, but {but}: {said}"
    what = "does not always arrive" if is_seldom(rates.lost) else "gets lost"
    helps = "and its error can be lowered" if check.is_by_error else "and it can be cured"
    if not check.recommended or check.after.lost.value >= HALF:
        helps = "and nothing that was tried cures it"
    return f"The robot {what}, {helps}: {said}"


def next_action(check: Check, folder: Folder | None = None, params: Params = (), *_: Any) -> Action:
    """The one thing to do next.

    Parameters
    ----------
    check : Check
        The check.
    folder : path, optional
        The folder that its files are in.
    params : path or sequence of path, default ()
        The user's parameters of Nav2, of which a copy was changed; without AMCL's only a section is
        written.
    """
    if check.is_fine:
        cheap = (each for each in check.cures if is_better(each) and each.kind in CHEAP)
        sentence = f"Nothing to do{_would(next(cheap, None), check.as_is)}."
        if check.effort == "quick":
            sentence += f" A loss of up to {check.as_is.lost.high:.0%} may hide from --quick."
        return Action(sentence, "", {})
    map_file = str(Folder(check.source.file).resolve()) if check.source else "MAP"
    again = typed() or ["locplan", "check", map_file]
    if not check.recommended:
        return Action(*_further(check, again, map_file), {})
    doing = "; ".join(DO[each.kind].format(cure=each) for each in check.advised)
    sentence = f"{doing[:1].upper()}{doing[1:]}: {_gains(check)}"
    files = check.written(params)
    if folder is None:
        return Action(sentence, shlex.join([*again, "-o", "report"]), files)
    return Action(sentence, _commands(check, folder, again, map_file, params), files)


def _gains(check: Check) -> str:
    """What all that is recommended gains, and whether that is enough."""
    if not any(map(is_better, check.advised)):
        return "the file is wrong there, though drives do not show that it costs much."
    before, after = check.as_is, check.after
    gains = f"lost {100 * before.lost.value:.0f} -> {share(after.lost)}"
    if check.is_by_error:  # then the shares of lost drives alone do not show it
        errors = " -> ".join(in_metres(each.error.value) for each in (before, after))
        gains = f"the usual error {errors}, {gains}"
    if not math.isnan(before.arrives.value):
        gains += f", arrives {100 * before.arrives.value:.0f} -> {share(after.arrives)}"
    gains += " of fresh drives."
    if is_seldom(after.lost):
        return gains
    left = "That alone is no cure" if after.lost.value >= HALF else "Some drives still get lost"
    quick = check.effort == "quick"
    more = "; without --quick, paths and poles are tried, too." if quick else "."
    return f"{gains} {left}{more}"


def _further(check: Check, again: list[str], map_file: str) -> tuple[str, str]:
    """What to do where nothing that was tried is clearly better, and the command for it."""
    if check.effort == "quick":
        said = "Try other paths and poles, too, on three times as many drives:"
        return said, shlex.join([word for word in again if word != "--quick"])
    if check.recorded:
        drives = [word for word in again if word.startswith("--drive")]
        command = ["locplan", "tune", map_file, *drives, "-o", "tuned"]
        return "Search settings on your own drives:", shlex.join(command)
    return (
        "Record a drive on the site, and check again with --drive drive: it shows whether the map"
        " fits, and how the filter really does.",
        "ros2 bag record -o drive /scan /odom /tf /tf_static",
    )


DO = {
    WALLS: "set in the map's YAML {cure.title}",
    MEND: "give the filter the mended map",
    REACH: "let the filter read {cure.title}",
    SETTINGS: "change the filter's {cure.title}",
    PATHS: "give Nav2 {cure.title}",
    LANDMARKS: "put up {cure.effort} where landmarks.csv says",
}
"""What to do, of each kind of cure."""


def _would(cure: Cure | None, before: Rates) -> str:
    """What a cure would lower where hardly a drive is lost."""
    if cure is None:
        return ""
    error = f"{in_metres(before.error.value)} to {in_metres(cure.rates.error.value)}"
    return f" ({cure.title} would lower the usual error from {error})"


def _commands(check: Check, folder: Folder, again: list[str], map_file: str, params: Params) -> str:
    """Commands that put what is recommended in force, or check that it helps, a line each."""
    taken, own = {*check.recommended}, folder.resolve()
    lines = []
    mask, params = bool(check.made.get(PATHS)), as_files(params)
    # Before Nav2, which waits for its maps.
    for place, needed in ((own, MEND in taken), (own / "mask", mask)):
        if needed:
            lines.append(["ros2", "launch", str(place / "localizability.launch.xml")])
    if {WALLS, LANDMARKS} & taken:
        name = "map_with_landmarks.yaml" if LANDMARKS in taken else "map.yaml"
        map_file = str(own / name)
    arguments = [f"map:={map_file}"]
    settings = {REACH, SETTINGS} & taken and has_amcl(params)
    changed = str(own / "nav2_params.yaml") if settings else ""
    if mask and params:  # which has the other changes, too
        whole = "nav2.yaml" if changed or len(params) == 1 else "merged.yaml"
        changed = str(own / "mask" / whole)
    if changed:
        arguments.append(f"params_file:={changed}")
    if len(arguments) > 1 or {WALLS, LANDMARKS} & taken:
        lines.append(["ros2", "launch", "nav2_bringup", "bringup_launch.py", *arguments])
    if PATHS in taken and not mask:
        paths = [f"--path={own / name}" for name in check.changed_paths]
        to = ["--to", "nav2-routes", *paths, "-o", str(own / "routes")]
        lines.append(["locplan", "export", map_file, *to])
    if not lines:  # the parameters have to be merged by hand, and can be checked before
        lines.append([*again, "--robot", str(folder / "nav2_params.yaml")])
    return "\n".join(map(shlex.join, lines))


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
    files = "; ".join(f"{name}: {text}" for name, text in action.files.items())
    if files and action.command.startswith("locplan check"):
        files += ", written by" if folder is None else "; to try it:"
    last = wrapped([f"Next: {action.sentence}", *filter(None, [files])])
    last += [f"  {line}" for line in action.command.splitlines()]
    assumed = " (assumed: name yours)" if check.assumed else ""
    heads = [verdict(check), f"with {check.site.robot.title}{assumed}", _map_sizes(check.site)]
    first = wrapped([*filter(None, heads)])
    # Faults with places come first: the last notes are left out where the report is long.
    faults = sorted(check.faults, key=lambda fault: not fault.boxes)
    said_of_map = [f"map: {fault.sentence}" for fault in faults]
    located = sum(bool(fault.boxes) for fault in faults)
    notes = [*said_of_map[:located], *check.recorded, *said_of_map[located:], check.start]
    said: list[str] = []
    for count, *rows in ROWS:
        more = wrapped([*filter(None, notes)][:count])
        said = [*first, *more, *_tables(check, *rows), *last]
        if len(said) <= LINES:
            break
    return "\n".join(said)


def _map_sizes(site: Site) -> str:
    """Return the sizes of the map and of the filter's map, or nothing if they are the same."""
    (width, height), (filter_width, filter_height) = (
        (each.shape[1] * each.resolution, each.shape[0] * each.resolution)
        for each in (site.world, site.filter_map)
    )
    if math.isclose(width, filter_width) and math.isclose(height, filter_height):
        return ""
    return (
        f"the map measures {width:.2f} x {height:.2f} m, the filter's map"
        f" {filter_width:.2f} x {filter_height:.2f} m"
    )


def _tables(check: Check, spots: int, trips: int, cures: int) -> list[str]:
    """Lines of the worst places, the worst trips and the best cures, so many of each."""
    count = len(check.trips)
    rates = (
        Column("lost", title="lost [95 %]", value=lambda each: share(each.rates.lost)),
        Column("arrives", title="arrives", value=lambda each: share(each.rates.arrives)),
    )
    place = (
        Column("place", value=lambda each: f"{each.letter} {each.place}".strip()),
        Column("lost", title="lost", value=lambda each: f"{each.lost}"),
        Column("missing", title="what is missing"),
        Column("deviation", title="off by"),
        Column("size", title="size"),
        Column("trips", title="trips", value=lambda each: f"{len(each.trips)} of {count}"),
    )
    near = Column("near", title="near", value=lambda each: each.lost_near or "-")
    ends = Column("ends", title="or else it", value=lambda each: each.rates.ends or "-")
    trip = Column("trip", value=lambda each: each.name), *rates, near, ends
    cure = Column("cure", value=lambda each: each.title), *rates, Column("", title="", value=said)
    worst = sorted(check.trips, key=lambda each: (-each.rates.lost.value, each.rates.arrives.value))
    as_is = Cure("", "as it is", "", "", check.as_is, NOTHING, NOTHING, 0.0)
    return [
        *(_table(place, check.spots, spots) or ["no weak spot, and no drive is lost"]),
        *_table(trip, worst, trips),
        *(_table(cure, check.cures, cures, as_is) or ["no cure suits: nothing was tried"]),
    ]


def _table(columns: Sequence[Column], records: Sequence[Any], most: int, *first: Any) -> list[str]:
    """Lines of a table, whose first heading says how many rows are not shown."""
    what, *others = columns
    title = f"{most} of {len(records)} {what.name}s" if len(records) > most else what.name
    table = Table.of([replace(what, title=title), *others], [*first, *records[:most]])
    lines = [line.rstrip() for line in str(table).splitlines()]
    return [line for line in lines if line.strip(" \u2500")] if records else []


def said(cure: Cure) -> str:
    """The verdict on a cure; of one that lowers the error alone by how much, too."""
    alone = is_better(cure) and not cure.keeps_more
    return f"{cure.verdict}: error {cure.ratio.value - 1:+.0%}" if alone else cure.verdict

"""Reports of twins: tables for people, and files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.results import ResultFolder, Results
from locplan._util.tables import finite, table
from locplan.simulation._writing import write_json, write_rows
from locplan.twins._looks import THRESHOLD
from locplan.twins._starts import Start
from locplan.twins._trials import GlobalMatches
from locplan.twins._twins import LAYERS, SHOWN, Twin, Twins

TWINS = Results(
    "twins",
    ("twins.json", "twins.png", "twins.csv", "twins.npz", "symmetries.csv", "starts.csv"),
)
COLUMNS = (
    *("x_m", "y_m", "excess_nat", "elsewhere", "modes", "turned", "stretch_m"),
    *("twin_x_m", "twin_y_m", "twin_heading_deg", "twin_excess_nat", "heading_deg"),
)
"""Names of the columns of twins.csv: a place, and the best of its twins."""
UNSAFE = 0.1
"""Share of the posterior elsewhere from which on a start is not safe."""
CLAIM = (
    "about matches of single scans with the whole map; AMCL's own global localization, which"
    " spreads particles and drives, is not foreseen well"
)


def twins_table(
    twins: Twins,
    starts: Sequence[Start],
    matches: GlobalMatches | None = None,
    place: int | None = None,
) -> str:
    """What can be mistaken for what, the symmetries, the best starts, and what matches say.

    With the number of a place, its twins instead.
    """
    said = []
    if place is None:
        alone = float((twins.stretch > 0).mean())
        said.append(
            f"{twins.grid.name or 'map'}: {twins.share:.0%} of {len(twins)} places have a twin of"
            f" up to {THRESHOLD:g} nats more than 2 m away; on {alone:.0%} a match can slide"
        )
        if twins.unseen > 0:
            said.append(f"on {twins.unseen:.0%} too few beams return to tell anything")
        said.append(f"with {twins.matching.lidar.title}; {CLAIM}")
        said.append(_symmetries(twins))
        if starts:
            heads = ["start", "x [m]", "y [m]", "least excess [nat]", "elsewhere"]
            said.append(table(heads, [_start(n, each) for n, each in enumerate(starts, 1)]))
            if starts[0].elsewhere > UNSAFE:
                said.append("no start is safe: tell the robot where it is, or add a landmark")
    else:
        said.append(_of_place(twins, place))
    if matches:
        low, high = matches.failure_rate.low, matches.failure_rate.high
        said.append(
            f"{len(matches.poses)} noisy scans from random poses were matched:"
            f" {matches.failed.mean():.1%} [{low:.1%}, {high:.1%}] failed,"
            f" {matches.elsewhere.mean():.1%} was foreseen; {_foreseen(matches)}"
        )
    return "\n".join(part for part in said if part)


def _foreseen(matches: GlobalMatches) -> str:
    """How well failures were foreseen, where there are some, and named."""
    if not matches.failed.any():
        return "no match was wrong, so that nothing can be said of how well failures are foreseen"
    named = f"twins or stretches name {matches.named_share:.0%} of the wrong matches"
    return named if math.isnan(matches.auc) else f"AUC {matches.auc:.2f}; {named}"


def _symmetries(twins: Twins) -> str:
    if not twins.symmetries:
        return "no symmetry: no rigid move takes a tenth of the places to twins"
    rows = []
    for n, each in enumerate(twins.symmetries[:SHOWN], 1):
        rows.append([str(n), f"{each.turn_deg:+d}", each.shift, f"{each.share:.0%}"])
    heads = ["symmetry", "turn [deg]", "the map's middle moves by [m]", "places"]
    more = len(twins.symmetries) - len(rows)
    return table(heads, rows) + (f"\n{more} more with fewer places" if more > 0 else "")


def _start(number: int, start: Start) -> list[str]:
    excess = f"{start.excess:.1f}" if math.isfinite(start.excess) else "no other"
    return [str(number), f"{start.x:.2f}", f"{start.y:.2f}", excess, f"{start.elsewhere:.1%}"]


def _of_place(twins: Twins, place: int) -> str:
    x, y = twins.places[place]
    elsewhere, stretch = twins.elsewhere[place], twins.stretch[place]
    lines = [f"{x:.2f},{y:.2f}: {elsewhere:.1%} of the posterior lies more than 2 m away"]
    if stretch > 0:
        lines.append(f"a match can slide {stretch:.1f} m without a rise of the loss")
    if twins.turned[place]:
        lines.append(f"it looks alike in {twins.turned[place]:.0f} other headings")
    found = twins.of(place)
    if not found:
        return "\n".join([*lines, "no twin"])
    heads = ["twin", "x [m]", "y [m]", "heading [deg]", "excess [nat]", "heading here [deg]"]
    rows = [
        [
            str(n),
            f"{twin.x:.2f}",
            f"{twin.y:.2f}",
            str(round(math.degrees(twin.heading))),
            f"{twin.excess:.2f}",
            str(round(math.degrees(twin.here))),
        ]
        for n, twin in enumerate(found[:SHOWN], 1)
    ]
    return "\n".join([*lines, table(heads, rows)])


def twins_summary(
    twins: Twins,
    starts: Sequence[Start],
    matches: GlobalMatches | None = None,
    place: int | None = None,
) -> dict[str, object]:
    """Shares, symmetries, starts and matches in numbers, fit for JSON; or the twins of a place."""
    about = twins.summary()
    about["starts"] = [dataclasses.asdict(each) for each in starts]
    about["matches"] = matches.summary() if matches else None
    if place is not None:
        about["at"] = {
            "position": twins.places[place].tolist(),
            **{name: float(getattr(twins, name)[place]) for name in LAYERS},
            "twins": [each._asdict() for each in twins.of(place)],
        }
    return finite(about)


def write_twins(
    results: ResultFolder,
    twins: Twins,
    starts: Sequence[Start],
    matches: GlobalMatches | None = None,
    place: int | None = None,
) -> list[Path]:
    """Write the layers, the symmetries, the starts and the picture.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.twins import _figures

    with results.writing() as folder:
        write_json(folder / "twins.json", twins_summary(twins, starts, matches, place))
        drawn = (
            _figures.twins_figure(twins, starts)
            if place is None
            else _figures.place_figure(twins, place)
        )
        save_figure(drawn, folder / "twins.png")
        write_rows(folder / "twins.csv", COLUMNS, (_row(twins, n) for n in range(len(twins))))
        arrays: dict[str, Any] = {name: twins.layer(name).astype(np.float32) for name in LAYERS}
        arrays |= {"places": twins.places, "headings": twins.headings, "twins": twins.twins}
        np.savez_compressed(folder / "twins.npz", **arrays)
        write_rows(
            folder / "symmetries.csv",
            ("turn_deg", "middle_x_m", "middle_y_m", "moved_x_m", "moved_y_m", "share"),
            (
                [math.degrees(each.turn), *each.middle, *each.moved, each.share]
                for each in twins.symmetries
            ),
        )
        write_rows(
            folder / "starts.csv",
            ("number", "x_m", "y_m", "excess_nat", "elsewhere"),
            ([n, *dataclasses.astuple(each)] for n, each in enumerate(starts, 1)),
        )
        written = sorted(file.name for file in folder.iterdir())
    return [results.folder / name for name in written]


def _row(twins: Twins, place: int) -> list[float]:
    found = twins.of(place)
    best = found[0] if found else Twin(*[math.nan] * 5)
    return [
        *twins.places[place].tolist(),
        *(float(getattr(twins, name)[place]) for name in LAYERS),
        *(best.x, best.y, math.degrees(best.heading), best.excess, math.degrees(best.here)),
    ]

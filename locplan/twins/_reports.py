"""The report of twins: text for people."""

from __future__ import annotations

import math
from collections.abc import Sequence

from locplan._util.records import Table
from locplan.twins._places import STARTS, SYMMETRIES, THRESHOLD, TWIN, GlobalMatches, Start
from locplan.twins._twins import SHOWN, Twins

CLAIM = (
    "about matches of single scans with the whole map; AMCL's own global localization, which"
    " scatters particles and drives, is not foreseen well"
)


def twins_report(
    twins: Twins, starts: Sequence[Start] | None = None, matches: GlobalMatches | None = None
) -> str:
    """What can be mistaken for what, the symmetries, the best starts, and what matches say.

    Of one place only, its twins instead.
    """
    starts = twins.best_starts() if starts is None else starts
    said = _of_place(twins) if len(twins) == 1 else _of_all(twins, starts)
    if matches:
        low, high = matches.failure_rate.low, matches.failure_rate.high
        said.append(
            f"{len(matches.poses)} noisy scans from random poses were matched:"
            f" {matches.failed.mean():.1%} [{low:.1%}, {high:.1%}] failed,"
            f" {matches.elsewhere.mean():.1%} was foreseen; {_foreseen(matches)}"
        )
    return "\n".join(said)


def _foreseen(matches: GlobalMatches) -> str:
    """How well failures were foreseen, where there are some, and named."""
    if not matches.failed.any():
        return "no match was wrong, so that nothing can be said of how well failures are foreseen"
    named = f"twins or stretches name {matches.named_share:.0%} of the wrong matches"
    return named if math.isnan(matches.auc) else f"AUC {matches.auc:.2f}; {named}"


def _of_all(twins: Twins, starts: Sequence[Start]) -> list[str]:
    alone = float((twins.stretch > 0).mean())
    said = [
        f"{twins.grid.name or 'map'}: {twins.share:.0%} of {len(twins)} places have a twin of"
        f" up to {THRESHOLD:g} nats more than 2 m away; on {alone:.0%} a match can slide"
    ]
    if twins.unseen > 0:
        said.append(f"on {twins.unseen:.0%} too few beams return to say anything")
    said.append(f"with {twins.matching.lidar.title}; {CLAIM}")
    if twins.symmetries:
        said.append(Table.of(SYMMETRIES, twins.symmetries, number="symmetry").text(SHOWN))
        more = len(twins.symmetries) - SHOWN
        said += [f"{more} more with fewer places"] if more > 0 else []
    else:
        said.append("no symmetry: no rigid move takes a tenth of the places to twins")
    if starts:
        said.append(str(Table.of(STARTS, starts, number="start")))
        # Share of the posterior elsewhere from which on a start is not safe.
        if starts[0].elsewhere > 0.1:
            said.append("no start is safe: give the robot its pose, or add a landmark")
    return said


def _of_place(twins: Twins) -> list[str]:
    x, y = twins.places[0]
    stretch, turned, found = twins.stretch[0], twins.turned[0], twins.of(0)
    said = [f"{x:.2f},{y:.2f}: {twins.elsewhere[0]:.1%} of the posterior lies more than 2 m away"]
    if stretch > 0:
        said.append(f"a match can slide {stretch:.1f} m without a rise of the loss")
    if turned:
        said.append(f"it looks alike in {turned:.0f} other headings")
    return [*said, Table.of(TWIN, found, number="twin").text(SHOWN) if found else "no twin"]

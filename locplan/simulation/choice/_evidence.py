"""The evidence of a choice: a table of its drives."""

from __future__ import annotations

import math

from locplan._util.intervals import Interval, digits_of
from locplan._util.tables import align
from locplan.simulation.choice._answer import (
    Decision,
    format_length,
    format_share,
    name_tuned_settings,
)
from locplan.simulation.choice._driven import Driven
from locplan.simulation.choice._race import ROUNDS

RACE_NOTE = (
    f"~: driven in the race alone, {ROUNDS[0]} to {ROUNDS[1]} times; the error is scaled by the"
    " shortest path's in the same drives"
)
"""Explains the mark of errors that are scaled."""


def evidence_table(decision: Decision) -> str:
    """Return the drives of each candidate as a table, the recommended path first; empty without."""
    shortest, chosen = decision.shortest, decision.chosen
    if shortest is None or chosen is None or shortest.driven is None:
        return ""
    ordered = [chosen, *(each for each in decision.candidates if each is not chosen)]
    rows = [(each.name, each, each.driven) for each in ordered]
    if decision.rival is not None:
        at = 1 + ordered.index(shortest)
        rows.insert(at, (f"{shortest.name}, tuned", shortest, decision.rival))
    has_off = any(driven is not None and driven.off_at_end.any() for _, _, driven in rows)
    is_angle = decision.settings.minimise == "heading"
    what = {"heading": "heading error [deg]", "goal-error": "error at the goal [m]"}
    heads = ["  path", "length", what.get(decision.settings.minimise, "error [m]"), "lost"]
    heads += [*(["off at the end"] if has_off else []), "drives"]
    texts = []
    for name, each, driven in rows:
        if driven is None:
            continue
        is_shared = driven.numbers.start == shortest.driven.numbers.start
        error = _format_error(driven.error, is_angle)
        if not is_shared:
            error = f"~{_format_error(_scaled_error(driven, shortest.driven), is_angle)}"
        mark = ">" if each is chosen and driven is not decision.rival else " "
        off = [f"{driven.off_at_end_rate.value:.0%}".replace("%", " %")] * has_off
        cells = [f"{mark} {name}", format_length(each), error]
        texts.append((*cells, format_share(driven.lost_rate), *off, str(len(driven.numbers))))
    return align(heads, texts)


def list_notes(decision: Decision) -> list[str]:
    """Return what the table's marks mean."""
    starts = {each.driven.numbers.start for each in decision.candidates if each.driven}
    notes = [RACE_NOTE] if len(starts) > 1 else []
    if decision.rival is not None:
        notes.append(f"tuned: {name_tuned_settings(decision)}")
    return notes


def _scaled_error(driven: Driven, shortest: Driven) -> Interval:
    """The error as if it were driven in the shortest path's drives, without an interval."""
    return Interval(driven.ratio.value * shortest.error.value, math.nan, math.nan)


def _format_error(error: Interval, is_angle: bool) -> str:
    digits = 1 if is_angle else digits_of(error.value)
    scale = math.degrees(1.0) if is_angle else 1.0
    value, low, high = (f"{scale * each:.{digits}f}" for each in error)
    return value if math.isnan(error.low) else f"{value} [{low}, {high}]"

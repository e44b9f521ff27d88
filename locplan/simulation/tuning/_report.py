"""Results of tuning as text."""

from __future__ import annotations

import textwrap

from locplan._util.runs import typed
from locplan._util.tables import REPORT_WIDTH
from locplan.robots.presets import CHANGES, describe_preset
from locplan.simulation.tuning._choose_preset import OWN
from locplan.simulation.tuning._results import Tuning

PRESETS = ". ".join(f"{name}: {describe_preset(name)}" for name in CHANGES) + "."
"""The meaning of the presets' names."""


def tuning_report(tuning: Tuning) -> str:
    """Return the answer, the table of all drives, and warnings."""
    choice = tuning.choice
    recorded = f" on {tuning.recording}" if tuning.recording else ""
    hint = choice.advise_recording(typed() or ["locplan", "tune", "MAP"])
    lines = [
        *(_wrap(f"note: {note}") for note in tuning.notes),
        _wrap(f"{tuning.conclusion}."),
        *([_wrap(hint)] if hint else []),
        _wrap(PRESETS),
        "",
        str(tuning.table()),
        _wrap(choice.describe_table(tuning.seed)),
        *(_wrap(f"{text[:1].upper()}{text[1:]}.") for text in _minor_objections(tuning)),
        "",
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}{recorded}",
        *(f"warning: {warning}" for warning in tuning.warnings),
    ]
    if choice.is_preset:
        lines.append("To go back, use your own file again: it stays as it was.")
    elif tuning.recording:
        lines.append(
            _wrap(
                f"No preset holds on your drive: keep {OWN}. Look at how well the map fits there,"
                " and how far odometry drifts (locplan recording FILE MAP)."
            )
        )
    return "\n".join(lines)


def _minor_objections(tuning: Tuning) -> list[str]:
    """Return the objections that the conclusion does not name."""
    return [*tuning.choice.objections.values()] if tuning.choice.is_preset else []


def _wrap(text: str) -> str:
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)

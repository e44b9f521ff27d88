"""Results of tuning as text."""

from __future__ import annotations

import textwrap

from locplan._util.tables import REPORT_WIDTH, table
from locplan.simulation.tuning._results import OWN, Tuning
from locplan.simulation.verdict import BETTER


def tuning_report(tuning: Tuning) -> str:
    """Return the answer, the table of the settings that were judged, the presets and warnings."""
    better = tuning.verdict == BETTER
    lines = [
        *(f"note: {note}" for note in tuning.notes),
        f"{tuning.conclusion}.",
        "",
        str(tuning.table()),
        _describe_drives(tuning),
        "",
        _presets_table(tuning),
        "These drives chose the best preset. Those above are fresh ones.",
        "Presets that were clearly worse stopped early.",
        "",
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {warning}" for warning in tuning.warnings),
        *_next_steps(tuning),
    ]
    if better:
        lines.append("To go back, use your own file again: it stays as it was.")
    return "\n".join(lines)


def _describe_drives(tuning: Tuning) -> str:
    """Return the sentence on the drives of the first table."""
    if tuning.recording:
        text = (
            f"{tuning.drives} replays of the whole of {tuning.recording} and of each of"
            f" {tuning.paths} stretches of its second half. The second half decides. On the whole"
            " drive the preset must not be worse. Errors are against the recorded poses."
        )
    else:
        where = f"of each of {tuning.where}" if tuning.grids[1:] else f"of {tuning.where}"
        text = (
            f"{tuning.drives} simulated drives along each of {tuning.paths} random paths {where}."
            " The usual level decides. With three times the errors of odometry (x3) the preset"
            " must not be worse."
        )
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)


def _presets_table(tuning: Tuning) -> str:
    rows = [
        [preset.name, f"{preset.error:.3f} m", f"{preset.lost:.0%}", f"{preset.drives}"]
        for preset in sorted(tuning.tried, key=lambda preset: preset.error)
    ]
    return table(["preset", "error", "lost", "drives"], rows)


def _next_steps(tuning: Tuning) -> list[str]:
    """Return the commands to go on with if no preset holds on a recording."""
    if not (tuning.recording and tuning.contradicting):
        return []
    return [
        f"Nothing that was tried holds on your drive: keep {OWN}. Look at how many scans fit the"
        " map there (locplan evaluate --drive), and how far odometry drifts (locplan calibrate"
        " --drive)."
    ]

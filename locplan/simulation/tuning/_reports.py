"""The report of tuning, for people."""

from __future__ import annotations

from string import ascii_uppercase

from locplan._util.intervals import Interval, two_digits
from locplan._util.tables import table
from locplan.simulation.tuning._results import Judged, Tuning


def tuning_report(tuning: Tuning) -> str:
    """Table of the settings that were judged, the warnings, and the conclusion."""
    head = ["", *(level.name for level in tuning.levels), "RMSE to A's", "ms/update", "ms/m"]
    rows = [
        [
            letter,
            *(f"{_metres(at.rmse.value)} {at.lost.value:.0%}" for at in each.levels),
            "1" if each is tuning.judged[0] else _short(each.ratio),
            f"{1e3 * each.cpu_per_update:.2f}",
            f"{1e3 * each.cpu_per_metre:.2f}",
        ]
        for letter, each in zip(ascii_uppercase, tuning.judged, strict=False)
    ]
    names = [
        f"{letter}: {_name(tuning, each)}"
        for letter, each in zip(ascii_uppercase, tuning.judged, strict=False)
    ]
    lines = [
        table(head, rows),
        *names,
        *_explained(tuning),
        *_gains(tuning),
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {each}" for each in tuning.lints),
        tuning.conclusion,
    ]
    return "\n".join(lines)


def _explained(tuning: Tuning) -> list[str]:
    """What the table's numbers are."""
    if tuning.drive:
        return [
            "RMSE of the position and share of lost replays (> 1 m at any time), against the"
            " recorded poses,",
            f"on {tuning.paths} stretches of {tuning.drive}, {tuning.drives} replays each, on which"
            " nothing was chosen;",
            "RMSE to A's [95 % over the stretches]; ms: CPU time",
        ]
    return [
        "RMSE of the position and share of lost drives (> 1 m at any time), with a third of, once",
        f"and three times odometry's errors, on {tuning.paths} random paths, {tuning.drives} drives"
        " each, on which nothing was",
        "chosen; RMSE to A's over all levels [95 %]; ms: CPU time, with that of the simulated scan",
    ]


def _gains(tuning: Tuning) -> list[str]:
    """What each change of the best setting gains, and what was put back."""
    kept = [axis.name for axis in tuning.changed_axes()]
    gains = [
        f"{name} {100 * (ratio - 1):+.0f} %{'' if name in kept else ' (put back)'}"
        for name, ratio in sorted(tuning.contributions.items(), key=lambda each: -each[1])
    ]
    where = "" if tuning.drive else " at its worst level"
    return [f"RMSE{where} without a change: {', '.join(gains)}"] if gains else []


def _name(tuning: Tuning, judged: Judged) -> str:
    marks = []
    if judged.amcl == tuning.winner and tuning.changes:
        marks.append("to use")
    if judged.better_everywhere and not tuning.drive:
        marks.append("better at every level")
    return f"{judged.name} ({'; '.join(marks)})" if marks else judged.name


def _metres(value: float) -> str:
    return f"{value:.2g} m"


def _short(interval: Interval) -> str:
    """Text of an interval without its leading zeros."""
    return " ".join(
        part.removeprefix("0") for part in two_digits(interval).replace("[0", "[").split()
    )

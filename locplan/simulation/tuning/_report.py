"""What tuning found, in text."""

from __future__ import annotations

import math
from string import ascii_uppercase

from locplan._util.intervals import Interval, two_digits
from locplan._util.tables import table
from locplan.simulation.tuning._judged import Judged, WholeDrive
from locplan.simulation.tuning._results import Tuning


def tuning_report(tuning: Tuning) -> str:
    """Table of the settings that were judged, the warnings, and the conclusion."""
    levels = ["worst"] if tuning.is_joined else [level.name for level in tuning.levels]
    if tuning.drive:
        levels = ["whole drive", "first off", *(levels if tuning.is_joined else ["stretches"])]
    head = ["", *levels, "RMSE to A's", "ms/update", "ms/m"]
    rows, names = [], []
    for letter, each in zip(ascii_uppercase, tuning.judged, strict=False):
        rows.append(
            [
                letter,
                *_of_whole(each.whole),
                *_at_levels(tuning, each),
                "1" if each is tuning.judged[0] else _short((each.whole or each).rmse_ratio),
                f"{each.cpu_ms_per_update:.2f}",
                f"{each.cpu_ms_per_metre:.2f}",
            ]
        )
        names.append(f"{letter}: {_name(tuning, each)}")
    lines = [
        *(f"note: {each}" for each in tuning.notes),
        table(head, rows),
        *names,
        _explained(tuning),
        *_gains(tuning),
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {each}" for each in tuning.lints),
        tuning.conclusion,
        *_holds_for(tuning),
        *_comes_back(tuning),
        *(["To go back, use your own file again: it stays as it was."] if tuning.changes else []),
    ]
    return "\n".join(lines)


def _at_levels(tuning: Tuning, judged: Judged) -> list[str]:
    """Cells of the levels; of several maps, that of the worst one, with its name."""
    some = [judged.worst_at()] if tuning.is_joined else judged.levels
    cells = []
    for at in some:
        where = f" {at.level.name}" if tuning.is_joined else ""
        shares = f"{at.lost.value:.0%} {at.off_at_goal.value:.0%}"
        cells.append(f"{at.rmse.value:.2g} m {shares}{where}")
    return cells


def _of_whole(whole: WholeDrive | None) -> list[str]:
    """Cells of the whole drive, or none."""
    if whole is None:
        return []
    first = f"{whole.first_loss:.0f} m" if math.isfinite(whole.first_loss) else "never"
    where = f" {whole.name}" if whole.name else ""
    return [f"{whole.rmse.value:.2g} m {whole.lost_way.value:.0%}{where}", first]


def _explained(tuning: Tuning) -> str:
    """What the table's numbers are."""
    where = tuning.drive or tuning.where
    if tuning.is_joined:
        where = f"each of {where} (the worst by name)"
    if tuning.drive:
        return (
            "RMSE of the position against the recorded poses, on the whole drive with the share of"
            " the way\noff by > 1 m and where it began, and with the shares of replays off by > 1 m"
            f" and by > 0.5 m at the\nend, on {tuning.paths} stretches of {where},"
            f" {tuning.drives} replays each, on which nothing was chosen;\nRMSE to A's on the whole"
            " drive [95 % over the replays]; ms: CPU time"
        )
    of_maps = f" of {where}" if tuning.is_joined else ""
    return (
        "RMSE of the position, and shares of the drives off by > 1 m at some time and by > 0.5 m"
        " at the\ngoal, at multiples of odometry's errors, on"
        f" {tuning.paths} random paths{of_maps}, {tuning.drives} drives each, on which\nnothing was"
        " chosen; RMSE to A's over all levels [95 %]; ms: CPU time, with that of the simulated scan"
    )


def _holds_for(tuning: Tuning) -> list[str]:
    """For which odometry the settings hold, and what they do beyond it."""
    if tuning.drive:
        return []
    judged = tuning.to_use
    most = f"{tuning.levels[-1].odometry:.0f}"
    chosen = f"They were chosen for odometry up to {most} times as bad as that of this robot"
    if (at := judged.beyond) is None:
        return [f"{chosen}."]
    return [
        f"{chosen}; at ten times: {at.rmse.value:.2g} m, off by more than 1 m in"
        f" {at.lost.value:.0%} (--odometry poor searches for that)."
    ]


def _comes_back(tuning: Tuning) -> list[str]:
    """What the settings to use do after they were lost or kidnapped."""
    found = "; ".join(each.sentence for each in tuning.to_use.recoveries)
    back = "The filter is back within 10 m of driving, or by the goal,"
    return [f"{back} {found}."] if found else []


def _gains(tuning: Tuning) -> list[str]:
    """What each change of the best setting gains, and what was put back."""
    kept = [axis.name for axis in tuning.changed_axes()]
    gains = [
        f"{name} {100 * (ratio - 1):+.0f} %{'' if name in kept else ' (put back)'}"
        for name, ratio in sorted(tuning.contributions.items(), key=lambda each: -each[1])
    ]
    if not gains:
        return []
    where = "" if tuning.drive else " at the worst level"
    counted = "where a lost drive's counts 2.7 times"
    return [f"Without a change, the RMSE{where}, {counted}, would be: {', '.join(gains)}"]


def _name(tuning: Tuning, judged: Judged) -> str:
    marks = ["to use"] if judged is tuning.to_use and tuning.changes else []
    marks += ["better at every level"] * (judged.better_at_every_level and not tuning.drive)
    return f"{judged.name} ({'; '.join(marks)})" if marks else judged.name


def _short(interval: Interval) -> str:
    """Text of an interval without its leading zeros."""
    return two_digits(interval).removeprefix("0").replace("[0", "[").replace(" 0", " ")

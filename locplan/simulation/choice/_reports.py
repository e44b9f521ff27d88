"""Reports of choices: a table for people, and files."""

from __future__ import annotations

import math
import shutil
import textwrap
from pathlib import Path

import numpy as np

from locplan._util.formats import digits_of
from locplan._util.intervals import Interval
from locplan._util.results import ResultFolder
from locplan._util.tables import file_name, table, write_json, write_rows
from locplan.simulation._drives import PROFILE_COLUMNS
from locplan.simulation.choice._choice import (
    MANY_LOST,
    UNTUNED,
    Candidate,
    Choice,
    at_length,
)

COLUMNS = (
    "candidate",
    "file",
    "chosen",
    "on_front",
    "drives",
    "length_m",
    "degenerate_m",
    "typical_rmse_m",
    *("rmse_ratio", "rmse_ratio_low", "rmse_ratio_high"),
    "median_error_m",
    "kept_rmse_m",
    "rmse_m",
    *("lost_rate", "lost_rate_low", "lost_rate_high"),
    "log_error",
    "price",
)
"""Names of the columns of candidates.csv; an empty field stands for a number that is not known."""
WIDE, WIDEST = 105, 120
"""Usual and greatest width of the whole table [characters]; narrower terminals get less of it."""
COMMON = ("rmse", "lost")
"""What is minimised that has a column in any case; the others' takes that of degenerate metres."""
LEFT_OUT = "left out, since the robot's outline meets a wall: "
NAME_LENGTH = 60
"""Greatest number of characters of a candidate's name in the name of its file."""


def choice_table(choice: Choice) -> str:
    """Table with a row per candidate, the reason for the choice, and what was simulated."""
    if choice.chosen is None:
        return f"{choice.status}: {choice.why}"
    width = shutil.get_terminal_size((WIDEST, 24)).columns
    whole = width >= WIDE
    front, price = choice.front, choice.price
    rows = [_row(choice, each, each in front, whole) for each in choice.candidates]
    heads = [
        "> chosen; * on the Pareto front of length against error",
        *(["degen.: degenerate metres"] * (whole and choice.minimise in COMMON)),
        "error, and its ratio to the shortest's: geometric mean of the drives' RMSE",
        *(["median: of the error on the way; kept: RMSE of drives not lost; all: of all"] * whole),
        "lost: > 1 m at any time",
    ]
    lines = [
        choice.sentence,
        *([_about_nearly(choice, choice.nearly)] if choice.nearly else []),
        *([f"{price:g} m of detour count as much as half the error"] if price else []),
        *([UNTUNED] if choice.chosen.drives.lost_rate.value >= MANY_LOST else []),
        *([LEFT_OUT + ", ".join(choice.left_out)] if choice.left_out else []),
        f"with {choice.robot.title}; {choice.driven}",
    ]
    said = ["; ".join(heads), *lines]
    wrapped = [part for line in said for part in textwrap.wrap(line, min(width, WIDE))]
    text = table(list(rows[0]), [list(row.values()) for row in rows], width=width)
    return "\n".join([text, *wrapped])


def _row(choice: Choice, each: Candidate, on_front: bool, whole: bool) -> dict[str, str]:
    """Text of each column by its head."""
    assert choice.shortest is not None
    first, drives = each is choice.shortest, each.drives
    extra = "" if first else f" {each.path.length - choice.shortest.path.length:+.1f}"
    marks = f"{'>' if each is choice.chosen else ' '}{'*' if on_front else ' '}"
    row = {"   candidate": f"{marks} {each.name}", "length\n[m]": f"{each.path.length:.1f}{extra}"}
    if whole and choice.minimise in COMMON:
        row["degen.\n[m]"] = f"{each.metrics.integrated_u:.1f}"
    row["error\n[m]"] = _number(each.typical_rmse)
    row["ratio\n[95 %]"] = "" if first else _interval(choice.ratio(each))
    typical = math.exp(each.log_error)
    if choice.minimise == "heading":
        row["heading\n[deg]"] = f"{math.degrees(typical):.1f}"
    elif choice.minimise == "goal-error":
        row["at goal\n[m]"] = _number(typical)
    if whole:
        row["median\n[m]"] = _number(drives.median_error.value)
        row["kept\n[m]"] = _number(drives.kept_rmse.value)
        row["all\n[m]"] = _number(drives.rmse.value)
    lost = "{:.0f} [{:.0f}, {:.0f}]".format(*(100 * share for share in drives.lost_rate))
    return {**row, "lost [%]\n[95 %]": lost}


def _about_nearly(choice: Choice, nearly: Candidate) -> str:
    """Sentence on the shorter candidate that does nearly as well."""
    assert choice.shortest is not None
    return f"{nearly.name} does nearly as well, {at_length(choice.shortest, nearly)}"


def write_choice(results: ResultFolder, choice: Choice) -> list[Path]:
    """Write choice.json, choice.png, the paths, and tables of the candidates and their errors.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation.choice import _figures

    names = {each.name: _file_of(n, each.name) for n, each in enumerate(choice.candidates, 1)}
    with results.writing() as folder:
        about, picture, candidates, chosen, errors = (folder / name for name in Choice.files.names)
        write_json(about, choice.summary())
        save_figure(_figures.choice_figure(choice), picture)
        every, front = choice.candidates, choice.front
        rows = (_values(choice, each, names[each.name], each in front) for each in every)
        write_rows(candidates, COLUMNS, rows)
        if choice.path:
            choice.path.save(chosen)
        for each in every:
            each.path.save(folder / names[each.name])
        profiles = ([each.name, *at] for each in every for at in each.drives.profile())
        write_rows(errors, ["path", *PROFILE_COLUMNS], profiles)
        written = sorted(file.name for file in folder.iterdir())
    return [results.folder / name for name in written]


def _values(choice: Choice, each: Candidate, file: str, on_front: bool) -> list[str | float]:
    """Row of candidates.csv."""
    return [
        each.name,
        file,
        int(each is choice.chosen),
        int(on_front),
        len(each.drives.errors),
        each.path.length,
        each.metrics.integrated_u,
        each.typical_rmse,
        *choice.ratio(each),
        each.drives.median_error.value,
        each.drives.kept_rmse.value,
        each.drives.rmse.value,
        *each.drives.lost_rate,
        each.log_error,
        each.price,
    ]


def _file_of(number: int, name: str) -> str:
    """Name of a candidate's file, without signs that a shell or a file system minds."""
    plain = file_name(name)
    while "--" in plain:
        plain = plain.replace("--", "-")
    return f"{number:02}-{plain[:NAME_LENGTH]}.csv"


def _number(value: float) -> str:
    """Text of a number above 0 with the digits of an error in metres, with none if it is large."""
    if not np.isfinite(value):
        return "-"
    return f"{value:.{digits_of(value) if value < 10 else 1 if value < 100 else 0}f}"


def _interval(interval: Interval) -> str:
    value, low, high = (_number(each).removeprefix("0") for each in interval)
    return value if np.isnan(interval.low) else f"{value} [{low}, {high}]"

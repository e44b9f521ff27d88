"""Evaluations of recorded drives as tables for people, and as files."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from locplan._util.results import ResultFolder
from locplan._util.tables import table, write_json, write_rows
from locplan.field import position_axes
from locplan.recordings._evaluation import DriveEvaluation
from locplan.recordings._verdict import agreement_texts

WIDTH = 100
"""Width of running text [characters]."""
COLUMNS = (
    *("scan", "time_s", "x_m", "y_m", "heading_rad", "judged", "outdated", "score"),
    *("returns", "offset_x_m", "offset_y_m", "offset_heading_rad"),
    *("major_std_m", "minor_std_m", "major_axis_rad", "heading_std_rad", "ambiguity"),
)
"""Columns of scans.csv; two more for each estimator."""


def drive_table(found: DriveEvaluation) -> str:
    """The drive, the agreement of each estimator, and the verdict."""
    matches, some = found.matches, found.compared
    low, middle, high = 100 * np.quantile(matches.position_std[some], (0.1, 0.5, 0.9))
    apart = int(found.outdated.sum())
    left = len(matches) - int(some.sum()) - apart
    rows = [
        ("map", matches.grid.name),
        ("drive", repr(matches.recording)),
        ("scans compared", f"{some.sum()} of {len(matches)}"),
        ("set apart", f"{apart} that saw what is not on the map, {left} off the free space"),
        ("deviation", f"median {middle:.1f} cm, 10 to 90 %: {low:.1f} to {high:.1f} cm"),
    ]
    columns = ["", "rank correlation", "AUC", "direction", "factor"]
    estimators = [[name, *agreement_texts(each)] for name, each in found.agreements.items()]
    said = textwrap.fill(" ".join(found.verdict), WIDTH, break_on_hyphens=False)
    about = (
        "predicted against measured deviations of the position [95 % intervals, stretches of 10 m];"
        "\nAUC: for the worst fifth; direction: share of long ellipses right to 15 deg; factor:"
        " predicted\nover measured"
    )
    return "\n".join([table([], rows), table(columns, estimators), about, said])


def write_drive(results: ResultFolder, found: DriveEvaluation) -> list[Path]:
    """Write drive.json, drive.png, and scans.csv with a row per scan."""
    from locplan.plotting import save_figure
    from locplan.recordings import _figures

    matches, drive = found.matches, found.matches.recording
    major, minor, direction = position_axes(matches.covariance)
    values = [
        np.arange(len(drive)),
        np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0],
        *drive.poses.T,
        matches.judged,
        found.outdated,
        matches.score,
        matches.returns,
        *matches.best.T,
        major,
        minor,
        direction,
        np.sqrt(matches.covariance[:, 2, 2]),
        matches.ambiguity,
    ]
    columns = list(COLUMNS)
    for name, covariance in found.predicted.items():
        own, _, towards = position_axes(covariance)
        values += [own, towards]
        columns += [f"{name}_major_std_m", f"{name}_major_axis_rad"]
    with results.writing() as folder:
        picture, about, scans = (folder / name for name in DriveEvaluation.files.names)
        save_figure(_figures.drive_figure(found), picture)
        write_json(about, found.summary())
        write_rows(scans, columns, np.column_stack(values).astype(float).tolist())
    return [results.folder / name for name in DriveEvaluation.files.names]

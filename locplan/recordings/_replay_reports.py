"""Replays of recorded drives as tables for people, and as files."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from locplan._util.formats import in_degrees, in_metres, in_percent, with_unit
from locplan._util.results import ResultFolder
from locplan._util.tables import table, write_json, write_rows
from locplan.recordings._replay import WITHIN, Replay
from locplan.simulation import PROFILE_COLUMNS

WIDTH = 100
"""Width of running text [characters]."""


def replay_table(replay: Replay) -> str:
    """Table of the errors against the recorded poses, and of the filter's consistency."""
    drives, found = replay.drives, replay.consistency
    within = found.within
    share = f"{within.value:.0%}" if np.isnan(within.low) else in_percent(within)
    of_filter = [
        (f"within the {WITHIN:.0%} ellipse", share),
        ("rms deviation by the filter", in_metres(found.filter_std)),
    ]
    rows = [
        ("map", replay.grid.name),
        ("drive", repr(replay.recording)),
        ("runs", f"{len(replay.errors)}, each of {found.updates} updates"),
        ("median error", with_unit(drives.median_error, "m")),
        ("lost (> 1 m at any time)", in_percent(drives.lost_rate)),
        ("RMSE of those not lost", with_unit(drives.kept_rmse, "m")),
        ("RMSE of all", with_unit(drives.rmse, "m")),
        ("RMSE at the end", with_unit(drives.final_rmse, "m")),
        ("heading RMSE", with_unit(in_degrees(drives.heading_rmse), "deg")),
        *(of_filter if found.updates else ()),
        *(("note", note) for note in replay.notes),
    ]
    about = (
        "errors against the recorded positions [95 % intervals over runs, of the ellipse by"
        f" stretches of\n10 m]; with {replay.robot.title}"
    )
    said = textwrap.fill(replay.verdict, WIDTH, break_on_hyphens=False)
    return "\n".join([table([], rows), about, said])


def write_replay(results: ResultFolder, replay: Replay) -> list[Path]:
    """Write replay.json, replay.png, and errors.csv with the errors along the drive.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.recordings import _replay_figures

    with results.writing() as folder:
        picture, about, errors = (folder / name for name in Replay.files.names)
        save_figure(_replay_figures.replay_figure(replay), picture)
        write_json(about, replay.summary())
        rows = np.column_stack([replay.drives.profile(), replay.filter_std])
        write_rows(errors, [*PROFILE_COLUMNS, "filter_std_m"], rows.tolist())
    return [results.folder / name for name in Replay.files.names]

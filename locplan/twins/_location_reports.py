"""Located scans as tables for people, and as files."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import numpy as np

from locplan._util.results import ResultFolder, Results
from locplan._util.tables import table
from locplan.simulation._writing import write_json, write_rows
from locplan.twins._located_drive import LocatedDrive
from locplan.twins._location import Location, Mode

LOCATED = Results("located", ("located.json", "located.png", "modes.csv", "scans.csv"))
WIDTH = 100
"""Width of running text [characters]."""
POSE = ("x_m", "y_m", "heading_deg")
MODES = (
    *("number", *POSE, "weight", "excess_nats"),
    *(f"covariance_{name}" for name in ("xx", "xy", "xh", "yy", "yh", "hh")),
)
"""Columns of modes.csv; the covariance is in metres and radians."""
SCANS = (
    *("scan", "time_s", *POSE, "weight", "second_nats", "explained"),
    *("position_std_m", "heading_std_deg"),
    *(f"recorded_{name}" for name in POSE),
    *("distance_m", "turn_deg"),
)
"""Columns of scans.csv; empty where a scan has too few returns."""


def location_table(found: LocatedDrive) -> str:
    """The modes of the only scan, or of several how many are right; and the sentence."""
    if len(found) > 1:
        return _drive_table(found)
    location = found.locations[0]
    assert location is not None
    columns = ["place", "x [m]", "y [m]", "heading [°]", "weight", "worse by [nats]", "std. dev."]
    rows = [
        [str(n), *_pose(*mode.pose), f"{mode.weight:.0%}", f"{mode.excess:.1f}", _deviations(mode)]
        for n, mode in enumerate(location.modes, 1)
    ]
    rows.append(["recorded", *_pose(*found.recording.poses[0].tolist()), "", "", ""])
    away = (
        f"The best place is {found.distance[0]:.2f} m and {math.degrees(found.turn[0]):.1f}° from"
        " the recorded pose."
    )
    return "\n".join([table(columns, rows), _wrapped(f"{location.sentence} {away}")])


def _drive_table(found: LocatedDrive) -> str:
    right, certain = found.right, found.certain
    without = sum(each is None for each in found.locations)
    rows = [
        ("map", found.grid.name),
        ("drive", repr(found.recording).removeprefix("Recording(").removesuffix(")")),
        ("right", f"{right.mean():.1%} of all scans"),
        (
            "certain",
            f"{certain.mean():.1%}"
            if without == 0
            else f"{certain.mean():.1%}; {without} scans have too few returns",
        ),
        ("right of the certain", f"{right[certain].mean():.1%}" if certain.any() else "-"),
    ]
    if right.any():
        distance, turn = (
            np.quantile(each[right], (0.5, 0.9)) for each in (found.distance, found.turn)
        )
        degrees = np.degrees(turn)
        rows.append(
            (
                "error of the right",
                f"median {100 * distance[0]:.1f} cm, {degrees[0]:.2f}°;"
                f" nine of ten below {100 * distance[1]:.1f} cm, {degrees[1]:.2f}°",
            )
        )
    return "\n".join([table([], rows), _wrapped(found.sentence)])


def _pose(x: float, y: float, heading: float) -> tuple[str, str, str]:
    return f"{x:.2f}", f"{y:.2f}", f"{math.degrees(heading):.1f}"


def _deviations(mode: Mode) -> str:
    return f"{100 * mode.position_std:.0f} cm, {math.degrees(mode.heading_std):.1f}°"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_on_hyphens=False)


def location_summary(found: LocatedDrive) -> dict[str, object]:
    """The only scan with its modes, or of several the shares that are right, fit for JSON."""
    about: dict[str, object] = {"map": found.grid.name, "drive": found.recording.source.file}
    location = found.locations[0]
    if len(found) > 1 or location is None:
        return about | found.summary()
    x, y, heading = found.recording.poses[0].tolist()
    recorded = {
        "x": x,
        "y": y,
        "heading_deg": math.degrees(heading),
        "distance": float(found.distance[0]),
        "turn_deg": math.degrees(float(found.turn[0])),
    }
    return about | location.summary() | {"recorded": recorded}


def write_location(results: ResultFolder, found: LocatedDrive) -> list[Path]:
    """Write located.json, located.png, and modes.csv of one scan, or scans.csv of several.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.twins import _location_figures as figures

    location = found.locations[0] if len(found) == 1 else None
    with results.writing() as folder:
        write_json(folder / "located.json", location_summary(found))
        if location is None:
            figure = figures.located_drive_figure(found)
            write_rows(folder / "scans.csv", SCANS, _scan_rows(found))
        else:
            figure = figures.locate_figure(location, recorded=found.recording.poses[0])
            write_rows(folder / "modes.csv", MODES, _mode_rows(location))
        save_figure(figure, folder / "located.png")
        written = sorted(file.name for file in folder.iterdir())
    return [results.folder / name for name in written]


def _mode_rows(location: Location) -> list[list[float]]:
    upper = np.triu_indices(3)
    return [
        [
            *(n, *mode.pose[:2], math.degrees(mode.pose[2]), mode.weight, mode.excess),
            *mode.covariance[upper].tolist(),
        ]
        for n, mode in enumerate(location.modes, 1)
    ]


def _scan_rows(found: LocatedDrive) -> list[list[float]]:
    drive = found.recording
    times = np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0]
    rows = []
    for n, each in enumerate(found.locations):
        own = [math.nan] * 8
        if each is not None:
            x, y, heading = each.best.pose
            own = [x, y, math.degrees(heading), each.best.weight, each.second, each.explained]
            own += [each.best.position_std, math.degrees(each.best.heading_std)]
        x, y, heading = drive.poses[n].tolist()
        away = [float(found.distance[n]), math.degrees(float(found.turn[n]))]
        rows.append([n, float(times[n]), *own, x, y, math.degrees(heading), *away])
    return rows

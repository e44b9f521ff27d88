"""Reports of landmarks: tables for people, and files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.results import ResultFolder, Results
from locplan._util.tables import table, wrapped
from locplan.landmarks._landmarks import PAYS, Landmarks
from locplan.landmarks._objects import Pole, outline_of
from locplan.landmarks._outcomes import (
    COLUMNS as OUTCOMES,
    Named,
    outcomes_rows,
    outcomes_table,
)
from locplan.landmarks._verification import Verification
from locplan.simulation._writing import write_json, write_rows

MAP = "map_with_landmarks"
LANDMARKS = Results(
    "landmarks",
    (
        "landmarks.json",
        "landmarks.png",
        "landmarks.csv",
        "landmarks.geojson",
        "rejected.csv",
        "verification.csv",
        f"{MAP}.yaml",
        f"{MAP}.pgm",
    ),
)
COLUMNS = ("number", "x_m", "y_m", "heading_deg", "length_m", "width_m", "gain", "expected")
"""Names of the columns of landmarks.csv; a pole's length and width are its diameter.

A gain is what a landmark takes off the objective: mean P_xx + P_yy along routes [m^2], with the
expected deviation [m], its root, as what is expected; or of a region, both times, the mean u.
"""
DRIVEN = ("landmarks", *OUTCOMES)
"""Names of the columns of verification.csv."""


def landmarks_table(made: Landmarks, verification: Verification | None) -> str:
    """What the drives say, then the landmarks in order of gain, and what was refused."""
    setting = made.setting
    driven, lines = "", []
    if verification:
        driven = outcomes_table("landmarks", _outcomes(verification)) + "\n"
        lines.append(verification.verdict)
        (before, high), (after, high_after) = verification.match_deviations.tolist()
        lines.append(
            f"deviation of single matches on the way (scan): median {before:.2f} -> {after:.2f} m,"
            f" 95 % below {high:.2f} -> {high_after:.2f} m"
        )
    else:
        lines.append("not verified: nothing was driven")
    lines.append(f"with {setting.robot.title}")
    placed = [
        [str(n), f"{x:.2f}", f"{y:.2f}", f"{math.degrees(heading):.0f}", f"{deviation:.3f}"]
        for n, ((x, y, heading), deviation) in enumerate(
            zip(made.poses.tolist(), made.expected[1:].tolist(), strict=True), 1
        )
    ]
    heads = ["landmark", "x [m]", "y [m]", "heading [deg]", made.measure.title]
    after = [
        f"{len(made)} x {setting.kind.title}, in order of gain; {made.measure.title} without any:"
        f" {made.expected[0]:.3f}"
    ]
    if setting.region is not None:
        area = float(setting.region.sum()) * made.grid.resolution**2
        routes = f"{len(setting.routes)} routes lead across it"
        after.append(f"the robot can be in {area:.0f} m2 of the region, and {routes}")
    after += _driven_beside(made)
    after += _number_that_pays(made, verification)
    if made.existing:
        after.append(f"{made.kept} of {made.existing} existing objects stay where they are")
    after += [f"{shift}" for shift in made.shifts]
    if made.regular:
        after.append(
            f"careful: {made.regular}, which a filter can mistake for a shift; move one of them"
        )
    if made.rejected:
        counts = ", ".join(f"{count} {reason}" for reason, count in made.reasons().items())
        after.append(f"places refused: {counts}")
    said = [driven + "\n".join(wrapped(lines)), table(heads, placed), "\n".join(wrapped(after))]
    return "\n".join(part for part in said if part)


def _number_that_pays(made: Landmarks, verification: Verification | None) -> list[str]:
    """From which number on landmarks gain little, if there is one."""
    if made.paying == len(made):
        return []
    if made.paying == 0:
        known = "whether they help is what the drives say" if verification else "drive them to know"
        return [f"each lowers it by less than {PAYS:.0%}: {known}"]
    return [
        f"from number {made.paying + 1} on each lowers it by less than {PAYS:.0%}:"
        f" {made.paying} may do; drive them to know"
    ]


def _driven_beside(made: Landmarks) -> list[str]:
    """How the places were chosen, and which others were driven beside them."""
    if not made.trials:
        return [f"chosen by: {made.chosen_by}"]
    said = [
        f"{each.chosen_by} ({each.lost} of {each.drives} lost, error {each.error:.2f} m)"
        for each in made.trials
    ]
    return [f"of {len(said)} placements that were driven, this one is kept: {said[0]}"] + [
        f"beaten: {each}" for each in said[1:]
    ]


def _outcomes(verification: Verification) -> Named:
    named = [("none", verification.before), ("proposed", verification.after)]
    if verification.random:
        named.append(("as many at random", verification.random))
    return named


def to_geojson(made: Landmarks, frame: str = "map") -> dict[str, Any]:
    """Landmarks as GeoJSON: outlines in the map's frame [m], with number, pose, size and gain."""
    sizes = {"kind": "pole" if isinstance(made.setting.kind, Pole) else "box", "frame": frame}
    features = []
    for n, (pose, gain) in enumerate(zip(made.poses, made.gains.tolist(), strict=True), 1):
        ring = outline_of(made.setting.kind, pose).round(4).tolist()
        x, y, heading = pose.tolist()
        about = {
            "number": n,
            "x": round(x, 4),
            "y": round(y, 4),
            "heading_deg": round(math.degrees(heading), 2),
            **vars(made.setting.kind),
            "gain": gain,
            **sizes,
        }
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        features.append({"type": "Feature", "properties": about, "geometry": geometry})
    return {"type": "FeatureCollection", "name": "landmarks", "features": features}


def landmarks_summary(made: Landmarks, verification: Verification | None) -> dict[str, object]:
    """Verification and landmarks in numbers, fit for JSON."""
    return {
        "verification": verification.summary() if verification else None,
        **made.summary(),
    }


def write_landmarks(
    results: ResultFolder,
    made: Landmarks,
    verification: Verification | None,
) -> list[Path]:
    """Write the places, the map with the landmarks, the picture, and the tables.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.landmarks import _figures
    from locplan.maps import save_map
    from locplan.plotting import save_figure

    shape = made.setting.kind.shape
    with results.writing() as folder:
        write_json(folder / "landmarks.json", landmarks_summary(made, verification))
        save_figure(_figures.landmarks_figure(made, verification), folder / "landmarks.png")
        rows = [
            [n, x, y, math.degrees(heading), 2 * shape.half_length, 2 * shape.half_width, *gained]
            for n, ((x, y, heading), *gained) in enumerate(
                zip(made.poses, made.gains, made.expected[1:], strict=True), 1
            )
        ]
        write_rows(folder / "landmarks.csv", COLUMNS, rows)
        text = json.dumps(to_geojson(made), allow_nan=False)
        (folder / "landmarks.geojson").write_text(text + "\n", encoding="utf-8")
        refused = ([x, y, np.degrees(turn), why] for x, y, turn, why in made.rejected)
        write_rows(folder / "rejected.csv", ("x_m", "y_m", "heading_deg", "reason"), refused)
        if verification:
            write_rows(
                folder / "verification.csv",
                DRIVEN,
                outcomes_rows(_outcomes(verification)),
            )
        save_map(made.grid, folder / f"{MAP}.yaml")
        written = sorted(file.name for file in folder.iterdir())
    return [results.folder / name for name in written]

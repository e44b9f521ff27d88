"""Reports of key features: tables for people, and files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from locplan._util.results import ResultFolder, Results
from locplan._util.tables import table, wrapped
from locplan.landmarks._feature_drives import FeatureDrives
from locplan.landmarks._features import Feature, KeyFeatures
from locplan.landmarks._outcomes import (
    COLUMNS as OUTCOMES,
    Named,
    outcomes_rows,
    outcomes_table,
)
from locplan.simulation._writing import write_json, write_rows

FEATURES = Results(
    "features",
    (
        "features.json",
        "features.png",
        "features.csv",
        "features.geojson",
        "verification.csv",
    ),
)
COLUMNS = (
    *("number", "kind", "x_m", "y_m", "length_m", "width_m", "heading_deg", "seen"),
    *("loss_m", "share", "worst_m", "worst_share", "worst_x_m", "worst_y_m", "moved_error_m"),
    *("matters", "together"),
)
"""Names of the columns of features.csv; together says which of the few it is, or nothing."""
DRIVEN = ("features", *OUTCOMES)
"""Names of the columns of verification.csv."""
LISTED = 10
"""Number of features in the table for people."""


def features_table(found: KeyFeatures, drives: FeatureDrives | None) -> str:
    """The verdicts, then the features with the greatest loss."""
    lines = [found.verdict]
    driven = ""
    if drives:
        driven = outcomes_table("in the world", _outcomes(drives)) + "\n"
        lines.append(drives.verdict)
    else:
        lines.append("not verified: nothing was driven")
    lines.append(f"with {found.robot.title}")
    shown = found.features[:LISTED]
    shown += tuple(found.feature(n) for n in found.together if n > LISTED)
    heads = ["", "what", "size [m]", "x,y [m]", "rise [cm]", "worst", "moved"]
    after = [
        f"rise: of the expected deviation of the position, {100 * found.deviations[0]:.1f} cm with"
        " all, as the feature goes; worst: at the place where it rises most [cm]",
        f"moved: error of the position [cm] if the feature is {100 * found.shift:.0f} cm off and"
        " the map does not show it, to first order",
    ]
    if len(found) > len(shown):
        after.append(f"{len(found)} features are seen; features.csv lists all of them")
    if len(found.together) > 1:
        steps = ", ".join(
            f"{number}: {100 * each:.1f} cm"
            for number, each in zip(found.together, found.deviations[1:].tolist(), strict=True)
        )
        after.append(f"expected deviation as they go one after the other: without {steps}")
    rows = [_row(each) for each in shown]
    parts = [driven + "\n".join(wrapped(lines))]
    if rows:
        parts += [table(heads, rows), "\n".join(wrapped(after))]
    return "\n".join(parts)


def _row(each: Feature) -> list[str]:
    return [
        str(each.number),
        each.kind,
        f"{each.length:.1f}x{each.width:.1f}",
        f"{each.x:.1f},{each.y:.1f}",
        f"{100 * each.loss:.1f} {each.share:+.0%}",
        f"{100 * each.worst:.1f}",
        f"{100 * each.error:.1f}",
    ]


def _outcomes(drives: FeatureDrives) -> Named:
    named = [("all features", drives.before)]
    named += [(f"without {number}", each) for number, each in drives.alone.items()]
    named.append((f"without the {drives.count}", drives.without))
    if drives.random:
        named.append(("without random ones", drives.random))
    return named


def to_geojson(found: KeyFeatures, frame: str = "map") -> dict[str, Any]:
    """Features as GeoJSON: the rectangles around them in the map's frame [m], with the losses."""
    made = []
    for each in found.features:
        ring = each.corners().round(4).tolist()
        x, y = each.worst_at
        about = {
            "number": each.number,
            "kind": each.kind,
            "x": round(each.x, 4),
            "y": round(each.y, 4),
            "length": round(each.length, 4),
            "width": round(each.width, 4),
            "heading_deg": round(math.degrees(each.heading), 2),
            "loss_m": each.loss,
            "share": each.share,
            "worst_m": each.worst,
            "worst_x": round(x, 4),
            "worst_y": round(y, 4),
            "moved_error_m": each.error,
            "matters": each.matters,
            "together": each.number in found.together,
            "frame": frame,
        }
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        made.append({"type": "Feature", "properties": about, "geometry": geometry})
    return {"type": "FeatureCollection", "name": "features", "features": made}


def features_summary(found: KeyFeatures, drives: FeatureDrives | None) -> dict[str, object]:
    """Verification and features in numbers, fit for JSON."""
    return {
        "verification": drives.summary() if drives else None,
        **found.summary(),
    }


def write_features(
    results: ResultFolder,
    found: KeyFeatures,
    drives: FeatureDrives | None,
) -> list[Path]:
    """Write the features, the picture, and the tables.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.landmarks import _feature_figures
    from locplan.plotting import save_figure

    order = {number: n for n, number in enumerate(found.together, 1)}
    with results.writing() as folder:
        write_json(folder / "features.json", features_summary(found, drives))
        figure = _feature_figures.key_features_figure(found, drives)
        save_figure(figure, folder / "features.png")
        rows = (
            [
                *(each.number, each.kind, each.x, each.y, each.length, each.width),
                *(math.degrees(each.heading), each.seen, each.loss, each.share, each.worst),
                *(each.worst_share, *each.worst_at, each.error),
                *(int(each.matters), order.get(each.number, math.nan)),
            ]
            for each in found.features
        )
        write_rows(folder / "features.csv", COLUMNS, rows)
        text = json.dumps(to_geojson(found), allow_nan=False)
        (folder / "features.geojson").write_text(text + "\n", encoding="utf-8")
        if drives:
            write_rows(
                folder / "verification.csv",
                DRIVEN,
                outcomes_rows(_outcomes(drives)),
            )
        written = sorted(file.name for file in folder.iterdir())
    return [results.folder / name for name in written]

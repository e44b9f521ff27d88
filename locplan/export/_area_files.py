"""Degenerate areas as GeoJSON, as a picture, and as Autoware reads them.

Autoware's node environment_adaptor takes the polygons of type degenerate_area from the vector map,
finds an environment by their subtype, and puts its covariance in place of that of the pose. Read
from tier4/autoware_universe, localization/autoware_environment_adaptor/src/
environment_classifier.cpp, environment_adaptor.cpp and covariance_utils.hpp, and
autowarefoundation/autoware_launch,
autoware_launch/config/localization/environment_adaptor.param.yaml. The node is proposed for
autowarefoundation/autoware_universe (pull request 12935), and in no release of it.

Its guide writes the areas as relations; but Lanelet2's reader makes polygons of ways with area=yes
alone (fzi-forschungszentrum-informatik/Lanelet2, lanelet2_io/src/OsmHandlerLoad.cpp, loadWays).
The map loader takes local_x and local_y for projector_type local (autowarefoundation/autoware_core,
map/autoware_map_loader/src/lanelet2_map_loader/lanelet2_map_loader.cpp). All was read, not run.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.records import Column, Table
from locplan.costs import Costmap, about_costs, costs_caption
from locplan.export._areas import DegenerateArea, degenerate_areas, half_free
from locplan.export._registry import ExportSummary, export_folder, rendered
from locplan.field import CovarianceField


def save_degenerate_areas(
    folder: str | Path,
    costs: Costmap,
    field: CovarianceField,
    *,
    threshold: float | None = None,
    min_area: float = 1.0,
    frame: str = "map",
) -> tuple[DegenerateArea, ...]:
    """Write the degenerate areas of a map as GeoJSON, for Autoware, and as a picture.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs, field, threshold, min_area
        See `degenerate_areas`.
    frame : str, default "map"
        Frame of the coordinates.

    Returns
    -------
    tuple of DegenerateArea
        What was written; without any the files are valid, but empty.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or no areas can be made, see `degenerate_areas`.
    """
    from locplan.export import _figures

    areas = degenerate_areas(costs, field, threshold=threshold, min_area=min_area)
    least = half_free(costs, field) if threshold is None else threshold
    name = costs.grid.name or "a map"
    about = {"kind": "degenerate-areas", "threshold": least, "min_area": min_area, "frame": frame}
    about |= about_costs(costs)
    known = {"map": name, "areas": areas, "said": _said(areas), "threshold": least, "frame": frame}
    with export_folder(folder, "degenerate-areas.md", about, **known) as temporary:
        outlines = [(area.outline, *area.holes) for area in areas]
        columns = (
            Column("name"),
            Column("area", "m^2"),
            Column("u_mean"),
            Column("u_max"),
            Column("position_std", "m"),
            Column("worst_position_std", "m"),
            Column("minor_position_std", "m"),
            Column("heading_std", "rad"),
            Column("worst_heading_std", "rad"),
            Column("direction", "rad"),
            Column("agreement"),
            Column("covariance", value=lambda area: area.covariance.tolist()),
        )
        Table.of(columns, areas).write_geojson(temporary / "areas.geojson", outlines, frame=frame)
        for file, text in _for_autoware(areas).items():
            (temporary / file).write_text(text, encoding="utf-8")
        title = f"{name}: {_said(areas)}, u ≥ {least:.2g}{costs_caption(costs)}"
        _figures.save_preview(temporary, _figures.areas_figure(costs.grid, areas, title))
    return areas


def _said(areas: Sequence[DegenerateArea]) -> str:
    """The number of areas in words."""
    return f"{len(areas) or 'no'} degenerate area{'s' if len(areas) != 1 else ''}"


def summary_of(
    areas: Sequence[DegenerateArea], costs: Costmap, field: CovarianceField, threshold: float | None
) -> ExportSummary:
    """The number of areas, their share of the free space, and the largest one."""
    least = half_free(costs, field) if threshold is None else threshold
    free = int(costs.grid.free.sum()) * costs.grid.resolution**2
    share = sum(area.area for area in areas) / free if free else 0.0
    values: dict[str, Any] = {"areas": len(areas), "threshold": least, "share_of_free": share}
    found = f"{len(areas)} with u ≥ {least:.2g}, {share:.0%} of the free space"
    rows = [("degenerate areas", found if areas else f"none with u ≥ {least:.2g}")]
    if areas:
        first = areas[0]
        values |= {"largest": first.name, "largest_area": first.area}
        deviation = f"{100 * first.position_std:.0f} cm"
        rows.append(("largest", f"{first.name}: {first.area:.1f} m², std. deviation {deviation}"))
    return ExportSummary(values, tuple(rows))


def _for_autoware(areas: Sequence[DegenerateArea]) -> dict[str, str]:
    """The areas as a Lanelet2 map (OSM), and the parameters that give their poses a covariance."""
    ids = count(-1, -1)  # negative ones are those of new objects
    polygons = []
    for area in areas:
        corners = without_holes(area.outline, area.holes).tolist()
        polygons.append((area, [(next(ids), x, y) for x, y in corners], next(ids)))
    # Ids of environments up to 100 are left to those who tune them by hand.
    environments = [(n, area, _body_covariance(area)) for n, area in enumerate(areas, start=101)]
    return {
        "degenerate_areas.osm": rendered("lanelet2.osm", polygons=polygons),
        "environment_adaptor.param.yaml": rendered(
            "environment_adaptor.yaml", environments=environments
        ),
    }


def _body_covariance(area: DegenerateArea) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch, yaw in the robot's own frame, (6, 6) [m^2, rad^2].

    It is the median over the area. Where its places are uncertain along one line, the robot
    drives along it: x is forward. Elsewhere both axes have the larger variance.
    """
    height, tilt = 0.0225, 0.000625  # those of Autoware's own file: a 2D map has none
    along = area.position_std**2
    across = area.minor_position_std**2 if area.agrees else along
    turn = tilt if np.isnan(area.heading_std) else area.heading_std**2
    return np.diag([along, across, height, tilt, tilt, turn])


def without_holes(
    outline: NDArray[np.float64], holes: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """One ring around an area without its holes, (n, 2): Lanelet2's polygons have none.

    A cut leads to each hole and back, from its leftmost corner straight to the left, where the
    outline lies or a hole that has been joined before.
    """
    ring = outline
    for hole in sorted(holes, key=lambda hole: float(hole[:, 0].min())):
        first = np.lexsort((hole[:, 1], hole[:, 0]))[0]
        hole = np.roll(hole, -int(first), axis=0)
        x, y = hole[0]
        start, end = ring, np.roll(ring, -1, axis=0)
        crosses = (start[:, 1] <= y) != (end[:, 1] <= y)
        rise = np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        hit = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
        hit = np.where(crosses & (hit < x), hit, -np.inf)
        line = int(np.argmax(hit))
        cut = np.array([[hit[line], y]])
        ring = np.concatenate([ring[: line + 1], cut, hole, hole[:1], cut, ring[line + 1 :]])
    return ring

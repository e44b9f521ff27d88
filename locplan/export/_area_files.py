"""Degenerate areas as GeoJSON, as Autoware's polygons, and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from locplan._util.records import Column, Table
from locplan.costs import Costmap, about_costs, costs_caption
from locplan.export._areas import MIN_AREA, DegenerateArea, degenerate_areas, half_free
from locplan.export._autoware import lanelet2_of, parameters_of
from locplan.export._folders import PREVIEW, export_folder
from locplan.export._registry import ExportSummary
from locplan.field import CovarianceField

AREAS = "areas.geojson"
LANELET2 = "degenerate_areas.osm"
PARAMETERS = "environment_adaptor.param.yaml"
COLUMNS = (
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
"""What a file says of each area."""


def save_degenerate_areas(
    folder: str | Path,
    costs: Costmap,
    field: CovarianceField,
    *,
    threshold: float | None = None,
    min_area: float = MIN_AREA,
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
    with export_folder(
        Path(folder), f"Degenerate areas of {name}", about, _readme(areas, least, frame)
    ) as temporary:
        outlines = [(area.outline, *area.holes) for area in areas]
        Table.of(COLUMNS, areas).write_geojson(temporary / AREAS, outlines, frame=frame)
        (temporary / LANELET2).write_text(lanelet2_of(areas), encoding="utf-8")
        (temporary / PARAMETERS).write_text(parameters_of(areas), encoding="utf-8")
        title = f"{name}: {said(areas)}, u ≥ {least:.2g}{costs_caption(costs)}"
        _figures.save_preview(temporary, _figures.areas_figure(costs.grid, areas, title))
    return areas


def said(areas: Sequence[DegenerateArea]) -> str:
    """The number of areas in words."""
    number = len(areas)
    return f"{number or 'no'} degenerate area{'s' if number != 1 else ''}"


def summary_of(
    areas: Sequence[DegenerateArea],
    costs: Costmap,
    field: CovarianceField,
    threshold: float | None,
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


def _readme(areas: Sequence[DegenerateArea], least: float, frame: str) -> list[str]:
    found = f"{said(areas).capitalize()}: free cells where u is at least {least:.3g}."
    if not areas:
        found += " The files are valid, but empty: a lower threshold or area may find some."
    return [
        found,
        "",
        f"- {AREAS}: polygons in metres of the frame {frame}, not in degrees. In QGIS, drag it onto"
        " a project without a coordinate reference system. position_std [m] and heading_std [rad]"
        " are medians; direction [rad] is the line along which the position is uncertain, and"
        " agreement says if that holds in all of the area (1) or not (0); covariance"
        " [m, m, rad] is that of the mean information.",
        f"- {LANELET2}: the areas for Autoware's environment_adaptor, a node that is in no release"
        " yet: polygons of type degenerate_area, to be merged into your vector map. They stand in"
        " local_x, local_y, for `projector_type: local`; lat and lon only show them in editors.",
        f"- {PARAMETERS}: its parameters (environment_adaptor_param_path) with each area's"
        " covariance in the vehicle's frame; z, roll and pitch keep Autoware's own variances. They"
        " hold for the lidar and the estimator in export.json: tune them to your NDT.",
        f"- {PREVIEW}; export.json: the input.",
    ]

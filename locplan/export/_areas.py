"""Areas where a match is degenerate, as polygons with their covariance, GeoJSON, and for Autoware.

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

import math
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import instance, number
from locplan._util.records import Column, Table
from locplan.costs import DEGENERATE, Costmap, about_costs, check_costs, costs_caption
from locplan.errors import FieldError
from locplan.export._outlines import QUARTERS, DegenerateArea, middle_of, polygons_of, without_holes
from locplan.export._registry import ExportSummary, check_has_field, export_folder, rendered
from locplan.field import CovarianceField, mean_information, position_axes, scalar


def degenerate_areas(
    costs: Costmap, field: CovarianceField, *, threshold: float | None = None, min_area: float = 1.0
) -> tuple[DegenerateArea, ...]:
    """Find the areas where u is at least a threshold, the largest first.

    Cells belong together that share an edge. Polygons follow the edges of cells to within a cell;
    they do not meet themselves, their holes or each other. The smallest holes
    are filled: those below 0.1 m^2, up to 2 % of an area.

    Parameters
    ----------
    costs : Costmap
        A costmap that was made of the field; its law and criterion define u.
    field : CovarianceField
        The field; several headings count by their mean information.
    threshold : float, optional
        Minimum u of a cell, 0..1; by default half of the u of a corridor without features: .5 for
        estimators that know the lidar, .18 for `Sad`. A lower one makes more and larger areas.
    min_area : float, default 1.0
        Minimum area [m^2], >= 0. Areas of a few lattice points may be chance.

    Returns
    -------
    tuple of DegenerateArea
        None where no area is large enough.

    Raises
    ------
    ConfigError
        If a number is out of its limits, or the costmap has no field.
    FieldError
        If the field belongs to another map.

    Examples
    --------
    >>> import locplan
    >>> from locplan.maps import environments
    >>> grid = environments.make("two_corridors", resolution=0.1)
    >>> field = locplan.covariance_field(grid, locplan.Sad(range=3.0))
    >>> costs = locplan.Costmap.from_field(grid, field)
    >>> area, *_ = locplan.export.degenerate_areas(costs, field)
    >>> area.name, area.outline.shape[1], area.area >= 1
    ('area-1', 2, True)
    """
    import cv2

    check_areas(threshold, min_area)
    check_costs(costs)
    instance("field", field, CovarianceField, "compute one with locplan.load_or_compute")
    if field.grid.digest != costs.grid.digest:
        raise FieldError("the field belongs to another map than the costmap; compute it for this")
    check_has_field(costs)
    threshold = half_free(costs, field, threshold)
    grid = costs.grid
    cell_area = grid.resolution**2
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(
        (costs.u >= threshold).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
    )
    sizes = boxes[:, cv2.CC_STAT_AREA] * cell_area
    large = np.flatnonzero(sizes[1:] >= min_area - 1e-9) + 1
    large = large[np.argsort(-sizes[large], kind="stable")]
    is_large = np.isin(np.arange(len(sizes)), large)
    # Holes below 0.1 m^2 are filled, such as the legs of tables.
    polygons = polygons_of(is_large[labels], labels, min(0.1, min_area) / cell_area)
    points = _points_of(field, labels)
    areas = []
    for n, label in enumerate(large.tolist(), start=1):
        left, low, width, height = boxes[label, :4].tolist()
        window = slice(low, low + height), slice(left, left + width)
        inside = labels[window] == label
        row, col = middle_of(inside)
        u = costs.u[window][inside]
        covariance = points.get(label)
        if covariance is None:
            covariance = _read(field, np.argwhere(inside) + np.array([low, left]))
        outline, *holes = (
            np.stack(grid.grid_to_world(*corners.T[::-1] / QUARTERS), axis=1)
            for corners in polygons[label]
        )
        middle = grid.cell_to_world(row + low, col + left)
        about = _deviations_of(covariance) | {"area": float(sizes[label])}
        about |= {"u_mean": float(u.mean()), "u_max": float(u.max())}
        areas.append(DegenerateArea(f"area-{n}", outline, tuple(holes), middle, **about))
    return tuple(areas)


def check_areas(threshold: float | None, min_area: float) -> None:
    """Raise a ConfigError unless these are limits of areas."""
    if threshold is not None:
        number("threshold", threshold, 0, 1)
    number("min_area", min_area, 0)


def half_free(costs: Costmap, field: CovarianceField, threshold: float | None) -> float:
    """A threshold, or half of the u of a place that is featureless along one line.

    Such a place, well marked across, is a corridor without features. Its u is 1 by the deviation of
    the position, and less by e, to which the position across and the heading count as well. On a
    logarithmic scale half of it is the geometric mean of the deviations of a perfect match and of
    none: .21 m for those that know the lidar, .26 m for `Sad`. Where u is made of something else,
    it is that of degenerate metres.
    """
    if threshold is not None:
        return threshold
    settings, estimator = costs.settings, field.config.estimator
    if settings is None or settings.criterion not in ("e", "position_std", "position_rms"):
        return DEGENERATE
    corridor = estimator.perfect(field.window).copy()
    corridor[0, 0] = estimator.featureless(field.window)[0, 0]
    least, greatest = field.anchors(settings.criterion)
    value = float(scalar(corridor, settings.criterion))
    if settings.law == "logarithmic":
        return math.log(value / least) / math.log(greatest / least) / 2
    share = value / greatest
    return (share ** (1 / 3) if settings.law == "cube-root" else share) / 2


def _points_of(field: CovarianceField, labels: NDArray[np.int32]) -> dict[int, Floats]:
    """The covariances on the lattice points of each label, (n, d, d)."""
    owner = np.where(field.evaluated, labels[:: field.stride, :: field.stride], 0)
    rows, cols = np.nonzero(owner)
    order = np.argsort(owner[rows, cols], kind="stable")
    rows, cols = rows[order], cols[order]
    found, starts = np.unique(owner[rows, cols], return_index=True)
    parts = np.split(field.mean_covariance[rows, cols], starts[1:])
    return dict(zip(found.tolist(), parts, strict=True)) if found.size else {}


def _read(field: CovarianceField, cells: Ints) -> Floats:
    """Covariances at some cells (n, 2) of an area that lies between the lattice's points."""
    some = cells[:: -(-len(cells) // 50)].tolist()
    read = np.array([field.at(field.grid.cell_to_world(row, col)) for row, col in some])
    return np.asarray(read[np.isfinite(read).all(axis=(1, 2))])


def _deviations_of(covariance: Floats) -> dict[str, Any]:
    """What the covariances of places (n, d, d) say of their area: fields of `DegenerateArea`."""
    major, minor, direction = position_axes(covariance)
    heading = scalar(covariance, "heading_std")
    if covariance.shape[-1] == 2:
        heading = np.full_like(heading, np.nan)
    total = major**2 + minor**2
    longer = np.divide(major**2 - minor**2, total, where=total > 0, out=np.zeros_like(total))
    mean = np.mean(longer * np.exp(2j * direction))  # a line's directions are alike, doubled
    return {
        "position_std": float(np.median(major)),
        "worst_position_std": float(major.max()),
        "minor_position_std": float(np.median(minor)),
        "heading_std": float(np.median(heading)),
        "worst_heading_std": float(heading.max()),
        "direction": float(np.angle(mean) / 2),
        "agreement": float(np.abs(mean)),
        "covariance": mean_information(covariance),
    }


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
    least = half_free(costs, field, threshold)
    name = costs.grid.name or "a map"
    about = {"kind": "degenerate-areas", "threshold": least, "min_area": min_area, "frame": frame}
    about |= about_costs(costs)
    said = f"{len(areas) or 'no'} degenerate area{'s' if len(areas) != 1 else ''}"
    known = {"map": name, "areas": areas, "said": said, "threshold": least, "frame": frame}
    with export_folder(folder, "degenerate-areas.md", about, **known) as temporary:
        outlines = [(area.outline, *area.holes) for area in areas]
        columns = (
            *(Column("name"), Column("area", "m^2"), Column("u_mean"), Column("u_max")),
            *(Column(f"{which}position_std", "m") for which in ("", "worst_", "minor_")),
            *(Column(f"{which}heading_std", "rad") for which in ("", "worst_")),
            *(Column("direction", "rad"), Column("agreement")),
            Column("covariance", value=lambda area: area.covariance.tolist()),
        )
        Table.of(columns, areas).write_geojson(temporary / "areas.geojson", outlines, frame=frame)
        _write_for_autoware(temporary, areas)
        title = f"{name}: {said}, u ≥ {least:.2g}{costs_caption(costs)}"
        _figures.save_preview(temporary, _figures.areas_figure(costs.grid, areas, title))
    return areas


def summary_of(
    areas: Sequence[DegenerateArea], costs: Costmap, field: CovarianceField, threshold: float | None
) -> ExportSummary:
    """The number of areas, their share of the free space, and the largest one."""
    least = half_free(costs, field, threshold)
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


def _write_for_autoware(folder: Path, areas: Sequence[DegenerateArea]) -> None:
    """Write a Lanelet2 map (OSM) of the areas, and parameters that give poses a covariance."""
    ids = count(-1, -1)  # negative ones are those of new objects
    rings = (without_holes(area.outline, area.holes).tolist() for area in areas)
    polygons = [
        (area, [(next(ids), x, y) for x, y in ring], next(ids))
        for area, ring in zip(areas, rings, strict=True)
    ]
    # Ids of environments up to 100 are left to those who tune them by hand.
    environments = [(n, area, _body_covariance(area)) for n, area in enumerate(areas, start=101)]
    osm = rendered("lanelet2.osm", polygons=polygons)
    (folder / "degenerate_areas.osm").write_text(osm, "utf-8")
    parameters = rendered("environment_adaptor.yaml", environments=environments)
    (folder / "environment_adaptor.param.yaml").write_text(parameters, "utf-8")


def _body_covariance(area: DegenerateArea) -> Floats:
    """Covariance of x, y, z, roll, pitch, yaw in the robot's own frame, (6, 6) [m^2, rad^2].

    It is the median over the area. Where its places are uncertain along one line, the robot
    drives along it: x is forward. Elsewhere both axes have the larger variance.
    """
    height, tilt = 0.0225, 0.000625  # those of Autoware's own file: a 2D map has none
    along = area.position_std**2
    across = area.minor_position_std**2 if area.agrees else along
    turn = tilt if np.isnan(area.heading_std) else area.heading_std**2
    return np.diag([along, across, height, tilt, tilt, turn])

"""The field as a layer for tools that show it, and its degenerate areas as polygons."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from locplan.export._registry import ExportJob, ExportSummary, Format


@dataclass(frozen=True, kw_only=True)
class LayerOptions:
    """The options of a layer."""

    frame: str = "map"
    """Frame of the coordinates; map by default."""


def write_layer(target: Path, job: ExportJob, options: LayerOptions) -> ExportSummary:
    """Write the field's deviations as pictures, rasters and a bag."""
    from locplan.export._layer import layer, quantiles

    layer(target, job.field, frame=options.frame)
    return quantiles(job.field)


@dataclass(frozen=True, kw_only=True)
class AreaOptions:
    """The options of degenerate areas."""

    threshold: float | None = None
    """Least u of an area; by default half of that where nothing is told along one line: .5
    for scan, .18 for sad."""
    min_area: float = 1.0
    """Least size of an area, in m²; 1 by default."""
    frame: str = "map"
    """Frame of the coordinates; map by default."""

    def __post_init__(self) -> None:
        from locplan.export._areas import check_areas

        check_areas(self.threshold, self.min_area)


def write_areas(target: Path, job: ExportJob, options: AreaOptions) -> ExportSummary:
    """Write the degenerate areas as polygons."""
    from locplan.export._area_files import save_degenerate_areas, summary_of

    areas = save_degenerate_areas(
        target,
        job.costs,
        job.field,
        threshold=options.threshold,
        min_area=options.min_area,
        frame=options.frame,
    )
    return summary_of(areas, job.costs, job.field, options.threshold)


FORMATS = (
    Format(
        "layer", "deviations for QGIS, RViz and Foxglove", write_layer, LayerOptions, library="mcap"
    ),
    Format(
        "degenerate-areas", "degenerate areas as GeoJSON and for Autoware", write_areas, AreaOptions
    ),
)

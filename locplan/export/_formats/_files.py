"""Bags, maps, layers and areas, and paths and fields as files that anything reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from locplan._util.checks import number
from locplan.export._formats._nav2 import MaskOptions
from locplan.export._registry import ExportJob, ExportSummary, Format, NoOptions


@dataclass(frozen=True, kw_only=True)
class InFrame:
    """The frame of what is written."""

    frame: str = "map"
    """Frame of the coordinates; map by default."""


@dataclass(frozen=True, kw_only=True)
class BagOptions(MaskOptions, InFrame):
    """The options of a bag."""

    spacing: float = 2.0
    """Least distance between ellipses, in metres; 2 by default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        number("spacing", self.spacing, 0.1)


def write_bag(target: Path, job: ExportJob, options: BagOptions) -> ExportSummary:
    """Write the map, a mask, the field and the paths as messages."""
    from locplan.export._bags import bag
    from locplan.export._nav2 import keepout_mask
    from locplan.export._parameters import PLANNER

    own = dict(vars(options))
    planner, param = own.pop("planner") or PLANNER, own.pop("planner_param")
    mask, conversion = keepout_mask(job.costs, planner=planner, planner_param=param)
    bag(target, job.costs.grid, mask=mask, field=job.field, paths=job.paths, **own)
    return ExportSummary({"paths": list(job.paths)} | conversion.summary(), conversion.rows())


def write_map(target: Path, job: ExportJob, options: NoOptions) -> ExportSummary:
    """Write u in per cent as maps in the modes raw and scale."""
    from locplan.export._value_maps import ros_map

    ros_map(target, job.costs)
    return ExportSummary()


@dataclass(frozen=True, kw_only=True)
class PathOptions(InFrame):
    """The options of a path."""

    step: float | None = None
    """Greatest distance between poses of the path, in metres; by default they are its corners."""

    def __post_init__(self) -> None:
        if self.step is not None:
            number("step", self.step, 0.001)


def write_path(target: Path, job: ExportJob, options: PathOptions) -> ExportSummary:
    """Write the only path of a job."""
    from locplan.export._plain_files import path

    (route,) = job.paths.values()
    path(target, route, **vars(options))
    return ExportSummary({"length": route.length}, (("length", f"{route.length:.2f} m"),))


def write_field(target: Path, job: ExportJob, options: NoOptions) -> ExportSummary:
    """Write the field; the suffix chooses the format."""
    from locplan.export._plain_files import field

    field(target, job.field)
    return ExportSummary()


def write_layer(target: Path, job: ExportJob, options: InFrame) -> ExportSummary:
    """Write the field's deviations as pictures, rasters and a bag."""
    from locplan.export._layer import layer, quantiles

    layer(target, job.field, frame=options.frame)
    return quantiles(job.field)


@dataclass(frozen=True, kw_only=True)
class AreaOptions(InFrame):
    """The options of degenerate areas."""

    threshold: float | None = None
    """Least u of an area; by default half of that of a corridor without features: .5 for scan,
    .18 for sad."""
    min_area: float = 1.0
    """Least size of an area, in m²; 1 by default."""

    def __post_init__(self) -> None:
        from locplan.export._areas import check_areas

        check_areas(self.threshold, self.min_area)


def write_areas(target: Path, job: ExportJob, options: AreaOptions) -> ExportSummary:
    """Write the degenerate areas as polygons."""
    from locplan.export._area_files import save_degenerate_areas, summary_of

    areas = save_degenerate_areas(target, job.costs, job.field, **vars(options))
    return summary_of(areas, job.costs, job.field, options.threshold)


FORMATS = (
    Format("ros-map", "u in per cent for the map servers of ROS", write_map),
    Format("bag", "a ROS 2 bag", write_bag, BagOptions, (".mcap",), "mcap", "several"),
    Format(
        *("path", "a path; also .json or .yaml", write_path, PathOptions),
        suffixes=(".csv", ".json", ".yaml"),
        paths="one",
    ),
    Format("csv", "a table of the field", write_field, suffixes=(".csv",)),
    Format("npz", "the field's arrays", write_field, suffixes=(".npz",)),
    Format("png", "a picture of the field", write_field, suffixes=(".png",)),
    Format(
        *("layer", "deviations for QGIS, RViz and Foxglove", write_layer, InFrame), library="mcap"
    ),
    Format(
        "degenerate-areas", "degenerate areas as GeoJSON and for Autoware", write_areas, AreaOptions
    ),
)

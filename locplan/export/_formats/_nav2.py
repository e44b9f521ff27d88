"""Masks, layers and route graphs for Nav2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from locplan._util.checks import number
from locplan.export._names import Distro, NavPlannerName
from locplan.export._registry import ExportJob, ExportSummary, Format

if TYPE_CHECKING:
    from locplan.export._travel_costs import Conversion


@dataclass(frozen=True, kw_only=True)
class MaskOptions:
    """Whose costs a mask is to make J."""

    planner: NavPlannerName = "smac2d"
    """The planner of Nav2 whose costs shall be J is smac2d by default."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost is by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export._travel_costs import check_planner

        check_planner(self.planner, self.planner_param)


@dataclass(frozen=True, kw_only=True)
class Merged:
    """Whose parameters ours go into."""

    params: Path | None = None
    """Our parameters are merged into this parameter file of Nav2."""

    def __post_init__(self) -> None:
        from locplan.maps._ros_parameters import read_parameters

        read_parameters(self.params)


@dataclass(frozen=True, kw_only=True)
class Nav2Options(MaskOptions, Merged):
    """The options of masks that a planner charges."""

    distro: Distro = "jazzy"
    """The distribution of ROS 2 is jazzy by default; humble writes plugins in another way."""

    def __post_init__(self) -> None:
        MaskOptions.__post_init__(self)
        Merged.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class SpeedOptions(Merged):
    """The options of a speed mask."""

    slowest: float = 0.3
    """The share of the speed left where nothing is seen is 0.3 by default."""

    def __post_init__(self) -> None:
        from locplan.export._nav2 import check_slowest

        check_slowest(self.slowest)
        super().__post_init__()


def write_keepout(target: Path, job: ExportJob, options: Nav2Options) -> ExportSummary:
    """Write a mask for the keepout filter."""
    from locplan.export._nav2 import nav2_keepout

    return _mask(nav2_keepout, target, job, options)


def write_static(target: Path, job: ExportJob, options: Nav2Options) -> ExportSummary:
    """Write a map for a second static layer."""
    from locplan.export._nav2 import nav2_static

    return _mask(nav2_static, target, job, options)


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export._nav2 import nav2_speed

    nav2_speed(target, job.costs, slowest=options.slowest, params=options.params)
    return ExportSummary({"slowest": options.slowest})


def _mask(
    write: Callable[..., Conversion], target: Path, job: ExportJob, options: Nav2Options
) -> ExportSummary:
    conversion = write(
        target,
        job.costs,
        planner=options.planner,
        param=options.planner_param,
        distro=options.distro,
        params=options.params,
    )
    return ExportSummary(conversion.summary(), conversion.rows())


@dataclass(frozen=True, kw_only=True)
class GraphOptions:
    """The options of a route graph."""

    spacing: float = 2.0
    """Nodes of the graph are this far apart in open space [m]; 2 by default."""
    frame: str = "map"
    """The frame of the coordinates is map by default."""

    def __post_init__(self) -> None:
        number("spacing", self.spacing, 0.1)


def write_graph(target: Path, job: ExportJob, options: GraphOptions) -> ExportSummary:
    """Write a roadmap, with the scorers that make the server charge J."""
    from locplan.export._geojson import route_graph

    graph = route_graph(target, job.costs, spacing=options.spacing, frame=options.frame)
    nodes, edges, parts = len(graph.nodes), len(graph.edges), graph.components
    return ExportSummary(
        {"nodes": nodes, "edges": edges, "components": parts},
        (("nodes, edges", f"{nodes:,}, {edges:,} each way"), ("parts not joined", f"{parts:,}")),
    )


FORMATS = (
    Format("nav2-keepout", "a mask for Nav2's KeepoutFilter", write_keepout, Nav2Options),
    Format("nav2-static", "a map for a StaticLayer of Nav2", write_static, Nav2Options),
    Format("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    Format("route-graph", "a GeoJSON graph for Nav2's route server", write_graph, GraphOptions),
)

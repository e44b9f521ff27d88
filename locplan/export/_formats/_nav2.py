"""Masks, layers and route graphs for Nav2."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from locplan._util.checks import number
from locplan.export._names import Distro, NavPlannerName
from locplan.export._registry import ExportJob, ExportSummary, Format
from locplan.robots import read_parameters


@dataclass(frozen=True, kw_only=True)
class MaskOptions:
    """The planner whose costs a mask makes J."""

    planner: NavPlannerName | None = None
    """Planner of Nav2 that charges J; by default the one in --robot, or smac2d."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost; by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export._travel_costs import check_planner

        if self.planner:
            check_planner(self.planner, self.planner_param)


@dataclass(frozen=True, kw_only=True)
class Nav2Options(MaskOptions):
    """The options of masks that a planner charges."""

    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""
    params: Path | None = None
    """Parameter file of Nav2, into a copy of which ours are merged."""

    def __post_init__(self) -> None:
        super().__post_init__()
        read_parameters(self.params)


@dataclass(frozen=True, kw_only=True)
class SpeedOptions:
    """The options of a speed mask."""

    slowest: float = 0.3
    """Share of the speed that is left where u is 1; 0.3 by default."""
    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""
    params: Path | None = None
    """Parameter file of Nav2, into a copy of which ours are merged."""

    def __post_init__(self) -> None:
        from locplan.export._nav2 import check_slowest

        check_slowest(self.slowest)
        read_parameters(self.params)


def write_mask(kind: str, target: Path, job: ExportJob, options: Nav2Options) -> ExportSummary:
    """Write a mask for the keepout filter, or a map for a second static layer."""
    from locplan.export._nav2 import nav2_keepout, nav2_static

    write = nav2_static if kind == "static" else nav2_keepout
    conversion = write(
        target,
        job.costs,
        planner=options.planner,
        param=options.planner_param,
        distro=options.distro,
        params=options.params,
    )
    return ExportSummary(conversion.summary(), conversion.rows())


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export._nav2 import nav2_speed

    least = nav2_speed(
        target, job.costs, slowest=options.slowest, distro=options.distro, params=options.params
    )
    return ExportSummary(
        {"slowest": options.slowest, "least_percent": least},
        (("in the most degenerate place", f"{least} % of the robot's speed"),),
    )


@dataclass(frozen=True, kw_only=True)
class GraphOptions:
    """The options of a route graph."""

    spacing: float = 2.0
    """Distance of nodes of the graph that are joined, in metres; 2 by default. Free space sees one
    within two of these."""
    frame: str = "map"
    """Frame of the coordinates; map by default."""
    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""

    def __post_init__(self) -> None:
        number("spacing", self.spacing, 0.1)


def write_graph(target: Path, job: ExportJob, options: GraphOptions) -> ExportSummary:
    """Write lanes, with the scorers that make the server charge J."""
    from locplan._util.progress import ProgressCallback, progress_bar
    from locplan.export._geojson import route_graph

    if job.progress:
        showing: AbstractContextManager[ProgressCallback] = nullcontext(job.progress)
    else:
        showing = progress_bar(f"writing {target.name}", "")
    with showing as progress:
        graph = route_graph(
            target,
            job.costs,
            spacing=options.spacing,
            frame=options.frame,
            distro=options.distro,
            progress=progress,
        )
    nodes, edges, parts = len(graph.nodes), len(graph.edges), graph.components
    return ExportSummary(
        {"nodes": nodes, "edges": edges, "components": parts},
        (("nodes, edges", f"{nodes:,}, {edges:,} each way"), ("parts not joined", f"{parts:,}")),
    )


FORMATS = (
    Format(
        "nav2-keepout",
        "a mask for Nav2's KeepoutFilter",
        partial(write_mask, "keepout"),
        Nav2Options,
    ),
    Format(
        "nav2-static", "a map for a StaticLayer of Nav2", partial(write_mask, "static"), Nav2Options
    ),
    Format("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    Format(
        "route-graph",
        "a GeoJSON graph for Nav2's route server",
        write_graph,
        GraphOptions,
        tells=True,
    ),
)

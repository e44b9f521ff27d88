"""Masks, layers and route graphs for Nav2, and layouts for fleet managers."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from locplan._util.checks import number, positive, whole
from locplan.errors import ConfigError
from locplan.export._distros import Distro, NavPlannerName
from locplan.export._registry import ExportJob, ExportSummary, Format
from locplan.robots import read_parameters

if TYPE_CHECKING:
    from locplan._util.progress import ProgressCallback
    from locplan.costs import Path as Route
    from locplan.export._roadmap import RouteGraph
    from locplan.simulation import Choices


@dataclass(frozen=True, kw_only=True)
class MaskOptions:
    """The planner whose costs a mask makes J."""

    planner: NavPlannerName | None = None
    """Planner of Nav2 whose costs become J; by default the one in --robot, or smac2d."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost; by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export._travel_costs import check_planner

        if self.planner:
            check_planner(self.planner, self.planner_param)


@dataclass(frozen=True, kw_only=True)
class Nav2Options:
    """The robot's own Nav2."""

    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""
    params: Path | None = None
    """Parameter file of Nav2, into a copy of which ours are merged."""

    def __post_init__(self) -> None:
        read_parameters(self.params)


@dataclass(frozen=True, kw_only=True)
class ChargedOptions(MaskOptions, Nav2Options):
    """The options of masks that a planner's costs are made of."""

    def __post_init__(self) -> None:
        MaskOptions.__post_init__(self)
        Nav2Options.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class SpeedOptions(Nav2Options):
    """The options of a speed mask."""

    slowest: float = 0.3
    """Share of the speed that is left where u is 1; 0.3 by default."""

    def __post_init__(self) -> None:
        from locplan.export._nav2 import check_slowest

        check_slowest(self.slowest)
        super().__post_init__()


def write_mask(kind: str, target: Path, job: ExportJob, options: ChargedOptions) -> ExportSummary:
    """Write a mask for the keepout filter, or a map for a second static layer."""
    from locplan.export._nav2 import nav2_keepout, nav2_static

    write = nav2_static if kind == "static" else nav2_keepout
    conversion = write(target, job.costs, **vars(options))
    return ExportSummary(conversion.summary(), conversion.rows())


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export._nav2 import nav2_speed

    least = nav2_speed(target, job.costs, **vars(options))
    return ExportSummary(
        {"slowest": options.slowest, "least_percent": least},
        (("in the most degenerate place", f"{least} % of the robot's speed"),),
    )


@dataclass(frozen=True, kw_only=True)
class LaneOptions:
    """How close the lanes of a graph are."""

    spacing: float = 2.0
    """Distance of nodes of the graph that are joined, in metres; 2 by default. Free space sees one
    within two of these."""

    def __post_init__(self) -> None:
        number("spacing", self.spacing, 0.1)


@dataclass(frozen=True, kw_only=True)
class GraphOptions(LaneOptions):
    """The options of a route graph."""

    frame: str = "map"
    """Frame of the coordinates; map by default."""
    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""


def write_graph(target: Path, job: ExportJob, options: GraphOptions) -> ExportSummary:
    """Write lanes, with the scorers that make the server's costs J."""
    from locplan._util.progress import progress_bar
    from locplan.export._geojson import route_graph

    showing: AbstractContextManager[ProgressCallback]
    showing = (
        nullcontext(job.progress) if job.progress else progress_bar(f"writing {target.name}", "")
    )
    with showing as progress:
        return _lanes(route_graph(target, job.costs, **vars(options), progress=progress))


@dataclass(frozen=True, kw_only=True)
class LifOptions(LaneOptions):
    """The options of a layout."""

    stations: Path | None = None
    """CSV file of stations (name,x,y), each of which gets a node."""
    vehicle: str = "locplan.robot"
    """Type of vehicle, locplan.robot by default; fleet managers know it as
    MANUFACTURER.SERIES."""
    speed: float | None = None
    """Speed by which J is divided for the travel times of edges, in m/s, which get such a maxSpeed;
    by default they have none."""

    def __post_init__(self) -> None:
        from locplan.planners import read_stations

        super().__post_init__()
        if not self.vehicle:
            raise ConfigError("vehicle must be a name, such as MANUFACTURER.SERIES")
        if self.speed is not None:
            positive("speed", self.speed, "metres a second")
        if self.stations is not None:
            read_stations(self.stations)


def write_lif(target: Path, job: ExportJob, options: LifOptions) -> ExportSummary:
    """Write lanes and stations as a layout."""
    from locplan.export._lif import lif
    from locplan.planners import read_stations

    stations = read_stations(options.stations) if options.stations else []
    graph = lif(target, job.costs, **{**vars(options), "stations": stations})
    return _lanes(graph, {"stations": len(stations)})


def _lanes(graph: RouteGraph, more: Mapping[str, int] | None = None) -> ExportSummary:
    """The size of a graph whose edges lead both ways."""
    nodes, edges, parts, more = len(graph.nodes), len(graph.edges), graph.components, more or {}
    return ExportSummary(
        {"nodes": nodes, "edges": edges, "components": parts, **more},
        (
            ("nodes, edges", f"{nodes:,}, {edges:,} each way"),
            *((name, f"{count:,}") for name, count in more.items()),
            ("parts not joined", f"{parts:,}"),
        ),
    )


@dataclass(frozen=True, kw_only=True)
class RoutesOptions:
    """The options of recommended routes."""

    queries: Path | None = None
    """File of queries whose paths are chosen by driving in simulation: CSV of
    name,start_x,start_y,goal_x,goal_y in metres, or of name,x,y of stations, each two of which are
    one."""
    drives: int = 8
    """Number of drives of each candidate, or fewer where that settles the choice; 8 by default."""
    params: Path | None = None
    """Parameter file of Nav2, which is checked against the ways."""
    frame: str = "map"
    """Frame of the coordinates; map by default."""
    distro: Distro = "jazzy"
    """Distribution of ROS 2; jazzy by default."""

    def __post_init__(self) -> None:
        from locplan.planners import read_queries

        whole("drives", self.drives, 2)
        read_parameters(self.params)
        if self.queries is not None:
            read_queries(self.queries)


def check_routes(options: RoutesOptions, paths: int) -> None:
    """Raise a ConfigError where there is nothing to export."""
    if options.queries is None and not paths:
        raise ConfigError("--to nav2-routes needs --queries FILE, or paths by --path CSV")


def write_routes(target: Path, job: ExportJob, options: RoutesOptions) -> ExportSummary:
    """Choose the paths of queries by driving, and write them with the paths that are given."""
    from locplan._util.progress import working
    from locplan.export._geojson import nav2_routes
    from locplan.export._parameters import Robot
    from locplan.export._recommended import check_ways

    robot = Robot.of(options.params, options.distro)
    robot.warn(robot.of_radius(job.costs.robot_radius))
    paths = dict(job.paths)
    check_ways(job.costs, paths)
    summary = ExportSummary()
    if options.queries is not None:
        choices = _chosen(options.queries, paths, job, options)
        for each in choices:
            if each.choice.path is not None:
                paths[each.query.name] = each.choice.path
        summary = _summary_of(choices)
    with working(f"writing {target.name}"):
        ways = nav2_routes(target, job.costs, paths, frame=options.frame, distro=options.distro)
    graph, contradicted = ways.graph, ways.contradicted
    rows = [
        *summary.rows,
        ("nodes, edges", f"{len(graph.nodes):,}, {len(graph.edges):,}"),
        ("ways that the server takes", f"{len(ways.followed)} of {len(ways.ways)}"),
    ]
    if contradicted:
        rows.append(("other routes are cheaper", ", ".join(contradicted)))
    values = {
        **summary.values,
        "nodes": len(graph.nodes),
        "edges": len(graph.edges),
        "followed": list(ways.followed),
        "changed_edges": ways.changed,
    }
    return ExportSummary(values, tuple(rows))


def _chosen(
    file: Path, paths: Mapping[str, Route], job: ExportJob, options: RoutesOptions
) -> Choices:
    """The choices for the queries in a file."""
    from locplan._util.progress import progress_bar
    from locplan.planners import read_queries
    from locplan.simulation import choose_many

    queries = read_queries(file)
    for query in queries:
        if query.name in paths:
            raise ConfigError(f"a path and a query are both named {query.name}; rename one")
    with progress_bar("driving the candidates", "queries") as progress:
        return choose_many(job.costs, queries, job.robot, drives=options.drives, progress=progress)


def _summary_of(choices: Choices) -> ExportSummary:
    """What the choices bring."""
    before, after = choices.lost
    without = [each.query.name for each in choices if each.choice.path is None]
    rows = [
        ("queries", f"{len(choices)}, {choices.left} leave the shortest path"),
        ("drives that are lost", f"{before:.0%} -> {after:.0%}"),
    ]
    if without:
        rows.append(("without a path", ", ".join(without)))
    values = {"left_the_shortest": choices.left, "lost": [before, after], "no_path": without}
    return ExportSummary(values, tuple(rows))


FORMATS = (
    Format(
        *("nav2-keepout", "a mask for Nav2's KeepoutFilter"),
        partial(write_mask, "keepout"),
        ChargedOptions,
    ),
    Format(
        *("nav2-static", "a map for a StaticLayer of Nav2"),
        partial(write_mask, "static"),
        ChargedOptions,
    ),
    Format("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    Format(
        *("route-graph", "a GeoJSON graph for Nav2's route server", write_graph, GraphOptions),
        shows_progress=True,
    ),
    Format(
        "nav2-routes",
        "the recommended ways of many queries as a graph for Nav2's route server, and in a bag",
        write_routes,
        RoutesOptions,
        library="mcap",
        paths="several",
        shows_progress=True,
        check=check_routes,
    ),
    Format("lif", "a VDMA LIF layout for fleet managers", write_lif, LifOptions, (".json",)),
)

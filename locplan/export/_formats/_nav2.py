"""Masks, layers and route graphs for Nav2."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from locplan._util.checks import number, whole
from locplan.errors import ConfigError
from locplan.export._names import Distro, NavPlannerName
from locplan.export._registry import ExportJob, ExportSummary, Format
from locplan.maps._ros_parameters import read_parameters


@dataclass(frozen=True, kw_only=True)
class MaskOptions:
    """The planner whose costs a mask makes J."""

    planner: NavPlannerName = "smac2d"
    """The planner of Nav2 that charges J is smac2d by default."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost is by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export._travel_costs import check_planner

        check_planner(self.planner, self.planner_param)


@dataclass(frozen=True, kw_only=True)
class Nav2Options(MaskOptions):
    """The options of masks that a planner charges."""

    distro: Distro = "jazzy"
    """The distribution of ROS 2 is jazzy by default."""
    params: Path | None = None
    """Our parameters are merged into this parameter file of Nav2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        read_parameters(self.params)


@dataclass(frozen=True, kw_only=True)
class SpeedOptions:
    """The options of a speed mask."""

    slowest: float = 0.3
    """The share of the speed that is left where u is 1 is 0.3 by default."""
    distro: Distro = "jazzy"
    """The distribution of ROS 2 is jazzy by default."""
    params: Path | None = None
    """Our parameters are merged into this parameter file of Nav2."""

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
    """Free space sees a node of the graph within two of these [m], and places that far apart are
    joined; 2 by default."""
    frame: str = "map"
    """The frame of the coordinates is map by default."""
    distro: Distro = "jazzy"
    """The distribution of ROS 2 is jazzy by default."""

    def __post_init__(self) -> None:
        number("spacing", self.spacing, 0.1)


def write_graph(target: Path, job: ExportJob, options: GraphOptions) -> ExportSummary:
    """Write lanes, with the scorers that make the server charge J."""
    from locplan.export._geojson import route_graph

    graph = route_graph(
        target, job.costs, spacing=options.spacing, frame=options.frame, distro=options.distro
    )
    nodes, edges, parts = len(graph.nodes), len(graph.edges), graph.components
    return ExportSummary(
        {"nodes": nodes, "edges": edges, "components": parts},
        (("nodes, edges", f"{nodes:,}, {edges:,} each way"), ("parts not joined", f"{parts:,}")),
    )


@dataclass(frozen=True, kw_only=True)
class RoutesOptions:
    """The options of recommended routes."""

    queries: Path | None = None
    """The paths of these queries are chosen by driving in simulation: a CSV file of
    name,start_x,start_y,goal_x,goal_y [m], or name,x,y of stations, each two of which are one."""
    drives: int = 8
    """Each candidate path is driven 8 times by default, or fewer where that settles the choice."""
    params: Path | None = None
    """The settings of amcl in this parameter file of Nav2 are simulated."""
    frame: str = "map"
    """The frame of the coordinates is map by default."""
    distro: Distro = "jazzy"
    """The distribution of ROS 2 is jazzy by default."""

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
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.export._nav2_routes import nav2_routes
    from locplan.export._recommended import check_ways
    from locplan.planners import read_queries
    from locplan.simulation import Amcl, choose_many
    from locplan.simulation._nav2 import read_amcl

    paths = dict(job.paths)
    check_ways(job.costs, paths)
    without = []
    values: dict[str, object] = {}
    rows: list[tuple[str, str]] = []
    if options.queries is not None:
        queries = read_queries(options.queries)
        for query in queries:
            if query.name in paths:
                raise ConfigError(f"a path and a query are both named {query.name}; rename one")
        amcl = read_amcl(options.params) if options.params else Amcl()
        with progress_bar("driving the candidates", "queries") as progress:
            choices = choose_many(
                job.costs, queries, amcl=amcl, drives=options.drives, progress=progress
            )
        for each in choices:
            if each.choice.path is None:
                without.append(each.query.name)
            else:
                paths[each.query.name] = each.choice.path
        before, after = choices.lost
        values = {"left_the_shortest": choices.left, "lost": [before, after], "no_path": without}
        rows = [
            ("queries", f"{len(choices)}, {choices.left} leave the shortest path"),
            ("drives that are lost", f"{before:.0%} -> {after:.0%}"),
        ]
        if without:
            rows.append(("without a path", ", ".join(without)))
    with working(f"writing {target.name}"):
        ways = nav2_routes(target, job.costs, paths, frame=options.frame, distro=options.distro)
    graph = ways.graph
    followed = f"{len(ways.followed)} of {len(ways.ways)}"
    rows.append(("ways that the server takes", followed))
    contradicted = [name for name in ways.ways if name not in ways.followed]
    if contradicted:
        rows.append(("other routes are cheaper", ", ".join(contradicted)))
    return ExportSummary(
        {
            **values,
            "nodes": len(graph.nodes),
            "edges": len(graph.edges),
            "followed": list(ways.followed),
            "changed_edges": ways.changed,
        },
        (
            *rows,
            ("nodes, edges", f"{len(graph.nodes):,}, {len(graph.edges):,} each way"),
        ),
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
    Format("route-graph", "a GeoJSON graph for Nav2's route server", write_graph, GraphOptions),
    Format(
        "nav2-routes",
        "the recommended ways of many queries as a graph for Nav2's route server, and in a bag",
        write_routes,
        RoutesOptions,
        library="mcap",
        paths="several",
        tells=True,
        check=check_routes,
    ),
)

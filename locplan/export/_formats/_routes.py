"""The recommended ways of many queries for Nav2's route server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from locplan._util.checks import whole
from locplan.errors import ConfigError
from locplan.export._names import Distro
from locplan.export._registry import ExportJob, ExportSummary, Format
from locplan.robots import read_parameters

if TYPE_CHECKING:
    from locplan.costs import Path as Route
    from locplan.simulation import Choices


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
    from locplan._util.working import working
    from locplan.export._nav2_routes import nav2_routes
    from locplan.export._recommended import check_ways
    from locplan.export._robots import Robot

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

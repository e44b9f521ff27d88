"""Recommended routes of many queries as one graph, for Nav2's route server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from locplan._support.records import Table, TableColumn
from locplan.errors import ConfigError
from locplan.export.parameters import Nav2Robot, ParameterFiles
from locplan.export.path_joining import (
    SAME_PLACE_DISTANCE,
    LineCosts,
    adjust_edge_costs,
    join_paths,
    straighten_routes,
    subdivide_path,
)
from locplan.export.registry import (
    DEFAULT_DISTRO,
    DEFAULT_FRAME,
    ExportSummary,
    create_export_folder,
)
from locplan.export.route_graph import (
    MAX_PRECISION_STEP,
    SCORERS,
    RouteGraph,
    check_precision,
    graph_to_geojson,
    save_graph_preview,
    write_graph,
)
from locplan.export.values import drop_costmap_yaw, drop_path_yaw
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.path import Path

MAX_END_DISTANCE = 2 * SAME_PLACE_DISTANCE
"""Maximum distance of ends that can become one node [m]: each may lie that far from it."""


@dataclass(frozen=True, eq=False, repr=False)
class RecommendedRoutes:
    """A route graph with the recommended route of each query."""

    graph: RouteGraph
    """The graph. The cost of a changed edge differs from J, but is at least its length."""
    routes: Mapping[str, tuple[int, ...]]
    """The nodes of each query's route, from start to goal."""
    n_changed_edges: int
    """Number of edges whose cost differs from J."""
    followed_queries: tuple[str, ...]
    """Names of the queries whose cheapest route is the recommended one, or stays within two metres
    of it."""

    @property
    def conflicting_queries(self) -> tuple[str, ...]:
        """Names of the queries with a cheaper route; their routes contradict followed ones."""
        return tuple(name for name in self.routes if name not in self.followed_queries)

    def summarize(self) -> ExportSummary:
        """Return the size of the graph and the queries that it follows, for JSON and for people."""
        sizes = {"nodes": len(self.graph.nodes), "edges": len(self.graph.edges)}
        values = {
            **sizes,
            "followed": list(self.followed_queries),
            "changed_edges": self.n_changed_edges,
        }
        followed = (
            "queries that take the recommended route",
            f"{len(self.followed_queries)} of {len(self.routes)}",
        )
        other = "queries with a cheaper route", ", ".join(self.conflicting_queries)
        size = "nodes, edges", f"{len(self.graph.nodes):,}, {len(self.graph.edges):,}"
        rows = size, followed, *([other] if self.conflicting_queries else [])
        return ExportSummary(values, rows)

    def __repr__(self) -> str:
        counts = f"{len(self.followed_queries)} of {len(self.routes)} followed"
        return f"RecommendedRoutes({counts}, {self.graph})"


def build_recommended_routes(costs: Costmap, paths: Mapping[str, Path]) -> RecommendedRoutes:
    """Build a route graph whose cheapest routes follow the given paths.

    Routes within two metres of each other are merged if that is free and costs little. The way back
    is the same route, unless that contradicts other routes.

    Parameters
    ----------
    costs : Costmap
        The costs of travel, on the map of the paths.
    paths : dict of Path
        The recommended path of each query; paths without a length are skipped.

    Returns
    -------
    RecommendedRoutes

    Raises
    ------
    ConfigError
        If no path has a length, a path leaves the map's free space or ends at its start, or the map
        is too far from the world's origin for Nav2's single precision.

    Examples
    --------
    >>> import numpy as np
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> costs = locplan.Costmap.blank(grid)
    >>> there = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0)).path
    >>> half = locplan.plan(costs, (2.0, 3.0), (20.0, 3.0)).path
    >>> build_recommended_routes(costs, {"there": there, "half": half})
    RecommendedRoutes(2 of 2 followed, RouteGraph(3 nodes, 4 directed edges))
    """
    paths = {name: path for name, path in paths.items() if path.length > MAX_END_DISTANCE}
    if not paths:
        raise ConfigError("there is no path to export; give at least one path with a length")
    check_routable_paths(costs, paths)
    lines = LineCosts(costs)
    # In single precision, a path along the edge of a blocked cell may lie inside the cell.
    if not all(
        np.isfinite(lines.compute_polyline_costs(subdivide_path(path))).all()
        for path in paths.values()
    ):
        lines = LineCosts(costs, side_tolerance=MAX_PRECISION_STEP)
    nodes, routes = straighten_routes(lines, *join_paths(lines, paths))
    forward_routes = [*routes.values()]
    all_routes = forward_routes + [route[::-1] for route in forward_routes]
    edges = np.array(sorted({two for route in all_routes for two in pairwise(route)}))
    length = np.hypot(*(nodes[edges[:, 0]] - nodes[edges[:, 1]]).T)
    price = np.maximum(lines.compute_costs(nodes, edges), length)
    # Priority of a route, and of its way back, if routes contradict each other.
    worth = np.repeat([1e3, 1e1], len(forward_routes))
    cost, followed = adjust_edge_costs(nodes, edges, price, length, all_routes, worth)
    e, u = (lines.integrate_layer(layer, nodes, edges) for layer in (costs.e, costs.u))
    return RecommendedRoutes(
        RouteGraph(nodes, edges, length, cost, e, u),
        {name: tuple(route) for name, route in routes.items()},
        int((np.abs(cost - price) > 1e-6).sum()),
        tuple(name for name, is_followed in zip(routes, followed, strict=False) if is_followed),
    )


def check_routable_paths(costs: Costmap, paths: Mapping[str, Path]) -> None:
    """Raise a ConfigError unless routes on the map can follow the paths."""
    check_precision(costs.grid)
    lines = LineCosts(costs)
    for name, path in paths.items():
        if np.hypot(*(path.xy[-1] - path.xy[0])) <= MAX_END_DISTANCE < path.length:
            raise ConfigError(
                f"path {name} ends at its start, where a server's route is empty; split it into two"
                " paths, there and back"
            )
        if not np.isfinite(lines.compute_polyline_costs(path.xy)).all():
            raise ConfigError(f"path {name} leaves the map's free space; plan it on this map")


def nav2_routes(
    folder: str | FilePath,
    costs: Costmap,
    paths: Mapping[str, Path],
    *,
    frame: str = DEFAULT_FRAME,
    distro: str = DEFAULT_DISTRO,
    params: ParameterFiles = None,
    force: bool = False,
) -> RecommendedRoutes:
    """Write recommended paths as a route graph for Nav2's route server.

    The graph's edges follow the paths; paths that run side by side share edges. The costs make each
    path the cheapest route between its ends, unless the paths contradict each other.

    Parameters
    ----------
    folder : path
        The folder, which may exist; an earlier export of this kind is replaced.
    costs : Costmap
        The costs of travel; the map's yaw is ignored, as in Nav2.
    paths : dict of Path
        The recommended path of each query by its name, such as from `recommend_paths`.
    frame : str, default "map"
        Frame of the nodes.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.
    params : path, optional
        A Nav2 parameter file to merge the server's parameters into, as for `nav2_keepout`. Its
        operations stay; the export replaces its scorers.
    force : bool, default False
        True overwrites files of the same names in the folder.

    Returns
    -------
    RecommendedRoutes
        The graph, the route of each query, and the queries whose route is the cheapest.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a path does not lie in the map's free space.
    """
    robot = Nav2Robot.from_files(params, distro)
    grid = costs.grid
    unturned = drop_costmap_yaw(costs)
    if grid.origin[2]:
        paths = {name: drop_path_yaw(grid, path) for name, path in paths.items()}
    routes = build_recommended_routes(unturned, paths)
    name = grid.name or "a map"
    metadata = {"kind": "nav2-routes", "distro": distro, "changed_edges": routes.n_changed_edges}
    metadata |= {
        "queries": list(routes.routes),
        "followed": list(routes.followed_queries),
    } | summarize_costs(costs)
    template_values: dict[str, Any] = {
        "map": name,
        "routes": routes,
        "robot": robot,
        "costs": costs,
    }
    template_values |= {"nodes": routes.graph.nodes, "ends": (1, 2)}
    with create_export_folder(
        folder, "nav2-routes.md", metadata, template_values, force=force
    ) as temporary:
        count = len(routes.routes)
        title = f"{name}: recommended routes of {count} quer{'y' if count == 1 else 'ies'}"
        write_graph(
            temporary, graph_to_geojson(routes.graph, frame), SCORERS, robot, FilePath(folder)
        )
        save_graph_preview(temporary, unturned, routes.graph, title)
        _make_query_table(routes).write_csv(temporary / "routes.csv")
    return routes


def _make_query_table(routes: RecommendedRoutes) -> Table:
    """Return a table with a row per query and the ids of its ends in the graph's file."""
    matrix, rows = routes.graph.cost_matrix, []
    for name, route in routes.routes.items():
        cost = round(float(sum(matrix[two] for two in pairwise(route))), 3)
        followed = "yes" if name in routes.followed_queries else "no"
        rows.append((name, route[0] + 1, route[-1] + 1, cost, followed))
    ends = TableColumn("query"), TableColumn("start_id"), TableColumn("goal_id")
    columns = *ends, TableColumn("cost", "m"), TableColumn("followed")
    return Table(columns, tuple(rows))

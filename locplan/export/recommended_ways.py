"""The recommended ways of many queries as one graph, for Nav2's route server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from locplan._support.records import Column, Table
from locplan.errors import ConfigError
from locplan.export.joined_ways import (
    SAME,
    LineCosts,
    adjust_costs,
    divide_path,
    join_paths,
    straighten_ways,
)
from locplan.export.parameters import Nav2Robot, Params
from locplan.export.registry import DISTRO, FRAME, ExportSummary, export_folder
from locplan.export.route_graph import (
    FINENESS,
    SCORERS,
    RouteGraph,
    check_precision,
    save_graph_preview,
    to_geojson,
    write_graph,
)
from locplan.export.values import unturn, world_to_unrotated_map
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.path import Path

MAX_END_DISTANCE = 2 * SAME
"""Maximum distance of ends that can become one node [m]: each may lie that far from it."""


@dataclass(frozen=True, eq=False, repr=False)
class RecommendedWays:
    """A route graph, and the way on it that is recommended for each query."""

    graph: RouteGraph
    """The graph. The cost of a changed edge is no longer J, but still at least its length."""
    ways: Mapping[str, tuple[int, ...]]
    """The nodes of each query's way, from start to goal."""
    changed: int
    """Number of edges whose cost is not J."""
    followed: tuple[str, ...]
    """Names of the queries whose cheapest route on the graph is the recommended way, or runs within
    two metres of all of it."""

    @property
    def conflicting_queries(self) -> tuple[str, ...]:
        """Names of the other queries: their ways contradict those of the ones that are followed."""
        return tuple(name for name in self.ways if name not in self.followed)

    def facts(self) -> ExportSummary:
        """Return the size of the graph and the ways that it keeps, also as rows for people."""
        sizes = {"nodes": len(self.graph.nodes), "edges": len(self.graph.edges)}
        values = {**sizes, "followed": list(self.followed), "changed_edges": self.changed}
        followed = "ways that the server takes", f"{len(self.followed)} of {len(self.ways)}"
        other = "other routes are cheaper", ", ".join(self.conflicting_queries)
        size = "nodes, edges", f"{len(self.graph.nodes):,}, {len(self.graph.edges):,}"
        rows = size, followed, *([other] if self.conflicting_queries else [])
        return ExportSummary(values, rows)

    def __repr__(self) -> str:
        return f"RecommendedWays({len(self.followed)} of {len(self.ways)} followed, {self.graph})"


def make_recommended_ways(costs: Costmap, paths: Mapping[str, Path]) -> RecommendedWays:
    """Join paths to a graph on which the cheapest routes are these paths.

    Ways within two metres of one another become one where that is free and costs little. The way
    back is the same, where that does not contradict other ways.

    Parameters
    ----------
    costs : Costmap
        The costs of travel, on the map of the paths.
    paths : dict of Path
        The recommended path of each query; one within a point is left out.

    Returns
    -------
    RecommendedWays

    Raises
    ------
    ConfigError
        If no path has a length, one leaves the free space of the map or ends where it starts, or
        the map is so far from the world's origin that Nav2's single precision would be too coarse.

    Examples
    --------
    >>> import numpy as np
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> costs = locplan.Costmap.blank(grid)
    >>> there = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0)).path
    >>> half = locplan.plan(costs, (2.0, 3.0), (20.0, 3.0)).path
    >>> recommended_ways(costs, {"there": there, "half": half})
    RecommendedWays(2 of 2 followed, RouteGraph(3 nodes, 4 directed edges))
    """
    paths = {name: path for name, path in paths.items() if path.length > MAX_END_DISTANCE}
    if not paths:
        raise ConfigError("there is no way to export; give at least one path of some length")
    check_ways(costs, paths)
    lines = LineCosts(costs)
    # A path along the edge of a blocked cell can come to lie beyond it in single precision.
    if not all(
        np.isfinite(lines.compute_chain_costs(divide_path(path))).all() for path in paths.values()
    ):
        lines = LineCosts(costs, side_tolerance=FINENESS)
    nodes, ways = straighten_ways(lines, *join_paths(lines, paths))
    forward_ways = [*ways.values()]
    all_ways = forward_ways + [way[::-1] for way in forward_ways]
    edges = np.array(sorted({two for way in all_ways for two in pairwise(way)}))
    length = np.hypot(*(nodes[edges[:, 0]] - nodes[edges[:, 1]]).T)
    price = np.maximum(lines.costs(nodes, edges), length)
    # Ways may contradict one another: the price of one, or of the way back, that is not followed.
    worth = np.repeat([1e3, 1e1], len(forward_ways))
    cost, followed = adjust_costs(nodes, edges, price, length, all_ways, worth)
    e, u = (lines.integrals(layer, nodes, edges) for layer in (costs.e, costs.u))
    return RecommendedWays(
        RouteGraph(nodes, edges, length, cost, e, u),
        {name: tuple(way) for name, way in ways.items()},
        int((np.abs(cost - price) > 1e-6).sum()),
        tuple(name for name, is_followed in zip(ways, followed, strict=False) if is_followed),
    )


def check_ways(costs: Costmap, paths: Mapping[str, Path]) -> None:
    """Raise a ConfigError unless paths are ways on the map that a route can follow."""
    check_precision(costs.grid)
    lines = LineCosts(costs)
    for name, path in paths.items():
        if np.hypot(*(path.xy[-1] - path.xy[0])) <= MAX_END_DISTANCE < path.length:
            raise ConfigError(
                f"path {name} ends where it starts, and a server's route there is empty; give the"
                " way out and the way back as two paths"
            )
        if not np.isfinite(lines.compute_chain_costs(path.xy)).all():
            raise ConfigError(f"path {name} leaves the map's free space; plan it on this map")


def nav2_routes(
    folder: str | FilePath,
    costs: Costmap,
    paths: Mapping[str, Path],
    *,
    frame: str = FRAME,
    distro: str = DISTRO,
    params: Params = None,
    force: bool = False,
) -> RecommendedWays:
    """Write recommended paths as a route graph that Nav2's server follows.

    The graph's edges are the paths, joined where they run side by side, and its costs make each
    path the cheapest route between its ends, as far as the paths do not contradict one another.

    Parameters
    ----------
    folder : path
        The folder, which need not exist; an earlier export of this kind is replaced.
    costs : Costmap
        The costs of travel; the map's yaw is left out, as Nav2 ignores it.
    paths : dict of Path
        The recommended path of each query by its name, such as those of `recommend_paths`.
    frame : str, default "map"
        Frame of the nodes.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.
    params : path, optional
        A Nav2 parameter file to merge the server's into, as for `nav2_keepout`: its operations
        stay, its scorers give way to ours.
    force : bool, default False
        True overwrites files of the same names in the folder; others stay.

    Returns
    -------
    RecommendedWays
        The graph, each query's way on it, and the queries for which it is the cheapest route.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a path does not lie in the map's free space.
    """
    robot = Nav2Robot.from_files(params, distro)
    grid = costs.grid
    unturned = unturn(costs)
    if grid.origin[2]:
        paths = {name: _remove_yaw(grid, path) for name, path in paths.items()}
    ways = make_recommended_ways(unturned, paths)
    name = grid.name or "a map"
    metadata = {"kind": "nav2-routes", "distro": distro, "changed_edges": ways.changed}
    metadata |= {"queries": list(ways.ways), "followed": list(ways.followed)} | summarize_costs(
        costs
    )
    template_values: dict[str, Any] = {"map": name, "ways": ways, "robot": robot, "costs": costs}
    template_values |= {"nodes": ways.graph.nodes, "ends": (1, 2)}
    with export_folder(folder, "nav2-routes.md", metadata, force, **template_values) as temporary:
        count = len(ways.ways)
        title = f"{name}: recommended ways of {count} quer{'y' if count == 1 else 'ies'}"
        write_graph(temporary, to_geojson(ways.graph, frame), SCORERS, robot, FilePath(folder))
        save_graph_preview(temporary, unturned, ways.graph, title)
        _make_table(ways).write_csv(temporary / "routes.csv")
    return ways


def _remove_yaw(grid: OccupancyGrid, path: Path) -> Path:
    """A path on the map without its yaw."""
    heading = None if path.heading is None else path.heading - grid.origin[2]
    return Path(world_to_unrotated_map(grid, path.xy), heading)


def _make_table(ways: RecommendedWays) -> Table:
    """A row for each query, with the ids of its ends in the graph's file."""
    matrix, rows = ways.graph.matrix, []
    for name, way in ways.ways.items():
        cost = round(float(sum(matrix[two] for two in pairwise(way))), 3)
        followed = "yes" if name in ways.followed else "no"
        rows.append((name, way[0] + 1, way[-1] + 1, cost, followed))
    ends = Column("query"), Column("start_id"), Column("goal_id")
    columns = *ends, Column("cost", "m"), Column("followed")
    return Table(columns, tuple(rows))

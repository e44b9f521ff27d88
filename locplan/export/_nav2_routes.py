"""The recommended ways of a fleet's queries for Nav2: a route graph, and paths in a bag."""

from __future__ import annotations

import csv
import dataclasses
import json
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path as FilePath

from locplan._util.tables import csv_cell
from locplan.costs import Costmap, Path, about_costs
from locplan.export._bags import bag
from locplan.export._distros import SERVERS, distribution, lines_on_serving
from locplan.export._folders import about_map, export_folder
from locplan.export._geojson import GRAPH, to_geojson, write_route_server
from locplan.export._messages import topics_of
from locplan.export._recommended import RecommendedWays, recommended_ways
from locplan.export._value_maps import PREVIEW, where_unturned, without_yaw
from locplan.maps import OccupancyGrid

BAG = "routes.mcap"
TABLE = "routes.csv"


def nav2_routes(
    folder: str | FilePath,
    costs: Costmap,
    paths: Mapping[str, Path],
    *,
    frame: str = "map",
    distro: str = "jazzy",
) -> RecommendedWays:
    """Write recommended paths as a route graph that Nav2's server follows, and into a bag.

    The graph's edges are the paths, joined where they run side by side, and its costs make each
    path the cheapest route between its ends, as far as the paths do not contradict one another.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        The costs of travel; the map's yaw is left out, as Nav2 ignores it.
    paths : dict of Path
        The recommended path of each query by its name, such as those of `choose_many`.
    frame : str, default "map"
        Frame of the nodes and of the paths.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.

    Returns
    -------
    RecommendedWays
        The graph, each query's way on it, and the queries for which it is the cheapest route.

    Raises
    ------
    LocplanError
        If the package mcap is missing, the folder cannot be written, or a path does not lie in the
        map's free space.
    """
    from locplan.export import _figures
    from locplan.plotting import save_figure

    runs = distribution(distro)
    runs.warn()
    grid = costs.grid
    unturned = dataclasses.replace(costs, grid=without_yaw(grid))
    if grid.origin[2]:
        paths = {name: _unturned(grid, path) for name, path in paths.items()}
    ways = recommended_ways(unturned, paths)
    graph = ways.graph
    text = json.dumps(to_geojson(graph, frame), allow_nan=False)
    name = grid.name or "a map"
    readme = [
        f"- {GRAPH}: the ways of {len(ways.ways)} queries, {len(graph.edges)} directed edges"
        f" between {len(graph.nodes)} nodes; the route server takes the recommended way of"
        f" {len(ways.followed)} of them ({ways.changed} edges do not cost J for that).",
        f"- {TABLE}: the nodes of each query's start and goal, for ComputeRoute by ids;"
        f" {BAG}: its path (nav_msgs/Path on its topic); {PREVIEW}; export.json: the input.",
        f"- {SERVERS}: the route server with the scorers that add up to these costs.",
        *lines_on_serving(runs, GRAPH),
        *about_map(costs),
    ]
    if ways.contradicted:
        readme.append(
            f"- Other routes are cheaper for {', '.join(ways.contradicted)}, whose ways contradict"
            " others: ask for these by places on the way, one after the other, or send the paths."
        )
    about = {"kind": "nav2-routes", "distro": distro, "changed_edges": ways.changed}
    about |= {"queries": list(ways.ways), "followed": list(ways.followed)} | about_costs(costs)
    with export_folder(FilePath(folder), f"Routes on {name}", about, readme) as temporary:
        (temporary / GRAPH).write_text(text + "\n", encoding="utf-8")
        write_route_server(temporary, None)
        bag(temporary / BAG, unturned.grid, paths=paths, frame=frame)
        _write_table(temporary / TABLE, ways, topics_of(paths))
        count = len(ways.ways)
        title = f"{name}: recommended ways of {count} quer{'y' if count == 1 else 'ies'}"
        figure = _figures.routes_figure(unturned, graph, title)
        save_figure(figure, temporary / PREVIEW, dpi=110)
    return ways


def _unturned(grid: OccupancyGrid, path: Path) -> Path:
    """A path on the map without its yaw."""
    heading = None if path.heading is None else path.heading - grid.origin[2]
    return Path(where_unturned(grid, path.xy), heading)


def _write_table(target: FilePath, ways: RecommendedWays, topics: Mapping[str, str]) -> None:
    """A row for each query, with the ids of its ends in the graph's file and its topic."""
    matrix = ways.graph.matrix
    with open(target, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("query", "start_id", "goal_id", "cost_m", "followed", "topic"))
        for name, way in ways.ways.items():
            cost = sum(matrix[one, other] for one, other in pairwise(way))
            followed = name in ways.followed
            row = name, way[0] + 1, way[-1] + 1, f"{cost:.3f}", followed, topics[name]
            writer.writerow(map(csv_cell, row))

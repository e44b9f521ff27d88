"""Stations: named positions that a route graph gets nodes at."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._kernels.route import line_costs
from locplan._util.checks import file_path, position
from locplan._util.reading import read_text
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.export._route_graphs import RouteGraph, space_of

LANES = 2
"""Number of edges to the lanes that a station gets at most."""


@dataclass(frozen=True)
class Station:
    """A named position where the robot has something to do."""

    name: str
    """The name, which no other station has."""
    x: float
    """World x [m]."""
    y: float
    """World y [m]."""

    def __post_init__(self) -> None:
        position(self.x, self.y, f"station {self.name}")


def read_stations(path: str | os.PathLike[str]) -> list[Station]:
    """Read stations from a CSV file whose header names name, x_m and y_m.

    Raises
    ------
    LocplanError
        If the file cannot be read, or does not hold stations with names of their own.
    """
    file = file_path("a station file", path)
    try:
        rows = csv.DictReader(read_text(file).lstrip("\ufeff").splitlines(), skipinitialspace=True)
        stations = [
            Station(row["name"].strip(), float(row["x_m"]), float(row["y_m"])) for row in rows
        ]
    except (KeyError, TypeError, ValueError, AttributeError, csv.Error):
        raise LocplanError(
            f"{file}: holds no stations; its first line must name name,x_m,y_m, and a station a"
            " line must follow"
        ) from None
    except LocplanError as error:
        raise LocplanError(f"{file}: {error}") from None
    names = [station.name for station in stations]
    for name in names:
        if not name or names.count(name) > 1:
            raise LocplanError(f"{file}: each station needs a name of its own, not {name!r}")
    return stations


def with_stations(
    costs: Costmap, graph: RouteGraph, stations: Sequence[Station]
) -> tuple[RouteGraph, list[int]]:
    """A graph with a node at each station, and these nodes.

    A station is joined to the two nodes that its straight lines to cost least; one that is nearly
    at a node takes that one.

    Raises
    ------
    LocplanError
        If the robot cannot stand at a station, or no node is seen from it.
    """
    space, resolution = space_of(costs), costs.grid.resolution
    nodes, edges = [*graph.nodes], graph.edges.tolist()
    at = []
    for station in stations:
        costs.cell_of((station.x, station.y), f"station {station.name}")
        xy = np.array((station.x, station.y), np.float32).astype(np.float64)
        away = np.hypot(*(graph.nodes - xy).T)
        lines = np.column_stack([np.arange(len(away)), np.full(len(away), len(away))])
        cost = line_costs(*space, np.vstack([graph.nodes, xy]), lines)
        seen = np.argsort(cost, kind="stable")[:LANES]
        seen = seen[np.isfinite(cost[seen])]
        if len(seen) == 0:
            raise ConfigError(
                f"no node is seen from station {station.name}; take a smaller spacing"
            )
        if away[seen[0]] < resolution:
            at.append(int(seen[0]))
            continue
        for node in seen.tolist():
            edges.append((node, len(nodes)))
            if graph.directed:
                edges.append((len(nodes), node))
        at.append(len(nodes))
        nodes.append(xy)
    return RouteGraph.over(costs, nodes, edges, directed=graph.directed), at

"""Routes of a check: between stations, or between places far apart."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from locplan._support.checks import short_repr
from locplan._support.tables import check_file_names_differ
from locplan.errors import ConfigError, LocplanError
from locplan.planning.costmap import Costmap
from locplan.planning.map_info import describe_map
from locplan.planning.path import Path
from locplan.planning.plans import check_ends, plan
from locplan.planning.queries import Query, Station, normalize_queries, random_queries

MAX_ROUTES = 12
"""Maximum number of routes between stations; more are thinned out evenly."""
Stations = str | os.PathLike[str] | Sequence[Any] | Mapping[str, Any]
"""A file of stations or queries, stations, positions by name, or (start, goal) pairs [m]."""


def plan_routes(
    costs: Costmap, stations: Stations | None, count: int, seed: int
) -> dict[str, Path]:
    """Plan the shortest path of each route, by its name.

    Parameters
    ----------
    costs : Costmap
        A costmap without a field.
    stations : see `locplan.check`
        The places to drive between; None takes places far apart.
    count : int
        Maximum number of routes between places far apart.
    seed : int
        Seed of random places.
    """
    queries = (
        _make_distant_queries(costs, count, seed)
        if stations is None
        else _make_station_queries(costs, stations)
    )
    if len(queries) > MAX_ROUTES:
        step = math.ceil(len(queries) / MAX_ROUTES)
        queries = queries[::step]
    check_file_names_differ("routes", dict.fromkeys(query.name for query in queries))
    paths = {}
    for query in queries:
        try:
            start, goal = check_ends(costs, query.start[:2], query.goal[:2])
        except LocplanError as error:
            raise type(error)(f"route {short_repr(query.name)}: {error}") from None
        path = plan(costs, query.start[:2], query.goal[:2]).path if start != goal else None
        if path is None or not path.length:
            raise ConfigError(
                f"route {short_repr(query.name)}: no path leads from start to goal. Leave it out,"
                " or correct the robot's footprint and margin"
            )
        paths[query.name] = path
    return paths


def _make_station_queries(costs: Costmap, stations: Stations) -> Sequence[Query]:
    """Return the queries between every two stations, or the queries of a file."""
    if isinstance(stations, Mapping):
        stations = [Station(str(name), *map(float, xy)) for name, xy in stations.items()]
    if not isinstance(stations, str | os.PathLike) and all(
        isinstance(station, Station) for station in stations
    ):
        station_list = [*stations]
        queries = [
            Query(f"{first.name} to {second.name}", (first.x, first.y), (second.x, second.y))
            for n, first in enumerate(station_list)
            for second in station_list[n + 1 :]
        ]
    else:
        queries = [*normalize_queries(costs, stations, 0.0, 1)]
    if not queries:
        raise ConfigError("no routes. Give at least two stations")
    return queries


def _make_distant_queries(costs: Costmap, count: int, seed: int) -> Sequence[Query]:
    """Return queries between the distant places of `locplan.planning.describe_map`.

    If they are too few, more are drawn at random in the main part of the map.
    """
    description = describe_map(costs.grid, robot=costs.robot_radius)
    if not description.pairs:
        return _number_queries(random_queries(costs, count, seed, min_distance=0.5))
    ends = [(room_pair.start, room_pair.goal) for room_pair in description.pairs[:count]]
    queries = [Query("", (start.x, start.y), (goal.x, goal.y)) for start, goal in ends]
    (x, y), (to_x, to_y) = (room_pair[:2] for room_pair in (queries[0].start, queries[0].goal))
    if len(queries) < count:
        min_distance = min(10.0, math.hypot(x - to_x, y - to_y) / 2)
        main = replace(costs, density=np.where(description.main_part, costs.density, np.inf))
        queries += random_queries(main, count - len(queries), seed, min_distance=min_distance)
    return _number_queries(queries)


def _number_queries(queries: Sequence[Query]) -> list[Query]:
    """Return the queries named by the numbers of their places."""
    numbers: dict[Any, int] = {}

    def number(end: Any) -> int:
        return numbers.setdefault(tuple(end[:2]), len(numbers) + 1)

    return [Query(f"{number(q.start)} to {number(q.goal)}", q.start, q.goal) for q in queries]

"""Simulated drives along the shortest and the localizability-aware path of many queries."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from locplan._support.intervals import (
    Interval,
    choose_digits,
    estimate_geometric_mean,
    estimate_mean,
    format_decimal,
    format_ratio,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.public import DrawableResult
from locplan._support.records import Result, Table, TableColumn, extract_values
from locplan._support.tables import format_table, make_file_name, nan_to_none
from locplan.errors import ConfigError
from locplan.field.config import equip_robot
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.plans import AWARE, SHORTEST, plan_with_shortest
from locplan.planning.queries import Query
from locplan.robots.robot import Robot
from locplan.simulation.driver import drive_open
from locplan.simulation.drives import (
    DEFAULT_DRIVES,
    DRIVE_COLUMNS,
    LOST_SHORT_TEXT,
    Drives,
    check_drive_count,
    compute_rmse_ratio,
)
from locplan.simulation.simulator import Simulator
from locplan.simulation.worlds import summarize_filter_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class QueryDrives:
    """Results of drives along both paths of one query."""

    query: Query
    """Start and goal of both paths."""
    length: tuple[float, float]
    """Lengths of the shortest and of the aware path [m]."""
    median_error: tuple[float, float]
    """Median error of the position along each path [m]."""
    lost: tuple[float, float]
    """Share of each path's drives that were lost."""
    off_at_end: tuple[float, float]
    """Share of each path's drives that were off at the end."""
    kept_rmse: tuple[float, float]
    """RMSE of each path's drives never lost [m]; NaN where all were."""
    rmse: tuple[float, float]
    """RMSE of the position along each path [m]."""
    summary: Mapping[str, object]
    """Summary of each path's drives, and the ratio of their RMSE, fit for JSON."""


def _make_column_pair(name: str, unit: str = "") -> tuple[TableColumn, TableColumn]:
    """Columns of a pair of values, of the shortest and of the aware path."""
    return (
        TableColumn(f"{name}_shortest", unit, value=lambda route: getattr(route, name)[0]),
        TableColumn(f"{name}_aware", unit, value=lambda route: getattr(route, name)[1]),
    )


COLUMNS = (
    TableColumn("query", value=lambda route: route.query.name),
    TableColumn("start_x", "m", value=lambda route: route.query.start[0]),
    TableColumn("start_y", "m", value=lambda route: route.query.start[1]),
    TableColumn("goal_x", "m", value=lambda route: route.query.goal[0]),
    TableColumn("goal_y", "m", value=lambda route: route.query.goal[1]),
    *_make_column_pair("length", "m"),
    *_make_column_pair("median_error", "m"),
    *_make_column_pair("lost"),
    *_make_column_pair("off_at_end"),
    *_make_column_pair("kept_rmse", "m"),
    *_make_column_pair("rmse", "m"),
)
"""Columns of a `Route`."""


@dataclass(frozen=True, eq=False, repr=False)
class Routes(DrawableResult):
    """Drives along both paths of many queries on one map; intervals are over the queries."""

    grid: OccupancyGrid
    """The map."""
    routes: Sequence[QueryDrives]
    """Results of each query that has a path."""
    description: Mapping[str, object]
    """Settings of the costs, the filter and the worlds, fit for JSON."""

    def __repr__(self) -> str:
        return f"Routes({self.grid.name or 'map'}, {len(self.routes)} queries, {self.verdict})"

    @property
    def length_ratio(self) -> Interval:
        """Ratio of the aware to the shortest path's length: geometric mean over the queries."""
        return estimate_geometric_mean(np.divide(*self.get_value_pairs("length").T[::-1]))

    @property
    def rmse_ratio(self) -> Interval:
        """Ratio of the aware to the shortest path's position RMSE: geometric mean."""
        return estimate_geometric_mean(np.divide(*self.get_value_pairs("rmse").T[::-1]))

    @property
    def median_error(self) -> tuple[float, float]:
        """Median error along the shortest and the aware paths: geometric means [m]."""
        return self._average_shortest_and_aware("median_error")

    @property
    def kept_rmse(self) -> tuple[float, float]:
        """RMSE of the drives that were not lost, along both kinds of paths: geometric means [m].

        They are over the queries of which both paths have such drives; NaN if there is none.
        """
        return self._average_shortest_and_aware("kept_rmse")

    @property
    def rmse(self) -> tuple[float, float]:
        """RMSE along the shortest and the aware paths: geometric means over the queries [m]."""
        return self._average_shortest_and_aware("rmse")

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives along the shortest and the aware paths: means over the queries."""
        return _pair_from_array(self.get_value_pairs("lost").mean(axis=0))

    @property
    def off_at_end(self) -> tuple[float, float]:
        """Share of drives off at the end along both kinds: means."""
        return _pair_from_array(self.get_value_pairs("off_at_end").mean(axis=0))

    @property
    def lost_difference(self) -> Interval:
        """Difference in the share of lost drives, aware minus shortest: mean over the queries."""
        return estimate_mean(np.diff(self.get_value_pairs("lost"))[:, 0])

    @property
    def verdict(self) -> str:
        """Effect of aware paths by `rmse_ratio`: helps, harms, unclear, or too few queries."""
        ratio = self.rmse_ratio
        if math.isnan(ratio.low):
            return "too few queries"
        if ratio.high < 1:
            return "helps"
        return "harms" if ratio.low > 1 else "unclear"

    def get_value_pairs(self, measure: str) -> Floats:
        """Values of the shortest and of the aware path of each query, (n, 2).

        Parameters
        ----------
        measure : str
            Name of the value in `Route`.
        """
        return np.array([getattr(route, measure) for route in self.routes])

    def _average_shortest_and_aware(self, measure: str) -> tuple[float, float]:
        """Geometric means over the queries of which both values are known; NaN without one."""
        pairs = self.get_value_pairs(measure)
        finite_pairs = pairs[~np.isnan(pairs).any(axis=1)]
        if not len(finite_pairs):
            return math.nan, math.nan
        return _pair_from_array(np.exp(np.log(finite_pairs).mean(axis=0)))

    def table(self) -> Table:
        """A row per query: both ends, and the errors along both paths."""
        return Table.from_records(COLUMNS, self.routes)

    def figure(self) -> Figure:
        """RMSE and share of lost drives of both paths of each query, and the mean ratios."""
        from locplan.simulation.figures import queries_figure

        return queries_figure(self)


@dataclass(frozen=True, eq=False, repr=False)
class RoutesOnMaps(Result):
    """Drives along both paths of queries on several maps."""

    is_drawable = False  # each map has a figure of its own
    files: ClassVar[ResultFiles] = ResultFiles(
        "queries",
        ("queries.json", "queries.csv"),
        purposes={
            "queries.csv": "a row per route",
        },
    )

    maps: tuple[Routes, ...]
    """The drives on each map."""

    def __iter__(self) -> Iterator[Routes]:
        return iter(self.maps)

    def __repr__(self) -> str:
        return f"RoutesOnMaps({len(self.maps)} maps)"

    def table(self) -> Table:
        """A row per query of each map."""
        rows = (
            (map_routes.grid.name, *row)
            for map_routes in self.maps
            for row in map_routes.table().rows
        )
        return Table((TableColumn("map"), *COLUMNS), tuple(rows))

    @staticmethod
    def pictures(maps: Sequence[str]) -> list[str]:
        """Return the names of the additional pictures.

        Parameters
        ----------
        maps : sequence of str
            Names of the maps.
        """
        return [
            f"{number:02}-{make_file_name(name or 'map')}.png"
            for number, name in enumerate(maps, 1)
        ]

    def summary(self) -> dict[str, object]:
        """Return all maps' results in numbers, fit for JSON; pairs are shortest and aware paths."""
        names = "length_ratio", "rmse_ratio", "lost", "off_at_end", "kept_rmse", "rmse"
        return {
            "maps": [
                nan_to_none(
                    {
                        **routes.description,
                        "verdict": routes.verdict,
                        "median_error": routes.median_error,
                        **{name: getattr(routes, name) for name in (*names, "lost_difference")},
                        "queries": [
                            {**asdict(route.query), **route.summary} for route in routes.routes
                        ],
                    }
                )
                for routes in self.maps
            ]
        }

    def _write(self, folder: Path, *related_results: Any) -> None:
        from locplan._support.drawing import save_figure

        self.table().write_csv(folder / "queries.csv")
        pictures = self.pictures([routes.grid.name for routes in self.maps])
        for name, routes in zip(pictures, self.maps, strict=True):
            save_figure(routes.figure(), folder / name)

    def report(self) -> str:
        """Table of both paths of many queries, one row per map."""
        return format_routes(self)


def format_routes(routes_on_maps: RoutesOnMaps) -> str:
    """Table of both paths of many queries, one row per map."""
    rows = []
    for routes in routes_on_maps:
        median, tracked_texts, rmse = (
            [format_decimal(error, choose_digits(error)) for error in pair]
            for pair in (routes.median_error, routes.kept_rmse, routes.rmse)
        )
        rows.append(
            [
                routes.grid.name,
                f"{100 * (routes.length_ratio.value - 1):+.1f} %",
                " -> ".join(median),
                "{:.0%} -> {:.0%}".format(*routes.lost),
                "{:.0%} -> {:.0%}".format(*routes.off_at_end),
                " -> ".join(tracked_texts),
                rmse[0],
                format_ratio(routes.rmse_ratio),
                routes.verdict,
            ]
        )
    columns = [
        "map",
        "length",
        "median",
        "lost",
        "off at\nthe end",
        "RMSE,\nkept",
        "RMSE",
    ]
    columns += ["ratio", "aware paths"]
    counts = sorted({len(routes.routes) for routes in routes_on_maps})
    queries = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    return (
        f"{format_table(columns, rows)}\nshortest -> aware paths of {queries} queries, geometric"
        " means;"
        f" errors of the\nposition [m]; lost: {LOST_SHORT_TEXT} at some time; off at the end: still"
        " so; kept: those\nnever lost; RMSE: of all drives along the shortest; ratio: of the RMSE,"
        " aware over\nshortest [95 %]"
    )


def simulate_queries(
    costs: Costmap,
    queries: Sequence[Query],
    robot: Robot | None = None,
    *,
    drives: int = DEFAULT_DRIVES,
    filter_map: OccupancyGrid | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Routes:
    """Drive the shortest and the aware path of each query.

    Parameters
    ----------
    costs : Costmap
        Costmap of a field, with the weight of the aware paths; the planner is any-angle.
    queries : sequence of Query
        Queries to drive; those without a path are left out.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your robot, such as from `Robot.load`.
    drives, filter_map, seed, threads, progress
        See `simulate`; the drives are those along each path.

    Returns
    -------
    Routes
        The errors along both paths of each query, and their ratios over the queries.

    Raises
    ------
    LocplanError
        If no query has a path, or a number is out of its range.
    """
    check_drive_count(drives)
    robot = equip_robot(robot, costs.settings.config if costs.settings else None)
    simulator = Simulator(
        costs.grid, robot, filter_map=filter_map, seed=seed, threads=threads, zones=costs.zones
    )
    paths_by_query = {}
    for query in queries:
        plans = plan_with_shortest(costs, query.start, query.goal)
        paths = {name: plan.path for name, plan in plans.items() if plan.path is not None}
        if len(paths) == 2:
            paths_by_query[query] = paths
    if not paths_by_query:
        raise ConfigError("no query has a path to drive; choose others, or a smaller robot radius")
    callbacks = split_progress(progress, [2 * drives] * len(paths_by_query))
    routes = [
        _make_route(query, drive_open(simulator, paths, range(drives), progress=part))
        for (query, paths), part in zip(paths_by_query.items(), callbacks, strict=True)
    ]
    description = {
        **summarize_costs(costs),
        "drives": drives,
        "seed": seed,
        "robot": simulator.robot.summary(),
        **summarize_filter_map(filter_map),
    }
    return Routes(costs.grid, routes, description)


def _pair_from_array(means: Floats) -> tuple[float, float]:
    return float(means[0]), float(means[1])


def _make_route(query: Query, drives: Mapping[str, Drives]) -> QueryDrives:
    shortest, aware = drives[SHORTEST], drives[AWARE]
    ratio = compute_rmse_ratio(aware, shortest)
    names = "median_error", "lost_rate", "off_at_end_rate", "kept_rmse", "rmse"
    median, lost, off, tracked_errors, rmse = (
        (getattr(shortest, name).value, getattr(aware, name).value) for name in names
    )
    lengths = shortest.length, aware.length
    path_summaries = {
        "paths": {
            name: extract_values(DRIVE_COLUMNS, path_drives) for name, path_drives in drives.items()
        }
    }
    return QueryDrives(
        query,
        lengths,
        median,
        lost,
        off,
        tracked_errors,
        rmse,
        {**path_summaries, "rmse_ratio": [*ratio]},
    )

"""Recommendations for many queries, in processes or on a cluster, and their folders."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan import __version__
from locplan._support.checks import (
    check_file_path,
    check_integer,
    check_threads,
    is_integer,
    short_repr,
)
from locplan._support.intervals import Interval, estimate_geometric_mean
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback
from locplan._support.records import Table, TableColumn
from locplan._support.tables import check_file_names_differ, make_file_name
from locplan.errors import ConfigError, LocplanError
from locplan.field.config import equip_robot
from locplan.field.fisher import Fused
from locplan.field.store import load_or_compute
from locplan.planning.costmap import Costmap
from locplan.planning.named_maps import name_maps
from locplan.planning.plans import check_ends
from locplan.planning.queries import (
    MIN_DISTANCE,
    Query,
    check_random_query_options,
    normalize_queries,
)
from locplan.robots.robot import Robot
from locplan.simulation.drives import LOST_DISTANCE
from locplan.simulation.problem import RecommendationSettings, normalize_settings
from locplan.simulation.race import Candidate
from locplan.simulation.recommendation import Recommendation
from locplan.simulation.recommender import recommend_path
from locplan.simulation.worlds import check_single_map


@dataclass(frozen=True)
class MapRecommendation:
    """The recommendation for one query."""

    map: str
    """Name of the map."""
    query: Query
    """Start and goal."""
    recommendation: Recommendation
    """The recommended path, and the candidates of the query."""

    @property
    def lengths(self) -> tuple[float, float]:
        """Length of the shortest and of the recommended path [m]; NaN without a path."""
        return self._evaluate_shortest_and_recommended(lambda candidate: candidate.path.length)

    @property
    def errors(self) -> tuple[float, float]:
        """Typical error of both: geometric mean over the drives [m], or [rad] of headings."""
        return self._evaluate_shortest_and_recommended(
            lambda candidate: candidate.driven.error.value if candidate.driven else math.nan
        )

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives of both, 0..1; NaN without a path."""
        return self._evaluate_shortest_and_recommended(
            lambda candidate: candidate.driven.lost_rate.value if candidate.driven else math.nan
        )

    @property
    def off_at_end(self) -> tuple[float, float]:
        """Share of drives of both off at the end, 0..1; NaN without a path."""
        return self._evaluate_shortest_and_recommended(
            lambda candidate: (
                candidate.driven.off_at_end_rate.value if candidate.driven else math.nan
            )
        )

    def _evaluate_shortest_and_recommended(
        self, get_candidate_measure: Callable[[Candidate], float]
    ) -> tuple[float, float]:
        candidates = self.recommendation.shortest, self.recommendation.recommended_candidate
        first, second = (
            math.nan if candidate is None else get_candidate_measure(candidate)
            for candidate in candidates
        )
        return first, second


def _make_column_pair(name: str, values: str, unit: str = "") -> tuple[TableColumn, TableColumn]:
    """Return the columns of a pair of values, of the shortest and of the recommended path."""
    shortest = TableColumn(
        f"{name}_shortest",
        unit,
        value=lambda map_recommendation: getattr(map_recommendation, values)[0],
    )
    return shortest, TableColumn(
        f"{name}_chosen",
        unit,
        value=lambda map_recommendation: getattr(map_recommendation, values)[1],
    )


@dataclass(frozen=True, repr=False)
class Recommendations:
    """Recommendations for many queries; intervals are over the queries that have a path.

    Errors come from the drives that confirmed the recommendation. Those along detours are about
    10 % too small.
    """

    files: ClassVar[ResultFiles] = ResultFiles(
        "choices",
        ("choices.csv",),
        purposes={
            "choices.csv": "the recommended path of each query",
        },
    )
    """The file that `save` writes next to a folder for each recommendation."""

    recommendations: tuple[MapRecommendation, ...]
    """Recommendations in the order of the maps and of their queries."""

    def __repr__(self) -> str:
        ratio = f"error {self.error_ratio.value:.2f} of the shortest's"
        return f"Recommendations({len(self)} queries, {self.n_detours} detours, {ratio})"

    def __len__(self) -> int:
        return len(self.recommendations)

    def __iter__(self) -> Iterator[MapRecommendation]:
        return iter(self.recommendations)

    def __getitem__(self, number: int) -> MapRecommendation:
        return self.recommendations[number]

    @property
    def solved_recommendations(self) -> tuple[MapRecommendation, ...]:
        """Recommendations for the queries that have a path."""
        return tuple(
            map_recommendation
            for map_recommendation in self.recommendations
            if map_recommendation.recommendation.candidates
        )

    @property
    def n_detours(self) -> int:
        """Number of queries for which another path than the shortest is recommended."""
        return sum(
            map_recommendation.recommendation.best > 0
            for map_recommendation in self.solved_recommendations
        )

    @property
    def error_ratio(self) -> Interval:
        """Error of the recommended relative to the shortest paths: geometric mean over queries."""
        return estimate_geometric_mean(
            np.array([e.errors[1] / e.errors[0] for e in self.solved_recommendations])
        )

    @property
    def length_ratio(self) -> Interval:
        """Length of the recommended relative to the shortest paths: geometric mean."""
        return estimate_geometric_mean(
            np.array([e.lengths[1] / e.lengths[0] for e in self.solved_recommendations])
        )

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives along the shortest and recommended paths: means over queries."""
        return self._average_shortest_and_recommended("lost")

    @property
    def off_at_end(self) -> tuple[float, float]:
        """Share of drives off at the end along both: means."""
        return self._average_shortest_and_recommended("off_at_end")

    def _average_shortest_and_recommended(self, measure: str) -> tuple[float, float]:
        value_pairs = np.array(
            [
                getattr(map_recommendation, measure)
                for map_recommendation in self.solved_recommendations
            ]
            or [(math.nan, math.nan)]
        )
        shortest, recommended = value_pairs.mean(axis=0).tolist()
        return shortest, recommended

    def table(self) -> Table:
        """Return a row per query: its ends, and figures of the shortest and recommended path."""
        columns = (
            TableColumn("map", title="map"),
            TableColumn("query", title="query", value=lambda row: row.query.name),
            TableColumn("start_x", "m", value=lambda row: row.query.start[0]),
            TableColumn("start_y", "m", value=lambda row: row.query.start[1]),
            TableColumn("goal_x", "m", value=lambda row: row.query.goal[0]),
            TableColumn("goal_y", "m", value=lambda row: row.query.goal[1]),
            TableColumn("chosen", value=lambda row: row.recommendation.recommended_name),
            *_make_column_pair("length", "lengths", "m"),
            *_make_column_pair("error", "errors"),
            *(
                map_recommendation
                for name in ("lost", "off_at_end")
                for map_recommendation in _make_column_pair(name, name)
            ),
        )
        return Table.from_records(columns, self.recommendations)

    def report(self) -> str:
        """Return the gain of the recommended paths as text, a row per map and one for all maps."""
        names = dict.fromkeys(map_recommendation.map for map_recommendation in self)
        groups = {name: Recommendations(tuple(e for e in self if e.map == name)) for name in names}
        if len(groups) > 1:
            groups["all maps"] = self
        columns = (
            *(TableColumn(name, title=name) for name in ("map", "queries")),
            TableColumn("left", title="detours", digits=0),
            TableColumn("length_ratio", title="length"),
            TableColumn("error_ratio", title="error", interval=True),
            TableColumn("off", title="lost,\noff at the end"),
        )
        rows = []
        for name, group in groups.items():
            rate_pairs = group.lost, group.off_at_end
            rates = (
                "{:.0%} -> {:.0%}".format(*map_recommendation)
                if group.solved_recommendations
                else "-"
                for map_recommendation in rate_pairs
            )
            solved, shares = (
                f"{len(group.solved_recommendations)} of {len(group)}",
                "\n".join(rates),
            )
            ratios = group.length_ratio.value, group.error_ratio
            rows.append((name, solved, group.n_detours, *ratios, shares))
        return (
            f"{Table(columns, tuple(rows))}\n"
            "detours: recommended paths other than the shortest\n"
            "length, error: ratio of the recommended to the shortest path [95 % interval]\n"
            f"lost, off at the end: by more than {LOST_DISTANCE:g} m"
        )

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the table and a folder per recommendation, for ``locplan export --choice``.

        Parameters
        ----------
        folder : path
            Folder of the recommendations, which need not exist. Each subfolder has the query's
            name, preceded by the map's name if there are several maps.
        force : bool, default False
            True replaces results in the folder; unrelated files stay.

        Raises
        ------
        LocplanError
            If a file cannot be written, or the names of two queries make the same file.
        """
        target = check_file_path("a folder of recommendations", folder)
        several = len({map_recommendation.map for map_recommendation in self}) > 1
        names = [
            f"{map_recommendation.map} {map_recommendation.query.name}"
            if several
            else map_recommendation.query.name
            for map_recommendation in self
        ]
        check_file_names_differ("queries", names)
        homes = dict(zip(map(make_file_name, names), self, strict=True))
        with self.files.make_output(target, force=force).writing() as new:
            for name, map_recommendation in homes.items():
                (new / name).mkdir()
                map_recommendation.recommendation.write_files(new / name)
            self.table().write_csv(new / "choices.csv")


def read_recommendations(*paths: str | os.PathLike[str]) -> dict[str, Recommendation]:
    """Read recommendations from their folders, by the names of these folders.

    Parameters
    ----------
    *paths : path
        Folders that `Recommendation.save` wrote, or their choice.json; or folders of such folders,
        as `Recommendations.save` writes them.

    Raises
    ------
    LocplanError
        If a folder has no recommendation, one cannot be read, or two folders have the same name.
    """
    recommendations: dict[str, Recommendation] = {}
    for path in (check_file_path("a folder of a recommendation", path_like) for path_like in paths):
        folders = [path.parent if path.is_file() else path]
        if path.is_dir() and not (path / CHOICE).exists():
            folders = sorted(file.parent for file in path.glob(f"*/{CHOICE}"))
        if not folders:
            raise LocplanError(
                f"{path}: has no recommendation; name a folder that plan or save wrote"
            )
        for folder in folders:
            name = folder.resolve().name
            if name in recommendations:
                raise LocplanError(f"two folders of recommendations are called {name}; rename one")
            recommendations[name] = Recommendation.load(path if path.is_file() else folder)
    return recommendations


CHOICE = f"{Recommendation.kind}{Recommendation.suffix}"
"""The file of a recommendation in its folder."""

IN_FLIGHT = 64
"""Maximum number of queries at an executor at once, which bounds the memory of their maps."""


class _QueryCase(NamedTuple):
    """A query with its map."""

    map: str
    costs: Costmap
    query: Query
    seed: int


def recommend_paths(
    maps: Any,
    queries: Any = 10,
    robot: Robot | None = None,
    *,
    settings: RecommendationSettings | None = None,
    min_distance: float = MIN_DISTANCE,
    query_seed: int = 1,
    executor: Executor | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Recommendations:
    """Recommend a path for each of many queries, as `recommend_path` does.

    The fields of the maps are computed, or read from the cache, in this process.

    Parameters
    ----------
    maps : map, or sequence or mapping of them
        Each map is a map_server YAML file, an OccupancyGrid or a Costmap; a mapping names them.
    queries : int, path, sequence, or mapping of them by map, default 10
        Number of random queries, 1 to 10,000 a map; a CSV file of name, start_x, start_y, goal_x,
        goal_y [m], or of name, x, y [m] of stations, each pair a query; `Query` objects, or
        (start, goal) pairs [m].
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your robot, such as from `Robot.load`.
    settings : RecommendationSettings, optional
        Limits of the candidates, the number of drives, and the error that decides.
    executor : concurrent.futures.Executor, optional
        Executor that runs each query as one task on one thread: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan. By default this
        process runs the queries one by one. The results do not depend on it.
    seed : int, default 1
        Seed of the random numbers of the first query, >= 0; it rises by 1 per query, so that the
        queries are independent.
    min_distance : float, default 10.0
        Minimum straight distance between start and goal of random queries [m], >= 0. Lower it on a
        small map.
    query_seed : int, default 1
        Seed of the random queries, >= 0.
    threads : int, optional
        Number of threads of this process, all cores by default.
    progress : callable, optional
        Called with (done, total) queries.

    Returns
    -------
    Recommendations
        The recommendations in the order of the maps and of their queries.

    Raises
    ------
    PoseError
        If a start or goal lies outside the map or in a blocked cell.
    LocplanError
        If a setting is out of its range, a path cannot be driven, or the executor fails.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> robot = robot.with_settings({"min_particles": 100, "max_particles": 100})
    >>> ends = [((2.0, 3.0), (8.0, 3.0)), ((8.0, 3.0), (2.0, 3.0))]
    >>> settings = RecommendationSettings(drives=4)
    >>> blank = locplan.Costmap.blank(grid)
    >>> recommendations = recommend_paths(blank, ends, robot, settings=settings)
    >>> [case.recommendation.verdict for case in recommendations]
    ['undecided', 'undecided']
    """
    check_threads(threads)
    maps_by_name = name_maps(maps)
    settings = normalize_settings(settings)
    check_single_map(settings.filter_map, maps_by_name)
    check_random_query_options(queries if is_integer(queries) else 1, query_seed, min_distance)
    check_integer("seed", seed, 0)
    cases: list[_QueryCase] = []
    for name, map_or_costmap in maps_by_name.items():
        if isinstance(map_or_costmap, Costmap):
            costs = map_or_costmap
        else:
            field = load_or_compute(
                map_or_costmap, Fused(equip_robot(robot).known_lidar), threads=threads
            )
            costs = Costmap.from_field(field, robot=(robot or Robot()).radius)
        if isinstance(queries, Mapping) and name not in queries:
            raise ConfigError(f"there are no queries for map {short_repr(name)}")
        map_queries = queries[name] if isinstance(queries, Mapping) else queries
        for query in normalize_queries(costs, map_queries, min_distance, query_seed):
            with _name_query_in_errors(name, query):
                begin, end = check_ends(costs, query.start[:2], query.goal[:2])
                if begin == end:
                    raise ConfigError("start and goal are one place")
            cases.append(_QueryCase(name, costs, query, seed + len(cases)))
    if not cases:
        raise ConfigError("there is no query; give at least one")
    recommendations = []
    local_recommendations = (
        recommend_for_case(__version__, case, robot, settings, threads) for case in cases
    )
    recommendation_iterator = (
        local_recommendations
        if executor is None
        else _recommend_with_executor(executor, cases, robot, settings)
    )
    for case in cases:
        with _name_query_in_errors(case.map, case.query):
            recommendation = dataclasses.replace(next(recommendation_iterator), costs=case.costs)
        recommendations.append(MapRecommendation(case.map, case.query, recommendation))
        if progress:
            progress(len(recommendations), len(cases))
    return Recommendations(tuple(recommendations))


def _recommend_with_executor(
    executor: Executor,
    cases: list[_QueryCase],
    robot: Robot | None,
    settings: RecommendationSettings,
) -> Iterator[Recommendation]:
    """Yield the recommendations of an executor in the order of the cases."""
    running: deque[Future[Recommendation]] = deque()
    waiting = iter(cases)
    try:
        while True:
            while len(running) < IN_FLIGHT and (case := next(waiting, None)):
                task = executor.submit(recommend_for_case, __version__, case, robot, settings)
                running.append(task)
            if not running:
                return
            yield running.popleft().result()
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own error for dead workers
        error_text = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise LocplanError(f"the executor failed ({error_text})") from error
    finally:
        for task in running:
            task.cancel()


def recommend_for_case(
    version: str,
    case: _QueryCase,
    robot: Robot | None,
    settings: RecommendationSettings,
    threads: int | None = 1,
) -> Recommendation:
    """Recommend a path for a query in a worker of the same version, without its costmap."""
    if version != __version__:
        raise ConfigError(
            f"a worker has locplan {__version__}, not {version}; install the same one there"
        )
    costs = case.costs
    recommendation = recommend_path(
        costs.grid,
        case.query.start[:2],
        case.query.goal[:2],
        equip_robot(robot, costs.settings.config if costs.settings else None),
        costs=costs,
        settings=settings,
        seed=case.seed,
        threads=threads,
    )
    return dataclasses.replace(recommendation, costs=None)


@contextmanager
def _name_query_in_errors(name: str, query: Query) -> Iterator[None]:
    """Name the map and the query in errors."""
    try:
        yield
    except LocplanError as error:
        place = f"map {short_repr(name)}, query {short_repr(query.name)}"
        raise type(error)(f"{place}: {error}") from None

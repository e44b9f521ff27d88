"""The simulated choice for many queries: here, in processes, or on a cluster."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, NamedTuple

from locplan import __version__
from locplan._util.checks import check_threads, is_whole, shown, whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, named_maps
from locplan.errors import ConfigError, LocplanError
from locplan.field import Fused, equipped, load_or_compute
from locplan.planners import Query, check_ends, check_random, queries_of
from locplan.robots import Robot
from locplan.simulation._arguments import check_of_one_map
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._choices import Choices, MapChoice
from locplan.simulation.choice._choose import choose
from locplan.simulation.choice._settings import ChoiceSettings

LEAST_DISTANCE = 10.0
"""Least straight distance between start and goal of random queries [m]."""
IN_FLIGHT = 64
"""Greatest number of choices at an executor at once, which bounds the memory of their maps."""


class _Case(NamedTuple):
    """A query with its map."""

    map: str
    costs: Costmap
    query: Query
    seed: int


def choose_many(
    maps: Any,
    queries: Any = 10,
    robot: Robot | None = None,
    *,
    executor: Executor | None = None,
    seed: int = 1,
    least_distance: float = LEAST_DISTANCE,
    query_seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> Choices:
    """Choose among driven paths, as `choose` does, for many queries.

    The fields of the maps are computed, or read from the cache, in this process.

    Parameters
    ----------
    maps : map, or sequence or mapping of them
        Each map is a map_server YAML file, an OccupancyGrid or a Costmap; a mapping names them.
    queries : int, path, sequence, or mapping of them by map, default 10
        Number of random queries, 1 to 10,000 a map; a CSV file of name, start_x, start_y, goal_x,
        goal_y [m], or of name, x, y [m] of stations, each two of which are one; `Query` objects, or
        (start, goal) pairs [m].
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    executor : concurrent.futures.Executor, optional
        Executor that runs each choice as one task on one thread: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan. By default the
        choices are made here, one after the other. The results do not depend on it.
    seed : int, default 1
        Seed of the random numbers of the first choice, >= 0; that of each further one is greater
        by 1, so that the choices are independent.
    least_distance : float, default 10.0
        Least straight distance between start and goal of random queries [m], >= 0. Lower it on a
        small map.
    query_seed : int, default 1
        Seed of the random queries, >= 0.
    threads : int, optional
        Number of threads of this process, all cores by default.
    progress : callable, optional
        Called with (done, total) queries.
    **settings
        Fields of `ChoiceSettings`, see `choose`.

    Returns
    -------
    Choices
        The choices in the order of the maps and of their queries.

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
    >>> ends = [((2.0, 3.0), (38.0, 3.0)), ((38.0, 3.0), (2.0, 3.0))]
    >>> choices = choose_many(locplan.Costmap.blank(grid), ends, drives=8)
    >>> [each.choice.verdict for each in choices]
    ['clearly better', 'clearly better']
    """
    check_threads(threads)
    named = named_maps(maps)
    check_of_one_map(ChoiceSettings.of(settings).filter_map, named)
    check_random(queries if is_whole(queries) else 1, query_seed, least_distance)
    whole("seed", seed, 0)
    asked: dict[str, Any] = {"robot": robot, **settings}
    cases: list[_Case] = []
    for name, given in named.items():
        if isinstance(given, Costmap):
            costs = given
        else:
            field = load_or_compute(given, Fused.of(equipped(robot).known_lidar), threads=threads)
            costs = Costmap.from_field(given, field, robot_radius=(robot or Robot()).radius)
        if isinstance(queries, Mapping) and name not in queries:
            raise ConfigError(f"there are no queries for map {shown(name)}")
        wanted = queries[name] if isinstance(queries, Mapping) else queries
        for query in queries_of(costs, wanted, least_distance, query_seed):
            with _where(name, query):
                begin, end = check_ends(costs, query.start[:2], query.goal[:2])
                if begin == end:
                    raise ConfigError("start and goal are one place")
            cases.append(_Case(name, costs, query, seed + len(cases)))
    if not cases:
        raise ConfigError("there is no query; give at least one")
    made = _here(cases, asked, threads) if executor is None else _at(executor, cases, asked)
    choices = []
    for case, choice in zip(cases, made, strict=True):
        choices.append(MapChoice(case.map, case.query, choice))
        if progress:
            progress(len(choices), len(cases))
    return Choices(tuple(choices))


def _here(cases: list[_Case], asked: dict[str, Any], threads: int | None) -> Iterator[Choice]:
    """The choices, made one after the other with threads inside."""
    for case in cases:
        with _where(case.map, case.query):
            yield _chosen(case, asked, threads)


def _at(executor: Executor, cases: list[_Case], asked: dict[str, Any]) -> Iterator[Choice]:
    """The choices of an executor in the order of the cases, with the caller's own costmaps."""
    running: deque[tuple[_Case, Future[Choice]]] = deque()
    waiting = iter(cases)
    try:
        while True:
            while len(running) < IN_FLIGHT and (case := next(waiting, None)):
                with _one_line_errors(case):
                    running.append((case, executor.submit(chosen, __version__, case, asked)))
            if not running:
                return
            case, task = running.popleft()
            with _where(case.map, case.query), _one_line_errors(case):
                found = task.result()
            yield dataclasses.replace(found, costs=case.costs)
    finally:
        for _, task in running:
            task.cancel()


def chosen(version: str, case: _Case, asked: dict[str, Any]) -> Choice:
    """Choose on a worker, which must have the same locplan; the costmap is not sent back."""
    if version != __version__:
        raise ConfigError(
            f"a worker has locplan {__version__}, not {version}; install the same one there"
        )
    nowhere: Any = None
    return dataclasses.replace(_chosen(case, asked, 1), costs=nowhere)


def _chosen(case: _Case, asked: dict[str, Any], threads: int | None) -> Choice:
    start, goal = case.query.start[:2], case.query.goal[:2]
    config = case.costs.settings.config if case.costs.settings else None
    own = {**asked, "robot": equipped(asked["robot"], config)}
    return choose(
        case.costs.grid, start, goal, costs=case.costs, seed=case.seed, threads=threads, **own
    )


@contextmanager
def _where(name: str, query: Query) -> Iterator[None]:
    """Tell in errors which query they are about."""
    try:
        yield
    except LocplanError as error:
        where = f"map {shown(name)}, query {shown(query.name)}"
        raise type(error)(f"{where}: {error}") from None


@contextmanager
def _one_line_errors(case: _Case) -> Iterator[None]:
    """Turn any failure of a foreign executor into an error of one line."""
    try:
        yield
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own error for dead workers
        what = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise LocplanError(f"the executor failed at {case.query.name} ({what})") from error

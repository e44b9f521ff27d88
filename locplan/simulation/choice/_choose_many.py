"""The simulated choice for many queries, here, in processes or on a cluster."""

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
from locplan.simulation._worlds import check_of_one_map
from locplan.simulation.choice._ask import ChoiceSettings
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._choices import Choices, MapChoice
from locplan.simulation.choice._choose import choose

IN_FLIGHT = 64
"""Maximum number of choices at an executor at once, which bounds the memory of their maps."""


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
    min_distance: float = 10.0,
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
    min_distance : float, default 10.0
        Minimum straight distance between start and goal of random queries [m], >= 0. Lower it on a
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
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0)).changed({"max_particles": 500})
    >>> ends = [((2.0, 3.0), (38.0, 3.0)), ((38.0, 3.0), (2.0, 3.0))]
    >>> choices = choose_many(locplan.Costmap.blank(grid), ends, robot=robot, drives=4)
    >>> [each.choice.verdict for each in choices]
    ['better', 'better']
    """
    check_threads(threads)
    named = named_maps(maps)
    check_of_one_map(ChoiceSettings.of(settings).filter_map, named)
    check_random(queries if is_whole(queries) else 1, query_seed, min_distance)
    whole("seed", seed, 0)
    asked: dict[str, Any] = {**settings, "robot": robot}
    cases: list[_Case] = []
    for name, given in named.items():
        if isinstance(given, Costmap):
            costs = given
        else:
            field = load_or_compute(given, Fused(equipped(robot).known_lidar), threads=threads)
            costs = Costmap.from_field(given, field, robot=(robot or Robot()).radius)
        if isinstance(queries, Mapping) and name not in queries:
            raise ConfigError(f"there are no queries for map {shown(name)}")
        wanted = queries[name] if isinstance(queries, Mapping) else queries
        for query in queries_of(costs, wanted, min_distance, query_seed):
            with _where(name, query):
                begin, end = check_ends(costs, query.start[:2], query.goal[:2])
                if begin == end:
                    raise ConfigError("start and goal are one place")
            cases.append(_Case(name, costs, query, seed + len(cases)))
    if not cases:
        raise ConfigError("there is no query; give at least one")
    choices = []
    here = (chosen(__version__, case, {**asked, "threads": threads}) for case in cases)
    made = here if executor is None else _at(executor, cases, asked)
    for case in cases:
        with _where(case.map, case.query):
            choice = dataclasses.replace(next(made), costs=case.costs)
        choices.append(MapChoice(case.map, case.query, choice))
        if progress:
            progress(len(choices), len(cases))
    return Choices(tuple(choices))


def _at(executor: Executor, cases: list[_Case], asked: dict[str, Any]) -> Iterator[Choice]:
    """The choices of an executor in the order of the cases."""
    running: deque[Future[Choice]] = deque()
    waiting = iter(cases)
    try:
        while True:
            while len(running) < IN_FLIGHT and (case := next(waiting, None)):
                running.append(executor.submit(chosen, __version__, case, asked))
            if not running:
                return
            yield running.popleft().result()
    except LocplanError:
        raise
    except Exception as error:  # each executor has its own error for dead workers
        what = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")[:200]
        raise LocplanError(f"the executor failed ({what})") from error
    finally:
        for task in running:
            task.cancel()


def chosen(version: str, case: _Case, asked: dict[str, Any]) -> Choice:
    """Choose where the same locplan is, on one thread by default; no costmap is sent back."""
    if version != __version__:
        raise ConfigError(
            f"a worker has locplan {__version__}, not {version}; install the same one there"
        )
    costs, ends = case.costs, (case.query.start[:2], case.query.goal[:2])
    robot = equipped(asked["robot"], costs.settings.config if costs.settings else None)
    about = {"threads": 1, **asked, "robot": robot, "seed": case.seed, "costs": costs}
    return dataclasses.replace(choose(costs.grid, *ends, **about), costs=None)


@contextmanager
def _where(name: str, query: Query) -> Iterator[None]:
    """Tell in errors which query they are about."""
    try:
        yield
    except LocplanError as error:
        where = f"map {shown(name)}, query {shown(query.name)}"
        raise type(error)(f"{where}: {error}") from None

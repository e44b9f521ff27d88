"""The simulated choice for many queries, here, in processes or on a cluster; what it brings."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from locplan import __version__
from locplan._util.checks import check_threads, is_whole, shown, whole
from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.progress import ProgressCallback
from locplan._util.records import Column, Table
from locplan._util.tables import finite
from locplan.costs import Costmap, named_maps
from locplan.errors import ConfigError, LocplanError
from locplan.field import Fused, equipped, load_or_compute
from locplan.planners import Query, check_ends, check_random, queries_of
from locplan.robots import Robot
from locplan.simulation._drives import LOST, OFF
from locplan.simulation._worlds import check_of_one_map
from locplan.simulation.choice._ask import ChoiceSettings
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._choose import choose
from locplan.simulation.choice._driven import Candidate

IN_FLIGHT = 64
"""Maximum number of choices at an executor at once, which bounds the memory of their maps."""


@dataclass(frozen=True)
class MapChoice:
    """The choice for one query."""

    map: str
    """Name of the map."""
    query: Query
    """Start and goal that were asked for."""
    choice: Choice
    """The candidates of the query, and the one to take."""

    @property
    def lengths(self) -> tuple[float, float]:
        """Length of the shortest and of the chosen path [m]; NaN without a path."""
        return self._both(lambda each: each.path.length)

    @property
    def errors(self) -> tuple[float, float]:
        """Typical error of both: geometric mean over the drives [m], or [rad] of headings."""
        return self._both(lambda each: each.driven.error.value if each.driven else math.nan)

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives of both, 0..1; NaN without a path."""
        return self._both(lambda each: each.driven.lost_rate.value if each.driven else math.nan)

    @property
    def off_at_goal(self) -> tuple[float, float]:
        """Share of drives of both off by more than 0.5 m at the goal, 0..1; NaN without a path."""
        return self._both(lambda each: each.driven.off_at_goal.value if each.driven else math.nan)

    def _both(self, value: Callable[[Candidate], float]) -> tuple[float, float]:
        both = self.choice.shortest, self.choice.chosen
        first, second = (math.nan if each is None else value(each) for each in both)
        return first, second


def _pair(name: str, values: str, unit: str = "") -> tuple[Column, Column]:
    """Columns of a pair of values, of the shortest and of the chosen path."""
    shortest = Column(f"{name}_shortest", unit, value=lambda each: getattr(each, values)[0])
    return shortest, Column(f"{name}_chosen", unit, value=lambda each: getattr(each, values)[1])


@dataclass(frozen=True, repr=False)
class Choices:
    """Choices for many queries; intervals are over the queries that have a path.

    Errors are those of the drives that confirmed the choice: those of paths that were taken are
    promised some 10 % too small.
    """

    choices: tuple[MapChoice, ...]
    """Choices in the order of the maps and of their queries."""

    def __repr__(self) -> str:
        ratio = f"error {self.error_ratio.value:.2f} of the shortest's"
        return f"Choices({len(self)} queries, {self.left} left the shortest, {ratio})"

    def __len__(self) -> int:
        return len(self.choices)

    def __iter__(self) -> Iterator[MapChoice]:
        return iter(self.choices)

    def __getitem__(self, number: int) -> MapChoice:
        return self.choices[number]

    @property
    def solved(self) -> tuple[MapChoice, ...]:
        """Choices for the queries that have a path."""
        return tuple(each for each in self.choices if each.choice.candidates)

    @property
    def left(self) -> int:
        """Number of queries for which another path than the shortest is recommended."""
        return sum(each.choice.best > 0 for each in self.solved)

    @property
    def error_ratio(self) -> Interval:
        """Ratio of the chosen paths' error to the shortest's: geometric mean over the queries."""
        return of_geometric_mean(np.array([e.errors[1] / e.errors[0] for e in self.solved]))

    @property
    def length_ratio(self) -> Interval:
        """Ratio of the chosen paths' length to the shortest's: geometric mean."""
        return of_geometric_mean(np.array([e.lengths[1] / e.lengths[0] for e in self.solved]))

    @property
    def lost(self) -> tuple[float, float]:
        """Share of lost drives along the shortest and the chosen paths: means over the queries."""
        return self._means("lost")

    @property
    def off_at_goal(self) -> tuple[float, float]:
        """Share of drives off by more than 0.5 m at the goal along both: means."""
        return self._means("off_at_goal")

    def _means(self, name: str) -> tuple[float, float]:
        both = np.array([getattr(each, name) for each in self.solved] or [(math.nan, math.nan)])
        shortest, chosen = both.mean(axis=0).tolist()
        return shortest, chosen

    def table(self) -> Table:
        """A row per query: both ends, and the figures of the shortest and of the chosen path."""
        columns = (
            Column("map", title="map"),
            Column("query", title="query", value=lambda each: each.query.name),
            Column("start_x", "m", value=lambda each: each.query.start[0]),
            Column("start_y", "m", value=lambda each: each.query.start[1]),
            Column("goal_x", "m", value=lambda each: each.query.goal[0]),
            Column("goal_y", "m", value=lambda each: each.query.goal[1]),
            Column("chosen", value=lambda each: each.choice.taken),
            *_pair("length", "lengths", "m"),
            *_pair("error", "errors"),
            *(each for name in ("lost", "off_at_goal") for each in _pair(name, name)),
        )
        return Table.of(columns, self.choices)

    def summary(self) -> dict[str, object]:
        """What the choices bring, and each of them, fit for JSON; shortest before chosen."""
        over_queries = "error_ratio", "length_ratio", "lost", "off_at_goal"
        about = {
            "queries": len(self),
            "solved": len(self.solved),
            "left_the_shortest": self.left,
            **{name: list(getattr(self, name)) for name in over_queries},
            "choices": [
                {"map": each.map, "query": each.query.name, **each.choice.summary()}
                for each in self.choices
            ],
        }
        return finite(about)

    def report(self) -> str:
        """Text of what the choices bring, one row per map and one of all maps."""
        names = dict.fromkeys(each.map for each in self)
        groups = {name: Choices(tuple(e for e in self if e.map == name)) for name in names}
        if len(groups) > 1:
            groups["all maps"] = self
        columns = (
            *(Column(name, title=name) for name in ("map", "queries")),
            Column("left", title="detours", digits=0),
            Column("length_ratio", title="length"),
            Column("error_ratio", title="error", interval=True),
            Column("off", title=f"off > {LOST:g} m,\nat the goal"),
        )
        rows = []
        for name, group in groups.items():
            both = group.lost, group.off_at_goal
            rates = ("{:.0%} -> {:.0%}".format(*each) if group.solved else "-" for each in both)
            solved, shares = f"{len(group.solved)} of {len(group)}", "\n".join(rates)
            ratios = group.length_ratio.value, group.error_ratio
            rows.append((name, solved, group.left, *ratios, shares))
        return (
            f"{Table(columns, tuple(rows))}\ndetours leave the shortest path; chosen over shortest,"
            f" by the drives that\nconfirmed it [95 % intervals]; off at the goal: by > {OFF:g} m"
        )


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
    >>> ends = [((2.0, 3.0), (38.0, 3.0)), ((38.0, 3.0), (2.0, 3.0))]
    >>> choices = choose_many(locplan.Costmap.blank(grid), ends, drives=8)
    >>> [each.choice.verdict for each in choices]
    ['clearly better', 'clearly better']
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

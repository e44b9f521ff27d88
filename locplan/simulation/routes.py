"""Simulated drives along the shortest and the aware path, of one query or of many."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan.about import about_costs
from locplan.comparison.queries import Query
from locplan.costmap import Costmap
from locplan.errors import ConfigError
from locplan.grid import OccupancyGrid
from locplan.intervals import Interval, of_geometric_mean, of_mean
from locplan.path import Path
from locplan.planners import plan_beside_shortest
from locplan.progress import ProgressCallback, in_turn
from locplan.simulation.drives import Drives, contrasts
from locplan.simulation.motion import poses_along
from locplan.simulation.settings import Amcl, Reality
from locplan.simulation.simulator import Simulator

DRIVES = 100
"""Along each path."""
SHORTEST, AWARE = "shortest", "localizability-aware"
"""The names of `locplan.planners.plan_beside_shortest`."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Drives along some paths on one map."""

    grid: OccupancyGrid
    paths: Mapping[str, Path]
    """By name; others are compared with the first."""
    drives: Mapping[str, Drives]
    """As many of each, the n-th of all in the same world with the same seed."""
    amcl: Amcl
    reality: Reality
    seed: int
    made_of: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """What the paths were planned on, fit for JSON."""

    def summary(self) -> dict[str, Any]:
        """Errors of each path, and the ratios of their RMSE to the first's, fit for JSON."""
        return {
            **(self.made_of or {"map": {"name": self.grid.name, "digest": self.grid.digest}}),
            "paths": {name: each.summary() for name, each in self.drives.items()},
            "rmse_ratio": {name: list(ratio) for name, ratio in contrasts(self.drives).items()},
            "seed": self.seed,
            "amcl": dataclasses.asdict(self.amcl),
            "reality": dataclasses.asdict(self.reality),
        }


def simulate(
    grid: OccupancyGrid,
    paths: Mapping[str, Path],
    *,
    amcl: Amcl | None = None,
    reality: Reality | None = None,
    drives: int = DRIVES,
    seed: int = 1,
    threads: int | None = None,
    made_of: Mapping[str, Any] | None = None,
    progress: ProgressCallback | None = None,
) -> Simulation:
    """Drive some paths of one map with a particle filter.

    The robot follows the path exactly, whatever the filter thinks.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : mapping of str to Path
        By name, each within the free cells.
    amcl, reality : optional
        The filter, and what it is up against.
    drives : int
        Along each path, at least 2.
    seed : int
        Of all random numbers; the same gives the same result, on any number of threads.
    threads : int, optional
        All cores by default.
    made_of : mapping, optional
        What the paths were planned on, for the result's summary.
    progress : callable, optional
        Called with (done, total) drives.

    Raises
    ------
    LocplanError
        If there is no path, one leaves the free cells, or a number is out of its range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.environments.make("two_corridors", resolution=0.1)
    >>> straight = Path(np.array([[2.0, 3.0], [6.0, 3.0]]))
    >>> result = simulate(grid, {"straight": straight}, drives=4)
    >>> result.drives["straight"].lost_rate.value
    0.0
    """
    if drives < 2:
        raise ConfigError(f"drives must be at least 2, not {drives}")
    if not paths:
        raise ConfigError("there must be at least one path to drive")
    simulator = Simulator(grid, amcl, reality, seed=seed, threads=threads)
    lines = {name: poses_along(path, grid) for name, path in paths.items()}
    told = in_turn(progress, len(lines)) if progress else None
    driven = {
        name: simulator.drive_along(poses, drives, progress=told) for name, poses in lines.items()
    }
    return Simulation(
        grid, paths, driven, simulator.amcl, simulator.reality, seed, dict(made_of or {})
    )


def planned(costs: Costmap, query: Query) -> dict[str, Path]:
    """The shortest and the aware path of any-angle; nothing if there is no path."""
    plans = plan_beside_shortest(costs, query.start, query.goal, planner="any-angle")
    return {name: plan.path for name, plan in plans.items() if plan.path is not None}


@dataclass(frozen=True, eq=False)
class Routes:
    """Both paths of many queries on one map, driven."""

    grid: OccupancyGrid
    queries: Sequence[Query]
    simulations: Sequence[Simulation]
    """One of each query."""

    @property
    def length_ratio(self) -> Interval:
        """Length of the aware over that of the shortest path: geometric mean over the queries."""
        return of_geometric_mean(self._ratios(lambda s, name: s.paths[name].length))

    @property
    def rmse_ratio(self) -> Interval:
        """The same of the RMSE of the position."""
        return of_geometric_mean(self._ratios(lambda s, name: s.drives[name].rmse.value))

    def rmse(self, name: str) -> float:
        """Geometric mean over the queries [m]."""
        values = [each.drives[name].rmse.value for each in self.simulations]
        return float(np.exp(np.mean(np.log(values))))

    def lost_rate(self, name: str) -> Interval:
        """Share of the drives that were lost: mean over the queries, with Student's interval."""
        interval = of_mean(
            np.array([each.drives[name].lost_rate.value for each in self.simulations])
        )
        return Interval(interval.value, max(0.0, interval.low), min(1.0, interval.high))

    @property
    def lost_difference(self) -> Interval:
        """Of the shares lost, the aware path's less the shortest's: mean over the queries."""
        return of_mean(
            np.array(
                [
                    each.drives[AWARE].lost_rate.value - each.drives[SHORTEST].lost_rate.value
                    for each in self.simulations
                ]
            )
        )

    def _ratios(self, measure: Any) -> np.ndarray:
        return np.array([measure(s, AWARE) / measure(s, SHORTEST) for s in self.simulations])

    @property
    def verdict(self) -> str:
        """Whether the aware paths help here."""
        ratio, lost = self.rmse_ratio, self.lost_difference
        if ratio.high < 1 or lost.high < 0:
            mixed = ratio.low > 1 or lost.low > 0
            return "mixed" if mixed else "helps"
        if ratio.low > 1 or lost.low > 0:
            return "harms"
        return "no clear change"

    def summary(self) -> dict[str, Any]:
        """In numbers, fit for JSON."""
        return {
            "map": {"name": self.grid.name, "digest": self.grid.digest},
            "verdict": self.verdict,
            "length_ratio": list(self.length_ratio),
            "rmse_ratio": list(self.rmse_ratio),
            "lost_rate": {name: list(self.lost_rate(name)) for name in (SHORTEST, AWARE)},
            "lost_difference": list(self.lost_difference),
            "queries": [
                {"name": query.name, "start": list(query.start), "goal": list(query.goal)}
                | each.summary()
                for query, each in zip(self.queries, self.simulations, strict=True)
            ],
        }


def simulate_queries(
    costs: Costmap,
    queries: Sequence[Query],
    *,
    amcl: Amcl | None = None,
    reality: Reality | None = None,
    drives: int = DRIVES,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Routes:
    """Drive the shortest and the aware path of each query.

    Parameters
    ----------
    costs : Costmap
        What the aware paths are planned on; the planner is any-angle.
    queries : sequence of Query
        Those without a path are left out.

    The others are those of `simulate`.

    Raises
    ------
    LocplanError
        If no query has a path, or a number is out of its range.
    """
    ways = {query: planned(costs, query) for query in queries}
    found = {query: paths for query, paths in ways.items() if len(paths) == 2}
    if not found:
        raise ConfigError("no query has a path to drive; choose others, or a smaller robot radius")
    told = in_turn(progress, len(found)) if progress else None
    simulations = [
        simulate(
            costs.grid,
            paths,
            amcl=amcl,
            reality=reality,
            drives=drives,
            seed=seed,
            threads=threads,
            made_of=about_costs(costs),
            progress=told,
        )
        for paths in found.values()
    ]
    return Routes(costs.grid, list(found), simulations)

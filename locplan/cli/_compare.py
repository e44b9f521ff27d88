"""The command that compares planners."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import Computing, Criterion, Output
from locplan.cli._robot_options import FieldOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.comparison import RandomQueries


@typed.option_group("Planner")
class Compared(typed.Options):
    """The planners that are compared."""

    planner: Annotated[tuple[str, ...], Parameter(metavar="NAME[:OPTION=VALUE,...]")] = ()
    """Planner, such as BITstar:time_limit=2, or 'simulated choice', which drives its paths;
    repeatable; by default grid and any-angle, or lattice for an outline or a turning radius."""
    seeds: typed.Count = 1
    """Number of runs of a planner with random numbers; 1 by default."""
    time_limit: float | None = None
    """Time of OMPL's planners, in seconds; 5 by default."""
    baseline: str | None = None
    """Planner that the others are compared with; that for the robot if it is there."""


@typed.option_group("Computing")
class Running(typed.Options):
    """The resources of the runs."""

    workers: typed.Count | None = None
    """Number of runs at a time; all cores by default."""
    memory: float | None = None
    """Maximum memory of a run, in GB; by default the runs share 80 % of all."""
    patience: float = 300.0
    """Time after which a planner without a time limit counts as hanging, in seconds; 300 by
    default."""


@typed.command(
    "compare lab.yaml -o compared --planner any-angle --planner BITstar:time_limit=2 --seeds 5",
)
class compare(typed.ManyMaps, FieldOptions, Criterion, Compared, Computing, Running, Output):
    """Run planners side by side, and report which one is best, where and by how much."""

    maps: Annotated[
        list[Path],
        *typed.MAPS,
        Parameter(help="Maps: map_server YAML files, folders of them, or .map."),
    ] = dataclasses.field(kw_only=False)
    random: typed.Count | None = None
    """Number of random queries on each map; 10 by default."""
    min_distance: float | None = None
    """Minimum distance from start to goal of random queries, in metres; 5 by default."""
    seed: typed.Seed | None = None
    """Seed of random queries; 1 by default."""
    queries: Annotated[Path | None, typed.INPUT] = None
    """File of queries: CSV of name,start_x,start_y,goal_x,goal_y in metres, or of name,x,y of
    stations, each two of which are one, or MovingAI .scen."""
    ranges: typed.Ranges = None
    """Ranges of the lidar, for each of which the planners are compared, in metres."""

    weight: Annotated[tuple[float, ...], typed.under("Costs")] = ()
    """Detour accepted per degenerate metre, in metres; by default the estimator's own;
    repeatable."""
    output: Annotated[Path, typed.Target, typed.under("Output")] = dataclasses.field()
    """Folder for the report, tables and logs."""

    def __call__(self) -> None:
        comparison = locplan.comparison
        queries = self._queries()
        robot, made = self.robot_and_fields(self.ranges)
        planners = self.planner or None
        if planners:
            comparison.specs_of(planners)
        self.check_output(locplan.Comparison.files)
        with progress_bar("runs", "runs") as progress:
            execution = comparison.Execution(
                **self.given("workers", "time_limit", "patience"),
                memory=None if self.memory is None else self.memory * 1e9,
                journal=self.output / "runs.jsonl",  # every run as it came
                force=self.force,
                field_of=self.field_of,
                progress=progress,
            )
            result = locplan.compare(
                self.maps,
                planners,
                queries,
                robot,
                configs={f"{e.estimator.name}, {e.estimator.reach:g} m": e for e in made},
                weights=self.weight or None,
                seeds=range(1, self.seeds + 1),
                execution=execution,
                **self.given("criterion", "baseline"),
            )
        self.finish(dataclasses.replace(result, command=shlex.join(["locplan", *sys.argv[1:]])))

    def _queries(self) -> Path | RandomQueries:
        """The file of queries, or how they are drawn; a ConfigError if both were given."""
        if self.queries is None:
            drawn = self.given("min_distance", "seed")
            counted = {} if self.random is None else {"count": self.random}
            return locplan.comparison.RandomQueries(**counted, **drawn)
        if self.random is not None:
            raise ConfigError("--random and --queries exclude one another")
        self.refuse("with --queries", "min_distance", "seed")
        return self.queries

"""The command that compares planners."""

from __future__ import annotations

import dataclasses
import shlex
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import Computing, Criterion, Output
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.comparison import RandomQueries


@typed.option_group("Planner")
class Compared:
    """The planners that are compared."""

    planner: Annotated[tuple[str, ...], Parameter(metavar="NAME[:OPTION=VALUE,...]")] = ()
    """Planner, such as BITstar:time_limit=2, or 'simulated choice', which drives its paths;
    repeatable; grid and any-angle by default."""
    seeds: typed.Count = 1
    """Number of runs of a planner with random numbers; 1 by default."""
    time_limit: float | None = None
    """Time of OMPL's planners, in seconds; 5 by default."""
    baseline: str | None = None
    """Planner that the others are compared with; any-angle if it is there."""


@typed.option_group("Options")
class Queries:
    """The queries that the planners answer."""

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

    def kept(self) -> Path | RandomQueries:
        """The file of queries, or how they are drawn; a ConfigError if both were given."""
        own = {"min_distance": self.min_distance, "seed": self.seed}
        if self.queries is None:
            given = {"count": self.random, **own}.items()
            drawn: Any = {name: value for name, value in given if value is not None}
            return locplan.comparison.RandomQueries(**drawn)
        if self.random is not None:
            raise ConfigError("--random and --queries exclude one another")
        typed.refuse("with --queries", **own)
        return self.queries


@typed.option_group("Computing")
class Running:
    """The resources of the runs."""

    workers: typed.Count | None = None
    """Number of runs at a time; all cores by default."""
    memory: float | None = None
    """Maximum memory of a run, in GB; by default the runs share 80 % of all."""
    patience: float = 300.0
    """Time after which a planner without a time limit counts as hanging, in seconds; 300 by
    default."""
    resume: bool = False
    """Go on with an earlier comparison in --output where it ended."""


@typed.option_group("Costs")
class Weights:
    """The costs of a path."""

    weight: tuple[float, ...] = ()
    """Detour accepted per degenerate metre, in metres; by default the estimator's own;
    repeatable."""
    criterion: Criterion = None


@typed.option_group("Output")
class Report(Output):
    """Where the report goes."""

    output: Annotated[Path, typed.Target] = dataclasses.field()
    """Folder for the report, tables and logs."""


@typed.command(
    "compare lab.yaml -o compared --planner any-angle --planner BITstar:time_limit=2 --seeds 5",
)
def compare(
    maps: Annotated[
        list[Path],
        *typed.MAPS,
        Parameter(help="Maps: map_server YAML files, folders of them, or .map."),
    ],
    /,
    *,
    out: Report,
    compared: Compared = Compared(),
    asked: Queries = Queries(),
    costs: Weights = Weights(),
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    running: Running = Running(),
    computing: Computing = Computing(),
) -> None:
    """Run planners side by side, and report which one is best, where and by how much."""
    comparison = locplan.comparison
    queries = asked.kept()
    robot, made = options.to_configs(robot_options, asked.ranges)
    planners = compared.planner or comparison.PLANNERS
    comparison.specs_of(planners)
    out.check(locplan.Comparison.files)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # and clean up
    with progress_bar("runs", "runs") as progress:
        execution = comparison.Execution(
            workers=running.workers,
            time_limit=compared.time_limit,
            memory=None if running.memory is None else running.memory * 1e9,
            patience=running.patience,
            journal=out.output / "runs.jsonl",  # every run as it came
            resume=running.resume,
            anew=out.force and not running.resume,
            field_of=computing.field,
            progress=progress,
        )
        result = locplan.compare(
            maps,
            planners,
            queries,
            robot,
            configs={f"{each.estimator.name}, {each.estimator.reach:g} m": each for each in made},
            weights=costs.weight or None,
            criterion=costs.criterion,
            seeds=range(1, compared.seeds + 1),
            baseline=compared.baseline,
            execution=execution,
        )
    out.finish(dataclasses.replace(result, command=shlex.join(["locplan", *sys.argv[1:]])))

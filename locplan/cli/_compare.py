"""The command that compares planners."""

from __future__ import annotations

import dataclasses
import shlex
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from locplan.cli import _groups as groups
from locplan.cli._groups import INPUT, MAP_INPUT, Count, Force, Json, Seed, option_group, results
from locplan.cli._options import Computing, Criterion, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import refuse, show
from locplan.errors import ConfigError

app = groups.command(
    "compare",
    "compare lab.yaml -o compared --planner any-angle --planner BITstar:time_limit=2 --seeds 5",
)

JOURNAL = "runs.jsonl"
"""The file in the output folder that has every run as it came."""


@option_group(groups.PLANNER)
class Compared:
    """The planners that are compared."""

    planner: Annotated[tuple[str, ...], Parameter(metavar="NAME[:OPTION=VALUE,...]")] = ()
    """Planner, such as BITstar:time_limit=2, or 'simulated choice', which drives its paths;
    repeatable; grid and any-angle by default."""
    seeds: Count = 1
    """Number of runs of a planner with random numbers; 1 by default."""
    time_limit: float | None = None
    """Time of OMPL's planners, in seconds; 5 by default."""
    baseline: str | None = None
    """Planner that the others are compared with; any-angle if it is there."""


@option_group(groups.GENERAL)
class Queries:
    """The queries that the planners answer."""

    random: Count | None = None
    """Number of random queries on each map; 10 by default."""
    least_distance: float | None = None
    """Least distance from start to goal of random queries, in metres; 5 by default."""
    seed: Seed | None = None
    """Seed of random queries; 1 by default."""
    queries: Annotated[Path | None, INPUT] = None
    """File of queries: CSV of name,start_x,start_y,goal_x,goal_y in metres, or of name,x,y of
    stations, each two of which are one, or MovingAI .scen."""
    ranges: Annotated[str | None, Parameter(metavar="R1,R2")] = None
    """Ranges of the lidar, for each of which the planners are compared, in metres."""

    def drawn(self) -> dict[str, Any]:
        """The settings of random queries that were given; they exclude a file of queries."""
        own = {"least_distance": self.least_distance, "seed": self.seed}
        if self.queries is not None:
            if self.random is not None:
                raise ConfigError("--random and --queries exclude one another")
            refuse("with --queries", **own)
        given = {"count": self.random, **own}
        return {name: value for name, value in given.items() if value is not None}


@option_group(groups.COMPUTING)
class Running:
    """The resources of the runs."""

    workers: Count | None = None
    """Number of runs at a time; all cores by default."""
    memory: float | None = None
    """Greatest memory of a run, in GB; by default the runs share 80 % of all."""
    patience: float = 300.0
    """Time after which a planner without a time limit counts as hanging, in seconds; 300 by
    default."""
    resume: bool = False
    """Go on with an earlier comparison in --output where it ended."""


@app.default
def compare(
    maps: Annotated[
        list[Path],
        MAP_INPUT,
        Parameter(help="Maps: map_server YAML files, folders of them, or .map."),
    ],
    /,
    *,
    output: Annotated[Path, results("Folder for the report, tables and logs.")],
    compared: Compared = Compared(),
    asked: Queries = Queries(),
    weight: Annotated[
        tuple[float, ...],
        Parameter(
            group=groups.COSTS,
            help="Detour accepted per degenerate metre, in metres; by default the estimator's own;"
            " repeatable.",
        ),
    ] = (),
    criterion: Criterion = None,
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    running: Running = Running(),
    computing: Computing = Computing(),
    force: Force = False,
    json: Json = False,
) -> None:
    """Run planners side by side, and report which one is best, where and by how much."""
    from locplan._util.progress import progress_bar, working
    from locplan.comparison import (
        PLANNERS,
        Comparison,
        Execution,
        RandomQueries,
        compare as run_all,
        specs_of,
    )

    drawn = asked.drawn()
    queries = asked.queries or RandomQueries(**drawn)
    robot, made = options.to_configs(robot_options, asked.ranges)
    specs_of(compared.planner or PLANNERS)
    Comparison.files.into(output, force=force)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # and clean up

    with progress_bar("runs", "runs") as progress:
        execution = Execution(
            workers=running.workers,
            time_limit=compared.time_limit,
            memory=None if running.memory is None else running.memory * 1e9,
            patience=running.patience,
            journal=output / JOURNAL,
            resume=running.resume,
            anew=force and not running.resume,
            field_of=computing.field,
            progress=progress,
        )
        result = run_all(
            maps,
            compared.planner or PLANNERS,
            queries,
            robot,
            configs={f"{each.estimator.name}, {each.estimator.reach:g} m": each for each in made},
            weights=weight or None,
            criterion=criterion,
            seeds=range(1, compared.seeds + 1),
            baseline=compared.baseline,
            execution=execution,
        )
    result = dataclasses.replace(result, command=shlex.join(["locplan", *sys.argv[1:]]))
    with working("writing the report"):
        result.save(output, force=force)
    show(json, result.summary(), result.report(), output)

"""The command that compares planners."""

from __future__ import annotations

import shlex
import signal
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli import _groups as groups
from locplan.cli._groups import INPUT, MAP_INPUT, Count, Force, Json, Seed, option_group, results
from locplan.cli._options import Computing, Criterion, FieldOptions, RobotRadius, radius_of
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
    """This planner is compared, as BITstar:time_limit=2, or 'simulated choice', which drives its
    paths; repeatable; grid and any-angle if none."""
    seeds: Count = 1
    """The number of runs of a planner with random numbers is 1 by default."""
    time_limit: float | None = None
    """OMPL's planners stop after this time [s]; 5 by default."""
    baseline: str | None = None
    """The others are compared with this planner; any-angle if it is there."""


@option_group(groups.GENERAL)
class Queries:
    """The queries that the planners answer."""

    random: Count | None = None
    """The number of random queries on each map is 10 by default."""
    least_distance: float | None = None
    """Random queries are this far from start to goal at least [m]; 5 by default."""
    seed: Seed | None = None
    """The seed of random queries is 1 by default."""
    queries: Annotated[Path | None, INPUT] = None
    """The file of queries: CSV of name,start_x,start_y,goal_x,goal_y [m], or of name,x,y of
    stations, each two of which are one, or MovingAI .scen."""
    ranges: Annotated[str | None, Parameter(metavar="R1,R2")] = None
    """The planners are compared for each of these ranges of the lidar [m]."""


@option_group(groups.COMPUTING)
class Running:
    """The resources of the runs."""

    workers: Count | None = None
    """The number of runs at a time is that of the cores by default."""
    memory: float | None = None
    """A run may take this much memory [GB]; by default the runs share 80 % of all."""
    patience: float = 300.0
    """A planner without a time limit counts as hanging after this time [s]; 300 by default."""
    resume: bool = False
    """An earlier comparison in --output goes on where it ended."""


@app.default
def compare(
    maps: Annotated[
        list[Path],
        MAP_INPUT,
        Parameter(help="The maps are map_server YAML files, folders of them, or .map."),
    ],
    /,
    *,
    output: Annotated[Path, results("The report, tables and logs are written to this folder.")],
    compared: Compared = Compared(),
    asked: Queries = Queries(),
    weight: Annotated[
        tuple[float, ...],
        Parameter(
            group=groups.COSTS,
            help="The weight is the detour accepted per degenerate metre [m], by default the"
            " estimator's own; repeatable.",
        ),
    ] = (),
    criterion: Criterion = None,
    robot_radius: RobotRadius = None,
    options: FieldOptions = FieldOptions(),
    running: Running = Running(),
    computing: Computing = Computing(),
    force: Force = False,
    json: Json = False,
) -> None:
    """Run planners side by side, and report which one is best, where and by how much."""
    from locplan import comparison
    from locplan._util.progress import progress_bar
    from locplan._util.working import working

    if asked.random is not None and asked.queries is not None:
        raise ConfigError("--random and --queries exclude one another")
    if asked.queries is not None:
        refuse("with --queries", least_distance=asked.least_distance, seed=asked.seed)
    if asked.ranges and options.range is not None:
        raise ConfigError("--range and --ranges exclude one another")
    made = options.to_configs(asked.ranges)
    configs = {f"{each.estimator.name}, {each.estimator.reach:g} m": each for each in made}
    comparison.specs_of(compared.planner or comparison.PLANNERS)
    comparison.check_result_folder(output, force=force)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # and clean up

    with progress_bar("runs", "runs") as progress:
        result = comparison.compare(
            maps,
            compared.planner or comparison.PLANNERS,
            asked.queries or asked.random or 10,
            weights=weight or None,
            seeds=range(1, compared.seeds + 1),
            configs=configs,
            robot_radius=radius_of(robot_radius),
            criterion=criterion,
            time_limit=compared.time_limit,
            least_distance=5.0 if asked.least_distance is None else asked.least_distance,
            query_seed=1 if asked.seed is None else asked.seed,
            baseline=compared.baseline,
            workers=running.workers,
            memory=None if running.memory is None else running.memory * 1e9,
            patience=running.patience,
            journal=output / JOURNAL,
            resume=running.resume,
            anew=force and not running.resume,
            field_of=computing.field,
            progress=progress,
        )
    with working("writing the report"):
        written = result.save(output, force=force, command=shlex.join(["locplan", *sys.argv[1:]]))
    show(json, result.to_json(), result.table(), *written)

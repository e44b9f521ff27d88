"""The command that tunes AMCL's settings on a map."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    DriveSeed,
    FilterMap,
    MapFile,
    Pair,
    Threads,
    command,
    option_group,
)
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load_filter_map, refuse

app = command(
    "tune",
    "tune lab.yaml --lidar turtlebot4 -o tuned",
    "tune lab.yaml --lidar rplidar-a1 --robot nav2_params.yaml -o tuned",
    "tune lab.yaml --drive monday.mcap --robot nav2_params.yaml -o tuned",
)


@option_group("Options")
class Amount:
    """The number of drives."""

    paths: Annotated[int | None, Parameter(validator=Number(gte=5, lte=1000))] = None
    """Number of random paths of the search, and of the others on which its result is judged; 20 by
    default. The time grows with it."""
    drives: Pair = 8
    """Number of drives along each path, at each level of disturbance; 8 by default."""


@app.default
def tune(
    map_file: MapFile,
    /,
    *,
    amount: Amount = Amount(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find settings of AMCL that localize your robot better, and write them as Nav2's parameters.

    Your own settings (--robot, or Nav2's defaults) and others drive along random
    shortest paths of the map in simulation, with a third of, once and three times
    the errors of odometry. The best at its worst level is judged against yours on
    other paths in other worlds. A copy of your file is written in which only those
    values differ that gain, or none if nothing is clearly better; those of --set;
    and do_beamskip, which is not simulated and is off where the laser model changes.

    With --drive, they are replayed on stretches of a recorded drive instead. Half
    of these are kept for the judgement; recorded poses should be better than AMCL's.

    This takes some three minutes on two cores, and more with more particles.
    """
    recorded.check()
    out.check(locplan.simulation.Tuning.files)
    params = robot_options.nav2_file("amcl")
    if out.output:
        locplan.simulation.check_tunable(params)
    every: dict[str, Any] = {"drives": amount.drives, "seed": seed, "threads": threads}
    every["others"] = locplan.robots.read_parameters(params).of("amcl")
    # The table says what works badly, which other commands warn of.
    if recorded.drive:
        refuse("with --drive", paths=amount.paths)
        grid, recording = recorded.on_map([map_file])
        robot = robot_options.on_drive(recording)
    else:
        robot, grid = robot_options.load(), locplan.load_map(map_file)
        every |= {"paths": amount.paths} if amount.paths else {}
    every["filter_map"] = load_filter_map(filter_map, [grid])
    where = f"on {recorded.drive.name}" if recorded.drive else f"in {grid.name}"
    with progress_bar(f"tuning {where}", "") as progress:
        if recorded.drive:
            tune_on_drive = locplan.recordings.tune_on_drive
            result = tune_on_drive(recording, grid, robot, progress=progress, **every)
        else:
            result = locplan.simulation.tune(grid, robot, progress=progress, **every)
    out.finish(result, saved=(params,))

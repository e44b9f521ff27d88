"""The command that compares fields with simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    INPUT,
    Count,
    DriveSeed,
    FilterMap,
    MapFiles,
    Pair,
    Threads,
    command,
    option_group,
)
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import given_of, load_filter_map, refuse

app = command(
    "evaluate",
    "evaluate lab.yaml -o evaluated",
    "evaluate lab.yaml --drive monday.mcap --every 10 -o evaluated",
)


@option_group("Simulation")
class AtPlaces:
    """The number of places drawn at random, and of the simulations at each."""

    places: Pair = 100
    """Number of places on each map; 100 by default."""
    drives: Count | None = None
    """Number of drives of 10 m to each place; 16 by default."""
    scans: Count | None = None
    """Number of single scans matched at each place; 16 by default."""

    def changed(self) -> dict[str, Any]:
        """The options that were given."""
        return {name: each for name, each in vars(self).items() if each != getattr(AtPlaces, name)}


@option_group("Field")
class Further:
    """A further field."""

    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """Settings of a further field to compare with --drive, as calibrate wrote them."""


@app.default
def evaluate(
    maps: MapFiles,
    /,
    *,
    further: Further = Further(),
    recorded: DriveOptions = DriveOptions(),
    at: AtPlaces = AtPlaces(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Show how well each field predicts where a robot is badly localized on your maps.

    It is simulated there, or, with --drive, what its own scans say along a recorded drive.
    """
    recorded.check()
    result: Any
    if recorded.drive is not None:
        own = {name: value or None for name, value in vars(robot_options).items()}
        own |= {"seed": None if seed == 1 else seed, "filter_map": filter_map}
        refuse("with --drive", **own, **at.changed())
        out.check(locplan.recordings.DriveEvaluation.files)
        config = further.config
        more = {"config": locplan.load_config(config).estimator} if config else {}
        grid, drive = recorded.on_map(maps)
        estimators = locplan.recordings.estimators_for(drive.lidar) | more
        with progress_bar("comparing fields", "fields") as progress:
            result = locplan.recordings.evaluate_drive(
                drive, grid, estimators=estimators, threads=threads, progress=progress
            )
    else:
        refuse("without --drive", config=further.config)
        robot = robot_options.simulated()
        out.check(locplan.simulation.Evaluation.files)
        grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*maps)]
        filters = load_filter_map(filter_map, grids)
        disc = min(robot.known_lidar.range, locplan.simulation.LARGEST_DISC)
        every: dict[str, Any] = {**given_of(at), "disc": disc, "seed": seed, "threads": threads}
        with progress_bar("driving", "drives") as progress:
            result = locplan.simulation.evaluate(
                grids, robot, filter_map=filters, progress=progress, **every
            )
    out.finish(result)

"""The command that compares fields with simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    FIELD,
    INPUT,
    AtPlaces,
    DriveSeed,
    FilterMap,
    MapFiles,
    command,
)
from locplan.cli._kinds import given_of
from locplan.cli._options import Threads
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load_filter_map, refuse

app = command(
    "evaluate",
    "evaluate lab.yaml -o evaluated",
    "evaluate lab.yaml --drive monday.mcap --every 10 -o evaluated",
)


@app.default
def evaluate(
    maps: MapFiles,
    /,
    *,
    config: Annotated[
        Path | None,
        INPUT,
        Parameter(
            group=FIELD,
            metavar="FILE.json",
            help="Settings of a further field to compare with --drive, as calibrate wrote them.",
        ),
    ] = None,
    recorded: DriveOptions = DriveOptions(),
    at: AtPlaces = AtPlaces(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: FilterMap = None,
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Tell how well each field predicts where a robot is badly localized on your maps.

    It is simulated there, or, with --drive, what its own scans say along a recorded drive.
    """
    recorded.check()
    if recorded.drive is not None:
        own = {name: value or None for name, value in vars(robot_options).items()}
        places = {name: each for name, each in vars(at).items() if each != getattr(AtPlaces, name)}
        refuse("with --drive", **own, **places, seed=None if seed == 1 else seed)
        refuse("with --drive", filter_map=filter_map)
        _evaluate_drive(maps, recorded, config, threads, out)
        return
    from locplan._util.progress import progress_bar
    from locplan.field import equipped
    from locplan.maps import find_maps, load_map
    from locplan.simulation import LARGEST_DISC, Evaluation, evaluate as measured

    refuse("without --drive", config=config)
    robot = equipped(robot_options.load())
    robot_options.warn(robot)
    out.check(Evaluation.files)
    grids = [load_map(file) for file in find_maps(*maps)]
    filters = load_filter_map(filter_map, grids)
    with progress_bar("driving", "drives") as progress:
        result = measured(
            grids,
            robot,
            filter_map=filters,
            **given_of(at),
            disc=min(robot.known_lidar.range, LARGEST_DISC),
            seed=seed,
            threads=threads,
            progress=progress,
        )
    out.finish(result)


def _evaluate_drive(
    maps: list[Path],
    recorded: DriveOptions,
    config: Path | None,
    threads: int | None,
    out: Output,
) -> None:
    """Compare the fields with the scans of a recorded drive."""
    from locplan._util.progress import progress_bar
    from locplan.field import load_config
    from locplan.recordings import DriveEvaluation, estimators_for, evaluate_drive

    out.check(DriveEvaluation.files)
    own = {"config": load_config(config).estimator} if config else {}
    grid, drive = recorded.on_map(maps)
    estimators = estimators_for(drive.lidar) | own
    with progress_bar("comparing fields", "fields") as progress:
        found = evaluate_drive(
            drive, grid, estimators=estimators, threads=threads, progress=progress
        )
    out.finish(found)

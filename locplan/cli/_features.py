"""The command that finds the features of a map that localization depends on."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    Count,
    DriveSeed,
    MapFile,
    command,
    option_group,
)
from locplan.cli._options import Threads
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._route_options import RouteOptions
from locplan.cli._values import load

app = command(
    "features",
    "features lab.yaml --start 2,3 --goal 38,3 -o found",
    "features lab.yaml --path mine.csv --robot nav2_params.yaml --count 2 -o found",
)


@option_group(GENERAL)
class Taking:
    """What counts as a feature, and how many are taken away."""

    count: Count = 3
    """Number of features that are taken away together; 3 by default."""
    piece: float = 1.0
    """Length of the pieces of walls, in metres; about 1 by default."""
    largest: float = 4.0
    """Greatest extent of an object, in metres; 4 by default."""
    shift: float = 0.3
    """Distance by which features are moved to see the error, in metres; 0.3 by default."""
    drives: Annotated[int, Parameter()] = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""


@app.default
def features(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    taking: Taking = Taking(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find the pillars, shelves and corners that localization on your routes depends on.

    Drives with your own filter, in a world that lacks the worst of them, say whether it is so.
    """
    from locplan import landmarks as core
    from locplan._util.progress import progress_bar
    from locplan.field import equipped
    from locplan.simulation import check_drives

    drives, ways = taking.drives, routes.given()
    check_drives(drives, or_none=True)
    robot = equipped(robot_options.load())
    robot_options.warn(robot)
    grid = load(map_file)
    out.check(core.KeyFeatures.files)
    with progress_bar("taking features away", "features") as progress:
        found = core.key_features(
            grid,
            **ways,
            robot=robot,
            count=taking.count,
            piece=taking.piece,
            largest=taking.largest,
            shift=taking.shift,
            progress=progress,
        )
    driven = None
    if drives and found.together:
        with progress_bar("verifying by drives", "drives") as progress:
            driven = found.verify(drives, seed=seed, threads=threads, progress=progress)
    out.finish(found, driven)

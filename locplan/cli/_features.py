"""The command that finds the features of a map that localization depends on."""

from __future__ import annotations

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._groups import Count, DriveSeed, MapFile, Threads, command, option_group
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._route_options import RouteOptions

app = command(
    "features",
    "features lab.yaml --start 2,3 --goal 38,3 -o found",
    "features lab.yaml --path mine.csv --robot nav2_params.yaml --count 2 -o found",
)


@option_group("Options")
class Taking:
    """What counts as a feature, and how many are taken away."""

    count: Count = 3
    """Number of features that are taken away together; 3 by default."""
    piece: float = 1.0
    """Length of the pieces of walls, in metres; about 1 by default."""
    largest: float = 4.0
    """Maximum extent of an object, in metres; 4 by default."""
    shift: float = 0.3
    """Distance by which features are moved to see the error, in metres; 0.3 by default."""


@option_group("Options")
class Verified:
    """How it is verified."""

    drives: int = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""


@app.default
def features(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    taking: Taking = Taking(),
    verified: Verified = Verified(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find the pillars, shelves and corners that localization on your routes depends on.

    Drives with your own filter, in a world that lacks the worst of them, say whether it is so.
    """
    drives, ways = verified.drives, routes.given()
    locplan.simulation.check_drives(drives, or_none=True)
    robot = robot_options.simulated()
    grid = locplan.load_map(map_file)
    out.check(locplan.KeyFeatures.files)
    with progress_bar("taking features away", "features") as progress:
        found = locplan.key_features(grid, **ways, robot=robot, **vars(taking), progress=progress)
    driven = None
    if drives and found.together:
        with progress_bar("verifying by drives", "drives") as progress:
            driven = found.verify(drives, seed=seed, threads=threads, progress=progress)
    out.finish(found, driven)

"""The command that proposes places for landmarks, and proves by drives whether they help."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._groups import Count, DriveSeed, MapFile, Threads, command, option_group
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._route_options import RouteOptions
from locplan.cli._values import given_of, parsed, position, rectangle, region

app = command(
    "landmarks",
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --robot nav2_params.yaml -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --count 8 --region all -o marked",
)


@option_group("Options")
class Placing:
    """The objects, and the region that they serve if it is no route."""

    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2"
    """Poles (pole:DIAMETER) or boxes (box:LENGTH,WIDTH), in metres; pole:0.2 by default."""
    count: int = 6
    """Maximum number of objects; 6 by default."""
    region: Annotated[tuple[Any, ...], parsed(region, "X0,Y0,X1,Y1", many=True)] = ()
    """Rectangle in which the robot may go anywhere, in metres, repeatable; "all" is the map."""


@option_group("Options")
class Standing:
    """Where the objects may stand."""

    where: Literal["walls", "free", "both"] = "both"
    """Places that are tried: along walls, in the open, or both, by default both."""
    spacing: float = 0.5
    """Distance between places along walls, in metres; 0.5 by default."""
    clearance: float = 0.2
    """Distance of routes and passages from the objects besides the robot's radius, in metres; 0.2
    by default."""
    keep_out: Annotated[Any, parsed(rectangle, "X0,Y0,X1,Y1", many=True)] = None
    """Rectangle in which no object may stand, in metres; repeatable."""
    existing: Annotated[tuple[Any, ...], parsed(position, "X,Y[,DEG]", many=True)] = ()
    """Object of this kind in the map, which may be moved, x,y in metres; repeatable."""


@option_group("Options")
class Driving:
    """The drives that choose and verify."""

    drives: int = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""
    trials: Count | None = None
    """Number of placements that are driven first, of which the best is taken; 4 by default, and 1
    without drives. Along routes the first two are by the two objectives."""


@app.default
def landmarks(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    placing: Placing = Placing(),
    standing: Standing = Standing(),
    driving: Driving = Driving(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Propose places for poles or boxes that keep the robot from getting lost on its ways.

    Drives with your own filter, before, after and with random places, say whether they help.
    """
    import numpy as np

    every: dict[str, Any] = {"seed": seed, "threads": threads}
    ways = routes.given(region=placing.region)
    kind = locplan.landmarks.parsed_object(placing.object)
    locplan.simulation.check_drives(driving.drives, or_none=True)
    robot = robot_options.simulated()
    sites = locplan.landmarks.Sites(**vars(standing))
    grid = locplan.load_map(map_file)
    if placing.region:
        whole = "all" in placing.region
        ways["region"] = np.ones(grid.shape, bool) if whole else placing.region
    out.check(locplan.Landmarks.files)
    with progress_bar("placing landmarks", "steps") as progress:
        made = locplan.place_landmarks(
            grid,
            kind,
            placing.count,
            **ways,
            robot=robot,
            sites=sites,
            threads=threads,
            progress=progress,
        )
    trials = given_of(driving).get("trials", None if driving.drives else 1)
    tried = {} if trials is None else {"trials": trials}
    with progress_bar("driving placements", "drives") as progress:
        made = locplan.landmarks.best_of_trials(made, **tried, **every, progress=progress)
    verification = None
    if driving.drives:
        with progress_bar("verifying by drives", "drives") as progress:
            verification = made.verify(driving.drives, **every, progress=progress)
    out.finish(made, verification)

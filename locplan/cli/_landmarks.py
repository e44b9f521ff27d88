"""The command that proposes places for landmarks, and proves by drives whether they help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    COSTS,
    GENERAL,
    Count,
    Force,
    Json,
    MapFile,
    command,
    option_group,
    results,
)
from locplan.cli._options import RobotRadius, Threads, radius_of
from locplan.cli._route_options import LidarOptions, RouteOptions
from locplan.cli._simulation_options import SimulationOptions
from locplan.cli._values import load, numbers, position, show

app = command(
    "landmarks",
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --params nav2_params.yaml -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --count 8 --region all -o marked",
)


@option_group(GENERAL)
class Placing:
    """The objects, the region that they serve if it is no route, and where they may stand."""

    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2"
    """They are poles (pole:DIAMETER) or boxes (box:LENGTH,WIDTH) [m]; pole:0.2 by default."""
    count: Annotated[int, Parameter()] = 6
    """So many are placed at most, 6 by default."""
    region: Annotated[
        tuple[str, ...], Parameter(metavar="X0,Y0,X1,Y1", allow_leading_hyphen=True)
    ] = ()
    """The robot may go anywhere in this rectangle [m], repeatable, or with "all" on the map."""
    where: Literal["walls", "free", "both"] = "both"
    """Places along walls, in the open, or both are tried, by default both."""
    spacing: float = 0.5
    """Along walls a place is tried every 0.5 m by default."""
    margin: float = 0.2
    """Routes and passages keep this distance from the objects besides the radius, 0.2 m by
    default."""
    keep_out: Annotated[
        tuple[str, ...], Parameter(metavar="X0,Y0,X1,Y1", allow_leading_hyphen=True)
    ] = ()
    """No object stands in this rectangle [m]; repeatable."""
    existing: Annotated[
        tuple[str, ...], Parameter(metavar="X,Y[,DEG]", allow_leading_hyphen=True)
    ] = ()
    """An object of this kind stands in the map here, and may be moved [m, deg]; repeatable."""
    drives: Annotated[int, Parameter()] = 100
    """The number of drives of the verification is 100 by default; 0 leaves it out."""
    trials: Count | None = None
    """So many placements that promise as much are driven first, and the best is taken; 4 by
    default, and 1 without drives. Along routes the first two are by the two objectives."""


@app.default
def landmarks(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    placing: Placing = Placing(),
    simulation: SimulationOptions = SimulationOptions(),
    robot_radius: Annotated[RobotRadius, Parameter(group=COSTS)] = None,
    lidar_options: LidarOptions = LidarOptions(),
    threads: Threads = None,
    output: Annotated[
        Path | None,
        results(
            "The places (CSV, GeoJSON), the map with the objects, a picture and the tables are"
            " written to this folder."
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Propose places for poles or boxes that keep the robot from getting lost on its ways.

    Drives with your own filter, before, after and with random places, say whether they help.
    """
    import numpy as np

    from locplan import landmarks as core
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.landmarks import _reports as reports
    from locplan.landmarks._objects import parsed_object
    from locplan.landmarks._trials import TRIALS, best_of_trials
    from locplan.simulation._drives import check_drives_or_none

    drives = placing.drives
    driven = routes.given(region=placing.region)
    kind = parsed_object(placing.object)
    check_drives_or_none(drives)
    lidar = lidar_options.named()
    robot, not_simulated = simulation.robot(lidar)
    radius = radius_of(robot_radius, simulation.params)
    existing = [position("existing", text) for text in placing.existing]
    keep_out = [numbers("keep-out", text, 4) for text in placing.keep_out]
    region = [numbers("region", text, 4) for text in placing.region if text != "all"]
    grid = load(map_file)
    if placing.region:
        driven = {"region": np.ones(grid.shape, bool) if "all" in placing.region else region}
    folder = reports.LANDMARKS.into(output, force=force) if output else None
    with progress_bar("placing landmarks", "steps") as progress:
        made = core.place_landmarks(
            grid,
            kind,
            placing.count,
            **driven,
            lidar=lidar,
            **robot,
            robot_radius=radius,
            margin=placing.margin,
            where=placing.where,
            spacing=placing.spacing,
            keep_out=keep_out or None,
            existing=existing,
            threads=threads,
            progress=progress,
        )
    seed = simulation.seed
    trials = placing.trials or (TRIALS if drives else 1)
    with progress_bar("driving placements", "drives") as progress:
        made = best_of_trials(made, trials, seed=seed, threads=threads, progress=progress)
    verification = None
    if drives:
        with progress_bar("verifying by drives", "drives") as progress:
            verification = made.verify(drives, seed=seed, threads=threads, progress=progress)
    if folder:
        with working("writing the landmarks"):
            reports.write_landmarks(folder, made, verification, not_simulated)
    about = reports.landmarks_summary(made, verification, not_simulated)
    show(json, about, reports.landmarks_table(made, verification, not_simulated), output)

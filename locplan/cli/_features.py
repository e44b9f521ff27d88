"""The command that tells which features of a map localization hangs on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
from locplan.cli._values import load, show

app = command(
    "features",
    "features lab.yaml --start 2,3 --goal 38,3 -o found",
    "features lab.yaml --path mine.csv --params nav2_params.yaml --count 2 -o found",
)


@option_group(GENERAL)
class Taking:
    """What counts as a feature, and how many are taken away."""

    count: Count = 3
    """So many features are taken away together, 3 by default."""
    piece: float = 1.0
    """Walls are divided into pieces of about this length [m], 1 by default."""
    largest: float = 4.0
    """What hangs together over at most this extent is one object [m], 4 by default."""
    gap: float = 0.1
    """Parts of an object may be this far apart [m], 0.1 by default."""
    shift: float = 0.3
    """The error is told if a feature is moved by this distance [m], 0.3 by default."""
    drives: Annotated[int, Parameter()] = 100
    """The number of drives of the verification is 100 by default; 0 leaves it out."""


@app.default
def features(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    taking: Taking = Taking(),
    simulation: SimulationOptions = SimulationOptions(),
    robot_radius: Annotated[RobotRadius, Parameter(group=COSTS)] = None,
    lidar_options: LidarOptions = LidarOptions(),
    threads: Threads = None,
    output: Annotated[
        Path | None,
        results("The features (CSV, GeoJSON, JSON) and a picture are written to this folder."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Tell which pillars, shelves and corners localization on your routes hangs on.

    Drives with your own filter, in a world that lacks the worst of them, say whether it is so.
    """
    from locplan import landmarks as core
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.landmarks import _feature_reports as reports
    from locplan.simulation._drives import check_drives_or_none

    drives, ways = taking.drives, routes.given()
    check_drives_or_none(drives)
    lidar = lidar_options.named()
    robot, not_simulated = simulation.robot(lidar)
    radius = radius_of(robot_radius, simulation.params)
    grid = load(map_file)
    folder = reports.FEATURES.into(output, force=force) if output else None
    with progress_bar("taking features away", "features") as progress:
        found = core.key_features(
            grid,
            **ways,
            lidar=lidar,
            **robot,
            robot_radius=radius,
            count=taking.count,
            piece=taking.piece,
            largest=taking.largest,
            gap=taking.gap,
            shift=taking.shift,
            progress=progress,
        )
    driven = None
    if drives and found.together:
        with progress_bar("verifying by drives", "drives") as progress:
            driven = found.verify(drives, seed=simulation.seed, threads=threads, progress=progress)
    if folder:
        with working("writing the features"):
            reports.write_features(folder, found, driven, not_simulated)
    about = reports.features_summary(found, driven, not_simulated)
    show(json, about, reports.features_table(found, driven, not_simulated), output)

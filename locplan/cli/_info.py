"""The command that describes a map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from locplan.cli._groups import FIELD, Json, MapFile, command, results
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import show

if TYPE_CHECKING:
    from locplan.costs import LidarShare
    from locplan.maps import OccupancyGrid
    from locplan.robots import Robot

COMPARED = ("turtlebot3", "turtlebot4", "tim571")
"""Lidars of short, middle and long range."""

app = command("info", "info lab.yaml -o lab_map.png", "info lab.yaml --lidars")


@app.default
def info(
    map_file: MapFile,
    /,
    *,
    robot_options: RobotOptions = RobotOptions(),
    output: Annotated[
        Path | None,
        results("File for a picture with grid lines and places (.png, .pdf, .svg)."),
    ] = None,
    lidars: Annotated[
        bool,
        Parameter(
            group=FIELD,
            help="Compare how much of the floor is degenerate with the robot's lidar and with"
            f" {', '.join(COMPARED)}.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Describe a map: size, what misleads, rooms, and places for start and goal."""
    from locplan._util.files import PICTURES, check_target
    from locplan._util.progress import working
    from locplan.costs import lidars_table
    from locplan.planners import describe_map

    if output:
        check_target(output, *PICTURES)
    robot = robot_options.load()
    about = describe_map(map_file, robot_radius=robot.radius)
    shares = _compared(about.grid, robot, COMPARED if lidars else ())
    if output:
        from locplan import plotting

        with working("drawing"):
            plotting.save_figure(plotting.info_figure(about), output)
    lines, found = [about.report()], about.summary()
    if shares:
        compared = lidars_table(shares)
        lines, found = [*lines, str(compared)], found | {"lidars": compared.records()}
    show(json, found, "\n".join(lines), output)


def _compared(grid: OccupancyGrid, robot: Robot, names: Sequence[str]) -> list[LidarShare]:
    """The robot's lidar, if it is known, and those of some names, with what is degenerate."""
    from locplan._util.progress import progress_bar
    from locplan.costs import compare_lidars
    from locplan.robots import Lidar

    every = dict.fromkeys([robot.lidar, *map(Lidar.preset, names)])
    known = [lidar for lidar in every if lidar]
    if not known:
        return []
    with progress_bar("lidars", "cells") as progress:
        return compare_lidars(grid, known, robot_radius=robot.radius, progress=progress)

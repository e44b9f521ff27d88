"""The command that describes a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import FIELD, Json, MapFile, command, results
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import show

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
    from locplan.costs import lidars_table
    from locplan.planners import describe_map

    if output:
        check_target(output, *PICTURES)
    robot = robot_options.load()
    about = describe_map(map_file, robot_radius=robot.radius)
    shares = []
    if lidars or robot.lidar:
        from locplan._util.progress import progress_bar
        from locplan.costs import compare_lidars
        from locplan.robots import Lidar

        named = [Lidar.preset(name) for name in COMPARED] if lidars else []
        named = list(dict.fromkeys([*([robot.lidar] if robot.lidar else []), *named]))
        with progress_bar("lidars", "cells") as progress:
            shares = compare_lidars(about.grid, named, robot_radius=robot.radius, progress=progress)
    if output:
        from locplan import plotting
        from locplan._util.working import working

        with working("drawing"):
            plotting.save_figure(plotting.info_figure(about), output)
    compared = {"lidars": [each.to_json() for each in shares]} if shares else {}
    tables = [about.table(), *([lidars_table(shares)] if shares else [])]
    show(json, {**about.to_json(), **compared}, "\n".join(tables), output)

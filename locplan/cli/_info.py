"""The command that describes a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import FIELD, Json, MapFile, command, results
from locplan.cli._options import RobotRadius, radius_of
from locplan.cli._values import show
from locplan.robots import PRESETS

COMPARED = ("turtlebot3", "turtlebot4", "tim571")
"""Lidars of short, middle and long range."""

app = command("info", "info lab.yaml -o lab_map.png", "info lab.yaml --lidars")


@app.default
def info(
    map_file: MapFile,
    /,
    *,
    robot_radius: RobotRadius = None,
    output: Annotated[
        Path | None,
        results("A picture with grid lines and places is written here (.png, .pdf, .svg)."),
    ] = None,
    lidars: Annotated[
        bool,
        Parameter(
            group=FIELD,
            help="Lidars are compared: how much of the floor is degenerate with each. They are"
            " turtlebot3, turtlebot4 and tim571 by default.",
        ),
    ] = False,
    lidar: Annotated[
        tuple[str, ...],
        Parameter(group=FIELD, choices=tuple(PRESETS), help="This lidar is compared; repeatable."),
    ] = (),
    json: Json = False,
) -> None:
    """Describe a map: size, what misleads, rooms, and places for start and goal."""
    from locplan._util.files import PICTURES, check_target
    from locplan.costs._lidars import lidars_table
    from locplan.planners import describe_map

    if output:
        check_target(output, *PICTURES)
    radius = radius_of(robot_radius)
    about = describe_map(map_file, robot_radius=radius)
    shares = []
    if lidars or lidar:
        from locplan._util.progress import progress_bar
        from locplan.costs._lidars import compare_lidars
        from locplan.robots import Lidar

        named = [Lidar.preset(name) for name in lidar or COMPARED]
        with progress_bar("lidars", "cells") as progress:
            shares = compare_lidars(about.grid, named, robot_radius=radius, progress=progress)
    if output:
        from locplan import plotting
        from locplan._util.working import working

        with working("drawing"):
            plotting.save_figure(plotting.info_figure(about), output)
    compared = {"lidars": [each.to_json() for each in shares]} if shares else {}
    tables = [about.table(), *([lidars_table(shares)] if shares else [])]
    show(json, {**about.to_json(), **compared}, "\n".join(tables), output)

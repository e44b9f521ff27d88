"""The command that describes a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import locplan
from locplan._util.files import PICTURES, check_target
from locplan._util.progress import progress_bar, working
from locplan.cli._groups import MapFile, command, option_group
from locplan.cli._output import Json, Target, show
from locplan.cli._robot_options import RobotOptions

app = command("info", "info lab.yaml -o lab_map.png", "info lab.yaml --lidars")


@option_group("Field")
class Lidars:
    """What is compared."""

    lidars: bool = False
    """Compare how much of the floor is degenerate with the robot's lidar and with those of
    turtlebot3, turtlebot4 and tim571, of short, middle and long range."""


@option_group("Output")
class Picture:
    """Where the picture goes."""

    output: Annotated[Path | None, Target] = None
    """File for a picture with grid lines and places (.png, .pdf, .svg)."""
    json: Json = False


@app.default
def info(
    map_file: MapFile,
    /,
    *,
    robot_options: RobotOptions = RobotOptions(),
    compared: Lidars = Lidars(),
    out: Picture = Picture(),
) -> None:
    """Describe a map: size, what misleads, rooms, and places for start and goal."""
    if out.output:
        check_target(out.output, *PICTURES)
    robot = robot_options.load()
    about = locplan.planners.describe_map(map_file, robot=robot)
    names = ("turtlebot3", "turtlebot4", "tim571") if compared.lidars else ()
    every = dict.fromkeys([robot.lidar, *map(locplan.Lidar.preset, names)])
    lines, found = [about.report()], about.summary()
    if known := [lidar for lidar in every if lidar]:
        with progress_bar("lidars", "cells") as progress:
            shares = locplan.costs.compare_lidars(about.grid, known, robot=robot, progress=progress)
        table = locplan.costs.lidars_table(shares)
        lines, found = [*lines, str(table)], found | {"lidars": table.records()}
    if out.output:
        with working("drawing"):
            locplan.plotting.save_figure(locplan.plotting.info_figure(about), out.output)
    show(out.json, found, "\n".join(lines), out.output)

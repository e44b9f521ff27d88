"""The command that describes a map."""

from __future__ import annotations

from pathlib import Path

import locplan
from locplan._util.files import PICTURES, check_target
from locplan._util.output import Output as Target
from locplan._util.progress import progress_bar, working
from locplan.cli.application import command
from locplan.cli.arguments import MapFile, Switch
from locplan.cli.groups import Output, RobotOptions
from locplan.errors import ConfigError

PRESETS = "turtlebot3", "turtlebot4", "tim571"
"""Lidars of short, middle and long range."""


@command(
    "info lab.yaml -o lab_map.png",
    "info lab.yaml --lidar turtlebot4 --lidars",
    "info hall -o maps",
    "info --settings",
)
def info(
    map_file: MapFile | None = None,
    /,
    *,
    lidars: Switch = False,
    settings: Switch = False,
    robot: RobotOptions = RobotOptions(),
    output: Output = Output(),
) -> None:
    """Describe a map: size, faults, rooms, and places for start and goal.

    With a lidar, reports the share of ambiguous places, and safe starts.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    lidars
        Compare the degenerate share of the floor with lidars of short to long range.
    settings
        List the robot's settings for --set, with their values.
    """
    if settings:
        table = locplan.robots.list_settings(robot.load())
        return output.show(table.records(), str(table))
    if map_file is None:
        raise ConfigError("name a map, or list the robot's settings with --settings")
    target = _target(map_file, output)
    described_robot = robot.load()
    described = locplan.planners.describe_map(map_file, robot=described_robot)
    lines, values = [described.report()], described.summary()
    if described_robot.lidar:
        line, values["ambiguous"] = _ambiguous_places(described.grid, described_robot)
        lines.append(line)
    compared = [*map(locplan.Lidar.preset, PRESETS)] if lidars else []
    if described_robot.lidar:
        compared = [described_robot.lidar, *compared]
    if compared:
        with progress_bar("lidars", "cells") as progress:
            shares = locplan.costs.compare_lidars(
                described.grid, [*dict.fromkeys(compared)], robot=described_robot, progress=progress
            )
        table = locplan.costs.lidars_table(shares)
        lines.append(str(table))
        values["lidars"] = table.records()
    if target and target.is_file:
        with working("drawing"), target.writing() as new:
            locplan.plotting.save_figure(locplan.plotting.info_figure(described), new)
    elif target:
        with target.writing(adds=True) as new:
            locplan.save_map(described.grid, new / f"{described.grid.name}.yaml")
    output.show(values, "\n".join(lines), output.output)


def _target(map_file: Path, output: Output) -> Target | None:
    """Return the file of a picture, or the folder for a built-in map's files; None for none."""
    if output.output is None:
        return None
    name = map_file.name
    if not locplan.maps.is_built_in(map_file) or output.output.suffix.lower() in PICTURES:
        picture = Target(output.output, "info", output.force, is_file=True)
        check_target(output.output, *PICTURES)
        picture.check()
        return picture
    folder = Target(output.output, "maps", output.force)
    folder.check(f"{name}.yaml", f"{name}.pgm")
    return folder


def _ambiguous_places(grid: locplan.OccupancyGrid, robot: locplan.Robot) -> tuple[str, object]:
    """Return the line about ambiguous places and starts, and the same fit for JSON."""
    try:
        with progress_bar("ambiguous places", "poses") as progress:
            places = locplan.recordings.find_ambiguous_places(grid, robot, progress=progress)
    except ConfigError as error:  # the robot fits nowhere, or there is no wall
        return f"ambiguous places: not known, since {error}", None
    return places.sentence, {"share": places.share, "starts": places.starts.tolist()}

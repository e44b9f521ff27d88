"""The command `info`: describe a map, or list names and settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import locplan
from locplan._support.files import PICTURES, check_writable_file
from locplan._support.output import ResultOutput as Target
from locplan._support.progress import show_progress_bar, show_spinner
from locplan.app.cli.application import command
from locplan.app.cli.arguments import MapFile, Switch
from locplan.app.cli.groups import OutputOptions, RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan._support.records import Table

COMPARED_LIDARS = "turtlebot3", "turtlebot4", "tim571"
"""Lidars of short, medium and long range."""


@command(
    "info lab.yaml -o lab_map.png",
    "info lab.yaml --lidar turtlebot4 --lidars",
    "info hall -o maps",
    "info --settings",
    "info",
)
def info(
    map_file: MapFile | None = None,
    /,
    *,
    lidars: Switch = False,
    settings: Switch = False,
    robot: RobotOptions = RobotOptions(),
    output: OutputOptions = OutputOptions(),
) -> None:
    """Describe a map: size, faults, rooms, and suggested starts and goals.

    With a lidar, also reports the share of ambiguous places and safe starting positions.
    Without a map, lists the built-in maps, lidars and planners.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    lidars
        Compare how much of the floor is degenerate with short- to long-range lidars.
    settings
        List the settings for --set with their values.
    """
    from locplan.planning.map_info import describe_map
    from locplan.planning.metrics import compare_lidars, make_lidar_table
    from locplan.robots.robot import list_settings

    if settings:
        settings_table = list_settings(robot.load())
        return output.show(settings_table.records(), _format_settings(settings_table))
    if map_file is None:
        if output.output or lidars:
            raise ConfigError("name a map, such as locplan info two_corridors")
        names = _list_names()
        return output.show(names, _format_names(names))
    target = _make_target(map_file, output)
    described_robot = robot.load()
    described = describe_map(map_file, robot=described_robot)
    lines, values = [described.report()], described.summary()
    if described_robot.lidar:
        line, values["ambiguous"] = _describe_ambiguous_places(described.grid, described_robot)
        lines.append(line)
    compared = [*map(locplan.Lidar.preset, COMPARED_LIDARS)] if lidars else []
    if described_robot.lidar:
        compared = [described_robot.lidar, *compared]
    if compared:
        with show_progress_bar("comparing lidars", "cells") as progress:
            shares = compare_lidars(
                described.grid, [*dict.fromkeys(compared)], robot=described_robot, progress=progress
            )
        compared_table = make_lidar_table(shares)
        lines.append(str(compared_table))
        values["lidars"] = compared_table.records()
    if target and target.is_file:
        from locplan._support.drawing import save_figure
        from locplan.planning.figures import map_info_figure

        with show_spinner("drawing"), target.writing() as new:
            save_figure(map_info_figure(described), new)
    elif target:
        with target.writing(adds=True) as new:
            locplan.save_map(described.grid, new / f"{described.grid.name}.yaml")
    output.show(values, "\n".join(lines), output.output)


def _format_settings(settings_table: Table) -> str:
    """Return a table of the robot's settings: name, unit and value."""
    from locplan._support.tables import format_table

    rows = [
        (f"{name} [{unit}]" if unit else name, value)
        for _, name, unit, value, _ in settings_table.rows
    ]
    table = format_table(["setting", "value"], rows)
    return f"{table}\nAdd --json to see the meaning of each setting."


def _list_names() -> dict[str, list[str]]:
    """Return the names of the built-in maps, lidars and planners."""
    from locplan.maps.environments import BUILT_IN
    from locplan.planning import registry
    from locplan.robots import lidar

    return {
        "maps": [*BUILT_IN],
        "lidars": [*lidar.LIDARS],
        "planners": [*registry.list_planner_names()],
    }


def _format_names(names: dict[str, list[str]]) -> str:
    """Return a table of the names, and the next commands."""
    from locplan._support.tables import format_table

    rows = [(title, ", ".join(values)) for title, values in names.items()]
    return (
        f"{format_table([], rows)}\n"
        "Planner options: --planner BITstar:time_limit=2. An unknown option lists all of them.\n"
        "Next: describe a map, or list the robot's settings:\n"
        "  locplan info two_corridors\n"
        "  locplan info --settings"
    )


def _make_target(map_file: Path, output: OutputOptions) -> Target | None:
    """Return the picture's file, or the folder for a built-in map; None without --output."""
    from locplan.maps.environments import is_built_in

    if output.output is None:
        return None
    name = map_file.name
    if not is_built_in(map_file) or output.output.suffix.lower() in PICTURES:
        picture = Target(
            output.output, "info", output.force, is_file=True, purposes={"*": "the picture"}
        )
        check_writable_file(output.output, *PICTURES)
        picture.check()
        return picture
    folder = Target(
        output.output,
        "maps",
        output.force,
        purposes={"*.yaml": "the map, for ROS and all commands"},
    )
    folder.check(f"{name}.yaml", f"{name}.pgm")
    return folder


def _describe_ambiguous_places(
    grid: locplan.OccupancyGrid, robot: locplan.Robot
) -> tuple[str, object]:
    """Return a line about ambiguous places and safe starts, and their values for JSON."""
    from locplan.recordings.ambiguous_places import find_ambiguous_places

    try:
        with show_progress_bar("finding ambiguous places", "poses") as progress:
            places = find_ambiguous_places(grid, robot, progress=progress)
    except ConfigError as error:  # the robot fits nowhere, or there is no wall
        return f"ambiguous places: unknown ({error})", None
    return places.sentence, {"share": places.share, "starts": places.starts.tolist()}

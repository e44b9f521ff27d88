"""The command `explore`: open the explorer in a browser."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_spinner
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    InputFile,
    Integer,
    MapFile,
    Position,
    Positions,
    Switch,
    reject_options,
    show_default,
)
from locplan.app.cli.groups import (
    FieldOptions,
    OutputOptions,
    RobotOptions,
    Threads,
    Weight,
    load_zones,
)
from locplan.app.cli.log import print_line
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.app.explorer.check_reports import CheckReport

ReportFolder = Annotated[Path | None, Parameter(metavar="FOLDER")]


@command(
    "explore lab.yaml --lidar turtlebot4",
    "explore --check report",
    "explore lab.yaml --lidar turtlebot4 --start 2,3 --goal 38,3 -o edited",
)
def explore(
    map_file: MapFile | None = None,
    /,
    *,
    check: ReportFolder = None,
    start: Position = None,
    goal: Position = None,
    via: Positions = (),
    weight: Weight = None,
    zones: InputFile = None,
    port: Annotated[Integer, show_default(lambda: None)] = 0,
    no_browser: Switch = False,
    robot: RobotOptions = RobotOptions(),
    field: FieldOptions = FieldOptions(),
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Explore a map in the browser: drag start and goal, draw walls and zones.

    Only this machine can open the page. The page writes only into --output. Stop with Ctrl-C.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map. Not needed with --check.
    check
        Folder of `locplan check -o`. Shows its weak spots, routes and fixes.
    start
        Initial start, in metres.
    goal
        Initial goal, in metres.
    via
        Initial waypoint, in metres. Repeatable.
    weight
        Detour that avoiding a degenerate metre is worth, in metres.
    zones
        Initial zones (GeoJSON) or keepout mask (map YAML).
    port
        Port of the page. [default: any free port]
    no_browser
        Do not open a browser.
    """
    from locplan.app.explorer.explorer import check_installed, open_explorer
    from locplan.app.explorer.scene import StartSettings
    from locplan.app.explorer.sites import changes_from_zones
    from locplan.field.config import COARSE_STRIDE

    reject_options("in explore", json=output.json)
    check_installed()
    report = _read_report(check, map_file, robot)
    page_map = report.map_file if report else map_file
    assert page_map is not None
    on_map, config = field.resolve(report.robot if report else robot.load())
    if report and field.stride is None:
        config = dataclasses.replace(config, stride=COARSE_STRIDE)
    grid = locplan.load_map(page_map)
    ends = report.first_route_ends if report else {}
    opening = StartSettings(
        config,
        on_map,
        weight=weight,
        threads=threads,
        folder=output.output,
        force=output.force,
        parameter_files=tuple(robot.list_nav2_files()),
        start=start or ends.get("start"),
        goal=goal or ends.get("goal"),
        via=via,
        changes=changes_from_zones(load_zones(zones, grid)),
        report=report,
    )
    with show_spinner("opening the page"):
        page = open_explorer(grid, opening, port=port)
    browse = "the page opens in your browser. If not, open the address above. Stop with Ctrl-C"
    if no_browser:
        browse = "open the address above in a browser on this machine. Stop with Ctrl-C"
    with page:
        print(page.address, flush=True)
        print_line(browse)
        if not no_browser:
            page.open()
        page.wait()


def _read_report(
    folder: Path | None, map_file: Path | None, robot: RobotOptions
) -> CheckReport | None:
    """Return the report of --check, if given; raise a ConfigError without a map."""
    from locplan.app.explorer import check_reports

    if folder is None:
        if map_file is None:
            raise ConfigError("name a map, or pass the folder of a check with --check")
        return None
    if map_file:
        raise ConfigError("a map and --check exclude each other; remove one")
    reject_options("with --check, which sets the robot", robot=robot.robot, lidar=robot.lidar)
    reject_options("with --check, which sets the robot", set=robot.set)
    return check_reports.CheckReport.read(folder)

"""The command `check`: find where a robot gets lost on a map, and the best fix."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import LIMIT_EXCEEDED, command
from locplan.app.cli.arguments import InputFile, MapFile, make_parser
from locplan.app.cli.groups import (
    SEED,
    FilterMapFile,
    OutputOptions,
    RecordingFiles,
    RobotOptions,
    Seed,
    Threads,
    load_filter_map,
    load_recording,
)
from locplan.errors import format_one_line

if TYPE_CHECKING:
    from locplan.advice.limits import CheckLimit


def parse_limit(_: str, text: str) -> CheckLimit:
    """Return the limit for a text such as "lost > 5%"."""
    from locplan.advice import limits

    return limits.CheckLimit.parse(text)


Limits = Annotated[tuple[Any, ...], make_parser(parse_limit, "LIMIT", is_repeatable=True)]


@command(
    "check lab.yaml --lidar turtlebot4 --robot nav2_params.yaml -o report",
    "check lab.yaml --robot nav2_params.yaml --recording drive.npz -o report",
    "check lab.yaml --robot robot.yaml --fail-if 'lost > 5%'",
)
def check(
    map_file: MapFile,
    /,
    *,
    recording: RecordingFiles = (),
    stations: InputFile = None,
    effort: Literal["quick", "usual", "thorough"] = "usual",
    fail_if: Limits = (),
    robot: RobotOptions = RobotOptions(),
    filter_map: FilterMapFile = None,
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> int:
    """Find where a robot gets lost on a map, and the best fix.

    Simulates the robot along routes, then each applicable fix on the same routes.
    Takes one to two minutes.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    stations
        Stations (CSV of name,x,y) or queries for the routes.
    effort
        Amount of simulated drives.
    fail_if
        Exit with 4 if this limit is exceeded, such as "lost > 5%". Repeatable.
    """
    from locplan.advice.check_result import Check
    from locplan.simulation.amcl_parameters import check_can_write_tuning

    output.check(Check.files)
    if output.output:
        check_can_write_tuning(robot.find_nav2_file("amcl"))
    grid = locplan.load_map(map_file)
    if recording:
        robot.check_recorded()
    recordings = [load_recording(file, grid, map_file) for file in recording]
    simulated = robot.load_recorded(recordings[0]) if recordings else robot.load()
    with show_progress_bar(f"checking {grid.name}", "") as progress:
        result = locplan.check(
            map_file,
            simulated,
            stations,
            recordings,
            filter_map=load_filter_map(filter_map, [map_file]) if filter_map else None,
            effort=effort,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    output.finish(result, output.output, robot.list_nav2_files())
    for limit in fail_if:
        print(format_one_line(limit.format_result(result)), file=sys.stderr)
    return LIMIT_EXCEEDED if any(limit.fails(result) for limit in fail_if) else 0

"""The command `landmarks`: propose places for poles or boxes."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    InputFile,
    Integer,
    MapFile,
    PathFiles,
    Position,
    check_ends,
    read_paths,
    show_default,
)
from locplan.app.cli.groups import SEED, OutputOptions, RobotOptions, Seed, Threads, load_zones
from locplan.errors import ConfigError


def _default_drives() -> int:
    from locplan.advice.landmarks import DRIVES

    return DRIVES


DriveCount = Annotated[Integer | None, show_default(_default_drives)]


@command(
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --robot nav2.yaml -o marked",
)
def landmarks(
    map_file: MapFile,
    /,
    *,
    start: Position = None,
    goal: Position = None,
    path: PathFiles = (),
    places: InputFile = None,
    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2",
    count: Integer = 6,
    zones: InputFile = None,
    drives: DriveCount = None,
    robot: RobotOptions = RobotOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Propose places for poles or boxes that help the robot to localize.

    Simulates drives without objects, with the proposed ones, and with randomly placed ones.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    start
        Start of the route, in metres.
    goal
        Goal of the route, in metres.
    path
        Path that the robot drives (CSV of x,y). Repeatable.
    places
        Places (CSV of name,x,y). The robot drives between all of them.
    object
        pole:DIAMETER or box:LENGTH,WIDTH, in metres.
    count
        Maximum number of objects.
    zones
        Zones (GeoJSON) or a keepout mask (map YAML) without objects.
    drives
        Number of verifying drives. 0 simulates nothing.
    """
    from locplan.advice.landmark_objects import parse_object
    from locplan.advice.landmarks import DRIVES, Landmarks, verify_landmarks
    from locplan.planning.queries import read_stations
    from locplan.simulation.drives import check_drive_count

    check_ends(start, goal)
    if bool(path) + (places is not None) + (start is not None) != 1:
        raise ConfigError("pass one of --path, --start and --goal, or --places")
    places_by_name = {"start": start, "goal": goal} if start and goal else None
    if places:
        stations = read_stations(places)
        places_by_name = {station.name: (station.x, station.y) for station in stations}
    kind = parse_object(object)
    drives = DRIVES if drives is None else drives
    check_drive_count(drives, allows_none=True)
    simulated, grid = robot.load_with_field_lidar(), locplan.load_map(map_file)
    output.check(Landmarks.files)
    with show_progress_bar("placing landmarks", "objects") as progress:
        result = locplan.place_landmarks(
            grid,
            kind,
            count,
            paths=read_paths(path) if path else None,
            places=places_by_name,
            robot=simulated,
            zones=load_zones(zones, grid),
            threads=threads,
            progress=progress,
        )
    verification = None
    if drives:
        with show_progress_bar("verifying the landmarks", "drives") as progress:
            verification = verify_landmarks(
                result, drives, seed=seed, threads=threads, progress=progress
            )
    output.finish(result, verification)

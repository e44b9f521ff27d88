"""The command that tells which places of a map a robot can be mistaken for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from locplan.cli._groups import (
    COSTS,
    FIELD,
    GENERAL,
    Count,
    Force,
    Json,
    MapFile,
    Seed,
    Text,
    command,
    option_group,
    results,
)
from locplan.cli._options import RobotRadius, Threads, radius_of
from locplan.cli._route_options import LidarOptions
from locplan.cli._values import load, refuse, show, two_numbers

app = command(
    "twins",
    "twins lab.yaml --lidar rplidar-a1 -o alike",
    "twins lab.yaml --lidar rplidar-a1 --at 2,3",
)


@option_group(GENERAL)
class Asked:
    """What is asked for."""

    at: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Only the twins of this place are looked for [m]."""
    starts: Count | None = None
    """So many starts are proposed at most; 5 by default."""
    spacing: float | None = None
    """The distance between neighbouring places is 0.8 by default [m]."""
    matches: Annotated[int, Parameter()] = 0
    """So many noisy scans from random poses are matched with the map, to check what is foreseen;
    none by default."""
    seed: Seed | None = None
    """The seed of these scans is 1 by default."""


@option_group(FIELD)
class Compared:
    """How scans are compared."""

    global_effective_beams: float | None = None
    """All beams together tell as much as so many independent ones, 36 by default; it is fitted to
    global matches, and not the number of scan."""
    count_missing: bool = False
    """A beam without a return counts against places where it would meet a wall in range; AMCL
    ignores such beams."""


@app.default
def twins(
    map_file: MapFile,
    /,
    *,
    asked: Asked = Asked(),
    robot_radius: Annotated[RobotRadius, Parameter(group=COSTS)] = None,
    lidar_options: LidarOptions = LidarOptions(),
    compared: Compared = Compared(),
    threads: Threads = None,
    output: Annotated[
        Path | None,
        results("The layers (CSV, NPZ), symmetries, starts and a picture go to this folder."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find places that look alike to the lidar, the map's symmetries, and where to start the robot.

    It is about matching single scans with the whole map. AMCL's own global localization, which
    spreads particles and drives, is not foreseen well.
    """
    from locplan import twins as core
    from locplan._util.checks import whole
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.twins import _reports as reports
    from locplan.twins._find import SPACING
    from locplan.twins._matching import GLOBAL_EFFECTIVE_BEAMS
    from locplan.twins._twins import STARTS

    options: dict[str, Any] = {}
    if asked.at is not None:
        refuse("with --at", starts=asked.starts, spacing=asked.spacing)
        refuse("with --at", matches=asked.matches or None)
        options["places"] = [two_numbers("at", asked.at)]
    if asked.matches:
        whole("--matches", asked.matches, 2, 100_000)
    else:
        refuse("without --matches", seed=asked.seed)
    lidar = lidar_options.named()
    folder = reports.TWINS.into(output, force=force) if output else None
    grid = load(map_file)
    beams = compared.global_effective_beams
    with progress_bar("looking for twins", "poses") as progress:
        found = core.find_twins(
            grid,
            lidar=lidar,
            spacing=SPACING if asked.spacing is None else asked.spacing,
            global_effective_beams=GLOBAL_EFFECTIVE_BEAMS if beams is None else beams,
            robot_radius=radius_of(robot_radius),
            count_missing=compared.count_missing,
            threads=threads,
            progress=progress,
            **options,
        )
    place = None if asked.at is None else 0
    starts = [] if asked.at else found.best_starts(asked.starts or STARTS)
    matches = None
    if asked.matches:
        seed = 1 if asked.seed is None else asked.seed
        with progress_bar("matching scans", "scans") as progress:
            matches = found.verify(asked.matches, seed=seed, threads=threads, progress=progress)
    about = found, starts, matches, place
    if folder:
        with working("writing the twins"):
            reports.write_twins(folder, *about)
    show(json, reports.twins_summary(*about), reports.twins_table(*about), output)

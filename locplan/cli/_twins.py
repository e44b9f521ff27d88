"""The command that tells which places of a map a robot can be mistaken for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from locplan.cli._groups import (
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
from locplan.cli._kinds import given_of
from locplan.cli._options import Threads
from locplan.cli._robot_options import RobotOptions
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
    """Place whose twins are looked for, x,y in metres; all places by default."""
    starts: Count | None = None
    """Greatest number of starts that are proposed; 5 by default."""
    spacing: float | None = None
    """Distance between neighbouring places, in metres; 0.8 by default."""
    matches: Annotated[int, Parameter()] = 0
    """Number of noisy scans from random poses that are matched with the map, to check what is
    foreseen; none by default."""
    seed: Seed | None = None
    """Seed of these scans; 1 by default."""


@option_group(FIELD)
class Compared:
    """How scans are compared."""

    global_effective_beams: float | None = None
    """Number of independent beams that tell as much as all together; 36 by default. It is fitted
    to global matches, and not the number of scan."""
    count_missing: bool = False
    """Count beams without a return against places where they would meet a wall in range; AMCL
    ignores such beams."""


@app.default
def twins(
    map_file: MapFile,
    /,
    *,
    asked: Asked = Asked(),
    robot_options: RobotOptions = RobotOptions(),
    compared: Compared = Compared(),
    threads: Threads = None,
    output: Annotated[
        Path | None,
        results("Folder for the layers (CSV, NPZ), symmetries, starts and a picture."),
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

    options: dict[str, Any] = given_of(compared)
    if asked.spacing is not None:
        options["spacing"] = asked.spacing
    if asked.at is not None:
        refuse("with --at", starts=asked.starts, spacing=asked.spacing)
        refuse("with --at", matches=asked.matches or None)
        options["places"] = [two_numbers("at", asked.at)]
    if asked.matches:
        whole("--matches", asked.matches, 2, 100_000)
    else:
        refuse("without --matches", seed=asked.seed)
    robot = robot_options.load()
    if output:
        core.Twins.files.into(output, force=force)
    grid = load(map_file)
    with progress_bar("looking for twins", "poses") as progress:
        found = core.find_twins(
            grid,
            robot,
            threads=threads,
            progress=progress,
            **options,
        )
    most = () if asked.starts is None else (asked.starts,)
    starts = [] if asked.at else found.best_starts(*most)
    matches = None
    if asked.matches:
        seed = 1 if asked.seed is None else asked.seed
        with progress_bar("matching scans", "scans") as progress:
            matches = found.verify(asked.matches, seed=seed, threads=threads, progress=progress)
    if output:
        with working("writing the twins"):
            found.save(output, starts, matches, force=force)
    show(json, found.summary(starts, matches), found.report(starts, matches), output)

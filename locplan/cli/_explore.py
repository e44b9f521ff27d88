"""The command that opens the explorer."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import (
    COMPUTING,
    DRIVE,
    INPUT,
    OUTPUT,
    Force,
    MapFile,
    Text,
    command,
)
from locplan.cli._options import CacheDir, CostOptions, FieldOptions, Threads, radius_of
from locplan.cli._simulation_options import FilterOptions
from locplan.cli._values import load, two_numbers

NEXT = {
    False: "the page opens in your browser, or open the address above; Ctrl-C ends it",
    True: "open the address above in a browser on this machine; Ctrl-C ends the page",
}
"""What the user does next, with and without `--no-browser`."""

app = command(
    "explore",
    "explore lab.yaml --lidar turtlebot4",
    "explore lab.yaml --lidar turtlebot4 --start 2,3 --goal 38,3 --drive drive.mcap -o edited",
)


@app.default
def explore(
    map_file: MapFile,
    /,
    *,
    start: Annotated[
        Text | None, Parameter(metavar="X,Y", help="The path starts here at first [m].")
    ] = None,
    goal: Annotated[
        Text | None, Parameter(metavar="X,Y", help="The path ends here at first [m].")
    ] = None,
    via: Annotated[
        tuple[Text, ...],
        Parameter(
            metavar="X,Y",
            allow_leading_hyphen=True,
            help="The path visits this on its way at first [m]; repeatable.",
        ),
    ] = (),
    port: Annotated[
        int, Parameter(help="The page is served on this port of this machine; by default any.")
    ] = 0,
    no_browser: Annotated[bool, Parameter(help="No browser is opened.")] = False,
    drive: Annotated[
        tuple[Path, ...],
        INPUT,
        Parameter(
            group=DRIVE, metavar="FILE", help="This recorded drive can be shown; repeatable."
        ),
    ] = (),
    simulation: FilterOptions = FilterOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    threads: Threads = None,
    cache_dir: Annotated[CacheDir, Parameter(group=COMPUTING)] = None,
    folder: Annotated[
        Path | None,
        Parameter(
            name=("--folder", "-o"),
            group=OUTPUT,
            help="The page may write maps and exports to this folder; without it, it writes none.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Explore a map in the browser: drag start and goal, change the lidar, draw walls.

    The page is for this machine alone, at the address that is printed. Ctrl-C ends it,
    with exit code 0.
    """
    from locplan._util.progress import progress_bar
    from locplan._util.supervision import end_if_supervised
    from locplan._util.working import working
    from locplan.explorer._drives import RecordedDrive
    from locplan.explorer._explore import check_installed, opened
    from locplan.explorer._scene import Opening
    from locplan.field import lidar_of

    check_installed()
    config = options.to_config()
    costs.check(config)
    lidar = options.own_lidar(config)
    ends = [xy and two_numbers(name, xy) for name, xy in (("start", start), ("goal", goal))]
    stops = tuple(two_numbers("via", xy) for xy in via)
    robot, _ = simulation.robot(lidar or lidar_of(config), config=options.config, lints=False)
    grid = load(map_file)
    drives = []
    for file in drive:
        with progress_bar(f"reading {file.name}", "messages") as progress:
            drives.append(RecordedDrive.read(file, progress))
    opening = Opening(
        config,
        lidar=lidar,
        robot_radius=radius_of(costs.robot_radius, simulation.params),
        criterion=costs.criterion,
        weight=costs.weight,
        start=ends[0] or None,
        goal=ends[1] or None,
        via=stops,
        folder=folder,
        drives=tuple(drives),
        cache_dir=cache_dir,
        threads=threads,
        map_file=str(map_file),
        force=force,
        **robot,
    )
    with working("opening the page"):
        page = opened(grid, opening, port=port)
    with page:
        try:
            print(page.address, flush=True)
            print(f"locplan: {NEXT[no_browser]}", file=sys.stderr, flush=True)
            if not no_browser:
                page.open()
            page.wait()
        except KeyboardInterrupt:  # the usual end of this command
            end_if_supervised(0)

"""The command that opens the explorer."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from locplan.cli._options import CacheDir, CostOptions, FieldOptions, Threads
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, two_numbers

if TYPE_CHECKING:
    from locplan.explorer import Explorer

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
        Text | None, Parameter(metavar="X,Y", help="First start of the path, x,y in metres.")
    ] = None,
    goal: Annotated[
        Text | None, Parameter(metavar="X,Y", help="First goal of the path, x,y in metres.")
    ] = None,
    via: Annotated[
        tuple[Text, ...],
        Parameter(
            metavar="X,Y",
            allow_leading_hyphen=True,
            help="Place to visit on the way at first, x,y in metres; repeatable.",
        ),
    ] = (),
    port: Annotated[
        int, Parameter(help="Port of this machine that the page is served on; by default any.")
    ] = 0,
    no_browser: Annotated[bool, Parameter(help="Open no browser.")] = False,
    drive: Annotated[
        tuple[Path, ...],
        INPUT,
        Parameter(
            group=DRIVE, metavar="FILE", help="Recorded drive that can be shown; repeatable."
        ),
    ] = (),
    robot_options: RobotOptions = RobotOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    threads: Threads = None,
    cache_dir: Annotated[CacheDir, Parameter(group=COMPUTING)] = None,
    folder: Annotated[
        Path | None,
        Parameter(
            name=("--folder", "-o"),
            group=OUTPUT,
            help="Folder that the page may write maps and exports to; without it, it writes none.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Explore a map in the browser: drag start and goal, change the lidar, draw walls.

    The page is for this machine alone, at the address that is printed. Ctrl-C ends it,
    with exit code 0.
    """
    from locplan._util.progress import progress_bar, working
    from locplan._util.supervision import end_if_supervised
    from locplan.explorer import Opening, RecordedDrive, check_installed, opened

    check_installed()
    robot, config = options.with_robot(robot_options)
    costs.check(config)
    ends = [xy and two_numbers(name, xy) for name, xy in (("start", start), ("goal", goal))]
    stops = tuple(two_numbers("via", xy) for xy in via)
    grid = load(map_file)
    drives = []
    for file in drive:
        with progress_bar(f"reading {file.name}", "messages") as progress:
            drives.append(RecordedDrive.read(file, progress))
    opening = Opening(
        config,
        robot,
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
    )
    with working("opening the page"):
        page = opened(grid, opening, port=port)
    with page:
        try:
            _show(page, no_browser)
        except KeyboardInterrupt:  # the usual end of this command
            end_if_supervised(0)


def _show(page: Explorer, no_browser: bool) -> None:
    """Say where the page is, and serve it until Ctrl-C."""
    print(page.address, flush=True)
    print(f"locplan: {NEXT[no_browser]}", file=sys.stderr, flush=True)
    if not no_browser:
        page.open()
    page.wait()

"""The command that opens the explorer."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar, working
from locplan._util.supervision import end_if_supervised
from locplan.cli import _types as typed
from locplan.cli._options import Cached, CostOptions, DriveFiles, Ends, Force, Reference, Threads
from locplan.cli._robot_options import FieldOptions


@typed.command(
    "explore lab.yaml --lidar turtlebot4",
    "explore lab.yaml --lidar turtlebot4 --start 2,3 --goal 38,3 --drive drive.mcap -o edited",
)
class explore(typed.OneMap, FieldOptions, Ends, CostOptions, Reference, Cached, Threads):
    """Explore a map in the browser: drag start and goal, change the lidar, draw walls.

    The page is for this machine alone, at the address that is printed. Ctrl-C ends it,
    with exit code 0.
    """

    start: typed.XY = None
    """First start of the path, x,y in metres."""
    goal: typed.XY = None
    """First goal of the path, x,y in metres."""
    via: Annotated[tuple[Any, ...], typed.parsed(typed.two_numbers, "X,Y", many=True)] = ()
    """Place to visit on the way at first, x,y in metres; repeatable."""
    port: int = 0
    """Port of this machine that the page is served on; by default any."""
    no_browser: bool = False
    """Open no browser."""
    drive: DriveFiles = ()
    """Recorded drive that can be shown; repeatable."""
    folder: Annotated[Path | None, Parameter(name=("--folder", "-o")), typed.under("Output")] = None
    """Folder that the page may write maps and exports to; without it, it writes none."""
    force: Force = False

    def __call__(self) -> None:
        locplan.explorer.check_installed()
        robot, config = self.robot_and_field()
        self.check_costs(config)
        if not self.drive:
            self.refuse("without --drive", Reference)
        grid = locplan.load_map(self.map_file)
        drives = []
        for file in self.drive:
            with progress_bar(f"reading {file.name}", "messages") as progress:
                drive = locplan.explorer.RecordedDrive.of(file, progress)
            with progress_bar(f"smoothing {file.name}", "") as progress:
                where = self.given(Reference, "cache_dir")
                drives.append(drive.on(grid, **where, progress=progress))
        opening = locplan.explorer.Opening(
            config,
            robot,
            **self.given(CostOptions, Cached, Threads, "folder", "force"),
            **self.given(Ends, "via"),
            drives=tuple(drives),
            map_file=str(self.map_file),
        )
        with working("opening the page"):
            page = locplan.explorer.opened(grid, opening, port=self.port)
        browse = "the page opens in your browser, or open the address above; Ctrl-C ends it"
        if self.no_browser:
            browse = "open the address above in a browser on this machine; Ctrl-C ends the page"
        with page:
            try:
                print(page.address, flush=True)
                print(f"locplan: {browse}", file=sys.stderr, flush=True)
                if not self.no_browser:
                    page.open()
                page.wait()
            except KeyboardInterrupt:  # the usual end of this command
                end_if_supervised(0)

"""The command that opens the explorer."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import working
from locplan.cli import _types as typed
from locplan.cli._options import Cached, CostOptions, Ends, Force, Threads
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan import FieldConfig, Lidar, Robot
    from locplan.explorer import CheckReport


@typed.command(
    "explore lab.yaml --lidar turtlebot4",
    "explore --check report",
    "explore lab.yaml --lidar turtlebot4 --start 2,3 --goal 38,3 -o edited",
)
class explore(FieldOptions, Ends, CostOptions, Cached, Threads):
    """Explore a map in the browser: drag start and goal, change the lidar, draw walls.

    The page is for this machine alone, at the address that is printed. Ctrl-C ends it.
    """

    map_file: Annotated[
        Path | None, *typed.MAPS, Parameter(help="Map, as for plan; none with --check.")
    ] = dataclasses.field(default=None, kw_only=False)
    check: Annotated[Path | None, Parameter(metavar="FOLDER")] = None
    """Folder that check has written, instead of a map: with its map and robot, the page shows its
    weak spots, routes and fixes."""
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
    folder: Annotated[Path | None, Parameter(name=("--folder", "-o")), typed.under("Output")] = None
    """Folder that the page may write maps and exports to; without it, it writes none."""
    force: Force = False

    def __call__(self) -> None:
        locplan.explorer.check_installed()
        map_file, report = self._opened_on()
        robot, config = self.robot_and_field()
        self.check_costs(config)
        grid = locplan.load_map(map_file)
        opening = locplan.explorer.Opening(
            config,
            robot,
            **self.given(CostOptions, Cached, Threads, "folder", "force"),
            **(report.ends if report else {}) | self.given(Ends, "via"),
            report=report,
        )
        with working("opening the page"):
            page = locplan.explorer.opened(grid, opening, port=self.port)
        browse = "the page opens in your browser, or open the address above; Ctrl-C ends it"
        if self.no_browser:
            browse = "open the address above in a browser on this machine; Ctrl-C ends the page"
        with page:
            print(page.address, flush=True)
            print(f"locplan: {browse}", file=sys.stderr, flush=True)
            if not self.no_browser:
                page.open()
            page.wait()

    def robot_and_field(self) -> tuple[Robot, FieldConfig]:
        """The robot and the settings of the field, which are those of the check on a report."""
        robot, config = super().robot_and_field()
        if self.check and self.stride is None and self.config is None:
            config = dataclasses.replace(config, stride=locplan.explorer.CheckReport.stride)
        return robot, config

    def load_robot(self, lidar: Lidar | None = None, *, recorded: bool = False) -> Robot:
        """The robot, that of the report where there is one."""
        if self.check:
            return locplan.explorer.CheckReport.read(self.check).robot
        return super().load_robot(lidar, recorded=recorded)

    def _opened_on(self) -> tuple[Path, CheckReport | None]:
        """The file of the map, and the report that names it, if it is one that does."""
        if self.check:
            if self.map_file:
                raise ConfigError("--check names the map itself; leave out one of the two")
            self.refuse("with --check, whose robot is taken", RobotOptions)
            report = locplan.explorer.CheckReport.read(self.check)
            return report.map_file, report
        if self.map_file is None:
            raise ConfigError("name a map, or with --check the folder that check has written")
        return self.map_file, None

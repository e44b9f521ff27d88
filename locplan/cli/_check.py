"""The command that shows where a robot fails on a map, and which fixes help."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _options as shared, _types as typed
from locplan.cli._application import BEYOND_LIMIT
from locplan.cli._robot_options import FilterMap
from locplan.errors import ConfigError, one_line

if TYPE_CHECKING:
    from locplan.diagnosis import Limit


def limit(_: str, text: str) -> Limit:
    """A limit as it is typed."""
    return locplan.diagnosis.Limit.parse(text)


@typed.command(
    "check lab.yaml --lidar turtlebot4 --robot nav2_params.yaml -o report",
    "check lab.yaml --lidar turtlebot4 --stations stations.csv --quick",
    "check lab.yaml --robot robot.yaml --fail-if 'lost > 5%'",
)
class check(typed.OneMap, FilterMap, shared.ReferencedOptions, shared.Seeded, shared.Output):
    """Find where a robot gets lost on a map, and the fix that helps most.

    check finds faults and weak spots of the map, and simulates the robot with its
    own filter along routes, in open and in closed loop. It simulates each
    applicable fix on the same routes: the repaired map, two presets of AMCL settings,
    other paths, landmarks. With --drive, settings must hold when they are replayed over
    the whole drive. The last lines name the one thing to do next. With --output check
    writes the files for it, and a report for the browser.

    Takes a minute or two.
    """

    drive: shared.DriveFiles = ()  # type: ignore[assignment]  # other commands take one
    """Recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ; repeatable."""
    stations: Annotated[Path | None, typed.INPUT, Parameter(metavar="CSV")] = None
    """Stations (name,x,y) between which routes lead, or queries
    (name,start_x,start_y,goal_x,goal_y); by default places far apart in each room."""
    quick: Annotated[bool, typed.under("Simulation")] = False
    """Simulate a third of the drives, and try neither other paths nor landmarks."""
    thorough: Annotated[bool, typed.under("Simulation")] = False
    """Simulate three times as many drives."""
    fail_if: Annotated[tuple[Any, ...], typed.parsed(limit, "LIMIT", many=True)] = ()
    """Limit of lost, reached, error, degenerate or faults, such as "lost > 5%"; the exit code is 4
    if the figure's whole interval is beyond it; repeatable."""

    def __call__(self) -> int:
        self._check()
        grid = locplan.load_map(self.map_file)
        recordings = [self.referenced(grid, file) for file in self.drive]
        robot = self.robot_on(recordings[0]) if recordings else self.load_robot()
        every: dict[str, Any] = {"seed": self.seed, "threads": self.threads, "found": _tell}
        every["filter_map"] = self.load_filter_map(grid) if self.filter_map else None
        effort: Any = next(iter(self.given("quick", "thorough")), "usual")
        with progress_bar("checking", "") as progress:
            found = locplan.check(
                self.map_file,
                robot,
                self.stations,
                recordings,
                effort=effort,
                progress=progress,
                **every,
            )
        self.finish(found, self.output, self.nav2_files())
        for each in self.fail_if:
            print(one_line(each.said(found)), file=sys.stderr)
        return BEYOND_LIMIT if any(each.fails(found) for each in self.fail_if) else 0

    def _check(self) -> None:
        """Raise a LocplanError for options that cannot be used; before long work."""
        if self.quick and self.thorough:
            raise ConfigError("--quick and --thorough exclude each other; leave one out")
        self.check_drive()
        self.check_output(locplan.Check.files)
        if self.output:
            locplan.simulation.check_tunable(self.nav2_file("amcl"))


def _tell(finding: str) -> None:
    """Print a finding as it comes, if somebody sees the progress."""
    if sys.stderr.isatty():
        print(one_line(finding), file=sys.stderr, flush=True)

"""The commands that propose landmarks, and that mend a map."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import Ends, Output, Seeded, read_paths
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError


@typed.command(
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --robot nav2_params.yaml -o marked",
)
class landmarks(typed.OneMap, RobotOptions, Ends, Seeded, Output):
    """Propose places for poles or boxes that keep the robot from getting lost on its routes.

    Drives with your own filter, before, after and with random places, say whether they help.
    """

    path: typed.Csv = ()
    """Path of the robot (x,y); repeatable."""
    places: Annotated[Path | None, typed.INPUT, Parameter(metavar="CSV")] = None
    """Places (name,x,y) between all of which the robot drives."""
    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2"
    """Poles (pole:DIAMETER) or boxes (box:LENGTH,WIDTH), in metres; pole:0.2 by default."""
    count: int = 6
    """Maximum number of objects; 6 by default."""
    keep_out: Annotated[
        Any, typed.parsed(partial(typed.numbers, count=4), "X0,Y0,X1,Y1", many=True)
    ] = None
    """Rectangle in which no object may stand, in metres; repeatable."""
    drives: int = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""

    def __call__(self) -> None:
        routes = self._routes()
        kind = locplan.landmarks.parsed_object(self.object)
        locplan.simulation.check_drives(self.drives, or_none=True)
        robot = self.simulated()
        grid = locplan.load_map(self.map_file)
        self.check_output(locplan.Landmarks.files)
        every = self.given("keep_out", "threads")
        with progress_bar("placing landmarks", "objects") as progress:
            made = locplan.place_landmarks(
                grid, kind, self.count, **routes, robot=robot, **every, progress=progress
            )
        verification = None
        if self.drives:
            with progress_bar("verifying by drives", "drives") as progress:
                verification = locplan.landmarks.verify_landmarks(
                    made, self.drives, **self.given(Seeded), progress=progress
                )
        self.finish(made, verification)

    def _routes(self) -> dict[str, Any]:
        """The paths, or the places that routes join; a ConfigError unless there is one of them."""
        if len(self.given("path", "places")) + bool(self.start or self.goal) != 1:
            raise ConfigError("give one of --path, --start with --goal, and --places")
        if self.path:
            return {"paths": read_paths(self.path)}
        if self.places:
            stations = locplan.planners.read_stations(self.places)
            return {"places": {each.name: (each.x, each.y) for each in stations}}
        return {"places": dict(zip(("start", "goal"), self.ends() or (), strict=True))}


@typed.command("mend lab.yaml --robot nav2_params.yaml -o mended")
class mend(typed.OneMap, RobotOptions, Seeded, Output):
    """Mend a map for the robot's filter, and drive with it in simulation to see what it gains.

    Walls that are black inside are hollowed, and specks erased. The map for planning stays; the
    folder has the filter's, map_amcl.yaml, with what Nav2 needs to publish it to AMCL alone.
    """

    paths: typed.Count = 5
    """Number of random shortest paths that are driven; 5 by default."""
    drives: typed.Pair = 8
    """Number of drives along each path, with each map and filter; 8 by default."""

    def __call__(self) -> None:
        self.check_output(locplan.mending.Mended.files)
        locplan.mending.check_concerned(self.nav2_file("amcl"))
        robot, grid = self.load_robot(), locplan.load_map(self.map_file)
        every = self.given("paths", "drives", Seeded)
        every["source"] = locplan.maps.read_map(self.map_file)[1]
        with progress_bar(f"mending {grid.name}", "drives") as progress:
            found = locplan.mend(grid, robot, progress=progress, **every)
        self.finish(found)

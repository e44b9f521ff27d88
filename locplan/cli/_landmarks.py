"""The commands that find key features on routes, and that propose landmarks."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import DriveFiles, Ends, Output, ReferencedOptions, Seeded, read_paths
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError


@typed.option_group("Options")
class RouteOptions(Ends):
    """The routes of the robot."""

    path: typed.Csv = ()
    """Path of the robot (x,y); repeatable."""
    start: typed.XY = None
    """Start of a shortest path, x,y in metres."""
    places: Annotated[Path | None, typed.INPUT, Parameter(metavar="CSV")] = None
    """Places (name,x,y) between all of which the robot drives."""
    drives: int = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""

    def ways(self, *others: str) -> dict[str, Any]:
        """The paths or places, or nothing with one of the others; it must be one of them all."""
        if len(self.given("path", "places", *others)) + bool(self.start or self.goal) != 1:
            names = ["--path", "--start with --goal", "--places", *map(typed.flag, others)]
            raise ConfigError(f"give one of {', '.join(names[:-1])}, and {names[-1]}")
        if self.path:
            return {"paths": read_paths(self.path)}
        if self.places:
            stations = locplan.planners.read_stations(self.places)
            return {"places": {each.name: (each.x, each.y) for each in stations}}
        ends = self.ends()
        return {"places": dict(zip(("start", "goal"), ends, strict=True))} if ends else {}

    def verified(self, found: Any) -> Any:
        """The drives that verify what was found; None without."""
        if not self.drives:
            return None
        with progress_bar("verifying by drives", "drives") as progress:
            return found.verify(self.drives, **self.given(Seeded), progress=progress)


@typed.command(
    "features lab.yaml --start 2,3 --goal 38,3 -o found",
    "features lab.yaml --path mine.csv --robot nav2_params.yaml --count 2 -o found",
)
class features(typed.OneMap, RobotOptions, RouteOptions, Seeded, Output):
    """Find the pillars, shelves and corners that localization on your routes depends on.

    Drives with your own filter, in a world that lacks the worst of them, say whether it is so.
    """

    count: typed.Count = 3
    """Number of features that are taken away together; 3 by default."""
    piece: float = 1.0
    """Length of the pieces of walls, in metres; about 1 by default."""
    largest: float = 4.0
    """Maximum extent of an object, in metres; 4 by default."""
    shift: float = 0.3
    """Distance by which features are moved to see the error, in metres; 0.3 by default."""

    def __call__(self) -> None:
        ways = self.ways()
        locplan.simulation.check_drives(self.drives, or_none=True)
        robot = self.simulated()
        grid = locplan.load_map(self.map_file)
        self.check_output(locplan.KeyFeatures.files)
        taken = self.given("count", "piece", "largest", "shift")
        with progress_bar("taking features away", "features") as progress:
            found = locplan.key_features(grid, **ways, robot=robot, **taken, progress=progress)
        self.finish(found, self.verified(found) if found.together else None)


def region(name: str, text: str) -> tuple[float, ...] | str:
    """A rectangle, or the word all."""
    return text if text == "all" else typed.numbers(name, text, 4)


@typed.command(
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --robot nav2_params.yaml -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --count 8 --region all -o marked",
)
class landmarks(typed.OneMap, RobotOptions, RouteOptions, Seeded, Output):
    """Propose places for poles or boxes that keep the robot from getting lost on its ways.

    Drives with your own filter, before, after and with random places, say whether they help.
    """

    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2"
    """Poles (pole:DIAMETER) or boxes (box:LENGTH,WIDTH), in metres; pole:0.2 by default."""
    count: int = 6
    """Maximum number of objects; 6 by default."""
    region: Annotated[tuple[Any, ...], typed.parsed(region, "X0,Y0,X1,Y1", many=True)] = ()
    """Rectangle in which the robot may go anywhere, in metres, repeatable; "all" is the map."""
    where: Literal["walls", "free", "both"] = "both"
    """Places that are tried: along walls, in the open, or both, by default both."""
    spacing: float = 0.5
    """Distance between places along walls, in metres; 0.5 by default."""
    clearance: float = 0.2
    """Distance of routes and passages from the objects besides the robot's radius, in metres; 0.2
    by default."""
    keep_out: Annotated[
        Any, typed.parsed(partial(typed.numbers, count=4), "X0,Y0,X1,Y1", many=True)
    ] = None
    """Rectangle in which no object may stand, in metres; repeatable."""
    existing: typed.Poses = ()
    """Object of this kind in the map, which may be moved, x,y in metres; repeatable."""
    trials: typed.Count | None = None
    """Number of placements that are driven first, of which the best is taken; 4 by default, and 1
    without drives. Along routes the first two are by the two objectives."""

    def __call__(self) -> None:
        import numpy as np

        ways = self.ways("region")
        kind = locplan.landmarks.parsed_object(self.object)
        locplan.simulation.check_drives(self.drives, or_none=True)
        robot = self.simulated()
        sites = locplan.landmarks.Sites(**self.given(locplan.landmarks.Sites))
        grid = locplan.load_map(self.map_file)
        if self.region:
            ways["region"] = np.ones(grid.shape, bool) if "all" in self.region else self.region
        self.check_output(locplan.Landmarks.files)
        every = self.given("threads")
        with progress_bar("placing landmarks", "steps") as progress:
            made = locplan.place_landmarks(
                grid, kind, self.count, **ways, robot=robot, sites=sites, **every, progress=progress
            )
        tried = ({} if self.drives else {"trials": 1}) | self.given("trials")
        tried |= self.given(Seeded)
        with progress_bar("driving placements", "drives") as progress:
            made = locplan.landmarks.best_of_trials(made, **tried, progress=progress)
        self.finish(made, self.verified(made))


@typed.command(
    "mend lab.yaml --robot nav2_params.yaml -o mended",
    "mend lab.yaml --robot nav2_params.yaml --drive monday.mcap --drive friday.mcap -o mended",
)
class mend(typed.OneMap, RobotOptions, ReferencedOptions, Seeded, Output):
    """Mend a map for the robot's filter, and drive with it in simulation to see what it gains.

    Walls that are black inside are hollowed, and specks erased. With a recorded drive, walls that
    it sees through are erased, and missing ones drawn, if that explains more of the scans held out.
    The map for planning stays; the folder has the filter's, map_amcl.yaml, with what Nav2 needs to
    publish it to AMCL alone.
    """

    drive: DriveFiles = ()  # type: ignore[assignment]  # other commands take one
    """Recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ; repeatable."""

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
        self.check_drive()
        recordings = [self.referenced(grid, file) for file in self.drive]
        with progress_bar(f"mending {grid.name}", "drives") as progress:
            found = locplan.mend(grid, robot, recordings=recordings, progress=progress, **every)
        self.finish(found)

"""The command that finds where a robot was along a recorded drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import Cached, DriveOptions, Output
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError


@typed.command(
    "trajectory lab.yaml --drive monday.mcap -o monday",
    "trajectory lab.yaml --drive monday.mcap --start 2,3,90 --robot nav2_params.yaml",
)
class trajectory(typed.OneMap, RobotOptions, DriveOptions, Cached, Output):
    """Find where a robot was along a recorded drive, of its scans, its odometry and the map.

    The log's own poses are not read, but compared. Of a bag the folder gets a copy with the poses
    on topics of their own. What was interrupted goes on when it is called again.
    """

    start: typed.Pose = None
    """Pose at the first scan, x,y,deg in metres and degrees; anywhere on the map by default."""
    seed: typed.Seed = 1
    """Seed of all random numbers; 1 by default."""

    no_bag: Annotated[bool, typed.under("Output")] = False
    """Write no copy of the drive's bag with the poses."""

    def __call__(self) -> None:
        if self.start is not None and len(self.start) != 3:
            raise ConfigError("--start needs a heading: x,y,deg")
        self.check_output(locplan.Trajectory.files)
        drive, grid = self.read(), locplan.load_map(self.map_file)
        copy = None
        if self.output and self.drive and not self.no_bag:
            topics = locplan.recordings.Topics(**self.given(locplan.recordings.Topics))
            copy = locplan.recordings.BagCopy.of(self.drive, topics)
            self.check_output(locplan.Trajectory.files, *copy.files if copy else ())
        robot = self.robot_on(drive, replayed=False)
        every = self.given("start", "seed", Cached)
        with progress_bar("smoothing", "") as progress:
            found = locplan.recordings.trajectory_of(drive, grid, robot, progress=progress, **every)
        self.finish(replace(found, bag=copy))

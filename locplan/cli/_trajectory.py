"""The command that finds where a robot was along a recorded drive."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._options import CacheDir, DriveOptions, Output
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError


@typed.command(
    "trajectory lab.yaml --drive monday.mcap -o monday",
    "trajectory lab.yaml --drive monday.mcap --start 2,3,90 --robot nav2_params.yaml",
)
def trajectory(
    map_file: typed.MapFile,
    /,
    *,
    recorded: DriveOptions = DriveOptions(),
    start: typed.Pose = None,
    robot_options: RobotOptions = RobotOptions(),
    seed: typed.DriveSeed = 1,
    cache_dir: Annotated[CacheDir, Parameter(group=typed.heading("Computing"))] = None,
    out: Output = Output(),
) -> None:
    """Find where a robot was along a recorded drive, of its scans, its odometry and the map.

    The log's own poses are not read, but compared. What was interrupted goes on when it is called
    again.

    Parameters
    ----------
    start
        Pose at the first scan, x,y,deg in metres and degrees; anywhere on the map by default.
    """
    if start is not None and len(start) != 3:
        raise ConfigError("--start needs a heading: x,y,deg")
    out.check(locplan.Trajectory.files)
    drive, grid = recorded.read(), locplan.load_map(map_file)
    robot = robot_options.on_drive(drive, replayed=False)
    with progress_bar("smoothing", "") as progress:
        found = locplan.recordings.trajectory_of(
            drive, grid, robot, start=start, seed=seed, cache_dir=cache_dir, progress=progress
        )
    out.finish(found)

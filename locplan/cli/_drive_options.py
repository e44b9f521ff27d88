"""Options of the commands that read a recorded drive."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar, working
from locplan.cli._groups import INPUT, Count, option_group
from locplan.cli._values import given_of, move, parsed, refuse, two_numbers
from locplan.errors import ConfigError, LocplanError

if TYPE_CHECKING:
    from locplan.recordings import Recording

Move = Annotated[Any, parsed(move, "X,Y,DEG")]


@option_group("Recorded drive")
class DriveOptions:
    """A recorded drive, and how its file is read."""

    drive: Annotated[Path | None, INPUT, Parameter(metavar="FILE")] = None
    """Recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ."""
    every: Count | None = None
    """Step between the scans that are read; 1 by default, which is all."""
    scan_topic: Annotated[str | None, Parameter(metavar="TOPIC")] = None
    """Topic of the scans, where a bag has several."""
    pose_topic: Annotated[str | None, Parameter(metavar="TOPIC")] = None
    """Topic of the poses in a bag, in place of TF."""
    odom_topic: Annotated[str | None, Parameter(metavar="TOPIC")] = None
    """Topic of the odometry in a bag."""
    map_frame: Annotated[str | None, Parameter(metavar="FRAME")] = None
    """Frame of the poses in a bag; map by default."""
    base_frame: Annotated[str | None, Parameter(metavar="FRAME")] = None
    """Frame of the robot in a bag; that of its odometry, or base_footprint or base_link."""
    range_limits: Annotated[Any, parsed(two_numbers, "MIN,MAX")] = None
    """Distances between which a reading is a return, in metres, where the log's own are wrong."""
    mount: Move = None
    """Pose of the lidar on the robot, in metres and degrees, where the log does not have it."""
    align: Move = None
    """Turn of the recorded poses about the map frame's origin, in degrees, and shift after it, in
    metres, where the map was moved."""

    def check(self) -> None:
        """Raise a ConfigError if an option is given without a drive; before long work."""
        if self.drive is None:
            refuse("without --drive", **given_of(self))

    def read(self) -> Recording:
        """The drive, with a progress bar while it is read.

        Raises
        ------
        ConfigError
            If no drive was named.
        RecordingError
            If the file cannot be read, or holds no drive.
        """
        self.check()
        if self.drive is None:
            raise ConfigError("name a recorded drive with --drive")
        names = vars(locplan.recordings.Topics())
        with progress_bar(f"reading {self.drive.name}", "messages") as progress:
            recording = locplan.recordings.read_drive(
                self.drive,
                every=self.every or 1,
                topics=locplan.recordings.Topics(
                    **{name: value for name, value in given_of(self).items() if name in names}
                ),
                range_limits=self.range_limits,
                mount=self.mount,
                progress=progress,
            )
        return recording.moved(*self.align) if self.align else recording

    def on_map(self, maps: Sequence[Path]) -> tuple[locplan.OccupancyGrid, Recording]:
        """The map, and the drive on it.

        Where the map does not fit, a warning says so if the user has aligned the drive.

        Raises
        ------
        LocplanError
            If there are several maps, the map does not fit, or a file cannot be read.
        """
        files = locplan.maps.find_maps(*maps)
        if len(files) != 1:
            raise ConfigError(f"--drive is of one map, not of {len(files)}; name the one it was on")
        grid, drive = locplan.load_map(files[0]), self.read()
        with working("looking whether the map fits"):
            fit = locplan.recordings.fit_to_map(drive, grid)
        if not fit.fits:
            x, y, turn = fit.move
            way = f" (--align {x:.3f},{y:.3f},{math.degrees(turn):.2f})" if fit.shifted else ""
            fault = f"{files[0]}: {fit.sentence.rstrip('.')}{way}"
            if self.align is None:
                raise LocplanError(f"{fault}; --align 0,0,0 goes on as it is")
            warnings.warn(locplan.maps.MapWarning(fault), stacklevel=2)
        return grid, drive

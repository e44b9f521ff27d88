"""The commands of recorded drives: where a robot was, and what its scans and odometry say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar, working
from locplan.cli import _types as typed
from locplan.cli._options import Cached, DriveOptions, Output, ReferencedOptions, Threads
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.recordings import Recording


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


@typed.command("evaluate lab.yaml --drive monday.mcap --every 10 -o evaluated")
class evaluate(typed.ManyMaps, ReferencedOptions, Threads, Output):
    """Show how well each field predicts where the scans of a recorded drive fix the pose badly."""

    def __call__(self) -> None:
        self.check_output(locplan.recordings.DriveEvaluation.files)
        grid, drive = self.on_map(self.maps)
        with progress_bar("comparing fields", "fields") as progress:
            found = locplan.recordings.evaluate_drive(
                drive, grid, threads=self.threads, progress=progress
            )
        self.finish(found)


@typed.command(
    "calibrate lab.yaml --drive monday.mcap -o robot.json",
    "simulate lab.yaml --random 20 --robot robot.json",
)
class calibrate(typed.ManyMaps, RobotOptions, ReferencedOptions, Threads, Output):
    """Fit the noise of odometry and ranges, outliers and blocked beams to a recorded drive.

    Simulations with the robot of the written file have them.
    """

    output: Annotated[Path, typed.Target, typed.under("Output")] = Path("calibrated.json")
    """File for the robot, for --robot of other commands; calibrated.json by default."""

    def __call__(self) -> None:
        locplan.recordings.check_calibration(self.output, force=self.force)
        grid, recording = self.on_map(self.maps)
        robot = self.robot_on(recording, replayed=False)
        with progress_bar("calibrating", "scans") as progress:
            found = locplan.recordings.calibrate_drive(
                recording, grid, robot, threads=self.threads, progress=progress
            )
        self.finish(found)


@typed.command(
    "locate lab.yaml --drive monday.mcap --at 12.5 -o located",
    "locate lab.yaml --drive monday.mcap --scan 40 --near-path route.csv",
    "locate lab.yaml --drive monday.mcap --every 20 -o located",
)
class locate(typed.OneMap, DriveOptions, Threads, Output):
    """Find where on the map the scans of a drive were taken, without their recorded poses.

    Places that explain a scan have weights, so that you see which ones look alike.
    """

    scan: Annotated[
        int | None, typed.under("Recorded drive"), Parameter(validator=Number(gte=0))
    ] = None
    """Number of the scan, from 0 on; by default each scan is located, by itself."""
    at: Annotated[float | None, typed.under("Recorded drive"), Parameter(metavar="SECONDS")] = None
    """Time of the scan after the first one, in seconds."""
    near_path: Annotated[Path | None, typed.INPUT, Parameter(metavar="CSV")] = None
    """Path (x,y) near which places are looked at; by default all are."""
    within: float | None = None
    """Maximum distance of these from the path, in metres; 3 by default."""
    count: typed.Count | None = None
    """Maximum number of places that are kept; 10 by default."""

    def __call__(self) -> None:
        if self.drive is None:
            raise ConfigError("name a recorded drive with --drive")
        if self.scan is not None:
            self.refuse("with --scan", "at", "every")
        if self.at is not None:
            self.refuse("with --at", "every")
        if self.near_path is None:
            self.refuse("without --near-path", "within")
        given = self.given("within", "count", "threads")
        if self.near_path:
            given["near"] = locplan.Path.load(self.near_path)
        self.check_output(locplan.recordings.LocatedDrive.files)
        grid, drive = locplan.load_map(self.map_file), self._chosen(self.read(needs_poses=False))
        with working("looking around at all places of the map"):
            database = locplan.ScanDatabase(grid, drive.lidar)
            _ = database.everywhere
        with progress_bar("locating scans", "scans") as progress:
            found = locplan.recordings.locate_drive(
                drive, grid, **given, database=database, progress=progress
            )
        self.finish(found)

    def _chosen(self, drive: Recording) -> Recording:
        """The recording of the scan that was asked for, or of all; a ConfigError without it."""
        scan = self.scan
        if self.at is not None:
            if drive.times is None:
                raise ConfigError("the drive has no times; choose by --scan")
            after = drive.times - drive.times[0]
            if not 0 <= self.at <= after[-1]:
                raise ConfigError(
                    f"--at must lie within the drive's {after[-1]:.4g} s, not be {self.at:g}"
                )
            scan = int(abs(after - self.at).argmin())
        if scan is None:
            return drive
        if scan >= len(drive):
            raise ConfigError(f"--scan must be below the drive's {len(drive)} scans, not {scan}")
        return drive[scan : scan + 1]

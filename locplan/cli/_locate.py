"""The command that finds where on a map scans of a recorded drive were taken."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    DRIVE,
    GENERAL,
    INPUT,
    Count,
    MapFile,
    command,
    option_group,
)
from locplan.cli._options import Threads
from locplan.cli._output import Output
from locplan.cli._values import load, refuse
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.recordings import Recording

app = command(
    "locate",
    "locate lab.yaml --drive monday.mcap --at 12.5 -o located",
    "locate lab.yaml --drive monday.mcap --scan 40 --near-path route.csv",
    "locate lab.yaml --drive monday.mcap --every 20 -o located",
)


@option_group(DRIVE)
class ScanOptions:
    """The scan of the drive."""

    scan: Annotated[int | None, Parameter(validator=Number(gte=0))] = None
    """Number of the scan, from 0 on; by default each scan is located, by itself."""
    at: Annotated[float | None, Parameter(metavar="SECONDS")] = None
    """Time of the scan after the first one, in seconds."""

    def chosen(self, drive: Recording) -> Recording:
        """The recording of the scan that was asked for, or of all.

        Raises
        ------
        ConfigError
            If there is no such scan.
        """
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


@option_group(GENERAL)
class LocateOptions:
    """Where the robot is looked for."""

    near_path: Annotated[Path | None, INPUT, Parameter(metavar="CSV")] = None
    """Path (x,y) near which places are looked at; by default all are."""
    within: float | None = None
    """Greatest distance of these from the path, in metres; 3 by default."""
    count: Count | None = None
    """Greatest number of places that are kept; 10 by default."""

    def to_arguments(self) -> dict[str, Any]:
        """The arguments of `locate_drive`, without those that are by default."""
        from locplan.costs import Path as Route

        given: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("within", "count")
            if getattr(self, name) is not None
        }
        if self.near_path is None:
            refuse("without --near-path", within=self.within)
            return given
        return given | {"near": Route.load(self.near_path)}


@app.default
def locate(
    map_file: MapFile,
    /,
    *,
    recorded: DriveOptions = DriveOptions(),
    which: ScanOptions = ScanOptions(),
    options: LocateOptions = LocateOptions(),
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find where on the map the scans of a drive were taken, without their recorded poses.

    Places that explain a scan have weights, so that you see which ones look alike.
    """
    from locplan._util.progress import progress_bar, working
    from locplan.matching import ScanDatabase
    from locplan.twins import LocatedDrive, locate_drive

    if recorded.drive is None:
        raise ConfigError("name a recorded drive with --drive")
    if which.scan is not None:
        refuse("with --scan", at=which.at, every=recorded.every)
    if which.at is not None:
        refuse("with --at", every=recorded.every)
    recorded.check()
    arguments = options.to_arguments()
    out.check(LocatedDrive.files)
    grid, drive = load(map_file), which.chosen(recorded.read())
    with working("looking around at all places of the map"):
        database = ScanDatabase(grid, drive.lidar)
        _ = database.everywhere
    with progress_bar("locating scans", "scans") as progress:
        found = locate_drive(
            drive, grid, **arguments, database=database, threads=threads, progress=progress
        )
    out.finish(found)

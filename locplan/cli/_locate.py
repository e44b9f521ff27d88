"""The command that finds where on a map scans of a recorded drive were taken."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.progress import progress_bar, working
from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import INPUT, Count, MapFile, Threads, command, option_group
from locplan.cli._output import Output
from locplan.cli._values import given_of, refuse
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.recordings import Recording

app = command(
    "locate",
    "locate lab.yaml --drive monday.mcap --at 12.5 -o located",
    "locate lab.yaml --drive monday.mcap --scan 40 --near-path route.csv",
    "locate lab.yaml --drive monday.mcap --every 20 -o located",
)


@option_group("Recorded drive")
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


@option_group("Options")
class Places:
    """Where the robot is looked for."""

    near_path: Annotated[Path | None, INPUT, Parameter(metavar="CSV")] = None
    """Path (x,y) near which places are looked at; by default all are."""
    within: float | None = None
    """Maximum distance of these from the path, in metres; 3 by default."""
    count: Count | None = None
    """Maximum number of places that are kept; 10 by default."""


@app.default
def locate(
    map_file: MapFile,
    /,
    *,
    recorded: DriveOptions = DriveOptions(),
    which: ScanOptions = ScanOptions(),
    places: Places = Places(),
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find where on the map the scans of a drive were taken, without their recorded poses.

    Places that explain a scan have weights, so that you see which ones look alike.
    """
    if recorded.drive is None:
        raise ConfigError("name a recorded drive with --drive")
    if which.scan is not None:
        refuse("with --scan", at=which.at, every=recorded.every)
    if which.at is not None:
        refuse("with --at", every=recorded.every)
    given = given_of(places)
    if path := given.pop("near_path", None):
        given["near"] = locplan.Path.load(path)
    else:
        refuse("without --near-path", within=places.within)
    out.check(locplan.twins.LocatedDrive.files)
    grid, drive = locplan.load_map(map_file), which.chosen(recorded.read())
    with working("looking around at all places of the map"):
        database = locplan.ScanDatabase(grid, drive.lidar)
        _ = database.everywhere
    with progress_bar("locating scans", "scans") as progress:
        found = locplan.twins.locate_drive(
            drive, grid, **given, database=database, threads=threads, progress=progress
        )
    out.finish(found)

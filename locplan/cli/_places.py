"""The commands that find where scans were taken, and what a robot can be mistaken for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.checks import whole
from locplan._util.progress import progress_bar, working
from locplan.cli import _types as typed
from locplan.cli._options import DriveOptions, Output
from locplan.cli._robot_options import RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.recordings import Recording


@typed.option_group("Recorded drive")
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


@typed.option_group("Options")
class Places:
    """Where the robot is looked for."""

    near_path: Annotated[Path | None, typed.INPUT, Parameter(metavar="CSV")] = None
    """Path (x,y) near which places are looked at; by default all are."""
    within: float | None = None
    """Maximum distance of these from the path, in metres; 3 by default."""
    count: typed.Count | None = None
    """Maximum number of places that are kept; 10 by default."""


@typed.command(
    "locate lab.yaml --drive monday.mcap --at 12.5 -o located",
    "locate lab.yaml --drive monday.mcap --scan 40 --near-path route.csv",
    "locate lab.yaml --drive monday.mcap --every 20 -o located",
)
def locate(
    map_file: typed.MapFile,
    /,
    *,
    recorded: DriveOptions = DriveOptions(),
    which: ScanOptions = ScanOptions(),
    places: Places = Places(),
    threads: typed.Threads = None,
    out: Output = Output(),
) -> None:
    """Find where on the map the scans of a drive were taken, without their recorded poses.

    Places that explain a scan have weights, so that you see which ones look alike.
    """
    if recorded.drive is None:
        raise ConfigError("name a recorded drive with --drive")
    if which.scan is not None:
        typed.refuse("with --scan", at=which.at, every=recorded.every)
    if which.at is not None:
        typed.refuse("with --at", every=recorded.every)
    given = typed.given_of(places)
    if path := given.pop("near_path", None):
        given["near"] = locplan.Path.load(path)
    else:
        typed.refuse("without --near-path", within=places.within)
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


@typed.option_group("Options")
class Asked:
    """What is asked for."""

    at: typed.XY = None
    """Place whose twins are looked for, x,y in metres; all places by default."""
    starts: typed.Count | None = None
    """Maximum number of starts that are proposed; 5 by default."""
    spacing: float | None = None
    """Distance between neighbouring places, in metres; 0.8 by default."""
    matches: int = 0
    """Number of noisy scans from random poses that are matched with the map, to check what is
    foreseen; none by default."""
    seed: typed.Seed | None = None
    """Seed of these scans; 1 by default."""

    def check(self) -> None:
        """Raise a ConfigError if an option is out of its range, or is not read."""
        if self.matches:
            whole("--matches", self.matches, 2, 100_000)
        else:
            typed.refuse("without --matches", seed=self.seed)
        if self.at:
            typed.refuse(
                "with --at", starts=self.starts, spacing=self.spacing, matches=self.matches or None
            )


@typed.command(
    "twins lab.yaml --lidar rplidar-a1 -o alike",
    "twins lab.yaml --lidar rplidar-a1 --at 2,3",
)
def twins(
    map_file: typed.MapFile,
    /,
    *,
    asked: Asked = Asked(),
    robot_options: RobotOptions = RobotOptions(),
    global_effective_beams: Annotated[float | None, Parameter(group=typed.heading("Field"))] = None,
    threads: typed.Threads = None,
    out: Output = Output(),
) -> None:
    """Find places that look alike to the lidar, the map's symmetries, and where to start the robot.

    It is about matching single scans with the whole map. AMCL's own global localization, which
    scatters particles and drives, is not foreseen well.

    Parameters
    ----------
    global_effective_beams
        Number of independent beams that count as much as all together; 36 by default. It is fitted
        to global matches, and not the number of scan.
    """
    asked.check()
    options: dict[str, Any] = {}
    if global_effective_beams is not None:
        options["global_effective_beams"] = global_effective_beams
    if asked.at:
        options["places"] = [asked.at]
    elif asked.spacing is not None:
        options["spacing"] = asked.spacing
    robot = robot_options.load()
    out.check(locplan.twins.Twins.files)
    grid = locplan.load_map(map_file)
    with progress_bar("looking for twins", "poses") as progress:
        found = locplan.find_twins(grid, robot, threads=threads, progress=progress, **options)
    starts = [] if asked.at else found.best_starts(*filter(None, [asked.starts]))
    matches = None
    if asked.matches:
        with progress_bar("matching scans", "scans") as progress:
            seed = typed.given_of(asked).get("seed", 1)
            matches = found.verify(asked.matches, seed=seed, threads=threads, progress=progress)
    out.finish(found, starts, matches)

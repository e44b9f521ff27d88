"""The command `locate`: find where on a map scans were taken."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._support.progress import show_progress_bar, show_spinner
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    INTEGER,
    Count,
    InputFile,
    MapFile,
    reject_options,
    show_default,
)
from locplan.app.cli.groups import OutputOptions, RecordingFile, Threads, read_recording
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.recordings.recording import Recording


def _default_distance() -> float:
    from locplan.recordings.location import WITHIN

    return WITHIN


def _default_count() -> int:
    from locplan.recordings.location import COUNT

    return COUNT


Within = Annotated[float | None, show_default(_default_distance)]
PlaceCount = Annotated[Count | None, show_default(_default_count)]


@command(
    "locate lab.yaml --recording drive.npz --at 12.5 -o located",
    "locate lab.yaml --recording drive.npz --every 20 -o located",
)
def locate(
    map_file: MapFile,
    /,
    *,
    recording: RecordingFile = None,
    scan: Annotated[int | None, INTEGER, Parameter(validator=Number(gte=0))] = None,
    at: Annotated[float | None, Parameter(metavar="SECONDS")] = None,
    every: Count | None = None,
    near_path: InputFile = None,
    within: Within = None,
    count: PlaceCount = None,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Find where on a map scans were taken, without using recorded poses.

    Lists the best places with weights, which show the places that look alike.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    scan
        Index of the scan, from 0. [default: all scans]
    at
        Time of the scan since the first one, in seconds.
    every
        Locate every n-th scan. [default: 1]
    near_path
        Path (CSV of x,y) that the places must be near. [default: no limit]
    within
        Maximum distance from the path, in metres.
    count
        Maximum number of places per scan.
    """
    from locplan.recordings.location import COUNT, WITHIN, LocatedDrive, locate_drive
    from locplan.recordings.map_fit import check_recording_on_map
    from locplan.recordings.matching import ScanDatabase

    if recording is None:
        raise ConfigError("name a recording with --recording")
    if scan is not None:
        reject_options("with --scan", at=at, every=every)
    if at is not None:
        reject_options("with --at", every=every)
    if near_path is None:
        reject_options("without --near-path", within=within)
    output.check(LocatedDrive.files)
    grid = locplan.load_map(map_file)
    drive = read_recording(recording, needs_poses=False)
    scans = _select_scans(drive, scan, at, every or 1)
    with show_spinner("simulating scans all over the map"):
        database = ScanDatabase(grid, scans.lidar)
        _ = database.full_database
        check_recording_on_map(drive, grid, database=database)
    with show_progress_bar("locating scans", "scans") as progress:
        result = locate_drive(
            scans,
            grid,
            near=locplan.Path.load(near_path) if near_path else None,
            within=WITHIN if within is None else within,
            count=COUNT if count is None else count,
            database=database,
            threads=threads,
            progress=progress,
        )
    output.finish(result)


def _select_scans(
    recording: Recording, scan: int | None, seconds: float | None, scan_step: int
) -> Recording:
    """Return the recording of one scan, or of every n-th one."""
    if seconds is not None:
        if recording.times is None:
            raise ConfigError("the recording has no times; use --scan instead of --at")
        after = recording.times - recording.times[0]
        if not 0 <= seconds <= after[-1]:
            raise ConfigError(
                f"--at must be from 0 to {after[-1]:.4g} s (the last scan), not {seconds:g}"
            )
        scan = int(abs(after - seconds).argmin())
    if scan is None:
        return recording.subsample(scan_step)
    if scan >= len(recording):
        raise ConfigError(
            f"--scan must be from 0 to {len(recording) - 1} (the last scan), not {scan}"
        )
    return recording[scan : scan + 1]

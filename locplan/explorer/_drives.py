"""Recorded drives for the page: where the robot was, how well its scans match the map there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import printable, shown
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid
from locplan.recordings import Recording, match_scans, read_drive, scans_unlike

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

MOST_POSES = 5000
"""Greatest number of poses that the page gets of a drive."""


@dataclass(frozen=True, eq=False)
class ShownDrive:
    """Some poses of a recorded drive, evenly spaced over its scans."""

    times: Numbers | None
    """Times since the first scan, (n,) [s]; None where the recording has none."""
    poses: Numbers
    """Poses in the map's frame, (n, 3) [m, m, rad]."""
    deviation: Numbers | None
    """Largest standard deviation of the position of each matched scan, (n,) [m], NaN where a scan
    tells too little; None where scans were not matched."""
    unlike: NDArray[np.bool_]
    """True for each scan of which fewer beams end at the map's walls than on a map that fits."""
    scans: int
    """Number of scans of the whole recording."""

    @property
    def duration(self) -> float | None:
        """Time from the first scan to the last one [s]; None without times."""
        return None if self.times is None else float(self.times[-1])

    def summary(self) -> dict[str, object]:
        """The drive, fit for JSON; without times, "t" counts the poses."""
        x, y, heading = self.poses.round(4).T.tolist()
        deviation: list[float | None] = [None] * len(x)
        if self.deviation is not None:
            deviation = [
                round(value, 4) if np.isfinite(value) else None for value in self.deviation.tolist()
            ]
        return {
            "t": list(range(len(x))) if self.times is None else self.times.round(3).tolist(),
            "timed": self.times is not None,
            "x": x,
            "y": y,
            "heading": heading,
            "sd": deviation,
            "unlike": self.unlike.astype(int).tolist(),
            "scans": self.scans,
        }


def shown_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    matched: bool = False,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> ShownDrive:
    """Poses of a recorded drive, and the scans that are unlike a map.

    A scan is unlike the map if fewer than 60 % of its returns end within two cells of a wall, at
    least 0.1 m: the share from which `locplan.recordings.fit_to_map` says that a map fits. One with
    fewer than 10 returns is not judged.

    Parameters
    ----------
    recording : Recording
        The drive; up to 5,000 of its scans are taken, evenly spaced.
    grid : OccupancyGrid
        The map.
    matched : bool
        True matches the scans with the map, too, which takes up to a millisecond each.
    threads : int, optional
        Number of threads of the matching; all cores by default.
    progress : callable, optional
        Called with (done, total) scans that were matched; what it raises ends the work.
    """
    count = len(recording)
    kept = np.unique(np.linspace(0, count - 1, min(count, MOST_POSES)).round().astype(np.int64))
    # Of the whole recording nothing is copied where few scans are without a return.
    poses = recording.poses[kept]
    times = None if recording.times is None else recording.times[kept] - recording.times[kept[0]]
    unlike = scans_unlike(recording, grid, kept)
    deviation = None
    if matched:
        deviation = np.full(len(kept), np.nan)
        try:
            found = match_scans(recording[kept], grid, threads=threads, progress=progress)
        except RecordingError:  # no scan on this map tells enough
            pass
        else:
            deviation = found.position_std
    return ShownDrive(times, poses, deviation, unlike, count)


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A recorded drive that the page can show."""

    name: str
    """Name of the drive, that of its file."""
    recording: Recording
    """Its scans and poses."""

    @classmethod
    def read(
        cls, file: str | os.PathLike[str], progress: ProgressCallback | None = None
    ) -> RecordedDrive:
        """Read a recorded drive from a file, see `locplan.recordings.read_drive`.

        Parameters
        ----------
        file : path
            The file.
        progress : callable, optional
            Called with (done, total) messages.
        """
        recording = read_drive(file, progress=progress)
        return cls(printable(FilePath(file).name), recording)

    @classmethod
    def of(cls, drive: RecordedDrive | Recording | str | os.PathLike[str]) -> RecordedDrive:
        """A drive of a recording, or of its file; a ConfigError of anything else.

        Parameters
        ----------
        drive : RecordedDrive, Recording or path
            The drive.
        """
        if isinstance(drive, RecordedDrive):
            return drive
        if isinstance(drive, Recording):
            return cls(printable(drive.source.file) or "recorded drive", drive)
        if isinstance(drive, (str, os.PathLike)):
            return cls.read(drive)
        raise ConfigError(f"a drive must be a recording or its file, not {shown(drive)}")

    def about(self) -> dict[str, object]:
        """Name, duration and sizes, fit for JSON."""
        times, scans = self.recording.times, len(self.recording)
        duration = None if times is None else float(times[-1] - times[0])
        poses = min(scans, MOST_POSES)
        return {"name": self.name, "duration": duration, "poses": poses, "scans": scans}


def drive_json(session: Session, number: int) -> dict[str, object]:
    """A recorded drive of a session on its present map, by its number from 0 on, fit for JSON."""
    return shown_drive(session.drives[number].recording, session.grid).summary()


def match(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the deviations that the scans of a drive have on the present map.

    They are kept, so that a drive that is shown again has them at once.
    """
    if not session.drives:
        raise ConfigError("there is no recorded drive; start the explorer with --drive FILE")
    number = ask.whole("drive", 0, len(session.drives) - 1)
    if number is None:
        raise ConfigError("drive must be the number of a recorded drive")
    grid = session.grid
    found: dict[str, object] = session.files.made(
        ("match", number, grid.digest),
        lambda: shown_drive(
            session.drives[number].recording,
            grid,
            matched=True,
            threads=session.opening.threads,
            progress=work.progress,
        ).summary(),
        lambda made: 200 * MOST_POSES,
    )
    return {"map": grid.digest, "sd": found["sd"], "unlike": found["unlike"]}

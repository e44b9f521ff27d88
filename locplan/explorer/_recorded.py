"""Recorded drives, as the page shows them."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from locplan._util.checks import printable, shown
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid

if TYPE_CHECKING:
    from locplan.recordings import Recording

MAX_POSES = 5000
"""Number of poses that the page gets of a drive at most."""


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A recorded drive that the page can show."""

    name: str
    """Name of the drive, that of its file."""
    recording: Recording
    """Its scans and poses."""

    @classmethod
    def of(
        cls,
        drive: RecordedDrive | Recording | str | os.PathLike[str],
        progress: ProgressCallback | None = None,
    ) -> RecordedDrive:
        """A drive of a recording, or of its file; a ConfigError of anything else.

        Parameters
        ----------
        drive : RecordedDrive, Recording or path
            The drive; for files see `locplan.recordings.read_drive`.
        progress : callable, optional
            Called with (done, total) messages of a file.
        """
        from locplan.recordings import Recording, read_drive

        if isinstance(drive, RecordedDrive):
            return drive
        if isinstance(drive, Recording):
            return cls(printable(drive.source.file) or "recorded drive", drive)
        if isinstance(drive, (str, os.PathLike)):
            return cls(printable(Path(drive).name), read_drive(drive, progress=progress))
        raise ConfigError(f"a drive must be a recording or its file, not {shown(drive)}")

    def on(
        self,
        grid: OccupancyGrid,
        reference: str | None = None,
        *,
        cache_dir: str | os.PathLike[str] | None = None,
        progress: ProgressCallback | None = None,
    ) -> RecordedDrive:
        """The drive with the poses that count as true on a map.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        reference, cache_dir, progress
            See `locplan.recordings.referenced`.
        """
        from locplan.recordings import referenced

        own = referenced(self.recording, grid, reference, cache_dir=cache_dir, progress=progress)
        return replace(self, recording=own)

    def about(self) -> dict[str, object]:
        """Name, duration and sizes, fit for JSON."""
        times, scans = self.recording.times, len(self.recording)
        duration = None if times is None else float(times[-1] - times[0])
        poses = min(scans, MAX_POSES)
        return {"name": self.name, "duration": duration, "poses": poses, "scans": scans}

    def shown(
        self,
        grid: OccupancyGrid,
        *,
        matched: bool = False,
        threads: int | None = None,
        progress: ProgressCallback | None = None,
    ) -> dict[str, object]:
        """Poses of the drive, evenly spaced over its scans, and the scans that are unlike a map.

        A scan is unlike the map if fewer than 60 % of its returns end within two cells of a wall,
        at least 0.1 m: the share from which `locplan.recordings.fit_to_map` says that a map fits.
        One with fewer than 10 returns is not judged. "sd" is the largest standard deviation of the
        position of each scan [m], of scans that were `matched` with the map, which takes up to a
        millisecond each; "t" is the time since the first scan [s], or the number of the pose
        without times.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        matched : bool, default False
            True matches the scans with the map.
        threads : int, optional
            Number of threads; all cores by default.
        progress : callable, optional
            Called with (done, total) scans.
        """
        from locplan.recordings import match_scans, scans_unlike

        recording, count = self.recording, len(self.recording)
        kept = np.unique(np.linspace(0, count - 1, min(count, MAX_POSES)).round().astype(np.int64))
        # Of the whole recording nothing is copied where few scans are without a return.
        x, y, heading = recording.poses[kept].round(4).T.tolist()
        times: list[float] = [*map(float, range(len(kept)))]
        if recording.times is not None:
            times = (recording.times[kept] - recording.times[kept[0]]).round(3).tolist()
        deviation = np.full(len(kept), np.nan)
        if matched:
            with suppress(RecordingError):  # no scan on this map is matched well enough
                found = match_scans(recording[kept], grid, threads=threads, progress=progress)
                deviation = found.position_std.round(4)
        return {
            "t": times,
            "timed": recording.times is not None,
            **{"x": x, "y": y, "heading": heading},
            "sd": finite(deviation.tolist()),
            "unlike": scans_unlike(recording, grid, kept).astype(int).tolist(),
            "scans": count,
        }

"""A recorded drive in a few numbers, as a table, and as JSON."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._util.poses import wrapped
from locplan._util.tables import finite, table
from locplan.recordings._options import Contents


@dataclass(frozen=True)
class DriveSummary:
    """How long a drive is, how dense its scans are, and how many beams have a return."""

    file: str
    """Name of the file."""
    scans: int
    """Number of scans."""
    beams: int
    """Number of beams of a scan."""
    lidar: str
    """Range and field of view of the lidar."""
    length: float
    """Length of the way [m]."""
    turned: float
    """Sum of the turns from scan to scan [rad]."""
    seconds: float | None
    """Duration [s]; None where the log has no times."""
    spacing: float
    """Median distance from one scan to the next [m]."""
    returns: float
    """Share of the beams that have a return, 0..1."""
    median_range: float
    """Median range of the returns [m]."""
    poses: str
    """Where the poses come from."""
    odometry: str
    """Where the odometry comes from; empty if there is none."""
    notes: tuple[str, ...]
    """What was assumed or left out."""

    @classmethod
    def of(cls, drive: Contents) -> DriveSummary:
        """The summary of a recording.

        Parameters
        ----------
        drive : Contents
            The fields of a recording, as `Recording.contents` gives them.
        """
        known = drive.ranges[np.isfinite(drive.ranges)]
        steps = np.hypot(*np.diff(drive.poses[:, :2], axis=0).T)
        has_odometry = drive.odometry is not None
        return cls(
            file=drive.source.file,
            scans=len(drive.poses),
            beams=drive.lidar.beams,
            lidar=drive.lidar.title,
            length=float(steps.sum()),
            turned=float(np.abs(wrapped(np.diff(drive.poses[:, 2]))).sum()),
            seconds=None if drive.times is None else float(drive.times[-1] - drive.times[0]),
            spacing=float(np.median(steps)) if len(steps) else 0.0,
            returns=known.size / drive.ranges.size,
            median_range=float(np.median(known)),
            poses=drive.source.poses or "given",
            odometry=(drive.source.odometry or "given") if has_odometry else "",
            notes=drive.source.notes,
        )

    def table(self) -> str:
        """The summary for people."""
        took = "no times" if self.seconds is None else f"{self.seconds:.4g} s"
        rows = [
            ("drive", f"{self.file or 'a recording'}: {self.length:.4g} m, {took}"),
            ("scans", f"{self.scans:,} of {self.beams} beams, {self.spacing:.2g} m apart"),
            ("lidar", self.lidar),
            ("returns", f"{self.returns:.0%} of the beams, median {self.median_range:.2g} m"),
            ("poses", self.poses),
            ("odometry", self.odometry or "none"),
            *(("note", note) for note in self.notes),
        ]
        return table([], rows)

    def to_json(self) -> dict[str, Any]:
        """The summary, fit for JSON."""
        return finite(dataclasses.asdict(self))

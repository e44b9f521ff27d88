"""The scans of a recorded drive, each located by itself, beside the recorded poses."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.poses import Numbers, wrapped
from locplan._util.progress import ProgressCallback
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.tables import REPORT_WIDTH, finite
from locplan.costs import Path
from locplan.errors import RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import CLEARANCE, ScanDatabase, checked_database, in_batches
from locplan.recordings import Recording
from locplan.twins._locate import (
    COUNT,
    WITHIN,
    NotLocatedError,
    located,
    places_of,
)
from locplan.twins._location import CERTAIN, DEVIATIONS, POSE, WEIGHT, Location

Mask = NDArray[np.bool_]
NEAR, TURNED = 0.3, float(np.radians(3.0))
"""Distance [m] and angle [rad] from the recorded pose up to which a scan is located rightly."""
AGREE = 0.5
"""Share of the certain scans that are right, or of all that fit, below which the recorded poses
seem to be of another map."""


SCANS = (
    Column("scan", title="scan", digits=0),
    Column("time", "s"),
    *POSE,
    WEIGHT,
    Column("second", "nat", "second", 1),
    Column("explained"),
    *(replace(column, title=None) for column in DEVIATIONS),
    *(replace(column, name=f"recorded_{column.name}", title=None) for column in POSE),
    Column("distance", "m", "off by", 1, "cm"),
    Column("turn", "rad", "turned by", 1, "deg"),
)


@dataclass(frozen=True, eq=False, repr=False)
class LocatedDrive(Result):
    """The scans of a recorded drive, each located by itself, from `locate_drive`."""

    _drawn_by: ClassVar[str] = "locplan.twins:located_drive_figure"
    files: ClassVar[Results] = Results(
        "located", ("located.json", "located.png", "modes.csv", "scans.csv")
    )

    recording: Recording
    """The scans, with their recorded poses."""
    grid: OccupancyGrid
    """The map."""
    locations: tuple[Location | None, ...]
    """Where each was taken; None where it has too few returns."""

    def __repr__(self) -> str:
        return f"LocatedDrive({len(self)} scans, {self.right.mean():.0%} right)"

    def __len__(self) -> int:
        return len(self.locations)

    @property
    def alone(self) -> Location | None:
        """The location of the only scan; None where there are several."""
        return self.locations[0] if len(self) == 1 else None

    @property
    def poses(self) -> Numbers:
        """The best pose of each scan in the world, (n, 3) [m, m, rad]; NaN where there is none."""
        none = (np.nan,) * 3
        return np.array([none if each is None else each.best.pose for each in self.locations])

    @property
    def distance(self) -> Numbers:
        """Distance of each best pose from the recorded one, (n,) [m]."""
        return np.asarray(np.hypot(*(self.poses - self.recording.poses)[:, :2].T))

    @property
    def turn(self) -> Numbers:
        """Angle of each best pose from the recorded one, (n,) [rad]."""
        return np.abs(wrapped(self.poses[:, 2] - self.recording.poses[:, 2]))

    @property
    def right(self) -> Mask:
        """Mask of the scans located within 0.3 m and 3 deg of the recorded pose, (n,)."""
        return np.asarray((self.distance <= NEAR) & (self.turn <= TURNED))

    @property
    def certain(self) -> Mask:
        """Mask of the scans that no second place explains within 3 nats, (n,)."""
        return np.array([each is not None and each.certain for each in self.locations])

    @property
    def fits(self) -> Mask:
        """Mask of the scans of which three of five returns end at walls of the map, (n,)."""
        return np.array([each is not None and each.fits for each in self.locations])

    @property
    def sentence(self) -> str:
        """How many scans are located, and whether the certain ones are right."""
        count, right, certain = len(self), self.right, self.certain
        limits = f"{NEAR:g} m and {np.degrees(TURNED):.0f}°"
        text = (
            f"{int(right.sum())} of {count} scans are located within {limits} of the recorded pose."
            f" {int(certain.sum())} have no second place within {CERTAIN:g} nats, and"
            f" {int((right & certain).sum())} of these are right."
        )
        if certain.any() and right[certain].mean() < AGREE:
            text += (
                " The recorded poses hardly agree with the map: check that they are in its frame,"
                " and how the lidar is mounted."
            )
        elif (fits := self.fits).mean() < AGREE:
            text += (
                f" Careful: only {int(fits.sum())} of {count} scans have most of their returns at"
                " walls: people, changes, or the map of another place."
            )
        return text

    def table(self) -> Table:
        """The scans: where each was taken, and how far that is from the recorded pose."""
        drive, unknown = self.recording, (math.nan,) * 8
        times = np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0]
        beside = np.column_stack([drive.poses, self.distance, self.turn]).tolist()
        rows = []
        for n, each in enumerate(self.locations):
            own: tuple[float, ...] = unknown
            if each is not None:
                best = each.best
                own = (*best.pose, best.weight, each.second, each.explained)
                own += (best.position_std, best.heading_std)
            rows.append((n, float(times[n]), *own, *beside[n]))
        return Table(SCANS, tuple(rows))

    def report(self) -> str:
        """The modes of the only scan, or how many of several are right: text for people."""
        if self.alone is None:
            return "\n".join(map(_wrapped, [*self._about(), self.sentence, *self._errors()]))
        modes = self.alone.table()
        recorded = ("recorded", *self.recording.poses[0].tolist())
        unknown = (math.nan,) * (len(modes.columns) - len(recorded))
        away = (
            f"The best place is {self.distance[0]:.2f} m and {math.degrees(self.turn[0]):.1f}° from"
            " the recorded pose."
        )
        shown = replace(modes, rows=(*modes.rows, (*recorded, *unknown)))
        return f"{shown}\n{_wrapped(f'{self.alone.sentence} {away}')}"

    def _about(self) -> list[str]:
        drive = repr(self.recording).removeprefix("Recording(").removesuffix(")")
        missing = sum(each is None for each in self.locations)
        few = [f"{missing} scans have too few returns."] if missing else []
        return [f"{self.grid.name or 'map'}, {drive}", *few]

    def _errors(self) -> list[str]:
        right = self.right
        if not right.any():
            return []
        away, turn = (100 * self.distance[right], np.degrees(self.turn[right]))
        below = (
            f"{np.quantile(away, share):.1f} cm, {np.quantile(turn, share):.2f}°"
            for share in (0.5, 0.9)
        )
        return ["Errors of these: median {}; nine of ten below {}.".format(*below)]

    def _write(self, folder: FilePath) -> None:
        if self.alone:
            self.alone.table().write_csv(folder / "modes.csv")
        else:
            self.table().write_csv(folder / "scans.csv")

    def summary(self) -> dict[str, object]:
        """The only scan with its modes, or of several the shares that are right, fit for JSON."""
        about = {"map": self.grid.name, "drive": self.recording.source.file}
        right, certain = self.right, self.certain
        if self.alone:
            names = ("x", "y", "heading", "distance", "turn")
            values = (*self.recording.poses[0].tolist(), self.distance[0], self.turn[0])
            recorded = finite(dict(zip(names, map(float, values), strict=True)))
            return {**about, **self.alone.summary(), "recorded": recorded}
        return finite(
            {
                **about,
                "sentence": self.sentence,
                "scans": len(self),
                "right": float(right.mean()),
                "certain": float(certain.mean()),
                "right_of_certain": float(right[certain].mean()) if certain.any() else None,
                "median_distance": float(np.median(self.distance[right])) if right.any() else None,
                "median_turn": float(np.median(self.turn[right])) if right.any() else None,
            }
        )


def _wrapped(text: str) -> str:
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)


def locate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    near: Path | ArrayLike | None = None,
    within: float = WITHIN,
    count: int = COUNT,
    clearance: float = CLEARANCE,
    database: ScanDatabase | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> LocatedDrive:
    """Locate each scan of a recorded drive by itself, as `locate` does.

    The recorded poses are only compared with the result.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    near, within, count, clearance, database
        See `locate`.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Returns
    -------
    LocatedDrive
        The location of each scan, and how many are right.

    Raises
    ------
    LocplanError
        If a value is out of its range, no scan has enough returns, or there is no place for the
        robot.
    """
    instance("recording", recording, Recording, "read one with locplan.recordings.read_drive")
    check_grid(grid)
    whole("count", count)
    workers = check_threads(threads)
    database = checked_database(grid, recording.lidar, clearance, database)
    places = places_of(database, near, within)
    _ = database.matcher.prepared  # now, once for all threads

    def find(some: NDArray[np.int64]) -> list[Location | None]:
        found: list[Location | None] = []
        for n in some:
            ranges = recording.ranges[n].astype(np.float64)
            try:
                found.append(located(database, ranges, places, count, restricted=near is not None))
            except NotLocatedError:
                found.append(None)
        return found

    locations = in_batches(find, len(recording), workers, progress)
    if not any(locations):
        raise RecordingError(
            f"none of {len(recording)} scans has enough returns to know where it was taken"
        )
    return LocatedDrive(recording, grid, tuple(locations))

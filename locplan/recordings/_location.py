"""Where a robot may be that has taken one scan, and each scan of a drive beside its pose."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path as FilePath
from typing import ClassVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.output import Results
from locplan._util.poses import wrapped
from locplan._util.public import Pictured
from locplan._util.records import Column, Result, Table
from locplan._util.tables import REPORT_WIDTH, finite
from locplan.field import position_axes
from locplan.maps import OccupancyGrid
from locplan.recordings._located_text import CERTAIN, NEAR, TURNED, drive_sentence
from locplan.recordings._recording import Recording
from locplan.robots import Lidar


@dataclass(frozen=True, eq=False, repr=False)
class Mode:
    """A pose that explains a scan, better than all poses around it."""

    pose: tuple[float, float, float]
    """x, y, heading in the world [m, m, rad]."""
    weight: float
    """Share of the posterior, of exp(-loss) over all modes, 0..1."""
    excess: float
    """How much worse it explains the scan than the best mode does, >= 0 [nats]."""
    covariance: Floats
    """Covariance of the pose in the world, (3, 3) [m, m, rad], as that of `match_scans`: the
    posterior over +-1.5 m and +-4 deg about the pose."""

    def __repr__(self) -> str:
        x, y, heading = self.pose
        return f"Mode({x:.2f},{y:.2f} m, {math.degrees(heading):.1f}°, weight {self.weight:.2f})"

    @property
    def position_std(self) -> float:
        """Largest standard deviation of the position [m]."""
        return float(position_axes(self.covariance)[0])

    @property
    def heading_std(self) -> float:
        """Standard deviation of the heading [rad]."""
        return math.sqrt(self.covariance[2, 2])


POSE = (
    Column("x", "m", "x", value=lambda mode: mode.pose[0]),
    Column("y", "m", "y", value=lambda mode: mode.pose[1]),
    Column("heading", "rad", "heading", 1, "deg", value=lambda mode: mode.pose[2]),
)
DEVIATIONS = (
    Column("position_std", "m", "std. dev.", 0, "cm"),
    Column("heading_std", "rad", "std. dev.", 1, "deg"),
)
WEIGHT = Column("weight", "", "weight", 0, "%")


def _entry(row: int, col: int) -> Callable[[Mode], float]:
    return lambda mode: float(mode.covariance[row, col])


MODES = (
    *POSE,
    WEIGHT,
    Column("excess", "nat", "worse by", 1),
    *DEVIATIONS,
    *(
        Column(f"covariance_{'xyh'[row]}{'xyh'[col]}", value=_entry(row, col))
        for row, col in combinations_with_replacement(range(3), 2)
    ),
)


@dataclass(frozen=True, eq=False, repr=False)
class Location(Pictured):
    """Where a robot may be that has taken one scan, from `locate`."""

    _drawn_by: ClassVar[str] = "locplan.recordings:locate_figure"

    grid: OccupancyGrid
    """The map."""
    lidar: Lidar
    """The lidar that took the scan."""
    ranges: Floats
    """The scan: distances along the lidar's beams, (beams,) [m], inf without a return."""
    modes: tuple[Mode, ...]
    """The poses that explain it, the best first."""
    second: float
    """Excess of the second best place [nats]; infinite if none is within 8 nats."""
    explained: float
    """Share of the returns that end within two deviations of a wall at the best pose, 0..1."""
    restricted: bool
    """True if only places near a route were looked at."""

    def __repr__(self) -> str:
        return f"Location({self.best!r}, second {self.second:.1f} nats)"

    @property
    def best(self) -> Mode:
        """The pose that explains the scan best."""
        return self.modes[0]

    @property
    def certain(self) -> bool:
        """True if every other place explains the scan worse by more than 3 nats."""
        return self.second > CERTAIN

    @property
    def fits(self) -> bool:
        """True if three of five returns end at walls of the map at the best pose."""
        return self.explained >= 0.6

    @property
    def sentence(self) -> str:
        """Where the robot is, or which places look alike."""
        where = " near the route" if self.restricted else ""
        alike = [mode for mode in self.modes if mode.excess <= CERTAIN]
        if self.certain:
            text = (
                f"The robot is at {_place(self.best)} (± {100 * self.best.position_std:.0f} cm,"
                f" {math.degrees(self.best.heading_std):.1f}°): no other place{where} explains the"
                f" scan within {CERTAIN:g} nats."
            )
        elif len(alike) <= 3:
            count = ("Two", "Three")[len(alike) - 2]
            named = [f"{_place(mode)} ({mode.weight:.0%})" for mode in alike]
            text = f"{count} places{where} look alike: {', '.join(named[:-1])} and {named[-1]}."
        else:
            # Sum of weights from which on none is left out.
            cut = sum(mode.weight for mode in self.modes) < 1 - 1e-9
            more = "or more " if cut and len(alike) == len(self.modes) else ""
            text = (
                f"{len(alike)} {more}places{where} look alike; the best, {_place(self.best)}, has"
                f" {self.best.weight:.0%} of the posterior."
            )
        if self.fits:
            return text
        return (
            f"{text} Careful: only {self.explained:.0%} of the returns end at walls there: people,"
            " changes, or the map of another place."
        )

    def table(self) -> Table:
        """The poses that explain the scan, the best first."""
        return Table.of(MODES, self.modes, number="place")


def _place(mode: Mode) -> str:
    """Text of a pose, without -0."""
    x, y, heading = mode.pose
    turn = round(math.degrees(heading)) + 0.0
    return f"{round(x, 2) + 0.0:.2f},{round(y, 2) + 0.0:.2f} m, {turn:.0f}°"


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

    _drawn_by: ClassVar[str] = "locplan.recordings:located_drive_figure"
    files: ClassVar[Results] = Results(
        "located", ("located.json", "located.png", "modes.csv", "scans.csv")
    )

    recording: Recording
    """The scans, with their recorded poses if there are any."""
    grid: OccupancyGrid
    """The map."""
    locations: tuple[Location | None, ...]
    """Where each was taken; None where it has too few returns."""

    def __repr__(self) -> str:
        if not self.recording.has_poses:
            return f"LocatedDrive({len(self)} scans, {self.certain.mean():.0%} certain)"
        return f"LocatedDrive({len(self)} scans, {self.right.mean():.0%} right)"

    def __len__(self) -> int:
        return len(self.locations)

    @property
    def alone(self) -> Location | None:
        """The location of the only scan; None where there are several."""
        return self.locations[0] if len(self) == 1 else None

    @property
    def poses(self) -> Floats:
        """The best pose of each scan in the world, (n, 3) [m, m, rad]; NaN where there is none."""
        none = (np.nan,) * 3
        return np.array([none if each is None else each.best.pose for each in self.locations])

    @property
    def distance(self) -> Floats:
        """Distance of each best pose from the recorded one, (n,) [m]."""
        return np.asarray(np.hypot(*(self.poses - self.recording.poses)[:, :2].T))

    @property
    def turn(self) -> Floats:
        """Angle of each best pose from the recorded one, (n,) [rad]."""
        return np.abs(wrapped(self.poses[:, 2] - self.recording.poses[:, 2]))

    @property
    def right(self) -> Bools:
        """Mask of the scans located within 0.3 m and 3 deg of the recorded pose, (n,)."""
        return np.asarray((self.distance <= NEAR) & (self.turn <= TURNED))

    @property
    def certain(self) -> Bools:
        """Mask of the scans that no second place explains within 3 nats, (n,)."""
        return np.array([each is not None and each.certain for each in self.locations])

    @property
    def fits(self) -> Bools:
        """Mask of the scans of which three of five returns end at walls of the map, (n,)."""
        return np.array([each is not None and each.fits for each in self.locations])

    @property
    def sentence(self) -> str:
        """How many scans are located, and whether the certain ones are right."""
        right = self.right if self.recording.has_poses else None
        return drive_sentence(self.certain, self.fits, right)

    def table(self) -> Table:
        """The scans: where each was taken, and how far that is from the recorded pose."""
        drive, unknown = self.recording, (math.nan,) * 8
        times = np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0]
        beside = np.column_stack([drive.poses, self.distance, self.turn]).tolist()
        rows = []
        for n, each in enumerate(self.locations):
            own = unknown
            if each is not None:
                best, sure = each.best, (each.second, each.explained)
                own = (*best.pose, best.weight, *sure, best.position_std, best.heading_std)
            rows.append((n, float(times[n]), *own, *beside[n]))
        return Table(SCANS, tuple(rows))

    def report(self) -> str:
        """The modes of the only scan, or how many of several are right: text for people."""
        if self.alone is None:
            drive = repr(self.recording).removeprefix("Recording(").removesuffix(")")
            missing = sum(each is None for each in self.locations)
            few = [f"{missing} scans have too few returns."] if missing else []
            about = [f"{self.grid.name or 'map'}, {drive}", *few]
            return "\n".join(map(_wrapped, [*about, self.sentence, *self._errors()]))
        modes = self.alone.table()
        if not self.recording.has_poses:
            return f"{modes}\n{_wrapped(self.alone.sentence)}"
        recorded = ("recorded", *self.recording.poses[0].tolist())
        unknown = (math.nan,) * (len(modes.columns) - len(recorded))
        away = (
            f"The best place is {self.distance[0]:.2f} m and {math.degrees(self.turn[0]):.1f}° from"
            " the recorded pose."
        )
        shown = replace(modes, rows=(*modes.rows, (*recorded, *unknown)))
        return f"{shown}\n{_wrapped(f'{self.alone.sentence} {away}')}"

    def _errors(self) -> list[str]:
        if not self.right.any():
            return []
        away, turn = 100 * self.distance[self.right], np.degrees(self.turn[self.right])
        at = np.column_stack([np.quantile(each, (0.5, 0.9)) for each in (away, turn)])
        median, below = (f"{distance:.1f} cm, {angle:.2f}°" for distance, angle in at)
        return [f"Errors of these: median {median}; nine of ten below {below}."]

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
            recorded = dict(zip(names, map(float, values), strict=True))
            return finite(
                {
                    **about,
                    "sentence": self.alone.sentence,
                    "certain": self.alone.certain,
                    "second": self.alone.second,
                    "explained": self.alone.explained,
                    "returns": int(np.isfinite(self.alone.ranges).sum()),
                    "modes": self.alone.table().records(),
                    "recorded": recorded,
                }
            )
        return finite(
            {
                **about,
                "sentence": self.sentence,
                "scans": len(self),
                "right": float(right.mean()) if self.recording.has_poses else None,
                "certain": float(certain.mean()),
                "right_of_certain": float(right[certain].mean())
                if certain.any() and self.recording.has_poses
                else None,
                "median_distance": float(np.median(self.distance[right])) if right.any() else None,
                "median_turn": float(np.median(self.turn[right])) if right.any() else None,
            }
        )


def _wrapped(text: str) -> str:
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)

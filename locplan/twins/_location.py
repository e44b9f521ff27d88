"""Where a robot may be that has taken one scan: poses with weights and covariances."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import ClassVar

import numpy as np

from locplan._util.poses import Numbers
from locplan._util.public import Pictured
from locplan._util.records import Column, Table
from locplan._util.tables import finite
from locplan.field import position_axes
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar

CERTAIN = 3.0
"""Excess of the second place from which on the best one is certain [nats]."""


@dataclass(frozen=True, eq=False, repr=False)
class Mode:
    """A pose that explains a scan, better than all poses around it."""

    pose: tuple[float, float, float]
    """x, y, heading in the world [m, m, rad]."""
    weight: float
    """Share of the posterior, of exp(-loss) over all modes, 0..1."""
    excess: float
    """How much worse it explains the scan than the best mode does, >= 0 [nats]."""
    covariance: Numbers
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

    _drawn_by: ClassVar[str] = "locplan.twins:locate_figure"

    grid: OccupancyGrid
    """The map."""
    lidar: Lidar
    """The lidar that took the scan."""
    ranges: Numbers
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
            places = f"{', '.join(named[:-1])} and {named[-1]}"
            text = f"{count} places{where} look alike: {places}."
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

    def summary(self) -> dict[str, object]:
        """The sentence, and all modes in numbers, fit for JSON."""
        return finite(
            {
                "sentence": self.sentence,
                "certain": self.certain,
                "second": self.second,
                "explained": self.explained,
                "returns": int(np.isfinite(self.ranges).sum()),
                "modes": self.table().records(),
            }
        )


def _place(mode: Mode) -> str:
    """Text of a pose, without -0."""
    x, y, heading = mode.pose
    turn = round(math.degrees(heading)) + 0.0
    return f"{round(x, 2) + 0.0:.2f},{round(y, 2) + 0.0:.2f} m, {turn:.0f}°"

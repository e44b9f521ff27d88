"""Look-alikes of one place: where a scan taken there would match as well."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from locplan._util.checks import FARTHEST
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.explorer._snap import snapped
from locplan.robots import Robot
from locplan.twins import ScanDatabase, Twins, find_twins

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

ALIKE = 3.0
"""Excess up to which a pose counts as a look-alike [nats]; a likelihood of a twentieth."""
BYTES_A_CELL = 20
"""Bytes that a database takes for each cell of the map, about."""


@dataclass(frozen=True)
class LookAlike:
    """A pose that the robot can be mistaken for."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    heading: float
    """Heading there [rad]."""
    excess: float
    """By how much it explains the scan worse [nats]; below 0 it explains it better."""


@dataclass(frozen=True)
class LookAlikes:
    """What one place can be mistaken for by a single scan."""

    place: tuple[float, float]
    """World x and y of the place [m]."""
    excess: float
    """Least excess of any pose more than 2 m away [nats]; infinite if there is none."""
    share: float
    """Share of the posterior more than 2 m away."""
    modes: int
    """Number of look-alike poses more than 2 m away."""
    stretch: float
    """Distance that a match can slide along the place, as in a corridor [m]."""
    twins: tuple[LookAlike, ...]
    """The best of the look-alikes, the one with the least excess first."""

    @classmethod
    def of(cls, found: Twins) -> LookAlikes:
        """The look-alikes of the first place that was searched for twins."""
        alike = [each for each in found.of(0) if each.excess <= ALIKE]
        x, y = found.places[0].tolist()
        return cls(
            (x, y),
            float(found.excess[0]),
            float(found.elsewhere[0]),
            int(found.modes[0]),
            float(found.stretch[0]),
            tuple(LookAlike(each.x, each.y, each.heading, float(each.excess)) for each in alike),
        )

    def summary(self) -> dict[str, object]:
        """The look-alikes, fit for JSON."""
        about: dict[str, object] = {
            "x": self.place[0],
            "y": self.place[1],
            "excess": self.excess,
            "share": self.share,
            "modes": self.modes,
            "stretch": self.stretch,
            "twins": [
                {**vars(each), "likelihood": math.exp(-max(each.excess, 0.0))}
                for each in self.twins
            ],
        }
        return finite(about)


def twins(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the look-alikes of a place."""
    x, y = (ask.number(name, -FARTHEST, FARTHEST) for name in ("x", "y"))
    if x is None or y is None:
        raise ConfigError("look-alikes need a place: x and y in metres")
    (place,) = snapped(session.parts(), [(x, y)])
    robot = session.robot
    database = database_of(session, robot, work)
    work.progress(0, 1, "comparing places")
    found = find_twins(
        database.grid, robot, places=[place], database=database, progress=work.progress
    )
    return LookAlikes.of(found).summary()


def database_of(session: Session, robot: Robot, work: Work) -> ScanDatabase:
    """What the lidar sees at all places of the map, made once and kept with the costmaps."""
    grid, lidar = session.grid, robot.known_lidar

    def prepared() -> ScanDatabase:
        made = ScanDatabase(grid, lidar, robot.radius)
        made.prepare(lambda done, total: work.progress(done, total, "looking from all places"))
        return made

    work.progress(0, 1, "looking from all places")
    return session.kept.made(
        ("scans", session.scene.serial, grid.digest, lidar),
        prepared,
        lambda made: made.everywhere.bytes,
        BYTES_A_CELL * grid.cells.size,
    )

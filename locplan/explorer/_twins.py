"""Look-alikes of one place, where a scan taken there would match as well, and of the whole map.

Those of all places are a layer beside those of the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from locplan._util.checks import FARTHEST
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.explorer._snap import snapped
from locplan.explorer._textures import Texture
from locplan.robots import Robot
from locplan.twins import PLACE_HEADINGS, PLACE_SPACING, ScanDatabase, Twins, find_twins

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

TWINS = "twins"
"""Name of the layer."""
MOST_EXCESS = 12.0
"""Excess from which on all places count as the same [nats]; a likelihood of 6e-6."""
SECONDS = 40.0
"""Processor time that all comparisons may take by the estimate [s]."""
POSE_SECONDS = 3.5e-3
"""Time of a pose on a map of few places, measured on one core [s]."""
PLACE_SECONDS = 0.2e-6
"""Time of a comparison of a pose with one more place, measured on one core [s]."""
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


def affordable_spacing(area: float, compared: int, headings: int) -> float:
    """Distance of places [m] at which the search takes no longer than it may.

    Parameters
    ----------
    area : float
        Area that the robot can stand on [m^2].
    compared : int
        Number of places that each pose is compared with.
    headings : int
        Number of headings at each place.
    """
    poses = SECONDS / (POSE_SECONDS + PLACE_SECONDS * compared)
    least = math.sqrt(area * headings / poses)
    return max(PLACE_SPACING, math.ceil(10 * least) / 10)


def spacing_of(database: ScanDatabase) -> float:
    """The usual distance of places [m], or a greater one where that would take too long."""
    every, cell = database.everywhere, database.grid.resolution
    headings = 1 if database.lidar.sees_alike_in_all_headings else PLACE_HEADINGS
    spacing = affordable_spacing(float(every.fits.sum()) * cell**2, len(every.positions), headings)
    return max(spacing, cell)


def texture_of(found: Twins, stride: int, digest: str) -> Texture:
    """The least excess of another place on the lattice of a field of this stride [cells]."""
    excess = found.layer("excess", stride=stride)
    return Texture(
        TWINS,
        "Look-alikes: excess of the best",
        "nat",
        1.0,
        1,
        False,
        (MOST_EXCESS, 0.0),
        np.clip(excess, 0.0, MOST_EXCESS),
        "How much worse the best other place explains a scan than the right one. At 0 both explain"
        f" it equally well, at {ALIKE:g} nats the other is {math.exp(-ALIKE):.0%} as likely;"
        f" {MOST_EXCESS:g} also stands for more. Places are {found.spacing:g} m apart.",
        digest,
    )


def twins_everywhere(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the look-alikes of all places: they become a layer of every page."""
    digest, field, robot = session.twins_digest, session.scene.field, session.robot
    if field is None:
        raise ConfigError("the field is still being computed; wait until it is there")
    database = database_of(session, robot, work)

    def progress(done: int, total: int) -> None:
        if session.twins_digest != digest:
            raise ConfigError("the map or the lidar was changed meanwhile; search again")
        work.progress(done, total, "comparing places")

    progress(0, 1)
    found = find_twins(
        database.grid,
        robot,
        spacing=spacing_of(database),
        database=database,
        progress=progress,
    )
    progress(1, 1)
    session.twins = texture_of(found, field.stride, digest)
    session.tell({"event": "state"})
    return {
        "layer": TWINS,
        "share": found.share,
        "alike": ALIKE,
        "places": len(found),
        "spacing": found.spacing,
    }

"""Look-alikes of one place, where a scan taken there would match as well, and of the whole map.

Those of all places are a layer beside those of the field.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import FARTHEST
from locplan.errors import ConfigError
from locplan.explorer._snap import snapped
from locplan.explorer._textures import Texture
from locplan.matching import ScanDatabase
from locplan.robots import Robot
from locplan.twins import PLACE_HEADINGS, PLACE_SPACING, Twins, find_twins

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

TWINS = "twins"
"""Name of the layer."""
MAX_EXCESS = 12.0
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
    at: Any = found.summary(starts=())["at"]
    alike = [each for each in at["twins"] if each["excess"] <= ALIKE]
    return {**at, "twins": alike}


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


def spacing_of(database: ScanDatabase) -> float:
    """The usual distance of places [m], or a greater one where that would take too long."""
    every, cell = database.everywhere, database.grid.resolution
    headings = 1 if database.lidar.sees_alike_in_all_headings else PLACE_HEADINGS
    poses = SECONDS / (POSE_SECONDS + PLACE_SECONDS * len(every.positions))
    spacing = math.sqrt(float(every.fits.sum()) * cell**2 * headings / poses)
    return max(PLACE_SPACING, math.ceil(10 * spacing) / 10, cell)


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
        (MAX_EXCESS, 0.0),
        np.clip(excess, 0.0, MAX_EXCESS),
        "How much worse the best other place explains a scan than the right one. At 0 both explain"
        f" it equally well, at {ALIKE:g} nats the other is {math.exp(-ALIKE):.0%} as likely;"
        f" {MAX_EXCESS:g} also stands for more. Places are {found.spacing:g} m apart.",
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

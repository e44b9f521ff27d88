"""Sessions of the explorer on small maps, without the web."""

from __future__ import annotations

import json
from functools import cache

import numpy as np

import locplan
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.session import Session
from locplan.field import CovarianceField, FieldConfig, Fisher, load_or_compute
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.maps.environments import make
from locplan.robots import Amcl, Lidar, Robot
from support.maps import random_rooms

START, MIDDLE, GOAL = (2.0, 3.0), (20.0, 3.0), (38.0, 3.0)
ROUTE = {"start": list(START), "goal": list(GOAL), "via": [], "weight": 3.0}
"""A route in the corridors, as the page asks for it."""
LIDAR = Lidar(range=6.0)
ROBOT = Robot(LIDAR, filter=Amcl(min_particles=100, max_particles=200))
SAD = FieldConfig(locplan.Sad(range=1.5), stride=0.4)
SMALL = Robot(footprint=0.15, margin=0.0)
POINT = Robot(footprint=0.0, margin=0.0)


@cache
def corridors() -> tuple[OccupancyGrid, CovarianceField]:
    """Two corridors, of which the shorter one is degenerate, and their field."""
    grid = make("two_corridors", resolution=0.1)
    return grid, load_or_compute(grid, FieldConfig(Fisher(LIDAR), stride=0.4))


def open_corridors(**opening) -> Session:
    """Return a session with the corridors' field."""
    grid, field = corridors()
    session = Session(grid, StartSettings(field.config, **{"robot": ROBOT} | opening))
    session.begin(field)
    session.wait()
    return session


def rooms(seed: int = 3, yaw: float = 0.0) -> OccupancyGrid:
    cells = random_rooms((60, 90), seed)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1, (1.0, -2.0, yaw), "rooms")


def open_session(grid: OccupancyGrid, config: FieldConfig = SAD, **opening) -> Session:
    """Return a session whose field is there."""
    session = Session(grid, StartSettings(config, **{"robot": SMALL, **opening}))
    session.begin()
    session.wait()
    return session


def ask(session: Session, do: str, progress=lambda *_: None, **values):
    """Return the answer to a question, through JSON as the page gets it."""
    answer = session.answer(do, progress=progress, **json.loads(json.dumps(values)))
    return json.loads(json.dumps(answer, allow_nan=False))


def ask_plan(session, stops, weight: float, *, held: int | None = None, draft: bool = False):
    """Return both paths over some stops, of which one may be held."""
    (start, *via, goal), last = stops, len(stops) - 1
    hold = None if held is None else {0: "start", last: "goal"}.get(held, f"via:{held - 1}")
    route = {"start": start, "via": via, "goal": goal, "weight": weight}
    return ask(session, "plan", **route, hold=hold, draft=draft)


def free_places(session: Session, count: int, seed: int = 1) -> list[tuple[float, float]]:
    """Return random places, off the cells' centres, of the largest part of the free space."""
    parts, rng = session.scene.parts, np.random.default_rng(seed)
    cells = np.argwhere(parts.labels == parts.largest)
    chosen = cells[rng.integers(0, len(cells), count)] + rng.uniform(0.2, 0.8, (count, 2))
    return [tuple(map(float, xy)) for xy in zip(*parts.grid.grid_to_world(*chosen.T), strict=True)]


class Interrupted(Exception):
    """Exception that the progress of a test raises."""


def interrupt_after(calls: int):
    """Return a progress callback that ends the work at a call, and the list of all calls."""
    seen = []

    def note(done: int, total: int, doing: str = "") -> None:
        seen.append((done, total))
        if len(seen) == calls:
            raise Interrupted

    return note, seen

"""Views of small maps, for tests of the explorer's long answers."""

from __future__ import annotations

import json
from functools import cache

from locplan.app.explorer.scene import Opening
from locplan.app.explorer.session import Session
from locplan.field import CovarianceField, FieldConfig, Fisher, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.maps.environments import make
from locplan.planning import Costmap, Path
from locplan.planning.plans import plan_beside_shortest
from locplan.robots import Amcl, Lidar, Robot

START, MIDDLE, GOAL = (2.0, 3.0), (20.0, 3.0), (38.0, 3.0)
LIDAR = Lidar(range=6.0)
ROBOT = Robot(LIDAR, filter=Amcl(min_particles=100, max_particles=200))


@cache
def corridors() -> tuple[OccupancyGrid, CovarianceField]:
    """Two corridors, of which the shorter one is degenerate, and their field."""
    grid = make("two_corridors", resolution=0.1)
    return grid, load_or_compute(grid, FieldConfig(Fisher(LIDAR), stride=0.4))


def make_costmap(weight: float = 3.0) -> Costmap:
    """The costmap of the corridors at a weight that is not the default."""
    return Costmap.from_field(*corridors(), weight=weight)


def plan_paths(weight: float = 3.0) -> dict[str, Path]:
    """The aware path and the shortest one through the corridors."""
    plans = plan_beside_shortest(make_costmap(weight), START, GOAL)
    return {name: plan.path for name, plan in plans.items()}


WAY = {"start": list(START), "goal": list(GOAL), "via": [], "weight": 3.0}


def open_session(with_field: bool = True, **opening) -> Session:
    """A session with the corridors' field."""
    grid, field = corridors()
    session = Session(grid, Opening(field.config, **{"robot": ROBOT} | opening))
    if with_field:
        session.begin(field).result()
    return session


def ask_session(session: Session, do: str, *, progress=lambda *_: None, **values):
    """The answer to a question, through JSON as the page gets it."""
    asked = json.loads(json.dumps(values))
    told = session.answer(do, progress=progress, **asked)
    return json.loads(json.dumps(told, allow_nan=False))


class Interrupted(Exception):
    """What the progress of a test raises."""


def interrupt_after(calls: int):
    """A progress callback that ends the work at a call, and the list of all calls."""
    seen = []

    def note(done: int, total: int, doing: str = "") -> None:
        seen.append((done, total))
        if len(seen) == calls:
            raise Interrupted

    return note, seen

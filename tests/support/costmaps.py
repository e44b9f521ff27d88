"""Small costmaps: random densities, two ways around a block, clutter, rooms."""

from __future__ import annotations

import numpy as np

from locplan.maps import FREE, OccupancyGrid
from locplan.planning import Costmap


def random_density(shape, seed, *, blocked=0.25, greatest=9.0):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1.0, greatest, shape)
    density[rng.random(shape) < blocked] = np.inf
    density[0, 0], density[-1, -1] = rng.uniform(1.0, greatest, 2)
    return density


def costmap_from_density(density) -> Costmap:
    return Costmap.from_density(OccupancyGrid(np.full(density.shape, FREE), 1.0), density)


def two_ways() -> Costmap:
    """A short way of great cost and a longer one of small cost around a block, walls between."""
    cells = np.full((40, 40), FREE, np.uint8)
    cells[12:30, 10:30] = 0
    density = np.ones(cells.shape)
    density[:12] = 8.0
    return Costmap.from_density(OccupancyGrid(cells, 0.1), density, robot=0.1)


def two_ways_request(space):
    """Start, goal and options on `two_ways`."""
    if space == "R2":
        return (0.55, 1.05), (3.45, 1.05), {}
    options = {} if space == "SE2" else {"turning_radius": 0.25}
    return (0.55, 1.05, 1.57), (3.45, 1.05, -1.57), options | {"space": space}


EMPTY_ROOM = OccupancyGrid(np.full((30, 30), FREE), 0.1, name="room")


ROOM_ENDS = ((0.5, 0.5), (2.5, 2.0))


def blank_room() -> Costmap:
    return Costmap.blank(EMPTY_ROOM, robot=0.1)

"""Generated maps: the paper's kinds of places, and larger plans to drive through.

The kinds of places are those of Figs. 16 and 17 of "Localizability estimation using correlation
on occupancy grid maps" (ROBOMECH Journal 10, 2023); the plans themselves are drawn here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import number, one_of, whole
from locplan.maps._drawing import Box, Canvas
from locplan.maps._grid import OccupancyGrid
from locplan.maps._occupancy import FREE, OCCUPIED

_FINEST, _COARSEST = 0.01, 0.1  # limits of the resolution at which plans keep their walls [m]


def _between(edges: Sequence[float]) -> list[tuple[float, float]]:
    """The rooms between walls of 0.2 m that end at the given edges."""
    return [(a, b - 0.2) for a, b in pairwise(edges)]


def _draw_places(c: Canvas) -> None:
    # A, the complex room: no two of its corners look alike.
    c.carve((1, 1, 12, 11), (3, 0, 3.8, 1), (8, 0.4, 9.6, 1), (0, 6, 1, 7.2), (0.4, 3, 1, 3.6))
    c.block((1, 8.8, 2.4, 11), (4.8, 1, 5, 2.8), (7.4, 8.6, 7.6, 11), (7.6, 8.6, 9.0, 8.8))
    c.block((2.4, 4, 3.4, 5.8), (8.2, 2.4, 9.8, 3.2), (5.6, 1, 7.4, 1.5), (10.4, 10.2, 12, 11))
    c.block((5.2, 8.2, 5.7, 8.7), (11.4, 7.4, 12, 8.8), (10.2, 8.8, 10.6, 9.2))
    c.polygon([(12, 1), (12, 2.8), (10.4, 1)])
    c.polygon([(6.9, 6.6), (7.6, 6.1), (8.2, 7.1), (7.5, 7.6)])
    c.pillars([(4.3, 7.0), (9.9, 6.2)], 0.3)
    c.pillars([(6.8, 3.7), (2.2, 2.3)], 0.2)
    # B, the straight corridor, and the ways from A and B to the rest.
    c.carve((12, 4.8, 12.2, 6.2), (12.2, 4.5, 38, 6.5), (38, 4.5, 40, 19))
    c.carve((3.2, 11, 4.6, 11.2), (3, 11.2, 4.8, 17), (3, 17, 38, 19))
    # C, the round room: its door is as narrow as possible, and opens to a distant wall.
    c.disc(46.5, 12, 4.5, free=True)
    c.carve((40, 11.6, 42.2, 12.4))
    # D, the repeating corridor.
    for k in range(16):
        x = 8.8 + 1.6 * k
        c.carve((x, 16.4, x + 0.8, 17), (x, 19, x + 0.8, 19.6))


def _draw_hall(c: Canvas) -> None:
    rng = np.random.default_rng(3)
    # E, the open hall: gates in its walls, nothing on its floor.
    c.carve((0.6, 0.6, 42.6, 32.6), (8, 0, 12, 0.6), (29, 0, 32, 0.6), (0, 12, 0.6, 16))
    c.carve((42.6, 6, 43.2, 9), (42.6, 20, 43.2, 24))
    # F, beside it: a concourse with kiosks, alcoves and pillars, and small rooms.
    c.carve((0.6, 32.9, 42.6, 37.3))
    c.door((4, 32.6, 7.2, 32.9), (19.6, 32.6, 22.8, 32.9), (36, 32.6, 39.2, 32.9))
    edges = (0.6, 5, 8.6, 14.2, 17.6, 23, 26.2, 31.6, 35.2, 38.4, 42.8)
    for k, (x0, x1) in enumerate(_between(edges)):
        top = (43.5, 42.9, 43.9, 42.1, 43.1)[k % 5]
        c.carve((x0, 37.5, x1, top))
        door = x0 + (0.6, 1.8, 1.2)[k % 3]
        c.door((door, 37.3, door + 1, 37.5))
        c.furnish(rng, (x0, 37.5, x1, top), 4, 1.6)
    c.block((11.2, 36.1, 13.6, 37.3), (15.4, 32.9, 15.6, 34.9), (25.4, 32.9, 28, 34.1))
    c.block((30.2, 35.7, 30.4, 37.3), (33.4, 32.9, 33.6, 34.3), (0.6, 34.9, 1.8, 36.3))
    c.block((12.2, 34.2, 13, 35), (23.4, 35.4, 24.4, 35.8), (40.8, 35.5, 42.6, 35.7))
    c.pillars([(3.2, 34.5), (9.2, 34.5), (17.4, 35.4), (20, 34.9), (31.6, 34.4), (38, 35)], 0.3)
    c.furnish(rng, (0.6, 32.9, 42.6, 37.3), 14, 0.9)


def _draw_two_corridors(c: Canvas) -> None:
    # The rooms at the ends, each with its own corners and furniture.
    c.carve((0, 0.4, 7, 14), (1.2, 0, 2.6, 0.4), (4.6, 14, 6, 14.6))
    c.block((0, 5, 2.2, 5.2), (3, 6.4, 4.4, 7.2), (0, 9.2, 0.6, 11), (5.4, 7.6, 7, 8.2))
    c.block((3.4, 0.4, 4.8, 1.1), (1.6, 12, 3.2, 12.8), (6.4, 4.6, 7, 6), (4.2, 10.2, 4.7, 10.7))
    c.polygon([(0, 14), (0, 12.6), (1.2, 14)])
    c.pillars([(4.7, 4.7), (2.2, 8.4)], 0.3)
    c.carve((33, 0, 40, 13.4), (34, 13.4, 35.6, 14))
    c.block((38.4, 6.6, 40, 6.8), (35.4, 8.6, 36.2, 10.2), (33, 5.2, 34.4, 5.8), (39.4, 9, 40, 11))
    c.block((36.8, 0, 38.6, 0.8), (33, 7.2, 33.5, 8.6), (37.4, 12.4, 38.8, 13.4), (34, 0, 34.4, 1))
    c.polygon([(40, 0), (40, 1.6), (39, 0)])
    c.polygon([(36.4, 5.2), (37.2, 4.8), (37.6, 5.6), (36.8, 6)])
    c.pillars([(37.6, 8.2), (35.2, 12), (34.6, 7.2)], 0.25)
    # The short corridor: 26 m without a mark, and nothing behind its walls within 6 m.
    c.carve((7, 2, 33, 4))
    # The long one: jogs, and on both sides niches of which no two are alike.
    c.carve((7, 10.6, 11.4, 12.4), (10.2, 11.4, 16.2, 13.2), (15, 10.2, 21.8, 12.2))
    c.carve((20.6, 11.2, 27, 13), (25.8, 10.4, 33, 12.2))
    c.carve((8, 12.4, 9.1, 14), (9.7, 9.8, 10.6, 10.6), (12, 13.2, 12.7, 14.2))
    c.carve((12.4, 10, 14, 11.4), (14.4, 13.2, 15.2, 14.4), (16.8, 12.2, 18.6, 13.4))
    c.carve((17.4, 9.7, 18, 10.2), (19.4, 12.2, 20, 14), (22, 9.8, 23.2, 11.2))
    c.carve((22.6, 13, 23.2, 13.8), (24.2, 13, 25.6, 14.4), (24.4, 10, 25, 11.2))
    c.carve((27.6, 12.2, 28.2, 13.8), (28.8, 9.7, 30.2, 10.4), (30.6, 12.2, 32, 13.2))
    c.block((8.6, 10.6, 9, 11), (11.6, 12.8, 12, 13.2), (14.6, 11.4, 15, 11.9))
    c.block((19, 10.2, 19.6, 10.8), (26.2, 12.6, 26.6, 13), (31.2, 10.4, 31.5, 11))
    c.pillars([(20.9, 12.2), (13.2, 10.7), (16.2, 11.3), (29.5, 11.2)], 0.2)


def _draw_office(c: Canvas) -> None:
    rng = np.random.default_rng(7)
    rooms: list[tuple[Box, int]] = []
    # A loop of corridors between the rooms along the facades and the core.
    c.carve((6, 6, 40, 8), (6, 22, 40, 24), (6, 6, 8, 24), (38, 6, 40, 24))
    south = (0, 4.4, 8.2, 12, 17.4, 21.2, 25, 30.6, 34.4, 40.2, 46.2)
    for k, (x0, x1) in enumerate(_between(south)):
        rooms.append(((x0, 0, x1, 5.8), 6))
        door = min(max(x0 + (0.6, 1.8)[k % 2], 6.2), 38.8) if 0 < k < 9 else 0
        if door:
            c.door((door, 5.8, door + 0.9, 6))
    north = (0, 6, 9.8, 15.4, 19.2, 23, 28.4, 32.2, 36.2, 40.2, 46.2)
    for k, (x0, x1) in enumerate(_between(north)):
        rooms.append(((x0, 24.2, x1, 30), 6))
        if 0 < k < 9:
            c.door((x1 - (0.9, 1.9)[k % 2] - 0.6, 24, x1 - (0.9, 1.9)[k % 2] + 0.3, 24.2))
    for y0, y1 in _between((6, 11.4, 16.2, 20, 24.2)):
        rooms += [((0, y0, 5.8, y1), 5), ((40.2, y0, 46, y1), 5)]
        c.door((5.8, y0 + 1.2, 6, y0 + 2.1), (40, y1 - 2.2, 40.2, y1 - 1.3))
    # The corner rooms are reached through their neighbours.
    c.door((2, 5.8, 2.9, 6), (2, 24, 2.9, 24.2), (43, 5.8, 43.9, 6), (43, 24, 43.9, 24.2))
    # The core: an open-plan area, a cross corridor, a meeting room and side rooms.
    c.carve((8.2, 8.2, 24, 21.8), (24.2, 8, 26, 22))
    c.door((8, 13.8, 8.2, 15.6), (24, 13.8, 24.2, 15.6), (14, 8, 15.4, 8.2))
    c.pillars([(x, y) for x in (9.8, 16.5, 22.9) for y in (11.2, 18.8)], 0.2)
    for x in (11, 14.2, 17.4, 20.6):
        c.block((x, 9.6, x + 1.4, 12.8), (x, 17.2, x + 1.4, 20.4))
    c.furnish(rng, (8.2, 8.2, 24, 21.8), 16, 0.8)
    meeting = (26.2, 8.2, 33.6, 14.2)
    c.carve(meeting)
    c.block((28, 10.4, 32, 12))
    c.door((26, 12.8, 26.2, 13.8), (28, 8, 29, 8.2))
    c.furnish(rng, meeting, 4, 0.7)
    for y0, y1 in _between((14.4, 18, 22)):
        rooms.append(((26.2, y0, 31.4, y1), 5))
        c.door((26, y0 + 1, 26.2, y0 + 1.9))
    rooms += [((33.8, 8.2, 37.8, 14.2), 5), ((31.6, 14.4, 37.8, 21.8), 8)]
    c.door((37.8, 10, 38, 10.9), (37.8, 17, 38, 17.9))
    for room, count in rooms:
        c.carve(room)
        c.furnish(rng, room, count, 1.8)


def _draw_warehouse(c: Canvas) -> None:
    rng = np.random.default_rng(5)
    c.carve((0, 0, 50, 30))
    # Two blocks with identical aisles: full racks, and racks of which a lidar sees only the feet.
    for k in range(7):
        y = 3 + 3.6 * k
        c.block((2.4, y, 14.4, y + 1.2))
        for foot in range(6):
            x = 17 + 2.4 * foot
            c.block((x, y, x + 0.2, y + 0.2), (x, y + 1, x + 0.2, y + 1.2))
    # The loading docks, the shift office, and pillars and pallets on the open floor.
    for k in range(5):
        y = 2 + 5.4 * k
        c.carve((50, y, 51.2, y + 3.2))
        c.block((49.4, y - 0.6, 50, y - 0.3), (49.4, y + 3.5, 50, y + 3.8))
    c.block((33, 25.8, 40, 26), (33, 26, 33.2, 30), (39.8, 26, 40, 30))
    c.door((35, 25.8, 36, 26))
    c.block((37.2, 29.2, 39.8, 30), (33.2, 28, 34, 29.4))
    c.pillars([(31.4, 8), (31.4, 22), (40.6, 8), (40.6, 22)], 0.3)
    for y0, y1 in ((1, 6), (13, 17), (18, 23)):
        c.furnish(rng, (44.4, y0, 48.6, y1), 3, 1.2)
    c.furnish(rng, (29.6, 0, 42, 4), 4, 1.2)


_PLANS: dict[str, tuple[tuple[float, float], Callable[[Canvas], None]]] = {
    "places": ((51, 19.6), _draw_places),
    "hall": ((43.2, 43.9), _draw_hall),
    "two_corridors": ((40, 14.6), _draw_two_corridors),
    "office": ((46, 30), _draw_office),
    "warehouse": ((51.2, 30), _draw_warehouse),
}
"""Width and height [m], and the function that draws the plan, by the environment's name."""
_LANDMARKS: dict[str, dict[str, tuple[float, float]]] = {
    "places": {"A": (5.9, 5.4), "B": (25, 5.5), "C": (46.5, 12), "D": (21.6, 18)},
    "hall": {"E": (21.6, 16.6), "F": (21.6, 36), "start": (3.6, 24), "goal": (39.6, 24)},
    "two_corridors": {"start": (2, 3), "goal": (38, 3), "short": (20, 3), "long": (20, 11.4)},
    "office": {"start": (7, 7), "goal": (39, 23), "open_plan": (16.1, 14.8), "meeting": (30, 13.2)},
    "warehouse": {"start": (1.2, 1.5), "goal": (47, 28.6), "aisle": (8.4, 12.6), "floor": (37, 15)},
}


def names() -> tuple[str, ...]:
    """Names of the environments that `make` draws."""
    return tuple(_PLANS)


def landmarks(name: str) -> dict[str, tuple[float, float]]:
    """World positions x, y [m] of the named places of an environment.

    They lie in free space, at least 0.25 m from any wall, and all are reachable from one another at
    that clearance.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    dict of str to (x, y)
        Positions [m] by name, such as "start" and "goal".

    Raises
    ------
    ConfigError
        If the name is unknown.

    Examples
    --------
    >>> landmarks("two_corridors")["goal"]
    (38.0, 3.0)
    """
    one_of("the environment", name, _PLANS)
    return {key: (float(x), float(y)) for key, (x, y) in _LANDMARKS[name].items()}


def make(
    name: str, *, resolution: float = 0.05, boundary_noise: float = 0.0, seed: int = 0
) -> OccupancyGrid:
    """Draw an environment: the same arguments always give the same map.

    Its walls are 0.1 m thick, and everything behind them is unknown.

    Parameters
    ----------
    name : str
        "places": a complex room A, a straight corridor B, a round room C and a corridor D that
        repeats every 1.6 m. "hall": a hall E of 42 m x 32 m beside small rooms F.
        "two_corridors": two rooms joined by a short featureless corridor and by a longer
        irregular one. "office" and "warehouse": larger plans.
    resolution : float, default 0.05
        Edge of a cell [m], 0.01 to 0.1; coarse cells are quicker to compute with.
    boundary_noise : float, default 0.0
        Share of the boundary cells to flip, 0 to 1, as `with_boundary_noise` does; 0 leaves the
        walls as they are drawn.
    seed : int, default 0
        Seed of that noise, not negative. The drawing does not depend on it.

    Raises
    ------
    ConfigError
        If the name is unknown or a value is out of its range.

    Examples
    --------
    >>> grid = make("two_corridors", resolution=0.1)
    >>> grid.shape, grid.name
    ((158, 412), 'two_corridors')
    """
    one_of("the environment", name, _PLANS)
    number("resolution", resolution, _FINEST, _COARSEST)
    size, draw = _PLANS[name]
    canvas = Canvas(size, resolution)
    draw(canvas)
    return with_boundary_noise(canvas.grid(name), boundary_noise, seed=seed)


def with_boundary_noise(grid: OccupancyGrid, fraction: float, *, seed: int = 0) -> OccupancyGrid:
    """Flip some of the cells where free space meets walls, as mapping errors do.

    Parameters
    ----------
    grid : OccupancyGrid
        The map to disturb; it is left as it is, and the new one has its place and name.
    fraction : float
        Probability with which each boundary cell flips, 0 to 1. A boundary cell is an occupied
        one with a free 4-neighbour (it becomes free) or the reverse (it becomes occupied).
    seed : int, default 0
        Seed of the choice, not negative; others give other cells.

    Raises
    ------
    ConfigError
        If the fraction or the seed is out of its range.
    """
    number("boundary_noise", fraction, 0, 1)
    whole("seed", seed, 0)
    occupied, flip = grid.cells == OCCUPIED, boundary_cells(grid)
    random = np.random.default_rng(seed)
    for row in flip:  # row by row, which saves memory on a large map
        row &= random.random(row.size) < fraction
    cells = grid.cells.copy()
    cells[flip & occupied], cells[flip & ~occupied] = FREE, OCCUPIED
    return replace(grid, cells=cells)


def boundary_cells(grid: OccupancyGrid) -> NDArray[np.bool_]:
    """Occupied cells with a free 4-neighbour, and free ones with an occupied one, (H, W).

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    occupied, free = grid.cells == OCCUPIED, grid.free
    return np.asarray((occupied & _beside(free)) | (free & _beside(occupied)))


def _beside(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells with a 4-neighbour in the mask."""
    beside = np.zeros_like(mask)
    beside[1:] |= mask[:-1]
    beside[:-1] |= mask[1:]
    beside[:, 1:] |= mask[:, :-1]
    beside[:, :-1] |= mask[:, 1:]
    return beside

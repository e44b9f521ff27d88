"""Generated maps: the paper's kinds of places, and larger plans to drive through.

The kinds of places are those of Figs. 16 and 17 of "Localizability estimation using correlation
on occupancy grid maps" (ROBOMECH Journal 10, 2023); the plans are the files in `plans/`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from locplan._kernels.arrays import Bools
from locplan._util.checks import number, one_of, whole
from locplan.maps._drawing import Canvas
from locplan.maps._grid import OccupancyGrid
from locplan.maps._occupancy import FREE, OCCUPIED

_FINEST, _COARSEST = 0.01, 0.1  # limits of the resolution at which plans keep their walls [m]
_NAMES = ("places", "hall", "two_corridors", "office", "warehouse")

Shape = tuple[str, list[float]]


@cache
def _plan(name: str) -> tuple[list[Shape], dict[str, tuple[float, float]]]:
    """The shapes of a plan in the order in which they are drawn, and its named places."""
    shapes: list[Shape] = []
    places: dict[str, tuple[float, float]] = {}
    text = Path(__file__).with_name("plans").joinpath(f"{name}.txt").read_text("utf-8")
    for line in text.splitlines():
        word, *given = line.split(maxsplit=1)
        for part in given[0].split(",") if word != "#" else ():
            if word == "place":
                place, x, y = part.split()
                places[place] = float(x), float(y)
            else:
                shapes.append((word, [*map(float, part.split())]))
    return shapes, places


def names() -> tuple[str, ...]:
    """Names of the environments that `make` draws."""
    return _NAMES


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
    one_of("the environment", name, _NAMES)
    return dict(_plan(name)[1])


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
    one_of("the environment", name, _NAMES)
    number("resolution", resolution, _FINEST, _COARSEST)
    (_, size), *shapes = _plan(name)[0]
    canvas = Canvas(size, resolution)
    for word, numbers in shapes:
        getattr(canvas, word)(*numbers)
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


def boundary_cells(grid: OccupancyGrid) -> Bools:
    """Occupied cells with a free 4-neighbour, and free ones with an occupied one, (H, W).

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    occupied, free = grid.cells == OCCUPIED, grid.free
    return np.asarray((occupied & _beside(free)) | (free & _beside(occupied)))


def _beside(mask: Bools) -> Bools:
    """Cells with a 4-neighbour in the mask."""
    beside = np.zeros_like(mask)
    beside[1:] |= mask[:-1]
    beside[:-1] |= mask[1:]
    beside[:, 1:] |= mask[:, :-1]
    beside[:, :-1] |= mask[:, 1:]
    return beside

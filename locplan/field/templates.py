"""The template around a cell: a disc of the turned map, or the visible part of it.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math

import numpy as np

from locplan._support.kernels.arrays import Bools, Ints, Octets
from locplan.maps.occupancy import FREE, UNKNOWN

BEHIND = 2
"""Number of cells behind the one that a ray hits that still belong to a visible template."""


def make_disc_mask(radius: int) -> Bools:
    """Mark the cells of a disc, the template's shape, (2r + 1, 2r + 1).

    Parameters
    ----------
    radius : int
        Maximum distance of its cells from the centre [cells].

    Examples
    --------
    >>> make_disc_mask(1).astype(int)
    array([[0, 1, 0],
           [1, 1, 1],
           [0, 1, 0]])
    """
    offset = np.abs(np.arange(-radius, radius + 1))
    half_width = np.array([math.isqrt(radius**2 - k**2) for k in offset.tolist()])
    return np.asarray(offset[None, :] <= half_width[:, None])


def cut_template(cells: Octets, row: int, col: int, radius: int) -> Octets:
    """Cut the square around a cell out of a map, (2r + 1, 2r + 1); outside the map is unknown.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    row, col : int
        The cell.
    radius : int
        Distance from the cell to the square's edges [cells].
    """
    offset = np.arange(-radius, radius + 1)
    return read_levels(cells, row + offset[:, None], col + offset)


def cut_rotated_template(cells: Octets, row: int, col: int, radius: int, theta: float) -> Octets:
    """Cut the square around a cell out of the map turned counter-clockwise by `theta` [rad].

    The whole map is turned about its centre with nearest-neighbour sampling, and cropped around
    the cell's turned and rounded position, (2r + 1, 2r + 1). Turned maps share the map's lattice.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    row, col : int
        The cell.
    radius : int
        Distance from the cell to the square's edges [cells].
    theta : float
        Rotation of the map [rad].
    """
    centre_row, centre_col = compute_map_centre(cells.shape)
    cos, sin = math.cos(theta), math.sin(theta)
    dy, dx = row - centre_row, col - centre_col
    rotated_row = math.floor(sin * dx + cos * dy + centre_row + 0.5)
    rotated_col = math.floor(cos * dx - sin * dy + centre_col + 0.5)
    offset = np.arange(-radius, radius + 1)
    v, u = (rotated_row + offset)[:, None] - centre_row, rotated_col + offset - centre_col
    source_row = np.floor(cos * v - sin * u + centre_row + 0.5).astype(np.int64)
    source_col = np.floor(sin * v + cos * u + centre_col + 0.5).astype(np.int64)
    return read_levels(cells, source_row, source_col)


def mark_visible_part(cells: Octets, row: int, col: int, radius: int, theta: float) -> Bools:
    """Mask of the visible part of a cell's disc, turned by `theta` [rad], (2r + 1, 2r + 1).

    A ray sees the cells on its way to the first cell that is not free, and `BEHIND` cells more, so
    that the wall that it hits is part of the template.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    row, col : int
        The cell.
    radius : int
        Radius of the disc [cells].
    theta : float
        Rotation of the disc [rad].
    """
    beams = count_template_rays(radius)
    steps = np.arange(1, 2 * radius + 1) / 2
    angles = 2 * np.pi * np.arange(beams) / beams
    rows = row + np.floor(np.sin(angles)[:, None] * steps + 0.5).astype(np.int64)
    cols = col + np.floor(np.cos(angles)[:, None] * steps + 0.5).astype(np.int64)
    stops = (read_levels(cells, rows, cols) != FREE) & ((rows != row) | (cols != col))
    first = np.where(stops.any(axis=1), stops.argmax(axis=1) + 1, 2 * radius)
    reach = (first + 1 + 2 * BEHIND)[find_cell_ray_indices(radius, theta)]  # [half cells]
    offset = 2 * np.arange(-radius, radius + 1)
    return make_disc_mask(radius) & (offset[:, None] ** 2 + offset[None, :] ** 2 <= reach**2)


def count_template_rays(radius: int) -> int:
    """Return the number of rays: one passes every cell at the disc's edge.

    Parameters
    ----------
    radius : int
        Radius of the disc [cells].
    """
    return max(360, math.ceil(2 * math.pi * radius))


def find_cell_ray_indices(radius: int, theta: float) -> Ints:
    """Return the index of the ray towards each cell of the square, (2r + 1, 2r + 1).

    Parameters
    ----------
    radius : int
        Distance from the centre to the square's edges [cells].
    theta : float
        Rotation of the square [rad].
    """
    beams = count_template_rays(radius)
    offset = np.arange(-radius, radius + 1)
    direction = np.arctan2(offset[:, None], offset[None, :]) - theta
    return np.floor(direction * (beams / (2 * np.pi)) + 0.5).astype(np.int64) % beams


def compute_map_centre(shape: tuple[int, int]) -> tuple[float, float]:
    """Return the centre of a map's rotation, (row, col).

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the map.
    """
    return (shape[0] - 1) / 2, (shape[1] - 1) / 2


def read_levels(cells: Octets, rows: Ints, cols: Ints) -> Octets:
    """Return the levels of a map at some cells; outside the map is unknown.

    Parameters
    ----------
    cells : (H, W) array of uint8
        Levels of the map.
    rows, cols : array of int
        The cells, of any shapes that broadcast.
    """
    height, width = cells.shape
    inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    levels = cells[np.clip(rows, 0, height - 1), np.clip(cols, 0, width - 1)]
    return np.where(inside, levels, np.uint8(UNKNOWN))

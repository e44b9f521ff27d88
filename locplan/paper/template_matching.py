"""Template matching at one pose, by the formulas: readable, slow, the reference for the kernels.

The seven models that the paper compares take the levels of a template T and of the part M of the
map that it lies on, arrays of the same shape. The best match has the least value of SSD, SAD and
NSSD, and the greatest value of NCC, ZNCC, ZCC and CC. A model that divides by zero is undefined:
NaN.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import short_repr
from locplan._support.kernels.arrays import Floats, Ints, Octets
from locplan.errors import ConfigError, MapError, PoseError
from locplan.field.sad import Sad
from locplan.field.search_window import OffsetLattice
from locplan.field.templates import (
    cut_rotated_template,
    cut_template,
    make_disc_mask,
    mark_visible_part,
)
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE


def ssd(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the sum of squared differences (Eq. 1).

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return float(((template - levels) ** 2).sum())


def sad(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the sum of absolute differences (Eq. 2).

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return float(np.abs(template - levels).sum())


def nssd(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the normalised sum of squared differences (Eq. 3); NaN if it divides by zero.

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return _normalise(ssd(template, levels), template, levels)


def ncc(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the normalised cross-correlation (Eq. 4); NaN if it divides by zero.

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return _normalise(cc(template, levels), template, levels)


def zncc(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the zero-mean normalised cross-correlation (Eq. 5); NaN if it divides by zero.

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return ncc(template - template.mean(), levels - levels.mean())


def zcc(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the zero-mean cross-correlation (Eq. 6).

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return cc(template - template.mean(), levels - levels.mean())


def cc(template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Compute the cross-correlation (Eq. 7).

    Parameters
    ----------
    template, levels : arrays of float
        See `similarities`; of uint8, differences would wrap around.
    """
    return float((template * levels).sum())


MODELS: dict[str, Callable[[NDArray[Any], NDArray[Any]], float]] = {
    "SSD": ssd,
    "SAD": sad,
    "NSSD": nssd,
    "NCC": ncc,
    "ZNCC": zncc,
    "ZCC": zcc,
    "CC": cc,
}
"""Functions of the models by name, in the order of Eq. 1-7."""
DIFFERENCES = ("SSD", "SAD", "NSSD")
"""The models whose least value is the best match."""


def compute_similarities(template: ArrayLike, levels: ArrayLike) -> dict[str, float]:
    """Compute all seven models from the levels of a template and of the map under it.

    Parameters
    ----------
    template : (...) array
        Levels of the template's cells, 0, 127 or 254, of any shape.
    levels : (...) array
        Levels of the map's cells under them, of the same shape.

    Returns
    -------
    dict of str to float
        Value of each model, in the order of Eq. 1-7; NaN if it divides by zero.

    Raises
    ------
    MapError
        If the shapes differ, or there is no cell.

    Examples
    --------
    >>> found = compute_similarities([0, 254], [127, 254])
    >>> found["SAD"], found["SSD"], round(found["NCC"], 2)
    (127.0, 16129.0, 0.89)
    """
    t, m = np.asarray(template, float), np.asarray(levels, float)
    if t.shape != m.shape or t.size == 0:
        raise MapError(f"template {t.shape} and map {m.shape} must be of one shape, with cells")
    return {name: model(t, m) for name, model in MODELS.items()}


def compare_models_along_strip(template: Octets, cells: Octets) -> dict[str, Floats]:
    """Compute the seven models for a template slid along a strip of map.

    Parameters
    ----------
    template : (h, w) array of uint8
        Levels of the template's cells.
    cells : (h, W) array of uint8
        Levels of the strip's cells, of the same height, W >= w.

    Returns
    -------
    dict of str to (W - w + 1,) array of float64
        Values of each model with the template's left edge at each column.

    Raises
    ------
    MapError
        If the heights differ or the template is wider than the map.
    """
    (height, width), (map_height, map_width) = template.shape, cells.shape
    if height != map_height or width > map_width:
        raise MapError(f"a template {template.shape} cannot slide along a map {cells.shape}")
    return _compute_model_values(
        (template, cells[:, k : k + width]) for k in range(map_width - width + 1)
    )


def compare_models_along_axis(
    grid: OccupancyGrid, x: float, y: float, axis: str, estimator: Sad
) -> tuple[Floats, dict[str, Floats]]:
    """Compute the seven models for the disc around a position, moved along one axis of the map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    x, y : float
        World position of the disc's centre [m], in free space.
    axis : str
        "x", "y" or "theta", along the map's axes.
    estimator : Sad
        Its search window bounds the offsets, which go cell by cell, or degree by degree.

    Returns
    -------
    offsets : (n,) array
        Offsets along the axis [m], or counter-clockwise turns [rad].
    curves : dict of str to (n,) array
        Values of each model by its name.

    Raises
    ------
    LocplanError
        If the position is not in free space, or the window has no such axis.
    """
    row, col, radius = _find_disc(grid, x, y, estimator)
    window = estimator.lattice(grid.resolution)
    if axis not in ("x", "y", "theta")[: window.dimension]:
        raise ConfigError(
            f"axis must be x, y, or theta if the window has headings, not {short_repr(axis)}"
        )
    mask = make_disc_mask(radius)
    unmoved = cut_template(grid.cells, row, col, radius)[mask]
    if axis == "theta":
        turns = round(estimator.window.half_rotation_deg)
        angles = np.radians(np.arange(-turns, turns + 1, dtype=np.float64))
        return angles, _compute_model_values(
            (cut_rotated_template(grid.cells, row, col, radius, angle)[mask], unmoved)
            for angle in angles
        )
    reach = window.reach
    cells = np.arange(-reach, reach + 1, dtype=np.float64)
    direction = (0, 1) if axis == "x" else (1, 0)
    return cells * grid.resolution, _compute_model_values(
        (
            unmoved,
            cut_template(grid.cells, row + k * direction[0], col + k * direction[1], radius)[mask],
        )
        for k in range(-reach, reach + 1)
    )


def _compute_model_values(pairs: Iterable[tuple[NDArray[Any], NDArray[Any]]]) -> dict[str, Floats]:
    """Compute the seven models for pairs of template and map, by name."""
    rows = [compute_similarities(template, levels) for template, levels in pairs]
    return {name: np.array([row[name] for row in rows]) for name in MODELS}


def _normalise(value: float, template: NDArray[Any], levels: NDArray[Any]) -> float:
    """Divide a value by the norms of template and map; NaN if one is zero."""
    norms = math.sqrt((template**2).sum() * (levels**2).sum())
    return value / norms if norms > 0 else math.nan


def compute_sad_distribution(
    cells: Octets, row: int, col: int, radius: int, window: OffsetLattice, *, visible: bool = False
) -> Ints:
    """Compute the sums of absolute differences over the search window at one cell (Eq. 2).

    S(c; dx, dy, theta) = sum over the disc of ``|T_theta(u) - M(c + d + u)|``, where T_theta is
    the template around c on the map turned by theta.

    Parameters
    ----------
    cell_offsets : (H, W) array of uint8
        Levels of the map.
    row, col : int
        The cell c.
    radius : int
        Radius of the disc [cells].
    window : OffsetLattice
        The offsets d and the headings theta.
    visible : bool, default False
        Whether only those cells of the disc count that are visible from c, see `Sad.template`.

    Returns
    -------
    (dx, dy, theta) array of int64
        Sums in units of the levels: 254 for a free cell on an occupied one; 0 at zero offset.

    Examples
    --------
    >>> cells = np.full((9, 9), 254, np.uint8)
    >>> cells[:, 6] = 0
    >>> from locplan.field import SearchWindow
    >>> window = SearchWindow(half_width=1, step=1, half_rotation_deg=0).to_lattice(resolution=1.0)
    >>> compute_sad_distribution(cells, 4, 4, 2, window)[:, :, 0]
    array([[ 254,  254,  254],
           [   0,    0,    0],
           [1016, 1016, 1016]])
    """
    import cv2

    mask = make_disc_mask(radius).astype(np.uint8)
    size = 2 * radius + 1
    around = cut_template(cells, row, col, radius + window.reach)
    shifts = (window.reach + window.cell_offsets).tolist()
    mismatch = np.empty((len(shifts), len(shifts), len(window.angles)), np.int64)
    for k, theta in enumerate(window.angles):
        template = cut_rotated_template(cells, row, col, radius, theta)
        if visible:
            mask = mark_visible_part(cells, row, col, radius, theta).astype(np.uint8)
        for j, dy in enumerate(shifts):
            for i, dx in enumerate(shifts):
                shifted = around[dy : dy + size, dx : dx + size]
                mismatch[i, j, k] = cv2.norm(template, shifted, cv2.NORM_L1, mask)
    return mismatch


def compute_mismatch_areas(grid: OccupancyGrid, x: float, y: float, estimator: Sad) -> Floats:
    """Compute the mismatch area of a position at every offset of the search window.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    x, y : float
        World position [m], in free space.
    estimator : Sad
        The estimator, whose template and search window are taken.

    Returns
    -------
    (dx, dy, theta) array of float64
        `compute_sad_distribution` in m^2: 1 m^2 of free cells on occupied ones is 1.

    Raises
    ------
    PoseError
        If the position is not in free space.
    """
    row, col, radius = _find_disc(grid, x, y, estimator)
    window = estimator.lattice(grid.resolution)
    visible = estimator.template == "visible"
    sums = compute_sad_distribution(grid.cells, row, col, radius, window, visible=visible)
    return sums * np.float64(grid.resolution**2 / FREE)


def _find_disc(grid: OccupancyGrid, x: float, y: float, estimator: Sad) -> tuple[int, int, int]:
    """Return row and column of the cell at a position, and the template's radius [cells]."""
    row, col = grid.cell((x, y))
    if not (grid.contains(row, col) and grid.free[row, col]):
        raise PoseError(f"{x:g},{y:g} is not in the map's free space; name a place that is")
    return row, col, max(1, math.floor(estimator.range / grid.resolution + 1e-9))

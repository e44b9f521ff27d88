"""The SAD-correlation covariance at given cells (the paper's Eq. 2, 8 and 9).

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.config import FieldConfig
from locplan.grid import FREE, OCCUPIED
from locplan.search_window import SearchWindow
from locplan.template_matching import disc, map_centre

LEVEL_STEP = 127
"""Difference of two neighbouring levels."""


def covariances(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    resolution: float,
    config: FieldConfig,
    *,
    corner: tuple[int, int] = (0, 0),
    map_shape: tuple[int, int] | None = None,
) -> NDArray[np.float64]:
    """Covariance of a pose match at each cell, in the grid's own axes.

    Parameters
    ----------
    levels : (H, W) array of uint8
        The map, or a part of it that reaches `halo` cells beyond every given cell.
    rows, cols : (n,) arrays of int
        The cells, as indices of the whole map.
    resolution : float
        Edge of a cell [m].
    config : FieldConfig
        Template, search window and weights.
    corner : (int, int)
        Where `levels` starts in the whole map.
    map_shape : (int, int), optional
        Of the whole map, which turns about its centre; by default that of `levels`.

    Returns
    -------
    (n, 3, 3) array of float64, or (n, 2, 2) without rotation
        k times the weighted covariance of (x, y, theta) [m, m, rad] (Eq. 8), plus Q if
        `config.quantisation`.
    """
    from locplan._kernels import sad

    window = SearchWindow.from_config(config, resolution)
    radius = template_radius(config, resolution)
    tables = _tile_tables(levels, rows, cols, radius, window, corner, map_shape or levels.shape)
    counts = np.arange(2 * np.count_nonzero(disc(radius)) + 1)
    weights = offset_weights(counts * LEVEL_STEP, resolution, config)
    in_steps = sad.tile_covariances(*tables, weights)
    steps = np.array([window.step, window.step, window.rotation_step])
    covariance = config.noise_level * in_steps * np.outer(steps, steps)
    covariance = covariance[:, : window.dimension, : window.dimension]
    return covariance + window.quantisation if config.quantisation else covariance


def sad_distributions(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    window: SearchWindow,
) -> NDArray[np.int64]:
    """The kernel's `template_matching.sad_distribution` at many cells, (n, dx, dy, theta)."""
    from locplan._kernels import sad

    tables = _tile_tables(levels, rows, cols, radius, window, (0, 0), levels.shape)
    return LEVEL_STEP * sad.tile_mismatch_counts(*tables).transpose(0, 1, 3, 2)


def offset_weights(
    mismatch: NDArray[Any], resolution: float, config: FieldConfig
) -> NDArray[np.float64]:
    """Weight of offsets with the sums of absolute differences `mismatch` (Eq. 9).

    S is held as mismatch area, ``mismatch / 254`` cells [m^2], so that `tau` and `floor` mean the
    same at every resolution.
    """
    cell_area = resolution**2
    area = mismatch / (FREE - OCCUPIED) * cell_area
    if config.weight_law == "exponential":
        return np.exp(-area / config.tau)
    floor = cell_area / 2 if config.floor is None else config.floor
    return 1 / np.maximum(area, floor) ** 2


def template_radius(config: FieldConfig, resolution: float) -> int:
    """Radius of the disc in whole cells, at least one."""
    return max(1, math.floor(config.sensor_range / resolution + 1e-9))


def halo(config: FieldConfig, resolution: float) -> int:
    """How far beyond a cell its covariance depends on the map [cells]."""
    window = SearchWindow.from_config(config, resolution)
    reach = window.half_steps * window.step_cells
    # A turned cell lies within one cell of its rounded place, and so does its source.
    return template_radius(config, resolution) + max(reach, 2)


def _tile_tables(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    window: SearchWindow,
    corner: tuple[int, int],
    map_shape: tuple[int, int],
) -> tuple[Any, ...]:
    """Lay out the map and its turned copies for the kernel, for all cells of a tile at once."""
    from locplan._kernels import bitplanes, sad, templates

    step, half_steps = window.step_cells, window.half_steps
    reach = half_steps * step
    disc_squares = templates.disc_squares(disc(radius))
    diameter = disc_squares.rows * bitplanes.SQUARE
    centre_row, centre_col = map_centre(map_shape)
    cos, sin = np.cos(window.angles), np.sin(window.angles)
    cos[window.half_rotations], sin[window.half_rotations] = 1.0, 0.0

    # The templates: the turned maps around the cells' turned and rounded places.
    dy, dx = (rows - centre_row)[:, None], (cols - centre_col)[:, None]
    turned_rows = np.floor(sin * dx + cos * dy + centre_row + 0.5).astype(np.int64)
    turned_cols = np.floor(cos * dx - sin * dy + centre_col + 0.5).astype(np.int64)
    turned = bitplanes.cut_strips(
        levels,
        *corner,
        centre_row,
        centre_col,
        cos,
        sin,
        turned_rows.min(axis=0) - radius,
        turned_cols.min(axis=0) - radius,
        int(np.ptp(turned_rows, axis=0).max()) + diameter,
        int(np.ptp(turned_cols, axis=0).max()) + diameter,
    )

    # The map: the rows and columns that a square starts at, of any cell and any offset.
    spread = math.gcd(*(int(v) for v in rows - rows[0]), *(int(v) for v in cols - cols[0]))
    around = bitplanes.lay_out_window(
        levels,
        *corner,
        int(rows.min()) - radius - reach,
        int(cols.min()) - radius - reach,
        int(np.ptp(rows)) + 2 * reach,
        int(np.ptp(cols)) + 2 * reach,
        radius,
        diameter,
        step,
        math.gcd(spread, step),
        -(-(2 * half_steps + 1) // sad.GROUP) * sad.GROUP,
    )
    return (
        around,
        turned,
        turned_rows,
        turned_cols,
        rows,
        cols,
        radius,
        step,
        half_steps,
        disc_squares,
    )

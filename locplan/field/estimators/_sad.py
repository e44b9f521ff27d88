"""The SAD-correlation covariance at given cells (the paper's Eq. 2, 8 and 9).

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._config import FieldConfig
from locplan.field._search_window import SearchWindow
from locplan.field._template import BEHIND, beam_count, beam_of_cell, disc, map_centre
from locplan.maps import FREE, OCCUPIED

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
    control: NDArray[np.int64] | None = None,
    **_: Any,
) -> dict[str, NDArray[np.float64]]:
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
    control : (2,) array of int64, optional
        Shared with other threads: the first is set to stop early, the second counts the cells
        done. Cells left out are NaN.

    Returns
    -------
    dict with "covariance", (n, 3, 3) array of float64, or (n, 2, 2) without rotation
        k times the weighted covariance of (x, y, theta) [m, m, rad] (Eq. 8), plus Q if
        `config.quantisation`.
    """
    from locplan._kernels import sad

    shape = map_shape or levels.shape
    window = SearchWindow.from_config(config, resolution)
    radius = template_radius(config, window, shape)
    counts = np.arange(2 * np.count_nonzero(disc(radius)) + 1)
    weights = offset_weights(counts * LEVEL_STEP, resolution, config)
    visible = config.template == "visible"
    tile = _lay_out_tile(levels, rows, cols, radius, window, corner, shape, visible)
    in_steps = sad.tile_covariances(tile, weights, np.zeros(2, int) if control is None else control)
    steps = np.array([window.step, window.step, window.rotation_step])
    covariance = config.noise_level * in_steps * np.outer(steps, steps)
    covariance = covariance[:, : window.dimension, : window.dimension]
    return {"covariance": covariance + window.quantisation if config.quantisation else covariance}


def prepare(levels: NDArray[np.uint8], resolution: float, config: FieldConfig) -> None:
    """Nothing: the layout of the map is that of a tile."""


def sad_distributions(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    window: SearchWindow,
    *,
    visible: bool = False,
) -> NDArray[np.int64]:
    """The kernel's `template_matching.sad_distribution` at many cells, (n, dx, dy, theta)."""
    from locplan._kernels import sad

    tile = _lay_out_tile(levels, rows, cols, radius, window, (0, 0), levels.shape, visible)
    return LEVEL_STEP * sad.tile_mismatch_counts(tile).transpose(0, 1, 3, 2)


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
        return np.exp(-area / config.mismatch_scale)
    floor = cell_area / 2 if config.floor is None else config.floor
    return (floor / np.maximum(area, floor)) ** 2  # a common factor of all weights is free


def template_radius(config: FieldConfig, window: SearchWindow, map_shape: tuple[int, int]) -> int:
    """Radius of the disc in whole cells, at least one.

    What lies further away than the map is long is unknown at every offset and adds no mismatch,
    so that a larger disc gives the same sums.
    """
    reach = window.half_steps * window.step_cells
    whole_map = math.ceil(math.hypot(*map_shape) + math.sqrt(2) * reach) + 2
    return max(1, min(math.floor(config.sensor_range / window.resolution + 1e-9), whole_map))


def halo(config: FieldConfig, resolution: float, map_shape: tuple[int, int]) -> int:
    """How far beyond a cell its covariance depends on the map [cells]."""
    window = SearchWindow.from_config(config, resolution)
    reach = window.half_steps * window.step_cells
    # A turned cell lies within one cell of its rounded place, and so does its source.
    return template_radius(config, window, map_shape) + max(reach, 2)


def points_apart(config: FieldConfig, resolution: float, stride: int) -> int:
    """Every how many lattice points, `stride` cells apart, had best share a tile.

    Where cells and offsets fall on a common lattice of more than one cell the layout of the map
    is thinner, and on a fine lattice only then fits into the processor's caches.
    """
    from locplan._kernels.bitplanes import SQUARE

    thinnest = math.gcd(SearchWindow.from_config(config, resolution).step_cells, SQUARE)
    return thinnest // math.gcd(thinnest, stride)


def _lay_out_tile(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    radius: int,
    window: SearchWindow,
    corner: tuple[int, int],
    map_shape: tuple[int, int],
    visible: bool,
) -> Any:
    """Lay out the map and its turned copies for the kernel, for all cells of a tile at once."""
    from locplan._kernels import bitplanes, sad, templates

    levels = np.array(levels, order="C")  # one type of array, for kernels compiled once
    step, half_steps = window.step_cells, window.half_steps
    reach = half_steps * step
    disc_squares = templates.disc_squares(disc(radius))
    diameter = disc_squares.rows * bitplanes.SQUARE
    centre_row, centre_col = map_centre(map_shape)
    cos, sin = np.cos(window.angles), np.sin(window.angles)

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
    spacing = int(np.gcd.reduce(np.concatenate([rows - rows[0], cols - cols[0], [step]])))
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
        spacing,
        -(-(2 * half_steps + 1) // sad.GROUP) * sad.GROUP,
    )
    return sad.Tile(
        window=around,
        turned=turned,
        rows=rows,
        cols=cols,
        turned_rows=turned_rows,
        turned_cols=turned_cols,
        disc=disc_squares,
        sight=_sight(radius, window if visible else None),
        levels=levels,
        level_rows=rows - corner[0],
        level_cols=cols - corner[1],
        radius=radius,
        step=step,
        half_steps=half_steps,
    )


@lru_cache(maxsize=4)
def _sight(radius: int, window: SearchWindow | None) -> Any:
    """The rays of templates of what is seen; without a window there are none."""
    from locplan._kernels import templates

    if window is None:
        nothing = (
            np.empty(0),
            np.empty(0),
            np.empty((0, 0, 0), np.int32),
            np.empty((0, 0), np.int32),
        )
        return templates.Sight(*nothing, BEHIND)
    angles = 2 * np.pi * np.arange(beam_count(radius)) / beam_count(radius)
    offset = 2 * np.arange(-radius, radius + 1, dtype=np.int32)
    beams = [beam_of_cell(radius, theta).astype(np.int32) for theta in window.angles]
    return templates.Sight(
        cos=np.cos(angles),
        sin=np.sin(angles),
        beam=np.array([templates.by_squares(beam) for beam in beams]),
        distance=templates.by_squares(offset[:, None] ** 2 + offset[None, :] ** 2),
        behind=BEHIND,
    )

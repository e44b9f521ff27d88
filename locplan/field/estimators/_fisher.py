"""The covariance that the Fisher information of a lidar's beams allows at given cells.

Sources: A. Censi, "On achievable accuracy for range-finder localization", ICRA 2007, doi
10.1109/ROBOT.2007.364120; Wang et al. on the static localizability of grid maps. The search
window's uniform variance is the prior, so that a place without any return is exactly featureless.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field._config import FieldConfig
from locplan.field._search_window import SearchWindow
from locplan.field._surfaces import REACH, surface_normals
from locplan.field.estimators._beams import beams_of, on_grid, reach_of_beams
from locplan.maps import OCCUPIED


class Scene(NamedTuple):
    """What the beams need of a map."""

    squares: NDArray[np.uint8]
    normals: NDArray[np.float32]


def covariances(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    resolution: float,
    config: FieldConfig,
    *,
    yaw: float = 0.0,
    corner: tuple[int, int] = (0, 0),
    control: NDArray[np.int64] | None = None,
    prepared: Scene | None = None,
    **_: Any,
) -> dict[str, NDArray[np.float64]]:
    """Covariance of a pose estimate at each cell, in the grid's own axes.

    Parameters
    ----------
    levels : (H, W) array of uint8
        The map, or a part of it that reaches `halo` cells beyond every given cell.
    rows, cols : (n,) arrays of int
        The cells, as indices of the whole map.
    resolution : float
        Edge of a cell [m].
    config : FieldConfig
        Lidar, headings and search window.
    yaw : float
        Of the grid in the world, which the headings count in [rad].
    corner : (int, int)
        Where `levels` starts in the whole map.
    control : (2,) array of int64, optional
        Shared with other threads: the first is set to stop early, the second counts the cells
        done. Cells left out are NaN.
    prepared : Scene, optional
        What `prepare` makes of these levels.

    Returns
    -------
    dict with "covariance", (n, 3, 3) array of float64, or (n, 2, 2) without rotation
        (n, headings, d, d) for several headings. Of (x, y, theta) [m, m, rad]: the inverse of
        information and prior, times k, plus Q if `config.quantisation`.
    """
    from locplan._kernels.information import information

    scene = prepared or prepare(levels, resolution, config)
    window = SearchWindow.from_config(config, resolution)
    found = information(
        scene.squares,
        scene.normals,
        resolution,
        rows - corner[0] + 0.5,
        cols - corner[1] + 0.5,
        config.heading_angles - yaw,
        beams_of(config),
        np.zeros(2, np.int64) if control is None else control,
    )[:, :, : window.dimension, : window.dimension]
    prior = np.linalg.inv(window.uniform_covariance)
    covariance = config.noise_level * _inverse(found + prior)
    return {"covariance": on_grid(covariance, window, config)}


def prepare(levels: NDArray[np.uint8], resolution: float, config: FieldConfig) -> Scene:
    """Empty squares and normals of a map or a part of it."""
    from locplan._kernels.rays import empty_squares

    occupied = levels == OCCUPIED
    return Scene(empty_squares(occupied), surface_normals(occupied))


def halo(config: FieldConfig, resolution: float, map_shape: tuple[int, int]) -> int:
    """How far beyond a cell its covariance depends on the map [cells]."""
    return min(reach_of_beams(config, resolution) + REACH, math.ceil(math.hypot(*map_shape)))


def points_apart(config: FieldConfig, resolution: float, stride: int) -> int:
    """Every how many lattice points had best share a tile: all."""
    return 1


def _inverse(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverses of (..., d, d); NaN where these are."""
    unknown = np.isnan(information[..., 0, 0])
    matrices = np.where(unknown[..., None, None], np.eye(information.shape[-1]), information)
    return np.where(unknown[..., None, None], np.nan, np.linalg.inv(matrices))

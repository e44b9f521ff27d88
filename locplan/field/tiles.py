"""The arrays of a field on its lattice, and the tiles that divide their computation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import check_memory
from locplan._support.kernels.arrays import Array, Bools, Floats
from locplan._support.public import require_extra
from locplan.errors import ConfigError, FieldError
from locplan.field.config import FieldConfig
from locplan.field.covariance import read_halo
from locplan.field.estimator import TILE_CELLS, Values
from locplan.field.lattice import select_evaluated_points
from locplan.maps.grid import OccupancyGrid

if TYPE_CHECKING:
    from xarray import Dataset

ENGINE = 5
"""Version of the computation; it grows when the same map and config give other values."""
TILE = 64
"""Maximum edge length of a tile, which is computed as a whole [lattice points]."""

Chunk = tuple[slice, slice]
"""Rows and columns of a rectangle of the lattice."""


def compute_field_shapes(grid: OccupancyGrid, config: FieldConfig) -> dict[str, tuple[int, ...]]:
    """Return array shapes: lattice rows and columns, headings if several, pose axes."""
    stride = config.stride_cells(grid.resolution)
    points = tuple(-(-size // stride) for size in grid.shape)
    places = points if config.headings == 1 else (*points, config.headings)
    dimension = config.estimator.lattice(grid.resolution).dimension
    layers = {layer.name: places for layer in config.estimator.layers}
    return {"covariance": (*places, dimension, dimension), **layers}


def make_empty_values(grid: OccupancyGrid, config: FieldConfig) -> Values:
    """Return arrays of a field, filled with NaN; a ConfigError if they take too much memory."""
    shapes = compute_field_shapes(grid, config)
    total = 8.0 * sum(math.prod(shape) for shape in shapes.values())
    check_memory("the values of the field", total, "set a larger stride or fewer headings")
    return {name: np.full(shape, np.nan) for name, shape in shapes.items()}


def check_tile_memory(grid: OccupancyGrid, config: FieldConfig) -> None:
    """Raise a ConfigError if a tile takes over 2 GB; range and window decide its size."""
    tile_memory = config.estimator.memory(grid.resolution, grid.shape)
    if tile_memory > 2e9:
        lattice = config.estimator.lattice(grid.resolution)
        raise ConfigError(
            f"cells of {grid.resolution:g} m are too fine for a range of"
            f" {config.estimator.reach:g} m and a search window of"
            f" +-{lattice.reach * lattice.resolution:g} m ({tile_memory / 1e9:.3g} GB of memory);"
            " set"
            " smaller ones, or scale the map down"
        )


def find_computed_points(values: Values) -> Bools:
    """Return the mask of the lattice points with values, (h, w)."""
    covariance = values["covariance"]
    return ~np.isnan(covariance.reshape(*covariance.shape[:2], -1)[:, :, 0])


def find_required_points(
    grid: OccupancyGrid, config: FieldConfig, points: Bools | None = None
) -> Bools:
    """Return the mask of the lattice points that a field needs, restricted to `points` if given.

    Raises
    ------
    ConfigError
        If `points` is not a mask of the lattice.
    """
    required = config.lattice_points(grid)
    if points is None:
        return required
    points = np.asarray(points)
    if points.shape != required.shape or points.dtype != bool:
        raise ConfigError(
            f"points must be an array of bool of the lattice's shape {required.shape}, not"
            f" {points.dtype} {points.shape}"
        )
    return points & required


def compute_chunk_edge(config: FieldConfig, resolution: float) -> int:
    """Return the edge of the square tiles that are computed as a whole [lattice points].

    By `Estimator.seconds`, a tile takes one thread roughly two seconds at most.
    """
    points = 2.0 / (config.headings * config.estimator.seconds(resolution))
    on_map = TILE_CELLS // config.stride_cells(resolution)
    return max(1, min(TILE, on_map, math.isqrt(int(min(points, TILE**2)))))


def iterate_chunks(points: Bools, chunk_edge: int) -> Iterator[Chunk]:
    """Yield chunks that hold at least one of the points, row by row."""
    for top, left in product(*(range(0, size, chunk_edge) for size in points.shape)):
        chunk = slice(top, top + chunk_edge), slice(left, left + chunk_edge)
        if points[chunk].any():
            yield chunk


def find_unchanged_points(
    before: OccupancyGrid, after: OccupancyGrid, config: FieldConfig
) -> Bools:
    """Mark the second map's lattice points whose covariances equal the first map's.

    Parameters
    ----------
    before, after : OccupancyGrid
        The maps.
    config : FieldConfig
        The field's settings.

    Returns
    -------
    (h, w) array of bool
        True for points with the same covariance.

    Raises
    ------
    FieldError
        If the maps differ in shape, resolution or origin.
    """
    import cv2

    for name in ("shape", "resolution", "origin"):
        if getattr(before, name) != getattr(after, name):
            raise FieldError(
                f"the field's map has {name} {getattr(before, name)}, but the new one"
                f" {getattr(after, name)}; compute a new field"
            )
    stride = config.stride_cells(after.resolution)
    changed = (before.cells != after.cells).astype(np.uint8)
    # A lidar that would stand in a wall is moved by up to one stride.
    reach = stride + read_halo(config.estimator, after.resolution, after.shape)
    box = [2 * min(reach, max(after.shape)) + 1] * 2
    near = cv2.boxFilter(changed, cv2.CV_32S, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray((near[::stride, ::stride] == 0) & select_evaluated_points(after.free, stride))


def build_dataset(
    values: Values, e: Floats, e_unit: str, grid: OccupancyGrid, config: FieldConfig
) -> Dataset:
    """Return a field's arrays and e with their coordinates; see `CovarianceField.to_xarray`."""
    require_extra("xarray", "tables", "to_xarray")
    from xarray import Dataset

    along = make_coordinates(grid, config)
    places = tuple(along)
    arrays: dict[str, Any] = {name: (places, array) for name, array in values.items()}
    arrays["covariance"] = (*places, "pose_row", "pose_col"), values["covariance"]
    arrays["e"] = places, e, {"units": e_unit}
    at = {name: (name, *described) for name, described in along.items()}
    attributes = {"map": grid.name, "yaw": grid.origin[2], "estimator": config.estimator.title}
    return Dataset(arrays, at, attributes)


def make_coordinates(
    grid: OccupancyGrid, config: FieldConfig
) -> dict[str, tuple[Array, dict[str, Any]]]:
    """Return values and attributes of the coordinates y, x and, if there are several, heading."""
    stride, (x0, y0, _) = config.stride_cells(grid.resolution), grid.origin
    meaning = "of the map's own axes, which the origin's yaw turns about the origin"
    metres = {"long_name": meaning, "units": "m"}
    axes = {
        name: (start + (np.arange(-(-size // stride)) * stride + 0.5) * grid.resolution, metres)
        for name, start, size in zip("yx", (y0, x0), grid.shape, strict=True)
    }
    if config.headings != 1:
        attributes = {"long_name": "of the robot in the world", "units": "rad"}
        axes["heading"] = config.heading_angles, attributes
    return axes

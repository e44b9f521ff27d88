"""Masks, fields and paths as ROS 2 messages, which are dictionaries here."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.field import CovarianceField, position_axes, sampled_covariances, scalar
from locplan.maps import OCCUPIED, OccupancyGrid

SHARP, DEGENERATE = np.array([0.0, 0.45, 0.7, 0.7]), np.array([0.84, 0.37, 0.0, 0.7])
"""Blue and vermilion, which colour-blind people distinguish, of small and large deviations."""
_CYLINDER, _LINE_LIST = 3, 5
_FLOAT32 = 7
_THICKNESS = 0.02


def occupancy_grid(grid: OccupancyGrid, mask: ArrayLike) -> dict[str, Any]:
    """nav_msgs/OccupancyGrid of values 0..100 and -1, (H, W)."""
    values = np.asarray(mask)
    if values.shape != grid.shape or not np.issubdtype(values.dtype, np.integer):
        raise LocplanError(f"a mask needs integers of shape {grid.shape}, not {values.shape}")
    if values.min() < -1 or values.max() > 100:
        raise LocplanError("a mask holds 0..100, or -1 for unknown")
    rows, cols = grid.shape
    x, y, yaw = grid.origin
    origin = _poses(np.array([[x, y]]), np.array([yaw]))[0]
    info = {"resolution": grid.resolution, "width": cols, "height": rows, "origin": origin}
    return {"info": info, "data": values.ravel()}


def levels_of(grid: OccupancyGrid) -> NDArray[np.int8]:
    """The map as ROS has it, (H, W): 0 free, 100 occupied, -1 unknown."""
    return np.select([grid.free, grid.cells == OCCUPIED], [0, 100], -1).astype(np.int8)


def layers_of(field: CovarianceField) -> dict[str, NDArray[np.float64]]:
    """The layers of a field by name, (h, w) each."""
    covariance = field.mean_covariance
    names = ("e", "position_std", "heading_std")[: covariance.shape[-1]]
    layers = {name: scalar(covariance, name) for name in names}
    layers["principal_axis"] = position_axes(covariance)[2]
    return layers | {name: field.scalar(name, headings="mean") for name in field.layers}


def foxglove_grid(
    field: CovarianceField, layers: Mapping[str, NDArray[np.float64]], header: Mapping[str, Any]
) -> dict[str, Any]:
    """foxglove_msgs/Grid: cells around the lattice's points, row by row from the lowest y."""
    grid, stride = field.grid, field.stride
    step = stride * grid.resolution
    corner = np.array(grid.grid_to_world((1 - stride) / 2, (1 - stride) / 2))
    values = np.stack(list(layers.values()), axis=-1).astype("<f4")
    size = values.shape[2] * values.itemsize
    fields = [{"name": name, "offset": 4 * n, "type": _FLOAT32} for n, name in enumerate(layers)]
    return {
        "timestamp": header["stamp"],
        "frame_id": header["frame_id"],
        "pose": _poses(corner[None], np.array([grid.origin[2]]))[0],
        "column_count": values.shape[1],
        "cell_size": {"x": step, "y": step},
        "row_stride": values.shape[1] * size,
        "cell_stride": size,
        "fields": fields,
        "data": np.frombuffer(values.tobytes(), np.uint8),
    }


def grid_map(field: CovarianceField, layers: Mapping[str, NDArray[np.float64]]) -> dict[str, Any]:
    """grid_map_msgs/GridMap: the first cell has the highest x and y, and x changes first."""
    grid, stride = field.grid, field.stride
    step = stride * grid.resolution
    if abs(math.sin(2 * grid.origin[2])) > 1e-9:
        step *= 2 / 3  # fine enough to meet every lattice point
    ends = [np.array([0, n]) * stride + (1 - stride) / 2 for n in field.covariance.shape[:2]]
    around = np.array(grid.grid_to_world(*np.meshgrid(*ends))).reshape(2, 4)
    low, high = around.min(axis=1), around.max(axis=1)
    cols, rows = np.maximum(np.ceil((high - low) / step - 1e-6), 1).astype(int)
    middle = (low + high) / 2
    x = middle[0] + (np.arange(cols)[::-1] - (cols - 1) / 2) * step
    y = middle[1] + (np.arange(rows)[::-1] - (rows - 1) / 2) * step
    near = [np.rint((v - 0.5) / stride).astype(int) for v in grid.world_to_grid(*np.meshgrid(x, y))]
    inside = [(k >= 0) & (k < n) for k, n in zip(near, field.covariance.shape, strict=False)]
    outside = ~(inside[0] & inside[1])
    i, j = (np.where(outside, 0, k) for k in near)
    dim = [
        {"label": "column_index", "size": rows, "stride": rows * cols},
        {"label": "row_index", "size": cols, "stride": cols},
    ]
    data = [np.where(outside, np.nan, values[i, j]).ravel() for values in layers.values()]
    pose = _poses(middle[None], np.zeros(1))[0]
    size = {"length_x": cols * step, "length_y": rows * step}
    return {
        "info": {"resolution": step, **size, "pose": pose},
        "layers": list(layers),
        "basic_layers": list(layers)[:1],
        "data": [{"layout": {"dim": dim}, "data": values} for values in data],
    }


def ellipse_markers(
    field: CovarianceField, header: Any, spacing: float, magnify: float
) -> Iterator[dict[str, Any]]:
    """visualization_msgs/Marker: flat cylinders, and last the major axes."""
    xy, covariance = sampled_covariances(field, spacing)
    major, minor, direction = position_axes(covariance)
    low, high = np.log(field.anchors("position_std"))
    shade = (np.log(np.maximum(major, 1e-9)) - low) / (high - low)
    colors = SHARP + np.clip(shade, 0, 1)[:, None] * (DEGENERATE - SHARP)
    scale = np.stack([2 * magnify * major, 2 * magnify * minor], axis=1)
    scale = np.column_stack([np.maximum(scale, 1e-3), np.full(len(scale), _THICKNESS)])
    for n, pose in enumerate(_poses(xy, direction)):
        kind = {"header": header, "ns": "ellipses", "id": n, "type": _CYLINDER}
        yield kind | {"pose": pose, "scale": scale[n], "color": colors[n]}
    arm = (magnify * major)[:, None] * np.stack([np.cos(direction), np.sin(direction)], 1)
    ends = np.stack([xy - arm, xy + arm], axis=1).reshape(-1, 2)
    points = np.column_stack([ends, np.full(len(ends), _THICKNESS)])
    lines = {"header": header, "ns": "axes", "type": _LINE_LIST, "points": points}
    black = np.array([0.0, 0.0, 0.0, 1.0])
    pose = _poses(np.zeros((1, 2)), np.zeros(1))[0]
    yield lines | {"pose": pose, "scale": np.array([0.02, 0.0, 0.0]), "color": black}


def _poses(xy: NDArray[Any], yaw: NDArray[Any]) -> NDArray[np.float64]:
    """Position and quaternion, (n, 7)."""
    nothing = np.zeros((len(xy), 3))
    return np.column_stack([xy, nothing, np.sin(yaw / 2), np.cos(yaw / 2)])


def path_message(route: Path, header: Mapping[str, Any]) -> dict[str, Any]:
    """nav_msgs/Path; poses without a heading face the way they go."""
    poses = _poses(route.xy, route.facing)
    return {"poses": [{"header": header, "pose": pose} for pose in poses]}


def topics_of(names: Iterable[str]) -> dict[str, str]:
    """The topic of each path: its name as ROS allows it, with a number where that is taken."""
    topics: dict[str, str] = {}
    taken = set()
    for name in names:
        token = "_".join(re.findall("[A-Za-z0-9]+", name))
        token = token if token and not token[0].isdigit() else f"path_{token}".rstrip("_")
        numbered = (token if n == 1 else f"{token}_{n}" for n in itertools.count(1))
        topic = next(each for each in numbered if each not in taken)
        taken.add(topic)
        topics[name] = f"/locplan/path/{topic}"
    return topics

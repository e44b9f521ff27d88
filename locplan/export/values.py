"""Maps and masks with values 0..100 that stand for u or speeds, and their files.

Formats read from nav2_map_server's map_io.cpp and from ROS 1's image_loader.cpp.
"""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_number
from locplan._support.files import write_text
from locplan._support.kernels.arrays import Floats
from locplan._support.reading import dump_yaml
from locplan.errors import ConfigError
from locplan.export.registry import check_has_field, create_export_folder
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.metrics import format_costs_caption
from locplan.planning.path import Path as Route


class YawWarning(UserWarning):
    """A warning that an export ignores the map's yaw."""


def drop_yaw(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the map without its yaw, which Nav2 and ROS 1 ignore; warn if there is one."""
    x, y, yaw = grid.origin
    if not yaw:
        return grid
    text = f"{grid.name or 'the map'} has a yaw of {yaw:g} rad, which navigation stacks ignore:"
    warnings.warn(YawWarning(f"{text} exported without the yaw"), stacklevel=2)
    return dataclasses.replace(grid, origin=(x, y, 0.0))


def drop_costmap_yaw(costs: Costmap) -> Costmap:
    """Return the costmap and its zones on the map without its yaw; warn if there is one."""
    grid = drop_yaw(costs.grid)
    if grid is costs.grid:
        return costs
    zones = [
        dataclasses.replace(zone, polygon=world_to_unrotated_map(costs.grid, zone.polygon))
        for zone in costs.zones
    ]
    return dataclasses.replace(costs, grid=grid, zones=Zones(zones))


def world_to_unrotated_map(grid: OccupancyGrid, xy: Floats) -> Floats:
    """Return world positions (n, 2) rotated to the map without its yaw [m]."""
    unturned = dataclasses.replace(grid, origin=(*grid.origin[:2], 0.0))
    return np.column_stack(unturned.grid_to_world(*grid.world_to_grid(*xy.T)))


def drop_path_yaw(grid: OccupancyGrid, path: Route) -> Route:
    """Return a path, rotated to the map without its yaw."""
    heading = None if path.heading is None else path.heading - grid.origin[2]
    return Route(world_to_unrotated_map(grid, path.xy), heading)


def write_map_values(stem: Path, values: NDArray[np.int8], grid: OccupancyGrid) -> None:
    """Write values 0..100, or -1 for unknown, which Nav2's and ROS 1's map servers read unchanged.

    The files are `stem`.yaml and `stem`.pgm; a grey level is the value, and 255 is unknown.
    """
    from PIL import Image

    image = stem.with_suffix(".pgm")
    Image.fromarray(values[::-1].view(np.uint8)).save(image)
    yaml_fields = {
        "image": image.name,
        "mode": "raw",
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    write_text(stem.with_suffix(".yaml"), dump_yaml(yaml_fields, default_flow_style=None))


def compute_degeneracy_percent(costs: Costmap) -> NDArray[np.int8]:
    """Return u in per cent, 0..98, or -1 in cells without u, (H, W).

    Nav2's StaticLayer treats 99 and 100 as obstacles.

    Parameters
    ----------
    costs : Costmap
        A costmap with a covariance field.

    Raises
    ------
    ConfigError
        If the costmap has no field.
    """
    check_has_field(costs)
    values = np.minimum(np.floor(100 * np.nan_to_num(costs.u) + 0.5), 98)
    return np.where(np.isnan(costs.u), -1, values).astype(np.int8)


def compute_speed_mask(costs: Costmap, slowest: float, lead: float) -> NDArray[np.int8]:
    """Return the reduction of the speed in per cent, 0..99 (H, W), or -1 in cells without u.

    If a slow zone has a lower limit than u, the zone's limit applies. `nav2_speed` describes the
    arguments and errors. With `slowest` 1, only zones limit the speed and no field is needed.
    """
    import cv2

    check_number("slowest", slowest, 0.01, 1)
    check_number("lead", lead, 0)
    if slowest < 1:
        check_has_field(costs)
    is_known = costs.grid.free if slowest == 1 else ~np.isnan(costs.u)
    if not is_known.any():
        raise ConfigError("no cell of the map has u, so the mask would be empty; check the field")
    speed_loss = np.floor(100 * (1 - slowest) * np.nan_to_num(costs.u) + 0.5)
    if costs.zones.has_kind("slow"):
        speed_loss = np.maximum(speed_loss, np.floor(100.5 - costs.zones.speed_limit(costs.grid)))
    reach = min(round(lead / costs.grid.resolution), max(costs.grid.shape))
    around = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    widened = cv2.dilate(speed_loss.astype(np.uint8), around.astype(np.uint8))
    values = np.minimum(widened, 99).astype(np.int8)  # 100 means full speed
    return np.where(is_known, values, -1)


def ros_map(folder: str | Path, costs: Costmap, *, force: bool = False) -> None:
    """Write u in per cent, at most 98, as a map in mode raw, such as for Nav2's StaticLayer.

    Parameters
    ----------
    folder : path
        The folder, which may exist; an earlier export of this kind is replaced.
    costs : Costmap
        A costmap with a covariance field.
    force : bool, default False
        True overwrites files of the same names in the folder.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or there is no field.
    """
    from locplan.export import figures as _figures

    values = compute_degeneracy_percent(costs)
    metadata = {"kind": "ros-map"} | summarize_costs(costs)
    grid = drop_yaw(costs.grid)
    purposes = {"README.md": "how to use it", "*.yaml": "u in per cent, as a map of ROS"}
    name = grid.name or "a map"
    with create_export_folder(
        folder, "ros-map.md", metadata, {"map": name}, purposes=purposes, force=force
    ) as temporary:
        write_map_values(temporary / "raw", values, grid)
        title = f"{grid.name or 'map'}: values as published{format_costs_caption(costs)}"
        figure = _figures.values_figure(costs.grid, values, "degeneracy u [%]", title)
        _figures.save_preview(temporary, figure, dpi=90)

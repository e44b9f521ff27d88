"""How degenerate each cell is, as maps that any map server publishes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.export._folders import export_folder
from locplan.export._value_maps import MODES, PREVIEW, without_yaw, write_preview, write_values


def check_has_field(costs: Costmap) -> None:
    """Raise a ConfigError unless the costmap tells how degenerate its cells are."""
    if np.isnan(costs.u).all() and np.isfinite(costs.density).any():
        raise ConfigError("this export needs a costmap made of a field (Costmap.from_field)")


def percent(costs: Costmap) -> NDArray[np.int8]:
    """u in per cent, 0..100, and -1 where it is not known, (H, W).

    Raises
    ------
    ConfigError
        If the costmap was made without a field.
    """
    check_has_field(costs)
    values = np.floor(100 * np.nan_to_num(costs.u) + 0.5)
    return np.where(np.isnan(costs.u), -1, values).astype(np.int8)


def ros_map(folder: str | Path, costs: Costmap) -> None:
    """Write u in per cent as maps in the modes raw and scale.

    Parameters
    ----------
    folder : path
        Where to: made, or replaced if it is such an export already.
    costs : Costmap
        With a field.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or there is no field.
    """
    values = percent(costs)
    name = costs.grid.name or "a map"
    readme = [
        "- raw.yaml, raw.pgm: u in per cent, grey 0-100 as it is and 255 unknown, for every stack.",
        "- scale.yaml (Nav2), scale_ros1.yaml (ROS 1): the same in mode scale, with their PNGs;"
        f" {PREVIEW}; export.json: what they were made of.",
        "- `ros2 run nav2_map_server map_server --ros-args -p yaml_filename:=$PWD/raw.yaml`, then"
        " `ros2 run nav2_util lifecycle_bringup map_server`",
        "- ROS 1: `rosrun map_server map_server raw.yaml`",
    ]
    about = {"kind": "ros-map"} | about_costs(costs)
    grid = without_yaw(costs.grid)
    with export_folder(Path(folder), f"Localizability of {name}", about, readme) as temporary:
        for mode in MODES:
            write_values(temporary / mode.replace("-", "_"), values, grid, mode)
        write_preview(temporary, costs.grid, values, "degeneracy u [%]", "as it is published")

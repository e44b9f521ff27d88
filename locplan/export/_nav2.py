"""Filter masks and layers for ROS 2 Nav2, with the parameters and the launch file to use them.

Formats read from ros-navigation/navigation2, branches humble to main (2026-08): keepout_filter.cpp,
speed_filter.cpp, static_layer.cpp and the documentation of their servers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import shown
from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.export import _value_maps as value_maps
from locplan.export._folders import export_folder
from locplan.export._parameters import with_costmap, with_planner
from locplan.export._servers import LAUNCH, SERVERS, Server, write_servers, write_yaml
from locplan.export._travel_costs import Conversion, planner_named, values_for
from locplan.maps._ros_parameters import Parameters, read_parameters

PARAMS = "nav2.yaml"
MASK = "mask"
MAX_SLOWED = 99
"""Greatest value of a speed mask: 100 would mean full speed."""
FILTERS: dict[str, Parameters] = {
    "keepout": {"type": 0, "base": 0.0, "multiplier": 1.0},
    "speed": {"type": 1, "base": 100.0, "multiplier": -1.0},
}
"""Type of each filter, and the linear map from its mask's values to costs or speeds."""


def nav2_keepout(
    folder: str | Path,
    costs: Costmap,
    *,
    planner: str = "smac2d",
    param: float | None = None,
    distro: str = "jazzy",
    params: str | Path | None = None,
) -> Conversion:
    """Write a mask for Nav2's KeepoutFilter that makes a planner charge the costmap's J.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        The mask's 0..99 stand for its density above 1. Nav2 ignores a map's yaw, so that the mask
        has none either.
    planner : str
        "smac2d", "smac-hybrid", "navfn" or "thetastar".
    param : float, optional
        The planner's own parameter: cost_travel_multiplier, cost_penalty or w_traversal_cost. By
        default such that u = 1 just fits, whatever the map. "navfn" has none.
    distro : str
        The distribution of ROS 2: "humble" writes the names of planners in another way.
    params : path, optional
        A Nav2 parameter file to merge ours into; by default nav2.yaml holds ours alone. The
        planner gets ``allow_unknown: false``, since J knows no way through unknown space.

    Returns
    -------
    Conversion
        Where the planner saturates, and how exact the mask is.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a setting is out of its range.
    """
    return _write_charged(folder, "keepout", costs, planner, param, distro, params)


def nav2_static(
    folder: str | Path,
    costs: Costmap,
    *,
    planner: str = "smac2d",
    param: float | None = None,
    distro: str = "jazzy",
    params: str | Path | None = None,
) -> Conversion:
    """Write a map for a second StaticLayer that makes a planner charge the costmap's J.

    Arguments, result and errors are those of `nav2_keepout`. In Nav2 `trinary_costmap` (false),
    `use_maximum` (true) and `lethal_cost_threshold` (100) hold for all static layers of a costmap,
    the robot's own included.
    """
    return _write_charged(folder, "static", costs, planner, param, distro, params)


def nav2_speed(
    folder: str | Path,
    costs: Costmap,
    *,
    slowest: float = 0.3,
    params: str | Path | None = None,
) -> None:
    """Write a mask for Nav2's SpeedFilter: the more degenerate a cell, the slower.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        A costmap that was made of a field.
    slowest : float
        Share of the robot's speed left where u is 1, 0.01 to 1; linear in u up to full speed.
    params : path, optional
        A Nav2 parameter file to merge ours into.

    Raises
    ------
    LocplanError
        If the folder cannot be written, `slowest` is out of its range, or there is no field.
    """
    check_slowest(slowest)
    value_maps.check_has_field(costs)
    merged = with_costmap(read_parameters(params), "speed")
    known = ~np.isnan(costs.u)
    values = np.full(costs.grid.shape, -1, np.int8)
    percent = np.floor(100 * (1 - slowest) * costs.u[known] + 0.5)
    values[known] = np.minimum(percent, MAX_SLOWED)
    title = f"Speed mask: {slowest:.0%} of the speed where nothing is seen"
    _write(folder, "speed", title, costs, values, merged, {"slowest": slowest}, params)


def keepout_mask(
    costs: Costmap, *, planner: str = "smac2d", param: float | None = None, static: bool = False
) -> tuple[NDArray[np.int8], Conversion]:
    """The values of a mask that make a planner charge J, (H, W): 0..99, or -1 to change nothing.

    Arguments and errors are those of `nav2_keepout`; `static` is for a StaticLayer, up to 98.
    """
    greatest = costs.weight
    if np.isnan(greatest):  # a density of one's own
        density = costs.density[np.isfinite(costs.density)]
        greatest = float(density.max()) - 1 if density.size else 0.0
    return values_for(costs.density, planner_named(planner), greatest, param, static=static)


def check_slowest(slowest: float) -> None:
    """Raise a ConfigError unless it is a share of the speed that leaves some."""
    if not 0.01 <= slowest <= 1:
        raise ConfigError(
            f"slowest must be a share of the speed from 0.01 to 1, not {shown(slowest)}"
        )


def _write_charged(
    folder: str | Path,
    kind: str,
    costs: Costmap,
    planner: str,
    param: float | None,
    distro: str,
    params: str | Path | None,
) -> Conversion:
    """Write the mask of a filter or a layer that makes a planner charge J."""
    merged = with_costmap(read_parameters(params), kind)
    values, conversion = keepout_mask(costs, planner=planner, param=param, static=kind == "static")
    merged, called = with_planner(merged, conversion, distro)
    what = "layer" if kind == "static" else "mask"
    title = f"Localizability {what} for {conversion.planner.plugin} ({called})"
    about = {"planner_id": called, "conversion": conversion.summary()}
    _write(folder, kind, title, costs, values, merged, about, params)
    return conversion


def _write(
    folder: str | Path,
    kind: str,
    title: str,
    costs: Costmap,
    values: NDArray[np.int8],
    merged: Parameters,
    about: Parameters,
    params: str | Path | None,
) -> None:
    """Write the folder of a mask."""
    own = f"all of {Path(params).name}, with ours" if params else "merge it into the robot's own"
    file = f"$PWD/{PARAMS}" if params else "PARAMS.yaml"
    readme = [
        f"- {MASK}.yaml, {MASK}.pgm: the mask of {costs.grid.name or 'the map'} (grey 0-100 as it"
        f" is, not 0-255); {SERVERS} and {LAUNCH} publish it.",
        f"- {PARAMS}: Nav2's parameters, {own}; {value_maps.PREVIEW}; export.json: the input.",
        f"- `ros2 launch ./{LAUNCH}` (in this folder)",
        f"- `ros2 launch nav2_bringup bringup_launch.py map:=MAP.yaml params_file:={file}`",
    ]
    base = f"localizability_{kind}"
    parameters = {"topic_name": f"/{base}_mask", "frame_id": "map"}
    files = {"yaml_filename": f"{MASK}.yaml"}
    servers = [Server("nav2_map_server", "map_server", f"{base}_mask_server", parameters, files)]
    if kind in FILTERS:
        topics = {"filter_info_topic": f"/{base}_info", "mask_topic": f"/{base}_mask"}
        node = "costmap_filter_info_server", f"{base}_info_server"
        servers.append(Server("nav2_map_server", *node, topics | FILTERS[kind]))
    about = {"kind": f"nav2-{kind}"} | about_costs(costs) | about
    with export_folder(Path(folder), title, about, readme) as temporary:
        write_yaml(temporary / PARAMS, merged)
        value_maps.write_values(temporary / MASK, values, value_maps.without_yaw(costs.grid))
        write_servers(temporary, servers, f"lifecycle_manager_{base}")
        value_maps.write_preview(temporary, costs.grid, values, f"{kind} mask [0-100]", title)

"""Filter masks and layers for ROS 2 Nav2, with the parameters and the launch file to use them.

Formats read from ros-navigation/navigation2, branches humble to main (2026-08): keepout_filter.cpp,
speed_filter.cpp, static_layer.cpp and the documentation of their servers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, about_costs
from locplan.errors import ConfigError
from locplan.export._folders import export_folder
from locplan.export._parameters import with_costmap, with_planner
from locplan.export._ros_maps import check_has_field
from locplan.export._servers import LAUNCH, SERVERS, Server, write_servers, write_yaml
from locplan.export._travel_costs import Conversion, planner_named, values_for
from locplan.export._value_maps import PREVIEW, without_yaw, write_preview, write_values
from locplan.maps._ros_parameters import Parameters, read_parameters

PARAMS = "nav2.yaml"
MASK = "mask"
MAX_SLOWED = 99
"""Of a speed mask: 100 would mean full speed."""


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
        Where to: made, or replaced if it is such an export already, without changes.
    costs : Costmap
        Of `Costmap.from_field`, say; 0..99 stand for its density above 1. Nav2 ignores a map's
        yaw, so that the mask has none either.
    planner : str
        "smac2d", "smac-hybrid", "navfn" or "thetastar".
    param : float, optional
        The planner's own parameter: cost_travel_multiplier, cost_penalty or w_traversal_cost. By
        default such that u = 1 just fits, whatever the map. "navfn" has none.
    distro : str
        Of ROS 2: "humble" writes the names of planners in another way.
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
    theirs = read_parameters(params)
    values, conversion = keepout_mask(costs, planner=planner, param=param)
    names = _Names("keepout")
    ours = {
        "filters": [names.plugin],
        names.plugin: {
            "plugin": "nav2_costmap_2d::KeepoutFilter",
            "enabled": True,
            "filter_info_topic": names.info_topic,
        },
    }
    merged, called = with_planner(with_costmap(theirs, ours), conversion, distro)
    title = f"Localizability mask for {conversion.planner.plugin} ({called})"
    info = {"type": 0, "base": 0.0, "multiplier": 1.0}
    about = {"planner_id": called, "conversion": conversion.summary()}
    _write(folder, names, title, costs, values, merged, info, about, params)
    return conversion


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
    theirs = read_parameters(params)
    values, conversion = keepout_mask(costs, planner=planner, param=param, static=True)
    names = _Names("static")
    ours = {
        "trinary_costmap": False,
        "use_maximum": True,
        "lethal_cost_threshold": 100,
        names.plugin: {
            "plugin": "nav2_costmap_2d::StaticLayer",
            "enabled": True,
            "map_topic": names.mask_topic,
            "map_subscribe_transient_local": True,
        },
    }
    merged, called = with_planner(with_costmap(theirs, ours, names.plugin), conversion, distro)
    title = f"Localizability layer for {conversion.planner.plugin} ({called})"
    about = {"planner_id": called, "conversion": conversion.summary()}
    _write(folder, names, title, costs, values, merged, None, about, params)
    return conversion


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
        Where to: made, or replaced if it is such an export already, without changes.
    costs : Costmap
        With a field.
    slowest : float
        Share of the robot's speed left where u is 1, 0.01 to 1; linear in u up to full speed.
    params : path, optional
        As for `nav2_keepout`.

    Raises
    ------
    LocplanError
        If the folder cannot be written, `slowest` is out of its range, or there is no field.
    """
    check_slowest(slowest)
    check_has_field(costs)
    theirs = read_parameters(params)
    known = ~np.isnan(costs.u)
    values = np.full(costs.grid.shape, -1, np.int8)
    percent = np.floor(100 * (1 - slowest) * costs.u[known] + 0.5)
    values[known] = np.minimum(percent, MAX_SLOWED)
    names = _Names("speed")
    ours = {
        "filters": [names.plugin],
        names.plugin: {
            "plugin": "nav2_costmap_2d::SpeedFilter",
            "enabled": True,
            "filter_info_topic": names.info_topic,
            "speed_limit_topic": "/speed_limit",
        },
    }
    title = f"Speed mask: {slowest:.0%} of the speed where nothing is seen"
    info = {"type": 1, "base": 100.0, "multiplier": -1.0}
    merged = with_costmap(theirs, ours)
    _write(folder, names, title, costs, values, merged, info, {"slowest": slowest}, params)


def keepout_mask(
    costs: Costmap, *, planner: str = "smac2d", param: float | None = None, static: bool = False
) -> tuple[NDArray[np.int8], Conversion]:
    """The values of a mask that make a planner charge J, (H, W): 0..99, or -1 to change nothing.

    Arguments and errors are those of `nav2_keepout`; `static` is for a StaticLayer, up to 98.
    """
    return values_for(costs.density, planner_named(planner), _greatest(costs), param, static=static)


def check_slowest(slowest: float) -> None:
    """Raise a ConfigError unless it is a share of the speed that leaves some."""
    if not 0.01 <= slowest <= 1:
        raise ConfigError(f"slowest must be a share of the speed from 0.01 to 1, not {slowest!r}")


class _Names:
    """Of plugin, topics and nodes, so that masks of several kinds go together."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.plugin = f"localizability_{kind}_{'layer' if kind == 'static' else 'filter'}"
        # Absolute: relative ones resolve within the costmap's own namespace before Kilted.
        self.mask_topic = f"/localizability_{kind}_mask"
        self.info_topic = f"/localizability_{kind}_info"
        self.mask_server = f"localizability_{kind}_mask_server"
        self.info_server = f"localizability_{kind}_info_server"
        self.manager = f"lifecycle_manager_localizability_{kind}"


def _write(
    folder: str | Path,
    names: _Names,
    title: str,
    costs: Costmap,
    values: NDArray[np.int8],
    merged: Parameters,
    info: dict[str, Any] | None,
    about: dict[str, Any],
    params: str | Path | None,
) -> None:
    own = f"all of {Path(params).name}, with ours" if params else "merge it into the robot's own"
    file = f"$PWD/{PARAMS}" if params else "PARAMS.yaml"
    readme = [
        f"- {MASK}.yaml, {MASK}.pgm: the mask of {costs.grid.name or 'the map'} (grey 0-100 as it"
        f" is, not 0-255); {SERVERS} and {LAUNCH} publish it.",
        f"- {PARAMS}: Nav2's parameters, {own}; {PREVIEW}; export.json: what all this was made of.",
        f"- `ros2 launch ./{LAUNCH}` (in this folder)",
        f"- `ros2 launch nav2_bringup bringup_launch.py map:=MAP.yaml params_file:={file}`",
    ]
    kind = {"kind": f"nav2-{names.kind}"}
    with export_folder(Path(folder), title, kind | about_costs(costs) | about, readme) as temporary:
        write_yaml(temporary / PARAMS, merged)
        write_values(temporary / MASK, values, without_yaw(costs.grid))
        write_servers(temporary, _servers(names, info), names.manager)
        write_preview(temporary, costs.grid, values, f"{names.kind} mask [0-100]", title)


def _servers(names: _Names, info: dict[str, Any] | None) -> list[Server]:
    """What publishes the mask and, of a filter, its kind."""
    parameters = {"topic_name": names.mask_topic, "frame_id": "map"}
    files = {"yaml_filename": f"{MASK}.yaml"}
    mask = Server("nav2_map_server", "map_server", names.mask_server, parameters, files)
    if info is None:
        return [mask]
    topics = {"filter_info_topic": names.info_topic, "mask_topic": names.mask_topic}
    executable = "costmap_filter_info_server"
    return [mask, Server("nav2_map_server", executable, names.info_server, topics | info)]


def _greatest(costs: Costmap) -> float:
    """Of the excess over 1 that must fit: with u = 1, or of a density of one's own."""
    if not np.isnan(costs.weight):
        return costs.weight
    density = costs.density[np.isfinite(costs.density)]
    return float(density.max()) - 1 if density.size else 0.0

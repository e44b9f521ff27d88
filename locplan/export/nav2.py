"""Filter masks and layers for ROS 2 Nav2, with the parameters and the launch file to use them.

Formats read from ros-navigation/navigation2, branches humble to main (2026-08): keepout_filter.cpp,
speed_filter.cpp, static_layer.cpp and the documentation of their servers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from locplan.about import about_costs
from locplan.costmap import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.export.folders import export_folder
from locplan.export.ros_maps import check_has_field
from locplan.export.servers import LAUNCH, SERVERS, Server, write_servers, write_yaml
from locplan.export.travel_costs import Conversion, planner_named, values_for
from locplan.export.value_maps import write_values

DISTROS = ("humble", "iron", "jazzy", "kilted", "lyrical", "rolling")
PARAMS = "nav2.yaml"
MASK = "mask"
MOST_SLOWED = 99
"""Of a speed mask: 100 would mean full speed."""

_NAME = "localizability"
_FILTER, _LAYER = f"{_NAME}_filter", f"{_NAME}_layer"
# Absolute names: relative ones resolve within the costmap's own namespace before Kilted.
_MASK_TOPIC, _INFO_TOPIC = f"/{_NAME}_mask", f"/{_NAME}_filter_info"
_GLOBAL, _SERVER = "global_costmap", "planner_server"
_LISTS = ("filters", "plugins")


def nav2_keepout(
    folder: Path,
    costs: Costmap,
    *,
    planner: str = "smac2d",
    param: float | None = None,
    distro: str = "jazzy",
    params: Path | None = None,
) -> Conversion:
    """Write a mask for Nav2's KeepoutFilter that makes a planner charge the costmap's J.

    Parameters
    ----------
    folder : Path
        Where to: made, or replaced if it is such an export already.
    costs : Costmap
        Of `Costmap.from_field`, say; 0..99 stand for its density.
    planner : str
        "smac2d", "smac-hybrid", "navfn" or "thetastar".
    param : float, optional
        The planner's own parameter: cost_travel_multiplier, cost_penalty or w_traversal_cost. By
        default such that u = 1 just fits, whatever the map. "navfn" has none.
    distro : str
        Of ROS 2: "humble" writes the names of planners in another way.
    params : Path, optional
        A Nav2 parameter file to merge ours into; by default nav2.yaml holds ours alone.

    Returns
    -------
    Conversion
        Where the planner saturates, and how exact the mask is.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a setting is out of its range.
    """
    theirs = _read_params(params)
    values, conversion = values_for(costs.density, planner_named(planner), _greatest(costs), param)
    costmap = {
        "filters": [_FILTER],
        _FILTER: {
            "plugin": "nav2_costmap_2d::KeepoutFilter",
            "enabled": True,
            "filter_info_topic": _INFO_TOPIC,
        },
    }
    ours = _in_global_costmap(costmap) | _planner_server(conversion, distro, theirs)
    title = f"Localizability mask of {costs.grid.name or 'a map'} for {conversion.planner.plugin}"
    with _written(
        folder, "nav2-keepout", title, costs, _merged(theirs, ours), params, conversion
    ) as temporary:
        write_values(temporary / MASK, values, costs.grid)
        write_servers(temporary, _servers({"type": 0, "base": 0.0, "multiplier": 1.0}))
    return conversion


def nav2_static(
    folder: Path,
    costs: Costmap,
    *,
    planner: str = "smac2d",
    param: float | None = None,
    distro: str = "jazzy",
    params: Path | None = None,
) -> Conversion:
    """Write a map for a second StaticLayer that makes a planner charge the costmap's J.

    Arguments, result and errors are those of `nav2_keepout`. In Nav2 `trinary_costmap` and
    `use_maximum` hold for all static layers of a costmap, the robot's own included.
    """
    theirs = _read_params(params)
    values, conversion = values_for(
        costs.density, planner_named(planner), _greatest(costs), param, static=True
    )
    costmap = {
        "plugins": ["static_layer", _LAYER, "obstacle_layer", "inflation_layer"],
        "trinary_costmap": False,
        "use_maximum": True,
        "lethal_cost_threshold": 100,
        _LAYER: {
            "plugin": "nav2_costmap_2d::StaticLayer",
            "enabled": True,
            "map_topic": _MASK_TOPIC,
            "map_subscribe_transient_local": True,
        },
    }
    ours = _in_global_costmap(costmap) | _planner_server(conversion, distro, theirs)
    title = f"Localizability layer of {costs.grid.name or 'a map'} for {conversion.planner.plugin}"
    with _written(
        folder, "nav2-static", title, costs, _merged(theirs, ours), params, conversion
    ) as temporary:
        write_values(temporary / MASK, values, costs.grid)
        write_servers(temporary, _servers(None))
    return conversion


def nav2_speed(
    folder: Path, costs: Costmap, *, slowest: float = 0.3, params: Path | None = None
) -> None:
    """Write a mask for Nav2's SpeedFilter: the blinder a cell, the slower.

    Parameters
    ----------
    folder : Path
        Where to: made, or replaced if it is such an export already.
    costs : Costmap
        With a field.
    slowest : float
        Share of the robot's speed left where u is 1, 0.01 to 1; linear in u up to full speed.
    params : Path, optional
        As for `nav2_keepout`.

    Raises
    ------
    LocplanError
        If the folder cannot be written, `slowest` is out of its range, or there is no field.
    """
    if not 0.01 <= slowest <= 1:
        raise ConfigError(f"slowest must be a share of the speed from 0.01 to 1, not {slowest!r}")
    check_has_field(costs)
    known = ~np.isnan(costs.u)
    values = np.full(costs.grid.shape, -1, np.int8)
    percent = np.floor(100 * (1 - slowest) * costs.u[known] + 0.5)
    values[known] = np.minimum(percent, MOST_SLOWED)
    costmap = {
        "filters": [_FILTER],
        _FILTER: {
            "plugin": "nav2_costmap_2d::SpeedFilter",
            "enabled": True,
            "filter_info_topic": _INFO_TOPIC,
            "speed_limit_topic": "/speed_limit",
        },
    }
    title = f"Speed mask of {costs.grid.name or 'a map'}: {slowest:.0%} where nothing is seen"
    merged = _merged(_read_params(params), _in_global_costmap(costmap))
    with _written(folder, "nav2-speed", title, costs, merged, params, None) as temporary:
        write_values(temporary / MASK, values, costs.grid)
        write_servers(temporary, _servers({"type": 1, "base": 100.0, "multiplier": -1.0}))


@contextmanager
def _written(
    folder: Path,
    kind: str,
    title: str,
    costs: Costmap,
    merged: dict[str, Any],
    params: Path | None,
    conversion: Conversion | None,
) -> Iterator[Path]:
    """The folder of a Nav2 export, to which the mask and its servers are still to be added."""
    own = f"all of {params.name}, with ours" if params else "to be merged into the robot's own"
    launched = f"{SERVERS} and {LAUNCH} publish it"
    readme = [
        f"- {MASK}.yaml, {MASK}.pgm: the mask (grey 0-100 as it is, not 0-255); {launched}.",
        f"- {PARAMS}: Nav2's parameters, {own}; export.json: what all this was made of.",
        f"- `ros2 launch ./{LAUNCH}` (in this folder)",
        f"- `ros2 launch nav2_bringup bringup_launch.py map:=MAP.yaml params_file:=$PWD/{PARAMS}`",
    ]
    about = {"kind": kind} | about_costs(costs)
    if conversion:
        about["conversion"] = conversion.summary()
    with export_folder(folder, title, about, readme) as temporary:
        write_yaml(temporary / PARAMS, merged)
        yield temporary


def _greatest(costs: Costmap) -> float:
    """Of the excess over 1 that must fit: with u = 1, or of a density of one's own."""
    if not np.isnan(costs.weight):
        return costs.weight
    density = costs.density[np.isfinite(costs.density)]
    return float(density.max()) - 1 if density.size else 0.0


def _in_global_costmap(parameters: dict[str, Any]) -> dict[str, Any]:
    return {_GLOBAL: {_GLOBAL: {"ros__parameters": parameters}}}


def _planner_server(
    conversion: Conversion, distro: str, theirs: Mapping[str, Any]
) -> dict[str, Any]:
    """The planner's parameters, under the name that their parameters have for it, if any."""
    if distro not in DISTROS:
        raise ConfigError(f"distro must be one of {', '.join(DISTROS)}, not {distro!r}")
    planner = conversion.planner
    named = theirs.get(_SERVER, {}).get("ros__parameters", {})
    names = [
        name
        for name, own in named.items()
        if isinstance(own, dict) and str(own.get("plugin")).replace("/", "::") == planner.plugin
    ]
    name = names[0] if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if distro == "humble" else planner.plugin
    own: dict[str, Any] = {"plugin": plugin, "allow_unknown": False}
    if planner.parameter is not None:
        own[planner.parameter] = float(conversion.param)
    if planner.name == "thetastar":
        own["w_euc_cost"] = 1.0
    listed = {} if names else {"planner_plugins": [name]}
    return {_SERVER: {"ros__parameters": {**listed, name: own}}}


def _servers(info: Mapping[str, Any] | None) -> list[Server]:
    """What publishes the mask and, of a filter, its kind."""
    parameters = {"topic_name": _MASK_TOPIC, "frame_id": "map"}
    files = {"yaml_filename": f"{MASK}.yaml"}
    mask = Server("nav2_map_server", "map_server", f"{_NAME}_mask_server", parameters, files)
    if info is None:
        return [mask]
    name, executable = f"{_NAME}_filter_info_server", "costmap_filter_info_server"
    topics = {"filter_info_topic": _INFO_TOPIC, "mask_topic": _MASK_TOPIC}
    return [mask, Server("nav2_map_server", executable, name, topics | dict(info))]


def _read_params(path: Path | None) -> dict[str, Any]:
    import yaml

    if path is None:
        return {}
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or "it is no YAML in UTF-8"
        raise LocplanError(f"{path}: cannot be read ({reason}); give Nav2's parameters") from None
    if not isinstance(content, dict) or not any(
        isinstance(node, dict) and ("ros__parameters" in node or _GLOBAL in node)
        for node in content.values()
    ):
        raise LocplanError(f"{path}: holds no ros__parameters; give Nav2's parameters")
    return content


def _merged(theirs: dict[str, Any], ours: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters with ours set; lists of plugins and filters keep theirs and get ours besides."""
    result = dict(theirs)
    for key, value in ours.items():
        old = result.get(key)
        if isinstance(value, dict) and isinstance(old, dict):
            result[key] = _merged(old, value)
        elif key in _LISTS and isinstance(old, list):
            added = [name for name in value if name.startswith(_NAME) and name not in old]
            behind = old.index("static_layer") + 1 if "static_layer" in old else len(old)
            place = behind if key == "plugins" else len(old)
            result[key] = old[:place] + added + old[place:]
        else:
            result[key] = value
    return result

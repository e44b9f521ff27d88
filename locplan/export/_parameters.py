"""Nav2's parameters: ours alone, or merged into a robot's own."""

from __future__ import annotations

from typing import Any, get_args

from locplan.errors import ConfigError
from locplan.export._names import Distro
from locplan.export._travel_costs import Conversion
from locplan.maps._ros_parameters import Parameters, listed_names, node_parameters

DISTROS = get_args(Distro)
OWN_PLANNER = "Localizability"
"""What our planner is called beside a robot's own."""
FIRST_LAYERS = {
    "static_layer": {
        "plugin": "nav2_costmap_2d::StaticLayer",
        "map_subscribe_transient_local": True,
    },
    "inflation_layer": {"plugin": "nav2_costmap_2d::InflationLayer"},
}
"""Of a costmap that names no layers itself, without the one of obstacles that a robot may have."""


def with_costmap(theirs: Parameters, ours: Parameters, layer: str | None = None) -> Parameters:
    """Parameters with ours in the global costmap, and a filter or a layer of ours in its list."""
    costmap = node_parameters(theirs, "global_costmap")
    merged = {**costmap, **ours}
    if layer is None:
        merged["filters"] = listed_names(costmap, "filters", [])
        merged["filters"] += [name for name in ours["filters"] if name not in merged["filters"]]
    else:
        if not costmap.get("plugins"):
            merged |= FIRST_LAYERS
        names = listed_names(costmap, "plugins", list(FIRST_LAYERS))
        if layer not in names:  # before the inflation, and behind what knows the walls
            at = names.index("static_layer") + 1 if "static_layer" in names else len(names)
            names.insert(at, layer)
        merged["plugins"] = names
    return {**theirs, "global_costmap": {"global_costmap": {"ros__parameters": merged}}}


def with_planner(theirs: Parameters, conversion: Conversion, distro: str) -> tuple[Parameters, str]:
    """Parameters with the planner that a conversion is for, and what it is called.

    A planner of the same kind that is there keeps its name and settings; besides others ours gets
    a name of its own.

    Raises
    ------
    ConfigError
        If the distribution is unknown.
    """
    check_distro(distro)
    planner, server = conversion.planner, node_parameters(theirs, "planner_server")
    names = listed_names(server, "planner_plugins", [])
    alike = [name for name in names if _plugin(server.get(name)) == planner.plugin]
    name = alike[0] if alike else OWN_PLANNER if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if distro == "humble" else planner.plugin
    own: Parameters = {"plugin": plugin, "allow_unknown": False, **planner.assumed}
    if planner.parameter is not None:
        own[planner.parameter] = float(conversion.param)
    if alike:
        own["plugin"] = server[name]["plugin"]
        own = {**server[name], **own}
    listed = names if name in names else [*names, name]
    merged = {**server, "planner_plugins": listed, name: own}
    return {**theirs, "planner_server": {"ros__parameters": merged}}, name


def check_distro(distro: str) -> None:
    """Raise a ConfigError unless it is a distribution of ROS 2 that is known here."""
    if distro not in DISTROS:
        raise ConfigError(f"distro must be one of {', '.join(DISTROS)}, not {distro!r}")


def _plugin(own: Any) -> str:
    """The kind of a plugin as it is written from Iron on."""
    return str(own.get("plugin")).replace("/", "::") if isinstance(own, dict) else ""

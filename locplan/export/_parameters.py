"""Nav2's parameters: ours alone, or merged into a robot's own."""

from __future__ import annotations

from typing import Any, get_args

from locplan._util.checks import one_of
from locplan.export._names import Distro
from locplan.export._travel_costs import Conversion
from locplan.maps._ros_parameters import Parameters, listed_names, node_parameters

OWN_PLANNER = "Localizability"
"""Name of our planner beside a robot's own."""
STATIC_LAYERS = {"trinary_costmap": False, "use_maximum": True, "lethal_cost_threshold": 100}
"""Parameters of a costmap that Nav2 applies to all its static layers."""
FIRST_LAYERS = {
    "static_layer": {
        "plugin": "nav2_costmap_2d::StaticLayer",
        "map_subscribe_transient_local": True,
    },
    "inflation_layer": {"plugin": "nav2_costmap_2d::InflationLayer"},
}
"""Layers of a costmap that names none itself; obstacles are left to the robot's own layers."""


def with_costmap(theirs: Parameters, kind: str) -> Parameters:
    """Parameters with our filter or static layer in the global costmap, and in its list of them."""
    costmap = node_parameters(theirs, "global_costmap")
    base = f"localizability_{kind}"  # topics are absolute: Kilted is the first to resolve others
    if kind == "static":
        plugin = f"{base}_layer"
        names = listed_names(costmap, "plugins", list(FIRST_LAYERS))
        if plugin not in names:  # before the inflation, and behind what knows the walls
            at = names.index("static_layer") + 1 if "static_layer" in names else len(names)
            names.insert(at, plugin)
        own: Parameters = {"plugin": "nav2_costmap_2d::StaticLayer", "enabled": True}
        own |= {"map_topic": f"/{base}_mask", "map_subscribe_transient_local": True}
        first = {} if costmap.get("plugins") else FIRST_LAYERS
        merged = {**costmap, **STATIC_LAYERS, plugin: own, **first, "plugins": names}
    else:
        plugin = f"{base}_filter"
        names = listed_names(costmap, "filters", [])
        own = {"plugin": f"nav2_costmap_2d::{kind.title()}Filter", "enabled": True}
        own |= {"filter_info_topic": f"/{base}_info"}
        if kind == "speed":
            own |= {"speed_limit_topic": "/speed_limit"}
        names = names if plugin in names else [*names, plugin]
        merged = {**costmap, "filters": names, plugin: own}
    return {**theirs, "global_costmap": {"global_costmap": {"ros__parameters": merged}}}


def with_planner(theirs: Parameters, conversion: Conversion, distro: str) -> tuple[Parameters, str]:
    """Parameters with the planner that a conversion is for, and the planner's name.

    A planner of the same kind that is there keeps its name and settings; besides others ours gets
    a name of its own.
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
    one_of("distro", distro, get_args(Distro))


def _plugin(own: Any) -> str:
    """The kind of a plugin as it is written from Iron on."""
    return str(own.get("plugin")).replace("/", "::") if isinstance(own, dict) else ""

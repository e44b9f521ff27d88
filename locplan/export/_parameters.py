"""Nav2's parameters: ours alone, or merged into a robot's own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from locplan._util.plain_yaml import scalar_text
from locplan.export._robots import SPEED_TOPIC, Robot
from locplan.export._travel_costs import Conversion
from locplan.robots import (
    GLOBAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
)

OWN_PLANNER = "Localizability"
"""Name of our planner beside a robot's own."""
STATIC_LAYERS = {"trinary_costmap": False, "use_maximum": True, "lethal_cost_threshold": 100}
"""Parameters of a costmap that Nav2 applies to all its static layers."""
QUADRATIC = "use_quadratic_cost_penalty"
"""A parameter of SmacPlannerHybrid from jazzy on."""
INSCRIBED = {"inscribed_obstacle_cost_value": 99}
"""A further one from lyrical on; layers hold less than this."""
FIRST_LAYERS: dict[str, dict[str, Any]] = {
    "static_layer": {
        "plugin": "nav2_costmap_2d::StaticLayer",
        "map_subscribe_transient_local": True,
    },
    "inflation_layer": {"plugin": "nav2_costmap_2d::InflationLayer"},
}
"""Layers of a costmap that names none itself; obstacles are left to the robot's own layers."""


def with_costmap(robot: Robot, kind: str) -> Nav2Parameters:
    """Parameters with our filter or static layer in the global costmap, and in its list of them."""
    costmap = robot.parameters.of(GLOBAL_COSTMAP)
    base = f"localizability_{kind}"  # topics are absolute: Kilted is the first to resolve others
    if kind == "static":
        plugin = f"{base}_layer"
        names = robot.parameters.names(GLOBAL_COSTMAP, "plugins", list(FIRST_LAYERS))
        if plugin not in names:  # before the inflation, and behind what knows the walls
            at = names.index("static_layer") + 1 if "static_layer" in names else len(names)
            names.insert(at, plugin)
        own: dict[str, Any] = {"plugin": "nav2_costmap_2d::StaticLayer", "enabled": True}
        own |= {"map_topic": f"/{base}_mask", "map_subscribe_transient_local": True}
        layers = {plugin: own} | ({} if costmap.get("plugins") else FIRST_LAYERS)
        shared = STATIC_LAYERS | (INSCRIBED if robot.distribution.inscribed_value else {})
        changes = {**shared, "plugins": names}
        for layer, settings in layers.items():
            changes |= _settings(layer, settings)
    else:
        plugin = f"{base}_filter"
        names = robot.parameters.names(GLOBAL_COSTMAP, "filters")
        own = {"plugin": f"nav2_costmap_2d::{kind.title()}Filter", "enabled": True}
        own |= {"filter_info_topic": f"/{base}_info"}
        if kind == "speed":
            own |= {"speed_limit_topic": SPEED_TOPIC}
        names = names if plugin in names else [*names, plugin]
        changes = {"filters": names, **_settings(plugin, own)}
    return robot.parameters.changed(GLOBAL_COSTMAP, changes)


def with_planner(
    robot: Robot, merged: Nav2Parameters, conversion: Conversion
) -> tuple[Nav2Parameters, str]:
    """Parameters with the planner that a conversion is for, and the planner's name.

    A planner of the same kind that is there keeps its name and its other settings, also a longer
    time for planning; besides others ours gets a name of its own.
    """
    planner, runs = conversion.planner, robot.distribution
    server, names = merged.of(PLANNER_SERVER), list(robot.planners)
    alike = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    name = alike[0] if alike else OWN_PLANNER if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if runs.slashes else planner.plugin
    own: dict[str, Any] = {"plugin": plugin, "allow_unknown": False, **planner.assumed}
    if not runs.quadratic_penalty:
        own.pop(QUADRATIC, None)
    if planner.parameter is not None:
        own[planner.parameter] = float(conversion.param)
    if planner.planning_time is not None:
        own["max_planning_time"] = planner.planning_time
    if alike:
        theirs_time = server.get(f"{name}.max_planning_time")
        if isinstance(theirs_time, (int, float)) and planner.planning_time is not None:
            own["max_planning_time"] = max(float(theirs_time), planner.planning_time)
        del own["plugin"]
    listed = names if name in names else [*names, name]
    changes = {"planner_plugins": listed, **_settings(name, own)}
    return merged.changed(PLANNER_SERVER, changes), name


def _settings(name: str, own: dict[str, Any]) -> dict[str, Any]:
    """The settings of a plugin by their names in ROS."""
    return {f"{name}.{key}": value for key, value in own.items()}


def changed_parameters(theirs: Any, merged: Any, name: str = "") -> Iterator[str]:
    """A sentence's part for each of a robot's own values that another one has replaced."""
    if isinstance(theirs, dict) and isinstance(merged, dict):
        for key, value in theirs.items():
            yield from changed_parameters(value, merged[key], _inner(name, key))
    elif isinstance(theirs, list) and isinstance(merged, list):
        return  # of names, to which ours are added
    elif theirs != merged:
        yield f"{name}: {scalar_text(merged)} (was {scalar_text(theirs)})"


def added_parameters(theirs: Any, merged: Any, name: str = "") -> Iterator[str]:
    """A sentence's part for each value that a robot's own parameters do not have."""
    if isinstance(merged, dict):
        own = theirs if isinstance(theirs, dict) else {}
        for key, value in merged.items():
            yield from added_parameters(own.get(key), value, _inner(name, key))
    elif isinstance(merged, list):
        added = [each for each in merged if each not in (theirs or [])]
        if added:
            yield f"{name}: {', '.join(map(str, added))}"
    elif theirs is None:
        yield f"{name}: {scalar_text(merged)}"


def _inner(name: str, key: str) -> str:
    """The name of a parameter within another one; nodes' own levels are left out."""
    return name if key in ("ros__parameters", name) else f"{name}.{key}".strip(".")

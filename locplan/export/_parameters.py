"""Nav2's parameters: ours alone, or merged into a robot's own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan.export._distros import Distribution, distribution
from locplan.export._travel_costs import Conversion
from locplan.maps._parameter_edits import scalar_text
from locplan.maps._ros_parameters import (
    Parameters,
    listed_names,
    node_parameters,
    read_parameters,
)

OWN_PLANNER = "Localizability"
"""Name of our planner beside a robot's own."""
STATIC_LAYERS = {"trinary_costmap": False, "use_maximum": True, "lethal_cost_threshold": 100}
"""Parameters of a costmap that Nav2 applies to all its static layers."""
QUADRATIC = "use_quadratic_cost_penalty"
"""A parameter of SmacPlannerHybrid from jazzy on."""
INSCRIBED = {"inscribed_obstacle_cost_value": 99}
"""A further one from lyrical on; layers hold less than this."""
FIRST_LAYERS = {
    "static_layer": {
        "plugin": "nav2_costmap_2d::StaticLayer",
        "map_subscribe_transient_local": True,
    },
    "inflation_layer": {"plugin": "nav2_costmap_2d::InflationLayer"},
}
"""Layers of a costmap that names none itself; obstacles are left to the robot's own layers."""


@dataclass(frozen=True)
class Robot:
    """A robot's own parameters of Nav2, into which ours are merged."""

    distribution: Distribution
    """The distribution of ROS 2 that it runs."""
    file: Path | None
    """The file of its parameters, if there is one."""
    parameters: Parameters
    """The parameters in the file; none without a file."""

    @classmethod
    def of(cls, params: str | Path | None, distro: str) -> Robot:
        """Read the file and warn of the distribution's faults; a LocplanError where it cannot."""
        runs = distribution(distro)
        own = read_parameters(params)
        runs.warn()
        return cls(runs, Path(params) if params else None, own)


def with_costmap(robot: Robot, kind: str) -> Parameters:
    """Parameters with our filter or static layer in the global costmap, and in its list of them."""
    theirs = robot.parameters
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
        shared = STATIC_LAYERS | (INSCRIBED if robot.distribution.inscribed_value else {})
        merged = {**costmap, **shared, plugin: own, **first, "plugins": names}
    else:
        plugin = f"{base}_filter"
        names = listed_names(costmap, "filters", [])
        own = {"plugin": f"nav2_costmap_2d::{kind.title()}Filter", "enabled": True}
        own |= {"filter_info_topic": f"/{base}_info"}
        if kind == "speed":
            own |= {"speed_limit_topic": "/speed_limit"}
        names = names if plugin in names else [*names, plugin]
        merged = {**costmap, "filters": names, plugin: own}
    namespace = theirs.get("global_costmap", {})
    node = {**namespace.get("global_costmap", {}), "ros__parameters": merged}
    return {**theirs, "global_costmap": {**namespace, "global_costmap": node}}


def with_planner(
    theirs: Parameters, conversion: Conversion, runs: Distribution
) -> tuple[Parameters, str]:
    """Parameters with the planner that a conversion is for, and the planner's name.

    A planner of the same kind that is there keeps its name and its other settings, also a longer
    time for planning; besides others ours gets a name of its own.
    """
    planner, server = conversion.planner, node_parameters(theirs, "planner_server")
    names = listed_names(server, "planner_plugins", [])
    alike = [name for name in names if _plugin(server.get(name)) == planner.plugin]
    name = alike[0] if alike else OWN_PLANNER if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if runs.slashes else planner.plugin
    own: Parameters = {"plugin": plugin, "allow_unknown": False, **planner.assumed}
    if not runs.quadratic_penalty:
        own.pop(QUADRATIC, None)
    if planner.parameter is not None:
        own[planner.parameter] = float(conversion.param)
    if planner.planning_time is not None:
        own["max_planning_time"] = planner.planning_time
    if alike:
        theirs_time = server[name].get("max_planning_time")
        if isinstance(theirs_time, float) and theirs_time > (planner.planning_time or math.inf):
            own["max_planning_time"] = theirs_time
        own["plugin"] = server[name]["plugin"]
        own = {**server[name], **own}
    listed = names if name in names else [*names, name]
    merged = {**server, "planner_plugins": listed, name: own}
    node = {**theirs.get("planner_server", {}), "ros__parameters": merged}
    return {**theirs, "planner_server": node}, name


def changed_parameters(theirs: Any, merged: Any, name: str = "") -> Iterator[str]:
    """A sentence's part for each of a robot's own values that another one has replaced."""
    if isinstance(theirs, dict) and isinstance(merged, dict):
        for key, value in theirs.items():
            inner = name if key in ("ros__parameters", name) else f"{name}.{key}".strip(".")
            yield from changed_parameters(value, merged[key], inner)
    elif isinstance(theirs, list) and isinstance(merged, list):
        return  # of names, to which ours are added
    elif theirs != merged:
        yield f"{name}: {scalar_text(merged)} (was {scalar_text(theirs)})"


def _plugin(own: Any) -> str:
    """The kind of a plugin as it is written from Iron on."""
    return str(own.get("plugin")).replace("/", "::") if isinstance(own, dict) else ""

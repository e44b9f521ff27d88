"""Nav2's parameters: a robot's own with ours, and what a README.md says of them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan._util.reading import scalar_text
from locplan.costs import Costmap
from locplan.export._distros import BRINGUP, LAUNCH, SERVERS, Distribution, distribution
from locplan.export._folders import about_map
from locplan.export._travel_costs import NO_LIMIT, PLANNERS, Conversion
from locplan.robots import (
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
)

PLANNER = "smac2d"
"""The planner of Nav2 that a mask is for where the robot's own is not known."""
SPEED_TOPIC = "/speed_limit"
"""Topic of the limits that the controller server obeys."""


class RobotWarning(UserWarning):
    """A robot's own parameters do not go with an export."""


@dataclass(frozen=True)
class Robot:
    """A robot's own parameters of Nav2, into which ours are merged."""

    distribution: Distribution
    """The distribution of ROS 2 that it runs."""
    file: Path | None
    """The file of its parameters, if there is one."""
    parameters: Nav2Parameters
    """The parameters in the file; none without a file."""

    @classmethod
    def of(cls, params: str | Path | None, distro: str) -> Robot:
        """Read the file and warn of the distribution's faults; a LocplanError where it cannot."""
        robot = cls(distribution(distro), Path(params) if params else None, read_parameters(params))
        robot.distribution.warn()
        robot.warn(robot._misspelt())
        return robot

    @property
    def planners(self) -> dict[str, str]:
        """The plugin of each of its planners by name, as it is written from Jazzy on."""
        return {name: plugin.replace("/", "::") for name, plugin in self._plugins().items()}

    @property
    def planner(self) -> str:
        """Its first planner of those that a mask can be for, as `PLANNERS` names it."""
        known = {each.plugin: name for name, each in PLANNERS.items()}
        return next((known[each] for each in self.planners.values() if each in known), PLANNER)

    def warn(self, notes: Iterator[str]) -> None:
        """Warn of what does not go together."""
        for note in notes:
            name = self.file.name if self.file else ""
            warnings.warn(RobotWarning(f"{name}: {note}"), stacklevel=4)

    def of_planner(self, called: str) -> Iterator[str]:
        """That ours stands beside its own planners."""
        others = [f"{name} ({plugin})" for name, plugin in self.planners.items() if name != called]
        if others and called not in self.planners:
            yield (
                f"its planners are {', '.join(others)}; {called} is added for the mask, and plans"
                " only where the behaviour tree names it (planner_id), or take another --planner"
            )

    def of_speed(self, own: str) -> Iterator[str]:
        """That another speed filter limits the same robot."""
        for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for name, value in self.parameters.of(costmap).items():
                layer, _, last = name.rpartition(".")
                if last == "plugin" and layer != own and str(value).endswith("SpeedFilter"):
                    yield (
                        f"{costmap.partition('/')[0]} has a speed filter, {layer}; both publish"
                        " limits, and the one that came last counts: merge the masks, or leave one"
                        " out"
                    )

    def of_radius(self, radius: float) -> Iterator[str]:
        """That it is larger than the robot that lanes were made for."""
        own = self.parameters.of(GLOBAL_COSTMAP).get("robot_radius")
        if isinstance(own, (int, float)) and own > radius + 1e-9 and math.isfinite(own):
            yield (
                f"its robot_radius is {own:g} m, but the ways are for {radius:g} m; give"
                f" --set footprint={own:g}"
            )

    def _misspelt(self) -> Iterator[str]:
        """That its planners are written as in another distribution."""
        for name, plugin in self._plugins().items():
            if "/" in plugin and not self.distribution.slashes:
                yield f"{name} is {plugin}, as in humble; give --distro humble if that runs there"
            elif "::" in plugin and self.distribution.slashes:
                yield f"{name} is {plugin}, as from jazzy on, but humble has / for ::"

    def _plugins(self) -> dict[str, str]:
        """The plugin of each of its planners by name, as the file has it."""
        server = self.parameters.of(PLANNER_SERVER)
        names = self.parameters.names(PLANNER_SERVER, "planner_plugins")
        return {name: str(server.get(f"{name}.plugin", "")) for name in names}


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


def mask_readme(
    costs: Costmap,
    robot: Robot,
    needs: Sequence[str],
    added: Sequence[str],
    changed: Sequence[str],
    *,
    params: str,
    preview: str,
) -> list[str]:
    """Lines on the files, the commands, the needs of a mask, and the parameters that are ours."""
    own = f"all of {robot.file.name} (but its comments), with ours" if robot.file else "ours alone"
    merging = "" if robot.file else "; merge them into the robot's own, as `--robot` does"
    file = f"$PWD/{params}" if robot.file else "PARAMS.yaml"
    lines = [
        f"- mask.yaml, mask.pgm: the mask of {costs.grid.name or 'the map'} (grey 0-100 as it"
        f" is, not 0-255); {SERVERS} and {LAUNCH} publish it.",
        f"- {params}: Nav2's parameters, {own}{merging}; {preview}; export.json: the input.",
        f"- `ros2 launch ./{LAUNCH}` (in this folder)",
        f"- `{BRINGUP.replace('PARAMS.yaml', file)}`",
        *needs,
        f"- Another mask goes beside this one with `locplan export ... --robot {params}`.",
        *about_map(costs),
    ]
    if robot.file and changed:
        lines += ["", f"{params} has other values than {robot.file.name} here:", ""]
        lines += [f"- {each}" for each in changed]
    if robot.file and added:
        lines += ["", f"{params} has these beside:", "", *(f"- {each}" for each in added)]
    return lines


def needs_of_planner(conversion: Conversion, called: str) -> list[str]:
    """Lines that say which parameters of a planner a mask needs, and why."""
    planner = conversion.planner
    lines = [
        f"- All planners of Nav2 charge the mask, but only `{called}` so that J comes out: name it"
        " as the planner_id in the behaviour tree (ComputePathToPose), or by a PlannerSelector."
    ]
    if planner.parameter:
        lines.append(
            f"- The mask changes little without `{planner.parameter}: {conversion.param:g}` (Nav2's"
            f" own default is {planner.default:g}). It raises the price of inflated cells as well."
        )
    lines.append("- `allow_unknown: false`: the mask says nothing of unknown space.")
    if planner.planning_time is not None:
        lines.append(
            "- A mask can make the search expand several times as many cells, hence"
            f" `max_iterations: {NO_LIMIT}` (no limit; the default of 1,000,000 ends it without a"
            f" path on large maps) and `max_planning_time: {planner.planning_time:g}` [s] or more,"
            " for which the planner server is busy at worst."
        )
    return lines


def needs_of_layer(shared: Sequence[str]) -> list[str]:
    """A line on the parameters that a static layer shares with the robot's own."""
    return [f"- {', '.join(f'`{each}`' for each in shared)} hold for all static layers."]


def needs_of_speed() -> list[str]:
    """A line on who obeys the limits."""
    return [
        f"- The controller server obeys the limits on {SPEED_TOPIC}; with a namespace set the topic"
        " on both sides (speed_limit_topic)."
    ]

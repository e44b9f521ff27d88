"""Nav2's parameters: ours alone, or merged into a robot's own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from locplan.errors import ConfigError, LocplanError
from locplan.export.travel_costs import Conversion

DISTROS = ("humble", "iron", "jazzy", "kilted", "lyrical", "rolling")
NODES = ("global_costmap", "local_costmap", "planner_server", "controller_server", "amcl")
"""Of which a parameter file of Nav2 has at least one at its top."""
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

Parameters = dict[str, Any]


def read_parameters(path: str | Path | None) -> Parameters:
    """The parameters in a file of Nav2's; none without a file.

    Raises
    ------
    LocplanError
        If it cannot be read, or is no parameter file of Nav2 without namespaces.
    """
    import yaml

    if path is None:
        return {}
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or "it is no YAML in UTF-8"
        raise LocplanError(f"{path}: cannot be read ({reason}); give Nav2's parameters") from None
    if not isinstance(content, dict) or not any(node in content for node in NODES):
        raise LocplanError(
            f"{path}: names none of Nav2's nodes at its top; give its parameters without namespaces"
        )
    for node in ("global_costmap", "planner_server"):
        _own(content, node, path)
    return content


def with_costmap(theirs: Parameters, ours: Parameters, layer: str | None = None) -> Parameters:
    """Parameters with ours in the global costmap, and a filter or a layer of ours in its list."""
    costmap = _own(theirs, "global_costmap")
    merged = {**costmap, **ours}
    if layer is None:
        merged["filters"] = _listed(costmap, "filters", [])
        merged["filters"] += [name for name in ours["filters"] if name not in merged["filters"]]
    else:
        if not costmap.get("plugins"):
            merged |= FIRST_LAYERS
        names = _listed(costmap, "plugins", list(FIRST_LAYERS))
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
    planner, server = conversion.planner, _own(theirs, "planner_server")
    names = _listed(server, "planner_plugins", [])
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


def _own(content: Mapping[str, Any], node: str, path: str | Path | None = None) -> Parameters:
    """A node's parameters; a costmap is a node within its own namespace."""
    inner = content.get(node, {})
    if node == "global_costmap" and isinstance(inner, dict):
        inner = inner.get(node, {})
    own = inner.get("ros__parameters", {}) if isinstance(inner, dict) else None
    if not isinstance(own, dict):
        raise LocplanError(f"{path}: {node} holds no ros__parameters; give Nav2's parameters")
    for name in ("plugins", "filters", "planner_plugins"):
        _listed(own, name, [], path)
    return own


def _listed(
    parameters: Mapping[str, Any], name: str, default: list[str], path: str | Path | None = None
) -> list[str]:
    names = parameters.get(name) or default
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise LocplanError(f"{path}: {name} must be a list of names, not {names!r}")
    return list(names)


def _plugin(own: Any) -> str:
    """The kind of a plugin as it is written from Iron on."""
    return str(own.get("plugin")).replace("/", "::") if isinstance(own, dict) else ""

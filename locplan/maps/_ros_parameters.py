"""Reading parameter files of ROS 2's Nav2."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from locplan.errors import LocplanError

NODES = ("global_costmap", "local_costmap", "planner_server", "controller_server", "amcl")
"""Nodes of Nav2; a parameter file has at least one of them at its top level."""
Parameters = dict[str, Any]


def read_parameters(path: str | Path | None) -> Parameters:
    """Read the parameters in a file of Nav2; without a file there are none.

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
        node_parameters(content, node, path)
    return content


def node_parameters(
    content: Mapping[str, Any], node: str, path: str | Path | None = None
) -> Parameters:
    """Parameters of a node; a costmap is a node within its own namespace."""
    inner = content.get(node, {})
    if node == "global_costmap" and isinstance(inner, dict):
        inner = inner.get(node, {})
    own = inner.get("ros__parameters", {}) if isinstance(inner, dict) else None
    if not isinstance(own, dict):
        raise LocplanError(f"{path}: {node} holds no ros__parameters; give Nav2's parameters")
    for name in ("plugins", "filters", "planner_plugins"):
        listed_names(own, name, [], path)
    return own


def listed_names(
    parameters: Mapping[str, Any], name: str, default: list[str], path: str | Path | None = None
) -> list[str]:
    names = parameters.get(name) or default
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise LocplanError(f"{path}: {name} must be a list of names, not {names!r}")
    return list(names)

"""Reading parameter files of ROS 2's Nav2."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.checks import file_path, shown
from locplan.errors import LocplanError
from locplan.maps._yaml import SCALAR_TAGS, compose, fault_of, read_content

if TYPE_CHECKING:
    import yaml

NODES = ("global_costmap", "local_costmap", "planner_server", "controller_server", "amcl")
"""Nodes of Nav2; a parameter file has at least one of them at its top level."""
MAX_BYTES = 2**17
"""Greatest size of a file, of which PyYAML reads some 50 KB a second."""
MAX_VALUES = 100_000
"""Greatest number of values in a file, those that aliases stand for included."""
REMEDY = "give Nav2's parameters"
ROS_BOOLEANS = {"y": True, "Y": True, "n": False, "N": False}
"""Plain words that are booleans to ROS, but texts to PyYAML."""
ROS_NUMBER = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+")
"""Plain words that are numbers to ROS, but texts to PyYAML."""
Parameters = dict[str, Any]


def read_parameters(path: str | os.PathLike[str] | None) -> Parameters:
    """Read the parameters in a file of Nav2; without a file there are none.

    As in ROS, names are texts, and values are numbers, true, false, texts, or lists of them; what
    YAML makes something else of, such as a date, is a text. Aliases are written out.

    Parameters
    ----------
    path : path or None
        The YAML file, of at most 128 KiB, with a node of Nav2 such as amcl at its top.

    Returns
    -------
    dict
        The whole content: nodes by name, each with its "ros__parameters".

    Raises
    ------
    LocplanError
        If the file cannot be read, or is no parameter file of Nav2 without namespaces.
    """
    if path is None:
        return {}
    file = file_path("a file of Nav2's parameters", path)
    return parameters_of(file, read_content(file, MAX_BYTES, REMEDY))


def parameters_of(file: Path, content: bytes) -> Parameters:
    """Parameters in the content of a file; see `read_parameters`."""
    root = compose(file, content, REMEDY)
    try:
        values = None if root is None else _Values().of(root)
    except (OverflowError, RecursionError):
        fault = f"its aliases stand for over {MAX_VALUES} values"
        raise fault_of(file, fault, "write out what they stand for") from None
    if not isinstance(values, dict) or not any(node in values for node in NODES):
        raise LocplanError(
            f"{file}: names none of Nav2's nodes at its top; give its parameters without namespaces"
        )
    for node in ("global_costmap", "planner_server"):
        node_parameters(values, node, file)
    return values


def node_parameters(
    content: Mapping[str, Any], node: str, path: str | os.PathLike[str] | None = None
) -> Parameters:
    """Parameters of a node; a costmap is a node within its own namespace."""
    inner = content.get(node, {})
    if node == "global_costmap" and isinstance(inner, dict):
        inner = inner.get(node, {})
    own = inner.get("ros__parameters", {}) if isinstance(inner, dict) else None
    if not isinstance(own, dict):
        raise LocplanError(f"{path}: {node} holds no ros__parameters; {REMEDY}")
    for name in ("plugins", "filters", "planner_plugins"):
        listed_names(own, name, [], path)
    return own


def listed_names(
    parameters: Mapping[str, Any],
    name: str,
    default: list[str],
    path: str | os.PathLike[str] | None = None,
) -> list[str]:
    names = parameters.get(name) or default
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise LocplanError(f"{path}: {name} must be a list of names, not {shown(names)}")
    return list(names)


class _Values:
    """The values of YAML's nodes; an OverflowError if there are more than `MAX_VALUES`."""

    def __init__(self) -> None:
        self.count = 0

    def of(self, node: yaml.Node) -> Any:
        """Value of a node, and of all in it."""
        import yaml

        self.count += 1
        if self.count > MAX_VALUES:
            raise OverflowError
        if isinstance(node, yaml.SequenceNode):
            return [self.of(item) for item in node.value]
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node)
        if node.tag == "tag:yaml.org,2002:null":
            return None
        is_plain = isinstance(node, yaml.ScalarNode) and node.style is None
        if is_plain and node.value in ROS_BOOLEANS:
            return ROS_BOOLEANS[node.value]
        if is_plain and ROS_NUMBER.fullmatch(node.value):
            return float(node.value)
        try:
            known = node.tag in SCALAR_TAGS
            value = yaml.SafeLoader("").construct_object(node) if known else node.value
        except (ValueError, LookupError, AttributeError):  # such as !!int x, or 5000 digits
            value = node.value
        too_long = isinstance(value, int) and not -(2**63) <= value < 2**63
        return str(node.value) if too_long else value

    def _mapping(self, node: yaml.MappingNode) -> Parameters:
        import yaml

        own: Parameters = {}
        merged: Parameters = {}
        for key, value in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                sources = value.value if isinstance(value, yaml.SequenceNode) else [value]
                for source in reversed(sources):  # of several the first one counts
                    content = self.of(source)
                    merged |= content if isinstance(content, dict) else {}
            else:
                own[str(key.value) if isinstance(key, yaml.ScalarNode) else "..."] = self.of(value)
        return merged | own

"""Reading parameter files of ROS 2's Nav2."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from locplan._util.checks import file_path, shown
from locplan._util.reading import ROS_BOOLEANS, ROS_NUMBER, compose, fault_of, read_content, scalar
from locplan.errors import LocplanError

PARAMETERS = "ros__parameters"
AMCL, PLANNER_SERVER = "amcl", "planner_server"
GLOBAL_COSTMAP, LOCAL_COSTMAP = (f"{each}_costmap/{each}_costmap" for each in ("global", "local"))
NODES = (AMCL, PLANNER_SERVER, "controller_server", GLOBAL_COSTMAP, LOCAL_COSTMAP)
"""Nodes of Nav2; a parameter file has parameters of at least one of them."""
MAX_BYTES = 2**17
"""Maximum size of a file, of which PyYAML reads some 50 KB a second."""
MAX_VALUES = 100_000
"""Maximum number of values in a file, those that aliases stand for included."""
REMEDY = "give Nav2's parameters"
Parameters = dict[str, Any]


@dataclass(frozen=True)
class Nav2Parameters:
    """The parameters of one robot's nodes in a file of Nav2, as ROS resolves them.

    A node has those of all entries whose name fits its own, "/**" and "/*" included; of several
    values the last one in the file counts, whether or not its entry is for other nodes, too. A
    launch file that rewrites the parameters, as nav2_bringup's does, first sorts the entries by
    name: where those with wildcards stand first in the file, the result is the same.
    """

    content: Parameters
    """The whole content of the file."""
    namespace: str = ""
    """Namespace of the robot, such as "/robot1"."""

    def entries(self, node: str) -> list[Entry]:
        """The entries for a node, in the order in which they count.

        Parameters
        ----------
        node : str
            Name of the node, such as amcl or global_costmap/global_costmap.
        """
        return [each for each in _entries(self.content) if each.is_for(f"{self.namespace}/{node}")]

    def of(self, node: str, *, shared: bool = True) -> Parameters:
        """Parameters of a node by their names in ROS, such as GridBased.plugin.

        Parameters
        ----------
        node : str
            Name of the node.
        shared : bool, default True
            Whether those for nodes of any name are among them.
        """
        entries = [each for each in self.entries(node) if shared or not each.is_shared]
        leaves = (leaf for each in entries for leaf in _leaves(each.parameters))
        return {".".join(path): value for path, value in leaves}

    def place(self, node: str, name: str) -> tuple[str, ...]:
        """The keys that lead to the value in force of a parameter, or to where it belongs.

        Parameters
        ----------
        node, name : str
            Names of the node and the parameter.
        """
        entries = self.entries(node)
        for entry in reversed(entries):
            for path, _ in _leaves(entry.parameters):
                if ".".join(path) == name:
                    return (*entry.keys, PARAMETERS, *path)
        own = [each.keys for each in entries if not each.is_shared]
        alone = [each.keys for each in entries if "*" not in each.name]
        new = tuple(filter(None, f"{self.namespace}/{node}".split("/")))
        return (*(alone or own or [new])[-1], PARAMETERS, *name.split("."))

    def names(self, node: str, name: str, default: Sequence[str] = ()) -> list[str]:
        """The names that a parameter of a node lists, or others without any.

        Parameters
        ----------
        node, name : str
            Names of the node and the parameter.
        default : sequence of str, default ()
            The names where the parameter is missing.

        Raises
        ------
        LocplanError
            If the parameter is no list of names.
        """
        listed = self.of(node).get(name) or list(default)
        if not isinstance(listed, list) or not all(isinstance(each, str) for each in listed):
            raise LocplanError(f"{name} must be a list of names, not {shown(listed)}")
        return list(listed)

    def changed(self, node: str, values: Mapping[str, Any]) -> Nav2Parameters:
        """Parameters with other values for a node, which stand where those in force stood.

        Parameters
        ----------
        node : str
            Name of the node.
        values : mapping
            Values by the names of the parameters.
        """
        content = copy.deepcopy(self.content)
        for name, value in values.items():
            *path, last = self.place(node, name)
            inner = content
            for key in path:
                if not isinstance(inner.get(key), dict):
                    inner[key] = {}
                inner = inner[key]
            inner[last] = value
        return Nav2Parameters(content, self.namespace)


class Entry(NamedTuple):
    """The parameters that a file has for the nodes of a name."""

    keys: tuple[str, ...]
    """The keys that lead to them."""
    name: str
    """Name of the nodes, which may have wildcards, such as /**/amcl."""
    parameters: Parameters

    @property
    def is_shared(self) -> bool:
        """Whether they are for nodes of any name."""
        return self.name.endswith("*")

    def is_for(self, node: str) -> bool:
        """Whether a node has them: * stands for one name, ** for any number of them."""
        names = node.strip("/").split("/")
        reached = {0}
        for part in filter(None, self.name.split("/")):
            if part == "**":
                reached = set(range(min(reached), len(names) + 1))
            else:
                fits = {at for at in reached if part == "*" or names[at : at + 1] == [part]}
                reached = {at + 1 for at in fits if at < len(names)}
            if not reached:
                return False
        return len(names) in reached


def read_parameters(path: str | os.PathLike[str] | None) -> Nav2Parameters:
    """Read the parameters in a file of Nav2; without a file there are none.

    As in ROS, names are texts, and values are numbers, true, false, texts, or lists of them; what
    YAML makes something else of, such as a date, is a text. Aliases are written out.

    Parameters
    ----------
    path : path or None
        The YAML file, of at most 128 KiB, with parameters of a node of Nav2 such as amcl. Where it
        has several robots, the namespace of one follows: "nav2.yaml:robot1", or "nav2.yaml:/" for
        the robot without one.

    Returns
    -------
    Nav2Parameters
        The content, and the parameters of each node of the robot.

    Raises
    ------
    LocplanError
        If the file cannot be read, is no parameter file of Nav2, or has several robots of which
        none is named.
    """
    if path is None:
        return Nav2Parameters({})
    file, robot = file_and_robot(path)
    return parameters_of(file, read_content(file, MAX_BYTES, REMEDY), robot)


def file_and_robot(path: str | os.PathLike[str]) -> tuple[Path, str | None]:
    """The file that a path names, and the robot's name after a colon, if there is one.

    Parameters
    ----------
    path : path
        The file, or "FILE:NAMESPACE".

    Raises
    ------
    LocplanError
        If the path can name no file.
    """
    file = file_path("a file of Nav2's parameters", path)
    name, colon, robot = str(file).rpartition(":")
    if colon and not file.exists() and Path(name).is_file():
        return Path(name), robot
    return file, None


def parameters_of(file: Path, content: bytes, robot: str | None = None) -> Nav2Parameters:
    """Parameters in the content of a file; see `read_parameters`."""
    values = values_in(file, content, REMEDY)
    for entry in _entries(values):
        if not isinstance(entry.parameters, dict):
            raise LocplanError(f"{file}: {shown(entry.name)} holds no {PARAMETERS}; {REMEDY}")
    namespace = _namespace(file, {each.name for each in _entries(values)}, robot)
    parameters = Nav2Parameters(values, namespace)
    if not any(parameters.entries(node) for node in NODES):
        where = f" in {namespace}" if namespace else ""
        raise LocplanError(
            f"{file}: has no parameters of Nav2's nodes{where}; {REMEDY} (as FILE:NAMESPACE where"
            " the robot has one), or a robot's file, which has an entry 'robot'"
        )
    for node in (GLOBAL_COSTMAP, PLANNER_SERVER):
        for name in ("plugins", "filters", "planner_plugins"):
            try:
                parameters.names(node, name)
            except LocplanError as error:
                raise LocplanError(f"{file}: {error}") from None
    return parameters


def _namespace(file: Path, names: set[str], robot: str | None) -> str:
    """Namespace of the robot that is named, or of the only one that the entries name."""
    nodes = {(f"/{name.strip('/')}", f"/{node}") for name in names for node in NODES}
    robots = sorted({name.removesuffix(node) for name, node in nodes if name.endswith(node)})
    robots = [each for each in robots if "*" not in each]
    known = ", ".join(shown(each or "/") for each in robots[:5])
    if robot is None:
        if len(robots) > 1:
            raise LocplanError(f"{file}: has several robots, {known}; name one, as FILE:NAMESPACE")
        return robots[0] if robots else ""
    namespace = f"/{robot.strip('/')}".rstrip("/")
    if robots and namespace not in robots:
        raise LocplanError(f"{file}: has no robot {shown(namespace or '/')}; it has {known}")
    return namespace


def _entries(content: Parameters) -> list[Entry]:
    """All entries, in the order in which later ones replace earlier ones.

    Those of the same name count where the first of them stands, as in rcl_yaml_param_parser.
    """
    found: dict[str, list[Entry]] = {}
    for entry in _walked(content, ()):
        found.setdefault(entry.name, []).append(entry)
    return [entry for entries in found.values() for entry in entries]


def _walked(content: Parameters, keys: tuple[str, ...]) -> Iterator[Entry]:
    for key, value in content.items():
        if key == PARAMETERS and keys:
            yield Entry(keys, "/".join(each.removesuffix("/") for each in keys), value)
        elif isinstance(value, dict):
            yield from _walked(value, (*keys, key))


def _leaves(
    parameters: Parameters, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The keys that lead to each value, and the value."""
    for key, value in parameters.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def values_in(file: Path, content: bytes, remedy: str) -> Parameters:
    """Values of a file's YAML by name, as ROS reads them; none if it holds others."""
    root = compose(file, content, remedy)
    try:
        values = None if root is None else _PlainValues().of(root)
    except (OverflowError, RecursionError):
        fault = f"its aliases stand for over {MAX_VALUES} values"
        raise fault_of(file, fault, "write out what they stand for") from None
    return values if isinstance(values, dict) else {}


class _PlainValues:
    """The values of YAML's nodes; an OverflowError if there are more than `MAX_VALUES`."""

    def __init__(self) -> None:
        self.count = 0

    def of(self, node: Any) -> Any:
        """Value of a node, and of all in it."""
        self.count += 1
        if self.count > MAX_VALUES:
            raise OverflowError
        if node.id == "sequence":
            return [self.of(item) for item in node.value]
        if node.id == "mapping":
            return self._mapping(node)
        if node.tag == "tag:yaml.org,2002:null":
            return None
        if node.style is None and node.value in ROS_BOOLEANS:
            return ROS_BOOLEANS[node.value]
        if node.style is None and ROS_NUMBER.fullmatch(node.value):
            return float(node.value)
        value = scalar(node)
        too_long = isinstance(value, int) and not -(2**63) <= value < 2**63
        return str(node.value) if too_long else value

    def _mapping(self, node: Any) -> Parameters:
        own: Parameters = {}
        merged: Parameters = {}
        for key, value in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                for source in reversed(value.value if value.id == "sequence" else [value]):
                    content = self.of(source)  # of several the first one counts
                    merged |= content if isinstance(content, dict) else {}
            else:
                name = str(key.value) if key.id == "scalar" else "?"
                own[name] = _joined(own.get(name), self.of(value))
        return merged | own


def _joined(first: Any, then: Any) -> Any:
    """The later of two values of a name, or what both hold: ROS reads all of them."""
    if not (isinstance(first, dict) and isinstance(then, dict)):
        return then
    return first | {name: _joined(first.get(name), value) for name, value in then.items()}

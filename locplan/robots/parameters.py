"""Nav2's parameter files: entries, and the values that ROS merges from several files."""

from __future__ import annotations

import copy
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from locplan._support.checks import check_file_path, short_repr
from locplan._support.reading import (
    ROS_BOOLEANS,
    ROS_NUMBER,
    compose_yaml,
    make_map_error,
    parse_scalar,
    read_content,
)
from locplan.errors import LocplanError

Parameters = dict[str, Any]
PARAMETERS = "ros__parameters"


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file, and the robot in it."""

    path: Path | None = None
    """The file; None for parameters that no file holds."""
    content: Parameters = None  # type: ignore[assignment]
    """The whole content."""
    namespace: str = ""
    """Namespace of the robot in this file, such as "/robot1"."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "content", {} if self.content is None else self.content)

    @property
    def title(self) -> str:
        """The file's name for people."""
        return self.path.name if self.path else "the parameters"

    @property
    def sections(self) -> Iterator[NodeSection]:
        """Yield all entries in their order in the file."""
        return iterate_sections(self.content, ())

    def is_for_robot(self, section: NodeSection) -> bool:
        """True if an entry can be for nodes in the robot's namespace."""
        namespace = self.namespace.strip("/")
        inside = f"{section.name.strip('/')}/".startswith(f"{namespace}/")
        return not namespace or inside or "*" in section.name

    def relative_name(self, section: NodeSection) -> str:
        """Return the name of an entry relative to the robot's namespace."""
        slash = "/" if section.name.startswith("/") else ""
        inner = f"{section.name.strip('/')}/".removeprefix(f"{self.namespace.strip('/')}/")
        return slash + inner.strip("/")


class NodeSection(NamedTuple):
    """The parameters in a file for nodes of one name."""

    keys: tuple[str, ...]
    """The keys that lead to them."""
    name: str
    """Name of the nodes, which may have wildcards, such as /**/amcl."""
    parameters: Parameters

    @property
    def is_shared(self) -> bool:
        """True if they are for nodes of any name."""
        return self.name.endswith("*")

    def matches_node(self, node: str) -> bool:
        """True if they are for a node: * stands for one name, ** for any number of them."""
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


class ParameterValue(NamedTuple):
    """A value of a parameter, and its place in the files."""

    value: Any
    file: int
    """Index of the file in `Nav2Parameters.files`."""
    section: NodeSection
    path: tuple[str, ...]
    """The keys that lead from the entry to the value."""

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that lead to the value in its file."""
        return (*self.section.keys, PARAMETERS, *self.path)


def iterate_sections(content: Parameters, keys: tuple[str, ...]) -> Iterator[NodeSection]:
    """Yield the entries of parameters for nodes in a file."""
    for key, value in content.items():
        if key == PARAMETERS and keys:
            yield NodeSection(
                keys, "/".join(key_part.removesuffix("/") for key_part in keys), value
            )
        elif isinstance(value, dict):
            yield from iterate_sections(value, (*keys, key))


def list_section_values(file_index: int, section: NodeSection) -> Iterator[ParameterValue]:
    """Yield all values in an entry."""
    for path, value in iterate_leaves(section.parameters):
        yield ParameterValue(value, file_index, section, path)


def merge_sections(sections: Sequence[tuple[int, NodeSection]]) -> list[ParameterValue]:
    """Merge entries of one name; later values replace earlier ones.

    rcl_yaml_param_parser replaces the first value of a plain name, but appends the value of a name
    in a mapping (find_parameter in parse.c searches the mapping's name).
    """
    values: list[ParameterValue] = []
    first: dict[str, int] = {}
    for at, section in sections:
        for parameter in list_section_values(at, section):
            name = ".".join(parameter.path)
            if len(parameter.path) == 1 and name in first:
                values[first[name]] = parameter
            else:
                first.setdefault(name, len(values))
                values.append(parameter)
    return values


def read_component_values(
    file_index: int, file: ParameterFile, node: str
) -> dict[str, ParameterValue]:
    """Return the values that launch_ros takes from a file for a node in a component container.

    Values for its name replace whole mappings of "/**", such as all settings of a plugin.
    """
    sections = {
        "/".join(key.lstrip("/") for key in parameter.keys): parameter
        for parameter in file.sections
    }
    parts: dict[str, list[ParameterValue]] = {}
    for name in ("**", f"{file.namespace}/{node}".strip("/")):
        if name in sections:
            section_values: dict[str, list[ParameterValue]] = {}
            for parameter in list_section_values(file_index, sections[name]):
                section_values.setdefault(parameter.path[0], []).append(parameter)
            parts |= section_values
    return {
        ".".join(parameter.path): parameter for values in parts.values() for parameter in values
    }


def iterate_leaves(
    parameters: Parameters, parent_keys: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each value with the keys that lead to it."""
    for key, value in parameters.items():
        if isinstance(value, dict):
            yield from iterate_leaves(value, (*parent_keys, key))
        else:
            yield (*parent_keys, key), value


AMCL, PLANNER_SERVER = "amcl", "planner_server"
GLOBAL_COSTMAP, LOCAL_COSTMAP = (
    f"{costmap_name}_costmap/{costmap_name}_costmap" for costmap_name in ("global", "local")
)
NODES = (AMCL, PLANNER_SERVER, "controller_server", GLOBAL_COSTMAP, LOCAL_COSTMAP)
"""Nodes of Nav2; the parameter files have parameters of at least one of them."""


class ParameterConflict(NamedTuple):
    """A parameter whose value depends on the place of a wildcard."""

    name: str
    """Name of the parameter."""
    text: str
    """The values and the files that have them, in one sentence for people."""


@dataclass(frozen=True)
class Nav2Parameters:
    """The parameters of one robot's nodes in files of Nav2, as ROS resolves them.

    A node gets the parameters of all entries whose name matches its name, including "/**" and "/*".
    A launch file that rewrites the parameters, such as nav2_bringup's, first sorts the entries by
    name. The result is the same if entries with wildcards come first in the file.
    """

    files: tuple[ParameterFile, ...] = ()
    """The files, of which later ones replace single parameters of earlier ones."""

    @property
    def content(self) -> Parameters:
        """The whole content of the file, or of `merged` if there are several."""
        return self.files[0].content if len(self.files) == 1 else self._merged_content()

    @property
    def namespace(self) -> str:
        """Namespace of the robot, such as "/robot1"."""
        return next((file.namespace for file in self.files if file.namespace), "")

    def find_sections(self, node: str) -> list[tuple[int, NodeSection]]:
        """Return the entries for a node and the indices of their files, in the order of
        application.

        Parameters
        ----------
        node : str
            Name of the node, such as amcl or global_costmap/global_costmap.
        """
        fits = [
            [
                (at, section)
                for at, section in sections
                if section.matches_node(f"{self._namespace_of_file(at)}/{node}")
            ]
            for sections in self._group_sections()
        ]
        return [section for sections in fits for section in sections]

    def find_values(
        self, node: str, *, shared: bool = True, component: bool = False
    ) -> dict[str, ParameterValue]:
        """Return the effective values of a node's parameters, with their places.

        Parameters
        ----------
        node : str
            Name of the node.
        shared : bool, default True
            True includes parameters for nodes of any name.
        component : bool, default False
            True if a component container loads the node. The costmaps, which their servers start,
            are merged in the same way in either case.
        """
        values: dict[str, ParameterValue] = {}
        for sections in self._group_sections():
            for parameter in merge_sections(sections):
                fits = parameter.section.matches_node(
                    f"{self._namespace_of_file(parameter.file)}/{node}"
                )
                if fits and (shared or not parameter.section.is_shared):
                    values[".".join(parameter.path)] = parameter
        if component and node not in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for at, file in enumerate(self.files):
                values |= read_component_values(at, file, node)
        return values

    def read_node_parameters(
        self, node: str, *, shared: bool = True, component: bool = False
    ) -> Parameters:
        """Return the parameters of a node by their names in ROS, such as GridBased.plugin.

        Parameters
        ----------
        node, shared, component
            Those of `values`.
        """
        values = self.find_values(node, shared=shared, component=component)
        return {name: parameter.value for name, parameter in values.items()}

    def find_conflicts(self, node: str) -> list[ParameterConflict]:
        """List parameters of a node whose values for a wildcard and for a name differ.

        A component container gives them a different value, or a later file's wildcard replaces the
        value for the node's name.

        Parameters
        ----------
        node : str
            Name of the node.
        """
        standalone, loaded = self.find_values(node), self.find_values(node, component=True)
        conflicts = []
        for name, winner in standalone.items():
            rivals = [
                rival for rival in self._find_all_values(node, name) if rival.value != winner.value
            ]
            specific_rivals = [rival for rival in rivals if not rival.section.is_shared]
            hidden = winner.section.is_shared and any(
                rival.file < winner.file for rival in specific_rivals
            )
            if loaded[name].value != winner.value or hidden:
                conflicts.append(
                    ParameterConflict(name, self._conflict_text(node, name, loaded[name]))
                )
        return conflicts

    def locate_parameter(self, node: str, name: str) -> tuple[int, tuple[str, ...]]:
        """Return file index and keys of a parameter's effective value, or of the place to add it.

        Parameters
        ----------
        node, name : str
            Names of the node and the parameter.
        """
        if value := self.find_values(node).get(name):
            return value.file, value.keys
        at = self.find_file_index(node) or self.find_file_index(GLOBAL_COSTMAP) or 0
        sections = [section for index, section in self.find_sections(node) if index == at]
        unshared_keys = [section.keys for section in sections if not section.is_shared]
        exact_keys = [section.keys for section in sections if "*" not in section.name]
        new = tuple(filter(None, f"{self._namespace_of_file(at)}/{node}".split("/")))
        return at, (*(exact_keys or unshared_keys or [new])[-1], PARAMETERS, *name.split("."))

    def find_file_index(self, node: str) -> int | None:
        """Return the index of the file with most parameters of a node; None if no file names it.

        Parameters
        ----------
        node : str
            Name of the node.
        """
        counts: Counter[int] = Counter()
        for at, section in self.find_sections(node):
            if not section.is_shared:
                counts[at] += 1 + sum(1 for _ in iterate_leaves(section.parameters))
        return max(sorted(counts), key=lambda at: counts[at]) if counts else None

    def read_names(self, node: str, name: str, default: Sequence[str] = ()) -> list[str]:
        """Return the list of names in a parameter of a node.

        Parameters
        ----------
        node, name : str
            Names of the node and the parameter.
        default : sequence of str, default ()
            The names if the parameter is missing.

        Raises
        ------
        LocplanError
            If the parameter is no list of names.
        """
        name_list = self.read_node_parameters(node).get(name) or list(default)
        if not isinstance(name_list, list) or not all(isinstance(text, str) for text in name_list):
            raise LocplanError(f"{name} must be a list of names, not {short_repr(name_list)}")
        return list(name_list)

    def with_values(self, node: str, values: Mapping[str, Any]) -> Nav2Parameters:
        """Return the parameters with some values of a node replaced, in place.

        Parameters
        ----------
        node : str
            Name of the node.
        values : mapping
            Values by the names of the parameters.
        """
        if not self.files:
            return Nav2Parameters((ParameterFile(),)).with_values(node, values)
        files = [replace(file, content=copy.deepcopy(file.content)) for file in self.files]
        for name, value in values.items():
            at, (*path, last) = self.locate_parameter(node, name)
            inner = files[at].content
            for key in path:
                if not isinstance(inner.get(key), dict):
                    inner[key] = {}
                inner = inner[key]
            inner[last] = value
        return Nav2Parameters(tuple(files))

    def merge_files(self) -> Nav2Parameters:
        """Return the same parameters as one file without a path."""
        if len(self.files) == 1:
            return self
        return Nav2Parameters((ParameterFile(None, self._merged_content(), self.namespace),))

    def _merged_content(self) -> Parameters:
        content: Parameters = {}
        for sections in self._group_sections():
            keys = sections[0][1].keys
            for parameter in {
                ".".join(value.path): value for value in merge_sections(sections)
            }.values():
                path: tuple[str, ...] = (*keys, PARAMETERS, *parameter.path)
                inner = content
                for key in path[:-1]:
                    inner = inner.setdefault(key, {})
                inner[path[-1]] = copy.deepcopy(parameter.value)
        return content

    def _namespace_of_file(self, file_index: int) -> str:
        """Return the robot's namespace in a file."""
        return self.files[file_index].namespace if self.files else ""

    def _group_sections(self) -> list[list[tuple[int, NodeSection]]]:
        """Group all entries, with the indices of their files, by name.

        The order of the names is the order of their first entries, as in rcl_yaml_param_parser.
        """
        groups: dict[str, list[tuple[int, NodeSection]]] = {}
        for at, file in enumerate(self.files):
            for section in filter(file.is_for_robot, file.sections):
                groups.setdefault(file.relative_name(section), []).append((at, section))
        return list(groups.values())

    def _find_all_values(self, node: str, name: str) -> list[ParameterValue]:
        """Return all values of a node's parameter in the files."""
        return [
            parameter
            for at, section in self.find_sections(node)
            for parameter in list_section_values(at, section)
            if ".".join(parameter.path) == name
        ]

    def _conflict_text(self, node: str, name: str, loaded: ParameterValue) -> str:
        """Return the values of a parameter and their files in one sentence."""
        stands = [
            f"{short_repr(parameter.value)} for {parameter.section.name}"
            f" ({self.files[parameter.file].title})"
            for parameter in sorted(
                self._find_all_values(node, name), key=lambda parameter: parameter.file
            )
        ]
        winner = self.find_values(node)[name]
        choice_text = f"ROS takes {short_repr(winner.value)}"
        if loaded.value != winner.value:
            choice_text += f", or {short_repr(loaded.value)} in a component container"
        return f"{node}: {name} is {', '.join(stands)}; {choice_text}"


MAX_BYTES = 2**17
"""Maximum size of a file, of which PyYAML reads some 50 KB a second."""
MAX_VALUES = 100_000
"""Maximum number of values in a file, those that aliases stand for included."""
REMEDY = "give Nav2's parameters"


def read_parameters(*paths: str | os.PathLike[str] | None) -> Nav2Parameters:
    """Read the parameters in files of Nav2; without a file there are none.

    As in ROS, names are texts, and values are numbers, true, false, texts, or lists of them; a
    value of another YAML type, such as a date, is a text. Aliases are written out.

    Parameters
    ----------
    *paths : path or None
        The YAML files, of at most 128 KiB, with parameters of nodes of Nav2 such as amcl; later
        ones replace single parameters. If a file has several robots, append the namespace of one:
        "nav2.yaml:robot1", or "nav2.yaml:/" for the robot without one.

    Returns
    -------
    Nav2Parameters
        The content, and the parameters of each node of the robot.

    Raises
    ------
    LocplanError
        If a file cannot be read, is no parameter file, or has several robots of which none is
        named; or if the files have no parameters of Nav2's nodes, or are of different robots.
    """
    files, robots = [], []
    for path in paths:
        if path is not None:
            file, robot = split_robot_name(path)
            content = parse_yaml_values(file, read_content(file, MAX_BYTES, REMEDY), REMEDY)
            files.append(ParameterFile(file, content))
            robots.append(robot)
    return resolve_parameters(files, robots) if files else Nav2Parameters()


def split_robot_name(path: str | os.PathLike[str]) -> tuple[Path, str | None]:
    """Split a path into the file and the robot's name after a colon, if there is one.

    Parameters
    ----------
    path : path
        The file, or "FILE:NAMESPACE".

    Raises
    ------
    LocplanError
        If the path can name no file.
    """
    file = check_file_path("a file of Nav2's parameters", path)
    name, colon, robot = str(file).rpartition(":")
    if colon and not file.exists() and Path(name).is_file():
        return Path(name), robot
    return file, None


def resolve_parameters(
    files: Sequence[ParameterFile], robots: Sequence[str | None] = (None,)
) -> Nav2Parameters:
    """Resolve the parameters in files for the robots that their paths name."""
    for file in files:
        remedy = f"{REMEDY} of ROS 2, or single values by --set, as --set alpha1=0.1"
        if (key := _find_ros1_name(file)) is not None:
            fault = f"holds parameters of ROS 1 ({short_repr(key)}), which has no {PARAMETERS}"
            raise LocplanError(f"{file.path}: {fault}; {remedy}")
        if (node := _find_bare_node(file)) is not None:
            fault = f"{short_repr(node)} holds no {PARAMETERS}, as in ROS 1"
            raise LocplanError(f"{file.path}: {fault}; {remedy}")
        for section in file.sections:
            if not isinstance(section.parameters, dict):
                raise LocplanError(
                    f"{file.path}: {short_repr(section.name)} holds no {PARAMETERS}; {REMEDY}"
                )
    spaces = _find_namespaces(files, robots)
    robot_files = (
        replace(file, namespace=space) for file, space in zip(files, spaces, strict=True)
    )
    parameters = Nav2Parameters(tuple(robot_files))
    first = (
        files[0].path
        if len(files) == 1
        else ", ".join(str(parameter_file.path) for parameter_file in files)
    )
    if not any(parameters.find_sections(node) for node in NODES):
        namespace_text = f" in {parameters.namespace}" if parameters.namespace else ""
        raise LocplanError(
            f"{first}: has no parameters of Nav2's nodes{namespace_text}; {REMEDY} (as"
            " FILE:NAMESPACE where"
            " the robot has one), or a robot's file, which has an entry 'robot'"
        )
    for node in (GLOBAL_COSTMAP, PLANNER_SERVER):
        for name in ("plugins", "filters", "planner_plugins"):
            try:
                parameters.read_names(node, name)
            except LocplanError as error:
                at, _ = parameters.locate_parameter(node, name)
                raise LocplanError(f"{files[at].path}: {error}") from None
    return parameters


ROS1_NAMES = {
    *("base_global_planner", "base_local_planner", "costmap_common_params", "kld_err", "kld_z"),
    *("laser_max_beams", "laser_sigma_hit", "laser_z_hit", "laser_z_rand", "move_base"),
    *("obstacle_range", "odom_alpha1", "odom_model_type", "raytrace_range", "static_map"),
    *("DWAPlannerROS", "NavfnROS", "TebLocalPlannerROS", "TrajectoryPlannerROS"),
}
"""Names of parameters and nodes that amcl and move_base have in ROS 1 only."""


def _find_ros1_name(file: ParameterFile) -> str | None:
    """Return a name that only files of ROS 1 have, or None."""
    if next(file.sections, None) is not None:
        return None
    contents = [file.content]
    while contents:
        for key, value in contents.pop().items():
            if key in ROS1_NAMES:
                return key
            if isinstance(value, dict):
                contents.append(value)
    return None


def _find_bare_node(file: ParameterFile) -> str | None:
    """Return a node of Nav2 in a file without any `ros__parameters`, or None."""
    if next(file.sections, None) is not None:
        return None
    names = {node.partition("/")[0] for node in NODES}
    return next((name for name in file.content if name.strip("/") in names), None)


def _find_namespaces(files: Sequence[ParameterFile], robots: Sequence[str | None]) -> list[str]:
    """Return the robot's namespace in each file: the requested one, or the only one."""
    robots_in_files = [_list_robot_namespaces(file) for file in files]
    requested = [None if robot is None else f"/{robot.strip('/')}".rstrip("/") for robot in robots]
    accepted = {namespace for namespace in requested if namespace is not None}
    accepted = accepted or {namespace[0] for namespace in robots_in_files if len(namespace) == 1}
    spaces: list[str | None] = []
    for file, robot, names in zip(files, requested, robots_in_files, strict=True):
        fits = [namespace for namespace in names if namespace in accepted]
        if robot is None and len(names) > 1 and len(fits) != 1:
            robot_list = ", ".join(short_repr(namespace or "/") for namespace in names[:5])
            raise LocplanError(
                f"{file.path}: has several robots, {robot_list}; name one, as FILE:NAMESPACE"
            )
        if robot is not None and names and robot not in names:
            robot_list = ", ".join(short_repr(namespace or "/") for namespace in names[:5])
            raise LocplanError(
                f"{file.path}: has no robot {short_repr(robot or '/')}; it has {robot_list}"
            )
        detected_space = fits[0] if len(names) > 1 else names[0] if names else None
        spaces.append(detected_space if robot is None else robot)
    different = {namespace for namespace in spaces if namespace is not None}
    if len(different) > 1 and None in requested:
        texts = (
            f"{file.path} has {short_repr(space or '/')}"
            for file, space in zip(files, spaces, strict=True)
            if space is not None
        )
        raise LocplanError(
            f"the files are of different robots: {', '.join(texts)}; name the robot of every file,"
            " as FILE:NAMESPACE"
        )
    common_space = next(iter(different)) if len(different) == 1 else ""
    return [common_space if space is None else space for space in spaces]


def _list_robot_namespaces(file: ParameterFile) -> list[str]:
    """List the namespaces of the robots in a file."""
    names = {robot.name for robot in file.sections}
    nodes = {(f"/{name.strip('/')}", f"/{node}") for name in names for node in NODES}
    robots = sorted({name.removesuffix(node) for name, node in nodes if name.endswith(node)})
    return [robot for robot in robots if "*" not in robot]


def parse_yaml_values(file: Path, content: bytes, remedy: str) -> Parameters:
    """Parse a file's YAML into values by name, as ROS reads them; empty if it is no mapping."""
    root = compose_yaml(file, content, remedy)
    try:
        values = None if root is None else _YamlValueReader().read_node(root)
    except (OverflowError, RecursionError):
        fault = f"its aliases stand for over {MAX_VALUES} values"
        raise make_map_error(file, fault, "write out what they stand for") from None
    return values if isinstance(values, dict) else {}


class _YamlValueReader:
    """A reader of YAML nodes; an OverflowError at more than `MAX_VALUES` values."""

    def __init__(self) -> None:
        self.count = 0

    def read_node(self, node: Any) -> Any:
        """Return the value of a node and all nodes in it."""
        self.count += 1
        if self.count > MAX_VALUES:
            raise OverflowError
        if node.id == "sequence":
            return [self.read_node(child) for child in node.value]
        if node.id == "mapping":
            return self._read_mapping(node)
        if node.tag == "tag:yaml.org,2002:null":
            return None
        if node.style is None and node.value in ROS_BOOLEANS:
            return ROS_BOOLEANS[node.value]
        if node.style is None and ROS_NUMBER.fullmatch(node.value):
            return float(node.value)
        value = parse_scalar(node)
        too_long = isinstance(value, int) and not -(2**63) <= value < 2**63
        return str(node.value) if too_long else value

    def _read_mapping(self, node: Any) -> Parameters:
        """Return a mapping node as a dict."""
        direct_values: Parameters = {}
        merged: Parameters = {}
        for key, value in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                for source in reversed(value.value if value.id == "sequence" else [value]):
                    content = self.read_node(source)  # of several the first one counts
                    merged |= content if isinstance(content, dict) else {}
            else:
                name = str(key.value) if key.id == "scalar" else "?"
                direct_values[name] = _merge_values(direct_values.get(name), self.read_node(value))
        return merged | direct_values


def _merge_values(first: Any, then: Any) -> Any:
    """Return the later of two values of a name; two mappings are merged, as in ROS."""
    if not (isinstance(first, dict) and isinstance(then, dict)):
        return then
    return first | {name: _merge_values(first.get(name), value) for name, value in then.items()}

"""Reading parameter files of ROS 2's Nav2."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from locplan._util.checks import file_path, shown
from locplan._util.reading import ROS_BOOLEANS, ROS_NUMBER, compose, fault_of, read_content, scalar
from locplan.errors import LocplanError
from locplan.robots._parameter_entries import PARAMETERS, ParameterFile, Parameters
from locplan.robots._parameters import GLOBAL_COSTMAP, NODES, PLANNER_SERVER, Nav2Parameters

MAX_BYTES = 2**17
"""Maximum size of a file, of which PyYAML reads some 50 KB a second."""
MAX_VALUES = 100_000
"""Maximum number of values in a file, those that aliases stand for included."""
REMEDY = "give Nav2's parameters"


def read_parameters(*paths: str | os.PathLike[str] | None) -> Nav2Parameters:
    """Read the parameters in files of Nav2; without a file there are none.

    As in ROS, names are texts, and values are numbers, true, false, texts, or lists of them; what
    YAML makes something else of, such as a date, is a text. Aliases are written out.

    Parameters
    ----------
    *paths : path or None
        The YAML files, of at most 128 KiB, with parameters of nodes of Nav2 such as amcl; later
        ones replace single parameters. Where a file has several robots, the namespace of one
        follows: "nav2.yaml:robot1", or "nav2.yaml:/" for the robot without one.

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
            file, robot = file_and_robot(path)
            content = values_in(file, read_content(file, MAX_BYTES, REMEDY), REMEDY)
            files.append(ParameterFile(file, content))
            robots.append(robot)
    return parameters_of(files, robots) if files else Nav2Parameters()


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


def parameters_of(
    files: Sequence[ParameterFile], robots: Sequence[str | None] = (None,)
) -> Nav2Parameters:
    """Parameters in files, with the robots that their paths name; see `read_parameters`."""
    for file in files:
        remedy = f"{REMEDY} of ROS 2, or single values by --set, as --set alpha1=0.1"
        if (key := _ros1_key(file)) is not None:
            fault = f"holds parameters of ROS 1 ({shown(key)}), which has no {PARAMETERS}"
            raise LocplanError(f"{file.path}: {fault}; {remedy}")
        if (node := _bare_node(file)) is not None:
            fault = f"{shown(node)} holds no {PARAMETERS}, as in ROS 1"
            raise LocplanError(f"{file.path}: {fault}; {remedy}")
        for entry in file.entries:
            if not isinstance(entry.parameters, dict):
                raise LocplanError(
                    f"{file.path}: {shown(entry.name)} holds no {PARAMETERS}; {REMEDY}"
                )
    spaces = _namespaces(files, robots)
    named = (replace(file, namespace=space) for file, space in zip(files, spaces, strict=True))
    parameters = Nav2Parameters(tuple(named))
    first = files[0].path if len(files) == 1 else ", ".join(str(each.path) for each in files)
    if not any(parameters.entries(node) for node in NODES):
        where = f" in {parameters.namespace}" if parameters.namespace else ""
        raise LocplanError(
            f"{first}: has no parameters of Nav2's nodes{where}; {REMEDY} (as FILE:NAMESPACE where"
            " the robot has one), or a robot's file, which has an entry 'robot'"
        )
    for node in (GLOBAL_COSTMAP, PLANNER_SERVER):
        for name in ("plugins", "filters", "planner_plugins"):
            try:
                parameters.names(node, name)
            except LocplanError as error:
                at, _ = parameters.place(node, name)
                raise LocplanError(f"{files[at].path}: {error}") from None
    return parameters


ROS1_NAMES = {
    *("base_global_planner", "base_local_planner", "costmap_common_params", "kld_err", "kld_z"),
    *("laser_max_beams", "laser_sigma_hit", "laser_z_hit", "laser_z_rand", "move_base"),
    *("obstacle_range", "odom_alpha1", "odom_model_type", "raytrace_range", "static_map"),
    *("DWAPlannerROS", "NavfnROS", "TebLocalPlannerROS", "TrajectoryPlannerROS"),
}
"""Names of parameters and nodes that amcl and move_base have in ROS 1 only."""


def _ros1_key(file: ParameterFile) -> str | None:
    """A name by which a file is one of ROS 1, or None."""
    if next(file.entries, None) is not None:
        return None
    contents = [file.content]
    while contents:
        for key, value in contents.pop().items():
            if key in ROS1_NAMES:
                return key
            if isinstance(value, dict):
                contents.append(value)
    return None


def _bare_node(file: ParameterFile) -> str | None:
    """A node of Nav2 in a file without any `ros__parameters`, or None."""
    if next(file.entries, None) is not None:
        return None
    names = {node.partition("/")[0] for node in NODES}
    return next((name for name in file.content if name.strip("/") in names), None)


def _namespaces(files: Sequence[ParameterFile], robots: Sequence[str | None]) -> list[str]:
    """Namespace of the robot in each file: the one that is named, or the only one."""
    known = [_robots_in(file) for file in files]
    asked = [None if robot is None else f"/{robot.strip('/')}".rstrip("/") for robot in robots]
    told = {each for each in asked if each is not None}
    told = told or {each[0] for each in known if len(each) == 1}
    spaces: list[str | None] = []
    for file, robot, names in zip(files, asked, known, strict=True):
        fits = [each for each in names if each in told]
        if robot is None and len(names) > 1 and len(fits) != 1:
            listed = ", ".join(shown(each or "/") for each in names[:5])
            raise LocplanError(
                f"{file.path}: has several robots, {listed}; name one, as FILE:NAMESPACE"
            )
        if robot is not None and names and robot not in names:
            listed = ", ".join(shown(each or "/") for each in names[:5])
            raise LocplanError(f"{file.path}: has no robot {shown(robot or '/')}; it has {listed}")
        found = fits[0] if len(names) > 1 else names[0] if names else None
        spaces.append(found if robot is None else robot)
    different = {each for each in spaces if each is not None}
    if len(different) > 1 and None in asked:
        texts = (
            f"{file.path} has {shown(space or '/')}"
            for file, space in zip(files, spaces, strict=True)
            if space is not None
        )
        raise LocplanError(
            f"the files are of different robots: {', '.join(texts)}; name the robot of every file,"
            " as FILE:NAMESPACE"
        )
    usual = next(iter(different)) if len(different) == 1 else ""
    return [usual if space is None else space for space in spaces]


def _robots_in(file: ParameterFile) -> list[str]:
    """Namespaces of the robots that a file names."""
    names = {each.name for each in file.entries}
    nodes = {(f"/{name.strip('/')}", f"/{node}") for name in names for node in NODES}
    robots = sorted({name.removesuffix(node) for name, node in nodes if name.endswith(node)})
    return [each for each in robots if "*" not in each]


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

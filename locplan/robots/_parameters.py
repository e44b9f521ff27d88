"""The parameters of a node of Nav2 that several parameter files give, as ROS merges them.

`read_parameters` reads the files in the order of a launch; the `Nav2Parameters` that it returns
answer all questions on them. `of` returns the parameters of a node as rcl_yaml_param_parser and
rclcpp's parameter_map resolve them: all files go into one list of entries. A later file replaces
single parameters; an entry keeps the place at which its name first stood in any file; of the
entries that fit a node, the last one that has a parameter counts, with wildcards or without.

A node that a component container loads has its parameters from launch_ros
(to_parameters_list.py): for every file those of "/**", then those of the node's name. It takes
what these do not name from the container, which merges as above. ``of(node, component=True)``
follows that. `conflicts` names the parameters of which both depend on the place of a wildcard.

The exporter asks the same object and writes with it:

- `of` and `names` for the values of the global costmap and the planner server,
- `changed` for other values: it edits the file in which the value in force stands, and puts a new
  parameter into the file that has most of the node (`file_of`),
- `edited_files` for the text of each file that `changed` has edited, with its
  comments and layout,
- `merged` for the same parameters in one file, since nav2_bringup takes a single ``params_file``.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from locplan._util.checks import shown
from locplan.errors import LocplanError
from locplan.robots._parameter_entries import (
    PARAMETERS,
    Entry,
    ParameterFile,
    Parameters,
    Value,
    component_values,
    leaves,
    merged_values,
    values_in_entry,
)

AMCL, PLANNER_SERVER = "amcl", "planner_server"
GLOBAL_COSTMAP, LOCAL_COSTMAP = (f"{each}_costmap/{each}_costmap" for each in ("global", "local"))
NODES = (AMCL, PLANNER_SERVER, "controller_server", GLOBAL_COSTMAP, LOCAL_COSTMAP)
"""Nodes of Nav2; the parameter files have parameters of at least one of them."""


class Conflict(NamedTuple):
    """A parameter whose value depends on the place of a wildcard."""

    name: str
    """Name of the parameter."""
    text: str
    """The values and the files that have them, in one sentence for people."""


@dataclass(frozen=True)
class Nav2Parameters:
    """The parameters of one robot's nodes in files of Nav2, as ROS resolves them.

    A node has those of all entries whose name fits its own, "/**" and "/*" included. A launch file
    that rewrites the parameters, as nav2_bringup's does, first sorts the entries by name: where
    those with wildcards stand first in the file, the result is the same.
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

    def entries(self, node: str) -> list[tuple[int, Entry]]:
        """The entries for a node and the indices of their files, in the order in which they count.

        Parameters
        ----------
        node : str
            Name of the node, such as amcl or global_costmap/global_costmap.
        """
        fits = [
            [(at, each) for at, each in entries if each.is_for(f"{self._space(at)}/{node}")]
            for entries in self._by_name()
        ]
        return [each for entries in fits for each in entries]

    def values(
        self, node: str, *, shared: bool = True, component: bool = False
    ) -> dict[str, Value]:
        """Values in force of a node's parameters, with their places.

        Parameters
        ----------
        node : str
            Name of the node.
        shared : bool, default True
            Whether those for nodes of any name are among them.
        component : bool, default False
            Whether a component container loads the node. The costmaps, which their servers start,
            are merged in the same way in either case.
        """
        values: dict[str, Value] = {}
        for entries in self._by_name():
            for each in merged_values(entries):
                fits = each.entry.is_for(f"{self._space(each.file)}/{node}")
                if fits and (shared or not each.entry.is_shared):
                    values[".".join(each.path)] = each
        if component and node not in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for at, file in enumerate(self.files):
                values |= component_values(at, file, node)
        return values

    def of(self, node: str, *, shared: bool = True, component: bool = False) -> Parameters:
        """Parameters of a node by their names in ROS, such as GridBased.plugin.

        Parameters
        ----------
        node, shared, component
            Those of `values`.
        """
        values = self.values(node, shared=shared, component=component)
        return {name: each.value for name, each in values.items()}

    def conflicts(self, node: str) -> list[Conflict]:
        """Parameters of a node of which a wildcard and a name have different values.

        They are those that a component container gives another value, and those of which a later
        file's wildcard replaces the value for the node's name.

        Parameters
        ----------
        node : str
            Name of the node.
        """
        alone, loaded = self.values(node), self.values(node, component=True)
        conflicts = []
        for name, winner in alone.items():
            rivals = [each for each in self._stands(node, name) if each.value != winner.value]
            named = [each for each in rivals if not each.entry.is_shared]
            hidden = winner.entry.is_shared and any(each.file < winner.file for each in named)
            if loaded[name].value != winner.value or hidden:
                conflicts.append(Conflict(name, self._conflict_text(node, name, loaded[name])))
        return conflicts

    def place(self, node: str, name: str) -> tuple[int, tuple[str, ...]]:
        """The file's index and the keys of the value in force, or of where it belongs.

        Parameters
        ----------
        node, name : str
            Names of the node and the parameter.
        """
        if value := self.values(node).get(name):
            return value.file, value.keys
        at = self.file_of(node) or 0
        entries = [each for index, each in self.entries(node) if index == at]
        own = [each.keys for each in entries if not each.is_shared]
        alone = [each.keys for each in entries if "*" not in each.name]
        new = tuple(filter(None, f"{self._space(at)}/{node}".split("/")))
        return at, (*(alone or own or [new])[-1], PARAMETERS, *name.split("."))

    def file_of(self, node: str) -> int | None:
        """Index of the file that has most parameters of a node, or None if no file names the node.

        Parameters
        ----------
        node : str
            Name of the node.
        """
        counts: Counter[int] = Counter()
        for at, entry in self.entries(node):
            if not entry.is_shared:
                counts[at] += 1 + sum(1 for _ in leaves(entry.parameters))
        return max(sorted(counts), key=lambda at: counts[at]) if counts else None

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
        if not self.files:
            return Nav2Parameters((ParameterFile(),)).changed(node, values)
        files = [replace(each, content=copy.deepcopy(each.content)) for each in self.files]
        for name, value in values.items():
            at, (*path, last) = self.place(node, name)
            inner = files[at].content
            for key in path:
                if not isinstance(inner.get(key), dict):
                    inner[key] = {}
                inner = inner[key]
            inner[last] = value
        return Nav2Parameters(tuple(files))

    def merged(self) -> Nav2Parameters:
        """The same parameters in one file, which no path names."""
        if len(self.files) == 1:
            return self
        return Nav2Parameters((ParameterFile(None, self._merged_content(), self.namespace),))

    def _merged_content(self) -> Parameters:
        content: Parameters = {}
        for entries in self._by_name():
            keys = entries[0][1].keys
            for each in {".".join(value.path): value for value in merged_values(entries)}.values():
                path: tuple[str, ...] = (*keys, PARAMETERS, *each.path)
                inner = content
                for key in path[:-1]:
                    inner = inner.setdefault(key, {})
                inner[path[-1]] = copy.deepcopy(each.value)
        return content

    def _space(self, at: int) -> str:
        return self.files[at].namespace if self.files else ""

    def _by_name(self) -> list[list[tuple[int, Entry]]]:
        """All entries with the indices of their files, those of the same name together.

        A name counts where it first stands in any file, as in rcl_yaml_param_parser.
        """
        entries: dict[str, list[tuple[int, Entry]]] = {}
        for at, file in enumerate(self.files):
            for entry in filter(file.is_for_robot, file.entries):
                entries.setdefault(file.relative_name(entry), []).append((at, entry))
        return list(entries.values())

    def _stands(self, node: str, name: str) -> list[Value]:
        """All values of a node's parameter that stand in the files."""
        return [
            each
            for at, entry in self.entries(node)
            for each in values_in_entry(at, entry)
            if ".".join(each.path) == name
        ]

    def _conflict_text(self, node: str, name: str, loaded: Value) -> str:
        stands = [
            f"{shown(each.value)} for {each.entry.name} ({self.files[each.file].title})"
            for each in sorted(self._stands(node, name), key=lambda each: each.file)
        ]
        own = self.values(node)[name]
        taken = f"ROS takes {shown(own.value)}"
        if loaded.value != own.value:
            taken += f", or {shown(loaded.value)} in a component container"
        return f"{node}: {name} is {', '.join(stands)}; {taken}"

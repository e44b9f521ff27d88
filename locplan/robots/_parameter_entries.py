"""Entries of a parameter file, and the values that ROS takes from several of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

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
    def entries(self) -> Iterator[Entry]:
        """All entries in the order in which they stand."""
        return walked_entries(self.content, ())

    def is_for_robot(self, entry: Entry) -> bool:
        """Return whether an entry can be for nodes in the robot's namespace."""
        namespace = self.namespace.strip("/")
        inside = f"{entry.name.strip('/')}/".startswith(f"{namespace}/")
        return not namespace or inside or "*" in entry.name

    def relative_name(self, entry: Entry) -> str:
        """Name of an entry as seen from the robot's namespace."""
        slash = "/" if entry.name.startswith("/") else ""
        inner = f"{entry.name.strip('/')}/".removeprefix(f"{self.namespace.strip('/')}/")
        return slash + inner.strip("/")


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


class Value(NamedTuple):
    """A value of a parameter, and its place in the files."""

    value: Any
    file: int
    """Index of the file in `Nav2Parameters.files`."""
    entry: Entry
    path: tuple[str, ...]
    """The keys that lead from the entry to the value."""

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that lead to the value in its file."""
        return (*self.entry.keys, PARAMETERS, *self.path)


def walked_entries(content: Parameters, keys: tuple[str, ...]) -> Iterator[Entry]:
    for key, value in content.items():
        if key == PARAMETERS and keys:
            yield Entry(keys, "/".join(each.removesuffix("/") for each in keys), value)
        elif isinstance(value, dict):
            yield from walked_entries(value, (*keys, key))


def values_in_entry(at: int, entry: Entry) -> Iterator[Value]:
    """All values in an entry."""
    for path, value in leaves(entry.parameters):
        yield Value(value, at, entry, path)


def merged_values(entries: Sequence[tuple[int, Entry]]) -> list[Value]:
    """The values of entries of one name, in the order in which later ones replace earlier ones.

    rcl_yaml_param_parser replaces the first value of a plain name, but appends that of a name in
    a mapping (find_parameter in parse.c looks for the mapping's name).
    """
    values: list[Value] = []
    first: dict[str, int] = {}
    for at, entry in entries:
        for each in values_in_entry(at, entry):
            name = ".".join(each.path)
            if len(each.path) == 1 and name in first:
                values[first[name]] = each
            else:
                first.setdefault(name, len(values))
                values.append(each)
    return values


def component_values(at: int, file: ParameterFile, node: str) -> dict[str, Value]:
    """The values that launch_ros takes from a file for a node in a component container.

    Those of its name replace whole parts of those of "/**", such as all settings of a plugin.
    """
    entries = {"/".join(key.lstrip("/") for key in each.keys): each for each in file.entries}
    parts: dict[str, list[Value]] = {}
    for name in ("**", f"{file.namespace}/{node}".strip("/")):
        if name in entries:
            own: dict[str, list[Value]] = {}
            for each in values_in_entry(at, entries[name]):
                own.setdefault(each.path[0], []).append(each)
            parts |= own
    return {".".join(each.path): each for values in parts.values() for each in values}


def leaves(
    parameters: Parameters, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The keys that lead to each value, and the value."""
    for key, value in parameters.items():
        if isinstance(value, dict):
            yield from leaves(value, (*above, key))
        else:
            yield (*above, key), value

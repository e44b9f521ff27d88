"""Changes of single values in a parameter file of Nav2 that leave all else as it is."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from locplan._util.checks import file_path
from locplan.errors import LocplanError
from locplan.maps._ros_parameters import (
    MAX_BYTES,
    REMEDY,
    parameters_of,
    read_parameters,
)
from locplan.maps._yaml import compose, read_content

if TYPE_CHECKING:
    import yaml

BOM = "\ufeff"
ALIAS = re.compile(r"\s*:\s*(\*[^\s,\[\]{}]+)")
ANCHOR = re.compile(r"&[^\s,\[\]{}]+\s*")


def edited_parameters(
    path: str | os.PathLike[str], node: str, values: Mapping[str, float | str | bool]
) -> bytes:
    """Content of a parameter file with other values of one node's parameters.

    Comments and layout stay; parameters that are missing are inserted above the first one.

    Parameters
    ----------
    path : path
        The file, which `read_parameters` reads.
    node : str
        Name of the node at the top of the file, such as amcl.
    values : mapping
        Values by the names of the parameters.

    Raises
    ------
    LocplanError
        If the file cannot be read, or if anchors, aliases or tags make one value stand for
        several, so that it cannot be changed alone.
    """
    import yaml

    before = read_parameters(path)
    file = file_path("a file of Nav2's parameters", path)
    content = read_content(file, MAX_BYTES, REMEDY)
    text = content.decode("utf-8-sig")
    root = compose(file, content, REMEDY)
    place = _value(_value(root, node), "ros__parameters")
    fault = LocplanError(
        f"{path}: {node}: its values cannot be changed alone; write out its anchors and aliases"
    )
    if not isinstance(place, yaml.MappingNode):
        raise fault
    edits = []
    missing = {}
    for name, value in values.items():
        found = _entry(place, name)
        if found is None:
            missing[name] = value
        else:
            edits.append(_replacement(text, *found, value))
    if missing:
        edits.append(_insertion(text, place, missing))
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    made = (BOM if content.startswith(BOM.encode()) else "").encode() + text.encode()
    wanted = {**before, node: {**before[node]}}
    wanted[node]["ros__parameters"] = {**before[node]["ros__parameters"], **values}
    try:
        read = parameters_of(file, made)
    except LocplanError:
        raise fault from None
    if read != wanted:
        raise fault
    return made


def scalar_text(value: float | str | bool) -> str:
    """Text of a value that YAML and ROS read as the same value of the same type."""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = str(value) if isinstance(value, str) else repr(value)
    if isinstance(value, float) and "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text


def _entry(mapping: Any, name: str) -> tuple[yaml.Node, yaml.Node] | None:
    """Key and value of the last entry of this name."""
    import yaml

    if not isinstance(mapping, yaml.MappingNode):
        return None
    found = [each for each in mapping.value if each[0].value == name]
    return found[-1] if found else None


def _value(mapping: Any, name: str) -> yaml.Node | None:
    found = _entry(mapping, name)
    return None if found is None else found[1]


def _replacement(
    text: str, key: yaml.Node, value: yaml.Node, new: float | str | bool
) -> tuple[int, int, str]:
    """Beginning, end and new text of a value."""
    start, end = value.start_mark.index, value.end_mark.index
    if start < key.end_mark.index:  # an alias, whose node stands where its anchor is
        alias = ALIAS.match(text, key.end_mark.index)
        assert alias is not None
        return alias.start(1), alias.end(1), scalar_text(new)
    anchor = ANCHOR.match(text, start)
    quote = text[start] if text[start : start + 1] in ("'", '"') else ""
    quote = quote if isinstance(new, str) else ""
    written = f"{quote}{scalar_text(new)}{quote}"
    return (anchor.end() if anchor else start), end, written


def _insertion(
    text: str, mapping: yaml.MappingNode, values: Mapping[str, float | str | bool]
) -> tuple[int, int, str]:
    """Where missing parameters are inserted, twice, and their text."""
    entries = [f"{name}: {scalar_text(value)}" for name, value in values.items()]
    if mapping.flow_style:
        at = text.index("{", mapping.start_mark.index) + 1
        return at, at, ", ".join(entries) + (", " if mapping.value else "")
    first = mapping.value[0][0].start_mark
    indent = text[first.index - first.column : first.index]
    newline = "\r\n" if "\r\n" in text else "\n"
    return first.index, first.index, "".join(f"{entry}{newline}{indent}" for entry in entries)

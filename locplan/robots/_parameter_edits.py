"""Changes of single values in a parameter file of Nav2 that leave all else as it is."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from locplan._util.reading import compose, read_content, scalar_text
from locplan.errors import LocplanError
from locplan.robots._parameters import (
    MAX_BYTES,
    REMEDY,
    file_and_robot,
    parameters_of,
    read_parameters,
)

if TYPE_CHECKING:
    import yaml

Values = dict[str, float | str | bool]
"""Values by the names of their parameters."""


def edited_parameters(
    path: str | os.PathLike[str], node: str, values: Mapping[str, float | str | bool]
) -> bytes:
    """Content of a parameter file with other values of one node's parameters.

    They stand where the values in force stood; comments and layout stay. Parameters that are
    missing are inserted above the first one of an entry for this node, or in a new entry.

    Parameters
    ----------
    path : path
        The file, which `read_parameters` reads, and the robot in it.
    node : str
        Name of the node, such as amcl.
    values : mapping
        Values by the names of the parameters.

    Raises
    ------
    LocplanError
        If the file cannot be read, or if anchors, aliases or tags make one value stand for
        several, so that it cannot be changed alone.
    """
    before = read_parameters(path)
    file, robot = file_and_robot(path)
    content = read_content(file, MAX_BYTES, REMEDY)
    text = content.decode("utf-8-sig")
    root = compose(file, content, REMEDY)
    fault = LocplanError(
        f"{path}: {node}: its values cannot be changed alone; write out its anchors and aliases"
    )
    edits = []
    missing: dict[tuple[str, ...], Values] = {}
    for name, value in values.items():
        place = before.place(node, name)
        found = _found(root, place)
        if found is None:
            missing.setdefault(place[:-1], {})[place[-1]] = value
        else:
            edits.append(_replacement(text, *found, value))
    for keys, new in missing.items():
        edits.append(_insertion(text, root, keys, new))
    for start, end, new_text in sorted(edits, reverse=True):
        text = text[:start] + new_text + text[end:]
    made = text.encode("utf-8-sig" if content.startswith(b"\xef\xbb\xbf") else "utf-8")
    try:
        read = parameters_of(file, made, robot)
    except LocplanError:
        raise fault from None
    if read != before.changed(node, values):
        raise fault
    return made


def _found(mapping: Any, keys: Sequence[str]) -> tuple[yaml.Node, yaml.Node] | None:
    """Key and value at the end of keys, the last ones where a key stands several times."""
    import yaml

    if not (keys and isinstance(mapping, yaml.MappingNode)):
        return None
    first, *inner = keys
    for key, value in reversed(mapping.value):
        if key.value == first:
            found = _found(value, inner) if inner else (key, value)
            if found is not None:
                return found
    return None


def _replacement(
    text: str, key: yaml.Node, value: yaml.Node, new: float | str | bool
) -> tuple[int, int, str]:
    """Beginning, end and new text of a value."""
    start, end = value.start_mark.index, value.end_mark.index
    if start < key.end_mark.index:  # an alias, whose node stands where its anchor is
        alias = re.compile(r"\s*:\s*(\*[^\s,\[\]{}]+)").match(text, key.end_mark.index)
        assert alias is not None
        return alias.start(1), alias.end(1), scalar_text(new)
    anchor = re.compile(r"&[^\s,\[\]{}]+\s*").match(text, start)
    quote = text[start] if text[start : start + 1] in ("'", '"') else ""
    quote = quote if isinstance(new, str) else ""
    written = f"{quote}{scalar_text(new)}{quote}"
    return (anchor.end() if anchor else start), end, written


def _insertion(text: str, root: Any, keys: Sequence[str], values: Values) -> tuple[int, int, str]:
    """Where missing parameters are inserted, twice, and their text."""
    entries = [f"{name}: {scalar_text(value)}" for name, value in values.items()]
    while keys and _found(root, keys) is None:  # the mapping is missing, too
        *keys, key = keys
        entries = [f"{key}: {{{', '.join(entries)}}}"]
    found = _found(root, keys)
    mapping: Any = found[1] if found else root
    if mapping.flow_style:
        at = text.index("{", mapping.start_mark.index) + 1
        return at, at, ", ".join(entries) + (", " if mapping.value else "")
    first = mapping.value[0][0].start_mark
    indent = text[first.index - first.column : first.index]
    newline = "\r\n" if "\r\n" in text else "\n"
    return first.index, first.index, "".join(f"{entry}{newline}{indent}" for entry in entries)

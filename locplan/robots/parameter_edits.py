"""Edits of parameter files that preserve comments and layout."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from locplan._support.reading import compose_yaml, format_yaml_flow, read_content
from locplan.errors import LocplanError
from locplan.robots.parameters import (
    MAX_BYTES,
    REMEDY,
    Nav2Parameters,
    ParameterFile,
    parse_yaml_values,
    read_parameters,
)


def edit_parameters(
    path: str | os.PathLike[str], node: str, values: Mapping[str, float | str | bool]
) -> bytes:
    """Return the content of a parameter file with some parameters of a node replaced.

    Values are replaced in place; comments and layout stay. Missing parameters are inserted above
    the first one of an entry for this node, or in a new entry.

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
    after = before.with_values(node, values)
    return _edit_content(before.files[0], after.files[0])


def edit_files(before: Nav2Parameters, after: Nav2Parameters) -> dict[Path, bytes]:
    """Return the content of the files that differ between two sets of parameters.

    Parameters
    ----------
    before, after : Nav2Parameters
        The parameters in the files, and the same parameters with changed or added values.

    Raises
    ------
    LocplanError
        If a file cannot be read, or one value stands for several.
    """
    pairs = zip(before.files, after.files, strict=True)
    return {
        was.path: _edit_content(was, now)
        for was, now in pairs
        if was.path is not None and was.content != now.content
    }


def _edit_content(before: ParameterFile, after: ParameterFile) -> bytes:
    """Return the content of a file after its values have changed."""
    file = before.path
    assert file is not None
    content = read_content(file, MAX_BYTES, REMEDY)
    text = content.decode("utf-8-sig")
    root = compose_yaml(file, content, REMEDY)
    fault = LocplanError(
        f"{file}: its values cannot be changed alone; write out its anchors and aliases"
    )
    edits = []
    missing: dict[tuple[str, ...], Any] = {}
    for keys, value in _list_changed_values(before.content, after.content):
        node_pair = _find_last_pair(root, keys)
        if node_pair is None:
            missing.setdefault(keys[:-1], {})[keys[-1]] = value
        else:
            edits.append(_make_replacement(text, *node_pair, value))
    for keys, new in missing.items():
        edits.append(_make_insertion(text, root, keys, new))
    for start, end, new_text in sorted(edits, reverse=True):
        text = text[:start] + new_text + text[end:]
    edited = text.encode("utf-8-sig" if content.startswith(b"\xef\xbb\xbf") else "utf-8")
    try:
        read = parse_yaml_values(file, edited, REMEDY)
    except LocplanError:
        raise fault from None
    if read != after.content:
        raise fault
    return edited


def _list_changed_values(
    before: Mapping[str, Any], after: Mapping[str, Any], above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield keys and value of everything new or changed in a mapping of mappings."""
    for key, value in after.items():
        old_value, keys = before.get(key), (*above, key)
        if isinstance(old_value, dict) and isinstance(value, dict):
            yield from _list_changed_values(old_value, value, keys)
        elif key not in before or old_value != value:
            yield keys, value


def _find_last_pair(mapping: Any, keys: Sequence[str]) -> tuple[Any, Any] | None:
    """Return key node and value node at some keys; the last ones if a key occurs several times."""
    if not (keys and mapping is not None and mapping.id == "mapping"):
        return None
    first, *inner = keys
    for key, value in reversed(mapping.value):
        if key.value == first:
            node_pair = _find_last_pair(value, inner) if inner else (key, value)
            if node_pair is not None:
                return node_pair
    return None


def _make_replacement(text: str, key: Any, value: Any, new: Any) -> tuple[int, int, str]:
    """Return start, end and new text of a value."""
    start, end = value.start_mark.index, value.end_mark.index
    if value.id == "sequence" and not value.flow_style:  # which ends where the next thing begins
        return (
            text.index(":", key.end_mark.index) + 1,
            value.value[-1].end_mark.index,
            (f" {format_yaml_flow(new)}"),
        )
    if start < key.end_mark.index:  # an alias, whose node stands where its anchor is
        alias = re.compile(r"\s*:\s*(\*[^\s,\[\]{}]+)").match(text, key.end_mark.index)
        assert alias is not None
        return alias.start(1), alias.end(1), format_yaml_flow(new)
    anchor = re.compile(r"&[^\s,\[\]{}]+\s*").match(text, start)
    quote = text[start] if text[start : start + 1] in ("'", '"') else ""
    quote = quote if isinstance(new, str) else ""
    written = f"{quote}{new}{quote}" if quote else format_yaml_flow(new)
    return (anchor.end() if anchor else start), end, written


def _make_insertion(
    text: str, root: Any, keys: Sequence[str], values: Mapping[str, Any]
) -> tuple[int, int, str]:
    """Return the place of missing parameters, as start and end, and their text."""
    lines = [f"{name}: {format_yaml_flow(value)}" for name, value in values.items()]
    node_pair = _find_last_pair(root, keys)
    mapping: Any = node_pair[1] if node_pair else root
    if mapping.flow_style:
        at = text.index("{", mapping.start_mark.index) + 1
        return at, at, ", ".join(lines) + (", " if mapping.value else "")
    first = mapping.value[0][0].start_mark
    indent = text[first.index - first.column : first.index]
    newline = "\r\n" if "\r\n" in text else "\n"
    return first.index, first.index, "".join(f"{line}{newline}{indent}" for line in lines)

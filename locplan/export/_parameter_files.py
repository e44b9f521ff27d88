"""Files of Nav2's parameters with ours, and what differs in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from locplan._util.reading import ROS_BOOLEANS, ROS_NUMBER, scalar_text
from locplan.errors import LocplanError
from locplan.robots import Nav2Parameters, edited_files, read_parameters


def yaml_text(content: Mapping[str, Any]) -> str:
    """Parameters as YAML, in which ROS reads each text as a text."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """A dumper that quotes what is a text to PyYAML only."""

    def represent(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
        # libyaml below 0.2.2 fails on an unquoted :: between braces.
        plain = text in ROS_BOOLEANS or ROS_NUMBER.fullmatch(text) or "::" in text
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, '"' if plain else None)

    Dumper.add_representer(str, represent)
    text: str = yaml.dump(dict(content), Dumper=Dumper, sort_keys=False, allow_unicode=True)
    return text


def parameter_files(before: Nav2Parameters, after: Nav2Parameters) -> tuple[dict[str, bytes], bool]:
    """Return the files of a robot's parameters with ours, and whether nav2.yaml has its comments.

    nav2.yaml is a copy of the robot's file that has what is changed; a merger if several files
    have, and, without comments, where anchors and aliases stand for what has to be changed. Of
    several files merged.yaml has all.

    Parameters
    ----------
    before, after : Nav2Parameters
        The robot's own parameters, and the same with ours.
    """
    text, has_comments = _text_of(before, after)
    files = {"nav2.yaml": text}
    if len(before.files) > 1:
        files["merged.yaml"] = yaml_text(after.merged().content).encode()
    return files, has_comments


def _text_of(before: Nav2Parameters, after: Nav2Parameters) -> tuple[bytes, bool]:
    """Text of the only file that is changed, or of all in one, and whether comments are in it."""
    pairs = list(zip(before.files, after.files, strict=False))
    changed = [new for old, new in pairs if old.content != new.content] or [*after.files][:1]
    path = changed[0].path if len(changed) == 1 else None
    if path is None:
        return yaml_text(after.merged().content).encode(), False
    try:
        return edited_files(before, after).get(path) or path.read_bytes(), True
    except LocplanError:
        return yaml_text(changed[0].content).encode(), False


def write_merged(target: Path, paths: Sequence[str | Path]) -> None:
    """Write the parameters of several files of Nav2 as one, as nav2_bringup takes them.

    Parameters
    ----------
    target : Path
        The file.
    paths : sequence of path
        The files, of which later ones replace single parameters of earlier ones.

    Raises
    ------
    LocplanError
        If a file cannot be read.
    """
    target.write_text(yaml_text(read_parameters(*paths).merged().content), "utf-8")


def differences(theirs: Any, merged: Any) -> tuple[list[str], list[str]]:
    """A sentence's part for each of a robot's own values that is another, and for each new one."""
    changed, added = [], []
    for name, own, value in _values_of(theirs, merged):
        if isinstance(value, list):  # of names, to which ours are added
            new = [str(each) for each in value if each not in (own or [])]
            if gone := [str(each) for each in own or [] if each not in value]:
                changed.append(f"{name}: without {', '.join(gone)}")
            if new:
                added.append(f"{name}: {', '.join(new)}")
        elif own is None:
            added.append(f"{name}: {scalar_text(value)}")
        elif own != value:
            changed.append(f"{name}: {scalar_text(value)} (was {scalar_text(own)})")
    return changed, added


def _values_of(theirs: Any, merged: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Name, value before and value after of each parameter; nodes' own levels are left out."""
    if not isinstance(merged, dict):
        yield name, theirs, merged
        return
    own = theirs if isinstance(theirs, dict) else {}
    for key, value in merged.items():
        inner = name if key in ("ros__parameters", name) else f"{name}.{key}".strip(".")
        yield from _values_of(own.get(key), value, inner)

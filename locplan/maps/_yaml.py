"""The YAML file of a map, whose entries ROS's map_server defines."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from locplan._util.checks import FARTHEST, RESOLUTIONS, is_file_name, shown
from locplan._util.reading import SCALAR_TAGS, compose, fault_of, read_content

if TYPE_CHECKING:
    import yaml

MODES = ("trinary", "scale", "raw")
MAX_YAML_BYTES = 2**16
Entry = str | list[str] | None
"""An entry of a map's YAML as text or texts; None is null."""


class Header(NamedTuple):
    """The entries of a map's YAML, as `read_header` checks them."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str


def read_header(file: Path) -> Header:
    """Read the entries of a map's YAML; a missing or a wrong one is a MapError."""
    entries = {"negate": "0", "mode": "trinary"} | _read_entries(file)
    image, origin, mode = entries.get("image"), entries.get("origin"), entries["mode"]
    place = [_number(item) for item in origin] if isinstance(origin, list) else []
    negate = {"0": False, "1": True, "false": False, "true": True}.get(
        str(entries["negate"]).lower()
    )
    resolution, occupied, free = (
        _number(entries.get(key)) for key in ("resolution", "occupied_thresh", "free_thresh")
    )
    finite = len(place) == 3 and all(abs(value) <= FARTHEST for value in place)
    named = isinstance(image, str) and is_file_name(image)
    (finest, coarsest), metres = RESOLUTIONS, f"{RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g} metres"
    for key, rule, example, holds in (
        ("image", "the name of a file", "map.pgm", named),
        ("resolution", metres, "0.05", finest <= resolution <= coarsest),
        ("origin", "three finite numbers x, y, yaw", "[0.0, 0.0, 0.0]", finite),
        ("negate", "0 or 1", "0", negate is not None),
        ("occupied_thresh", "a fraction in 0..1, not per cent", "0.65", 0 <= occupied <= 1),
        ("free_thresh", "a fraction up to the other, not per cent", "0.196", 0 <= free <= occupied),
        ("mode", "trinary, scale or raw", "trinary", mode in MODES),
    ):
        if not holds:
            fault = f"{key} must be {rule}, but is {_shown(entries.get(key))}"
            unit = "is it metres? " if key == "resolution" and 0 < resolution < math.inf else ""
            raise fault_of(file, fault, f"{unit}write e.g. {key}: {example}")
    name, (x, y, yaw) = os.path.expanduser(str(image)), place
    return Header(name, resolution, (x, y, yaw), bool(negate), occupied, free, str(mode))


def _read_entries(file: Path) -> dict[str, Entry]:
    """Read the top level of a map YAML, as nodes only: no tag is obeyed, no alias expanded."""
    import yaml

    content = read_content(
        file, MAX_YAML_BYTES, "give a map YAML, which is a few lines, not its image"
    )
    remedy = "write lines such as image: map.pgm"
    root = compose(file, content, remedy)
    if not isinstance(root, yaml.MappingNode):
        raise fault_of(file, "holds no keys", remedy)
    entries: dict[str, Entry] = {}
    for key, value in root.value:
        name = "".join(_plain(key) or "")
        if name in entries:
            raise fault_of(file, f"{_shown(name)} occurs twice", "keep one of the two")
        entries[name] = _plain(value)
    return entries


def _plain(node: yaml.Node) -> Entry:
    """Text of a scalar, or the texts of a sequence; ... stands for anything else."""
    import yaml

    if node.tag == "tag:yaml.org,2002:null":
        return None
    if isinstance(node, yaml.ScalarNode) and node.tag in SCALAR_TAGS:
        return str(node.value)
    items = node.value if isinstance(node, yaml.SequenceNode) else [None]
    return [str(item.value) if isinstance(item, yaml.ScalarNode) else "..." for item in items]


def _number(entry: Entry) -> float:
    """Number in a text (also 5e-2, which PyYAML takes for a string), or else NaN."""
    try:
        return float(entry) if isinstance(entry, str) else math.nan
    except ValueError:
        return math.nan


def _shown(entry: Entry) -> str:
    text = f"[{', '.join(entry[:4])}]" if isinstance(entry, list) else entry
    return "missing" if text is None else shown(text)

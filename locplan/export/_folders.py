"""A folder of exported files, written whole or not at all, with a description of its input."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from locplan._util.files import check_folder_target, replacing_folder
from locplan._util.reading import MAX_JSON_BYTES, parsed_json, read_text
from locplan._util.results import digest_of
from locplan._util.runs import write_run
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError

ABOUT = "export.json"
README = "README.md"
PREVIEW = "preview.png"


def check_export_folder(target: Path) -> None:
    """Raise a LocplanError unless an export can be written there; to be called before long work."""
    check_folder_target(target, None, _is_untouched_export)


@contextmanager
def export_folder(
    target: Path, title: str, about: Mapping[str, Any], readme: Sequence[str]
) -> Iterator[Path]:
    """A new folder that takes the place of `target` when the block ends well.

    It gets a README.md of a title and the lines given, and export.json, which lists the files; a
    folder is replaced only if this file says that it is an export without changes.
    """
    with replacing_folder(target, None, _is_untouched_export) as folder:
        yield folder
        (folder / README).write_text("\n".join([f"# {title}", "", *readme]) + "\n", "utf-8")
        write_run(folder, target)
        files = {file.name: digest_of(file) for file in sorted(folder.iterdir())}
        text = json.dumps({**about, "files": files}, indent=2, allow_nan=False)
        (folder / ABOUT).write_text(text + "\n", "utf-8")


def check_has_field(costs: Costmap) -> None:
    """Raise a ConfigError unless the costmap knows how degenerate its cells are."""
    if np.isnan(costs.u).all() and np.isfinite(costs.density).any():
        raise ConfigError("this export needs a costmap made of a field (Costmap.from_field)")


def about_map(costs: Costmap) -> list[str]:
    """Lines of a README.md on what the values were made of, and on a yaw that was left out."""
    grid, settings = costs.grid, costs.settings
    made = "a density of one's own"
    if settings:
        made = f"the field of {settings.config.estimator.summary}, weight {costs.weight:g}"
    lines = [f"- Made of {made}, for a robot radius of {costs.robot_radius:g} m."]
    if grid.origin[2]:
        lines.append(
            f"- The map has a yaw of {grid.origin[2]:g} rad, which Nav2 ignores: all positions here"
            " are where Nav2 has them, with the map unturned."
        )
    return lines


def _is_untouched_export(folder: Path) -> bool:
    if not folder.is_dir():
        return False
    there = {file.name for file in folder.iterdir()}
    try:
        files = parsed_json(read_text(folder / ABOUT, MAX_JSON_BYTES))["files"]
        return there == {ABOUT, *files} and all(
            digest_of(folder / name) == digest for name, digest in files.items()
        )
    except (LocplanError, OSError, ValueError, TypeError, KeyError, AttributeError):
        return not there

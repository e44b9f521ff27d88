"""A folder of exported files: whole or not at all, with what it was made of beside them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from locplan.files import replacing_folder

ABOUT = "export.json"
README = "README.md"


@contextmanager
def export_folder(
    target: Path, title: str, about: Mapping[str, Any], readme: Sequence[str]
) -> Iterator[Path]:
    """A new folder that takes the place of `target` when the block ends well.

    It gets a README.md of a title and the lines given, and export.json, by which an export of
    ours that is there already is known and may be replaced.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or holds something else.
    """
    with replacing_folder(target, None, _is_export) as folder:
        yield folder
        (folder / README).write_text("\n".join([f"# {title}", "", *readme]) + "\n", "utf-8")
        (folder / ABOUT).write_text(json.dumps(about, indent=2) + "\n", "utf-8")


def _is_export(folder: Path) -> bool:
    if not folder.is_dir():
        return False
    if not any(folder.iterdir()):
        return True
    try:
        return "locplan" in json.loads((folder / ABOUT).read_text("utf-8"))
    except (OSError, ValueError):
        return False

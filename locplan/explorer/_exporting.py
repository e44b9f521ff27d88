"""Exports of the view for Nav2, into the folder that was named on the command line."""

from __future__ import annotations

import dataclasses
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.files import make_folder
from locplan.errors import ConfigError, LocplanError
from locplan.export import ExportJob, distribution, formats
from locplan.planners import AWARE

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

EXPORTS = ("nav2-keepout", "nav2-static", "nav2-speed", "route-graph", "path")
"""Formats that the page offers, by their names on the command line."""
MAX_NUMBER = 1000
"""Greatest number behind the name of an export beside others."""


def export(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Write an export of the view, as `locplan export` does; only "path" exports its way.

    Nothing that is there is replaced without `force`: the export gets a number behind its name.
    With it, a file is replaced, and a folder if it is an export of ours without changes.
    """
    to = ask.one_of("to", EXPORTS, EXPORTS[0])
    distro, folder, force = ask.text("distro"), session.folder, session.force
    view = session.view(ask)
    work.progress(0, 1, "writing")
    if folder is None:
        raise ConfigError("exports need a folder: start the explorer with --folder FOLDER")
    format = formats()[to]
    if distro is not None:
        distribution(distro)
    has_distro = any(each.name == "distro" for each in dataclasses.fields(format.options))
    options: Any = format.options(**({"distro": distro} if distro and has_distro else {}))
    suffix = "".join(format.suffixes[:1])
    stem = f"{plain_name(view.grid.name)}-{to}"
    target = folder / f"{stem}{suffix}" if force else _unused(folder, stem, suffix)
    paths = {AWARE: view.paths()[0]} if format.paths == "one" else {}
    make_folder(folder)
    format.check_target(target, force=force)
    job = ExportJob(view.costs, view.field, paths, work.progress, view.robot)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        summary = format.write(target, job, options)
    written = [target] if target.is_file() else sorted(target.rglob("*"))
    return {
        "folder": str(folder),
        "files": [each.relative_to(folder).as_posix() for each in written if each.is_file()],
        "facts": dict(summary.rows),
        "warnings": [*dict.fromkeys(str(each.message) for each in caught)],
    }


def plain_name(name: str) -> str:
    """A map's name as the name of a file: letters, digits, dots, dashes and underlines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:80] or "map"


def _unused(folder: Path, stem: str, suffix: str) -> Path:
    """A name in the folder that nothing has, with a number where others are there."""
    for number in range(1, MAX_NUMBER + 1):
        target = folder / f"{stem}{f'-{number}' if number > 1 else ''}{suffix}"
        if not target.exists() and not target.is_symlink():
            return target
    raise LocplanError(f"{folder}: holds {MAX_NUMBER} such exports; remove some")

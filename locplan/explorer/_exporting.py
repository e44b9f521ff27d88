"""Exports of the view for Nav2, into the folder that was named on the command line."""

from __future__ import annotations

import dataclasses
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.checks import one_of
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError, LocplanError
from locplan.explorer._view import View, given
from locplan.export import ExportJob, distribution, formats

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

EXPORTS = ("nav2-keepout", "nav2-static", "nav2-speed", "route-graph", "path")
"""Formats that the page offers, by their names on the command line."""
MOST_NUMBERED = 1000
"""Greatest number behind the name of an export beside others."""


@dataclass(frozen=True)
class Exported:
    """An export that was written."""

    folder: Path
    """The folder that was named on the command line."""
    files: tuple[str, ...]
    """Names of the files, within that folder."""
    facts: Mapping[str, str]
    """Facts about the export for people, by their labels."""
    warnings: tuple[str, ...] = ()
    """What is to be known about the export, such as a fault of the distribution."""

    def summary(self) -> dict[str, object]:
        """What was written, fit for JSON."""
        return {
            "folder": str(self.folder),
            "files": list(self.files),
            "facts": dict(self.facts),
            "warnings": list(self.warnings),
        }


def exported(
    view: View,
    folder: Path | None,
    *,
    to: str = "nav2-keepout",
    distro: str | None = None,
    force: bool = False,
    progress: ProgressCallback | None = None,
) -> Exported:
    """Write an export of a view, as `locplan export` does.

    Nothing that is there is replaced without `force`: the export gets a number behind its name.
    With it, a file is replaced, and a folder if it is an export of ours without changes.

    Parameters
    ----------
    view : View
        The view; of its way, only "path" exports anything.
    folder : Path or None
        The folder that exports go to, which is made; None refuses.
    to : str
        One of `EXPORTS`.
    distro : str, optional
        The distribution of ROS 2, for formats that have one.
    force : bool
        True replaces what an export of this name left.
    progress : callable, optional
        Called with (done, total) steps of a route graph; what it raises ends the work, and nothing
        is written. The other formats have no steps, and are written in a few seconds.

    Raises
    ------
    LocplanError
        If no folder was named, an option is unknown, or the folder cannot be written.
    """
    one_of("to", to, EXPORTS)
    if folder is None:
        raise ConfigError("exports need a folder: start the explorer with --folder FOLDER")
    format = formats()[to]
    known = {each.name for each in dataclasses.fields(format.options)}
    if distro is not None:
        distribution(distro)
    options: Any = format.options(**({"distro": distro} if distro and "distro" in known else {}))
    suffix = "".join(format.suffixes[:1])
    stem = f"{plain_name(view.grid.name)}-{to}"
    target = folder / f"{stem}{suffix}" if force else _unused(folder, stem, suffix)
    paths = {}
    if format.paths == "one":
        aware, _ = view.paths()
        paths["aware"] = aware
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LocplanError(f"{folder}: cannot be made ({error.strerror})") from None
    format.check_target(target, force=force)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        summary = format.write(target, ExportJob(view.costs, view.field, paths, progress), options)
    written = [target] if target.is_file() else sorted(target.rglob("*"))
    files = tuple(each.relative_to(folder).as_posix() for each in written if each.is_file())
    told = tuple(dict.fromkeys(str(each.message) for each in caught))
    return Exported(folder, files, dict(summary.rows), told)


def export(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for an export of the way shown."""
    to = given(ask.one_of("to", EXPORTS), EXPORTS[0])
    distro = ask.text("distro")
    view = session.view(ask)
    work.progress(0, 1, "writing")
    options: dict[str, Any] = {"to": to, "distro": distro, "force": session.force}
    return exported(view, session.folder, **options, progress=work.progress).summary()


def plain_name(name: str) -> str:
    """A map's name as the name of a file: letters, digits, dots, dashes and underlines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:80] or "map"


def _unused(folder: Path, stem: str, suffix: str) -> Path:
    """A name in the folder that nothing has, with a number where others are there."""
    for number in range(1, MOST_NUMBERED + 1):
        target = folder / f"{stem}{f'-{number}' if number > 1 else ''}{suffix}"
        if not target.exists() and not target.is_symlink():
            return target
    raise LocplanError(f"{folder}: holds {MOST_NUMBERED} such exports; remove some")

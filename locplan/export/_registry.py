"""The formats of exports; a new one is a module in `_formats` and its name here."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from locplan._util.progress import ProgressCallback
    from locplan.costs import Costmap, Path as Route
    from locplan.field import CovarianceField
    from locplan.robots import Robot

MODULES = [f"locplan.export._formats.{name}" for name in ("_nav2", "_files")]
"""Modules that have FORMATS, a tuple of `Format`, and import heavy libraries when they write."""


@dataclass(frozen=True)
class ExportJob:
    """The objects to export."""

    costs: Costmap
    """The costmap, with its map."""
    field: CovarianceField
    """The covariance field of the map."""
    paths: Mapping[str, Route] = dataclasses.field(default_factory=dict)
    """The paths by name."""
    progress: ProgressCallback | None = None
    """The function that is called with (done, total) by formats whose work has steps; what it
    raises ends the work."""
    robot: Robot | None = None
    """The robot, for formats that simulate drives; None for one with the field's lidar."""


@dataclass(frozen=True)
class ExportSummary:
    """Facts about an export that was written."""

    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """The facts by name, fit for JSON."""
    rows: tuple[tuple[str, str], ...] = ()
    """The facts for people: a label and a text each."""


@dataclass(frozen=True)
class NoOptions:
    """The options of a format that has none."""


@dataclass(frozen=True)
class Format:
    """A format of exports."""

    name: str
    """The name on the command line."""
    about: str
    """A few words that describe it."""
    write: Callable[[Path, ExportJob, Any], ExportSummary]
    """The function that writes a job to a target, with an instance of `options`."""
    options: type = NoOptions
    """A frozen dataclass whose docstrings say what each field does; it checks itself when made."""
    suffixes: tuple[str, ...] = ()
    """The suffixes of a file, the usual one first; a folder has none."""
    library: str = ""
    """The library of the extra `ros` that it needs."""
    paths: Literal["none", "one", "several"] = "none"
    """The number of paths that it takes."""
    shows_progress: bool = False
    """Whether it shows how far it is; else only that it is being written is shown."""
    check: Callable[[Any, int], None] = lambda options, paths: None
    """The function that raises a ConfigError where the options and the number of paths do not go
    together; it is called before long work."""

    def check_target(self, target: Path, *, force: bool = False) -> None:
        """Raise a LocplanError unless it can be written there; to be called before long work.

        Parameters
        ----------
        target : Path
            The file, or the folder, which is refused unless it is an export of ours without
            changes.
        force : bool, default False
            Whether a file that is there is replaced.
        """
        from locplan._util.files import check_target
        from locplan._util.public import needed
        from locplan.errors import LocplanError
        from locplan.export._folders import check_export_folder

        if self.library:
            needed(self.library, "ros", f"--to {self.name}")
        if self.suffixes:
            check_target(target, *self.suffixes)
            if target.exists() and not force:
                raise LocplanError(f"{target}: is there; choose another name, or --force")
        else:
            check_export_folder(target)


def formats() -> dict[str, Format]:
    """All formats by name."""
    every = [each for module in MODULES for each in import_module(module).FORMATS]
    return {each.name: each for each in every}

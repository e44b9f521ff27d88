"""The formats of exports: a line here, and a module beside the others in `_formats`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from locplan.costs import Costmap, Path as Route
    from locplan.field import CovarianceField

MODULES = [
    "locplan.export._formats._nav2",
    "locplan.export._formats._ros",
    "locplan.export._formats._plain",
]
"""Each has FORMATS, a tuple of `Format`, and imports what is heavy when it writes."""


@dataclass(frozen=True)
class ExportJob:
    """What there is to export."""

    costs: Costmap
    """The costmap, with its map."""
    field: CovarianceField
    """The covariance field of the map."""
    paths: Mapping[str, Route] = dataclasses.field(default_factory=dict)
    """The paths by name."""


@dataclass(frozen=True)
class ExportSummary:
    """What a format tells of what it wrote."""

    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """The facts by name, fit for JSON."""
    rows: tuple[tuple[str, str], ...] = ()
    """The same for people: a label and a text each."""


@dataclass(frozen=True)
class NoOptions:
    """The options of a format that has none."""


@dataclass(frozen=True)
class Format:
    """A format of exports."""

    name: str
    """The name on the command line."""
    about: str
    """What it is, in a few words."""
    write: Callable[[Path, ExportJob, Any], ExportSummary]
    """Writes a job to a target, with an instance of `options`."""
    options: type = NoOptions
    """A frozen dataclass whose docstrings say what each field does; it checks itself when made."""
    suffixes: tuple[str, ...] = ()
    """The suffixes of a file, the usual one first; a folder has none."""
    paths: Literal["none", "one", "several"] = "none"
    """The number of paths that it takes."""

    def check_target(self, target: Path) -> None:
        """Raise a LocplanError unless it can be written there; to be called before long work."""
        from locplan._util.files import check_target
        from locplan.export._folders import check_export_folder

        if self.suffixes:
            check_target(target, *self.suffixes)
        else:
            check_export_folder(target)


def formats() -> dict[str, Format]:
    """All formats by name."""
    every = [each for module in MODULES for each in import_module(module).FORMATS]
    return {each.name: each for each in every}

"""Paths and fields as files that anything reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from locplan._util.checks import number
from locplan.export._registry import ExportJob, ExportSummary, Format, NoOptions


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """The options of a path."""

    step: float | None = None
    """The poses of the path are this far apart at most [m]; by default they are its corners."""
    frame: str = "map"
    """The frame of the coordinates is map by default."""

    def __post_init__(self) -> None:
        if self.step is not None:
            number("step", self.step, 0.001)


def write_path(target: Path, job: ExportJob, options: PathOptions) -> ExportSummary:
    """Write the only path of a job."""
    from locplan.export._plain_files import path

    (route,) = job.paths.values()
    path(target, route, frame=options.frame, step=options.step)
    return ExportSummary({"length_m": route.length}, (("length", f"{route.length:.2f} m"),))


def write_field(target: Path, job: ExportJob, options: NoOptions) -> ExportSummary:
    """Write the field; the suffix chooses the format."""
    from locplan.export._plain_files import field

    field(target, job.field)
    return ExportSummary()


FORMATS = (
    Format(
        "path",
        "a path (.csv, .json or .yaml)",
        write_path,
        PathOptions,
        suffixes=(".csv", ".json", ".yaml"),
        paths="one",
    ),
    Format("csv", "a table of the field", write_field, suffixes=(".csv",)),
    Format("npz", "the field's arrays", write_field, suffixes=(".npz",)),
    Format("png", "a picture of the field", write_field, suffixes=(".png",)),
)

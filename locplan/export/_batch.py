"""Fields of many maps, one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan._util.files import PICTURES, check_target, make_folder
from locplan._util.progress import working
from locplan._util.results import ResultFolder
from locplan._util.tables import table
from locplan.errors import LocplanError
from locplan.field import FIELD_SUFFIX, SCALARS, CovarianceField, FieldSummary, check_field_target
from locplan.maps import OccupancyGrid, find_maps, load_map, name_of


@dataclass(frozen=True)
class FieldJob:
    """A map, and the files of its field and its picture, if they are to be written."""

    map_file: Path
    """The map's file."""
    output: Path | None = None
    """File of the field; None for none."""
    picture: Path | None = None
    """File of the picture; None for none."""
    pictures: ResultFolder | None = None
    """The folder of the picture, unless the user named the file."""
    force: bool = False
    """Whether files in the way are replaced."""

    def check(self) -> None:
        """Raise a LocplanError unless both can be written."""
        if self.output:
            check_field_target(self.output, force=self.force)
        if self.picture:
            check_target(self.picture, *PICTURES)
        if self.picture and self.pictures:
            self.pictures.check(self.picture.name)

    def run(self, compute: Callable[[OccupancyGrid], CovarianceField]) -> CovarianceField:
        """Load the map, compute its field, and write the files that are asked for.

        Parameters
        ----------
        compute : callable
            Computes the field of a map.
        """
        field = compute(load_map(self.map_file))
        if self.output:
            with working(f"writing {self.output.name}"):
                field.save(self.output, force=self.force)
        if self.picture:
            from locplan import plotting

            named = nullcontext(self.picture.parent)
            home = self.pictures.writing(others_stay=True) if self.pictures else named
            with working(f"drawing {self.picture.name}"), home as folder:
                plotting.save_figure(plotting.field_figure(field), folder / self.picture.name)
        return field


def field_jobs(
    maps: Sequence[Path], output: Path | None, picture: Path | None, *, force: bool = False
) -> list[FieldJob]:
    """One job for each map file that is named or lies in a folder that is named.

    For a single map `output` is its field and `picture` its picture; for several they are
    folders, with a file by the name of each map.

    Parameters
    ----------
    maps : sequence of Path
        Map files, and folders of them.
    output, picture : Path or None
        Where fields and pictures go; None for none.
    force : bool, default False
        True replaces files in the way.

    Returns
    -------
    list of FieldJob
        The jobs, in the order of the maps.

    Raises
    ------
    LocplanError
        If a file cannot be written, or two maps have one name.
    """
    files = find_maps(*maps)
    if len(files) == 1:
        job = FieldJob(files[0], output, picture, force=force)
        job.check()
        return [job]
    for folder, suffixes in ((output, [FIELD_SUFFIX]), (picture, PICTURES)):
        if folder and folder.suffix in suffixes:
            raise LocplanError(f"{folder}: of {len(files)} maps; name a folder, for a file each")
    if output or picture:
        homes: dict[str, Path] = {}
        for file in files:
            other = homes.setdefault(name_of(file), file)
            if other != file:
                raise LocplanError(f"{other} and {file} have one name; run them apart, or rename")
    for folder in filter(None, (output, picture)):
        make_folder(folder)
    return [
        FieldJob(
            file,
            output / f"{name_of(file)}{FIELD_SUFFIX}" if output else None,
            picture / f"{name_of(file)}.png" if picture else None,
            ResultFolder(picture, "pictures", force) if picture else None,
            force,
        )
        for file in files
    ]


@dataclass(frozen=True)
class FieldRun:
    """The result of a job."""

    file: Path
    """The map's file."""
    summary: FieldSummary | None
    """The field in a few numbers; None if the job failed."""
    error: str | None
    """The reason why the job failed, or None."""
    seconds: float
    """Time that the job took [s]."""

    def to_json(self) -> dict[str, Any]:
        """The run, fit for JSON."""
        about = self.summary.summary() if self.summary else {"map": name_of(self.file)}
        done = {"error": self.error, "seconds": round(self.seconds, 3)}
        return {"file": str(self.file)} | about | done


def run_field_jobs(
    jobs: Sequence[FieldJob], compute: Callable[[OccupancyGrid], CovarianceField]
) -> Iterator[FieldRun]:
    """Run each job, and give its result or the reason why it failed.

    Parameters
    ----------
    jobs : sequence of FieldJob
        The jobs.
    compute : callable
        Computes the field of a map.

    Returns
    -------
    iterator of FieldRun
        The result of each job, when it is there.
    """
    for job in jobs:
        started = time.perf_counter()
        summary, reason = None, None
        try:
            job.check()
            summary = FieldSummary.of(job.run(compute))
        except LocplanError as error:
            reason = str(error)
            if str(job.map_file) not in reason:
                reason = f"{job.map_file}: {reason}"
        yield FieldRun(job.map_file, summary, reason, time.perf_counter() - started)


def field_runs_table(runs: Sequence[FieldRun]) -> str:
    """The summaries of many fields, one a row, and below them the reasons why some failed.

    Parameters
    ----------
    runs : sequence of FieldRun
        The results.
    """
    rows, std = [], SCALARS["position_std"]
    for run in runs:
        if (found := run.summary) is None:
            rows.append([name_of(run.file), "–", "–", "–", "–", "failed"])
        else:
            position = f"{found.position_std.median_text(std.factor)} {std.unit}"
            cells, share = f"{found.cells_evaluated:,}", f"{found.saturated_share:.0%}"
            texts = [position, found.e.median_text(), share, f"{run.seconds:.1f} s"]
            rows.append([found.map, cells, *texts])
    errors = [f"failed: {run.error}" for run in runs if run.error]
    columns = ["map", "cells", "median position std", "median e", "saturated", "took"]
    return "\n".join([table(columns, rows), *errors])

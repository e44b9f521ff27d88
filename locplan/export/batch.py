"""Fields of many maps, one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan._support.checks import check_choice
from locplan._support.files import PICTURES, check_target
from locplan._support.output import Output, strip_staging_folder
from locplan._support.progress import show_spinner
from locplan._support.saved import to_plain_data
from locplan._support.tables import format_table
from locplan.errors import LocplanError
from locplan.export.plain_files import write_field_file
from locplan.field.config import FieldConfig
from locplan.field.covariance import SCALARS
from locplan.field.field import CovarianceField
from locplan.field.files import FIELD_SUFFIX
from locplan.field.summary import FieldSummary
from locplan.maps.files import find_maps, load_map, map_name_from_file
from locplan.maps.grid import OccupancyGrid

PURPOSES = {f"*{FIELD_SUFFIX}": "the field, for --field", "*": "the picture"}
"""Purpose of the files by their pattern."""


@dataclass(frozen=True)
class FieldJob:
    """A map, and the file that is written of its field."""

    map_file: Path
    """The map's file."""
    output: Path | None = None
    """File of the field (.npz) or of a picture of it (.png, .pdf, .svg); None for none."""
    scalar: str | None = None
    """Scalar that a picture shows; by default what degeneracy is made of."""
    folder: Output | None = None
    """The folder of the files of several maps; None if the user named the file."""
    force: bool = False
    """True overwrites files of the same names."""

    def check(self) -> None:
        """Raise a LocplanError unless the file can be written."""
        if self.output is None:
            if self.scalar:
                raise LocplanError(f"name a file for the picture of {self.scalar} with --output")
            return
        if self.folder:
            return self.folder.check()
        check_target(self.output, *([] if self.scalar else [FIELD_SUFFIX]), *PICTURES)
        self._output(self.output).check()

    def _output(self, file: Path) -> Output:
        return Output(file, "field", self.force, is_file=True, purposes=PURPOSES)

    def run(
        self, compute: Callable[[OccupancyGrid], CovarianceField], folder: Path | None = None
    ) -> CovarianceField:
        """Load the map, compute its field, and write the file that is asked for.

        Parameters
        ----------
        compute : callable
            Computes the field of a map.
        folder : Path, optional
            The temporary folder of the files of several maps.
        """
        computed = compute(load_map(self.map_file))
        if self.output:
            single_output = self._output(self.output)
            with (
                show_spinner(f"writing {self.output.name}"),
                nullcontext(folder / self.output.name)
                if folder
                else single_output.writing() as file,
            ):
                self._write(file, computed)
        return computed

    def _write(self, file: Path, computed: CovarianceField) -> None:
        if file.suffix.lower() == FIELD_SUFFIX:
            write_field_file(file, computed)
        else:
            from locplan._support.drawing import save_figure
            from locplan.field.figures import field_figure

            save_figure(field_figure(computed, self.scalar), file)


def field_jobs(
    maps: Sequence[Path],
    output: Path | None,
    scalar: str | None,
    config: FieldConfig,
    *,
    force: bool = False,
) -> list[FieldJob]:
    """One job for each map file that is named or lies in a folder that is named.

    For a single map `output` is a file; for several it is a folder, with a file by the name of
    each map.

    Parameters
    ----------
    maps : sequence of Path
        Map files, and folders of them.
    output : Path or None
        Where fields or pictures go; None for none.
    scalar : str or None
        Scalar of the pictures, if pictures are to be written of several maps; of a single map the
        suffix of `output` says so, too.
    config : FieldConfig
        Settings of the fields.
    force : bool, default False
        True overwrites files of the same names.

    Returns
    -------
    list of FieldJob
        The jobs, in the order of the maps.

    Raises
    ------
    LocplanError
        If a file cannot be written, the fields have no such scalar, or two maps have one name.
    """
    if scalar:
        check_choice(
            "the picture", scalar, [*SCALARS, *(layer.name for layer in config.estimator.layers)]
        )
    files = find_maps(*maps)
    if len(files) == 1:
        job = FieldJob(files[0], output, scalar, force=force)
        job.check()
        return [job]
    if output is None:
        jobs = [FieldJob(file, None, scalar) for file in files]
        jobs[0].check()
        return jobs
    if output.suffix in (FIELD_SUFFIX, *PICTURES):
        raise LocplanError(f"{output}: of {len(files)} maps; name a folder, for a file each")
    homes: dict[str, Path] = {}
    for file in files:
        other = homes.setdefault(map_name_from_file(file), file)
        if other != file:
            raise LocplanError(f"{other} and {file} have one name; run them apart, or rename")
    suffix = ".png" if scalar else FIELD_SUFFIX
    folder, targets = (
        Output(output, "fields", force, purposes=PURPOSES),
        [f"{name}{suffix}" for name in homes],
    )
    folder.check(*targets)
    return [
        FieldJob(file, output / target, scalar, folder, force)
        for file, target in zip(files, targets, strict=True)
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
        summary_values = (
            to_plain_data(self.summary) if self.summary else {"map": map_name_from_file(self.file)}
        )
        run_values = {"error": self.error, "seconds": round(self.seconds, 3)}
        return {"file": str(self.file)} | summary_values | run_values


def run_field_jobs(
    jobs: Sequence[FieldJob], compute: Callable[[OccupancyGrid], CovarianceField]
) -> Iterator[FieldRun]:
    """Run each job, and yield its result or the reason of its failure; write all files at the end.

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
    output = next((job.folder for job in jobs if job.folder), None)
    with output.writing() if output else nullcontext() as folder:
        for job in jobs:
            started = time.perf_counter()
            summary, reason = None, None
            try:
                summary = FieldSummary.from_field(job.run(compute, folder))
            except LocplanError as error:
                reason = strip_staging_folder(str(error))
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
        if (summary := run.summary) is None:
            rows.append([map_name_from_file(run.file), "–", "–", "–", "–", "failed"])
        else:
            position = f"{summary.position_std.median_text(std.factor)} {std.unit}"
            cells, share = f"{summary.cells_evaluated:,}", f"{summary.saturated_share:.0%}"
            texts = [position, summary.e.median_text(), share, f"{run.seconds:.1f} s"]
            rows.append([summary.map, cells, *texts])
    errors = [f"failed: {run.error}" for run in runs if run.error]
    columns = ["map", "cells", "median position std", "median e", "saturated", "took"]
    return "\n".join([format_table(columns, rows), *errors])

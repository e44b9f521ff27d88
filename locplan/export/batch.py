"""Jobs that compute and write the fields of many maps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan._support.checks import check_choice
from locplan._support.files import PICTURES, check_writable_file
from locplan._support.output import ResultOutput, strip_staging_folder
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
    """A map, and the file that its field or picture is written to."""

    map_file: Path
    """The map's file."""
    output: Path | None = None
    """File of the field (.npz) or of its picture (.png, .pdf, .svg); None to write no file."""
    scalar: str | None = None
    """Scalar that a picture shows; by default the one that the degeneracy is based on."""
    folder: ResultOutput | None = None
    """The folder for the files of several maps; None if the user named the file."""
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
        check_writable_file(self.output, *([] if self.scalar else [FIELD_SUFFIX]), *PICTURES)
        self._make_output(self.output).check()

    def _make_output(self, file: Path) -> ResultOutput:
        return ResultOutput(file, "field", self.force, is_file=True, purposes=PURPOSES)

    def run(
        self, compute: Callable[[OccupancyGrid], CovarianceField], folder: Path | None = None
    ) -> CovarianceField:
        """Load the map, compute its field, and write the file.

        Parameters
        ----------
        compute : callable
            Computes the field of a map.
        folder : Path, optional
            The temporary folder for the files of several maps.
        """
        computed = compute(load_map(self.map_file))
        if self.output:
            single_output = self._make_output(self.output)
            with (
                show_spinner(f"writing {self.output.name}"),
                nullcontext(folder / self.output.name)
                if folder
                else single_output.writing() as file,
            ):
                self._write_file(file, computed)
        return computed

    def _write_file(self, file: Path, computed: CovarianceField) -> None:
        if file.suffix.lower() == FIELD_SUFFIX:
            write_field_file(file, computed)
        else:
            from locplan._support.drawing import save_figure
            from locplan.field.figures import field_figure

            save_figure(field_figure(computed, self.scalar), file)


def make_field_jobs(
    maps: Sequence[Path],
    output: Path | None,
    scalar: str | None,
    config: FieldConfig,
    *,
    force: bool = False,
) -> list[FieldJob]:
    """Return a job for each map file, given directly or inside a folder.

    For a single map, `output` is a file. For several maps it is a folder with one file per map.

    Parameters
    ----------
    maps : sequence of Path
        Map files, and folders of them.
    output : Path or None
        File or folder of the fields or pictures; None to write none.
    scalar : str or None
        Scalar of the pictures. If it is set, several maps get pictures instead of fields; for a
        single map the suffix of `output` decides.
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
        If a file cannot be written, the fields lack the scalar, or two maps have the same name.
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
        raise LocplanError(f"{output}: is one file for {len(files)} maps; name a folder")
    files_by_name: dict[str, Path] = {}
    for file in files:
        other = files_by_name.setdefault(map_name_from_file(file), file)
        if other != file:
            raise LocplanError(
                f"{other} and {file} have the same name; rename one, or run them separately"
            )
    suffix = ".png" if scalar else FIELD_SUFFIX
    folder, targets = (
        ResultOutput(output, "fields", force, purposes=PURPOSES),
        [f"{name}{suffix}" for name in files_by_name],
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
    """Summary of the field; None if the job failed."""
    error: str | None
    """The reason why the job failed, or None."""
    seconds: float
    """Time that the job took [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""
        summary_values = (
            to_plain_data(self.summary) if self.summary else {"map": map_name_from_file(self.file)}
        )
        run_values = {"error": self.error, "seconds": round(self.seconds, 3)}
        return {"file": str(self.file)} | summary_values | run_values


def run_field_jobs(
    jobs: Sequence[FieldJob], compute: Callable[[OccupancyGrid], CovarianceField]
) -> Iterator[FieldRun]:
    """Run each job and yield its result or error; write all files at the end.

    Parameters
    ----------
    jobs : sequence of FieldJob
        The jobs.
    compute : callable
        Computes the field of a map.

    Returns
    -------
    iterator of FieldRun
        The result of each job as soon as it is complete.
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


def format_field_runs(runs: Sequence[FieldRun]) -> str:
    """Return a table with a row per field, followed by the errors of failed jobs.

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

"""The command that computes fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import OUTPUT, Force, Json, MapFiles, command, results
from locplan.cli._options import Computing, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import show

app = command("field", "field lab.yaml -o lab.zarr --picture lab.png")


@app.default
def field(
    maps: MapFiles,
    /,
    *,
    output: Annotated[
        Path | None, results("File for the field (.zarr; of many maps a folder).")
    ] = None,
    picture: Annotated[
        Path | None,
        Parameter(
            group=OUTPUT,
            help="File for a picture of e (.png, .pdf, .svg; of many maps a folder).",
        ),
    ] = None,
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    force: Force = False,
    json: Json = False,
) -> int:
    """Compute how uncertain a pose match is all over a map, or over many."""
    from locplan.export import field_jobs, field_runs_table, run_field_jobs
    from locplan.field import FieldSummary

    _, config = options.with_robot(robot_options)
    jobs = field_jobs(maps, output, picture, force=force)
    with computing.of(config) as compute:
        if len(jobs) == 1:
            summary = FieldSummary.of(jobs[0].run(compute))
            show(json, summary.summary(), summary.table(), output, picture)
            return 0
        runs = list(run_field_jobs(jobs, compute))
    failed = [run for run in runs if run.error]
    written = [output, picture] if len(failed) < len(runs) else []
    show(json, [run.to_json() for run in runs], field_runs_table(runs), *written)
    return 2 if failed else 0

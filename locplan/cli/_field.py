"""The command that computes fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import locplan
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import MapFiles, command, option_group
from locplan.cli._options import Computing
from locplan.cli._output import Output, Target
from locplan.cli._robot_options import RobotOptions

app = command("field", "field lab.yaml -o lab.zarr --picture lab.png")


@option_group("Output")
class FieldOutput(Output):
    """Where fields go."""

    output: Annotated[Path | None, Target] = None
    """File for the field (.zarr; of many maps a folder)."""
    picture: Path | None = None
    """File for a picture of e (.png, .pdf, .svg; of many maps a folder)."""


@app.default
def field(
    maps: MapFiles,
    /,
    *,
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: FieldOutput = FieldOutput(),
) -> int:
    """Compute how uncertain a pose match is all over a map, or over many."""
    _, config = options.with_robot(robot_options)
    written = [out.output, out.picture]
    jobs = locplan.export.field_jobs(maps, *written, force=out.force)
    with computing.of(config) as compute:
        if len(jobs) == 1:
            summary = locplan.field.FieldSummary.of(jobs[0].run(compute))
            out.show(summary.summary(), summary.table(), *written)
            return 0
        runs = list(locplan.export.run_field_jobs(jobs, compute))
    failed = [run for run in runs if run.error]
    table = locplan.export.field_runs_table(runs)
    out.show([run.to_json() for run in runs], table, *written if len(failed) < len(runs) else ())
    return 2 if failed else 0

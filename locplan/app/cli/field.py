"""The command `field`: compute the covariance field of maps."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

import locplan
from locplan.app.cli.application import command
from locplan.app.cli.arguments import MapFiles
from locplan.app.cli.groups import FieldOptions, OutputOptions, RobotOptions, Threads


@command(
    "field lab.yaml -o lab.npz",
    "field lab.yaml --lidar turtlebot4 --picture heading_std -o heading.png",
    words="ue",
)
def field(
    maps: MapFiles,
    /,
    *,
    picture: Annotated[str | None, Parameter(metavar="SCALAR")] = None,
    robot: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> int:
    """Compute how well scans fix the pose in every free cell of a map.

    Writes a field (.npz) or a picture (.png, .pdf, .svg). For several maps, --output is a folder.

    Parameters
    ----------
    maps
        Map YAML files, folders with one, or built-in maps.
    picture
        Draw e, position_std, position_rms, heading_std, ambiguity or entropy.
    """
    from locplan._support.saved import to_plain_data
    from locplan.export.batch import format_field_runs, make_field_jobs, run_field_jobs
    from locplan.field.summary import FieldSummary

    _, config = options.resolve(robot.load())
    jobs = make_field_jobs(maps, output.output, picture, config, force=output.force)

    def compute(grid: locplan.OccupancyGrid) -> locplan.CovarianceField:
        return options.compute(grid, config, threads)

    if len(jobs) == 1:
        summary = FieldSummary.from_field(jobs[0].run(compute))
        output.show(to_plain_data(summary), summary.table(), output.output)
        return 0
    runs = list(run_field_jobs(jobs, compute))
    failed = [run for run in runs if run.error]
    files = [output.output] if len(failed) < len(runs) else []
    output.show([run.to_json() for run in runs], format_field_runs(runs), *files)
    return 2 if failed else 0

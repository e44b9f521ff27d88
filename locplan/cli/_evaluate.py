"""The command that compares fields with simulated errors."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import FIELD, Force, Json, MapFiles, command
from locplan.cli._kinds import given_of
from locplan.cli._options import FieldOptions, RobotRadius, Threads, radius_of
from locplan.cli._simulation_options import AtPlaces, Folder, SimulationOptions
from locplan.cli._values import show
from locplan.field._lidar_presets import PRESETS

app = command("evaluate", "evaluate lab.yaml -o evaluated")


@app.default
def evaluate(
    maps: MapFiles,
    /,
    *,
    lidar: Annotated[
        str | None,
        Parameter(
            group=FIELD,
            choices=tuple(PRESETS),
            help="The lidar, or the robot that carries it, is one of these.",
        ),
    ] = None,
    range: Annotated[
        float | None,
        Parameter(group=FIELD, help="The lidar's range is that of its data sheet, or 6 [m]."),
    ] = None,
    field_of_view: Annotated[
        float | None,
        Parameter(group=FIELD, help="The field of view is that of the lidar that is named [deg]."),
    ] = None,
    at: AtPlaces = AtPlaces(),
    simulation: SimulationOptions = SimulationOptions(),
    robot_radius: RobotRadius = None,
    threads: Threads = None,
    output: Folder = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Tell how well each field predicts where a robot is badly localized on your maps."""
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _evaluation as evaluation, _reports as reports

    options = FieldOptions(lidar=lidar, range=range, field_of_view=field_of_view)
    config = options.to_config()
    simulated = simulation.simulated(config, options.named_lidar())
    folder = reports.EVALUATION.into(output, force=force) if output else None
    with progress_bar("driving", "drives") as progress:
        result = evaluation.evaluate(
            [load_map(file) for file in find_maps(*maps)],
            **simulated,
            **given_of(at),
            disc=min(config.estimator.reach, evaluation.LARGEST_DISC),
            robot_radius=radius_of(robot_radius),
            threads=threads,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_evaluation(folder, result) if folder else []
    show(json, result.summary(), reports.evaluation_table(result), *written)

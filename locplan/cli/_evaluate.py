"""The command that compares fields with simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import FIELD, INPUT, Force, Json, MapFiles, command
from locplan.cli._kinds import given_of
from locplan.cli._options import FieldOptions, RobotRadius, Threads, radius_of
from locplan.cli._simulation_options import AtPlaces, Folder, SimulationOptions
from locplan.cli._values import refuse, show
from locplan.robots import PRESETS

app = command(
    "evaluate",
    "evaluate lab.yaml -o evaluated",
    "evaluate lab.yaml --drive monday.mcap --every 10 -o evaluated",
)


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
    config: Annotated[
        Path | None,
        INPUT,
        Parameter(
            group=FIELD,
            metavar="FILE.json",
            help="The lidar, the filter and the disturbances are those of this file, as calibrate"
            " wrote it.",
        ),
    ] = None,
    recorded: DriveOptions = DriveOptions(),
    at: AtPlaces = AtPlaces(),
    simulation: SimulationOptions = SimulationOptions(),
    robot_radius: RobotRadius = None,
    threads: Threads = None,
    output: Folder = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Tell how well each field predicts where a robot is badly localized on your maps.

    It is simulated there, or, with --drive, what its own scans say along a recorded drive.
    """
    recorded.check()
    if recorded.drive is not None:
        refuse("with --drive", lidar=lidar, range=range, field_of_view=field_of_view)
        seed = None if simulation.seed == SimulationOptions.seed else simulation.seed
        refuse("with --drive", params=simulation.params, set=simulation.set or None, seed=seed)
        places = {
            name: value for name, value in given_of(at).items() if value != getattr(AtPlaces, name)
        }
        refuse("with --drive", **places, robot_radius=robot_radius)
        _evaluate_drive(maps, recorded, config, threads, output, force=force, json=json)
        return
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _evaluation as evaluation, _reports as reports

    options = FieldOptions(lidar=lidar, range=range, field_of_view=field_of_view, config=config)
    field = options.to_config()
    simulated = simulation.simulated(field, options.named_lidar(), file=config)
    radius = radius_of(robot_radius, simulation.params)
    folder = reports.EVALUATION.into(output, force=force) if output else None
    with progress_bar("driving", "drives") as progress:
        result = evaluation.evaluate(
            [load_map(file) for file in find_maps(*maps)],
            **simulated,
            **given_of(at),
            disc=min(field.estimator.reach, evaluation.LARGEST_DISC),
            robot_radius=radius,
            threads=threads,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_evaluation(folder, result) if folder else []
    show(json, result.summary(), reports.evaluation_table(result), *written)


def _evaluate_drive(
    maps: list[Path],
    recorded: DriveOptions,
    config: Path | None,
    threads: int | None,
    output: Path | None,
    *,
    force: bool,
    json: bool,
) -> None:
    """Compare the fields with the scans of a recorded drive."""
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.recordings import _reports as reports, evaluate_drive
    from locplan.recordings._evaluation import estimators_for

    folder = reports.DRIVE.into(output, force=force) if output else None
    own = {"config": FieldOptions(config=config).to_config().estimator} if config else {}
    grid, drive = recorded.on_map(maps)
    estimators = estimators_for(drive.lidar) | own
    with progress_bar("comparing fields", "fields") as progress:
        found = evaluate_drive(
            drive, grid, estimators=estimators, threads=threads, progress=progress
        )
    with working("writing the results"):
        written = reports.write_drive(folder, found) if folder else []
    show(json, found.summary(), reports.drive_table(found), *written)

"""The command that compares fields with simulated errors."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import FIELD, Force, Json, MapFiles, command
from locplan.cli._kinds import given_of
from locplan.cli._options import FieldOptions, RobotRadius, Threads, radius_of
from locplan.cli._simulation_options import AtPlaces, Folder, SimulationOptions
from locplan.cli._values import refuse, show
from locplan.errors import ConfigError, LocplanError
from locplan.field._lidar_presets import PRESETS

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
        refuse("with --drive", params=simulation.params, set=simulation.set or None)
        places = {
            name: value for name, value in given_of(at).items() if value != getattr(AtPlaces, name)
        }
        refuse("with --drive", **places, robot_radius=robot_radius)
        _evaluate_drive(maps, recorded, threads, output, force=force, json=json)
        return
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


def _evaluate_drive(
    maps: list[Path],
    recorded: DriveOptions,
    threads: int | None,
    output: Path | None,
    *,
    force: bool,
    json: bool,
) -> None:
    """Compare the fields with the scans of a recorded drive."""
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.maps import find_maps, load_map
    from locplan.maps._files import MapWarning
    from locplan.recordings import _reports as reports, evaluate_drive, fit_to_map

    files = find_maps(*maps)
    if len(files) != 1:
        raise ConfigError(f"--drive is of one map, not of {len(files)}; name the one it was on")
    folder = reports.DRIVE.into(output, force=force) if output else None
    grid = load_map(files[0])
    drive = recorded.read()
    with working("looking whether the map fits"):
        fit = fit_to_map(drive, grid)
    if not fit.fits:
        x, y, turn = fit.move
        way = f" (--align {x:.3f},{y:.3f},{math.degrees(turn):.2f})" if fit.shifted else ""
        fault = f"{files[0]}: {fit.sentence.rstrip('.')}{way}"
        if recorded.align is None:
            raise LocplanError(f"{fault}; --align 0,0,0 goes on as it is")
        warnings.warn(MapWarning(fault), stacklevel=2)
    with progress_bar("comparing fields", "fields") as progress:
        found = evaluate_drive(drive, grid, threads=threads, progress=progress)
    with working("writing the results"):
        written = reports.write_drive(folder, found) if folder else []
    show(json, found.summary(), reports.drive_table(found), *written)

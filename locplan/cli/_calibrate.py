"""The command that fits the noise level of a field to simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._application import NOT_IN_METRES
from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import AtPlaces, DriveSeed, Force, Json, MapFiles, command, results
from locplan.cli._kinds import given_of
from locplan.cli._options import FieldOptions, Threads
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import refuse, show

app = command(
    "calibrate",
    "calibrate lab.yaml -o lab.json",
    "field lab.yaml --config lab.json",
    "calibrate lab.yaml --drive monday.mcap -o robot.json",
    "simulate lab.yaml --random 20 --robot robot.json",
)


@app.default
def calibrate(
    maps: MapFiles,
    /,
    *,
    error: Annotated[
        Literal["tracking", "match"] | None,
        Parameter(help="Errors of the filter (tracking, by default), or of single scans."),
    ] = None,
    fit_tau: Annotated[
        bool, Parameter(help="Fit the scale tau of sad's exponential weights, too.")
    ] = False,
    at: AtPlaces = AtPlaces(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    options: FieldOptions = FieldOptions(),
    threads: Threads = None,
    output: Annotated[
        Path,
        results(
            "File for the settings, for --config and --robot of other commands, with a picture"
            " NAME_calibration.png beside it; calibrated.json by default."
        ),
    ] = Path("calibrated.json"),
    force: Force = False,
    json: Json = False,
) -> int:
    """Fit the noise level k (and tau), so that the field's deviations are errors in metres.

    With --drive, k is fitted to the posteriors of recorded scans instead, and the noise of
    odometry, of ranges, outliers and blocked beams are, too: simulations with --robot have them.

    Where that cannot be, the exit code is 3, the written file says so, and its use warns.
    """
    from locplan._util.progress import progress_bar, working
    from locplan.maps import find_maps, load_map
    from locplan.simulation import calibrate as fitted, check_calibration, measure_maps

    check_calibration(output, force=force)
    recorded.check()
    if recorded.drive:
        _refuse_with_drive(at, error, fit_tau)
        return _from_drive(maps, recorded, robot_options, options, threads, output, force, json)
    error = error or "tracking"
    unread = "scans" if error == "tracking" else "drives"
    refuse(f"with --error {error}", **{unread: getattr(at, unread)})
    robot, config = options.simulated(robot_options)
    with progress_bar("driving", "drives") as progress:
        measured = measure_maps(
            [load_map(file) for file in find_maps(*maps)],
            robot,
            **given_of(at) | {unread: 0},
            seed=seed,
            threads=threads,
            progress=progress,
        )
    with progress_bar("fitting", "values of tau") as progress:
        result = fitted(
            measured, config, error=error, fit_tau=fit_tau, threads=threads, progress=progress
        )
    with working("writing the results"):
        written = result.save(output, robot, force=force)
    show(json, result.summary(), result.report(), *written)
    return 0 if result.in_metres else NOT_IN_METRES


def _refuse_with_drive(at: AtPlaces, error: str | None, fit_tau: bool) -> None:
    """Raise a ConfigError if an option of simulations was given."""
    places = None if at.places == AtPlaces.places else at.places
    own = {"error": error, "fit_tau": fit_tau or None, "places": places}
    refuse("with --drive", **own, scans=at.scans, drives=at.drives)


def _from_drive(
    maps: list[Path],
    recorded: DriveOptions,
    robot_options: RobotOptions,
    options: FieldOptions,
    threads: int | None,
    output: Path,
    force: bool,
    json: bool,
) -> int:
    """Fit the settings to a recorded drive."""
    from locplan._util.progress import progress_bar, working
    from locplan.recordings import calibrate_drive

    grid, recording = recorded.on_map(maps)
    config = options.of_drive(recording.lidar)
    robot = robot_options.on_drive(recording, replayed=False)
    with progress_bar("calibrating", "") as progress:
        result = calibrate_drive(
            recording, grid, config, robot=robot, threads=threads, progress=progress
        )
    with working("writing the results"):
        written = result.save(output, force=force)
    show(json, result.summary(), result.report(), *written)
    return 0 if result.field and result.field.in_metres else NOT_IN_METRES

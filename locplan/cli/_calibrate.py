"""The commands that compare fields with errors, and that fit the noise level to them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._application import NOT_IN_METRES
from locplan.cli._options import Output, ReferencedOptions, load_filter_map
from locplan.cli._robot_options import FieldOptions, RobotOptions


@typed.option_group("Simulation")
class AtPlaces:
    """The number of places drawn at random, and of the simulations at each."""

    places: typed.Pair | None = None
    """Number of places on each map; 100 by default."""
    drives: typed.Count | None = None
    """Number of drives of 10 m to each place; 16 by default."""
    scans: typed.Count | None = None
    """Number of single scans matched at each place; 16 by default."""


@typed.command(
    "evaluate lab.yaml -o evaluated",
    "evaluate lab.yaml --drive monday.mcap --every 10 -o evaluated",
)
def evaluate(
    maps: typed.MapFiles,
    /,
    *,
    config: Annotated[typed.ConfigFile, Parameter(group=typed.heading("Field"))] = None,
    recorded: ReferencedOptions = ReferencedOptions(),
    at: AtPlaces = AtPlaces(),
    robot_options: RobotOptions = RobotOptions(),
    filter_map: typed.FilterMap = None,
    seeded: typed.Seeded = typed.Seeded(),
    out: Output = Output(),
) -> None:
    """Show how well each field predicts where a robot is badly localized on your maps.

    It is simulated there, or, with --drive, what its own scans say along a recorded drive.

    Parameters
    ----------
    config
        Settings of a further field to compare with --drive, as calibrate wrote them.
    """
    recorded.check()
    result: Any
    if recorded.drive is not None:
        own = {"seed": None if seeded.seed == 1 else seeded.seed, "filter_map": filter_map}
        typed.refuse("with --drive", **vars(robot_options), **own, **vars(at))
        out.check(locplan.recordings.DriveEvaluation.files)
        more = {"config": locplan.load_config(config).estimator} if config else {}
        grid, drive = recorded.on_map(maps)
        estimators = locplan.recordings.estimators_for(drive.lidar) | more
        with progress_bar("comparing fields", "fields") as progress:
            result = locplan.recordings.evaluate_drive(
                drive, grid, estimators=estimators, threads=seeded.threads, progress=progress
            )
    else:
        typed.refuse("without --drive", config=config)
        robot = robot_options.simulated()
        out.check(locplan.simulation.Evaluation.files)
        grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*maps)]
        filters = load_filter_map(filter_map, grids)
        disc = min(robot.known_lidar.range, locplan.simulation.LARGEST_DISC)
        every = typed.given_of(at) | vars(seeded) | {"disc": disc, "filter_map": filters}
        with progress_bar("driving", "drives") as progress:
            result = locplan.simulation.evaluate(grids, robot, progress=progress, **every)
    out.finish(result)


@typed.option_group("Options")
class Fit:
    """What is fitted."""

    error: Literal["tracking", "match"] | None = None
    """Errors of the filter (tracking, by default), or of single scans."""
    fit_tau: bool = False
    """Fit the scale tau of sad's exponential weights, too."""


@typed.option_group("Output")
class SettingsOutput(Output):
    """Where the settings go."""

    output: Annotated[Path, typed.Target] = Path("calibrated.json")
    """File for the settings, for --config and --robot of other commands, with a picture
    NAME_calibration.png beside it; calibrated.json by default."""


@typed.command(
    "calibrate lab.yaml -o lab.json",
    "field lab.yaml --config lab.json",
    "calibrate lab.yaml --drive monday.mcap -o robot.json",
    "simulate lab.yaml --random 20 --robot robot.json",
)
def calibrate(
    maps: typed.MapFiles,
    /,
    *,
    fit: Fit = Fit(),
    at: AtPlaces = AtPlaces(),
    recorded: ReferencedOptions = ReferencedOptions(),
    robot_options: RobotOptions = RobotOptions(),
    seeded: typed.Seeded = typed.Seeded(),
    options: FieldOptions = FieldOptions(),
    out: SettingsOutput = SettingsOutput(),
) -> int:
    """Fit the noise level k (and tau), so that the field's deviations are errors in metres.

    With --drive, k is fitted to the posteriors of recorded scans instead, and the noise of
    odometry, of ranges, outliers and blocked beams are, too: simulations with --robot have them.

    Where that cannot be, the exit code is 3, the written file says so, and its use warns.
    """
    locplan.simulation.check_calibration(out.output, force=out.force)
    recorded.check()
    threads = seeded.threads
    if recorded.drive:
        typed.refuse("with --drive", **vars(fit), **vars(at))
        grid, recording = recorded.on_map(maps)
        config = options.of_drive(recording.lidar)
        robot = robot_options.on_drive(recording, replayed=False)
        with progress_bar("calibrating", "") as progress:
            found = locplan.recordings.calibrate_drive(
                recording, grid, config, robot=robot, threads=threads, progress=progress
            )
        out.finish(found)
        return 0 if getattr(found.field, "in_metres", False) else NOT_IN_METRES
    fitted: dict[str, Any] = {"error": fit.error or "tracking", "fit_tau": fit.fit_tau}
    unread = "scans" if fitted["error"] == "tracking" else "drives"
    typed.refuse(f"with --error {fitted['error']}", **{unread: getattr(at, unread)})
    robot, config = options.simulated(robot_options)
    places = typed.given_of(at) | {unread: 0} | vars(seeded)
    with progress_bar("driving", "drives") as progress:
        grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*maps)]
        measured = locplan.simulation.measure_maps(grids, robot, **places, progress=progress)
    with progress_bar("fitting", "values of tau") as progress:
        result = locplan.simulation.calibrate(
            measured, config, **fitted, threads=threads, progress=progress
        )
    out.finish(result, saved=(robot,))
    return 0 if result.in_metres else NOT_IN_METRES

"""The command that fits the noise level of a field to simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._application import NOT_IN_METRES
from locplan.cli._drive_options import DriveOptions
from locplan.cli._evaluate import AtPlaces
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import DriveSeed, MapFiles, Threads, command, option_group
from locplan.cli._output import Output, Target
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import given_of, refuse

app = command(
    "calibrate",
    "calibrate lab.yaml -o lab.json",
    "field lab.yaml --config lab.json",
    "calibrate lab.yaml --drive monday.mcap -o robot.json",
    "simulate lab.yaml --random 20 --robot robot.json",
)


@option_group("Options")
class Fit:
    """What is fitted."""

    error: Literal["tracking", "match"] | None = None
    """Errors of the filter (tracking, by default), or of single scans."""
    fit_tau: bool = False
    """Fit the scale tau of sad's exponential weights, too."""


@option_group("Output")
class SettingsOutput(Output):
    """Where the settings go."""

    output: Annotated[Path, Target] = Path("calibrated.json")
    """File for the settings, for --config and --robot of other commands, with a picture
    NAME_calibration.png beside it; calibrated.json by default."""


@app.default
def calibrate(
    maps: MapFiles,
    /,
    *,
    fit: Fit = Fit(),
    at: AtPlaces = AtPlaces(),
    recorded: DriveOptions = DriveOptions(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    options: FieldOptions = FieldOptions(),
    threads: Threads = None,
    out: SettingsOutput = SettingsOutput(),
) -> int:
    """Fit the noise level k (and tau), so that the field's deviations are errors in metres.

    With --drive, k is fitted to the posteriors of recorded scans instead, and the noise of
    odometry, of ranges, outliers and blocked beams are, too: simulations with --robot have them.

    Where that cannot be, the exit code is 3, the written file says so, and its use warns.
    """
    locplan.simulation.check_calibration(out.output, force=out.force)
    recorded.check()
    every: dict[str, Any] = {"threads": threads}
    if recorded.drive:
        refuse("with --drive", error=fit.error, fit_tau=fit.fit_tau or None, **at.changed())
        grid, recording = recorded.on_map(maps)
        config = options.of_drive(recording.lidar)
        robot = robot_options.on_drive(recording, replayed=False)
        with progress_bar("calibrating", "") as progress:
            found = locplan.recordings.calibrate_drive(
                recording, grid, config, robot=robot, progress=progress, **every
            )
        out.finish(found)
        return 0 if getattr(found.field, "in_metres", False) else NOT_IN_METRES
    error = fit.error or "tracking"
    unread = "scans" if error == "tracking" else "drives"
    refuse(f"with --error {error}", **{unread: getattr(at, unread)})
    robot, config = options.simulated(robot_options)
    places = given_of(at) | {unread: 0, "seed": seed}
    with progress_bar("driving", "drives") as progress:
        grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*maps)]
        measured = locplan.simulation.measure_maps(
            grids, robot, **places, progress=progress, **every
        )
    with progress_bar("fitting", "values of tau") as progress:
        result = locplan.simulation.calibrate(
            measured, config, error=error, fit_tau=fit.fit_tau, progress=progress, **every
        )
    out.finish(result, saved=(robot,))
    return 0 if result.in_metres else NOT_IN_METRES

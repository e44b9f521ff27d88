"""The commands that compare fields with errors, and that fit the noise level to them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import locplan
from locplan._util.progress import progress_bar
from locplan.cli import _types as typed
from locplan.cli._application import NOT_IN_METRES
from locplan.cli._options import Output, ReferencedOptions, Seeded
from locplan.cli._robot_options import FieldOptions, FilterMap


@typed.option_group("Simulation")
class AtPlaces(typed.Options):
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
class evaluate(typed.ManyMaps, FilterMap, ReferencedOptions, Seeded, AtPlaces, Output):
    """Show how well each field predicts where a robot is badly localized on your maps.

    It is simulated there, or, with --drive, what its own scans say along a recorded drive.
    """

    config: Annotated[typed.ConfigFile, typed.under("Field")] = None
    """Settings of a further field to compare with --drive, as calibrate wrote them."""

    def __call__(self) -> None:
        self.check_drive()
        self.finish(self._on_drive() if self.drive else self._simulated())

    def _on_drive(self) -> Any:
        self.refuse("with --drive", FilterMap, *["seed"] * (self.seed != 1), AtPlaces)
        self.check_output(locplan.recordings.DriveEvaluation.files)
        more = {"config": locplan.load_config(self.config).estimator} if self.config else {}
        grid, drive = self.on_map(self.maps)
        estimators = locplan.recordings.estimators_for(drive.lidar) | more
        with progress_bar("comparing fields", "fields") as progress:
            return locplan.recordings.evaluate_drive(
                drive, grid, estimators=estimators, threads=self.threads, progress=progress
            )

    def _simulated(self) -> Any:
        self.refuse("without --drive", "config")
        robot = self.simulated()
        self.check_output(locplan.simulation.Evaluation.files)
        grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*self.maps)]
        every = self.given(AtPlaces, Seeded) | {"filter_map": self.load_filter_map(*grids)}
        every["disc"] = min(robot.known_lidar.range, locplan.simulation.LARGEST_DISC)
        with progress_bar("driving", "drives") as progress:
            return locplan.simulation.evaluate(grids, robot, progress=progress, **every)


@typed.command(
    "calibrate lab.yaml -o lab.json",
    "field lab.yaml --config lab.json",
    "calibrate lab.yaml --drive monday.mcap -o robot.json",
    "simulate lab.yaml --random 20 --robot robot.json",
)
class calibrate(typed.ManyMaps, FieldOptions, ReferencedOptions, Seeded, AtPlaces, Output):
    """Fit the noise level k (and tau), so that the field's deviations are errors in metres.

    With --drive, k is fitted to the posteriors of recorded scans instead, and the noise of
    odometry, of ranges, outliers and blocked beams are, too: simulations with --robot have them.

    Where that cannot be, the exit code is 3, the written file says so, and its use warns.
    """

    error: Literal["tracking", "match"] | None = None
    """Errors of the filter (tracking, by default), or of single scans."""
    fit_tau: bool = False
    """Fit the scale tau of sad's exponential weights, too."""
    output: Annotated[Path, typed.Target, typed.under("Output")] = Path("calibrated.json")
    """File for the settings, for --config and --robot of other commands, with a picture
    NAME_calibration.png beside it; calibrated.json by default."""

    def __call__(self) -> int:
        locplan.simulation.check_calibration(self.output, force=self.force)
        self.check_drive()
        in_metres = self._on_drive() if self.drive else self._simulated()
        return 0 if in_metres else NOT_IN_METRES

    def _on_drive(self) -> bool:
        self.refuse("with --drive", "error", "fit_tau", AtPlaces)
        grid, recording = self.on_map(self.maps)
        config = self.field_on(recording.lidar)
        robot = self.robot_on(recording, replayed=False)
        with progress_bar("calibrating", "") as progress:
            found = locplan.recordings.calibrate_drive(
                recording, grid, config, robot=robot, threads=self.threads, progress=progress
            )
        self.finish(found)
        return getattr(found.field, "in_metres", False)

    def _simulated(self) -> bool:
        error = self.error or "tracking"
        unread = "scans" if error == "tracking" else "drives"
        self.refuse(f"with --error {error}", unread)
        robot, config = self.robot_and_field()
        robot = self.simulated(robot, config)
        places = self.given(AtPlaces, Seeded) | {unread: 0}
        with progress_bar("driving", "drives") as progress:
            grids = [locplan.load_map(file) for file in locplan.maps.find_maps(*self.maps)]
            measured = locplan.simulation.measure_maps(grids, robot, **places, progress=progress)
        fitted = self.given("fit_tau", "threads") | {"error": error}
        with progress_bar("fitting", "values of tau") as progress:
            result = locplan.simulation.calibrate(measured, config, **fitted, progress=progress)
        self.finish(result, saved=(robot,))
        return result.in_metres

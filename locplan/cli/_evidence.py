"""The commands that hold the fields against simulated errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from locplan.cli._options import (
    STYLE,
    AsJson,
    ConfigFile,
    Estimator,
    FieldOfView,
    Headings,
    Preset,
    Range,
    SensorName,
    Stride,
    Template,
    Threads,
    config_of,
    say_written,
    to_json,
)
from locplan.cli._simulated import (
    DriveCount,
    Folder,
    LidarName,
    MapFiles,
    Params,
    PlaceCount,
    Radius,
    ScanCount,
    Seed,
    Set,
    simulated,
)
from locplan.errors import ConfigError

app = typer.Typer(**STYLE)


@app.command()
def evaluate(
    maps: MapFiles,
    places: PlaceCount = 100,
    drives: DriveCount = 16,
    scans: ScanCount = 16,
    seed: Seed = 1,
    lidar: LidarName = None,
    sensor_range: Range = None,
    params: Params = None,
    settings: Set = None,
    robot_radius: Radius = 0.25,
    output: Folder = None,
    threads: Threads = None,
    as_json: AsJson = False,
) -> None:
    """How well each field predicts where a robot is badly localized on your maps."""
    from locplan._util.files import check_folder
    from locplan._util.progress import progress_bar
    from locplan.field import FieldConfig, Sad
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _evaluation as evaluation, _reports as reports

    config = FieldConfig() if sensor_range is None else FieldConfig(Sad(range=sensor_range))
    simulated_lidar, amcl, disturbances = simulated(config, lidar, params, settings)
    if output:
        check_folder(output)
    with progress_bar("driving", "drives") as progress:
        result = evaluation.evaluate(
            [load_map(file) for file in find_maps(*maps)],
            lidar=simulated_lidar,
            amcl=amcl,
            disturbances=disturbances,
            places=places,
            drives=drives,
            scans=scans,
            disc=config.estimator.reach,
            robot_radius=robot_radius,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    written = reports.write_evaluation(output, result) if output else []
    print(to_json(result.summary()) if as_json else reports.evaluation_table(result))
    say_written(*written)


@app.command()
def calibrate(
    maps: MapFiles,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Settings for --config of other commands, and beside them a picture of that name.",
        ),
    ] = Path("calibrated.json"),
    error: Annotated[
        str, typer.Option(help="tracking (of the filter) | match (of single scans).")
    ] = "tracking",
    fit_tau: Annotated[
        bool, typer.Option("--fit-tau", help="Fit tau, too, of sad's exponential weights.")
    ] = False,
    places: Annotated[int, typer.Option(min=10, help="On each map.")] = 100,
    drives: DriveCount = 16,
    scans: ScanCount = 16,
    seed: Seed = 1,
    lidar: LidarName = None,
    params: Params = None,
    settings: Set = None,
    robot_radius: Radius = 0.25,
    config_file: ConfigFile = None,
    preset: Preset = "default",
    sensor_range: Range = None,
    estimator: Estimator = "sad",
    sensor: SensorName = None,
    field_of_view: FieldOfView = None,
    headings: Headings = 0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    as_json: AsJson = False,
) -> None:
    """Fit the noise level k (and tau), so that the field's deviations are errors in metres."""
    from locplan._util.files import check_target
    from locplan._util.progress import progress_bar
    from locplan.maps import find_maps, load_map
    from locplan.simulation import _reports as reports
    from locplan.simulation._calibration import calibrate as fit
    from locplan.simulation._evaluation import KINDS
    from locplan.simulation._places import places_of

    if error not in KINDS:
        raise ConfigError(f"--error must be {' or '.join(KINDS)}, not {error!r}")
    kind: Any = error
    check_target(output, ".json")
    config = config_of(
        preset,
        sensor_range,
        template,
        stride,
        estimator,
        sensor,
        field_of_view,
        headings,
        config_file,
    )
    simulated_lidar, amcl, disturbances = simulated(config, lidar, params, settings)
    with progress_bar("driving", "drives") as progress:
        measured = places_of(
            [load_map(file) for file in find_maps(*maps)],
            lidar=simulated_lidar,
            amcl=amcl,
            disturbances=disturbances,
            places=places,
            drives=drives if error == "tracking" else 0,
            scans=scans if error == "match" else 0,
            robot_radius=robot_radius,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    with progress_bar("fitting", "values of tau") as progress:
        result = fit(
            measured,
            config,
            error=kind,
            fit_tau=fit_tau,
            threads=threads,
            progress=progress,
        )
    written = reports.write_calibration(output, result)
    print(to_json(result.summary()) if as_json else reports.calibration_table(result))
    say_written(*written)

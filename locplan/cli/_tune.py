"""The command that tunes AMCL's settings on a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._drive_options import DriveOptions
from locplan.cli._groups import (
    FIELD,
    GENERAL,
    INPUT,
    Force,
    Json,
    MapFile,
    Pair,
    command,
    option_group,
    results,
)
from locplan.cli._options import FieldOptions, RobotRadius, Threads, radius_of
from locplan.cli._simulation_options import SimulationOptions
from locplan.cli._values import load, refuse, show
from locplan.robots import PRESETS

app = command(
    "tune",
    "tune lab.yaml --lidar turtlebot4 -o tuned",
    "tune lab.yaml --lidar rplidar-a1 --params nav2_params.yaml -o tuned",
    "tune lab.yaml --drive monday.mcap --params nav2_params.yaml -o tuned",
)


@option_group(FIELD)
class Seen:
    """The robot's lidar."""

    lidar: Annotated[str | None, Parameter(choices=tuple(PRESETS))] = None
    """The lidar, or the robot that carries it, is one of these."""
    range: float | None = None
    """The lidar's range is that of its data sheet, or 6 [m]."""
    field_of_view: float | None = None
    """The field of view is that of the lidar that is named [deg]."""
    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """The lidar, the filter and the disturbances are those of this file, as calibrate wrote it."""


@option_group(GENERAL)
class Amount:
    """The number of drives."""

    paths: Annotated[int | None, Parameter(validator=Number(gte=5, lte=1000))] = None
    """The number of random paths of the search is 20 by default, and so is that of the others on
    which its result is judged; the time grows with it."""
    drives: Pair = 8
    """The number of drives along each path, at each level of disturbance, is 8 by default."""


@app.default
def tune(
    map_file: MapFile,
    /,
    *,
    amount: Amount = Amount(),
    recorded: DriveOptions = DriveOptions(),
    simulation: SimulationOptions = SimulationOptions(),
    seen: Seen = Seen(),
    robot_radius: RobotRadius = None,
    threads: Threads = None,
    output: Annotated[
        Path | None,
        results("The files nav2_params.yaml, tuning.json and tuning.png go to this folder."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find settings of AMCL that localize your robot better, and write them as Nav2's parameters.

    Your own settings (--params, or Nav2's defaults) and others drive along random
    shortest paths of the map in simulation, with a third of, once and three times
    the errors of odometry. The best at its worst level is judged against yours on
    other paths in other worlds. A copy of your file is written in which only those
    values differ that gain, or none if nothing is clearly better; those of --set;
    and do_beamskip, which is not simulated and is off where the laser model changes.

    With --drive, they are replayed on stretches of a recorded drive instead. Half
    of these are kept for the judgement; recorded poses should be better than AMCL's.

    This takes some three minutes on two cores, and more with more particles.
    """
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.robots import read_parameters
    from locplan.simulation.tuning import _files as files, _reports as reports
    from locplan.simulation.tuning._tune import PATHS, tune as search

    recorded.check()
    if recorded.drive:
        of_lidar = {name: value for name, value in vars(seen).items() if name != "config"}
        refuse("with --drive", paths=amount.paths, robot_radius=robot_radius, **of_lidar)
        _on_drive(map_file, amount, recorded, simulation, seen, threads, output, force, json)
        return
    options = FieldOptions(**vars(seen))
    # The table tells what works badly.
    simulated = simulation.simulated(
        options.to_config(), options.named_lidar(), file=seen.config, lints=False
    )
    radius = radius_of(robot_radius, simulation.params)
    grid = load(map_file)
    folder = reports.TUNING.into(output, force=force) if output else None
    if output:
        files.check_parameters(simulation.params)
    with progress_bar(f"tuning in {grid.name}", "") as progress:
        result = search(
            grid,
            **simulated,
            paths=amount.paths or PATHS,
            drives=amount.drives,
            robot_radius=radius,
            others=read_parameters(simulation.params).of("amcl"),
            threads=threads,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_tuning(folder, result, simulation.params) if folder else []
    about = {**result.summary(), "conclusion": reports.conclusion(result)}
    show(json, about, reports.tuning_table(result), *written)


def _on_drive(
    map_file: Path,
    amount: Amount,
    recorded: DriveOptions,
    simulation: SimulationOptions,
    seen: Seen,
    threads: int | None,
    output: Path | None,
    force: bool,
    json: bool,
) -> None:
    """Tune on stretches of a recorded drive."""
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.recordings import tune_on_drive
    from locplan.robots import read_parameters
    from locplan.simulation.tuning import _files as files, _reports as reports

    folder = reports.TUNING.into(output, force=force) if output else None
    if output:
        files.check_parameters(simulation.params)
    grid, recording = recorded.on_map([map_file])
    replayed = simulation.replayed(recording.lidar, config=seen.config, lints=False)
    with progress_bar(f"tuning on {recorded.drive.name if recorded.drive else ''}", "") as progress:
        result = tune_on_drive(
            recording,
            grid,
            **replayed,
            drives=amount.drives,
            others=read_parameters(simulation.params).of("amcl"),
            seed=simulation.seed,
            threads=threads,
            progress=progress,
        )
    with working("writing the results"):
        written = reports.write_tuning(folder, result, simulation.params) if folder else []
    about = {**result.summary(), "conclusion": reports.conclusion(result)}
    show(json, about, reports.tuning_table(result), *written)

"""The command `tune`: tune AMCL with simulated drives or recordings."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import command
from locplan.app.cli.arguments import INTEGER, MapFiles, PairCount, reject_options, show_default
from locplan.app.cli.groups import (
    SEED,
    FilterMapFile,
    OutputOptions,
    RecordingFiles,
    RobotOptions,
    Seed,
    Threads,
    load_filter_map,
    load_recording,
)
from locplan.errors import ConfigError


def _default_paths() -> int:
    from locplan.advice.tuning import PATHS

    return PATHS


def _default_drives() -> str:
    from locplan.advice.tuning import DRIVES
    from locplan.recordings.replays import RUNS

    return f"{DRIVES} or {RUNS}"


PathCount = Annotated[
    int | None,
    INTEGER,
    Parameter(validator=Number(gte=5, lte=1000)),
    show_default(_default_paths),
]
DriveCount = Annotated[PairCount | None, show_default(_default_drives)]


@command(
    "tune lab.yaml --lidar turtlebot4 --robot nav2_params.yaml -o tuned",
    "tune lab.yaml --recording drive.npz --robot nav2_params.yaml -o tuned",
)
def tune(
    maps: MapFiles,
    /,
    *,
    recording: RecordingFiles = (),
    paths: PathCount = None,
    drives: DriveCount = None,
    robot: RobotOptions = RobotOptions(),
    filter_map: FilterMapFile = None,
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Find AMCL settings that localize the robot better, and write them for Nav2.

    Simulates your settings and others along random paths, or replays recordings with them.

    Parameters
    ----------
    maps
        Map YAML files, folders with one, or built-in maps.
    paths
        Number of random paths.
    drives
        Number of drives per path, or of replays per recording.
    """
    from locplan.advice import tuning
    from locplan.advice.tuning import Tuning, tune_on_drive
    from locplan.maps.files import find_maps
    from locplan.recordings.replays import RUNS
    from locplan.robots.parameters import read_parameters
    from locplan.simulation.amcl_parameters import check_can_write_tuning

    output.check(Tuning.files)
    params = robot.find_nav2_file("amcl")
    if output.output:
        check_can_write_tuning(params)
    further_parameters = read_parameters(params).read_node_parameters("amcl")
    if not recording:
        grids = [locplan.load_map(file) for file in find_maps(*maps)]
        names = ", ".join(grid.name for grid in grids)
        with show_progress_bar(f"tuning in {names}", "") as progress:
            result = tuning.tune(
                grids,
                robot.load(),
                paths=paths or tuning.PATHS,
                drives=drives or tuning.DRIVES,
                filter_map=load_filter_map(filter_map, maps),
                further_parameters=further_parameters,
                seed=seed,
                threads=threads,
                progress=progress,
            )
    else:
        reject_options("with --recording", paths=paths)
        robot.check_recorded()
        if len(maps) not in (1, len(recording)):
            raise ConfigError(
                f"there are {len(recording)} recordings and {len(maps)} maps; name one map for all"
                " recordings, or one per recording in the same order"
            )
        map_files = maps * (len(recording) // len(maps))
        grids = [locplan.load_map(file) for file in map_files]
        recordings = [
            load_recording(file, grid, map_file)
            for file, grid, map_file in zip(recording, grids, map_files, strict=True)
        ]
        names = ", ".join(file.name for file in recording)
        with show_progress_bar(f"tuning on {names}", "") as progress:
            result = tune_on_drive(
                recordings,
                grids,
                robot.load_recorded(recordings[0]),
                drives=drives or RUNS,
                filter_map=load_filter_map(filter_map, maps),
                further_parameters=further_parameters,
                seed=seed,
                threads=threads,
                progress=progress,
            )
    output.finish(result, saved_details=(params,))

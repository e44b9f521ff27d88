"""The command `repair`: repair a map for the robot's filter."""

from __future__ import annotations

from typing import Annotated

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import command
from locplan.app.cli.arguments import Count, MapFile, PairCount, show_default
from locplan.app.cli.groups import SEED, OutputOptions, RobotOptions, Seed, Threads


def _default_paths() -> int:
    from locplan.advice.map_repair import N_PATHS

    return N_PATHS


def _default_drives() -> int:
    from locplan.advice.map_repair import N_DRIVES

    return N_DRIVES


PathCount = Annotated[Count | None, show_default(_default_paths)]
DriveCount = Annotated[PairCount | None, show_default(_default_drives)]


@command("repair lab.yaml --robot nav2_params.yaml -o repaired")
def repair(
    map_file: MapFile,
    /,
    *,
    paths: PathCount = None,
    drives: DriveCount = None,
    robot: RobotOptions = RobotOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Repair a map for the robot's filter, and simulate drives to measure the gain.

    Hollows solid walls and erases specks. Keep using the original map for planning.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    paths
        Number of random shortest paths.
    drives
        Number of drives per path and map.
    """
    from locplan.advice.map_repair import N_DRIVES, N_PATHS, RepairedMap, check_repair_helps
    from locplan.maps.files import read_map

    output.check(RepairedMap.files)
    check_repair_helps(robot.find_nav2_file("amcl"))
    simulated, grid = robot.load(), locplan.load_map(map_file)
    with show_progress_bar(f"repairing {grid.name}", "drives") as progress:
        result = locplan.repair(
            grid,
            simulated,
            paths=paths or N_PATHS,
            drives=drives or N_DRIVES,
            source=read_map(map_file)[1],
            seed=seed,
            threads=threads,
            progress=progress,
        )
    output.finish(result)

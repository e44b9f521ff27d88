"""Repair of maps: hollow walls, erase specks, and compare the maps by simulated drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from locplan._support.checks import check_integer
from locplan._support.files import write_text
from locplan._support.intervals import Interval
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.records import Result, Table, TableColumn
from locplan.errors import ConfigError
from locplan.export.servers import write_filter_map
from locplan.field.config import equip_robot
from locplan.maps.files import MapSource, format_corrected_yaml
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFaults, faults, measure_solidity
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.planning.queries import random_queries
from locplan.robots.amcl import Amcl
from locplan.robots.parameters import read_parameters
from locplan.robots.robot import Robot
from locplan.simulation.driver import drive_open
from locplan.simulation.drives import Drives, check_drive_count, make_rate_column
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import DriveSet, compare_drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure


N_PATHS, N_DRIVES = 5, 8
"""Default number of paths, and of drives along each path with each map and filter."""
DISTANCES = 10.0, 5.0, 2.0, 0.5
"""Minimum distances from start to goal of the paths; the first feasible one is used [m]."""

AFFECTED_FILTERS = (
    "The repaired map helps likelihood-field filters: AMCL, als_ros, MRPT, and beluga before 2.1.1."
    " SLAM Toolbox and Cartographer do not need it."
)


@dataclass(frozen=True)
class MapVerdict:
    """Verdict of simulated drives on one filter: original map against repaired map."""

    filter: str
    """The filter, in words."""
    lost_as_is: Interval
    """Share of the drives that were lost with the map as it is."""
    lost_repaired: Interval
    """The same with the repaired map."""
    rmse_ratio: Interval
    """Geometric mean of the ratio of errors: repaired map over original map."""
    verdict: str
    """The verdict on the repaired map: "better", "worse", "no difference" or "undecided"."""


@dataclass(frozen=True, eq=False, repr=False)
class RepairedMap(Result):
    """Result of `repair`: the map for the filter, and the verdict on it."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "repair",
        (
            *("repair.json", "repair.png", "repair.csv", "map_amcl.yaml", "map_amcl.pgm"),
            *("servers.yaml", "localizability.launch.xml", "amcl.yaml", "README.md", "map.yaml"),
        ),
        purposes={
            "README.md": "how to use the repaired map in Nav2",
            "map_amcl.yaml": "the repaired map, for AMCL alone",
            "map.yaml": "the map with the right threshold",
            "repair.png": "the picture",
            "repair.csv": "the repairs with their places",
        },
    )

    grid: OccupancyGrid
    """The original map, which stays the map for planning."""
    filter_map: OccupancyGrid
    """The map for the filter, of the same size, resolution and origin; equal to `grid` if nothing
    was repaired."""
    faults: MapFaults
    """The faults of the map."""
    verdicts: tuple[MapVerdict, ...]
    """Verdicts on Nav2's default filter and, if it differs, on the robot's filter."""
    seed: int
    """Seed of all random numbers."""
    no_verdict_reason: str = ""
    """Reason for a missing verdict on a repaired map; otherwise empty."""
    source: MapSource | None = None
    """The map's file, if its thresholds need a correction for planning as well; otherwise None."""

    def __repr__(self) -> str:
        return f"RepairedMap({self.grid.name or 'map'}, {self.n_changed:,} cells)"

    @property
    def n_changed(self) -> int:
        """Number of cells that differ on the map for the filter."""
        return int(np.count_nonzero(self.grid.cells != self.filter_map.cells))

    def summary(self) -> dict[str, object]:
        """Return faults, cells and verdicts as plain data for JSON."""
        return {
            **self.faults.summary(),
            "filter_map": {"name": self.filter_map.name, "digest": self.filter_map.digest},
            "changed_cells": self.n_changed,
            "verdicts": self.table().records(),
            "undriven": self.no_verdict_reason,
            "seed": self.seed,
        }

    def table(self) -> Table:
        """Return the table of the verdicts, a row for each filter."""
        columns = (
            TableColumn("filter", title="filter"),
            make_rate_column("lost_as_is", "lost, original"),
            make_rate_column("lost_repaired", "lost, repaired"),
            TableColumn("rmse_ratio", title="error ratio", interval=True),
            TableColumn("verdict", title="verdict"),
        )
        return Table.from_records(columns, self.verdicts)

    def _write(self, folder: FilePath, *related_results: object) -> None:
        self.table().write_csv(folder / "repair.csv")
        if self.n_changed:
            write_filter_map(folder, self.filter_map)
        if self.source is not None:
            write_text(folder / "map.yaml", format_corrected_yaml(self.source))

    def figure(self) -> Figure:
        """Draw the original and the repaired map, side by side."""
        from locplan.advice.figures import repair_figure

        return repair_figure(self)

    def report(self) -> str:
        """Return the repairs, and the verdicts of simulated drives, as text."""
        return repair_report(self)


def repair_report(repaired_map: RepairedMap) -> str:
    """Return the repairs, and the verdicts of simulated drives, as text."""
    lines = [repaired_map.faults.report()]
    if not repaired_map.n_changed:
        return "\n".join([*lines, "Nothing to repair."])
    if repaired_map.faults.is_solid:
        lines.append(AFFECTED_FILTERS)
    world, planning_map = "the original map", "the original map"
    if repaired_map.source is not None:
        free, occupied = repaired_map.source.corrected_thresholds
        planning_map = f"map.yaml (free_thresh {free:g}, occupied_thresh {occupied:g})"
        world = "the corrected map"
        if np.array_equal(
            *(grid.cells == OCCUPIED for grid in (repaired_map.grid, repaired_map.filter_map))
        ):
            lines.append(
                "The walls are unchanged: the correction helps planning, not a localized filter."
            )
    lines.append(
        f"{repaired_map.n_changed:,} cells differ in the filter's map. Plan on {planning_map}."
    )
    if repaired_map.no_verdict_reason:
        return "\n".join([*lines, f"No simulated drives: {repaired_map.no_verdict_reason}"])
    lines += [
        str(repaired_map.table()),
        f"Simulated drives in {world}, 95 % intervals. Error ratio: repaired over original map.",
    ]
    return "\n".join(lines)


def repair(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    source: MapSource | None = None,
    paths: int = N_PATHS,
    drives: int = N_DRIVES,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> RepairedMap:
    """Repair a map for the filter: hollow solid walls, erase specks, and simulate the effect.

    If dark greys of the file seem to be walls, or map_saver's grey is read as free, the thresholds
    are corrected first. The robot then drives in the corrected map, with the original and with the
    repaired map for its filter, and for Nav2's default AMCL. The n-th drives with both maps have
    the same world and seed.

    Parameters
    ----------
    grid : OccupancyGrid
        The map, which stays the map for planning.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round.
    source : MapSource, optional
        The map's file and thresholds, see `locplan.maps.read_map`; needed to find their faults.
    paths : int, default 5
        Number of random shortest paths for the drives, 1 to 1000.
    drives : int, default 8
        Number of drives along each, with each map and filter, 2 to 100,000.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    RepairedMap
        The map for the filter, and the verdict; `save` writes both and files for Nav2.

    Raises
    ------
    LocplanError
        If a number is out of its range, or the map is a mask for a costmap filter. If the robot
        fits nowhere, the result has no verdict instead.

    Examples
    --------
    >>> from locplan.maps import environments
    >>> repair(environments.make("two_corridors", resolution=0.1)).n_changed
    0
    """
    check_drive_count(drives)
    check_integer("paths", paths, 1, 1000)
    robot, map_faults = equip_robot(robot), faults(grid, source)
    map_faults.check_is_no_mask()
    mended, world = map_faults.repaired_map, map_faults.corrected_map
    file = None if world == grid else source
    if mended == grid:
        return RepairedMap(grid, mended, map_faults, (), seed)
    default = Amcl()
    filters = {"Nav2's defaults": replace(robot, filter=default)}
    if robot.filter != default:
        filters["the robot's"] = robot
    try:
        ways = _plan_random_paths(world, robot, paths, seed)
    except ConfigError as error:
        return RepairedMap(grid, mended, map_faults, (), seed, str(error), file)
    callbacks = split_progress(progress, [2 * paths * drives] * len(filters))
    verdicts = []
    for (name, filter_robot), part in zip(filters.items(), callbacks, strict=True):
        map_callbacks = split_progress(part, [paths * drives] * 2)
        as_is, hollow = (
            [
                *drive_open(
                    Simulator(
                        world, filter_robot, filter_map=filter_map, seed=seed, threads=threads
                    ),
                    ways,
                    range(drives),
                    progress=tell,
                ).values()
            ]
            for filter_map, tell in zip((grid, mended), map_callbacks, strict=True)
        )
        verdicts.append(_make_verdict(name, as_is, hollow))
    return RepairedMap(grid, mended, map_faults, tuple(verdicts), seed, source=file)


def _plan_random_paths(grid: OccupancyGrid, robot: Robot, count: int, seed: int) -> dict[str, Path]:
    """Plan shortest paths between random places, as far apart as the map allows."""
    costs = Costmap.blank(grid, robot=robot)
    for distance in DISTANCES:
        try:
            queries = random_queries(costs, count, seed, min_distance=distance)
        except ConfigError:
            if distance == DISTANCES[-1]:
                raise
            continue
        break
    path_pairs = ((query.name, plan(costs, query.start, query.goal).path) for query in queries)
    return {name: path for name, path in path_pairs if path is not None}


def _make_verdict(
    name: str, original_drives: Sequence[Drives], repaired_drives: Sequence[Drives]
) -> MapVerdict:
    """Return the verdict on the drives along all paths together."""
    comparison = compare_drives(
        DriveSet.from_drives(original_drives), DriveSet.from_drives(repaired_drives)
    )
    return MapVerdict(name, *comparison.lost, comparison.ratio, comparison.word)


def check_repair_helps(parameters: FilePath | None) -> None:
    """Raise a ConfigError if AMCL uses the beam model, which solid walls do not mislead.

    Parameters
    ----------
    parameters : path, optional
        File of Nav2's parameters; without it AMCL has its defaults, which need the repair.
    """
    if read_parameters(parameters).read_node_parameters("amcl").get("laser_model_type") == "beam":
        raise ConfigError(
            f"{parameters}: AMCL's beam model needs no repaired map. Its rays end at the first"
            " black cell, so solid walls do not mislead it. Keep using the original map"
        )


def format_solid_wall_warning(grid: OccupancyGrid) -> str | None:
    """Return the warning that solid walls mislead the filter; None without solid walls.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    """
    if not measure_solidity(grid).is_solid:
        return None
    return (
        f"{grid.name or 'the map'}: the map has solid walls, which make AMCL lose the robot. Run"
        " `locplan repair` and pass its map_amcl.yaml as --filter-map"
    )

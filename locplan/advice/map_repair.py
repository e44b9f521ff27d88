"""Repaired maps: walls hollowed, specks erased, and the simulated drives that decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from locplan._support.checks import check_integer
from locplan._support.intervals import Interval
from locplan._support.output import Results
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.records import Column, Result, Table
from locplan.errors import ConfigError
from locplan.export.servers import write_filter_map
from locplan.field.config import equip_robot
from locplan.maps.files import MapSource, corrected_yaml
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
from locplan.simulation.drives import Drives, check_drives
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import DriveSet, compare_drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PATHS, DRIVES = 5, 8
"""Default number of paths of the verdict, and of drives along each with each map and filter."""
DISTANCES = 10.0, 5.0, 2.0, 0.5
"""Minimum distances from start to goal of the verdict's paths, the first that the map has [m]."""

CONCERNED = (
    "this helps likelihood fields: AMCL's, als_ros, MRPT and beluga before 2.1.1; SLAM Toolbox and"
    " Cartographer need it not"
)


@dataclass(frozen=True)
class MapVerdict:
    """What simulated drives say of a filter with the map as it is, and with the mended one."""

    filter: str
    """The filter, in words."""
    lost_as_is: Interval
    """Share of the drives that were lost with the map as it is."""
    lost_mended: Interval
    """The same with the mended map."""
    rmse_ratio: Interval
    """Ratio of the error with the mended map to that with the map as it is: geometric mean."""
    verdict: str
    """The verdict on the mended map: "better", "worse", "no difference" or "undecided"."""


@dataclass(frozen=True, eq=False, repr=False)
class RepairedMap(Result):
    """A map mended for the filter; made by `mend`."""

    files: ClassVar[Results] = Results(
        "mend",
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
    """The map as it is, which stays that for planning."""
    filter_map: OccupancyGrid
    """The map for the filter, of the same size, resolution and origin; where nothing was mended,
    it equals the other."""
    faults: MapFaults
    """The faults of the map."""
    verdicts: tuple[MapVerdict, ...]
    """What drives say, first of Nav2's defaults, then of the robot's filter if that is another."""
    seed: int
    """Seed of all random numbers."""
    undriven: str = ""
    """Why there is no verdict though something was mended; else empty."""
    source: MapSource | None = None
    """How the map was read, if its thresholds are to be changed for planning, too; else None."""

    def __repr__(self) -> str:
        return f"RepairedMap({self.grid.name or 'map'}, {self.n_changed:,} cells)"

    @property
    def n_changed(self) -> int:
        """Number of cells that are other ones on the map for the filter."""
        return int(np.count_nonzero(self.grid.cells != self.filter_map.cells))

    def summary(self) -> dict[str, object]:
        """Faults, cells and verdicts, fit for JSON."""
        return {
            **self.faults.summary(),
            "filter_map": {"name": self.filter_map.name, "digest": self.filter_map.digest},
            "changed_cells": self.n_changed,
            "verdicts": self.table().records(),
            "undriven": self.undriven,
            "seed": self.seed,
        }

    def table(self) -> Table:
        """The verdicts, a row for each filter."""
        share = {"people": "%", "digits": 0, "interval": True}
        columns = (
            Column("filter", title="filter"),
            Column("lost_as_is", title="lost, as is", **share),  # type: ignore[arg-type]
            Column("lost_mended", title="repaired", **share),  # type: ignore[arg-type]
            Column("rmse_ratio", title="error ratio", interval=True),
            Column("verdict", title="verdict"),
        )
        return Table.from_records(columns, self.verdicts)

    def _write(self, folder: FilePath, *related: object) -> None:
        self.table().write_csv(folder / "repair.csv")
        if self.n_changed:
            write_filter_map(folder, self.filter_map)
        if self.source is not None:
            (folder / "map.yaml").write_text(corrected_yaml(self.source), "utf-8")

    def figure(self) -> Figure:
        """Draw the map as it is and mended, side by side."""
        from locplan.advice.figures import repair_figure

        return repair_figure(self)

    def report(self) -> str:
        """What was mended, and what drives say."""
        return repair_report(self)


def repair_report(mended: RepairedMap) -> str:
    """What was mended, and what drives say."""
    lines = [mended.faults.report()]
    if not mended.n_changed:
        return "\n".join([*lines, "nothing to mend"])
    if mended.faults.is_solid:
        lines.append(CONCERNED)
    world, planning_map = "as it is", "the map as it is"
    if mended.source is not None:
        free, occupied = mended.source.corrected_thresholds
        planning_map = f"map.yaml, which has free_thresh {free:g} and occupied_thresh {occupied:g}"
        world = "as its greys are meant"
        if np.array_equal(*(grid.cells == OCCUPIED for grid in (mended.grid, mended.filter_map))):
            lines.append(
                "no wall is another: a filter that knows its place gains nothing; plans do"
            )
    lines.append(
        f"{mended.n_changed:,} cells are other ones for the filter; plan on {planning_map}"
    )
    if mended.undriven:
        return "\n".join([*lines, f"no verdict by drives: {mended.undriven}"])
    lines += [
        str(mended.table()),
        f"simulated drives in the map {world} [95 %]; error ratio: repaired over as is",
    ]
    return "\n".join(lines)


def repair(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    source: MapSource | None = None,
    paths: int = PATHS,
    drives: int = DRIVES,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> RepairedMap:
    """Mend a map for the filter: hollow solid walls, and erase specks; drives judge it.

    Where dark greys of the file seem to be walls, or map_saver's grey is read as free, the map is
    read as it is meant, by other thresholds.

    The robot drives in this map. Its filter has the map as it is or the mended one, and so has
    Nav2's AMCL with its defaults. The n-th drives of both have the same world and seed.

    Parameters
    ----------
    grid : OccupancyGrid
        The map, which stays the one for planning.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round.
    source : MapSource, optional
        How its pixels were read, see `locplan.maps.read_map`, of which faults are told, too.
    paths : int, default 5
        Number of random shortest paths of the verdict, 1 to 1000.
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
        The map for the filter, and the verdict; `save` writes them with what Nav2 needs.

    Raises
    ------
    LocplanError
        If a number is out of its range, or the map is a mask for a costmap filter. Where the robot
        can drive nowhere, there is no verdict.

    Examples
    --------
    >>> from locplan.maps import environments
    >>> mend(environments.make("two_corridors", resolution=0.1)).changed
    0
    """
    check_drives(drives)
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
    """Shortest paths between random places, far apart where the map has such."""
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


def _make_verdict(name: str, as_is: Sequence[Drives], mended: Sequence[Drives]) -> MapVerdict:
    """The verdict of the drives along all paths together."""
    comparison = compare_drives(DriveSet.from_drives(as_is), DriveSet.from_drives(mended))
    return MapVerdict(name, *comparison.lost, comparison.ratio, comparison.word)


def check_concerned(parameters: FilePath | None) -> None:
    """Raise a ConfigError if Nav2's parameters have AMCL cast rays, which no black misleads.

    Parameters
    ----------
    parameters : path, optional
        File of Nav2's parameters; without it AMCL has its defaults, and is concerned.
    """
    if read_parameters(parameters).read_node_parameters("amcl").get("laser_model_type") == "beam":
        raise ConfigError(
            f"{parameters}: not concerned: AMCL's beam model casts rays, which end at the first"
            " black cell, so that the inside of walls does not mislead it"
        )


def format_solid_wall_warning(grid: OccupancyGrid) -> str | None:
    """Say in a sentence that a filter gets lost on a map, and that it can be mended; else None.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    """
    if not measure_solidity(grid).is_solid:
        return None
    return (
        f"{grid.name or 'the map'}: walls are black inside, so that AMCL's particles gain by"
        " standing in them; run locplan repair first, and give its map_amcl.yaml as --filter-map"
    )

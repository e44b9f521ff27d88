"""Simulated drives along some paths of one map; another process can compile their kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.intervals import Interval
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.records import Result, Table, TableColumn, extract_values
from locplan._support.tables import format_table, nan_to_none
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import (
    ARRIVAL_COLUMNS,
    ENDING_COLUMNS,
    Arrivals,
    ClosedLoopSettings,
    tabulate_ends,
)
from locplan.simulation.driver import drive_closed, drive_open
from locplan.simulation.drives import (
    DEFAULT_DRIVES,
    DRIVE_COLUMNS,
    Drives,
    check_drive_count,
    compute_rmse_ratios,
    tabulate_profiles,
)
from locplan.simulation.simulator import Simulator
from locplan.simulation.worlds import summarize_filter_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Result):
    """Drives along some paths on one map."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "simulation",
        ("simulation.json", "simulation.png", "errors.csv"),
        purposes={
            "simulation.png": "the picture",
            "errors.csv": "the errors along the path",
            "arrivals.csv": "the end of each closed-loop drive",
        },
    )

    grid: OccupancyGrid
    """The map."""
    paths: Mapping[str, Path]
    """Paths by name; the others are compared with the first."""
    drives: Mapping[str, Drives]
    """Drives of each path, equally many; the n-th of paths with the same ends are pairs."""
    robot: Robot
    """The robot that was simulated."""
    seed: int
    """Seed of all random numbers."""
    costs: Costmap | None = None
    """Costmap that the paths were planned on; None if that is not known."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, where it is not the one that was driven in."""
    arrivals: Mapping[str, Arrivals] | None = None
    """Closed-loop drives along each path, where they were asked for."""

    def __repr__(self) -> str:
        drive_texts = ", ".join(f"{name}: {drives!r}" for name, drives in self.drives.items())
        return f"Simulation({self.grid.name or 'map'}, {drive_texts})"

    def summary(self) -> dict[str, object]:
        """Errors of each path, and the ratios of their RMSE to the first's, fit for JSON."""
        map_of = {"name": self.grid.name, "digest": self.grid.digest}
        record: dict[str, object] = {
            **(summarize_costs(self.costs) if self.costs else {"map": map_of}),
            "paths": {
                name: extract_values(DRIVE_COLUMNS, path_drives)
                for name, path_drives in self.drives.items()
            },
            "rmse_ratio": {
                name: list(ratio) for name, ratio in compute_rmse_ratios(self.drives).items()
            },
            "seed": self.seed,
            "robot": self.robot.summary(),
            **summarize_filter_map(self.filter_map),
        }
        if self.arrivals:
            record["arrivals"] = {
                name: {
                    "drives": len(arrivals.drives),
                    "standstills": arrivals.standstills,
                    **extract_values(ENDING_COLUMNS, arrivals),
                }
                for name, arrivals in self.arrivals.items()
            }
        return nan_to_none(record)

    def table(self) -> Table:
        """Length and errors of each path, and the ratio of its RMSE to the first's."""
        ratios, unit_ratio = compute_rmse_ratios(self.drives), Interval(1.0, math.nan, math.nan)
        ratio = TableColumn(
            "rmse_ratio", "", f"error over {next(iter(self.drives))}'s", interval=True
        )
        rows = {
            name: [
                name,
                *(column.extract_value(path_drives) for column in DRIVE_COLUMNS),
                ratios.get(name, unit_ratio),
            ]
            for name, path_drives in self.drives.items()
        }
        for name, path_drives in (self.arrivals or {}).items():
            rows[name] += [column.extract_value(path_drives) for column in ARRIVAL_COLUMNS]
        columns = (
            TableColumn("path", title=""),
            *DRIVE_COLUMNS,
            ratio,
            *(ARRIVAL_COLUMNS if self.arrivals else ()),
        )
        return Table(columns, tuple(map(tuple, rows.values())))

    def _write(self, folder: FilePath, *related_results: Any) -> None:
        tabulate_profiles(self.drives).write_csv(folder / "errors.csv")
        if self.arrivals:
            tabulate_ends(self.arrivals).write_csv(folder / "arrivals.csv")

    def figure(self) -> Figure:
        """Paths over the map, coloured by the mean error there, and the error along each of
        them.
        """
        from locplan.simulation.figures import simulation_figure

        return simulation_figure(self)

    def report(self) -> str:
        """Table of the errors along each path, side by side."""
        return format_simulation(self)


def format_simulation(simulation: Simulation) -> str:
    """Table of the errors along each path, side by side."""
    head, *rows = simulation.table().format_transposed()
    if len(head) == 2:  # one path has no ratio
        del rows[sum(column.title is not None for column in DRIVE_COLUMNS)]
    count = len(next(iter(simulation.drives.values())).errors)
    caption = f"errors of the position, of {count} drives each"
    if arrivals := simulation.arrivals:
        caption += f", and the ends of {len(next(iter(arrivals.values())).drives)} more"
        # Ends that no drive has are not worth a line.
        empty_rows = [
            share.heading
            for share in ENDING_COLUMNS[1:]
            if not any(
                share.extract_value(path_arrivals).value for path_arrivals in arrivals.values()
            )
        ]
        rows = [row for row in rows if row[0] not in empty_rows]
    return f"{format_table(head, rows)}\n{caption} [95 % intervals]\nwith {simulation.robot.title}"


def simulate(
    grid: OccupancyGrid,
    paths: Mapping[str, Path | ArrayLike],
    robot: Robot | None = None,
    *,
    drives: int = DEFAULT_DRIVES,
    closed: ClosedLoopSettings | None = None,
    filter_map: OccupancyGrid | None = None,
    seed: int = 1,
    threads: int | None = None,
    costs: Costmap | None = None,
    progress: ProgressCallback | None = None,
) -> Simulation:
    """Drive some paths of one map with a particle filter.

    In open-loop drives the robot follows the path exactly. In closed-loop drives a pursuit follower
    steers it by the filter's pose; they show whether it reaches the goal.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : mapping of str to Path, or to (n, 2) array
        Paths by name, each within the free cells; the first is the baseline. Arrays are positions
        in the world [m].
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your robot, such as from `Robot.load`.
    drives : int, default 100
        Number of drives along each path, 2 to 100,000. Fewer are quicker, and widen the intervals.
    closed : Closed, optional
        Settings of additional closed-loop drives along each path; none by default.
    filter_map : OccupancyGrid, optional
        The filter's map, in the frame of `grid`, if it differs; by default `grid`. Resolution,
        origin and size may also differ.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, on any number of threads.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    costs : Costmap, optional
        Costmap that the paths were planned on, for the result's summary.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Simulation
        The errors along each path.

    Raises
    ------
    LocplanError
        If there is no path, one leaves the free cells, a number is out of its range, or a
        car-like robot is to be steered.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> straight = Path(np.array([[2.0, 3.0], [6.0, 3.0]]))
    >>> result = simulate(grid, {"straight": straight}, drives=4)
    >>> result.drives["straight"].lost_rate.value
    0.0
    """
    check_drive_count(drives)
    if not isinstance(paths, Mapping):
        raise ConfigError("paths must be a mapping of names to paths, such as {'mine': plan.path}")
    if not paths:
        raise ConfigError("there must be at least one path to drive")
    zones = costs.zones if costs else None
    simulator = Simulator(
        grid, robot, filter_map=filter_map, seed=seed, threads=threads, zones=zones
    )
    routes = {
        name: path if isinstance(path, Path) else Path(np.asarray(path))
        for name, path in paths.items()
    }
    steered = closed.drives if closed else 0
    open_progress, closed_progress = split_progress(
        progress, [drives * len(routes), steered * len(routes)]
    )
    open_drives = drive_open(simulator, routes, range(drives), progress=open_progress)
    arrivals = None
    if closed:
        arrivals = drive_closed(
            simulator, routes, range(steered), replan=closed.replan, progress=closed_progress
        )
    return Simulation(grid, routes, open_drives, simulator.robot, seed, costs, filter_map, arrivals)

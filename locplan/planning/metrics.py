"""Metrics of paths on a costmap, and of maps with several lidars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Array, Bools, Floats, Ints
from locplan._support.progress import ProgressCallback, chain_progress
from locplan._support.records import Table, TableColumn
from locplan._support.saved import EqualByValue
from locplan.errors import LocplanError
from locplan.field.config import COARSE_STRIDE, FieldConfig
from locplan.field.covariance import DEGENERATE
from locplan.field.fisher import Fused
from locplan.field.store import load_or_compute
from locplan.maps.grid import OccupancyGrid
from locplan.maps.zones import Zones
from locplan.planning.costmap import ROBOT_RADIUS, Costmap
from locplan.planning.path import AnyPath, Path, as_path, stack_poses
from locplan.robots.lidar import Lidar
from locplan.robots.robot import Robot, format_radius

MAX_CELLS = 10**7
"""Maximum number of cells that a path may cross."""


def find_cells_of_path(grid: OccupancyGrid, path: Path, headings: int = 1) -> list[Array]:
    """Return headings, rows and columns of the cells that a path crosses, and lengths in them [m].

    Parameters
    ----------
    grid : OccupancyGrid
        The map; cells may lie outside it.
    path : Path
        The path in the world [m].
    headings : int, default 1
        Number of headings, evenly spaced from 0 on; over 1e7 cells are a LocplanError.
    """
    poses, sizes, _ = stack_poses(path)
    return find_cells_of_paths(grid, poses, sizes, headings)[:4]


def find_cells_of_paths(
    grid: OccupancyGrid, poses: Floats, sizes: Ints, headings: int
) -> list[Array]:
    """Return the cells that several paths cross, as headings, rows, columns, lengths, path numbers.

    Cells are in order of travel. A path, or a part of it in one heading, that has no length has
    one cell with length 0.

    Parameters
    ----------
    grid : OccupancyGrid
        The map; cells may lie outside it.
    poses : (k, 3) array
        Poses of all paths, path by path [m, m, rad].
    sizes : (m,) array
        Number of poses of each path, at least 1.
    headings : int
        Number of headings, evenly spaced from 0 on; the poses' headings do not count if it is 1.
    """
    from locplan._support.kernels.rays import find_line_cells

    number = np.repeat(np.arange(len(sizes)), sizes)
    is_alone = np.repeat(sizes == 1, sizes)  # such a path is a line without length
    first = np.flatnonzero(is_alone | np.append(number[1:] == number[:-1], False))
    last = np.where(is_alone[first], first, first + 1)
    number, heading = number[first], np.zeros(len(first), np.int64)
    begin, end = poses[first, :2], poses[last, :2]
    if headings > 1:
        lines, begin, end, heading = _split_by_heading(poses[first], poses[last], number, headings)
        number = number[lines]
    begin, end = (np.column_stack(grid.world_to_grid(*xy.T)) for xy in (begin, end))
    if np.bincount(number, np.abs(end - begin).sum(axis=1)).max() > MAX_CELLS:
        raise LocplanError(
            f"the path crosses over {MAX_CELLS} cells of {grid.resolution:g} m; give a path in"
            " metres on this map"
        )
    row, col, length, line = find_line_cells(begin, end)
    is_new = (np.diff(number, prepend=-1) != 0) | (np.diff(heading, prepend=-1) != 0)
    part = np.cumsum(is_new) - 1
    empty = np.flatnonzero(is_new)[np.bincount(part[line], minlength=part[-1] + 1) == 0]
    if empty.size:
        at = np.floor(begin[empty]).astype(np.int64)
        line = np.concatenate([line, empty])
        order = np.argsort(line, kind="stable")
        row, col = np.concatenate([row, at[:, 0]])[order], np.concatenate([col, at[:, 1]])[order]
        length, line = np.concatenate([length, np.zeros(len(empty))])[order], line[order]
    return [heading[line], row, col, length * grid.resolution, number[line]]


def _split_by_heading(
    begin: Floats, end: Floats, number: Ints, headings: int
) -> tuple[Ints, Floats, Floats, Ints]:
    """Split paths' lines between poses (n, 3) at changes of the nearest of several even headings.

    Along each line the heading turns evenly, the shorter way. Returned are the number of the line
    that a part belongs to, the begin and the end of the part, (m, 2), and its nearest heading.
    """
    # The full turns to add so that headings go on without jumps along each path.
    turns = -np.round((end[:, 2] - begin[:, 2]) / (2 * np.pi))
    total = np.concatenate([[0.0], np.cumsum(turns)])
    first = np.flatnonzero(np.diff(number, prepend=-1) != 0)[number]
    before = begin[:, 2] + 2 * np.pi * (total[:-1] - total[first])
    after = end[:, 2] + 2 * np.pi * (total[1:] - total[first])
    # In steps between headings, shifted so that the nearest heading changes at whole numbers.
    before, after = (angle / (2 * np.pi) * headings + 0.5 for angle in (before, after))
    changes = np.floor(after) - np.floor(before)
    counts = np.abs(changes).astype(np.int64) + 1
    lines = np.repeat(np.arange(len(begin)), counts)
    steps = np.arange(len(lines)) - np.repeat(np.cumsum(counts) - counts, counts)
    way = np.sign(changes)[lines]
    heading = np.floor(before)[lines] + way * steps
    # A further part begins where the heading crosses the border to its nearest heading.
    starts, is_further = begin[lines, :2], steps > 0
    crossed = lines[is_further]
    border = np.where(way > 0, heading, heading + 1)[is_further]
    share = (border - before[crossed]) / (after - before)[crossed]
    starts[is_further] += share[:, None] * (end - begin)[crossed, :2]
    is_last = np.append(lines[1:] != lines[:-1], True)
    ends = np.where(is_last[:, None], end[lines, :2], np.roll(starts, -1, axis=0))
    return lines, starts, ends, heading.astype(np.int64) % headings


@dataclass(frozen=True, eq=False, repr=False)
class PathMetrics(EqualByValue):
    """Metrics of a path, by the exact line integral over the map's cells.

    Metrics that depend on a field are NaN for a costmap without one.
    """

    length: float
    """Length of the path [m]."""
    cost: float
    """J, the integral of the costmap's density [m]; infinite if a blocked cell is crossed."""
    integrated_e: float
    """Integral of e [m^2 rad m]."""
    integrated_u: float
    """Integral of u, the degenerate metres [m]."""
    mean_e: float
    """Mean e over the length [m^2 rad]."""
    max_e: float
    """Maximum e on the path [m^2 rad]."""
    degenerate_share: float
    """Share of the length with u above 0.5, 0..1."""
    longest_degenerate: float
    """Length of the longest stretch with u above 0.5 [m]."""
    clearance: float
    """Minimum distance from the centre of a crossed cell to an occupied one [m]."""

    def __repr__(self) -> str:
        return (
            f"PathMetrics({self.length:.2f} m long, cost {self.cost:.2f} m, degenerate"
            f" {self.integrated_u:.2f} m, integrated e {self.integrated_e:.3g} m² rad m,"
            f" clearance {self.clearance:.2f} m)"
        )


METRICS: tuple[TableColumn, ...] = (
    TableColumn("length", "m", "length"),
    TableColumn("cost", "m", "cost J"),
    TableColumn("integrated_u", "m", "degenerate metres (∫u ds)"),
    TableColumn("integrated_e", "m² rad m", "∫e ds", 4),
    TableColumn("mean_e", "m² rad", "mean e", 5),
    TableColumn("max_e", "m² rad", "max e", 5),
    TableColumn("degenerate_share", "", f"share with u > {DEGENERATE:g}", 0, "%"),
    TableColumn("longest_degenerate", "m", f"longest with u > {DEGENERATE:g}"),
    TableColumn("clearance", "m", "least clearance"),
)
"""Columns of the metrics of a path: its title, unit and digits by the name of the field."""


def path_metrics(costs: Costmap, path: AnyPath) -> PathMetrics:
    """Measure a path on a costmap, in the path's headings if it and the costmap have headings.

    Where the path leaves the map or touches cells that are not free, the cost is infinite and the
    integrals of e and u are NaN.

    Parameters
    ----------
    costs : Costmap
        The costmap; its e and u count whatever the path was planned on.
    path : Path, Plan, or (n, 2) or (n, 3) array
        The path in the world [m, m, rad].

    Raises
    ------
    LocplanError
        If it is no path, or crosses over 1e7 cells.
    """
    path = as_path(path)
    layers: list[Any] = [costs.e[None], costs.u[None], costs.density[None]]
    if path.heading is not None and costs.u_of_heading is not None:
        layers = [costs.e_of_heading, costs.u_of_heading, costs.density_of_heading]
    *at, lengths = find_cells_of_path(costs.grid, path, len(layers[0]))
    e, u = (_sample_layers(layer, at, np.nan) for layer in layers[:2])
    density, clearance = _sample_layers(layers[2], at, np.inf), costs.grid.clearance[None]
    integrated_e, share, longest = float(e @ lengths), np.nan, np.nan
    if np.isfinite(u).all():
        share, longest = _measure_stretches(u > DEGENERATE, lengths)
    return PathMetrics(
        length=path.length,
        cost=float(_sum_by_path(density, lengths, np.zeros(len(lengths), np.int64))[0]),
        integrated_e=integrated_e,
        integrated_u=float(u @ lengths),
        mean_e=integrated_e / path.length if path.length else float(e[0]),
        max_e=float(e.max()),
        degenerate_share=share,
        longest_degenerate=longest,
        clearance=float(_sample_layers(clearance, [0 * at[0], *at[1:]], 0.0).min()),
    )


def crosses_no_go(zones: Zones, grid: OccupancyGrid, path: Path) -> bool:
    """True if a path enters a cell of a no-go zone.

    Parameters
    ----------
    zones : Zones
        The zones.
    grid : OccupancyGrid
        The map.
    path : Path
        The path in the world.
    """
    if not zones.has_kind("no-go"):
        return False
    *at, _ = find_cells_of_path(grid, path, 1)
    return bool(_sample_layers(zones.cells(grid, "no-go")[None], at, 0.0).any())


def path_cost(costs: Costmap, path: AnyPath | Sequence[AnyPath]) -> Any:
    """Return J of a path, or of each of several paths, as `path_metrics` has it.

    Parameters
    ----------
    costs : Costmap
        The costmap whose density is integrated.
    path : Path, Plan, or (n, 2) or (n, 3) array, or several of them
        The path in the world [m, m, rad]; a list of paths, or an array (m, n, 2) or (m, n, 3).

    Returns
    -------
    float, or (m,) array
        The cost [m], infinite if a blocked cell is crossed.

    Raises
    ------
    LocplanError
        If it is no path, or crosses over 1e7 cells.

    Examples
    --------
    >>> from locplan.maps import OccupancyGrid
    >>> costs = Costmap.blank(OccupancyGrid([[254, 254, 0]], resolution=1.0), robot=0.0)
    >>> path_cost(costs, [[0.5, 0.5], [1.5, 0.5]])
    1.0
    >>> lines = np.array([[[0.5, 0.5], [1.0, 0.5]], [[0.5, 0.5], [2.5, 0.5]]])
    >>> path_cost(costs, lines).tolist()
    [0.5, inf]
    """
    poses, sizes, is_single = stack_poses(path)
    values = np.empty(len(sizes))
    has_heading = ~np.isnan(poses[np.cumsum(sizes) - sizes, 2]) & (costs.u_of_heading is not None)
    for headed in np.unique(has_heading):
        selection = has_heading == headed
        density = costs.density_of_heading if headed else costs.density[None]
        part = poses[np.repeat(selection, sizes)]
        *at, lengths, number = find_cells_of_paths(costs.grid, part, sizes[selection], len(density))
        values[selection] = _sum_by_path(_sample_layers(density, at, np.inf), lengths, number)
    return float(values[0]) if is_single else values


def _sum_by_path(density: Floats, lengths: Floats, number: Ints) -> Floats:
    """Return J of paths [m], by the numbers of the paths that cross cells.

    A blocked cell costs inf, also if its length is 0.
    """
    is_blocked = ~np.isfinite(density)
    sums = np.bincount(number, np.where(is_blocked, 0.0, density) * lengths)
    return np.where(np.bincount(number, is_blocked) > 0, np.inf, sums)


def compute_profile(
    costs: Costmap, path: AnyPath, layer: NDArray[np.floating]
) -> tuple[Floats, Floats]:
    """Return the steps of a layer along a path.

    Parameters
    ----------
    costs : Costmap
        The costmap, whose map has the layer's cells.
    path : Path, Plan, or (n, 2) or (n, 3) array
        The path in the world [m, m, rad]; with headings if the layer has several.
    layer : (H, W) or (n, H, W) array
        Values of the cells, such as `costs.u`, or those for n headings evenly spaced from 0 on,
        such as `costs.u_of_heading`.

    Returns
    -------
    distance : (k + 1,) array
        Distance along the path at which each crossed cell begins, and the path's length [m].
    values : (k,) array
        Value of the layer in each cell; NaN outside the map.

    Raises
    ------
    LocplanError
        If the path crosses over 1e7 cells.
    """
    layers = layer.reshape(-1, *layer.shape[-2:])
    *at, lengths = find_cells_of_path(costs.grid, as_path(path), len(layers))
    return np.concatenate([[0.0], np.cumsum(lengths)]), _sample_layers(layers, at, np.nan)


def _sample_layers(layers: Array, cells: Sequence[Array], outside: float) -> Floats:
    """Return the values of layers at headings, rows and columns; `outside` outside the map."""
    heading, row, col = cells
    rows, cols = layers.shape[1:]
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    row, col = np.where(inside, row, 0), np.where(inside, col, 0)
    return np.where(inside, layers[heading, row, col], outside)


def _measure_stretches(is_inside: Bools, lengths: Array) -> tuple[float, float]:
    """Return the share of the length where something holds, and the longest stretch of it [m]."""
    total = lengths.sum()
    share = float(lengths[is_inside].sum() / total) if total > 0 else 0.0
    longest = stretch = 0.0
    for inside, length in zip(is_inside, lengths, strict=True):
        stretch = stretch + length if inside else 0.0
        longest = max(longest, stretch)
    return share, float(longest)


@dataclass(frozen=True)
class LidarDegeneracy:
    """A lidar, and how much of the floor is degenerate with it."""

    lidar: Lidar
    """The lidar."""
    degenerate_share: float
    """Share of the floor, where the robot can stand, with u above 0.5, 0..1; NaN without floor."""


def compare_lidars(
    grid: OccupancyGrid,
    lidars: Sequence[Lidar],
    *,
    robot: Robot | float = ROBOT_RADIUS,
    progress: ProgressCallback | None = None,
) -> list[LidarDegeneracy]:
    """Find for each lidar how much of a map is degenerate by `Fused`, in its worst heading.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    lidars : sequence of Lidar
        The lidars, such as ``[Lidar.preset("turtlebot3"), Lidar.preset("tim571")]``.
    robot : Robot, or float, default 0.25
        The robot, or its radius [m], >= 0; places closer to a wall are no part of the floor.
    progress : callable, optional
        Function that is called with (done, total) cells from time to time, lidar by lidar.

    Returns
    -------
    list of LidarShare
        The lidars in their order, each with its share.

    Raises
    ------
    LocplanError
        If an argument is out of its range.
    """
    shares, report_progress = [], chain_progress(progress, len(lidars)) if progress else None
    for lidar in lidars:
        config = FieldConfig(Fused(lidar), stride=COARSE_STRIDE)
        field = load_or_compute(grid, config, progress=report_progress)
        costs = Costmap.from_field(field, robot=robot, headings="worst")
        u = costs.u[np.isfinite(costs.density)]
        shares.append(LidarDegeneracy(lidar, float(np.mean(u > DEGENERATE)) if u.size else np.nan))
    return shares


def make_lidar_table(shares: Sequence[LidarDegeneracy]) -> Table:
    """Return a table that compares lidars.

    Parameters
    ----------
    shares : sequence of LidarShare
        What `compare_lidars` returned.
    """
    columns = (
        TableColumn("title", title="lidar", value=lambda lidar_share: lidar_share.lidar.title),
        TableColumn("lidar", value=lambda lidar_share: lidar_share.lidar.model),
        TableColumn("range", "m", value=lambda lidar_share: lidar_share.lidar.range),
        TableColumn(
            "degenerate_share",
            title=f"floor where the robot may get lost (u > {DEGENERATE:g})",
            digits=0,
            people="%",
        ),
    )
    return Table.from_records(columns, shares)


def format_costs_caption(costs: Costmap) -> str:
    """Return a further line of a title about the field and the robot of a costmap.

    Parameters
    ----------
    costs : Costmap
        The costmap.

    Returns
    -------
    str
        The line, which begins with a line break; empty for a costmap without a field.
    """
    if costs.settings is None:
        return ""
    radius = format_radius(costs.robot, costs.robot_radius)
    return f"\n{costs.settings.config.title}, robot radius {radius}"

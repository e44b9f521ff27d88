"""Where to put landmarks: `place_landmarks`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from itertools import combinations, product, starmap

import numpy as np
from numpy.typing import ArrayLike

from locplan._kernels.arrays import Bools, Floats, Ints, Octets
from locplan._util.checks import check_threads, instance, whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.landmarks._landmarks import Landmarks
from locplan.landmarks._objectives import AlongRoutes, MeanDegeneracy, Objective
from locplan.landmarks._objects import LandmarkObject, Shape, check_object, filled_cells, on_grid
from locplan.landmarks._places import Passages, Rejected, Sites, counted, places_of, refusals
from locplan.landmarks._routes import (
    Setting,
    cells_in,
    poses_in,
    routes_across,
    routes_of,
    where_robot_is,
)
from locplan.landmarks._search import Search, in_world
from locplan.landmarks._sight import Sight, lines_along, surroundings
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, check_grid
from locplan.robots import Robot


def place_landmarks(
    grid: OccupancyGrid,
    kind: LandmarkObject,
    count: int,
    *,
    paths: Mapping[str, Path | ArrayLike] | Sequence[Path | ArrayLike] | Path | None = None,
    places: Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | None = None,
    region: ArrayLike | None = None,
    robot: Robot | None = None,
    sites: Sites | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Choose places for objects that keep a robot from getting lost on its ways.

    Along routes they make the mean of P_xx + P_yy small, P the covariance of an information filter
    with the noise of the robot's own; in a region, the mean degeneracy u. It is a greedy choice,
    then up to three rounds in which each object may go elsewhere, and rows at equal short steps
    are broken where that costs little. `best_of_trials` drives other choices, too, and
    `Landmarks.verify` tests by simulated drives whether they help.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    count : int
        Number of objects to place besides those that exist, 1 to 200, or 0 with some of those.
        There are fewer where no further one helps, or may stand.
    paths : Path, or mapping of str to Path or to (n, 2) array, optional
        Routes of the robot in the world [m], within the free cells. It drives just these.
    places : sequence of (x, y), or mapping of str to (x, y), optional
        Instead of paths: the robot drives the shortest paths between all of these, 2 to 8 [m],
        planned again among the objects.
    region : (H, W) array of bool, or sequence of (x0, y0, x1, y1), optional
        Instead of paths: the robot may go anywhere in these cells, or rectangles in the world [m].
        Of parts that no way joins, the largest counts. Drives between places far apart verify it.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    sites : Sites, optional
        Where objects may stand, and which ones exist; see `Sites`.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with (done, total) steps of the search.

    Returns
    -------
    Landmarks
        The places in order of gain, and the map with the objects.

    Raises
    ------
    LocplanError
        If an argument is out of its range, a path leaves the free cells, the robot cannot be in the
        region, no object may stand anywhere, or an existing one is not in the map.

    See Also
    --------
    locplan.landmarks.best_of_trials : Drives this placement and others, and keeps the best.
    Landmarks.verify : Drives before, after, and with as many objects at random places.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> route = Path(np.array([[6.0, 3.0], [30.0, 3.0]]))
    >>> robot = locplan.Robot().changed({"laser_model_type": "likelihood_field_prob"})
    >>> made = place_landmarks(grid, locplan.Pole(0.2), 2, paths=route, robot=robot)
    >>> made.poses.shape, bool(made.curve[2] < made.curve[1] < made.curve[0])
    ((2, 3), True)
    """
    from scipy.spatial import cKDTree

    check_grid(grid)
    check_object(kind)
    sites = Sites() if sites is None else sites
    instance("sites", sites, Sites, 'such as locplan.landmarks.Sites(where="walls")')
    existing = np.array(sites.existing, dtype=np.float64).reshape(-1, 3)
    whole("count", count, 0 if len(existing) else 1, 200)
    robot = equipped(robot)
    threads = check_threads(threads)
    if sum(each is not None for each in (paths, places, region)) != 1:
        raise ConfigError("give one of paths, places and region")
    empty = without_objects(grid, kind, existing) if len(existing) else grid
    if region is None:
        routes = routes_of(empty, paths, places, robot.radius)
        setting = Setting(empty, kind, routes, None, paths is None, robot)
        lines = lines_along(empty, routes, robot)
        clear_of = [path.resampled(empty.resolution / 2).xy for path in routes.values()]
        if paths is not None and len(existing):
            lines_along(grid, routes, robot)  # nor may an object stand on them
    else:
        cells = where_robot_is(empty, cells_in(empty, region, "region"), robot.radius)
        routes = routes_across(empty, cells, robot.radius)
        setting = Setting(empty, kind, routes, cells, True, robot)
        lines = [poses_in(empty, cells, robot.known_lidar)]
        clear_of = [path.xy[[0, -1]] for path in setting.routes.values()]
    passages = Passages(empty, kind.shape, robot.radius, sites.clearance)
    seen = surroundings(empty, lines, kind.shape, robot)
    keep, area = robot.radius + sites.clearance, cells_in(grid, sites.keep_out, "keep_out")
    beside = setting.routes.values() if region is None else ()
    tried = places_of(empty, kind.shape, sites, beside, keep)
    robots = cKDTree(on_grid(empty, np.concatenate(lines))[:, :2])
    within = (seen.rays.most + kind.shape.reach) / empty.resolution
    tried = tried[np.isfinite(robots.query(tried[:, :2], distance_upper_bound=within)[0])]
    at = np.column_stack(empty.world_to_grid(*np.concatenate(clear_of).T))
    reasons = refusals(tried, empty, passages, at, keep, area)
    allowed = np.array([not reason for reason in reasons], bool)
    every = np.concatenate([on_grid(empty, existing), tried[allowed]])
    if not len(every):
        raise ConfigError(
            f"no {kind.title} may stand within the lidar's range of the robot:"
            f" {counted(reasons)}; allow more places (where), a smaller object or clearance, or"
            " keep less of the map out"
        )
    sight = Sight(empty, seen, kind.shape, every, threads)
    objective: Objective = AlongRoutes(sight)
    if region is not None:
        objective = MeanDegeneracy.of(sight, robot.known_lidar)
    search = Search(objective, passages, np.arange(len(every)))
    order = search.run(list(range(len(existing))), count, progress)
    order, shifts = search.without_rows(order)
    refused = in_world(empty, np.concatenate([tried[~allowed], every[list(search.refused)]]))
    whys = [*filter(None, reasons), *search.refused.values()]
    rejected = tuple(starmap(Rejected, zip(*refused.T.tolist(), whys, strict=True)))
    indices = np.array(order, np.int64)
    return Landmarks(
        setting, search, indices, shifts, rejected, grid, len(existing), objective.name
    )


def without_objects(grid: OccupancyGrid, kind: LandmarkObject, poses: Floats) -> OccupancyGrid:
    """Copy of a map without objects that stand in it, whose cells become free.

    An object is sought up to a cell from its pose, where the least of it is free. Cells stay that
    a straight wall holds, which goes on at both sides of the object. Of the cells around it, only
    those go that are joined with nothing else: a wall that it touches stays.

    Raises
    ------
    ConfigError
        If nothing is drawn where an object should be, or two are given at one place.
    """
    _check_apart(kind, poses)
    cells, occupied = grid.cells.copy(), grid.cells == OCCUPIED
    for (x, y, _), pose in zip(poses.tolist(), on_grid(grid, poses), strict=True):
        rows, cols = _drawn_cells(grid, kind.shape, pose)
        if not rows.size:
            raise ConfigError(
                f"no {kind.title} is drawn in the map at {x:g},{y:g}; an existing object must be"
                " there, within a cell"
            )
        # Distance from an object at which a wall beside it still must be one [cells].
        reach = kind.shape.reach / grid.resolution + 2.5
        own = ~_in_walls(occupied, np.column_stack([rows, cols]), pose[:2], reach)
        at = rows[own], cols[own]
        cells[at] = FREE
        cells[_rim(cells, at)] = FREE
    return dataclasses.replace(grid, cells=cells)


def _check_apart(kind: LandmarkObject, poses: Floats) -> None:
    """Raise a ConfigError if two objects are given whose middles lie in each other."""
    for (x, y, _), (other_x, other_y, _) in combinations(poses.tolist(), 2):
        if math.hypot(x - other_x, y - other_y) < kind.shape.half_width:
            raise ConfigError(
                f"two existing objects are given at one place, {x:g},{y:g} and"
                f" {other_x:g},{other_y:g}; leave one out"
            )


def _drawn_cells(grid: OccupancyGrid, shape: Shape, pose: Floats) -> tuple[Ints, Ints]:
    """The occupied cells that an object fills, shifted only to where less of it is free."""
    best, found = (-math.inf, 0.0), (np.empty(0, np.int64), np.empty(0, np.int64))
    # Shifts of an object along rows and columns that are tried [cells].
    for d_row, d_col in product((-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75), repeat=2):
        at = filled_cells(grid, shape, pose + np.array([d_row, d_col, 0.0]))
        taken = grid.cells[at] == OCCUPIED
        rank = float(taken.sum() - len(taken)), -math.hypot(d_row, d_col)
        if rank > best:
            best, found = rank, (at[0][taken], at[1][taken])
    return found


def _in_walls(occupied: Bools, cells: Ints, centre: Floats, reach: float) -> Bools:
    """Whether occupied cells lead from each cell straight out of a disc [cells] on both sides."""
    angles = np.arange(8) * math.pi / 8  # of walls
    steps = np.column_stack([np.sin(angles), np.cos(angles)])
    count = int(2 * reach) + 2
    ways = np.repeat(np.concatenate([steps, -steps])[:, None], count + 1, axis=1)
    ways = np.repeat(ways[None], len(cells), axis=0)
    ways[:, :, 0] = cells[:, None] + 0.5
    ways = np.cumsum(ways, axis=2)
    within = np.hypot(*np.moveaxis(ways - centre, -1, 0)) <= reach
    at = np.clip(np.floor(ways).astype(int) + 1, 0, np.array(occupied.shape) + 1)
    free = ~np.pad(occupied, 1, constant_values=True)[at[..., 0], at[..., 1]]
    leaves = ~(free[..., 1:] & within[..., :-1]).any(axis=2)  # a wall goes on where the map ends
    return np.asarray((leaves[:, :8] & leaves[:, 8:]).any(axis=1))


def _rim(cells: Octets, at: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """Occupied cells beside those of an object that lead no farther: no wall has them."""
    import cv2

    if not at[0].size:
        return at
    rows, cols = (slice(max(int(v.min()) - 2, 0), int(v.max()) + 3) for v in at)
    own = np.zeros(cells[rows, cols].shape, np.uint8)
    own[at[0] - rows.start, at[1] - cols.start] = 1
    beside = cv2.dilate(own, np.ones((3, 3), np.uint8)) > 0
    _, parts = cv2.connectedComponents((cells[rows, cols] == OCCUPIED).astype(np.uint8))
    of_walls = np.unique(parts[~beside])
    rim_rows, rim_cols = np.nonzero(beside & (parts > 0) & ~np.isin(parts, of_walls))
    return rim_rows + rows.start, rim_cols + cols.start

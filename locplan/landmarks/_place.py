"""Where to put landmarks: `place_landmarks`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.landmarks._existing import without_objects
from locplan.landmarks._landmarks import Landmarks
from locplan.landmarks._objectives import AlongRoutes, MeanDegeneracy, Objective
from locplan.landmarks._objects import LandmarkObject, check_object, on_grid
from locplan.landmarks._places import Passages, Rejected, Sites, places_of, refusals
from locplan.landmarks._routes import (
    Setting,
    cells_in,
    poses_in,
    routes_across,
    routes_of,
    where_robot_is,
)
from locplan.landmarks._search import Search, in_world
from locplan.landmarks._sight import Sight, lines_along, step_of, surroundings
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot

MAX_COUNT = 200
"""Greatest number of landmarks."""


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
    check_grid(grid)
    check_object(kind)
    sites = Sites() if sites is None else sites
    instance("sites", sites, Sites, 'such as locplan.landmarks.Sites(where="walls")')
    existing = np.array(sites.existing, dtype=np.float64).reshape(-1, 3)
    whole("count", count, 0 if len(existing) else 1, MAX_COUNT)
    robot = equipped(robot)
    threads = check_threads(threads)
    if sum(each is not None for each in (paths, places, region)) != 1:
        raise ConfigError("give one of paths, places and region")
    empty = without_objects(grid, kind, existing) if len(existing) else grid
    if region is not None:
        ways = _ways_in(empty, region, robot)
    else:
        ways = _ways_along(empty, routes_of(empty, paths, places, robot.radius), robot)
        if paths is not None and len(existing):
            lines_along(grid, ways.routes, step_of(robot.amcl))  # nor may an object stand on them
    setting = Setting(empty, kind, ways.routes, ways.region, paths is None, robot)
    passages = Passages(empty, kind.shape, robot.radius, sites.clearance)
    seen = surroundings(empty, ways.lines, step_of(robot.amcl), kind.shape, robot)
    tried = _within_range(setting, ways, sites, seen.rays.most + kind.shape.reach)
    routes = np.column_stack(empty.world_to_grid(*ways.clear_of.T))
    keep, area = robot.radius + sites.clearance, cells_in(grid, sites.keep_out, "keep_out")
    reasons = refusals(tried, empty, passages, routes, keep, area)
    allowed = np.array([not reason for reason in reasons], bool)
    every = np.concatenate([on_grid(empty, existing), tried[allowed]])
    if not len(every):
        raise ConfigError(
            f"no {kind.title} may stand within the lidar's range of the robot:"
            f" {_counted(reasons)}; allow more places (where), a smaller object or clearance, or"
            " keep less of the map out"
        )
    sight = Sight(seen, kind.shape, every, grid.resolution, threads)
    objective: Objective = AlongRoutes(sight)
    if region is not None:
        objective = MeanDegeneracy.of(sight, robot.known_lidar)
    search = Search(objective, passages, np.arange(len(every)))
    order = search.run(list(range(len(existing))), count, progress)
    order, shifts = search.without_rows(order)
    refused = in_world(empty, np.concatenate([tried[~allowed], every[list(search.refused)]]))
    reasons = [*filter(None, reasons), *search.refused.values()]
    rejected = tuple(
        Rejected(x, y, heading, reason)
        for (x, y, heading), reason in zip(refused.tolist(), reasons, strict=True)
    )
    return Landmarks.of(setting, search, order, rejected, grid, len(existing), shifts)


class _Ways(NamedTuple):
    """Where the robot is."""

    routes: dict[str, Path]
    """Routes that are driven."""
    region: NDArray[np.bool_] | None
    """Cells of a region, (H, W), or None where the robot drives the routes only."""
    lines: list[Poses]
    """Poses at which it looks around, along each route or in the region."""
    clear_of: NDArray[np.float64]
    """World x and y that objects keep away from, (n, 2) [m]."""


def _ways_along(grid: OccupancyGrid, routes: dict[str, Path], robot: Robot) -> _Ways:
    """Poses along routes."""
    fine = [path.resampled(grid.resolution / 2).xy for path in routes.values()]
    lines = lines_along(grid, routes, step_of(robot.amcl))
    return _Ways(routes, None, lines, np.concatenate(fine))


def _ways_in(grid: OccupancyGrid, region: Any, robot: Robot) -> _Ways:
    """Poses in a region, and the routes across it."""
    area = cells_in(grid, region, "region")
    if area is None:
        raise ConfigError("the region must hold at least one rectangle (x0, y0, x1, y1) in metres")
    cells = where_robot_is(grid, area, robot.radius)
    routes = routes_across(grid, cells, robot.radius)
    ends = np.concatenate([path.xy[[0, -1]] for path in routes.values()])
    return _Ways(routes, cells, [poses_in(grid, cells, robot.known_lidar)], ends)


def _within_range(setting: Setting, ways: _Ways, sites: Sites, reach: float) -> NDArray[np.float64]:
    """Places on the map within a distance [m] of the robot's poses, (n, 3)."""
    from scipy.spatial import cKDTree

    grid, robot = setting.grid, setting.robot
    beside = setting.routes.values() if setting.region is None else ()
    places = places_of(grid, setting.kind.shape, sites, beside, robot.radius + sites.clearance)
    poses = np.concatenate([line[:, :2] for line in ways.lines])
    at = np.column_stack(grid.world_to_grid(*poses.T))
    apart, _ = cKDTree(at).query(places[:, :2], distance_upper_bound=reach / grid.resolution)
    near: NDArray[np.float64] = places[np.isfinite(apart)]
    return near


def _counted(reasons: Sequence[str]) -> str:
    """How many places were refused for which reason."""
    counts = {each: reasons.count(each) for each in dict.fromkeys(reasons)}
    return ", ".join(f"{each} ({count})" for each, count in counts.items()) or "there are no places"

"""Where to put landmarks: `place_landmarks`, a greedy choice of places along routes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from locplan._util.checks import check_threads, position, shown, whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError, LocplanError
from locplan.field import equipped
from locplan.landmarks._landmarks import Landmarks, Setting
from locplan.landmarks._objects import LandmarkObject, check_object, on_grid
from locplan.landmarks._places import (
    CLEARANCE,
    Passages,
    candidate_places,
    cells_in,
    counted,
    refusals,
)
from locplan.landmarks._search import Search, poses_in_world
from locplan.landmarks._sight import Sight, lines_along, surroundings
from locplan.maps import OccupancyGrid, check_grid
from locplan.planners import plan
from locplan.robots import Robot

MAX_PLACES = 8
"""Maximum number of places; all of them are joined by routes."""


def place_landmarks(
    grid: OccupancyGrid,
    kind: LandmarkObject,
    count: int,
    *,
    paths: Mapping[str, Path | ArrayLike] | Sequence[Path | ArrayLike] | Path | None = None,
    places: Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | None = None,
    robot: Robot | None = None,
    keep_out: Sequence[Sequence[float]] | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Choose places for objects that keep a robot from getting lost on its routes.

    The choice is greedy: each place makes the mean of P_xx + P_yy along the routes smallest, P the
    covariance of an information filter with the noise of the robot's own. `Landmarks.verify` tests
    by simulated drives whether the objects help.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    count : int
        Number of objects, 1 to 200. There are fewer if no further one helps, or may stand.
    paths : Path, or mapping of str to Path or to (n, 2) array, optional
        Routes of the robot in the world [m], within the free cells. It drives just these.
    places : sequence of (x, y), or mapping of str to (x, y), optional
        Instead of paths: the robot drives the shortest paths between all of these, 2 to 8 [m],
        planned again among the objects.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    keep_out : sequence of (x0, y0, x1, y1), optional
        Rectangles in the world [m] in which no object may stand.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with (done, total) objects.

    Returns
    -------
    Landmarks
        The places in order of gain, and the map with the objects.

    Raises
    ------
    LocplanError
        If an argument is out of its range, a path leaves the free cells, or no object may stand
        anywhere.

    See Also
    --------
    Landmarks.verify : Drives before, after, and with as many objects at random places.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> route = Path(np.array([[6.0, 3.0], [30.0, 3.0]]))
    >>> robot = locplan.Robot().changed({"laser_model_type": "likelihood_field_prob"})
    >>> made = place_landmarks(grid, locplan.landmarks.Pole(0.2), 2, paths=route, robot=robot)
    >>> made.poses.shape, bool(made.curve[2] < made.curve[1] < made.curve[0])
    ((2, 3), True)
    """
    check_grid(grid)
    check_object(kind)
    whole("count", count, 1, 200)
    robot = equipped(robot)
    threads = check_threads(threads)
    if (paths is None) == (places is None):
        raise ConfigError("give either paths or places")
    routes = routes_of(grid, paths, places, robot.radius)
    search = _search_along(grid, kind, routes, robot, keep_out, threads)
    chosen, curve = search.run(count, progress)
    setting = Setting(grid, kind, routes, paths is None, robot)
    return Landmarks(setting, poses_in_world(grid, search.places[chosen]), curve, search)


def _search_along(
    grid: OccupancyGrid,
    kind: LandmarkObject,
    routes: Mapping[str, Path],
    robot: Robot,
    keep_out: Sequence[Sequence[float]] | None,
    threads: int,
) -> Search:
    """Return the search among the allowed places that the robot can see from its routes.

    Raises
    ------
    LocplanError
        If a path leaves the free cells, or there is no such place.
    """
    from scipy.spatial import cKDTree

    lines = lines_along(grid, routes, robot)
    passages = Passages(grid, kind.shape, robot.radius, CLEARANCE)
    seen = surroundings(grid, lines, kind.shape, robot)
    keep, area = robot.radius + CLEARANCE, cells_in(grid, keep_out)
    tried = candidate_places(grid, kind.shape, routes.values(), keep)
    robots = cKDTree(on_grid(grid, np.concatenate(lines))[:, :2])
    within = (seen.rays.most + kind.shape.reach) / grid.resolution
    tried = tried[np.isfinite(robots.query(tried[:, :2], distance_upper_bound=within)[0])]
    clear_of = [path.resampled(grid.resolution / 2).xy for path in routes.values()]
    at = np.column_stack(grid.world_to_grid(*np.concatenate(clear_of).T))
    reasons = refusals(tried, grid, passages, at, keep, area)
    allowed = np.array([not reason for reason in reasons], bool)
    if not allowed.any():
        raise ConfigError(
            f"no {kind.title} may stand within the lidar's range of the robot:"
            f" {counted(reasons)}; give a smaller object, or keep less of the map out"
        )
    return Search(Sight(grid, seen, kind.shape, tried[allowed], threads), passages)


def routes_of(grid: OccupancyGrid, paths: Any, places: Any, robot_radius: float) -> dict[str, Path]:
    """Routes by name: the paths that were given, or the shortest ones between places.

    Raises
    ------
    ConfigError
        If they are none.
    LocplanError
        If the robot cannot stand at a place, or no path joins two.
    """
    if paths is not None:
        given = {"path": paths} if isinstance(paths, Path) else paths
        named = _named(given, "path", "paths by name")
        if not named:
            raise ConfigError("there must be at least one path along which landmarks help")
        return {
            str(name): path if isinstance(path, Path) else Path(np.asarray(path))
            for name, path in named.items()
        }
    named = _named(places, "place", "positions x, y in metres")
    if not 2 <= len(named) <= MAX_PLACES:
        raise ConfigError(
            f"there must be 2 to {MAX_PLACES} places, which routes join, not {len(named)};"
            " give longer lists of routes as paths"
        )
    ends = {str(name): position(xy, name=f"place {name}") for name, xy in named.items()}
    costs = Costmap.blank(grid, robot=robot_radius)
    for name, xy in ends.items():
        costs.cell_of(xy, name)
    routes = {}
    for (one, start), (other, goal) in combinations(ends.items(), 2):
        found = plan(costs, start, goal).path
        if found is None:
            raise LocplanError(f"no path leads from {one} to {other}; name places that are joined")
        routes[f"{one} to {other}"] = found
    return routes


def _named(values: Any, word: str, what: str) -> Mapping[Any, Any]:
    """What has names already, or is numbered from 1."""
    if isinstance(values, Mapping):
        return values
    if not isinstance(values, Iterable) or isinstance(values, str):
        raise ConfigError(f"{word}s must be {what}, not {shown(values)}")
    return {f"{word} {n}": value for n, value in enumerate(values, 1)}

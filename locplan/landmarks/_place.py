"""Where to put landmarks: `place_landmarks`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._util.checks import number, one_of, positive, whole
from locplan._util.machine import check_threads
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.landmarks._candidates import (
    WHERE,
    Candidates,
    Rejected,
    Where,
    checked,
    places_of,
)
from locplan.landmarks._existing import without_objects
from locplan.landmarks._landmarks import Landmarks
from locplan.landmarks._objectives import AlongRoutes, MeanDegeneracy, Objective, anchors_of
from locplan.landmarks._objects import (
    LandmarkObject,
    check_object,
    checked_poses,
    on_grid,
)
from locplan.landmarks._passages import Passages
from locplan.landmarks._problem import cells_in, routes_of
from locplan.landmarks._region import poses_in, routes_across, where_robot_is
from locplan.landmarks._rows import without_rows
from locplan.landmarks._search import Search, in_world
from locplan.landmarks._setting import Setting
from locplan.landmarks._sight import Sight
from locplan.landmarks._surroundings import (
    Surroundings,
    lines_along,
    step_of,
    surroundings,
)
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot

MARGIN = 0.2
"""Default distance that the robot keeps from landmarks besides its radius [m]."""
SPACING = 0.5
"""Default spacing of the places that are tried along walls [m]."""
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
    margin: float = MARGIN,
    where: Where = "both",
    spacing: float = SPACING,
    keep_out: ArrayLike | None = None,
    existing: Iterable[Sequence[float]] = (),
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Choose places for objects that keep a robot from getting lost on its ways.

    Along routes they make the mean of P_xx + P_yy small, P the covariance of an information filter
    with the noise of the robot's own; in a region, the mean degeneracy u. It is a greedy choice,
    then up to three rounds in which each object may go elsewhere, and rows at equal short steps
    are broken where that costs little. `best_of_trials` drives other choices, too, and
    `Landmarks.verify` tells by simulated drives whether they help.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    count : int
        Number of objects to place besides those in `existing`, 1 to 200, or 0 with some of those.
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
    margin : float, default 0.2
        Distance that routes, and ends of those in a region, and passages keep from the objects
        besides the radius [m], >= 0. Lower it where no place is left.
    where : str, default "both"
        Places that are tried: along "walls", "free" with a clearance above 1.2 m, on a lattice of
        1 m and beside the routes, or "both". Those beyond the lidar's range of the robot are left
        out.
    spacing : float, default 0.5
        Distance between the places along walls and beside routes [m], above 0. A smaller one tries
        more places, and takes longer.
    keep_out : (H, W) array of bool, or sequence of (x0, y0, x1, y1), optional
        Cells, or rectangles in the world [m], that no object may stand in; none by default.
    existing : iterable of (x, y) or (x, y, heading), default ()
        Objects of this kind that are drawn in the map and may be moved [m, m, rad]. There must be
        occupied cells within a cell of where each would be.
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
    moved = checked_poses(existing, "an existing object")
    whole("count", count, 0 if len(moved) else 1, MAX_COUNT)
    number("margin", margin, 0.0)
    positive("spacing", spacing, "m")
    one_of("where", where, WHERE)
    robot = equipped(robot)
    threads = check_threads(threads)
    given = {"paths": paths, "places": places, "region": region}
    if sum(each is not None for each in given.values()) != 1:
        raise ConfigError("give one of paths, places and region")
    area = cells_in(grid, keep_out, "keep_out")
    empty = without_objects(grid, kind, moved) if len(moved) else grid
    if region is not None:
        ways = _ways_in(empty, region, robot)
    else:
        ways = _ways_along(empty, routes_of(empty, paths, places, robot.radius), robot)
        if paths is not None and len(moved):
            lines_along(grid, ways.routes, step_of(robot.filter))  # nor may an object stand on them
    setting = Setting(empty, kind, ways.routes, ways.region, paths is None, robot)
    passages = Passages(empty, kind.shape, robot.radius, margin)
    seen = surroundings(empty, ways.lines, step_of(robot.filter), kind.shape, robot)
    candidates = _candidates(setting, ways, passages, seen, where, spacing, margin, area)
    every = np.concatenate([on_grid(empty, moved), candidates.poses])
    if not len(every):
        raise ConfigError(
            f"no {kind.title} may stand within the lidar's range of the robot:"
            f" {_reasons(candidates.reasons)}; allow more places (where), a"
            " smaller object or margin, or keep less of the map out"
        )
    sight = Sight(seen, kind.shape, every, grid.resolution, threads)
    objective: Objective = AlongRoutes(sight)
    if region is not None:
        objective = MeanDegeneracy(sight, anchors_of(robot.known_lidar, grid.resolution))
    search = Search(objective, passages, np.arange(len(every)))
    order, shifts = without_rows(search, search.run(list(range(len(moved))), count, progress))
    refused = np.concatenate([candidates.refused, every[list(search.refused)]], dtype=np.float64)
    reasons = [*candidates.reasons, *search.refused.values()]
    rejected = tuple(
        Rejected(x, y, heading, reason)
        for (x, y, heading), reason in zip(in_world(empty, refused).tolist(), reasons, strict=True)
    )
    return Landmarks.of(setting, search, order, rejected, grid, len(moved), shifts)


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
    lines = lines_along(grid, routes, step_of(robot.filter))
    return _Ways(routes, None, lines, np.concatenate(fine))


def _ways_in(grid: OccupancyGrid, region: Any, robot: Robot) -> _Ways:
    """Poses in a region, and the routes across it."""
    cells = where_robot_is(grid, _region(grid, region), robot.radius)
    routes = routes_across(grid, cells, robot.radius)
    ends = np.concatenate([path.xy[[0, -1]] for path in routes.values()])
    return _Ways(routes, cells, [poses_in(grid, cells, robot.known_lidar)], ends)


def _candidates(
    setting: Setting,
    ways: _Ways,
    passages: Passages,
    seen: Surroundings,
    where: Where,
    spacing: float,
    margin: float,
    keep_out: NDArray[np.bool_] | None,
) -> Candidates:
    """Places within the lidar's range of the robot, those that are refused apart."""
    grid, shape, keep = setting.grid, setting.kind.shape, setting.robot.radius + margin
    beside = setting.routes.values() if setting.region is None else ()
    tried = places_of(grid, shape, where, spacing, beside, keep)
    poses = np.concatenate([line[:, :2] for line in ways.lines])
    at = np.column_stack(grid.world_to_grid(*poses.T))
    tried = _within(tried, at, (seen.rays.most + shape.reach) / grid.resolution)
    routes = np.column_stack(grid.world_to_grid(*ways.clear_of.T))
    return checked(tried, grid, shape, passages, routes=routes, keep=keep, keep_out=keep_out)


def _region(grid: OccupancyGrid, region: Any) -> NDArray[np.bool_]:
    """Cells of a region, of which there must be some."""
    cells = cells_in(grid, region, "region")
    if cells is None:
        raise ConfigError("the region must hold at least one rectangle (x0, y0, x1, y1) in metres")
    return cells


def _within(
    places: NDArray[np.float64], poses: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Places within a distance [cells] of the robot's poses."""
    from scipy.spatial import cKDTree

    apart, _ = cKDTree(poses).query(places[:, :2], distance_upper_bound=reach)
    near: NDArray[np.float64] = places[np.isfinite(apart)]
    return near


def _reasons(reasons: Sequence[str]) -> str:
    """How many places were refused for which reason."""
    counts: dict[str, Any] = {each: reasons.count(each) for each in dict.fromkeys(reasons)}
    return ", ".join(f"{count} {each}" for each, count in counts.items()) or "there are no places"

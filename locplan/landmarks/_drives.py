"""Drives that compare placements: trials of some, and the verification of the best."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts
from locplan.costs import Costmap, Path
from locplan.errors import LocplanError
from locplan.field import CovarianceField, FieldConfig, Fused, covariance_field, points_near, scalar
from locplan.landmarks._landmarks import Landmarks, Trial
from locplan.landmarks._objectives import MeanDegeneracy, Objective
from locplan.landmarks._objects import with_objects
from locplan.landmarks._outcomes import Profile
from locplan.landmarks._routes import Setting
from locplan.landmarks._search import Search, in_world
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import plan
from locplan.robots import Robot
from locplan.simulation import Drives, Simulator, drive_paths

Cells: TypeAlias = NDArray[np.int64]
"""Rows and columns of a feature's cells, (k, 2)."""


def drive_on(
    setting: Setting,
    grid: OccupancyGrid,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> tuple[Drives, ...]:
    """Drives of each route on a map that the robot's filter has, too."""
    simulator = Simulator(grid, robot=setting.robot, seed=seed, threads=threads)
    return tuple(
        drive_paths(simulator, paths_on(setting, grid), drives, progress=progress).values()
    )


def drive_without(
    grid: OccupancyGrid,
    lacking: Sequence[Cells],
    routes: Mapping[str, Path],
    robot: Robot,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> tuple[Drives, ...]:
    """Drives of each route in worlds that lack features, which the robot's map still shows."""
    cells = grid.cells.copy()
    if lacking:
        cells[tuple(np.concatenate(lacking).T)] = FREE
    world = dataclasses.replace(grid, cells=cells)
    simulator = Simulator(world, robot, filter_map=grid, seed=seed, threads=threads)
    return tuple(drive_paths(simulator, routes, drives, progress=progress).values())


def paths_on(setting: Setting, grid: OccupancyGrid) -> Mapping[str, Path]:
    """The routes that were given, or the shortest paths between their ends on a map."""
    if not setting.planned:
        return setting.routes
    costs = Costmap.blank(grid, robot_radius=setting.robot.radius)
    paths = {}
    for name, path in setting.routes.items():
        (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
        found = plan(costs, (x0, y0), (x1, y1)).path
        if found is None:
            raise LocplanError(
                f"no path of the robot leads along {name} on the map"
                f" {'with' if grid is not setting.grid else 'without'} landmarks"
            )
        paths[name] = found
    return paths


def random_maps(
    setting: Setting, search: Search, count: int, sets: int, seed: int
) -> list[OccupancyGrid]:
    """Maps with `count` objects at random places of those that are allowed."""
    maps = []
    for n in range(sets):
        # Stream of random numbers of places at random, beside those of `Simulator`.
        chosen = search.at_random(count, random_of(seed, 100, n))
        if not chosen:
            return []
        poses = in_world(setting.grid, search.places[chosen])
        maps.append(with_objects(setting.grid, setting.kind, poses))
    return maps


def fields_along(
    setting: Setting, maps: tuple[OccupancyGrid, OccupancyGrid], threads: int | None
) -> dict[str, tuple[Profile, Profile]]:
    """Deviations of a match by `Fused` along each route on the maps before and after.

    The field is computed near the routes only, and updated where the second map differs.
    """
    config = FieldConfig(Fused.of(setting.robot.known_lidar))
    routes = [paths_on(setting, grid) for grid in maps]
    before, after = (
        _near(grid, config, paths.values()) for grid, paths in zip(maps, routes, strict=True)
    )
    field = covariance_field(maps[0], config, points=before, threads=threads)
    found = {name: _along(field, path) for name, path in routes[0].items()}
    field = field.update(maps[1], points=after, threads=threads)
    return {name: (found[name], _along(field, path)) for name, path in routes[1].items()}


def _near(grid: OccupancyGrid, config: FieldConfig, paths: Iterable[Path]) -> NDArray[np.bool_]:
    """Lattice points that are read along some paths."""
    stride = config.stride_cells(grid.resolution)
    xy = np.concatenate([path.resampled(grid.resolution * stride / 2).xy for path in paths])
    cells = np.column_stack(grid.world_to_grid(*xy.T)) - 0.5
    return points_near(config.lattice_points(grid), stride, cells, 1.5 * stride)


def _along(field: CovarianceField, path: Path) -> Profile:
    """A field's largest deviation of the position along a path; NaN where it has none."""
    # Distance between the positions along a route at which the field is read [m].
    fine = path.resampled(0.5, even=True)
    covariances = np.array([field.at(x, y) for x, y in fine.xy.tolist()])
    return np.column_stack([fine.distance, scalar(covariances, "position_std")])


FIRST_DRIVES = 40
"""Number of drives along each route in the first round; it doubles while placements halve."""
MIN_ERROR = 1e-3
"""Least error of a drive [m], since its logarithm counts."""
VARIANTS, ROUNDS = 101, 102
"""Streams of random numbers, beside those of `Simulator` and of places at random."""


def best_of_trials(
    made: Landmarks,
    trials: int = 4,
    *,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Drive a placement and others that promise as much, and return the best.

    Along routes the second one has the least degeneracy at the poses there, which often drives
    better, and often worse. Further ones are searched among a random half of the places, by either
    objective in turn. In each round all are driven, and the better half of them stays: those with
    the fewest lost drives, of these those with the least error. `Landmarks.trials` says what was
    driven. `Landmarks.verify` has other drives.

    Parameters
    ----------
    made : Landmarks
        The placement, as `place_landmarks` returns it.
    trials : int, default 4
        Number of placements, `made` among them, 1 to 100; 1 returns it without a drive. More take
        longer, and may find a better one.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Landmarks
        The best placement, with the results of all in `trials`.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """
    whole("trials", trials, 1, 100)
    whole("seed", seed, 0)
    if trials == 1:
        return made
    left = [Contender(each) for each in _placements(made, trials, seed)]
    sizes, size, drives = [], len(left), FIRST_DRIVES
    while size > 1:
        sizes += [drives * len(made.setting.routes)] * size
        size, drives = -(-size // 2), 2 * drives
    callbacks = iter(parts(progress, sizes))
    drives, round_ = FIRST_DRIVES, 0
    beaten: list[Contender] = []
    while len(left) > 1:
        own_seed = int(random_of(seed, ROUNDS, round_).integers(2**31))
        for each in left:
            setting, grid = each.made.setting, each.made.grid
            each.driven += drive_on(setting, grid, drives, own_seed, threads, next(callbacks))
        left.sort(key=lambda each: each.score)
        stay = -(-len(left) // 2)
        left, beaten = left[:stay], left[stay:] + beaten
        drives, round_ = 2 * drives, round_ + 1
    trials_made = tuple(each.trial for each in [*left, *beaten])
    return dataclasses.replace(left[0].made, trials=trials_made)


@dataclass
class Contender:
    """A placement, and its drives so far."""

    made: Landmarks
    driven: list[Drives] = field(default_factory=list)

    @property
    def score(self) -> tuple[int, float]:
        """Number of lost drives, and the mean logarithm of the squared error of all."""
        squares: NDArray[np.float64] = np.concatenate([each.mean_squares for each in self.driven])
        lost = sum(int(each.lost.sum()) for each in self.driven)
        return lost, float(np.log(np.maximum(squares, MIN_ERROR**2)).mean())

    @property
    def trial(self) -> Trial:
        """What its drives say."""
        lost, error = self.score
        number = sum(len(each.errors) for each in self.driven)
        return Trial(self.made.chosen_by, number, lost, math.exp(error / 2))


def _placements(made: Landmarks, trials: int, seed: int) -> Iterator[Landmarks]:
    """A placement and others of as many: by the other objective, and among half of the places.

    Their curves are those of the objective of `made`, so that they compare.
    """
    yield made
    first, own = made.existing, made.search
    objectives: list[Objective] = [own.objective]
    if made.setting.region is None:
        sight = own.objective.sight
        objectives.append(MeanDegeneracy.of(sight, made.setting.robot.known_lidar))
    for n in range(1, trials):
        objective, half = objectives[n % len(objectives)], n >= len(objectives)
        keep: NDArray[np.bool_] = np.ones(len(own.places), bool)
        if half:
            # Share of the places that a further placement is searched among.
            keep = random_of(seed, VARIANTS, n).random(len(keep)) < 0.5
            keep |= not keep.any()
        search = Search(objective, own.passages, np.flatnonzero(keep))
        order = search.run(list(range(first)), max(len(made) - first, 0))
        order, shifts = search.without_rows(order)
        found = Landmarks.of(
            made.setting, own, own.in_order(order), made.rejected, made.before, first, shifts
        )
        among = ", half of the places" if half else ""
        yield dataclasses.replace(found, chosen_by=objective.name + among)

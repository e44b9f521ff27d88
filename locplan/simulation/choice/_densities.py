"""Densities on which candidates are the paths of least cost."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import CovarianceField, FieldConfig, Fused, Sad
from locplan.maps import OccupancyGrid
from locplan.planners import SHORTEST
from locplan.robots import Lidar, Robot
from locplan.simulation._worlds import Window, inflated

WEIGHTS = (4.0, 8.0, 12.0)
"""Weights of the degeneracy u of the aware paths."""


@dataclass(frozen=True)
class Ground:
    """A map, or a part of one, and what densities of candidates are made of there."""

    grid: OccupancyGrid
    """The map."""
    u: NDArray[np.float64]
    """Degeneracy of each cell."""
    robot: Robot
    """The robot."""
    accepted: dict[str, Path]
    """Candidates until now, the shortest first."""

    @cached_property
    def clear(self) -> NDArray[np.float64]:
        """Density that keeps off the walls."""
        return 1 + 3 * np.exp(-(self.grid.clearance - self.robot.radius) / 0.4)

    @property
    def inflated(self) -> NDArray[np.float64]:
        """Density that Nav2's planners see in an inflated costmap."""
        return inflated(self.grid.clearance, self.robot)

    @property
    def beside(self) -> NDArray[np.float64]:
        """1 on the candidates until now, falling to 1/e at 1 m from them."""
        return np.exp(-(self._distance_to(*self.accepted.values()) ** 2))

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Cells within 1.5 m of the middle of the shortest path."""
        shortest = self.accepted[SHORTEST]
        middle = [np.interp(shortest.length / 2, shortest.distance, v) for v in shortest.xy.T]
        return self._distance_to(Path(np.array([middle]))) < 1.5

    def _distance_to(self, *paths: Path) -> NDArray[np.float64]:
        import cv2

        away = np.ones(self.grid.shape, np.uint8)
        for path in paths:
            fine = path.resampled(self.grid.resolution / 2) if path.length else path
            cells = np.floor(self.grid.world_to_grid(*fine.xy.T)).astype(np.int64)
            away[tuple(np.clip(cells, 0, np.array(away.shape)[:, None] - 1))] = 0
        cells = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(cells * self.grid.resolution, np.float64)


def config_of(about: Mapping[str, Any], lidar: Lidar | None) -> FieldConfig:
    """Settings of the field in what is known of a costmap; without any, the usual ones."""
    if "config" in about:
        return FieldConfig.from_json(about["config"])
    return FieldConfig(Fused(lidar) if lidar else Sad())


def costs_again(about: Mapping[str, Any], field: CovarianceField) -> Costmap:
    """The costmap of a field by what `about_costs` says of it; a ConfigError on another map."""
    if field.grid.digest != about["map"]["digest"]:
        raise ConfigError(f"the choice is of another map, {about['map']['name'] or 'unnamed'}")
    names = "weight", "law", "criterion", "headings"
    own = {name: about[name] for name in names if about.get(name) is not None}
    return Costmap.from_field(field.grid, field, robot=about["robot_radius"], **own)


def costmap_of(
    costs: Costmap, candidates: Mapping[str, Path], name: str, robot: Robot, max_e: float | None
) -> Costmap:
    """A costmap of the density of a candidate, in place of that of the field.

    Its u is the excess over 1, to scale, and its weight the greatest one.
    """
    density, blocked = density_of(costs, candidates, name, robot), blocked_of(costs, max_e)
    most = float(density[~blocked].max(initial=1.0)) - 1
    u = np.where(costs.grid.free, np.clip((density - 1) / (most or 1.0), 0.0, 1.0), np.nan)
    values = np.where(blocked, np.inf, 1 + most * u)
    return dataclasses.replace(
        costs, density=values, weight=most, u=u, of_heading=None, settings=None
    )


def blocked_of(
    costs: Costmap, max_e: float | None, window: Window = np.s_[:, :]
) -> NDArray[np.bool_]:
    """Cells of a map, or of a part of it, that no candidate may enter."""
    blocked = ~np.isfinite(costs.density[window])
    return blocked if max_e is None else blocked | (costs.e[window] > max_e)


Density: TypeAlias = Callable[[Ground], NDArray[np.float64]]
"""Cost per metre of each cell of a part of a map."""


AWARE_NAME = "aware, weight "
"""Beginning of the names of aware paths; their weight follows."""


def aware(weight: float) -> dict[str, Density]:
    return {f"{AWARE_NAME}{weight:g}": lambda part: 1 + weight * part.u}


INFLATED: dict[str, Density] = {"inflated": lambda part: part.inflated}
"""That of the robot's own inflated costmap, on which its navigation would plan."""
DENSITIES: dict[str, Density] = {
    "clear of walls": lambda part: part.clear,
    "along walls": lambda part: 1 + 3 * np.minimum(abs(part.grid.clearance - 0.6), 1.5),
    "a metre off walls": lambda part: 1 + 2 * np.minimum(abs(part.grid.clearance - 1), 2),
    "detour": lambda part: part.clear + 50 * part.cut,
    "way around 1": lambda part: 1 + 1.2 * part.beside,
    "way around 2": lambda part: 1 + 2.5 * part.beside,
    "clear way around 1": lambda part: part.clear + 1.2 * part.beside,
    "clear way around 2": lambda part: part.clear + 2.5 * part.beside,
}
"""Those that need no field, whose paths must be others than those before. They were found to lower
the error of filters; the first is the best of them."""
AWARE: dict[str, Density] = {
    **{name: density for weight in WEIGHTS for name, density in aware(weight).items()},
    "aware and clear": lambda part: part.clear + 8 * part.u,
}
"""Those that need a field, whose paths are candidates however near another one they are."""


def density_of(
    costs: Costmap, candidates: Mapping[str, Path], name: str, robot: Robot
) -> NDArray[np.float64]:
    """The density on a whole map whose cheapest path a candidate is, 1 or more, (H, W).

    Of a path that was given, or that another planner found, it is 1 there and rises to 9 within
    two metres of it.

    Parameters
    ----------
    costs : Costmap
        The costmap of the map, with a field or without one.
    candidates : mapping of str to Path
        The candidates in their order.
    name : str
        Name of the candidate.
    robot : Robot
        The robot.
    """
    before = dict(itertools.takewhile(lambda each: each[0] != name, candidates.items()))
    ground = Ground(costs.grid, costs.u, robot, before)
    if name == SHORTEST:
        return np.ones(costs.grid.shape)
    if density := {**INFLATED, **DENSITIES, **AWARE}.get(name):
        return density(ground)
    if name.startswith(AWARE_NAME):
        return 1 + float(name.removeprefix(AWARE_NAME)) * costs.u
    alone = dataclasses.replace(ground, accepted={name: candidates[name]})
    return 1 + 8 * (1 - alone.beside)

"""Alternatives to the shortest path: a handful of dissimilar paths that are not much longer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import number
from locplan.costs import Costmap, Path, check_costs
from locplan.planners._plan import SHORTEST, check_ends, plan
from locplan.planners._protocol import Position

PENALTIES = (0.6, 1.2, 2.5)
"""Costs that are added, one after the other, where earlier paths lead."""
PENALTY_REACH = 1.0
"""Distance from a path at which its penalty has fallen to 1/e [m]."""
WEIGHTS = (4.0, 12.0)
"""Weights of the degeneracy u of further alternatives."""
APART = 0.75
"""Distance from a path beyond which a point lies beside it [m]."""
LEAST_SHARE = 0.2
"""Least share of a path's points that lie beside each other path, for it to be another way."""
SPACING = 0.25
"""Distance between these points [m]."""
LONGEST_ALTERNATIVE = 1.5
"""Greatest length of an alternative by default, in lengths of the shortest path."""


def alternatives(
    costs: Costmap,
    start: Position,
    goal: Position,
    *,
    longest: float = LONGEST_ALTERNATIVE,
    others: Mapping[str, Path] | None = None,
) -> dict[str, Path]:
    """Find the shortest path and a handful of dissimilar ones.

    The others avoid the neighbourhood of those before, or the degeneracy of the costmap's field. A
    path counts as another way if at least a fifth of its points lie more than 0.75 m from each
    such path before it.

    Parameters
    ----------
    costs : Costmap
        Costmap of a field; without one only the neighbourhoods count.
    start, goal : (x, y)
        Positions in the world [m].
    longest : float, default 1.5
        Greatest length of an alternative, in lengths of the shortest path, >= 1. Raise it where
        detours are cheap, or the only other way is long.
    others : mapping of str to Path, optional
        Paths of your own by name, which are taken as they are, after all alternatives; "own" is
        put before a name that an alternative has.

    Returns
    -------
    dict of str to Path
        Paths by name, the shortest first; empty if no path leads to the goal.

    Raises
    ------
    PoseError
        If start or goal lies outside the map or in a blocked cell.
    ConfigError
        If `longest` is below 1.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> paths = alternatives(Costmap.blank(grid), (2.0, 3.0), (38.0, 3.0))
    >>> {name: round(path.length) for name, path in paths.items()}
    {'shortest': 36, 'way around 1': 37, 'way around 2': 46, 'way around 3': 37}
    """
    check_costs(costs)
    longest = number("longest", longest, 1.0)
    begin, end = check_ends(costs, start, goal)
    fielded = costs.settings is not None
    # Of many shortest paths a costmap with a field has the one that sees most.
    first = plan(costs.with_weight(1e-6) if fielded else _alike(costs), begin, end).path
    if first is None:
        return {}
    around = [f"way around {n}" for n, _ in enumerate(PENALTIES, 1)]
    aware = [f"aware, weight {weight:g}" for weight in WEIGHTS]
    found = {SHORTEST: first}
    limit = longest * first.length

    def add(name: str, layer: Costmap) -> None:
        path = plan(layer, begin, end).path
        if path is not None and path.length <= limit and is_another_way(path, found.values()):
            found[name] = path

    for name, penalty in zip(around, PENALTIES, strict=True):
        add(name, _avoiding(costs, found.values(), penalty))
    for name, weight in zip(aware, WEIGHTS, strict=True) if fielded else ():
        add(name, costs.with_weight(weight))
    for name, path in (others or {}).items():
        while name in (SHORTEST, *around, *aware, *found):
            name = f"own {name}"
        found[name] = path
    return found


def is_another_way(path: Path, others: Iterable[Path]) -> bool:
    """Return whether a path lies beside each of the others for a fifth of its way."""
    points = _points(path)
    return all(
        float((_distances(points, _points(other)) > APART).mean()) >= LEAST_SHARE
        for other in others
    )


def _points(path: Path) -> NDArray[np.float64]:
    return path.resampled(SPACING, even=True).xy  # each stands for as much of the path


def _distances(points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each point (n, 2) to the nearest of the others [m]."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(others).query(points)[0])


def _alike(costs: Costmap) -> Costmap:
    """Costmap on which every metre costs the same."""
    density = np.where(np.isfinite(costs.density), 1.0, np.inf)
    return Costmap.from_density(costs.grid, density)


def _avoiding(costs: Costmap, paths: Iterable[Path], penalty: float) -> Costmap:
    """Costmap of density 1 + penalty exp(-(d / reach)^2), d the distance to the nearest path."""
    import cv2

    grid = costs.grid
    away = np.ones(grid.shape, np.uint8)
    for path in paths:
        rows, cols = grid.world_to_grid(*path.resampled(grid.resolution / 2).xy.T)
        cells = np.floor([rows, cols]).astype(np.int64)
        away[tuple(np.clip(cells, 0, np.array(grid.shape)[:, None] - 1))] = 0
    distance = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.resolution
    density = 1 + penalty * np.exp(-((distance / PENALTY_REACH) ** 2))
    return Costmap.from_density(grid, np.where(np.isfinite(costs.density), density, np.inf))

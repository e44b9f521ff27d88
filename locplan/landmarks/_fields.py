"""How well single matches do along the routes, before and after: a field near them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Path
from locplan.field import CovarianceField, FieldConfig, Fused, covariance_field, points_near, scalar
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar

SPACING = 0.5
"""Distance between the positions along a route at which the field is read [m]."""

Profile = NDArray[np.float64]
"""Distance along a route and the largest deviation of a match's position there, (n, 2) [m]."""


def fields_along(
    maps: tuple[OccupancyGrid, OccupancyGrid],
    routes: tuple[Mapping[str, Path], Mapping[str, Path]],
    lidar: Lidar,
    threads: int | None,
) -> dict[str, tuple[Profile, Profile]]:
    """Deviations of a match by `Fused` along each route on the maps before and after.

    The field is computed near the routes only, and updated where the second map differs.
    """
    config = FieldConfig(Fused.of(lidar))
    before, after = (
        _near(grid, config, paths.values()) for grid, paths in zip(maps, routes, strict=True)
    )
    field = covariance_field(maps[0], config, points=before, threads=threads)
    found = {name: [_along(field, path)] for name, path in routes[0].items()}
    field = field.update(maps[1], points=after, threads=threads)
    return {name: (found[name][0], _along(field, path)) for name, path in routes[1].items()}


def _near(grid: OccupancyGrid, config: FieldConfig, paths: Iterable[Path]) -> NDArray[np.bool_]:
    """Lattice points that are read along some paths."""
    stride = config.stride_cells(grid.resolution)
    xy = np.concatenate([path.resampled(grid.resolution * stride / 2).xy for path in paths])
    cells = np.column_stack(grid.world_to_grid(*xy.T)) - 0.5
    return points_near(config.lattice_points(grid), stride, cells, 1.5 * stride)


def _along(field: CovarianceField, path: Path) -> Profile:
    """A field's largest deviation of the position along a path; NaN where it has none."""
    fine = path.resampled(SPACING, even=True)
    covariances = np.array([field.at(x, y) for x, y in fine.xy.tolist()])
    return np.column_stack([fine.distance, scalar(covariances, "position_std")])

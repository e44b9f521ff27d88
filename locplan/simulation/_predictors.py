"""Predictors of where a robot is badly localized: every estimator, and two simple baselines."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field import FieldConfig, Fisher, Fused, Sad, Scan, covariances_at, scalar
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Lidar

Array = NDArray[np.float64]
SCALARS = ("e", "position_std", "heading_std")
"""Scalars of each field that are tried."""
CLEARANCE, FEW_WALLS = "clearance", "few occupied cells"


class Predictor(NamedTuple):
    """A source and the scalar that is read of it; greater values should mean greater errors."""

    source: str
    """Name of the field, or of a baseline."""
    scalar: str
    """One of `SCALARS`, or nothing for a baseline."""

    @property
    def of_heading(self) -> bool:
        """True if it predicts the heading's error instead of the position's."""
        return self.scalar == "heading_std"

    def __str__(self) -> str:
        short = self.scalar.removesuffix("_std")
        return f"{self.source}, {short}" if short else self.source

    @property
    def column(self) -> str:
        """Name of the predictor's column in a CSV file."""
        return "_".join(filter(None, (self.source, self.scalar))).replace(" ", "_")


PLANNED = {
    Predictor("fused", "position_std"): "with --lidar",
    Predictor("scan", "position_std"): "with --lidar and --estimator scan",
    Predictor("fisher", "position_std"): "with --lidar and --estimator fisher",
    Predictor("sad", "e"): "with --estimator sad, the default without a lidar",
    Predictor("sad visible", "e"): "with --estimator sad --template visible",
    Predictor("paper", "e"): "with --estimator sad --preset paper",
    Predictor("paper visible", "e"): "with --estimator sad --preset paper --template visible",
}
"""Predictors that `locplan plan` makes its cost of, and its options for them.

Those that real lasers speak for come first."""


def configs(lidar: Lidar, disc: float | None = None) -> dict[str, FieldConfig]:
    """Settings of the fields that are tried, by name; all but "sad" and "paper" use this lidar.

    "sad" is the default preset and "paper" the paper's, with discs of the radius `disc` [m], by
    default the paper's; "visible" ones have templates of what is visible within that radius.
    """
    radius = Sad().range if disc is None else disc
    default, paper = Sad(range=radius), Sad.paper(range=radius)
    estimators = {
        "sad": default,
        "sad visible": dataclasses.replace(default, template="visible"),
        "paper": paper,
        "paper visible": dataclasses.replace(paper, template="visible"),
        "fisher": Fisher(lidar),
        "scan": Scan(lidar),
        "fused": Fused.of(lidar),
    }
    return {name: FieldConfig(estimator) for name, estimator in estimators.items()}


def predictions(
    grid: OccupancyGrid,
    fields: Mapping[str, FieldConfig],
    points: NDArray[np.int64],
    *,
    threads: int | None = None,
) -> dict[Predictor, Array]:
    """Values of each predictor at points of the lattice of the default stride, (n,).

    The configs' own strides are ignored. Several headings give the value of their mean
    information.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    fields : mapping of str to FieldConfig
        Settings of the fields by name, as returned by `configs`.
    points : (n, 2) array
        Rows and columns on the lattice of the default stride.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    """
    found: dict[Predictor, Array] = {}
    for name, config in fields.items():
        config = dataclasses.replace(config, stride=FieldConfig.stride)
        covariance = covariances_at(grid, config, points, threads=threads)
        for each in SCALARS:
            found[Predictor(name, each)] = scalar(covariance, each)
    config = next(iter(fields.values()))
    cells = points * config.stride_cells(grid.resolution)
    found[Predictor(CLEARANCE, "")] = grid.clearance[tuple(cells.T)]
    found[Predictor(FEW_WALLS, "")] = -occupied_in_range(grid, cells, config.estimator.reach)
    return found


def occupied_in_range(grid: OccupancyGrid, cells: NDArray[np.int64], reach: float) -> Array:
    """Number of occupied cells within `reach` [m] of each cell (n, 2), also behind walls, (n,)."""
    from scipy.spatial import cKDTree

    occupied = np.argwhere(grid.cells == OCCUPIED)
    if not len(occupied):
        return np.zeros(len(cells))
    radius = reach / grid.resolution
    return np.asarray(
        cKDTree(occupied).query_ball_point(cells, radius, return_length=True).astype(float)
    )

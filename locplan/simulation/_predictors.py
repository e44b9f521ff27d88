"""What may predict where a robot is badly localized: every estimator, and two simple baselines."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field import (
    CovarianceField,
    FieldConfig,
    Fisher,
    Lidar,
    Sad,
    Scan,
    _tiles as tiles,
    scalar,
)
from locplan.field._lattice import stride_cells
from locplan.maps import OCCUPIED, OccupancyGrid

Array = NDArray[np.float64]
SCALARS = ("e", "position_std", "heading_std")
"""Of each field."""
FUSED = "fisher+scan"
CLEARANCE, FEW_WALLS = "clearance", "few occupied cells"


class Predictor(NamedTuple):
    """A source and what is read of it; greater shall mean worse."""

    source: str
    scalar: str
    """One of `SCALARS`, or nothing for a baseline."""

    @property
    def of_heading(self) -> bool:
        """Whether it predicts the heading's error instead of the position's."""
        return self.scalar == "heading_std"

    def __str__(self) -> str:
        short = self.scalar.removesuffix("_std")
        return f"{self.source}, {short}" if short else self.source

    @property
    def column(self) -> str:
        """What to call it in a table for programs."""
        return "_".join(filter(None, (self.source, self.scalar))).replace(" ", "_")


def configs(lidar: Lidar, disc: float | None = None) -> dict[str, FieldConfig]:
    """The fields that are tried, by name; those that know a lidar know this one.

    "sad" is the default preset, "paper" the paper's, with discs of this radius [m], by default
    the paper's, or templates of what is visible within it.
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
    }
    return {name: FieldConfig(estimator) for name, estimator in estimators.items()}


def covariances_at(
    grid: OccupancyGrid,
    config: FieldConfig,
    points: NDArray[np.int64],
    *,
    threads: int | None = None,
) -> Array:
    """Covariances at some points of the default lattice, whatever the config's own, (n, d, d).

    Of several headings that of the mean information.

    Parameters
    ----------
    grid, config
        The map, and the field's settings.
    points : (n, 2) array
        Rows and columns of the lattice of the default stride.
    threads : int, optional
        All cores by default.
    """
    config = dataclasses.replace(config, stride=FieldConfig.stride)
    values = tiles.nothing_known(grid, config)
    wanted = np.zeros(values["covariance"].shape[:2], bool)
    wanted[tuple(points.T)] = True
    tiles.complete(values, grid, config, threads, None, None, wanted)
    return np.asarray(CovarianceField.of(values, grid, config).mean_covariance[tuple(points.T)])


def predictions(
    grid: OccupancyGrid,
    fields: Mapping[str, FieldConfig],
    points: NDArray[np.int64],
    *,
    threads: int | None = None,
) -> dict[Predictor, Array]:
    """What each predictor says at points of the default lattice, (n,).

    Fisher's and the scan's together are the geometric mean of both.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    fields : mapping of str to FieldConfig
        As `configs` has them.
    points, threads
        As for `covariances_at`.
    """
    found: dict[Predictor, Array] = {}
    for name, config in fields.items():
        covariance = covariances_at(grid, config, points, threads=threads)
        for each in SCALARS:
            found[Predictor(name, each)] = scalar(covariance, each)
    if {"fisher", "scan"} <= set(fields):
        for each in SCALARS:
            both = found[Predictor("fisher", each)] * found[Predictor("scan", each)]
            found[Predictor(FUSED, each)] = np.sqrt(both)
    config = next(iter(fields.values()))
    cells = points * stride_cells(config.stride, grid.resolution)
    found[Predictor(CLEARANCE, "")] = grid.clearance[tuple(cells.T)]
    found[Predictor(FEW_WALLS, "")] = -occupied_in_range(grid, cells, config.estimator.reach)
    return found


def occupied_in_range(grid: OccupancyGrid, cells: NDArray[np.int64], reach: float) -> Array:
    """How many occupied cells lie within `reach` [m] of each cell (n, 2), walls or not, (n,)."""
    from scipy.spatial import cKDTree

    occupied = np.argwhere(grid.cells == OCCUPIED)
    if not len(occupied):
        return np.zeros(len(cells))
    radius = reach / grid.resolution
    return np.asarray(
        cKDTree(occupied).query_ball_point(cells, radius, return_length=True).astype(float)
    )

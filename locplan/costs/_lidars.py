"""What a better lidar would buy: the share of a map that is degenerate for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._util.progress import ProgressCallback, in_turn
from locplan._util.records import Column, Table
from locplan.costs._costmap import ROBOT_RADIUS, Costmap
from locplan.costs._metrics import DEGENERATE
from locplan.field import FieldConfig, Fused, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar

STRIDE = 0.4
"""Spacing of the evaluated cells, which is enough for shares of an area [m]."""


COLUMNS = (
    Column("title", title="lidar", value=lambda each: each.lidar.title),
    Column("lidar", value=lambda each: each.lidar.model),
    Column("range", "m", value=lambda each: each.lidar.range),
    Column("degenerate_share", title=f"floor with u > {DEGENERATE:g}", digits=0, people="%"),
)
"""Columns of a table of lidars."""


@dataclass(frozen=True)
class LidarShare:
    """A lidar, and how much of the floor is degenerate with it."""

    lidar: Lidar
    """The lidar."""
    degenerate_share: float
    """Share of the floor, where the robot can stand, with u above 0.5, 0..1; NaN without floor."""


def compare_lidars(
    grid: OccupancyGrid,
    lidars: Sequence[Lidar],
    *,
    robot_radius: float = ROBOT_RADIUS,
    progress: ProgressCallback | None = None,
) -> list[LidarShare]:
    """Find for each lidar how much of a map is degenerate by `Fused`.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    lidars : sequence of Lidar
        The lidars, such as ``[Lidar.preset("turtlebot3"), Lidar.preset("tim571")]``.
    robot_radius : float, default 0.25
        Radius of the robot [m], >= 0; places closer to a wall are no part of the floor.
    progress : callable, optional
        Function that is called with (done, total) cells from time to time, lidar by lidar.

    Returns
    -------
    list of LidarShare
        The lidars in their order, each with its share.

    Raises
    ------
    LocplanError
        If an argument is out of its range.
    """
    shares, each_in_turn = [], in_turn(progress, len(lidars)) if progress else None
    for lidar in lidars:
        field = load_or_compute(
            grid, FieldConfig(Fused.of(lidar), stride=STRIDE), progress=each_in_turn
        )
        costs = Costmap.from_field(grid, field, robot_radius=robot_radius)
        u = costs.u[np.isfinite(costs.density)]
        shares.append(LidarShare(lidar, float(np.mean(u > DEGENERATE)) if u.size else np.nan))
    return shares


def lidars_table(shares: Sequence[LidarShare]) -> Table:
    """Table of lidars side by side.

    Parameters
    ----------
    shares : sequence of LidarShare
        What `compare_lidars` returned.
    """
    return Table.of(COLUMNS, shares)

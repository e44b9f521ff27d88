"""What a better lidar would buy: the share of a map that is degenerate for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._util.progress import ProgressCallback, in_turn
from locplan._util.tables import table
from locplan.costs._costmap import ROBOT_RADIUS, Costmap
from locplan.costs._metrics import DEGENERATE
from locplan.field import FieldConfig, Fused, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar

STRIDE = 0.4
"""Spacing of the evaluated cells, which is enough for shares of an area [m]."""


@dataclass(frozen=True)
class LidarShare:
    """A lidar, and how much of the floor is degenerate with it."""

    lidar: Lidar
    """The lidar."""
    degenerate_share: float
    """Share of the floor, where the robot can stand, with u above 0.5, 0..1; NaN without floor."""

    def to_json(self) -> dict[str, Any]:
        """The share, fit for JSON."""
        share = None if np.isnan(self.degenerate_share) else self.degenerate_share
        about = {"lidar": self.lidar.model, "range_m": self.lidar.range}
        return {**about, "degenerate_share": share}


def compare_lidars(
    grid: OccupancyGrid,
    lidars: Sequence[Lidar],
    *,
    robot_radius: float = ROBOT_RADIUS,
    progress: ProgressCallback | None = None,
) -> list[LidarShare]:
    """Tell for each lidar how much of a map is degenerate by `Fused`.

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
    shares, told = [], in_turn(progress, len(lidars)) if progress else None
    for lidar in lidars:
        field = load_or_compute(grid, FieldConfig(Fused.of(lidar), stride=STRIDE), progress=told)
        costs = Costmap.from_field(grid, field, robot_radius=robot_radius)
        u = costs.u[np.isfinite(costs.density)]
        shares.append(LidarShare(lidar, float(np.mean(u > DEGENERATE)) if u.size else np.nan))
    return shares


def lidars_table(shares: Sequence[LidarShare]) -> str:
    """Show lidars side by side, for people.

    Parameters
    ----------
    shares : sequence of LidarShare
        What `compare_lidars` returned.
    """
    rows = [
        [
            each.lidar.title,
            "–" if np.isnan(each.degenerate_share) else f"{each.degenerate_share:.0%}",
        ]
        for each in shares
    ]
    return table(["lidar", f"floor with u > {DEGENERATE:g}"], rows)

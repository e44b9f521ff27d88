"""The common base of the estimators that simulate a lidar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import instance
from locplan.field._estimator import Estimator
from locplan.field._lidar import Lidar
from locplan.field._search_window import OffsetLattice

HEADINGS = 8
"""Default number of headings where what the lidar sees depends on the heading."""


@dataclass(frozen=True, repr=False)
class LidarEstimator(Estimator):
    """An estimator that simulates a lidar."""

    casts_rays: ClassVar[bool] = True

    lidar: Lidar
    """The lidar: its range, field of view, beams and mount."""

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')

    @property
    def reach(self) -> float:
        """Range of the lidar [m]."""
        return self.lidar.range

    @property
    def summary(self) -> str:
        """Name and field of view of the estimator, for titles."""
        return f"{self.name}, {self.lidar.field_of_view_deg:g}°"

    @property
    def headings(self) -> int:
        """Default number of headings: 1 where the lidar sees the same in all, otherwise 8."""
        return 1 if self.lidar.sees_alike_in_all_headings else HEADINGS

    def on_grid(
        self, covariance: NDArray[np.float64], window: OffsetLattice
    ) -> NDArray[np.float64]:
        """Covariances as a field holds them: with Q if set, and no axis for a single heading."""
        covariance = self.plus_q(covariance, window)
        return covariance[:, 0] if covariance.shape[1] == 1 else covariance


def beams_of(lidar: Lidar, most: int | None = None) -> Any:
    """Lidar in the form that the kernels take, with at most `most` beams, evenly spaced."""
    from locplan._kernels.lidar import Lidar as Beams

    angles = lidar.angles
    if most and most < len(angles):
        angles = angles[(2 * np.arange(most) + 1) * len(angles) // (2 * most)]
    return Beams(
        angles=angles,
        forward=lidar.mount_x,
        left=lidar.mount_y,
        yaw=lidar.mount_yaw,
        sigma=lidar.range_sigma,
        max_range=lidar.range,
    )


def reach_of_beams(lidar: Lidar, resolution: float) -> int:
    """Greatest distance from the robot's cell to the end of a beam [cells]."""
    lever = math.hypot(lidar.mount_x, lidar.mount_y)
    return math.ceil((lidar.range + lever) / resolution) + 2

"""What the estimators that know the sensor have in common."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field._config import FieldConfig
from locplan.field._search_window import SearchWindow


def beams_of(config: FieldConfig, most: int | None = None) -> Any:
    """The config's sensor for the kernels, with at most so many beams, evenly spaced."""
    from locplan._kernels.lidar import Lidar

    sensor = config.sensor
    assert sensor is not None
    angles = sensor.angles
    if most and most < len(angles):
        angles = angles[(2 * np.arange(most) + 1) * len(angles) // (2 * most)]
    return Lidar(
        angles=angles,
        forward=sensor.mount_x,
        left=sensor.mount_y,
        yaw=sensor.mount_yaw,
        sigma=sensor.range_sigma,
        max_range=sensor.range,
    )


def reach_of_beams(config: FieldConfig, resolution: float) -> int:
    """How far from the robot's cell a beam may end [cells]."""
    sensor = config.sensor
    assert sensor is not None
    lever = math.hypot(sensor.mount_x, sensor.mount_y)
    return math.ceil((sensor.range + lever) / resolution) + 2


def on_grid(
    covariance: NDArray[np.float64], window: SearchWindow, config: FieldConfig
) -> NDArray[np.float64]:
    """As a field holds them: with Q if wanted, and no axis for a single heading."""
    if config.quantisation:
        covariance = covariance + window.quantisation
    return covariance[:, 0] if config.headings == 1 else covariance

"""The covariance that the Fisher information of a lidar's beams allows at given cells.

Sources: A. Censi, "On achievable accuracy for range-finder localization", ICRA 2007, doi
10.1109/ROBOT.2007.364120; Wang et al. on the static localizability of grid maps. The search
window's uniform variance is the prior, so that a place without any return is exactly featureless.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field._estimator import MapPart, Values
from locplan.field._surfaces import REACH, surface_normals
from locplan.field.estimators._beams import LidarEstimator, beams_of, reach_of_beams
from locplan.maps import OCCUPIED


class Scene(NamedTuple):
    """Data of a map that simulated beams need."""

    squares: NDArray[np.uint8]
    normals: NDArray[np.float32]


@dataclass(frozen=True, repr=False)
class Fisher(LidarEstimator):
    """The covariance that the Fisher information of a lidar's beams allows.

    It sees corridors and halls, but not repetition: it knows the derivatives at the true pose only.
    """

    name: ClassVar[str] = "fisher"
    remedy: ClassVar[str] = "--estimator scan tells more apart: it also sees repetition"

    def covariances(self, part: MapPart) -> Values:
        """Inverse of the sum of the beams' information and the window's prior, times k."""
        from locplan._kernels.information import information

        scene = part.prepared or self.prepare(part.levels, part.resolution)
        window = self.window.on(part.resolution)
        found = information(
            scene.squares,
            scene.normals,
            part.resolution,
            part.rows - part.corner[0] + 0.5,
            part.cols - part.corner[1] + 0.5,
            part.headings,
            beams_of(self.lidar),
            part.control,
        )[:, :, : window.dimension, : window.dimension]
        prior = np.linalg.inv(window.uniform_covariance)
        covariance = self.noise_level * _inverse(found + prior)
        return {"covariance": self.on_grid(covariance, window)}

    def prepare(self, levels: NDArray[np.uint8], resolution: float) -> Scene:
        """Empty squares and normals of a map or a part of it."""
        from locplan._kernels.rays import empty_squares

        occupied = levels == OCCUPIED
        return Scene(empty_squares(occupied), surface_normals(occupied))

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        reach = reach_of_beams(self.lidar, resolution) + REACH
        return min(reach, math.ceil(math.hypot(*map_shape)))


def _inverse(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverses of matrices (..., d, d); NaN where a matrix holds NaN."""
    unknown = np.isnan(information[..., 0, 0])
    matrices = np.where(unknown[..., None, None], np.eye(information.shape[-1]), information)
    return np.where(unknown[..., None, None], np.nan, np.linalg.inv(matrices))

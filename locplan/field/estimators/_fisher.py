"""The covariance that the Fisher information of a lidar's beams allows at given cells.

Two models of what a beam tells: the distance of its end from the surface it meets, as likelihood
fields and scan matching have it; or its range, see A. Censi, "On achievable accuracy for
range-finder localization", ICRA 2007, doi 10.1109/ROBOT.2007.364120. The search window's uniform
variance is the prior, so that a place without any return is exactly featureless.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Octets, Singles
from locplan._util.checks import one_of
from locplan.field._estimator import MapPart, Values
from locplan.field._search_window import OffsetLattice
from locplan.field.estimators._beams import (
    NORMAL_REACH,
    LidarEstimator,
    reach_of_beams,
    surface_normals,
)
from locplan.maps import OCCUPIED


class Scene(NamedTuple):
    """Data of a map that simulated beams need."""

    squares: Octets
    normals: Singles


@dataclass(frozen=True, repr=False)
class Fisher(LidarEstimator):
    """The covariance that the Fisher information of a lidar's beams allows.

    It sees corridors and halls, but not repetition: it knows the derivatives at the true pose only.

    Examples
    --------
    >>> from locplan.robots import Lidar
    >>> Fisher(Lidar.preset("utm-30lx")).beams_compared
    180
    """

    name: ClassVar[str] = "fisher"
    remedy: ClassVar[str] = "--estimator scan tells more apart: it also sees repetition"

    model: Literal["endpoint", "range"] = field(default="endpoint", kw_only=True)
    """Quantity that a beam tells: its end's distance from the surface, or its range (Censi).

    "endpoint" is what likelihood fields and scan matching have; "range" counts
    `Lidar.range_sigma` instead of the deviation of ends.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("model", self.model, ("endpoint", "range"))

    def identity(self) -> dict[str, object]:
        """The settings that the model reads: of ranges their noise, of ends that of the ends."""
        settings = super().identity()
        if self.model == "range":
            settings["sigma_hit"], settings["range_sigma"] = None, self.lidar.range_sigma
        return settings

    def q(self, lattice: OffsetLattice) -> Floats:
        """Zero, (d, d): nothing is compared in steps. See `locplan.field.Estimator.q`."""
        return np.zeros_like(lattice.quantisation)

    def sigma(self, resolution: float) -> float:
        """Standard deviation of what a beam tells, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        if self.model == "range":
            return max(self.lidar.range_sigma, resolution)
        return super().sigma(resolution)

    def covariances(self, part: MapPart) -> Values:
        """Inverse of the sum of the beams' information and the window's prior, times k.

        See `locplan.field.Estimator.covariances`.
        """
        from locplan._kernels.lidar import information

        scene = part.prepared or self.prepare(part.levels, part.resolution)
        window = self.lattice(part.resolution)
        found = information(
            scene.squares,
            scene.normals,
            part.resolution,
            part.rows - part.corner[0] + 0.5,
            part.cols - part.corner[1] + 0.5,
            part.headings,
            self.beams(),
            self.model == "range",
            part.control,
        )[:, :, : window.dimension, : window.dimension]
        prior = np.linalg.inv(window.uniform_covariance)
        known = found * (self.temperature / self.sigma(part.resolution) ** 2)
        covariance = self.noise_level * _inverse(known + prior)
        return {"covariance": covariance[:, part.heading_axis]}

    def prepare(self, levels: Octets, resolution: float) -> Scene:
        """Empty squares and normals of a map or a part of it.

        See `locplan.field.Estimator.prepare`.
        """
        from locplan._kernels.rays import empty_squares

        occupied = levels == OCCUPIED
        return Scene(empty_squares(occupied), surface_normals(occupied))

    def seconds(self, resolution: float) -> float:
        """Time in proportion to the beams, and a little for the inverse [s].

        See `locplan.field.Estimator.seconds`.
        """
        return 1e-5 + 1e-7 * self.beams_compared

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        reach = reach_of_beams(self.lidar, resolution) + NORMAL_REACH
        return min(reach, math.ceil(math.hypot(*map_shape)))


def _inverse(information: Floats) -> Floats:
    """Inverses of matrices (..., d, d); NaN where a matrix holds NaN."""
    unknown = np.isnan(information[..., 0, 0])
    matrices = np.where(unknown[..., None, None], np.eye(information.shape[-1]), information)
    return np.where(unknown[..., None, None], np.nan, np.linalg.inv(matrices))

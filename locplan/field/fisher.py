"""The covariance from the Fisher information of a lidar's beams, alone and fused with a scan's.

Two models of a beam's measurement: the distance of its end from the surface it meets, as in
likelihood fields and scan matching; or its range, see A. Censi, "On achievable accuracy for range-
finder localization", ICRA 2007, doi 10.1109/ROBOT.2007.364120. The search window's uniform variance
is the prior, so that a place without any return is exactly featureless.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from locplan._support.checks import check_choice, check_instance, derived_setting, set_frozen_fields
from locplan._support.kernels.arrays import Floats, Octets, Singles
from locplan.errors import ConfigError
from locplan.field.beams import (
    NORMAL_REACH,
    LidarEstimator,
    compute_beam_reach,
    find_surface_normals,
)
from locplan.field.covariance import compute_log_means, position_axes
from locplan.field.estimator import Estimator, EstimatorLayer, MapPart, Values
from locplan.field.scan import Scan
from locplan.field.search_window import OffsetLattice
from locplan.maps.occupancy import OCCUPIED
from locplan.robots.lidar import Lidar


@dataclass(frozen=True, repr=False)
class Fisher(LidarEstimator):
    """The covariance that the Fisher information of a lidar's beams allows.

    It sees corridors and halls, but not repetition: it knows the derivatives at the true pose only.

    Examples
    --------
    >>> from locplan.robots import Lidar
    >>> Fisher(Lidar.preset("utm-30lx")).beams_compared
    270
    """

    name: ClassVar[str] = "fisher"
    remedy: ClassVar[str] = "--field scan distinguishes more: it also detects repetition"

    model: Literal["endpoint", "range"] = field(default="endpoint", kw_only=True)
    """Quantity that a beam measures: its end's distance from the surface, or its range (Censi).

    "endpoint" is what likelihood fields and scan matching have; "range" counts
    `Lidar.range_sigma` instead of the deviation of ends.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("model", self.model, ("endpoint", "range"))

    def identity(self) -> dict[str, object]:
        """Return the settings that the model reads: the noise of ranges, or the noise of ends."""
        settings = super().identity()
        if self.model == "range":
            settings["sigma_hit"], settings["range_sigma"] = None, self.lidar.range_sigma
        return settings

    def q(self, lattice: OffsetLattice) -> Floats:
        """Return zero, (d, d): nothing is compared in steps. See `locplan.field.Estimator.q`."""
        return np.zeros_like(lattice.quantisation)

    def sigma(self, resolution: float) -> float:
        """Return the standard deviation of a beam's measurement, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        if self.model == "range":
            return max(self.lidar.range_sigma, resolution)
        return super().sigma(resolution)

    def covariances(self, part: MapPart) -> Values:
        """Return the inverse of the sum of the beams' information and the window's prior, times k.

        See `locplan.field.Estimator.covariances`.
        """
        from locplan._support.kernels.lidar import compute_fisher_information

        squares, normals = part.prepared or self.prepare(part.levels, part.resolution)
        window = self.lattice(part.resolution)
        beam_information = compute_fisher_information(
            squares,
            normals,
            part.resolution,
            part.rows - part.corner[0] + 0.5,
            part.cols - part.corner[1] + 0.5,
            part.headings,
            self.make_kernel_lidar(),
            self.model == "range",
            part.control,
        )[:, :, : window.dimension, : window.dimension]
        prior = np.linalg.inv(window.uniform_covariance)
        scaled_information = beam_information * (
            self.temperature / self.sigma(part.resolution) ** 2
        )
        covariance = self.noise_level * _invert(scaled_information + prior)
        return {"covariance": covariance[:, part.heading_axis]}

    def prepare(self, levels: Octets, resolution: float) -> tuple[Octets, Singles]:
        """Compute empty squares and normals of a map or a part of it.

        See `locplan.field.Estimator.prepare`.
        """
        from locplan._support.kernels.rays import compute_empty_squares

        occupied = levels == OCCUPIED
        return compute_empty_squares(occupied), find_surface_normals(occupied)

    def seconds(self, resolution: float) -> float:
        """Return a time in proportion to the beams, and a little for the inverse [s].

        See `locplan.field.Estimator.seconds`.
        """
        return 1e-5 + 1e-7 * self.beams_compared

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        reach = compute_beam_reach(self.lidar, resolution) + NORMAL_REACH
        return min(reach, math.ceil(math.hypot(*map_shape)))


def _invert(information: Floats) -> Floats:
    """Invert matrices (..., d, d); NaN for a matrix with NaN."""
    unknown = np.isnan(information[..., 0, 0])
    matrices = np.where(unknown[..., None, None], np.eye(information.shape[-1]), information)
    return np.where(unknown[..., None, None], np.nan, np.linalg.inv(matrices))


ROUND, ELONGATED = 1.5, 4.0
"""Ratios of the axes of the scan's ellipse: up to the first both covariances count equally, from
the second on only the scan's.

In a corridor the derivatives give at most half of the measured deviation.
"""
SMALL, LARGE = 0.25, 0.35
"""Largest deviations of the scan [m]: up to the first both covariances count equally, from the
second on only the scan's.

A lidar that sees less may have a rounder ellipse, but not a smaller one: so large deviations stay
large. There the derivatives also give at most half of the measured deviation.
"""


@dataclass(frozen=True, repr=False)
class Fused(Estimator):
    """The mean of the covariances of `Fisher` and `Scan` in the matrix logarithm.

    Both have equal weights if the scan's ellipse of positions is round and small; if it is long and
    narrow, or large, only the scan counts. Of all estimators it ranks the uncertainty of real
    lasers best, and is nearest to it in metres.

    Examples
    --------
    >>> from locplan.robots import Lidar
    >>> Fused(Lidar.preset("utm-30lx")).reach
    30.0
    """

    name: ClassVar[str] = "fused"
    layers: ClassVar[tuple[EstimatorLayer, ...]] = Scan.layers
    remedy: ClassVar[str] = LidarEstimator.remedy
    weight: ClassVar[float] = LidarEstimator.weight
    criterion: ClassVar[str] = LidarEstimator.criterion
    casts_rays: ClassVar[bool] = True

    lidar: Lidar
    """The lidar: its range, field of view, beams and mount."""
    _: KW_ONLY
    fisher: Fisher = derived_setting(lambda fused: Fisher(fused.lidar))
    """The estimator of the derivatives; by default `Fisher` for the lidar."""
    scan: Scan = derived_setting(lambda fused: Scan(fused.lidar))
    """The estimator of the simulated scan, whose layers the field has; by default `Scan`.

    Its lidar and its window are those of `fisher`.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        check_instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        set_frozen_fields(
            self, fisher=self.fisher or Fisher(self.lidar), scan=self.scan or Scan(self.lidar)
        )
        check_instance("fisher", self.fisher, Fisher)
        check_instance("scan", self.scan, Scan)
        if {self.fisher.lidar, self.scan.lidar} != {self.lidar}:
            raise ConfigError("fisher and scan must have the lidar of the fused estimator")
        if self.fisher.window != self.scan.window:
            raise ConfigError("fisher and scan must have one window to be fused")

    def with_lidar(self, lidar: Lidar) -> Fused:
        fisher, scan = replace(self.fisher, lidar=lidar), replace(self.scan, lidar=lidar)
        return replace(self, lidar=lidar, fisher=fisher, scan=scan)

    @property
    def reach(self) -> float:
        """Range of the lidar [m]."""
        return self.scan.reach

    @property
    def title(self) -> str:
        """Name of the estimator, its lidar, range and field of view."""
        return f"{self.name}, {self.lidar.title}"

    @property
    def headings(self) -> int:
        """Default number of headings: 1 if the lidar sees the same at all of them, otherwise 8."""
        return self.scan.headings

    def identity(self) -> dict[str, object]:
        """Return the settings that decide the values of both estimators."""
        identities = {"fisher": self.fisher.identity(), "scan": self.scan.identity()}
        return {"name": self.name, "noise_level": self.noise_level, **identities}

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.scan.lattice(resolution)

    def perfect(self, lattice: OffsetLattice) -> Floats:
        return self.scan.perfect(lattice)

    def featureless(self, lattice: OffsetLattice) -> Floats:
        return self._blend_covariances(
            self.fisher.featureless(lattice), self.scan.featureless(lattice)
        )

    def q(self, lattice: OffsetLattice) -> Floats:
        """Return zero, (d, d): the mean has the scan's Q. See `locplan.field.Estimator.q`."""
        return self.fisher.q(lattice)

    def covariances(self, part: MapPart) -> Values:
        """Return the mean of both covariances in the matrix logarithm, times k, and the scan's
        layers.

        See `locplan.field.Estimator.covariances`.
        """
        of_fisher, of_scan = part.prepared or self.prepare(part.levels, part.resolution)
        uncounted = part.control[:1]  # the scan alone counts the cells that are done
        fisher_values = self.fisher.covariances(
            replace(part, prepared=of_fisher, control=uncounted)
        )
        scan_values = self.scan.covariances(replace(part, prepared=of_scan))
        return {
            **scan_values,
            "covariance": self._blend_covariances(
                fisher_values["covariance"], scan_values["covariance"]
            ),
        }

    def _blend_covariances(self, of_fisher: Floats, of_scan: Floats) -> Floats:
        """Return the mean of both covariances in the matrix logarithm, with the scan's weight."""
        major, minor, _ = position_axes(of_scan)
        is_round = (ELONGATED - major / minor) / (ELONGATED - ROUND)
        is_small = (LARGE - major) / (LARGE - SMALL)
        of_both = np.clip(np.minimum(is_round, is_small), 0.0, 1.0)
        return self.noise_level * compute_log_means(of_fisher, of_scan, 1 - of_both / 2)

    def prepare(self, levels: Octets, resolution: float) -> tuple[object, object]:
        """Prepare data of a map or a part of it for both estimators.

        See `locplan.field.Estimator.prepare`.
        """
        return self.fisher.prepare(levels, resolution), self.scan.prepare(levels, resolution)

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        estimators = self.fisher, self.scan
        return max(estimator.halo(resolution, map_shape) for estimator in estimators)

    def seconds(self, resolution: float) -> float:
        return self.fisher.seconds(resolution) + self.scan.seconds(resolution)

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        return sum(
            estimator.memory(resolution, map_shape) for estimator in (self.fisher, self.scan)
        )

"""What derivatives and a simulated scan say of a match, together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Octets
from locplan._util.checks import instance
from locplan.errors import ConfigError
from locplan.field._covariance import log_euclidean_means, position_axes
from locplan.field._estimator import Estimator, Layer, MapPart, Values
from locplan.field._search_window import OffsetLattice
from locplan.field.estimators._beams import LidarEstimator
from locplan.field.estimators._fisher import Fisher, Scene as FisherScene
from locplan.field.estimators._scan import Scan, Scene as ScanScene
from locplan.robots import Lidar

ROUND, ELONGATED = 1.5, 4.0
"""Ratios of the axes of the scan's ellipse up to which both count alike, and from which it alone.

In a corridor the derivatives say half the deviation that is measured, or less.
"""


class Scenes(NamedTuple):
    """Data of a map for both estimators."""

    fisher: FisherScene
    scan: ScanScene


@dataclass(frozen=True, repr=False)
class Fused(Estimator):
    """The mean of the covariances of `Fisher` and `Scan` in the matrix logarithm.

    Both count alike where the scan's ellipse of positions is round; where it is long and narrow,
    the scan alone counts. It ranks the uncertainty of real lasers best, and is nearest to it in
    metres.

    Examples
    --------
    >>> Fused.of(Lidar.preset("utm-30lx")).reach
    30.0
    """

    name: ClassVar[str] = "fused"
    layers: ClassVar[tuple[Layer, ...]] = Scan.layers
    remedy: ClassVar[str] = LidarEstimator.remedy
    weight: ClassVar[float] = LidarEstimator.weight
    criterion: ClassVar[str] = LidarEstimator.criterion
    casts_rays: ClassVar[bool] = True

    fisher: Fisher
    """The estimator of the derivatives."""
    scan: Scan
    """The estimator of the simulated scan, whose layers the field has.

    Its lidar and its window are those of `fisher`.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("fisher", self.fisher, Fisher)
        instance("scan", self.scan, Scan)
        if (self.fisher.lidar, self.fisher.window) != (self.scan.lidar, self.scan.window):
            raise ConfigError("fisher and scan must have one lidar and one window to be fused")

    @classmethod
    def of(cls, lidar: Lidar, **settings: Any) -> Fused:
        """Both estimators with their default settings for a lidar.

        Parameters
        ----------
        lidar
            See `locplan.field.Estimator.of`.
        **settings
            Settings of `Fused` alone, which is its noise level.
        """
        return cls(Fisher(lidar), Scan(lidar), **settings)

    def with_lidar(self, lidar: Lidar) -> Fused:
        fisher, scan = replace(self.fisher, lidar=lidar), replace(self.scan, lidar=lidar)
        return replace(self, fisher=fisher, scan=scan)

    @property
    def lidar(self) -> Lidar:
        """The lidar of both estimators."""
        return self.scan.lidar

    @property
    def reach(self) -> float:
        """Range of the lidar [m]."""
        return self.scan.reach

    @property
    def summary(self) -> str:
        """Name of the estimator, its lidar, range and field of view."""
        return f"{self.name}, {self.lidar.title}"

    @property
    def headings(self) -> int:
        """Default number of headings: 1 where the lidar sees the same in all, otherwise 8."""
        return self.scan.headings

    def identity(self) -> dict[str, object]:
        """What decides the values of both."""
        both = {"fisher": self.fisher.identity(), "scan": self.scan.identity()}
        return {**super().identity(), **both}

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.scan.lattice(resolution)

    def perfect(self, lattice: OffsetLattice) -> Floats:
        return self.scan.perfect(lattice)

    def featureless(self, lattice: OffsetLattice) -> Floats:
        return self._mean(self.fisher.featureless(lattice), self.scan.featureless(lattice))

    def q(self, lattice: OffsetLattice) -> Floats:
        """Zero, (d, d): the scan's is within the mean already. See `locplan.field.Estimator.q`."""
        return self.fisher.q(lattice)

    def covariances(self, part: MapPart) -> Values:
        """Mean of both covariances in the matrix logarithm, times k, and the scan's layers.

        See `locplan.field.Estimator.covariances`.
        """
        scenes: Scenes = part.prepared or self.prepare(part.levels, part.resolution)
        uncounted = part.control[:1]  # the scan alone counts the cells that are done
        known = self.fisher.covariances(replace(part, prepared=scenes.fisher, control=uncounted))
        found = self.scan.covariances(replace(part, prepared=scenes.scan))
        return {**found, "covariance": self._mean(known["covariance"], found["covariance"])}

    def _mean(self, of_fisher: Floats, of_scan: Floats) -> Floats:
        major, minor, _ = position_axes(of_scan)
        of_both = np.clip((ELONGATED - major / minor) / (ELONGATED - ROUND), 0.0, 1.0)
        return self.noise_level * log_euclidean_means(of_fisher, of_scan, 1 - of_both / 2)

    def prepare(self, levels: Octets, resolution: float) -> Scenes:
        """Data of a map or a part of it for both estimators.

        See `locplan.field.Estimator.prepare`.
        """
        return Scenes(
            self.fisher.prepare(levels, resolution), self.scan.prepare(levels, resolution)
        )

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        both = self.fisher, self.scan
        return max(each.halo(resolution, map_shape) for each in both)

    def seconds(self, resolution: float) -> float:
        return self.fisher.seconds(resolution) + self.scan.seconds(resolution)

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        return sum(each.memory(resolution, map_shape) for each in (self.fisher, self.scan))

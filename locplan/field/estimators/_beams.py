"""The common base of the estimators that simulate a lidar."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import instance, keep, positive, whole
from locplan.field._estimator import Estimator
from locplan.field._search_window import OffsetLattice, SearchWindow
from locplan.robots import Lidar

WINDOW = SearchWindow(half_width=1.5, step=0.1, half_rotation_deg=4.0, rotation_step_deg=1.0)
"""Search window that ranks the uncertainty of real lasers best."""
EFFECTIVE_BEAMS = 12.6
"""Number of independent beams that tell as much as a whole scan does, fitted to real lasers."""
SHARP = 0.05
"""Largest standard deviation of a position up to which a match counts as perfect [m]."""
VIEW = (
    "range",
    "least_range",
    "field_of_view_deg",
    "beams",
    "mount_x",
    "mount_y",
    "mount_yaw_deg",
)
"""Settings of a lidar that decide which surfaces its beams meet."""


@dataclass(frozen=True, repr=False)
class LidarEstimator(Estimator):
    """An estimator that simulates a lidar."""

    casts_rays: ClassVar[bool] = True
    remedy: ClassVar[str] = f"matches there are within the {SHARP:g} m that count as perfect"
    weight: ClassVar[float] = 8.0
    criterion: ClassVar[str] = "position_std"

    lidar: Lidar
    """The lidar: its range, field of view, beams and mount."""
    window: SearchWindow = field(default=WINDOW, kw_only=True)
    """Search window of pose offsets, which bounds the covariance.

    By default 1.5 m in steps of 0.1 m, and 4 deg in steps of 1 deg.
    """
    sigma_hit: float = field(default=0.1, kw_only=True)
    """Standard deviation of the distance of a beam's end from a wall [m], above 0.

    At least a cell counts. More suits a map that is drawn roughly, and makes covariances larger.
    """
    effective_beams: float = field(default=EFFECTIVE_BEAMS, kw_only=True)
    """Number of independent beams that tell as much as all, above 0.

    Neighbouring beams err alike; the default is fitted to real lasers. Covariances shrink as it
    grows. Of fewer beams than these, each tells as much as an independent one.
    """
    max_beams: int = field(default=180, kw_only=True)
    """Greatest number of beams that count, >= 1; fewer are faster.

    Of a lidar with more, as many are simulated, evenly spaced over its field of view.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        instance("window", self.window, SearchWindow)
        keep(
            self,
            sigma_hit=positive("sigma_hit", self.sigma_hit, "m"),
            effective_beams=positive("effective_beams", self.effective_beams, "beams"),
            max_beams=whole("max_beams", self.max_beams),
        )

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.window.on(resolution)

    def perfect(self, lattice: OffsetLattice) -> NDArray[np.float64]:
        """Deviations of 0.05 m, or of the lattice's steps where these are coarser, (d, d).

        See `locplan.field.Estimator.perfect`.
        """
        least = lattice.quantisation
        least[[0, 1], [0, 1]] = np.maximum(least[[0, 1], [0, 1]], SHARP**2)
        return least

    def identity(self) -> dict[str, object]:
        """The settings as they count; of the lidar, those that decide what its beams meet."""
        return {
            **super().identity(),
            "lidar": {name: getattr(self.lidar, name) for name in VIEW},
            "effective_beams": float(min(self.effective_beams, self.beams_compared)),
            "max_beams": self.beams_compared,
        }

    def sigma(self, resolution: float) -> float:
        """Standard deviation of a beam's end that counts, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        return max(self.sigma_hit, resolution)

    @property
    def beams_compared(self) -> int:
        """Number of beams that count; whole quarters of them where the lidar sees all round."""
        count = min(self.lidar.beams, self.max_beams)
        return count // 4 * 4 or count if self.lidar.sees_all_round else count

    @property
    def beam_numbers(self) -> NDArray[np.int64]:
        """Numbers of a real lidar's beams that count, evenly spaced, (beams_compared,)."""
        count = self.beams_compared
        return (2 * np.arange(count) + 1) * self.lidar.beams // (2 * count)

    @property
    def temperature(self) -> float:
        """Factor on the log-likelihood of the beams that count."""
        return min(1.0, self.effective_beams / self.beams_compared)

    @property
    def reach(self) -> float:
        """Range of the lidar [m]."""
        return self.lidar.range

    @property
    def summary(self) -> str:
        """Name of the estimator, its lidar, range and field of view."""
        return f"{self.name}, {self.lidar.title}"

    @classmethod
    def of(cls, lidar: Lidar, **settings: Any) -> LidarEstimator:
        return cls(lidar, **settings)

    def with_lidar(self, lidar: Lidar) -> LidarEstimator:
        return replace(self, lidar=lidar)

    @property
    def headings(self) -> int:
        """Default number of headings: 1 where the lidar sees the same in all, otherwise 8."""
        return 1 if self.lidar.sees_alike_in_all_headings else 8

    def beams(self) -> Any:
        """The simulated lidar with the beams that count, in the form that the kernels take."""
        from locplan._kernels.lidar import Lidar as Beams

        # A choice of the lidar's own beams would lie aside of the middle, and not turn with a map.
        lidar = replace(self.lidar, beams=self.beams_compared)
        return Beams(
            angles=lidar.angles,
            forward=lidar.mount_x,
            left=lidar.mount_y,
            yaw=lidar.mount_yaw,
            sigma=lidar.range_sigma,
            min_range=lidar.least_range,
            max_range=lidar.range,
        )


def reach_of_beams(lidar: Lidar, resolution: float) -> int:
    """Greatest distance from the robot's cell to the end of a beam [cells]."""
    lever = math.hypot(lidar.mount_x, lidar.mount_y)
    return math.ceil((lidar.range + lever) / resolution) + 2

"""The common base of the estimators that simulate a lidar, and the surfaces that its beams meet."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints, Octets, Singles
from locplan._util.checks import instance, positive, setting
from locplan.field._estimator import Estimator
from locplan.field._search_window import OffsetLattice, SearchWindow
from locplan.robots import Lidar

SHARP = 0.05
"""Largest standard deviation of a position up to which a match counts as perfect [m]."""


@dataclass(frozen=True, repr=False)
class LidarEstimator(Estimator):
    """An estimator that simulates a lidar."""

    casts_rays: ClassVar[bool] = True
    remedy: ClassVar[str] = f"matches there are within the {SHARP:g} m that count as perfect"
    weight: ClassVar[float] = 8.0
    criterion: ClassVar[str] = "position_std"

    lidar: Lidar
    """The lidar: its range, field of view, beams and mount."""
    _: KW_ONLY
    window: SearchWindow = field(
        default=SearchWindow(half_width=1.5, step=0.1, half_rotation_deg=4.0, rotation_step_deg=1.0)
    )
    """Search window of pose offsets, which bounds the covariance.

    By default 1.5 m in steps of 0.1 m, and 4 deg in steps of 1 deg, which ranks the uncertainty of
    real lasers best.
    """
    sigma_hit: float = setting(0.1, positive, "m")
    """Standard deviation of the distance of a beam's end from a wall [m], above 0.

    At least a cell counts. More suits a map that is drawn roughly, and makes covariances larger.
    """
    effective_beams: float = setting(12.6, positive, "beams")
    """Number of independent beams that tell as much as all, above 0.

    Neighbouring beams err alike; the default is fitted to real lasers. Covariances shrink as it
    grows. Of fewer beams than these, each tells as much as an independent one.
    """
    max_beams: int = setting(180)
    """Maximum number of beams that count, >= 1; fewer are faster.

    Of a lidar with more, as many are simulated, evenly spaced over its field of view.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        instance("window", self.window, SearchWindow)

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.window.on(resolution)

    def perfect(self, lattice: OffsetLattice) -> Floats:
        """Deviations of 0.05 m, or of the lattice's steps where these are coarser, (d, d).

        See `locplan.field.Estimator.perfect`.
        """
        least = lattice.quantisation
        least[[0, 1], [0, 1]] = np.maximum(least[[0, 1], [0, 1]], SHARP**2)
        return least

    def identity(self) -> dict[str, object]:
        """The settings as they count; of the lidar, those that decide what its beams meet."""
        view = ("range", "min_range", "field_of_view_deg", "beams")
        mount = ("mount_x", "mount_y", "mount_yaw_deg")
        return {
            **super().identity(),
            "lidar": {name: getattr(self.lidar, name) for name in (*view, *mount)},
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
    def beam_numbers(self) -> Ints:
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
        # A choice of the lidar's own beams would lie aside of the middle, and not turn with a map.
        return replace(self.lidar, beams=self.beams_compared).for_kernels()


def reach_of_beams(lidar: Lidar, resolution: float) -> int:
    """Maximum distance from the robot's cell to the end of a beam [cells]."""
    lever = math.hypot(lidar.mount_x, lidar.mount_y)
    return math.ceil((lidar.range + lever) / resolution) + 2


WIDTHS = 3, 9, 27, 81
"""Edge lengths of the windows that a normal is averaged over, one after the other [cells]."""
NORMAL_REACH = 3 + 1 + sum(width // 2 for width in WIDTHS)
"""Distance from a cell within which the map decides its normal [cells]."""
BAND = 1 << 20
"""Number of cells that are processed at once, which bounds the memory."""


def surface_normals(occupied: Bools) -> Singles:
    """Find the unit normal of the surface at each occupied cell, without a sign.

    It is the main axis of the structure tensor (Bigün and Granlund, 1987) over the widest window
    in which the surface is straight and faces the same way as in the narrower ones. The steps of
    slanting walls turn a narrow window's axis by degrees, so that a bare slanting corridor would
    seem to fix the position along it. A wide window alone would smooth away real door frames.

    A part of a map gives the same normals at `NORMAL_REACH` or more cells from its edges.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.

    Returns
    -------
    (H, W, 2) array
        The components (row, col), zero where a cell is not occupied or has no direction.
    """
    rows, cols = occupied.shape
    normals = np.zeros((*occupied.shape, 2), np.float32)
    band = max(2 * NORMAL_REACH, BAND // cols)
    for top in range(0, rows, band):
        bottom, above = min(top + band, rows), max(0, top - NORMAL_REACH)
        part = _normals(occupied[above : min(rows, bottom + NORMAL_REACH)])
        normals[top:bottom] = part[top - above : bottom - above]
    return normals


def wall_cells(occupied: Bools) -> Octets:
    """Mark the occupied cells that have one of their 8 neighbours not occupied.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.

    Returns
    -------
    (H, W) array of uint8
        1 at such cells, 0 elsewhere.
    """
    import cv2

    solid = occupied.astype(np.uint8)
    around = np.ones((3, 3), np.uint8)
    enclosed = cv2.erode(solid, around, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(solid - enclosed)


def _normals(occupied: Bools) -> Singles:
    import cv2

    edge: Any = {"borderType": cv2.BORDER_REPLICATE}
    # The steps of slanting walls are smoothed; so few levels that all sums over windows are exact.
    soft = cv2.GaussianBlur(occupied.astype(np.uint8) * 100, (0, 0), 1.0, **edge)
    # Slopes along the columns (dx) and along the rows (dy).
    dx, dy = (cv2.Scharr(soft, cv2.CV_64F, *order, **edge) for order in ((1, 0), (0, 1)))
    # The tensor in whole numbers: its main axis as (cos, sin) of the doubled angle, and its trace.
    tensor = np.stack([(dx - dy) * (dx + dy), 2 * dx * dy, dx**2 + dy**2], axis=-1)
    tensor = _summed(tensor, WIDTHS[0])
    axis, agreement = _main_axes(tensor[occupied])
    faces = agreement > 1e-3  # a lone post, for one, has no normal
    for width in WIDTHS[1:]:
        tensor = _summed(tensor, width)
        wider, agreement = _main_axes(tensor[occupied])
        # A wider window may turn the axis by 18 deg; of a straight surface nearly all slopes are on
        # one axis: (l1 - l2) / (l1 + l2) is above 0.8.
        alike = (axis * wider).sum(axis=1) > math.cos(2 * math.radians(18))
        better = alike & (agreement > 0.8)
        axis[better] = wider[better]
    # Halving the angle by roots keeps the normals of walls along the axes free of rounding.
    double_cos, double_sin = axis.T
    row = np.copysign(np.sqrt(np.clip((1 - double_cos) / 2, 0, 1)), double_sin)
    col = np.sqrt(np.clip((1 + double_cos) / 2, 0, 1))
    normals = np.zeros((*occupied.shape, 2), np.float32)
    normals[occupied] = np.stack([row * faces, col * faces], axis=-1)
    return normals


def _summed(tensor: Floats, width: int) -> Floats:
    import cv2

    edge: Any = {"borderType": cv2.BORDER_REPLICATE}
    return np.asarray(cv2.boxFilter(tensor, -1, (width, width), normalize=False, **edge))


def _main_axes(tensors: Floats) -> tuple[Floats, Floats]:
    """Unit vectors of the axes' doubled angles, (n, 2), and agreement of the slopes, 0..1."""
    length = np.hypot(tensors[:, 0], tensors[:, 1])
    axes = tensors[:, :2] / np.maximum(length, 1.0)[:, None]
    return axes, length / np.maximum(tensors[:, 2], 1.0)

"""The common base of the estimators that simulate a lidar, and the surfaces that its beams meet."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from locplan._support.checks import check_instance, check_positive, checked_setting
from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets, Singles
from locplan.field.estimator import Estimator
from locplan.field.search_window import OffsetLattice, SearchWindow
from locplan.robots.lidar import Lidar

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
    sigma_hit: float = checked_setting(0.1, check_positive, "m")
    """Standard deviation of the distance of a beam's end from a wall [m], above 0.

    At least a cell counts. More suits a map that is drawn roughly, and makes covariances larger.
    """
    effective_beams: float = checked_setting(12.6, check_positive, "beams")
    """Number of independent beams as informative as all beams in half a turn, above 0.

    It grows with the field of view: a lidar that sees all round has twice as many. Errors of
    neighbouring beams are correlated; the default is fitted to real lasers with a field of view of
    half a turn. Covariances shrink as it grows. Fewer beams than these count as independent.
    """
    max_beams: int = checked_setting(180)
    """Maximum number of beams in half a turn that count, >= 1; fewer are faster.

    It also grows with the field of view. An odd number counts as the even one below it.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        check_instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        check_instance("window", self.window, SearchWindow)

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.window.to_lattice(resolution)

    def perfect(self, lattice: OffsetLattice) -> Floats:
        """Return deviations of 0.05 m, or of the lattice's steps if these are coarser, (d, d).

        See `locplan.field.Estimator.perfect`.
        """
        deviations = lattice.quantisation
        deviations[[0, 1], [0, 1]] = np.maximum(deviations[[0, 1], [0, 1]], SHARP**2)
        return deviations

    def identity(self) -> dict[str, object]:
        """Return the effective settings, and the lidar's settings that decide where beams end."""
        view = ("range", "min_range", "field_of_view_deg", "beams")
        mount = ("mount_x", "mount_y", "mount_yaw_deg")
        return {
            **super().identity(),
            "lidar": {name: getattr(self.lidar, name) for name in (*view, *mount)},
            "effective_beams": self.temperature * 180 / self._compared_beams.pitch_deg,
            "max_beams": self.beams_compared,
        }

    def sigma(self, resolution: float) -> float:
        """Return the effective standard deviation of a beam's end, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        return max(self.sigma_hit, resolution)

    @cached_property
    def _compared_beams(self) -> ComparedBeams:
        """The beams that count."""
        return ComparedBeams.from_lidar(self.lidar, self.max_beams)

    @property
    def beams_compared(self) -> int:
        """Number of beams that count."""
        return len(self._compared_beams.places)

    @property
    def nearest_beam_indices(self) -> Ints:
        """Indices of a real lidar's beams that are nearest to the simulated ones, (n,)."""
        return self._compared_beams.find_nearest_beam_indices(self.lidar)

    @property
    def temperature(self) -> float:
        """Factor on the log-likelihood of the beams that count.

        It is the same for all fields of view, so that each further beam adds information.
        """
        return min(1.0, self.effective_beams * self._compared_beams.pitch_deg / 180)

    @property
    def reach(self) -> float:
        """Range of the lidar [m]."""
        return self.lidar.range

    @property
    def title(self) -> str:
        """Name of the estimator, its lidar, range and field of view."""
        return f"{self.name}, {self.lidar.title}"

    def with_lidar(self, lidar: Lidar) -> LidarEstimator:
        return replace(self, lidar=lidar)

    @property
    def headings(self) -> int:
        """Default number of headings: 1 if the lidar sees the same at all of them, otherwise 8."""
        return 1 if self.lidar.is_heading_independent else 8

    def make_kernel_lidar(self) -> Any:
        """Return the simulated lidar with the beams that count, as the kernels take it."""
        angles, yaw = self._compared_beams.compute_angles_and_yaw(self.lidar)
        return self.lidar.to_kernel_settings()._replace(angles=angles, yaw=yaw)


@dataclass(frozen=True, eq=False)
class ComparedBeams:
    """The beams of a lidar that count.

    Their bearings lie on one lattice: the first point is half a pitch from the robot's axis, and a
    quarter turn is a whole number of pitches. A part of a field of view therefore has a part of the
    beams and never more information than all of it, and results turn with the map. A lidar whose
    beams are one pitch apart keeps them.
    """

    pitch_deg: float
    """Angle from one beam to the next [deg]."""
    places: Ints
    """Places of the beams on the lattice, (n,): 0 and -1 next to the axis; for the lidar's beams
    from 0 on."""
    are_lidar_beams: bool
    """True if they are all of the lidar's beams."""

    @classmethod
    def from_lidar(cls, lidar: Lidar, max_beams: int) -> ComparedBeams:
        """Choose the beams of a lidar that count.

        Parameters
        ----------
        lidar : Lidar
            The lidar.
        max_beams : int
            Maximum number of beams in half a turn.
        """
        width, count, all_round = lidar.field_of_view_deg, lidar.beams, lidar.sees_all_round
        if count < 4:
            return cls(width / count, np.arange(count), True)
        # A part of a lidar's view has a rounded number of its beams.
        in_quarter = count // 4 if all_round else int(90 * (count + 0.5) / width)
        in_quarter = max(1, min(in_quarter, max_beams // 2))
        pitch = 90 / in_quarter
        if all_round:
            return cls(pitch, np.arange(-2 * in_quarter, 2 * in_quarter), False)
        if math.isclose(width / (count - 1), pitch, rel_tol=1e-3):
            return cls(pitch, np.arange(count), True)
        first, last = (
            (lidar.mount_yaw_deg + side * (width / 2 + 1e-6)) / pitch - 0.5 for side in (-1, 1)
        )
        places = np.arange(math.ceil(first), math.floor(last) + 1)
        middle = math.floor(lidar.mount_yaw_deg / pitch)  # of a view that is narrower than a pitch
        return cls(pitch, places if places.size else np.array([middle]), False)

    def compute_angles_and_yaw(self, lidar: Lidar) -> tuple[Floats, float]:
        """Return the beams' angles (n,) from an axis, and the axis' angle on the robot [rad]."""
        if self.are_lidar_beams:
            return lidar.angles, lidar.mount_yaw
        return np.radians((self.places + 0.5) * self.pitch_deg), 0.0

    def find_nearest_beam_indices(self, lidar: Lidar) -> Ints:
        """Return the sorted indices of the lidar's beams that are nearest to these."""
        if self.are_lidar_beams:
            return self.places
        on_lidar = (self.places + 0.5) * self.pitch_deg - lidar.mount_yaw_deg
        between = np.degrees(lidar.angles[1] - lidar.angles[0])
        numbers = np.rint((on_lidar - np.degrees(lidar.angles[0])) / between - 1e-6).astype(int)
        if lidar.sees_all_round:
            return np.unique(numbers % lidar.beams)
        return np.unique(np.clip(numbers, 0, lidar.beams - 1))

    def number_symmetric_beams(self, lidar: Lidar) -> Ints:
        """Return the places of the beams from an axis, 1 next to it; symmetric beams share one.

        The axis is the middle of the lidar's beams, or the robot's axis. For a lidar that sees all
        round, quarter turns are symmetries as well.
        """
        half_pitches = abs(2 * self.places + 1)
        if self.are_lidar_beams:
            half_pitches = abs(2 * self.places + 1 - len(self.places))
        if lidar.sees_all_round:
            quarter = len(self.places) / 2
            half_pitches = np.minimum(half_pitches % quarter, -half_pitches % quarter)
        return (half_pitches // 2).astype(np.int64) + 1


def compute_beam_reach(lidar: Lidar, resolution: float) -> int:
    """Return the maximum distance from the robot's cell to the end of a beam [cells]."""
    lever = math.hypot(lidar.mount_x, lidar.mount_y)
    return math.ceil((lidar.range + lever) / resolution) + 2


WIDTHS = 3, 9, 27, 81
"""Edge lengths of the windows that a normal is averaged over, one after the other [cells]."""
NORMAL_REACH = 3 + 1 + sum(width // 2 for width in WIDTHS)
"""Distance from a cell within which the map decides its normal [cells]."""
BAND = 1 << 20
"""Number of cells that are processed at once, which bounds the memory."""


def find_surface_normals(occupied: Bools) -> Singles:
    """Find the unit normal of the surface at each occupied cell, without a sign.

    It is the main axis of the structure tensor (Bigün and Granlund, 1987) over the widest window
    with a straight surface that faces the same way as in the narrower windows. The steps of
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
        The components (row, col), zero for cells that are not occupied or have no direction.
    """
    rows, cols = occupied.shape
    normals = np.zeros((*occupied.shape, 2), np.float32)
    band = max(2 * NORMAL_REACH, BAND // cols)
    for top in range(0, rows, band):
        bottom, above = min(top + band, rows), max(0, top - NORMAL_REACH)
        part = _compute_normals(occupied[above : min(rows, bottom + NORMAL_REACH)])
        normals[top:bottom] = part[top - above : bottom - above]
    return normals


def find_wall_surface_cells(occupied: Bools) -> Octets:
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


def _compute_normals(occupied: Bools) -> Singles:
    """Compute the normals of a band of the map."""
    import cv2

    # The steps of slanting walls are smoothed; so few levels that all sums over windows are exact.
    soft = cv2.GaussianBlur(
        occupied.astype(np.uint8) * 100, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE
    )
    # Slopes along the columns (dx) and along the rows (dy).
    dx, dy = (
        cv2.Scharr(soft, cv2.CV_64F, dx=x_order, dy=1 - x_order, borderType=cv2.BORDER_REPLICATE)
        for x_order in (1, 0)
    )
    # The tensor in whole numbers: its main axis as (cos, sin) of the doubled angle, and its trace.
    tensor = np.stack([(dx - dy) * (dx + dy), 2 * dx * dy, dx**2 + dy**2], axis=-1)
    tensor = _sum_windows(tensor, WIDTHS[0])
    axis, agreement = _compute_main_axes(tensor[occupied])
    faces = agreement > 1e-3  # a lone post, for one, has no normal
    for width in WIDTHS[1:]:
        tensor = _sum_windows(tensor, width)
        wider, agreement = _compute_main_axes(tensor[occupied])
        # A wider window may turn the axis by 18 deg; of a straight surface nearly all slopes are on
        # one axis: (l1 - l2) / (l1 + l2) is above 0.8.
        agrees = (axis * wider).sum(axis=1) > math.cos(2 * math.radians(18))
        is_better = agrees & (agreement > 0.8)
        axis[is_better] = wider[is_better]
    # Halving the angle by roots keeps the normals of walls along the axes free of rounding.
    double_cos, double_sin = axis.T
    row = np.copysign(np.sqrt(np.clip((1 - double_cos) / 2, 0, 1)), double_sin)
    col = np.sqrt(np.clip((1 + double_cos) / 2, 0, 1))
    normals = np.zeros((*occupied.shape, 2), np.float32)
    normals[occupied] = np.stack([row * faces, col * faces], axis=-1)
    return normals


def _sum_windows(tensor: Floats, width: int) -> Floats:
    """Sum a tensor over square windows."""
    import cv2

    sums = cv2.boxFilter(
        tensor, -1, (width, width), normalize=False, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(sums)


def _compute_main_axes(tensors: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors of the axes' doubled angles, (n, 2), and the slopes' agreement, 0..1."""
    length = np.hypot(tensors[:, 0], tensors[:, 1])
    axes = tensors[:, :2] / np.maximum(length, 1.0)[:, None]
    return axes, length / np.maximum(tensors[:, 2], 1.0)

"""The parts of a robot: outline, kinematics, odometry errors, and disturbances."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import Settings, check_positive, checked_setting, short_repr
from locplan._support.kernels.arrays import Floats, Ints
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED


@dataclass(frozen=True, kw_only=True, repr=False)
class Kinematics(Settings):
    """How a robot moves.

    Raises
    ------
    ConfigError
        If a value is out of its range, or a robot that turns on the spot has a turning radius.

    Examples
    --------
    >>> Kinematics(drive="car-like", turning_radius=1.2)
    Kinematics(drive='car-like', turning_radius=1.2)
    """

    drive: Literal["differential", "omnidirectional", "car-like"] = checked_setting(
        "differential", "differential", "omnidirectional", "car-like"
    )
    """A differential drive turns on the spot, an omnidirectional one also moves sideways, and a
    car-like one needs a turning radius."""
    turning_radius: float = checked_setting(0.0, 0.0)
    """Minimum turning radius, above 0 for a car-like robot, otherwise 0 [m]."""
    reverse: bool = checked_setting(True)
    """True if the robot can also drive in reverse."""
    speed: float = checked_setting(0.5, check_positive)
    """Usual speed, above 0 [m/s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.drive == "car-like") != (self.turning_radius > 0):
            raise ConfigError(
                "turning_radius must be above 0 for a car-like robot, otherwise 0; this robot is"
                f" {self.drive} with {self.turning_radius:g} m"
            )


@dataclass(frozen=True, kw_only=True, repr=False)
class Inflation(Settings):
    """Nav2's inflation of a costmap, which keeps planned paths off the walls.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Inflation(inflation_radius=0.7).cost_scaling_factor
    10.0
    """

    inflation_radius: float = checked_setting(0.55, 0.0)
    """Distance from walls up to which cells cost more, >= 0 [m]."""
    cost_scaling_factor: float = checked_setting(10.0, check_positive)
    """Decay of the cost with the distance, above 0 [1/m]."""


NEAREST_OBJECT, FARTHEST_OBJECT = 0.5, 2.0
"""Minimum and maximum distance of an object that occludes the lidar [m]."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Odometry(Settings):
    """Errors of a robot's odometry.

    The defaults suit a small robot indoors. They were set before any measurement.
    `locplan.recordings.calibration.calibrate_drive` fits them to a recorded drive.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Odometry(distance_drift=0.05)
    Odometry(distance_drift=0.05)
    """

    distance_drift: float = checked_setting(0.02, 0.0)
    """Standard deviation of the reported distance after 1 m, >= 0 [m]; it grows with the root of
    the distance."""
    heading_drift_deg: float = checked_setting(1.0, 0.0)
    """Standard deviation of the reported heading after 1 m, >= 0 [deg]; it grows with the root of
    the distance."""
    turn_drift_deg: float = checked_setting(1.0, 0.0)
    """Standard deviation of the reported heading after a turn of 1 rad, >= 0 [deg]; it grows with
    the root of the turn."""
    distance_bias: float = checked_setting(0.02, 0.0)
    """Standard deviation, from drive to drive, of the factor on reported distances, >= 0 [1]."""
    heading_bias_deg: float = checked_setting(1.0, 0.0)
    """Standard deviation, from drive to drive, of a reported bend to one side, >= 0 [deg/m]."""
    turn_bias: float = checked_setting(0.02, 0.0)
    """Standard deviation, from drive to drive, of the factor on reported turns, >= 0 [1]."""

    def to_kernel_settings(self) -> Any:
        """The errors in the form that the kernels take."""
        from locplan._support.kernels.drives import OdometryErrors

        return OdometryErrors(
            distance_drift=self.distance_drift,
            heading_drift=math.radians(self.heading_drift_deg),
            turn_drift=math.radians(self.turn_drift_deg),
            distance_bias=self.distance_bias,
            heading_bias=math.radians(self.heading_bias_deg),
            turn_bias=self.turn_bias,
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class Disturbances(Settings):
    """Disturbances of a lidar and a filter, and worlds that differ from the map.

    The defaults suit a small robot indoors. They were set before any measurement.
    `locplan.recordings.calibration.calibrate_drive` fits them to a recorded drive.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Disturbances(boundary_noise=0.0).worlds
    8
    """

    boundary_noise: float = checked_setting(0.1, 0.0, 1.0)
    """Share of the cells between free space and walls in which the world differs from the map,
    0..1; raise it where furniture is moved or the map is old."""
    worlds: int = checked_setting(8, 1, 1000)
    """Number of such worlds, which single scans take in turn, 1 to 1000; a drive has its own."""
    outliers: float = checked_setting(0.04, 0.0, 1.0)
    """Share of the beams that end at a random distance within the range, 0..1."""
    occlusion: float = checked_setting(0.2, 0.0, 1.0)
    """Share of the scans in which an object stands in view of the lidar, 0.5 to 2 m away, 0..1;
    raise it where people walk about."""
    occlusion_deg: float = checked_setting(20.0, 0.0, 360.0)
    """Width of this object in the lidar's view, 0 to 360 [deg]."""
    start_sigma: float = checked_setting(0.1, 0.0)
    """Standard deviation of the filter's first position in x and y, >= 0 [m]."""
    start_sigma_deg: float = checked_setting(3.0, 0.0)
    """Standard deviation of the filter's first heading, >= 0 [deg]."""

    def to_kernel_settings(self) -> Any:
        """The disturbances of scans in the form that the kernels take."""
        from locplan._support.kernels.lidar import BeamDisturbances

        width = math.radians(self.occlusion_deg)
        return BeamDisturbances(
            self.outliers, self.occlusion, width, NEAREST_OBJECT, FARTHEST_OBJECT
        )


@dataclass(frozen=True, eq=False, repr=False)
class Footprint:
    """A convex outline around the robot's centre.

    Parameters
    ----------
    vertices : (n, 2) array of float64
        Corners x (forward), y (left) [m] from the robot's centre, n >= 3. If the outline is not
        convex, its convex hull counts. The centre must lie inside.

    Examples
    --------
    >>> outline = Footprint([(0.5, 0.2), (0.5, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
    >>> round(outline.circumscribed_radius, 3), round(outline.inscribed_radius, 3)
    (0.539, 0.2)
    """

    vertices: Floats

    if TYPE_CHECKING:  # a list is taken, but an array kept

        def __init__(self, vertices: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        hull = _compute_hull(_parse_corners(self.vertices))
        area = np.sum(hull[:, 0] * np.roll(hull[:, 1], -1) - hull[:, 1] * np.roll(hull[:, 0], -1))
        hull = hull if area > 0 else hull[::-1]
        inside = np.sum(_compute_normals(hull) * hull, axis=1) > 0
        if len(hull) < 3 or not inside.all():
            raise ConfigError("footprint must be a polygon around the robot's centre (0, 0)")
        object.__setattr__(self, "vertices", hull)

    @classmethod
    def from_text(cls, text: str) -> Footprint:
        """Parse a footprint from a text of Nav2's parameter files.

        Parameters
        ----------
        text : str
            The corners, such as "[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]" [m].

        Raises
        ------
        ConfigError
            If it is no such text, or no polygon around the robot's centre.
        """
        plain = "".join(part.strip() for part in re.split(r"([\[\],])", text))
        pairs = [pair.split(",") for pair in plain[2:-2].split("],[")]
        try:
            if not (plain.startswith("[[") and plain.endswith("]]")):
                raise ValueError
            return cls(np.array([[float(value) for value in pair] for pair in pairs]))
        except ValueError:
            raise ConfigError(
                "footprint must be corners such as [[0.3,0.2],[0.3,-0.2],[-0.3,0]], not"
                f" {short_repr(text)}"
            ) from None

    def __repr__(self) -> str:
        radii = f"radii {self.inscribed_radius:g} and {self.circumscribed_radius:.3g} m"
        return f"Footprint({len(self.vertices)} corners, {radii})"

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the smallest circle about the centre that holds the outline [m]."""
        return float(np.hypot(*self.vertices.T).max())

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle about the centre that the outline holds [m]."""
        normals = _compute_normals(self.vertices)
        return float((np.sum(self.vertices * normals, axis=1) / np.hypot(*normals.T)).min())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Footprint) and np.array_equal(self.vertices, other.vertices)

    def __hash__(self) -> int:
        return hash(self.vertices.tobytes())

    def find_first_collision(self, grid: OccupancyGrid, poses: Any) -> tuple[float, float] | None:
        """Find the first position on a path with the outline on an occupied cell.

        A path without headings is driven forward: the robot heads along each line and turns on
        the spot, the shorter way, where two lines meet. The check is exact for lines; in turns the
        outline is grown by at most 0.004 %, so that nothing is missed between.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        poses : Path, or (n, 2) or (n, 3) array
            Positions of the robot's centre along the path in the world, with headings or without
            [m, m, rad].

        Returns
        -------
        (x, y) or None
            Start of the colliding line or turn [m]; None without a collision.
        """
        moves = _poses_on_grid(grid, np.asarray(getattr(poses, "poses", poses), np.float64))
        hit = next(self._find_colliding_moves(grid, moves), -1)
        if hit < 0:
            return None
        x, y = grid.grid_to_world(moves[hit, 1], moves[hit, 0])
        return float(x), float(y)

    def find_collisions(self, grid: OccupancyGrid, poses: Floats) -> Ints:
        """Return the indices of all lines between poses that collide with an occupied cell.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        poses : (n, 3) array
            Poses of the robot's centre along the path in the world [m, m, rad].

        Returns
        -------
        (k,) array
            The colliding ones of the n - 1 lines.
        """
        return np.array([*self._find_colliding_moves(grid, _poses_on_grid(grid, poses))], np.int64)

    def _find_colliding_moves(self, grid: OccupancyGrid, moves: Floats) -> Iterator[int]:
        """Yield the indices of the colliding lines between poses (n, 3) of (col, row, heading)."""
        from locplan._support.kernels.outlines import find_first_hit, sum_occupied_along_rows

        sums, corners, begin = (
            sum_occupied_along_rows(grid.cells == OCCUPIED),
            self.vertices / grid.resolution,
            0,
        )
        while (hit := int(find_first_hit(sums, corners, moves[begin:]))) >= 0:
            yield begin + hit
            begin += hit + 1


def _poses_on_grid(grid: OccupancyGrid, poses: Floats) -> Floats:
    """Return poses (n, 3) of (col, row, heading) along a path [cells, rad], split into single
    moves.

    Without headings the robot heads along each line, and turns where two meet.
    """
    row, col = grid.world_to_grid(*poses[:, :2].T)
    xy = np.column_stack([col, row])
    if poses.shape[1] == 3:
        return np.column_stack([xy, poses[:, 2] - grid.origin[2]])
    xy = xy[np.concatenate([[True], np.any(np.diff(xy, axis=0), axis=1)])]
    if len(xy) == 1:
        return np.empty((0, 3))
    heading = np.arctan2(*np.diff(xy, axis=0).T[::-1])
    along = np.column_stack([xy[:-1], heading]), np.column_stack([xy[1:], heading])
    return np.asarray(np.stack(along, axis=1).reshape(-1, 3))


def _parse_corners(vertices: ArrayLike) -> Floats:
    """Return the corners of an outline as an array (n, 2)."""
    try:
        corners = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    plane = corners.ndim == 2 and corners.shape[1] == 2 and len(corners) >= 3
    if not (plane and np.isfinite(corners).all()):
        raise ConfigError("footprint must be three or more finite corners (x, y) in metres")
    return corners


def _compute_hull(corners: NDArray[Any]) -> Floats:
    """Return the convex hull of corners, counter-clockwise."""
    import cv2

    order = cv2.convexHull(corners.astype(np.float32), returnPoints=False)
    return np.asarray(corners[np.asarray(order).ravel()])


def _compute_normals(polygon: NDArray[Any]) -> Floats:
    """Return outward normals of a counter-clockwise polygon's edges, as long as the edges."""
    x, y = (np.roll(polygon, -1, axis=0) - polygon).T
    return np.column_stack([y, -x])

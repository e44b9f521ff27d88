"""A path in the plane: its poses, its length, and positions along it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from locplan._support.checks import FARTHEST, check_file_path, check_positive
from locplan._support.files import check_writable_file
from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.poses import compute_travel_distances
from locplan._support.reading import read_text
from locplan._support.saved import EqualByValue
from locplan._support.tables import make_geojson_collection, make_geojson_feature, write_csv
from locplan.errors import LocplanError

COLUMNS = ("x", "y", "heading")
"""Columns of a path's file [m, m, rad]."""


@dataclass(frozen=True, eq=False, repr=False)
class Path(EqualByValue):
    """A polyline in the world.

    Parameters
    ----------
    xy : (n, 2) array of float64
        World positions from start to goal, n >= 1, within 1e8 m. They are copied, and read-only
        afterwards.
    heading : (n,) array of float64, optional
        Heading of the robot at each position, counter-clockwise from the x axis [rad], within
        1e6. Give it if the robot does not face its direction of travel.

    Raises
    ------
    LocplanError
        If the shapes do not match, or values are not finite or out of range.

    Examples
    --------
    >>> path = Path(np.array([[0.0, 0.0], [3.0, 4.0]]))
    >>> path.length
    5.0
    >>> path.resample(2.5).xy.tolist()
    [[0.0, 0.0], [1.5, 2.0], [3.0, 4.0]]
    """

    xy: Floats
    heading: Floats | None = None

    if TYPE_CHECKING:  # lists are taken, but arrays kept

        def __init__(self, xy: ArrayLike, heading: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        xy = parse_number_array(self.xy, "a path needs an (n, 2) array of metres")
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) == 0 or not np.isfinite(xy).all():
            raise LocplanError(f"a path needs an (n, 2) array of finite metres, not {xy.shape}")
        if np.abs(xy).max() > FARTHEST:
            raise LocplanError(f"a path must lie within ±{FARTHEST:g} m; give it in metres")
        xy.setflags(write=False)
        object.__setattr__(self, "xy", xy)
        if self.heading is not None:
            fault = f"headings must be {len(xy)} angles within ±1e+06 rad, one a position"
            heading = parse_number_array(self.heading, fault)
            if heading.shape != xy.shape[:1] or not (np.abs(heading) <= 1e6).all():
                raise LocplanError(fault)
            heading.setflags(write=False)
            object.__setattr__(self, "heading", heading)

    def __repr__(self) -> str:
        ends = (f"{x:g},{y:g}" for x, y in self.xy[[0, -1]].tolist())
        return f"Path({' to '.join(ends)} m, {self.length:.2f} m long, {len(self)} positions)"

    def __len__(self) -> int:
        return len(self.xy)

    def __iter__(self) -> Iterator[tuple[float, float]]:
        """Iterate over the positions as (x, y) [m]."""
        return map(tuple, self.xy.tolist())

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Floats:
        """Return the positions, (n, 2) [m]."""
        return np.array(self.xy, dtype=dtype, copy=copy)

    @property
    def poses(self) -> Floats:
        """Positions, with headings if the path has them, (n, 2) or (n, 3) [m, m, rad]."""
        return self.xy if self.heading is None else np.column_stack([self.xy, self.heading])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write x, y, and heading if there are headings, as CSV with a row for each position.

        Parameters
        ----------
        path : path
            The file, named ``*.csv``; an existing file is replaced.

        Raises
        ------
        LocplanError
            If the file cannot be written, or its name does not end in .csv.
        """
        file = check_file_path("a path file", path)
        check_writable_file(file, ".csv")
        # The shortest text of just this number: `load` gives the path back as it was.
        write_csv(file, self.poses, ",".join(COLUMNS[: self.poses.shape[1]]), "%s")

    @classmethod
    def join(cls, paths: Sequence[Path]) -> Path:
        """Join paths that begin at the end of the previous one.

        Parameters
        ----------
        paths : sequence of Path
            The paths, one at least; the whole has headings if all of them have.
        """
        xy = np.vstack([paths[0].xy, *(path.xy[1:] for path in paths[1:])])
        headings = [path.heading for path in paths if path.heading is not None]
        if len(headings) < len(paths):
            return cls(xy)
        return cls(xy, np.concatenate([headings[0], *(heading[1:] for heading in headings[1:])]))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Path:
        """Read a path from a CSV file whose header names x, y and perhaps heading.

        Parameters
        ----------
        path : path
            The file: metres and radians, a position a row; further columns are ignored.

        Raises
        ------
        LocplanError
            If the file cannot be read, or does not hold a path.
        """
        file = check_file_path("a path file", path)
        names, *lines = read_text(file).splitlines() or [""]
        columns = [name.strip() for name in names.split(",")]
        if "x_m" in columns:
            raise LocplanError(
                f"{file}: its columns have the former names x_m, y_m; name them x, y,"
                " and heading_rad heading"
            )
        used = COLUMNS if "heading" in columns else COLUMNS[:2]
        try:
            at = [number for number, row_text in enumerate(lines, 2) if row_text.strip()]
            rows = [
                [float(v) for v in row_text.split(",")] for row_text in lines if row_text.strip()
            ]
            poses = np.array(rows)[:, [columns.index(name) for name in used]]
        except (ValueError, IndexError):
            raise LocplanError(
                f"{file}: is no path; its first line must name x,y, and numbers follow"
            ) from None
        finite = np.isfinite(poses).all(axis=1)
        if not finite.all():
            line = at[int(np.argmin(finite))]
            raise LocplanError(
                f"{file}: line {line} has {', '.join(used)} that are not all finite; correct or"
                " remove it"
            )
        try:
            return cls(poses[:, :2], poses[:, 2] if "heading" in columns else None)
        except LocplanError as error:
            raise LocplanError(f"{file}: {error}") from None

    def to_geojson(self, *, frame: str = "map") -> dict[str, Any]:
        """Return the path as GeoJSON: a FeatureCollection with one LineString [m].

        Parameters
        ----------
        frame : str, default "map"
            Frame of the coordinates, a property like "length" [m] and "heading" [rad].
        """
        properties: dict[str, Any] = {"frame": frame, "length": self.length}
        if self.heading is not None:
            properties["heading"] = self.heading.tolist()
        xy = self.xy.tolist()
        return make_geojson_collection(
            "path",
            [make_geojson_feature("LineString", xy * (2 if len(xy) == 1 else 1), properties)],
        )

    def to_nav_msgs(self, *, frame: str = "map") -> dict[str, Any]:
        """Return the path as the fields of a nav_msgs/Path, without a time.

        ``rosidl_runtime_py.set_message_fields(message, fields)`` fills a message with them.

        Parameters
        ----------
        frame : str, default "map"
            Frame of the poses; positions without a heading face the way they go.

        Examples
        --------
        >>> fields = Path([[0.0, 0.0], [0.0, 2.0]]).to_nav_msgs()
        >>> fields["poses"][1]["pose"]["position"]
        {'x': 0.0, 'y': 2.0, 'z': 0.0}
        """
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
        poses = []
        for (x, y), heading in zip(self.xy.tolist(), self.facing.tolist(), strict=True):
            position = {"x": x, "y": y, "z": 0.0}
            turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
            poses.append({"header": header, "pose": {"position": position, "orientation": turn}})
        return {"header": header, "poses": poses}

    @cached_property
    def distance(self) -> Floats:
        """Distance travelled at each position, (n,) [m]."""
        return compute_travel_distances(self.xy)

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return float(self.distance[-1])

    @property
    def drive_poses(self) -> Floats:
        """Poses (n, 3) as a robot takes them: without `heading` along each line, and turned where
        two lines meet [m, m, rad]."""
        if self.heading is not None or len(self) == 1:
            return np.column_stack([self.xy, self.facing])
        heading = self.facing[:-1]
        line_ends = [np.column_stack([xy, heading]) for xy in (self.xy[:-1], self.xy[1:])]
        return np.asarray(np.stack(line_ends, axis=1).reshape(-1, 3))

    @property
    def facing(self) -> Floats:
        """`heading`, or without it the direction of the line after each position, (n,) [rad]."""
        if self.heading is not None:
            return self.heading
        steps = np.diff(self.xy, axis=0)
        moving = np.flatnonzero(steps.any(axis=1))
        if moving.size == 0:
            return np.zeros(len(self.xy))
        ahead = np.searchsorted(moving, np.arange(len(self.xy)))
        x, y = steps[moving[np.minimum(ahead, len(moving) - 1)]].T
        return np.asarray(np.arctan2(y, x))

    def resample(self, spacing: float, *, even: bool = False) -> Path:
        """Return the same line with positions at most a spacing apart; its corners are kept.

        Parameters
        ----------
        spacing : float
            Maximum distance from one position to the next, along the path [m], above 0.
        even : bool, default False
            True puts the positions at equal distances, as statistics along a path need them. The
            lines between them then cut corners, and may meet obstacles that the path avoids.

        Raises
        ------
        LocplanError
            If the spacing is not positive, or gives more than 1e7 positions.
        """
        check_positive("spacing", spacing, "metres")
        if self.length / spacing > 10**7:
            raise LocplanError(
                f"a path of {self.length:.3g} m cannot have a position every {spacing:g} m; take a"
                " greater spacing"
            )
        poses = self.poses.copy()
        poses[:, 2:] = np.unwrap(poses[:, 2:], axis=0)
        if even:
            count = max(1, int(np.ceil(self.length / spacing - 1e-9)))
            at = np.linspace(0.0, self.length, count + 1)
            poses = np.column_stack([np.interp(at, self.distance, v) for v in poses.T])
        else:
            poses = insert_poses_between(poses, np.diff(self.distance) / spacing - 1e-9)
        return Path(poses[:, :2], None if self.heading is None else poses[:, 2])


def parse_number_array(values: object, fault: str) -> Floats:
    """Return a copy as an array of numbers; a LocplanError with this fault if it is not numeric."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise LocplanError(fault) from None


def insert_poses_between(poses: Floats, n_parts: Floats) -> Floats:
    """Insert poses between poses, evenly on each step.

    Parameters
    ----------
    poses : (n, k) array
        The poses; all columns are interpolated linearly.
    n_parts : (n - 1,) array
        Minimum number of parts of each step, rounded up, at least 1.

    Returns
    -------
    (m, k) array
        All poses, m >= n.
    """
    steps = np.maximum(1, np.ceil(n_parts))
    at = np.concatenate([[0.0], np.cumsum(steps)])
    indices = np.arange(at[-1] + 1)
    return np.column_stack([np.interp(indices, at, v) for v in poses.T])


class HasPath(Protocol):
    """A result with a path, such as a `Plan`."""

    @property
    def path(self) -> Path | None:
        """The path; None if there is none."""


AnyPath = Path | HasPath | ArrayLike
"""A path, a plan that has one, or an (n, 2) or (n, 3) array of positions or poses [m, m, rad]."""


def as_path(path_like: AnyPath) -> Path:
    """Return the path that a path, a plan or an array is.

    Parameters
    ----------
    path_like : Path, Plan, or (n, 2) or (n, 3) array
        The path; the third column of an array has headings [rad].

    Raises
    ------
    LocplanError
        If it is none of them, or a plan without a path.
    """
    path = getattr(path_like, "path", path_like)
    if isinstance(path, Path):
        return path
    if path is None and path_like is not None:
        raise LocplanError("the plan has no path; its status and note give the reason")
    fault = "a path must be a Path, a plan, or an (n, 2) or (n, 3) array [m, m, rad]"
    poses = parse_number_array(path, fault)
    if poses.ndim != 2 or poses.shape[1] not in (2, 3):
        raise LocplanError(f"{fault}, not {poses.shape}")
    return Path(poses[:, :2], poses[:, 2] if poses.shape[1] == 3 else None)


def stack_poses(path_like: AnyPath | Sequence[AnyPath]) -> tuple[Floats, Ints, bool]:
    """Return the poses of one path or several, their numbers, and whether it is a single path.

    Parameters
    ----------
    path_like : Path, Plan, or (n, 2) or (n, 3) array, or several of them
        One path as of `as_path`; a list of such paths, or an array (m, n, 2) or (m, n, 3).

    Returns
    -------
    poses : (k, 3) array
        Poses of all paths, path by path; the heading is NaN if a path has none.
    sizes : (m,) array
        Number of poses of each path, at least 1.
    is_single : bool
        True if the caller gave one path, not several.
    """
    is_single = not _are_several(path_like)
    several: Any = [path_like] if is_single else path_like
    if isinstance(several, np.ndarray) and several.size:  # checked as one, for speed
        sizes = np.full(len(several), several.shape[1])
        return _poses_or_nan(as_path(several.reshape(-1, several.shape[2]))), sizes, False
    poses = [_poses_or_nan(as_path(path)) for path in several]
    sizes = np.array([len(part) for part in poses], np.int64)
    return np.concatenate([np.empty((0, 3)), *poses]), sizes, is_single


def _poses_or_nan(path: Path) -> Floats:
    return np.column_stack(
        [path.xy, np.nan * path.xy[:, 0] if path.heading is None else path.heading]
    )


def _are_several(path_like: object) -> bool:
    """True if these are paths, and not the positions of one."""
    if isinstance(path_like, np.ndarray):
        return path_like.ndim == 3
    if not isinstance(path_like, (list, tuple)) or not path_like:
        return False
    first = path_like[0]
    if isinstance(first, (list, tuple)):
        return bool(first) and isinstance(first[0], (list, tuple, np.ndarray))
    return isinstance(first, Path) or hasattr(first, "path") or np.ndim(first) == 2

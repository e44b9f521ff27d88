"""Poses, rigid moves, ends of beams, windows of maps, and transforms between frames."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import FARTHEST
from locplan._support.kernels.arrays import Floats

Poses = NDArray[np.float64]
"""Array of poses (x, y, heading) in the world, (n, 3) [m, m, rad]."""


def move_ends_to_poses(ends: Floats, poses: Floats) -> Floats:
    """Ends (n, beams, 2) on robots at poses (n, 3), in the frame of the poses [m]."""
    cos, sin = (part(poses[:, 2])[:, None] for part in (np.cos, np.sin))
    x = poses[:, 0, None] + cos * ends[..., 0] - sin * ends[..., 1]
    y = poses[:, 1, None] + sin * ends[..., 0] + cos * ends[..., 1]
    return np.stack([x, y], axis=-1)


def move_poses(poses: Floats, move: tuple[float, float, float]) -> Floats:
    """Poses (n, 3) after a rigid move: a turn about the origin, then a shift [m, m, rad]."""
    dx, dy, turn = move
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, heading = poses.T
    return np.column_stack([dx + cos * x - sin * y, dy + sin * x + cos * y, heading + turn])


def find_update_poses(poses: Floats, min_distance: float, min_turn: float) -> list[int]:
    """Indices of the poses (n, 3) at which AMCL updates: the first, and after so much motion.

    A pose counts if it is more than `min_distance` along x or y [m], or more than `min_turn` [rad],
    from the one before.
    """
    update_indices, (at_x, at_y, at_heading) = [0], poses[0].tolist()
    for n, (x, y, heading) in enumerate(poses.tolist()):
        way = max(abs(x - at_x), abs(y - at_y))
        if way > min_distance or abs(math.remainder(heading - at_heading, 2 * math.pi)) > min_turn:
            update_indices.append(n)
            at_x, at_y, at_heading = x, y, heading
    return update_indices


def compute_motions(start_poses: Floats, end_poses: Floats) -> Floats:
    """Poses `end_poses` as they are seen from `start_poses`, (..., 3) [m, m, rad]."""
    dx, dy, turn = np.moveaxis(end_poses - start_poses, -1, 0)
    cos, sin = np.cos(start_poses[..., 2]), np.sin(start_poses[..., 2])
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turn], axis=-1)


def apply_motions(poses: Floats, motions: Floats) -> Floats:
    """Return the poses after motions from start poses, (..., 3) [m, m, rad]."""
    ahead, left, turn = np.moveaxis(motions, -1, 0)
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x = poses[..., 0] + cos * ahead - sin * left
    y = poses[..., 1] + sin * ahead + cos * left
    return np.stack([x, y, poses[..., 2] + turn], axis=-1)


def wrap_angles(angles: Any) -> Floats:
    """Angles within -pi to pi [rad]."""
    return np.asarray((np.asarray(angles, np.float64) + np.pi) % (2 * np.pi) - np.pi)


def compute_path_length(poses: Floats) -> float:
    """Length of the way over poses (n, 3) [m]."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def make_rotation_matrix(yaw: float) -> Floats:
    """The turn of x, y, heading by an angle [rad], (3, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def compute_travel_distances(poses: Floats) -> Floats:
    """Length of the way from the first of the poses (n, 2) or (n, 3) to each, (n,) [m]."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


STILL = 0.05
"""Distance [m] and turn [rad] up to which a pose counts as the same across any gap."""
Transform = tuple[float, ...]
Edge = tuple[str, str]
IDENTITY: Transform = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class TransformTrack:
    """The samples of a moving pose that lie next to given times: all that interpolation needs.

    However long the pose was recorded, no more than two samples a time are kept. `steady` is one
    that holds at all times if it never changed, as transforms do that are sent once.
    """

    def __init__(self, times: Sequence[float], *, steady: bool = False) -> None:
        self._times, self._steady = times, steady
        self._before, self._after = (np.full((len(times), 8), np.nan) for _ in range(2))
        self._first: Transform | None = None
        self._moves = False
        self.left_out = 0
        self.begin, self.end = math.inf, -math.inf

    def add(self, time: float, pose: Transform) -> None:
        """Add a sample; invalid samples are counted and skipped."""
        if not is_transform(pose):
            self.left_out += 1
            return
        if self._first is None:
            self._first = pose
        self._moves |= pose != self._first
        self.begin, self.end = min(self.begin, time), max(self.end, time)
        at = bisect_left(self._times, time)
        if at < len(self._times) and not self._before[at, 0] > time:
            self._before[at] = (time, *pose)
        if at and not self._after[at - 1, 0] < time:
            self._after[at - 1] = (time, *pose)

    @property
    def empty(self) -> bool:
        """True if no sample could be used."""
        return self._first is None

    def interpolate(self) -> Floats:
        """Transforms at all times, (n, 7); NaN where no samples are near enough."""
        if self._first is None:
            return np.full((len(self._times), 7), np.nan)
        if self._steady and not self._moves:
            return np.tile(np.array(self._first), (len(self._times), 1))
        return interpolate_transforms(np.asarray(self._times, np.float64), *self.samples())

    def samples(self) -> tuple[Floats, Floats]:
        """The samples before and after each time: its time and transform, (n, 8) each, or NaN."""
        return _fill_gaps(self._before), _fill_gaps(self._after[::-1])[::-1].copy()


def _fill_gaps(samples: Floats) -> Floats:
    """Samples with those before them where there are none, (n, 8)."""
    sample_rows = np.where(np.isfinite(samples[:, 0]), np.arange(len(samples)), 0)
    return np.asarray(samples[np.maximum.accumulate(sample_rows)])


def interpolate_transforms(times: Floats, before: Floats, after: Floats) -> Floats:
    """Transforms between samples (n, 8) of time and transform before and after; NaN if too far."""
    exact = before[:, 0] == times
    after = np.where(exact[:, None], before, after)
    gap = after[:, 0] - before[:, 0]
    share = np.where(exact, 0.0, (times - before[:, 0]) / np.where(gap > 0, gap, 1.0))
    same = (before[:, 4:] * after[:, 4:]).sum(1)  # a quaternion and its negative turn alike
    after[:, 4:] *= np.where(same < 0, -1.0, 1.0)[:, None]
    transforms = before[:, 1:] + share[:, None] * (after[:, 1:] - before[:, 1:])
    transforms[:, 3:] = _interpolate_rotations(before[:, 4:], after[:, 4:], share)
    way = np.linalg.norm(after[:, 1:4] - before[:, 1:4], axis=1)
    turn = 2 * np.arccos(np.clip(np.abs(same), 0.0, 1.0))
    # Greatest time between two samples of a moving pose that are interpolated [s].
    near = (gap <= 1.0) | ((way < STILL) & (turn < STILL))
    transforms[~near] = np.nan
    return transforms


def _interpolate_rotations(start: Floats, end: Floats, share: Floats) -> Floats:
    """Interpolate unit quaternions by a share of the turn, (n, 4)."""
    start, end = (
        quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        for quaternions in (start, end)
    )
    angle = np.arccos(np.clip((start * end).sum(1), -1.0, 1.0))
    plain = angle < 1e-6
    sine = np.where(plain, 1.0, np.sin(angle))
    left = np.where(plain, 1 - share, np.sin((1 - share) * angle) / sine)
    right = np.where(plain, share, np.sin(share * angle) / sine)
    return np.asarray(left[:, None] * start + right[:, None] * end)


class FrameTree:
    """Frames, and the transforms between them at the times of the scans."""

    def __init__(self, times: Sequence[float]) -> None:
        self._times = self.times = times
        self._edges: dict[Edge, Transform | TransformTrack] = {}
        self._left_out: set[Edge] = set()

    def add_static(self, parent: str, child: str, pose: Transform) -> None:
        """Add a transform that holds at all times."""
        if is_transform(pose):
            self._edges[normalize_frame_name(parent), normalize_frame_name(child)] = pose

    def add(self, time: float, parent: str, child: str, pose: Transform) -> None:
        """Add a transform at a time."""
        edge = normalize_frame_name(parent), normalize_frame_name(child)
        if edge in self._left_out:
            return
        track = self._edges.get(edge)
        if track is None:
            track = self._edges[edge] = TransformTrack(self._times, steady=True)
        if isinstance(track, TransformTrack):
            track.add(time, pose)

    def drop_unrelated_tracks(self, target: str, sources: Iterable[str]) -> None:
        """Drop moving transforms that do not connect the frames, such as those of wheels."""
        connecting = {
            edge
            for transform in sources
            for edge, _ in self._find_edge_chain(target, transform) or ()
        }
        moving = {
            edge for edge, transform in self._edges.items() if isinstance(transform, TransformTrack)
        }
        self._left_out |= moving - connecting
        self._edges = {
            k: transform for k, transform in self._edges.items() if k not in self._left_out
        }

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, sorted."""
        return tuple(sorted({name for edge in self._edges for name in edge}))

    @property
    def moving_time_range(self) -> tuple[float, float]:
        """Times of the first and the last sample that moves; infinite if there is none."""
        tracks = [track for track in self._edges.values() if isinstance(track, TransformTrack)]
        begins, ends = [track.begin for track in tracks], [track.end for track in tracks]
        return min(begins, default=math.inf), max(ends, default=-math.inf)

    def describe_groups(self) -> str:
        """Return the groups of connected frames as text for an error message."""
        groups: list[list[str]] = []
        for frame in self.frames:
            group = next(
                (group_frames for group_frames in groups if self.has_chain(group_frames[0], frame)),
                None,
            )
            if group is None:
                groups.append([frame])
            else:
                group.append(frame)
        return "; ".join(" - ".join(group) for group in groups) or "none"

    def has_chain(self, target: str, source: str) -> bool:
        """True if a chain of transforms connects two frames."""
        return self._find_edge_chain(target, source) is not None

    def pose(self, target: str, source: str) -> Floats | None:
        """Return the pose of the source frame in the target frame at all times, (n, 7), or None.

        NaN at times without a transform; None if the frames are not connected.
        """
        chain = self._find_edge_chain(target, source)
        if chain is None:
            return None
        source_poses = np.tile(np.array(IDENTITY), (len(self._times), 1))
        for edge, backwards in chain:
            step = self._edges[edge]
            pose = step.interpolate() if isinstance(step, TransformTrack) else np.array([step])
            source_poses = compose_transforms(
                source_poses, invert_transforms(pose) if backwards else pose
            )
        return source_poses

    def _find_edge_chain(self, target: str, source: str) -> list[tuple[Edge, bool]] | None:
        """Return the edges from target to source; True with each that is taken backwards."""
        if target == source:
            return []
        came: dict[str, tuple[str, Edge, bool]] = {}
        near: dict[str, list[tuple[str, Edge, bool]]] = defaultdict(list)
        for edge in self._edges:
            near[edge[0]].append((edge[1], edge, False))
            near[edge[1]].append((edge[0], edge, True))
        waiting = deque([target])
        while waiting and source not in came:
            frame = waiting.popleft()
            for neighbour, edge, backwards in near[frame]:
                if neighbour != target and neighbour not in came:
                    came[neighbour] = frame, edge, backwards
                    waiting.append(neighbour)
        if source not in came:
            return None
        chain = []
        while source != target:
            source, edge, backwards = came[source]
            chain.append((edge, backwards))
        return chain[::-1]


def is_transform(pose: Transform) -> bool:
    """True if the numbers are a valid position and rotation."""
    near = all(abs(value) <= FARTHEST for value in pose)  # False for NaN
    return near and 0.5 < math.hypot(*pose[3:]) < 2.0


def normalize_frame_name(name: object) -> str:
    """Return a frame's name without the leading slash of older robots."""
    return str(name).lstrip("/")


def compose_transforms(first: Floats, second: Floats) -> Floats:
    """Return the transform `first` followed by `second`, (n, 7)."""
    place = first[:, :3] + rotate_vectors(first[:, 3:], second[:, :3])
    return np.concatenate([place, _multiply_quaternions(first[:, 3:], second[:, 3:])], axis=1)


def invert_transforms(pose: Floats) -> Floats:
    """Return the inverse transform, (n, 7)."""
    back = pose[:, 3:] * (-1.0, -1.0, -1.0, 1.0) / (pose[:, 3:] ** 2).sum(1, keepdims=True)
    return np.concatenate([-rotate_vectors(back, pose[:, :3]), back], axis=1)


def rotate_vectors(quaternions: Floats, vectors: Floats) -> Floats:
    """Vectors (n, 3) turned by quaternions (n, 4), which need not have length 1."""
    quaternions = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    axis, w = quaternions[:, :3], quaternions[:, 3:]
    half = 2 * np.cross(axis, np.broadcast_to(vectors, (max(len(vectors), len(quaternions)), 3)))
    return np.asarray(vectors + w * half + np.cross(axis, half))


def _multiply_quaternions(first: Floats, second: Floats) -> Floats:
    x, y, z, w = first.T
    a, b, c, d = second.T
    parts: Iterable[Floats] = (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )
    return np.stack(np.broadcast_arrays(*parts), axis=1)


def project_to_plane(pose: Floats) -> Floats:
    """Transforms (n, 7) seen from above: x, y and the direction of the x axis, (n, 3)."""
    ahead = rotate_vectors(pose[:, 3:], np.array([[1.0, 0.0, 0.0]]))
    return np.column_stack([pose[:, :2], np.arctan2(ahead[:, 1], ahead[:, 0])])


def compute_uprightness(pose: Floats) -> Floats:
    """Height of the tip of each transform's z axis: 1 upright, -1 upside down, (n,)."""
    return rotate_vectors(pose[:, 3:], np.array([[0.0, 0.0, 1.0]]))[:, 2]


def find_window(
    row: float, col: float, reach: float, map_shape: tuple[int, int]
) -> tuple[slice, slice]:
    """Rows and columns of a map within `reach` of a position [cells]."""
    ends = [
        slice(*(min(max(int(v), 0), size) for v in (math.floor(at - reach), at + reach + 1)))
        for at, size in zip((row, col), map_shape, strict=True)
    ]
    return ends[0], ends[1]

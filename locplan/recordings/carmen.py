"""Reader of CARMEN logs: text files with one message per line."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import MAX_AMOUNT, MAX_RANGE
from locplan._support.kernels.arrays import Floats
from locplan._support.poses import apply_motions, compute_motions, wrap_angles
from locplan._support.reading import read_numbered_lines
from locplan.errors import RecordingError
from locplan.recordings.logs import ReadOptions, RecordingSource, ScanRows
from locplan.recordings.recording import Recording

SUFFIXES: tuple[str, ...] = (".log", ".clf", ".log.gz", ".clf.gz")
KINDS = ("ROBOTLASER1", "FLASER")
"""Kinds of lines with scans, the more detailed one first, because a log may have both."""


@dataclass
class _ScanLines:
    """The lines of one kind of scan in a log."""

    rows: ScanRows = field(default_factory=lambda: ScanRows((0.0, MAX_RANGE)))
    """Every n-th scan."""
    lines: array[float] = field(default_factory=lambda: array("d"))
    """First pose (lidar), second pose (robot) and time of each line, flat to save memory."""
    last_odometry: list[int] = field(default_factory=list)
    """Index of the last line of odometry before each line."""
    greatest: float = 0.0
    """Maximum range in the lines [m]."""


@dataclass
class _CarmenLog:
    """The parsed lines of a log."""

    scans: dict[str, _ScanLines] = field(default_factory=dict)
    odometry: array[float] = field(default_factory=lambda: array("d"))
    """x, y [m], heading [rad], time [s] and forward speed [m/s] of the lines of odometry, flat."""
    other_lines: set[str] = field(default_factory=set)
    """Names of other kinds of lines."""
    notes: list[str] = field(default_factory=list)

    @property
    def odometry_lines(self) -> Floats:
        """The lines of odometry, (n, 5)."""
        return np.array(self.odometry).reshape(-1, 5)


def read_carmen(path: Path, options: ReadOptions) -> Recording:
    """Read a drive from a log of CARMEN, optionally packed by gzip.

    Raises
    ------
    RecordingError
        If the file is not a log of CARMEN, is damaged, or has no scans.
    """
    options.refuse_unused("a log of CARMEN", of_robot=True)
    log = _parse_log(path, options)
    kind = _choose_scan_kind(log, options.scan_topic)
    scan_lines, selection = log.scans[kind], slice(None, None, options.every)
    lines = np.array(scan_lines.lines).reshape(-1, 7)
    poses, reported, mount = _derive_poses(lines, scan_lines.last_odometry, log)
    lidar = scan_lines.rows.make_lidar(options.mount or mount, upside_down=False)
    ranges = scan_lines.rows.take_rows(range(len(scan_lines.rows)))
    min_range, max_range = options.range_limits or (0.0, scan_lines.greatest)
    if not 0 < max_range <= MAX_RANGE:
        max_range = _estimate_max_range(ranges)
    times = lines[:, 6]
    ordered, stamps_back = bool((np.diff(times) > 0).all()), int((np.diff(times) < 0).sum())
    if not ordered:
        log.notes.append("its stamps are coarse or out of order, so times were dropped")
    source = RecordingSource(
        file=path.name,
        scans=kind,
        poses=kind,
        odometry="" if reported is None else "ODOM" if log.odometry else kind,
        map_frame=options.map_frame,
        stamps_back=stamps_back,
        notes=tuple(log.notes),
    )
    speeds = _select_speeds(log, scan_lines.last_odometry)
    ranges.setflags(write=False)
    recording = Recording(
        ranges,
        replace(lidar, min_range=min_range, range=max_range),
        poses[selection],
        times[selection] if ordered else None,
        None if reported is None else reported[selection],
        source,
        None if reported is None or speeds is None else speeds[selection],
    )
    return recording if options.window is None else recording.window(*options.window)


def _select_speeds(log: _CarmenLog, last_odometry: Sequence[int]) -> Floats | None:
    """Select forward speeds before the scans, (n,) [m/s]; None if all speeds are 0."""
    values = log.odometry_lines[:, 4]
    if not values.any():
        return None
    return np.where(np.asarray(last_odometry) < 0, np.nan, values[last_odometry])


def _choose_scan_kind(log: _CarmenLog, requested_kind: str | None) -> str:
    """Return the requested kind of scans, or the first one of `KINDS` in the log."""
    kind = requested_kind or next((kind_name for kind_name in KINDS if kind_name in log.scans), "")
    if kind in log.scans:
        return kind
    have = ", ".join(sorted(log.other_lines | log.scans.keys())[:12]) or "nothing"
    raise RecordingError(
        f"has no scans ({kind or 'FLASER or ROBOTLASER1'} lines); it has {have};"
        " pass a log of CARMEN"
    )


def _estimate_max_range(ranges: NDArray[np.float32]) -> float:
    """Estimate the lidar's maximum range from a pile of readings without a return [m]."""
    pile = 0.1  # readings within 10 cm of the largest are no returns if they are over 3 permille
    finite_ranges = ranges[np.isfinite(ranges)]
    longest = float(finite_ranges.max(initial=0.0))
    if (finite_ranges > longest - pile).sum() > 3e-3 * ranges.size and longest > 2 * pile:
        return round(longest - pile, 3)
    return round(min(longest + pile, MAX_RANGE), 3)


def _derive_poses(
    scans: Floats, last_odometry: Sequence[int], log: _CarmenLog
) -> tuple[Floats, Floats | None, tuple[float, float, float]]:
    """Derive the robot's poses, its odometry, and the lidar's mount [m, m, rad].

    A line has two poses, for lidar and robot. If they do not move as a rigid body, the first pose
    was corrected by mapping, and the second one is odometry.
    """
    first, second = scans[:, :3], scans[:, 3:6]
    mounts = compute_motions(second, first)
    mounts[:, 2] = wrap_angles(mounts[:, 2])
    mount = np.median(mounts, axis=0)
    if np.abs(mounts - mount).max() < 0.02:  # metres and radians
        poses, reported = second, None
        x, y, yaw = (float(value) for value in np.round(mount, 4))
    else:
        poses, reported, x, y, yaw = first, second, 0.0, 0.0, 0.0
    lines = compute_scan_odometry(poses, scans[:, 6], last_odometry, log.odometry_lines[:, :4])
    reported = reported if lines is None else lines
    if reported is not None and np.hypot(*(reported - poses)[:, :2].T).max() < 0.02:
        log.notes.append("its odometry equals its poses, which may be uncorrected")
        reported = None
    return poses, reported, (x, y, yaw)


def _parse_log(path: Path, options: ReadOptions) -> _CarmenLog:
    """Parse the lines of a log."""
    log, bad, requested_kind = _CarmenLog(), 0, options.scan_topic
    if requested_kind not in (None, *KINDS):
        raise RecordingError(
            f"has no scans on {requested_kind}; set scan_topic= to {' or '.join(KINDS)}"
        )
    for number, line in read_numbered_lines(path, "replace"):
        if bad:
            raise RecordingError(f"line {bad} is cut off or damaged; remove it")
        name = line[:24].split(maxsplit=1)[0] if line[:24].strip() else "#"
        try:
            if name == "ODOM":
                words = line.split()
                log.odometry.extend(_parse_finite((*words[1:4], words[7], words[4])))
            elif name in KINDS and requested_kind in (None, name):
                scans = log.scans.get(name) or _ScanLines()
                _add_scan(name, line.split(), scans, len(log.odometry) // 5 - 1, options.every)
                log.scans[name] = scans
            elif not name.startswith("#") and len(log.other_lines) < 100:
                log.other_lines.add(name if name.isprintable() else "?")
        except (ValueError, IndexError, OverflowError):
            bad = number  # the last line may be cut off if recording was stopped
    if bad:
        log.notes.append(f"its last line, {bad}, is cut off and was dropped")
    return log


def _add_scan(
    kind: str, words: list[str], scans: _ScanLines, last_odometry: int, scan_step: int
) -> None:
    """Add the line of a scan; raise a ValueError or IndexError if it is damaged."""
    if kind == "FLASER":
        count = int(words[1])
        begin, first, step = 2, -math.pi / 2, math.pi / max(1, count - count % 2)
        greatest, rest = 0.0, words[2 + count :]
        stamp = rest[6]
    else:
        first, _, step, greatest = _parse_finite(words[2:6])
        count, begin = int(words[8]), 9
        rest = words[9 + count :]
        rest = rest[1 + int(rest[0]) :]
        stamp = rest[11]
    line = _parse_finite([*rest[:6], stamp])
    if not 0 < count <= len(words):
        raise ValueError
    if len(scans.last_odometry) % scan_step == 0:
        ranges = [float(word) for word in words[begin : begin + count]]
        scans.rows.add(ranges, first, step, 0.0, MAX_RANGE)
    scans.greatest = max(scans.greatest, greatest)
    scans.lines.extend(line)
    scans.last_odometry.append(last_odometry)


def _parse_finite(words: Sequence[str]) -> tuple[float, ...]:
    """Parse numbers; raise a ValueError if one is not finite, or impossibly large."""
    values = tuple(map(float, words))
    if not all(abs(value) <= MAX_AMOUNT for value in values):
        raise ValueError
    return values


def compute_scan_odometry(
    poses: Floats, stamps: Floats, last_odometry: Sequence[int], odometry_lines: Floats
) -> Floats | None:
    """Compute the odometry at n scans; None without separate odometry.

    Mapping programs repeat the corrected pose after each scan as a line of odometry, and continue
    odometry from there. The motions from each such line to the next scan are chained then.

    Parameters
    ----------
    poses : (n, 3) array
        Poses of the robot at the scans [m, m, rad].
    stamps : (n,) array
        Times of the scans [s].
    last_odometry : sequence of n int
        Index of the last line of odometry before each scan, or -1.
    odometry_lines : (m, 4) array
        Lines of odometry: x, y [m], heading [rad], time [s].
    """
    if not len(odometry_lines):
        return None
    at = np.clip(last_odometry, 0, len(odometry_lines) - 1)
    after = np.clip(np.asarray(last_odometry) + 1, 0, len(odometry_lines) - 1)
    off = odometry_lines[after, :3] - poses
    off[:, 2] = wrap_angles(off[:, 2])
    repeated = (np.abs(off) < 1e-5).all(1)
    if repeated.mean() > 0.5:  # odometry restarts at most scans
        has_later_line = at[1:] > after[:-1]
        if len(has_later_line) and has_later_line.mean() < 0.5:
            return None
        # The k-th piece leads from the line begins[k] to the line at[k + 1].
        begins = np.where(repeated, after, at)
        odometry = np.empty((len(at), 3))
        odometry[0] = odometry_lines[at[0], :3]
        for n in range(1, len(at)):
            begin = min(begins[n - 1], at[n])
            odometry[n] = apply_motions(
                odometry[n - 1],
                compute_motions(odometry_lines[begin, :3], odometry_lines[at[n], :3]),
            )
        return odometry
    # Interpolate between the lines around each scan if stamps allow it; otherwise take the former.
    gap = odometry_lines[after, 3] - odometry_lines[at, 3]
    inside = (gap > 0) & (stamps >= odometry_lines[at, 3]) & (stamps <= odometry_lines[after, 3])
    share = np.where(inside, (stamps - odometry_lines[at, 3]) / np.where(gap > 0, gap, 1.0), 0.0)
    step = odometry_lines[after, :3] - odometry_lines[at, :3]
    step[:, 2] = wrap_angles(step[:, 2])
    return np.asarray(odometry_lines[at, :3] + share[:, None] * step)

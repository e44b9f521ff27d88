"""The motion of a robot from scan to scan of a recorded drive: by odometry, and by the scans.

A scan is scored on the likelihood field of the scan a step before, at all motions of a lattice
about that of odometry. A mean score is 1 if all ends lie on what the scan before saw, and 0 if none
lies near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._kernels.arrays import Array, Bools, Floats, Ints, Octets
from locplan._util.poses import way_along, way_between, wrapped
from locplan.field import likelihood_field
from locplan.maps import FREE, OCCUPIED
from locplan.recordings._recording import Recording

WAY, TURN, SECONDS, SCANS = 0.25, math.radians(15), 1.0, 10
"""Way [m], turn [rad] and time [s] of a step; without times, so many scans are one."""
CELL, HALF_STEPS, HALF_TURNS = 0.05, 24, 15
"""Spacing of the lattice of motions [m], and its steps and turns of 1 deg to each side."""
SIGMA, ANYWHERE = 0.1, 0.5
"""Deviation of an end from what the scan before saw [m], and the likelihood of an end anywhere."""
REACH, RETURNS = 12.0, 10
"""Greatest range that is compared [m], and least number of returns."""
GRAZING = 10.0
"""Distance of neighbouring ends on one wall, in times of that on a wall across the beams."""
TURNED = math.radians(30)
"""Turn beyond which a step is not judged: odometry and scans have different stamps [rad]."""
APART, GAIN, FIT = 0.16, 0.07, 0.5
"""Odometry and scans disagree if a motion more than so far from odometry's [m] has a score that is
higher by so much, and at least so high."""
NEXT_GAIN = 0.02
"""The same at steps next to such a step: a fault is mostly longer than a step."""


@dataclass(frozen=True, eq=False)
class ScanSteps:
    """k steps of a drive: the motion of the robot by odometry, and by the scans.

    Motions are seen from the robot before the step: ahead, to the left, turn [m, m, rad].
    """

    scans: Ints
    """Scans at which the steps begin and end, (k + 1,)."""
    reported: Floats
    """Motions by odometry, (k, 3)."""
    measured: Floats
    """Motions of the best score, (k, 3); NaN if a step cannot be judged."""
    scores: Floats
    """Best scores, (k,)."""
    gains: Floats
    """Best scores minus those of odometry, which may err by a cell and in its turn, (k,)."""
    hidden: Bools
    """Mask of the steps at which another motion scores almost as well, as along corridors, (k,)."""

    @property
    def are_judged(self) -> Bools:
        """Mask of the steps with enough returns and not too large a turn, (k,)."""
        return np.isfinite(self.scores)

    @property
    def errors(self) -> Floats:
        """Distances between the ends of both motions, (k,) [m]; NaN if a step is not judged."""
        return np.asarray(np.hypot(*(self.measured - self.reported)[:, :2].T))

    @property
    def disagree(self) -> Bools:
        """Mask of the steps at which the scans contradict odometry, (k,)."""
        turned = np.abs(self.measured[:, 2] - self.reported[:, 2])
        # At the edge of the lattice the true turn lies beyond.
        is_inside = turned < math.radians(HALF_TURNS - 0.5)
        is_apart = is_inside & (self.errors > APART) & (self.scores > FIT)
        is_likely, is_sure = (is_apart & (self.gains > gain) for gain in (NEXT_GAIN, GAIN))
        runs = np.cumsum(np.diff(is_likely, prepend=False))
        return np.asarray(is_likely & np.isin(runs, runs[is_sure]))

    @property
    def motions(self) -> Floats:
        """Motions by odometry, but by the scans where these contradict it, (k, 3)."""
        return np.where(self.disagree[:, None], self.measured, self.reported)


def measure_steps(recording: Recording) -> ScanSteps:
    """Compare odometry with the motion between scans.

    Parameters
    ----------
    recording : Recording
        The drive, with odometry.
    """
    from locplan._kernels.likelihood import make_lattice

    odometry = recording.odometry
    assert odometry is not None
    scans = step_ends(odometry, recording.times)
    reported = way_between(odometry[scans[:-1]], odometry[scans[1:]])
    reported[:, 2] = wrapped(reported[:, 2])
    outlines, ends = _outlines(recording, scans), _compared_ends(recording, scans)
    lattice = make_lattice(HALF_STEPS, np.radians(np.arange(-HALF_TURNS, HALF_TURNS + 1.0)))
    measured = np.full_like(reported, np.nan)
    scores, gains = np.full(len(reported), np.nan), np.zeros(len(reported))
    hidden = np.zeros(len(reported), np.bool_)
    for n, motion in enumerate(reported):
        is_seen = min(len(outlines[n][0]), len(ends[n + 1])) >= RETURNS
        if not is_seen or abs(motion[2]) > TURNED:
            continue
        values = _scores_around(motion, *outlines[n], ends[n + 1], lattice)
        turn, left, ahead = map(int, np.unravel_index(int(np.argmax(values)), values.shape))
        offset = np.array([ahead - HALF_STEPS, left - HALF_STEPS, turn - HALF_TURNS])
        measured[n] = motion + offset * (CELL, CELL, math.radians(1))
        scores[n], any_turn = values[turn, left, ahead], values.max(axis=0)
        # Odometry may err by a cell, and in its turn.
        gains[n] = scores[n] - any_turn[_distances(HALF_STEPS, HALF_STEPS) < 1.2 * CELL].max()
        away = _distances(left, ahead)
        hidden[n] = scores[n] - any_turn[(away > 4.5 * CELL) & (away < 6.5 * CELL)].max() < GAIN
    return ScanSteps(scans, reported, measured, scores, gains, hidden)


def step_ends(odometry: Floats, times: Floats | None) -> Ints:
    """Scans at which steps end: after so much way or turn, and of a robot that stands, of time."""
    way = way_along(odometry)
    turned = np.append(0.0, np.cumsum(np.abs(wrapped(np.diff(odometry[:, 2])))))
    passed = np.arange(len(way)) / SCANS if times is None else (times - times[0]) / SECONDS
    progress, scans = np.column_stack([way / WAY, turned / TURN, passed]), [0]
    for n, here in enumerate(progress):
        if (here - progress[scans[-1]] >= 1.0).any():
            scans.append(n)
    return np.array(scans)


def _compared_ends(recording: Recording, scans: Ints) -> list[Floats]:
    """Ends of up to some 180 beams of each scan on the robot, (b, 2) [m]."""
    some = slice(None, None, max(1, recording.lidar.beams // 180))
    chosen = recording[scans]
    near = chosen.ranges[:, some] < REACH
    ends = chosen.ends_on_robot()[:, some]
    return [part[is_near] for part, is_near in zip(ends, near, strict=True)]


def _outlines(recording: Recording, scans: Ints) -> list[tuple[Floats, Bools]]:
    """Ends of the beams of each scan that have a neighbour on the same wall, and which have.

    The other ends are left out: at the same angles from anywhere in a corridor, they would show a
    robot that stands still.
    """
    chosen = recording[scans]
    angles, found = recording.lidar.angles, []
    spacing = GRAZING * abs(float(angles[1] - angles[0])) if len(angles) > 1 else 0.0
    for ends, ranges in zip(chosen.ends_on_robot(), chosen.ranges, strict=True):
        near, gaps = ranges < REACH, np.hypot(*np.diff(ends, axis=0).T)
        widest = np.maximum(2 * CELL, spacing * np.minimum(ranges[1:], ranges[:-1]))
        joined = near[1:] & near[:-1] & (gaps < widest)
        kept = np.append(joined, False) | np.append(False, joined)
        found.append((ends[kept], np.append(joined, False)[kept]))
    return found


def _scores_around(
    motion: Floats, outline: Floats, joined: Bools, ends: Floats, lattice: Any
) -> Array:
    """Mean scores of a scan at the motions about one by odometry, (turn, left, ahead)."""
    from locplan._kernels.likelihood import TOP
    from locplan._kernels.posterior import score

    low = outline.min(axis=0) - CELL
    field = likelihood_field(_drawn(outline, joined, low), CELL, 1, HALF_STEPS, SIGMA, ANYWHERE)
    position = (motion[:2] - low) / CELL
    cell = np.floor(position).astype(np.int64)
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    turned = ends @ np.array([[cos, sin], [-sin, cos]]) / CELL + (position - cell - 0.5)
    costs = np.empty_like(lattice.empty)
    score(field, lattice, int(cell[1]), int(cell[0]), turned, costs)
    rows, side = lattice.plane // lattice.width, lattice.offsets
    values = costs.reshape(-1, rows, lattice.width)[:, :side, :side]
    return np.asarray(1.0 - values / (TOP * len(ends)))


def _drawn(outline: Floats, joined: Bools, low: Floats) -> Octets:
    """A map of what a scan saw: walls from each end to the next one where they are joined."""
    import cv2

    places = np.floor((outline - low) / CELL).astype(np.int32)
    cols, rows = places.max(axis=0) + 2
    levels = np.full((rows, cols), FREE, np.uint8)
    lines = [places[n : n + 2] for n in np.flatnonzero(joined)]
    cv2.polylines(levels, lines, False, (float(OCCUPIED),))
    return levels


def _distances(row: int, col: int) -> Floats:
    """Distances of the lattice's positions from one of them [m]."""
    rows, cols = np.mgrid[: 2 * HALF_STEPS + 1, : 2 * HALF_STEPS + 1]
    return np.asarray(CELL * np.hypot(rows - row, cols - col))

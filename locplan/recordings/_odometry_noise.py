"""Noise of odometry against recorded poses: AMCL's alphas, and drifts as the simulation has them.

Source of the alphas' model: S. Thrun, W. Burgard and D. Fox, "Probabilistic Robotics" (2005),
sample_motion_odometry, as nav2_amcl's differential motion model has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.particles import STILL
from locplan._util.intervals import Interval, blocks_along, intervals
from locplan._util.poses import Numbers, updates_of, way_along, way_between, wrapped
from locplan.recordings._recording import Recording
from locplan.recordings._tracks import without_jumps
from locplan.robots import Amcl

SPANS = (0.5, 1.0, 2.0, 4.0)
"""Lengths of the stretches over which odometry is compared with the poses [m]. Errors of the poses
do not grow with them, those of odometry do."""
MIN_UPDATES = 40
"""Number of the filter's updates below which odometry is not calibrated."""
RESAMPLES = 100
"""Number of resamples of blocks."""
TINY = 1e-12


@dataclass(frozen=True)
class OdometryNoise:
    """Noise of odometry with 95 % intervals over blocks of the drive of 4 m.

    Drifts and biases are those of `locplan.robots.Odometry`. A bias is that of this drive:
    its size stands for the deviation from drive to drive.
    """

    alpha1: Interval
    """Variance of a turn per square of the turn [1]."""
    alpha2: Interval
    """Variance of a turn per square of the distance driven in an update [rad^2 / m^2]."""
    alpha3: Interval
    """Variance of the distance per square of the distance [1]."""
    alpha4: Interval
    """Variance of the distance per square of the turn [m^2 / rad^2]."""
    distance_drift: Interval
    """Standard deviation of the reported distance after 1 m [m]."""
    heading_drift_deg: Interval
    """Standard deviation of the reported heading after 1 m [deg]."""
    turn_drift_deg: Interval
    """Standard deviation of the reported heading after a turn of 1 rad [deg]."""
    distance_bias: Interval
    """Reported distances over true ones, minus 1."""
    heading_bias_deg: Interval
    """Reported bend to one side [deg/m]."""
    turn_bias: Interval
    """Reported turns over true ones, minus 1."""
    position_noise: Interval
    """Standard deviation of a recorded pose's position [m]."""
    heading_noise_deg: Interval
    """Standard deviation of a recorded pose's heading [deg]."""
    turned: float
    """Sum of the robot's turns [rad]."""
    updates: int
    """Number of the filter's updates, between which the increments were compared."""
    notes: tuple[str, ...]
    """What limits the fit, in sentences without a full stop."""

    def settings(self) -> dict[str, float]:
        """The drifts, and the sizes of the biases, by their names in `locplan.robots.Odometry`.

        Where the robot turned little, the drifts of heading and turns are hardly known.
        """
        names = ["distance_drift", "distance_bias", "heading_bias_deg"]
        if self.turned >= 2 * math.pi:
            names += ["heading_drift_deg", "turn_drift_deg", "turn_bias"]
        return {name: abs(getattr(self, name).value) for name in names}


def odometry_noise(recording: Recording, amcl: Amcl) -> OdometryNoise | None:
    """Fit the noise of odometry by maximum likelihood; None where the drive is too short.

    Drifts and biases are fitted to stretches of several lengths at once, which tells them from the
    constant noise of the poses. The alphas are fitted to the increments between the updates of this
    filter, for which they hold, with the noise that the poses surely have.

    Parameters
    ----------
    recording : Recording
        The drive.
    amcl : Amcl
        The filter, between whose updates odometry is compared with the poses.
    """
    if recording.odometry is None:
        return None
    updates = updates_of(recording.odometry, amcl.update_min_d, amcl.update_min_a)
    if len(updates) - 1 < MIN_UPDATES:
        return None
    poses, odometry, jumps = without_jumps(recording.poses, recording.odometry)
    stretches = _Stretches.of(poses, odometry)
    blocks = blocks_along(poses, SPANS[-1])
    increments = _Increments.of(poses[updates], odometry[updates])
    drifts = intervals(stretches.fitted, blocks[stretches.begin], RESAMPLES)
    # The noise that the poses surely have: a small one is hardly apart from odometry's.
    position, heading = np.nan_to_num([each.low for each in drifts[-2:]]).tolist()
    sure = position, math.radians(heading)
    alphas = intervals(lambda w: increments.fitted(w, *sure), blocks[updates[:-1]], RESAMPLES)
    turned = float(np.abs(wrapped(np.diff(recording.poses[:, 2]))).sum())
    notes = _notes(increments, np.array([each.value for each in alphas]), sure, turned)
    if jumps:
        notes.append(f"jumps of odometry against the recorded poses, which are left out: {jumps}")
    values: list[Any] = [*alphas, *drifts, turned, len(updates), tuple(notes)]
    return OdometryNoise(*values)


def _notes(
    increments: _Increments, alphas: Numbers, sure: tuple[float, float], turned: float
) -> list[str]:
    notes = []
    of_poses, of_odometry = increments.shares(alphas, *sure)
    if of_poses > of_odometry:
        notes.append(
            "the recorded poses are noisier than the odometry between two updates of the filter:"
            " the alphas are uncertain; record better poses, as of SLAM or motion capture"
        )
    if turned < 2 * math.pi:
        notes.append(
            f"the robot turned by {math.degrees(turned):.0f} deg in all, too little for alpha1,"
            " alpha4 and the drifts of heading and turns, which are not written"
        )
    jumps = increments.jumps(alphas, *sure)
    if jumps > 0.01:
        notes.append(
            f"{jumps:.0%} of the increments are beyond 5 standard deviations: the recorded poses"
            " may jump, as those of a filter do"
        )
    return notes


def _ways(poses: Numbers, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Numbers:
    """Poses at the end as seen from those at the begin, (n, 3) [m, m, rad]."""
    ways = way_between(poses[begin], poses[end])
    return np.column_stack([ways[:, :2], wrapped(ways[:, 2])])


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Stretches of a drive of some lengths, and what odometry says of them."""

    begin: NDArray[np.int64]
    way: Numbers
    """Length of the way [m]."""
    turned: Numbers
    """Sum of turns [rad]."""
    chord: Numbers
    """Distance from the begin to the end [m]."""
    turn: Numbers
    """Turn from the begin to the end [rad]."""
    ahead: Numbers
    """Reported chord minus the true one, along it [m]; NaN where the way is not straight."""
    aside: Numbers
    """Reported turn minus the true one [rad]."""

    @classmethod
    def of(cls, poses: Numbers, odometry: Numbers) -> _Stretches:
        """Stretches of each length, one after the other."""
        turns = np.abs(wrapped(np.diff(odometry[:, 2])))
        way, turned = way_along(odometry), np.concatenate([[0.0], np.cumsum(turns)])
        progress = way + 0.3 * turned  # a turn of 1 rad counts as 0.3 m of way
        begins, ends = [], []
        for span in SPANS:
            marks = np.searchsorted(progress, np.arange(0.0, progress[-1], span))
            begins.append(marks[:-1])
            ends.append(marks[1:])
        begin, end = np.concatenate(begins), np.concatenate(ends)
        begin, end = begin[end > begin], end[end > begin]
        true, reported = _ways(poses, begin, end), _ways(odometry, begin, end)
        chord = np.hypot(true[:, 0], true[:, 1])
        own = np.hypot(reported[:, 0], reported[:, 1])  # noise of the poses chooses no stretches
        along = (reported[:, :2] * true[:, :2]).sum(axis=1) / np.maximum(chord, TINY)
        long = way[end] - way[begin]
        straight = (own > 0.9 * long) & (own > SPANS[0] / 2)
        return cls(
            begin,
            long,
            turned[end] - turned[begin],
            chord,
            true[:, 2],
            np.where(straight, along - chord, np.nan),
            np.asarray(wrapped(reported[:, 2] - true[:, 2])),
        )

    def fitted(self, weights: Numbers) -> Numbers:
        """Drifts, biases, and the noise of the poses, in the order of `OdometryNoise`, (8,)."""
        some = np.isfinite(self.ahead)
        one = np.ones(len(self.way))
        (scale,), (distance, at) = _regressed(
            self.ahead[some],
            self.chord[some, None],
            np.column_stack([self.way, one])[some],
            weights[some],
        )
        (bend, turn_scale), (heading, turning, to) = _regressed(
            self.aside,
            np.column_stack([self.way, self.turn]),
            np.column_stack([self.way, self.turned, one]),
            weights,
        )
        return np.array(
            [
                math.sqrt(distance),
                math.degrees(math.sqrt(heading)),
                math.degrees(math.sqrt(turning)),
                scale,
                math.degrees(bend),
                turn_scale,
                math.sqrt(at / 2),  # both ends have this noise
                math.degrees(math.sqrt(to / 2)),
            ]
        )


@dataclass(frozen=True, eq=False)
class _Increments:
    """Increments of odometry between updates, in the parts of AMCL's differential model."""

    features: Numbers
    """What the variances are made of, (parts, n, 4): turns before, distances, turns after."""
    poses: Numbers
    """What the variances of positions and headings add to those, (parts, n, 2)."""
    residuals: Numbers
    """Reported minus true parts, (parts, n) [rad, m, rad]; NaN for the turn before none."""

    @classmethod
    def of(cls, poses: Numbers, odometry: Numbers) -> _Increments:
        """Increments from each pose to the next."""
        begin = np.arange(len(poses) - 1)
        true, reported = (_ways(each, begin, begin + 1) for each in (poses, odometry))
        way = np.hypot(reported[:, 0], reported[:, 1])
        moves = way >= STILL
        first = np.where(moves, np.arctan2(reported[:, 1], reported[:, 0]), 0.0)
        second = np.asarray(wrapped(reported[:, 2] - first))
        # The true end in the direction of the reported way.
        cos, sin = np.cos(first), np.sin(first)
        ahead, aside = (cos * true[:, 0] + sin * true[:, 1], cos * true[:, 1] - sin * true[:, 0])
        own_first = np.where(moves, aside / np.maximum(way, STILL), 0.0)
        turn = np.asarray(wrapped(true[:, 2] - reported[:, 2]))
        sizes = [np.minimum(abs(t), abs(wrapped(t - np.pi))) ** 2 for t in (first, second)]
        none, square = np.zeros(len(way)), way**2
        one, near = np.ones(len(way)), 2 / np.maximum(way, STILL) ** 2
        return cls(
            np.array(
                [
                    np.column_stack([sizes[0], square, none, none]),
                    np.column_stack([none, none, square, sizes[0] + sizes[1]]),
                    np.column_stack([sizes[1], square, none, none]),
                ]
            ),
            np.array(
                [
                    np.column_stack([near, one]),
                    np.column_stack([2 * one, none]),
                    np.column_stack([near * moves, np.where(moves, one, 2.0)]),
                ]
            ),
            np.array([np.where(moves, own_first, np.nan), ahead - way, turn - own_first]),
        )

    def fitted(self, weights: Numbers, position: float, heading: float) -> Numbers:
        """The alphas, (4,), with poses that have noise of their own [m, rad]."""
        some = np.isfinite(self.residuals)
        fixed = self.poses[some] @ np.array([position**2, heading**2])
        every = np.broadcast_to(weights, self.residuals.shape)[some]
        return _variances(self.residuals[some] ** 2, self.features[some], fixed, every)

    def shares(self, alphas: Numbers, position: float, heading: float) -> tuple[float, float]:
        """Mean variance of the turns that is of the poses, and that is of odometry [rad^2]."""
        some = np.isfinite(self.residuals[0])
        of_poses = self.poses[0][some] @ np.array([position**2, heading**2])
        return float(of_poses.mean()), float((self.features[0][some] @ alphas).mean())

    def jumps(self, alphas: Numbers, position: float, heading: float) -> float:
        """Share of the increments that are far off what the fit expects."""
        variance = self.features @ alphas + self.poses @ np.array([position**2, heading**2])
        return float((self.residuals**2 > 25 * (variance + TINY)).any(axis=0).mean())


def _regressed(
    values: Numbers, means: Numbers, features: Numbers, weights: Numbers
) -> tuple[Numbers, Numbers]:
    """Coefficients of the mean and of the variance of Gaussian values that are likeliest."""
    coefficients: Numbers = np.zeros(means.shape[1])
    parts: Numbers | None = None
    for _ in range(4):
        squares = (values - means @ coefficients) ** 2
        parts = _variances(squares, features, np.zeros(len(values)), weights, parts)
        own = weights / (features @ parts + TINY)
        matrix = (means * own[:, None]).T @ means + TINY * np.eye(means.shape[1])
        coefficients = np.asarray(np.linalg.solve(matrix, (means * own[:, None]).T @ values))
    assert parts is not None
    return coefficients, parts


def _variances(
    squares: Numbers,
    features: Numbers,
    fixed: Numbers,
    weights: Numbers,
    start: Numbers | None = None,
) -> Numbers:
    """Coefficients of the variance of Gaussian values that are likeliest, none below 0.

    The variance of a value is ``features @ coefficients + fixed``. Each round is a step of Fisher's
    scoring: least squares of the squares, weighted by the precision that they have by now.
    """
    scale = np.maximum(weights @ features, TINY)
    found = weights @ squares / scale if start is None else start
    # So that no value of hardly any variance counts for all others.
    least = 1e-3 * float(weights @ squares / max(weights.sum(), TINY)) + TINY
    for _ in range(12):
        variance = np.maximum(features @ found + fixed, least)
        own = (weights / variance**2)[:, None] * features
        found = (found + _not_negative(own.T @ features, own.T @ (squares - fixed))) / 2
    return np.asarray(found)


def _not_negative(matrix: Numbers, vector: Numbers) -> Numbers:
    """Least squares by their normal equations, without the coefficients that would be negative."""
    some = np.diag(matrix) > TINY
    found = np.zeros(len(vector))
    while some.any():
        part = matrix[np.ix_(some, some)]
        size = np.sqrt(np.diag(part))
        solved = np.linalg.lstsq(part / np.outer(size, size), vector[some] / size, rcond=1e-9)[0]
        if (solved >= 0).all():
            found[some] = solved / size
            break
        some[np.flatnonzero(some)[np.argmin(solved)]] = False
    return found

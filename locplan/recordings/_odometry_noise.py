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

from locplan._kernels.arrays import Bools, Floats
from locplan._kernels.particles import STILL
from locplan._util.intervals import Interval, blocks_along, intervals
from locplan._util.poses import updates_of, way_along, way_between, wrapped
from locplan.recordings._odometry_model import TINY, likeliest_variances
from locplan.recordings._recording import Recording
from locplan.recordings._tracks import without_jumps
from locplan.recordings._trajectory import SMOOTHED
from locplan.robots import Amcl

SPANS, SMOOTHED_SPANS = (0.5, 1.0, 2.0, 4.0), (4.0, 8.0)
"""Lengths of the stretches over which odometry is compared with the poses [m]. Errors of the poses
do not grow with them, those of odometry do. Smoothed poses follow odometry over short ones."""
MIN_STRETCHES, SMOOTHED_MIN_STRETCHES = 30, 60
"""Numbers of stretches below which the drifts are hardly known: drives of some 10 m, and of some
150 m with smoothed poses, where that of the distance may vanish in 100 m."""
MIN_UPDATES = 40
"""Number of the filter's updates below which odometry is not calibrated."""
TURN = 0.2
"""Turn that is one: the noise of many small ones would add up [rad]."""
RESAMPLES = 100
"""Number of resamples of blocks."""


@dataclass(frozen=True)
class OdometryNoise:
    """Noise of odometry with 95 % intervals over blocks of the drive of 4 m, of smoothed poses 8 m.

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
    """Sum of the robot's turns of 0.2 rad and more [rad]."""
    updates: int
    """Number of the filter's updates, between which the increments were compared."""
    long_enough: bool
    """Whether the drive tells the drifts."""
    notes: tuple[str, ...]
    """What limits the fit, in sentences without a full stop."""

    def settings(self) -> dict[str, float]:
        """The drifts, and the sizes of the biases, by their names in `locplan.robots.Odometry`.

        Where the robot turned little, the drifts of heading and turns are hardly known, and where
        it drove little, no drifts are.
        """
        names = ["distance_bias", "heading_bias_deg"]
        names += ["distance_drift"] if self.long_enough else []
        if self.turned >= 2 * math.pi:
            names += ["turn_bias"]
            names += ["heading_drift_deg", "turn_drift_deg"] if self.long_enough else []
        return {name: abs(getattr(self, name).value) for name in names}


def odometry_noise(
    recording: Recording, amcl: Amcl, faulty: Bools | None = None
) -> OdometryNoise | None:
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
    faulty : (scans - 1,) array of bool, optional
        Mask of the steps that are left out, as `find_recording_faults` finds them.
    """
    if recording.odometry is None:
        return None
    updates = updates_of(recording.odometry, amcl.update_min_d, amcl.update_min_a)
    if len(updates) - 1 < MIN_UPDATES:
        return None
    poses, odometry, jumps = without_jumps(recording.poses, recording.odometry, faulty)
    smoothed = recording.source.poses == SMOOTHED
    spans = SMOOTHED_SPANS if smoothed else SPANS
    needed = SMOOTHED_MIN_STRETCHES if smoothed else MIN_STRETCHES
    stretches = _Stretches.of(poses, odometry, spans)
    blocks = blocks_along(poses, spans[-1])
    increments = _Increments.of(poses[updates], odometry[updates])
    drifts = intervals(stretches.fitted, blocks[stretches.begin], RESAMPLES)
    # The noise that the poses surely have: a small one is hardly apart from odometry's.
    position, heading = np.nan_to_num([each.low for each in drifts[-2:]]).tolist()
    sure = position, math.radians(heading)
    alphas = intervals(lambda w: increments.fitted(w, *sure), blocks[updates[:-1]], RESAMPLES)
    turns = np.diff(poses[updates_of(poses, math.inf, TURN), 2])
    turned = float(np.abs(wrapped(turns)).sum())
    notes = _notes(increments, np.array([each.value for each in alphas]), sure, turned)
    if jumps:
        notes.append(f"jumps of odometry against the recorded poses, which are left out: {jumps}")
    if smoothed:
        notes.append("smoothed poses follow odometry between two updates: the alphas are too low")
    long_enough = len(stretches.way) >= needed
    if not long_enough:
        each = " and ".join(f"{span:g}" for span in spans)
        notes.append(
            "the drive is too short to tell the drifts, which are not written: it has"
            f" {len(stretches.way)} stretches of {each} m, not {needed}"
        )
    values: list[Any] = [*alphas, *drifts, turned, len(updates), long_enough, tuple(notes)]
    return OdometryNoise(*values)


def _notes(
    increments: _Increments, alphas: Floats, sure: tuple[float, float], turned: float
) -> list[str]:
    notes = []
    if increments.outweighed(alphas, *sure):
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


def _ways(poses: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Poses at the end as seen from those at the begin, (n, 3) [m, m, rad]."""
    ways = way_between(poses[begin], poses[end])
    return np.column_stack([ways[:, :2], wrapped(ways[:, 2])])


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Stretches of a drive of some lengths, and what odometry says of them."""

    begin: NDArray[np.int64]
    way: Floats
    """Length of the way [m]."""
    turned: Floats
    """Sum of turns [rad]."""
    chord: Floats
    """Distance from the begin to the end [m]."""
    turn: Floats
    """Turn from the begin to the end [rad]."""
    ahead: Floats
    """Reported chord minus the true one, along it [m]; NaN where the way is not straight."""
    aside: Floats
    """Reported turn minus the true one [rad]."""

    @classmethod
    def of(cls, poses: Floats, odometry: Floats, spans: tuple[float, ...]) -> _Stretches:
        """Stretches of each length [m], one after the other."""
        turns = np.abs(wrapped(np.diff(odometry[:, 2])))
        way, turned = way_along(odometry), np.concatenate([[0.0], np.cumsum(turns)])
        progress = way + 0.3 * turned  # a turn of 1 rad counts as 0.3 m of way
        begins, ends = [], []
        for span in spans:
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
        straight = (own > 0.9 * long) & (own > spans[0] / 2)
        return cls(
            begin,
            long,
            turned[end] - turned[begin],
            chord,
            true[:, 2],
            np.where(straight, along - chord, np.nan),
            np.asarray(wrapped(reported[:, 2] - true[:, 2])),
        )

    def fitted(self, weights: Floats) -> Floats:
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
    """Increments of odometry between updates: turns and distances of AMCL's differential model.

    Its turn before the way and that after it are taken together: each by itself depends on the
    direction of ways of a few centimetres, which no poses tell.
    """

    features: Floats
    """What the variances of turns and of distances are made of, (2, n, 4)."""
    poses: Floats
    """What the variances of positions and headings add to those, (2, n, 2)."""
    residuals: Floats
    """Reported minus true ones, (2, n) [rad, m]."""

    @classmethod
    def of(cls, poses: Floats, odometry: Floats) -> _Increments:
        """Increments from each pose to the next."""
        begin = np.arange(len(poses) - 1)
        true, reported = (_ways(each, begin, begin + 1) for each in (poses, odometry))
        way = np.hypot(reported[:, 0], reported[:, 1])
        first = np.where(way >= STILL, np.arctan2(reported[:, 1], reported[:, 0]), 0.0)
        # The true end in the direction of the reported way.
        ahead = np.cos(first) * true[:, 0] + np.sin(first) * true[:, 1]
        second, turn = reported[:, 2] - first, wrapped(true[:, 2] - reported[:, 2])
        turned = sum(
            np.minimum(abs(wrapped(t)), abs(wrapped(t - np.pi))) ** 2 for t in (first, second)
        )
        none, two, square = np.zeros(len(way)), np.full(len(way), 2.0), way**2
        return cls(
            np.array(
                [
                    np.column_stack([turned, 2 * square, none, none]),
                    np.column_stack([none, none, square, turned]),
                ]
            ),
            np.array([np.column_stack([none, two]), np.column_stack([two, none])]),
            np.array([turn, ahead - way]),
        )

    def fitted(self, weights: Floats, position: float, heading: float) -> Floats:
        """The alphas, (4,), with poses that have noise of their own [m, rad]."""
        fixed = (self.poses @ np.array([position**2, heading**2])).ravel()
        features, every = self.features.reshape(-1, 4), np.tile(weights, 2)
        return likeliest_variances(self.residuals.ravel() ** 2, features, fixed, every)

    def outweighed(self, alphas: Floats, position: float, heading: float) -> bool:
        """Whether the poses' noise is more than odometry's, of the turns or of the distances."""
        of_poses = self.poses @ np.array([position**2, heading**2])
        of_odometry = self.features @ alphas
        return bool((of_poses.mean(axis=1) > of_odometry.mean(axis=1)).any())

    def jumps(self, alphas: Floats, position: float, heading: float) -> float:
        """Share of the increments that are far off what the fit expects."""
        variance = self.features @ alphas + self.poses @ np.array([position**2, heading**2])
        return float((self.residuals**2 > 25 * (variance + TINY)).any(axis=0).mean())


def _regressed(
    values: Floats, means: Floats, features: Floats, weights: Floats
) -> tuple[Floats, Floats]:
    """Coefficients of the mean and of the variance of Gaussian values that are likeliest."""
    coefficients: Floats = np.zeros(means.shape[1])
    parts: Floats | None = None
    for _ in range(4):
        squares = (values - means @ coefficients) ** 2
        parts = likeliest_variances(squares, features, np.zeros(len(values)), weights, parts)
        own = weights / (features @ parts + TINY)
        matrix = (means * own[:, None]).T @ means + TINY * np.eye(means.shape[1])
        coefficients = np.asarray(np.linalg.solve(matrix, (means * own[:, None]).T @ values))
    assert parts is not None
    return coefficients, parts

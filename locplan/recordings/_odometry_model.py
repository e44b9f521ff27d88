"""How a robot's odometry errs: its biases, the mount that they show, and its variances."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.poses import after_way, way_between, wrapped
from locplan._util.saved import Valued
from locplan.robots import Odometry

FREEDOM = 4.0
"""Degrees of freedom of Student's distribution of the errors."""
AHEAD, LEFT, TURN = range(3)
TINY = 1e-12


@dataclass(frozen=True)
class Moves:
    """What odometry says of the ways between n scans; the first one stands for none."""

    ways: Floats
    """Each scan as seen from the one before, (n, 3) [m, m, rad]."""
    lengths: Floats
    """Length of the way [m], (n,)."""
    turned: Floats
    """Sum of the turns [rad], (n,)."""

    @classmethod
    def of(cls, odometry: Floats, scans: NDArray[np.int64]) -> Moves:
        """Moves between some scans of a drive."""
        steps = way_between(odometry[:-1], odometry[1:])
        sums = np.zeros((len(odometry), 2))
        sums[1:, 0] = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
        sums[1:, 1] = np.cumsum(np.abs(wrapped(steps[:, 2])))
        ways = np.zeros((len(scans), 3))
        ways[1:] = way_between(odometry[scans[:-1]], odometry[scans[1:]])
        ways[:, 2] = wrapped(ways[:, 2])
        return cls(ways, *np.diff(sums[scans], axis=0, prepend=sums[scans[:1]]).T)

    @property
    def features(self) -> Floats:
        """What variances are made of, (n, 3)."""
        return np.column_stack([self.lengths, self.turned, np.ones(len(self.lengths))])


@dataclass(frozen=True, eq=False)
class OdometryModel(Valued):
    """Odometry of one drive: the true ways are the reported ones, corrected, with an error.

    The errors are Student's with 4 degrees of freedom, and independent from scan to scan.
    """

    scale: float
    """True distances over reported ones, minus 1."""
    bend: float
    """Bend to the left of ways that are reported straight [rad/m]."""
    turn_scale: float
    """True turns over reported ones, minus 1."""
    mount: tuple[float, float, float]
    """Pose of the lidar from where it is said to be, as the drive shows it [m, m, rad]."""
    variances: Floats
    """Squared scales of the errors ahead, to the left, and of the turn, a metre of way, a radian
    turned, and a scan, (3, 3) [m^2, m^2, rad^2]."""

    @classmethod
    def first(cls, odometry: Odometry) -> OdometryModel:
        """What is taken for granted at first: wide errors, or those of a robot that has wider.

        Parameters
        ----------
        odometry : Odometry
            That of the robot.
        """
        turn = math.radians(4.0)
        own = math.radians(odometry.heading_drift_deg), math.radians(odometry.turn_drift_deg)
        deviations = [
            [max(0.10, odometry.distance_drift), 0.05, 0.01],
            [0.07, 0.05, 0.01],
            [max(turn, own[0]), max(turn, own[1]), math.radians(0.3)],
        ]
        return cls(0.0, 0.0, 0.0, (0.0, 0.0, 0.0), np.square(deviations))

    def expected(self, moves: Moves) -> Floats:
        """The corrected ways, (n, 3), of a robot whose lidar is where it is said to be.

        Parameters
        ----------
        moves : Moves
            What odometry says.
        """
        ahead, left, turn = moves.ways.T
        turn = turn * (1 + self.turn_scale) + self.bend * moves.lengths
        robot = np.column_stack([ahead * (1 + self.scale), left * (1 + self.scale), turn])
        lidar = np.broadcast_to(np.array(self.mount), robot.shape)
        return way_between(lidar, after_way(robot, lidar))

    def deviations(self, moves: Moves) -> Floats:
        """Scales of the errors, (n, 3) [m, m, rad].

        Parameters
        ----------
        moves : Moves
            What odometry says.
        """
        return np.asarray(np.sqrt(moves.features @ self.variances.T))

    def learned(self, moves: Moves, true: Floats, known: Floats, used: Floats) -> OdometryModel:
        """The model that explains the true ways best: a step of expectation and maximisation.

        Parameters
        ----------
        moves : Moves
            What odometry says.
        true : (n, 3) array
            The ways [m, m, rad].
        known : (n, 3) array
            Variances with which they are known, without which those of odometry would vanish.
        used : (n,) array
            1 where a way counts, and 0 where it is a jump.
        """
        model = self
        for _ in range(3):
            model = model._unbiased(moves, true, used)
            errors = true - model.expected(moves)
            errors[:, TURN] = wrapped(errors[:, TURN])
            variances = np.empty((3, 3))
            for axis in range(3):
                square, scale = errors[:, axis] ** 2, model.deviations(moves)[:, axis] ** 2
                sure = (FREEDOM + 1) / (FREEDOM + square / scale)
                squares, none = sure * square + known[:, axis], np.zeros(len(square))
                variances[axis] = likeliest_variances(squares, moves.features, none, used)
            # So that a drive that hardly errs does not become one without error.
            least = np.array([0.005, 0.005, math.radians(0.1)]) ** 2
            variances[:, 2] = np.maximum(variances[:, 2], least)
            model = replace(model, variances=variances)
        return model

    def _unbiased(self, moves: Moves, true: Floats, used: Floats) -> OdometryModel:
        """The model with the biases, by robust regression towards none."""
        ahead, left, turn = moves.ways.T
        cos, sin = np.cos(turn) - 1, np.sin(turn)
        deviations = self.deviations(moves)
        off = true - moves.ways
        off[:, TURN] = wrapped(off[:, TURN])
        # A lidar that is mounted elsewhere swings about the robot in turns.
        features = [
            np.column_stack([ahead, left, cos, -sin]),
            np.column_stack([left, -ahead, sin, cos]),
        ]
        both = np.concatenate([each / deviations[:, [n]] for n, each in enumerate(features)])
        places = np.concatenate([off[:, AHEAD] / deviations[:, 0], off[:, LEFT] / deviations[:, 1]])
        scale, yaw, x, y = _robust(both, places, np.tile(used, 2), (0.1, 0.1, 0.2, 0.2))
        turns = np.column_stack([turn, moves.lengths]) / deviations[:, [TURN]]
        own = off[:, TURN] / deviations[:, TURN]
        turn_scale, bend = _robust(turns, own, used, (0.2, 0.1))
        return OdometryModel(scale, bend, turn_scale, (x, y, yaw), self.variances)


def _robust(features: Floats, values: Floats, used: Floats, near: tuple[float, ...]) -> list[float]:
    """Coefficients by least squares with Student's weights, and a prior about zero."""
    prior = np.diag(1 / np.square(near))
    found: Floats = np.zeros(len(near))
    for _ in range(6):
        weights = used * (FREEDOM + 1) / (FREEDOM + (values - features @ found) ** 2)
        weighed = (features * weights[:, None]).T
        found = np.asarray(np.linalg.solve(weighed @ features + prior, weighed @ values))
    return list(map(float, found))


def ways_of(poses: Floats, own: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Ways between n poses, the first one none, and the variances with which they are known.

    Parameters
    ----------
    poses : (n, 3) array
        The poses [m, m, rad].
    own, across : (n, 3, 3) arrays
        Covariances of each, and of each with the one before.
    """
    ways, known = np.zeros((len(poses), 3)), np.zeros((len(poses), 3))
    ways[1:] = way_between(poses[:-1], poses[1:])
    ways[:, TURN] = wrapped(ways[:, TURN])
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    after = np.zeros((len(cos), 3, 3))
    after[:, 0, 0], after[:, 0, 1], after[:, 1, 0], after[:, 1, 1] = cos, sin, -sin, cos
    after[:, 2, 2] = 1.0
    before = -after
    before[:, 0, 2], before[:, 1, 2] = ways[1:, LEFT], -ways[1:, AHEAD]
    both = np.concatenate([before, after], axis=2)
    joint = np.block([[own[:-1], across[1:].transpose(0, 2, 1)], [across[1:], own[1:]]])
    known[1:] = np.einsum("nij,njk,nik->ni", both, joint, both)
    return ways, known


def likeliest_variances(
    squares: Floats,
    features: Floats,
    fixed: Floats,
    weights: Floats,
    start: Floats | None = None,
) -> Floats:
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


def _not_negative(matrix: Floats, vector: Floats) -> Floats:
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

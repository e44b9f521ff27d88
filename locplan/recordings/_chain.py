"""Scans of a recorded drive one after the other, and the poses that explain them best together."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.poses import after_way, way_between, wrapped
from locplan.recordings._odometry_model import Moves, OdometryModel, ways_of
from locplan.recordings._passes import BEAMS, UNEXPLAINED, Walls, scoring
from locplan.recordings._trajectory import CARRIED

FINE, FINE_BEAMS = 0.1, 150.0
"""Deviation of beams' ends [m], and the number of independent beams that a scan counts as."""

DISPLACED, FAR_AWAY = 0.2, 40.0
"""Least distance, and largest length, of a stretch of the map that is said to be displaced [m]."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Some scans of a drive one after the other, and the least squares of their poses."""

    walls: Walls
    ends: Floats
    moves: Moves
    model: OdometryModel
    jumps: tuple[int, ...] = ()
    """Scans that odometry does not lead to."""

    @cached_property
    def _drive(self) -> Any:
        """The scans and the odometry as the kernels take them."""
        from locplan._kernels.least_squares import Drive

        # Scans from almost the same place tell the same.
        shares = np.minimum(1.0, self.moves.lengths / 0.5)
        shares[0] = 1.0
        deviations = self.model.deviations(self.moves)
        deviations[list(self.jumps)] = np.inf
        return Drive(self.ends, shares, self.model.expected(self.moves), deviations)

    def refined(self, poses: Floats, rounds: int) -> Floats:
        """Poses of less loss."""
        from locplan._kernels.least_squares import refine_poses

        poses = np.array(poses)
        beams = scoring(FINE, FINE_BEAMS)
        refine_poses(self.walls.distances, beams, self._drive, poses, rounds)
        return poses

    def fits(self, candidates: Floats) -> Floats:
        """Log-likelihoods a beam of the scans at poses (c, n, 3), (c, n); NaN without returns."""
        from locplan._kernels.least_squares import fits_along

        fits = np.empty(candidates.shape[:2])
        fits_along(self.walls.distances, scoring(0.15, BEAMS), self.ends, candidates, fits)
        return fits

    def best_way(self, candidates: Floats) -> Floats:
        """The likeliest way over the poses of some candidates (c, n, 3), (n, 3)."""
        from locplan._kernels.trajectory import best_way

        gains = BEAMS * np.maximum(np.nan_to_num(self.fits(candidates)), UNEXPLAINED)
        _, _, moves, deviations = self._drive
        way = best_way(candidates, gains, moves, deviations, self.walls.kidnapped)
        return np.asarray(candidates[way, np.arange(len(way))])

    def covariances(self, poses: Floats, beams: float) -> tuple[Floats, Floats]:
        """Covariance of each pose, and with the one before, of so many independent beams."""
        from locplan._kernels.least_squares import Equations, covariances_of, normal_equations

        blocks = np.empty((4, len(poses), 3, 3))
        equations = Equations(blocks[0], blocks[1], np.empty((len(poses), 3)))
        scored = scoring(FINE, beams)
        normal_equations(self.walls.distances, scored, self._drive, poses, equations)
        covariances_of(equations, blocks[2], blocks[3])
        return blocks[2], blocks[3]

    def errors(self, poses: Floats) -> Floats:
        """How odometry errs from one pose to the next, (n, 3) [m, m, rad]."""
        errors = np.zeros((len(poses), 3))
        errors[1:] = way_between(poses[:-1], poses[1:]) - self.model.expected(self.moves)[1:]
        errors[:, 2] = wrapped(errors[:, 2])
        return errors

    def jumped(self, poses: Floats) -> tuple[int, ...]:
        """The scans to which odometry does not lead: far off, and far beyond its errors."""
        errors = self.errors(poses)
        square = ((errors / self.model.deviations(self.moves)) ** 2).sum(axis=1)
        far = (np.hypot(errors[:, 0], errors[:, 1]) > 0.5) | (np.abs(errors[:, 2]) > 0.5)
        return tuple(map(int, np.flatnonzero(far & (square > 40.0))))

    def bridged(self, poses: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Poses that follow odometry between two jumps which undo each other, and where they do.

        A robot that is carried away and back to where its odometry leads was not away: a stretch
        looks like another one, or like none.
        """
        found, away = poses.copy(), np.zeros(len(poses), np.bool_)
        errors, ways = self.errors(poses), self.model.expected(self.moves)
        far = [n for n in self.jumped(poses) if np.hypot(*errors[n, :2]) > CARRIED]
        for begin, end in itertools.combinations(far, 2):
            across = poses[begin - 1 : end + 1].copy()
            for n in range(begin, end + 1):
                across[n - begin + 1] = after_way(across[n - begin], ways[n])
            closing = poses[end] - across[-1]
            closing[2] = wrapped(closing[2])
            if np.hypot(*closing[:2]) < CARRIED / 2 and not away[begin - 1 : end + 1].any():
                share = np.arange(1, end - begin + 1) / (end - begin + 1)
                found[begin:end] = across[1:-1] + share[:, None] * closing
                away[begin:end] = True
        return found, away

    def displaced(self, poses: Floats) -> NDArray[np.bool_]:
        """Where the map seems displaced: between errors of odometry to one side and to the other.

        A filter that follows such a stretch of the map is shifted when it enters it, and back again
        when it leaves it.
        """
        before = np.zeros((len(poses), 3))
        before[1:, 2] = poses[:-1, 2]
        errors = after_way(before, self.errors(poses))[:, :2]
        errors[list(self.jumps)] = 0.0
        squares = self.model.deviations(self.moves)[:, :2] ** 2
        sums, variances = np.cumsum(errors, axis=0), np.cumsum(squares.mean(axis=1))
        way, found = np.cumsum(self.moves.lengths), np.zeros(len(poses), np.bool_)
        marks = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], 1.0)))
        spans = [each for n in range(1, 5) for each in zip(marks, marks[n:], strict=False)]
        shifts = []
        for begin, end in sorted(spans):
            off = sums[end] - sums[begin]
            size = float(np.hypot(*off))
            if size > DISPLACED and size**2 > 25 * (variances[end] - variances[begin]):
                shifts.append((begin, end, off, size))
        for (_, begin, there, size), (end, _, back, other) in itertools.combinations(shifts, 2):
            near, left = way[end] - way[begin] < FAR_AWAY, np.hypot(*(there + back))
            if begin <= end and near and 2 * left < min(size, other):
                found[begin : end + 1] = True
        return found

    def of_samples(self, samples: Floats) -> Floats:
        """Some samples of a filter, refined, (16, n, 3)."""
        return np.array([self.refined(each, 3) for each in samples[:16]])

    def learning(self, poses: Floats) -> Chain:
        """The same scans with what poses tell of odometry."""
        own, across = self.covariances(poses, FINE_BEAMS)
        used = np.ones(len(poses))
        used[[0, *self.jumps]] = 0.0
        model = self.model.learned(self.moves, *ways_of(poses, own, across), used)
        return replace(self, model=model)

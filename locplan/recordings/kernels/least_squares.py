"""Least squares of all poses of a recorded drive: beams' ends near walls, and odometry between.

Poses are (x, y, heading) in the map's own axes [m, m, rad]; for moves see
`locplan.recordings.kernels.trajectory`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats
from locplan._support.kernels.particles import BeamScores
from locplan.recordings.kernels.trajectory import write_motion_error

BY_SCAN = 15.0
"""Number of independent beams by which it is told whether the map explains a scan."""
FREEDOM = 4.0
"""Degrees of freedom of Student's distribution of odometry's errors."""


class BeamMixture(NamedTuple):
    """How the ends of beams are scored: a mixture of near walls, and anywhere."""

    sigma: float  # deviation of an end from a wall [m]
    anywhere: float  # share of ends anywhere
    effective: float  # number of independent beams that a scan counts as
    floor: float  # log-likelihood of a beam of a scan that the map does not explain


class DriveScans(NamedTuple):
    """Scans one after the other, and what odometry says of the ways between them."""

    ends: Floats  # (n, b, 2) ends of beams on the robot [m]; NaN without a return
    shares: Floats  # (n,) share of each scan that counts
    moves: Floats  # (n, 3) to each from the one before
    deviations: Floats  # (n, 3) infinite at a jump, of which odometry says nothing


class NormalEquations(NamedTuple):
    """Normal equations of n poses, which are block-tridiagonal."""

    diagonal: Floats  # (n, 3, 3)
    off_diagonal: Floats  # (n, 3, 3) from each pose to the one before
    vector: Floats  # (n, 3) gradient


@njit(nogil=True, cache=True, error_model="numpy")
def evaluate_fit(
    field: BeamScores, beams: BeamMixture, ends: Floats, pose: Array, matrix: Floats, vector: Floats
) -> float:
    """Mean log-likelihood of a scan's ends (b, 2) [m] at a pose, 0 at best; NaN without returns.

    It writes the normal equations of the ends' distances from walls, weighted by how surely they
    are of walls, into `matrix` (3, 3) and `vector` (3,), and scales them to `effective` beams.
    """
    matrix[:], vector[:] = 0.0, 0.0
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    total, product, count = 0.0, 1.0, 0
    slope = np.empty(3)
    for b in range(len(ends)):
        ahead, left = ends[b, 0], ends[b, 1]
        if np.isnan(ahead):
            continue
        count += 1
        dx, dy = cos * ahead - sin * left, sin * ahead + cos * left
        u = (pose[0] + dx) / field.resolution + field.shift - 0.5
        v = (pose[1] + dy) / field.resolution + field.shift - 0.5
        u, v = min(max(u, 0.0), field.cols - 1.001), min(max(v, 0.0), field.rows - 1.001)
        i, j = int(v), int(u)
        a, c, at = u - j, v - i, i * field.cols + j
        low, low_next = field.values[at], field.values[at + 1]
        high, high_next = field.values[at + field.cols], field.values[at + field.cols + 1]
        near, far = low + a * (low_next - low), high + a * (high_next - high)
        deviation = (near + c * (far - near)) / beams.sigma
        hit = (1 - beams.anywhere) * np.exp(-0.5 * deviation**2)
        # One logarithm serves many beams.
        product *= hit + beams.anywhere
        if product < 1e-200:
            total, product = total + np.log(product), 1.0
        scale = beams.sigma * field.resolution
        slope[0] = ((1 - c) * (low_next - low) + c * (high_next - high)) / scale
        slope[1] = (far - near) / scale
        slope[2] = slope[1] * dx - slope[0] * dy
        wall_share = hit / (hit + beams.anywhere)
        for p in range(3):
            vector[p] += wall_share * slope[p] * deviation
            for q in range(3):
                matrix[p, q] += wall_share * slope[p] * slope[q]
    if count == 0:
        return np.nan
    for p in range(3):
        vector[p] *= beams.effective / count
        for q in range(3):
            matrix[p, q] *= beams.effective / count
    return (total + np.log(product)) / count


@njit(nogil=True, cache=True)
def evaluate_fits(
    field: BeamScores, beams: BeamMixture, ends: Floats, poses: Floats, fits: Floats
) -> None:
    """Write the mean log-likelihoods of n scans at poses (c, n, 3) into `fits` (c, n)."""
    matrix, vector = np.empty((3, 3)), np.empty(3)
    for c in range(len(poses)):
        for n in range(len(ends)):
            fits[c, n] = evaluate_fit(field, beams, ends[n], poses[c, n], matrix, vector)


@njit(nogil=True, cache=True)
def _invert_symmetric(matrix: Floats) -> Array:
    """Inverse of a symmetric positive matrix (3, 3), by cofactors."""
    cofactors = np.empty((3, 3))
    for p in range(3):
        for q in range(3):
            a, b, c, d = (p + 1) % 3, (p + 2) % 3, (q + 1) % 3, (q + 2) % 3
            cofactors[q, p] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    size = (
        matrix[0, 0] * cofactors[0, 0]
        + matrix[0, 1] * cofactors[1, 0]
        + matrix[0, 2] * cofactors[2, 0]
    )
    return cofactors / size


@njit(nogil=True, cache=True)
def _write_odometry_terms(
    first: Array,
    second: Array,
    move: Array,
    deviation: Array,
    first_jacobian: Floats,
    second_jacobian: Floats,
    residuals: Floats,
) -> float:
    """Loss of a move; the weighted Jacobians by both poses are written, (3, 3), and residuals."""
    first_jacobian[:], second_jacobian[:], residuals[:] = 0.0, 0.0, 0.0
    if not np.isfinite(deviation[0]):
        return 0.0
    write_motion_error(first, second, move, residuals)
    cos, sin = np.cos(first[2]), np.sin(first[2])
    (
        second_jacobian[0, 0],
        second_jacobian[0, 1],
        second_jacobian[1, 0],
        second_jacobian[1, 1],
        second_jacobian[2, 2],
    ) = cos, sin, -sin, cos, 1.0
    first_jacobian[0, 2], first_jacobian[1, 2] = residuals[1] + move[1], -residuals[0] - move[0]
    square = 0.0
    for axis in range(3):
        square += (residuals[axis] / deviation[axis]) ** 2
    weight = np.sqrt((FREEDOM + 3) / (FREEDOM + square))
    for axis in range(3):
        residuals[axis] *= weight / deviation[axis]
        for q in range(3):
            first_jacobian[axis, q] = (
                (first_jacobian[axis, q] - second_jacobian[axis, q]) * weight / deviation[axis]
            )
            second_jacobian[axis, q] *= weight / deviation[axis]
    return 0.5 * (FREEDOM + 3) * np.log(1 + square / FREEDOM)


@njit(nogil=True, cache=True)
def write_normal_equations(
    field: BeamScores,
    beams: BeamMixture,
    drive: DriveScans,
    poses: Floats,
    equations: NormalEquations,
) -> float:
    """Loss of a trajectory (n, 3); its normal equations are written into `equations`."""
    diagonal, off_diagonal, vector = equations
    matrix, before, after, sides = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    diagonal[:], off_diagonal[:], vector[:] = 0.0, 0.0, 0.0
    loss = 0.0
    for n in range(len(poses)):
        fit = evaluate_fit(field, beams, drive.ends[n], poses[n], matrix, sides)
        if not np.isnan(fit):
            # A scan that the map does not explain counts less: a mixture by scan.
            explained, not_so = np.exp(BY_SCAN * fit), np.exp(BY_SCAN * beams.floor)
            share = drive.shares[n] * explained / (explained + not_so)
            mixture = np.log(explained + not_so) / BY_SCAN
            loss -= drive.shares[n] * beams.effective * mixture
            for p in range(3):
                vector[n, p] += share * sides[p]
                for q in range(3):
                    diagonal[n, p, q] += share * matrix[p, q]
        if n == 0:
            continue
        move, deviation = drive.moves[n], drive.deviations[n]
        loss += _write_odometry_terms(poses[n - 1], poses[n], move, deviation, before, after, sides)
        diagonal[n - 1] += before.T @ before
        diagonal[n] += after.T @ after
        off_diagonal[n] += after.T @ before
        vector[n - 1] += before.T @ sides
        vector[n] += after.T @ sides
    return loss


@njit(nogil=True, cache=True)
def solve_block_tridiagonal(equations: NormalEquations, damping: float, step: Floats) -> None:
    """Solve the equations, damped, for the step (n, 3) that lowers the loss."""
    diagonal, off_diagonal, vector = equations
    count = len(diagonal)
    inverses, sides = np.empty((count, 3, 3)), np.empty((count, 3))
    for n in range(count):
        block, side = diagonal[n].copy(), -vector[n]
        for p in range(3):
            block[p, p] += damping * (block[p, p] + 1.0)
        if n:
            led = off_diagonal[n] @ inverses[n - 1]
            block -= led @ off_diagonal[n].T
            side -= led @ sides[n - 1]
        inverses[n], sides[n] = _invert_symmetric(block), side
    for n in range(count - 1, -1, -1):
        side = sides[n]
        if n < count - 1:
            side = side - off_diagonal[n + 1].T @ step[n + 1]
        step[n] = inverses[n] @ side


@njit(nogil=True, cache=True)
def refine_poses(
    field: BeamScores, beams: BeamMixture, drive: DriveScans, poses: Floats, n_rounds: int
) -> float:
    """Move a trajectory (n, 3) to less loss by Levenberg and Marquardt's steps; return the loss."""
    count = len(poses)
    blocks = np.empty((2, count, 3, 3))
    equations, damping = NormalEquations(blocks[0], blocks[1], np.empty((count, 3))), 1e-3
    trial_poses, step = poses.copy(), np.empty((count, 3))
    loss = write_normal_equations(field, beams, drive, poses, equations)
    for _ in range(n_rounds):
        solve_block_tridiagonal(equations, damping, step)
        for n in range(count):
            for axis in range(3):
                trial_poses[n, axis] = poses[n, axis] + min(max(step[n, axis], -0.5), 0.5)
        after = write_normal_equations(field, beams, drive, trial_poses, equations)
        if after <= loss:
            gain, loss, damping = loss - after, after, max(damping / 10, 1e-9)
            poses[:] = trial_poses
            if gain < 1e-3:
                break
        else:
            damping *= 10
            write_normal_equations(field, beams, drive, poses, equations)
    return loss


@njit(nogil=True, cache=True)
def write_covariances(
    equations: NormalEquations, covariances: Floats, cross_covariances: Floats
) -> None:
    """Write the covariances of poses, (n, 3, 3), and those with the pose before, from equations."""
    diagonal, off_diagonal, _ = equations
    count = len(diagonal)
    inverses = np.empty((count, 3, 3))
    for n in range(count):
        block = diagonal[n] + 1e-9 * np.eye(3)
        if n:
            block -= off_diagonal[n] @ inverses[n - 1] @ off_diagonal[n].T
        inverses[n] = _invert_symmetric(block)
    for n in range(count - 1, -1, -1):
        covariances[n], cross_covariances[n] = inverses[n], 0.0
        if n < count - 1:
            led = inverses[n] @ off_diagonal[n + 1].T
            cross_covariances[n + 1] = -covariances[n + 1] @ led.T
            covariances[n] += led @ covariances[n + 1] @ led.T

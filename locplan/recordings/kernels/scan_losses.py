"""The loss of a scan at a pose on a likelihood field, and the poses near by where it is least.

A table holds for every cell the losses at four neighbouring cell centres, a byte each in one word,
so that one look-up gives all that a bilinear interpolation needs. The losses are in steps of which
`TOP` are that of an end far from all walls. A margin around the map holds `TOP`; ends beyond it are
moved to its edge. Positions are x (columns) and y (rows) in cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Floats, Ints, Octets, Singles

TOP = 255
"""Loss of a beam's end far from all walls [steps]."""
ROUNDS = 24
"""Greatest number of rounds of the search with one step."""


class LossTables(NamedTuple):
    """The losses around a map at some deviations, the widest first, and where the robot fits."""

    corners: NDArray[np.uint32]  # (level, row x col) losses at four centres, the lowest first
    fits: Octets  # (row, col) of the map, 1 where the robot may stand
    margin: int  # cells around the map
    width: int  # number of words in a row
    height: int  # number of rows
    steps: Floats  # (level, steps) of the search [cells]; 0 where there is none


@njit(nogil=True, cache=True, error_model="numpy")
def compute_loss_at_pose(
    tables: LossTables, level: int, ends: Singles, x: float, y: float, heading: float
) -> float:
    """Sum of the losses of a scan's ends, (2, k) ahead and to the left [cells], at a pose [steps].

    Ends are rounded down to 1/256 of a cell, so that sums are whole numbers.
    """
    cos, sin = np.float32(np.cos(heading)), np.float32(np.sin(heading))
    corners, width = tables.corners[level], tables.width
    shift, zero, parts = tables.margin - 0.5, np.float32(0.0), np.float32(256)
    from_x, from_y = np.float32(x + shift), np.float32(y + shift)
    last_x, last_y = np.float32(width - 1.01), np.float32(tables.height - 1.01)
    total = np.int64(0)
    for b in range(ends.shape[1]):
        ahead, left = ends[0, b], ends[1, b]
        u = min(max(from_x + cos * ahead - sin * left, zero), last_x)
        v = min(max(from_y + sin * ahead + cos * left, zero), last_y)
        across, along = np.int32(u * parts), np.int32(v * parts)
        # An unsigned index need not be checked if it counts from the end.
        word = corners[np.uint32((along >> 8) * width + (across >> 8))]
        a, c = across & 255, along & 255
        low = np.int32(word & 255) * (256 - a) + np.int32(word >> 8 & 255) * a
        high = np.int32(word >> 16 & 255) * (256 - a) + np.int32(word >> 24) * a
        total += low * (256 - c) + high * c
    return total / (256 * 256)


@njit(nogil=True, cache=True, error_model="numpy")
def can_robot_stand_at(tables: LossTables, x: float, y: float) -> bool:
    """Whether the robot may stand at a position [cells]."""
    row, col = int(np.floor(y)), int(np.floor(x))
    rows, cols = tables.fits.shape
    return 0 <= row < rows and 0 <= col < cols and tables.fits[row, col] > 0


@njit(nogil=True, cache=True, error_model="numpy")
def refine_pose(
    tables: LossTables, level: int, ends: Singles, turn_lever: float, pose: Floats
) -> float:
    """Move a pose, x, y [cells] and heading [rad], to where no step lowers the loss; return it.

    Steps along the axes and turns that move an end `turn_lever` cells away as far alternate,
    with each of the level's steps. The robot fits at all positions but perhaps the first.
    """
    best = compute_loss_at_pose(tables, level, ends, pose[0], pose[1], pose[2])
    trial = np.empty(3)
    for step in tables.steps[level]:
        for _ in range(ROUNDS if step > 0 else 0):
            is_moved = False
            for axis in range(3):
                for sign in (1.0, -1.0):
                    trial[:] = pose
                    trial[axis] += sign * (step if axis < 2 else step / turn_lever)
                    if axis < 2 and not can_robot_stand_at(tables, trial[0], trial[1]):
                        continue
                    loss = compute_loss_at_pose(tables, level, ends, trial[0], trial[1], trial[2])
                    if loss < best:
                        best, is_moved = loss, True
                        pose[axis] = trial[axis]
                        break
            if not is_moved:
                break
    return best


@njit(nogil=True, cache=True, error_model="numpy")
def polish_pose(tables: LossTables, ends: Singles, turn_lever: float, pose: Floats) -> float:
    """Move a pose to where no step in any of 26 directions lowers the loss; return the loss.

    Steps along one axis alone stop where a turn would have to go with a move. The steps are those
    of the last level, the deviation is its own.
    """
    level = len(tables.corners) - 1
    best = compute_loss_at_pose(tables, level, ends, pose[0], pose[1], pose[2])
    trial = np.empty(3)
    for step in tables.steps[level]:
        for _ in range(ROUNDS if step > 0 else 0):
            is_moved = False
            for n in range(27):
                trial[0] = pose[0] + (n % 3 - 1) * step
                trial[1] = pose[1] + (n // 3 % 3 - 1) * step
                trial[2] = pose[2] + (n // 9 - 1) * step / turn_lever
                if n == 13 or not can_robot_stand_at(tables, trial[0], trial[1]):
                    continue
                loss = compute_loss_at_pose(tables, level, ends, trial[0], trial[1], trial[2])
                if loss < best:
                    best, is_moved = loss, True
                    pose[:] = trial
            if not is_moved:
                break
    return best


@njit(nogil=True, cache=True)
def are_poses_close(first: Floats, second: Floats, max_distance: float, max_turn: float) -> bool:
    """True if two poses are nearer than `max_distance` [cells] and `max_turn` [rad]."""
    across, along = first[0] - second[0], first[1] - second[1]
    if across * across + along * along >= max_distance * max_distance:
        return False
    return abs((first[2] - second[2] + np.pi) % (2 * np.pi) - np.pi) < max_turn


@njit(nogil=True, cache=True)
def find_distinct_poses(poses: Floats, order: Ints, max_distance: float, max_turn: float) -> Array:
    """Indices, in order, of the poses that are like none of those before that are kept."""
    distinct = np.empty(order.size, np.int64)
    count = 0
    for n in order:
        for k in range(count):
            if are_poses_close(poses[n], poses[distinct[k]], max_distance, max_turn):
                break
        else:
            distinct[count] = n
            count += 1
    return distinct[:count]


@njit(nogil=True, cache=True, error_model="numpy")
def find_modes(
    tables: LossTables,
    ends: Singles,
    starts: Floats,
    turn_lever: float,
    max_excess: float,
    slack: float,
    home: Floats,
    far_distance: float,
    max_distance: float,
    max_turn: float,
) -> tuple[Array, Array]:
    """Poses of least loss that are found from starts, the best first, (n, 3), and losses (n,).

    But for the last deviation, every second beam is compared. A start is given up when its loss
    with a wider deviation, which is hardly greater than that with a narrower one, is above the
    least loss that was found by more than `max_excess`, and above the least loss away from home.

    Parameters
    ----------
    tables, ends, lever
        See `refine`.
    starts : (k, 3) array
        Poses to begin from.
    max_excess : float
        Excess over the least loss up to which all modes are found [steps].
    slack : float
        By how much the first refinement lowers a loss at most [steps].
    home : (2,) array
        Position, x and y [cells]; NaN where there is none.
    far_distance : float
        Distance from home from which on the best mode is found whatever its loss [cells].
    max_distance, max_turn : float
        Distance [cells] and angle [rad] below which two modes are one.
    """
    count, last = len(starts), len(tables.corners) - 1
    poses, losses = starts.copy(), np.full(count, np.inf)
    sparse_ends = np.ascontiguousarray(ends[:, ::2])
    factor = ends.shape[1] / sparse_ends.shape[1]
    for n in range(count):
        if can_robot_stand_at(tables, poses[n, 0], poses[n, 1]):
            losses[n] = factor * compute_loss_at_pose(
                tables, 0, sparse_ends, poses[n, 0], poses[n, 1], poses[n, 2]
            )
    place, candidates, order = (
        (home[0], home[1], far_distance),
        (poses, losses),
        _sort_finite_losses(losses),
    )
    _refine_candidates(
        tables, 0, (sparse_ends, factor), turn_lever, order, max_excess, slack, place, candidates
    )
    for level in range(1, last + 1):
        order = find_distinct_poses(
            poses, _sort_finite_losses(losses), max_distance / 2, max_turn / 2
        )
        scaled = (sparse_ends, factor) if level < last else (ends, 1.0)
        _refine_candidates(
            tables, level, scaled, turn_lever, order, max_excess, 0.0, place, candidates
        )
    distinct = find_distinct_poses(poses, _sort_finite_losses(losses), max_distance, max_turn)
    poses, losses = poses[distinct], losses[distinct]
    for n in range(len(distinct)):
        if losses[n] <= losses[0] + max_excess:
            losses[n] = polish_pose(tables, ends, turn_lever, poses[n])
    order = np.argsort(losses, kind="mergesort")
    return poses[order], losses[order]


@njit(nogil=True, cache=True)
def _sort_finite_losses(losses: Floats) -> Array:
    """Indices of the finite losses, the least first."""
    return np.argsort(losses, kind="mergesort")[: int((losses < np.inf).sum())]


@njit(nogil=True, cache=True, error_model="numpy")
def _refine_candidates(
    tables: LossTables,
    level: int,
    scaled: tuple[Singles, float],
    turn_lever: float,
    order: Ints,
    max_excess: float,
    slack: float,
    home: tuple[float, float, float],
    candidates: tuple[Floats, Floats],
) -> None:
    """Refine poses in the order of their losses; those given up get infinite ones, see `modes`."""
    (ends, factor), (poses, losses) = scaled, candidates
    before = losses.copy()
    losses[:] = np.inf
    x, y, far_distance = home
    min_loss, min_far_loss = np.inf, 0.0 if np.isnan(x) else np.inf
    for n in order:
        # The rest of the order is worse: refined, too, it would neither be the best nor near it.
        if before[n] > min_loss + max_excess + slack and before[n] > min_far_loss + slack:
            break
        losses[n] = factor * refine_pose(tables, level, ends, turn_lever, poses[n])
        min_loss = min(min_loss, losses[n])
        if np.hypot(poses[n, 0] - x, poses[n, 1] - y) > far_distance:
            min_far_loss = min(min_far_loss, losses[n])


@njit(nogil=True, cache=True, error_model="numpy")
def refine_on_lattice(
    tables: LossTables,
    ends: Singles,
    turn_lever: float,
    half_steps: int,
    step: float,
    half_turns: int,
    turn: float,
    pose: Floats,
) -> float:
    """Move a pose (3,) to the least loss of all offsets on a lattice about it, refined; return it.

    The lattice has so many steps [cells] to each side in x and y, and so many turns [rad]. That is
    repeated about the pose that was found, as long as the lattice has a lower loss, which is the
    loss at the least deviation. The robot fits at all positions but perhaps the first. For
    `tables`, `ends` and `turn_lever` see `refine_pose`.
    """
    last = len(tables.corners) - 1
    best = refine_pose(tables, last, ends, turn_lever, pose)
    best_pose = np.empty(3)
    for _ in range(6):  # so often at most the pose moves to a better one of the lattice around it
        min_loss = best
        for k in range(-half_turns, half_turns + 1):
            heading = pose[2] + k * turn
            for j in range(-half_steps, half_steps + 1):
                y = pose[1] + j * step
                for i in range(-half_steps, half_steps + 1):
                    x = pose[0] + i * step
                    if can_robot_stand_at(tables, x, y):
                        loss = compute_loss_at_pose(tables, last, ends, x, y, heading)
                        if loss < min_loss:
                            min_loss = loss
                            best_pose[0], best_pose[1], best_pose[2] = x, y, heading
        if min_loss >= best:
            break
        pose[:] = best_pose
        best = refine_pose(tables, last, ends, turn_lever, pose)
    return best

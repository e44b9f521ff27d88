"""A follower that steers a robot along a path by the pose that its filter believes.

It does what Nav2 does with its regulated pure pursuit controller (RPP) and its default behaviour
tree (nav2_regulated_pure_pursuit_controller and navigate_to_pose_w_replanning_and_recovery.xml,
jazzy). Every tenth of a second the robot takes the arc to a point 0.6 m away on the path. If a
second of that arc leads into a wall, it stands still, since RPP tries only one arc. Then it
recovers and tries again, a limited number of times. The drive is aborted after these, or as soon as
the estimate jumps so far that no part of the path lies in the local costmap. A car-like robot turns
on no less than its radius and changes its gear with its path.

Poses are (x, y, heading) in metres along the columns and rows of the part that is driven in.
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats, Ints, Random
from locplan._support.kernels.drives import (
    FilterState,
    OdometryErrors,
    advance_particles,
    correct_particles,
    estimate_pose,
    is_update_due,
)
from locplan._support.kernels.lidar import BeamDisturbances, LidarBeams, simulate_measured_ends
from locplan._support.kernels.particles import BeamScores, FilterSettings
from locplan.simulation.kernels.bodies import (
    DriveWorld,
    RobotBody,
    measure_margin,
    measure_wall_distance,
)
from locplan.simulation.kernels.pursuit import (
    AT,
    BLOCKED,
    FAILED,
    NEAR,
    PLAN_TICK,
    REACH,
    RECOVERY,
    SINCE,
    STANDSTILLS,
    TICK,
    TICKS,
    DriveTrace,
    advance_to_nearest,
    is_arc_clear,
    is_path_ahead_clear,
    write_pursuit_command,
)

HALF_COSTMAP = 1.5
"""Half the width of Nav2's local costmap by default [m]; RPP has no path farther away."""
ASTRAY = 0.3
"""Distance from the path above which the robot plans anew [m]."""
REPLAN = 10
"""Ticks between two plans."""
PATIENCE = 3
"""Ticks that RPP may stand before a wall until it fails (failure_tolerance)."""
STALL, STALLED = 100, 0.5
"""Ticks in which the robot must come so far [m] (progress_checker)."""
RETRIES = 6
"""Number of recoveries until the goal is aborted (number_of_retries of NavigateRecovery). The tree
recovers at every second failure; at the others it only clears the local costmap."""
CLEAR, SPIN, WAIT, BACK = 1, 2, 3, 0
"""The recoveries in the order of their numbers, by the remainder of 4."""
RECOVERY_TICKS = 21, 0, 17, 51
"""Ticks of each: back up by 0.3 m, clear the costmaps, spin by 90 deg, wait for 5 s. The last one
plans."""
SPIN_RATE = np.pi / 2 / (16 * TICK)
"""Turning rate of a spin [rad/s]."""
GO, PLAN, ENDED, ABORTED, TIMED_OUT = range(5)
"""What a decision says: a command, a plan is needed, or how the drive ended."""


@njit(nogil=True, cache=True)
def decide_next_command(
    path: Floats, surroundings: DriveWorld, body: RobotBody, replan_ticks: int, trace: DriveTrace
) -> int:
    """Write the next command into the trace; return GO, PLAN, or the outcome of the drive.

    Parameters
    ----------
    path : (n, 3) array
        Positions that lead to the goal, some 0.05 m apart [m], and the gear that leads there: 1, or
        -1 in reverse.
    surroundings : Surroundings
        The true world.
    body : Body
        The robot.
    replan_ticks : int
        Number of ticks after which the robot plans again without an obstacle in its way.
    trace : Trace
        The drive until now.
    """
    counts, command = trace.counts, trace.command
    n = counts[TICKS]
    x, y, _ = trace.believed[n]
    # A path that begins at its goal, or leads past it, does not end there.
    at_end = counts[AT] + REACH >= len(path) - 1
    if at_end and np.hypot(path[-1, 0] - x, path[-1, 1] - y) <= body.tolerance:
        return ENDED
    if n + 1 == len(trace.truth):
        return TIMED_OUT
    command[:] = 0.0
    if counts[RECOVERY]:
        return continue_recovery(path, surroundings, body, trace)
    path_distance = advance_to_nearest(path, x, y, counts)
    if path_distance > HALF_COSTMAP:
        return ABORTED
    before = trace.believed[max(n - STALL, 0)]
    if n - STALL >= counts[SINCE] and np.hypot(x - before[0], y - before[1]) < STALLED:
        return count_failure(counts)
    tx, ty, _ = trace.truth[n]
    cell = surroundings.resolution
    wall_distance = (
        measure_wall_distance(surroundings.squares, ty / cell, tx / cell, NEAR / cell) * cell
    )
    carrot_distance = write_pursuit_command(path, body, wall_distance, trace)
    clear = is_arc_clear(surroundings, body, carrot_distance, trace)
    if n > counts[PLAN_TICK]:
        # Nav2 plans once a second. Without need the planner would find the same path again.
        due = n - counts[PLAN_TICK] >= replan_ticks
        if not due and n % REPLAN == 0:
            due = (
                not clear
                or path_distance > ASTRAY
                or not is_path_ahead_clear(path, surroundings, body, trace)
            )
        if due:
            counts[PLAN_TICK] = n
            return PLAN
    if clear:
        counts[BLOCKED] = 0
        return GO
    command[:] = 0.0
    counts[BLOCKED] += 1
    if counts[BLOCKED] < PATIENCE:
        return GO
    counts[STANDSTILLS] += 1
    return count_failure(counts)


@njit(nogil=True, cache=True)
def count_failure(counts: Ints) -> int:
    """Count a failure of the controller, and begin the recovery that follows."""
    counts[FAILED] += 1
    counts[BLOCKED], counts[SINCE] = 0, counts[TICKS]
    if counts[FAILED] % 2:
        return GO
    number = counts[FAILED] // 2
    if number > RETRIES:
        return ABORTED
    counts[RECOVERY] = RECOVERY_TICKS[number % 4]
    if counts[RECOVERY]:
        return GO
    counts[PLAN_TICK] = counts[TICKS]
    return PLAN


@njit(nogil=True, cache=True)
def continue_recovery(
    path: Floats, surroundings: DriveWorld, body: RobotBody, trace: DriveTrace
) -> int:
    """Spin, wait, or back up if that is clear, and plan again at last."""
    counts, command = trace.counts, trace.command
    counts[RECOVERY] -= 1
    if counts[RECOVERY] == 0:
        counts[PLAN_TICK] = counts[SINCE] = counts[TICKS]
        return PLAN
    kind = counts[FAILED] // 2 % 4
    if kind == SPIN and body.radius == 0:
        command[2] = SPIN_RATE
    elif kind == BACK:
        command[0] = -body.retreat * path[counts[AT], 2]
    if not is_arc_clear(surroundings, body, np.inf, trace):
        command[:] = 0.0
    return GO


@njit(nogil=True, cache=True)
def apply_command(
    random: Random,
    surroundings: DriveWorld,
    body: RobotBody,
    odometry: OdometryErrors,
    trace: DriveTrace,
) -> None:
    """Drive for a tick: odometry reports the command, and its errors are in the true motion."""
    n, command = trace.counts[TICKS], trace.command
    way = np.hypot(command[0], command[1]) * TICK
    bearing, turn = np.arctan2(command[1], command[0]), command[2] * TICK
    scale, bend, turn_scale = trace.biases
    drift = odometry.distance_drift * np.sqrt(way) * random.standard_normal()
    true_way = max(0.0, (way - drift) / scale)
    deviation = odometry.heading_drift**2 * way + odometry.turn_drift**2 * abs(turn)
    noise = np.sqrt(deviation) * random.standard_normal()
    true_turn = (turn - bend * way - noise) / turn_scale
    write_next_pose(trace.reported, n, way, bearing, turn)
    write_next_pose(trace.truth, n, true_way, bearing, true_turn)
    trace.counts[TICKS] = n + 1
    x, y, heading = trace.truth[n]
    margin = measure_margin(surroundings, body, x, y, heading, 0.0)
    x, y, heading = trace.truth[n + 1]
    if measure_margin(surroundings, body, x, y, heading, margin) < margin:  # a wall is in the way
        for axis in range(3):
            trace.truth[n + 1, axis] = trace.truth[n, axis]


@njit(nogil=True, cache=True)
def write_next_pose(poses: Floats, n: int, way: float, bearing: float, turn: float) -> None:
    """Write the pose after `n`."""
    middle = poses[n, 2] + turn / 2 + bearing
    poses[n + 1, 0] = poses[n, 0] + way * np.cos(middle)
    poses[n + 1, 1] = poses[n, 1] + way * np.sin(middle)
    poses[n + 1, 2] = poses[n, 2] + turn


@njit(nogil=True, cache=True, error_model="numpy")
def follow_path(
    random: Random,
    sensor_random: Random,
    path: Floats,
    surroundings: DriveWorld,
    body: RobotBody,
    replan_ticks: int,
    frame: Floats,
    tracker: FilterState,
    scores: BeamScores,
    lidar: LidarBeams,
    disturbances: BeamDisturbances,
    odometry: OdometryErrors,
    settings: FilterSettings,
    perfect: bool,
    trace: DriveTrace,
) -> int:
    """Drive until a plan is needed or the drive has ended; return this decision.

    Parameters
    ----------
    random, sensor_random : numpy.random.Generator
        Sources of random numbers: of odometry, and of the lidar and the filter.
    path, surroundings, body, period, trace
        As for `decide_next_command`.
    frame : (3,) array
        Pose of the filter map's axes in the driven part of the map [m, m, rad].
    tracker : Tracker
        The filter, begun.
    scores, lidar, disturbances, odometry, settings
        As for `drives.simulate_drive`.
    perfect : bool
        Whether the filter's pose is the true one.
    """
    squares, resolution = surroundings.squares, surroundings.resolution
    ends, finer = np.empty((lidar.angles.size, 2)), resolution / scores.resolution
    cell = np.empty(3)
    while True:
        n = trace.counts[TICKS]
        if perfect:
            for axis in range(3):
                trace.believed[n, axis] = trace.truth[n, axis]
        else:
            due = is_update_due(tracker, trace.reported, n, settings)
            if due:
                advance_particles(sensor_random, tracker, trace.reported, n, settings)
            if due or n == 0:
                x, y, cell[2] = trace.truth[n]
                cell[0], cell[1] = y / resolution, x / resolution
                simulate_measured_ends(
                    sensor_random, squares, resolution, cell, lidar, disturbances, ends
                )
                for b in range(len(ends)):
                    ends[b, 0] *= finer
                    ends[b, 1] *= finer
                correct_particles(sensor_random, tracker, scores, ends, n, settings)
            write_believed_pose(estimate_pose(tracker, trace.reported, n), frame, trace)
        decision = decide_next_command(path, surroundings, body, replan_ticks, trace)
        if decision != GO:
            return decision
        apply_command(random, surroundings, body, odometry, trace)


@njit(nogil=True, cache=True)
def write_believed_pose(pose: tuple[float, float, float], frame: Floats, trace: DriveTrace) -> None:
    """Write the filter's pose, given in its map's axes, into the trace."""
    n = trace.counts[TICKS]
    cos, sin = np.cos(frame[2]), np.sin(frame[2])
    trace.believed[n, 0] = frame[0] + cos * pose[0] - sin * pose[1]
    trace.believed[n, 1] = frame[1] + sin * pose[0] + cos * pose[1]
    trace.believed[n, 2] = frame[2] + pose[2]

"""A follower that steers a robot along a path by the pose that its filter believes.

Every tenth of a second it pursues a point half a metre ahead on the path (pure pursuit; R. C.
Coulter, CMU-RI-TR-92-01, 1992), and looks a second ahead into the true world. Hindered, it asks for
a new plan; blocked, it waits, backs off and plans again. A car-like robot turns on no less than its
radius and changes its gear where its path does.

Poses are (x, y, heading) in metres along the columns and rows of the part that is driven in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from locplan._kernels.arrays import Floats, Ints, Random
from locplan._kernels.bodies import Body, Surroundings, margin_at
from locplan._kernels.drives import Odometry, Tracker, advance, correct, estimate, is_due
from locplan._kernels.lidar import BeamDisturbances, Lidar, measured_ends
from locplan._kernels.particles import BeamScores, Filter, wrapped

TICK = 0.1
"""Time between two commands [s]."""
AHEAD = 0.5
"""Distance to the point that is pursued [m]."""
SPOT = np.pi / 4
"""Angle to that point above which a robot turns on the spot [rad]."""
SLIGHT, MAX_TURN = 0.1, 1.0
"""Turning rate below which a blocked robot need not turn, and the maximum [rad/s]."""
LOOK = 10
"""Number of ticks that the follower looks ahead."""
MARGIN, NEAR = 0.01, 0.1
"""Distance from walls that an arc keeps, and below which the robot slows down [m]."""
REACH = 40
"""Number of points of the path among which the next one is looked for."""
PATIENCE, WAIT, BACK, TRIES = 20, 20, 11, 3
"""Ticks blocked until a recovery, ticks of waiting, of backing off, and number of recoveries."""
STALL, STALLED = 100, 0.5
"""Ticks in which the robot must come so far [m]."""
REPLAN = 10
"""Ticks between two plans."""
GO, PLAN, ENDED, STUCK, TIMED_OUT = range(5)
"""What a decision says: a command, a plan is needed, or how the drive ended."""
TICKS, AT, BLOCKED, PLANNED, TRIED, WAITS, BACKS, SINCE = range(8)
"""Places in `Trace.counts`."""


class Trace(NamedTuple):
    """A drive until now."""

    truth: Floats  # (ticks, 3) true poses
    believed: Floats  # (ticks, 3) the filter's poses
    reported: Floats  # (ticks, 3) odometry, from 0, 0, 0
    command: Floats  # (3,) the last command: ahead, to the left [m/s], and turn [rad/s]
    biases: Floats  # (3,) factor on distances, bend [rad / m], and factor on turns
    counts: Ints  # (8,)


@njit(nogil=True, cache=True)
def is_clear(
    surroundings: Surroundings, body: Body, pose: Floats, ahead: float, left: float, turn: float
) -> bool:
    """Whether a second of a command keeps off the walls, or at least comes no nearer."""
    x, y, heading = pose
    enough = margin_at(surroundings, body, x, y, heading, MARGIN)
    for _ in range(LOOK):
        middle = heading + turn * TICK / 2
        cos, sin = np.cos(middle) * TICK, np.sin(middle) * TICK
        x, y = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        heading += turn * TICK
        if margin_at(surroundings, body, x, y, heading, enough) < enough - 1e-9:
            return False
    return True


@njit(nogil=True, cache=True)
def carrot_on(path: Floats, x: float, y: float, counts: Ints) -> int:
    """The point to pursue, up to where the gear changes; writes the nearest one into the counts."""
    last, nearest, distance = len(path) - 1, counts[AT], np.inf
    for k in range(counts[AT], min(counts[AT] + REACH, len(path))):
        if path[k, 2] != path[counts[AT], 2]:
            break
        away = np.hypot(path[k, 0] - x, path[k, 1] - y)
        if away < distance:
            nearest, distance = k, away
    if nearest < last and path[nearest + 1, 2] != path[nearest, 2]:
        nearest += 1
    counts[AT] = nearest
    way, carrot = 0.0, nearest
    while carrot < last and way < AHEAD and path[carrot + 1, 2] == path[nearest, 2]:
        way += np.hypot(
            path[carrot + 1, 0] - path[carrot, 0], path[carrot + 1, 1] - path[carrot, 1]
        )
        carrot += 1
    return int(carrot)


@njit(nogil=True, cache=True)
def bounded(turn: float, ahead: float, body: Body) -> float:
    """The turning rate nearest to one that the radius of a car-like robot allows at a speed."""
    limit = min(MAX_TURN, abs(ahead) / body.radius)
    return min(max(turn, -limit), limit)


@njit(nogil=True, cache=True)
def pursue(path: Floats, body: Body, near: float, trace: Trace) -> None:
    """Write the command that leads towards the point ahead on the path."""
    x, y, heading = trace.believed[trace.counts[TICKS]]
    carrot, last = carrot_on(path, x, y, trace.counts), len(path) - 1
    gear = path[carrot, 2]
    heading += np.pi * (gear < 0)
    dx, dy = path[carrot, 0] - x, path[carrot, 1] - y
    away, aside = max(np.hypot(dx, dy), 0.1), wrapped(np.arctan2(dy, dx) - heading)
    speed = min(body.speed, max(0.1, np.hypot(path[last, 0] - x, path[last, 1] - y)))
    speed *= min(1.0, max(0.4, near / NEAR))
    command = trace.command
    if body.omnidirectional:
        command[0], command[1] = speed * np.cos(aside), speed * np.sin(aside)
        command[2] = min(max(aside, -MAX_TURN), MAX_TURN)
        return
    command[1] = 0.0
    if body.radius > 0:
        command[0] = gear * speed * (1 - min(abs(aside), SPOT) / (2 * SPOT))
        turn = 2 * abs(command[0]) * np.sin(min(max(aside, -np.pi / 2), np.pi / 2)) / away
        command[2] = bounded(turn, command[0], body)
        return
    if abs(aside) > SPOT:
        command[0], command[2] = 0.0, np.sign(aside) * min(MAX_TURN, 2 * abs(aside))
        return
    command[0] = speed * (1 - abs(aside) / (2 * SPOT))
    command[2] = min(max(2 * command[0] * np.sin(aside) / away, -MAX_TURN), MAX_TURN)


@njit(nogil=True, cache=True)
def evade(surroundings: Surroundings, body: Body, trace: Trace) -> bool:
    """Change the command to the nearest slower one that is clear; False if none is.

    Where no arc is, the robot turns on the spot to the point that it pursues, if it can.
    """
    pose, command = trace.truth[trace.counts[TICKS]], trace.command
    ahead, left, turn = command
    for share in (1.0, 0.6, 0.3):
        for bend in (0.0, 0.3, -0.3, 0.6, -0.6, 1.0, -1.0):
            bent = turn + bend
            if body.radius > 0:
                bent = bounded(bent, share * ahead, body)
            if is_clear(surroundings, body, pose, share * ahead, share * left, bent):
                command[0], command[1], command[2] = share * ahead, share * left, bent
                return True
    command[:] = 0.0
    if body.radius > 0 or abs(turn) <= SLIGHT:
        return False
    turns = is_clear(surroundings, body, pose, 0.0, 0.0, turn)
    if turns:
        command[2] = turn
    return turns


@njit(nogil=True, cache=True)
def decide(path: Floats, surroundings: Surroundings, body: Body, period: int, trace: Trace) -> int:
    """Write the next command into the trace; GO, or PLAN, or how the drive has ended.

    Parameters
    ----------
    path : (n, 3) array
        Positions that lead to the goal, some 0.05 m apart [m], and the gear that leads there: 1, or
        -1 in reverse.
    surroundings : Surroundings
        The true world.
    body : Body
        The robot.
    period : int
        Number of ticks after which a new plan is made though nothing is in the way.
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
    if counts[WAITS] or counts[BACKS]:
        return recover(path, surroundings, body, trace)
    before = trace.believed[max(n - STALL, 0)]
    stalled = n - STALL >= counts[SINCE] and np.hypot(x - before[0], y - before[1]) < STALLED
    if stalled or counts[BLOCKED] >= PATIENCE:
        counts[TRIED] += 1
        counts[BLOCKED], counts[SINCE], counts[WAITS] = 0, n, WAIT
        return STUCK if counts[TRIED] > TRIES else GO
    px, py, heading = trace.truth[n]
    pursue(path, body, margin_at(surroundings, body, px, py, heading, NEAR), trace)
    clear = is_clear(surroundings, body, trace.truth[n], command[0], command[1], command[2])
    if n - counts[PLANNED] >= (period if clear else REPLAN):
        counts[PLANNED] = n
        return PLAN
    if clear:
        counts[BLOCKED] = 0
        return GO
    counts[BLOCKED] = 0 if evade(surroundings, body, trace) else counts[BLOCKED] + 1
    return GO


@njit(nogil=True, cache=True)
def recover(path: Floats, surroundings: Surroundings, body: Body, trace: Trace) -> int:
    """Wait, or back off where that is clear, and plan again at last."""
    counts, n = trace.counts, trace.counts[TICKS]
    if counts[WAITS]:
        counts[WAITS] -= 1
        counts[BACKS] = 0 if counts[WAITS] else BACK
        return GO
    counts[BACKS] -= 1
    if counts[BACKS] == 0:
        counts[PLANNED] = counts[SINCE] = n
        return PLAN
    back = -body.retreat * path[counts[AT], 2]
    if is_clear(surroundings, body, trace.truth[n], back, 0.0, 0.0):
        trace.command[0] = back
    return GO


@njit(nogil=True, cache=True)
def act(
    random: Random, surroundings: Surroundings, body: Body, odometry: Odometry, trace: Trace
) -> None:
    """Drive for a tick: odometry reports the command, and its errors are in the true motion."""
    n, command = trace.counts[TICKS], trace.command
    way = np.hypot(command[0], command[1]) * TICK
    aside, turn = np.arctan2(command[1], command[0]), command[2] * TICK
    scale, bend, turn_scale = trace.biases
    drift = odometry.distance_drift * np.sqrt(way) * random.standard_normal()
    true_way = max(0.0, (way - drift) / scale)
    deviation = odometry.heading_drift**2 * way + odometry.turn_drift**2 * abs(turn)
    noise = np.sqrt(deviation) * random.standard_normal()
    true_turn = (turn - bend * way - noise) / turn_scale
    moved(trace.reported, n, way, aside, turn)
    moved(trace.truth, n, true_way, aside, true_turn)
    trace.counts[TICKS] = n + 1
    x, y, heading = trace.truth[n]
    enough = margin_at(surroundings, body, x, y, heading, 0.0)
    x, y, heading = trace.truth[n + 1]
    if margin_at(surroundings, body, x, y, heading, enough) < enough:  # a wall is in the way
        for axis in range(3):
            trace.truth[n + 1, axis] = trace.truth[n, axis]


@njit(nogil=True, cache=True)
def moved(poses: Floats, n: int, way: float, aside: float, turn: float) -> None:
    """Write the pose after `n`."""
    middle = poses[n, 2] + turn / 2 + aside
    poses[n + 1, 0] = poses[n, 0] + way * np.cos(middle)
    poses[n + 1, 1] = poses[n, 1] + way * np.sin(middle)
    poses[n + 1, 2] = poses[n, 2] + turn


@njit(nogil=True, cache=True, error_model="numpy")
def follow(
    random: Random,
    sensing: Random,
    path: Floats,
    surroundings: Surroundings,
    body: Body,
    period: int,
    frame: Floats,
    tracker: Tracker,
    scores: BeamScores,
    lidar: Lidar,
    disturbances: BeamDisturbances,
    odometry: Odometry,
    settings: Filter,
    perfect: bool,
    trace: Trace,
) -> int:
    """Drive until a plan is needed or the drive has ended, which the returned decision says.

    Parameters
    ----------
    random, sensing : numpy.random.Generator
        Source of the random numbers of odometry, and of those of the lidar and the filter.
    path, surroundings, body, period, trace
        As for `decide`.
    frame : (3,) array
        Pose of the filter map's own axes in the part that is driven in [m, m, rad].
    tracker : Tracker
        The filter, begun.
    scores, lidar, disturbances, odometry, settings
        As for `drives.drive`.
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
            due = is_due(tracker, trace.reported, n, settings)
            if due:
                advance(sensing, tracker, trace.reported, n, settings)
            if due or n == 0:
                x, y, cell[2] = trace.truth[n]
                cell[0], cell[1] = y / resolution, x / resolution
                measured_ends(sensing, squares, resolution, cell, lidar, disturbances, ends)
                for b in range(len(ends)):
                    ends[b, 0] *= finer
                    ends[b, 1] *= finer
                correct(sensing, tracker, scores, ends, n, settings)
            believe(estimate(tracker, trace.reported, n), frame, trace)
        decision = decide(path, surroundings, body, period, trace)
        if decision != GO:
            return decision
        act(random, surroundings, body, odometry, trace)


@njit(nogil=True, cache=True)
def believe(pose: tuple[float, float, float], frame: Floats, trace: Trace) -> None:
    """Write the filter's pose, which is in its own map's axes, into the trace."""
    n = trace.counts[TICKS]
    cos, sin = np.cos(frame[2]), np.sin(frame[2])
    trace.believed[n, 0] = frame[0] + cos * pose[0] - sin * pose[1]
    trace.believed[n, 1] = frame[1] + sin * pose[0] + cos * pose[1]
    trace.believed[n, 2] = frame[2] + pose[2]

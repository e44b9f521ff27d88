"""What objects would tell a robot along its routes.

A robot looks around at poses along its routes, by rays that are evenly spaced. Of each ray its
hit is known: the range, the surface's normal n, and the turn h x n, h counted from the robot's
centre, so that g = (n_x, n_y, h x n) is the gradient of the end's distance from the surface (as in
`information`). An object changes the rays that meet it before what they hit, and no others: it
adds g g^T of its own surface, and takes away that of what was hit.

Lengths are in metres, in the map's own axes: x along the columns, y along the rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from locplan._kernels.rays import cast

RANGE, NORMAL_X, NORMAL_Y, TURN = 0, 1, 2, 3
"""Columns of a hit; the range is infinite and all else 0 without one."""
XX, XY, YY, XT, YT, TT, HITS = 0, 1, 2, 3, 4, 5, 6
"""Columns of the sums over the rays of a pose."""


class Rays(NamedTuple):
    """The poses of the robot, and the rays at each."""

    poses: NDArray[np.float64]  # (n, 2) the robot's centre [m]
    levers: NDArray[np.float64]  # (n, 2) the lidar from there [m]
    first: NDArray[np.float64]  # (n,) bearing of the first ray [rad]
    step: float  # from one ray to the next [rad]
    beams: int  # rays at a pose
    all_round: bool  # whether the last ray has the first as its neighbour
    least: float  # nearer returns count as none [m]
    most: float  # greatest range [m]


class Outline(NamedTuple):
    """Outline of the objects: half the extents [m], or the radius of a disc twice."""

    half_length: float
    half_width: float
    is_round: bool


class Told(NamedTuple):
    """How the sum over the rays becomes information: share * sum / (1 + other * hits).

    The hits are those on the map without objects: if those on objects counted, a search would
    rather hide objects from each other than see them well.
    """

    share: float  # [1 / m^2]
    other: float  # how far each further hit lessens what a hit tells


class Motion(NamedTuple):
    """Variances of the motion model per metre, and those at the start."""

    along: float  # [m^2 / m]
    across: float  # [m^2 / m]
    turn: float  # [rad^2 / m]
    start: float  # [m^2]
    start_turn: float  # [rad^2]


@njit(nogil=True, cache=True, error_model="numpy")
def hits_of_map(
    squares: NDArray[np.uint8],
    normals: NDArray[np.float32],
    resolution: float,
    rays: Rays,
    begin: int,
    end: int,
    hits: NDArray[np.float32],
) -> None:
    """Fill the hits (n, beams, 4) of the poses from `begin` to `end` on a map."""
    for n in range(begin, end):
        x, y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
        for b in range(rays.beams):
            bearing = rays.first[n] + b * rays.step
            dx, dy = np.cos(bearing), np.sin(bearing)
            at, row, col = cast(
                squares, y / resolution, x / resolution, dy, dx, rays.most / resolution
            )
            at *= resolution
            hit = hits[n, b]
            if not 0 < at < np.inf or at < rays.least:
                # Nothing is seen behind a wall that is too near.
                hit[RANGE] = at if at < rays.least else np.inf
                hit[NORMAL_X] = hit[NORMAL_Y] = hit[TURN] = 0.0
                continue
            nx, ny = np.float64(normals[row, col, 1]), np.float64(normals[row, col, 0])
            hx, hy = rays.levers[n, 0] + at * dx, rays.levers[n, 1] + at * dy
            hit[RANGE], hit[NORMAL_X], hit[NORMAL_Y] = at, nx, ny
            hit[TURN] = hx * ny - hy * nx


@njit(nogil=True, cache=True, error_model="numpy")
def entry(
    outline: Outline, heading: float, x: float, y: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Range at which a ray from (x, y) enters an object at the origin, and the normal there.

    The range is infinite where the ray misses it, or begins within it.
    """
    if outline.is_round:
        along = -(x * dx + y * dy)
        aside = x * dy - y * dx
        inside = outline.half_length**2 - aside * aside
        if inside < 0:
            return np.inf, 0.0, 0.0
        at = along - np.sqrt(inside)
        if at <= 0:
            return np.inf, 0.0, 0.0
        return at, (x + at * dx) / outline.half_length, (y + at * dy) / outline.half_length
    cos, sin = np.cos(heading), np.sin(heading)
    u, v, du, dv = cos * x + sin * y, cos * y - sin * x, cos * dx + sin * dy, cos * dy - sin * dx
    enter_u, leave_u, enter_v, leave_v = -np.inf, np.inf, -np.inf, np.inf
    if du != 0:
        enter_u = (-np.copysign(outline.half_length, du) - u) / du
        leave_u = (np.copysign(outline.half_length, du) - u) / du
    elif abs(u) > outline.half_length:
        return np.inf, 0.0, 0.0
    if dv != 0:
        enter_v = (-np.copysign(outline.half_width, dv) - v) / dv
        leave_v = (np.copysign(outline.half_width, dv) - v) / dv
    elif abs(v) > outline.half_width:
        return np.inf, 0.0, 0.0
    at = max(enter_u, enter_v)
    if at > min(leave_u, leave_v) or at <= 0:
        return np.inf, 0.0, 0.0
    if enter_u > enter_v:
        return at, cos, sin
    return at, -sin, cos


@njit(nogil=True, cache=True, error_model="numpy")
def meeting(rays: Rays, n: int, outline: Outline, x: float, y: float) -> tuple[int, int]:
    """First ray of a pose that may meet an object at (x, y), and how many follow it; or none."""
    reach = outline.half_length
    if not outline.is_round:
        reach = np.hypot(outline.half_length, outline.half_width)
    away_x = x - rays.poses[n, 0] - rays.levers[n, 0]
    away_y = y - rays.poses[n, 1] - rays.levers[n, 1]
    away = np.hypot(away_x, away_y)
    if away - reach > rays.most:
        return 0, 0
    if away <= reach:
        return 0, rays.beams
    half = np.arcsin(reach / away) / rays.step
    middle = (np.arctan2(away_y, away_x) - rays.first[n]) / rays.step
    turn = 2 * np.pi / rays.step
    middle -= turn * np.floor((middle - half) / turn)
    begin, end = int(np.ceil(middle - half - 1e-6)), int(np.floor(middle + half + 1e-6))
    if rays.all_round:
        return begin, min(end - begin + 1, rays.beams)
    if begin >= rays.beams:  # it may still reach over the first ray from behind
        begin, end = 0, int(np.floor(middle + half + 1e-6 - turn))
    end = min(end, rays.beams - 1)
    return begin, max(end - begin + 1, 0)


@njit(nogil=True, cache=True, error_model="numpy")
def add_object(
    hits: NDArray[np.float32],
    rays: Rays,
    outline: Outline,
    x: float,
    y: float,
    heading: float,
) -> None:
    """Change the hits (n, beams, 4) as an object at (x, y) does."""
    for n in range(rays.first.size):
        begin, count = meeting(rays, n, outline, x, y)
        from_x, from_y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
        for k in range(count):
            b = (begin + k) % rays.beams
            bearing = rays.first[n] + b * rays.step
            dx, dy = np.cos(bearing), np.sin(bearing)
            at, nx, ny = entry(outline, heading, from_x - x, from_y - y, dx, dy)
            hit = hits[n, b]
            if at >= hit[RANGE] or at > rays.most:
                continue
            if at < rays.least:
                nx, ny = 0.0, 0.0
            hx, hy = rays.levers[n, 0] + at * dx, rays.levers[n, 1] + at * dy
            hit[RANGE], hit[NORMAL_X], hit[NORMAL_Y] = at, nx, ny
            hit[TURN] = hx * ny - hy * nx


@njit(nogil=True, cache=True, error_model="numpy")
def sums_of(hits: NDArray[np.float32], least: float) -> NDArray[np.float64]:
    """Sums of g g^T over the rays of each pose, and the number of its hits, (n, 7)."""
    sums = np.zeros((hits.shape[0], 7))
    for n in range(hits.shape[0]):
        for b in range(hits.shape[1]):
            _change(sums[n], hits[n, b], 1.0, least)
            if least <= hits[n, b, RANGE] < np.inf:
                sums[n, HITS] += 1
    return sums


@njit(inline="always")
def _change(sums: NDArray[np.float64], hit: NDArray[np.float32], sign: float, least: float) -> None:
    """Add a hit to the sums of a pose, or take it away."""
    if least <= hit[RANGE] < np.inf:
        nx, ny = np.float64(hit[NORMAL_X]), np.float64(hit[NORMAL_Y])
        turn = np.float64(hit[TURN])
        sums[XX] += sign * nx * nx
        sums[XY] += sign * nx * ny
        sums[YY] += sign * ny * ny
        sums[XT] += sign * nx * turn
        sums[YT] += sign * ny * turn
        sums[TT] += sign * turn * turn


@njit(nogil=True, cache=True, error_model="numpy")
def with_object(
    sums: NDArray[np.float64],
    hits: NDArray[np.float32],
    rays: Rays,
    n: int,
    outline: Outline,
    x: float,
    y: float,
    heading: float,
    changed: NDArray[np.float64],
) -> bool:
    """Write a pose's sums with an object at (x, y) into `changed` (7,); False if they stay.

    The number of hits stays in any case: it is that on the map without objects.
    """
    begin, count = meeting(rays, n, outline, x, y)
    if count == 0:
        return False
    for k in range(7):
        changed[k] = sums[n, k]
    any_ray = False
    new = np.zeros(4, np.float32)
    from_x, from_y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
    for k in range(count):
        b = (begin + k) % rays.beams
        bearing = rays.first[n] + b * rays.step
        dx, dy = np.cos(bearing), np.sin(bearing)
        at, nx, ny = entry(outline, heading, from_x - x, from_y - y, dx, dy)
        if at >= hits[n, b, RANGE] or at > rays.most:
            continue
        any_ray = True
        _change(changed, hits[n, b], -1.0, rays.least)
        hx, hy = rays.levers[n, 0] + at * dx, rays.levers[n, 1] + at * dy
        new[RANGE], new[NORMAL_X], new[NORMAL_Y] = at, nx, ny
        new[TURN] = hx * ny - hy * nx
        _change(changed, new, 1.0, rays.least)
    return any_ray


@njit(nogil=True, cache=True, error_model="numpy")
def update(p: NDArray[np.float64], sums: NDArray[np.float64], told: Told) -> None:
    """Turn a covariance P (6,) [xx, xy, yy, xt, yt, tt] into (P^-1 + I)^-1, I of the sums (7,)."""
    share = told.share / (1 + told.other * max(sums[HITS], 0.0))
    _invert(p)
    for k in range(6):
        p[k] += share * sums[k]
    _invert(p)


@njit(inline="always")
def _invert(m: NDArray[np.float64]) -> None:
    """Invert a symmetric matrix (6,) in place."""
    a, b, d, c, e, f = m[XX], m[XY], m[YY], m[XT], m[YT], m[TT]
    one, two, three = d * f - e * e, c * e - b * f, b * e - c * d
    factor = 1 / (a * one + b * two + c * three)
    m[XX], m[XY], m[XT] = one * factor, two * factor, three * factor
    m[YY], m[YT], m[TT] = (
        (a * f - c * c) * factor,
        (b * c - a * e) * factor,
        (a * d - b * b) * factor,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def move(p: NDArray[np.float64], dx: float, dy: float, motion: Motion) -> None:
    """Turn a covariance P (6,) into F P F^T + Q ds, as the robot moves by (dx, dy)."""
    way = np.hypot(dx, dy)
    xt, yt, tt = p[XT], p[YT], p[TT]
    p[XX] += -2 * dy * xt + dy * dy * tt
    p[XY] += dx * xt - dy * yt - dx * dy * tt
    p[YY] += 2 * dx * yt + dx * dx * tt
    p[XT] -= dy * tt
    p[YT] += dx * tt
    if way > 0:
        cos, sin = dx / way, dy / way
        along, across = motion.along * way, motion.across * way
        p[XX] += along * cos * cos + across * sin * sin
        p[XY] += (along - across) * cos * sin
        p[YY] += along * sin * sin + across * cos * cos
        p[TT] += motion.turn * way


@njit(nogil=True, cache=True, error_model="numpy")
def covariances(
    sums: NDArray[np.float64],
    poses: NDArray[np.float64],
    routes: NDArray[np.int64],
    told: Told,
    motion: Motion,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Covariances (n, 6) before and after each look around, along routes.

    `routes` (r + 1,) are the indices at which the routes begin, and the number of all poses.
    """
    before, after = np.zeros((len(sums), 6)), np.zeros((len(sums), 6))
    p = np.zeros(6)
    for r in range(routes.size - 1):
        _begin(p, motion)
        for n in range(routes[r], routes[r + 1]):
            if n > routes[r]:
                move(p, poses[n, 0] - poses[n - 1, 0], poses[n, 1] - poses[n - 1, 1], motion)
            for k in range(6):
                before[n, k] = p[k]
            update(p, sums[n], told)
            for k in range(6):
                after[n, k] = p[k]
    return before, after


@njit(inline="always")
def _begin(p: NDArray[np.float64], motion: Motion) -> None:
    for k in range(6):
        p[k] = 0.0
    p[XX] = p[YY] = motion.start
    p[TT] = motion.start_turn


@njit(nogil=True, cache=True, error_model="numpy")
def uncertainties(
    candidates: NDArray[np.float64],
    hits: NDArray[np.float32],
    sums: NDArray[np.float64],
    rays: Rays,
    routes: NDArray[np.int64],
    outline: Outline,
    told: Told,
    motion: Motion,
) -> NDArray[np.float64]:
    """Mean of P_xx + P_yy over all poses with each candidate besides, (m,) [m^2].

    Parameters
    ----------
    candidates : (m, 3) array
        x, y and heading of each [m, m, rad].
    hits : (n, beams, 4) array
        Hits on the map and the objects that stand already.
    sums : (n, 7) array
        What `sums_of` makes of them.
    rays, routes, outline, told, motion
        The poses and their rays, see `covariances`, the object, and the models.
    """
    before, after = covariances(sums, rays.poses, routes, told, motion)
    count = len(sums)
    total = 0.0
    for n in range(count):
        total += after[n, XX] + after[n, YY]
    result = np.empty(len(candidates))
    changed, p = np.empty(7), np.empty(6)
    for m in range(len(candidates)):
        x, y, heading = candidates[m, 0], candidates[m, 1], candidates[m, 2]
        value = total
        for r in range(routes.size - 1):
            differs = False
            for n in range(routes[r], routes[r + 1]):
                if differs:
                    move(
                        p,
                        rays.poses[n, 0] - rays.poses[n - 1, 0],
                        rays.poses[n, 1] - rays.poses[n - 1, 1],
                        motion,
                    )
                meets = with_object(sums, hits, rays, n, outline, x, y, heading, changed)
                if meets and not differs:
                    differs = True
                    for k in range(6):
                        p[k] = before[n, k]
                if not differs:
                    continue
                update(p, changed if meets else sums[n], told)
                value += p[XX] + p[YY] - after[n, XX] - after[n, YY]
        result[m] = value / count
    return result

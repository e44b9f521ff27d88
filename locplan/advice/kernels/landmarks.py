"""Information that objects add to a robot's scans along its routes.

A robot scans at poses along its routes, with evenly spaced rays. The hit of each ray holds the
range, the surface's normal n, and the turn h x n, with h measured from the robot's centre. Thus g =
(n_x, n_y, h x n) is the gradient of the end's distance from the surface (see
`locplan._support.kernels.lidar`). An object changes only the rays that meet it before their hit: it
adds g g^T of its surface, and removes g g^T of the hit. Far hits weigh less: a filter's heading has
a new error at every update, and a beam's end swings by this error times its range.

Lengths are in metres, in the axes of the map: x along the columns, y along the rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Bools, Floats, Ints, Numbers, Octets, Singles
from locplan._support.kernels.rays import cast_ray

RANGE, NORMAL_X, NORMAL_Y, TURN = 0, 1, 2, 3
"""Columns of a hit; the range is infinite and all else 0 without one."""
XX, XY, YY, XT, YT, TT, HITS = 0, 1, 2, 3, 4, 5, 6
"""Columns of the sums over the rays of a pose."""


class RouteRays(NamedTuple):
    """The poses of the robot on its routes, and the rays at each pose."""

    poses: Floats  # (n, 2) the robot's centre [m]
    levers: Floats  # (n, 2) the lidar from the robot's centre [m]
    first: Floats  # (n,) bearing of the first ray [rad]
    step: float  # from one ray to the next [rad]
    beams: int  # rays at a pose
    all_round: bool  # True if the last ray is next to the first
    min_range: float  # nearer returns count as none [m]
    max_range: float  # maximum range [m]
    swing: float  # a beam of range r has the weight 1 / (1 + swing r^2) [1 / m^2]


class MapSurfaces(NamedTuple):
    """Surfaces of a map, for rays."""

    squares: Octets  # (4, H + 2, W + 2) see `rays.compute_empty_squares`
    normals: Singles  # (H, W, 2) unit normals (row, col) of the cells that stop a ray
    resolution: float  # edge of a cell [m]


class ObjectOutline(NamedTuple):
    """Outline of an object: half of its extents [m], or the radius of a disc twice."""

    half_length: float
    half_width: float
    is_round: bool


@njit(nogil=True, cache=True, error_model="numpy")
def cast_map_hits(surfaces: MapSurfaces, rays: RouteRays, hits: Singles) -> None:
    """Fill the hits (n, beams, 4) of all poses on a map."""
    for n in range(len(hits)):
        for b in range(rays.beams):
            _write_hit(surfaces, rays, n, b, hits[n, b])


@njit(nogil=True, cache=True, error_model="numpy")
def _write_hit(
    surfaces: MapSurfaces, rays: RouteRays, pose_number: int, ray_number: int, hit: Singles
) -> None:
    """Write the hit (4,) of a ray on a map."""
    squares, normals, resolution = surfaces
    x, y = (
        rays.poses[pose_number, 0] + rays.levers[pose_number, 0],
        rays.poses[pose_number, 1] + rays.levers[pose_number, 1],
    )
    bearing = rays.first[pose_number] + ray_number * rays.step
    dx, dy = np.cos(bearing), np.sin(bearing)
    at, row, col = cast_ray(
        squares, y / resolution, x / resolution, dy, dx, rays.max_range / resolution
    )
    at *= resolution
    if not 0 < at < np.inf or at < rays.min_range:
        # Nothing is seen behind a wall that is too near.
        hit[RANGE] = at if at < rays.min_range else np.inf
        hit[NORMAL_X] = hit[NORMAL_Y] = hit[TURN] = 0.0
        return
    nx, ny = np.float64(normals[row, col, 1]), np.float64(normals[row, col, 0])
    _set_hit(hit, rays, pose_number, at, dx, dy, nx, ny)


@njit(inline="always")
def _set_hit(
    hit: Singles,
    rays: RouteRays,
    pose_number: int,
    hit_range: float,
    dx: float,
    dy: float,
    nx: float,
    ny: float,
) -> None:
    """Write a hit at a range in the direction (dx, dy), with the surface's normal."""
    hx, hy = (
        rays.levers[pose_number, 0] + hit_range * dx,
        rays.levers[pose_number, 1] + hit_range * dy,
    )
    hit[RANGE], hit[NORMAL_X], hit[NORMAL_Y] = hit_range, nx, ny
    hit[TURN] = hx * ny - hy * nx


@njit(nogil=True, cache=True, error_model="numpy")
def intersect_object(
    outline: ObjectOutline, cos: float, sin: float, x: float, y: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Return the range of an object at the origin along a ray from (x, y), and its normal.

    `cos` and `sin` are of the object's heading. The range is infinite if the ray misses the object,
    or starts inside it.
    """
    if outline.is_round:
        along = -(x * dx + y * dy)
        lateral = x * dy - y * dx
        inside = outline.half_length**2 - lateral * lateral
        if inside < 0:
            return np.inf, 0.0, 0.0
        at = along - np.sqrt(inside)
        if at <= 0:
            return np.inf, 0.0, 0.0
        return at, (x + at * dx) / outline.half_length, (y + at * dy) / outline.half_length
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
def find_rays_towards_object(
    rays: RouteRays, pose_number: int, outline: ObjectOutline, x: float, y: float
) -> tuple[int, int]:
    """Return the first ray of a pose that may meet an object at (x, y), and their number."""
    reach = outline.half_length
    if not outline.is_round:
        reach = np.hypot(outline.half_length, outline.half_width)
    offset_x = x - rays.poses[pose_number, 0] - rays.levers[pose_number, 0]
    offset_y = y - rays.poses[pose_number, 1] - rays.levers[pose_number, 1]
    distance = np.hypot(offset_x, offset_y)
    if distance - reach > rays.max_range:
        return 0, 0
    if distance <= reach:
        return 0, rays.beams
    half = np.arcsin(reach / distance) / rays.step
    middle = (np.arctan2(offset_y, offset_x) - rays.first[pose_number]) / rays.step
    turn = 2 * np.pi / rays.step
    middle -= turn * np.floor((middle - half) / turn)
    begin, end = int(np.ceil(middle - half - 1e-6)), int(np.floor(middle + half + 1e-6))
    if rays.all_round:
        return begin, min(end - begin + 1, rays.beams)
    from_behind = int(np.floor(middle + half + 1e-6 - turn))
    if begin < rays.beams <= end and from_behind >= 0:
        return 0, rays.beams  # it reaches into the view at both ends
    if begin >= rays.beams:  # it may still reach over the first ray from behind
        begin, end = 0, from_behind
    end = min(end, rays.beams - 1)
    return begin, max(end - begin + 1, 0)


@njit(nogil=True, cache=True, error_model="numpy")
def add_object_to_hits(
    hits: Singles,
    rays: RouteRays,
    outline: ObjectOutline,
    x: float,
    y: float,
    heading: float,
    is_changed: Bools,
) -> None:
    """Change the hits (n, beams, 4) by an object at (x, y), and mark the affected poses, (n,)."""
    cos, sin = np.cos(heading), np.sin(heading)
    for n in range(rays.first.size):
        begin, count = find_rays_towards_object(rays, n, outline, x, y)
        from_x, from_y = rays.poses[n, 0] + rays.levers[n, 0], rays.poses[n, 1] + rays.levers[n, 1]
        for k in range(count):
            b = (begin + k) % rays.beams
            bearing = rays.first[n] + b * rays.step
            dx, dy = np.cos(bearing), np.sin(bearing)
            at, nx, ny = intersect_object(outline, cos, sin, from_x - x, from_y - y, dx, dy)
            hit = hits[n, b]
            if at >= hit[RANGE] or at > rays.max_range:
                continue
            is_changed[n] = True
            if at < rays.min_range:
                nx, ny = 0.0, 0.0
            _set_hit(hit, rays, n, at, dx, dy, nx, ny)


@njit(inline="always")
def _add_to_sums(sums: Floats, hit: Singles, sign: float, rays: RouteRays) -> None:
    """Add a hit to the sums of a pose; subtract it if `sign` is -1."""
    if rays.min_range <= hit[RANGE] < np.inf:
        sign /= 1 + rays.swing * np.float64(hit[RANGE]) ** 2
        nx, ny = np.float64(hit[NORMAL_X]), np.float64(hit[NORMAL_Y])
        turn = np.float64(hit[TURN])
        sums[XX] += sign * nx * nx
        sums[XY] += sign * nx * ny
        sums[YY] += sign * ny * ny
        sums[XT] += sign * nx * turn
        sums[YT] += sign * ny * turn
        sums[TT] += sign * turn * turn


@njit(nogil=True, cache=True, error_model="numpy")
def write_hit_sums(hits: Singles, rays: RouteRays, is_changed: Bools, sums: Floats) -> None:
    """Write the weighted sums of g g^T and the number of hits of touched poses, (n, 7)."""
    for n in range(hits.shape[0]):
        if not is_changed[n]:
            continue
        for k in range(7):
            sums[n, k] = 0.0
        for b in range(hits.shape[1]):
            _add_to_sums(sums[n], hits[n, b], 1.0, rays)
            if rays.min_range <= hits[n, b, RANGE] < np.inf:
                sums[n, HITS] += 1


@njit(nogil=True, cache=True, error_model="numpy")
def sum_hits(hits: Singles, rays: RouteRays) -> Floats:
    """Return the weighted sums of g g^T and the number of hits of each pose, (n, 7)."""
    sums = np.zeros((hits.shape[0], 7))
    write_hit_sums(hits, rays, np.ones(hits.shape[0], np.bool_), sums)
    return sums


class ObjectSightings(NamedTuple):
    """The poses that see each object, in order, and their rays that meet it."""

    starts: Ints  # (m + 1,) index of each object's first sighting
    poses: NDArray[np.int32]  # (k,) the pose
    rays: NDArray[np.int16]  # (k, 2) the first ray and the number of rays


@njit(nogil=True, cache=True, error_model="numpy")
def find_shortened_rays(
    hits: Singles,
    rays: RouteRays,
    pose_number: int,
    outline: ObjectOutline,
    x: float,
    y: float,
    heading: float,
) -> tuple[int, int]:
    """Return the first ray that an object at (x, y) shortens, and the number to the last; or 0."""
    begin, count = find_rays_towards_object(rays, pose_number, outline, x, y)
    from_x, from_y = (
        rays.poses[pose_number, 0] + rays.levers[pose_number, 0],
        rays.poses[pose_number, 1] + rays.levers[pose_number, 1],
    )
    cos, sin = np.cos(heading), np.sin(heading)
    first, last = -1, -1
    for k in range(count):
        b = (begin + k) % rays.beams
        bearing = rays.first[pose_number] + b * rays.step
        dx, dy = np.cos(bearing), np.sin(bearing)
        at, _, _ = intersect_object(outline, cos, sin, from_x - x, from_y - y, dx, dy)
        if at < hits[pose_number, b, RANGE] and at <= rays.max_range:
            first, last = k if first < 0 else first, k
    if first < 0:
        return 0, 0
    return (begin + first) % rays.beams, last - first + 1


@njit(nogil=True, cache=True, error_model="numpy")
def find_sightings(
    candidates: Floats,
    begin: int,
    end: int,
    hits: Singles,
    rays: RouteRays,
    outline: ObjectOutline,
    sightings: ObjectSightings,
    counts: Ints,
) -> None:
    """Count the poses that see each candidate (x, y, heading) from `begin` to `end`, (m,).

    If `sightings` has space, they are written as well. Counting comes first, since all of them may
    not fit into memory.
    """
    has_room = sightings.poses.size > 0
    for m in range(begin, end):
        x, y, heading = candidates[m, 0], candidates[m, 1], candidates[m, 2]
        at = sightings.starts[m]
        for n in range(rays.first.size):
            first, count = find_shortened_rays(hits, rays, n, outline, x, y, heading)
            if count > 0:
                if has_room:
                    sightings.poses[at] = n
                    sightings.rays[at, 0], sightings.rays[at, 1] = first, count
                at += 1
        counts[m] = at - sightings.starts[m]


class LandmarkScene(NamedTuple):
    """Hits on the map and its objects, and the outline of further objects."""

    hits: Singles  # (n, beams, 4) on the map and the objects
    sums: Floats  # (n, 7), see `sum_hits`
    rays: RouteRays
    outline: ObjectOutline


@njit(nogil=True, cache=True, error_model="numpy")
def write_object_sums(
    scene: LandmarkScene,
    pose_number: int,
    place: Numbers,
    begin: int,
    count: int,
    changed_sums: Floats,
) -> bool:
    """Write a pose's sums with one more object into `changed_sums` (7,); False if nothing changes.

    `place` is (x, y, heading). `count` rays from `begin` on may meet the object, see
    `find_rays_towards_object`. The number of hits never changes: it counts hits on the map without
    objects.
    """
    hits, sums, rays, outline = scene
    x, y, heading = place
    for k in range(7):
        changed_sums[k] = sums[pose_number, k]
    any_ray = False
    new = np.zeros(4, np.float32)
    from_x, from_y = (
        rays.poses[pose_number, 0] + rays.levers[pose_number, 0],
        rays.poses[pose_number, 1] + rays.levers[pose_number, 1],
    )
    cos, sin = np.cos(rays.step), np.sin(rays.step)
    heading_cos, heading_sin = np.cos(heading), np.sin(heading)
    bearing = rays.first[pose_number] + (begin - 1) * rays.step
    dx, dy = np.cos(bearing), np.sin(bearing)
    for k in range(count):
        b = (begin + k) % rays.beams
        dx, dy = cos * dx - sin * dy, sin * dx + cos * dy
        at, nx, ny = intersect_object(
            outline, heading_cos, heading_sin, from_x - x, from_y - y, dx, dy
        )
        if at >= hits[pose_number, b, RANGE] or at > rays.max_range:
            continue
        any_ray = True
        _add_to_sums(changed_sums, hits[pose_number, b], -1.0, rays)
        _set_hit(new, rays, pose_number, at, dx, dy, nx, ny)
        _add_to_sums(changed_sums, new, 1.0, rays)
    return any_ray

"""Failure places of the baseline's drives, and their weak spot or passage."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from string import ascii_uppercase
from typing import NamedTuple

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan.advice.weak_spots import SCANS_FIT, WeakSpot, are_inside, group_positions, sample_path
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED, UNKNOWN
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import (
    ABORTED,
    ARRIVED,
    ELSEWHERE,
    FOLLOWER_FAULT,
    TIMED_OUT,
    WORLD_FAULT,
    Arrivals,
)

LETTERS = ascii_uppercase[:6]
"""Letters of the worst places; further weak spots have none."""
STOP_RADIUS = 2.0
"""Distance within which closed-loop drives stop at one place [m]."""
STOP_TEXTS = {
    ELSEWHERE: "stop in the wrong place",
    ABORTED: "are aborted",
    TIMED_OUT: "run out of time",
    FOLLOWER_FAULT: "fail even with perfect localization",
}
"""Failure of closed-loop drives in words, by their outcome or fault."""


def attribute_failures(
    spots: Sequence[WeakSpot],
    paths: Mapping[str, Path],
    loss_distances: Sequence[Floats],
    arrivals: Mapping[str, Arrivals],
    grid: OccupancyGrid,
) -> tuple[tuple[WeakSpot, ...], list[RouteFailures]]:
    """Find the places where drives fail, the worst first.

    A lost drive counts for the spot that it left last. Otherwise its position becomes a new spot.
    Places where at least two closed-loop drives stop short of the goal are also spots.

    Parameters
    ----------
    spots : sequence of WeakSpot
        The weak spots.
    paths : mapping of str to Path
        The routes by name.
    loss_distances : sequence of (drives,) array
        Distance along each route where each drive got lost [m]; NaN if it did not.
    arrivals : mapping of str to Arrivals
        Closed-loop drives along each route; empty if none were simulated.
    grid : OccupancyGrid
        The map. Unknown cells stop no drive.

    Returns
    -------
    spots, failures
        The spots with letters and the numbers of failed drives, and the failures of each route.
    """
    lines = {name: sample_path(path) for name, path in paths.items()}
    wide = 0.08 * float(np.ptp(np.concatenate([*lines.values()]), axis=0).max())
    blames = [
        _attribute_losses(spots, line, paths[name].length, at[np.isfinite(at)])
        for (name, line), at in zip(lines.items(), loss_distances, strict=True)
    ]
    loss_positions = [positions for _, positions in blames]
    owner, all_positions = (np.concatenate(parts) for parts in zip(*blames, strict=True))
    places = [
        _move_spot_to_losses(spot, all_positions[owner == n], wide) for n, spot in enumerate(spots)
    ]
    unowned = np.flatnonzero(owner < 0)
    for at, members in group_positions(all_positions[unowned], wide):
        owner[unowned[members]] = len(places)
        near = {name: np.linalg.norm(line - at, axis=1).min() for name, line in lines.items()}
        passing = tuple(name for name, distance in near.items() if distance <= wide)
        places.append(_make_spot_without_area(at, SCANS_FIT, passing, lost=len(members)))
    stops = _collect_stops(arrivals)
    stop_owner = np.full(len(stops), -1)
    for at, members in group_positions(
        np.array([stop.xy for stop in stops]).reshape(-1, 2), STOP_RADIUS
    ):
        if len(members) >= 2:
            stop_owner[members] = len(places)
            stopping = _describe_stops([stops[n].outcome for n in members])
            row, col = np.floor(grid.world_to_grid(*at)).astype(int)
            if not (grid.contains(row, col) and grid.cells[row, col] != UNKNOWN):
                stopping += ", outside the mapped area"
            passing = tuple(dict.fromkeys(stops[n].route for n in members))
            places.append(_make_spot_without_area(at, stopping, passing, stopped=len(members)))
    order = sorted(range(len(places)), key=lambda n: places[n].severity, reverse=True)
    letters = dict(zip(order, LETTERS, strict=False))
    failures = []
    ends = np.cumsum([len(positions) for positions in loss_positions])[:-1]
    for name, positions, owners in zip(paths, loss_positions, np.split(owner, ends), strict=True):
        numbers = [n for n, stop in enumerate(stops) if stop.route == name]
        stopped_at = np.array([stops[n].xy for n in numbers]).reshape(-1, 2)
        near_to = [_list_main_letters(owned, letters) for owned in (owners, stop_owner[numbers])]
        failures.append(RouteFailures(near_to[0], positions, near_to[1], stopped_at))
    return tuple(replace(places[n], letter=letters.get(n, "")) for n in order), failures


class RouteFailures(NamedTuple):
    """Failures of the drives along one route."""

    lost_near: str
    """Letters of the places with a quarter of its lost drives or more."""
    lost_at: Floats
    """Positions where drives got lost, (n, 2) [m]."""
    stopped_near: str
    """Letters of the places where a quarter of its stopped drives or more stop."""
    stopped_at: Floats
    """Positions where closed-loop drives miss the goal, (n, 2) [m]."""


class _DriveStop(NamedTuple):
    """The end of a closed-loop drive that does not reach the goal."""

    route: str
    outcome: str
    xy: tuple[float, float]


def _collect_stops(arrivals: Mapping[str, Arrivals]) -> list[_DriveStop]:
    """Return the drives that miss the goal although their world has a way to it."""
    return [
        _DriveStop(name, drive.fault or drive.outcome, drive.end[:2])
        for name, drives in arrivals.items()
        for drive in drives.drives
        if drive.outcome != ARRIVED and drive.fault != WORLD_FAULT
    ]


def _describe_stops(outcomes: Sequence[str]) -> str:
    """Return how drives fail at a place, by their outcomes or faults."""
    (main, count), *others = Counter(outcomes).most_common()
    if not others:
        return f"drives {STOP_TEXTS[main]}"
    most = f", most {STOP_TEXTS[main]}" if 2 * count > len(outcomes) else ""
    return f"drives miss the goal{most}"


def _make_spot_without_area(
    position: Floats, missing: str, routes: tuple[str, ...], *, lost: int = 0, stopped: int = 0
) -> WeakSpot:
    x, y = position.tolist()
    return WeakSpot(
        letter="",
        x=x,
        y=y,
        length=0.0,
        width=0.0,
        direction=math.nan,
        position_std=math.nan,
        heading_std=math.nan,
        missing=missing,
        routes=routes,
        outline=np.empty((0, 2)),
        lost=lost,
        stopped=stopped,
    )


def _list_main_letters(owners: Ints, letters: Mapping[int, str]) -> str:
    """Return the letters of the places with at least a quarter of a route's failures."""
    counts = Counter[int](owners.tolist()).most_common()
    place_letters = [letters.get(n, "") for n, count in counts if count >= 0.25 * len(owners)]
    return ", ".join(filter(None, place_letters))


def _attribute_losses(
    spots: Sequence[WeakSpot], route_points: Floats, length: float, loss_distances: Floats
) -> tuple[Ints, Floats]:
    """Return the spot that each lost drive left last, or -1, and the position of its loss."""
    distance = np.linspace(0, length, len(route_points))
    since = loss_distances[:, None] - distance
    # A robot drives up to 10 m from a spot until it is lost because of it.
    near = (since >= -0.5) & (since <= 10.0)
    spot_distances = [
        np.where(near & are_inside(spot, route_points), distance, -1.0).max(axis=1)
        for spot in spots
    ]
    owner = np.argmax([np.full(len(loss_distances), -0.5), *spot_distances], axis=0) - 1
    return owner, np.column_stack(
        [np.interp(loss_distances, distance, spot) for spot in route_points.T]
    )


def _move_spot_to_losses(spot: WeakSpot, loss_positions: Floats, wide: float) -> WeakSpot:
    """Return a spot with its lost drives, moved to their densest place."""
    inner_positions = loss_positions[are_inside(spot, loss_positions)]
    at = group_positions(inner_positions, wide)[0][0] if len(inner_positions) else (spot.x, spot.y)
    return replace(spot, x=float(at[0]), y=float(at[1]), lost=len(loss_positions))


NARROW_ROOM = 0.3
"""Maximum free width of a narrow passage beyond the robot's width [m]."""
NEAR, REACH = 3.0, 3.0
"""Maximum distance of the passage from the ends of the drives, and of its walls [m]."""


class FailurePassage(NamedTuple):
    """The place where most drives fail even with perfect localization."""

    x: float
    """World x of its narrowest point on the path [m]."""
    y: float
    """World y of it [m]."""
    width: float
    """Distance between its walls [m]; infinite if none are near."""
    robot_width: float
    """Width of the robot [m]."""
    n_drives: int
    """Number of closed-loop drives that fail near it even with perfect localization."""
    routes: tuple[str, ...]
    """Names of their routes."""

    @property
    def is_narrow(self) -> bool:
        """True if the robot has little room in it."""
        return self.width < self.robot_width + NARROW_ROOM


def find_failure_passage(
    grid: OccupancyGrid, robot: Robot, paths: Mapping[str, Path], arrivals: Mapping[str, Arrivals]
) -> FailurePassage | None:
    """Find the place where most drives fail even with perfect localization.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot
        The robot.
    paths : mapping of str to Path
        The path of each route by its name.
    arrivals : mapping of str to Arrivals
        Closed-loop drives along each route.

    Returns
    -------
    Passage or None
        None if no drive fails with perfect localization.
    """
    ends = [
        (name, drive.end[:2])
        for name, drives in arrivals.items()
        for drive in drives.drives
        if drive.fault
    ]
    if not ends:
        return None
    middle, members = group_positions(np.array([end for _, end in ends]), STOP_RADIUS)[0]
    routes = tuple(dict.fromkeys(ends[n][0] for n in members))
    # A wall may be a cell thick.
    points = np.concatenate([paths[name].resample(grid.resolution).xy for name in routes])
    near = np.linalg.norm(points - middle, axis=1) <= NEAR
    points = points[near] if near.any() else points
    widths = measure_width(grid, points)
    x, y = points[widths.argmin()].tolist()
    radius = robot.radius - robot.margin
    return FailurePassage(x, y, float(widths.min()), 2 * radius, len(members), routes)


def measure_width(grid: OccupancyGrid, points: Floats) -> Floats:
    """Return the shortest distance between two walls on opposite sides of each point, (n,) [m].

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    points : (n, 2) array
        Positions in the world [m].
    """
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    steps = np.arange(0.0, REACH, grid.resolution / 4)
    offsets = steps[:, None] * np.stack([np.cos(angles), np.sin(angles)])[:, None]
    widths = []
    for x, y in points:
        rows, cols = (
            np.floor(at).astype(int) for at in grid.world_to_grid(x + offsets[0], y + offsets[1])
        )
        rows, cols = (
            np.clip(at, 0, size - 1) for at, size in zip((rows, cols), grid.shape, strict=True)
        )
        is_wall = grid.cells[rows, cols] == OCCUPIED
        distance = np.where(is_wall.any(axis=0), steps[is_wall.argmax(axis=0)], np.inf)
        widths.append((distance[:36] + distance[36:]).min())
    return np.array(widths)

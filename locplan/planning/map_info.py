"""The description of a map before planning: its rooms, levels and main part."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from locplan._support.kernels.arrays import Array, Bools
from locplan._support.public import DrawableResult
from locplan._support.records import POSITION, Table, TableColumn
from locplan._support.tables import format_area, format_table
from locplan.maps import environments
from locplan.maps.files import MapSource, read_map
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.map_faults import faults
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN
from locplan.planning.cost_to_go import NamedPlace, PlacePair, find_farthest_pairs
from locplan.planning.costmap import ROBOT_RADIUS
from locplan.planning.grid import find_map_parts, iterate_bands
from locplan.robots.robot import Robot, format_radius, planning_radius

if TYPE_CHECKING:
    from matplotlib.figure import Figure


INDOOR_SHARE = 0.05
"""Minimum area of rooms or a building within surroundings, as a share of the surroundings' area."""


def find_main_part(
    grid: OccupancyGrid, room_of_cell: Array, areas: Sequence[float]
) -> tuple[int, Bools | None]:
    """Find the largest part of the building that a robot can reach.

    It is the largest room. A room along most of the image's border is the outside of a drawing, or
    a building that is open to it. Then only its cells between walls count.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    room_of_cell : (H, W) array of int
        Number of the room of each cell, from 1 on; 0 where there is none.
    areas : sequence of float
        Area of each room [m^2], the largest first.

    Returns
    -------
    room : int
        Number of the room; 0 without any.
    cells : (H, W) array of bool, or None
        The cells of its main part; None if it is the whole room.
    """
    if not areas:
        return 0, None
    outside = find_outside_room(room_of_cell, len(areas))
    if not outside:
        return 1, None
    inner = [number for number in range(1, len(areas) + 1) if number != outside]
    largest = areas[inner[0] - 1] if inner else 0.0
    indoor = (room_of_cell == outside) & _mark_cells_between_walls(grid)
    indoor_area = float(np.count_nonzero(indoor)) * grid.resolution**2
    if max(largest, indoor_area) < INDOOR_SHARE * areas[outside - 1]:
        return outside, None
    return (outside, indoor) if indoor_area > largest else (inner[0], None)


def find_outside_room(room_of_cell: Array, count: int) -> int:
    """Return the number of the room along most of the image's border, or 0 without one."""
    border = [room_of_cell[0], room_of_cell[-1], room_of_cell[1:-1, 0], room_of_cell[1:-1, -1]]
    cells = np.bincount(np.concatenate(border), minlength=count + 1)
    room = int(cells[1:].argmax()) + 1
    return room if cells[room] > cells.sum() / 2 else 0


def _mark_cells_between_walls(grid: OccupancyGrid) -> Bools:
    """Mark the cells with an occupied cell on all four sides, in their row and column."""
    occupied = grid.cells == OCCUPIED
    between = np.ones(grid.shape, np.bool_)
    for mask, marks in ((occupied, between), (occupied.T, between.T)):
        marks &= np.logical_or.accumulate(mask, axis=1)
        marks &= np.logical_or.accumulate(mask[:, ::-1], axis=1)[:, ::-1]
    return between


MAX_LISTED_ROOMS = 8
"""Number of rooms in the table; the others are summed up."""
LIDAR = "turtlebot4"
"""Preset that stands for the user's lidar in command lines."""


@dataclass(frozen=True)
class Room:
    """A connected part of the space that the robot's centre can enter."""

    number: int
    """Number, from 1 for the largest room on."""
    area: float
    """Area that the robot's centre can reach [m^2]."""


@dataclass(frozen=True)
class LevelArea:
    """The cells of one level."""

    area: float
    """Area of the cells [m^2]."""
    share: float
    """Share of the map's cells, 0..1."""


@dataclass(frozen=True, eq=False, repr=False)
class MapInfo(DrawableResult):
    """Size, levels, rooms and places of a map; made by `describe_map`."""

    grid: OccupancyGrid
    """The map."""
    source: MapSource | None
    """How the file was read; None for a grid that was not."""
    robot_radius: float
    """Minimum distance from the robot's centre to an occupied cell [m]."""
    robot_size: str
    """The same with the robot's margin apart, for people."""
    free: LevelArea
    """The free cells."""
    occupied: LevelArea
    """The occupied cells."""
    unknown: LevelArea
    """The unknown cells."""
    rooms: tuple[Room, ...]
    """The rooms, largest first, without the specks."""
    specks: int
    """Number of specks: rooms too small to count."""
    specks_area: float
    """Area of all specks [m^2]."""
    room_of_cell: Array
    """Number of the room of each cell, (H, W), of an unsigned type; 0 where there is none."""
    pairs: tuple[PlacePair, ...]
    """Pairs of places far apart in the largest rooms, the farthest of each room first."""
    warnings: tuple[str, ...]
    """Faults of the map that mislead a robot, one sentence each."""

    def __repr__(self) -> str:
        rooms = f"{len(self.rooms)} room{'' if len(self.rooms) == 1 else 's'}"
        return f"MapInfo({self.grid!r}, {rooms}, {len(self.warnings)} warnings)"

    @property
    def places(self) -> tuple[NamedPlace, ...]:
        """The named places, in the order of their names."""
        by_name = {place.name: place for pair in self.pairs for place in (pair.start, pair.goal)}
        return tuple(by_name[name] for name in sorted(by_name))

    @property
    def main_part(self) -> Bools:
        """The cells of the largest part of the building that the robot can reach, (H, W)."""
        areas = [room.area for room in self.rooms]
        room, cells = find_main_part(self.grid, self.room_of_cell, areas)
        if cells is None:
            cells = self.room_of_cell == room if room else np.zeros(self.grid.shape, np.bool_)
        return cells

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the image [m], before yaw."""
        rows, cols = self.grid.shape
        return cols * self.grid.resolution, rows * self.grid.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Minimum x and y, maximum x and y of the image in the world [m]."""
        rows, cols = self.grid.shape
        x, y = self.grid.grid_to_world(np.array([0, 0, rows, rows]), np.array([0, cols] * 2))
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())

    def format_plan_command(self, pair: PlacePair) -> str:
        """Return the command line that plans between two places, with `LIDAR` for the user's.

        Parameters
        ----------
        pair : PlacePair
            Start and goal, such as one of `pairs`.
        """
        name = self.grid.name or "MAP"
        file_name = name if name in environments.list_environments() else f"{name}.yaml"
        file = self.source.file if self.source else file_name
        radius = f" --set footprint={self.robot_radius:g} --set margin=0"
        return (
            f"locplan plan {shlex.quote(file)} --start {pair.start.position_argument} --goal"
            f" {pair.goal.position_argument}"
            f" --lidar {LIDAR}{'' if self.robot_radius == ROBOT_RADIUS else radius}"
        )

    def table(self) -> Table:
        """Return the named places."""
        columns = (
            TableColumn("name", title="place"),
            *POSITION,
            TableColumn("room", title="room", digits=0),
        )
        return Table.from_records(columns, self.places)

    def report(self) -> str:
        """Return the information for people, with command lines to copy."""
        parts = [format_table([], self._list_facts()), self._format_rooms()]
        for pair in self.pairs:
            ends = " / ".join(
                f"{place.name} {place.position_argument}" for place in (pair.start, pair.goal)
            )
            digits = 0 if pair.distance >= 9.95 else 1
            parts.append(f"{ends}: {pair.distance:.{digits}f} m by the shortest path")
            parts.append(f"  {self.format_plan_command(pair)}")
        if self.pairs:
            parts.append(
                f"{LIDAR} stands for your lidar, or the robot that carries it (`locplan info`"
                " lists them)."
            )
        return "\n".join([*parts, *(f"warning: {warning}" for warning in self.warnings)])

    def _list_facts(self) -> list[list[str]]:
        """Return the rows about the map as a whole."""
        (rows, cols), (width, height) = self.grid.shape, self.size
        x, y, yaw = self.grid.origin
        x_min, y_min, x_max, y_max = self.extent
        facts = [
            ["map", self.grid.name],
            ["size", f"{cols} x {rows} cells, {width:.2f} x {height:.2f} m"],
            ["resolution", f"{self.grid.resolution:g} m a cell"],
            ["origin", f"x {x:g} m, y {y:g} m, yaw {math.degrees(yaw):g} deg"],
            ["covers", f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"],
        ]
        for name in ("free", "occupied", "unknown"):
            level = getattr(self, name)
            facts.append([name, f"{format_area(level.area)} ({level.share:.1%})"])
        if source := self.source:
            mode = f"mode {source.mode}{', negate' if source.negate else ''}"
            free, occupied = f"{source.free_thresh:g}", f"{source.occupied_thresh:g}"
            thresholds = f"free_thresh {free}, occupied_thresh {occupied}"
            facts.append(["read with", f"{mode}, {thresholds}"])
        return facts

    def _format_rooms(self) -> str:
        """Return the rooms, with the small ones summed up."""
        robot_text = f"for a robot of radius {self.robot_size}"
        if not self.rooms:
            return f"no room {robot_text}"
        rows = []
        for room in self.rooms[:MAX_LISTED_ROOMS]:
            places = ", ".join(place.name for place in self.places if place.room == room.number)
            rows.append([str(room.number), format_area(room.area), places or "–"])
        if further_rooms := self.rooms[MAX_LISTED_ROOMS:]:
            area = sum(room.area for room in further_rooms)
            rows.append([f"{len(further_rooms)} more", format_area(area), "–"])
        if self.specks:
            name = "1 speck" if self.specks == 1 else f"{self.specks} specks"
            rows.append([name, format_area(self.specks_area), "–"])
        return format_table([f"room {robot_text}", "area for its centre", "places"], rows)

    def summary(self) -> dict[str, object]:
        """Return the information, fit for JSON: lengths in metres, areas in square metres."""
        (rows, cols), (width, height) = self.grid.shape, self.size
        levels = {name: vars(getattr(self, name)) for name in ("free", "occupied", "unknown")}
        return {
            "map": self.grid.name,
            "cells": {"rows": rows, "cols": cols},
            "size": {"width": width, "height": height},
            "resolution": self.grid.resolution,
            "origin": dict(zip(("x", "y", "heading"), self.grid.origin, strict=True)),
            "extent": dict(zip(("x_min", "y_min", "x_max", "y_max"), self.extent, strict=True)),
            **levels,
            "source": dict(vars(self.source)) if self.source else None,
            "robot_radius": self.robot_radius,
            "rooms": [{"room": room.number, "area": room.area} for room in self.rooms],
            "specks": {"count": self.specks, "area": self.specks_area},
            "places": self.table().records(),
            "pairs": [
                {"start": pair.start.name, "goal": pair.goal.name, "distance": pair.distance}
                | {"command": self.format_plan_command(pair)}
                for pair in self.pairs
            ],
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw the map with numbered grid lines [m], its rooms tinted, and its places named."""
        from locplan.planning.figures import map_info_figure

        return map_info_figure(self)


def describe_map(
    grid: OccupancyGrid | str | os.PathLike[str], *, robot: Robot | float = ROBOT_RADIUS
) -> MapInfo:
    """Describe a map: its size, levels, faults, rooms, and places that are far apart in them.

    Parameters
    ----------
    grid : OccupancyGrid, str or path
        The map, or its file, whose thresholds and grey values are then checked as well.
    robot : Robot, or float, default 0.25
        The robot, or its radius [m], >= 0, which decides what counts as one room.

    Returns
    -------
    MapInfo
        The description; its `report` is text for people, `summary` is fit for JSON.

    Raises
    ------
    MapError
        If the file cannot be read.
    ConfigError
        If the radius is out of its range.

    Examples
    --------
    >>> from locplan.maps import environments
    >>> info = describe_map(environments.make("two_corridors", resolution=0.1))
    >>> [round(room.area) for room in info.rooms], [place.name for place in info.places]
    ([233], ['A', 'B', 'C', 'D'])
    """
    source = None
    if isinstance(grid, (str, os.PathLike)):
        grid, source = read_map(grid)
    check_grid(grid)
    cell, radius = grid.resolution**2, planning_radius(robot)
    cells, room_of_cell = find_map_parts(grid, radius)
    areas = cells * cell
    order = np.argsort(-areas, kind="stable")
    greatest = float(areas.max(initial=0.0))
    counted = (areas >= 1.0) | (areas >= greatest / 10)  # others are specks, such as noise
    large = [int(label) for label in order if counted[label]]
    number_of = np.zeros(len(areas) + 1, room_of_cell.dtype)
    number_of[np.array(large, int) + 1] = np.arange(1, len(large) + 1)
    for band, _, _ in iterate_bands(*grid.shape, 0):  # an index takes 8 bytes for each cell
        room_of_cell[band] = number_of[room_of_cell[band]]
    room_of_cell.setflags(write=False)
    rooms = tuple(Room(n, float(areas[label])) for n, label in enumerate(large, 1))
    free, occupied, unknown = (
        LevelArea(int(number) * cell, int(number) / grid.cells.size)
        for number in (np.count_nonzero(grid.cells == fault) for fault in (FREE, OCCUPIED, UNKNOWN))
    )
    return MapInfo(
        grid=grid,
        source=source,
        robot_radius=radius,
        robot_size=format_radius(robot if isinstance(robot, Robot) else None, radius),
        free=free,
        occupied=occupied,
        unknown=unknown,
        rooms=rooms,
        specks=len(areas) - len(rooms),
        specks_area=float(areas[~counted].sum()),
        room_of_cell=room_of_cell,
        pairs=_choose_routes(grid, room_of_cell, rooms, radius),
        warnings=(
            *(fault.sentence for fault in faults(grid, source)),
            *_list_robot_warnings(grid, radius, bool(rooms)),
        ),
    )


def _choose_routes(
    grid: OccupancyGrid, room_of_cell: Array, rooms: tuple[Room, ...], radius: float
) -> tuple[PlacePair, ...]:
    """Choose pairs of places far apart in the main part of a map, and in rooms of its size."""
    areas = [room.area for room in rooms]
    main, cells = find_main_part(grid, room_of_cell, areas)
    if not main:
        return ()
    outside = find_outside_room(room_of_cell, len(rooms))
    side_rooms = [room.number for room in rooms if room.number not in (main, outside)]
    large = areas[main - 1] if cells is None else np.count_nonzero(cells) * grid.resolution**2
    pairs: list[PlacePair] = []
    used = 0
    for number, count in zip((main, *side_rooms), (4, 2, 2), strict=False):
        if number == main or areas[number - 1] >= large / 3:
            names = "ABCDEFGH"[used : used + count]
            part = cells if number == main else None
            room_pairs = find_farthest_pairs(grid, room_of_cell, number, names, 2 * radius, part)
            used += len(room_pairs) + 1 if room_pairs else 0
            pairs += room_pairs
    return tuple(pairs)


def _list_robot_warnings(grid: OccupancyGrid, radius: float, fits: bool) -> list[str]:
    """Return warnings about the robot on this map."""
    if not fits and grid.free.any():
        widest, near = 0.0, math.ceil(radius / grid.resolution) + 1
        for band, around, inner in iterate_bands(
            *grid.shape, near
        ):  # nowhere is it farther to a wall
            clearance = OccupancyGrid(grid.cells[around], grid.resolution).clearance[inner]
            widest = max(widest, float(clearance[grid.cells[band] == FREE].max(initial=0.0)))
        return [
            f"a robot of radius {radius:g} m fits nowhere: the widest place is {widest:.3g} m from"
            " its walls; give the robot's own footprint and margin if it is smaller"
        ]
    if 0 < radius < grid.resolution:
        return [
            f"a cell of {grid.resolution:g} m is larger than the robot's radius of {radius:g} m, so"
            " that gaps and walls are only roughly known"
        ]
    return []

"""The state of a session at one moment: a site, its costs and its field; stops on it."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Bools
from locplan._support.poses import find_window
from locplan.app.explorer.sites import Change, ExploredSite
from locplan.errors import ConfigError, PoseError
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, UNKNOWN
from locplan.maps.zones import Zones
from locplan.planning.costmap import CellWindow, Costmap
from locplan.planning.grid import connected_parts
from locplan.planning.protocol import Position
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.check_reports import CheckReport
    from locplan.app.explorer.messages import Question

FACTOR = 4
"""Number of cells of the map along a side of a coarse one."""
MAX_MOVE = 3.0
"""Maximum distance by which a stop is moved to a free cell [m]."""


@dataclass(frozen=True)
class SceneLimits:
    """Sizes of what a session stores, and when it begins to draft."""

    search_bytes: float = 520e6
    """Bytes of costmaps and searches: at 4000 x 4000 cells two costmaps, searches on both from two
    ends, drafts, and a search that runs."""
    file_bytes: float = 80e6
    """Bytes of layers and files to download."""
    scene_bytes: float = 200e6
    """Bytes of costmaps and fields of earlier changes."""
    draft_cells: int = 1500
    """Longest side of a map on which drafts are planned on its own cells [cells]."""
    first_seconds: float = 0.06
    """Time that the points nearest to a change may take by the estimator's own estimate [s]."""
    min_points: int = 64
    """Minimum number of points that are computed at once."""


@dataclass(frozen=True)
class Opening:
    """The settings of a session, which never change."""

    config: FieldConfig
    """Settings of the first field."""
    robot: Robot = field(default_factory=Robot)
    """The robot; its lidar is None if none was named."""
    weight: float | None = None
    """Metres of detour accepted per degenerate metre; None for the estimator's own."""
    start: Position | None = None
    """Position of the first start [m]; None lets the page choose one."""
    goal: Position | None = None
    """Position of the first goal [m]; None lets the page choose one."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way [m]."""
    folder: FilePath | None = None
    """Folder that exports are written into; None if none may be written."""
    parameter_files: tuple[FilePath, ...] = ()
    """Nav2 parameters that an export merges those of the masks into."""
    cache_dir: FilePath | None = None
    """Folder of cached fields; None for the usual one."""
    threads: int | None = None
    """Number of threads for fields and drives; None for all cores."""
    force: bool = False
    """True replaces earlier exports."""
    changes: tuple[Change, ...] = ()
    """Changes that the page begins with, see `zones_as_changes`."""
    report: CheckReport | None = None
    """The report of a check that the page shows."""
    limits: SceneLimits = SceneLimits()
    """Sizes of what is stored."""


@dataclass(frozen=True, eq=False)
class FreeParts:
    """The connected parts of the free cells of a costmap."""

    grid: OccupancyGrid
    """The map."""
    labels: NDArray[np.int32]
    """Number of the connected part that a cell belongs to, (H, W); 0 if it is blocked."""

    @property
    def largest(self) -> int:
        """Number of the largest part; 0 if there is none."""
        sizes = np.bincount(self.labels.ravel())
        return int(sizes[1:].argmax()) + 1 if len(sizes) > 1 else 0

    def label(self, xy: Position) -> int:
        """Return the number of the part at a position [m], 0 in blocked cells and off the map."""
        cell = self.grid.cell(xy[:2])
        return int(self.labels[cell]) if self.grid.contains(*cell) else 0

    def nearest(self, xy: Position, label: int = 0) -> Position | None:
        """Return the centre of the nearest free cell within `MAX_MOVE`, of one part or any [m]."""

        def is_right(labels: NDArray[np.int32]) -> Bools:
            return labels == label if label else labels > 0

        reach = MAX_MOVE / self.grid.resolution
        return nearest_centre(self.grid, xy, reach, self.labels, is_right)


def nearest_centre(
    grid: OccupancyGrid,
    xy: Position,
    reach: float,
    values: NDArray[Any],
    is_right: Callable[[NDArray[Any]], Bools],
) -> Position | None:
    """Return the centre of the nearest cell whose value is right; None without one [m].

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    xy : (x, y)
        The position [m].
    reach : float
        Maximum distance [cells].
    values : (H, W) array
        Values of the cells.
    is_right : callable
        Function that returns the mask of the right ones among some values.
    """
    at = np.array([float(v) for v in grid.world_to_grid(*xy[:2])])
    row, col = at.tolist()
    window = find_window(row, col, reach, grid.shape)
    cells = np.argwhere(is_right(values[window])) + [axis.start for axis in window]
    squared = ((cells + 0.5 - at) ** 2).sum(axis=1)
    if squared.min(initial=np.inf) > reach**2:
        return None
    row, col = cells[squared.argmin()]
    return grid.position(int(row), int(col))


def snap_stops(
    parts: FreeParts, stops: Sequence[Position], held: int | None = None
) -> list[Position]:
    """Return the stops of a path, with those in no free cell moved into one.

    Cells of the part that the other stops are in are preferred: the first of them that is free
    decides, and the held one last of all.

    Raises
    ------
    PoseError
        If there is no free cell near a stop.
    """
    order = [n for n in range(len(stops)) if n != held] + ([] if held is None else [held])
    part = next((label for n in order if (label := parts.label(stops[n]))), 0)
    snapped = list(stops)
    for n in order:
        xy = stops[n]
        if parts.label(xy):
            continue
        near = (parts.nearest(xy, part) if part else None) or parts.nearest(xy)
        if near is None:
            role = {len(stops) - 1: "the goal", 0: "the start"}.get(n, f"waypoint {n}")
            raise PoseError(
                f"{role} {xy[0]:.2f},{xy[1]:.2f} has no free cell within"
                f" {MAX_MOVE:g} m; put it where the robot can stand"
            )
        snapped[n] = near
        part = part or parts.label(near)
    return snapped


def read_stops(question: Question, parts: FreeParts) -> tuple[list[Position], int | None]:
    """Return the stops of a question, snapped, and the number of the held one."""
    stops = [question.position("start"), *question.positions("via"), question.position("goal")]
    names = ["start", *(f"via:{k}" for k in range(len(stops) - 2)), "goal"]
    hold = question.choice("hold", names, None)
    held = None if hold is None else names.index(hold)
    return snap_stops(parts, stops, held), held


def coarse_costs(fine: Costmap, factor: int = FACTOR) -> Costmap:
    """Return the costmap of larger cells: free if at least half is, at the mean degeneracy.

    Without a field it has a degeneracy of 0.
    """
    shape = -(-fine.grid.shape[0] // factor), -(-fine.grid.shape[1] // factor)
    total, count = np.zeros(shape), np.zeros(shape, np.uint8)
    for row, col in itertools.product(range(factor), repeat=2):  # no copy of the whole map
        strided_cells = slice(row, None, factor), slice(col, None, factor)
        free, u = np.isfinite(fine.density[strided_cells]), fine.u[strided_cells]
        at = slice(0, free.shape[0]), slice(0, free.shape[1])
        total[at] += np.where(free & ~np.isnan(u), u, 0.0)
        count[at] += free
    cells = np.where(count >= factor * factor / 2, FREE, UNKNOWN).astype(np.uint8)
    grid = OccupancyGrid(cells, fine.grid.resolution * factor, fine.grid.origin)
    # Cells in no-go zones are not free already.
    zones = Zones([zone for zone in fine.zones if zone.kind == "prefer"])
    return Costmap.from_layers(grid, u=total / np.maximum(count, 1), robot=0.0, zones=zones)


@dataclass(frozen=True, eq=False)
class MapScene:
    """A site, its costs and its field at one moment."""

    site: ExploredSite
    """The map, the settings of the field, the robot and the zones."""
    costs: Costmap
    """The costmap at the default weight; blank without a field."""
    field: CovarianceField | None = None
    """The field, or None before there is one."""
    fresh: Bools | None = None
    """Mask of the field's points whose values are those of the map, (h, w)."""
    step: int = 0
    """Number of the step of a repair, after which some points are not fresh; 0 if all are."""
    stale: CellWindow | None = None
    """Window of the costmap that holds values from before a change; None without one."""

    @property
    def is_whole(self) -> bool:
        """True if all values of the field are those of the map."""
        return self.step == 0

    def has_field(self, config: FieldConfig) -> bool:
        """Return whether there is a field with these settings."""
        return self.field is not None and self.field.config == config

    def check_field(self) -> CovarianceField:
        """Return the field; raise a ConfigError before all its values are those of the map."""
        if self.field is None or not self.is_whole:
            raise ConfigError("the field is still being computed; wait until it is there")
        return self.field

    @cached_property
    def digest(self) -> str | None:
        """Digest of the field; None without one."""
        if self.field is None:
            return None
        facts = [self.site.grid.digest, self.field.config.to_json(), self.step]
        text = json.dumps(facts, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def basis(self) -> dict[str, str | None]:
        """Digests of all that results depend on, except the route."""
        return {**self.site.digests, "field": self.digest}

    @cached_property
    def key(self) -> str:
        """Text by which searches on the scene are stored."""
        return json.dumps(self.basis)

    @cached_property
    def parts(self) -> FreeParts:
        """The connected parts of the free space."""
        return FreeParts(self.costs.grid, connected_parts(self.costs)[1])

    @cached_property
    def coarse(self) -> Costmap:
        """The costmap in larger cells, for drafts."""
        return coarse_costs(self.costs)

    @property
    def bytes(self) -> int:
        """Bytes of the costmap and the field."""
        arrays = [self.costs.density, self.costs.u, self.costs.e]
        arrays += self.field.values.values() if self.field else []
        return sum(array.nbytes for array in arrays)

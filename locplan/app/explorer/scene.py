"""Scenes: a site with its costs and its field at one moment. Stops on a scene."""

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
from locplan.planning.grid import label_connected_parts
from locplan.planning.protocol import Position
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.check_reports import CheckReport
    from locplan.app.explorer.messages import Question

FACTOR = 4
"""Side of a coarse cell [cells of the map]."""
MAX_MOVE = 3.0
"""Maximum distance from a stop to the free cell that it snaps to [m]."""


@dataclass(frozen=True)
class SceneLimits:
    """Memory limits of a session, and the map size above which it drafts paths."""

    search_bytes: float = 520e6
    """Bytes of costmaps and searches: at 4000 x 4000 cells two costmaps, searches on both from two
    ends, drafts, and a search that runs."""
    file_bytes: float = 80e6
    """Bytes of layers and files to download."""
    scene_bytes: float = 200e6
    """Bytes of costmaps and fields of earlier changes."""
    draft_cells: int = 1500
    """Longest side of a map whose drafts are planned at full resolution [cells]."""
    first_seconds: float = 0.06
    """Time for the points nearest to a change, as the estimator predicts it [s]."""
    min_points: int = 64
    """Minimum number of points computed at once."""


@dataclass(frozen=True)
class StartSettings:
    """Settings with which a session opens."""

    config: FieldConfig
    """Settings of the first field."""
    robot: Robot = field(default_factory=Robot)
    """The robot. Its lidar is None if the user named none."""
    weight: float | None = None
    """Detour accepted per degenerate metre [m]; None for the estimator's default."""
    start: Position | None = None
    """Position of the first start [m]; None lets the page choose one."""
    goal: Position | None = None
    """Position of the first goal [m]; None lets the page choose one."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way [m]."""
    folder: FilePath | None = None
    """Folder for exports; None forbids them."""
    parameter_files: tuple[FilePath, ...] = ()
    """Nav2 parameter files that an export merges its parameters into."""
    cache_dir: FilePath | None = None
    """Folder of cached fields; None for the default one."""
    threads: int | None = None
    """Number of threads for fields and drives; None for all cores."""
    force: bool = False
    """True replaces earlier exports."""
    changes: tuple[Change, ...] = ()
    """Initial changes, see `changes_from_zones`."""
    report: CheckReport | None = None
    """Report of a check to show."""
    limits: SceneLimits = SceneLimits()
    """Memory limits."""


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

    def get_part_number(self, xy: Position) -> int:
        """Return the number of the part at a position [m]; 0 in blocked cells and off the map."""
        cell = self.grid.cell(xy[:2])
        return int(self.labels[cell]) if self.grid.contains(*cell) else 0

    def find_nearest_position(self, xy: Position, label: int = 0) -> Position | None:
        """Return the centre of the nearest free cell within `MAX_MOVE`, in one part or any [m]."""

        def is_suitable(labels: NDArray[np.int32]) -> Bools:
            return labels == label if label else labels > 0

        reach = MAX_MOVE / self.grid.resolution
        return find_nearest_centre(self.grid, xy, reach, self.labels, is_suitable)


def find_nearest_centre(
    grid: OccupancyGrid,
    xy: Position,
    max_distance: float,
    values: NDArray[Any],
    is_suitable: Callable[[NDArray[Any]], Bools],
) -> Position | None:
    """Return the centre [m] of the nearest cell with a suitable value; None without one.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    xy : (x, y)
        The position [m].
    max_distance : float
        Maximum distance [cells].
    values : (H, W) array
        Values of the cells.
    is_suitable : callable
        Function that returns the mask of suitable values.
    """
    at = np.array([float(v) for v in grid.world_to_grid(*xy[:2])])
    row, col = at.tolist()
    window = find_window(row, col, max_distance, grid.shape)
    cells = np.argwhere(is_suitable(values[window])) + [axis.start for axis in window]
    squared = ((cells + 0.5 - at) ** 2).sum(axis=1)
    if squared.min(initial=np.inf) > max_distance**2:
        return None
    row, col = cells[squared.argmin()]
    return grid.position(int(row), int(col))


def snap_stops(
    parts: FreeParts, stops: Sequence[Position], dragged_index: int | None = None
) -> list[Position]:
    """Move the stops of a path that lie in no free cell into one.

    Free cells connected to the other stops are preferred: the first stop in a free cell decides,
    the dragged one last.

    Raises
    ------
    PoseError
        If there is no free cell near a stop.
    """
    order = [n for n in range(len(stops)) if n != dragged_index] + (
        [] if dragged_index is None else [dragged_index]
    )
    part = next((label for n in order if (label := parts.get_part_number(stops[n]))), 0)
    snapped = list(stops)
    for n in order:
        xy = stops[n]
        if parts.get_part_number(xy):
            continue
        near = (
            parts.find_nearest_position(xy, part) if part else None
        ) or parts.find_nearest_position(xy)
        if near is None:
            role = {len(stops) - 1: "the goal", 0: "the start"}.get(n, f"waypoint {n}")
            raise PoseError(
                f"{role} {xy[0]:.2f},{xy[1]:.2f} has no free cell within"
                f" {MAX_MOVE:g} m; move it to a place where the robot fits"
            )
        snapped[n] = near
        part = part or parts.get_part_number(near)
    return snapped


def read_stops(question: Question, parts: FreeParts) -> tuple[list[Position], int | None]:
    """Return the snapped stops of a question, and the index of the dragged one."""
    stops = [question.position("start"), *question.positions("via"), question.position("goal")]
    names = ["start", *(f"via:{k}" for k in range(len(stops) - 2)), "goal"]
    hold = question.choice("hold", names, None)
    held = None if hold is None else names.index(hold)
    return snap_stops(parts, stops, held), held


def coarsen_costs(fine_costs: Costmap, factor: int = FACTOR) -> Costmap:
    """Return the costmap of larger cells: free if at least half is, at the mean degeneracy.

    Without a field it has a degeneracy of 0.
    """
    shape = -(-fine_costs.grid.shape[0] // factor), -(-fine_costs.grid.shape[1] // factor)
    total, count = np.zeros(shape), np.zeros(shape, np.uint8)
    for row, col in itertools.product(range(factor), repeat=2):  # no copy of the whole map
        strided_cells = slice(row, None, factor), slice(col, None, factor)
        free, u = np.isfinite(fine_costs.density[strided_cells]), fine_costs.u[strided_cells]
        at = slice(0, free.shape[0]), slice(0, free.shape[1])
        total[at] += np.where(free & ~np.isnan(u), u, 0.0)
        count[at] += free
    cells = np.where(count >= factor * factor / 2, FREE, UNKNOWN).astype(np.uint8)
    grid = OccupancyGrid(cells, fine_costs.grid.resolution * factor, fine_costs.grid.origin)
    # Cells in no-go zones are blocked already.
    zones = Zones([zone for zone in fine_costs.zones if zone.kind == "prefer"])
    return Costmap.from_layers(grid, u=total / np.maximum(count, 1), robot=0.0, zones=zones)


@dataclass(frozen=True, eq=False)
class MapScene:
    """A site with its costs and its field at one moment."""

    site: ExploredSite
    """The map, the settings of the field, the robot and the zones."""
    costs: Costmap
    """The costmap at the default weight; blank without a field."""
    field: CovarianceField | None = None
    """The field; None while it is being computed."""
    fresh: Bools | None = None
    """Mask of the points whose values are up to date with the map, (h, w)."""
    step: int = 0
    """Number of the repair step if some points are out of date; otherwise 0."""
    stale: CellWindow | None = None
    """Window of the costmap with values from before a change; None if there are none."""

    @property
    def is_field_complete(self) -> bool:
        """True if the whole field is up to date with the map."""
        return self.step == 0

    def has_field(self, config: FieldConfig) -> bool:
        """Return True if the scene has a field with these settings."""
        return self.field is not None and self.field.config == config

    def check_field(self) -> CovarianceField:
        """Return the field; raise a ConfigError unless it is up to date."""
        if self.field is None or not self.is_field_complete:
            raise ConfigError("the field is still being computed; wait for it")
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
        """Digests of everything that results depend on, except the route."""
        return {**self.site.digests, "field": self.digest}

    @cached_property
    def key(self) -> str:
        """Key under which searches on the scene are stored."""
        return json.dumps(self.basis)

    @cached_property
    def parts(self) -> FreeParts:
        """The connected parts of the free space."""
        return FreeParts(self.costs.grid, label_connected_parts(self.costs)[1])

    @cached_property
    def coarse_costs(self) -> Costmap:
        """The costmap in larger cells, for drafts."""
        return coarsen_costs(self.costs)

    @property
    def n_bytes(self) -> int:
        """Bytes of the costmap and the field."""
        arrays = [self.costs.density, self.costs.u, self.costs.e]
        arrays += self.field.values.values() if self.field else []
        return sum(array.nbytes for array in arrays)

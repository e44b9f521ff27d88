"""What a session begins with, what it shows at one moment, its layers, and the way asked for."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Floats, Octets, Shorts
from locplan._support.poses import window_around
from locplan._support.tables import finite
from locplan.errors import PoseError
from locplan.field.config import FieldConfig
from locplan.field.covariance import SCALARS
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, UNKNOWN
from locplan.planning.costmap import Costmap
from locplan.planning.grid import connected_parts
from locplan.planning.protocol import Position
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Ask


FACTOR = 4
"""Number of cells of the map along a side of a coarse one."""
MAX_MOVE = 3.0
"""Maximum distance by which a position is moved [m]."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The free cells of a costmap, and which of them are connected."""

    grid: OccupancyGrid
    """The map."""
    labels: NDArray[np.int32] | Shorts
    """Number of the connected part that a cell belongs to, (H, W); 0 where it is blocked."""

    @classmethod
    def of(cls, costs: Costmap) -> Parts:
        """The parts where no corner may be cut."""
        count, labels = connected_parts(costs)
        fits = count <= np.iinfo(np.uint16).max
        return cls(costs.grid, labels.astype(np.uint16) if fits else labels)

    def label(self, xy: Position) -> int:
        """Number of the part at a world position [m], 0 in blocked cells and outside the map."""
        cell = self.grid.cell(xy[:2])
        return int(self.labels[cell]) if self.grid.contains(*cell) else 0

    def nearest(self, xy: Position, label: int = 0) -> Position | None:
        """Centre of the nearest free cell within `MAX_MOVE`, of one part or of any [m]."""
        grid = self.grid
        row, col = (float(v) for v in grid.world_to_grid(*xy[:2]))
        reach = MAX_MOVE / grid.resolution
        window = window_around(row, col, reach, grid.shape)
        labels, first = self.labels[window], [each.start for each in window]
        cells = np.argwhere(labels == label if label else labels > 0) + first
        squared = ((cells + 0.5 - (row, col)) ** 2).sum(axis=1)
        if squared.min(initial=np.inf) > reach**2:
            return None
        row, col = cells[squared.argmin()]
        return grid.position(int(row), int(col))


def snapped(parts: Parts, stops: Sequence[Position], held: int | None = None) -> list[Position]:
    """The stops of a path, each of them moved into a free cell where it is in none.

    Cells of the part that the other stops are in are preferred: the first of them that is free
    decides, and the one that is held last of all.

    Raises
    ------
    PoseError
        If there is no free cell near a stop.
    """
    order = [n for n in range(len(stops)) if n != held] + ([] if held is None else [held])
    part = next((label for n in order if (label := parts.label(stops[n]))), 0)
    found = list(stops)
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
        found[n] = near
        part = part or parts.label(near)
    return found


def stops_of(ask: Ask, parts: Parts) -> tuple[list[Position], int | None]:
    """Stops of a question, moved to where the robot can stand, and which of them is held."""
    stops = [ask.position("start"), *ask.positions("via"), ask.position("goal")]
    names = ["start", *(f"via:{k}" for k in range(len(stops) - 2)), "goal"]
    hold = ask.one_of("hold", ["", *names], "")
    held = names.index(hold) if hold else None
    return snapped(parts, stops, held), held


def coarse_costs(fine: Costmap, factor: int = FACTOR) -> Costmap:
    """The costmap of larger cells: free where at least half is floor, whose mean degeneracy counts.

    Without a field it has a degeneracy of 0.
    """
    shape = -(-fine.grid.shape[0] // factor), -(-fine.grid.shape[1] // factor)
    total, count = np.zeros(shape), np.zeros(shape, np.uint8)
    for row, col in itertools.product(range(factor), repeat=2):  # no copy of the whole map
        some = slice(row, None, factor), slice(col, None, factor)
        free, u = np.isfinite(fine.density[some]), fine.u[some]
        at = slice(0, free.shape[0]), slice(0, free.shape[1])
        total[at] += np.where(free & ~np.isnan(u), u, 0.0)
        count[at] += free
    cells = np.where(count >= factor * factor / 2, FREE, UNKNOWN).astype(np.uint8)
    grid = OccupancyGrid(cells, fine.grid.resolution * factor, fine.grid.origin)
    return Costmap.from_layers(grid, u=total / np.maximum(count, 1), robot=0.0)


@dataclass(frozen=True)
class Limits:
    """How much a session keeps, and when it begins to draft."""

    kept_bytes: float = 520e6
    """Bytes of costmaps and searches that are kept: at 4000 x 4000 cells two costmaps, searches on
    both from two ends, drafts, and a search that is made."""
    file_bytes: float = 80e6
    """Bytes of textures and files to download that are kept."""
    undo_bytes: float = 64e6
    """Bytes of cells that are kept for undoing; the last edit can be undone whatever it takes."""
    undo: int = 200
    """Number of edits that can be undone."""
    draft_cells: int = 1500
    """Longest side of a map on which drafts are planned on its own cells [cells]."""
    first_seconds: float = 0.06
    """Time that the points nearest to an edit may take by the estimator's own estimate [s]."""
    min_points: int = 64
    """Number of points that are computed at once at least."""
    pages: int = 20
    """Number of pages that are open at once."""
    waiting: int = 100
    """Number of questions of a page that wait for their answers."""


@dataclass(frozen=True)
class Opening:
    """What a session begins with, and what never changes in it."""

    config: FieldConfig
    """Settings of the first field."""
    robot: Robot = field(default_factory=Robot)
    """The robot; its lidar is None where none was named."""
    criterion: str | None = None
    """Scalar that u is made of; None for the estimator's own."""
    weight: float | None = None
    """Metres of detour accepted per degenerate metre; None for the estimator's own."""
    start: Position | None = None
    """Position of the start [m]; None for a place of the page's own choice."""
    goal: Position | None = None
    """Position of the goal [m]; None for a place of the page's own choice."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way [m]."""
    folder: FilePath | None = None
    """Folder that files are written under; None where none may be written."""
    cache_dir: FilePath | None = None
    """Folder of cached fields; None for the usual one."""
    threads: int | None = None
    """Number of threads for fields; None for all cores."""
    force: bool = False
    """True lets files in the way be replaced."""
    report: Any = None
    """The report of a check that the page opens on, a `CheckReport`; None without one."""
    limits: Limits = Limits()
    """How much is kept."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The map, its field and its costs at one moment."""

    costs: Costmap
    """The costmap at the default weight; blank without a field."""
    field: CovarianceField | None
    """The field, or None before there is one."""
    whole: bool
    """False while some values are those from before an edit."""
    serial: int
    """Number of the scene."""

    @cached_property
    def digest(self) -> str:
        """Digest of the map and of the values of its field."""
        settings = self.field.config.to_json() if self.field else None
        state = None if self.whole else self.serial
        text = json.dumps([self.costs.grid.digest, settings, state], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @cached_property
    def parts(self) -> Parts:
        """The connected parts of the free space."""
        return Parts.of(self.costs)

    @cached_property
    def coarse(self) -> Costmap:
        """The costmap in larger cells, for drafts."""
        return coarse_costs(self.costs)


MAX_DRIVES = 256
"""Maximum number of confirming drives that the page can ask for."""


def rounded(xy: object) -> list[list[float]]:
    """Positions (n, 2) as lists for JSON, to a millimetre [m]."""
    values: list[list[float]] = np.round(np.asarray(xy, float), 3).tolist()
    return values


@dataclass(frozen=True, eq=False)
class Texture:
    """A layer of a field on its lattice, as the page shows it."""

    name: str
    """Name of the layer."""
    title: str
    """Title for people."""
    unit: str
    """Unit of what is shown."""
    factor: float
    """Number of shown units in one of the values'."""
    decimals: int
    """Number of decimals to show."""
    logarithmic: bool
    """Whether the steps are even in the logarithm."""
    anchors: tuple[float, float]
    """Values of the first and the last step; the last one is the worst."""
    values: Floats
    """Values on the lattice in SI units, row 0 at the lowest y; NaN where there are none."""

    @property
    def texels(self) -> Octets:
        """Steps from 1 to 255 between the anchors, 0 where there is no value, row 0 on top."""
        steps = 1 + np.rint(254 * share_between(self.values, self.anchors, self.logarithmic))
        return np.asarray(np.nan_to_num(steps, nan=0.0)[::-1], np.uint8)

    @cached_property
    def present(self) -> list[float]:
        """Values that nearly all on this map lie between; the anchors where there are none."""
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return list(self.anchors)
        ends: list[float] = np.quantile(known, (0.02, 0.98)).tolist()
        return ends if self.anchors[0] < self.anchors[1] else ends[::-1]

    def to_json(self) -> dict[str, object]:
        """All but the values, fit for JSON."""
        shown = {name: value for name, value in vars(self).items() if name != "values"}
        scale = "log" if self.logarithmic else "linear"
        return finite(shown | {"scale": scale, "present": self.present})


def textures_of(field: CovarianceField) -> dict[str, Texture]:
    """The layers of a field that the page shows, by name."""
    made = [
        _scalar(field, "sigma", "position_std", "Position deviation", 1),
        _scalar(field, "heading", "heading_std", "Heading deviation", 1),
        Texture("degeneracy", "Degeneracy u", "1", 1.0, 2, False, (0.0, 1.0), degeneracy_of(field)),
        _scalar(field, "e", "e", "Pose uncertainty e", 4),
    ]
    return {each.name: each for each in made if each.anchors[1] > each.anchors[0]}


def degeneracy_of(field: CovarianceField) -> Floats:
    """u of the estimator's own criterion on the lattice, (h, w), as costmaps have it."""
    criterion = field.config.estimator.criterion
    values = field.scalar(criterion, with_q=True)
    u = share_between(values, field.anchors(criterion), criterion not in field.layers)
    return u.mean(axis=2) if u.ndim == 3 else u


def share_between(values: Floats, anchors: tuple[float, float], logarithmic: bool) -> Floats:
    """Where values lie between two anchors, 0..1; NaN where they are NaN."""
    low, high = anchors
    with np.errstate(invalid="ignore", divide="ignore"):
        if logarithmic:
            share = np.log(np.maximum(values, np.finfo(float).tiny) / low) / np.log(high / low)
        else:
            share = (values - low) / (high - low)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _scalar(field: CovarianceField, name: str, of: str, title: str, decimals: int) -> Texture:
    shown = SCALARS[of]
    unit = field.e_unit if of == "e" else shown.unit
    values, anchors = field.scalar(of, headings="mean"), field.anchors(of)
    return Texture(name, title, unit, shown.factor, decimals, True, anchors, values)

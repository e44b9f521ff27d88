"""Zones of a site: closed to the robot, slow, or preferred."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import (
    FARTHEST,
    check_choice,
    check_file_path,
    check_instance,
    check_number,
    is_number,
    set_frozen_fields,
    short_repr,
)
from locplan._support.files import check_writable_file
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan._support.output import replace_file
from locplan._support.reading import MAX_BYTES, parse_json, read_text
from locplan._support.saved import EqualByValue
from locplan._support.tables import make_geojson_feature
from locplan.errors import ConfigError, LocplanError
from locplan.maps.files import read_mask
from locplan.maps.grid import OccupancyGrid, check_grid, format_extent
from locplan.maps.occupancy import OCCUPIED

ZoneKind = Literal["no-go", "slow", "prefer"]
"""What a zone asks of the robot."""
KINDS: tuple[ZoneKind, ...] = get_args(ZoneKind)
FILE = "zones.geojson"
"""Name of the file of zones in the folder of an export."""
OUTSIDE_COST = 1.0
"""Cost per metre outside the preferred zones, on top of those of the length and of u."""
MAX_ZONES, MAX_CORNERS, MAX_ALL_CORNERS = 25_000, 1000, 100_000
"""Maximum number of zones, of the corners of one, and of all corners."""
DIGITS = 3
"""Corners are rounded to a thousandth of a cell, so that an outline along the edges of cells does
not reach into the cells next to it."""


@dataclass(frozen=True, eq=False)
class Zone(EqualByValue):
    """A polygon on the map that the robot avoids, prefers, or drives through slowly.

    Parameters
    ----------
    kind : str
        "no-go": the robot's centre never enters it. "slow": the robot drives slower there.
        "prefer": outside all zones of this kind a path costs more.
    polygon : (n, 2) array
        Corners of the outline in the map frame [m], 3 to 1000; the first one is not repeated.
    percent : float, optional
        Share of the top speed in a slow zone, 1 to 100 [%]; only slow zones have it.

    Raises
    ------
    ConfigError
        If the kind is unknown, the outline crosses itself or encloses no area, or the percentage
        is missing or out of its range.

    Examples
    --------
    >>> zone = Zone("slow", [[0, 0], [2, 0], [2, 1], [0, 1]], percent=30)
    >>> zone.polygon.shape, zone.percent
    ((4, 2), 30.0)
    """

    kind: ZoneKind
    polygon: Floats
    percent: float | None = None

    if TYPE_CHECKING:  # lists are taken, but arrays kept

        def __init__(
            self, kind: ZoneKind, polygon: ArrayLike, percent: float | None = None
        ) -> None: ...

    def __post_init__(self) -> None:
        check_choice("the kind of a zone", self.kind, KINDS)
        set_frozen_fields(self, polygon=_check_polygon(self.polygon))
        if self.kind != "slow" and self.percent is not None:
            raise ConfigError(f"a zone of kind {self.kind} has no percent; leave percent out")
        if self.kind == "slow":
            if self.percent is None:
                raise ConfigError("a slow zone needs percent, 1 to 100 of the top speed; add it")
            set_frozen_fields(self, percent=check_number("percent", self.percent, 1.0, 100.0))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled zone, with its corners read-only as before."""
        vars(self).update(state)
        self.polygon.setflags(write=False)

    def to_json(self) -> dict[str, Any]:
        """Return the zone as a feature of GeoJSON."""
        percent = {"percent": self.percent} if self.kind == "slow" else {}
        ring = self.polygon.tolist()
        return make_geojson_feature("Polygon", [[*ring, ring[0]]], {"kind": self.kind} | percent)

    @classmethod
    def from_json(cls, geojson: Any) -> Zone:
        """Read a zone from a feature of GeoJSON.

        Parameters
        ----------
        geojson : dict
            The feature, a Polygon with the property kind, and percent if it is slow.

        Raises
        ------
        ConfigError
            If it is no such feature.
        """
        properties, shape = (
            _get_geojson_member(geojson, name) for name in ("properties", "geometry")
        )
        if not isinstance(properties, dict) or "kind" not in properties:
            raise ConfigError(f"has no kind; write one of {', '.join(KINDS)} into its properties")
        kind = _get_geojson_member(shape, "type")
        if kind == "MultiPolygon":
            raise ConfigError("is a MultiPolygon; save each polygon as its own feature")
        if kind != "Polygon":
            raise ConfigError(f"is no polygon, but {short_repr(kind)}; draw the zone as a Polygon")
        rings = _get_geojson_member(shape, "coordinates")
        if not isinstance(rings, list) or not rings:
            raise ConfigError("has no corners; draw the polygon again")
        if len(rings) > 1:
            raise ConfigError("has a hole; split the zone into polygons without holes")
        ring = rings[0][:-1] if _is_closed_ring(rings[0]) else rings[0]
        return cls(properties["kind"], ring, properties.get("percent"))


@dataclass(frozen=True, eq=False, repr=False)
class Zones:
    """The zones of a site, in the map frame.

    A cell of a map belongs to a zone if they overlap. No-go zones therefore block each cell that
    they reach into, however thin they are, and no path through the remaining cells crosses them.

    In the density of a costmap, 1 + weight * u, the cells of no-go zones are infinite. If there are
    preferred zones, 1 is added to every cell outside them. Slow zones change no path; they limit
    the speed.

    Parameters
    ----------
    zones : sequence of Zone
        The zones, 25,000 at most.

    Raises
    ------
    ConfigError
        If there are too many zones or corners.

    Examples
    --------
    >>> zones = Zones([Zone("no-go", [[0, 0], [2, 0], [2, 1], [0, 1]])])
    >>> zones
    Zones(1 no-go)
    >>> grid = OccupancyGrid(np.full((2, 4), 254), resolution=1.0)
    >>> zones.cells(grid, "no-go").astype(int).tolist()
    [[1, 1, 0, 0], [0, 0, 0, 0]]
    """

    zones: tuple[Zone, ...] = ()

    if TYPE_CHECKING:

        def __init__(self, zones: Sequence[Zone] = ()) -> None: ...

    def __post_init__(self) -> None:
        zones = tuple(self.zones)
        for zone in zones:
            check_instance("a zone", zone, Zone, "make one with locplan.Zone")
        corners = sum(len(zone.polygon) for zone in zones)
        if len(zones) > MAX_ZONES or corners > MAX_ALL_CORNERS:
            raise ConfigError(
                f"{len(zones):,} zones with {corners:,} corners are too many; draw at most"
                f" {MAX_ZONES:,} with {MAX_ALL_CORNERS:,}"
            )
        set_frozen_fields(self, items=zones)

    def __len__(self) -> int:
        return len(self.zones)

    def __iter__(self) -> Iterator[Zone]:
        return iter(self.zones)

    def __repr__(self) -> str:
        return f"Zones({self})"

    def __str__(self) -> str:
        counts = [(sum(zone.kind == kind for zone in self), kind) for kind in KINDS]
        return ", ".join(f"{count} {kind}" for count, kind in counts if count)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Zones) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Zones:
        """Read zones that `save` or the explorer wrote, or a keepout mask of Nav2.

        Parameters
        ----------
        path : path
            A GeoJSON FeatureCollection of Polygons with the property kind, in the map frame [m]; or
            the map YAML of a keepout mask, see `from_mask`. Of a mask in mode raw or scale only the
            value 100 counts, as for Nav2's KeepoutFilter.

        Raises
        ------
        LocplanError
            If it cannot be read. The error names the feature, counted from 1.
        """
        file = check_file_path("a file of zones", path)
        if file.suffix.lower() in (".yaml", ".yml"):
            try:
                return cls.from_mask(read_mask(file))
            except ConfigError as error:
                raise LocplanError(f"{file}: {error}") from None
        try:
            return cls.from_json(parse_json(read_text(file, MAX_BYTES)))
        except (ConfigError, ValueError) as error:
            remedy = "" if isinstance(error, ConfigError) else "is not JSON; save the zones again: "
            raise LocplanError(f"{file}: {remedy}{error}") from None

    @classmethod
    def from_mask(cls, mask: OccupancyGrid) -> Zones:
        """Return the occupied cells of a mask as no-go zones, exactly.

        Each zone is a rectangle of cells. The mask's cells may differ from the map's.

        Parameters
        ----------
        mask : OccupancyGrid
            The mask; its occupied cells are closed, the rest is open.

        Raises
        ------
        ConfigError
            If the cells make more than 25,000 rectangles.
        """
        check_grid(mask)
        rectangles = _split_rectangles(mask.cells == OCCUPIED)
        if len(rectangles) > MAX_ZONES:
            raise ConfigError(
                f"its closed cells make {len(rectangles):,} rectangles, more than {MAX_ZONES:,};"
                " draw the zones as polygons"
            )
        row, col, top, right = np.reshape(rectangles, (-1, 4)).T
        x, y = mask.grid_to_world([row, row, top, top], [col, right, right, col])
        return cls([Zone("no-go", corners) for corners in np.stack([x, y], axis=-1).swapaxes(0, 1)])

    @classmethod
    def from_json(cls, geojson: Any) -> Zones:
        """Read the zones of a GeoJSON FeatureCollection.

        Parameters
        ----------
        geojson : dict
            The collection.

        Raises
        ------
        ConfigError
            If it is no collection, or a feature is no zone. The error names the feature, counted
            from 1.
        """
        features = _get_geojson_member(geojson, "features")
        if _get_geojson_member(geojson, "type") != "FeatureCollection" or not isinstance(
            features, list
        ):
            raise ConfigError(
                "holds no zones; give a GeoJSON FeatureCollection of polygons, or a map YAML"
            )
        if len(features) > MAX_ZONES:
            raise ConfigError(f"has {len(features):,} features; draw at most {MAX_ZONES:,} zones")
        zones = []
        for place, zone_feature in enumerate(features, 1):
            try:
                zones.append(Zone.from_json(zone_feature))
            except ConfigError as error:
                raise ConfigError(f"feature {place}: {error}") from None
        return cls(zones)

    def to_json(self) -> dict[str, Any]:
        """Return the zones as a GeoJSON FeatureCollection."""
        return {"type": "FeatureCollection", "features": [zone.to_json() for zone in self]}

    @cached_property
    def text(self) -> str:
        """Text of the file, one line per zone; equal for equal zones."""
        lines = ",\n".join(json.dumps(zone.to_json(), allow_nan=False) for zone in self)
        return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the file: equal for equal zones in the same order."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the zones as GeoJSON, for `load`, the page and the option ``--zones``.

        Parameters
        ----------
        path : path
            The file, named .geojson or .json. An existing file is replaced.

        Raises
        ------
        LocplanError
            If it cannot be written.
        """
        target = check_file_path("a file of zones", path)
        check_writable_file(target, ".geojson", ".json")
        with replace_file(target) as temporary:
            temporary.write_bytes(self.text.encode())

    @cached_property
    def no_go_zones(self) -> Zones:
        """The no-go zones only."""
        return Zones([zone for zone in self if zone.kind == "no-go"])

    def has_kind(self, kind: ZoneKind) -> bool:
        """True if there is a zone of a kind.

        Parameters
        ----------
        kind : str
            "no-go", "slow" or "prefer".
        """
        return any(zone.kind == kind for zone in self)

    def cells(self, grid: OccupancyGrid, kind: ZoneKind) -> Bools:
        """Return the mask of the cells that zones of a kind overlap, (H, W), read-only.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        kind : str
            "no-go", "slow" or "prefer".
        """
        return _find_zone_cells(self, kind, grid.shape, grid.resolution, grid.origin)

    def cost_per_metre(self, grid: OccupancyGrid) -> Floats | float:
        """Cost per metre of each cell for the zones, (H, W): 1 outside the preferred ones.

        Parameters
        ----------
        grid : OccupancyGrid
            The map. Without a preferred zone the cost is 0.
        """
        return (
            np.where(self.cells(grid, "prefer"), 0.0, OUTSIDE_COST)
            if self.max_cost_per_metre
            else 0.0
        )

    @property
    def max_cost_per_metre(self) -> float:
        """Largest cost per metre for the zones: 1 with preferred zones, otherwise 0."""
        return OUTSIDE_COST if self.has_kind("prefer") else 0.0

    def speed_limit(self, grid: OccupancyGrid) -> Floats:
        """Return the share of the top speed in each cell, (H, W) [%]: the least of its slow zones.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        """
        limit = np.full(grid.shape, 100.0)
        for zone in self:
            if zone.kind == "slow":
                window, inside = _find_overlap(zone.polygon, grid)
                limit[window][inside] = np.minimum(limit[window][inside], zone.percent or 100.0)
        return limit


@lru_cache(maxsize=8)
def _find_zone_cells(
    zones: Zones,
    kind: ZoneKind,
    shape: tuple[int, int],
    resolution: float,
    origin: tuple[float, float, float],
) -> Bools:
    """Mark the cells that zones of a kind overlap, (H, W)."""
    blank = OccupancyGrid(np.zeros(shape, np.uint8), resolution, origin)
    mask = np.zeros(shape, bool)
    for zone in zones:
        if zone.kind == kind:
            window, inside = _find_overlap(zone.polygon, blank)
            mask[window] |= inside
    mask.setflags(write=False)
    return mask


def _find_overlap(polygon: Floats, grid: OccupancyGrid) -> tuple[tuple[slice, slice], Bools]:
    """Return the window of a map around a polygon, and the mask of its cells that overlap it.

    A cell overlaps it if an edge passes through the cell or the cell's centre is inside.
    """
    corners = np.column_stack(grid.world_to_grid(*polygon.T)).round(DIGITS)
    size = np.array(grid.shape)
    low = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(np.int64)
    high = np.clip(np.ceil(corners.max(axis=0)), low, size).astype(np.int64)
    window = slice(low[0], high[0]), slice(low[1], high[1])
    shape, ends = high - low, np.roll(corners, -1, axis=0)
    inside = _find_inner_cells(corners - low, ends - low, shape)
    rows, cols = _find_crossed_cells(corners - low, ends - low, shape)
    inside[rows, cols] = True
    return window, inside


def _find_inner_cells(starts: Floats, ends: Floats, shape: Ints) -> Bools:
    """Mark the cells whose centres lie inside the polygon."""
    rows, columns = int(shape[0]), int(shape[1])
    lowest, highest = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    # An edge crosses the rows of centres from its lower end on, up to but not at its upper one.
    first, last = (np.clip(np.ceil(y - 0.5), 0, rows).astype(np.int64) for y in (lowest, highest))
    counts = last - first
    edge = np.repeat(np.arange(len(starts)), counts)
    row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (row + 0.5 - starts[edge, 0]) / (ends[edge, 0] - starts[edge, 0])
    crossing = starts[edge, 1] + along * (ends[edge, 1] - starts[edge, 1])
    turns = np.zeros((rows, columns + 1), np.int32)
    col = np.clip(np.ceil(crossing - 0.5), 0, columns).astype(np.int64)
    np.add.at(turns, (row, col), np.sign(ends[edge, 0] - starts[edge, 0]).astype(np.int32))
    return np.asarray(np.cumsum(turns, axis=1)[:, :-1] != 0)


def _find_crossed_cells(starts: Floats, ends: Floats, shape: Ints) -> tuple[Ints, Ints]:
    """Find rows and columns of the cells that edges pass through, not just touch."""
    is_between = ((starts == ends) & (starts == np.floor(starts))).any(axis=1)
    if is_between.all():  # as of the rectangles of a mask, which may be thousands
        nowhere = np.empty(0, np.int64)
        return nowhere, nowhere
    from locplan._support.kernels.rays import find_line_cells

    starts, ends = starts[~is_between], ends[~is_between]
    steps = ends - starts
    with np.errstate(divide="ignore", invalid="ignore"):
        # NaN is an edge along a border of the map, which does not limit it.
        bounds = np.stack([-starts / steps, (shape - starts) / steps])
    is_outside = ((steps == 0) & ((starts < 0) | (starts > shape))).any(axis=1)
    enter = np.nanmax(bounds.min(axis=0), axis=1, initial=0.0)
    leave = np.nanmin(bounds.max(axis=0), axis=1, initial=1.0)
    is_seen = (enter < leave) & ~is_outside
    starts, steps, enter, leave = (values[is_seen] for values in (starts, steps, enter, leave))
    rows, cols, lengths, _ = find_line_cells(
        np.clip(starts + enter[:, None] * steps, 0, shape),
        np.clip(starts + leave[:, None] * steps, 0, shape),
    )
    is_inside = (rows >= 0) & (rows < shape[0]) & (cols >= 0) & (cols < shape[1])
    is_inside &= lengths > 1e-6
    return rows[is_inside], cols[is_inside]


def _split_rectangles(mask: Bools) -> list[tuple[int, int, int, int]]:
    """Split a mask into rectangles: first row and column, and the row and column after the last."""
    edges = np.diff(np.pad(mask, ((0, 1), (1, 1))).astype(np.int8), axis=1)
    open_runs: dict[tuple[int, int], int] = {}
    rectangles: list[tuple[int, int, int, int]] = []
    for row, steps in enumerate(edges):
        firsts, lasts = np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist()
        runs = set(zip(firsts, lasts, strict=True))
        for run in sorted(open_runs.keys() - runs):
            rectangles.append((open_runs.pop(run), run[0], row, run[1]))
        for run in runs - open_runs.keys():
            open_runs[run] = row
    return sorted(rectangles)


def _get_geojson_member(geojson: Any, name: str) -> Any:
    """Return a member of a GeoJSON object, or None."""
    return geojson.get(name) if isinstance(geojson, Mapping) else None


def _is_closed_ring(ring: Any) -> bool:
    """True if the first point of a ring is also its last."""
    return isinstance(ring, list) and len(ring) > 1 and ring[0] == ring[-1]


def _check_polygon(polygon: ArrayLike) -> Floats:
    """Return the corners of a polygon, (n, 2), read-only; a ConfigError if they enclose no area."""
    corners = _parse_corners(polygon)
    if len(corners) > MAX_CORNERS:
        raise ConfigError(f"has {len(corners):,} corners; draw at most {MAX_CORNERS:,}")
    ahead = np.roll(corners, -1, axis=0)
    if (
        len(corners) < 3
        or not abs(_cross_product(corners - corners[0], ahead - corners[0]).sum()) > 0
    ):
        raise ConfigError("encloses no area; draw at least three corners that are not in a line")
    if len(corners) > 3 and (crossing := _find_self_crossing(corners, ahead)) is not None:
        x, y = crossing
        raise ConfigError(f"its outline crosses itself near {x:.2f},{y:.2f}; draw it as two zones")
    corners.setflags(write=False)
    return corners


def _parse_corners(polygon: Any) -> Floats:
    """Return the corners as numbers, (n, 2); a ConfigError if they are not numbers."""
    if isinstance(polygon, np.ndarray):
        if polygon.ndim == 2 and polygon.shape[1] == 2 and polygon.dtype.kind in "iuf":
            corners = polygon.astype(np.float64) + 0.0  # turns -0 into 0
            if (np.abs(corners) <= FARTHEST).all():
                return corners
        raise ConfigError(
            f"its corners must be an (n, 2) array of metres within ±{FARTHEST:g}, not an array"
            f" {polygon.shape} of {polygon.dtype}"
        )
    if not isinstance(polygon, (list, tuple)):
        raise ConfigError(
            f"its corners must be positions x, y in metres, not {short_repr(polygon)}"
        )
    for corner in polygon:
        ok = isinstance(corner, (list, tuple, np.ndarray)) and len(corner) in (2, 3)
        if not ok or not all(is_number(value) and abs(value) <= FARTHEST for value in corner):
            raise ConfigError(
                f"a corner must be x, y in metres within ±{FARTHEST:g}, not {short_repr(corner)}"
            )
    return np.array([[float(value) for value in corner[:2]] for corner in polygon]) + 0.0


def _cross_product(first: Floats, second: Floats) -> Floats:
    """Return the cross products of vectors (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _find_self_crossing(starts: Floats, ends: Floats) -> tuple[float, float] | None:
    """Return a point at which two edges of an outline cross, or None."""
    steps = ends - starts
    begin, end = (
        _cross_product(steps[:, None], xy[None] - starts[:, None]) for xy in (starts, ends)
    )
    is_across = begin * end < 0
    pairs = np.argwhere(np.triu(is_across & is_across.T))
    if not len(pairs):
        return None
    edge, other_edge = pairs[0]
    share = begin[edge, other_edge] / (begin[edge, other_edge] - end[edge, other_edge])
    x, y = (starts[other_edge] + share * steps[other_edge]).tolist()
    return x, y


def check_zones_on_map(zones: Zones, grid: OccupancyGrid) -> None:
    """Raise a ConfigError if there are zones, but none overlaps the map.

    Parameters
    ----------
    zones : Zones
        The zones.
    grid : OccupancyGrid
        The map.
    """
    if zones and not any(zones.cells(grid, kind).any() for kind in KINDS):
        raise ConfigError(
            f"no zone overlaps the map, which reaches from {format_extent(grid)}; draw the zones in"
            " the map frame, in metres"
        )


def normalize_zones(zones: Zones | None) -> Zones:
    """Return the zones, or empty ones for None; raise a ConfigError if they are not Zones.

    Parameters
    ----------
    zones : Zones or None
        The zones.
    """
    if zones is None:
        return Zones()
    check_instance("zones", zones, Zones, "read a file with locplan.Zones.load")
    return zones

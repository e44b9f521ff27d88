"""Weak spots of a map: polygons of connected cells with high degeneracy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_instance, check_number
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan.errors import FieldError
from locplan.field.covariance import DEGENERATE, position_axes, scalar
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap, check_costs
from locplan.planning.grid import label_connected_parts
from locplan.planning.path import Path

QUARTERS = 4
"""Units of a ring along the edge of a cell."""
_STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
_CHUNK = 256


@dataclass(frozen=True, eq=False, repr=False)
class DegenerateArea:
    """A polygon of cells whose degeneracy u is high, in the world frame."""

    outline: Floats
    """Corners [m], counter-clockwise, the first one only once, (n, 2)."""
    holes: tuple[Floats, ...]
    """Corners of the holes [m], clockwise, (n, 2) each."""
    middle: tuple[float, float]
    """Position well inside the area [m]."""
    area: float
    """Area of the cells [m^2]."""
    position_std: float
    """Median of the largest standard deviation of the position [m]."""
    heading_std: float
    """Median of the heading's standard deviation [rad]; NaN in a field without rotation."""
    direction: float
    """Direction along which the position is uncertain, from x, in (-pi/2, pi/2] [rad]."""
    agreement: float
    """1 if all cells are uncertain along that line only, 0 without a common direction."""

    @property
    def has_common_direction(self) -> bool:
        """True if the area is uncertain along one common line."""
        return self.agreement >= 0.5

    def __repr__(self) -> str:
        return (
            f"DegenerateArea({self.area:.3g} m²,"
            f" position std. deviation {100 * self.position_std:.3g} cm)"
        )


class CellRing(NamedTuple):
    """A closed line around an area of cells, or around a hole in it."""

    corners: Ints
    """Columns and rows of its corners [quarters of a cell], (n, 2), one a cell's edge."""
    cell: tuple[int, int]
    """Row and column of a cell of the area next to the ring."""


def trace_rings(mask: Bools) -> list[CellRing]:
    """Trace all rings along the edges of the cells of a mask, (H, W).

    Cells that only share a corner are not connected: both sides keep a quarter of a cell away from
    it, so that rings never touch.
    """
    inside = np.pad(mask, 1)
    width = inside.shape[1]
    codes, cells = [], []
    for side, (first, ahead) in enumerate([((0, 0), -1), ((0, 1), 1), ((1, 1), 1), ((1, 0), -1)]):
        neighbours = np.roll(inside, -ahead, axis=side % 2)
        rows, cols = np.nonzero(inside & ~neighbours)
        starts = (rows + first[0]) * width + cols + first[1]
        codes.append(4 * starts + side)
        cells.append(np.column_stack([rows, cols]) - 1)
    code, cell = np.concatenate(codes), np.concatenate(cells)
    if not code.size:
        return []
    order = np.argsort(code, kind="stable")
    code, cell = code[order], cell[order]
    direction = code % 4
    end = code // 4 + np.array([1, width, -1, -width])[direction]
    after = np.empty(len(code), np.int64)
    turns = {}
    for turn in (3, 0, 1):  # a left turn, which stays at the same cell, comes last and wins
        following = 4 * end + (direction + turn) % 4
        positions = np.minimum(np.searchsorted(code, following), len(code) - 1)
        turns[turn] = code[positions] == following
        after[turns[turn]] = positions[turns[turn]]
    corner = QUARTERS * (np.column_stack([end % width, end // width]) - 1)
    corner_shift = _STEPS[(direction + 1) % 4] - _STEPS[direction]
    corner[turns[1] & turns[3]] += corner_shift[turns[1] & turns[3]]
    return [
        CellRing(corner[ring], (int(cell[ring[0], 0]), int(cell[ring[0], 1])))
        for ring in _find_cycles(after.tolist())
    ]


def _find_cycles(successors: list[int]) -> list[list[int]]:
    """Return the cycles of a permutation."""
    visited = bytearray(len(successors))
    cycles = []
    for first in range(len(successors)):
        if not visited[first]:
            cycle, at = [], first
            while not visited[at]:
                visited[at] = 1
                cycle.append(at)
                at = successors[at]
            cycles.append(cycle)
    return cycles


def compute_signed_area(corners: NDArray[Any]) -> float:
    """Return the area of a ring in the square of its unit, negative if it runs clockwise."""
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def simplify_rings(rings: Sequence[Ints], tolerance: float) -> list[Ints]:
    """Return the indices of the kept corners of an area's rings, by Douglas and Peucker.

    `tolerance` is the maximum distance of a dropped corner [cells]. It is halved until the area
    changes by at most 2 %.
    """
    exact = sum(map(compute_signed_area, rings))
    while tolerance >= 1 / 8:
        corner_indices = [_simplify_ring(ring, tolerance) for ring in rings]
        left = (ring[k] for ring, k in zip(rings, corner_indices, strict=True))
        areas = [compute_signed_area(ring) if len(ring) > 2 else 0.0 for ring in left]
        have_same_sign = all(
            a * compute_signed_area(ring) > 0 for a, ring in zip(areas, rings, strict=True)
        )
        if have_same_sign and abs(sum(areas) - exact) <= 0.02 * exact:
            return corner_indices
        tolerance /= 2
    return [np.arange(len(ring)) for ring in rings]


def _simplify_ring(ring: Ints, tolerance: float) -> Ints:
    """Return the indices of the corners that Douglas and Peucker's algorithm keeps."""
    import cv2

    corners = cv2.approxPolyDP(ring.astype(np.int32)[:, None], QUARTERS * tolerance, True)[:, 0]
    index = {tuple(at): n for n, at in enumerate(ring.tolist())}
    return np.sort([index[tuple(at)] for at in corners.tolist()])


def untangle_rings(rings: Sequence[Ints], corner_indices: Sequence[Ints]) -> list[Ints]:
    """Return the kept corners, with corners added back until no lines meet."""
    corner_indices = list(corner_indices)
    while True:
        corners = [ring[k] for ring, k in zip(rings, corner_indices, strict=True)]
        bounds = np.cumsum([0, *map(len, corners)])
        met = mark_crossing_lines(corners)
        if not met.any():
            return corner_indices
        for n in np.flatnonzero(np.add.reduceat(met, bounds[:-1])).tolist():
            lines = np.flatnonzero(met[bounds[n] : bounds[n + 1]]).tolist()
            extra_corners = [
                _find_farthest_corner(rings[n], corner_indices[n], line) for line in lines
            ]
            corner_indices[n] = np.unique(np.concatenate([corner_indices[n], *extra_corners]))


def _find_farthest_corner(ring: Ints, corner_indices: Ints, line_number: int) -> Ints:
    """Return the index of the dropped corner farthest from a line; empty without one."""
    first, last = (
        corner_indices[line_number],
        corner_indices[(line_number + 1) % len(corner_indices)],
    )
    left_out = np.arange(first + 1, last if last > first else last + len(ring)) % len(ring)
    if not left_out.size:
        return left_out
    (dx, dy), (x, y) = ring[last] - ring[first], (ring[left_out] - ring[first]).T
    distances = np.abs(dx * y - dy * x)
    farthest = int(np.argmax(distances)) if distances.any() else len(distances) // 2
    return np.asarray(left_out[farthest : farthest + 1])


def mark_crossing_lines(rings: Sequence[Ints]) -> Bools:
    """Mark the lines of the rings that meet any line except their neighbours, (n,)."""
    sizes = [len(ring) for ring in rings]
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    offsets = np.repeat(np.cumsum([0, *sizes[:-1]]), sizes)
    after = offsets + (np.arange(len(start)) - offsets + 1) % np.repeat(sizes, sizes)
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(low[:, 0], kind="stable")
    lefts = low[order, 0]
    met = np.zeros(len(start), bool)
    for first in range(0, len(start), _CHUNK):
        chunk = order[first : first + _CHUNK]
        candidates = order[first : np.searchsorted(lefts, high[chunk, 0].max(), side="right")]
        near = np.arange(len(candidates)) > np.arange(len(chunk))[:, None]
        near &= low[candidates, 0] <= high[chunk, 0][:, None]
        near &= low[candidates, 1] <= high[chunk, 1][:, None]
        near &= high[candidates, 1] >= low[chunk, 1][:, None]
        a, b = np.nonzero(near)
        i, j = chunk[a], candidates[b]
        along, across = end[i] - start[i], end[j] - start[j]
        touch = _multiply_side_signs(along, start[i], start[j], end[j]) <= 0
        touch &= _multiply_side_signs(across, start[j], start[i], end[i]) <= 0
        neighbours = (after[i] == j) | (after[j] == i)
        back = (_compute_cross_products(along, across) == 0) & (np.sum(along * across, axis=1) < 0)
        bad = np.where(neighbours, back, touch)
        met[i[bad]] = met[j[bad]] = True
    return met


def _multiply_side_signs(along: Ints, origin: Ints, first: Ints, second: Ints) -> Ints:
    """Return at most 0 if two points do not lie strictly on one side of a line."""
    return np.sign(_compute_cross_products(along, first - origin)) * np.sign(
        _compute_cross_products(along, second - origin)
    )


def _compute_cross_products(a: Ints, b: Ints) -> Ints:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def make_polygons(
    mask: Bools, labels: NDArray[np.int32], min_hole_cells: float
) -> dict[int, list[Ints]]:
    """Return the rings of each label, outline first; holes of fewer cells are filled."""
    of_label: dict[int, list[CellRing]] = {}
    for ring in trace_rings(mask):
        of_label.setdefault(int(labels[ring.cell]), []).append(ring)
    rings, corner_indices, owners = [], [], []
    for label, label_rings in of_label.items():
        areas = np.array([compute_signed_area(ring.corners) / QUARTERS**2 for ring in label_rings])
        first, *holes = np.argsort(-areas, kind="stable").tolist()  # the smallest holes come first
        total = np.cumsum(-areas[holes])
        # Holes that are filled have at most 2 % of the area.
        filled = (areas[holes] > -min_hole_cells) & (total <= 0.02 * areas[first])
        corners = [label_rings[n].corners for n in (first, *np.array(holes, int)[~filled].tolist())]
        rings += corners
        corner_indices += simplify_rings(corners, 1.0)  # [cells], which makes steps straight
        owners += [label] * len(corners)
    polygons: dict[int, list[Ints]] = {}
    if rings:
        for label, ring, indices in zip(
            owners, rings, untangle_rings(rings, corner_indices), strict=True
        ):
            polygons.setdefault(label, []).append(ring[indices])
    return polygons


def find_middle_cell(inside: Bools) -> tuple[int, int]:
    """Return the cell nearest to the mean of the cells far from an area's edge, (H, W)."""
    import cv2

    distance = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)
    cells = np.argwhere(distance[1:-1, 1:-1] >= 0.9 * distance.max())
    row, col = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))].tolist()
    return row, col


def find_degenerate_areas(
    costs: Costmap, field: CovarianceField, *, threshold: float | None = None, min_area: float = 1.0
) -> tuple[DegenerateArea, ...]:
    """Find the areas where u is at least a threshold, the largest first.

    Cells that share an edge are connected. Polygons follow the edges of cells to within a cell and
    never intersect. Holes below 0.1 m^2 are filled, up to 2 % of an area.

    Parameters
    ----------
    costs : Costmap
        The costmap of the field; its law and criterion define u. A costmap without a field has no
        areas.
    field : CovarianceField
        The field; several headings count by their mean information.
    threshold : float, optional
        Minimum u of a cell, 0..1; by default half of the u of a corridor without features: .5 for
        estimators that know the lidar, .18 for `Sad`. A lower one makes more and larger areas.
    min_area : float, default 1.0
        Minimum area [m^2], >= 0. Areas of a few lattice points may be chance.

    Returns
    -------
    tuple of DegenerateArea
        Empty if no area is large enough.

    Raises
    ------
    ConfigError
        If a number is out of its limits.
    FieldError
        If the field belongs to another map.

    Examples
    --------
    >>> import locplan
    >>> from locplan.maps import environments
    >>> grid = environments.make("two_corridors", resolution=0.1)
    >>> field = locplan.covariance_field(grid, locplan.Sad(range=3.0))
    >>> costs = locplan.Costmap.from_field(field)
    >>> area, *_ = locplan.advice.weak_spots.find_degenerate_areas(costs, field)
    >>> area.outline.shape[1], area.area >= 1
    (2, True)
    """
    import cv2

    if threshold is not None:
        check_number("threshold", threshold, 0, 1)
    check_number("min_area", min_area, 0)
    check_costs(costs)
    check_instance("field", field, CovarianceField, "compute one with locplan.load_or_compute")
    if field.grid.digest != costs.grid.digest:
        raise FieldError("the field belongs to another map than the costmap; compute it for this")
    threshold = _choose_threshold(costs, field, threshold)
    grid = costs.grid
    cell_area = grid.resolution**2
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(
        (costs.u >= threshold).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
    )
    sizes = boxes[:, cv2.CC_STAT_AREA] * cell_area
    large = np.flatnonzero(sizes[1:] >= min_area - 1e-9) + 1
    large = large[np.argsort(-sizes[large], kind="stable")]
    is_large = np.isin(np.arange(len(sizes)), large)
    # Holes below 0.1 m^2 are filled, such as the legs of tables.
    polygons = make_polygons(is_large[labels], labels, min(0.1, min_area) / cell_area)
    points = _group_covariances(field, labels)
    areas = []
    for label in large.tolist():
        left, low, width, height = boxes[label, :4].tolist()
        window = slice(low, low + height), slice(left, left + width)
        inside = labels[window] == label
        row, col = find_middle_cell(inside)
        covariance = points.get(label)
        if covariance is None:
            covariance = _read_covariances(field, np.argwhere(inside) + np.array([low, left]))
        outline, *holes = (
            np.stack(grid.grid_to_world(*corners.T[::-1] / QUARTERS), axis=1)
            for corners in polygons[label]
        )
        middle = grid.position(row + low, col + left)
        position_std, heading_std, direction, agreement = _summarize_covariances(covariance)
        areas.append(
            DegenerateArea(
                outline=outline,
                holes=tuple(holes),
                middle=middle,
                area=float(sizes[label]),
                position_std=position_std,
                heading_std=heading_std,
                direction=direction,
                agreement=agreement,
            )
        )
    return tuple(areas)


def _choose_threshold(costs: Costmap, field: CovarianceField, threshold: float | None) -> float:
    """Return the threshold, by default half of the u of a corridor without features.

    For the criterion of position deviations, u of such a corridor is 1. For e it is less, since e
    includes the position across and the heading. On a logarithmic scale, half of it is the
    geometric mean of the deviations of a perfect match and of no match: 0.21 m for estimators that
    know the lidar, 0.26 m for `Sad`. For a custom u it is the threshold of degenerate metres.
    """
    if threshold is not None:
        return threshold
    settings, estimator = costs.settings, field.config.estimator
    if settings is None or settings.criterion not in ("e", "position_std", "position_rms"):
        return DEGENERATE
    corridor = estimator.perfect(field.window).copy()
    corridor[0, 0] = estimator.featureless(field.window)[0, 0]
    perfect_value, featureless_value = field.anchors(settings.criterion)
    value = float(scalar(corridor, settings.criterion))
    if settings.law == "logarithmic":
        return math.log(value / perfect_value) / math.log(featureless_value / perfect_value) / 2
    share = value / featureless_value
    return (share ** (1 / 3) if settings.law == "cube-root" else share) / 2


def _group_covariances(field: CovarianceField, labels: NDArray[np.int32]) -> dict[int, Floats]:
    """Return the covariances on the lattice points of each label, (n, d, d)."""
    owner = np.where(field.is_evaluated, labels[:: field.stride, :: field.stride], 0)
    rows, cols = np.nonzero(owner)
    order = np.argsort(owner[rows, cols], kind="stable")
    rows, cols = rows[order], cols[order]
    label_values, starts = np.unique(owner[rows, cols], return_index=True)
    parts = np.split(field.average_headings[rows, cols], starts[1:])
    return dict(zip(label_values.tolist(), parts, strict=True)) if label_values.size else {}


def _read_covariances(field: CovarianceField, cells: Ints) -> Floats:
    """Interpolate covariances at cells (n, 2) of an area between lattice points."""
    sampled_cells = cells[:: -(-len(cells) // 50)]
    xy = np.column_stack(field.grid.grid_to_world(*(sampled_cells + 0.5).T))
    covariances = field.at(xy, "covariance")
    return covariances[np.isfinite(covariances).all(axis=(1, 2))]


def _summarize_covariances(covariance: Floats) -> tuple[float, float, float, float]:
    """Return position_std, heading_std, direction and agreement of covariances (n, d, d)."""
    major, minor, direction = position_axes(covariance)
    heading = scalar(covariance, "heading_std")
    if covariance.shape[-1] == 2:
        heading = np.full_like(heading, np.nan)
    total = major**2 + minor**2
    longer = np.divide(major**2 - minor**2, total, where=total > 0, out=np.zeros_like(total))
    mean = np.mean(longer * np.exp(2j * direction))  # a line's directions are alike, doubled
    return (
        float(np.median(major)),
        float(np.median(heading)),
        float(np.angle(mean) / 2),
        float(np.abs(mean)),
    )


@dataclass(frozen=True, eq=False, repr=False)
class WeakSpot:
    """A degenerate place of the map, or another place at which drives fail."""

    letter: str
    """Its letter on the picture, A for the worst; empty beyond the sixth."""
    x: float
    """World x of a place in it, which a route passes if one does [m]."""
    y: float
    """World y of it [m]."""
    length: float
    """Its extent along the direction in which a pose is uncertain [m]."""
    width: float
    """Its extent across [m]."""
    direction: float
    """Direction in which a pose is uncertain, from x, 0..pi [rad]; NaN without a common one."""
    position_std: float
    """Standard deviation of a pose match along it, the median over the spot [m]; NaN where no scan
    is weak."""
    heading_std: float
    """Standard deviation of the heading, the median over the spot [rad]; NaN where no scan is."""
    missing: str
    """What is missing there, in words."""
    routes: tuple[str, ...]
    """Names of the routes that pass it."""
    outline: Floats
    """Corners [m], (n, 2); none where no scan is weak."""
    holes: tuple[Floats, ...] = ()
    """Corners of the holes [m], (n, 2) each."""
    lost: int = 0
    """Number of the baseline's drives that get lost in it, or up to 10 m after."""
    stopped: int = 0
    """Number of the baseline's closed-loop drives that stop there, short of the goal."""

    def __repr__(self) -> str:
        return f"WeakSpot({self.letter}: {self.size} at {self.place}, {self.missing})"

    @property
    def place(self) -> str:
        """Position as text [m]."""
        return f"({self.x:.1f}, {self.y:.1f})"

    @property
    def size(self) -> str:
        """Its extent as text."""
        return f"{self.length:.0f} x {self.width:.0f} m" if self.rings else "-"

    @property
    def deviation(self) -> str:
        """The standard deviation of a scan match there, as text."""
        if not self.rings:
            return "-"
        if self.missing == NO_HEADING:
            return f"{math.degrees(self.heading_std):.0f} deg"
        return f"{100 * self.position_std:.0f} cm"

    @property
    def rings(self) -> tuple[Floats, ...]:
        """Corners of its outline and holes [m]; empty for a place that is not degenerate."""
        return (self.outline, *self.holes) if len(self.outline) else ()

    @property
    def severity(self) -> tuple[float, ...]:
        """Sort key: failed drives, then deviation x length x number of routes."""
        weight = self.position_std * self.length if self.rings else 0.0
        return self.lost + self.stopped, self.stopped, weight * len(self.routes), weight


NO_HEADING, SCANS_FIT = "no corner fixes the heading", "the filter errs although scans fit"
"""Reasons if only the heading is uncertain, and at a place that is not degenerate."""


def find_weak_spots(
    costs: Costmap, field: CovarianceField, lidar_range: float, paths: Mapping[str, Path]
) -> tuple[WeakSpot, ...]:
    """Find the weak spots of a map, sorted by deviation x length x number of passing routes.

    Only parts of the map that are connected to a route count; without routes, the largest part.

    Parameters
    ----------
    costs : Costmap
        The costmap of the field.
    field : CovarianceField
        The field.
    lidar_range : float
        Maximum lidar range that the filter uses [m].
    paths : mapping of str to Path
        The routes by name.
    """
    lines = {name: sample_path(path) for name, path in paths.items()}
    reachable = _mark_reachable(costs, lines)
    costs = replace(costs, u=np.where(reachable, costs.u, np.nan))
    free = np.count_nonzero(reachable) * costs.grid.resolution**2
    spots = [
        _make_spot(area, costs.grid, lidar_range, lines)
        for area in _find_large_enough_areas(costs, field, free)
    ]
    return tuple(sorted(spots, key=lambda spot: spot.severity, reverse=True))


def _mark_reachable(costs: Costmap, lines: Mapping[str, Floats]) -> Bools:
    """Mark the free cells that the robot covers in the parts of the map with routes.

    Without routes, mark the largest part.
    """
    import cv2

    _, labels = label_connected_parts(costs)
    if lines:
        rows, cols = (
            np.clip(np.floor(coordinates).astype(int), 0, size - 1)
            for coordinates, size in zip(
                costs.grid.world_to_grid(*np.concatenate([*lines.values()]).T),
                labels.shape,
                strict=True,
            )
        )
        passed = np.setdiff1d(labels[rows, cols], [0])
    else:
        sizes = np.bincount(labels.ravel(), minlength=2)
        passed = np.array([1 + sizes[1:].argmax()])
    drivable = np.isin(labels, passed)
    distance = cv2.distanceTransform((~drivable).astype(np.uint8), cv2.DIST_L2, 5)
    near = distance * costs.grid.resolution <= costs.robot_radius + costs.grid.resolution
    return np.asarray(near & costs.grid.free)


def _find_large_enough_areas(
    costs: Costmap, field: CovarianceField, free_area: float
) -> tuple[DegenerateArea, ...]:
    """Return the degenerate areas; a higher threshold divides areas of a quarter of the map."""
    areas: tuple[DegenerateArea, ...] = ()
    for threshold in (None, 0.6, 0.7, 0.8, 0.9):  # minimum u of a spot's cells
        before, areas = areas, find_degenerate_areas(costs, field, threshold=threshold)
        if not areas:
            return before
        if areas[0].area < 0.25 * free_area:  # else an area takes too much of the map
            break
    return areas


def _make_spot(
    area: DegenerateArea, grid: OccupancyGrid, lidar_range: float, lines: Mapping[str, Floats]
) -> WeakSpot:
    direction = area.direction % math.pi
    along = np.array([math.cos(direction), math.sin(direction)])
    length, width = (float(np.ptp(area.outline @ way)) for way in (along, along[::-1] * [-1, 1]))
    passing = {
        name: inner_points
        for name, line in lines.items()
        if len(inner_points := line[are_inside(area, line)])
    }
    longest = max(passing.values(), key=len, default=np.array([area.middle]))
    x, y = longest[len(longest) // 2].tolist()
    turns = area.heading_std > math.radians(10) and area.position_std < 0.2
    degrees = round(math.degrees(direction)) % 180
    axis = {0: "x", 9: "y", 18: "x"}.get(round(degrees / 10), f"{degrees} deg")
    missing = f"no features along {axis}"
    if compute_visible_share(grid, (x, y), lidar_range) < 0.35:  # of the directions
        missing = f"few walls within {lidar_range:g} m"
    elif turns:
        missing = NO_HEADING
    elif not area.has_common_direction:
        missing = "no long wall, only clutter"
    return WeakSpot(
        letter="",
        x=x,
        y=y,
        length=length,
        width=width,
        direction=direction if area.has_common_direction else math.nan,
        position_std=area.position_std,
        heading_std=area.heading_std,
        missing=missing,
        routes=tuple(passing),
        outline=area.outline,
        holes=area.holes,
    )


def compute_visible_share(grid: OccupancyGrid, xy: tuple[float, float], max_range: float) -> float:
    """Return the share of 72 directions with a wall within a range of a place [m]."""
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    steps = np.arange(0.0, max_range, grid.resolution / 2)
    at = grid.world_to_grid(xy[0] + steps * np.cos(angles), xy[1] + steps * np.sin(angles))
    rows, cols = (np.floor(indices).astype(int) for indices in at)
    height, width = grid.shape
    is_inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    walls = grid.cells[np.where(is_inside, rows, 0), np.where(is_inside, cols, 0)] == OCCUPIED
    return float((walls & is_inside).any(axis=1).mean())


def sample_path(path: Path) -> Floats:
    """Return the points of a path every 0.25 m, (n, 2) [m]."""
    return np.asarray(path.resample(0.25, even=True).xy)


def are_inside_outline(outline: Floats, points: Floats) -> Bools:
    """Mark the points (n, 2) inside an outline, (n,)."""
    import cv2

    if not len(outline):
        return np.zeros(len(points), np.bool_)
    corners = outline.astype(np.float32)
    tested = [cv2.pointPolygonTest(corners, (x, y), False) for x, y in points.tolist()]
    return np.array(tested) >= 0


def are_inside(area: DegenerateArea | WeakSpot, points: Floats) -> Bools:
    """Mark the points (n, 2) inside an area and outside its holes, (n,)."""
    is_inside = are_inside_outline(area.outline, points)
    for hole in area.holes:
        is_inside &= ~are_inside_outline(hole, points)
    return is_inside


def group_positions(xy: Floats, radius: float) -> list[tuple[Floats, Ints]]:
    """Group positions, the largest group first: each group's centre and member indices.

    Parameters
    ----------
    xy : (n, 2) array
        The positions [m].
    radius : float
        The radius [m].
    """
    near = np.linalg.norm(xy[:, None] - xy, axis=2) <= radius
    left, groups = np.ones(len(xy), np.bool_), []
    while left.any():
        middle = int(np.argmax((near & left).sum(axis=1) * left))
        groups.append((xy[middle], np.flatnonzero(near[middle] & left)))
        left &= ~near[middle]
    return groups

"""Degenerate areas, and how cells become polygons: rings along their edges, with fewer corners.

Rings are (n, 2) arrays of whole numbers, the columns and rows of their corners in quarters of a
cell, without the first corner once more at the end. The area lies to their left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats, Ints

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
    """1 where all places are uncertain along that line only, 0 where there is no common one."""

    @property
    def agrees(self) -> bool:
        """Whether the area counts as uncertain along one line, which robots drive along."""
        return self.agreement >= 0.5

    def __repr__(self) -> str:
        return (
            f"DegenerateArea({self.area:.3g} m²,"
            f" position std. deviation {100 * self.position_std:.3g} cm)"
        )


class Ring(NamedTuple):
    """A closed line around an area of cells, or around a hole in it."""

    corners: Ints
    """Columns and rows of its corners [quarters of a cell], (n, 2), one a cell's edge."""
    cell: tuple[int, int]
    """Row and column of a cell of the area, beside the ring."""


def rings_of(mask: Bools) -> list[Ring]:
    """All rings along the edges of the cells of a mask, (H, W).

    Cells that meet at a corner alone do not belong together: both sides keep a quarter of a cell
    away from it, so that no ring meets itself or another one.
    """
    inside = np.pad(mask, 1)
    width = inside.shape[1]
    codes, cells = [], []
    for side, (first, ahead) in enumerate([((0, 0), -1), ((0, 1), 1), ((1, 1), 1), ((1, 0), -1)]):
        beside = np.roll(inside, -ahead, axis=side % 2)
        rows, cols = np.nonzero(inside & ~beside)
        starts = (rows + first[0]) * width + cols + first[1]
        codes.append(4 * starts + side)
        cells.append(np.column_stack([rows, cols]) - 1)
    code, cell = np.concatenate(codes), np.concatenate(cells)
    if not code.size:
        return []
    order = np.argsort(code)
    code, cell = code[order], cell[order]
    direction = code % 4
    end = code // 4 + np.array([1, width, -1, -width])[direction]
    after = np.empty(len(code), np.int64)
    turns = {}
    for turn in (3, 0, 1):  # a left turn, which stays at the same cell, comes last and wins
        following = 4 * end + (direction + turn) % 4
        found = np.minimum(np.searchsorted(code, following), len(code) - 1)
        turns[turn] = code[found] == following
        after[turns[turn]] = found[turns[turn]]
    corner = QUARTERS * (np.column_stack([end % width, end // width]) - 1)
    away = _STEPS[(direction + 1) % 4] - _STEPS[direction]
    corner[turns[1] & turns[3]] += away[turns[1] & turns[3]]
    return [
        Ring(corner[ring], (int(cell[ring[0], 0]), int(cell[ring[0], 1])))
        for ring in _cycles(after.tolist())
    ]


def _cycles(after: list[int]) -> list[list[int]]:
    """The cycles of a permutation."""
    seen = bytearray(len(after))
    cycles = []
    for first in range(len(after)):
        if not seen[first]:
            cycle, at = [], first
            while not seen[at]:
                seen[at] = 1
                cycle.append(at)
                at = after[at]
            cycles.append(cycle)
    return cycles


def signed_area(corners: NDArray[Any]) -> float:
    """Area of a ring in the square of its unit, negative if it runs clockwise."""
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def thinned(rings: Sequence[Ints], tolerance: float) -> list[Ints]:
    """The corners that are left of an area's rings, as sorted indices, by Douglas and Peucker.

    `tolerance` is the greatest distance of a corner that is left out [cells]; less is taken where
    the area would change by more than 2 %.
    """
    exact = sum(map(signed_area, rings))
    while tolerance >= 1 / 8:
        kept = [_kept(ring, tolerance) for ring in rings]
        left = (ring[k] for ring, k in zip(rings, kept, strict=True))
        areas = [signed_area(ring) if len(ring) > 2 else 0.0 for ring in left]
        alike = all(a * signed_area(ring) > 0 for a, ring in zip(areas, rings, strict=True))
        if alike and abs(sum(areas) - exact) <= 0.02 * exact:
            return kept
        tolerance /= 2
    return [np.arange(len(ring)) for ring in rings]


def _kept(ring: Ints, tolerance: float) -> Ints:
    """Indices of the corners that Douglas and Peucker keep."""
    import cv2

    corners = cv2.approxPolyDP(ring.astype(np.int32)[:, None], QUARTERS * tolerance, True)[:, 0]
    index = {tuple(at): n for n, at in enumerate(ring.tolist())}
    return np.sort([index[tuple(at)] for at in corners.tolist()])


def untangled(rings: Sequence[Ints], kept: Sequence[Ints]) -> list[Ints]:
    """The corners that are left, and as many more as it takes that no lines meet."""
    kept = list(kept)
    while True:
        corners = [ring[k] for ring, k in zip(rings, kept, strict=True)]
        bounds = np.cumsum([0, *map(len, corners)])
        met = meeting(corners)
        if not met.any():
            return kept
        for n in np.flatnonzero(np.add.reduceat(met, bounds[:-1])).tolist():
            lines = np.flatnonzero(met[bounds[n] : bounds[n + 1]]).tolist()
            more = [_between(rings[n], kept[n], line) for line in lines]
            kept[n] = np.unique(np.concatenate([kept[n], *more]))


def _between(ring: Ints, kept: Ints, line: int) -> Ints:
    """Index of the corner farthest from a line that left it out; none if it left out none."""
    first, last = kept[line], kept[(line + 1) % len(kept)]
    left_out = np.arange(first + 1, last if last > first else last + len(ring)) % len(ring)
    if not left_out.size:
        return left_out
    (dx, dy), (x, y) = ring[last] - ring[first], (ring[left_out] - ring[first]).T
    away = np.abs(dx * y - dy * x)
    farthest = int(np.argmax(away)) if away.any() else len(away) // 2
    return np.asarray(left_out[farthest : farthest + 1])


def meeting(rings: Sequence[Ints]) -> Bools:
    """Whether each line of the rings, one after the other, meets any but its neighbours' ends."""
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
        some = order[first : first + _CHUNK]
        others = order[first : np.searchsorted(lefts, high[some, 0].max(), side="right")]
        near = np.arange(len(others)) > np.arange(len(some))[:, None]
        near &= low[others, 0] <= high[some, 0][:, None]
        near &= low[others, 1] <= high[some, 1][:, None]
        near &= high[others, 1] >= low[some, 1][:, None]
        a, b = np.nonzero(near)
        i, j = some[a], others[b]
        along, across = end[i] - start[i], end[j] - start[j]
        touch = _sides(along, start[i], start[j], end[j]) <= 0
        touch &= _sides(across, start[j], start[i], end[i]) <= 0
        neighbours = (after[i] == j) | (after[j] == i)
        back = (_cross(along, across) == 0) & (np.sum(along * across, axis=1) < 0)
        bad = np.where(neighbours, back, touch)
        met[i[bad]] = met[j[bad]] = True
    return met


def _sides(along: Ints, origin: Ints, one: Ints, other: Ints) -> Ints:
    """At most 0 where two points do not lie strictly on one side of a line."""
    return np.sign(_cross(along, one - origin)) * np.sign(_cross(along, other - origin))


def _cross(a: Ints, b: Ints) -> Ints:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def polygons_of(mask: Bools, labels: NDArray[np.int32], min_hole: float) -> dict[int, list[Ints]]:
    """The rings of each label, its outline first; holes of fewer cells are filled."""
    of_label: dict[int, list[Ring]] = {}
    for ring in rings_of(mask):
        of_label.setdefault(int(labels[ring.cell]), []).append(ring)
    rings, kept, owners = [], [], []
    for label, own in of_label.items():
        areas = np.array([signed_area(ring.corners) / QUARTERS**2 for ring in own])
        first, *holes = np.argsort(areas)[::-1].tolist()  # the smallest holes come first
        total = np.cumsum(-areas[holes])
        # Holes that are filled have at most 2 % of the area.
        filled = (areas[holes] > -min_hole) & (total <= 0.02 * areas[first])
        corners = [own[n].corners for n in (first, *np.array(holes, int)[~filled].tolist())]
        rings += corners
        kept += thinned(corners, 1.0)  # [cells], which makes steps straight
        owners += [label] * len(corners)
    polygons: dict[int, list[Ints]] = {}
    if rings:
        for label, ring, few in zip(owners, rings, untangled(rings, kept), strict=True):
            polygons.setdefault(label, []).append(ring[few])
    return polygons


def middle_of(inside: Bools) -> tuple[int, int]:
    """Of the cells far from the edge of an area (H, W), that nearest to their mean."""
    import cv2

    distance = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)
    cells = np.argwhere(distance[1:-1, 1:-1] >= 0.9 * distance.max())
    row, col = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))].tolist()
    return row, col

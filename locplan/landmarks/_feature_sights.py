"""The features of a map, objects and pieces of walls, and what a robot sees without them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats, Ints, Singles
from locplan.field import NORMAL_REACH, surface_normals
from locplan.landmarks._sight import Surroundings
from locplan.maps import OCCUPIED, OccupancyGrid

OBJECT, CORNER, WALL = "object", "corner", "wall"
"""Kinds of features: what stands free; walls at corners, ends and door frames; other walls."""


def pieces_of(
    occupied: Bools, met: Ints, resolution: float, piece: float, largest: float, gap: float
) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Divide what a robot sees into features.

    Occupied cells that are joined (also by their corners) are one object, up to a greatest
    extent, with those that are a small gap away: outlines on maps are often broken. Larger ones
    are walls: a piece of them is what is nearest to its middle. The middles are the corners, the
    sharpest first, and between them the wall is divided evenly.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.
    met : (k,) array of int
        Cells that rays meet, row * W + col; what has none is no feature.
    resolution : float
        Edge of a cell [m].
    piece : float
        Length of a piece [m].
    largest : float
        Maximum extent of an object [m].
    gap : float
        Maximum gap between the parts of one object [m].

    Returns
    -------
    labels : (H, W) array of int
        Number of the feature that a cell belongs to, or -1.
    kinds : tuple of str
        Kind of each feature: object, corner or wall.
    """
    from scipy.spatial import cKDTree

    parts, boxes, small = _components(occupied, resolution, largest, gap)
    rows, cols = np.divmod(np.unique(met), occupied.shape[1])
    of_met = parts[rows, cols]
    seen = np.unique(of_met)
    objects = seen[small[seen]]
    numbers = np.full(len(boxes), -1, np.int32)
    numbers[objects] = np.arange(len(objects))
    labels = numbers[parts]
    kinds = [OBJECT] * len(objects)
    for part in seen[~small[seen]].tolist():
        own = of_met == part
        at = np.column_stack([rows[own], cols[own]])
        left, top, right, bottom = boxes[part].tolist()
        window = slice(top, bottom + 1), slice(left, right + 1)
        corner = np.array([top, left])
        inside = parts[window] == part
        sharp = _cornerness(inside, piece, resolution)[tuple((at - corner).T)]
        middles, number = _middles(at, sharp, piece / resolution)
        # Each cell belongs to the nearest middle within a piece, if there is one.
        apart, nearest = cKDTree(middles - corner).query(
            np.argwhere(inside), distance_upper_bound=max(piece / resolution, 1.5)
        )
        labels[window][inside] = np.where(np.isfinite(apart), nearest + len(kinds), -1)
        kinds += [CORNER] * number + [WALL] * (len(middles) - number)
    return np.ascontiguousarray(labels, np.int32), tuple(kinds)


def _components(
    occupied: Bools, resolution: float, largest: float, gap: float
) -> tuple[NDArray[np.int32], Ints, Bools]:
    """Number of what each cell is joined with (H, W), boxes, and which are objects.

    A box is the first and last column and row of the cells that are joined without a gap
    (left, top, right, bottom), (k, 4).
    """
    import cv2

    _, parts, about, _ = cv2.connectedComponentsWithStats(occupied.astype(np.uint8), connectivity=8)
    corner = about[:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP]]
    sides = about[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    boxes = np.concatenate([corner, corner + sides - 1], axis=1).astype(np.int64)

    def fit(boxes: Ints) -> Bools:
        sides = boxes[:, 2:] - boxes[:, :2] + 1
        return np.asarray(np.hypot(*sides.T) * resolution <= largest)

    small = fit(boxes)
    wider = int(gap / (2 * resolution) + 1e-9)
    mask = small[parts] & occupied
    if not wider or not mask.any():
        return parts, boxes, small
    size = 2 * wider + 1
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8))
    count, groups = cv2.connectedComponents(grown, connectivity=8)
    group = np.zeros(len(boxes), np.int64)
    group[parts[mask]] = groups[mask]
    signs = np.array([1, 1, -1, -1])  # so that least values are the farthest on all sides
    ends = np.full((count, 4), np.iinfo(np.int64).max)
    own = boxes * signs
    np.minimum.at(ends, group[small], own[small])
    together = small & fit(ends * signs)[group]
    first = np.full(count, len(boxes))
    numbers = np.arange(len(boxes))
    np.minimum.at(first, group[together], numbers[together])
    numbers[together] = first[group[together]]
    return numbers[parts].astype(np.int32), boxes, small


def _cornerness(solid: Bools, piece: float, resolution: float) -> Floats:
    """How far the outline turns about each cell, 1 for a right angle, (h, w)."""
    import cv2

    # Greatest distance of what cornerness looks at [cells].
    size = 2 * min(max(1, round(piece / 4 / resolution)), 200) + 1
    edge: Any = {"borderType": cv2.BORDER_CONSTANT}

    def response(cells: Bools) -> Floats:
        padded = np.pad(cells.astype(np.float32), size)  # nothing beyond is occupied
        soft = cv2.GaussianBlur(padded, (0, 0), 1.0, **edge)
        found = cv2.cornerMinEigenVal(soft, size, ksize=3)
        return np.asarray(found[size:-size, size:-size], np.float64)

    ideal = np.ones((2 * size, 2 * size), bool)
    return np.asarray(response(solid) / response(ideal)[0, 0])


def _middles(at: Ints, sharp: Floats, piece: float) -> tuple[Ints, int]:
    """Middles of a wall's pieces (k, 2), the corners first, and the number of corners [cells]."""
    from scipy.spatial import cKDTree

    tree = cKDTree(at)
    order = np.argsort(-sharp.round(6), kind="stable")
    # A corner has at least 0.3 of a right angle's cornerness.
    free = sharp >= 0.3
    chosen: list[int] = []
    for n in order[: int(free.sum())].tolist():
        if free[n]:
            chosen.append(n)
            free[tree.query_ball_point(at[n], piece / 2)] = False
    corners = len(chosen)
    if not chosen:  # begin at an end
        chosen.append(int(np.argmax(np.hypot(*(at - at.mean(axis=0)).T))))
    apart = np.full(len(at), math.inf)
    for n in chosen:
        apart = np.minimum(apart, np.hypot(*(at - at[n]).T))
    # Greatest distance of a wall's cell from the middle of its piece, in lengths of a piece.
    while apart.max() > 0.6 * piece:
        n = int(np.argmax(apart))
        chosen.append(n)
        apart = np.minimum(apart, np.hypot(*(at - at[n]).T))
    return at[chosen], corners


class Sights:
    """Hits of all rays, and P along the routes, without some features.

    Without an object its cells are free: rays reach what lies behind, and surfaces beside it have
    the normals of the map without it. A piece of a wall is no window: rays that meet it count
    for nothing, and no edge comes up where it ends. The number of hits that a filter's model counts
    stays that of the map, as with objects that are added.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    seen : Surroundings
        Poses of the robot, and its models.
    piece, largest, gap : float
        See `pieces_of`.
    """

    def __init__(
        self, grid: OccupancyGrid, seen: Surroundings, piece: float, largest: float, gap: float
    ) -> None:
        from locplan._kernels.landmarks import sums_of
        from locplan._kernels.rays import empty_squares

        self.grid, self.seen = grid, seen
        self._standing = occupied = grid.cells == OCCUPIED
        self._squares, self._normals = empty_squares(occupied), surface_normals(occupied)
        self._labels, self._silent = np.full(occupied.shape, -1, np.int32), np.zeros(1, bool)
        count, beams = len(seen.rays.first), seen.rays.beams
        self._hits, self._cells = self._look(np.arange(count * beams))
        self.sums = sums_of(self._hits.reshape(count, beams, 4), seen.rays)
        met = np.unique(self._cells[self._cells >= 0])
        division = pieces_of(occupied, met, grid.resolution, piece, largest, gap)
        self._labels, self.kinds = division
        self._silent = np.zeros(max(len(self.kinds), 1), bool)
        at = np.argwhere(self._labels >= 0)
        labels = self._labels[tuple(at.T)]
        ends = np.cumsum(np.bincount(labels, minlength=len(self.kinds)))
        self.whole = np.split(at[np.argsort(labels, kind="stable")], ends[:-1])
        """Rows and columns of each feature's cells, (k, 2)."""
        self._patches: dict[int, tuple[Any, Any, Any]] = {}
        self._sort()

    @property
    def positions(self) -> Floats:
        """World x and y of the poses, (n, 2) [m]."""
        at = self.seen.rays.poses / self.grid.resolution
        return np.column_stack(self.grid.grid_to_world(at[:, 1], at[:, 0]))

    def profile(self) -> Floats:
        """P_xx + P_yy at each pose, (n,) [m^2]."""
        return self.seen.profile(self.sums)

    def without(self, feature: int) -> Floats:
        """P_xx + P_yy at each pose with this feature away, too, (n,) [m^2]."""
        rays, new, _ = self._changes(feature)
        return self.seen.profile(self._summed(rays, new))

    def take(self, feature: int) -> None:
        """Take a feature away for good."""
        rays, new, cells = self._changes(feature)
        self.sums = self._summed(rays, new)
        self._hits[rays], self._cells[rays] = new, cells
        if self.kinds[feature] == OBJECT:
            rows, cols = self.whole[feature].T
            window, normals, _ = self._patch(feature)
            self._normals[window] = normals
            self._standing[rows, cols] = False
            self._squares[:, rows + 1, cols + 1] = 1
            self._patches.clear()
        else:
            self._silent[feature] = True
        self._sort()

    def rays_of(self, feature: int) -> Ints:
        """Rays that meet a feature: pose * beams + beam, in order."""
        low, high = np.searchsorted(self._sorted_labels, [feature, feature + 1])
        return np.sort(self._by_label[low:high])

    def biases(self, feature: int) -> Floats:
        """Errors of the pose by a shift of the feature; see `objectives.biases`, (n, 3, 2)."""
        from locplan._kernels import objectives
        from locplan._kernels.landmarks import HITS, NORMAL_X, NORMAL_Y, RANGE, TURN

        seen, rays = self.seen, self.rays_of(feature)
        share = seen.a_step.share / (1 + seen.a_step.other * self.sums[:, HITS])
        hits = self._hits[rays].astype(np.float64)
        weight = np.zeros(len(rays))
        returns = np.isfinite(hits[:, RANGE])
        weight[returns] = 1 / (1 + seen.rays.swing * hits[returns, RANGE] ** 2)
        normals = hits[:, [NORMAL_X, NORMAL_Y]]
        gradients = hits[:, [NORMAL_X, NORMAL_Y, TURN]] * weight[:, None]
        pulls = np.zeros((len(self.sums), 3, 2))
        np.add.at(pulls, rays // seen.rays.beams, gradients[:, :, None] * normals[:, None, :])
        return np.asarray(
            objectives.biases(
                pulls * share[:, None, None],
                self.sums[:, :HITS] * share[:, None],
                seen.covariances(self.sums),
                seen.rays.poses,
                seen.routes,
            )
        )

    def _look(self, rays: Ints) -> tuple[Singles, Ints]:
        from locplan._kernels.features import look
        from locplan._kernels.landmarks import Surfaces

        hits, cells = np.zeros((len(rays), 4), np.float32), np.empty(len(rays), np.int64)
        surfaces = Surfaces(self._squares, self._normals, self.grid.resolution)
        look(surfaces, self._labels, self._silent, self.seen.rays, rays, hits, cells)
        return hits, cells

    def _changes(self, feature: int) -> tuple[Ints, Singles, Ints]:
        """Rays that see something else without a feature, their new hits, and the cells."""
        rays = self.rays_of(feature)
        if self.kinds[feature] != OBJECT:
            new = np.zeros((len(rays), 4), np.float32)
            new[:, 0] = np.inf
            return rays, new, self._cells[rays]
        rows, cols = self.whole[feature].T
        window, normals, changed = self._patch(feature)
        ends = (np.searchsorted(self._sorted_cells, [cell, cell + 1]) for cell in changed)
        beside = [self._by_cell[slice(*each)] for each in ends]
        rays = np.unique(np.concatenate([rays, *beside]))
        before = self._normals[window].copy()
        self._normals[window] = normals
        self._squares[:, rows + 1, cols + 1] = 1  # a leap of one cell is always allowed
        new, cells = self._look(rays)
        self._normals[window] = before
        self._squares[:, rows + 1, cols + 1] = 0
        return rays, new, cells

    def _patch(self, feature: int) -> tuple[tuple[slice, ...], Singles, Ints]:
        """A window, its normals without an object, and the cells that rays meet with others."""
        if feature in self._patches:
            return self._patches[feature]
        at = self.whole[feature]
        low, high = at.min(axis=0), at.max(axis=0) + 1
        inner, outer = (
            tuple(map(slice, np.maximum(low - reach, 0), high + reach))
            for reach in (NORMAL_REACH, 2 * NORMAL_REACH)
        )
        start = np.array([outer[0].start, outer[1].start])
        own = self._standing[outer].copy()
        own[tuple((at - start).T)] = False
        own_inner = tuple(slice(i.start - o, i.stop - o) for i, o in zip(inner, start, strict=True))
        normals = surface_normals(own)[own_inner]
        differs = (normals != self._normals[inner]).any(axis=2) & own[own_inner]
        rows, cols = np.nonzero(differs)
        flat = (rows + inner[0].start) * self._standing.shape[1] + cols + inner[1].start
        met = np.searchsorted(self._sorted_cells, flat).clip(max=len(self._sorted_cells) - 1)
        patch = inner, normals, flat[self._sorted_cells[met] == flat]
        self._patches[feature] = patch
        return patch

    def _summed(self, rays: Ints, new: Singles) -> Floats:
        """The sums with new hits of some rays; the number of hits stays."""
        from locplan._kernels.landmarks import HITS, sums_of

        own = self.seen.rays
        change = sums_of(new[:, None], own) - sums_of(self._hits[rays][:, None], own)
        change[:, HITS] = 0
        sums: Floats = self.sums.copy()
        np.add.at(sums, rays // own.beams, change)
        return sums

    def _sort(self) -> None:
        """Rays in order of the cells and of the features that they meet."""
        self._by_cell = np.argsort(self._cells, kind="stable")
        self._sorted_cells = self._cells[self._by_cell]
        labels = np.where(self._cells < 0, -1, self._labels.ravel()[self._cells])
        self._by_label = np.argsort(labels, kind="stable")
        self._sorted_labels = labels[self._by_label]

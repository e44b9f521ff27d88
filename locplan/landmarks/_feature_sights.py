"""What a robot sees along its routes where features of the map are away."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.field import NORMAL_REACH, surface_normals
from locplan.landmarks._pieces import OBJECT, Pieces
from locplan.landmarks._sight import Surroundings


@dataclass
class Sights:
    """Hits of all rays, and P along the routes, without some features.

    Without an object its cells are free: rays reach what lies behind, and surfaces beside it have
    the normals of the map without it. A piece of a wall is no window: rays that meet it count
    for nothing, and no edge comes up where it ends. The number of hits that a filter's model counts
    stays that of the map, as with objects that are added.
    """

    occupied: NDArray[np.bool_]
    resolution: float
    seen: Surroundings
    pieces: Pieces
    hits: NDArray[np.float32] = field(init=False)
    """Hits of the rays, (n * beams, 4)."""
    cells: NDArray[np.int64] = field(init=False)
    """Cells that the rays meet, row * W + col, or -1, (n * beams,)."""
    sums: NDArray[np.float64] = field(init=False)
    """See `landmarks.sums_of`, (n, 7)."""

    def __post_init__(self) -> None:
        from locplan._kernels.landmarks import sums_of
        from locplan._kernels.rays import empty_squares

        rays = self.seen.rays
        self._standing = self.occupied.copy()
        self._squares, self._normals = empty_squares(self.occupied), surface_normals(self.occupied)
        self._silent = np.zeros(max(len(self.pieces.kinds), 1), bool)
        self._whole: dict[int, NDArray[np.int64]] = {}
        self._patches: dict[int, tuple[Any, Any, Any]] = {}
        self.hits, self.cells = self._look(np.arange(len(rays.first) * rays.beams))
        self.sums = sums_of(self.hits.reshape(len(rays.first), rays.beams, 4), rays)
        self._sort()

    def profile(self, sums: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """P_xx + P_yy at each pose, (n,) [m^2]; with other sums than those of what stands."""
        return self.seen.profile(self.sums if sums is None else sums)

    def without(self, feature: int) -> NDArray[np.float64]:
        """P_xx + P_yy at each pose with this feature away, too, (n,) [m^2]."""
        rays, new, _ = self._changes(feature)
        return self.profile(self._summed(rays, new))

    def take(self, feature: int) -> None:
        """Take a feature away for good."""
        rays, new, cells = self._changes(feature)
        self.sums = self._summed(rays, new)
        self.hits[rays], self.cells[rays] = new, cells
        if self.pieces.kinds[feature] == OBJECT:
            rows, cols = self.whole(feature).T
            window, normals, _ = self._patch(feature)
            self._normals[window] = normals
            self._standing[rows, cols] = False
            self._squares[:, rows + 1, cols + 1] = 1
            self._patches.clear()
        else:
            self._silent[feature] = True
        self._sort()

    def rays_of(self, feature: int) -> NDArray[np.int64]:
        """Rays that meet a feature: pose * beams + beam, in order."""
        low, high = np.searchsorted(self._labels, [feature, feature + 1])
        return np.sort(self._by_label[low:high])

    def whole(self, feature: int) -> NDArray[np.int64]:
        """Rows and columns of a feature's cells, (k, 2)."""
        if not self._whole:
            labels = self.pieces.labels
            at = np.argwhere(labels >= 0)
            order = np.argsort(labels[tuple(at.T)], kind="stable")
            ends = np.cumsum(np.bincount(labels[labels >= 0], minlength=len(self.pieces.kinds)))
            self._whole = dict(enumerate(np.split(at[order], ends[:-1])))
        return self._whole[feature]

    def biases(self, feature: int) -> NDArray[np.float64]:
        """Errors of the pose by a shift of the feature; see `features.biases`, (n, 3, 2)."""
        from locplan._kernels import features
        from locplan._kernels.landmarks import HITS, NORMAL_X, NORMAL_Y, RANGE, TURN

        seen, rays = self.seen, self.rays_of(feature)
        share = seen.a_step.share / (1 + seen.a_step.other * self.sums[:, HITS])
        hits = self.hits[rays].astype(np.float64)
        weight = np.zeros(len(rays))
        returns = np.isfinite(hits[:, RANGE])
        weight[returns] = 1 / (1 + seen.rays.swing * hits[returns, RANGE] ** 2)
        normals = hits[:, [NORMAL_X, NORMAL_Y]]
        gradients = hits[:, [NORMAL_X, NORMAL_Y, TURN]] * weight[:, None]
        pulls = np.zeros((len(self.sums), 3, 2))
        np.add.at(pulls, rays // seen.rays.beams, gradients[:, :, None] * normals[:, None, :])
        return np.asarray(
            features.biases(
                pulls * share[:, None, None],
                self.sums[:, :HITS] * share[:, None],
                seen.covariances(self.sums),
                seen.rays.poses,
                seen.routes,
            )
        )

    def _look(self, rays: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        from locplan._kernels.features import look

        hits, cells = np.zeros((len(rays), 4), np.float32), np.empty(len(rays), np.int64)
        labels = self.pieces.labels
        scene = self._squares, self._normals, labels, self._silent, self.resolution
        look(*scene, self.seen.rays, rays, hits, cells)
        return hits, cells

    def _changes(
        self, feature: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
        """Rays that see something else without a feature, their new hits, and the cells."""
        rays = self.rays_of(feature)
        if self.pieces.kinds[feature] != OBJECT:
            new = np.zeros((len(rays), 4), np.float32)
            new[:, 0] = np.inf
            return rays, new, self.cells[rays]
        rows, cols = self.whole(feature).T
        window, normals, changed = self._patch(feature)
        beside = [self._by_cell[slice(*np.searchsorted(self._cells, [c, c + 1]))] for c in changed]
        rays = np.unique(np.concatenate([rays, *beside]))
        before = self._normals[window].copy()
        self._normals[window] = normals
        self._squares[:, rows + 1, cols + 1] = 1  # a leap of one cell is always allowed
        new, cells = self._look(rays)
        self._normals[window] = before
        self._squares[:, rows + 1, cols + 1] = 0
        return rays, new, cells

    def _patch(
        self, feature: int
    ) -> tuple[tuple[slice, slice], NDArray[np.float32], NDArray[np.int64]]:
        """A window, its normals without an object, and the cells that rays meet with others."""
        if feature in self._patches:
            return self._patches[feature]
        at = self.whole(feature)
        inner, outer = (
            _window(at, reach, self.occupied.shape) for reach in (NORMAL_REACH, 2 * NORMAL_REACH)
        )
        row, col = outer[0].start, outer[1].start
        own = self._standing[outer].copy()
        own[at[:, 0] - row, at[:, 1] - col] = False
        within = tuple(
            slice(i.start - o, i.stop - o) for i, o in zip(inner, (row, col), strict=True)
        )
        normals = surface_normals(own)[within[0], within[1]]
        differs = (normals != self._normals[inner]).any(axis=2) & own[within[0], within[1]]
        rows, cols = np.nonzero(differs)
        flat = (rows + inner[0].start) * self.occupied.shape[1] + cols + inner[1].start
        met = np.searchsorted(self._cells, flat).clip(max=len(self._cells) - 1)
        patch = inner, normals, flat[self._cells[met] == flat]
        self._patches[feature] = patch
        return patch

    def _summed(self, rays: NDArray[np.int64], new: NDArray[np.float32]) -> NDArray[np.float64]:
        """The sums with new hits of some rays; the number of hits stays."""
        from locplan._kernels.landmarks import HITS, sums_of

        own = self.seen.rays
        change = sums_of(new[:, None], own) - sums_of(self.hits[rays][:, None], own)
        change[:, HITS] = 0
        sums = self.sums.copy()
        np.add.at(sums, rays // own.beams, change)
        return sums

    def _sort(self) -> None:
        """Rays in order of the cells and of the features that they meet."""
        self._by_cell = np.argsort(self.cells, kind="stable")
        self._cells = self.cells[self._by_cell]
        labels = np.where(self.cells < 0, -1, self.pieces.labels.ravel()[self.cells])
        self._by_label = np.argsort(labels, kind="stable")
        self._labels = labels[self._by_label]


def met_cells(occupied: NDArray[np.bool_], resolution: float, rays: Any) -> NDArray[np.int64]:
    """The occupied cells that rays meet, row * W + col, each once."""
    from locplan._kernels.features import look
    from locplan._kernels.rays import empty_squares

    every = np.arange(len(rays.first) * rays.beams)
    hits, cells = np.zeros((len(every), 4), np.float32), np.empty(len(every), np.int64)
    labels = np.full(occupied.shape, -1, np.int32)
    normals = np.zeros((*occupied.shape, 2), np.float32)
    none = np.zeros(1, bool)
    look(empty_squares(occupied), normals, labels, none, resolution, rays, every, hits, cells)
    return np.unique(cells[cells >= 0])


def _window(at: NDArray[np.int64], reach: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of a map within `reach` of some cells [cells]."""
    rows, cols = (
        slice(max(0, int(values.min()) - reach), min(size, int(values.max()) + reach + 1))
        for values, size in zip(at.T, shape, strict=True)
    )
    return rows, cols

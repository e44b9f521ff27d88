"""Values of a field at poses, interpolated between lattice points and headings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import check_choice, parse_poses
from locplan._support.kernels.arrays import Bools, Floats, Ints
from locplan.field.covariance import SCALARS, scalar
from locplan.maps.grid import OccupancyGrid

OFFSETS = np.array([*product((-1, 0, 1), repeat=2)])
"""A lattice point and the eight around it, (9, 2)."""


@dataclass(frozen=True)
class LatticeCorners:
    """Lattice points and their weights to interpolate values at positions."""

    points: Ints
    """Row and column of each point on the lattice, (k, 2)."""
    weights: Any
    """Weights of the points at each position, a sparse matrix (n, k). They add up to 1, or there
    are none at a position without a value."""

    @classmethod
    def from_positions(
        cls, grid: OccupancyGrid, stride: int, is_computed: Bools, lacking: Bools, xy: Floats
    ) -> LatticeCorners:
        """Find the lattice points around positions.

        There are none in cells that are not free, and outside the map. The points around a lacking
        one take its weight, as in `_lattice.filled`.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        stride : int
            Spacing of the lattice [cells].
        is_computed, lacking : (h, w) arrays of bool
            Lattice points with a covariance, and points that are interpolated from their
            neighbours.
        xy : (n, 2) array
            The positions [m].
        """
        cells, size = np.column_stack(grid.world_to_grid(*xy.T)), np.array(is_computed.shape)
        lattice = np.clip((cells - 0.5) / stride, 0.0, size - 1.0)
        low = np.floor(lattice).astype(np.int64)
        share = lattice - low
        sides = [*product((0, 1), repeat=2)]
        number = np.tile(np.arange(len(xy)), len(sides))
        points = np.concatenate([np.minimum(low + side, size - 1) for side in sides])
        weight = np.concatenate([np.where(side, share, 1 - share).prod(axis=1) for side in sides])
        is_used = _is_free(grid, xy)[number] & (weight > 0)
        number, points, weight = number[is_used], points[is_used], weight[is_used]
        is_known = is_computed[tuple(points.T)]
        is_lacking = lacking[tuple(points.T)]
        around = (points[is_lacking, None] + OFFSETS).reshape(-1, 2)
        inside = ((around >= 0) & (around < size)).all(axis=1)
        around[~inside] = 0
        near = 0.5 ** np.abs(OFFSETS).sum(axis=1) * (
            (inside & is_computed[tuple(around.T)]).reshape(-1, len(OFFSETS))
        )
        near *= (weight[is_lacking] / np.maximum(near.sum(axis=1), 1e-9))[:, None]
        number = np.concatenate([number[is_known], np.repeat(number[is_lacking], len(OFFSETS))])
        points = np.concatenate([points[is_known], around])
        return cls._from_weights(
            number, points, np.concatenate([weight[is_known], near.ravel()]), len(xy)
        )

    @classmethod
    def _from_weights(
        cls, position_index: Ints, points: Ints, weight: Floats, count: int
    ) -> LatticeCorners:
        """Make corners from entries: the index of the position, the point, and its weight."""
        is_used = weight > 0
        position_index, points, weight = position_index[is_used], points[is_used], weight[is_used]
        index = points[:, 0] * (points[:, 1].max(initial=0) + 1) + points[:, 1]
        _, first, place = np.unique(index, return_index=True, return_inverse=True)
        weight = weight / np.bincount(position_index, weight, count)[position_index]
        return cls(
            points[first], _make_sparse_matrix(weight, position_index, place, (count, len(first)))
        )

    def interpolate(self, values: Floats, headings: Floats | None) -> Floats:
        """Return the values at the positions, (n, ...), NaN for a position without a value.

        Parameters
        ----------
        values : (k,) or (k, headings) array
            The values of the points.
        headings : (n,) array, optional
            Heading at each position [rad]; by default the mean over all headings counts.
        """
        values, weights = self._select_headings(values, 1, headings)
        return self._set_unread_to_nan(weights @ values)

    def interpolate_covariances(self, covariances: Floats, headings: Floats | None) -> Floats:
        """Return covariances at the positions, (n, d, d), interpolated in the matrix logarithm.

        Parameters
        ----------
        covariances : (k, d, d) or (k, headings, d, d) array
            The covariances of the points, for one heading if `headings` is None.
        headings : (n,) array, optional
            Heading at each position [rad].
        """
        from locplan.field.kernels.symmetric import compute_log_or_exp

        d = covariances.shape[-1]
        heading_covariances, weights = self._select_headings(covariances, 3, headings)
        logs = weights @ compute_log_or_exp(heading_covariances, True).reshape(-1, d * d)
        return self._set_unread_to_nan(compute_log_or_exp(logs.reshape(-1, d, d), False))

    def _select_headings(
        self, values: Floats, n_plain_dims: int, headings: Floats | None
    ) -> tuple[Floats, Any]:
        """Return the values to read, of one heading each, and their weights at each position.

        `n_plain_dims` is the number of dimensions of values without headings.
        """
        if values.ndim == n_plain_dims or headings is None:
            return (values if values.ndim == n_plain_dims else values.mean(axis=1)), self.weights
        count = values.shape[1]
        turn = headings / (2 * math.pi) * count
        low = np.floor(turn).astype(np.int64)
        sparse_weights = self.weights.tocoo()
        share = (turn - low)[sparse_weights.row]
        before = sparse_weights.col * count + low[sparse_weights.row] % count
        after = sparse_weights.col * count + (low[sparse_weights.row] + 1) % count
        used, place = np.unique(np.concatenate([before, after]), return_inverse=True)
        weight = np.concatenate([sparse_weights.data * (1 - share), sparse_weights.data * share])
        shape = (self.weights.shape[0], len(used))
        weights = _make_sparse_matrix(weight, np.tile(sparse_weights.row, 2), place, shape)
        return values.reshape(-1, *values.shape[2:])[used], weights

    def _set_unread_to_nan(self, values: Floats) -> Floats:
        """Replace the values at positions without a weight by NaN."""
        values[np.diff(self.weights.indptr) == 0] = np.nan
        return values


def _is_free(grid: OccupancyGrid, xy: Floats) -> Bools:
    """True for positions (n, 2) in free cells; they may lie outside the map."""
    rows, cols = grid.cell(xy)
    inside = grid.contains(rows, cols)
    return np.asarray(inside & grid.free[np.where(inside, rows, 0), np.where(inside, cols, 0)])


def _make_sparse_matrix(weight: Floats, rows: Ints, cols: Ints, shape: tuple[int, int]) -> Any:
    """Return a sparse matrix of weights."""
    from scipy.sparse import csr_array

    return csr_array((weight, (rows, cols)), shape=shape)


def interpolate_at_poses(field: Any, poses: ArrayLike, name: str | None) -> Any:
    """Return all values of a field at poses by name, or the values with one name.

    Parameters
    ----------
    field : CovarianceField
        The field, whose module imports this one.
    poses, name
        See `CovarianceField.at`.
    """
    array, is_single = parse_poses(poses)
    names = ("covariance", *SCALARS, *field.layers)
    if name is not None:
        check_choice("name", name, names)
    headings = array[:, 2] if array.shape[1] == 3 else None
    corners = LatticeCorners.from_positions(
        field.grid, field.stride, field.is_evaluated, field.is_interpolated, array[:, :2]
    )
    at = tuple(corners.points.T)
    values: dict[str, Floats] = {}
    if name not in field.layers:
        covariances = field.covariance if headings is not None else field.average_headings
        values["covariance"] = corners.interpolate_covariances(covariances[at], headings)
    for quantity_name in names if name is None else (name,):
        if quantity_name in field.layers:
            values[quantity_name] = corners.interpolate(field.layers[quantity_name][at], headings)
        elif quantity_name != "covariance":
            values[quantity_name] = scalar(values["covariance"], quantity_name)
    if is_single:
        values = {quantity_name: array[0] for quantity_name, array in values.items()}
    return values if name is None else values[name]

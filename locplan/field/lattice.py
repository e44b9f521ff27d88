"""The lattice of cells that a field is evaluated on, and interpolation between them.

Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import count_usable_cores
from locplan._support.kernels.arrays import Array, Bools, Floats
from locplan.field.covariance import average_information


def stride_cells(stride: float, resolution: float) -> int:
    """Return a spacing in metres as a whole number of cells, at least one."""
    return max(1, round(stride / resolution))


def select_evaluated_points(free: Bools, stride: int) -> Bools:
    """Return the mask of lattice points to evaluate, (h, w): each free cell reads at least one."""
    required = free[::stride, ::stride].copy()
    lonely = free & ~_find_covered_cells(required, free.shape, stride)
    nearest = (
        np.minimum((index + stride // 2) // stride, size - 1)
        for index, size in zip(np.nonzero(lonely), required.shape, strict=True)
    )
    required[tuple(nearest)] = True
    return required


def _find_covered_cells(points: Bools, shape: tuple[int, int], stride: int) -> Bools:
    """Mark the cells whose interpolated value reads at least one of the points, (H, W)."""
    for axis, size in enumerate(shape):
        at = np.arange(size)
        below = np.minimum(at // stride, points.shape[axis] - 1)
        above = np.minimum(-(-at // stride), points.shape[axis] - 1)
        points = np.take(points, below, axis) | np.take(points, above, axis)
    return points


def select_every_second_point(points: Bools) -> Bools:
    """Select every second lattice point in each direction, and points without such a neighbour.

    Parameters
    ----------
    points : (h, w) array of bool
        The lattice points to choose from.

    Returns
    -------
    (h, w) array of bool
        The chosen ones.
    """
    import cv2

    is_selected = np.zeros_like(points)
    is_selected[::2, ::2] = points[::2, ::2]
    around = cv2.dilate(is_selected.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.asarray(is_selected | (points & ~around))


def select_points_evenly(is_computed: Bools, lacking: Bools) -> Bools:
    """Select computed points of a lattice at equal density everywhere, (h, w)."""
    return (
        is_computed & select_every_second_point(is_computed | lacking)
        if lacking.any()
        else is_computed
    )


def find_near_points(points: Bools, stride: int, cells: Floats, distance: float) -> Bools:
    """Select the lattice points near some cells.

    Parameters
    ----------
    points : (h, w) array of bool
        The lattice points to choose from.
    stride : int
        Spacing of the lattice [cells].
    cells : (n, 2) array
        Rows and columns from the centre of the map's first cell; they may lie between cells.
    distance : float
        Maximum distance from the lattice points nearest to the cells [cells].

    Returns
    -------
    (h, w) array of bool
        The chosen ones.
    """
    import cv2

    index = np.rint(cells / stride).astype(np.intp)
    rows, cols = (np.clip(i, 0, size - 1) for i, size in zip(index.T, points.shape, strict=True))
    marks = np.zeros(points.shape, np.uint8)
    marks[rows, cols] = 1
    reach = math.ceil(distance / stride)
    offset = np.arange(-reach, reach + 1)
    disc = offset[:, None] ** 2 + offset**2 <= (distance / stride) ** 2
    return np.asarray(points & (cv2.dilate(marks, disc.astype(np.uint8)) > 0))


def fill_lacking_points(values: Floats, is_computed: Bools, lacking: Bools) -> Floats:
    """Fill the lacking points of a lattice (h, w) with the mean of their computed neighbours.

    If every second point is known, this is their bilinear interpolation. Points without a known
    neighbour stay NaN.
    """
    import cv2

    half = np.array([0.5, 1.0, 0.5])
    summed, weight = (
        np.asarray(cv2.sepFilter2D(array, -1, half, half, borderType=cv2.BORDER_CONSTANT))
        for array in (np.where(is_computed, values, 0.0), is_computed.astype(float))
    )
    result = values.copy()
    with np.errstate(invalid="ignore"):  # 0 / 0 is NaN where none is known around
        result[lacking] = summed[lacking] / weight[lacking]
    return result


def interpolate_lattice_on_map(values: Floats, free: Bools, stride: int) -> Floats:
    """Read the values of a lattice (h, w) bilinearly at the free cells, (H, W); NaN elsewhere.

    The last values extend to the map's edge. A NaN corner leaves its weight to the remaining
    corners.
    """
    rows, cols = free.shape
    is_finite = ~np.isnan(values)
    value = _interpolate_along_rows(np.where(is_finite, values, 0.0), cols, stride)
    weight = _interpolate_along_rows(is_finite.astype(float), cols, stride)
    result = np.empty(free.shape)
    # So many cells and their neighbours fit a core's cache.
    block = max(1, (1 << 16) // (stride * cols))

    def read(first: int) -> None:
        band = slice(first * stride, min((first + block) * stride, rows))
        band_values = _interpolate_between_rows(value, first, block, stride)
        with np.errstate(invalid="ignore"):  # 0 / 0 is NaN where nothing is known
            band_values /= _interpolate_between_rows(weight, first, block, stride)
        np.copyto(result[band], band_values[: band.stop - band.start])
        np.copyto(result[band], np.nan, where=~free[band])

    with ThreadPoolExecutor(count_usable_cores()) as pool:
        list(pool.map(read, range(0, -(-rows // stride), block)))
    return result


def _interpolate_along_rows(values: Floats, cols: int, stride: int) -> Floats:
    """Interpolate values (h, w) along each row at all columns, (h, cols)."""
    low, next_one, part = _find_neighbours(np.arange(cols), stride, values.shape[1])
    return np.asarray(values[:, low] * (1 - part) + values[:, next_one] * part)


def _interpolate_between_rows(values: Floats, first: int, count: int, stride: int) -> Floats:
    """Interpolate `stride` rows after each of `count` lattice rows, from row `first` on."""
    below = values[first : first + count, None]
    above = values[np.minimum(np.arange(first + 1, first + len(below) + 1), len(values) - 1), None]
    part = (np.arange(stride) / stride)[:, None]
    read = below * (1 - part)
    read += above * part
    return np.asarray(read.reshape(-1, values.shape[1]))


def interpolate_lattice_at_cells(values: Floats, stride: int, rows: Array, cols: Array) -> Floats:
    """Read the values of a lattice (h, w) bilinearly at some cells, which may lie between cells.

    A NaN corner leaves its weight to the remaining corners.
    """
    left, right, col_part = _find_neighbours(cols, stride, values.shape[1])
    row, above, row_part = _find_neighbours(rows, stride, values.shape[0])

    def read(array: Floats) -> Floats:
        lower = array[row, left] * (1 - col_part) + array[row, right] * col_part
        upper = array[above, left] * (1 - col_part) + array[above, right] * col_part
        return np.asarray(lower * (1 - row_part) + upper * row_part)

    is_finite = ~np.isnan(values)
    with np.errstate(invalid="ignore"):  # 0 / 0 is NaN where nothing is known
        return read(np.where(is_finite, values, 0.0)) / read(is_finite.astype(float))


def _find_neighbours(
    cells: Array, stride: int, size: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return lattice indices before and after each cell along one axis, and the latter's weight."""
    lattice_floor = np.floor(np.asarray(cells) / stride)
    low = np.minimum(lattice_floor.astype(np.intp), size - 1)
    return low, np.minimum(low + 1, size - 1), (cells - lattice_floor * stride) / stride


def merge_headings(covariance: Floats, is_computed: Bools) -> Floats:
    """Return the covariances (h, w, d, d) of the mean information over all headings."""
    if covariance.ndim == 4:
        return covariance
    result = np.full((*covariance.shape[:2], *covariance.shape[3:]), np.nan)
    result[is_computed] = average_information(covariance[is_computed])
    return result

"""Compare ray casting with its peers, and time lidar estimators per cell.

pytest tests/benchmarks/bench_sensor.py --benchmark-only -s
"""

import time
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from locplan._support.kernels.rays import cast_ray, compute_empty_squares
from locplan.field import Fisher, Scan
from locplan.field.estimator import MapPart
from locplan.maps import OCCUPIED, load_map
from locplan.robots import Lidar

MAPS = ("tb4_depot", "fetch_4_26_15", "aws_small_house", "mit_stata_basement_yaw")
LIDAR = Lidar(range=30.0, beams=360)
TARGET_FISHER, TARGET_SCAN = 0.05, 0.2


@njit(cache=True)
def ranges_by_leaps(squares, rows, cols, drows, dcols, most):
    result = np.empty((rows.size, drows.size))
    for n in range(rows.size):
        for k in range(drows.size):
            result[n, k] = cast_ray(squares, rows[n], cols[n], drows[k], dcols[k], most)[0]
    return result


@njit(cache=True)
def ranges_by_cells(stops, rows, cols, drows, dcols, most):
    """Amanatides and Woo, cell by cell."""
    result = np.full((rows.size, drows.size), np.inf)
    for n in range(rows.size):
        for k in range(drows.size):
            drow, dcol = drows[k], dcols[k]
            row, col = int(np.floor(rows[n])), int(np.floor(cols[n]))
            row_step, col_step = (1 if drow > 0 else -1), (1 if dcol > 0 else -1)
            row_pace, col_pace = abs(1 / drow), abs(1 / dcol)
            row_at = abs(row + (drow > 0) - rows[n]) * row_pace
            col_at = abs(col + (dcol > 0) - cols[n]) * col_pace
            at = 0.0
            while at <= most and 0 <= row < stops.shape[0] and 0 <= col < stops.shape[1]:
                if stops[row, col]:
                    result[n, k] = at
                    break
                if row_at < col_at:
                    at, row, row_at = row_at, row + row_step, row_at + row_pace
                else:
                    at, col, col_at = col_at, col + col_step, col_at + col_pace
    return result


@njit(cache=True)
def ranges_by_marching(distance, rows, cols, drows, dcols, most):
    """Ray marching on a distance field, the method of range_libc (Walsh and Karaman, 2018)."""
    result = np.full((rows.size, drows.size), np.inf)
    for n in range(rows.size):
        for k in range(drows.size):
            at = 0.0
            while at <= most:
                row = int(np.floor(rows[n] + at * drows[k]))
                col = int(np.floor(cols[n] + at * dcols[k]))
                if not (0 <= row < distance.shape[0] and 0 <= col < distance.shape[1]):
                    break
                if distance[row, col] == 0:
                    result[n, k] = at
                    break
                at += max(distance[row, col] - 1.0, 0.5)
    return result


def free_cells(grid, count=600):
    rows, cols = np.nonzero(grid.free)
    chosen = np.random.default_rng(0).permutation(len(rows))[:count]
    return rows[chosen], cols[chosen]


def load(name, real_maps):
    return load_map(next((real_maps / name).glob("*.yaml")))


def seconds(function, *arguments):
    function(*arguments)
    best = np.inf
    for _ in range(3):
        began = time.perf_counter()
        result = function(*arguments)
        best = min(best, time.perf_counter() - began)
    return best, result


@pytest.mark.parametrize("name", MAPS)
def test_rays(benchmark, name, real_maps):
    from scipy.ndimage import distance_transform_edt

    grid = load(name, real_maps)
    stops = grid.cells == OCCUPIED
    rows, cols = (index + 0.5 for index in free_cells(grid))
    beams = np.sin(LIDAR.angles + 1e-3), np.cos(LIDAR.angles + 1e-3)
    rest = rows, cols, *beams, LIDAR.range / grid.resolution
    squares = compute_empty_squares(stops)
    ranges_by_leaps(squares, *rest)
    ours = benchmark.pedantic(ranges_by_leaps, (squares, *rest), rounds=5)
    leaps, _ = seconds(ranges_by_leaps, squares, *rest)
    cells, exact = seconds(ranges_by_cells, stops, *rest)
    marching, coarse = seconds(ranges_by_marching, distance_transform_edt(~stops), *rest)
    np.testing.assert_allclose(ours, exact, atol=1e-6)
    alike = np.mean(
        np.abs(np.where(np.isinf(coarse), 1e9, coarse) - np.where(np.isinf(ours), 1e9, ours)) < 1.5
    )
    each = 1e9 / ours.size
    benchmark.extra_info.update(
        ratio_to_cell_by_cell=cells / leaps,
        ratio_to_ray_marching=marching / leaps,
        nanoseconds_a_ray=leaps * each,
    )
    print(
        f"\n{name}: {leaps * each:.0f} ns a ray; cell by cell {cells / leaps:.1f} times as long,"
        f" ray marching {marching / leaps:.1f} ({alike:.0%} within 1.5 cells)"
    )


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize(
    ("estimator", "target"), [(Fisher(LIDAR), TARGET_FISHER), (Scan(LIDAR), TARGET_SCAN)]
)
def test_milliseconds_a_cell(benchmark, name, estimator, target, real_maps):
    """One thread, the map's own preparation not counted."""
    grid = load(name, real_maps)
    began = time.perf_counter()
    prepared = estimator.prepare(grid.cells, grid.resolution)
    preparing = time.perf_counter() - began
    rows, cols = free_cells(grid, 2000)
    part = replace(MapPart.from_map(grid.cells, rows, cols, grid.resolution), prepared=prepared)
    estimator.covariances(replace(part, rows=rows[:2], cols=cols[:2]))
    benchmark.pedantic(estimator.covariances, (part,), rounds=5)
    each = 1e3 * benchmark.stats.stats.min / len(rows)
    benchmark.extra_info["milliseconds_a_cell"] = each
    print(
        f"\n{name}, {estimator.name}: {each:.3f} ms a cell (at most {target}),"
        f" the map once {1e3 * preparing:.0f} ms"
    )

"""Time the field, and compare it with OpenCV and with the processor's limits.

Run: pytest tests/benchmarks/bench_field.py --benchmark-only -s
"""

from __future__ import annotations

import os
import time

import cv2
import numpy as np
import pytest
from numba import njit
from support.machine import SHARED_DATA
from support.sad import PlainSad, count_mismatches

from benchmarks.opencv_forms import masked_norm, packed_hamming
from locplan._support.kernels.simd import LANES, add_matches, add_to, zeros
from locplan.field import FieldConfig, Sad, covariance_field, sad
from locplan.field.estimator import MapPart
from locplan.field.kernels import sad as kernel
from locplan.field.sad_tiles import MapLayout
from locplan.maps import load_map

MAPS = (
    "f1tenth_gym_stata_basement",
    "fetch_4_26_15",
    "aws_small_warehouse_005_png",
    "aws_small_house",
    "nav2_depot",
    "willow_full_stage",
    "tb4_warehouse",
)
pytestmark = pytest.mark.filterwarnings("ignore::locplan.maps.files.MapWarning")


def load(name):
    folder = SHARED_DATA / "rosmaps" / name
    if not folder.is_dir():
        pytest.skip("the collection of real maps (../shared/data/rosmaps) is not here")
    return load_map(next(folder.glob("*.yaml")))


def lattice_tile(grid, config, seed, edge=32):
    """The lattice cells around a random free one, as many as a tile has."""
    stride = config.stride_cells(grid.resolution)
    free = np.argwhere(grid.free[::stride, ::stride])
    centre = free[np.random.default_rng(seed).integers(len(free))]
    near = free[np.abs(free - centre).max(axis=1) <= edge]
    return near[:, 0] * stride, near[:, 1] * stride


@njit(nogil=True)
def popcount_loop(words, rounds):
    result = np.zeros(3 * LANES, np.int64)
    a = b = c = zeros()
    word = np.uint64(0x0123456789ABCDEF)
    for _ in range(rounds):
        for at in range(0, words.size - 3 * LANES + 1, 3 * LANES):
            a = add_matches(a, word, words, at)
            b = add_matches(b, word, words, at + LANES)
            c = add_matches(c, word, words, at + 2 * LANES)
    add_to(result, 0, a)
    add_to(result, LANES, b)
    add_to(result, 2 * LANES, c)
    return result.sum()


def seconds(function, *arguments, repeats=3):
    """Least time of some runs after one that is not counted."""
    function(*arguments)
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - started)
    return min(times)


def peak_words_per_second():
    words = np.random.default_rng(0).integers(0, 2**63, 960).astype(np.uint64)
    return 960 * 2000 / seconds(popcount_loop, words, 2000)


@pytest.mark.parametrize("name", MAPS)
def test_kernel_beside_opencv(benchmark, name):
    grid, config = load(name), FieldConfig()
    window = config.estimator.window.to_lattice(grid.resolution)
    radius = config.estimator.template_radius(grid.resolution, grid.shape)
    rows, cols = lattice_tile(grid, config, seed=1)
    compared = np.random.default_rng(2).integers(len(rows), size=3)
    part = MapPart.from_map(grid.cells, rows[compared], cols[compared], grid.resolution)
    by_kernel = sad.LEVEL_STEP * count_mismatches(MapLayout.from_part(part, radius, window))

    cv2.setNumThreads(1)
    opencv = {}
    for form in (masked_norm, packed_hamming):
        results = [form(grid.cells, rows[n], cols[n], radius, window) for n in compared]
        np.testing.assert_array_equal(results, by_kernel)
        opencv[form.__name__] = min(
            seconds(form, grid.cells, rows[n], cols[n], radius, window) for n in compared
        )

    part = MapPart.from_map(grid.cells, rows, cols, grid.resolution)
    benchmark.pedantic(config.estimator.covariances, (part,), rounds=5, warmup_rounds=1)
    cell = benchmark.stats.stats.min / len(rows)
    words = words_compared(grid, rows, cols, radius, window)
    peak = peak_words_per_second()
    benchmark.extra_info.update(
        microseconds_a_cell=1e6 * cell,
        **{f"ratio_to_{form}": time / cell for form, time in opencv.items()},
        popcount_words_per_second=words / cell,
        share_of_popcount_peak=words / cell / peak,
    )
    print(
        f"\n{name} ({grid.resolution:g} m): {1e6 * cell:.0f} us a cell;"
        f" masked norm {1e3 * opencv['masked_norm']:.1f} ms, {opencv['masked_norm'] / cell:.0f}x;"
        f" packed Hamming {1e3 * opencv['packed_hamming']:.1f} ms,"
        f" {opencv['packed_hamming'] / cell:.0f}x;"
        f" {words / cell / 1e9:.1f} G words/s, {words / cell / peak:.0%} of {peak / 1e9:.1f} G"
    )


def words_compared(grid, rows, cols, radius, window):
    """Words and prefix sums that the vectors go through at a cell, in the mean of some."""
    chosen = slice(None, None, max(1, len(rows) // 50))
    part = MapPart.from_map(grid.cells, rows[chosen], cols[chosen], grid.resolution)
    layout = MapLayout.from_part(part, radius, window)
    weights = np.ones(4 * radius**2 * 2)
    total = 0
    for group in layout.groups():
        tile, every = (
            layout.make_tile_layout(group),
            np.ones((window.angles.size, 1, layout.n_offsets), bool),
        )
        scratch = kernel.make_cell_buffers(*every.shape[::-2], layout.disc, masked=False)
        for n in range(group.cells.size):
            per_cell = ("corners", "rests", "places", "sum_places")
            one = tile._replace(**{name: getattr(tile, name)[n : n + 1] for name in per_cell})
            given = weights, layout.window.cell_lattice_places, scratch, np.zeros(2, np.int64)
            kernel.fill_tile_covariances(one, None, every, *given, np.empty((1, 3, 3)))
            last = scratch.template.bounds[-1, -1]
            total += int(last[1]) + 2 * int(last[3])
    return total / len(part.rows) * layout.n_offsets * kernel.GROUP


LONG = [
    ("nav2_depot", 12.0),
    ("nav2_depot", 20.0),
    ("nav2_depot", 30.0),
    ("f1tenth_gym_stata_basement", 12.0),
    ("f1tenth_gym_stata_basement", 20.0),
    ("f1tenth_gym_stata_basement", 30.0),
    ("willow_full_stage", 12.0),
    ("willow_full_stage", 20.0),
    ("willow_full_stage", 30.0),
]


@pytest.mark.parametrize(("name", "reach"), LONG)
def test_the_bound_beside_all_offsets(benchmark, name, reach):
    grid, config = load(name), FieldConfig(Sad(range=reach))
    rows, cols = lattice_tile(grid, config, seed=1)
    part = MapPart.from_map(grid.cells, rows[:1500], cols[:1500], grid.resolution)
    times = {}
    results = {}
    for _ in range(3):  # in turn, since others may load the machine
        for estimator in (config.estimator, PlainSad(range=reach)):
            began = time.process_time()
            results[type(estimator)] = estimator.covariances(part)["covariance"]
            took = time.process_time() - began
            times[type(estimator)] = min(took, times.get(type(estimator), took))
    np.testing.assert_allclose(results[Sad], results[PlainSad], rtol=0, atol=1e-12)
    benchmark.pedantic(config.estimator.covariances, (part,), rounds=1)
    ratio = times[PlainSad] / times[Sad]
    benchmark.extra_info.update(
        microseconds_a_cell=1e6 * times[Sad] / len(part.rows), ratio_to_all_offsets=ratio
    )
    each = (f"{1e3 * times[kind] / len(part.rows):.2f}" for kind in (PlainSad, Sad))
    print(f"\n{name}, {reach:g} m: {' -> '.join(each)} ms a cell, {ratio:.1f}x")


def test_two_threads_beside_one(benchmark):
    if (os.cpu_count() or 1) < 2:
        pytest.skip("the machine has a single core")
    grid = load("fetch_4_26_15")
    times = {}
    for threads in (1, 2):
        times[threads] = seconds(lambda n=threads: covariance_field(grid, threads=n), repeats=2)
    benchmark.pedantic(covariance_field, (grid,), rounds=1)
    benchmark.extra_info["share_of_two_cores"] = times[1] / times[2] / 2
    print(f"\n{times[1]:.2f} s on one thread, {times[2]:.2f} s on two: {times[1] / times[2]:.2f}x")

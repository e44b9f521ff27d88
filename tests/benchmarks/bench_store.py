"""Measure the cache of fields: killed runs, opening, sizes, updates, and a second dask worker.

pytest tests/benchmarks/bench_store.py --benchmark-only -s
"""

import dataclasses
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from support.maps import random_rooms

from locplan import load_map, save_map
from locplan.field import FieldConfig, Fused, Sad, covariance_field, load_or_compute
from locplan.field.store import field_path
from locplan.maps import OCCUPIED, OccupancyGrid, environments
from locplan.robots import Lidar

KILLS = 50
COMPUTE = """
import sys, locplan
locplan.field.store.PART_SECONDS = 0.2
locplan.load_or_compute(locplan.load_map(sys.argv[1]), cache_dir=sys.argv[2])
"""
ESTIMATORS = {
    "one heading": Sad(),
    "eight headings": Fused(Lidar(range=8.0, field_of_view_deg=180.0, beams=90)),
}


def test_kills_at_random_moments(benchmark, tmp_path):
    save_map(environments.make("office"), tmp_path / "office.yaml")
    grid = load_map(tmp_path / "office.yaml")
    expected = covariance_field(grid)
    path = field_path(grid, FieldConfig(), tmp_path)
    command = [sys.executable, "-c", COMPUTE, tmp_path / "office.yaml", tmp_path]
    began = time.perf_counter()
    subprocess.run(command, check=True)
    undisturbed = time.perf_counter() - began
    rng = np.random.default_rng(0)
    finished, recomputed = [], []

    def kill_and_resume():
        path.unlink(missing_ok=True)
        shutil.rmtree(path.with_suffix(".parts"), ignore_errors=True)
        process = subprocess.Popen(command)
        time.sleep(rng.uniform(0, undisturbed))
        process.send_signal(signal.SIGKILL)
        process.wait()
        parts = len([*path.with_suffix(".parts").glob("*.npz")])
        finished.append("all" if path.exists() else f"{parts} parts")
        totals = [0]
        field = load_or_compute(
            grid, cache_dir=tmp_path, progress=lambda done, total: totals.append(total)
        )
        np.testing.assert_array_equal(field.covariance, expected.covariance)
        recomputed.append(totals[-1] / expected.is_evaluated.sum())

    benchmark.pedantic(kill_and_resume, rounds=KILLS)
    benchmark.extra_info["no_peer"] = "whether fields survive kills, at moments drawn by chance"
    print(f"\n{KILLS} kills within {undisturbed:.1f} s: all fields bit-equal")
    for part in sorted(set(finished)):
        shares = [s for f, s in zip(finished, recomputed, strict=True) if f == part]
        print(f"{len(shares)} x with {part} finished: {np.mean(shares):.0%} recomputed")


@pytest.mark.parametrize("headings", ESTIMATORS)
def test_opening_from_the_cache(benchmark, tmp_path, headings):
    cells = random_rooms((1000, 1000), seed=1, blocks=60)
    config = FieldConfig(ESTIMATORS[headings])
    load_or_compute(OccupancyGrid(cells, 0.05), config, cache_dir=tmp_path)
    seconds = []

    def open_it():
        grid = OccupancyGrid(cells, 0.05)
        began = time.process_time()
        load_or_compute(grid, config, cache_dir=tmp_path)
        seconds.append(time.process_time() - began)

    benchmark.pedantic(open_it, rounds=9, warmup_rounds=1)
    size = field_path(OccupancyGrid(cells, 0.05), config, tmp_path).stat().st_size
    benchmark.extra_info["cpu_seconds"] = float(np.median(seconds))
    benchmark.extra_info["bytes"] = size
    print(f"\n{headings}: {1000 * np.median(seconds):.1f} ms of CPU, {size / 1e6:.1f} MB")


def test_update_against_a_full_run(benchmark):
    before = OccupancyGrid(random_rooms((2000, 2000), seed=2, blocks=120), 0.05)
    cells = before.cells.copy()
    row, col = np.argwhere(before.free)[np.count_nonzero(before.free) // 2]
    cells[row : row + 10, col : col + 10] = OCCUPIED
    after = dataclasses.replace(before, cells=cells)
    field = covariance_field(before)
    began = time.perf_counter()
    full = covariance_field(after)
    whole = time.perf_counter() - began
    updated = benchmark.pedantic(field.update, (after,), rounds=5)
    np.testing.assert_array_equal(updated.covariance, full.covariance)
    benchmark.extra_info["ratio_to_a_full_run"] = whole / benchmark.stats.stats.min
    print(f"\nupdate: {benchmark.stats.stats.median / whole:.1%} of the full {whole:.1f} s")


def test_a_second_dask_worker(benchmark):
    import distributed

    grid = OccupancyGrid(random_rooms((1000, 1000), seed=1, blocks=60), 0.05)
    expected = covariance_field(grid)
    seconds = {}
    for workers in (1, 2):
        with (
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=":0"
            ) as running,
            distributed.Client(running, set_as_default=False) as client,
        ):
            executor = client.get_executor()
            covariance_field(grid, executor=executor)  # each worker loads the kernels
            times = []

            def computed(executor=executor, times=times):
                began = time.perf_counter()
                field = covariance_field(grid, executor=executor)
                times.append(time.perf_counter() - began)
                return field

            field = computed() if workers == 1 else benchmark.pedantic(computed, rounds=3)
            while len(times) < 3:
                computed()
            np.testing.assert_array_equal(field.covariance, expected.covariance)
            seconds[workers] = min(times)
    benchmark.extra_info["share_of_two_workers"] = seconds[1] / seconds[2] / 2
    print(f"\ndask: {seconds[1]:.2f} s with one worker, {seconds[2]:.2f} s with two:", end=" ")
    print(f"{seconds[1] / seconds[2]:.2f} times as fast")

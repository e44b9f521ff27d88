"""Count simulated drives per minute, and compare the kernels with NumPy on whole arrays.

Run: pytest tests/benchmarks/bench_simulation.py --benchmark-only -s
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from locplan import Path
from locplan._support.kernels import particles
from locplan.maps import environments
from locplan.robots import Amcl, Robot
from locplan.simulation import Simulator, drive_open

FIXED = Amcl(min_particles=500, max_particles=500)
DRIVES = 1000


@pytest.fixture(scope="module")
def simulator():
    grid = environments.make("places")
    return Simulator(grid, robot=Robot(filter=FIXED))


@pytest.fixture(scope="module")
def ten_metres(simulator):
    path = Path(np.array([[13.0, 5.5], [23.0, 5.5]]))
    assert path.length == 10.0
    return path


def test_a_thousand_drives(benchmark, simulator, ten_metres):
    assert simulator.arguments.lidar.angles.size == 60
    paths = {"ten metres": ten_metres}
    drive_open(simulator, paths, range(4))
    driven = benchmark.pedantic(
        drive_open, args=(simulator, paths, range(DRIVES)), rounds=3, iterations=1
    )
    seconds = benchmark.stats["min"]
    benchmark.extra_info["milliseconds_a_drive"] = 1e3 * seconds / DRIVES
    updates = DRIVES * ten_metres.length / 0.25
    per_beam = seconds / (updates * 500 * 60)
    print(
        f"\n{DRIVES} drives of 10 m, 500 particles, 60 beams: {seconds:.2f} s,"
        f" {1e9 * per_beam:.2f} ns a beam of a particle on all cores"
    )
    assert len(driven["ten metres"].errors) == DRIVES


def weighed_by_numpy(scores, ends, poses):
    """The weights of all particles and beams at once."""
    cos, sin = np.cos(poses[2])[:, None], np.sin(poses[2])[:, None]
    ahead, left = ends.T
    col = poses[0, :, None] / scores.resolution + scores.shift + cos * ahead - sin * left
    row = poses[1, :, None] / scores.resolution + scores.shift + sin * ahead + cos * left
    col = np.clip(col, 0, scores.cols - 1).astype(np.int64)
    row = np.clip(row, 0, scores.rows - 1).astype(np.int64)
    weights = 1 + scores.values[row * scores.cols + col].sum(axis=1, dtype=float)
    return weights / weights.sum()


def test_one_scan(benchmark, simulator):
    """The weights of all particles after a scan, beside NumPy in whole arrays."""
    random, scores = np.random.default_rng(0), simulator.arguments.scores
    poses = np.array([[20.0], [5.5], [0.0]]) + 0.3 * random.standard_normal((3, 500))
    bearing, at = np.linspace(0, 2 * np.pi, 60), random.uniform(10, 120, 60)
    ends = np.column_stack([at * np.cos(bearing), at * np.sin(bearing)])
    weights = np.full(500, 1 / 500)
    particles.weigh_particles(scores, ends, poses, 500, weights)
    assert weights == pytest.approx(weighed_by_numpy(scores, ends, poses), rel=1e-9)
    in_arrays = []
    for _ in range(50):
        began = time.perf_counter()
        weighed_by_numpy(scores, ends, poses)
        in_arrays.append(time.perf_counter() - began)
    benchmark(particles.weigh_particles, scores, ends, poses, 500, weights)
    seconds = benchmark.stats["min"]
    benchmark.extra_info["ratio_to_NumPy"] = min(in_arrays) / seconds
    print(
        f"\n{1e9 * seconds / 30_000:.2f} ns a beam of a particle,"
        f" NumPy {1e9 * min(in_arrays) / 30_000:.2f}"
    )

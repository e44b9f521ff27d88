"""Time `recommend_path`, and the whole command `plan` with its simulation.

Run: pytest tests/benchmarks/bench_choose.py --benchmark-only -s
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
from support.machine import SHARED_DATA

import locplan
from locplan.robots import Robot
from locplan.simulation import simulate

DEPOT = SHARED_DATA / "rosmaps" / "tb4_depot"
START, GOAL = (-10.0, 0.0), (10.0, 0.0)


@pytest.fixture(scope="module")
def depot():
    if not DEPOT.is_dir():
        pytest.skip("the real maps (../shared/data/rosmaps) are not here")
    return locplan.load_map(DEPOT)


def test_a_choice_of_20_metres(benchmark, depot):
    """Some ten candidates, beside the field; the drives alone are the peer."""
    lidar = locplan.Lidar.preset("turtlebot4")
    field = locplan.load_or_compute(depot, locplan.Fused(lidar))
    costs = locplan.Costmap.from_field(field)

    def chosen():
        return locplan.recommend_path(depot, START, GOAL, Robot(lidar), costs=costs)

    choice = chosen()
    benchmark.pedantic(chosen, rounds=5, iterations=1)
    seconds = benchmark.stats["min"]
    looked = len(choice.judgement.drives) if choice.judgement.leader else 0
    counts = [len(each.driven.numbers) for each in choice.candidates]
    metres = sum(
        each.path.length * (count + 8 * (looked > 0 and n in (0, choice.judgement.leader)))
        for n, (each, count) in enumerate(zip(choice.candidates, counts, strict=True))
    )
    print(
        f"\n{len(counts)} candidates, {metres:.0f} m driven: {seconds:.2f} s,"
        f" {1e3 * seconds / metres:.2f} ms a metre on {os.cpu_count()} cores; {choice.sentence}"
    )
    paths = {each.name: each.path for each in choice.candidates}
    driving = []
    for _ in range(3):
        began = time.perf_counter()
        simulate(depot, paths, robot=Robot(lidar), drives=4)
        driving.append(time.perf_counter() - began)
    alone = min(driving) / (4 * sum(path.length for path in paths.values()))
    benchmark.extra_info["share_of_its_drives_alone"] = alone * metres / seconds
    benchmark.extra_info["milliseconds_a_metre"] = 1e3 * seconds / metres


def test_plan_with_its_verdict_as_a_whole_process(benchmark, depot):
    ends = ["--start", "-10,0", "--goal", "10,0", "--lidar", "turtlebot4"]
    command = [sys.executable, "-m", "locplan", "plan", str(DEPOT), *ends]

    def planned():
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    out = planned()  # the field is cached now, and the kernels are compiled
    benchmark.pedantic(planned, rounds=3, iterations=1)
    assert "Nav2's defaults" in " ".join(out.split())
    print(f"\n{benchmark.stats['min']:.2f} s; {out.splitlines()[-1]}")

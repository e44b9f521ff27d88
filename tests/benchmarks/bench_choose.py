"""The simulated choice: seconds of one choice, and of `plan` with its verdict as a whole process.

Run: pytest tests/benchmarks/bench_choose.py --benchmark-only -s
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
from conftest import SHARED_DATA

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
    """Five candidates, eight drives each, beside the field; the drives alone are the peer."""
    lidar = locplan.Lidar.preset("turtlebot4")
    field = locplan.load_or_compute(depot, locplan.Fused.of(lidar))
    costs = locplan.Costmap.from_field(depot, field)
    own = {"aware": locplan.plan(costs, START, GOAL).path}

    def chosen():
        return locplan.choose(depot, START, GOAL, robot=Robot(lidar), costs=costs, candidates=own)

    choice = chosen()
    benchmark.pedantic(chosen, rounds=5, iterations=1)
    seconds = benchmark.stats["min"]
    paths = {each.name: each.path for each in choice.candidates}
    metres = sum(each.drives.distance[-1] * len(each.drives.errors) for each in choice.candidates)
    print(
        f"\n{len(paths)} candidates, {metres:.0f} m driven: {seconds:.2f} s,"
        f" {1e3 * seconds / metres:.2f} ms a metre on {os.cpu_count()} cores"
    )
    drives = len(choice.candidates[0].drives.errors)
    again = simulate(depot, paths, robot=Robot(lidar), drives=drives)
    driving = []
    for _ in range(3):
        began = time.perf_counter()
        simulate(depot, paths, robot=Robot(lidar), drives=drives)
        driving.append(time.perf_counter() - began)
    benchmark.extra_info["share_of_its_drives_alone"] = min(driving) / seconds
    benchmark.extra_info["milliseconds_a_metre"] = 1e3 * seconds / metres
    for each in choice.candidates:
        assert (again.drives[each.name].errors == each.drives.errors).all()


def test_plan_with_its_verdict_as_a_whole_process(benchmark, depot):
    ends = ["--start", "-10,0", "--goal", "10,0", "--lidar", "turtlebot4"]
    command = [sys.executable, "-m", "locplan", "plan", str(DEPOT), *ends]

    def planned():
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    out = planned()  # the field is cached now, and the kernels are compiled
    benchmark.pedantic(planned, rounds=3, iterations=1)
    assert "with Nav2's defaults" in out
    print(f"\n{benchmark.stats['min']:.2f} s; {out.splitlines()[-1]}")

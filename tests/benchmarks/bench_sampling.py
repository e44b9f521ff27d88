"""Measure OMPL's planners on a costmap: speed, cost after five seconds, and leaks.

pytest tests/benchmarks/bench_sampling.py --benchmark-only -s
"""

import resource
import statistics
import time

import numpy as np
import pytest
from ompl import base, util

from benchmarks.bench_planners import rooms
from locplan.field import FieldConfig, covariance_field
from locplan.maps import FREE, OccupancyGrid, environments, load_map
from locplan.planning import Costmap, ompl as sampling, plan
from locplan.planning.ompl.settings import log_messages, make_ompl_planner

WEIGHT = 3.0
SECONDS = 5.0
REAL = {"tb4_warehouse": 0.25, "willow_full_stage": 0.3}


def rooms_of_400() -> tuple[Costmap, tuple, tuple]:
    density = 1 + (rooms(400) - 1) * WEIGHT / 10
    costs = Costmap.from_density(OccupancyGrid(np.full((400, 400), FREE), 0.05), density)
    return costs, (0.1, 0.1), (19.9, 19.9)


def iterations_a_second(planner: str, information, problem) -> float:
    searching = make_ompl_planner(planner, information, {})
    searching.setProblemDefinition(problem)
    searching.setup()
    began = time.perf_counter()
    searching.solve(base.timedPlannerTerminationCondition(SECONDS))
    return searching.numIterations() / (time.perf_counter() - began)


@pytest.mark.parametrize(("planner", "target"), [("RRTstar", 10_000), ("BITstar", 70_000)])
def test_iterations_a_second(benchmark, planner, target):
    """Beside the usual way: states checked one by one from Python, and OMPL's own length."""
    costs, start, goal = rooms_of_400()
    sampling.Ompl(planner).prepare()
    motions = sampling.Motions(costs)
    rates = {}

    def run():
        with log_messages():
            util.RNG.setSeed(1)
            ours = sampling.space_information(motions)
            problem = sampling.problem_definition(ours, motions, start, goal)
            rates["ours"] = iterations_a_second(planner, ours, problem)
            util.RNG.setSeed(1)
            usual = base.SpaceInformation(sampling.state_space(motions))
            usual.setStateValidityChecker(lambda state: motions.is_free(state[0], state[1]))
            usual.setStateValidityCheckingResolution(0.05 / usual.getMaximumExtent())
            usual.setup()
            problem = base.ProblemDefinition(usual)
            ends = [sampling.state_from_pose(usual, motions, pose) for pose in (start, goal)]
            problem.setStartAndGoalStates(*ends)
            problem.setOptimizationObjective(base.PathLengthOptimizationObjective(usual))
            rates["length only"] = iterations_a_second(planner, usual, problem)

    benchmark.pedantic(run, rounds=1)
    benchmark.extra_info["ratio_to_states_checked_in_Python"] = rates["ours"] / rates["length only"]
    benchmark.extra_info["iterations_a_second"] = rates["ours"]
    print(
        f"\n{planner}: {rates['ours']:,.0f} iterations/s (target {target:,});"
        f" {rates['ours'] / rates['length only']:.2f} of the plain way by length only"
    )


def problem_on(name, real_maps):
    """A costmap of the field at the default settings, and two ends far apart."""
    if name in ("two_corridors", "office"):
        grid = environments.make(name, resolution=0.05)
        ends = environments.place_positions(name)
        start, goal, radius = ends["start"], ends["goal"], 0.25
    else:
        grid, radius = load_map(next((real_maps / name).glob("*.yaml"))), REAL[name]
    field = covariance_field(grid, FieldConfig())
    costs = Costmap.from_field(field, weight=WEIGHT, robot=radius)
    if name in REAL:
        start, goal = far_apart(costs)
    return costs, start, goal


def far_apart(costs):
    """The two ends of the longest way: farthest from the farthest cell of some free one."""
    from locplan.planning import cost_to_go

    def farthest(xy):
        cost = cost_to_go.plan_field(costs, xy).cost
        cost = np.where(np.isfinite(cost), cost, -1)
        return costs.grid.position(*map(int, np.unravel_index(cost.argmax(), cost.shape)))

    rows, cols = np.nonzero(np.isfinite(costs.density))
    clear = costs.grid.clearance[rows, cols].argmax()
    start = farthest(costs.grid.position(int(rows[clear]), int(cols[clear])))
    return start, farthest(start)


@pytest.mark.parametrize("name", ["two_corridors", "office", *REAL])
def test_cost_after_five_seconds(benchmark, name, real_maps):
    costs, start, goal = problem_on(name, real_maps)
    best = plan(costs, start, goal, planner="any-angle").metrics.cost
    lines = []

    def run():
        for planner in ("InformedRRTstar", "BITstar"):
            found = [
                plan(costs, start, goal, planner=planner, seed=seed, time_limit=SECONDS)
                for seed in range(1, 11)
            ]
            solved = [one.metrics.cost / best for one in found if one.status == "solved"]
            median = statistics.median(solved) if solved else np.nan
            benchmark.extra_info[f"{planner}_cost_above_any-angle"] = f"{median - 1:+.2%}"
            lines.append(
                f"{name}, {planner}: {len(solved)} of 10 solved, J {median - 1:+.2%}"
                f" of any-angle's ({best:.1f} m), from {min(solved, default=9) - 1:+.2%}"
                f" to {max(solved, default=9) - 1:+.2%}"
            )

    benchmark.pedantic(run, rounds=1)
    benchmark.extra_info["no_peer"] = f"costs after {SECONDS:g} s, which it takes in any case"
    print("\n" + "\n".join(lines))


def test_two_hundred_solves_do_not_grow(benchmark):
    costs, start, goal = rooms_of_400()

    def some(times):
        for seed in range(1, times + 1):
            planner = ("RRTstar", "InformedRRTstar", "BITstar", "PRMstar", "RRTConnect")[seed % 5]
            plan(costs, start, goal, planner=planner, seed=seed, time_limit=0.25)

    some(10)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    benchmark.pedantic(some, args=(200,), rounds=1)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    benchmark.extra_info["no_peer"] = "what 200 solves leave in memory; their time is given"
    benchmark.extra_info["megabytes"] = (after - before) / 1000
    print(f"\n200 solves: {(after - before) / 1000:+.1f} MB")


def test_reading_a_roadmap_takes_what_growth_leaves(benchmark):
    costs, start, goal = rooms_of_400()

    def run():
        began = time.perf_counter()
        result = plan(costs, start, goal, planner="PRMstar", time_limit=SECONDS)
        return result.metrics.cost, time.perf_counter() - began

    cost, seconds = benchmark.pedantic(run, rounds=1)
    best = plan(costs, start, goal, planner="any-angle").metrics.cost
    benchmark.extra_info["share_of_its_time_limit"] = SECONDS / seconds
    print(f"\nPRMstar: {seconds:.2f} s of {SECONDS:g}, J {cost / best - 1:+.2%} of any-angle's")

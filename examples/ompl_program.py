"""Use locplan in your own OMPL program: a planner by hand, then OMPL's Benchmark.

Run: python examples/ompl_program.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

from ompl import base, geometric, tools, util

import locplan
from locplan.maps import environments
from locplan.planning import ompl


def main(folder: str = "ompl_program") -> None:
    util.setLogLevel(util.LogLevel.LOG_WARN)
    grid = environments.make("two_corridors", resolution=0.1)
    ends = environments.place_positions("two_corridors")
    field = locplan.load_or_compute(grid, locplan.FieldConfig(stride=0.4))
    costs = locplan.Costmap.from_field(field)
    motions = ompl.Motions(costs)  # space="Dubins", turning_radius=0.5 for a car

    # A planner by hand: the space information checks states and motions, the problem has J.
    ompl.Ompl("InformedRRTstar").prepare()  # compiles the kernels, which takes seconds once
    information = ompl.space_information(motions)
    problem = ompl.problem_definition(information, motions, ends["start"], ends["goal"])
    path = find_path(information, problem, base.timedPlannerTerminationCondition(1.0))
    if path is None:
        print("InformedRRTstar: no path to the goal after 1 s")
    else:
        cost = path.cost(problem.getOptimizationObjective()).value()
        print(f"InformedRRTstar: J = {cost:.1f} m after 1 s, {path.getStateCount()} states")

    # Or use OMPL's SimpleSetup, here to compare planners with its Benchmark. (That keeps
    # its set-up to the end of the program, where nanobind complains of a leak: a flaw of OMPL.)
    setup = geometric.SimpleSetup(information)
    start, goal = (
        ompl.state_from_pose(information, motions, ends[name]) for name in ("start", "goal")
    )
    setup.setStartAndGoalStates(start, goal)
    setup.setOptimizationObjective(ompl.CostObjective(information, motions))
    benchmark = tools.Benchmark(setup, "two_corridors")
    for kind in (geometric.RRTstar, geometric.BITstar):
        benchmark.addPlanner(kind(information))
    request = tools.Request()
    request.maxTime, request.runCount = 0.5, 2
    request.displayProgress = request.saveConsoleOutput = False
    benchmark.benchmark(request)
    log = Path(folder) / "benchmark.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    benchmark.saveResultsToFile(str(log))
    print(f"wrote {log}; ompl_benchmark_statistics {log} makes a database for Planner Arena of it")


def find_path(
    information: base.SpaceInformation,
    problem: base.ProblemDefinition,
    limit: base.PlannerTerminationCondition,
) -> geometric.PathGeometric | None:
    """Return the path that a planner finds within a limit, or None if none reaches the goal."""
    planner = geometric.InformedRRTstar(information)
    planner.setProblemDefinition(problem)
    planner.setRewireFactor(0.25)
    planner.setup()
    planner.solve(limit)
    # Otherwise OMPL's solution is a path that ends near the goal, whose cost means nothing.
    return problem.getSolutionPath() if problem.hasExactSolution() else None


if __name__ == "__main__":
    main(*sys.argv[1:2])

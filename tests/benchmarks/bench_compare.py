"""Time the overhead of a comparison, per run and in total.

Run: pytest tests/benchmarks/bench_compare.py --benchmark-only -s
"""

import numpy as np
import pytest

import locplan
from locplan.comparison import Execution
from locplan.field import FieldConfig

MAPS = ("aws_small_house", "tuw_warehouse032")
PLANNERS = ("grid", "any-angle", "InformedRRTstar", "BITstar", "RRTConnect")
ANYTIME = ("InformedRRTstar", "BITstar")


@pytest.mark.parametrize("time_limit", [0.5, 1.0])
def test_a_comparison_of_real_maps(benchmark, real_maps, tmp_path, time_limit):
    """Five planners, ten queries, three weights and three seeds on two maps, with the report."""
    settings = {
        "weights": [1.0, 4.0, 12.0],
        "seeds": [1, 2, 3],
        "configs": FieldConfig(),
        "execution": Execution(workers=2, time_limit=time_limit),
    }

    def run():
        made = locplan.compare([real_maps / name for name in MAPS], PLANNERS, 10, **settings)
        made.save(tmp_path / "out")
        return made

    made = benchmark.pedantic(run, rounds=1)
    assert {run.status for run in made.runs} == {"solved"}
    limits = sum(time_limit for run in made.runs if run.task.planner in ANYTIME) / 2
    over = benchmark.stats["mean"] / limits - 1
    benchmark.extra_info["share_of_the_time_limits"] = limits / benchmark.stats["min"]
    print(f"\n{len(made.runs)} runs, limits of {limits:.0f} s for two workers: {over:+.1%}")
    for planner in PLANNERS:
        extra = [r.wall_seconds - r.seconds for r in made.runs if r.task.planner == planner]
        told = f"median {1000 * np.median(extra):.1f} ms, largest {1000 * max(extra):.1f} ms"
        print(f"{planner}: beyond the planner {told}")

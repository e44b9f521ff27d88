"""Time the first path with a lidar's estimator, on a field near the paths and on the whole field.

pytest tests/benchmarks/bench_first_path.py --benchmark-only -s
"""

import time

import pytest

from locplan.field import FieldConfig, Fused, covariance_field
from locplan.maps import load_map
from locplan.planning import Costmap, path_metrics
from locplan.planning.plans import AWARE, plan_with_adaptive_field, plan_with_shortest
from locplan.robots import Lidar

QUERIES = {
    "fetch_3_1_16_png": ((3.6, 36.2), (44.2, 3.0)),
    "fetch_4_26_15": ((-16.3, 30.0), (22.2, -2.8)),
}
CONFIG = FieldConfig(Fused(Lidar.preset("lms291")))
"""It looks forward only: 8 headings."""


@pytest.mark.parametrize("name", QUERIES)
def test_first_path(benchmark, real_maps, name):
    grid = load_map(next((real_maps / name).glob("*.yaml")))
    start, goal = QUERIES[name]

    def planned(field):
        costs = Costmap.from_field(field)
        return plan_with_shortest(costs, start, goal)

    def near_paths():
        return plan_with_adaptive_field(
            grid,
            CONFIG,
            lambda points: covariance_field(grid, CONFIG, points=points),
            planned,
            lambda plans: [each.path for each in plans.values()],
        )

    planned(covariance_field(grid, FieldConfig(CONFIG.estimator, stride=2.0)))
    began = time.perf_counter()
    whole = covariance_field(grid, CONFIG)
    best = planned(whole)[AWARE].metrics.cost
    whole_seconds = time.perf_counter() - began
    field, plans = benchmark.pedantic(near_paths, rounds=1)
    costs = Costmap.from_field(whole)
    assert path_metrics(costs, plans[AWARE].path).cost == pytest.approx(best, rel=2e-3)
    seconds = benchmark.stats.stats.min
    benchmark.extra_info["ratio_to_the_whole_field"] = whole_seconds / seconds
    evaluated = field.is_evaluated.sum() / whole.is_evaluated.sum()
    benchmark.extra_info["points_evaluated"] = float(evaluated)
    print(
        f"{name}: {seconds:.1f} s near the paths, {whole_seconds:.1f} s for the whole field;"
        f" {evaluated:.0%} of the points"
    )

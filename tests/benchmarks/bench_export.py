"""Time exports of a 2000 x 2000 map from a cached field, and measure the error of masks.

Run: pytest tests/benchmarks/bench_export.py --benchmark-only -s
"""

import time

import numpy as np
import pytest
from support.smac import compare_with_smac, find_far_ends

from locplan import load_map
from locplan.export import nav2_keepout, nav2_speed, plain_files, ros_map
from locplan.field import CovarianceField, FieldConfig, load_or_compute
from locplan.maps import OccupancyGrid, environments
from locplan.planning import Costmap

SIZE = 2000
RESOLUTION = 0.05


def rooms() -> np.ndarray:
    """Rooms of 8 m with doors and a box each."""
    cells = np.full((SIZE, SIZE), 254, np.uint8)
    rng = np.random.default_rng(1)
    for at in range(0, SIZE, 160):
        cells[at : at + 3] = cells[:, at : at + 3] = 0
    for row in range(0, SIZE, 160):
        for col in range(0, SIZE, 160):
            door = 20 + int(rng.integers(100))
            cells[row : row + 3, col + door : col + door + 30] = 254
            cells[row + door : row + door + 30, col : col + 3] = 254
            top, left = rng.integers(20, 120, 2)
            cells[row + top : row + top + 24, col + left : col + left + 16] = 0
    return cells


@pytest.fixture(scope="module")
def made():
    grid = OccupancyGrid(rooms(), RESOLUTION, name="rooms")
    return grid, load_or_compute(grid, FieldConfig())


def everything(grid: OccupancyGrid) -> tuple[CovarianceField, Costmap]:
    """What every command does first: the field from the cache, and the costmap."""
    field = load_or_compute(grid, FieldConfig())
    return field, Costmap.from_field(field, robot=0.25)


def fresh(made) -> OccupancyGrid:
    """The same map without anything remembered of it."""
    return OccupancyGrid(made[0].cells, RESOLUTION, name="rooms")


WRITERS = {
    "nav2-keepout": lambda folder, _, costs: nav2_keepout(folder, costs),
    "nav2-speed": lambda folder, _, costs: nav2_speed(folder, costs),
    "ros-map": lambda folder, _, costs: ros_map(folder, costs),
    "npz": lambda folder, field, _: plain_files.write_field_file(folder.with_suffix(".npz"), field),
}


def test_reading_alone(benchmark, made):
    benchmark.pedantic(lambda: everything(fresh(made)), rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("name", WRITERS)
def test_export(benchmark, made, tmp_path, name):
    def run():
        field, costs = everything(fresh(made))
        WRITERS[name](tmp_path / "out", field, costs)

    benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    began = time.perf_counter()
    everything(fresh(made))
    reading = time.perf_counter() - began
    benchmark.extra_info["share_of_reading_the_field_alone"] = reading / benchmark.stats["min"]
    size = sum(file.stat().st_size for file in tmp_path.rglob("*") if file.is_file())
    print(f"\n{name}: {benchmark.stats['median']:.2f} s, {size / 1e6:.1f} MB")


MAPS = ("aws_small_house", "willow_full_stage", "tb4_warehouse", "mit_stata_basement_yaw")


@pytest.mark.filterwarnings("ignore::locplan.export.values.YawWarning")
@pytest.mark.parametrize("weight", [1.0, 4.0, 12.0])
@pytest.mark.parametrize("name", ["two_corridors", "office", *MAPS, "fetch_4_26_15"])
def test_smac2d_on_our_mask(benchmark, real_maps, tmp_path, name, weight):
    """J of SmacPlanner2D's formula on the mask beside the grid planner's, both cutting corners."""
    own = name in environments.list_environments()
    grid = environments.make(name) if own else load_map(*(real_maps / name).glob("*.yaml"))
    field = load_or_compute(grid, FieldConfig())
    costs = Costmap.from_field(field, weight=weight, robot=0.2)
    ratios = []

    def run():
        for seed in range(4):
            ends = find_far_ends(costs, seed)
            theirs, ours, _ = compare_with_smac(tmp_path / f"{seed}", costs, *ends)
            ratios.append(theirs.cost / ours.cost - 1)

    benchmark.pedantic(run, rounds=1)
    benchmark.extra_info["no_peer"] = "how exact a mask is, not how fast"
    benchmark.extra_info["J_of_its_paths_above_ours"] = f"at most {max(ratios):.3%}"
    print(f"\n{name}, weight {weight:g}: J larger by {', '.join(f'{r:.3%}' for r in ratios)}")

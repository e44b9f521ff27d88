"""What tuning says of filters that were lost, or whose robot was kidnapped."""

from __future__ import annotations

import numpy as np
import pytest
from made_drives import recorded

from locplan.costs import Costmap, Path
from locplan.maps import environments
from locplan.recordings import tune_on_drive
from locplan.robots import Amcl, Disturbances, Lidar, Odometry, Robot
from locplan.simulation import Kidnapping, SimulatedBench, poses_along, tune

FAR = Path([(2.0, 3.0), (36.0, 3.0)])
STILL = Amcl(min_particles=20, max_particles=20, alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0)
EXACT = Disturbances(start_sigma=0.0, start_sigma_deg=0.0)
NONE = Odometry(**dict.fromkeys(Odometry.__dataclass_fields__, 0.0))


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


def bent() -> np.ndarray:
    """Poses every 0.1 m: 4 m ahead, then to the left."""
    way = np.arange(0.0, 4.0, 0.1)
    ahead = np.column_stack([way, 0 * way, 0 * way])
    left = np.column_stack([0 * way + 4.0, way, 0 * way + np.pi / 2])
    return np.concatenate([ahead, left])


def test_odometry_knows_nothing_of_a_kidnapping():
    line = bent()
    kidnapping = Kidnapping.on(line, 3.0)
    reported, kept = kidnapping.odometry(line), line[kidnapping.kept]
    at = kidnapping.first
    assert line[at, 0] == pytest.approx(2.0)  # a quarter of the way
    carried = kept[at + 1] - kept[at]
    assert 3.0 <= np.hypot(*carried[:2]) < 3.1
    assert carried[2] == pytest.approx(np.pi / 2)  # round the corner
    assert reported[at + 1] == pytest.approx(reported[at])
    # Further on it reports the way that the robot drives, as its wheels see it.
    assert reported[-1, 0] - reported[at, 0] == pytest.approx(kept[-1, 1] - kept[at + 1, 1])
    assert reported[-1, 1:] == pytest.approx([0.0, 0.0])
    assert Kidnapping.on(line[:10], 3.0) is None


def test_a_filter_is_judged_ten_metres_after_a_kidnapping():
    way = np.arange(0.0, 30.0, 0.1)
    kept = Kidnapping.on(np.column_stack([way, 0 * way, 0 * way]), 1.0).kept
    assert way[kept[-1]] == pytest.approx(3.0 + 1.0 + 10.0, abs=0.11)
    assert (np.diff(kept) > 1).sum() == 1


def test_a_filter_that_follows_odometry_never_comes_back(grid):
    robot = Robot(Lidar(range=6.0, beams=60), filter=STILL, odometry=NONE, disturbances=EXACT)
    paths = [FAR, *SimulatedBench.paths(Costmap.blank(grid), 2, 1)]
    bench = SimulatedBench(grid, robot, paths, 2, seed=5, threads=2)
    for metres in (1.0, 3.0):
        expected = []
        for line in bench.lines:
            kidnapping = Kidnapping.on(line, metres)
            off = kidnapping.odometry(line)[-1] - line[kidnapping.kept[-1]]
            expected += [float(np.hypot(*off[:2]))] * 2
        assert expected[0] == pytest.approx(metres, abs=0.06)
        assert bench.kidnapped(STILL, metres) == pytest.approx(np.array(expected), abs=1e-6)


@pytest.mark.long
def test_what_a_filter_does_after_a_kidnapping_is_said(grid):
    robot = Robot(Lidar(range=6.0, beams=60), filter=STILL)
    found = tune(grid, robot, paths=5, drives=2, threads=2)
    shown = {each.after: each for each in found.to_use.recoveries}
    assert shown["after a kidnapping of 1 m"].drives == 10
    assert 0 < shown["after a kidnapping of 3 m"].drives <= 10
    last = next(
        line for line in found.report().splitlines() if line.startswith("The filter is back")
    )
    assert last.startswith("The filter is back within 10 m of driving, or by the goal, after ")
    for each in shown.values():
        assert f"{each.after}, in {each.back} of {each.drives} drives [" in last
    judged = found.summary()["judged"]
    told = {found.own, found.candidate}  # kidnappings cost, and the others are not written
    assert {each.amcl for each in found.judged if each.recoveries} == told
    assert judged[0]["recoveries"][-1]["share"][0] <= 1.0


def test_recorded_drives_are_replayed_with_a_kidnapping(grid):
    drive = recorded(grid, poses_along(FAR, grid)[::2])
    robot = Robot(filter=STILL, disturbances=EXACT)
    found = tune_on_drive(drive, grid, robot, drives=2)
    shown = {each.after: each for each in found.judged[0].recoveries}
    for metres in (1, 3):
        each = shown[f"after a kidnapping of {metres} m"]
        assert (each.back, each.drives) == (0, 10)  # five parts, twice each
    assert "\nThe filter is back within 10 m of driving" in found.report()

"""Paths of any planner checked for a robot."""

import json
import math

import numpy as np
import pytest

from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Path, check_path, path_cost, plan
from locplan.robots import Footprint, Kinematics, Robot

BOX = Footprint([(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
CAR = Kinematics(drive="car-like", turning_radius=0.5, reverse=False)


def room(yaw=0.0):
    """An empty map with a pillar whose lower edge lies 2 m up, from 4 to 4.4 m."""
    cells = np.full((60, 80), FREE, np.uint8)
    cells[20:24, 40:44] = OCCUPIED
    return OccupancyGrid(cells, 0.1, (-2.0, 1.0, yaw))


def in_world(grid, poses):
    x, y = grid.grid_to_world(*np.array(poses)[:, [1, 0]].T / 0.1)
    headings = np.array(poses)[:, 2] + grid.origin[2]
    return Path(np.column_stack([x, y]), headings)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize("beside", [1.6, 1.75])
def test_check_clearance_uses_outline_along_path(yaw, beside):
    grid = room(yaw)
    check = check_path(grid, in_world(grid, [(1, beside, 0), (7, beside, 0)]), Robot(footprint=BOX))
    assert check.drivable
    assert check.clearance == pytest.approx(2.0 - beside - 0.2, abs=2e-3)
    assert check.swept.sum() * 0.01 == pytest.approx(6.6 * 0.4, rel=0.3)
    assert math.isinf(check.least_radius)
    assert math.isnan(check.cost)


def test_collision_fault_has_place_and_distance():
    grid, robot = room(), Robot(footprint=BOX)
    check = check_path(grid, in_world(grid, [(1 + n / 4, 1.9, 0) for n in range(25)]), robot)
    assert not check.drivable
    assert check.clearance == 0.0
    (fault,) = check.faults
    assert fault.kind == "collision"
    assert fault.along == pytest.approx(2.5)
    assert fault.length == pytest.approx(1.25)
    assert BOX.find_first_collision(grid, check.path) == pytest.approx((fault.x, fault.y))
    free = check_path(grid, in_world(grid, [(1, 1.9, 0), (7, 1.9, 0)]), Robot(footprint=0.09))
    assert free.drivable


def test_turn_and_reverse_faults_need_car():
    """A robot that turns in place can drive the same paths."""
    grid = room()
    corner = Path([(-1.0, 1.5), (3.0, 1.5), (3.0, 2.5)])
    back = in_world(grid, [(1, 0.5, 0), (3, 0.5, 0), (2, 0.5, 0)])
    for path, kind in ((corner, "tight turn"), (back, "reverse")):
        (fault,) = check_path(grid, path, Robot(footprint=BOX, kinematics=CAR)).faults
        assert fault.kind == kind
        assert check_path(grid, path, Robot(footprint=BOX)).drivable
    angle = np.linspace(0, 1.5, 20)
    for radius, drivable in ((0.5, True), (0.45, False)):
        arc = np.column_stack([2 + radius * np.sin(angle), 1 + radius * (1 - np.cos(angle)), angle])
        check = check_path(grid, in_world(grid, arc), Robot(footprint=BOX, kinematics=CAR))
        assert check.least_radius == pytest.approx(radius)
        assert check.drivable == drivable


def test_lattice_path_passes_check():
    grid, robot = room(), Robot(footprint=BOX, kinematics=CAR)
    costs = Costmap.blank(grid, robot=robot)
    made = plan(costs, (-1.0, 2.0, 0.0), (4.5, 5.0, 1.57), planner="lattice")
    check = check_path(grid, made.path, robot, costs=costs)
    assert check.drivable, check.report()
    assert check.cost == path_cost(costs, made.path)
    assert check.least_radius >= 0.495


def test_saved_check_has_faults(tmp_path):
    grid, robot = room(), Robot(footprint=BOX, kinematics=CAR)
    check = check_path(grid, [(-1.0, 2.9), (3.0, 2.9), (3.0, 2.0)], robot)
    check.save(tmp_path / "out")
    saved = json.loads((tmp_path / "out" / "path-check.json").read_text())
    assert [each["kind"] for each in saved["faults"]] == ["collision", "tight turn"]
    assert saved["drivable"] is False
    assert "collision" in (tmp_path / "out" / "path-check.csv").read_text()
    assert "cannot be driven at 2 places" in check.figure().axes[0].get_title()
    assert check == check_path(grid, [(-1.0, 2.9), (3.0, 2.9), (3.0, 2.0)], robot)
    assert "tight turn" in check.report()


def test_check_accepts_point_robot():
    found = check_path(room(), [(1.0, 1.0), (2.0, 1.0)], Robot(footprint=0.0, margin=0.0))
    assert found.drivable


def test_check_path_rejects_invalid_arguments():
    grid = room()
    with pytest.raises(ConfigError, match="robot must be"):
        check_path(grid, [(0, 2), (1, 2)], 0.2)
    with pytest.raises(ConfigError, match="another map"):
        check_path(grid, [(0, 2), (1, 2)], Robot(), costs=Costmap.blank(room(0.1), robot=0.1))
    with pytest.raises(LocplanError):
        check_path(grid, [(0, math.nan), (1, 2)], Robot())

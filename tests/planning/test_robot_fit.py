"""Paths respect the robot of the costmap, or the plan's note says what they ignore."""

import dataclasses

import numpy as np
import pytest

import locplan
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, check_path, pareto_front, plan, plan_field
from locplan.robots import Footprint, Kinematics, Robot

SLIM = Footprint([(0.5, 0.2), (0.5, -0.2), (-0.5, -0.2), (-0.5, 0.2)])
CAR = Kinematics(drive="car-like", turning_radius=0.8)
ROBOTS = {
    "outline": Robot(footprint=SLIM),
    "turning radius": Robot(footprint=0.2, kinematics=CAR),
    "both": Robot(footprint=SLIM, kinematics=CAR),
}
ENDS = (1.0, 1.0), (7.0, 3.0)
POSES = (1.0, 1.0, 0.0), (7.0, 3.0, 0.0)


def costs_for(robot, *, posts=()) -> Costmap:
    """Two rooms of 0.1 m cells, joined by a door of 1.2 m, of which one half is degenerate.

    Posts are occupied cells (row, col).
    """
    cells = np.full((40, 80), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[:, 40] = OCCUPIED
    cells[14:26, 40] = FREE
    for row, col in posts:
        cells[row, col] = OCCUPIED
    u = np.broadcast_to(np.linspace(0, 1, 40)[:, None], cells.shape)
    return Costmap.from_layers(OccupancyGrid(cells, 0.1), u=u, weight=4.0, robot=robot)


@pytest.mark.parametrize("name", ROBOTS)
def test_default_path_is_drivable(name):
    robot = ROBOTS[name]
    found = plan(costs_for(robot), *ENDS)
    assert found.planner == "lattice"
    assert found.note == ""
    assert check_path(costs_for(robot).grid, found.path, robot).drivable


@pytest.mark.parametrize("robot", [0.2, Robot(footprint=0.2)])
def test_circle_keeps_its_default_planner(robot):
    costs = costs_for(robot)
    found, grid = plan(costs, *ENDS), plan(costs, *ENDS, planner="grid")
    assert (found.planner, found.note, grid.note) == ("any-angle", "", "")
    assert np.array_equal(found.path.xy, plan(costs, *ENDS, planner="any-angle").path.xy)


@pytest.mark.parametrize("planner", ["grid", "astar", "any-angle", "RRTstar"])
def test_note_names_what_planner_ignores(planner):
    options = {"iterations": 200} if planner == "RRTstar" else {}
    for name, what in [
        ("outline", "outline"),
        ("turning radius", "turning radius"),
        ("both", "outline and turning radius"),
    ]:
        note = plan(costs_for(ROBOTS[name]), *ENDS, planner=planner, **options).note
        assert note.startswith(f"{planner} ignores the robot's {what}: ")


def test_budget_front_and_field_have_note():
    costs = costs_for(ROBOTS["both"])
    front = pareto_front(costs, *ENDS)
    plans = (
        plan(costs, *ENDS, budget=100.0),
        front.plan(0),
        plan_field(costs, ENDS[1]).plan(ENDS[0]),
    )
    assert all("ignores the robot's outline and turning radius" in each.note for each in plans)


def test_note_judges_user_path():
    def straight(costs, start, goal):
        return locplan.Path(np.array([start, goal]))

    costs = costs_for(ROBOTS["both"])
    assert plan(costs, (1.0, 1.0), (3.0, 1.0), planner=straight).note == ""
    blocked = plan(costs, (3.5, 0.5), (0.5, 0.5), planner=straight)
    assert blocked.note.startswith("the robot cannot drive this path: collision near")


@pytest.mark.parametrize("space", ["Dubins", "ReedsShepp"])
@pytest.mark.parametrize("planner", ["RRTstar", "PRMstar"])
def test_ompl_curves_respect_outline(space, planner):
    """On the direct curve a front corner of the outline hits a post that the circle passes.

    The robot must back up to go around it.
    """
    long = Footprint([(0.8, 0.2), (0.8, -0.2), (-0.8, -0.2), (-0.8, 0.2)])
    robot = Robot(footprint=long, kinematics=CAR)
    costs = costs_for(robot, posts=[(10, 20)])
    ends = (1.187, 1.113, 0.0), (1.987, 2.6, np.pi / 2)
    options = {"space": space, "turning_radius": 0.8, "iterations": 200, "planner": planner}
    circle = dataclasses.replace(costs, robot=None)
    direct = plan(circle, *ends, **options).path
    assert check_path(costs.grid, direct, robot).faults[0].kind == "collision"
    found = plan(costs, *ends, **options)
    assert found.status == ("solved" if space == "ReedsShepp" else "not found")
    if found.path is not None:
        assert found.note == ""
        assert check_path(costs.grid, found.path, robot).drivable


def test_ompl_note_names_colliding_end():
    options = {"planner": "RRTstar", "space": "Dubins", "turning_radius": 0.8, "iterations": 9}
    found = plan(costs_for(ROBOTS["both"]), (0.5, 1.0, 0.0), POSES[1], **options)
    assert found.status == "infeasible"
    assert "outline meets a wall at the start" in found.note


def test_ompl_note_names_tighter_radius():
    options = {"planner": "RRTstar", "space": "ReedsShepp", "iterations": 500}
    robot = Robot(footprint=0.2, kinematics=dataclasses.replace(CAR, reverse=False))
    found = plan(costs_for(robot), *POSES, turning_radius=0.4, **options)
    assert found.note.startswith("RRTstar ignores the robot's turning radius and lack of a reverse")


@pytest.mark.usefixtures("inline_workers")
def test_compare_uses_robot_planner():
    costs = costs_for(ROBOTS["both"])
    execution = locplan.comparison.Execution(workers=1)
    result = locplan.compare(costs, queries=[ENDS], execution=execution)
    notes = {run.task.planner: run.note for run in result.runs}
    assert result.baseline == "lattice"
    assert notes["lattice"] == ""
    assert "cannot drive" in notes["grid"]


def test_candidates_for_outline_robot_are_drivable():
    robot = ROBOTS["outline"]
    costs = costs_for(robot)
    choice = locplan.recommend_path(costs.grid, *ENDS, robot, costs=costs)
    assert {each.planner for each in choice.candidates} == {"lattice"}
    for each in choice.candidates:
        assert check_path(costs.grid, each.path, robot).drivable

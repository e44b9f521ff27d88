"""Closed-loop drives: steered by the filter's pose, does the robot arrive?"""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases

from locplan import Footprint, Lidar, OccupancyGrid, Path, Robot
from locplan._support.intervals import make_generator
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, Zone, Zones
from locplan.robots import Disturbances, Kinematics
from locplan.simulation import Arrivals, ClosedLoopSettings, Simulator, drive_closed, simulate
from locplan.simulation.arrivals import ENDS, STOPS, ClosedLoopDrive
from locplan.simulation.driver import compute_route_key
from locplan.simulation.figures import MARK_LABELS

QUIET = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0)
OUTLINE = Footprint([(0.35, 0.15), (0.35, -0.15), (-0.2, -0.15), (-0.2, 0.15)])
CLOSED = 6
"""Stream of random numbers of closed-loop drives."""


def room(*, wall=None, door=(0, 0), origin=(0.0, 0.0, 0.0), resolution=0.1):
    """A room of 8 x 5 m, in which a wall at x = 4 m may have a door between two heights [m]."""
    cells = np.full((round(5 / resolution), round(8 / resolution)), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[15:17, 10:13] = OCCUPIED
    if wall:
        cells[:, round(4 / resolution)] = OCCUPIED
        low, high = (round(each / resolution) for each in door)
        cells[low:high, round(4 / resolution)] = FREE
    return OccupancyGrid(cells, resolution, origin=origin, name="room")


def line(*xy, grid=None):
    points = np.array(xy)
    if grid is not None:
        points = np.column_stack(grid.grid_to_world(*(points[:, ::-1] / grid.resolution).T))
    return Path(points)


def drive_path(grid, path, robot, drives=8, seed=1, **options):
    simulator = Simulator(grid, robot, seed=seed)
    return drive_closed(simulator, {"path": path}, range(drives), **options)["path"]


def outcomes(arrivals):
    return [drive.outcome for drive in arrivals.drives]


ROBOTS = {
    "round": Robot(Lidar(range=5.0, beams=60)),
    "outlined": Robot(Lidar(range=5.0, beams=60), footprint=OUTLINE),
    "sideways": Robot(
        Lidar(range=5.0, beams=60), kinematics=Kinematics(drive="omnidirectional", speed=0.4)
    ),
    "car": Robot(
        Lidar(range=5.0, beams=60),
        footprint=OUTLINE,
        kinematics=Kinematics(drive="car-like", turning_radius=0.8),
    ),
}
BENT = ((1.5, 1.0), (3.0, 3.5), (6.5, 1.5))
AHEAD = 2.5
"""Length of the first stretch of `there_and_back` [m]."""


def there_and_back():
    """A path with headings: straight ahead, and then in reverse along an arc."""
    turn = np.linspace(0.0, 1.4, 60)
    back = np.column_stack([4.0 - np.sin(turn), 0.7 + 1 - np.cos(turn)])
    xy = np.concatenate([[(4.0 - AHEAD, 0.7)], back])
    return Path(xy, np.concatenate([[0.0], -turn]))


@pytest.mark.parametrize("name", sample_cases(["round", "sideways", "car", "outlined"], 2))
def test_closed_loop_drive_equals_plain_loop(name):
    """The robot knows its pose, so that the drive depends on the follower alone."""
    grid, robot = room(), ROBOTS[name].with_settings({"boundary_noise": 0.0})
    path = there_and_back() if name == "car" else line(*BENT)
    (drive,) = drive_path(grid, path, robot, 1, seed=3, perfect=True).drives
    corners = OUTLINE.vertices
    discs = [(0.0, 0.0, 0.2)]
    if robot.outline:
        sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        discs = [
            (*(a + step * 0.05 / math.dist(a, b) * (b - a)), 0.025)
            for a, b in sides
            for step in range(math.ceil(math.dist(a, b) / 0.05 - 1e-9))
        ]
    even = path.resample(0.05, even=True)
    gears = [-1 if name == "car" and at > AHEAD + 0.025 else 1 for at in even.distance]
    directed_path = np.column_stack([even.xy, gears])
    first = (*even.xy[0], math.atan2(*(even.xy[6] - even.xy[0])[::-1]))
    stops = grid.cells == OCCUPIED
    truth = oracles.closed_loop.follow(
        make_generator(3, CLOSED, compute_route_key(path), 0),
        *(directed_path.tolist(), stops, 0.1, robot, discs, first, 1000),
    )
    assert drive.outcome == "arrived"
    assert drive.truth == pytest.approx(truth, abs=1e-9)
    assert drive.believed == pytest.approx(drive.truth)


def test_robot_with_good_filter_reaches_goal():
    grid = room(origin=(-3.0, 2.0, 0.7))
    arrivals = drive_path(grid, line(*BENT, grid=grid), ROBOTS["round"])
    assert outcomes(arrivals) == ["arrived"] * 8
    goal = line(*BENT, grid=grid).xy[-1]
    assert all(math.dist(drive.truth[-1, :2], goal) < 0.5 for drive in arrivals.drives)
    assert all(math.dist(drive.believed[-1, :2], goal) <= 0.25 for drive in arrivals.drives)
    assert arrivals.arrival_rate.low == pytest.approx(0.676, abs=1e-3)


class Shifted:
    """A filter that believes odometry from a pose that is off by some metres in x."""

    title, settings = "shifted", "Shifted()"

    def __init__(self, shift, stands=False):
        self.shift, self.stands = shift, stands

    def start(self, grid, lidar, pose, deviation, random):
        self.pose = np.add(pose, (self.shift, 0.0, 0.0))
        self.last = None
        return self

    def motion(self, odometry):
        if self.last is not None and not self.stands:
            turn = self.pose[2] - self.last[2]
            dx, dy = odometry[:2] - self.last[:2]
            cos, sin = math.cos(turn), math.sin(turn)
            step = [cos * dx - sin * dy, sin * dx + cos * dy, odometry[2] - self.last[2]]
            self.pose = self.pose + step
        self.last = np.array(odometry)

    def scan(self, ranges):
        pass

    def estimate(self):
        return self.pose

    def covariance(self):
        return np.eye(3)


STILL = dict.fromkeys(
    ("distance_drift", "heading_drift_deg", "turn_drift_deg", "distance_bias", "heading_bias_deg"),
    0.0,
)
STILL |= {"turn_bias": 0.0, "start_sigma": 0.0, "start_sigma_deg": 0.0}


def noiseless_robot(filter):
    robot = Robot(Lidar(range=5.0, beams=20), filter=filter, disturbances=QUIET)
    return robot.with_settings(STILL)


def test_shifted_estimate_ends_drive_elsewhere():
    """The robot believes that it has reached the goal."""
    path = line((2.0, 2.5), (6.0, 2.5))
    (drive,) = drive_path(room(), path, noiseless_robot(Shifted(0.8)), 1).drives
    assert drive.outcome == "elsewhere"
    assert not drive.fault
    assert drive.believed[-1] - drive.truth[-1] == pytest.approx([0.8, 0.0, 0.0], abs=1e-6)
    (near,) = drive_path(room(), path, noiseless_robot(Shifted(0.2)), 1).drives
    assert near.outcome == "arrived"


class Jumping(Shifted):
    """A filter whose estimate jumps sideways by some metres after 4 s of perfect odometry."""

    def __init__(self, jump):
        super().__init__(0.0)
        self.jump, self.updates = jump, 0

    def scan(self, ranges):
        self.updates += 1
        if self.updates == 40:
            self.pose = np.add(self.pose, (0.0, self.jump, 0.0))


@pytest.mark.parametrize(("jump", "is_aborted"), [(1.6, True), (1.4, False)])
def test_drive_aborts_if_estimate_jumps_away(jump, is_aborted):
    """RPP cuts the plan at half the local costmap, 1.5 m; without poses it aborts the goal."""
    path = line((1.5, 2.0), (6.5, 2.0))
    (drive,) = drive_path(room(), path, noiseless_robot(Jumping(jump)), 1).drives
    assert (drive.outcome == "aborted") == is_aborted
    assert (drive.seconds == pytest.approx(3.9)) == is_aborted
    assert is_aborted or drive.seconds > 10


def test_robot_stops_if_arc_meets_wall():
    """It tries as often as Nav2's default tree: seven failures, each after one clearing."""
    grid, path = room(wall=True, door=(2.3, 2.5)), line((2.0, 2.4), (6.5, 2.4))
    (drive,) = drive_path(grid, path, noiseless_robot(Shifted(0.0)), 1).drives
    assert (drive.outcome, drive.standstills) == ("aborted", 14)
    arrivals = Arrivals((drive, dataclasses.replace(drive, outcome="arrived", standstills=0)))
    assert arrivals.standstills == 7.0
    assert arrivals.abort_rate.value == 0.5
    step, heading = np.diff(drive.truth, axis=0), drive.truth[:-1, 2]
    ahead = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
    # Two spins by 90 deg, and one retreat by 0.3 m.
    assert (step[:, 2] > math.pi / 2 / 16 - 1e-9).sum() >= 32
    assert ahead[ahead < 0].sum() == pytest.approx(-0.3, abs=0.01)


def test_robot_stops_if_arc_cuts_corner():
    """The path keeps off the walls, and the arc to a point 0.6 m ahead does not."""
    grid = room(wall=True, door=(2.2, 2.8))
    path = line((3.65, 0.8), (3.65, 2.5), (6.5, 2.5))
    (drive,) = drive_path(grid, path, noiseless_robot(Shifted(0.0)), 1).drives
    assert drive.standstills > 0
    wide = room(wall=True, door=(1.9, 3.1))
    (drive,) = drive_path(wide, path, noiseless_robot(Shifted(0.0)), 1).drives
    assert (drive.outcome, drive.standstills) == ("arrived", 0)


def test_constant_estimate_leads_to_timeout():
    (drive,) = drive_path(
        room(), line((2.0, 2.5), (6.0, 2.5)), noiseless_robot(Shifted(0.0, stands=True)), 1
    ).drives
    assert drive.outcome == "timed out"


def test_robot_drives_around_unexpected_wall():
    """The path was planned on a map without the wall."""
    path = line((2.0, 2.5), (6.5, 2.5))
    grid = room(wall=True, door=(3.2, 4.2))
    robot = ROBOTS["round"].with_settings({"boundary_noise": 0.0})
    arrivals = drive_path(grid, path, robot, 4)
    assert outcomes(arrivals) == ["arrived"] * 4
    crossed = [drive.truth[np.argmin(abs(drive.truth[:, 0] - 4.05))] for drive in arrivals.drives]
    assert all(3.3 < y < 4.1 for _, y, _ in crossed)


@pytest.mark.parametrize("name", ["round", "car"])
def test_replanning_avoids_no_go_zones(name):
    """Zones close the near side of a box in the path, so that robots drive around the far side."""
    path, robot = line((1.5, 2.4), (6.5, 2.4)), ROBOTS[name].with_settings({"boundary_noise": 0.0})
    cells = room().cells.copy()
    cells[21:26, 38:43] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    zones = Zones([Zone("no-go", [[3.6, 2.6], [4.5, 2.6], [4.5, 5.0], [3.6, 5.0]])])
    closed = zones.cells(grid, "no-go")
    heights = []
    for active_zones in (None, zones):
        simulator = Simulator(grid, robot, zones=active_zones)
        arrivals = drive_closed(simulator, {"path": path}, range(2), perfect=True)["path"]
        assert outcomes(arrivals) == ["arrived"] * 2
        truths = [drive.truth for drive in arrivals.drives]
        heights += [truth[np.argmin(abs(truth[:, 0] - 4.05)), 1] for truth in truths]
        if active_zones:
            assert not any(closed[grid.cell(truth[:, :2])].any() for truth in truths)
    assert max(heights[:2]) > 2.6
    assert max(heights[2:]) < 2.1


@pytest.mark.parametrize(("door", "fault"), [((2.2, 2.6), "follower"), ((2.3, 2.5), "world")])
def test_aborted_drive_blames_follower_or_world(door, fault):
    """A path exists through the first door, but not through the narrower second door."""
    grid, path = room(wall=True, door=door), line((2.0, 2.4), (6.5, 2.4))
    robot = Robot(Lidar(range=5.0, beams=60)).with_settings({"boundary_noise": 0.0})
    arrivals = drive_path(grid, path, robot, 3)
    assert set(outcomes(arrivals)) == {"aborted"}
    assert {drive.fault for drive in arrivals.drives} == {fault}
    assert arrivals.compute_rate("follower").value == float(fault == "follower")
    assert arrivals.compute_rate("world").value == float(fault == "world")
    assert all(drive.truth[:, 0].max() < 4.0 for drive in arrivals.drives)


def test_closed_loop_drives_ignore_other_drives():
    """Drives of one number are equal; test_driver compares counts of threads."""
    simulator, path = Simulator(room(), ROBOTS["round"], seed=2), line(*BENT)
    whole, part = (
        drive_closed(simulator, {"a": path, "b": path}, numbers)
        for numbers in (range(6), range(3, 6))
    )
    for one, other in zip(whole["a"].drives[3:], part["b"].drives, strict=True):
        assert one.outcome == other.outcome
        assert np.array_equal(one.truth, other.truth)
    assert not np.array_equal(whole["a"].drives[0].truth[-1], whole["a"].drives[1].truth[-1])


def test_robot_reaches_goal_with_periodic_replanning():
    arrivals = drive_path(room(), line(*BENT), ROBOTS["round"], 4, replan=1.0)
    assert outcomes(arrivals) == ["arrived"] * 4


def test_robot_drives_lap_to_its_end():
    """The start of a lap is also its goal."""
    lap = line((1.5, 1.0), (6.5, 1.0), (6.5, 3.0), (1.5, 3.0), (1.5, 1.0))
    (drive,) = drive_path(room(), lap, ROBOTS["round"], 1, perfect=True).drives
    assert drive.outcome == "arrived"
    assert drive.truth[:, 0].max() > 6.0
    assert drive.truth[-1, 2] > math.pi
    assert drive.end == pytest.approx((*drive.truth[-1, :2], drive.truth[-1, 2] - 2 * math.pi))
    assert drive.seconds > 0.9 * lap.length / ROBOTS["round"].kinematics.speed


def test_replanning_rate_is_limited_by_commands():
    """Commands are 0.1 s apart."""
    replanned_too_often, replanned = (
        drive_path(room(), line(*BENT), ROBOTS["round"], 1, replan=seconds).drives[0]
        for seconds in (0.04, 0.1)
    )
    assert np.array_equal(replanned_too_often.truth, replanned.truth)


def test_replanning_keeps_exact_goal():
    grid, goal = room(resolution=0.25), (6.49, 1.74)  # 0.16 m from the centre of its cell
    path = line((1.5, 1.6), goal)
    (drive,) = drive_path(grid, path, ROBOTS["round"], 1, replan=0.5, perfect=True).drives
    assert drive.outcome == "arrived"
    assert math.dist(drive.end[:2], goal) <= ROBOTS["round"].goal_tolerance


def test_car_keeps_turning_radius_and_gears():
    """It changes gear only where its path does."""
    robot = dataclasses.replace(ROBOTS["car"], disturbances=QUIET).with_settings(STILL)
    (drive,) = drive_path(room(), there_and_back(), robot, 1).drives
    assert drive.outcome == "arrived"
    turn, step = np.diff(drive.truth[:, 2]), np.diff(drive.truth[:, :2], axis=0)
    assert (abs(turn) * 0.8 <= np.hypot(*step.T) * (1 + 1e-6) + 1e-9).all()
    middle = drive.truth[:-1, 2] + turn / 2
    ahead = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    assert (np.diff(np.sign(ahead[ahead != 0])) != 0).sum() == 1


def test_car_aborts_in_narrow_door():
    """A disc within the outline would fit through the door."""
    robot = ROBOTS["car"].with_settings({"boundary_noise": 0.0})
    grid = room(wall=True, door=(2.3, 2.6))  # a disc within its outline fits, 0.3 m wide as it is
    (drive,) = drive_path(grid, line((2.0, 2.45), (6.5, 2.45)), robot, 1).drives
    assert (drive.outcome, drive.fault) == ("aborted", "world")


def test_car_drives_around_unexpected_wall():
    robot = dataclasses.replace(ROBOTS["car"], disturbances=QUIET).with_settings(STILL)
    grid = room(wall=True, door=(2.4, 4.5))
    path = line((1.5, 2.1), (6.5, 2.1))
    (drive,) = drive_path(grid, path, robot, 1, perfect=True).drives
    assert drive.outcome == "arrived"
    turn, step = np.diff(drive.truth[:, 2]), np.diff(drive.truth[:, :2], axis=0)
    assert (abs(turn) * 0.8 <= np.hypot(*step.T) * (1 + 1e-6) + 1e-9).all()


def test_simulate_reports_reached_goals(tmp_path):
    grid, robot = room(wall=True, door=(2.3, 2.5)), Robot(Lidar(range=5.0, beams=60))
    paths = {"through": line((2.0, 2.4), (6.5, 2.4)), "away": line((2.0, 2.4), (2.0, 4.0))}
    result = simulate(grid, paths, robot, drives=2, closed=ClosedLoopSettings(drives=3), seed=4)
    assert simulate(grid, paths, robot, drives=2, seed=4).arrivals is None
    summary = result.summary()["arrivals"]
    assert summary["through"]["aborted"][0] == summary["through"]["no_way"][0] == 1.0
    assert summary["away"]["drives"] == 3
    assert summary["away"]["arrived"][0] == 1.0
    (through, away) = result.table().records()
    assert (through["arrived"], away["arrived"]) == (0.0, 1.0)
    legend = [each.get_text() for each in result.figure().legends[0].get_texts()]
    assert "0 of 3 [0, 56 %] arrive (3 have no way)" in " ".join(legend[0].split())
    assert "3 of 3 [44, 100 %] arrive" in " ".join(legend[1].split())
    assert {MARK_LABELS[STOPS], MARK_LABELS[ENDS]} <= set(legend)
    result.save(tmp_path / "out")
    with (tmp_path / "out" / "arrivals.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["outcome"] for row in rows] == ["aborted"] * 3 + ["arrived"] * 3
    assert float(rows[0]["x"]) < 4.0 < 6.5
    assert [int(row["standstills"]) for row in rows] == [14] * 3 + [0] * 3
    assert (through["standstills"], away["standstills"]) == (14.0, 0.0)
    with pytest.raises(LocplanError, match="drives"):
        ClosedLoopSettings(drives=1)
    with pytest.raises(ConfigError, match="replan must be"):
        ClosedLoopSettings(replan=0.0)


def test_arrivals_list_places_of_failures():
    grid = room(wall=True, door=(2.2, 2.6))
    robot = Robot(Lidar(range=5.0, beams=60)).with_settings({"boundary_noise": 0.0})
    (stuck,) = drive_path(grid, line((2.0, 2.4), (6.5, 2.4)), robot, 1).drives
    places = Arrivals((stuck,)).places().records()
    assert {each["what"] for each in places} == {"stops", "ends"}
    (end,) = (each for each in places if each["what"] == "ends")
    assert (end["x"], end["y"], end["drive"]) == (*stuck.truth[-1, :2], 0)
    stops = np.array([(each["x"], each["y"]) for each in places if each["what"] == "stops"])
    still = (stuck.truth[20:] == stuck.truth[:-20]).all(axis=1)
    at = stuck.truth[:-20][still, :2]
    assert np.hypot(*(at[:, None] - stops).T).min(axis=0).max() <= 0.5
    assert np.hypot(*(at[:, None] - stops).T).min(axis=1).max() == 0.0

    truth = np.zeros((40, 3))
    truth[:, 0] = np.arange(40) * 0.1
    truth[10:20, 1] = truth[30:35, 1] = 0.7
    path = line((0.0, 0.0), (4.0, 0.0))
    arrivals = Arrivals((ClosedLoopDrive.from_drive("arrived", truth, truth, path),))
    assert [(each["what"], each["x"]) for each in arrivals.places().records()] == [
        ("leaves the path by 0.5 m", pytest.approx(1.0)),
        ("leaves the path by 0.5 m", pytest.approx(3.0)),
    ]

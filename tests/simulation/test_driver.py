"""Drives of paths: their random numbers, and equal drives in all commands."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.cases import sample_cases

from locplan import Costmap, Lidar, OccupancyGrid, Path, Robot, check, plan, recommend_path
from locplan.advice import Pole
from locplan.advice.check_drives import EFFORTS
from locplan.advice.landmark_objects import mark_objects
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, environments
from locplan.robots import Amcl, Disturbances, Odometry
from locplan.simulation import (
    Arrivals,
    ClosedLoopSettings,
    Drives,
    RecommendationSettings,
    Simulator,
    drive_closed,
    drive_open,
    simulate,
)
from locplan.simulation.arrivals import ClosedLoopDrive
from locplan.simulation.driver import FIRST_CHOOSING_DRIVE, FIRST_FRESH_DRIVE, compute_route_key
from locplan.simulation.verdict import DriveSet, compare_drives

LIDAR = Lidar(range=5.0, beams=60)
ROBOT = Robot(LIDAR, filter=Amcl(min_particles=60, max_particles=60), footprint=0.2)
MASK = 2**64 - 1


def room(rows: int = 60, cols: int = 90) -> OccupancyGrid:
    """Return a room with two pillars, of 0.1 m cells."""
    walls = np.full((rows, cols), FREE, np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = OCCUPIED
    walls[20:26, 30:34] = walls[38:42, 60:70] = OCCUPIED
    return OccupancyGrid(walls, 0.1, name="room")


def path(*xy: tuple[float, float]) -> Path:
    return Path(np.array(xy, float))


LONG = path((1.0, 1.0), (8.0, 1.0))
BENT = path((1.0, 1.0), (4.5, 1.5), (8.0, 1.0))
OTHER = path((1.0, 5.0), (8.0, 5.0))


def splitmix64(counter: int) -> int:
    """Return splitmix64's hash of a number, in exact integers."""
    bits = counter & MASK
    bits = (bits ^ bits >> 30) * 0xBF58476D1CE4E5B9 & MASK
    bits = (bits ^ bits >> 27) * 0x94D049BB133111EB & MASK
    return bits ^ bits >> 31


# Worlds


def test_flipped_cells_equal_plain_loop():
    from locplan.simulation.kernels.worlds import flip_cells

    random = np.random.default_rng(1)
    stops, seed, row, col = random.random((20, 30)) < 0.5, int(MASK - 5), 1000, 70_000
    cells = np.argwhere(random.random(stops.shape) < 0.7)
    expected = stops.copy()
    for i, j in cells.tolist():
        number = ((row + i) << 32 | col + j) + 1
        share = (splitmix64(seed + number * 0x9E3779B97F4A7C15) >> 11) / 2**53
        expected[i, j] ^= share < 0.3
    flip_cells(stops, cells, row, col, 0.3, np.uint64(seed))
    assert (stops == expected).all()


def test_flips_follow_published_splitmix64_numbers():
    """The numbers are the first three of splitmix64 with seed 1234567."""
    from locplan.simulation.kernels.worlds import flip_cells

    cells = np.array([[0, 0], [0, 1], [0, 2]])
    numbers = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    shares = np.array([(number >> 11) / 2**53 for number in numbers])
    for share in shares:
        for limit in (share, np.nextafter(share, 1.0)):
            flips = np.zeros((1, 3), bool)
            flip_cells(flips, cells, 0, 0, limit, np.uint64(1234567))
            assert (flips[0] == (shares < limit)).all()


@pytest.mark.parametrize("noise", sample_cases([0.1, 0.0, 0.5, 1.0], 2))
def test_world_flips_share_of_boundary_cells(noise):
    robot = dataclasses.replace(ROBOT, disturbances=Disturbances(boundary_noise=noise))
    simulator = Simulator(room(200, 300), robot)
    boundary, stops = simulator.boundary, simulator.is_occupied
    flips = np.array(
        [simulator.make_world_region().find_occupied_cells(7, n) != stops for n in range(40)]
    )
    assert not flips[:, ~boundary].any()
    count = 40 * boundary.sum()
    share = flips[:, boundary].mean()
    assert abs(share - noise) <= 4 * np.sqrt(noise * (1 - noise) / count)
    if noise == 0.1:  # cells, numbers, routes and seeds are independent
        cells = flips[:, boundary].astype(float)
        assert abs(np.corrcoef(cells[0], cells[1])[0, 1]) < 4 / np.sqrt(cells.shape[1])
        assert abs((cells[:, 1:] * cells[:, :-1]).mean() - noise**2) < 0.005
        assert (simulator.make_world_region().find_occupied_cells(8, 0) != (flips[0] ^ stops)).any()
        other = Simulator(room(200, 300), robot, seed=2).make_world_region()
        assert (other.find_occupied_cells(7, 0) != (flips[0] ^ stops)).any()


def test_world_region_equals_whole_world():
    simulator = Simulator(room(200, 300), ROBOT)
    far = simulator.make_drive_poses(np.array([[22.0, 14.0, 0.0], [24.0, 14.0, 0.0]]))
    whole, part = simulator.make_world_region(), simulator.make_world_region([far])
    assert min(each.start for each in part.window) > 0
    assert part.stops.shape != whole.stops.shape
    for number in (0, FIRST_CHOOSING_DRIVE):
        world = whole.find_occupied_cells(3, number)
        assert (part.find_occupied_cells(3, number) == world[part.window]).all()


def test_object_leaves_other_noise_unchanged():
    grid = room(200, 300)
    with_pole = mark_objects(grid, Pole(0.2), np.array([[4.0, 3.0, 0.0]]))
    one, other = (
        Simulator(world, ROBOT).make_world_region().find_occupied_cells(3, 0)
        for world in (grid, with_pole)
    )
    rows, cols = np.nonzero(one != other)
    assert rows.size
    assert (np.hypot(rows * 0.1 - 3.0, cols * 0.1 - 4.0) < 0.5).all()


# Random numbers


def test_drives_ignore_other_paths():
    simulator = Simulator(room(), ROBOT)
    alone = drive_open(simulator, {"a": LONG}, range(4))["a"]
    together = drive_open(simulator, {"b": BENT, "c": OTHER, "a": LONG}, range(2, 4))
    assert [*together] == ["b", "c", "a"]
    np.testing.assert_allclose(together["a"].errors, alone.errors[2:], atol=1e-9)


@pytest.mark.parametrize("numbers", [range(3), range(1)])
def test_drives_ignore_thread_count(numbers):
    paths = {"a": LONG, "b": BENT, "c": OTHER}
    one, three = (Simulator(room(), ROBOT, threads=threads) for threads in (1, 3))
    calls = []
    before = drive_open(one, paths, numbers, progress=lambda *step: calls.append(step))
    after = drive_open(three, paths, numbers)
    assert all((before[name].errors == after[name].errors).all() for name in paths)
    assert calls == [(n + 1, 3 * len(numbers)) for n in range(3 * len(numbers))]
    first, second = (drive_closed(simulator, paths, numbers) for simulator in (one, three))
    for name in paths:
        for drive, again in zip(first[name].drives, second[name].drives, strict=True):
            assert (drive.truth == again.truth).all()


class Odometer:
    """A filter that believes odometry, so that its errors are those of odometry alone."""

    title, settings = "odometer", "Odometer()"

    def start(self, grid, lidar, pose, deviation, random):
        return Odometer()

    def motion(self, odometry):
        self.pose = odometry

    def scan(self, ranges):
        pass

    def estimate(self):
        return self.pose


def correlate_ends(one: Drives, other: Drives) -> float:
    """Return the correlation of the final errors in x, which biased wheels cause."""
    return float(np.corrcoef(one.errors[:, -1, 0], other.errors[:, -1, 0])[0, 1])


def test_open_loop_drives_pair_within_route():
    near = path((1.0, 1.0), (8.0, 1.002))
    paths = {"long": LONG, "bent": BENT, "near": near, "other": OTHER}
    wheels = Odometry(distance_bias=0.1)
    lidar = Lidar(range=5.0, beams=4)
    simulator = Simulator(room(), Robot(lidar, filter=Odometer(), odometry=wheels))
    drives = drive_open(simulator, paths, range(24))
    assert correlate_ends(drives["long"], drives["bent"]) > 0.9
    for name in ("near", "other"):
        assert abs(correlate_ends(drives["long"], drives[name])) < 0.5
    paired = drive_open(
        simulator, {"long": LONG, "near": near}, range(24), route=compute_route_key(LONG)
    )
    assert correlate_ends(paired["long"], paired["near"]) > 0.99
    assert (paired["long"].errors == drives["long"].errors).all()


def test_closed_loop_drives_pair_within_route():
    """Drives of one number and one route start with the same error of the filter."""
    paths = {"long": LONG, "bent": BENT, "near": path((1.0, 1.0), (8.0, 1.002))}
    arrivals = drive_closed(Simulator(room(), ROBOT), paths, range(3))
    starts = {
        name: np.array([drive.believed[0, :2] - drive.truth[0, :2] for drive in each.drives])
        for name, each in arrivals.items()
    }
    assert abs(starts["long"] - starts["bent"]).max() < 0.02
    assert abs(starts["long"] - starts["near"]).min(axis=1).max() > 0.02


def test_route_key_counts_in_millimetres():
    assert (
        compute_route_key(LONG)
        == compute_route_key(BENT)
        == compute_route_key([(1.0002, 1.0), (8, 0.9996)])
    )
    others = [OTHER, path((8.0, 1.0), (1.0, 1.0)), path((1.0, 1.0), (8.0, 1.001))]
    assert len({compute_route_key(LONG), *map(compute_route_key, others)}) == 4


def test_drive_number_ranges_are_disjoint():
    """Drives that choose a path or a fix never confirm it."""
    with pytest.raises(ConfigError, match=r"whole number in 2\.\.1024"):
        RecommendationSettings(drives=FIRST_CHOOSING_DRIVE + 1)
    for effort in EFFORTS.values():
        assert effort.n_drives <= FIRST_CHOOSING_DRIVE
        assert FIRST_CHOOSING_DRIVE + effort.n_trial_drives <= FIRST_FRESH_DRIVE


def test_stretched_world_increases_error():
    grid = room()
    calm = Robot(LIDAR, disturbances=Disturbances(boundary_noise=0.0, start_sigma=0.0))
    right, wrong = (
        drive_open(Simulator(grid, calm, stretch=stretch), {"a": LONG}, range(4))["a"]
        for stretch in (1.0, 1.3)
    )
    assert wrong.rmse.value > 2 * right.rmse.value
    with pytest.raises(ConfigError, match="closed-loop drives need stretch=1"):
        drive_closed(Simulator(grid, calm, stretch=1.3), {"a": LONG}, range(1))
    with pytest.raises(ConfigError, match="stretch must be positive"):
        Simulator(grid, stretch=0.0)


# Reported rates


def test_verdict_compares_rates_of_reached_goals():
    drives = Drives(LONG.poses, np.zeros((4, len(LONG.poses), 3)))
    place = (0.0, 0.0, 0.0)

    def arrivals(*outcomes: str) -> Arrivals:
        return Arrivals(tuple(ClosedLoopDrive(outcome, 1.0, place, place) for outcome in outcomes))

    one = DriveSet.from_drives([drives], [arrivals("arrived", "aborted")])
    two = DriveSet.from_drives([drives], [arrivals("arrived"), arrivals("arrived")])
    reached = compare_drives(one, two).reached
    assert (reached.baseline.value, reached.alternative.value) == (0.5, 1.0)
    assert compare_drives(one, DriveSet.from_drives([drives])).reached is None


@pytest.mark.long
def test_commands_report_equal_rates():
    """`simulate`, `check` and `recommend_path` drive one route on which robots get lost."""
    grid = environments.make("two_corridors", resolution=0.1)
    robot = Robot(
        Lidar(range=4.0, beams=60), filter=Amcl(min_particles=100, max_particles=100), footprint=0.2
    )
    start, goal = (4.0, 3.0), (34.0, 3.0)
    costs = Costmap.blank(grid, robot=robot)
    shortest = plan(costs, start, goal).path
    report = check(grid, robot, {"a": start, "b": goal}, effort="quick", seed=3)
    (route,) = report.routes
    assert route.path.xy.tolist() == shortest.xy.tolist()
    recommendation = recommend_path(
        grid,
        start,
        goal,
        robot,
        costs=costs,
        settings=RecommendationSettings(drives=32, rival=None),
        seed=3,
    )
    candidate = recommendation.shortest
    count = len(candidate.driven.numbers)
    assert candidate.driven.numbers == range(count)
    for drives in {count, route.rates.n_drives}:
        closed = ClosedLoopSettings(drives=16)
        result = simulate(grid, {"a": shortest}, robot, drives=drives, closed=closed, seed=3)
        if drives == count:
            assert result.drives["a"].lost_rate == candidate.driven.lost_rate
            assert result.drives["a"].off_at_end_rate == candidate.driven.off_at_end_rate
        if drives == route.rates.n_drives:
            assert result.drives["a"].lost_rate == route.rates.lost
            assert 0 < route.rates.lost.value < 1
        assert result.arrivals["a"].arrival_rate == candidate.arrivals.arrival_rate
    assert (route.rates.n_closed, route.rates.reached.value) == (
        16,
        candidate.arrivals.arrival_rate.value,
    )

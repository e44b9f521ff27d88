"""Kernels of the particle filter, compared with plain loops of the same random numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import oracles
from support.maps import random_rooms

from locplan._support.kernels import drives, lidar as lidars, particles
from locplan._support.kernels.rays import compute_empty_squares
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Amcl, Disturbances, Lidar, Robot
from locplan.robots.amcl import DIFFERENTIAL, OMNIDIRECTIONAL
from locplan.simulation import Simulator

RESOLUTION = 0.1
SMALL = Lidar(range=2.0, beams=9, range_sigma=0.02, mount_x=0.15, mount_y=-0.05, mount_yaw_deg=20)


def room(seed=3):
    """2.4 m x 2.8 m with boxes, walls around, and free in the middle."""
    cells = random_rooms((24, 28), seed, blocks=9)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[8:16, 8:20] = FREE
    return OccupancyGrid(cells, RESOLUTION, name="room")


def simulator(grid, amcl=None, lidar=SMALL, **changes):
    return Simulator(grid, Robot(lidar, filter=amcl or Amcl()).with_settings(changes))


def cloud(random, count):
    spread = np.array([[0.4], [0.3], [0.3]])
    return np.array([[1.3], [1.2], [0.4]]) + spread * random.standard_normal((3, count))


@pytest.mark.parametrize("half_cell", [True, False])
@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob"])
def test_particle_weights_equal_plain_formula(model, half_cell):
    grid, random = room(), np.random.default_rng(1)
    amcl = Amcl(laser_model_type=model, laser_likelihood_max_dist=0.6, half_cell=half_cell)
    poses = cloud(random, 40)
    poses[:, 0] = -3.0, 5.0, 0.0  # far off the map
    ends = random.uniform(-12, 12, (9, 2))
    ends[4] = np.nan
    weights = random.uniform(0.1, 1.0, 40)
    expected = oracles.particles.weigh(
        grid.cells, RESOLUTION, ends, poses, weights, amcl, SMALL.range
    )
    particles.weigh_particles(simulator(grid, amcl).arguments.scores, ends, poses, 40, weights)
    assert weights == pytest.approx(expected, rel=2e-6)


def test_weighing_without_returns_only_normalizes():
    weights = np.array([0.2, 0.4, 0.0])
    scores = simulator(room()).arguments.scores
    particles.weigh_particles(scores, np.full((3, 2), np.nan), np.ones((3, 3)), 3, weights)
    assert weights == pytest.approx([1 / 3, 2 / 3, 0])


def test_weighing_equalizes_zero_weights():
    weights, scores = np.zeros(3), simulator(room()).arguments.scores
    particles.weigh_particles(scores, np.full((3, 2), np.nan), np.ones((3, 3)), 3, weights)
    assert weights == pytest.approx([1 / 3] * 3)


@pytest.mark.parametrize("model", [DIFFERENTIAL, OMNIDIRECTIONAL])
@pytest.mark.parametrize(
    ("dx", "dy", "turn"),
    [(0.25, 0.1, 0.1), (-0.3, -0.02, -0.05), (0.0, 0.0, 0.4), (0.004, 0.0, -2.0)],
)
def test_particle_motion_equals_plain_formula(dx, dy, turn, model):
    poses = cloud(np.random.default_rng(2), 30)
    alphas = {f"alpha{n}": n / 10 for n in range(1, 6)}
    amcl = Amcl(**alphas, robot_model_type=model)
    expected = oracles.particles.move(np.random.default_rng(5), poses, dx, dy, turn, 0.3, amcl)
    settings = simulator(room(), amcl).arguments.filter
    particles.move_particles(np.random.default_rng(5), poses, 30, dx, dy, turn, 0.3, settings)
    assert poses == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("model", [DIFFERENTIAL, OMNIDIRECTIONAL])
def test_without_noise_particles_follow_odometry(model):
    poses = np.array([[1.0, 2.0], [1.0, 1.0], [0.0, math.pi / 2]])
    still = Amcl(**{f"alpha{n}": 0.0 for n in range(1, 6)}, robot_model_type=model)
    settings = simulator(room(), still).arguments.filter
    particles.move_particles(np.random.default_rng(0), poses, 2, 0.5, 0.0, 0.1, 0.0, settings)
    assert poses == pytest.approx(np.array([[1.5, 2.0], [1.0, 1.5], [0.1, math.pi / 2 + 0.1]]))


@pytest.mark.parametrize("count", [1, 50, 300])
def test_clusters_are_those_of_touching_bins(count):
    random = np.random.default_rng(count)
    poses = cloud(random, count)
    poses[:2] += 4 * random.integers(0, 3, (2, count)) * [[1.0], [-1.0]]
    histogram, bins = particles.make_histogram(count), 0
    for n in range(count):
        bins = particles.insert_particle(histogram, bins, n, *poses[:, n])
    assert bins == len(set(oracles.particles.bins_of(poses)))
    mean = particles.compute_heaviest_mean(histogram, bins, poses, count)
    assert mean == pytest.approx(oracles.particles.heaviest_cluster_mean(poses), abs=1e-12)
    particles.clear_histogram(histogram, bins)
    assert (histogram.bin_of == particles.FREE).all()


def test_kld_sample_size_equals_amcl():
    amcl = Amcl(min_particles=20, max_particles=500)
    settings = simulator(room(), amcl).arguments.filter
    for bins in range(200):
        assert particles.compute_kld_sample_size(
            bins, settings
        ) == oracles.particles.kld_sample_size(bins, amcl)
    # AMCL's own quirk: a single bin asks for all.
    assert particles.compute_kld_sample_size(1, settings) == 500


@pytest.mark.parametrize(("limits", "lost"), [((5, 400), 0.0), ((60, 60), 0.0), ((60, 400), 0.3)])
def test_resampling_equals_plain_loop(limits, lost):
    random = np.random.default_rng(4)
    recovery = {"recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.1} if lost else {}
    amcl = Amcl(min_particles=limits[0], max_particles=limits[1], pf_err=0.2, **recovery)
    grid, arguments = room(), simulator(room(), amcl).arguments
    count = 60
    poses, weights = cloud(random, limits[1]), np.zeros(limits[1])
    weights[:count] = random.exponential(size=count)
    weights[:count] /= weights[:count].sum()
    free = np.argwhere(grid.free).tolist(), grid.resolution
    expected = oracles.particles.resample(
        np.random.default_rng(8), poses[:, :count], weights[:count], amcl, lost, *free
    )
    drawn = np.empty_like(poses)
    histogram, bins = particles.make_histogram(limits[1]), 0
    for n in range(count):
        bins = particles.insert_particle(histogram, bins, n, *poses[:, n])
    n_drawn, _ = particles.resample_particles(
        np.random.default_rng(8),
        poses,
        weights,
        count,
        arguments.filter,
        histogram,
        bins,
        drawn,
        arguments.scores,
        lost,
    )
    assert n_drawn == expected.shape[1] <= limits[1]
    assert drawn[:, :n_drawn] == pytest.approx(expected)


def test_lost_share_rises_with_falling_weights():
    """This share of the particles is drawn at random places."""
    amcl = Amcl(recovery_alpha_slow=0.01, recovery_alpha_fast=0.3)
    settings = simulator(room(), amcl).arguments.filter
    averages, expected = np.zeros(2), np.zeros(2)
    shares = []
    for weight in (0.8, 0.9, 0.0, 0.2, 0.1, 0.1, 2.0):
        shares.append(drives.update_lost_share(averages, weight, settings))
        share = oracles.particles.update_lost_share(expected, weight, amcl)
        assert shares[-1] == pytest.approx(share)
        assert averages == pytest.approx(expected)
    assert shares[0] == shares[1] == shares[-1] == 0
    assert 0 < shares[3] < shares[4] < shares[5] < 1
    none = simulator(room(), Amcl()).arguments.filter
    assert [drives.update_lost_share(np.array([0.5, 0.5]), w, none) for w in (0.1, 2.0)] == [0, 0]


def test_find_first_above_ignores_start_index():
    random = np.random.default_rng(5)
    weights = random.exponential(size=40) ** 3
    weights[random.choice(40, 15, replace=False)] = 0.0
    shares = np.cumsum(weights)
    values = [0.0, *shares, *random.uniform(0, shares[-1], 50)]
    for value in values:
        expected = min(np.searchsorted(shares, value, side="right"), 39)
        for near in range(40):
            assert particles.find_first_above(value, shares, near) == expected
    expected = np.searchsorted(shares * 40, np.arange(41) * shares[-1], side="right")
    np.testing.assert_array_equal(
        particles.index_cumulative_shares(shares), np.minimum(expected, 39)
    )


def test_resampling_follows_particle_weights():
    amcl = Amcl(min_particles=20_000, max_particles=20_000)
    poses, weights = np.zeros((3, 20_000)), np.zeros(20_000)
    poses[0, :4], weights[:4] = (0, 1, 2, 3), (0.1, 0.2, 0.3, 0.4)
    drawn, histogram = np.empty_like(poses), particles.make_histogram(20_000)
    arguments = simulator(room(), amcl).arguments
    count, _ = particles.resample_particles(
        np.random.default_rng(1),
        poses,
        weights,
        4,
        arguments.filter,
        histogram,
        0,
        drawn,
        arguments.scores,
        0.0,
    )
    shares = np.bincount(drawn[0, :count].astype(int)) / count
    assert shares == pytest.approx(weights[:4], abs=0.015)


@pytest.mark.parametrize("occlusion", [0.0, 1.0])
def test_measured_beams_equal_plain_loop(occlusion):
    grid = room()
    here = simulator(grid, outliers=0.2, occlusion=occlusion, occlusion_deg=90)
    squares, ends = compute_empty_squares(grid.cells == OCCUPIED), np.empty((9, 2))
    for seed in range(12):
        pose = np.array([12.3, 13.7, 0.7 * seed])
        random = np.random.default_rng(seed)
        lidar, of_beams = here.arguments.lidar, here.arguments.disturbances
        lidars.simulate_measured_ends(random, squares, RESOLUTION, pose, lidar, of_beams, ends)
        expected = oracles.particles.measured_ends(
            np.random.default_rng(seed),
            grid.cells,
            RESOLUTION,
            pose,
            SMALL,
            lidar.angles,
            here.robot.disturbances,
        )
        assert ends == pytest.approx(expected, abs=2e-6, nan_ok=True)  # levers are rounded


def test_outlier_and_occlusion_rates_match_settings():
    free = OccupancyGrid(np.full((90, 90), FREE), RESOLUTION)
    sensor = Lidar(range=4.0, beams=72)
    here = simulator(free, lidar=sensor, outliers=0.1, occlusion=0.3, occlusion_deg=40.0)
    squares, ends = here.worlds[0], np.empty((72, 2))
    lidar = here.arguments.lidar._replace(angles=sensor.angles)
    random, returned, blocked = np.random.default_rng(0), 0.0, 0
    for _ in range(2000):
        pose = np.array([45.0, 45.0, 0.0])
        disturbances = here.arguments.disturbances
        lidars.simulate_measured_ends(random, squares, RESOLUTION, pose, lidar, disturbances, ends)
        at = np.hypot(*ends.T) * RESOLUTION
        returned += np.isfinite(at).mean() / 2000
        values, counts = np.unique(at[np.isfinite(at)].round(9), return_counts=True)
        blocked += counts.max(initial=0) >= 6 and 0.5 <= values[np.argmax(counts)] <= 2.0
    assert blocked / 2000 == pytest.approx(0.3, abs=0.03)
    assert returned == pytest.approx(0.1 + 0.9 * 0.3 * 40 / 360, abs=0.01)


def test_odometry_drift_equals_plain_formula():
    truth = np.column_stack(
        [np.linspace(0, 3, 40), np.sin(np.linspace(0, 2, 40)), np.linspace(0, 4, 40)]
    )
    truth[10:13] = truth[10]
    truth[10:13, 2] += [0, 0.3, 0.5]
    here = simulator(
        room(), distance_drift=0.1, heading_drift_deg=5, turn_drift_deg=7, turn_bias=0.1
    )
    odometry = drives.simulate_odometry(np.random.default_rng(3), truth, here.arguments.odometry)
    assert odometry == pytest.approx(
        oracles.particles.odometry_along(np.random.default_rng(3), truth, here.robot.odometry)
    )


def test_drift_grows_with_root_of_distance():
    quiet = dict.fromkeys(
        ("distance_bias", "heading_bias_deg", "turn_bias", "heading_drift_deg"), 0.0
    )
    here = simulator(room(), distance_drift=0.1, **quiet)
    ends = []
    for spacing in (0.05, 0.5):
        x = np.arange(0, 4 + spacing / 2, spacing)
        truth = np.column_stack([x, 0 * x, 0 * x])
        random = np.random.default_rng(1)
        ends.append(
            [
                drives.simulate_odometry(random, truth, here.arguments.odometry)[-1, 0]
                for _ in range(800)
            ]
        )
    assert np.std(ends, axis=1) == pytest.approx([0.2, 0.2], rel=0.1)


@pytest.mark.parametrize(
    "amcl",
    [
        Amcl(min_particles=15, max_particles=60, pf_err=0.2),
        Amcl(
            min_particles=40,
            max_particles=40,
            laser_model_type="likelihood_field_prob",
            resample_interval=2,
            update_min_d=0.1,
            half_cell=False,
            robot_model_type=OMNIDIRECTIONAL,
        ),
        Amcl(
            min_particles=30,
            max_particles=80,
            update_min_d=0.1,
            recovery_alpha_slow=0.01,
            recovery_alpha_fast=0.5,
        ),
    ],
)
def test_simulated_drive_equals_plain_loop(amcl):
    grid, world = room(), room(4)
    x = np.linspace(0.9, 1.7, 17)
    truth = np.column_stack([x, 1.2 + 0.1 * np.sin(4 * x), 0.8 * (x - 0.9)])
    robot = Robot(SMALL, filter=amcl, disturbances=Disturbances(occlusion=0.5))
    here = Simulator(grid, robot)
    expected = oracles.particles.drive(
        np.random.default_rng(6),
        truth,
        grid.cells,
        world.cells,
        RESOLUTION,
        robot,
        here.arguments.lidar.angles,
    )
    errors, random = np.empty_like(truth), np.random.default_rng(6)
    reported = drives.simulate_odometry(random, truth, here.arguments.odometry)
    drives.simulate_drive(
        random,
        truth,
        reported,
        drives.DrivenWorld(
            compute_empty_squares(world.cells == OCCUPIED),
            RESOLUTION,
            truth[:, [1, 0, 2]] / (RESOLUTION, RESOLUTION, 1),
        ),
        here.arguments.scores,
        here.arguments.lidar,
        here.arguments.disturbances,
        here.arguments.start,
        here.arguments.filter,
        errors,
    )
    assert errors == pytest.approx(expected, abs=1e-9)

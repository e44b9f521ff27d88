"""Calibrations by recorded drives: the noise that a drive was made with is found."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from support.recordings import LIDAR, simulate_recording
from support.small_drive import FILE, MAP

from locplan import Costmap, load_map, plan
from locplan._support import intervals as of_intervals, poses as of_poses
from locplan._support.kernels.drives import simulate_odometry
from locplan._support.kernels.particles import move_particles
from locplan.errors import ConfigError, RecordingError
from locplan.maps import environments
from locplan.recordings import Recording
from locplan.recordings.calibration import calibrate_drive, fit_odometry_noise, fit_scan_noise
from locplan.robots import Amcl, Disturbances, Odometry, Robot
from locplan.simulation import Simulator
from locplan.simulation.worlds import make_path_poses

EXACT = {"boundary_noise": 0.0, "outliers": 0.0, "occlusion": 0.0}
DRIFTS = {"distance_drift": 0.03, "heading_drift_deg": 2.0, "turn_drift_deg": 3.0}
BIASES = {"distance_bias": 0.0, "heading_bias_deg": 0.0, "turn_bias": 0.0}


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def line(grid):
    costs = Costmap.blank(grid, robot=0.3)
    path = plan(costs, (2.0, 3.0), (36.0, 3.0)).path
    return make_path_poses(path, grid)[::2]


@pytest.fixture(scope="module")
def winding():
    """Poses of a drive of 300 m that turns all the time, 0.2 m apart, (n, 3)."""
    turns = 0.3 * np.sin(np.arange(1500) / 4)
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    middle = heading[:-1] + turns / 2
    x, y = (np.concatenate([[0.0], np.cumsum(0.2 * part(middle))]) for part in (np.cos, np.sin))
    return np.column_stack([x, y, heading])


@pytest.fixture
def few_resamples(monkeypatch):
    """Intervals are those of few resamples: for tests of the values alone."""
    monkeypatch.setattr("locplan.recordings.calibration.RESAMPLES", 12)


def make_recording(poses, odometry, noise=(0.0, 0.0), seed=0):
    """A recording without scans to speak of, whose poses have noise of their own [m, rad]."""
    random = np.random.default_rng(seed)
    spread = np.array([noise[0], noise[0], noise[1]])
    recorded_poses = poses + spread * random.standard_normal(poses.shape)
    return Recording(np.ones((len(poses), LIDAR.beams)), LIDAR, recorded_poses, odometry=odometry)


def make_odometry(grid, poses, seed=1, **odometry):
    settings = Simulator(grid, Robot(odometry=Odometry(**odometry))).arguments.odometry
    return simulate_odometry(np.random.default_rng(seed), poses, settings)


def test_calibration_finds_odometry_drifts(grid, winding):
    odometry = make_odometry(grid, winding, **DRIFTS, **BIASES)
    noise = fit_odometry_noise(make_recording(winding, odometry), Amcl())
    for name, value in DRIFTS.items():
        estimate, low, high = getattr(noise, name)
        assert estimate == pytest.approx(value, rel=0.25), name
        assert 0.85 * low < value < 1.15 * high, name
    for name in BIASES:
        assert abs(getattr(noise, name).value) < (0.3 if "deg" in name else 0.01), name
    assert noise.position_noise.value < 0.01
    assert noise.notes == ()


def test_calibration_finds_odometry_biases(grid, winding, few_resamples):
    odometry = winding.copy()
    steps = of_poses.compute_motions(winding[:-1], winding[1:])
    for n, (ahead, aside, turn) in enumerate(steps):
        x, y, heading = odometry[n]
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, aside = 1.03 * ahead, 1.03 * aside
        turn = 0.96 * turn + math.radians(0.5) * math.hypot(ahead, aside)
        odometry[n + 1] = (
            x + cos * ahead - sin * aside,
            y + sin * ahead + cos * aside,
            heading + turn,
        )
    noise = fit_odometry_noise(make_recording(winding, odometry), Amcl())
    assert noise.distance_bias.value == pytest.approx(0.03, abs=0.005)
    assert noise.turn_bias.value == pytest.approx(-0.04, abs=0.005)
    assert noise.heading_bias_deg.value == pytest.approx(0.5, abs=0.05)


def test_calibration_separates_pose_and_odometry_noise(grid, winding, few_resamples):
    odometry = make_odometry(grid, winding, **DRIFTS, **BIASES)
    noise = fit_odometry_noise(make_recording(winding, odometry, (0.05, 0.02)), Amcl())
    assert 0.035 < noise.position_noise.value < 0.055
    assert noise.heading_noise_deg.value == pytest.approx(math.degrees(0.02), rel=0.25)
    assert noise.heading_drift_deg.value == pytest.approx(DRIFTS["heading_drift_deg"], rel=0.3)
    assert "recorded poses are noisier than the odometry" in noise.notes[0]


def test_calibration_finds_amcl_alphas(grid, winding, few_resamples):
    amcl = Amcl(alpha1=0.05, alpha2=0.02, alpha3=0.04, alpha4=0.03, update_min_d=0.01)
    settings = Simulator(grid, robot=Robot(filter=amcl)).arguments.filter
    random, poses = np.random.default_rng(2), [np.zeros(3)]
    steps = of_poses.compute_motions(winding[:-1], winding[1:])
    for ahead, aside, turn in steps:
        particle = poses[-1][:, None].copy()
        # Odometry in the particle's own axes, as AMCL applies it.
        cos, sin = math.cos(poses[-1][2]), math.sin(poses[-1][2])
        dx, dy = cos * ahead - sin * aside, sin * ahead + cos * aside
        move_particles(random, particle, 1, dx, dy, turn, poses[-1][2], settings)
        poses.append(particle[:, 0])
    noise = fit_odometry_noise(make_recording(np.array(poses), winding), amcl)
    for name in ("alpha1", "alpha2", "alpha3", "alpha4"):
        assert getattr(noise, name).value == pytest.approx(getattr(amcl, name), rel=0.3), name


def test_calibration_rejects_uninformative_drives(grid, line, few_resamples):
    odometry = make_odometry(grid, line, **DRIFTS)
    assert fit_odometry_noise(make_recording(line[:20], odometry[:20]), Amcl()) is None
    straight = np.column_stack([np.arange(0, 60, 0.2), np.zeros(300), np.zeros(300)])
    found = fit_odometry_noise(make_recording(straight, make_odometry(grid, straight)), Amcl())
    assert "turned by only 0 deg in total, too little for alpha1" in found.notes[0]
    noisy = fit_odometry_noise(make_recording(straight, straight, (0.01, 0.02)), Amcl())
    assert any("turned by only 0 deg in total" in note for note in noisy.notes)
    assert not {"turn_bias", "turn_drift_deg"} & {*noisy.settings()}


def test_calibration_reports_pose_jumps(grid, winding, few_resamples):
    odometry = make_odometry(grid, winding, **DRIFTS, **BIASES)
    jumping = winding.copy()
    for n in range(100, len(jumping), 60):
        jumping[n:, :2] += 0.3
    noise = fit_odometry_noise(make_recording(jumping, odometry), Amcl())
    assert any("may jump" in note for note in noise.notes)


@pytest.mark.parametrize(("sigma", "outliers"), [(0.01, 0.0), (0.03, 0.1)])
def test_calibration_finds_range_noise_and_outliers(grid, line, sigma, outliers):
    lidar = dataclasses.replace(LIDAR, range_sigma=sigma, range=12.0)
    disturbances = Disturbances(**EXACT | {"outliers": outliers})
    random = np.random.default_rng(3)
    drive = simulate_recording(grid, line, lidar=lidar, disturbances=disturbances)
    noise = random.standard_normal(line.shape) * [0.04, 0.04, 0.01]
    fit = fit_scan_noise(dataclasses.replace(drive, poses=line + noise), grid, threads=1)
    assert fit.range_sigma.value == pytest.approx(sigma, rel=0.2)
    assert fit.outliers.value == pytest.approx(outliers, abs=0.012)
    assert fit.blocked.value < 0.01
    assert fit.range_sigma.low < fit.range_sigma.value < fit.range_sigma.high
    assert 0.02 < fit.moved < 0.09
    assert fit.set_apart == 0


def test_calibration_finds_objects_in_view(grid, line):
    disturbances = Disturbances(**EXACT | {"occlusion": 0.6, "occlusion_deg": 40.0})
    fit = fit_scan_noise(simulate_recording(grid, line, disturbances=disturbances), grid)
    assert fit.occlusion.value == pytest.approx(0.6, abs=0.15)
    assert 30 < fit.occlusion_deg.value < 42
    assert 0.03 < fit.blocked.value < 0.6 * 40 / 270  # walls hide some objects
    assert fit.outliers.value < 0.005


def test_calibration_ignores_odometry_jumps(few_resamples):
    """Odometry jumps when its driver restarts, and poses jump when a filter corrects them."""
    drive = Recording.load(FILE)
    plain = fit_odometry_noise(drive, Amcl())
    odometry, poses = drive.odometry.copy(), drive.poses.copy()
    odometry[150:] = of_poses.move_poses(odometry[150:], (-7.0, 3.0, 2.0))
    poses[300:, 0] += 4.0
    noise = fit_odometry_noise(dataclasses.replace(drive, poses=poses, odometry=odometry), Amcl())
    assert noise.notes[-1].endswith("were ignored: 2")
    assert not any("jump" in note for note in plain.notes)
    for name in ("alpha2", "alpha3", "distance_drift", "heading_drift_deg", "heading_bias_deg"):
        value, expected = getattr(noise, name).value, getattr(plain, name).value
        assert value == pytest.approx(expected, rel=0.25, abs=2e-3), name


@pytest.mark.parametrize("jumping", ["odometry", "poses"])
def test_calibration_compares_jump_with_shorter_motion(few_resamples, jumping):
    """The limit grows with the shorter motion, because a jump lengthens its own motion."""
    drive = Recording.load(FILE)
    track = getattr(drive, jumping).copy()
    track[150:, :2] += 0.6 * np.array([np.cos(track[149, 2]), np.sin(track[149, 2])])
    noise = fit_odometry_noise(dataclasses.replace(drive, **{jumping: track}), Amcl())
    assert noise.notes[-1].endswith("were ignored: 1")


def test_calibration_ignores_changed_walls():
    """The small drive has the usual disturbances, whose walls shadow others."""
    fit = fit_scan_noise(Recording.load(FILE), load_map(MAP))
    assert fit.occlusion.value == pytest.approx(Disturbances.occlusion, abs=0.06)
    assert fit.occlusion_deg.value == pytest.approx(Disturbances.occlusion_deg, abs=3)


def test_object_needs_four_short_beams(grid, line):
    plain = simulate_recording(grid, line[::4], disturbances=Disturbances(**EXACT))
    short = np.array([1, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1, 1, 1, 1], bool)
    for first, count in ((short, 9), (short[:3], 0)):
        ranges = plain.ranges.copy()
        ranges[:, 10 : 10 + len(first)][:, first] = 0.3
        fit = fit_scan_noise(dataclasses.replace(plain, ranges=ranges), grid)
        assert fit.occlusion_deg.value == pytest.approx(count * 270 / 90), count


def test_calibration_rejects_scans_of_another_map(grid, line):
    ranges = np.random.default_rng(0).uniform(0.5, 8.0, (len(line), LIDAR.beams))
    with pytest.raises(RecordingError, match="scans fit the map and lie in its free space"):
        fit_scan_noise(Recording(ranges, LIDAR, line), grid)
    with pytest.raises(RecordingError, match="has only 9 scans; at least 10 are needed"):
        fit_scan_noise(Recording(ranges[:9], LIDAR, line[:9]), grid)


def test_bootstrap_draws_whole_blocks():
    poses = np.column_stack([np.arange(0, 80, 0.5), np.zeros(160), np.zeros(160)])
    blocks = of_intervals.assign_blocks(poses)
    assert np.bincount(blocks).tolist() == [20] * 8
    draws = of_intervals.count_block_draws(blocks)
    assert (draws.sum(axis=1) == 160).all()
    assert (draws.reshape(len(draws), 8, 20).std(axis=2) == 0).all()
    value, low, high = of_intervals.estimate_block_mean(blocks.astype(float), blocks)
    assert (value, low < value < high) == (3.5, True)
    assert math.isnan(of_intervals.estimate_block_mean(np.ones(60), blocks[:60]).low)
    (total,) = of_intervals.bootstrap_statistics(
        lambda weights: np.array([weights.sum()]), blocks, 50
    )
    assert total == (160, 160, 160)


@pytest.fixture(scope="module")
def drive(grid, line):
    """There and back."""
    back = line[::-1] + np.array([0.0, 0.0, np.pi])
    there_and_back = np.concatenate([line, back])
    return simulate_recording(grid, there_and_back, disturbances=Disturbances(outliers=0.08))


@pytest.fixture(scope="module")
def calibration(grid, drive):
    return calibrate_drive(drive, grid, robot=Robot(filter=Amcl(max_particles=900)), threads=2)


def test_calibrated_robot_has_measured_disturbances(calibration):
    assert calibration.robot.disturbances.outliers == calibration.scans.outliers.value
    assert calibration.robot.disturbances.outliers == pytest.approx(0.08, abs=0.02)
    odometry = calibration.odometry
    assert calibration.robot.odometry.distance_drift == odometry.distance_drift.value
    assert calibration.robot.odometry.heading_drift_deg == Odometry.heading_drift_deg
    assert "which are not written" in " ".join(odometry.notes)
    turned = dataclasses.replace(odometry, turned=7.0)
    assert turned.settings()["heading_drift_deg"] == odometry.heading_drift_deg.value
    assert calibration.robot.disturbances.boundary_noise == Disturbances.boundary_noise
    assert calibration.robot.filter == Amcl(max_particles=900)


def test_calibration_works_without_odometry(grid, drive):
    result = calibrate_drive(dataclasses.replace(drive, odometry=None), grid)
    assert result.odometry is None
    assert result.robot.odometry == Odometry()
    assert "no odometry" in " ".join(result.notes)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"filter": {"alpha9": 1}}, "filter has no 'alpha9'"),
        ({"disturbances": {"outliers": 2}}, "disturbances: outliers must be 0 to 1"),
        ({"disturbances": [1]}, "disturbances must hold settings by name"),
    ],
)
def test_robot_rejects_invalid_settings_file(tmp_path, content, message):
    file = tmp_path / "robot.json"
    file.write_text(json.dumps({"robot": content}))
    with pytest.raises(ConfigError, match=f"robot.json: {message}"):
        Robot.load(file)


def test_robot_rejects_older_settings_file(tmp_path):
    file = tmp_path / "older.json"
    file.write_text(json.dumps({"config": {}, "amcl": {"alpha1": 0.1}}))
    with pytest.raises(ConfigError, match=r"older\.json: has no entry \"robot\"; .* again"):
        Robot.load(file)

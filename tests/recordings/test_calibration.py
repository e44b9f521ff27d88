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


def driven(poses, odometry, noise=(0.0, 0.0), seed=0):
    """A recording without scans to speak of, whose poses have noise of their own [m, rad]."""
    random = np.random.default_rng(seed)
    spread = np.array([noise[0], noise[0], noise[1]])
    recorded_poses = poses + spread * random.standard_normal(poses.shape)
    return Recording(np.ones((len(poses), LIDAR.beams)), LIDAR, recorded_poses, odometry=odometry)


def reported(grid, poses, seed=1, **odometry):
    own = Simulator(grid, Robot(odometry=Odometry(**odometry))).arguments.odometry
    return simulate_odometry(np.random.default_rng(seed), poses, own)


def test_calibration_finds_odometry_drifts(grid, winding):
    odometry = reported(grid, winding, **DRIFTS, **BIASES)
    found = fit_odometry_noise(driven(winding, odometry), Amcl())
    for name, value in DRIFTS.items():
        value_found, low, high = getattr(found, name)
        assert value_found == pytest.approx(value, rel=0.25), name
        assert 0.85 * low < value < 1.15 * high, name
    for name in BIASES:
        assert abs(getattr(found, name).value) < 0.3 if "deg" in name else 0.01
    assert found.position_noise.value < 0.01
    assert found.notes == ()


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
    found = fit_odometry_noise(driven(winding, odometry), Amcl())
    assert found.distance_bias.value == pytest.approx(0.03, abs=0.005)
    assert found.turn_bias.value == pytest.approx(-0.04, abs=0.005)
    assert found.heading_bias_deg.value == pytest.approx(0.5, abs=0.05)


def test_calibration_separates_pose_and_odometry_noise(grid, winding, few_resamples):
    odometry = reported(grid, winding, **DRIFTS, **BIASES)
    found = fit_odometry_noise(driven(winding, odometry, (0.05, 0.02)), Amcl())
    assert 0.035 < found.position_noise.value < 0.055
    assert found.heading_noise_deg.value == pytest.approx(math.degrees(0.02), rel=0.25)
    assert found.heading_drift_deg.value == pytest.approx(DRIFTS["heading_drift_deg"], rel=0.3)
    assert "recorded poses are noisier than the odometry" in found.notes[0]


def test_calibration_finds_amcl_alphas(grid, winding, few_resamples):
    true = Amcl(alpha1=0.05, alpha2=0.02, alpha3=0.04, alpha4=0.03, update_min_d=0.01)
    settings = Simulator(grid, robot=Robot(filter=true)).arguments.filter
    random, poses = np.random.default_rng(2), [np.zeros(3)]
    steps = of_poses.compute_motions(winding[:-1], winding[1:])
    for ahead, aside, turn in steps:
        particle = poses[-1][:, None].copy()
        # Odometry in the particle's own axes, as AMCL applies it.
        cos, sin = math.cos(poses[-1][2]), math.sin(poses[-1][2])
        dx, dy = cos * ahead - sin * aside, sin * ahead + cos * aside
        move_particles(random, particle, 1, dx, dy, turn, poses[-1][2], settings)
        poses.append(particle[:, 0])
    found = fit_odometry_noise(driven(np.array(poses), winding), true)
    for name in ("alpha1", "alpha2", "alpha3", "alpha4"):
        assert getattr(found, name).value == pytest.approx(getattr(true, name), rel=0.3), name


def test_calibration_rejects_uninformative_drives(grid, line, few_resamples):
    odometry = reported(grid, line, **DRIFTS)
    assert fit_odometry_noise(driven(line[:20], odometry[:20]), Amcl()) is None
    straight = np.column_stack([np.arange(0, 60, 0.2), np.zeros(300), np.zeros(300)])
    found = fit_odometry_noise(driven(straight, reported(grid, straight)), Amcl())
    assert "turned by only 0 deg in total, too little for alpha1" in found.notes[0]
    noisy = fit_odometry_noise(driven(straight, straight, (0.01, 0.02)), Amcl())
    assert any("turned by only 0 deg in total" in note for note in noisy.notes)
    assert not {"turn_bias", "turn_drift_deg"} & {*noisy.settings()}


def test_calibration_reports_pose_jumps(grid, winding, few_resamples):
    odometry = reported(grid, winding, **DRIFTS, **BIASES)
    jumping = winding.copy()
    for n in range(100, len(jumping), 60):
        jumping[n:, :2] += 0.3
    found = fit_odometry_noise(driven(jumping, odometry), Amcl())
    assert any("may jump" in note for note in found.notes)


@pytest.mark.parametrize(("sigma", "outliers"), [(0.01, 0.0), (0.03, 0.1)])
def test_calibration_finds_range_noise_and_outliers(grid, line, sigma, outliers):
    lidar = dataclasses.replace(LIDAR, range_sigma=sigma, range=12.0)
    made = Disturbances(**EXACT | {"outliers": outliers})
    random = np.random.default_rng(3)
    drive = simulate_recording(grid, line, lidar=lidar, disturbances=made)
    noise = random.standard_normal(line.shape) * [0.04, 0.04, 0.01]
    found = fit_scan_noise(dataclasses.replace(drive, poses=line + noise), grid, threads=1)
    assert found.range_sigma.value == pytest.approx(sigma, rel=0.2)
    assert found.outliers.value == pytest.approx(outliers, abs=0.012)
    assert found.blocked.value < 0.01
    assert found.range_sigma.low < found.range_sigma.value < found.range_sigma.high
    assert 0.02 < found.moved < 0.09
    assert found.set_apart == 0


def test_calibration_finds_objects_in_view(grid, line):
    made = Disturbances(**EXACT | {"occlusion": 0.6, "occlusion_deg": 40.0})
    found = fit_scan_noise(simulate_recording(grid, line, disturbances=made), grid)
    assert found.occlusion.value == pytest.approx(0.6, abs=0.15)
    assert 30 < found.occlusion_deg.value < 42
    assert 0.03 < found.blocked.value < 0.6 * 40 / 270  # walls hide some objects
    assert found.outliers.value < 0.005


def test_calibration_ignores_odometry_jumps(few_resamples):
    """As where its driver is started again, or where a filter's pose jumps."""
    drive = Recording.load(FILE)
    plain = fit_odometry_noise(drive, Amcl())
    odometry, poses = drive.odometry.copy(), drive.poses.copy()
    odometry[150:] = of_poses.move_poses(odometry[150:], (-7.0, 3.0, 2.0))
    poses[300:, 0] += 4.0
    found = fit_odometry_noise(dataclasses.replace(drive, poses=poses, odometry=odometry), Amcl())
    assert found.notes[-1].endswith("were ignored: 2")
    assert not any("jump" in note for note in plain.notes)
    for name in ("alpha2", "alpha3", "distance_drift", "heading_drift_deg", "heading_bias_deg"):
        value, expected = getattr(found, name).value, getattr(plain, name).value
        assert value == pytest.approx(expected, rel=0.25, abs=2e-3), name


@pytest.mark.parametrize("jumping", ["odometry", "poses"])
def test_calibration_compares_jump_with_shorter_motion(few_resamples, jumping):
    """The way that jumps is long by its jump alone, which would excuse it."""
    drive = Recording.load(FILE)
    moved_on = getattr(drive, jumping).copy()
    moved_on[150:, :2] += 0.6 * np.array([np.cos(moved_on[149, 2]), np.sin(moved_on[149, 2])])
    found = fit_odometry_noise(dataclasses.replace(drive, **{jumping: moved_on}), Amcl())
    assert found.notes[-1].endswith("were ignored: 1")


def test_calibration_ignores_changed_walls():
    """The small drive has the usual disturbances, whose walls shadow others."""
    found = fit_scan_noise(Recording.load(FILE), load_map(MAP))
    assert found.occlusion.value == pytest.approx(Disturbances.occlusion, abs=0.06)
    assert found.occlusion_deg.value == pytest.approx(Disturbances.occlusion_deg, abs=3)


def test_object_needs_four_short_beams(grid, line):
    plain = simulate_recording(grid, line[::4], disturbances=Disturbances(**EXACT))
    short = np.array([1, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1, 1, 1, 1], bool)
    for first, count in ((short, 9), (short[:3], 0)):
        ranges = plain.ranges.copy()
        ranges[:, 10 : 10 + len(first)][:, first] = 0.3
        found = fit_scan_noise(dataclasses.replace(plain, ranges=ranges), grid)
        assert found.occlusion_deg.value == pytest.approx(count * 270 / 90), count


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
    drawn = of_intervals.count_block_draws(blocks)
    assert (drawn.sum(axis=1) == 160).all()
    assert (drawn.reshape(len(drawn), 8, 20).std(axis=2) == 0).all()
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
def calibrated(grid, drive):
    return calibrate_drive(drive, grid, robot=Robot(filter=Amcl(max_particles=900)), threads=2)


def test_calibrated_robot_has_measured_disturbances(calibrated):
    assert calibrated.robot.disturbances.outliers == calibrated.scans.outliers.value
    assert calibrated.robot.disturbances.outliers == pytest.approx(0.08, abs=0.02)
    odometry = calibrated.odometry
    assert calibrated.robot.odometry.distance_drift == odometry.distance_drift.value
    assert calibrated.robot.odometry.heading_drift_deg == Odometry.heading_drift_deg
    assert "which are not written" in " ".join(odometry.notes)
    turned = dataclasses.replace(odometry, turned=7.0)
    assert turned.settings()["heading_drift_deg"] == odometry.heading_drift_deg.value
    assert calibrated.robot.disturbances.boundary_noise == Disturbances.boundary_noise
    assert calibrated.robot.filter == Amcl(max_particles=900)


def test_calibration_works_without_odometry(grid, drive):
    found = calibrate_drive(dataclasses.replace(drive, odometry=None), grid)
    assert found.odometry is None
    assert found.robot.odometry == Odometry()
    assert "no odometry" in " ".join(found.notes)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"filter": {"alpha9": 1}}, "filter has no 'alpha9'"),
        ({"disturbances": {"outliers": 2}}, "disturbances: outliers must be 0 to 1"),
        ({"disturbances": [1]}, "disturbances must hold settings by name"),
    ],
)
def test_robot_rejects_invalid_settings_file(tmp_path, content, said):
    file = tmp_path / "robot.json"
    file.write_text(json.dumps({"robot": content}))
    with pytest.raises(ConfigError, match=f"robot.json: {said}"):
        Robot.load(file)


def test_robot_rejects_older_settings_file(tmp_path):
    file = tmp_path / "older.json"
    file.write_text(json.dumps({"config": {}, "amcl": {"alpha1": 0.1}}))
    with pytest.raises(ConfigError, match=r"older\.json: has no entry \"robot\"; .* again"):
        Robot.load(file)

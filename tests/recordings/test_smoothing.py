"""Trajectories of recorded drives: their kernels, what is found, and what is told of it."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support import oracles
from support.machine import SHARED_DATA

import locplan
from locplan._support import poses as of_poses
from locplan._support.kernels.particles import BeamScores
from locplan.errors import ConfigError, RecordingError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.recordings import Recording, read_recording, record_drive
from locplan.recordings.calibration import fit_odometry_noise
from locplan.recordings.figures import trajectory_figure
from locplan.recordings.kernels import least_squares, trajectory as kernels
from locplan.recordings.smoothing import load_or_smooth, smooth, with_ground_truth
from locplan.recordings.trajectory import OdometryJump

pytestmark = pytest.mark.usefixtures("undrawn")

GRID = locplan.maps.environments.make("places", resolution=0.1)
ROBOT = locplan.Robot(locplan.Lidar(range=8.0, beams=180))


@pytest.fixture(scope="module")
def drive() -> Recording:
    costs = locplan.Costmap.blank(GRID)
    way = locplan.plan(costs, (4.55, 4.15), (25.75, 17.75)).path
    return record_drive(GRID, way, ROBOT, spacing=0.35)


@pytest.fixture(scope="module")
def trajectory(drive):
    return smooth(GRID, drive)


def measure_errors(trajectory, drive, some=slice(None)) -> np.ndarray:
    return np.hypot(*(trajectory.poses - drive.poses)[some, :2].T)


def with_odometry(drive: Recording, change) -> Recording:
    """The drive with other moves by odometry, which are changed in place."""
    moves = of_poses.compute_motions(drive.odometry[:-1], drive.odometry[1:])
    change(moves)
    odometry = [drive.odometry[0]]
    for move in moves:
        odometry.append(of_poses.apply_motions(odometry[-1], move))
    return replace(drive, odometry=np.array(odometry))


# Kernels


@pytest.mark.parametrize("scale", [0.1, 1.0, 3.0, 8.0])
def test_motion_density_equals_mixture(scale):
    random = np.random.default_rng(1)
    for _ in range(50):
        error = random.standard_normal(3) * scale * (0.2, 0.2, 0.1)
        deviation = random.uniform(0.02, 0.2, 3)
        expected = oracles.trajectories.density_of(error, deviation, 1e-15)
        assert kernels.compute_motion_density(error, deviation, 1e-15) == pytest.approx(
            expected, rel=1e-3
        )
    assert kernels.compute_motion_density(np.array([20.0, 0, 0]), deviation, 1e-15) == 1e-15


def small_scene():
    """Walls, the distances of the cells' centres from them in a ring of 2 m, and a scan's ends."""
    walls = np.zeros((12, 15), bool)
    walls[2, 1:14], walls[3:11, 4], walls[9, 9:12] = True, True, True
    rows, cols = np.nonzero(walls)
    away = np.full((14, 17), 2.0, np.float32)
    for i, j in np.ndindex(walls.shape):
        away[i + 1, j + 1] = min(2.0, 0.1 * np.hypot(rows - i, cols - j).min())
    ends = np.random.default_rng(2).uniform(-0.6, 0.6, (20, 2))
    ends[3] = np.nan
    return walls, BeamScores(away.ravel(), *away.shape, 0.1, True, 1.0), ends


def test_scan_fit_equals_plain_loops():
    """The vector of the normal equations is the gradient of the fit."""
    walls, field, ends = small_scene()
    beams = least_squares.BeamMixture(0.1, 0.1, 30.0, -1.0)
    matrix, vector = np.empty((3, 3)), np.empty(3)
    random = np.random.default_rng(3)
    for _ in range(20):
        pose = random.uniform((0.4, 0.4, -3), (1.1, 0.8, 3))

        def fit(at):
            return least_squares.evaluate_fit(field, beams, ends, at, matrix, vector)

        expected = oracles.trajectories.fit_of(walls, 0.1, 0.1, 0.1, ends, pose)
        assert fit(pose) == pytest.approx(expected, abs=1e-5)
        slope = vector.copy()
        steps = 1e-4 * np.eye(3)
        rise = [(fit(pose + step) - fit(pose - step)) / 2e-4 for step in steps]
        # Where an end crosses into another cell within a step, the slope jumps.
        assert slope == pytest.approx(-30.0 * np.array(rise), rel=0.1, abs=4.0)
    assert math.isnan(least_squares.evaluate_fit(field, beams, ends * np.nan, pose, matrix, vector))


def test_likeliest_candidates_equal_exhaustive_search():
    random = np.random.default_rng(4)
    for _ in range(20):
        candidates = random.uniform(-1, 1, (3, 5, 3))
        gains, moves = random.uniform(-9, 0, (3, 5)), random.uniform(-1, 1, (5, 3))
        deviations = random.uniform(0.1, 0.6, (5, 3))
        way = kernels.find_likeliest_candidates(candidates, gains, moves, deviations, 1e-9)
        assert tuple(way) == oracles.trajectories.best_way(
            candidates, gains, moves, deviations, 1e-9
        )


def test_block_solver_equals_dense_matrix():
    random = np.random.default_rng(5)
    parts = random.standard_normal((6, 3, 6))
    diagonal, beside = np.zeros((6, 3, 3)), np.zeros((6, 3, 3))
    diagonal += np.eye(3)
    for n in range(1, 6):
        both = parts[n].T @ parts[n]
        diagonal[n - 1] += both[:3, :3]
        diagonal[n] += both[3:, 3:]
        beside[n] = both[3:, :3]
    vector, step = random.standard_normal((6, 3)), np.empty((6, 3))
    equations = least_squares.NormalEquations(diagonal, beside, vector)
    least_squares.solve_block_tridiagonal(equations, 0.0, step)
    whole = oracles.trajectories.whole_matrix(diagonal, beside)
    assert step.ravel() == pytest.approx(-np.linalg.solve(whole, vector.ravel()))
    own, across = np.empty((6, 3, 3)), np.empty((6, 3, 3))
    least_squares.write_covariances(equations, own, across)
    inverse = np.linalg.inv(whole + 1e-9 * np.eye(18))
    for n in range(6):
        here, before = slice(3 * n, 3 * n + 3), slice(3 * n - 3, 3 * n)
        assert own[n] == pytest.approx(inverse[here, here])
        assert n == 0 or across[n] == pytest.approx(inverse[here, before])


def some_drive(ends):
    """Six scans whose odometry errs, and the poses that it was made with."""
    random = np.random.default_rng(8)
    moves = np.tile([0.2, 0.02, 0.3], (6, 1))
    poses = [np.array([0.7, 0.5, 0.1])]
    for move in moves[1:]:
        poses.append(of_poses.apply_motions(poses[-1], move + random.standard_normal(3) * 0.05))
    deviations = np.full((6, 3), 0.05)
    deviations[3] = np.inf  # a jump
    drive = least_squares.DriveScans(np.tile(ends, (6, 1, 1)), np.ones(6), moves, deviations)
    return drive, np.array(poses)


def test_odometry_equations_equal_loss_gradient():
    _, field, ends = small_scene()
    drive, poses = some_drive(ends * np.nan)
    beams = least_squares.BeamMixture(0.1, 0.1, 30.0, -1.0)
    equations = least_squares.NormalEquations(*np.empty((2, 6, 3, 3)), np.empty((6, 3)))
    least_squares.write_normal_equations(field, beams, drive, poses, equations)
    slope, rest = equations.vector.copy(), least_squares.NormalEquations(*map(np.copy, equations))
    for n, axis in np.ndindex(6, 3):
        step = np.zeros((6, 3))
        step[n, axis] = 1e-6
        up, down = (
            least_squares.write_normal_equations(field, beams, drive, poses + sign * step, rest)
            for sign in (1, -1)
        )
        assert slope[n, axis] == pytest.approx((up - down) / 2e-6, rel=1e-4, abs=1e-4)
    assert not equations.off_diagonal[3].any()


def test_refined_poses_have_lower_loss():
    """Without returns, the poses follow the odometry."""
    _, field, ends = small_scene()
    drive, poses = some_drive(ends)
    beams = least_squares.BeamMixture(0.1, 0.1, 30.0, -1.0)
    equations = least_squares.NormalEquations(*np.empty((2, 6, 3, 3)), np.empty((6, 3)))
    before = least_squares.write_normal_equations(field, beams, drive, poses, equations)
    trajectory = poses.copy()
    after = least_squares.refine_poses(field, beams, drive, trajectory, 20)
    assert after < before
    loss = least_squares.write_normal_equations(field, beams, drive, trajectory, equations)
    assert loss == pytest.approx(after)
    nothing = drive._replace(ends=drive.ends * np.nan)
    least_squares.refine_poses(field, beams, nothing, poses, 50)
    ways = of_poses.compute_motions(poses[:-1], poses[1:])
    assert ways[[0, 1, 3, 4]] == pytest.approx(drive.moves[[1, 2, 4, 5]], abs=1e-3)


def test_particle_spread_equals_motion_noise():
    cloud = np.zeros((3, 4), np.float32)
    cloud[2] = math.pi / 2  # ahead is up
    poses, deviation = np.empty((3, 80_000)), np.array([0.1, 0.05, 0.02])
    kernels.spread_particles(
        np.random.default_rng(9), cloud, np.array([1.0, 0, 0.2]), deviation, poses
    )
    low, middle, high = np.quantile(poses, (0.159, 0.5, 0.841), axis=1)
    assert middle == pytest.approx([0.0, 1.0, math.pi / 2 + 0.2], abs=2e-3)
    assert (high - low) / 2 == pytest.approx([0.0585, 0.117, 0.0234], rel=0.05)
    assert 0.003 < (np.hypot(poses[0], poses[1] - 1.0) > 1.0).mean() < 0.012


def test_resampling_is_proportional_to_weights():
    poses = np.arange(12.0).reshape(3, 4)
    cloud = np.empty((3, 1000), np.float32)
    weights = np.array([1.0, 0.0, 2.0, 7.0])
    kernels.resample_evenly(np.random.default_rng(6), poses, weights, cloud)
    counts = [(cloud[0] == x).sum() for x in poses[0]]
    assert counts == pytest.approx([100, 0, 200, 700], abs=1)
    assert (cloud[2] - cloud[0] == 8).all()


def test_backward_samples_lead_to_final_particles():
    clouds = np.zeros((3, 3, 40), np.float32)
    clouds[:, 1, 20:] = 5.0  # two ways side by side, 5 m apart
    clouds[:, 0] = np.arange(3)[:, None]
    clouds[2, 1] = 5.0  # of which one ends here
    moves, deviations = np.tile([1.0, 0, 0], (3, 1)), np.full((3, 3), 0.1)
    samples = np.empty((30, 3, 3))
    kernels.sample_trajectories_backwards(
        np.random.default_rng(7), clouds, moves, deviations, 1e-15, samples
    )
    assert (samples[..., 1] == 5.0).all()


def test_backward_samples_equal_plain_loops():
    random = np.random.default_rng(10)
    clouds = random.normal(0.0, (0.3, 0.3, 0.2), (4, 30, 3)).transpose(0, 2, 1).astype(np.float32)
    clouds[2, 2] += 2 * np.pi
    moves, deviations = random.normal(0.0, 0.2, (4, 3)), random.uniform(0.05, 0.3, (4, 3))
    samples, seed = np.empty((10, 4, 3)), 11
    kernels.sample_trajectories_backwards(
        np.random.default_rng(seed), clouds, moves, deviations, 1e-15, samples
    )
    expected = oracles.trajectories.sample_backwards(
        np.random.default_rng(seed), clouds.astype(float), moves, deviations, 1e-15, 10
    )
    assert np.array_equal(samples, expected)


# What is found


def test_smooth_needs_no_start_or_poses(drive, trajectory):
    assert np.median(measure_errors(trajectory, drive)) < 0.04
    assert measure_errors(trajectory, drive).max() < 0.12
    turn = np.abs(of_poses.wrap_angles(trajectory.poses[:, 2] - drive.poses[:, 2]))
    assert math.degrees(np.median(turn)) < 0.5
    lost = replace(drive, poses=drive.poses[::-1].copy())
    assert np.array_equal(smooth(GRID, lost).poses, trajectory.poses)


def test_covariance_covers_trajectory_errors(drive, trajectory):
    error = (trajectory.poses - drive.poses)[:, :2]
    squares = np.einsum(
        "ni,nij,nj->n", error, np.linalg.inv(trajectory.covariances[:, :2, :2]), error
    )
    assert (squares < 5.99).mean() > 0.9
    assert np.median(squares) > 0.02


def test_smooth_reports_wheel_slip(drive):
    def slip(moves):
        moves[19, 0] += 2.0

    trajectory = smooth(GRID, with_odometry(drive, slip))
    (jump,) = trajectory.jumps
    assert (jump.scan, jump.kind) == (20, "slip")
    assert jump.distance == pytest.approx(2.0, abs=0.15)
    assert not trajectory.is_trusted[19:23].any()  # scans are 0.35 m apart, and a metre counts
    assert trajectory.is_trusted[[18, 24]].all()
    assert measure_errors(trajectory, drive).max() < 0.2
    assert "wheels slip 2" in " ".join(trajectory.sentences)


@pytest.mark.long
def test_smooth_finds_carried_robot(drive):
    there = replace(drive, poses=drive.poses[::-1], ranges=drive.ranges[::-1], times=None)
    both = {
        name: np.concatenate([getattr(drive, name), getattr(there, name)])
        for name in ("ranges", "poses")
    }
    moves = of_poses.compute_motions(drive.odometry[:-1], drive.odometry[1:])
    back = of_poses.compute_motions(moves[::-1], np.zeros_like(moves))
    odometry = [drive.odometry[0]]
    for move in [*moves, [0.4, 0.0, 0.0], *back[5:]]:
        odometry.append(of_poses.apply_motions(odometry[-1], np.array(move)))
    count = len(drive)
    keep = np.r_[0:count, count + 5 : 2 * count]
    carried = Recording(
        both["ranges"][keep], drive.lidar, both["poses"][keep], odometry=np.array(odometry)
    )
    trajectory = smooth(GRID, carried)
    assert measure_errors(trajectory, carried, trajectory.is_trusted).max() < 0.2


def test_smooth_reports_displaced_map(drive, trajectory):
    assert "the map is probably displaced" not in trajectory.report()
    row, col = GRID.cell(drive.poses[35, :2])
    box = slice(row - 40, row + 40), slice(col - 40, col + 40)
    cells = GRID.cells.copy()
    cells[box] = np.roll(cells[box], 4, axis=1)
    moved = smooth(replace(GRID, cells=cells), drive)
    away = measure_errors(moved, drive) > 0.2
    assert away.sum() > 20
    named = np.array(["the map is probably displaced" in row[-1] for row in moved.table().rows])
    assert named[away].mean() > 0.8
    assert not named[~away].any()
    assert "the map is probably displaced" in moved.report()


@pytest.mark.long
def test_smooth_names_map_between_opposite_turns(drive):
    """Odometry that jumps by a turn, and later back, was right: the map is turned."""

    def turn(moves):
        moves[19, 2] += 1.0
        moves[39, 2] -= 1.2

    turned = smooth(GRID, with_odometry(drive, turn))
    doubts = [row[-1] for row in turned.table().rows]
    assert all("the map is probably displaced" in doubt for doubt in doubts[23:39])
    assert not any("the map is probably displaced" in doubt for doubt in doubts[:23] + doubts[39:])


def test_smooth_trusts_single_misfitting_scan(drive):
    """Odometry leads over a single scan of people around the robot, but not over two."""
    ranges = drive.ranges.copy()
    crowd = [30, 50, 51]
    ranges[crowd, :110] = np.random.default_rng(12).uniform(0.5, 8.0, (3, 110))
    crowded = smooth(GRID, replace(drive, ranges=ranges), start="log")
    assert (crowded.fits[crowd] < -0.8).all()
    assert crowded.is_trusted[29:32].all()
    assert measure_errors(crowded, drive)[30] < 0.1
    assert not crowded.is_trusted[50:52].any()


def test_smooth_distrusts_scans_in_twin_rooms():
    room = np.full((60, 80), FREE, np.uint8)
    room[[0, -1]], room[:, [0, -1]] = OCCUPIED, OCCUPIED
    room[10:20, 30:50], room[35:60, 55:60] = OCCUPIED, OCCUPIED
    grid = OccupancyGrid(np.hstack([room, room]), 0.1)
    way = locplan.Path(np.array([[1.0, 2.5], [2.0, 4.0], [5.0, 4.0], [6.5, 2.0]]))
    drive = record_drive(grid, way, ROBOT, spacing=0.35)
    assert not smooth(grid, drive).is_trusted.any()


def test_smooth_follows_poses_without_odometry(drive, trajectory):
    alone = smooth(GRID, replace(drive, odometry=None))
    assert alone.odometry is None
    assert "no odometry, so its poses were used as odometry" in alone.report()
    assert measure_errors(alone, drive).max() < 0.1


def test_trajectory_rotates_with_map(drive, trajectory):
    turned = replace(GRID, origin=(1.0, -2.0, 0.7))
    moved = trajectory.grid.world_to_grid(*drive.poses[:, :2].T)
    x, y = turned.grid_to_world(*moved)
    poses = np.column_stack([x, y, drive.poses[:, 2] + 0.7 - GRID.origin[2]])
    there = smooth(turned, replace(drive, poses=poses))
    assert measure_errors(there, replace(drive, poses=poses)) == pytest.approx(
        measure_errors(trajectory, drive), abs=1e-6
    )
    assert of_poses.wrap_angles(there.poses[:, 2] - trajectory.poses[:, 2]) == pytest.approx(
        0.7, abs=1e-6
    )
    cos, sin = math.cos(0.7), math.sin(0.7)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    assert there.covariances == pytest.approx(turn @ trajectory.covariances @ turn.T, abs=1e-9)


@pytest.mark.long
def test_smooth_estimates_odometry_scale(drive):
    def wrong(moves):
        moves[:, 0] *= 0.9

    trajectory = smooth(GRID, with_odometry(drive, wrong))
    before = smooth(GRID, drive).odometry.scale
    assert (1 + trajectory.odometry.scale) / (1 + before) == pytest.approx(1 / 0.9, abs=0.03)


def test_smooth_accepts_known_start(drive):
    assert measure_errors(smooth(GRID, drive, start=drive.poses[0]), drive).max() < 0.12
    for start in ("here", (1.0, 2.0), (math.nan, 0, 0), {}):
        with pytest.raises(ConfigError, match="start must be"):
            smooth(GRID, drive, start=start)
    with pytest.raises(ConfigError, match="lies outside places, which reaches from"):
        smooth(GRID, drive, start=(-5.0, 2.0, 0.0))


def test_doubtful_trajectory_suggests_map_check(trajectory):
    (said,) = replace(trajectory, doubts=np.ones(len(trajectory), np.int64)).sentences
    assert said.startswith(f"The poses of all {len(trajectory)} scans are doubtful: check the map,")


def test_smooth_rejects_unusable_input(drive):
    with pytest.raises(RecordingError, match="at least 10 are needed"):
        smooth(GRID, drive[:9])
    bare = OccupancyGrid(np.full((50, 50), FREE, np.uint8), 0.1)
    with pytest.raises(RecordingError, match="no walls"):
        smooth(bare, drive)


@pytest.mark.long
@pytest.mark.skipif(not (SHARED_DATA / "carmen").exists(), reason="the logs are not in this place")
@pytest.mark.parametrize(
    ("name", "half"),
    [("aces", "odd"), ("csail", "even"), ("fhw", "odd"), ("intel", "even"), ("seattle", "odd")],
)
def test_smooth_finds_real_drives(name, half):
    """Odd scans are smoothed on the map of the even scans, or vice versa."""
    log = read_recording(SHARED_DATA / "carmen" / f"{name}-corrected.log.gz")
    drive = log[(half == "odd") :: 2]
    other = {"odd": "even", "even": "odd"}[half]
    grid = locplan.load_map(SHARED_DATA / "rosmaps_carmen" / f"{name}_{other}" / "map.yaml")
    trajectory = smooth(grid, drive)
    error, some = measure_errors(trajectory, drive), trajectory.is_trusted
    turn = np.degrees(np.abs(of_poses.wrap_angles(trajectory.poses[:, 2] - drive.poses[:, 2])))
    assert np.median(error) <= 0.04
    assert np.quantile(error[some], 0.95) <= 0.12
    assert np.median(turn) <= 0.5
    assert not (error[some] > 0.3).any()
    assert some.mean() >= 0.93
    apart = (trajectory.poses - drive.poses)[:, :2]
    squares = np.einsum(
        "ni,nij,nj->n", apart, np.linalg.inv(trajectory.covariances[:, :2, :2]), apart
    )
    assert (squares < 5.99).mean() >= 0.9


@pytest.mark.long
@pytest.mark.skipif(
    not (SHARED_DATA / "drives").exists(), reason="the drives are not in this place"
)
@pytest.mark.parametrize(
    ("name", "median", "most"),
    [
        ("wean2", 0.008, 0.02),
        ("mines2", 0.025, 0.08),
        ("killian_3", 0.02, 0.14),
    ],
)
def test_smooth_finds_dense_drives(name, median, most):
    folder = SHARED_DATA / "drives"
    drive = read_recording(folder / f"{name}.log.gz")
    trajectory = smooth(locplan.load_map(folder / f"{name}.yaml"), drive)
    error = measure_errors(trajectory, drive)
    assert np.median(error) <= median
    assert np.quantile(error, 0.95) <= most
    assert not (error[trajectory.is_trusted] > 0.3).any()
    assert trajectory.is_trusted.mean() >= 0.935


# What is kept


def test_interrupted_smoothing_resumes_with_same_result(drive, trajectory, tmp_path):
    def stop(done, total):
        if done > 0.4 * total:  # after 64 scans of the first pass
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        smooth(GRID, drive, folder=tmp_path, progress=stop)
    (done,) = tmp_path.iterdir()
    before = done.stat().st_mtime_ns
    assert smooth(GRID, drive, folder=tmp_path) == trajectory
    assert done.stat().st_mtime_ns == before
    with np.load(done) as block:
        others = {name: block[name] + 1.0 for name in block}
    np.savez(done, **others)
    assert smooth(GRID, drive, folder=tmp_path) != trajectory


@pytest.mark.long
def test_smoothing_ignores_foreign_and_damaged_blocks(drive, trajectory, tmp_path):
    smooth(GRID, drive, folder=tmp_path, seed=2)
    assert smooth(GRID, drive, folder=tmp_path) == trajectory
    for block in tmp_path.iterdir():
        block.write_bytes(block.read_bytes()[:1000])
    assert smooth(GRID, drive, folder=tmp_path) == trajectory


def test_trajectory_is_cached_and_saved(drive, trajectory, tmp_path):
    made = load_or_smooth(drive, GRID, cache_dir=tmp_path)
    steps = []
    again = load_or_smooth(drive, GRID, cache_dir=tmp_path, progress=lambda *s: steps.append(s))
    assert made == again == trajectory
    assert not steps
    renamed = replace(drive, source=replace(drive.source, file="monday"))
    grid = OccupancyGrid(GRID.cells, GRID.resolution, origin=GRID.origin, name="lab")
    again = load_or_smooth(renamed, grid, cache_dir=tmp_path)
    assert (again.drive, again.map) == ("monday", "lab")
    assert np.array_equal(again.poses, trajectory.poses)
    trajectory.save(tmp_path / "saved")
    assert locplan.recordings.Trajectory.load(tmp_path / "saved") == trajectory
    tum = np.loadtxt(tmp_path / "saved" / "poses.tum", delimiter=" ")  # as evo splits lines
    some = trajectory.is_trusted
    assert tum[:, 1:3] == pytest.approx(trajectory.poses[some, :2], abs=1e-6)
    assert 2 * np.arctan2(tum[:, 6], tum[:, 7]) == pytest.approx(
        trajectory.poses[some, 2], abs=1e-5
    )


def test_cache_lists_and_clears_trajectories(drive, tmp_path, run, monkeypatch):
    def stop(done, total):
        if done > 0.4 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_or_smooth(drive, GRID, cache_dir=tmp_path, progress=stop)
    monkeypatch.setenv("LOCPLAN_CACHE", str(tmp_path))
    (entry,) = json.loads(run("cache", "list", "--json")[1])
    assert (entry["kind"], entry["finished_share"]) == ("unfinished", None)
    load_or_smooth(drive, GRID, cache_dir=tmp_path)
    (entry,) = json.loads(run("cache", "list", "--json")[1])
    about = entry["kind"], entry["map"], entry["details"], entry["finished_share"]
    assert about == ("trajectory", GRID.name, drive.source.file, 1.0)
    assert "1 result," in run("cache", "list")[1]
    assert "removed 1" in run("cache", "clear")[1]
    assert json.loads(run("cache", "list", "--json")[1]) == []


def test_smoothed_ground_truth_has_trusted_poses(drive, trajectory, tmp_path):
    assert with_ground_truth(drive, GRID) is drive  # it is no bag
    smoothed = with_ground_truth(drive, GRID, "smoothed", cache_dir=tmp_path)
    assert np.array_equal(smoothed.poses, trajectory.poses[trajectory.is_trusted])
    assert with_ground_truth(smoothed, GRID, "smoothed") is smoothed
    as_bag = replace(drive, source=replace(drive.source, file="monday", lidar_frame="laser"))
    assert len(with_ground_truth(as_bag, GRID, cache_dir=tmp_path)) == len(smoothed)
    with pytest.raises(ConfigError, match="reference must be one of"):
        with_ground_truth(drive, GRID, "truth")


def test_trajectory_figure_marks_doubtful_poses(drive, trajectory):
    doubts = trajectory.doubts.copy()
    doubts[30:34] = 1
    jump = OdometryJump(30, "slip", *map(float, trajectory.poses[30, :2]), 2.0, 0.1)
    figure = trajectory_figure(replace(trajectory, doubts=doubts, jumps=(jump,)))
    crosses = [each.get_xydata() for each in figure.axes[0].lines if each.get_marker() == "x"]
    np.testing.assert_array_equal(crosses[0], trajectory.poses[30:34, :2])
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"doubtful pose", "odometry jumps"} <= texts


def test_report_names_doubts_and_odometry_errors(trajectory):
    doubts = np.zeros(len(trajectory), np.int64)
    doubts[3], doubts[30:34] = 1, 2
    model = replace(trajectory.odometry, scale=-0.02, turn_scale=0.03, bend=0.01)
    text = " ".join(replace(trajectory, doubts=doubts, odometry=model).report().split())
    assert "2 stretches with 5 scans" in text
    x, y, _ = trajectory.poses[3]
    assert f"scan 3 at {x:.1f},{y:.1f}: the standard deviation" in text
    assert "scans 30 to 33 at" in text
    assert "distances are 2.0% too long, turns 3.0% too small" in text
    assert "bend by 0.57 deg/m to the left" in text
    doubts[:52:2] = 1
    many = replace(trajectory, doubts=doubts)
    assert f"and {len(many.doubtful_stretches) - 20} more" in many.report()
    untrusted = replace(trajectory, doubts=np.ones_like(doubts), odometry=model)
    assert "distances are" not in untrusted.report()


def test_calibration_omits_drifts_of_short_drive(drive, trajectory):
    noise = fit_odometry_noise(trajectory.replace_poses(drive), ROBOT.amcl)
    assert any("too short to estimate drifts" in note for note in noise.notes)
    assert not any("drift" in name for name in noise.settings())
    assert "distance_bias" in noise.settings()
    true = fit_odometry_noise(drive, ROBOT.amcl)
    assert not any("too short" in note for note in true.notes)
    assert "distance_drift" in true.settings()


@pytest.mark.long
def test_calibration_finds_drifts_after_smoothing():
    """Smoothing uses this odometry, which must not hide its drifts."""
    costs = locplan.Costmap.blank(GRID, robot=ROBOT)
    ends = [each.start for each in locplan.planning.random_queries(costs, 9, 7, min_distance=15.0)]
    ways = [locplan.plan(costs, *pair).path.xy for pair in itertools.pairwise(ends)]
    way = locplan.Path(np.concatenate([ways[0], *(each[1:] for each in ways[1:])]))
    drive = record_drive(GRID, way, ROBOT, spacing=0.25)
    noise = fit_odometry_noise(smooth(GRID, drive).replace_poses(drive), ROBOT.amcl)
    assert noise.distance_drift.value == pytest.approx(ROBOT.odometry.distance_drift, rel=0.2)
    turned = noise.turned / way.length
    drift = math.hypot(noise.heading_drift_deg.value, noise.turn_drift_deg.value * turned**0.5)
    own = ROBOT.odometry
    true = math.hypot(own.heading_drift_deg, own.turn_drift_deg * turned**0.5)
    assert drift == pytest.approx(true, rel=0.25)

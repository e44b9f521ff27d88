"""Replays of recorded drives: the same filter as in simulation, its errors, and its consistency."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from support import oracles
from support.maps import random_rooms
from support.recordings import LIDAR, simulate_recording

from locplan import Costmap, Lidar, OccupancyGrid, Path, plan, save_map
from locplan._support.kernels import drives
from locplan.app.cli import main
from locplan.errors import ConfigError, RecordingError
from locplan.maps import FREE, OCCUPIED, environments
from locplan.maps.grid import world_to_map_frame
from locplan.recordings import Recording, replay
from locplan.recordings.figures import replay_figure
from locplan.robots import Amcl, Disturbances, Robot
from locplan.robots.particles import compute_compared_ends
from locplan.simulation import Simulator, drive_open
from locplan.simulation.drives import LOST_DISTANCE, LOST_TEXT
from locplan.simulation.worlds import make_path_poses

pytestmark = pytest.mark.usefixtures("undrawn")

RESOLUTION = 0.1
FEW = {"min_particles": 100, "max_particles": 300}
SHARP = Amcl(laser_model_type="likelihood_field_prob", alpha1=0.05, alpha2=0.05, **FEW)


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=RESOLUTION)


@pytest.fixture(scope="module")
def line(grid):
    """True poses of a drive of 0.1 m steps through a room and a corridor, (n, 3)."""
    costs = Costmap.blank(grid, robot=0.3)
    path = plan(costs, (2.0, 3.0), (30.0, 3.0)).path
    return make_path_poses(path, grid)[::2]


@pytest.fixture(scope="module")
def drive(grid, line):
    return simulate_recording(grid, line)


@pytest.fixture(scope="module")
def replayed(grid, drive):
    return replay(drive, grid, robot=Robot(filter=SHARP), runs=6)


@pytest.mark.parametrize("interval", [1, 2])
def test_replayed_estimates_equal_simulated_estimates(interval):
    cells = random_rooms((24, 28), 3, blocks=9)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[8:16, 8:20] = FREE
    room = OccupancyGrid(cells, RESOLUTION)
    lidar = Lidar(range=2.0, beams=9, range_sigma=0.02, mount_x=0.15, mount_yaw_deg=20)
    amcl = Amcl(min_particles=20, max_particles=60, resample_interval=interval)
    disturbances = Disturbances(boundary_noise=0.0, start_sigma=0.05)
    robot = Robot(lidar, filter=amcl, disturbances=disturbances)
    here = Simulator(room, robot)
    truth = np.array([[1.0 + n / 25, 1.1 + 0.05 * math.sin(n), 0.1 * n] for n in range(20)])
    log: list = []
    expected = oracles.particles.drive(
        np.random.default_rng(6),
        truth,
        cells,
        cells,
        RESOLUTION,
        robot,
        here.arguments.lidar.angles,
        own=np.random.default_rng(7),
        log=log,
    )
    reported, *updates = log
    ends = np.full((len(truth), len(here.arguments.lidar.angles), 2), np.nan)
    for n, scan, _ in updates:
        ends[n] = scan
    poses, covariances = np.empty_like(truth), np.empty((len(truth), 3, 3))
    own = here.arguments
    kernel = (own.scores, own.start, own.filter, poses, covariances)
    drives.replay_filter(np.random.default_rng(7), truth[0], reported, ends, *kernel)
    errors = poses - truth
    errors[:, 2] = oracles.particles.wrapped(errors[:, 2])
    assert errors == pytest.approx(expected, abs=1e-9)
    resampled = updates[interval - 1 :: interval]
    assert np.flatnonzero(np.isfinite(covariances[:, 0, 0])).tolist() == [n for n, *_ in resampled]
    for n, _, covariance in resampled:
        assert covariances[n] == pytest.approx(covariance, abs=1e-9)


@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob"])
def test_replay_and_simulation_compare_same_beams(grid, line, model):
    quiet = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0)
    lidar = dataclasses.replace(LIDAR, range_sigma=1e-6)
    amcl = Amcl(laser_model_type=model, max_beams=30, laser_max_range=6.0, laser_min_range=2.5)
    drive = simulate_recording(grid, line[:20], lidar=lidar, disturbances=quiet)
    ends = compute_compared_ends(amcl, drive.lidar, drive.ranges) / RESOLUTION
    here = Simulator(grid, robot=Robot(lidar, filter=amcl, disturbances=quiet))
    expected = naive_ends(here, line[:20])
    assert ends == pytest.approx(expected, abs=1e-4, nan_ok=True)
    assert 0.1 < np.isnan(ends).mean() < 0.9


def naive_ends(here, line):
    """Ends of the beams that the simulated filter gets at some poses [cells]."""
    from locplan._support.kernels.lidar import simulate_measured_ends

    found = np.empty((len(line), len(here.arguments.lidar.angles), 2))
    for n, (x, y, heading) in enumerate(
        world_to_map_frame(here.grid, line) / (RESOLUTION, RESOLUTION, 1)
    ):
        simulate_measured_ends(
            np.random.default_rng(0),
            here.worlds[0],
            RESOLUTION,
            np.array([y, x, heading]),
            here.arguments.lidar,
            here.arguments.disturbances,
            found[n],
        )
    return found


def test_replay_error_matches_simulated_error(grid, line):
    path, simulator = Path(line[:, :2], line[:, 2]), Simulator(grid, Robot(LIDAR, filter=SHARP))
    simulated = drive_open(simulator, {"line": path}, range(30))["line"]
    rms = []
    for seed in range(8):
        drive = simulate_recording(grid, line, seed=seed)
        rms.append(
            replay(drive, grid, robot=Robot(filter=SHARP), runs=4, seed=seed).drives.mean_squares
        )
    ratio = np.sqrt(np.mean(rms) / simulated.mean_squares.mean())
    assert 0.75 < ratio < 1.33


def test_equal_seeds_give_equal_replays(grid, drive, replayed):
    """The number of threads must not matter."""
    again = replay(drive, grid, robot=Robot(filter=SHARP), runs=6, threads=1)
    assert (again.errors == replayed.errors).all()
    other = replay(drive, grid, robot=Robot(filter=SHARP), runs=2, seed=2)
    assert (other.errors != replayed.errors[:2]).any(axis=(1, 2)).all()
    assert (replayed.errors[0] != replayed.errors[1]).any()


def test_replay_errors_rotate_with_map(grid, drive, replayed):
    turn, shift = 0.5, (3.0, -2.0)
    (x, y, _), cos, sin = grid.origin, math.cos(turn), math.sin(turn)
    origin = cos * x - sin * y + shift[0], sin * x + cos * y + shift[1], turn
    turned = OccupancyGrid(grid.cells, RESOLUTION, origin=origin)
    found = replay(drive.move(*shift, turn), turned, robot=Robot(filter=SHARP), runs=6)
    back = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    assert found.errors @ back.T == pytest.approx(replayed.errors, abs=1e-6)
    assert back @ found.covariances @ back.T == pytest.approx(
        replayed.covariances, abs=1e-6, nan_ok=True
    )


def test_replay_ignores_frame_of_odometry(grid, drive, replayed):
    # The filter updates by the distance along x or y of odometry: a quarter turn keeps both.
    turned = dataclasses.replace(drive, poses=drive.odometry).move(5.0, 1.0, math.pi / 2)
    found = replay(
        dataclasses.replace(drive, odometry=turned.poses), grid, robot=Robot(filter=SHARP), runs=6
    )
    assert found.errors == pytest.approx(replayed.errors, abs=1e-6)


def test_consistency_follows_normalized_squared_errors(replayed):
    at = replayed.is_updated
    errors, covariances = replayed.errors[:, at, :2], replayed.covariances[:, at, :2, :2]
    squares = np.einsum("rni,rnij,rnj->rn", errors, np.linalg.inv(covariances), errors)
    assert replayed.nees[:, at] == pytest.approx(squares, rel=1e-3)
    found = replayed.consistency
    assert found.share_within.value == pytest.approx((squares < -2 * math.log(0.05)).mean())
    assert found.ellipse_factor == pytest.approx(
        math.sqrt(np.median(squares) / (2 * math.log(2))), rel=1e-3
    )


@pytest.mark.parametrize(
    ("factor", "said"), [(0.02, "overconfident"), (1.0, ""), (400.0, "overestimates its error")]
)
def test_consistency_reports_wrong_covariances(replayed, factor, said):
    changed = dataclasses.replace(replayed, covariances=factor * replayed.covariances)
    assert said in changed.consistency.sentence


def test_verdict_begins_with_lost_runs(replayed):
    assert replayed.verdict == replayed.consistency.sentence
    lost = dataclasses.replace(
        replayed, errors=replayed.errors + np.array([3 * LOST_DISTANCE, 0.0, 0.0])
    )
    assert lost.verdict.startswith(f"The filter is {LOST_TEXT} at some time in 100% of the runs")
    assert "first gets lost after 0 m, near " in lost.verdict
    assert "tune" not in lost.verdict  # these settings are not Nav2's, so they may be what it found
    untuned = dataclasses.replace(lost, robot=dataclasses.replace(lost.robot, filter=Amcl()))
    assert untuned.verdict.endswith("Run locplan tune --recording to find better settings.")


def test_consistency_needs_enough_updates(grid, drive):
    few = replay(
        drive, grid, robot=Robot(filter=dataclasses.replace(SHARP, resample_interval=40)), runs=2
    )
    assert 0 < few.consistency.updates < 10
    assert f"at only {few.consistency.updates} scans, too few" in few.consistency.sentence
    none = replay(
        drive, grid, robot=Robot(filter=dataclasses.replace(SHARP, resample_interval=9999)), runs=2
    )
    assert none.consistency.updates == 0
    assert none.summary()["consistency"]["filter_std"] is None
    assert "nan" not in none.report()
    assert "95 % ellipse" not in none.report()
    assert len(replay_figure(none).axes) == 2


def test_replay_notes_sparse_scans(grid, drive, replayed):
    assert replayed.notes == ()
    sparse = replay(drive.subsample(8), grid, robot=Robot(filter=SHARP), runs=2)
    assert "a scan only every 0.8 m, but AMCL updates every 0.25 m" in sparse.notes[0]
    # They come first, and nothing is said of losses, which are the log's own.
    first, *rest = sparse.report().splitlines()
    assert first.startswith("This log has too few scans to measure how often the filter gets lost")
    assert "at some time" not in "".join(rest)
    assert "overconfident" not in sparse.report()
    often = dataclasses.replace(SHARP, update_min_d=0.05)  # no log is sparse for this alone
    assert replay(drive, grid, robot=Robot(filter=often), runs=2).notes == ()
    holds = replay(drive.subsample(4), grid, robot=Robot(filter=SHARP), runs=2)
    first = holds.report().splitlines()[0]
    assert first.startswith(f"The filter was never {LOST_TEXT}, although the log has a scan")
    assert holds.report().count("has a scan only every") == 1


def test_replay_rejects_unusable_drives(grid, drive):
    without = dataclasses.replace(drive, odometry=None)
    with pytest.raises(RecordingError, match="no odometry, which a replay needs"):
        replay(without, grid)
    with pytest.raises(RecordingError, match=r"begins at .*, outside of two_corridors"):
        replay(drive.move(500.0, 0.0, 0.0), grid)
    with pytest.raises(ConfigError, match="runs must be"):
        replay(drive, grid, runs=0)
    with pytest.raises(ConfigError, match="Recording"):
        replay("drive.npz", grid)


def test_replay_figure_shows_both_paths(replayed):
    figure = replay_figure(replayed)
    upper, lower, *_ = figure.axes
    assert len(upper.lines) >= 7
    assert lower.get_xlabel() == "distance along the drive [m]"


@pytest.fixture
def files(tmp_path, grid, drive):
    save_map(grid, tmp_path / "map.yaml")
    drive.save(tmp_path / "drive.npz")
    dataclasses.replace(drive, odometry=None).save(tmp_path / "without.npz")
    return tmp_path


def run(monkeypatch, capsys, *arguments):
    monkeypatch.setattr("sys.argv", ["locplan", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def test_command_replays_recording(files, monkeypatch, capsys):
    settings = ["--set", "max_particles=300", "--set", "min_particles=100"]
    common = ["simulate", files / "map.yaml", "--drives", "2", *settings, "--recording"]
    code, out, _ = run(
        monkeypatch, capsys, *common, files / "drive.npz", "-o", files / "out", "--json"
    )
    about = json.loads(out)
    assert code == 0
    assert about["runs"] == 2
    assert about["robot"]["filter"]["max_particles"] == 300
    assert {each.name for each in (files / "out").iterdir()} >= {
        "replay.png",
        "replay.json",
        "errors.csv",
    }
    code, out, _ = run(monkeypatch, capsys, *common, files / "drive.npz")
    assert code == 0
    assert "RMSE of all" in out
    assert "95 % ellipse" in out
    code, _, err = run(monkeypatch, capsys, *common, files / "without.npz")
    assert code == 2
    assert err.count("\n") == 1
    assert "no odometry" in err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--start", "1,2", "--goal", "2,2"], "--start has no effect with --recording"),
        (["--field", "scan"], "--field has no effect with --recording"),
        (["--weight", "3"], "--weight has no effect with --recording"),
        (["--lidar", "rplidar-a1"], "--lidar has no effect with --recording"),
        (["--set", "outliers=0.1"], "outliers has no effect with --recording"),
    ],
)
def test_replay_rejects_unused_options(files, monkeypatch, capsys, given, said):
    command = ["simulate", files / "map.yaml", "--recording", files / "drive.npz", *given]
    code, _, err = run(monkeypatch, capsys, *command)
    assert code == 2
    assert said in err


def test_replay_rejects_several_maps(files, monkeypatch, capsys):
    maps = files / "map.yaml", files / "other.yaml"
    maps[1].write_text(maps[0].read_text())
    code, _, err = run(monkeypatch, capsys, "simulate", *maps, "--recording", files / "drive.npz")
    assert code == 2
    assert "a recording needs one map; name one of these 2" in err


def test_replay_has_twenty_runs_by_default(files, monkeypatch, capsys, coarse_fit):
    command = ["simulate", files / "map.yaml", "--recording", files / "drive.npz", "--json"]
    assert json.loads(run(monkeypatch, capsys, *command)[1])["runs"] == 20


def test_replay_rejects_shifted_map(files, monkeypatch, capsys, coarse_fit):
    command = ["simulate", files / "map.yaml", "--recording", files / "drive.npz", "--drives", "2"]
    drive = Recording.load(files / "drive.npz").move(0.0, 1.0, 0.0)
    drive.save(files / "drive.npz")
    code, _, err = run(monkeypatch, capsys, *command)
    assert code == 2
    assert "seems shifted" in err
    assert "run `locplan recording --align " in err


def test_replay_rejects_frozen_odometry(grid, drive):
    frozen = dataclasses.replace(drive, odometry=np.zeros_like(drive.poses))
    with pytest.raises(
        RecordingError, match=r"the odometry moves by only 0\.0 m, but the poses by"
    ):
        replay(frozen, grid)

"""The protocol of filters, and filters whose map is not the one that is driven in."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from support.recordings import simulate_recording

from locplan import (
    Costmap,
    Lidar,
    LocplanError,
    OccupancyGrid,
    Path,
    Robot,
    Sad,
    covariance_field,
    save_map,
)
from locplan._support.intervals import make_generator
from locplan.advice.tuning import tune, tune_on_drive
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED
from locplan.planning import Query
from locplan.recordings import replay
from locplan.robots import Amcl, Disturbances, Odometry
from locplan.simulation import Recommendation, RecommendationSettings, recommend_path, simulate
from locplan.simulation.query_routes import simulate_queries
from locplan.simulation.worlds import make_path_poses
from locplan.testing import check_filter

pytestmark = pytest.mark.usefixtures("undrawn")

FEW = {"min_particles": 100, "max_particles": 200}
STRAIGHT = {"distance_bias": 0.0, "heading_drift_deg": 0.0, "heading_bias_deg": 0.0}
REPLAYS = 14
"""Stream of random numbers of replays."""
QUIET = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0)
SHARP = Amcl(
    half_cell=False,
    laser_model_type="likelihood_field_prob",
    **{f"alpha{n}": 0.05 for n in range(1, 5)},
    **FEW,
)
EXACT = Robot(Lidar(range=5.0, beams=90), filter=SHARP, disturbances=QUIET)


def room(resolution=0.125):
    """A room of 12 x 8 m with two pillars, its walls within the map."""
    cells = np.full((int(8 / resolution), int(12 / resolution)), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    each = int(1 / resolution)
    cells[2 * each : 3 * each, 4 * each : 5 * each] = OCCUPIED
    cells[5 * each : 6 * each, 8 * each : 9 * each] = OCCUPIED
    return OccupancyGrid(cells, resolution, name="room")


def shifted_wall():
    """The room as the filter knows it: what stands on the right stands 0.75 m further left."""
    cells = room().cells.copy()
    cells[:, 48:-6] = cells[:, 54:]
    cells[1:-1, -6:] = FREE
    return OccupancyGrid(cells, 0.125, name="old")


THROUGH = {"through": Path(np.array([[2.0, 4.0], [9.0, 4.0], [9.0, 2.0]]))}


def errors(filter_map=None, robot=EXACT, drives=8, **more):
    found = simulate(room(), THROUGH, robot, drives=drives, filter_map=filter_map, **more)
    return found.drives["through"].errors


@pytest.mark.parametrize("interval", [1, 3])
def test_stepped_amcl_equals_replay(interval):
    grid = OccupancyGrid(room().cells, 0.125, (3.0, -2.0, 0.5))
    xy = np.column_stack(grid.grid_to_world([30.0, 30.0, 20.0], [12.0, 60.0, 80.0]))
    line = make_path_poses(Path(xy), grid)[::3]
    drive = simulate_recording(grid, line)
    amcl = Amcl(resample_interval=interval, max_beams=30, laser_max_range=4.0, **FEW)
    robot = Robot(drive.lidar, filter=amcl)
    whole = replay(drive, grid, robot, runs=2, seed=5)
    noise = robot.disturbances
    deviation = noise.start_sigma, np.radians(noise.start_sigma_deg)
    tracker = amcl.start(
        grid, drive.lidar, drive.poses[0], deviation, make_generator(5, REPLAYS, 1)
    )
    for n in range(len(drive)):
        tracker.motion(drive.odometry[n])
        tracker.scan(drive.ranges[n])
        off = tracker.estimate() - whole.poses[1, n]
        off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
        assert off == pytest.approx(0, abs=1e-9)
        expected = whole.covariances[1, n]
        assert tracker.covariance() == pytest.approx(expected, abs=1e-9, nan_ok=True)


class Deaf:
    """A filter that adds odometry to its first pose, with faults to be switched on."""

    title = "odometry alone"

    def __init__(self, fault=""):
        self.fault = fault

    def start(self, grid, lidar, pose, deviation, random):
        self.pose, self.before, self.random = np.array(pose), None, random
        return Deaf(self.fault).begun(pose)

    def begun(self, pose):
        self.pose, self.before = np.array(pose), None
        return self

    def motion(self, odometry):
        if self.before is not None or self.fault == "frame":
            self.pose = self.pose + odometry - (0 if self.before is None else self.before)
        self.before = odometry

    def scan(self, ranges):
        if self.fault == "seed":
            self.pose = self.pose + np.random.default_rng().normal(0, 1e-6, 3)

    def estimate(self):
        return self.pose[:2] if self.fault == "shape" else self.pose

    def covariance(self):
        own = np.eye(2 if self.fault == "size" else 3)
        own[0, 1] = 0.5 if self.fault == "symmetry" else 0.0
        return -own if self.fault == "sign" else own


@dataclasses.dataclass(frozen=True)
class Wrapped:
    """AMCL that the simulator does not know as such."""

    amcl: Amcl = SHARP
    fault: str = ""
    title = "a filter of my own"

    def start(self, grid, lidar, pose, deviation, random):
        tracker = self.amcl.start(grid, lidar, pose, (0.0, 0.0), random)
        if self.fault:
            tracker.estimate = lambda: np.zeros(2)
        return tracker


def test_simulate_drives_custom_filter():
    yawed = dataclasses.replace(room(), origin=(3.0, -2.0, 0.5))
    xy = np.column_stack(yawed.grid_to_world([32.0, 32.0, 16.0], [16.0, 72.0, 72.0]))
    found, amcl = (
        simulate(yawed, {"a": Path(xy)}, dataclasses.replace(EXACT, filter=each), drives=12)
        for each in (Wrapped(), SHARP)
    )
    ratio = found.drives["a"].rmse.value / amcl.drives["a"].rmse.value
    assert 0.5 < ratio < 1.5
    assert found.drives["a"].rmse.value < 0.1
    assert found.summary()["robot"]["filter"]["title"] == "a filter of my own"
    assert "a filter of my own" in found.report()
    again = simulate(yawed, {"a": Path(xy)}, found.robot, drives=12, threads=1)
    assert (again.drives["a"].errors == found.drives["a"].errors).all()


def test_odometry_filter_drifts_with_odometry():
    deaf = Robot(EXACT.lidar, filter=Deaf(), disturbances=EXACT.disturbances)
    found = simulate(room(), THROUGH, deaf.with_settings({"distance_bias": 0.1}), drives=40)
    errors = found.drives["through"].errors
    assert errors[:, 0, :2].std() == pytest.approx(deaf.disturbances.start_sigma, rel=0.25)
    at = np.searchsorted(found.drives["through"].distance, 7.0)
    assert errors[:, at, 0].std() == pytest.approx(0.7, rel=0.3)


def test_amcl_functions_reject_custom_filter(tmp_path):
    robot = dataclasses.replace(EXACT, filter=Wrapped())
    for asked in (
        lambda: tune(room(), robot, paths=5, drives=2),
        lambda: robot.with_settings({"alpha1": 0.1}),
        lambda: robot.save(tmp_path / "robot.yaml"),
    ):
        with pytest.raises(ConfigError, match=r"a filter of my own.* is not AMCL") as caught:
            asked()
        assert "\n" not in str(caught.value)
    with pytest.raises(LocplanError, match=r"a filter of my own: estimate\(\) must be three"):
        simulate(room(), THROUGH, dataclasses.replace(EXACT, filter=Wrapped(fault="x")), drives=2)


def test_filters_of_users_are_checked():
    check_filter(Amcl(**FEW))
    check_filter(Deaf())


def test_check_filter_scans_match_map():
    class Looking(Deaf):
        def start(self, grid, lidar, pose, *more):
            self.grid, self.lidar = grid, lidar
            return self.begun(pose)

        def scan(self, ranges):
            at = self.pose[2] + self.lidar.angles
            ends = [np.cos(at), np.sin(at)] * ranges + self.pose[:2, None]
            rows, cols = np.round(self.grid.world_to_grid(*ends), 3)
            walls = np.isin(rows, (1, 39)) | np.isin(cols, (1, 59))
            assert walls.all()  # on the inner face
            inside = (slice(1, -1),) * 2
            assert (self.grid.cells[inside] == FREE).all()

    check_filter(Looking())


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("frame", "far from the robot"),
        ("seed", "equal seeds"),
        ("shape", "three finite"),
        ("size", r"must be \(3, 3\), not \(2, 2\)"),
        ("symmetry", "symmetric"),
        ("sign", "negative"),
    ],
)
def test_check_filter_names_fault(fault, said):
    with pytest.raises(LocplanError, match=said):
        check_filter(Deaf(fault))


def test_equal_filter_map_keeps_errors():
    assert np.array_equal(errors(), errors(room()))


def test_shifted_filter_map_increases_error():
    assert mean_error(None) < 0.06
    assert mean_error(shifted_wall()) > 0.15


def mean_error(filter_map, robot=EXACT):
    return np.hypot(*errors(filter_map, robot)[..., :2].T).mean()


def padded(*cells):
    """The room with unknown cells below, above, to the left and to the right of it."""
    below, above, left, right = cells
    grown = np.pad(room().cells, ((below, above), (left, right)), constant_values=127)
    return OccupancyGrid(grown, 0.125, (-0.125 * left, -0.125 * below, 0.0))


def test_filter_map_may_have_other_origin():
    around, further = padded(24, 24, 24, 24), padded(28, 40, 36, 24)
    assert errors(further) == pytest.approx(errors(around), abs=1e-6)


def finer():
    return OccupancyGrid(np.repeat(np.repeat(room().cells, 2, 0), 2, 1), 0.0625)


def test_filter_uses_finer_or_turned_map():
    turned = OccupancyGrid(np.rot90(room().cells, -1), 0.125, (0.0, 8.0, -np.pi / 2))
    assert mean_error(finer()) < 0.06
    assert mean_error(turned) < 0.06
    assert np.abs(errors(turned)[..., 2]).mean() < 0.05


def test_errors_are_in_world_frame():
    """The filter's map is turned by a quarter."""
    turned = OccupancyGrid(np.rot90(room().cells, -1), 0.125, (0.0, 8.0, -np.pi / 2))
    unseen = dataclasses.replace(
        EXACT,
        lidar=Lidar(range=0.2, beams=9),
        disturbances=dataclasses.replace(QUIET, start_sigma=0.0, start_sigma_deg=0.0),
        odometry=Odometry(
            distance_bias=0.0, distance_drift=0.3, heading_drift_deg=0.0, heading_bias_deg=0.0
        ),
    )
    half = 40  # while the robot drives along x
    for filter_map in (None, turned):
        x, y = np.abs(errors(filter_map, unseen)[:, half, :2]).mean(axis=0)
        assert x > 2 * y


def test_simulate_rejects_distant_filter_map():
    far = OccupancyGrid(room().cells, 0.125, (100.0, 0.0, 0.0), "far")
    with pytest.raises(ConfigError, match=r"map \(far\) and room do not overlap"):
        errors(far)
    with pytest.raises(ConfigError, match="a filter's map is of one map, not of 2"):
        tune([room(), room()], EXACT, filter_map=room())


@pytest.mark.long
def test_simulating_functions_accept_filter_map(tmp_path):
    grid, old = room(), shifted_wall()
    costs = Costmap.from_field(covariance_field(grid, Sad()), robot=0.3)
    query = [Query("one", (2.0, 4.0), (9.0, 4.0))]
    chosen = [
        recommend_path(
            *(grid, query[0].start, query[0].goal, EXACT),
            costs=costs,
            settings=RecommendationSettings(drives=4, filter_map=m),
        )
        for m in (None, grid, old)
    ]
    error = [each.shortest.driven.error.value for each in chosen]
    assert error[0] == error[1] < error[2]
    chosen[2].save(tmp_path)
    assert Recommendation.load(tmp_path) == chosen[2] != chosen[0]
    assert chosen[2].summary()["about"]["filter_map"] == {"name": "old", "digest": old.digest}
    aware = [simulate_queries(costs, query, EXACT, drives=4, filter_map=m) for m in (None, old)]
    assert aware[0].rmse[0] < aware[1].rmse[0]
    own = {"paths": 5, "drives": 2}
    results = [tune(grid, EXACT, filter_map=m, **own) for m in (None, grid, old, finer())]
    tuned = [result.choice.results[0].error.value for result in results]
    assert tuned[0] == tuned[1] < tuned[2]
    assert tuned[3] < tuned[2]
    assert aware[1].description["filter_map"] == {"name": "old", "digest": old.digest}


@pytest.mark.long
def test_replay_uses_filter_map():
    grid, old = room(), shifted_wall()
    back = Path(np.array([[1.5, 4.0], [9.5, 4.0], [9.5, 2.0], [10.5, 4.0], [1.5, 4.2]] * 2))
    drive = simulate_recording(grid, make_path_poses(back, grid)[::4])
    runs = [replay(drive, grid, EXACT, runs=4, filter_map=m) for m in (None, grid, old)]
    assert np.array_equal(runs[0].errors, runs[1].errors)
    assert runs[0].drives.rmse.value < runs[2].drives.rmse.value
    tuned = [tune_on_drive(drive, grid, EXACT, drives=2, filter_map=m) for m in (None, old)]
    errors = [
        next(row.error.value for row in each.choice.results if row.case in each.choice.recordings)
        for each in tuned
    ]
    assert errors[0] < errors[1]
    assert tuned[1].grids == (grid,)
    assert tuned[1].filter_map is old


def rmse_simulated(about):
    return next(v[0] for k, v in about["paths"]["through"].items() if k.startswith("rmse"))


COMMANDS = {
    "simulate": (("--path", "through.csv"), rmse_simulated),
    "plan": (
        ("--start", "2,4", "--goal", "9,2", "--stride", "0.8"),
        lambda about: about["candidates"][0]["driven"]["error"][0],
    ),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_use_filter_map_option(command, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_map(room(), "room.yaml")
    save_map(shifted_wall(), "old.yaml")
    THROUGH["through"].save("through.csv")
    options, error_of = COMMANDS[command]
    own = "--lidar", "rplidar-a1", "--set", "range=5", "--drives", "4", "--json"
    own += "--set", "min_particles=100", "--set", "max_particles=200"
    error = []
    for extra in ("room.yaml", "old.yaml"):
        code, out, err = run(command, "room.yaml", *options, *own, "--filter-map", extra)
        assert code == 0, err
        error.append(error_of(json.loads(out)))
    assert error[0] < error[1]

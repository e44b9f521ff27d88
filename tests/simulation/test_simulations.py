"""Simulated drives: frames, physics, AMCL's settings, and reported results."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from support.maps import corridor

import locplan
from locplan import FieldConfig, Lidar, LocplanError, OccupancyGrid, Path
from locplan._support.records import extract_values
from locplan.field import Sad, Scan
from locplan.field.config import SHORT_LIDAR
from locplan.field.sad import Exponential
from locplan.maps import FREE, OCCUPIED, environments
from locplan.planning import Query
from locplan.planning.plans import AWARE, SHORTEST
from locplan.robots import Amcl, Disturbances, Robot
from locplan.robots.amcl import OMNIDIRECTIONAL
from locplan.robots.nav2 import read_amcl
from locplan.simulation import Drives, Simulator, drive_open, simulate
from locplan.simulation.drives import DRIVE_COLUMNS, LOST_DISTANCE, compute_rmse_ratio
from locplan.simulation.figures import simulation_figure
from locplan.simulation.query_routes import QueryDrives, Routes, RoutesOnMaps, simulate_queries
from locplan.simulation.worlds import make_path_poses

pytestmark = pytest.mark.usefixtures("undrawn")

QUIET = {
    "boundary_noise": 0.0,
    "outliers": 0.0,
    "occlusion": 0.0,
    "distance_drift": 0.0,
    "heading_drift_deg": 0.0,
    "turn_drift_deg": 0.0,
    "distance_bias": 0.0,
    "heading_bias_deg": 0.0,
    "turn_bias": 0.0,
    "start_sigma": 0.0,
    "start_sigma_deg": 0.0,
}
ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
STILL = {"alpha1": 0.0, "alpha2": 0.0, "alpha3": 0.0, "alpha4": 0.0}
FEW = {"min_particles": 300, "max_particles": 300}


@pytest.fixture(scope="module")
def two_corridors():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def in_room():
    """A path in the well-marked room of two_corridors."""
    return Path(np.array([[2.0, 3.0], [5.0, 3.0], [5.5, 9.5]]))


def open_space(metres=40.0, resolution=0.1):
    return OccupancyGrid(np.full((int(metres / resolution),) * 2, FREE), resolution)


def test_poses_follow_path_facing_ahead(two_corridors, in_room):
    poses = make_path_poses(in_room, two_corridors)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps.max() <= 0.05 + 1e-9
    assert poses[0, :2].tolist() == [2.0, 3.0]
    assert poses[-1, :2] == pytest.approx([5.5, 9.5])
    assert poses[0, 2] == 0
    assert poses[-1, 2] == pytest.approx(math.atan2(6.5, 0.5))
    assert abs(np.diff(poses[:, 2])).max() < 0.5
    headed = Path(in_room.xy, np.array([1.0, 2.0, 3.0]))
    assert make_path_poses(headed, two_corridors)[[0, -1], 2].tolist() == [1.0, 3.0]


def test_turns_in_place_have_small_steps(two_corridors):
    back = Path(np.array([[2.0, 3.0], [5.0, 3.0], [2.0, 3.0]]))
    poses = make_path_poses(back, two_corridors)
    assert abs(np.diff(poses[:, 2])).max() <= 0.1 + 1e-9
    assert abs(poses[-1, 2]) == pytest.approx(math.pi)
    turned = Path(np.array([[2.0, 3.0], [5.0, 3.0], [5.0, 3.0]]), np.array([0.0, 0.0, 2.0]))
    poses = make_path_poses(turned, two_corridors)
    assert abs(np.diff(poses[:, 2])).max() <= 0.1 + 1e-9
    assert poses[-1].tolist() == [5.0, 3.0, 2.0]


@pytest.mark.parametrize(
    ("xy", "reason"),
    [
        ([[2.0, 3.0]], "has no length"),
        ([[2.0, 3.0], [2.0, 3.0]], "has no length"),
        ([[2.0, 3.0], [20.0, 8.0]], "leaves the free cells of two_corridors at"),
        ([[2.0, 3.0], [-50.0, 3.0]], "which reaches from -0.6,-0.6 to 40.6,15.2 m, at"),
    ],
)
def test_simulation_rejects_undrivable_path(two_corridors, xy, reason):
    with pytest.raises(LocplanError, match=reason):
        make_path_poses(Path(np.array(xy)), two_corridors)


def test_noiseless_filter_is_exact_without_walls():
    grid = open_space()
    path = Path(np.array([[10.0, 10.0], [30.0, 12.0], [30.0, 20.0]]))
    result = simulate(
        grid,
        {"a": path},
        robot=Robot(filter=Amcl(**STILL, **FEW)).with_settings(QUIET),
        drives=2,
    )
    assert abs(result.drives["a"].errors).max() < 1e-9


def test_half_cell_shifts_estimate_back(two_corridors, in_room):
    amcl = Amcl(laser_model_type="likelihood_field_prob", **dict.fromkeys(ALPHAS, 0.02))
    both = [
        simulate(
            two_corridors,
            {"a": in_room},
            robot=Robot(filter=amcl).with_settings({**QUIET, "half_cell": half_cell}),
            drives=20,
        ).drives["a"]
        for half_cell in (True, False)
    ]
    shifts = [each.errors[:, 20:, :2].mean(axis=(0, 1)) for each in both]
    half = two_corridors.resolution / 2
    assert shifts[0] - shifts[1] == pytest.approx([-half, -half], abs=0.3 * half)


def test_odometry_drifts_without_walls():
    grid = open_space()
    path = Path(np.array([[10.0, 20.0], [30.0, 20.0]]))
    result = simulate(
        grid,
        {"a": path},
        robot=Robot(filter=Amcl(**STILL, **FEW)).with_settings({**QUIET, "distance_bias": 0.05}),
        drives=200,
    )
    errors = result.drives["a"].errors
    assert errors[:, -1, 0].std() == pytest.approx(20 * 0.05, rel=0.15)
    assert abs(errors[..., 1]).max() < 1e-9
    halfway = errors.shape[1] // 2
    assert errors[:, halfway, 0] == pytest.approx(errors[:, -1, 0] / 2, rel=0.02)


def test_walls_correct_bad_odometry(two_corridors, in_room):
    poor = {"boundary_noise": 0.0, "distance_bias": 0.1, "heading_bias_deg": 5.0}
    seeing, not_seeing = (
        simulate(two_corridors, {"a": in_room}, robot=Robot(lidar).with_settings(poor), drives=20)
        .drives["a"]
        .rmse.value
        for lidar in (SHORT_LIDAR, Lidar(range=0.2))
    )
    assert seeing < 0.25
    assert not_seeing > 2 * seeing


@pytest.mark.parametrize("angle", [0.0, math.pi / 6, math.pi / 2])
def test_corridor_error_lies_along_corridor(angle):
    grid = corridor(40.0, 2.0, angle=angle, resolution=0.1)
    ahead = np.array([math.cos(angle), math.sin(angle)])
    path = Path(np.array([-6.0 * ahead, 6.0 * ahead]))
    amcl = Amcl(laser_model_type="likelihood_field_prob")
    errors = simulate(grid, {"a": path}, robot=Robot(filter=amcl), drives=40).drives["a"].errors
    along = errors[..., :2] @ ahead
    across = errors[..., :2] @ np.array([-ahead[1], ahead[0]])
    assert along[:, -1].std() > 4 * across[:, -1].std()


def test_errors_turn_with_map_yaw(two_corridors, in_room):
    yaw, shift = 0.7, np.array([3.0, -5.0])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    origin = np.array(two_corridors.origin[:2])
    turned = dataclasses.replace(two_corridors, origin=(*(turn @ origin + shift), yaw))
    paths = in_room, Path(in_room.xy @ turn.T + shift)
    plain, other = (  # routes of other maps have other random numbers
        drive_open(Simulator(grid), {"a": path}, range(6), route=1)["a"]
        for grid, path in zip((two_corridors, turned), paths, strict=True)
    )
    assert other.errors[..., :2] == pytest.approx(plain.errors[..., :2] @ turn.T, abs=1e-6)
    assert other.errors[..., 2] == pytest.approx(plain.errors[..., 2], abs=1e-6)


def test_drives_depend_only_on_seed(two_corridors, in_room):
    other = Path(np.array([[2.0, 3.0], [4.0, 3.0]]))
    every = {"in room": in_room, "other": other}
    first = simulate(two_corridors, every, drives=6, threads=2).drives["other"].errors
    again = simulate(two_corridors, {"alone": other}, drives=6, threads=1).drives["alone"].errors
    fewer = simulate(two_corridors, {"alone": other}, drives=3).drives["alone"].errors
    assert (first == again).all()
    assert (first[:3] == fewer).all()
    another = simulate(two_corridors, {"alone": other}, drives=6, seed=2).drives["alone"].errors
    assert not (first == another).any(axis=(1, 2)).any()


def test_paths_may_be_arrays(two_corridors, in_room):
    one, other = (
        simulate(two_corridors, {"a": path}, drives=2).drives["a"].errors
        for path in (in_room, in_room.xy.tolist())
    )
    assert (one == other).all()


def test_worlds_differ_from_map(two_corridors):
    simulator = Simulator(two_corridors, robot=Robot(disturbances=Disturbances(worlds=3)))
    stops = [world[0, 1:-1, 1:-1] == 0 for world in simulator.worlds]
    walls = two_corridors.cells == OCCUPIED
    assert len(stops) == 3
    assert all(0.03 < (each != walls).sum() / walls.sum() < 0.5 for each in stops)
    assert (stops[0] != stops[1]).any()
    assert (
        len(
            Simulator(
                two_corridors, robot=Robot(disturbances=Disturbances(boundary_noise=0.0))
            ).worlds
        )
        == 1
    )


def test_lost_drives_and_their_intervals(two_corridors):
    short = Path(np.array([[2.0, 3.0], [30.0, 3.0]]))
    drives = simulate(two_corridors, {"a": short}, drives=30).drives["a"]
    assert drives.lost.tolist() == (drives.position_error > LOST_DISTANCE).any(axis=1).tolist()
    assert 0 < drives.lost_rate.low < drives.lost_rate.value < drives.lost_rate.high < 1
    assert drives.off_at_end.tolist() == (drives.position_error[:, -1] > LOST_DISTANCE).tolist()
    assert drives.off_at_end_rate.value == drives.off_at_end.mean()
    mean_square = (drives.errors[..., :2] ** 2).sum(axis=2).mean()
    assert drives.rmse.value == pytest.approx(math.sqrt(mean_square))
    assert drives.rmse.low < drives.rmse.value < drives.rmse.high
    kept = drives.position_error[~drives.lost]
    assert drives.kept_rmse.value == pytest.approx(math.sqrt((kept**2).mean()))
    assert drives.kept_rmse.low < drives.kept_rmse.value < drives.kept_rmse.high < LOST_DISTANCE
    assert drives.median_error.value == np.median(drives.position_error)
    assert drives.median_error.low < drives.median_error.value < drives.median_error.high
    about = extract_values(DRIVE_COLUMNS, drives)
    assert about["median_error"] == list(drives.median_error)
    assert about["kept_rmse"] == list(drives.kept_rmse)
    assert drives.profile().shape == (len(drives.poses), 9)
    assert compute_rmse_ratio(drives, drives) == pytest.approx((1, 1, 1))


def test_legend_fits_figure_of_narrow_map():
    cells = np.full((160, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    paths = {
        "shortest": np.array([[1.0, 1.0], [1.0, 14.0]]),
        "localizability-aware": np.array([[1.0, 1.0], [5.0, 7.0], [1.0, 14.0]]),
    }
    figure = simulation_figure(simulate(OccupancyGrid(cells, 0.1), paths, drives=6))
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert "localizability-aware: 15.3 m, median error" in figure.legends[0].texts[1].get_text()


def test_lost_drives_leave_kept_rmse_undefined():
    poses = np.column_stack([np.linspace(0, 9, 10), np.zeros((10, 2))])
    errors = np.zeros((6, 10, 3))
    errors[:, 4, 1] = 2 * LOST_DISTANCE
    drives = Drives(poses, errors)
    assert drives.lost.all()
    assert np.isnan(drives.kept_rmse).all()
    assert extract_values(DRIVE_COLUMNS, drives)["kept_rmse"] == [None] * 3
    assert drives.median_error == (0.0, 0.0, 0.0)
    errors[:2, 4, 1] = LOST_DISTANCE / 2  # two are too few for an interval
    kept = Drives(poses, errors).kept_rmse
    assert kept.value == pytest.approx(LOST_DISTANCE / 2 / math.sqrt(10))
    assert np.isnan(kept[1:]).all()


def at_places(name, ends, drives):
    grid = environments.make(name, resolution=0.1)
    costs = locplan.Costmap.from_field(
        locplan.covariance_field(grid, FieldConfig(stride=0.4)), weight=4.0, robot=0.25
    )
    marks = environments.place_positions(name)
    query = Query(name, *(marks[end] for end in ends))
    return simulate_queries(costs, [query], drives=drives)


def test_aware_path_helps_in_two_corridors():
    routes = at_places("two_corridors", ("start", "goal"), 16)
    assert routes.routes[0].summary["rmse_ratio"][2] < 0.6
    assert routes.lost[0] > 0.3
    assert routes.lost[1] <= routes.lost[0] / 2


@pytest.mark.long
def test_aware_path_helps_in_hall():
    routes = at_places("hall", ("start", "goal"), 10)
    assert routes.routes[0].summary["rmse_ratio"][2] < 0.7
    assert routes.verdict == "too few queries"
    (row,) = routes.table().records()
    both = routes.routes[0].summary["paths"]
    for name, path in (("shortest", SHORTEST), ("aware", AWARE)):
        assert row[f"median_error_{name}"] == both[path]["median_error"][0]
        assert row[f"lost_{name}"] == both[path]["lost_rate"][0]
        kept = both[path]["kept_rmse"][0]  # none if all drives are lost
        assert row[f"kept_rmse_{name}"] == kept
        assert row[f"rmse_{name}"] == both[path]["rmse"][0]
    (about,) = json.loads(json.dumps(RoutesOnMaps((routes,)).summary(), allow_nan=False))["maps"]
    assert about["median_error"] == pytest.approx(routes.routes[0].median_error)
    assert about["queries"][0]["name"] == "hall"


def test_kept_rmse_skips_lost_queries(monkeypatch):
    ends = Query("a", (0, 0), (9, 0))
    routes = [
        QueryDrives(ends, (9.0, 9.0), (0.1, 0.1), lost, lost, kept, (1.0, 1.0), {})
        for lost, kept in (((0.0, 0.0), (0.2, 0.4)), ((0.5, 0.5), (0.8, 0.1)))
    ]
    errors = (2.0, 0.1), (1.0, 0.0), (1.0, 0.0), (math.nan, 0.1), (2.0, 0.1)
    lost = QueryDrives(ends, (9.0, 9.0), *errors, {})
    grid = open_space(4.0)
    assert Routes(grid, [*routes, lost], {}).kept_rmse == pytest.approx((0.4, 0.2))
    only = Routes(grid, [lost], {})
    assert np.isnan(only.kept_rmse).all()
    (about,) = RoutesOnMaps((only,)).summary()["maps"]
    assert about["kept_rmse"] == [None, None]
    monkeypatch.setenv("COLUMNS", "110")
    table = RoutesOnMaps((only,)).report()
    assert "- -> -" in table
    assert "100% -> 0%" in table


def test_simulate_queries_skips_unreachable_goals(two_corridors):
    field = locplan.covariance_field(two_corridors, FieldConfig(Sad(range=1.0), stride=1.0))
    costs = locplan.Costmap.from_field(field, robot=0.25)
    away = np.full(two_corridors.shape, False)
    away[:, 150:160] = True
    cut = costs.with_blocked(away)
    near, far = Query("near", (2, 3), (6, 3)), Query("far", (2, 3), (38, 3))
    routes = simulate_queries(cut, [near, far], drives=2)
    assert [route.query.name for route in routes.routes] == ["near"]
    assert routes.description["robot"]["lidar"]["range"] == 1.0  # that of the field
    with pytest.raises(LocplanError, match="no query has a path"):
        simulate_queries(cut, [far], drives=2)


def drives_with(position_errors):
    """Drives whose position errors (drives, n) are known."""
    errors = np.zeros((*np.shape(position_errors), 3))
    errors[..., 0] = position_errors
    return Drives(np.zeros((errors.shape[1], 3)), errors)


def test_rmse_interval_has_stated_coverage():
    random, inside = np.random.default_rng(0), 0
    for _ in range(400):
        low, high = drives_with(np.sqrt(random.lognormal(0.0, 1.0, (60, 1)))).rmse[1:]
        inside += low <= math.sqrt(math.exp(0.5)) <= high
    assert 0.88 < inside / 400 < 0.98


def test_ratio_interval_has_stated_coverage():
    random, inside = np.random.default_rng(0), 0
    for _ in range(400):
        a, b = map(drives_with, random.lognormal(0.0, 1.0, (2, 60, 1)))
        low, high = compute_rmse_ratio(a, b)[1:]
        inside += low <= 1 <= high
    assert 0.92 < inside / 400 < 0.98


def test_median_interval_has_stated_coverage():
    random = np.random.default_rng(0)
    inside = plain = 0
    for _ in range(400):
        trials = random.normal(0.0, 1.0, (30, 1)) + random.normal(0.0, 0.5, (30, 20))
        low, high = drives_with(np.exp(trials)).median_error[1:]
        inside += low <= 1 <= high
        # Poses of one drive that are taken for drives.
        low, high = drives_with(np.exp(trials).reshape(-1, 1)).median_error[1:]
        plain += low <= 1 <= high
    assert 0.92 < inside / 400 < 0.98
    assert plain / 400 < 0.6


def test_intervals_of_too_few_drives():
    few = drives_with([[1.0, 2.0], [3.0, 4.0]])
    assert few.median_error.value == 2.5
    for interval in (few.median_error, few.rmse, few.typical_rmse, few.final_rmse):
        assert np.isnan(interval[1:]).all()
    assert few.rmse.value == pytest.approx(math.sqrt(7.5))
    still = drives_with(np.zeros((5, 3)))
    assert still.rmse.value == still.median_error.value == 0.0
    two = drives_with([[2.0], [8.0]])
    assert two.typical_rmse.value == pytest.approx(4.0)
    assert compute_rmse_ratio(two, drives_with([[1.0], [1.0]])).value == pytest.approx(4.0)
    assert np.isnan(drives_with([[2 * LOST_DISTANCE]] * 6).kept_rmse).all()


# Settings of AMCL

NAV2 = {
    "alpha1": 0.2,
    "alpha2": 0.2,
    "alpha3": 0.2,
    "alpha4": 0.2,
    "alpha5": 0.2,
    "robot_model_type": "nav2_amcl::DifferentialMotionModel",
    "laser_likelihood_max_dist": 2.0,
    "laser_max_range": 100.0,
    "laser_min_range": -1.0,
    "laser_model_type": "likelihood_field",
    "max_beams": 60,
    "max_particles": 2000,
    "min_particles": 500,
    "pf_err": 0.05,
    "pf_z": 0.99,
    "recovery_alpha_fast": 0.0,
    "recovery_alpha_slow": 0.0,
    "resample_interval": 1,
    "sigma_hit": 0.2,
    "update_min_a": 0.2,
    "update_min_d": 0.25,
    "z_hit": 0.5,
    "z_rand": 0.5,
}
"""Parameters that nav2_amcl declares (amcl_node.cpp), with their defaults."""


def test_amcl_defaults_equal_nav2():
    assert dataclasses.asdict(Amcl()) == {**NAV2, "half_cell": True}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"laser_model_type": "beam"}, "laser_model_type must be one of likelihood_field,"),
        ({"alpha1": -0.1}, "alpha1 must be at least 0, not -0.1"),
        ({"sigma_hit": 0.0}, "sigma_hit must be positive"),
        ({"z_hit": 1.5}, "z_hit must be 0 to 1"),
        ({"z_hit": 0.0, "z_rand": 0.0}, "one of z_hit and z_rand"),
        ({"max_beams": 1}, "max_beams must be a whole number of at least 2"),
        ({"max_particles": 100}, "must not exceed max_particles"),
        ({"min_particles": 2.5}, "min_particles must be a whole number"),
        ({"pf_err": math.nan}, "pf_err must be positive"),
        ({"update_min_d": "0.25"}, "a number of at least 0, not '0.25'; remove the quotes"),
        ({"max_beams": "60"}, "not '60'; remove the quotes"),
        ({"sigma_hit": "0.2"}, "must be a positive number, not '0.2'; remove the quotes"),
        ({"update_min_d": "far"}, "update_min_d must be a number of at least 0, not 'far'"),
        ({"robot_model_type": "tricycle"}, "robot_model_type must be one of nav2_amcl::Diff"),
        ({"half_cell": 1}, "half_cell must be a bool, not 1; give true or false"),
    ],
)
def test_impossible_filters_are_refused(changes, reason):
    with pytest.raises(LocplanError, match=reason):
        Amcl(**changes)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"boundary_noise": 1.5}, "boundary_noise must be 0 to 1"),
        ({"worlds": 0}, "worlds must be a whole number in 1..1000"),
        ({"distance_drift": -1.0}, "distance_drift must be at least 0"),
        ({"occlusion_deg": 400.0}, "occlusion_deg must be 0 to 360"),
    ],
)
def test_robot_rejects_bad_disturbances(changes, reason):
    with pytest.raises(LocplanError, match=reason):
        Robot().with_settings(changes)


def test_beams_are_thinned_like_amcl():
    grid = open_space(4.0)
    for beams, expected in ((360, 60), (61, 61), (20, 20), (1081, 61)):
        sensor = Lidar(range=6.0, field_of_view_deg=180.0, beams=beams)
        assert Simulator(grid, robot=Robot(sensor)).arguments.lidar.angles.size == expected
    product = Amcl(laser_model_type="likelihood_field_prob")  # takes every n-th, never more
    for beams, expected in ((360, 60), (61, 31), (20, 20), (1081, 57)):
        sensor = Lidar(range=6.0, field_of_view_deg=180.0, beams=beams)
        lidar = Simulator(grid, robot=Robot(sensor, filter=product)).arguments.lidar
        assert lidar.angles.size == expected
    assert (
        Simulator(grid, robot=Robot(filter=Amcl(laser_max_range=3.0))).arguments.lidar.max_range
        == 3.0
    )
    assert (
        Simulator(grid, robot=Robot(filter=Amcl(laser_max_range=-1.0))).arguments.lidar.max_range
        == 6.0
    )


def test_amcl_is_read_from_nav2s_parameters(tmp_path):
    file = tmp_path / "nav2.yaml"
    file.write_text(
        "amcl:\n  ros__parameters:\n    alpha1: 0.05\n    max_particles: 800\n"
        "    base_frame_id: base\n    robot_model_type: mine::Tricycle\n"
        "    alfa2: 0.1\n    do_beamskip: true\n    half_cell: false\n"
    )
    left_out = r"nav2.yaml: not simulated: robot_model_type, alfa2, half_cell$"
    with pytest.warns(UserWarning, match=left_out):
        amcl = read_amcl(file)
    assert amcl == Amcl(alpha1=0.05, max_particles=800)
    sideways = "amcl:\n  ros__parameters:\n    alpha5: 0.1\n    laser_min_range: 0.3\n"
    for name in (OMNIDIRECTIONAL, "omnidirectional"):
        file.write_text(f"{sideways}    robot_model_type: {name}\n")
        expected = Amcl(alpha5=0.1, laser_min_range=0.3, robot_model_type=OMNIDIRECTIONAL)
        assert read_amcl(file) == expected
    file.write_text("amcl:\n  ros__parameters:\n    laser_model_type: beam\n")
    with pytest.warns(UserWarning, match="AMCL's beam model is not simulated"):
        assert read_amcl(file).laser_model_type == "likelihood_field"
    file.write_text("planner_server:\n  ros__parameters:\n    a: 1\n")
    with pytest.raises(LocplanError, match="has no parameters of amcl"):
        read_amcl(file)


def test_simulate_rejects_bad_arguments(two_corridors, in_room):
    for options, reason in (
        ({"drives": 1}, "drives must be a whole number in 2..100000"),
        ({"seed": -1}, "seed must be"),
        ({"threads": 0}, "threads must be a whole number of at least 1"),
        ({"drives": 2.5}, "drives must be a whole number"),
    ):
        with pytest.raises(LocplanError, match=reason):
            simulate(two_corridors, {"a": in_room}, **options)
    with pytest.raises(LocplanError, match="at least one path"):
        simulate(two_corridors, {})


# Settings in files


def test_loaded_config_equals_saved_config(tmp_path):
    for n, config in enumerate(
        (
            FieldConfig(Sad(weights=Exponential(0.2), noise_level=0.3)),
            FieldConfig(Sad.paper(range=8.0)),
            FieldConfig(Scan(Lidar.preset("utm-30lx"))),
        )
    ):
        locplan.save_config(config, tmp_path / f"{n}.json")
        assert locplan.load_config(tmp_path / f"{n}.json") == config
    (tmp_path / "bare.json").write_text('{"stride": 0.4}')
    assert locplan.load_config(tmp_path / "bare.json") == FieldConfig(stride=0.4)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("no json", "is no JSON"),
        ("[1]", "must hold settings of a field"),
        ('{"config": {"tua": 1}}', "FieldConfig has no setting 'tua'"),
        (
            '{"estimator": {"name": "sad", "weights": {"name": "exponential", "tau": 0}}}',
            "tau must be a positive number",
        ),
        (
            '{"estimator": {"name": "sad", "window": {"half_width": 1e9}}}',
            "half_width must be at most 1000 times step",
        ),
        ('{"estimator": {"name": "scan", "lidar": {"reach": 3}}}', "Lidar has no setting 'reach'"),
    ],
)
def test_load_config_rejects_bad_file(tmp_path, text, reason):
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(LocplanError, match=reason):
        locplan.load_config(tmp_path / "c.json")
    with pytest.raises(LocplanError, match="there is no such file"):
        locplan.load_config(tmp_path / "missing.json")
    with pytest.raises(LocplanError, match="must end in"):
        locplan.save_config(FieldConfig(), tmp_path / "c.yaml")

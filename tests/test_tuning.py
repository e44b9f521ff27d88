"""Tuning of AMCL: how presets compete, how the best one is judged, and the files it writes."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, save_map
from locplan.robots import Amcl, Disturbances, Lidar, Robot, read_amcl
from locplan.robots.presets import PRECISE, SAFE, amcl_presets, with_changes
from locplan.simulation import (
    BeamsLeft,
    Case,
    DisturbanceLevel,
    Tuning,
    TuningBench,
    choose_settings,
    plan_random_paths,
    poses_along,
    simulate,
    simulated_cases,
    tune,
    tuning_figure,
)
from locplan.simulation.verdict import DriveSet

FEW = {"min_particles": 30, "max_particles": 60}
LIDAR = Lidar(range=6.0, beams=60)


def hall(name="hall") -> OccupancyGrid:
    """A hall of 14 x 8 m with four pillars."""
    cells = np.full((80, 140), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for row, col in ((20, 30), (50, 60), (25, 90), (55, 115)):
        cells[row : row + 6, col : col + 6] = OCCUPIED
    return OccupancyGrid(cells, 0.1, name=name)


@pytest.fixture(scope="module")
def tuning():
    return tune(hall(), robot=Robot(LIDAR, filter=Amcl(**FEW)), paths=8, drives=2, threads=2)


LINE = np.column_stack([np.arange(101) * 0.05, np.zeros(101), np.zeros(101)])


def case_of(error_of, name="usual", **kinds):
    """A case of eight lines with known errors: a function of the settings and the number.

    It returns the error on all lines, or one for each.
    """

    def drive(amcl, numbers):
        errors = np.concatenate([np.broadcast_to(error_of(amcl, n), 8) for n in numbers])
        return DriveSet(np.log(errors), errors > 1, errors > 1)

    return Case(name, [LINE] * 8, drive, **kinds)


def tune_on(choosing, judging, own=None, drives=2):
    bench = TuningBench(choosing, judging, drives)
    robot = Robot(LIDAR, filter=own or Amcl())
    return choose_settings(bench, robot, [hall()], beams_left=BeamsLeft(60, 60.0))


def error_by_model(amcl, number):
    """A tenth of a metre with one laser model, half of it with the other."""
    return 0.05 if amcl.laser_model_type == "likelihood_field_prob" else 0.1


def test_presets_change_some_of_the_settings():
    own = Amcl(**FEW, max_beams=90)
    settings = [with_changes(own, changes) for changes in amcl_presets(own).values()]
    assert len(set(settings)) == len(settings)
    assert own not in settings
    assert {with_changes(own, SAFE), with_changes(own, PRECISE)} <= {*settings}
    assert {(each.max_beams, each.max_particles) for each in settings} == {(90, 60)}


def test_preset_with_the_users_values_is_left_out():
    own = with_changes(Amcl(), PRECISE)
    names = [*amcl_presets(own)]
    assert "alphas 0.05" not in names
    assert "alphas 0.1" in names
    assert all(with_changes(own, each) != own for each in amcl_presets(own).values())


def test_bench_chooses_preset_with_least_error():
    def error_of(amcl, number):
        return error_by_model(amcl, number) * (0.5 if amcl.alpha1 == 0.1 else 1.0)

    case = case_of(error_of)
    result = tune_on([case], [case])
    assert result.candidate_name == "alphas 0.1, likelihood_field_prob"
    assert result.verdict == "better"
    assert result.changes["alpha3"] == 0.1
    assert result.conclusion.startswith(f"Use {result.candidate_name}: 75 % less error than")


def test_clearly_worse_presets_stop_early():
    case = case_of(error_by_model)
    drives = {preset.name: preset.drives for preset in tune_on([case], [case], drives=4).tried}
    assert drives["alphas 0.05, likelihood_field_prob"] == 32
    assert drives["alphas 0.05"] == 8


def test_fresh_drives_alone_decide():
    """A preset that seems better in the drives that chose it is not used."""
    numbers = []

    def error_of(amcl, number):
        numbers.append(number)
        return error_by_model(amcl, number) if number >= 2 else 0.1

    case = case_of(error_of)
    result = tune_on([case], [case])
    assert {0, 1} < {*numbers}
    assert min(set(numbers) - {0, 1}) > 1000
    assert result.verdict == "no difference"
    assert result.winner == Amcl()
    assert result.changes == {}
    assert result.conclusion.startswith("Keep your settings: ")


def test_case_that_is_worse_contradicts():
    usual = case_of(error_by_model)
    other = case_of(lambda amcl, n: 0.1 / error_by_model(amcl, n) / 10, "x3", decides=False)
    result = tune_on([usual], [usual, other])
    assert result.candidate_verdict.word == "better"
    assert [case.name for case in result.contradicting] == ["x3"]
    assert result.verdict == "undecided"
    assert result.changes == {}
    assert result.conclusion.endswith("better on the other drives, but not here: x3")


@pytest.mark.parametrize(("lost_drives", "word"), [(0, "better"), (1, "undecided")])
def test_single_lost_drive_contradicts_in_strict_case(lost_drives, word):
    def error_of(amcl, number):
        errors = np.full(8, error_by_model(amcl, number))
        errors[:lost_drives] = 1.1 if amcl != Amcl() and number == 0 else errors[0]
        return errors

    usual = case_of(error_by_model)
    lenient = case_of(error_of, "x3", decides=False)
    strict = dataclasses.replace(lenient, name="whole drive", is_strict=True)
    assert tune_on([usual], [usual, strict], drives=8).verdict == word
    assert tune_on([usual], [usual, lenient], drives=8).verdict == "better"


def test_levels_scale_odometry_and_clutter_only():
    robot = Robot(disturbances=Disturbances(outliers=0.3, occlusion=0.6))
    strong = DisturbanceLevel("x3", 3.0, 2.0).apply_to(robot)
    for name in ("distance_drift", "heading_drift_deg", "turn_drift_deg", "turn_bias"):
        expected = 3 * getattr(robot.odometry, name)
        assert getattr(strong.odometry, name) == pytest.approx(expected)
    assert strong.disturbances.boundary_noise == 2 * robot.disturbances.boundary_noise
    assert strong.disturbances.outliers == 0.5  # at most half of the beams
    assert strong.disturbances.occlusion == 0.6  # but never fewer than the robot's
    assert strong.disturbances.start_sigma == robot.disturbances.start_sigma


def test_random_paths_are_seeded_and_cut():
    cells = np.full((12, 500), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    paths, again, others = (plan_random_paths(Costmap.blank(grid), 6, seed) for seed in (3, 3, 4))
    lengths = [path.length for path in paths]
    assert max(lengths) == pytest.approx(16.0)
    assert min(lengths) >= 8 - 1e-9
    for path in paths:
        poses_along(path, grid)  # raises if it leaves the free cells
    assert [path.xy.tolist() for path in paths] == [path.xy.tolist() for path in again]
    assert others[0].xy.tolist() != paths[0].xy.tolist()


def test_small_maps_have_shorter_paths():
    cells = np.full((40, 40), FREE, np.uint8)
    room = OccupancyGrid(cells, 0.1, name="room")
    assert min(path.length for path in plan_random_paths(Costmap.blank(room), 5, 1)) >= 2 - 1e-9
    closet = OccupancyGrid(cells[:10, :10], 0.1, name="room")
    with pytest.raises(ConfigError, match="room: no two positions") as caught:
        plan_random_paths(Costmap.blank(closet), 5, 1)
    assert "larger map" in str(caught.value)


def test_drives_equal_those_of_simulate():
    """A route has the same drives in every command."""
    grid, robot = hall(), Robot(LIDAR, filter=Amcl(**FEW))
    paths = plan_random_paths(Costmap.blank(grid), 2, 1)
    usual, _ = simulated_cases(grid, robot, paths, filter_map=None, label="", seed=5, threads=2)
    drives = simulate(grid, {"a": paths[0], "b": paths[1]}, robot, drives=2, seed=5).drives
    expected = DriveSet.from_drives(drives.values())
    shown = usual.drive(robot.amcl, range(2))
    np.testing.assert_allclose(shown.log_error, expected.log_error)
    assert shown.lost.tolist() == expected.lost.tolist()


def test_several_maps_have_cases_of_their_own():
    robot = Robot(LIDAR, filter=Amcl(min_particles=20, max_particles=20))
    result = tune([hall(), hall()], robot, paths=5, drives=2, threads=2)
    assert [(case.name, case.decides) for case in result.cases] == [
        ("hall usual", True),
        ("hall x3", False),
        ("hall 2 usual", True),
        ("hall 2 x3", False),
    ]
    assert result.candidate_verdict.n_drives == 20
    assert "of each of hall, hall" in result.report()
    about = json.loads(json.dumps(result.summary(), allow_nan=False))
    assert [each["name"] for each in about["maps"]] == ["hall", "hall"]
    with pytest.raises(ConfigError, match="a filter's map is of one map, not of 2"):
        tune([hall(), hall()], filter_map=hall())
    with pytest.raises(ConfigError, match="grid must be"):
        tune([])


def test_report_shows_evidence_and_presets(tuning):
    assert tuning.own == Amcl(**FEW)
    assert tuning.verdict == "better"
    assert tuning.winner == tuning.candidate != tuning.own
    text = tuning.report()
    assert text.startswith(f"{tuning.conclusion}.\n")
    for preset in tuning.tried:
        assert preset.name in text
    assert f"\n{LIDAR.title}: of 60 beams compared, " in text
    assert "\nTo go back, use your own file again" in text
    about = json.loads(json.dumps(tuning.summary(), allow_nan=False))
    assert (about["verdict"], about["map"]["name"]) == ("better", "hall")
    assert len(about["presets"]) == len(amcl_presets(tuning.own))


def test_equal_seeds_give_equal_results_on_any_number_of_threads(tuning):
    calls = []
    again = tune(
        hall(),
        robot=Robot(LIDAR, filter=Amcl(**FEW)),
        paths=8,
        drives=2,
        threads=1,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert again.summary() == tuning.summary()
    assert calls == sorted(calls)
    assert calls[-1] == (1000, 1000)


def test_settings_that_are_not_better_change_nothing(tuning, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS)
    for word in ("undecided", "no difference", "worse"):
        verdict = dataclasses.replace(tuning.candidate_verdict, word=word)
        unclear = dataclasses.replace(tuning, candidate_verdict=verdict)
        assert unclear.winner == tuning.own
        assert unclear.changes == {}
        unclear.save(tmp_path / "out", file)
        assert (tmp_path / "out" / "nav2_params.yaml").read_bytes() == file.read_bytes()
        assert unclear.conclusion.startswith("Keep your settings: ")
        assert unclear.conclusion.endswith(f"times their error: {word}")
        assert unclear.summary()["verdict"] == word


def saved(tuning, folder, params=None):
    """The parameter file in a folder of results."""
    tuning.save(folder, params)
    return folder / "nav2_params.yaml"


def test_a_new_file_has_all_parameters(tuning, tmp_path):
    file = saved(tuning, tmp_path / "out")
    assert read_amcl(file) == tuning.winner
    given = yaml.safe_load(file.read_text())["amcl"]["ros__parameters"]
    assert given["robot_model_type"] == "nav2_amcl::DifferentialMotionModel"
    assert given["scan_topic"] == "scan"
    assert "  # Nav2's default is 2000" in file.read_text()


def test_a_file_that_says_something_else_is_not_left_behind(tuning, tmp_path, monkeypatch):
    edited = "locplan.simulation.tuning._parameters.edited_parameters"
    monkeypatch.setattr(edited, lambda path, *_: path.read_bytes())
    (tmp_path / "mine.yaml").write_text(PARAMS)
    with pytest.raises(LocplanError, match="could not be written as it was meant"):
        saved(tuning, tmp_path / "out", tmp_path / "mine.yaml")
    assert not (tmp_path / "out").exists()


PARAMS = """amcl:
  ros__parameters:
    # mine
    alpha1: 0.2  # set long ago
    min_particles: 30
    max_particles: 60
    do_beamskip: true
    unknown_to_us: [1, 2]
"""


def test_the_users_file_is_copied_with_what_gains(tuning, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS)
    prob = with_changes(tuning.own, PRECISE)
    tried = dataclasses.replace(tuning.tried[0], amcl=prob)
    own = dataclasses.replace(tuning, tried=(tried,), candidate=prob)
    made = saved(own, tmp_path / "out", file)
    with pytest.warns(UserWarning, match="unknown_to_us"):
        assert read_amcl(made) == prob
    text = made.read_text()
    assert "    # mine\n" in text
    assert "alpha1: 0.05  # set long ago\n" in text
    assert "alpha2: 0.05\n" in text
    assert "do_beamskip: false\n" in text  # it has an effect with this model only
    assert "unknown_to_us: [1, 2]\n" in text
    assert file.read_text() == PARAMS


def test_one_of_several_robots_in_a_file_is_tuned(tuning, tmp_path):
    file = tmp_path / "fleet.yaml"
    file.write_text("robot1:\n  amcl:\n    ros__parameters:\n      alpha1: 0.2\n" + PARAMS)
    made = saved(tuning, tmp_path / "out", tmp_path / "fleet.yaml:robot1")
    assert made.read_text().endswith(PARAMS)
    read = Robot.from_nav2(f"{made}:robot1", LIDAR).filter
    assert (read.alpha1, read.max_beams) == (tuning.winner.alpha1, tuning.winner.max_beams)


def test_a_file_that_was_set_otherwise_for_the_run_gets_these_settings_too(tuning, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS.replace("max_particles: 60", "max_particles: 500"))
    made = saved(tuning, tmp_path / "out", file)
    with pytest.warns(UserWarning, match="unknown_to_us"):
        assert read_amcl(made) == tuning.winner


def test_results_are_written_and_drawn(tuning, tmp_path):
    tuning.save(tmp_path / "out")
    names = {each.name for each in (tmp_path / "out").iterdir()}
    assert names == {*Tuning.files.names, "run.yaml"}
    about = json.loads((tmp_path / "out" / "tuning.json").read_text())
    assert about["conclusion"] == tuning.conclusion
    assert about["changes"] == tuning.changes
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == tuning.winner
    labels = [panel.get_ylabel() for panel in tuning_figure(tuning).axes]
    assert labels == ["RMSE of the position [m]", "lost drives (off by > 1 m) [%]"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"paths": 4}, "paths"),
        ({"drives": 1}, "drives"),
        ({"seed": -1}, "seed"),
        ({"robot": 3}, "robot must be a Robot"),
        ({"robot": Robot(footprint=30.0)}, "no cell where the robot fits"),
    ],
)
def test_bad_arguments_are_refused(arguments, words):
    with pytest.raises(LocplanError, match=words) as caught:
        tune(hall(), **arguments)
    assert "\n" not in str(caught.value)


def test_the_command_writes_a_copy_and_keeps_the_users_file(run, tmp_path):
    save_map(hall(), tmp_path / "hall.yaml")
    params = tmp_path / "nav2_params.yaml"
    params.write_text(PARAMS)
    asked = ["tune", tmp_path / "hall.yaml", "--robot", params, "--set", "range=6"]
    asked += ["--paths", 5, "--drives", 2, "--seed", 3]
    for forced in ([], ["--force"]):
        code, _, err = run(*asked, *forced, "-o", tmp_path)
        assert code == 2
        assert "nav2_params.yaml" in err.splitlines()[-1]
        assert params.read_text() == PARAMS
    code, out, _ = run(*asked, "-o", tmp_path / "tuned")
    assert code == 0
    about = json.loads((tmp_path / "tuned" / "tuning.json").read_text())
    assert about["conclusion"] in out
    read = yaml.safe_load((tmp_path / "tuned" / "nav2_params.yaml").read_text())
    read, mine = (each["amcl"]["ros__parameters"] for each in (read, yaml.safe_load(PARAMS)))
    assert read.items() >= about["changes"].items()
    differing = {name for name, value in read.items() if mine.get(name) != value}
    assert differing <= {*about["changes"], "do_beamskip"}
    assert params.read_text() == PARAMS


def test_a_file_that_cannot_be_changed_is_refused_before_the_work(run, tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.simulation.tune", None)
    save_map(hall(), tmp_path / "hall.yaml")
    params = tmp_path / "params.yaml"
    head = "amcl:\n  ros__parameters:\n    "
    for text in (
        "alpha1: &a 0.2\n    pf_err: *a\n",
        "do_beamskip: &a true\n    tf_broadcast: *a\n",
    ):
        params.write_text(head + text)
        options = "--robot", params, "-o", tmp_path / "out"
        code, _, err = run("tune", tmp_path / "hall.yaml", *options)
        assert code == 2
        assert "anchors and aliases" in err
        assert not (tmp_path / "out").exists()

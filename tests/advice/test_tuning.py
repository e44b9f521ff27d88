"""Tuning of AMCL: the choice of a preset, and the files of the result."""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from support.recordings import simulate_recording

from locplan import plan
from locplan.advice import Tuning
from locplan.advice.figures import tuning_figure
from locplan.advice.preset_choice import USER_SETTINGS, LevelCase, choose_preset
from locplan.advice.tuning import (
    cut_path,
    make_simulated_cases,
    plan_random_paths,
    tune,
    tune_on_drive,
)
from locplan.app.cli import main
from locplan.errors import ConfigError, LocplanError, RecordingError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, environments, save_map
from locplan.planning import Costmap, Path
from locplan.recordings import replay
from locplan.robots import PRECISE, SAFE, Amcl, Lidar, Robot, with_preset
from locplan.robots.nav2 import read_amcl
from locplan.robots.presets import list_applicable_presets
from locplan.simulation import LEVELS, NO_FAULT, Drives, simulate
from locplan.simulation.drives import LOST_DISTANCE
from locplan.simulation.verdict import DriveSet
from locplan.simulation.worlds import make_path_poses

pytestmark = pytest.mark.usefixtures("undrawn")

FEW = {"min_particles": 30, "max_particles": 60}
LIDAR = Lidar(range=6.0, beams=60)
PRECISE_SETTINGS, SAFE_SETTINGS = list_applicable_presets(Amcl()).values()


def hall(name="hall") -> OccupancyGrid:
    """A hall of 14 x 8 m with four pillars."""
    cells = np.full((80, 140), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for row, col in ((20, 30), (50, 60), (25, 90), (55, 115)):
        cells[row : row + 6, col : col + 6] = OCCUPIED
    return OccupancyGrid(cells, 0.1, name=name)


@pytest.fixture(scope="module")
def tuning():
    return tune(hall(), robot=Robot(LIDAR, filter=Amcl(**FEW)), paths=5, drives=4, threads=2)


LINE = np.column_stack([np.arange(101) * 0.05, np.zeros(101), np.zeros(101)])


def make_case(errors, off=None, name="usual", fault=""):
    """Return a case of 64 drives with known errors and numbers of drives off at the end.

    Both belong to the user's settings, the precise preset and the safe preset.
    """
    driven = []

    def drive(amcl, numbers):
        place = [Amcl(), PRECISE_SETTINGS, SAFE_SETTINGS].index(amcl)
        driven.append(place)
        is_off = np.arange(64) < (off or (0, 0, 0))[place]
        spread = np.linspace(0.9, 1.1, 64)
        return DriveSet(np.log(errors[place] * spread)[numbers], is_off[numbers], is_off[numbers])

    case = LevelCase(name, drive, (16, 32, 64) if fault else (64,), fault)
    return case, driven


BETTER = 0.2, 0.05, 0.1
OFF_ERROR = LOST_DISTANCE + 0.2


class Recorded:
    """A recording whose replays have known errors, at the end and along the way."""

    name = "drive 1"

    def __init__(self, errors, at_end=None):
        self.errors, self.at_end, self.replayed = errors, at_end or errors, []

    def replay(self, amcl):
        place = [Amcl(), PRECISE_SETTINGS, SAFE_SETTINGS].index(amcl)
        self.replayed.append(place)
        errors = np.zeros((12, len(LINE), 3))
        errors[..., 0] = self.errors[place]
        errors[0, -1, 0] = self.at_end[place]
        return Drives(LINE, errors)


def choose_from_cases(*cases, recordings=(), **options):
    return choose_preset(Amcl(), cases, [LINE], recordings, **options)


def test_presets_change_only_their_parameters():
    own = Amcl(**FEW, max_beams=90)
    precise, safe = list_applicable_presets(own).values()
    assert (safe.update_min_d, safe.update_min_a, safe.alpha1) == (0.1, 0.1, own.alpha1)
    assert {getattr(precise, f"alpha{n}") for n in range(1, 6)} == {0.05}
    assert precise.multiplies_likelihoods
    assert {(each.max_beams, each.max_particles) for each in (precise, safe)} == {(90, 60)}


def test_preset_without_changes_is_dropped():
    assert [*list_applicable_presets(with_preset(Amcl(), PRECISE))] == [SAFE]
    often = Amcl(update_min_d=0.05, update_min_a=0.02)
    assert [*list_applicable_presets(often)] == [PRECISE]
    assert with_preset(often, PRECISE).update_min_d == 0.05


def test_precise_preset_needs_all_levels():
    """Without a recording, it must be rarely off at the end at all levels."""
    usual, _ = make_case(BETTER)
    harmless, _ = make_case(BETTER, (9, 4, 5), "slip", "odometry slips")
    assert choose_from_cases(usual, harmless).name == PRECISE
    short, _ = make_case(BETTER, (60, 60, 60), "standstill", "odometry stands still")
    assert choose_from_cases(usual, harmless, short).name == SAFE
    harmful, _ = make_case(BETTER, (9, 30, 9), "standstill", "odometry stands still")
    choice = choose_from_cases(usual, harmless, harmful)
    assert (choice.name, choice.settings) == (SAFE, SAFE_SETTINGS)
    assert "47 % [35, 59] of the drives if odometry stands still" in choice.objections[PRECISE]
    assert choice.untested_error == pytest.approx(0.05, abs=0.001)
    advice = choice.advise_recording()
    assert advice.startswith(
        "Precise settings lower the error to 0.050 m, but a robot that gets lost with them"
    )
    assert advice.endswith("To test them on a recorded drive, add `--recording FILE`.")


def test_preset_harmful_at_level_is_rejected():
    usual, _ = make_case(BETTER)
    one, _ = make_case(BETTER, (30, 8, 30), "slip", "odometry slips")
    other, _ = make_case(BETTER, (4, 0, 12), "turns", "odometry errs in turns")
    assert choose_from_cases(usual, one).name == SAFE
    choice = choose_from_cases(usual, one, other)
    assert (choice.name, choice.settings, choice.changes) == (USER_SETTINGS, Amcl(), "")
    assert [*choice.objections] == [PRECISE, SAFE]


def test_preset_needs_gain_at_usual_level():
    usual, _ = make_case((0.2, 0.2, 0.2))
    choice = choose_from_cases(usual)
    assert choice.name == USER_SETTINGS
    assert (
        choice.objections[SAFE] == "safe settings are not better than your settings: no difference"
    )
    assert choice.advise_recording() == ""


def test_choice_skips_drives_without_influence():
    usual, _ = make_case(BETTER)
    harmful, _ = make_case(BETTER, (0, 30, 0), "standstill", "odometry stands still")
    later, driven = make_case(BETTER, (0, 0, 0), "slip", "odometry slips")
    choice = choose_from_cases(usual, harmful, later, drives_all=False)
    assert choice.name == SAFE
    assert driven == [2]  # the safe preset is never off, whatever the user's settings are
    full = choose_from_cases(usual, harmful, later)
    assert (full.name, driven) == (SAFE, [2, *[0] * 3, *[1] * 3, *[2] * 3])
    assert len(full.results) == 9


@pytest.mark.parametrize(
    ("off", "name", "driven"),
    [
        ((64, 0, 64), PRECISE, [1]),
        ((64, 1, 64), PRECISE, [1, 1]),
        ((20, 30, 0), SAFE, [1, 2]),
        ((20, 30, 1), SAFE, [1, 2, 2]),
        ((0, 30, 30), USER_SETTINGS, [1, 2, 0]),
        ((40, 30, 40), SAFE, [1, 2, 0, 2, 0]),
    ],
)
def test_level_ends_at_first_decision(off, name, driven):
    """Drives end at 16, 32 or 64; `driven` lists the settings of each step by their index."""
    usual, _ = make_case(BETTER)
    level, places = make_case(BETTER, off, "slip", "odometry slips")
    choice = choose_from_cases(usual, level, drives_all=False)
    assert (choice.name, places) == (name, driven)
    drives = {row.settings: row.n_drives for row in choice.results if row.case == "slip"}
    assert drives[PRECISE] == 16 * driven.count(1)


def test_choice_states_rates_of_hardest_level():
    """Harm that 64 drives cannot prove is visible, with intervals."""
    usual, _ = make_case(BETTER, (1, 40, 2))
    slip, _ = make_case(BETTER, (9, 64, 10), "slip", "odometry slips")
    standstill, _ = make_case(BETTER, (20, 64, 24), "standstill", "odometry stands still")
    choice = choose_from_cases(usual, slip, standstill)
    assert choice.hardest_level == (
        "Hardest test: if odometry stands still, drives with safe settings are off at the end in"
        " 38 % [27, 50], your settings in 31 % [21, 43]."
    )
    assert choose_from_cases(usual, recordings=[Recorded((0.2, 0.06, 0.1))]).hardest_level == ""
    harmful, _ = make_case(BETTER, (9, 64, 1), "slip", "odometry slips")
    quick = choose_from_cases(usual, harmful, drives_all=False)
    assert quick.hardest_level == (
        "Hardest test: if odometry slips, drives with safe settings are off at the end in"
        " 3 % [1, 16]."
    )


def test_trailing_preset_is_driven_less():
    (case, places) = make_case((0.2, 0.3, 0.1))
    usual = dataclasses.replace(case, looks=(24, 64))
    choice = choose_from_cases(usual, drives_all=False)
    assert (choice.name, places) == (SAFE, [0, 1, 2, 0, 2])
    drives = {row.settings: row.n_drives for row in choice.results}
    assert drives == {USER_SETTINGS: 64, PRECISE: 24, SAFE: 64}


def test_recording_excludes_preset_from_simulation():
    usual, places = make_case(BETTER)
    assert choose_from_cases(usual, recordings=[Recorded((0.2, 0.3, 0.1))]).name == SAFE
    assert 1 not in places


def test_preset_with_more_losses_is_rejected():
    """Two more lost drives are chance, eighteen are not; the error is smaller in both cases."""
    usual, _ = make_case(BETTER, (2, 4, 2))
    assert choose_from_cases(usual).name == PRECISE
    usual, _ = make_case(BETTER, (2, 20, 2))
    choice = choose_from_cases(usual)
    assert choice.name == SAFE
    assert (
        choice.objections[PRECISE]
        == "precise settings are not better than your settings: undecided"
    )
    assert choice.untested_error is None
    rows = {row.settings: row.verdict for row in choice.results}
    assert rows == {USER_SETTINGS: "baseline", PRECISE: "undecided", SAFE: "better"}


def test_recording_decides_instead_of_levels():
    usual, _ = make_case(BETTER)
    harmful, driven = make_case(BETTER, (0, 30, 0), "standstill", "odometry stands still")
    recording = Recorded((0.2, 0.06, 0.1))
    choice = choose_from_cases(usual, harmful, recordings=[recording])
    assert (choice.name, driven) == (PRECISE, [])
    assert choice.recordings == ("drive 1",)
    rows = {(row.settings, row.case): row for row in choice.results}
    assert rows[PRECISE, "drive 1"].error.value == pytest.approx(0.06)
    assert rows[USER_SETTINGS, "drive 1"].n_drives == 12
    assert choice.advise_recording() == ""


@pytest.mark.parametrize(
    ("errors", "at_end", "name", "reason"),
    [
        ((0.2, 0.06, 0.1), (0.2, OFF_ERROR, 0.1), SAFE, "1 of 12 runs are off at the end"),
        ((0.2, 0.3, 0.1), None, SAFE, "the error is 0.30 m, 0.20 m with your settings, on drive 1"),
        ((0.2, 0.3, 0.25), None, USER_SETTINGS, "the error is 0.30 m"),
        ((0.2, OFF_ERROR, 0.1), (0.2, 0.2, 0.1), SAFE, "11 of 12 runs are off at the end"),
    ],
)
def test_preset_failing_on_recording_is_rejected(errors, at_end, name, reason):
    usual, _ = make_case(BETTER)
    choice = choose_from_cases(usual, recordings=[Recorded(errors, at_end)])
    assert choice.name == name
    assert reason in choice.objections[PRECISE]


def test_faulty_recording_rules_out_precise_preset():
    usual, _ = make_case(BETTER)
    recording = Recorded((0.2, 0.06, 0.1))
    choice = choose_from_cases(usual, recordings=[recording], are_recordings_sound=False)
    assert choice.name == SAFE
    assert 1 not in recording.replayed
    alone = choose_from_cases(usual, are_recordings_sound=False)
    assert alone.name == SAFE


def test_recording_decides_if_simulation_is_undecided():
    undecided, _ = make_case((0.2, 0.2, 0.2))
    assert choose_from_cases(undecided, recordings=[Recorded((0.2, 0.06, 0.1))]).name == PRECISE
    worse, _ = make_case((0.2, 0.4, 0.2))
    assert choose_from_cases(worse, recordings=[Recorded((0.2, 0.06, 0.1))]).name == SAFE


def test_settings_must_hold_on_all_recordings():
    usual, _ = make_case(BETTER)
    good, bad = Recorded((0.2, 0.06, 0.1)), Recorded((0.2, 0.3, 0.1))
    bad.name = "drive 2"
    choice = choose_from_cases(usual, recordings=[good, bad])
    assert choice.name == SAFE
    assert choice.objections[PRECISE].endswith("on drive 2")


def test_cost_follows_updates_along_lines():
    usual, _ = make_case((0.2, 0.2, 0.1))
    choice = choose_from_cases(usual)
    assert choice.cost_ratio == pytest.approx(2.2, abs=0.1)
    times = f"{choice.cost_ratio:.1f} times the filter's CPU"
    assert choice.title == f"safe: update_min_d 0.1, update_min_a 0.1, {times}"


def test_random_paths_are_seeded_and_cut():
    cells = np.full((12, 1200), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    paths, again, others = (plan_random_paths(Costmap.blank(grid), 6, seed) for seed in (3, 3, 4))
    lengths = [path.length for path in paths]
    assert max(lengths) == pytest.approx(40.0)
    assert min(lengths) >= 20 - 1e-9
    for path in paths:
        make_path_poses(path, grid)  # raises if it leaves the free cells
    assert [path.xy.tolist() for path in paths] == [path.xy.tolist() for path in again]
    assert others[0].xy.tolist() != paths[0].xy.tolist()


def test_cut_path_keeps_headings():
    """Turns in place and reverse driving stay in the cut part."""
    path = Path(np.array([[0, 0], [30, 0], [30, 0], [80, 0]]), np.array([0, 0, np.pi, np.pi]))
    part = cut_path(path, 0.25)
    assert part.xy.tolist() == [[10, 0], [30, 0], [30, 0], [50, 0]]
    assert part.heading.tolist() == [0, 0, np.pi, np.pi]
    assert cut_path(part, 0.5) is part


def test_small_maps_have_shorter_paths():
    cells = np.full((40, 40), FREE, np.uint8)
    room = OccupancyGrid(cells, 0.1, name="room")
    assert min(path.length for path in plan_random_paths(Costmap.blank(room), 5, 1)) >= 2 - 1e-9
    closet = OccupancyGrid(cells[:10, :10], 0.1, name="room")
    with pytest.raises(ConfigError, match="room: no two connected positions") as caught:
        plan_random_paths(Costmap.blank(closet), 5, 1)
    assert "larger map" in str(caught.value)


def test_drives_equal_those_of_simulate():
    """A route has the same drives in every command."""
    grid, robot = hall(), Robot(LIDAR, filter=Amcl(**FEW))
    paths = plan_random_paths(Costmap.blank(grid), 2, 1)
    (usual,) = make_simulated_cases(grid, robot, paths, [NO_FAULT], drives=2, seed=5, threads=2)
    drives = simulate(grid, {"a": paths[0], "b": paths[1]}, robot, drives=2, seed=5).drives
    expected = DriveSet.from_drives(drives.values())
    shown = usual.drive(robot.amcl, range(*usual.looks))
    np.testing.assert_allclose(shown.log_error, expected.log_error)
    assert shown.lost.tolist() == expected.lost.tolist()


def test_levels_have_64_drives_at_least():
    robot = Robot(LIDAR, filter=Amcl(min_particles=5, max_particles=5))
    paths = plan_random_paths(Costmap.blank(hall()), 5, 1)
    usual, slip, *_ = make_simulated_cases(hall(), robot, paths, LEVELS, drives=2, threads=2)
    assert (usual.is_usual, slip.is_usual, slip.name) == (True, False, "slip")
    assert len(usual.drive(robot.amcl, range(*usual.looks)).lost) == 10
    assert slip.looks == (4, 7, 13)
    assert len(slip.drive(robot.amcl, range(7, 13)).lost) == 30


def test_tune_separates_cases_of_maps():
    robot = Robot(LIDAR, filter=Amcl(min_particles=20, max_particles=20))
    result = tune([hall(), hall()], robot, paths=5, drives=2, threads=2, levels=[NO_FAULT])
    assert [*dict.fromkeys(row.case for row in result.choice.results)] == [
        "hall usual",
        "hall 2 usual",
    ]
    assert {verdict.n_drives for verdict in result.choice.verdicts.values()} == {20}
    about = json.loads(json.dumps(result.summary(), allow_nan=False))
    assert [each["name"] for each in about["maps"]] == ["hall", "hall"]
    with pytest.raises(ConfigError, match="a filter's map is of one map, not of 2"):
        tune([hall(), hall()], filter_map=hall())
    with pytest.raises(ConfigError, match="grid must be"):
        tune([])


def test_report_shows_settings_at_all_levels(tuning):
    assert tuning.robot.amcl == Amcl(**FEW)
    assert tuning.winner == tuning.choice.settings
    text = " ".join(tuning.report().split())
    assert text.startswith(f"{tuning.conclusion}.")
    rows = {(row.settings, row.case) for row in tuning.choice.results}
    levels = "usual", "slip", "standstill", "turns"  # a hall has no corridor for a kink
    assert {(name, level) for name in (USER_SETTINGS, PRECISE, SAFE) for level in levels} <= rows
    assert "off at the end" in text
    assert f"{LIDAR.title}: of 60 beams compared, " in text
    about = json.loads(json.dumps(tuning.summary(), allow_nan=False))
    assert (about["choice"]["settings"], about["map"]["name"]) == (tuning.choice.name, "hall")
    assert len(about["choice"]["results"]) == len(tuning.choice.results)


@pytest.mark.long
def test_tune_ignores_thread_count(tuning):
    calls = []
    again = tune(
        hall(),
        robot=Robot(LIDAR, filter=Amcl(**FEW)),
        paths=5,
        drives=4,
        threads=1,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert again.summary() == tuning.summary()
    assert calls == sorted(calls)
    assert calls[-1][0] == calls[-1][1]


@pytest.fixture(scope="module")
def precise(tuning):
    """Return the same tuning with the precise preset as its result."""
    choice = dataclasses.replace(tuning.choice, name=PRECISE)
    return dataclasses.replace(tuning, choice=choice)


def test_rejected_presets_change_nothing(tuning, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS)
    kept = dataclasses.replace(tuning.choice, name=USER_SETTINGS, objections={SAFE: "it is worse"})
    unclear = dataclasses.replace(tuning, choice=kept)
    assert unclear.winner == tuning.robot.amcl
    assert unclear.changes == {}
    unclear.save(tmp_path / "out", file)
    assert (tmp_path / "out" / "nav2_params.yaml").read_bytes() == file.read_bytes()
    assert unclear.conclusion == "Keep your settings: it is worse"


def save_parameters(tuning, folder, params=None):
    """Save the results in a folder, and return its parameter file."""
    tuning.save(folder, params)
    return folder / "nav2_params.yaml"


def test_new_parameter_file_is_complete(tuning, tmp_path):
    file = save_parameters(tuning, tmp_path / "out")
    assert read_amcl(file) == tuning.winner
    parameters = yaml.safe_load(file.read_text())["amcl"]["ros__parameters"]
    assert parameters["robot_model_type"] == "nav2_amcl::DifferentialMotionModel"
    assert parameters["scan_topic"] == "scan"
    assert "  # Nav2's default is 2000" in file.read_text()


def test_wrong_parameter_file_is_not_kept(precise, tmp_path, monkeypatch):
    """`tune` reads the file that it wrote."""
    edited = "locplan.simulation.amcl_parameters.edit_parameters"
    monkeypatch.setattr(edited, lambda path, *_: path.read_bytes())
    (tmp_path / "mine.yaml").write_text(PARAMS)
    with pytest.raises(LocplanError, match="could not be written as it was meant"):
        save_parameters(precise, tmp_path / "out", tmp_path / "mine.yaml")
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


def test_users_file_is_copied_with_preset(precise, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS)
    saved_file = save_parameters(precise, tmp_path / "out", file)
    with pytest.warns(UserWarning, match="unknown_to_us"):
        assert read_amcl(saved_file) == precise.winner
    text = saved_file.read_text()
    assert "    # mine\n" in text
    assert "alpha1: 0.05  # set long ago\n" in text
    assert "alpha2: 0.05\n" in text
    assert "do_beamskip: false\n" in text  # it has an effect with this model only
    assert "unknown_to_us: [1, 2]\n" in text
    assert file.read_text() == PARAMS
    assert precise.conclusion.startswith("Use precise: alphas 0.05, likelihood_field_prob")


def test_tune_changes_single_robot_of_fleet(tuning, tmp_path):
    file = tmp_path / "fleet.yaml"
    file.write_text("robot1:\n  amcl:\n    ros__parameters:\n      alpha1: 0.2\n" + PARAMS)
    saved_file = save_parameters(tuning, tmp_path / "out", tmp_path / "fleet.yaml:robot1")
    assert saved_file.read_text().endswith(PARAMS)
    read = Robot.load(f"{saved_file}:robot1", lidar=LIDAR).filter
    assert (read.alpha1, read.max_beams) == (tuning.winner.alpha1, tuning.winner.max_beams)


def test_saved_file_has_settings_of_run(tuning, tmp_path):
    """Options may have changed the values of the user's file."""
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS.replace("max_particles: 60", "max_particles: 500"))
    saved_file = save_parameters(tuning, tmp_path / "out", file)
    with pytest.warns(UserWarning, match="unknown_to_us"):
        assert read_amcl(saved_file) == tuning.winner


def test_results_are_written_and_drawn(tuning, tmp_path):
    tuning.save(tmp_path / "out")
    names = {each.name for each in (tmp_path / "out").iterdir()}
    assert names == {*Tuning.files.names, "run.yaml"}
    about = json.loads((tmp_path / "out" / "tuning.json").read_text())
    assert about["conclusion"] == tuning.conclusion
    assert about["changes"] == tuning.changes
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == tuning.winner
    figure = tuning_figure(tuning)
    labels = [panel.get_ylabel() for panel in figure.axes]
    assert labels == ["RMSE of the position [m]", "off at the end [% of the drives]"]
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert tuning.choice.name == "your settings"
    assert entries == ["your settings: keep these", "precise", "safe"]


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
def test_tune_rejects_bad_arguments(arguments, words):
    with pytest.raises(LocplanError, match=words):
        tune(hall(), **arguments)


def test_tune_command_keeps_users_file(run, tmp_path):
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
    assert " ".join(about["conclusion"].split()) in " ".join(out.split())
    read = yaml.safe_load((tmp_path / "tuned" / "nav2_params.yaml").read_text())
    read, mine = (each["amcl"]["ros__parameters"] for each in (read, yaml.safe_load(PARAMS)))
    assert read.items() >= about["changes"].items()
    differing = {name for name, value in read.items() if mine.get(name) != value}
    assert differing <= {*about["changes"], "do_beamskip"}
    assert params.read_text() == PARAMS


def test_tune_rejects_yaml_anchors_early(run, tmp_path, monkeypatch):
    """A changed anchor would change other parameters, too."""
    monkeypatch.setattr("locplan.advice.tuning.tune", None)
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


FEW_ON_DRIVE = {"min_particles": 60, "max_particles": 120}
POOR = Amcl(**FEW_ON_DRIVE, alpha1=1.0, alpha2=1.0, alpha3=1.0, alpha4=1.0)


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def drive(grid):
    """A drive of 34 m, with a scan every 0.1 m."""
    costs = Costmap.blank(grid, robot=0.3)
    path = plan(costs, (2.0, 3.0), (36.0, 3.0)).path
    return simulate_recording(grid, make_path_poses(path, grid)[::2])


@pytest.fixture(scope="module")
def recording_tuning(grid, drive):
    return tune_on_drive(drive, grid, robot=Robot(filter=POOR), drives=2)


def test_poor_settings_are_bettered_on_recording(recording_tuning):
    assert recording_tuning.robot.amcl == POOR
    assert recording_tuning.choice.name == PRECISE
    assert recording_tuning.winner.alpha2 == 0.05
    cases = {(row.settings, row.case) for row in recording_tuning.choice.results}
    assert {
        (USER_SETTINGS, "usual"),
        (PRECISE, "usual"),
        (USER_SETTINGS, "the drive"),
        (PRECISE, "the drive"),
    } <= cases
    assert {case for _, case in cases} == {"usual", "the drive"}


def test_report_shows_recording(recording_tuning):
    text = " ".join(recording_tuning.report().split())
    assert text.startswith("note: the drive: The scans cannot show motion along corridors")
    assert "on the drive, " in recording_tuning.conclusion
    assert "2 runs over the whole drive (seed 1)" in text
    assert "precise: alphas 0.05, likelihood_field_prob. safe: update_min_d 0.1" in text
    verdicts = {(row.settings, row.case): row.verdict for row in recording_tuning.choice.results}
    assert verdicts[USER_SETTINGS, "the drive"] == "baseline"
    assert verdicts[PRECISE, "the drive"] == "confirmed"
    about = recording_tuning.summary()
    assert about["recording"] == "the drive"
    json.dumps(about, allow_nan=False)


def test_recording_has_replays_of_simulate(recording_tuning, grid, drive):
    """The same numbers give the same replays in both commands."""
    expected = replay(drive, grid, Robot(filter=POOR), runs=2).drives
    (row,) = (
        row
        for row in recording_tuning.choice.results
        if (row.settings, row.case) == (USER_SETTINGS, "the drive")
    )
    assert row.error.value == pytest.approx(expected.rmse.value)
    assert row.lost.value == expected.lost.mean()


def test_failing_presets_keep_user_settings(recording_tuning, tmp_path):
    kept = dataclasses.replace(
        recording_tuning.choice, name=USER_SETTINGS, objections={PRECISE: "runs end lost"}
    )
    refused = dataclasses.replace(recording_tuning, choice=kept)
    assert refused.changes == {}
    assert refused.conclusion == "Keep your settings: runs end lost"
    assert "locplan recording FILE MAP" in " ".join(refused.report().split())
    refused.save(tmp_path / "out")
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == POOR


def test_several_recordings_are_judged_together(grid, drive):
    still = Amcl(min_particles=20, max_particles=20)
    result = tune_on_drive([drive, drive], grid, Robot(filter=still), drives=2)
    assert result.choice.recordings == ("the drive", "the drive 2")
    assert result.recording == "the drive, the drive 2"
    with pytest.raises(ConfigError, match="2 drives need one map, or one for each"):
        tune_on_drive([drive, drive], [grid] * 3)


def test_tune_rejects_unsuitable_recordings(grid, drive):
    with pytest.raises(RecordingError, match="m are needed to compare settings"):
        tune_on_drive(drive[:100], grid)
    with pytest.raises(RecordingError, match="no odometry"):
        tune_on_drive(dataclasses.replace(drive, odometry=None), grid)


@pytest.mark.long
def test_report_notes_sparse_scans(grid, drive):
    own = Amcl(min_particles=20, max_particles=20)
    tuning = tune_on_drive(drive.subsample(5), grid, robot=Robot(filter=own), drives=2)
    assert "a scan only every 0.5 m" in tuning.notes[0]
    assert tuning.report().startswith("note: the log has a scan only every 0.5 m")


def test_tune_command_reads_recording(tmp_path, grid, drive, monkeypatch, capsys):
    save_map(grid, tmp_path / "map.yaml")
    drive.save(tmp_path / "drive.npz")
    few = ["--set", "min_particles=20", "--set", "max_particles=40", "--drives", "2"]
    command = ["tune", tmp_path / "map.yaml", "--recording", tmp_path / "drive.npz", *few]

    def run(*more):
        monkeypatch.setattr("sys.argv", ["locplan", *map(str, command), *map(str, more)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    code, said = run("-o", tmp_path / "tuned")
    assert code == 0, said.err
    assert "The recording decides" in said.out
    assert read_amcl(tmp_path / "tuned" / "nav2_params.yaml").max_particles == 40
    for more, fault in ((["--paths", "8"], "--paths"), (["--set", "range=5"], "--set range")):
        code, said = run(*more)
        assert code == 2
        assert f"{fault} has no effect with --recording" in said.err
    command[1:2] = [tmp_path / "map.yaml"] * 3
    code, said = run("--recording", tmp_path / "drive.npz")
    assert code == 2
    assert "2 recordings and 3 maps" in said.err

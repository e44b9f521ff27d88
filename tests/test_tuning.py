"""Tuning of AMCL's settings: what is tried, how it is judged, and the files that are written."""

import dataclasses
import json
import math

import numpy as np
import pytest
import yaml

from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, save_map
from locplan.robots import OMNIDIRECTIONAL, Amcl, Disturbances, Lidar, Robot, read_amcl
from locplan.simulation import (
    BeamsLeft,
    DisturbanceLevel,
    Drives,
    SimulatedBench,
    Simulator,
    Tuning,
    TuningBench,
    drive_open,
    joined,
    poses_along,
    search_settings,
    tune,
    tuning_figure,
)

FEW = {"min_particles": 30, "max_particles": 60}
GOOD = Amcl(**FEW, alpha1=0.05, alpha2=0.05, alpha3=0.05, alpha4=0.05)
LIDAR = Lidar(range=6.0, beams=60)


def hall() -> OccupancyGrid:
    """A hall of 14 x 8 m with four pillars."""
    cells = np.full((80, 140), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for row, col in ((20, 30), (50, 60), (25, 90), (55, 115)):
        cells[row : row + 6, col : col + 6] = OCCUPIED
    return OccupancyGrid(cells, 0.1, name="hall")


@pytest.fixture(scope="module")
def tuning():
    return tune(hall(), robot=Robot(LIDAR, filter=Amcl(**FEW)), paths=5, drives=4, threads=2)


class Formula(TuningBench):
    """A bench whose settings have known errors at each level: sums of what each value adds."""

    def __init__(self, added=None, levels=(0.0, 0.1, 0.2), lines=None):
        self.added, self.offsets = added or {}, levels
        line = np.column_stack([np.arange(101) * 0.05, np.zeros(101), np.zeros(101)])
        every = [DisturbanceLevel(f"level {n}", 1.0, 1.0) for n in range(3)]
        own = {"seed": 1, "threads": 1}
        super().__init__(hall(), hall(), LIDAR, every, lines or [line] * 20, 8, **own)

    def arguments(self, amcl):
        total = sum(each.get(getattr(amcl, name), 0.0) for name, each in self.added.items())
        levels = self.offsets(amcl) if callable(self.offsets) else self.offsets
        return [math.exp(total + level) for level in levels]

    def errors(self, level, path, drive, arguments):
        return np.array([[100 * arguments, 0.0, 0.0]])


class Unsteady(Formula):
    """One where a sigma_hit of 0.1 errs more on every other drive, and less on the rest."""

    def __init__(self, added, spread):
        super().__init__(added)
        self.spread = spread

    def arguments(self, amcl):
        return [(each, self.spread * (amcl.sigma_hit == 0.1)) for each in super().arguments(amcl)]

    def errors(self, level, path, drive, arguments):
        error, spread = arguments
        return super().errors(level, path, drive, error * math.exp(spread * (-1) ** drive))


def found_by(bench, own=None):
    """What is found on a bench that the search and the judgement share."""
    left = BeamsLeft(60, 60.0)
    own = Robot(LIDAR, filter=own or Amcl())
    about = {"left": left, "others": None, "seed": 1, "progress": None}
    return search_settings(lambda *_: bench, own, **about)


def tried(own):
    """Settings that a search begins with."""
    bench = Formula()
    count = found_by(bench, own).rungs[0][0]
    return list(bench.driven)[:count]


ALPHAS = {0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0}


def test_settings_are_drawn_over_the_whole_space_the_users_own_first():
    found = tried(Amcl())
    assert found[0] == Amcl()
    assert len(set(found)) == len(found) == 128
    assert {each.alpha1 for each in found} == {each.alpha2 for each in found} == ALPHAS
    assert all(each.alpha1 == each.alpha4 and each.alpha2 == each.alpha3 for each in found)
    assert len({(each.alpha1, each.alpha2) for each in found}) > 50  # groups of their own
    weights = {(each.z_hit, each.z_rand) for each in found}
    assert weights == {(0.5, 0.5), (0.8, 0.2), (0.95, 0.05)}
    assert {(each.update_min_d, each.update_min_a) for each in found} == {
        (0.25, 0.2),
        (0.25, 0.1),
        (0.1, 0.2),
        (0.1, 0.1),
    }


def test_own_values_take_the_place_of_those_near_them():
    own = Amcl(max_beams=50, update_min_d=0.2, alpha1=0.1, **FEW)
    found = tried(own)
    assert {each.max_beams for each in found} == {30, 50, 120, 180}
    assert {each.update_min_d for each in found} == {0.1, 0.2}
    assert {each.min_particles for each in found} == {FEW["min_particles"]}
    assert {(0.1, 0.2)} <= {(each.alpha1, each.alpha4) for each in found}  # its own, mixed


def test_the_alpha_of_sideways_motion_is_tuned_where_it_counts():
    sideways = Amcl(robot_model_type=OMNIDIRECTIONAL)
    found = tried(sideways)
    assert {each.alpha5 for each in found} == ALPHAS
    assert {each.robot_model_type for each in found} == {OMNIDIRECTIONAL}
    assert {each.alpha5 for each in tried(Amcl())} == {0.2}
    quiet = found_by(Formula({"alpha5": {0.05: -1.0}}), sideways)
    assert quiet.changes == dict.fromkeys(("alpha2", "alpha3", "alpha5"), 0.05)
    assert quiet.conclusion.startswith("way alphas 0.05: RMSE")


def test_of_too_many_settings_some_are_drawn():
    own = Amcl(max_beams=7, update_min_d=0.0, sigma_hit=0.02, alpha1=1.0)
    found = tried(own)
    assert found[0] == own
    assert len(set(found)) == len(found) == 128
    assert found == tried(own)


def test_changes_are_named():
    added = {"alpha2": {0.05: -1.0}, "max_beams": {30: -1.0}}
    added["laser_model_type"] = {"likelihood_field_prob": -1.0}
    found = found_by(Formula(added))
    assert found.conclusion.startswith("way alphas 0.05, likelihood_field_prob, max_beams 30: ")
    mixed = dataclasses.replace(GOOD, alpha1=0.1)
    turned = found_by(Formula({"alpha1": {0.1: -1.0}}), GOOD)
    assert turned.conclusion.startswith("turn alphas 0.1:")
    assert found_by(Formula({"alpha1": {0.05: -1.0}}), mixed).changes == {"alpha1": 0.05}


def test_levels_scale_odometry_and_clutter_only():
    robot = Robot(disturbances=Disturbances(outliers=0.3, occlusion=0.6))
    levels = bench_of().levels
    assert levels[1].of(robot) == robot
    base = robot.odometry
    mild, strong = (levels[n].of(robot).odometry for n in (0, 2))
    for name in ("distance_drift", "heading_drift_deg", "turn_drift_deg", "turn_bias"):
        assert getattr(mild, name) == pytest.approx(getattr(base, name) / 3)
        assert getattr(strong, name) == pytest.approx(getattr(base, name) * 3)
    mild, strong = (levels[n].of(robot).disturbances for n in (0, 2))
    assert (mild.boundary_noise, strong.boundary_noise) == (0.05, 0.2)
    assert strong.outliers == 0.5  # at most half of the beams
    assert strong.occlusion == 0.6  # but never fewer than asked for
    assert strong.start_sigma == robot.disturbances.start_sigma


@pytest.mark.long
def test_what_happens_at_ten_times_the_errors_of_odometry_is_said(tuning):
    assert [level.name for level in tuning.levels] == ["x1/3", "x1", "x3"]
    beyond = tuning.found.beyond
    assert beyond.level.name == "x10"
    assert (beyond.level.odometry, beyond.level.clutter) == (10.0, 1.0)
    assert beyond.rmse.value > tuning.found.levels[0].rmse.value
    said = tuning.report().splitlines()[-3:]
    assert f"at ten times: {beyond.rmse.value:.2g} m" in " ".join(said)


def test_settings_for_poor_odometry_are_searched_at_ten_times_its_errors():
    few = {"paths": 5, "drives": 2, "threads": 2}
    own = Robot(LIDAR, filter=Amcl(min_particles=20, max_particles=20))
    poor = tune(hall(), own, odometry="poor", **few)
    assert [level.name for level in poor.levels] == ["x1", "x3", "x10"]
    assert poor.found.beyond is None
    assert "up to 10 times as bad" in poor.report()


def test_random_paths_are_of_the_map_and_cut_to_length():
    cells = np.full((12, 500), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    paths = SimulatedBench.paths(Costmap.blank(grid), 6, 3)
    lengths = [path.length for path in paths]
    assert max(lengths) == pytest.approx(SimulatedBench.longest)
    assert min(lengths) >= 8 - 1e-9
    for path in paths:
        poses_along(path, grid)  # raises where it leaves the free cells
    assert [path.xy.tolist() for path in paths] == [
        path.xy.tolist() for path in SimulatedBench.paths(Costmap.blank(grid), 6, 3)
    ]
    assert SimulatedBench.paths(Costmap.blank(grid), 6, 4)[0].xy.tolist() != paths[0].xy.tolist()


def test_small_maps_have_shorter_paths():
    cells = np.full((40, 40), FREE, np.uint8)
    grid = OccupancyGrid(cells, 0.1, name="room")
    assert min(path.length for path in SimulatedBench.paths(Costmap.blank(grid), 5, 1)) >= 2 - 1e-9
    with pytest.raises(ConfigError, match="room: no two positions") as caught:
        SimulatedBench.paths(Costmap.blank(OccupancyGrid(cells[:10, :10], 0.1, name="room")), 5, 1)
    assert "larger map" in str(caught.value)


def bench_of(paths: int = 3, drives: int = 4) -> SimulatedBench:
    grid = hall()
    lines = SimulatedBench.paths(Costmap.blank(grid), paths, 1)
    return SimulatedBench(grid, Robot(LIDAR), lines, drives, seed=5, threads=2)


def test_a_bench_drives_as_the_simulator_does():
    bench, grid = bench_of(), hall()
    bench.drive([GOOD], 3, 4)
    lines = SimulatedBench.paths(Costmap.blank(grid), 3, 1)
    for n, level in enumerate(bench.levels):
        simulator = Simulator(grid, level.of(Robot(LIDAR, filter=GOOD)), seed=5)
        for path, line in enumerate(lines):
            own = drive_open(simulator, {"line": line}, range(4), route=path)["line"]
            np.testing.assert_allclose(bench.driven[GOOD].squares[n, path], own.mean_squares)
            assert bench.driven[GOOD].lost[n, path].tolist() == own.lost.tolist()


def test_a_bench_remembers_what_was_driven():
    once, bit_by_bit = bench_of(), bench_of()
    once.drive([GOOD, Amcl(**FEW)], 3, 4)
    calls = []
    for paths, drives, levels in ((1, 2, [2]), (3, 2, [2]), (3, 4, [2]), (3, 4, range(3))):
        bit_by_bit.drive([GOOD, GOOD], paths, drives, levels, lambda *step: calls.append(step))
    assert [done for done, total in calls if done == total] == [2, 4, 6, 24]
    np.testing.assert_array_equal(once.driven[GOOD].squares, bit_by_bit.driven[GOOD].squares)


def test_a_bench_keeps_the_scores_of_few_settings(monkeypatch):
    """Each may be as large as the map."""
    monkeypatch.setattr(TuningBench, "at_once", 2)
    bench = bench_of(paths=1, drives=2)
    settings = [Amcl(**FEW, sigma_hit=0.1 + 0.02 * n) for n in range(5)]
    done = []
    bench.drive(settings, 1, 2, progress=lambda *counts: done.append(counts))
    assert set(bench.driven) == set(settings)
    assert bench._scores.cache_info().currsize == 2
    assert done[-1] == (30, 30)


def test_updates_are_those_of_the_settings():
    line = np.column_stack([np.arange(101) * 0.05, np.zeros(101), np.zeros(101)])
    assert Formula(lines=[line]).updates(Amcl(update_min_d=0.24)) == 1 + 20
    assert Formula(lines=[line] * 2).updates(Amcl(update_min_d=0.09)) == 2 * (1 + 50)
    line[:, 2] = np.arange(101) * 0.15
    assert Formula(lines=[line]).updates(Amcl(update_min_d=9.0)) == 1 + 50


def test_a_heading_across_half_a_turn_is_no_update():
    line = np.zeros((101, 3))
    line[:, 2] = np.where(np.arange(101) % 2, np.pi - 0.05, -np.pi + 0.05)
    assert Formula(lines=[line]).updates(Amcl(update_min_a=0.11)) == 1
    assert Formula(lines=[line]).updates(Amcl(update_min_a=0.09)) == 101


def test_the_search_finds_the_best_and_puts_back_what_gains_nothing():
    added = {
        "alpha1": {alpha: abs(math.log(alpha / 0.05)) for alpha in ALPHAS},
        "laser_model_type": {"likelihood_field": 1.0},
        "sigma_hit": {0.2: 0.01},
    }
    found = found_by(Formula(added))
    assert found.changes == {
        **dict.fromkeys(("alpha1", "alpha4"), 0.05),
        "laser_model_type": "likelihood_field_prob",
    }
    assert found.contributions["laser_model_type"] == pytest.approx(math.e)
    assert found.contributions["sigma_hit"] == pytest.approx(math.exp(0.01))
    assert found.rungs[:3] == ((128, 5, 1), (48, 5, 2), (16, 10, 4))
    assert all(each[0] <= 16 for each in found.rungs[3:] if each[1:] != (5, 1))
    assert found.rungs[-1][1:] == (20, 8)


def test_a_loss_has_its_price():
    """What errs less, but is off by more than a metre once on each drive, is not found."""

    class Lossy(Formula):
        def errors(self, level, path, drive, arguments):
            errors = np.full((1000, 3), [arguments / 10, 0.0, 0.0])
            errors[-1, 0] = max(errors[-1, 0], 1.1 * (arguments < 0.8))
            return errors

    found = found_by(Lossy({"sigma_hit": {0.1: -0.7, 0.05: -0.05}}, (0.0, 0.0, 0.0)))
    assert found.candidate.sigma_hit == 0.05
    assert found.found.worst < math.log(0.1)


def test_what_loses_more_where_it_is_judged_is_left_for_the_next():
    class Judging(Formula):
        def arguments(self, amcl):
            known = super().arguments(amcl)
            return [(each, amcl.max_beams == 60 and amcl.sigma_hit == 0.1) for each in known]

        def errors(self, level, path, drive, arguments):
            error, loses = arguments
            lost = loses and path == 0  # so few that they are no clear harm
            return np.array([[error, 0.0, 0.0]] * 100 + [[1.1, 0.0, 0.0]] * lost)

    added = {"sigma_hit": {0.1: -1.0}, "max_beams": {180: -0.08}}
    quiet = (-4.0, -4.0, -4.0)
    benches = {False: Formula(added, quiet), True: Judging(added, quiet)}
    about = {"left": BeamsLeft(60, 60.0), "others": None, "seed": 1, "progress": None}
    found = search_settings(lambda _, judging: benches[judging], Robot(LIDAR), **about)
    kept = next(each for each in found.judged if each.amcl == Amcl(sigma_hit=0.1))
    assert kept.verdict == "undecided"  # errs less, and loses significantly more drives
    assert not kept.better
    assert found.winner.sigma_hit == 0.1
    assert found.winner.max_beams != 60


@pytest.mark.parametrize("losses", [1, 2])
def test_of_two_that_are_better_the_one_lost_on_fewer_replays_is_found(losses):
    class Replayed(Formula):
        def whole(self, amcl):
            errors = np.full((8, 1000, 3), [self.arguments(amcl)[0], 0.0, 0.0])
            lost = 4 if amcl == Amcl() else {180: losses}.get(amcl.max_beams, 1)
            errors[:lost, -1, 0] = 1.1
            return [Drives(np.zeros((1000, 3)), errors)]

    added = {"sigma_hit": {0.1: -1.0}, "max_beams": {180: -0.2}}
    found = found_by(Replayed(added, (-4.0, -4.0, -4.0)))
    assert found.found.better
    assert (found.candidate.max_beams == 180) == (losses == 1)


def test_settings_are_judged_with_random_numbers_of_their_own():
    seeds = {}

    def bench_of(seed, judging):
        seeds[judging] = seed
        return Formula()

    about = {"left": BeamsLeft(60, 60.0), "others": None, "seed": 1, "progress": None}
    search_settings(bench_of, Robot(LIDAR), **about)
    assert seeds[False] != seeds[True]


def test_settings_share_the_world_of_a_drive():
    made = []

    class Worlds(Formula):
        def world(self, *at):
            made.append(at)

    Worlds().drive([Amcl(), GOOD, Amcl(sigma_hit=0.1)], 1, 2, [2])
    assert sorted(made) == [(2, 0, 0), (2, 0, 1)]


def test_more_beams_a_metre_must_gain_more():
    for gain, kept in ((0.08, 60), (0.12, 180)):
        found = found_by(Formula({"max_beams": {180: -gain}}))
        assert (found.candidate.max_beams, "max_beams" in found.contributions) == (kept, True)
    for gain, kept in ((0.03, 0.1), (0.015, 0.2)):
        assert found_by(Formula({"sigma_hit": {0.1: -gain}})).candidate.sigma_hit == kept


def test_a_gain_that_drives_do_not_show_clearly_is_put_back():
    added = {"sigma_hit": {0.1: -0.05, 0.05: 1.0}}
    for spread, kept in ((0.1, 0.1), (0.5, 0.2)):  # 160 drives show 1.6 % of it, or 8 %
        assert found_by(Unsteady(added, spread)).candidate.sigma_hit == kept


def test_of_settings_as_good_the_one_nearest_to_the_users_own_is_found():
    gains = {0.5: -0.995, 1.0: -1.0, 2.0: -1.005, 5.0: -1.01}
    others = {
        "alpha2": dict.fromkeys(ALPHAS - {0.2}, 1.0),
        "laser_model_type": {"likelihood_field_prob": 1.0},
        "update_min_d": {0.1: 1.0},
        "update_min_a": {0.1: 1.0},
        "max_beams": dict.fromkeys((30, 120, 180), 1.0),
        "sigma_hit": {0.05: 1.0, 0.1: 1.0},
        "z_hit": {0.8: 1.0, 0.95: 1.0},
    }
    bench = Formula({"alpha1": gains, **others})
    assert found_by(bench).candidate == Amcl(alpha1=0.5, alpha4=0.5)
    assert max(each.alpha1 for each in bench.driven) > 0.5


def test_every_rung_drives_along_enough_paths():
    line = Formula().lines[0]
    assert [each[1] for each in found_by(Formula(lines=[line] * 6)).rungs[:2]] == [5, 5]


def test_nothing_is_put_back_that_is_worse_at_another_level():
    def levels(amcl):
        return (0.5 if amcl.sigma_hit == 0.2 else 0.0), 0.1, 0.2

    assert found_by(Formula({"sigma_hit": {0.2: 0.01}}, levels)).candidate.sigma_hit == 0.1


def test_the_worst_level_counts_whichever_it_is():
    treacherous = dataclasses.replace(GOOD, max_beams=120)

    def levels(amcl):
        return (0.9, 0.0, 0.1) if amcl == treacherous else (0.0, 0.1, 0.2)

    found = found_by(Formula({"sigma_hit": {0.1: -0.05}}, levels), GOOD)
    assert treacherous not in {each.amcl for each in found.judged}
    assert found.candidate.sigma_hit == 0.1


def test_of_several_maps_the_worst_counts():
    of_one = {"sigma_hit": {0.05: -2.0, 0.1: -1.0}}
    of_other = {"sigma_hit": {0.05: 1.0, 0.1: -1.0}}
    benches = [Formula(of_one), Formula(of_other)]
    assert found_by(benches[0]).candidate.sigma_hit == 0.05
    bench = joined(benches, ["one", "one"])
    found = found_by(bench)
    assert found.candidate.sigma_hit == 0.1
    assert [each.name for each in found.levels][::3] == ["one level 0", "one 2 level 0"]
    assert bench.strongest == [2, 5]
    assert found.found.worst_at().level.name == "one level 2"
    named = found.report().split("A: ")[0]
    assert "one level 2" in named
    assert "one level 0" not in named
    assert bench.updates(Amcl()) == benches[0].updates(Amcl())


def test_own_settings_that_are_best_are_found():
    own = dataclasses.replace(GOOD, laser_model_type="likelihood_field_prob")
    added = {"alpha1": {0.05: -1}, "laser_model_type": {own.laser_model_type: -1}}
    found = found_by(Formula(added), own)
    assert found.candidate == found.winner == own
    assert [each.name for each in found.judged] == ["your settings", "Nav2's defaults"]
    assert found.contributions == found.changes == {}


def test_tuning_gains_and_is_judged_on_other_paths(tuning):
    own, found = tuning.judged[0], tuning.found
    assert own.amcl == tuning.own == Amcl(**FEW)
    assert own.name == "your settings"
    assert all(level.rmse_ratio.value == 1 for level in own.levels)
    assert not own.better
    assert found.amcl == tuning.candidate != tuning.own
    assert found.better
    assert tuning.winner == found.amcl
    assert tuning.changes
    assert found.rmse_ratio.high < 1
    assert found.worst < own.worst
    assert tuning.judged_seed != tuning.seed
    assert {each.name for each in tuning.judged} >= {"your settings", "Nav2's defaults"}
    assert tuning.conclusion.startswith(f"{found.name}: RMSE ")
    before, after = own.cpu_ms_per_update, found.cpu_ms_per_update
    assert f"times the CPU ({before:.2f} -> {after:.2f} ms an update)" in tuning.report()
    assert f"\n{LIDAR.title}: of 60 beams compared, " in tuning.report()
    assert "\nTo go back, use your own file again" in tuning.report()
    assert json.loads(json.dumps(tuning.summary(), allow_nan=False))["verdict"] == "better"


def without_times(tuning):
    text = json.dumps(tuning.summary(), default=str)
    return [part for part in text.split(", ") if "cpu" not in part.lower()]


def test_equal_seeds_give_equal_results_on_any_number_of_threads(tuning):
    calls = []
    again = tune(
        hall(),
        robot=Robot(LIDAR, filter=Amcl(**FEW)),
        paths=5,
        drives=4,
        threads=1,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert without_times(again) == without_times(tuning)
    assert calls == sorted(calls)
    assert calls[-1] == (1000, 1000)


def test_settings_that_are_not_better_change_nothing(tuning, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(PARAMS)
    levels = [dataclasses.replace(level, verdict="worse") for level in tuning.found.levels[:1]]
    for change, word in (
        ({"verdict": "undecided"}, "undecided"),
        ({"verdict": "no difference"}, "no difference"),
        ({"verdict": "worse"}, "worse"),
        ({"levels": (*levels, *tuning.found.levels[1:])}, "undecided"),
    ):
        found = dataclasses.replace(tuning.found, **change)
        judged = tuple(found if each is tuning.found else each for each in tuning.judged)
        unclear = dataclasses.replace(tuning, judged=judged)
        assert unclear.winner == tuning.own
        assert unclear.changes == {}
        unclear.save(tmp_path / "out", file)
        assert (tmp_path / "out" / "nav2_params.yaml").read_bytes() == file.read_bytes()
        assert unclear.conclusion.startswith("nothing is better than your settings")
        assert unclear.conclusion.endswith(f"times their RMSE: {word})")
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
    edited = "locplan.simulation.tuning._space.edited_parameters"
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
    prob = dataclasses.replace(GOOD, laser_model_type="likelihood_field_prob")
    judged = tuple(
        dataclasses.replace(each, amcl=prob) if each is tuning.found else each
        for each in tuning.judged
    )
    own = dataclasses.replace(tuning, judged=judged, candidate=prob)
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
    assert {each.name for each in (tmp_path / "out").glob("[!.]*")} == {*Tuning.files.names}
    about = json.loads((tmp_path / "out" / "tuning.json").read_text())
    assert about["conclusion"] == tuning.conclusion
    assert about["changes"] == tuning.changes
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == tuning.winner
    panels = tuning_figure(tuning).axes
    labels = [panel.get_ylabel() for panel in panels]
    assert labels[:2] == ["RMSE of the position [m]", "drives off by > 1 m at some time [%]"]
    assert "lost drives' RMSE x 2.7" in panels[2].get_xlabel()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"paths": 4}, "paths"),
        ({"drives": 1}, "drives"),
        ({"seed": -1}, "seed"),
        ({"odometry": "good"}, "odometry must be one of usual, poor"),
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

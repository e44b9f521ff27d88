"""Evaluations, calibrations, and the commands that simulate."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import tracemalloc

import numpy as np
import pytest
from conftest import SHARED_DATA, changed, refused
from scipy import stats

import locplan
from locplan import FieldConfig, LocplanError, simulation
from locplan._util import intervals
from locplan.errors import CalibrationError, ConfigError
from locplan.field import (
    SHORT_LIDAR,
    CalibrationWarning,
    Exponential,
    Fisher,
    Sad,
    Scan,
    SearchWindow,
    covariances_along,
    covariances_at,
)
from locplan.field._tiles import field_shapes
from locplan.maps import environments
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation import (
    Places,
    Predictor,
    calibrate,
    evaluate,
)


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def evaluation(grid):
    other = environments.make("places", resolution=0.1)
    return evaluate([grid, other], places=14, drives=3, scans=2)


# Ranks.


def test_rank_correlations_are_scipys():
    random = np.random.default_rng(0)
    for n in (5, 40, 200):
        values, errors = random.integers(0, 12, n).astype(float), random.lognormal(size=n)
        assert intervals.spearman(values, errors) == pytest.approx(
            stats.spearmanr(values, errors)[0]
        )
    assert intervals.spearman(np.ones(6), np.arange(6.0)) == 0


def test_areas_under_the_curve_are_those_of_the_rank_sum():
    random = np.random.default_rng(1)
    values, errors = random.integers(0, 9, 60).astype(float), random.lognormal(size=60)
    worst = np.argsort(errors)[-12:]
    others = np.setdiff1d(np.arange(60), worst)
    expected = stats.mannwhitneyu(values[worst], values[others]).statistic / (12 * 48)
    assert intervals.auc(values, errors) == pytest.approx(expected)


def test_a_resample_is_ranked_like_the_places_drawn():
    random = np.random.default_rng(2)
    values, errors = random.integers(0, 9, (2, 30)).astype(float)
    drawn = intervals.Resamples.of([30])
    assert (drawn.places[0].sum(axis=1) == 30).all()
    one = dataclasses.replace(
        drawn, places=[np.repeat(drawn.places[0][:1], intervals.RESAMPLES, axis=0)]
    )
    often = drawn.places[0][0].astype(int)
    expected = stats.spearmanr(np.repeat(values, often), np.repeat(errors, often))[0]
    assert intervals.rank([values], [errors], one).spearman[1:] == pytest.approx(
        (expected, expected)
    )


def test_intervals_of_ranks_hold_the_truth():
    random, inside = np.random.default_rng(3), 0
    truth = 6 / math.pi * math.asin(0.6 / 2)  # Spearman's of a bivariate normal with r = 0.6
    for seed in range(60):
        a, b = random.multivariate_normal([0, 0], [[1, 0.6], [0.6, 1]], 80).T
        low, high = intervals.rank([a], [b], intervals.Resamples.of([80], seed)).spearman[1:]
        inside += low <= truth <= high
    assert inside >= 51


def test_several_maps_widen_the_interval_and_are_averaged():
    random = np.random.default_rng(4)
    # Within each map the values say nothing; between maps everything.
    errors = [np.exp(m + 0.1 * random.standard_normal(50)) for m in range(4)]
    values = [m + 0.1 * random.standard_normal(50) for m in range(4)]
    found = intervals.rank(values, errors, intervals.Resamples.of([50] * 4))
    assert found.spearman.value > 0.85
    assert abs(found.within.value) < 0.2
    alone = intervals.rank(
        [np.concatenate(values)], [np.concatenate(errors)], intervals.Resamples.of([200])
    )
    assert found.spearman.high - found.spearman.low > alone.spearman.high - alone.spearman.low


# Predictors.


def test_predictions_are_what_the_fields_say(grid):
    made = evaluate(grid, places=3, drives=1, scans=1)
    (found,), (places,) = made.predictions, made.places
    at = tuple(places.points.T)
    field = locplan.load_or_compute(grid)
    assert found[Predictor("sad", "e")] == pytest.approx(field.e[at])
    paper = locplan.load_or_compute(grid, FieldConfig(Sad.paper()))
    assert found[Predictor("paper", "e")] == pytest.approx(paper.e[at])
    fused = locplan.load_or_compute(grid, locplan.Fused(SHORT_LIDAR))
    assert found[Predictor("fused", "e")] == pytest.approx(fused.e[at])
    cells = places.points * 2
    assert found[Predictor("clearance", "")].tolist() == grid.clearance[tuple(cells.T)].tolist()
    walls = np.argwhere(grid.cells == 0)
    near = [np.sum(np.linalg.norm(walls - cell, axis=1) <= 60) for cell in cells]
    assert found[Predictor("few occupied cells", "")].tolist() == [-n for n in near]


def test_a_sensor_that_does_not_see_all_round_is_predicted_over_headings(grid):
    sensor = locplan.Lidar(range=6.0, field_of_view_deg=180.0, beams=60)
    points = np.array([[15, 20], [18, 100]])
    field = locplan.covariance_field(grid, FieldConfig(Fisher(sensor)))
    expected = field.mean_covariance[tuple(points.T)]
    assert covariances_at(grid, field.config, points) == pytest.approx(expected)


def test_covariances_along_poses_are_those_of_the_field(grid):
    sensor = locplan.Lidar(range=6.0, field_of_view_deg=180.0, beams=60)
    field = locplan.covariance_field(grid, FieldConfig(Fisher(sensor)))
    poses = np.array([[3.03, 3.31, 0.4], [20.5, 3.0, -2.9], [500.0, 0.0, 0.0], [20.47, 3.12, 1.0]])
    for known in (poses, poses[:, :2]):  # without headings all of the field's count
        expected = [field.at(*pose) for pose in known]
        found = covariances_along(grid, field.config, known)
        assert found == pytest.approx(np.array(expected), nan_ok=True)
        assert np.isfinite(expected).sum() == 27


def test_covariances_along_poses_take_no_arrays_of_the_whole_map():
    large = locplan.OccupancyGrid(np.full((400, 400), 254), 0.2)
    config = FieldConfig(Fisher(locplan.Lidar(range=2.0, field_of_view_deg=180.0, beams=12)))
    tracemalloc.start()
    covariances_along(large, config, np.array([[40.0, 40.0, 0.0]]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    field = 8 * np.prod(field_shapes(large, config)["covariance"])
    assert peak < field / 3


def test_predictions_that_take_too_much_memory_are_refused():
    fine, points = locplan.OccupancyGrid(np.full((20, 20), 254), 0.001), np.array([[0, 0]])
    with pytest.raises(ConfigError, match="too fine for a range of 6 m"):
        covariances_at(fine, FieldConfig(Sad(window=SearchWindow(half_width=30))), points)


# Evaluations.


def test_an_evaluation_ranks_every_predictor_by_both_errors(evaluation):
    assert len(evaluation.places) == 2
    assert len(evaluation.ranks) == 2 * 23
    for found in evaluation.ranks.values():
        assert -1 <= found.spearman.low <= found.spearman.high <= 1
        assert 0 <= found.auc.value <= 1
    errors = np.concatenate([each.position_rmse("match") for each in evaluation.places])
    values = np.concatenate([found[Predictor("scan", "e")] for found in evaluation.predictions])
    expected = stats.spearmanr(values, errors)[0]
    rank_of = evaluation.ranks[Predictor("scan", "e"), "match"]
    assert rank_of.spearman.value == pytest.approx(expected)
    headings = np.concatenate([each.heading_rmse("match") for each in evaluation.places])
    turns = np.concatenate(
        [found[Predictor("fisher", "heading_std")] for found in evaluation.predictions]
    )
    rank_of = evaluation.ranks[Predictor("fisher", "heading_std"), "match"]
    assert rank_of.spearman.value == pytest.approx(stats.spearmanr(turns, headings)[0])


def test_an_evaluation_concludes_from_its_own_numbers(evaluation):
    halves = np.concatenate([each.halves for each in evaluation.places])
    expected = stats.spearmanr(*halves.T)[0]
    assert evaluation.agreement.value == pytest.approx(expected)
    scans = np.concatenate([each.position_rmse("match") for each in evaluation.places])
    failed = (scans > 0.25).mean()
    median = np.median(np.concatenate([each.tracking_median for each in evaluation.places]))
    assert f"at {100 * failed:.0f} % of the places" in evaluation.conclusion[1]
    assert f"its median error is {median:.2f} m" in evaluation.conclusion[1]
    once = [
        dataclasses.replace(each, halves=np.full_like(each.halves, np.nan))
        for each in evaluation.places
    ]
    assert np.isnan(dataclasses.replace(evaluation, places=once).agreement).all()


def test_an_evaluation_is_the_same_again_and_on_one_thread(grid):
    few = {"places": 4, "drives": 2, "scans": 2}
    one, two = (evaluate([grid], threads=threads, **few) for threads in (1, 2))
    assert (one.places[0].tracking == two.places[0].tracking).all()
    assert (one.places[0].match == two.places[0].match).all()
    assert one.summary() == two.summary()


def test_evaluations_are_written_and_drawn(evaluation, tmp_path):
    evaluation.save(tmp_path / "out")
    about = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert [each["name"] for each in about["maps"]] == ["two_corridors", "places"]
    assert about["robot"]["filter"]["sigma_hit"] == 0.2
    with (tmp_path / "out" / "places.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(each.points) for each in evaluation.places)
    first = evaluation.places[0]
    assert float(rows[0]["tracking_rmse"]) == pytest.approx(first.position_rmse("tracking")[0])
    assert float(rows[0]["x"]) == pytest.approx(first.xy[0, 0])
    assert float(rows[0]["sad_e"]) == pytest.approx(
        evaluation.predictions[0][Predictor("sad", "e")][0]
    )
    many = dataclasses.replace(
        evaluation, places=[*evaluation.places] * 4, predictions=[*evaluation.predictions] * 4
    )
    assert "8 maps" in simulation.evaluation_figure(many).subfigs[0].get_suptitle()
    table = evaluation.report()
    assert "paper visible, heading *" in table
    assert table.split("\n\n")[-1].replace("\n", " ") == " ".join(evaluation.conclusion)
    assert "best" not in table
    assert SHORT_LIDAR.title in table
    assert about["conclusion"] == evaluation.conclusion
    assert about["maps"][1]["lost_rate"] == pytest.approx(evaluation.places[1].lost.mean())
    median = np.quantile(evaluation.places[0].tracking_median, (0.1, 0.5, 0.9))
    assert about["maps"][0]["tracking_median_10_50_90"] == pytest.approx(median)
    assert float(rows[0]["tracking_median"]) == pytest.approx(first.tracking_median[0])
    assert float(rows[0]["lost_rate"]) == first.lost[0]
    assert "28 places, 3 drives to each" in table
    lines = table.splitlines()
    (at,) = (n for n, line in enumerate(lines) if line.startswith("  two_corridors"))
    assert lines[at + 1].startswith("  places ")  # no number is broken at 80 columns
    few = dataclasses.replace(
        evaluation, places=evaluation.places[:1], predictions=evaluation.predictions[:1]
    )
    assert "14 places are too few to tell" in few.report()


# Calibrations.


def made_up_places(grid, config, level, *, noise=0.1):
    """Places whose errors are those of a noise level, but for some scatter."""
    field = locplan.load_or_compute(grid, FieldConfig())
    i, j = np.nonzero(field.evaluated)
    chosen = np.random.default_rng(0).choice(len(i), 120, replace=False)
    points = np.column_stack([i, j])[chosen]
    plain = changed(config, noise_level=1.0)
    q = config.estimator.q(config.estimator.lattice(grid.resolution)) * config.estimator.adds_q
    scatter = np.exp(noise * np.random.default_rng(1).standard_normal(120))[:, None, None]
    moments = scatter * (level * (covariances_at(grid, plain, points) - q) + q)
    rmse = np.sqrt(moments[:, 0, 0] + moments[:, 1, 1])
    halves = np.column_stack([rmse, rmse])
    return Places(grid, points, moments, 4 * moments, rmse, 2 * rmse, *[0 * rmse] * 2, rmse, halves)


@pytest.fixture(scope="module")
def places(grid):
    """Those of the defaults with a noise level of 0.3."""
    return made_up_places(grid, FieldConfig(), 0.3)


@pytest.mark.parametrize(
    "config",
    [
        FieldConfig(),
        FieldConfig(Sad.paper()),
        FieldConfig(Fisher(Lidar(range=6.0))),
        FieldConfig(Scan(Lidar(range=6.0))),
    ],
)
def test_a_calibration_finds_the_noise_level(grid, config):
    places = made_up_places(grid, config, 0.3)
    result = calibrate([places], config)
    assert result.config.estimator.noise_level == pytest.approx(0.3, rel=0.1)
    assert result.noise_level.low < 0.3 < result.noise_level.high
    assert result.factor < 1.1
    assert result.factor <= result.factor_before
    assert result.consistency == pytest.approx(1.0, abs=0.1)
    assert result.in_metres
    assert not result.fitted_tau
    assert result.within_two == 1.0
    apart = np.log(result.predicted / result.measured)
    expected = 1 - np.mean(apart**2) / np.log(result.measured).var()
    assert result.r_squared == pytest.approx(expected)
    assert result.config == changed(config, noise_level=result.config.estimator.noise_level)
    if not config.estimator.adds_q:
        fourfold = calibrate([places], config, error="match")
        assert fourfold.config.estimator.noise_level == pytest.approx(
            4 * result.config.estimator.noise_level, rel=1e-3
        )


def test_a_calibration_finds_tau_if_asked(grid):
    tau = 0.2035  # about one that is tried
    places = made_up_places(grid, FieldConfig(Sad(weights=Exponential(tau))), 0.3, noise=0.02)
    result = calibrate([places], FieldConfig(), fit_tau=True)
    assert result.config.estimator.tau == pytest.approx(tau, rel=0.5)
    assert result.config.estimator.noise_level == pytest.approx(0.3, rel=0.4)
    assert result.factor < calibrate([places], FieldConfig()).factor
    assert result.fitted_tau
    again = calibrate([places], result.config)
    assert not again.fitted_tau
    assert again.summary()["tau"] is None
    with pytest.raises(LocplanError, match="tau is of the exponential weights"):
        calibrate([places], FieldConfig(Sad.paper()), fit_tau=True)


@pytest.mark.long
def test_a_calibration_does_not_depend_on_the_stride_or_the_order_of_maps(grid):
    fine = environments.make("two_corridors")
    coarse = environments.make("places", resolution=0.1)
    config = FieldConfig(Sad(window=SearchWindow(step=0.25)))  # of which Q differs between the maps
    every = [
        dataclasses.replace(made_up_places(each, config, 0.3), points=points)
        for each in (fine, coarse)
        for points in [made_up_places(each, config, 0.3).points]
    ]
    forwards, backwards = calibrate(every, config), calibrate(every[::-1], config)
    assert forwards.config.estimator.noise_level == pytest.approx(
        backwards.config.estimator.noise_level, rel=1e-4
    )
    assert forwards.consistency == pytest.approx(backwards.consistency, rel=1e-4)
    other = calibrate(every, dataclasses.replace(config, stride=0.5))
    assert other.config.estimator.noise_level == pytest.approx(
        forwards.config.estimator.noise_level, rel=1e-6
    )


def test_errors_below_what_q_adds_do_not_calibrate(places):
    tiny = dataclasses.replace(places, tracking=1e-6 * places.tracking)
    with pytest.raises(LocplanError, match="do not determine k: they are below what Q adds"):
        calibrate([tiny])


def test_a_few_large_errors_do_not_make_sigma_large(places):
    factors = np.ones(len(places.points))
    factors[np.argsort(places.position_rmse("tracking"))[:6]] = 1e4  # where Sigma is least
    wild = dataclasses.replace(places, tracking=places.tracking * factors[:, None, None])
    result = calibrate([wild])
    assert result.config.estimator.noise_level < 3
    assert result.factor <= result.factor_before


def test_a_calibration_that_says_nothing_says_so(places):
    order = np.argsort(places.position_rmse("tracking"))
    backwards = np.empty_like(places.tracking)
    backwards[order] = places.tracking[order[::-1]]
    with pytest.raises(CalibrationError, match="do not determine k"):
        calibrate([dataclasses.replace(places, tracking=backwards)])
    with pytest.raises(CalibrationError, match="it would be above 10000; calibrate on other maps"):
        calibrate([dataclasses.replace(places, tracking=1e9 * places.tracking)])
    poor = dataclasses.replace(calibrate([places]), r_squared=-0.1)
    assert "NOT IN METRES" in poor.report()
    assert not poor.in_metres
    assert simulation.calibration_figure(poor).axes[0].get_title().startswith("NOT IN METRES: sad")


def test_settings_that_are_not_in_metres_warn_wherever_they_are_read(places, tmp_path):
    good = calibrate([places])
    for result in (good, dataclasses.replace(good, r_squared=0.0)):
        result.save(tmp_path / "c.json", Robot(), force=True)
        about = json.loads((tmp_path / "c.json").read_text())
        assert about["in_metres"] is about["calibration"]["in_metres"] is result.in_metres
        if result.in_metres:
            assert locplan.load_config(tmp_path / "c.json") == result.config
            continue
        assert "Σ follows these errors less than one value" in about["why"]
        with pytest.warns(CalibrationWarning, match="c.json: deviations .* not in metres") as told:
            assert locplan.load_config(tmp_path / "c.json") == result.config
        assert told[0].filename == __file__


def test_too_few_places_cannot_calibrate(places):
    few = dataclasses.replace(
        places, points=places.points[:5], tracking=places.tracking[:5], match=places.match[:5]
    )
    undriven = dataclasses.replace(places, tracking=np.full_like(places.tracking, np.nan))
    for each in ([few], [undriven], []):
        with pytest.raises(LocplanError, match="at least 10 places, all with tracking errors"):
            calibrate(each)
    with pytest.raises(LocplanError, match="error must be one of tracking, match"):
        calibrate([places], error="both")


# Commands.


@pytest.fixture(scope="module")
def map_file(grid, tmp_path_factory):
    file = tmp_path_factory.mktemp("maps") / "corridors.yaml"
    locplan.save_map(grid, file)
    return file


ENDS = ("--start", "2,3", "--goal", "6,9")


def test_simulate_drives_both_paths(run, map_file, tmp_path):
    out = tmp_path / "out"
    code, table, err = run("simulate", map_file, *ENDS, "--drives", 4, "-o", out)
    assert code == 0
    assert [row.split("  ")[1] for row in table.splitlines()[2:9]] == [
        "length [m]",
        "error of a typical drive [m]",
        "median error [m]",
        "off by > 1 m at some time",
        "off by > 0.5 m at the goal",
        "RMSE of those never off [m]",
        "RMSE of all [m]",
    ]
    assert "4 drives each" in table
    assert err.endswith(f"wrote {out}\n")
    about = json.loads((out / "simulation.json").read_text())
    assert set(about["paths"]) == {"shortest", "localizability-aware"}
    assert about["robot"]["lidar"]["range"] == 6.0
    assert about["weight"] == 4.0
    with (out / "errors.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["path"] for row in rows} == set(about["paths"])
    assert float(rows[0]["x"]) == 2.0
    assert all(float(row["error_mean"]) > 0 for row in rows)
    assert (out / "simulation.png").stat().st_size > 10_000


def test_simulate_takes_the_paths_that_plan_writes(run, map_file, tmp_path):
    run("plan", map_file, *ENDS, "-o", tmp_path / "plan")
    file = tmp_path / "plan" / "01-shortest.csv"
    code, out, _ = run(
        "simulate", map_file, "--path", file, "--drives", 3, "--json",
        "--set", "max_particles=600", "--set", "laser_model_type=likelihood_field_prob",
        "--set", "outliers=0.1", "--lidar", "rplidar-a1",
    )  # fmt: skip
    about = json.loads(out)
    assert code == 0
    assert list(about["paths"]) == ["01-shortest"]
    assert about["robot"]["filter"]["max_particles"] == 600
    assert about["robot"]["filter"]["laser_model_type"] == "likelihood_field_prob"
    assert about["robot"]["disturbances"]["outliers"] == 0.1
    assert about["robot"]["lidar"]["range"] == 12.0


def test_simulate_random_queries_of_several_maps(run, map_file, tmp_path):
    other = tmp_path / "b.yaml"
    locplan.save_map(environments.make("places", resolution=0.1), other)
    asked = "--random", 5, "--drives", 2, "--min-distance", 4
    code, table, _ = run("simulate", map_file, other, *asked, "-o", tmp_path / "out")
    assert code == 0
    assert "of 5 queries" in table
    assert len(list((tmp_path / "out").glob("*.png"))) == 2
    about = json.loads((tmp_path / "out" / "queries.json").read_text())
    first = about["maps"][0]
    assert len(first["queries"]) == 5
    with (tmp_path / "out" / "queries.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["map"] for row in rows] == ["corridors"] * 5 + ["b"] * 5
    one = first["queries"][0]["paths"]["shortest"]
    assert float(rows[0]["rmse_shortest"]) == pytest.approx(one["rmse"][0])
    ratios = [
        q["paths"]["localizability-aware"]["rmse"][0] / q["paths"]["shortest"]["rmse"][0]
        for q in first["queries"]
    ]
    assert first["rmse_ratio"][0] == pytest.approx(stats.gmean(ratios))
    low, high = first["rmse_ratio"][1:]
    expected = "helps" if high < 1 else "harms" if low > 1 else "unclear"
    assert first["verdict"] == expected


def test_an_unreachable_goal_is_a_result(run, tmp_path):
    cells = np.full((40, 60), 254, np.uint8)
    cells[:, 30] = 0
    locplan.save_map(locplan.OccupancyGrid(cells, 0.1), tmp_path / "cut.yaml")
    code, out, _ = run("simulate", tmp_path / "cut.yaml", "--start", "1,1", "--goal", "5,1")
    assert (code, out) == (0, "unreachable: no path leads to the goal\n")
    asked = "--start", "1,1", "--goal", "5,1", "--json"
    code, out, _ = run("simulate", tmp_path / "cut.yaml", *asked)
    assert json.loads(out) == {"status": "unreachable"}


def test_what_is_simulated_is_not_written_over(run, map_file, tmp_path):
    run("plan", map_file, *ENDS, "-o", tmp_path)
    before = (tmp_path / "01-shortest.csv").read_bytes()
    run("simulate", map_file, "--path", tmp_path / "01-shortest.csv", "--drives", 2, "-o", tmp_path)
    assert (tmp_path / "01-shortest.csv").read_bytes() == before


def test_evaluate_and_calibrate_and_plan_with_what_they_wrote(run, map_file, tmp_path):
    few = ("--places", 10, "--drives", 2, "--set", "half_cell=false")
    code, table, _ = run("evaluate", map_file, *few, "--scans", 2, "-o", tmp_path / "out")
    assert code == 0
    assert "fused, position" in table
    assert (tmp_path / "out" / "evaluation.png").stat().st_size > 10_000
    target = tmp_path / "calibrated.json"
    code, table, _ = run("calibrate", map_file, *few, "--seed", 5, "-o", target)
    assert code == 0
    assert "noise level k" in table
    assert target.with_name(f"{target.stem}_calibration.png").stat().st_size > 10_000
    config = locplan.load_config(target)
    assert config.estimator.noise_level != 1.0
    code, out, _ = run("field", map_file, "--config", target, "--json")
    assert json.loads(out)["config"]["estimator"]["noise_level"] == config.estimator.noise_level
    code, out, _ = run("field", map_file, "--config", target, "--set", "range=4", "--json")
    assert json.loads(out)["config"]["estimator"]["range"] == 4.0
    err = refused(run("plan", map_file, *ENDS, "--config", target, "--stride", 0.4))
    assert "--config has all settings of the field; leave out --stride" in err


@pytest.mark.usefixtures("inline_workers")
def test_calibrations_that_are_not_in_metres_have_their_own_exit_code(
    run, grid, map_file, tmp_path, monkeypatch
):
    target, paper = tmp_path / "c.json", FieldConfig(Sad.paper())
    places = made_up_places(grid, paper, 0.3)
    monkeypatch.setattr("locplan.simulation.measure_maps", lambda *_, **__: [places])
    asked = "calibrate", map_file, "--preset", "paper", "-o", target
    target.write_text("mine")
    assert "c.json: is there, and no calibration" in refused(run(*asked))
    assert run(*asked, "--force")[0] == 0
    _, _, err = run("field", map_file, "--config", target)
    assert err == ""
    moments = np.random.default_rng(0).permutation(places.tracking)
    places = dataclasses.replace(places, tracking=moments)
    code, out, _ = run("calibrate", map_file, "--preset", "paper", "-o", target, "--json")
    assert code == 3
    assert json.loads(out)["in_metres"] is False
    few = "--random", "1", "--planner", "any-angle", "--workers", "1", "--ranges", "4,5"
    for command in (("field", map_file), ("compare", map_file, *few, "-o", target)):
        _, _, err = run(*command, "--config", target)
        warned = [line for line in err.splitlines() if line.startswith("locplan: warning: ")]
        assert len(warned) == 1
        assert "c.json: deviations of this field are not in metres" in warned[0]
    for written in (target, target.with_name("c_calibration.png")):
        written.unlink()
    places = dataclasses.replace(places, tracking=1e9 * places.tracking)
    code, out, err = run("calibrate", map_file, "--preset", "paper", "-o", target)
    assert (code, out) == (3, "")
    assert err.startswith("locplan: error: the errors do not determine k")
    assert not target.exists()


def test_simulations_that_are_not_made_are_refused(run, map_file):
    for error, unread in (("tracking", "scans"), ("match", "drives")):
        err = refused(run("calibrate", map_file, "--error", error, f"--{unread}", 3))
        assert f"--{unread} is not read with --error {error}" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((), "give one of --path"),
        (("--start", "2,3"), "give one of --path"),
        (("--start", "2,3", "--random", "3"), "give one of --path"),
        (("--goal", "2,3", "--path", "a.csv"), "give one of --path"),
        ((*ENDS, "--random", "3"), "give one of --path"),
        ((*ENDS, "--set", "alpha9=1"), "a robot has no setting 'alpha9'; it has footprint,"),
        ((*ENDS, "--set", "alpha1"), "--set must be NAME=VALUE, such as alpha1=0.05"),
        ((*ENDS, "--set", "alpha1=often"), "alpha1 must be at least 0"),
        ((*ENDS, "--set", "max_particles=3"), "must not exceed max_particles"),
        ((*ENDS, "--lidar", "sonar"), "--lidar must be one of rplidar-a1"),
        ((*ENDS, "--robot", "none.yaml"), "none.yaml: there is no such file"),
        ((*ENDS, "--config", "none.json"), "none.json: cannot be read"),
        ((*ENDS, "--weight", "-1"), "weight"),
        (("--start", "0,0.1", "--goal", "6,9"), "start"),
        (("--path", "none.csv"), "none.csv: cannot be read"),
        (("--path", "a.csv", "--weight", "3"), "--weight is not read with --path"),
        (("--path", "a.csv", "--stride", "1"), "--stride is not read with --path"),
        ((*ENDS, "--min-distance", "3"), "--min-distance is not read without --random"),
    ],
)
def test_wrong_requests_end_in_one_line(run, map_file, tmp_path, arguments, reason):
    out = tmp_path / "out"
    assert reason in refused(run("simulate", map_file, *arguments, "-o", out))
    assert not out.exists()


def test_wrong_evaluations_end_in_one_line(run, map_file, tmp_path):
    assert "there is no such file" in refused(run("evaluate", tmp_path / "no.yaml"))
    assert "must be one of tracking, match" in refused(
        run("calibrate", map_file, "--error", "both")
    )
    assert "must end in .json" in refused(run("calibrate", map_file, "-o", tmp_path / "c.txt"))
    assert "robot fits" in refused(run("evaluate", map_file, "--set", "footprint=20"))
    locplan.save_map(locplan.load_map(map_file), tmp_path / "other.yaml")
    several = map_file, tmp_path / "other.yaml"
    assert "name one of these 2, or give --random" in refused(run("simulate", *several, *ENDS))


def test_a_real_map_is_evaluated_with_other_settings(real_maps):
    grid = locplan.load_map(next((real_maps / "aws_small_house").glob("*.yaml")))
    amcl = Amcl(min_particles=100, max_particles=100)
    found = evaluate([grid], robot=Robot(filter=amcl), places=6, drives=2, scans=2)
    assert found.places[0].position_rmse("match").max() < 0.5
    assert SHARED_DATA.exists()

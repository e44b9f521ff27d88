"""Ranks, covariances at places, and the commands that simulate."""

from __future__ import annotations

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from scipy import stats
from support.command_line import check_refusal

import locplan
from locplan import FieldConfig
from locplan._support import intervals
from locplan.field import Fisher
from locplan.maps import environments
from locplan.simulation.drives import RATE_COLUMNS


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


# Ranks.


def test_rank_correlations_are_scipys():
    random = np.random.default_rng(0)
    for n in (5, 40, 200):
        values, errors = random.integers(0, 12, n).astype(float), random.lognormal(size=n)
        assert intervals.compute_spearman(values, errors) == pytest.approx(
            stats.spearmanr(values, errors)[0]
        )
    assert intervals.compute_spearman(np.ones(6), np.arange(6.0)) == 0


def test_auc_equals_rank_sum_statistic():
    random = np.random.default_rng(1)
    values, errors = random.integers(0, 9, 60).astype(float), random.lognormal(size=60)
    worst = np.argsort(errors)[-12:]
    others = np.setdiff1d(np.arange(60), worst)
    expected = stats.mannwhitneyu(values[worst], values[others]).statistic / (12 * 48)
    assert intervals.compute_auc(values, errors) == pytest.approx(expected)


def test_resampled_ranks_equal_repeated_places():
    random = np.random.default_rng(2)
    values, errors = random.integers(0, 9, (2, 30)).astype(float)
    drawn = intervals.BootstrapResamples.from_counts([30])
    assert (drawn.places[0].sum(axis=1) == 30).all()
    one = dataclasses.replace(
        drawn, places=[np.repeat(drawn.places[0][:1], intervals.RESAMPLES, axis=0)]
    )
    often = drawn.places[0][0].astype(int)
    expected = stats.spearmanr(np.repeat(values, often), np.repeat(errors, often))[0]
    assert intervals.compute_rank_statistics([values], [errors], one).spearman[1:] == pytest.approx(
        (expected, expected)
    )


def test_rank_correlation_intervals_cover_truth():
    random, inside = np.random.default_rng(3), 0
    truth = 6 / math.pi * math.asin(0.6 / 2)  # Spearman's of a bivariate normal with r = 0.6
    for seed in range(60):
        a, b = random.multivariate_normal([0, 0], [[1, 0.6], [0.6, 1]], 80).T
        low, high = intervals.compute_rank_statistics(
            [a], [b], intervals.BootstrapResamples.from_counts([80], seed)
        ).spearman[1:]
        inside += low <= truth <= high
    assert inside >= 51


def test_several_maps_widen_rank_interval():
    """Maps are resampled, too."""
    random = np.random.default_rng(4)
    # Within each map the values say nothing; between maps everything.
    errors = [np.exp(m + 0.1 * random.standard_normal(50)) for m in range(4)]
    values = [m + 0.1 * random.standard_normal(50) for m in range(4)]
    found = intervals.compute_rank_statistics(
        values, errors, intervals.BootstrapResamples.from_counts([50] * 4)
    )
    assert found.spearman.value > 0.85
    assert abs(found.within.value) < 0.2
    alone = intervals.compute_rank_statistics(
        [np.concatenate(values)],
        [np.concatenate(errors)],
        intervals.BootstrapResamples.from_counts([200]),
    )
    assert found.spearman.high - found.spearman.low > alone.spearman.high - alone.spearman.low


# Covariances.


def test_field_at_poses_equals_whole_field(grid):
    """As the evaluation of a recording computes it; without headings all of them count."""
    sensor = locplan.Lidar(range=6.0, field_of_view_deg=180.0, beams=60)
    config = FieldConfig(Fisher(sensor))
    poses = np.array([[3.03, 3.31, 0.4], [20.5, 3.0, -2.9], [500.0, 0.0, 0.0], [20.47, 3.12, 1.0]])
    points = config.lattice_points(grid, poses)
    assert 4 <= points.sum() <= 12
    part, whole = (locplan.covariance_field(grid, config, points=each) for each in (points, None))
    for known in (poses, poses[:, :2]):
        values = part.at(known, "covariance")
        np.testing.assert_array_equal(values, whole.at(known, "covariance"))
        assert np.isfinite(values).sum() == 27


# Commands.


@pytest.fixture(scope="module")
def map_file(grid, tmp_path_factory):
    file = tmp_path_factory.mktemp("maps") / "corridors.yaml"
    locplan.save_map(grid, file)
    return file


ENDS = ("--start", "2,3", "--goal", "6,9")


def test_simulate_drives_both_paths(run, map_file, tmp_path):
    out = tmp_path / "out"
    code, table, _ = run("simulate", map_file, *ENDS, "--drives", 4, "-o", out)
    assert code == 0
    assert [row.split("  ")[1] for row in table.splitlines()[2:9]] == [
        "length [m]",
        "error of a typical drive [m]",
        "median error [m]",
        *(column.title for column in RATE_COLUMNS),
        "RMSE of those never lost [m]",
        "RMSE of all [m]",
    ]
    assert "4 drives each" in table
    assert f"wrote {out}/simulation.png: the picture\n" in table
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


def test_simulate_reads_path_of_plan(run, map_file, tmp_path):
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


@pytest.mark.usefixtures("undrawn")
def test_simulate_random_queries_of_several_maps(run, map_file, tmp_path):
    other = tmp_path / "b.yaml"
    locplan.save_map(environments.make("places", resolution=0.1), other)
    asked = "--random", 5, "--drives", 2, "--min-distance", 4
    few = "--set", "min_particles=100", "--set", "max_particles=100"
    code, table, _ = run("simulate", map_file, other, *asked, *few, "-o", tmp_path / "out")
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


def test_simulate_reports_unreachable_goal(run, tmp_path):
    cells = np.full((40, 60), 254, np.uint8)
    cells[:, 30] = 0
    locplan.save_map(locplan.OccupancyGrid(cells, 0.1), tmp_path / "cut.yaml")
    code, out, _ = run("simulate", tmp_path / "cut.yaml", "--start", "1,1", "--goal", "5,1")
    assert (code, out) == (0, "unreachable: no path leads from start to goal\n")
    asked = "--start", "1,1", "--goal", "5,1", "--json"
    code, out, _ = run("simulate", tmp_path / "cut.yaml", *asked)
    assert json.loads(out) == {"status": "unreachable"}


@pytest.mark.usefixtures("undrawn")
def test_simulate_keeps_its_path_file(run, map_file, tmp_path):
    """The path lies in the output folder."""
    run("plan", map_file, *ENDS, "-o", tmp_path)
    before = (tmp_path / "01-shortest.csv").read_bytes()
    run("simulate", map_file, "--path", tmp_path / "01-shortest.csv", "--drives", 2, "-o", tmp_path)
    assert (tmp_path / "01-shortest.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((), "name the paths with one of --path, --start and --goal, --random, or --recording"),
        (("--start", "2,3"), "--start and --goal belong together"),
        (("--start", "2,3", "--random", "3"), "belong together"),
        (("--goal", "2,3", "--path", "a.csv"), "belong together"),
        ((*ENDS, "--random", "3"), "name the paths with one of --path"),
        ((*ENDS, "--set", "alpha9=1"), "a robot has no setting 'alpha9'; it has footprint,"),
        ((*ENDS, "--set", "alpha1"), "--set must be NAME=VALUE, such as alpha1=0.05"),
        ((*ENDS, "--set", "alpha1=often"), "alpha1 must be a number of at least 0"),
        ((*ENDS, "--set", "max_particles=3"), "must not exceed max_particles"),
        ((*ENDS, "--lidar", "sonar"), "--lidar must be one of rplidar-a1"),
        ((*ENDS, "--robot", "none.yaml"), "none.yaml: there is no such file"),
        ((*ENDS, "--field", "none.json"), "none.json: there is no such file"),
        ((*ENDS, "--weight", "-1"), "weight"),
        (("--start", "0,0.1", "--goal", "6,9"), "start"),
        (("--path", "none.csv"), "none.csv: there is no such file"),
        (("--path", "a.csv", "--weight", "3"), "--weight has no effect with --path"),
        (("--path", "a.csv", "--stride", "1"), "--stride has no effect with --path"),
        ((*ENDS, "--min-distance", "3"), "--min-distance has no effect without --random"),
    ],
)
def test_wrong_requests_end_in_one_line(run, map_file, tmp_path, arguments, reason):
    out = tmp_path / "out"
    assert reason in check_refusal(run("simulate", map_file, *arguments, "-o", out))
    assert not out.exists()


def test_simulate_rejects_path_on_several_maps(run, map_file, tmp_path):
    locplan.save_map(locplan.load_map(map_file), tmp_path / "other.yaml")
    several = map_file, tmp_path / "other.yaml"
    error = check_refusal(run("simulate", *several, *ENDS))
    assert "a path needs one map; name one of these 2, or use --random" in error

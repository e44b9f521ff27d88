"""Summaries, paired comparisons, and tables of runs."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.comparison_runs import failed_run, fake_runs, solved_run

from locplan._support import intervals
from locplan.comparison.result import Comparison
from locplan.comparison.statistics import MEASURES, RunTask
from locplan.errors import LocplanError

ABOUT = {"began": "2025-03-04T05:06:07"}


def contrasts(runs, baseline, pooled=False):
    return Comparison(tuple(runs), baseline, {}).contrasts(pooled=pooled)


def summaries(runs):
    return Comparison(tuple(runs), "", {}).summaries()


def rows_of(runs, baseline):
    table = Comparison(tuple(runs), baseline, {}).table()
    return {row["planner"]: row for row in table.records()}


def compare_values(ours, theirs, measure="cost"):
    """The comparison of planners whose measure has these values on successive queries."""
    runs = []
    for planner, values in (("mine", ours), ("base", theirs)):
        for query, value in enumerate(values):
            task = RunTask("rooms", "6 m", f"q{query}", 4.0, planner, 0)
            runs.append(solved_run(task, **{"cost": 10.0, measure: value}))
    return select_one(contrasts(runs, "base"), planner="mine", measure=measure)


def select_one(found, **wanted):
    (one,) = [each for each in found if all(getattr(each, k) == v for k, v in wanted.items())]
    return one


def test_contrast_estimates_known_ratio():
    runs = fake_runs({"base": 1.0, "anytime": 0.9, "dear": 3.0, "same": 1.0})
    of_cost = [each for each in contrasts(runs, "base", pooled=True) if each.measure == "cost"]
    cheap = select_one(of_cost, planner="anytime")
    assert cheap.pairs == 24
    assert cheap.estimate.value == pytest.approx(0.9, abs=0.02)
    assert cheap.sentence.split(" [")[0].endswith("% cheaper than base")
    assert select_one(of_cost, planner="dear").sentence.startswith("cost J 2.99 times base's [")
    assert select_one(of_cost, planner="same").sentence.startswith(
        "no significant difference from base"
    )


def test_ratio_has_student_interval_of_logarithms():
    rng = np.random.default_rng(3)
    theirs = rng.uniform(5, 50, 9)
    ours = theirs * np.exp(rng.normal(-0.1, 0.05, 9))
    logs = np.log(ours / theirs)
    low, high = stats.t.interval(0.95, 8, logs.mean(), stats.sem(logs))
    found = compare_values(ours, theirs).estimate
    assert found == pytest.approx((np.exp(logs.mean()), np.exp(low), np.exp(high)))


def test_mean_has_student_interval():
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776445 * np.sqrt(2.5 / 5)  # the table's t of 4 degrees of freedom
    assert intervals.estimate_mean(values) == pytest.approx((3.0, 3.0 - half, 3.0 + half), rel=1e-6)
    assert intervals.estimate_geometric_mean(np.exp(values)) == pytest.approx(
        np.exp(intervals.estimate_mean(values))
    )
    low, high = stats.t.interval(0.95, 11, 3.5, stats.sem(np.arange(12)))
    assert intervals.estimate_mean(np.arange(12) - 2.0)[1:] == pytest.approx((low, high))


def test_rms_interval_equals_jackknife():
    squares = np.array([0.7, 1.9, 1.1, 2.6, 0.4])
    others = np.ones(5)
    log = lambda kept: np.log(squares[kept].sum() / others[kept].sum())  # noqa: E731
    every = np.arange(5)
    pseudo = [5 * log(every) - 4 * log(every != n) for n in every]
    half = 2.776445 * stats.sem(pseudo)
    expected = np.exp(np.array([log(every), log(every) - half, log(every) + half]) / 2)
    assert intervals.estimate_rms(squares) == pytest.approx(expected, rel=1e-6)


def test_contrast_uses_median_over_seeds():
    runs = [
        solved_run(RunTask("rooms", "6 m", f"q{query}", 4.0, planner, seed), cost)
        for query in range(6)
        for planner, costs in (("base", [10.0]), ("mine", [9.0, 9.5, 90.0]))
        for seed, cost in enumerate(costs)
    ]
    found = select_one(contrasts(runs, "base"), planner="mine", measure="cost")
    assert found.pairs == 6
    assert found.estimate == pytest.approx((0.95, 0.95, 0.95))
    assert found.sentence == "5 % cheaper than base [5, 5]"


def test_failing_planner_leaves_other_rows_unchanged():
    runs = fake_runs({"base": 1.0, "mine": 0.9, "bad": 2.0}, maps=("rooms",))
    late = lambda run: run.task.planner == "bad" and run.task.query != "q3"  # noqa: E731
    runs = [failed_run(run.task) if late(run) else run for run in runs]
    without = [run for run in runs if run.task.planner != "bad"]
    rows = rows_of(runs, "base")
    assert rows["mine"] == rows_of(without, "base")["mine"]
    costs = {(r.task.planner, r.task.query): r.measures["cost"] for r in runs if r.measures}
    assert (rows["mine"]["pairs"], rows["bad"]["pairs"]) == (12, 1)
    assert rows["bad"]["cost"] == costs["bad", "q3"]
    assert rows["bad"]["baseline_cost"] == costs["base", "q3"]


def test_row_statistics_use_same_values():
    seeds = {"base": (10.0, 10.0, 10.0), "mine": (9.0, 9.5, 90.0)}
    runs = [
        solved_run(RunTask("rooms", "6 m", f"q{query}", 4.0, planner, seed), (query + 1) * cost)
        for query in range(5)
        for planner, costs in seeds.items()
        for seed, cost in enumerate(costs)
    ]
    text = Comparison(tuple(runs), "base", {}).report()
    assert "mine 100% 5 0.950 28.50 30.00 1.43 0.030" in " ".join(text.split())
    assert "\nmine: 5 % cheaper than base [5, 5]\n" in text
    row = rows_of(runs, "base")["mine"]
    assert (row["pairs"], row["cost"], row["baseline_cost"]) == (5, 28.5, 30.0)
    contrast = select_one(contrasts(runs, "base"), planner="mine", measure="cost")
    assert (
        contrast.pairs,
        contrast.planner_quartiles.median,
        contrast.baseline_quartiles.median,
    ) == (5, 28.5, 30.0)
    assert row["ratio"] == contrast.estimate.value == pytest.approx(0.95)


def test_report_row_fits_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    runs = fake_runs({"any-angle": 1.0, "simulated choice": 0.98765}, maps=("rooms",))
    lines = Comparison(tuple(runs), "any-angle", {}).report().splitlines()
    head, rows = 2, 2
    assert len([line for line in lines if line.startswith("  ")]) == head + rows


def test_contrast_pairs_queries_solved_by_both():
    runs = fake_runs({"base": 1.0, "mine": 0.9}, maps=("rooms",))
    lost = [
        failed_run(run.task) if (run.task.planner, run.task.query) == ("mine", "q3") else run
        for run in runs
        if (run.task.planner, run.task.query) != ("base", "q5")
    ]
    assert select_one(contrasts(lost, "base"), planner="mine", measure="cost").pairs == 10
    ours, theirs = [0.2, np.nan, 0.1, 0.4, 0.3], [0.3, 0.2, np.nan, 0.1, 0.2]
    assert compare_values(ours, theirs, "degenerate_share").pairs == 3


def test_integrated_u_uses_ratio_of_sums():
    """It may be 0, which has no logarithm."""
    found = compare_values([0, 0, 1, 2, 3, 0], [0, 2, 2, 4, 4, 0], "integrated_u")
    assert found.kind == "ratio of sums"
    assert found.estimate.value == pytest.approx(0.5)
    assert found.estimate.low < 0.5 < found.estimate.high
    nothing = compare_values([0.0] * 6, [0.0] * 6, "integrated_u")
    assert np.isnan(nothing.estimate.value)
    assert nothing.sentence == "no ratio, since it is 0 for base"
    alone = compare_values([1.0] * 6, [2.0] + [0.0] * 5, "integrated_u")
    assert np.isnan(alone.estimate.low)
    assert alone.sentence == "too few queries for a verdict (6)"


def test_shares_differ_by_percentage_points():
    found = compare_values(
        [0.1, 0.1, 0.12, 0.09, 0.1], [0.3, 0.29, 0.3, 0.31, 0.3], "degenerate_share"
    )
    assert found.sentence.startswith("19.8 percentage points less with u > 0.5 than base [1")


@pytest.mark.parametrize(
    ("ours", "theirs", "pairs", "sentence"),
    [
        ([], [], 0, "solves no query that base solves"),
        ([9.0], [10.0], 1, "too few queries for a verdict (1 of 5)"),
        ([9.0] * 4, [10.0] * 4, 4, "too few queries for a verdict (4 of 5)"),
    ],
)
def test_few_pairs_give_no_verdict(ours, theirs, pairs, sentence):
    if not pairs:
        runs = [
            failed_run(RunTask("rooms", "6 m", "q", 4.0, planner, 0))
            for planner in ("base", "mine")
        ]
        found = select_one(contrasts(runs, "base"), planner="mine", measure="cost")
    else:
        found = compare_values(ours, theirs)
    assert (found.pairs, found.sentence) == (pairs, sentence)


def test_contrast_ignores_non_finite_values():
    found = compare_values(
        [9, np.nan, np.inf, 9, 9, 9, 9, 9], [10, 10, 10, 10, 10, 10, np.nan, 0.0]
    )
    assert found.pairs == 4


def test_rounding_is_no_difference():
    equal = [10.0] * 7
    rounded = [value * (1 + 1e-12) for value in equal]
    assert compare_values(equal, equal).estimate == (1, 1, 1)
    assert (
        compare_values(rounded, equal).sentence
        == "no significant difference from base [1e-10, 1e-10] %"
    )


def test_baseline_has_unit_ratio():
    runs = fake_runs({"base": 1.0, "anytime": 0.9})
    found = select_one(contrasts(runs, "base", pooled=True), planner="base", measure="cost")
    assert found.estimate == (1, 1, 1)
    assert found.sentence == ""
    with pytest.raises(LocplanError, match="grid: no runs to compare with; there are anytime, bas"):
        contrasts(runs, "grid")


def test_maps_are_strata():
    """What differs between maps does not widen the pooled interval."""
    runs = fake_runs({"base": 1.0, "mine": 1.0}, queries=8, noise=0.01)
    apart = [
        solved_run(run.task, 0.5 * run.measures["cost"])
        if (run.task.map, run.task.planner) == ("office", "mine")
        else run
        for run in runs
    ]
    found = select_one(
        contrasts(apart, "base", pooled=True), planner="mine", measure="cost"
    ).estimate
    assert found.value == pytest.approx(0.5**0.5, rel=0.02)
    assert found.high / found.low < 1.03


@pytest.mark.long
def test_ratio_interval_covers_true_ratio():
    """The 95 % interval covers the true ratio in about 95 % of 2000 simulated comparisons."""
    rng = np.random.default_rng(11)
    queries = -0.04 + rng.normal(0, 0.05, (2000, 10, 1)) + rng.normal(0, 0.03, (2000, 10, 3))
    costs = np.exp(np.median(queries, axis=2))
    planners = [("base", np.ones_like(costs)), ("mine", costs)]
    runs = [
        solved_run(RunTask(str(trial), "6 m", str(query), 4.0, planner, 0), cost)
        for planner, values in planners
        for (trial, query), cost in np.ndenumerate(values)
    ]
    found = [c for c in contrasts(runs, "base") if (c.planner, c.measure) == ("mine", "cost")]
    assert len(found) == 2000
    covered = [each.estimate.low <= np.exp(-0.04) <= each.estimate.high for each in found]
    assert 0.935 < np.mean(covered) < 0.965


def test_success_counts_queries_not_seeds():
    runs = fake_runs({"anytime": 1.0}, queries=10, maps=("rooms",))
    lost = [failed_run(run.task) if run.task.query in ("q0", "q1") else run for run in runs]
    (summary,) = summaries(lost)
    assert (summary.runs, summary.solved) == (30, 24)
    assert summary.success == pytest.approx(
        (0.8, *stats.binomtest(8, 10).proportion_ci(0.95, "wilson"))
    )
    assert intervals.compute_wilson_interval(1.0, 3).high == 1
    assert intervals.compute_wilson_interval(0.0, 3).low == 0


def test_quartiles_ignore_unknown_values():
    tasks = [RunTask("rooms", "6 m", f"q{query}", 4.0, "mine", 0) for query in range(6)]
    runs = [solved_run(task, cost) for task, cost in zip(tasks, [1, 2, 3, 4, 5], strict=False)]
    runs.append(solved_run(tasks[5], np.inf))
    (summary,) = summaries(runs)
    assert summary.measures["cost"] == (3, 2, 4, 5)
    assert summary.measures["max_e"].n_values == 0
    (nothing,) = summaries([failed_run(task) for task in tasks])
    assert nothing.success.value == 0
    assert all(np.isnan(each.median) for each in nothing.measures.values())


def test_contrasts_cover_all_measures():
    planners = {"base": 1.0, "grid": 1.04, "anytime 1": 0.99, "anytime 2": 1.01, "anytime 3": 1.1}
    runs = fake_runs(planners, queries=20, maps=("a", "b"), weights=(4.0, 12.0), seeds=3)
    assert len(runs) == 880
    assert summaries(runs)
    found = contrasts(runs, "base") + contrasts(runs, "base", pooled=True)
    assert len(found) == 6 * 5 * len(MEASURES)
    assert all(each.sentence for each in found if each.planner != "base")


def test_tables(tmp_path):
    runs = [
        *fake_runs({"base": 1.0}, queries=3),
        failed_run(RunTask("ü, ß", "6 m", "q", 4.0, "base", 0)),
    ]
    runs += fake_runs({"=1+1": -1.0}, queries=1, maps=("@x",))
    runs.append(replace(runs[0], task=replace(runs[0].task, seed=2**32 - 1, map="\udcff")))
    Comparison(tuple(runs), "base", {}, ABOUT).save(tmp_path / "out")
    with (tmp_path / "out" / "runs.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    costs = [run.measures["cost"] for run in runs[:6]]
    assert [float(row["cost"]) for row in read[:6]] == pytest.approx(costs, rel=1e-8)
    assert (read[6]["map"], read[6]["cost"]) == ("ü, ß", "")
    assert (read[7]["map"], read[7]["planner"], read[7]["cost"][0]) == ("'@x", "'=1+1", "-")
    assert (read[8]["map"], int(read[8]["seed"])) == ("?", 2**32 - 1)


def test_frame_has_every_run():
    pytest.importorskip("pandas")
    runs = [
        *fake_runs({"base": 1.0}, queries=3),
        failed_run(RunTask("rooms", "6 m", "q", 4.0, "base", 0)),
    ]
    frame = Comparison(tuple(runs), "base", {}, ABOUT).to_frame()
    assert frame.groupby("status").size()["solved"] == 6

"""Logs that OMPL's own script makes a database of."""

from __future__ import annotations

import math
import re
import sqlite3
import subprocess
import sys
from contextlib import closing
from datetime import datetime
from importlib.metadata import version
from typing import get_args, get_type_hints

import pytest
from support.comparison_runs import failed_run, fake_runs, solved_run

from locplan.comparison.benchmarks import write_ompl_logs
from locplan.comparison.statistics import STATUSES, RunTask
from locplan.errors import LocplanError
from locplan.planning import Path, PlannerResult


def database(logs, folder, *options):
    """What `ompl_benchmark_statistics` makes of the logs."""
    target = folder / "arena.db"
    command = [sys.executable, "-m", "ompl.ompl_benchmark_statistics", "-d", str(target)]
    made = subprocess.run([*command, *options, *map(str, logs)], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert "duplicate" not in made.stdout
    return closing(sqlite3.connect(target))


def rows(database, query):
    return database.execute(query).fetchall()


def test_database_has_all_runs(tmp_path):
    runs = fake_runs({"any-angle": 1.0, "anytime: range=2": 0.9}, queries=3)
    moment = datetime(2025, 3, 4, 5, 6, 7)
    logs = write_ompl_logs(
        runs,
        tmp_path / "logs",
        baseline="any-angle",
        time_limit=2.0,
        started=moment,
    )
    assert len(logs) == 2 * 3
    with database(logs, tmp_path) as made:
        assert rows(made, "SELECT DISTINCT name, timelimit, memorylimit, runcount, version, date"
                          " FROM experiments ORDER BY name") == [
            (
                f"{name},_6_m,_weight_4",
                2.0,
                None,
                3,
                f"locplan {version('locplan')}",
                "2025-03-04 05:06:07",
            )
            for name in ("office", "rooms")
        ]  # fmt: skip
        assert rows(made, "SELECT DISTINCT query FROM experiments") == [("q0",), ("q1",), ("q2",)]
        configs = rows(made, "SELECT name, settings FROM plannerConfigs")
        assert configs[0] == ("any-angle", "")
        assert configs[1] == ("anytime: range=2", "")
        found = rows(
            made,
            "SELECT e.name, e.query, p.name, planner_seed, time, wall_time, solved, status, cost,"
            " solution_length, integrated_u, max_e FROM runs JOIN experiments e"
            " ON e.id = experimentid JOIN plannerConfigs p ON p.id = plannerid",
        )
        wanted = [
            (
                f"{run.task.map},_6_m,_weight_4",
                *(run.task.query, run.task.planner, run.task.seed, run.seconds, run.wall_seconds),
                *(1, 6, *(run.measures[name] for name in ("cost", "length", "integrated_u")), None),
            )
            for run in runs
        ]
        assert sorted(found) == sorted(wanted)


def test_progress_has_best_cost_over_time(tmp_path):
    runs = fake_runs({"any-angle": 1.0, "anytime": 0.9}, queries=1, maps=("rooms",), seeds=2)
    runs.append(failed_run(RunTask("rooms", "6 m", "q0", 4.0, "anytime", 3)))
    logs = write_ompl_logs(runs, tmp_path / "logs", baseline="any-angle")
    with database(logs, tmp_path) as made:
        columns = [column[1] for column in rows(made, "PRAGMA table_info(progress)")]
        assert columns[:2] == ["runid", "time"]
        series = rows(
            made,
            "SELECT planner_seed, progress.time, best_cost, progress.relative_cost FROM progress"
            " JOIN runs ON runs.id = runid ORDER BY planner_seed, progress.time",
        )
    assert {seed for seed, *_ in series} == {1, 2}
    base, first = runs[0].measures["cost"], runs[1].measures["cost"]
    of_first = [row[1:] for row in series if row[0] == 1]
    assert len(of_first) == 100 - 4  # 2 s in a hundred steps, the first path after 0.1 s
    assert of_first[0] == pytest.approx((0.1, 1.5 * first, 1.5 * first / base))
    assert of_first[-1] == pytest.approx((2.0, first, first / base))
    at_half = next(cost for time, cost, _ in of_first if time >= 0.5)
    assert at_half == pytest.approx(1.2 * first)


def test_single_query_is_no_parameter(tmp_path):
    """Planner Arena 1.0's progress page fails on parameters with one value."""
    runs = fake_runs({"any-angle": 1.0}, queries=1, maps=("rooms",))
    with database(write_ompl_logs(runs, tmp_path / "logs"), tmp_path) as made:
        names = [column[1] for column in rows(made, "PRAGMA table_info(experiments)")]
        assert "query" not in names
        assert rows(made, "SELECT relative_cost FROM runs") == [(None,)]


def test_every_status_has_its_name(tmp_path):
    tasks = [RunTask("rooms", "6 m", "q", 4.0, "mine", seed) for seed in range(len(STATUSES))]
    runs = [
        solved_run(task, 9.0) if status == "solved" else failed_run(task, status)
        for task, status in zip(tasks, STATUSES, strict=True)
    ]
    with database(write_ompl_logs(runs, tmp_path / "logs"), tmp_path) as made:
        found = dict(
            rows(made, "SELECT planner_seed, description FROM runs JOIN enums ON status = value")
        )
        assert rows(made, "SELECT sum(solved), count(*) FROM runs") == [(1, len(STATUSES))]
        assert rows(made, "SELECT avg_solved FROM bestPlannerConfigs") == [(1 / len(STATUSES),)]
    named = {status: found[seed] for seed, status in enumerate(STATUSES)}
    assert named.pop("solved") == "Exact solution"
    assert named.pop("crashed") == "Crash"
    assert all(name.lower() == status for status, name in named.items())
    assert set(STATUSES) > set(
        get_args(get_type_hints(PlannerResult, localns={"Path": Path})["status"])
    )


def test_status_numbers_equal_ompl_numbers(tmp_path):
    from ompl import base

    kinds = type(base.PlannerStatus.TIMEOUT)
    task = RunTask("map", "settings", "1", 1.0, "planner", 0)
    (log,) = write_ompl_logs([solved_run(task, 9.0)], tmp_path / "logs")
    _, *names = re.search(r"^status\|.*", log.read_text(), re.M).group().split("|")
    for number in (1, 2, 3, 4, 5, 6, 7):
        assert names[number] == base.PlannerStatus(kinds(number)).asString()


def test_odd_names_and_numbers_pass(tmp_path):
    tasks = [
        RunTask("büro\n|>>>", "r = 6 m", query, 0.5, "ünder; a|b, c", 0)
        for query in ("1", "a = b", " ", "nan", "ß")
    ]
    runs = [solved_run(task, 9.0, max_e=-math.inf, turning=math.nan) for task in tasks]
    logs = write_ompl_logs(runs, tmp_path / "logs")
    assert all(log.read_bytes().isascii() for log in logs)
    with database(logs, tmp_path) as made:
        assert {row[0] for row in rows(made, "SELECT query FROM experiments")} == {
            "query 1", "a=b", "unnamed", "query nan", "\\xdf",
        }  # fmt: skip
        assert rows(made, "SELECT DISTINCT max_e, turning, cost FROM runs") == [(None, None, 9.0)]
        assert len(rows(made, "SELECT DISTINCT plannerid FROM runs")) == 1
        assert len(rows(made, "SELECT DISTINCT name FROM experiments")) == 1


def test_logs_append_to_database(tmp_path):
    runs = fake_runs({"any-angle": 1.0}, queries=2, maps=("rooms",))
    logs = write_ompl_logs(runs, tmp_path / "logs")
    with database(logs[:1], tmp_path), database(logs[1:], tmp_path, "--append") as made:
        assert rows(made, "SELECT count(*) FROM experiments") == [(2,)]
        assert rows(made, "SELECT count(*) FROM plannerConfigs") == [(1,)]


def test_no_runs_are_no_log(tmp_path):
    with pytest.raises(LocplanError, match="no runs"):
        write_ompl_logs([], tmp_path / "logs")

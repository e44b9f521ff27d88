"""The table of benchmarks: its rows, and what counts as worse than the last one."""

import csv
import json

import pytest
from benchmarks import table


def measured(name="bench_search.py::test_dijkstra[1000]", seconds=0.5, **left):
    return {"fullname": f"tests/benchmarks/{name}", "stats": {"min": seconds}, "extra_info": left}


def raw_of(*benchmarks):
    machine = {"system": "Linux", "release": "6", "python_version": "3.11.1", "cpu": {}}
    made = {"machine_info": machine, "commit_info": {"id": "abc", "dirty": True}, "datetime": "now"}
    return {**made, "benchmarks": list(benchmarks)}


def test_table_rows_have_peers_and_limits():
    given = {
        "ratio_to_scipy": 3.0,
        "ratio_to_A_star": 1.5,
        "share_of_memory": 0.4,
        "cells": 12345.6,
    }
    assert table.rows_of(measured(**given, yardstick=0.05)) == [
        table.Row(
            "search: dijkstra [1000]", 0.5, "scipy", 3.0, "memory", 0.4, figures="cells 12,346"
        ),
        table.Row("search: dijkstra [1000]", 0.5, "A star", 1.5),
    ]


def test_benchmark_without_peer_uses_yardstick():
    (row,) = table.rows_of(measured("bench_new.py::test_a_new_one", 0.5, yardstick=0.05))
    assert row == table.Row("new: a new one", 0.5, table.YARDSTICK, pytest.approx(0.1))


def test_benchmark_may_declare_no_peer():
    (row,) = table.rows_of(measured(no_peer="a limit of 5 s", yardstick=0.05))
    assert (row.peer, row.ratio, row.figures) == ("none", None, "a limit of 5 s")
    assert dict(table.ratios([row])) == {}


@pytest.mark.parametrize("key", ["ratio_to_scipy", "share_of_memory", "yardstick"])
@pytest.mark.parametrize(
    ("value", "share", "names"), [(0.76, 0.25, 0), (0.74, 0.25, 1), (0.74, 0.3, 0), (1.5, 0, 0)]
)
def test_table_names_ratios_worse_than_share(key, value, share, names):
    last, now = (table.rows_of(measured(**{key: each})) for each in (1.0, value))
    lines = table.worse(now, last, share)
    assert len(lines) == names
    assert all(line.startswith("search: dijkstra [1000], ") for line in lines)


def test_slower_machine_loses_no_ratio():
    last = table.rows_of(measured(seconds=0.5, ratio_to_scipy=3.0))
    now = table.rows_of(measured(seconds=5.0, ratio_to_scipy=3.0))
    assert table.worse(now, last, 0.1) == []


def test_peers_and_limits_are_compared_separately():
    last = table.rows_of(measured(ratio_to_scipy=3.0, share_of_scipy=0.3))
    now = table.rows_of(measured(ratio_to_scipy=3.0, share_of_scipy=0.1))
    (line,) = table.worse(now, last, 0.25)
    assert line == "search: dijkstra [1000], of scipy: 0.1, and it was 0.3 (-67%)"


def test_table_names_missing_ratios_only():
    """A new ratio is not worse."""
    last, now = (table.rows_of(measured(**{f"ratio_to_{name}": 1.0})) for name in ("old", "new"))
    assert table.missing(now, last) == ["search: dijkstra [1000], old"]
    assert table.worse(now, last, 0.0) == []


@pytest.fixture
def run_table(monkeypatch, tmp_path):
    """The command, with made-up measurements instead of pytest's."""

    def call(*arguments, ratio=3.0, complete=True, asked=None):
        def measure(selected):
            assert list(selected) == (asked or [])
            return raw_of(measured(ratio_to_scipy=ratio)), complete

        monkeypatch.setattr(table, "measure", measure)
        try:
            return table.main([str(each) for each in arguments])
        except SystemExit as stop:
            return stop.code

    return call


def test_table_is_written_in_three_formats(run_table, tmp_path):
    assert run_table(tmp_path / "new" / "out", "-k", "search", asked=["-k", "search"]) == 0
    out = tmp_path / "new" / "out"
    assert {file.name for file in out.iterdir()} == {
        f"benchmarks.{s}" for s in ("md", "csv", "json")
    }
    assert "| search: dijkstra [1000] | 0.5 | scipy | 3 |" in (out / "benchmarks.md").read_text()
    assert "- commit: abc with changes" in (out / "benchmarks.md").read_text()
    with (out / "benchmarks.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["peer"], float(row["ratio"])) == ("scipy", 3.0)
    made = json.loads((out / "benchmarks.json").read_text())
    assert made["machine"]["python"] == "3.11.1"
    assert table.read(out / "benchmarks.json") == table.rows_of(measured(ratio_to_scipy=3.0))


def test_loss_or_failure_exits_with_1(run_table, tmp_path, capsys):
    last = tmp_path / "last" / "benchmarks.json"
    assert run_table(last.parent) == 0
    assert run_table(tmp_path, "--compare", last) == 0
    assert "1 ratios compared, none worse by more than 25%" in capsys.readouterr().out
    assert run_table(tmp_path, "--compare", last, ratio=2.0) == 1
    assert "worse by more than 25%: search: dijkstra [1000], scipy: 2" in capsys.readouterr().out
    assert run_table(tmp_path, "--compare", last, "--worse", "0.5", ratio=2.0) == 0
    assert run_table(tmp_path, "--compare", last, complete=False) == 1


@pytest.mark.parametrize("text", ["", "[]", '{"rows": 3}', '{"rows": [{"seconds": 1}]}'])
def test_wrong_table_is_refused_before_measurement(run_table, tmp_path, capsys, text):
    last = tmp_path / "last.json"
    last.write_text(text)
    assert run_table(tmp_path / "out", "--compare", last) == 2
    assert "is no table of benchmarks" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_command_runs_new_benchmarks(monkeypatch, tmp_path):
    (tmp_path / "bench_new.py").write_text(
        "def test_it(benchmark):\n"
        "    benchmark.pedantic(sum, ([1, 2],), rounds=1)\n"
        "    benchmark.extra_info['ratio_to_two'] = 2.0\n"
    )
    monkeypatch.setattr(table, "HERE", tmp_path)
    raw, complete = table.measure(["-p", "no:cacheprovider"])
    assert complete
    (row,) = [row for each in raw["benchmarks"] for row in table.rows_of(each)]
    assert (row.benchmark, row.peer, row.ratio) == ("new: it", "two", 2.0)
    assert table.machine_of(raw)["processor"]

"""The claims that README and guides quote follow from the measured rows."""

import csv
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import locplan
from locplan.recordings import Recording
from locplan.simulation.levels import REVERSAL, STANDSTILL

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MAP = str(EXAMPLES.parent / "maps" / "two_corridors.yaml")


@pytest.fixture
def evidence(monkeypatch):
    """The program that computes the claims."""
    return import_example("evidence", monkeypatch)


@pytest.fixture
def levels(monkeypatch):
    """The program that measures settings at the levels of disturbance."""
    return import_example("levels", monkeypatch)


def import_example(name, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    for program in ("evidence", name):
        monkeypatch.delitem(sys.modules, program, raising=False)
    return __import__(name)


def test_claims_and_page_follow_from_rows(evidence, tmp_path):
    """`python examples/evidence.py` brings both up to date."""
    evidence.main(str(tmp_path))
    claims = evidence.ROWS / "claims.csv"
    assert (tmp_path / "claims.csv").read_text() == claims.read_text()
    assert (tmp_path / "evidence.md").read_text() == evidence.PAGE.read_text()


def test_claims_have_unique_keys_valid_intervals(evidence):
    with (evidence.ROWS / "claims.csv").open(encoding="utf-8", newline="") as opened:
        claims = list(csv.DictReader(opened))
    keys = [claim["key"] for claim in claims]
    assert len(set(keys)) == len(keys)
    for claim in claims:
        assert claim["version"]
        assert claim["command"]
        if claim["low"]:
            assert float(claim["low"]) <= float(claim["value"]) <= float(claim["high"]), claim


def test_page_has_each_table_once(evidence):
    names = evidence.TABLE.findall(evidence.PAGE.read_text(encoding="utf-8"))
    assert sorted(name for _, name, _ in names) == sorted({"claims", *evidence.TABLES})


def test_mean_over_groups_weighs_values_equally(evidence):
    mean = evidence.estimate_over_groups([[1.0, 2.0], [6.0]])
    assert mean.value == pytest.approx(3.0)
    assert mean.low < 3.0 < mean.high


@pytest.mark.parametrize(
    ("value", "unit", "low", "high", "text"),
    [
        (0.8012, "", 0.7, 0.9, "0.80 [0.70, 0.90]"),
        (9.0, "of 9", 6.3, 9.0, "9 of 9 [70, 100 %]"),
        (81.5, "%", 72.3, 88.9, "82 % [72, 89]"),
        (0.066, "m", math.nan, math.nan, "0.066 m"),
    ],
)
def test_figure_has_unit_and_interval(evidence, value, unit, low, high, text):
    claim = evidence.Claim("key", "claim", value, low, high, unit, 1, "", "", "")
    assert claim.figure == text


def make_row(settings, error, off_at_end, drives, place):
    return {
        "source": "simulation",
        "place": place,
        "level": "usual",
        "settings": settings,
        "drives": drives,
        "error": error,
        "error_low": error,
        "error_high": error,
        "lost": drives,
        "off_at_end": off_at_end,
    }


def test_levels_weigh_maps_equally(evidence, levels):
    rows = [
        make_row(settings, error, off, drives, place)
        for settings in levels.SETTINGS
        for place, error, off, drives in (("hall", 0.1, 6, 6), ("lab", 0.4, 0, 18))
    ]
    count, results = evidence.summarize_levels(rows, "simulation")["usual"]
    assert count == 2
    assert results["safe"].error.value == pytest.approx(0.2)
    assert results["safe"].off_at_end.value == pytest.approx(0.5)
    assert len(levels.levels_figure(rows).axes) == 2


def test_reversal_goes_back_and_on(levels):
    """Otherwise no route of the check could show lost signs."""
    straight = locplan.Path([[0.0, 0.0], [30.0, 0.0]])
    path = levels.back_up(straight)
    assert path.length == pytest.approx(straight.length + 2 * levels.REVERSE, abs=0.1)
    assert REVERSAL.can_affect(path, locplan.load_map(MAP))
    assert np.ptp(path.heading) == 0


def test_levels_disturb_only_suitable_recordings(levels):
    x = np.r_[0:20:0.25, 20:18.9:-0.25, 19:60:0.25]
    poses = np.column_stack([x, np.zeros((len(x), 2))])
    lidar = locplan.Lidar(range=5.0, beams=5)
    recording = Recording(np.full((len(x), 5), 1.0), lidar, poses, odometry=poses)
    assert levels.disturb(recording, REVERSAL) is None  # it reverses over 1 m only
    disturbed = levels.disturb(recording, STANDSTILL)
    lengths = (np.abs(np.diff(each[:, 0])).sum() for each in (poses, disturbed.odometry))
    assert next(lengths) - next(lengths) == pytest.approx(2.0, abs=0.6)


@pytest.mark.long
def test_levels_resume(levels, tmp_path, capsys):
    for expected in (True, False):
        levels.main(str(tmp_path), maps=("two_corridors",), drives=1)
        assert ("two_corridors, slip, safe:" in capsys.readouterr().out) == expected
    assert len((tmp_path / "levels.csv").read_text().splitlines()) == 19
    assert (tmp_path / "levels.png").stat().st_size > 10_000

"""Results of two states, or of two processors, are compared, and differences are named."""

import sys

import fingerprints
import numpy as np
import pytest

from locplan.maps import environments

MADE = {"m/costs/a": np.array([1.0, np.nan, np.inf]), "m/costs/b": np.arange(4)}
ERRORS = np.random.default_rng(1).normal(0, 0.1, (8, 30, 3))


def test_equal_results_do_not_differ():
    copies = {name: array.copy() for name, array in MADE.items()}
    assert fingerprints.compared(MADE, copies) == {True: [], False: []}


@pytest.mark.parametrize(
    ("changed", "is_within", "line"),
    [
        ({"m/costs/a": np.array([1.0 + 2**-52, np.nan, np.inf])}, True, "a: by 2.22e-16 at 1"),
        ({"m/costs/a": np.array([1.0, 0.0, np.inf])}, False, "a: other values are known"),
        ({"m/costs/a": np.array([1.0, np.nan, 7.0])}, False, "a: by inf at inf"),
        ({"m/costs/b": np.arange(5)}, False, "b: shapes (4,) and (5,)"),
        ({"m/costs/b": np.arange(4).astype(np.int32)}, False, "b: types int64 and int32"),
        ({"m/costs/c": np.arange(4)}, False, "c: in one only"),
    ],
)
def test_comparison_names_differing_result(changed, is_within, line):
    lines = fingerprints.compared(MADE, MADE | changed)
    assert [text.startswith(f"m/costs/{line}") for text in lines[is_within]] == [True]
    assert lines[not is_within] == []


def scale_entry(factor: float) -> np.ndarray:
    matrix = np.diag([1.0, 1e-3, 1e-6])
    matrix[0, 0] *= factor
    return np.stack([matrix, np.full((3, 3), np.nan)])


@pytest.mark.parametrize(
    ("name", "one", "other", "is_within"),
    [
        ("field/sad/covariance", scale_entry(1.0), scale_entry(1 + 9e-8), True),
        ("field/sad/covariance", scale_entry(1.0), scale_entry(1 + 2e-7), False),
        ("costs/sad/u", np.array([3.0]), np.array([3.0 + 2e-7]), True),
        ("costs/sad/u", np.array([3.0]), np.array([3.0 + 4e-7]), False),
        ("path/sad/grid", np.zeros((4, 2)), np.ones((5, 2)), True),
        ("path/sad/grid/cost", np.array([9.0, 8.0]), np.array([9.0, 8.1]), False),
        ("path/sad/grid/status", np.arange(3), np.arange(1, 4), False),
        ("path/sad/RRTstar/cost", np.array([9.0, 8.0]), np.array([9.0, 8.1]), True),
        ("path/sad/RRTstar/cost", np.array([9.0, 8.0]), np.array([9.0, 18.0]), False),
        ("mask/sad/smac2d", np.zeros(2000), np.eye(1, 2000), False),
        ("mask/sad/smac2d", np.zeros((1, 2000)), np.eye(1, 2000), True),
        ("mask/sad/smac2d", np.zeros((3, 2000)), np.ones((3, 2000)), False),
        ("drives/sad/errors", ERRORS, ERRORS[::-1], True),
        ("drives/sad/errors", ERRORS, ERRORS + 0.2, False),
        ("choice/sad/ratio", np.array([0.5, 0.4, 0.6]), np.array([0.7, 0.5, 0.8]), True),
        ("choice/sad/ratio", np.array([0.5, 0.4, 0.6]), np.array([0.8, 0.7, 0.9]), False),
        ("choice/sad/verdict", np.arange(3), np.arange(1, 4), False),
    ],
)
def test_tolerance_depends_on_quantity(name, one, other, is_within):
    assert fingerprints.is_within_tolerance(f"map/{name}", one, other) == is_within


@pytest.mark.parametrize(("change", "code"), [(0.0, 0), (2**-52, 0), (1e-3, 1)])
def test_exit_code_tells_of_differences(tmp_path, monkeypatch, capsys, change, code):
    grid = environments.make("two_corridors", resolution=0.1)
    monkeypatch.setattr(fingerprints, "maps", lambda: iter([("m", grid)]))
    monkeypatch.setattr(fingerprints, "results", lambda _: iter([("costs/a", np.ones(3) + change)]))
    np.savez(tmp_path / "before.npz", **{"m/costs/a": np.ones(3)})
    files = str(tmp_path / "now.npz"), "--beside", str(tmp_path / "before.npz")
    monkeypatch.setattr(sys, "argv", ["fingerprints.py", *files])
    assert fingerprints.main() == code
    text = capsys.readouterr().out
    assert f"{int(change == 2**-52)} of 1 differ within the tolerance" in text
    assert f"{code} of 1 differ beyond the tolerance" in text


@pytest.mark.long
def test_fingerprints_are_reproducible():
    grid = environments.make("places", resolution=0.1)
    one, other = (
        {f"places/{name}": array for name, array in fingerprints.results(grid)} for _ in range(2)
    )
    assert {name.split("/")[1] for name in one} >= {"field", "costs", "path", "front", "mask"}
    assert fingerprints.compared(one, other) == {True: [], False: []}

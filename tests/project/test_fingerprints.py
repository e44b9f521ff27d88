"""Two states' results are compared to the bit, and differences are named."""

import fingerprints
import numpy as np
import pytest

from locplan.maps import environments

MADE = {"a": np.array([1.0, np.nan, np.inf]), "b": np.arange(4)}


def test_the_same_results_do_not_differ():
    assert fingerprints.compared(MADE, {name: array.copy() for name, array in MADE.items()}) == []


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"a": np.array([1.0 + 2**-52, np.nan, np.inf])}, "a: by 2.22e-16 at 1"),
        ({"a": np.array([1.0, 0.0, np.inf])}, "a: other values are known"),
        ({"a": np.array([1.0, np.nan, 7.0])}, "a: by inf at inf"),
        ({"b": np.arange(5)}, "b: shapes (4,) and (5,)"),
        ({"b": np.arange(4).astype(np.int32)}, "b: types int64 and int32"),
        ({"c": np.arange(4)}, "c: in one only"),
    ],
)
def test_a_result_that_differs_is_named_with_how_far(changed, line):
    (found,) = fingerprints.compared(MADE, MADE | changed)
    assert found.startswith(line)


@pytest.mark.long
def test_results_of_a_map_are_the_same_again():
    grid = environments.make("places", resolution=0.1)
    one, other = (dict(fingerprints.results(grid)) for _ in range(2))
    assert {name.split("/")[0] for name in one} >= {"field", "costs", "path", "front", "mask"}
    assert fingerprints.compared(one, other) == []

import numpy as np
import pytest

from locplan.costs import Path
from locplan.errors import LocplanError


def test_resampling_keeps_the_line_and_its_ends():
    path = Path(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.5]]))
    fine = path.resampled(0.5)
    assert len(fine.xy) == 8
    np.testing.assert_allclose(np.diff(fine.distance), 0.5)
    np.testing.assert_array_equal(fine.xy[[0, -1]], path.xy[[0, -1]])


def test_a_single_position_has_no_length():
    path = Path(np.array([[1.0, 2.0]]))
    assert path.length == 0.0
    assert path.resampled(1.0).xy.tolist() == [[1.0, 2.0], [1.0, 2.0]]


@pytest.mark.parametrize("xy", [np.zeros((0, 2)), np.zeros(3), np.full((2, 2), np.nan)])
def test_unusable_positions_are_refused(xy):
    with pytest.raises(LocplanError, match="finite"):
        Path(xy)


def test_spacing_must_be_positive():
    with pytest.raises(LocplanError, match="spacing"):
        Path(np.zeros((2, 2))).resampled(0.0)

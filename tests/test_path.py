import numpy as np
import pytest
from conftest import drawn

from locplan._util.reading import MAX_BYTES
from locplan.comparison._journal import Journal
from locplan.costs import Costmap, Path, path_metrics
from locplan.errors import LocplanError
from locplan.field import CovarianceField, load_config
from locplan.maps import load_map
from locplan.planners import read_queries


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


@pytest.mark.parametrize("xy", [[[0, 0], [1e12, 0]], [[10**400, 0]], [["a", 0]], [[0, 0], [0]]])
def test_positions_that_are_no_metres_are_refused(xy):
    with pytest.raises(LocplanError):
        Path(xy)


@pytest.mark.parametrize("heading", [[1e300, 0.0], ["east", 0.0], [10**400, 0], [0.0]])
def test_headings_that_are_no_angles_are_refused(heading):
    with pytest.raises(LocplanError, match="headings must be 2 angles"):
        Path(np.zeros((2, 2)), heading)


def test_no_path_takes_endless_steps():
    far = Path([[0.0, 0.0], [1e8, 0.0]])
    with pytest.raises(LocplanError, match="greater spacing"):
        far.resampled(0.001)
    costs = Costmap.from_density(drawn("...."), np.ones((1, 4)))
    with pytest.raises(LocplanError, match="crosses over 10000000 cells"):
        path_metrics(costs, far)
    assert path_metrics(costs, Path([[0.5, 0.5], [1e4, 0.5]])).cost == np.inf


@pytest.mark.parametrize(
    "text", ["", "x_m,y_m\n", "x_m,y_m\n1e12,0\n", "x_m,y_m\n1\n", "x_m,y_m\n" + "9" * 400 + ",0"]
)
def test_files_without_a_path_are_refused(tmp_path, text):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(LocplanError, match="p"):
        Path.load(tmp_path / "p.csv")


@pytest.mark.parametrize("name", ["", " ", "a\0b", "\ud800", None, 3])
def test_what_can_be_no_file_name_is_refused(name):
    for read in (Path.load, load_map, load_config, read_queries, CovarianceField.load, Journal):
        with pytest.raises(LocplanError, match="must be a path, not"):
            read(name)


def test_files_that_are_too_large_are_refused(tmp_path):
    with (tmp_path / "p.csv").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(LocplanError, match="over 67 MB"):
        Path.load(tmp_path / "p.csv")

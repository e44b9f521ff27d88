# Copyright 2026 locplan developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Test the reader of field files."""

import json
import math

from locplan_ros.field_file import FieldFile, FREE
import numpy as np
import pytest

ABOUT = {
    'version': 1,
    'origin': [2.0, -1.0, 0.0],
    'resolution': 0.5,
    'config': {'stride': 1.0},
}
"""The metadata that locplan writes, as far as the reader needs it."""


@pytest.fixture
def arrays():
    """Return the arrays of a file: a room of 4 x 6 cells with an occupied cell in its corner."""
    cells = np.full((4, 6), FREE, np.uint8)
    cells[0, 0] = 0
    covariance = np.tile(np.diag([0.01, 0.04, 0.0025]), (2, 3, 1, 1))
    covariance[:, 2] *= 4.0
    return {
        'covariance': covariance,
        'u_map': np.where(cells == FREE, 0.25, np.nan),
        'cells': cells,
        'about': json.dumps(ABOUT),
    }


@pytest.fixture
def load(tmp_path, arrays):
    """Return a function that writes the arrays and reads them back."""

    def write_and_load(**changes):
        file = tmp_path / 'field.npz'
        np.savez_compressed(str(file), **{**arrays, **changes})
        return FieldFile.load(str(file))

    return write_and_load


def test_file_is_read_with_numpy(load, arrays):
    """The lattice has a point every second cell, and values between points are interpolated."""
    field = load()
    assert (field.stride, field.resolution, field.origin) == (2, 0.5, (2.0, -1.0, 0.0))
    u, covariance = field.at(3.25, -0.75)  # lattice point (0, 1)
    assert u == 0.25
    np.testing.assert_allclose(covariance, arrays['covariance'][0, 1])
    _, between = field.at(3.75, -0.75)  # halfway to a point with four times the covariance
    np.testing.assert_allclose(between, 2.0 * arrays['covariance'][0, 1])


def test_positions_off_free_cells_have_no_value(load):
    """Values exist only in free cells of the map."""
    field = load()
    for x, y in ((2.1, -0.9), (1.9, 0.0), (5.1, 0.0), (3.0, -1.1), (3.0, 1.1), (math.nan, 0.0)):
        u, covariance = field.at(x, y)
        assert math.isnan(u)
        assert np.isnan(covariance).all()


def test_field_turns_with_map(load):
    """The origin's yaw turns the map about the corner of its first cell."""
    about = dict(ABOUT, origin=[2.0, -1.0, math.pi / 2])
    plain, turned = load(), load(about=json.dumps(about))
    np.testing.assert_allclose(turned.at(1.75, 0.75)[1], plain.at(3.75, -0.75)[1])
    x, y = turned.positions(1.0).T
    assert x.min() >= 0.0
    assert x.max() <= 2.0
    assert y.max() <= 2.0
    assert len(x) == len(plain.positions(1.0)) == 5


def test_heading_selects_covariance(load, arrays):
    """Between two headings, the covariance is interpolated."""
    lattice = np.stack([arrays['covariance'], 4.0 * arrays['covariance']], axis=2)
    field = load(covariance=lattice)
    expected = arrays['covariance'][0, 1]
    for heading, factor in ((0.0, 1.0), (math.pi, 4.0), (math.pi / 2, 2.0)):
        np.testing.assert_allclose(field.at(3.25, -0.75, heading)[1], factor * expected)
    np.testing.assert_allclose(field.at(3.25, -0.75)[1], 1.6 * expected)  # of mean information


@pytest.mark.parametrize(
    'changes', [{'about': '{}'}, {'about': 'no JSON'}, {'cells': np.array([{}], object)}]
)
def test_wrong_file_is_refused(load, changes):
    """The error is one line that names the file and the command."""
    with pytest.raises(ValueError, match='locplan field') as error:
        load(**changes)
    assert 'field.npz' in str(error.value)
    assert '\n' not in str(error.value)


def test_missing_file_is_refused(tmp_path):
    """The error names the file."""
    with pytest.raises(ValueError, match=r'gone\.npz'):
        FieldFile.load(str(tmp_path / 'gone.npz'))


def test_file_of_newer_locplan_is_refused(load):
    """Its arrays may mean something else."""
    with pytest.raises(ValueError, match='update locplan_ros'):
        load(about=json.dumps(dict(ABOUT, version=2)))

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

"""Test the events of a robot that enters and leaves degenerate places."""

import math

from locplan_ros.watch import compute_ellipse, DEGENERATE, Limits, OFF_FIELD, Watch
import numpy as np
import pytest


class DegeneracyAlongX:
    """A field whose u is a function of x; the deviation is 1 m along the diagonal."""

    def __init__(self, u):
        self.u = u

    def at(self, x, y, heading=None):
        """Return u and the covariance at a position."""
        return self.u(x), np.array([[0.5, 0.49, 0.0], [0.49, 0.5, 0.0], [0.0, 0.0, 0.01]])


def list_events(watch, xs):
    """Return the events of poses along x."""
    readings = [watch.update(x, 0.0) for x in xs]
    return [reading.event for reading in readings if reading.event]


def test_degenerate_place_is_entered_and_left_once():
    """The text has the deviations on entering, and the distance on leaving."""
    watch = Watch(DegeneracyAlongX(lambda x: 0.9 if 1.0 < x < 3.0 else 0.1))
    entered, left = list_events(watch, np.arange(0.0, 5.0, 0.25))
    assert entered.state == DEGENERATE
    assert entered.is_warning
    assert 'the position to 99 cm along 45 deg and 10 cm across' in entered.text
    assert not left.is_warning
    assert left.text == 'left the degenerate place at (3.00, 0.00) after 1.8 m'


def test_noisy_u_at_border_gives_one_event():
    """The gap between enter and leave prevents further events."""
    noise = np.random.RandomState(3).uniform(-0.09, 0.09, 300)
    field = DegeneracyAlongX(lambda x: x)
    events = list_events(Watch(field), 0.5 + noise)
    assert [event.state for event in events] == [DEGENERATE]
    assert len(list_events(Watch(field, Limits(0.5, 0.5)), 0.5 + noise)) > 50


def test_robot_is_off_field_after_several_poses():
    """A pose may graze a wall, so a single pose without a value changes nothing."""
    watch = Watch(DegeneracyAlongX(lambda x: math.nan if x < 0 else 0.9), Limits(patience=3))
    states = [watch.update(x, 0.0).state for x in (1, -1, -1, 1, -1, -1, -1, -1, 1)]
    assert states == [DEGENERATE] * 6 + [OFF_FIELD] * 2 + [DEGENERATE]
    assert not watch.update(-1, 0.0).is_known


@pytest.mark.parametrize(
    ('limits', 'words'),
    [
        ((0.4, 0.5), '0 <= leave <= enter'),
        ((1.5, 0.5), '0.5 and 1.5'),
        ((0.5, 0.4, 0), 'at least 1'),
    ],
)
def test_wrong_limits_are_refused(limits, words):
    """The error names the values."""
    with pytest.raises(ValueError, match=words):
        Limits(*limits)


def test_ellipse_has_axes_of_covariance():
    """The axes are eigenvectors, and the deviations are roots of eigenvalues."""
    turn = np.array([[math.cos(0.3), -math.sin(0.3)], [math.sin(0.3), math.cos(0.3)]])
    covariance = turn @ np.diag([4.0, 0.25]) @ turn.T
    np.testing.assert_allclose(compute_ellipse(covariance), (2.0, 0.5, 0.3), rtol=1e-12)

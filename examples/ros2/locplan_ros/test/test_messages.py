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

"""Test the content of the node's messages."""

import math

from locplan_ros import messages
from locplan_ros.watch import Limits, Watch
import numpy as np
import pytest

STAMP = {'sec': 1, 'nanosec': 2}


class DegeneracyAlongX:
    """A field whose u is x; there is no value at a negative x."""

    def at(self, x, y, heading=None):
        """Return u and the covariance at a position."""
        return (math.nan if x < 0 else x), np.diag([0.25, 0.01, 0.04])


@pytest.fixture
def readings():
    """Return a reading in a clear place, in a degenerate place, and off the field."""
    watch = Watch(DegeneracyAlongX(), Limits(patience=1))
    return [watch.update(x, 2.0, 0.5) for x in (0.1, 0.9, -1.0)]


def test_covariance_is_row_by_row_in_order_of_ros():
    """The order is x, y, z and the rotations about x, y and z."""
    covariance = np.array([[1.0, 0.2, 0.3], [0.2, 2.0, 0.4], [0.3, 0.4, 3.0]])
    expected = np.zeros((6, 6))
    expected[:2, :2] = covariance[:2, :2]
    expected[:2, 5] = expected[5, :2] = covariance[:2, 2]
    expected[5, 5] = 3.0
    assert messages.make_covariance_6x6(covariance) == expected.ravel().tolist()
    without_heading = messages.make_covariance_6x6(covariance[:2, :2])
    assert without_heading[35] == pytest.approx(math.pi**2 / 3)


def test_heading_survives_its_quaternion():
    """The functions for both directions agree."""
    for yaw in (-3.0, -0.4, 0.0, 2.5):
        turn = messages.make_pose(0.0, 0.0, yaw)['orientation']
        heading = messages.yaw_from_quaternion(0.0, 0.0, turn['z'], turn['w'])
        assert heading == pytest.approx(yaw)


def test_warning_is_shown_only_in_degenerate_places(readings):
    """The marker is removed elsewhere; the diagnostics also warn off the field."""
    clear, degenerate, off_field = (
        messages.make_warning(STAMP, 'map', reading) for reading in readings
    )
    actions = [marker['action'] for marker in (clear, degenerate, off_field)]
    assert actions == [messages.DELETE, messages.ADD, messages.DELETE]
    assert degenerate['text'].startswith('degenerate: u 0.90\nthe position to 50 cm')
    statuses = [messages.make_diagnostics(STAMP, reading)['status'][0] for reading in readings]
    assert [status['level'] for status in statuses] == [messages.OK, messages.WARN, messages.WARN]
    assert statuses[2]['message'] == 'off the field'


def test_pose_has_covariance_of_scan_match(readings):
    """The message has the robot's pose in the map's frame."""
    message = messages.make_pose_with_covariance(STAMP, 'map', readings[1])
    assert message['header'] == {'stamp': STAMP, 'frame_id': 'map'}
    assert message['pose']['pose']['position'] == {'x': 0.9, 'y': 2.0}
    assert [message['pose']['covariance'][i] for i in (0, 7, 35)] == [0.25, 0.01, 0.04]

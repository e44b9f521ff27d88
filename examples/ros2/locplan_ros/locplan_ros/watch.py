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

"""Events of a robot that enters and leaves degenerate places, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np

CLEAR, DEGENERATE, OFF_FIELD = 'clear', 'degenerate', 'off the field'
"""The states of a robot: localizable, in a degenerate place, or off the field."""


class Field(Protocol):
    """A field with a value for each free position of a map."""

    def at(self, x: float, y: float, heading: float | None = None) -> tuple[float, np.ndarray]:
        """Return u, 0..1, and the covariance of (x, y, theta), or of (x, y); NaN off the field."""


@dataclass(frozen=True)
class Limits:
    """The limits between the states; a ValueError if they contradict each other."""

    enter: float = 0.5
    """Degeneracy u at which a degenerate place begins."""
    leave: float = 0.4
    """Degeneracy u below which it ends. The gap prevents events at every pose near a border."""
    patience: int = 5
    """Number of consecutive poses without a value before the robot counts as off the field."""

    def __post_init__(self) -> None:
        if not 0 <= self.leave <= self.enter <= 1:
            raise ValueError(
                f'leave and enter must be 0 <= leave <= enter <= 1, not {self.leave:g} and'
                f' {self.enter:g}'
            )
        if self.patience < 1:
            raise ValueError(f'patience must be at least 1 pose, not {self.patience}')


@dataclass(frozen=True)
class Event:
    """A change of the robot's state."""

    state: str
    """The new state."""
    text: str
    """A sentence for a log."""

    @property
    def is_warning(self) -> bool:
        """Return True if the new state deserves a warning."""
        return self.state != CLEAR


@dataclass(frozen=True, eq=False)
class Reading:
    """The field's values at a pose of the robot."""

    x: float
    """World position [m]."""
    y: float
    """World position [m]."""
    heading: float
    """Heading of the robot [rad]."""
    u: float
    """Degeneracy, 0..1; NaN off the field."""
    covariance: np.ndarray
    """Covariance of (x, y, theta), or of (x, y), (d, d) [m, m, rad]."""
    state: str
    """State of the robot."""
    event: Event | None
    """The change of the state at this pose; None without one."""

    @property
    def is_known(self) -> bool:
        """Return True if the field has a value here."""
        return bool(np.isfinite(self.u) and np.isfinite(self.covariance).all())


class Watch:
    """
    The state of a robot that moves over a field; each pose gives a `Reading`.

    Parameters
    ----------
    field : Field
        The field, such as a `locplan_ros.field_file.FieldFile`.
    limits : Limits, optional
        The limits between the states.

    """

    def __init__(self, field: Field, limits: Limits | None = None) -> None:
        self.field = field
        self.limits = limits or Limits()
        self.state = CLEAR
        self._without_value = 0
        self._last: tuple[float, float] | None = None
        self._driven = 0.0

    def update(self, x: float, y: float, heading: float = 0.0) -> Reading:
        """Return the reading of the robot's next pose [m, m, rad]."""
        u, covariance = self.field.at(x, y, heading)
        if self._last is not None and self.state == DEGENERATE:
            self._driven += math.hypot(x - self._last[0], y - self._last[1])
        self._last = (x, y)
        known = math.isfinite(u) and bool(np.isfinite(covariance).all())
        self._without_value = 0 if known else self._without_value + 1
        state = self._next_state(u) if known else self._state_without_value()
        event = None
        if state != self.state:
            event = Event(state, self._format_event(state, x, y, covariance))
            self.state, self._driven = state, 0.0
        return Reading(x, y, heading, u, covariance, self.state, event)

    def _next_state(self, u: float) -> str:
        limit = self.limits.leave if self.state == DEGENERATE else self.limits.enter
        return DEGENERATE if u >= limit else CLEAR

    def _state_without_value(self) -> str:
        return OFF_FIELD if self._without_value >= self.limits.patience else self.state

    def _format_event(self, state: str, x: float, y: float, covariance: np.ndarray) -> str:
        place = f'({x:.2f}, {y:.2f})'
        if state == DEGENERATE:
            deviations = format_deviations(covariance)
            return f'entered a degenerate place at {place}: a scan match there knows {deviations}'
        if state == OFF_FIELD:
            return f'left the field at {place}: no free cell of its map'
        if self.state == DEGENERATE:
            return f'left the degenerate place at {place} after {self._driven:.1f} m'
        return f'back on the field at {place}'


def compute_ellipse(covariance: np.ndarray) -> tuple[float, float, float]:
    """Return the deviations along both axes of the position [m], and the major axis [rad]."""
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    mean, radius = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    major, minor = math.sqrt(mean + radius), math.sqrt(max(mean - radius, 0.0))
    return major, minor, 0.5 * math.atan2(2 * xy, xx - yy)


def format_deviations(covariance: np.ndarray) -> str:
    """Return the standard deviations in centimetres and degrees."""
    major, minor, direction = compute_ellipse(covariance)
    degrees = round(math.degrees(direction)) % 180
    text = (
        f'the position to {100 * major:.0f} cm along {degrees} deg and {100 * minor:.0f} cm across'
    )
    if len(covariance) == 3:
        text += f', the heading to {math.degrees(math.sqrt(covariance[2, 2])):.1f} deg'
    return text

"""When a robot enters and leaves degenerate places: events from its poses, without ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

CLEAR, DEGENERATE, NOWHERE = "clear", "degenerate", "nowhere"
"""The states of a robot: well localizable, in a degenerate place, where the field has no value."""


class Field(Protocol):
    """A field that can be asked for a position [m]; NaN where it has no value."""

    def at(self, x: float, y: float, heading: float | None = None) -> tuple[float, np.ndarray]:
        """Degeneracy u, 0..1, and covariance of (x, y, theta), or of (x, y), (d, d)."""


@dataclass(frozen=True)
class Limits:
    """The limits between the states; a ValueError says what is wrong with them."""

    enter: float = 0.5
    """Degeneracy u from which on a place is degenerate."""
    leave: float = 0.4
    """Degeneracy u below which the robot has left it; the gap keeps a border from flickering."""
    patience: int = 5
    """Number of poses in a row without a value before the robot counts as nowhere."""

    def __post_init__(self) -> None:
        if not 0 <= self.leave <= self.enter <= 1:
            raise ValueError(
                f"leave and enter must be 0 <= leave <= enter <= 1, not {self.leave:g} and"
                f" {self.enter:g}"
            )
        if self.patience < 1:
            raise ValueError(f"patience must be at least 1 pose, not {self.patience}")


@dataclass(frozen=True)
class Event:
    """A change of the robot's state."""

    state: str
    """The new state."""
    text: str
    """A sentence for a log."""

    @property
    def is_warning(self) -> bool:
        """Whether it is worth a warning."""
        return self.state != CLEAR


@dataclass(frozen=True, eq=False)
class Reading:
    """What the field says of one pose."""

    x: float
    """World position [m]."""
    y: float
    """World position [m]."""
    heading: float
    """Heading of the robot [rad]."""
    u: float
    """Degeneracy, 0..1; NaN where the field has no value."""
    covariance: np.ndarray
    """Covariance of (x, y, theta), or of (x, y), (d, d) [m, m, rad]."""
    state: str
    """State of the robot."""
    event: Event | None
    """The change that this pose brought, if it brought one."""

    @property
    def is_known(self) -> bool:
        """Whether the field has a value here."""
        return bool(np.isfinite(self.u) and np.isfinite(self.covariance).all())


class Watch:
    """The state of a robot that moves over a field; each pose gives a `Reading`.

    Parameters
    ----------
    field : Field
        The field, such as a `locplan_ros.field_file.FieldFile`.
    limits : Limits, optional
    """

    def __init__(self, field: Field, limits: Limits | None = None) -> None:
        self.field = field
        self.limits = limits or Limits()
        self.state = CLEAR
        self._without_value = 0
        self._last: tuple[float, float] | None = None
        self._driven = 0.0

    def update(self, x: float, y: float, heading: float = 0.0) -> Reading:
        """Take the robot's next pose [m, m, rad]."""
        u, covariance = self.field.at(x, y, heading)
        if self._last is not None and self.state == DEGENERATE:
            self._driven += math.hypot(x - self._last[0], y - self._last[1])
        self._last = (x, y)
        known = math.isfinite(u) and bool(np.isfinite(covariance).all())
        self._without_value = 0 if known else self._without_value + 1
        state = self._next_state(u) if known else self._state_without_value()
        event = None
        if state != self.state:
            event = Event(state, self._sentence(state, x, y, covariance))
            self.state, self._driven = state, 0.0
        return Reading(x, y, heading, u, covariance, self.state, event)

    def _next_state(self, u: float) -> str:
        limit = self.limits.leave if self.state == DEGENERATE else self.limits.enter
        return DEGENERATE if u >= limit else CLEAR

    def _state_without_value(self) -> str:
        return NOWHERE if self._without_value >= self.limits.patience else self.state

    def _sentence(self, state: str, x: float, y: float, covariance: np.ndarray) -> str:
        place = f"({x:.2f}, {y:.2f})"
        if state == DEGENERATE:
            return (
                f"entered a degenerate place at {place}: a match there knows {spread(covariance)}"
            )
        if state == NOWHERE:
            return f"the field has no value at {place}: no free cell of its map"
        if self.state == DEGENERATE:
            return f"left the degenerate place at {place} after {self._driven:.1f} m"
        return f"back on the field at {place}"


def ellipse(covariance: np.ndarray) -> tuple[float, float, float]:
    """Standard deviations along both axes of the position [m], and the major axis [rad]."""
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    mean, radius = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    major, minor = math.sqrt(mean + radius), math.sqrt(max(mean - radius, 0.0))
    return major, minor, 0.5 * math.atan2(2 * xy, xx - yy)


def spread(covariance: np.ndarray) -> str:
    """The standard deviations in centimetres and degrees."""
    major, minor, direction = ellipse(covariance)
    text = (
        f"the position to {100 * major:.0f} cm along {round(math.degrees(direction)) % 180} deg and"
        f" {100 * minor:.0f} cm across"
    )
    if len(covariance) == 3:
        text += f", the heading to {math.degrees(math.sqrt(covariance[2, 2])):.1f} deg"
    return text

"""What is known of places, twins, starts and symmetries: layers, and columns of tables."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from locplan._util.records import POSE, POSITION, Column


class Layer(NamedTuple):
    """What is known of each place."""

    label: str
    """Name for people."""
    unit: str
    """Unit; empty for shares and numbers."""


LAYERS = {
    "excess": Layer("least excess of another place", "nat"),
    "elsewhere": Layer("share of the posterior elsewhere", ""),
    "modes": Layer("number of look-alike poses elsewhere", ""),
    "turned": Layer("number of look-alike headings in place", ""),
    "stretch": Layer("distance that a match may slide", "m"),
}
"""The layers by name."""


class Twin(NamedTuple):
    """A pose that a robot can be mistaken for."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    heading: float
    """Heading there [rad]."""
    excess: float
    """By how much it explains the scan worse [nats]; below 0 it explains it better."""
    here: float
    """Heading of the robot at its place [rad]."""


STARTS = (
    *POSITION,
    Column("excess", "nat", "least excess", 1),
    Column("elsewhere", "", "elsewhere", 1, "%"),
)
TWIN = (
    *POSE,
    Column("excess", "nat", "excess"),
    Column("here", "rad", "heading here", 0, "deg"),
)
PLACES = (
    *STARTS,
    Column("modes", "", "modes", 0),
    Column("turned", "", "turned", 0),
    Column("stretch", "m", "stretch", 1),
    *(dataclasses.replace(column, name=f"twin_{column.name}", title=None) for column in TWIN[:-1]),
    dataclasses.replace(TWIN[-1], title=None),
)
"""Columns of the places: x, y, `LAYERS`, and the best of the twins."""
SYMMETRIES = (
    Column("turn", "rad", "turn", 0, "deg", signed=True),
    Column("shift_x", "m", "middle moves x", 1, signed=True, value=lambda one: one.shift[0]),
    Column("shift_y", "m", "middle moves y", 1, signed=True, value=lambda one: one.shift[1]),
    Column("share", "", "places", 0, "%"),
    Column("middle_x", "m", value=lambda one: one.middle[0]),
    Column("middle_y", "m", value=lambda one: one.middle[1]),
)

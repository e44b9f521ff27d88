"""What is known of a place: its twins, how sure a match is, and whether to start a robot there."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from locplan._util.poses import Numbers, wrapped
from locplan._util.records import POSE, POSITION, Column
from locplan.matching import (
    APART,
    AWAY,
    ENOUGH,
    MIN_RETURNS,
    TURNED,
    Database,
    ScanOnMap,
)


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


THRESHOLD = 3.0
"""Excess up to which a pose counts as a twin: a match mistakes one in ten such [nats]."""
LISTED = 32
"""Number of twins that are kept of a pose."""


@dataclass(frozen=True, eq=False)
class Looks:
    """The other poses that explain the scan of one pose."""

    excess: float
    """Minimum excess of any pose more than 2 m away [nats]; infinite if there is none."""
    elsewhere: float
    """Share of the posterior more than 2 m away."""
    modes: int
    """Number of modes more than 2 m away with an excess of up to `THRESHOLD`."""
    turned: int
    """Number of modes within 2 m, turned by more than 60 deg, with such an excess."""
    stretch: float
    """Distance up to which the pose may slide without a rise of the loss [m]."""
    twins: Numbers
    """x, y [cells], heading on the map and excess of the best twins, (k, 4)."""


NOTHING_SEEN = Looks(0.0, 1.0, 0, 0, 0.0, np.empty((0, 4)))
"""Where too few beams return."""


def look_around(database: Database, ranges: Numbers, home: Numbers) -> Looks:
    """Match the scan of a pose, x, y [cells] and heading on the map, with the whole map."""
    scan = ScanOnMap(database, ranges)
    found = scan.modes(home)
    if found.returns < MIN_RETURNS:
        return NOTHING_SEEN
    resolution = database.grid.resolution
    away = np.hypot(*(found.poses[:, :2] - home[:2]).T) * resolution
    turn = np.abs(wrapped(found.poses[:, 2] - home[2]))
    own = np.flatnonzero((away < APART) & (turn < TURNED))
    if not own.size:  # the robot does not fit quite there
        return NOTHING_SEEN
    excess = found.losses - found.losses[own[0]]
    weights = np.exp(-(found.losses - found.losses.min()))
    far = away > AWAY
    joined = scan.joined_to(found, int(own[0]))
    twins = np.flatnonzero(far & ~joined & (excess <= ENOUGH))[:LISTED]
    low = excess <= THRESHOLD
    slid = away[joined & far]
    # Turn from which on a mode in place is another one [rad].
    return Looks(
        excess=float(excess[far].min()) if far.any() else np.inf,
        elsewhere=float(weights[far].sum() / weights.sum()),
        modes=int((far & low).sum()),
        turned=int((~far & low & (turn > np.radians(60.0))).sum()),
        stretch=float(slid.max()) if slid.size else 0.0,
        twins=np.column_stack([found.poses[twins], excess[twins]]),
    )


@dataclass(frozen=True)
class Start:
    """A place from which a global match finds the robot."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    excess: float
    """Minimum excess of any other place, of this place and its neighbours [nats]."""
    elsewhere: float
    """Maximum share of the posterior elsewhere, of this place and its neighbours, 0..1."""


def best_starts(
    places: Numbers, excess: Numbers, elsewhere: Numbers, count: int, spacing: float, apart: float
) -> Sequence[Start]:
    """The places with the greatest excess among those at least `apart` [m] from each other.

    A place counts as the worst of its neighbours, since a robot never stands quite where it should.
    """
    from scipy.spatial import cKDTree

    # Factor on the spacing of the places within which they are neighbours.
    near = cKDTree(places).query_ball_point(places, 1.6 * spacing)
    least = np.array([excess[own].min() for own in near])
    most = np.array([elsewhere[own].max() for own in near])
    starts: list[Start] = []
    left = np.ones(len(places), bool)
    for n in np.lexsort([most, -least]):
        if len(starts) == count:
            break
        if left[n]:
            x, y = places[n].tolist()
            starts.append(Start(x, y, float(least[n]), float(most[n])))
            left &= np.hypot(*(places - places[n]).T) >= apart
    return starts

"""What else explains the scan of a pose: its twins, its stretch, and how sure a match is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from locplan._util.poses import Numbers
from locplan.twins._database import Database, wrapped
from locplan.twins._modes import (
    APART,
    AWAY,
    ENOUGH,
    LEAST_RETURNS,
    TURNED,
    find_modes,
    joined_to,
)

THRESHOLD = 3.0
"""Excess up to which a pose counts as a twin: a match mistakes one in ten such [nats]."""
OTHER_WAY = np.radians(60.0)
"""Turn from which on a mode in place is another one [rad]."""
LISTED = 32
"""Number of twins that are kept of a pose."""


@dataclass(frozen=True, eq=False)
class Looks:
    """The other poses that explain the scan of one pose."""

    excess: float
    """Least excess of any pose more than 2 m away [nats]; infinite if there is none."""
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
    found = find_modes(database, ranges, home)
    if found.returns < LEAST_RETURNS:
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
    joined = joined_to(database, ranges, found, int(own[0]), ENOUGH)
    twins = np.flatnonzero(far & ~joined & (excess <= ENOUGH))[:LISTED]
    low = excess <= THRESHOLD
    slid = away[joined & far]
    return Looks(
        excess=float(excess[far].min()) if far.any() else np.inf,
        elsewhere=float(weights[far].sum() / weights.sum()),
        modes=int((far & low).sum()),
        turned=int((~far & low & (turn > OTHER_WAY)).sum()),
        stretch=float(slid.max()) if slid.size else 0.0,
        twins=np.column_stack([found.poses[twins], excess[twins]]),
    )

"""Where to start a robot, or put its dock: places that no other place is mistaken for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._util.poses import Numbers

NEXT = 1.6
"""Factor on the spacing of the places within which they are neighbours."""


@dataclass(frozen=True)
class Start:
    """A place from which a global match finds the robot."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    excess: float
    """Least excess of any other place, of this place and its neighbours [nats]."""
    elsewhere: float
    """Greatest share of the posterior elsewhere, of this place and its neighbours, 0..1."""


def best_starts(
    places: Numbers, excess: Numbers, elsewhere: Numbers, count: int, spacing: float, apart: float
) -> Sequence[Start]:
    """The places with the greatest excess among those at least `apart` [m] from each other.

    A place counts as the worst of its neighbours, since a robot never stands quite where it should.
    """
    from scipy.spatial import cKDTree

    near = cKDTree(places).query_ball_point(places, NEXT * spacing)
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

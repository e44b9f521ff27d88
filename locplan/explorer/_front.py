"""The Pareto front of the way shown: length against degenerate metres, with the paths."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.explorer._scene import View, rounded
from locplan.planners import ParetoFront, pareto_front

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session

SECONDS, SECONDS_PER_CELL = 5.0, 1e-6
"""Time limit of a front by default, for all legs together [s], and how it grows with the map."""
MIN_SECONDS, MAX_SECONDS = 0.1, 60.0
"""Limits of the time limit that can be asked for [s]."""
SHOWN = 60
"""Greatest number of points that are shown; a front can have thousands."""
PAIRS = 4_000_000
"""Greatest number of pairs of points of two legs that are added up."""


def front(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the Pareto front of the way shown, by rising length.

    The front through waypoints is what is best of all sums of its legs' paths, which is exact where
    the legs' fronts are. The search has no progress within a leg: one that is cancelled ends with
    its leg, at the time limit at the latest.
    """
    view = session.view(ask)
    usual = min(SECONDS + SECONDS_PER_CELL * view.grid.cells.size, MAX_SECONDS)
    limit = ask.number("time_limit", MIN_SECONDS, MAX_SECONDS, usual)
    legs = _fronts_of(view, limit, work)
    length, integral, chosen, thinned = _summed(legs)
    epsilon = max(leg.epsilon for leg in legs) or (np.inf if thinned else 0.0)
    # Its knee is that of the lengths and integrals alone.
    knee = dataclasses.replace(legs[0], length=length, integral=integral, cells=()).knee
    weights = _weights_of(length, integral)
    shown = _thinned(length, integral, np.isfinite(weights), knee).tolist()
    points = [
        {
            "length": float(length[n]),
            "degenerate": float(integral[n]),
            "weight": float(weights[n]),
            "xy": rounded(_joined(legs, chosen[n])),
        }
        for n in shown
    ]
    return finite(
        {
            "points": points,
            "knee": shown.index(knee),
            "paths": len(length),
            "epsilon": epsilon,
            "complete": epsilon == 0,
        }
    )


def _fronts_of(view: View, seconds: float, work: Work) -> list[ParetoFront]:
    """The front of each leg, for all of which there is some time [s]."""
    legs: list[ParetoFront] = []
    left, count = seconds, len(view.legs)
    work.progress(0, count)
    for n, (start, goal) in enumerate(view.legs):
        began = time.perf_counter()
        leg = pareto_front(view.costs, start, goal, time_limit=left / (count - n))
        left = max(left - (time.perf_counter() - began), 1e-3)
        work.progress(n + 1, count)
        if leg.status == "timeout":
            raise ConfigError(f"no path was found within {seconds:.3g} s; ask for places closer by")
        if not len(leg):
            raise ConfigError("no path joins start and goal; move one of them")
        legs.append(leg)
    return legs


def _summed(legs: Sequence[ParetoFront]) -> tuple[Numbers, Numbers, NDArray[np.int64], bool]:
    """Lengths and integrals (n,) of the best sums of legs, the path of each leg, (n, legs).

    The last value says whether points were left out, since there were too many pairs.
    """
    length, integral = legs[0].length, legs[0].integral
    chosen, thinned = np.arange(len(length))[:, None], False
    for leg in legs[1:]:
        own = np.arange(len(leg))
        if len(length) * len(own) > PAIRS:
            thinned = True
            own = _evenly(len(own), int(PAIRS**0.5))
            kept = _evenly(len(length), PAIRS // len(own))
            length, integral, chosen = length[kept], integral[kept], chosen[kept]
        sums = (length[:, None] + leg.length[own]).ravel()
        others = (integral[:, None] + leg.integral[own]).ravel()
        best = _undominated(sums, others)
        before, last = np.divmod(best, len(own))
        length, integral = sums[best], others[best]
        chosen = np.column_stack([chosen[before], own[last]])
    return length, integral, chosen, thinned


def _undominated(length: Numbers, integral: Numbers) -> NDArray[np.int64]:
    """Indices of the pairs that no other one is at most as long and degenerate as, by length."""
    order = np.lexsort((integral, length))
    least = np.minimum.accumulate(integral[order])
    first = np.concatenate([[True], integral[order][1:] < least[:-1]])
    kept: NDArray[np.int64] = order[first]
    return kept


def _weights_of(length: Numbers, integral: Numbers) -> Numbers:
    """A weight at which each point is the cheapest, (n,); NaN if there is none.

    Points are given by rising length and falling integral; those on the lower hull have weights.
    """
    hull: list[int] = []
    for n in range(len(length)):
        while len(hull) > 1 and _slope(length, integral, hull[-2], hull[-1]) >= _slope(
            length, integral, hull[-1], n
        ):
            hull.pop()
        hull.append(n)
    weights = np.full(len(length), np.nan)
    turns = [_slope(length, integral, *pair) for pair in itertools.pairwise(hull)]
    if not turns:
        weights[hull] = 0.0
        return weights
    # Half the first and twice the last: the ends are the cheapest all the way to 0 and beyond.
    low, high = [turns[0] / 4, *turns], [*turns, 4 * turns[-1]]
    weights[hull] = np.sqrt(np.multiply(low, high))
    return weights


def _slope(length: Numbers, integral: Numbers, one: int, other: int) -> float:
    """Metres of detour for a degenerate metre less, from one point to a longer one."""
    return float((length[other] - length[one]) / (integral[one] - integral[other]))


def _thinned(
    length: Numbers, integral: Numbers, preferred: NDArray[np.bool_], knee: int
) -> NDArray[np.int64]:
    """Indices of at most `SHOWN` points, evenly along the front: both ends and the knee always.

    Of neighbours one that is preferred is taken.
    """
    count = len(length)
    if count <= SHOWN:
        return np.arange(count)
    steps = [np.abs(np.diff(each)) / np.ptp(each) for each in (length, integral)]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*steps))])
    # By their way along the front and by their number: much of the way can be a few wide gaps.
    along = along / along[-1] + np.linspace(0, 1, count)
    places = np.minimum((along / 2 * (SHOWN - 3)).astype(int), SHOWN - 4)
    kept = {0, count - 1, knee}
    for place in range(SHOWN - 3):
        (inside,) = np.nonzero(places == place)
        better = inside[preferred[inside]]
        some = better if better.size else inside
        if some.size:
            kept.add(int(some[some.size // 2]))
    return np.array(sorted(kept))


def _evenly(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of `count` things, evenly, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _joined(legs: Sequence[ParetoFront], chosen: NDArray[np.int64]) -> Numbers:
    """Positions along one path of each leg, one after the other, (n, 2) [m]."""
    parts: list[Numbers] = []
    for leg, index in zip(legs, chosen.tolist(), strict=True):
        path = leg.plan(index).path
        assert path is not None
        parts.append(path.xy[1:] if parts else path.xy)
    return np.concatenate(parts)

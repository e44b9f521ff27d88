"""Paths that follow while a marker is dragged, and the Pareto front of the way shown."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import RESOLUTIONS
from locplan._util.poses import way_along
from locplan.costs import Costmap, Path, crossed_cells
from locplan.errors import ConfigError
from locplan.explorer._scene import FACTOR, Scene, rounded, stops_of
from locplan.explorer._searches import Flood, Searches
from locplan.explorer._view import headed, planner_of
from locplan.field import read_known_at
from locplan.maps import OccupancyGrid
from locplan.planners import (
    AWARE,
    LATTICE,
    SHORTEST,
    ParetoFront,
    Position,
    pareto_front,
    plan_beside_shortest,
)

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session
    from locplan.explorer._view import View


SHORTEST_WEIGHT = 1e-6
"""Weight of the shortest path: of the many on a grid it is the one that sees most."""


def plan(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer with both paths over start, waypoints and goal.

    They are those of `locplan.planners.plan_beside_shortest`, also where they come from searches
    that are kept from the other end. A draft is planned on a coarser map where the map is large,
    and the search is kept from the ends that are not held.
    """
    scene, weight = session.scene, session.weight_of(ask)
    stops, held = stops_of(ask, scene.parts)
    start, *via, goal = map(list, stops)
    about = {"start": start, "goal": goal, "via": via, "draft": False}
    nothing = about | {"aware": None, "shortest": None}
    searches = Searches(session.kept, scene, work.cancel.check)
    weights = (SHORTEST_WEIGHT, weight) if scene.field else (SHORTEST_WEIGHT,)
    if _is_for_lattice(ask, scene, held):
        return about | _by_lattice(searches, headed(ask, stops), weight)
    if ask.flag("draft") and _has_drafts(session, scene.costs.grid):
        drafts = [searches.path(stops, each, held, draft=True) for each in weights]
        paths = [path_answer(scene.costs, scene, path, weight) for path in drafts if path]
        if len(paths) == len(weights):
            return nothing | dict(zip(("shortest", "aware"), paths, strict=False)) | {"draft": True}
    found: list[Path] = []
    for each in weights:
        path = searches.path(stops, each, held)
        searches.check()
        if path is None:
            why = f"no path joins them for a robot of radius {session.robot.radius:g} m"
            return nothing | {"why": why}
        found.append(path)
    costs = searches.halved(weights[-1]).costs
    answers = [path_answer(costs, scene, path) for path in found]
    if scene.field is None:
        return nothing | {"shortest": answers[0], "why": "the field is still being computed"}
    # Any-angle paths are improved from two beginnings, and the better one of the two counts.
    shortest, aware = (min(answers, key=lambda one: one[by]) for by in ("length", "cost"))
    return about | {"aware": aware, "shortest": shortest}


def _is_for_lattice(ask: Ask, scene: Scene, held: int | None) -> bool:
    """Whether a plan is one of the lattice planner: else it is that of a circle."""
    rests = held is None and not ask.flag("draft")
    return rests and scene.field is not None and planner_of(ask) is not None


def _by_lattice(searches: Searches, stops: Sequence[Position], weight: float) -> dict[str, Any]:
    """Both paths of the lattice planner, with the headings along the aware one."""
    (start, *via, goal), scene = stops, searches.scene
    costs = scene.costs.with_weight(weight)
    found = plan_beside_shortest(costs, start, goal, via=via, planner=LATTICE)
    searches.check()
    paths = [found[name].path for name in (AWARE, SHORTEST)]
    if None in paths:
        return {"aware": None, "shortest": None, "why": found[AWARE].note or found[AWARE].status}
    halved = searches.halved(weight).costs
    aware, shortest = (path_answer(halved, scene, path) for path in paths if path)
    facing = paths[0].facing.round(3).tolist() if paths[0] else []
    return {"aware": aware | {"heading": facing}, "shortest": shortest}


def idle(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Prepare drafts and search from the stops, so that the next drag finds that done.

    Where a stop is held, its drag has begun: only the stops beside it are searched from. While a
    field is computed nothing is done: its costs will be others, and both have no room at once.
    """
    if session.busy is not None:
        return {"ok": False}
    scene, weight, check = session.scene, session.weight_of(ask), work.cancel.check
    stops, held = stops_of(ask, scene.parts)
    weights = (SHORTEST_WEIGHT, weight) if scene.field else (SHORTEST_WEIGHT,)
    searches = Searches(session.kept, scene, check)
    for each in weights if held is None and _has_drafts(session, scene.costs.grid) else ():
        check()
        searches.coarse(each)
    halved = [searches.halved(each).bordered for each in weights]
    room = session.kept.limit - Flood.expected(halved[0])
    # A coarse costmap takes three arrays of its own cells.
    room -= sum(each.half.nbytes + 3 * each.half.nbytes // FACTOR**2 for each in halved)
    for stop in _first_to_rest(stops, held):
        room -= sum(each.half.size for each in halved)
        if room < 0:
            break  # one search would only push out another
        # A drag that has begun waits for these; else one after the other takes less memory.
        with ThreadPoolExecutor(1 if held is None else len(weights)) as pool:
            made = [pool.submit(searches.flood, each, stop, check) for each in weights]
        for one in made:
            one.result()
    return {"ok": True}


def _first_to_rest(stops: Sequence[Position], held: int | None) -> list[Position]:
    """The stops beside the one that is held, or all as drags may need them: ends move most."""
    if held is not None:
        return [stops[n] for n in (held - 1, held + 1) if 0 <= n < len(stops)]
    start, *via, goal = stops
    ends = [via[-1], via[0], start, goal, *via[1:-1]] if via else [start, goal]
    return list(dict.fromkeys(ends))


def is_slow(session: Session, ask: Ask) -> bool:
    """Whether a plan takes so long that drafts must not wait for it."""
    if ask.values.get("draft") is True:
        return False
    return _has_drafts(session, session.grid) or ask.has("planner")


def _has_drafts(session: Session, grid: OccupancyGrid) -> bool:
    """Whether drafts are planned on larger cells: those of a map may have 10 m at most."""
    large = max(grid.shape) > session.opening.limits.draft_cells
    return large and grid.resolution * FACTOR <= RESOLUTIONS[1]


def path_answer(
    costs: Costmap, scene: Scene, path: Path, weight: float | None = None
) -> dict[str, Any]:
    """Measure a path on a scene's costmap of half the cost, and read what lies along it.

    The numbers are those of `locplan.costs.path_metrics`, which takes the clearance of the whole
    map besides. The cost is that at a weight where one is given, such as for a draft.
    """
    _, *at, lengths = crossed_cells(costs.grid, path)
    rows, cols = (np.clip(i, 0, n - 1) for i, n in zip(at, costs.grid.shape, strict=True))
    ends, u = np.cumsum(lengths), costs.u[rows, cols]
    density, degenerate = costs.density[rows, cols], float(u @ lengths)
    cost = 2 * float(density @ lengths) if np.isfinite(density).all() else float("inf")
    sigma = np.full(len(u), np.nan)
    if scene.field is not None and scene.log_deviation is not None:
        log = read_known_at(*scene.log_deviation, rows, cols, scene.field.stride)
        sigma = 100 * np.exp(log)
    first = np.unique(np.linspace(0, len(ends), min(len(ends), 400), endpoint=False).astype(int))
    last = np.append(first[1:], len(ends)) - 1
    known = ~np.isnan(sigma)
    way = lengths[known].sum()
    return {
        "xy": np.round(path.xy, 4).tolist(),
        "length": path.length,
        "degenerate": degenerate,
        "cost": cost if weight is None else path.length + weight * degenerate,
        "integrated_e": float(costs.e[rows, cols] @ lengths),
        "mean_sigma_cm": float(sigma[known] @ lengths[known] / way) if way else None,
        "worst_sigma_cm": float(sigma[known].max()) if known.any() else None,
        "profile": {  # of the cells of each step the worst, at the step's end
            "s": np.round(ends[last], 3).tolist(),
            "u": np.round(np.fmax.reduceat(u, first), 4).tolist(),
            "sigma_cm": np.round(np.fmax.reduceat(sigma, first), 2).tolist(),
        },
    }


SECONDS, SECONDS_PER_CELL = 5.0, 1e-6
"""Time limit of a front by default, for all legs together [s], and how it grows with the map."""
MIN_SECONDS, MAX_SECONDS = 0.1, 60.0
"""Limits of the time limit that can be asked for [s]."""
SHOWN = 60
"""Maximum number of points that are shown; a front can have thousands."""
PAIRS = 4_000_000
"""Maximum number of pairs of points of two legs that are added up."""


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
            "xy": rounded(_joined(legs, chosen[n]).xy),
        }
        for n in shown
    ]
    return {
        "points": points,
        "knee": shown.index(knee),
        "paths": len(length),
        "epsilon": epsilon,
        "complete": epsilon == 0,
    }


def _fronts_of(view: View, seconds: float, work: Work) -> list[ParetoFront]:
    """The front of each leg, for all of which there is some time [s]."""
    legs: list[ParetoFront] = []
    left, count = seconds, len(view.stops) - 1
    work.progress(0, count)
    for n, (start, goal) in enumerate(itertools.pairwise(view.stops)):
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


def _summed(legs: Sequence[ParetoFront]) -> tuple[Floats, Floats, Ints, bool]:
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


def _undominated(length: Floats, integral: Floats) -> Ints:
    """Indices of the pairs that no other one is at most as long and degenerate as, by length."""
    order = np.lexsort((integral, length))
    least = np.minimum.accumulate(integral[order])
    first = np.concatenate([[True], integral[order][1:] < least[:-1]])
    kept: Ints = order[first]
    return kept


def _weights_of(length: Floats, integral: Floats) -> Floats:
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


def _slope(length: Floats, integral: Floats, one: int, other: int) -> float:
    """Metres of detour for a degenerate metre less, from one point to a longer one."""
    return float((length[other] - length[one]) / (integral[one] - integral[other]))


def _thinned(length: Floats, integral: Floats, preferred: Bools, knee: int) -> Ints:
    """Indices of at most `SHOWN` points, evenly along the front: both ends and the knee always.

    One that is preferred is taken where it is not much farther from its place than others.
    """
    count = len(length)
    if count <= SHOWN:
        return np.arange(count)
    along = way_along(np.column_stack([each / np.ptp(each) for each in (length, integral)]))
    # By their way along the front and by their number: much of the way can be a few wide gaps.
    along = along / along[-1] + np.linspace(0, 1, count)
    steps = np.linspace(0, 2, SHOWN - 2)
    places = (steps[1:] + steps[:-1]) / 2
    apart = np.abs(along[:, None] - places) + np.where(preferred, 0, steps[1] / 2)[:, None]
    return np.unique([0, count - 1, knee, *apart.argmin(axis=0)])


def _evenly(count: int, most: int) -> Ints:
    """Indices of at most `most` of `count` things, evenly, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _joined(legs: Sequence[ParetoFront], chosen: Ints) -> Path:
    """One path of each leg, one after the other."""
    plans = [leg.plan(index) for leg, index in zip(legs, chosen.tolist(), strict=True)]
    return Path.joined([plan.path for plan in plans if plan.path is not None])

"""Paths that follow while a marker is dragged."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import RESOLUTIONS
from locplan.app.explorer.scene import FACTOR, Scene, stops_of
from locplan.app.explorer.searches import Flood, Searches
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import crossed_cells, path_cost
from locplan.planning.path import Path
from locplan.planning.protocol import Position

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Ask, Work
    from locplan.app.explorer.session import Session


SHORTEST_WEIGHT = 1e-6
"""Weight of the shortest path: of the many on a grid it is the one that sees most."""


def plan(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer with both paths over start, waypoints and goal.

    They are those of `locplan.planning.plans.plan_beside_shortest`, also where they come from
    searches that are kept from the other end. A draft is planned on a coarser map where the map is
    large, and the search is kept from the ends that are not held.
    """
    scene, weight = session.scene, session.weight_of(ask)
    stops, held = stops_of(ask, scene.parts)
    start, *via, goal = map(list, stops)
    about = {"start": start, "goal": goal, "via": via, "draft": False}
    nothing = about | {"aware": None, "shortest": None}
    searches = Searches(session.kept, scene, work.cancel.check)
    weights = (SHORTEST_WEIGHT, weight) if scene.field else (SHORTEST_WEIGHT,)
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
    return _has_drafts(session, session.grid)


def _has_drafts(session: Session, grid: OccupancyGrid) -> bool:
    """Whether drafts are planned on larger cells: those of a map may have 10 m at most."""
    large = max(grid.shape) > session.opening.limits.draft_cells
    return large and grid.resolution * FACTOR <= RESOLUTIONS[1]


def path_answer(
    costs: Costmap, scene: Scene, path: Path, weight: float | None = None
) -> dict[str, Any]:
    """Measure a path on a scene's costmap of half the cost, and read what lies along it.

    The numbers are those of `locplan.planning.path_metrics`, which takes the clearance of the whole
    map besides. The cost is that at a weight where one is given, such as for a draft.
    """
    _, *at, lengths = crossed_cells(costs.grid, path)
    rows, cols = (np.clip(i, 0, n - 1) for i, n in zip(at, costs.grid.shape, strict=True))
    ends, u = np.cumsum(lengths), costs.u[rows, cols]
    degenerate, cost = float(u @ lengths), 2 * float(path_cost(costs, path))
    sigma = np.full(len(u), np.nan)
    if scene.field is not None:
        middles = np.column_stack(costs.grid.grid_to_world(rows + 0.5, cols + 0.5))
        sigma = 100 * scene.field.at(middles, "position_std")
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

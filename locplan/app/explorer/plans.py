"""Plans of the recommended and the shortest path, updated while a marker is dragged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import RESOLUTIONS
from locplan._support.kernels.arrays import Floats, Ints
from locplan.app.explorer.messages import MAX_WEIGHT
from locplan.app.explorer.scene import FACTOR, MapScene, StartSettings, read_stops
from locplan.app.explorer.searches import PathSearches, PathTree
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import find_cells_of_path
from locplan.planning.path import Path
from locplan.planning.protocol import Position

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question, QuestionJob
    from locplan.app.explorer.session import Session

MAX_STEPS = 400
"""Maximum number of points of a profile."""
TINY = 1e-12
"""Length added to each step, so that a path of length 0 has a mean [m]."""


def plan_route(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Plan the recommended and the shortest path over start, waypoints and goal.

    They equal those of `locplan.planning.plans.plan_with_shortest`. On large maps, a draft is
    planned on larger cells. Searches from the stops that do not move are stored.
    """
    weight = read_weight(question, scene)
    stops, held = read_stops(question, scene.parts)
    start, *via, goal = map(list, stops)
    answer = {"start": start, "goal": goal, "via": via, "draft": False, "why": None}
    answer |= {"recommended": None, "shortest": None}
    searches = PathSearches(session.searches, scene, job.check)
    weights = (None, weight) if scene.field else (None,)
    is_draft = question.flag("draft") and has_drafts(session.opening, scene.site.grid)
    paths = [searches.path(stops, w, held, is_draft=is_draft) for w in weights]
    if is_draft and None in paths:  # a gap may be too narrow for large cells
        is_draft, paths = False, [searches.path(stops, w, held) for w in weights]
    measured = [measure_path(scene, path, weight, held is None) for path in paths if path]
    if len(measured) < len(weights):
        reason = f"No path joins these places for a robot of radius {scene.site.robot.radius:g} m."
        return answer | {"why": reason}
    if scene.field is None:
        reason = "The field is still being computed."
        return answer | {"shortest": measured[0], "why": reason}
    shortest, recommended = measured
    if not is_draft:  # any-angle search is a heuristic: the path for the other weight may be better
        shortest = min(measured, key=lambda path: path["length"])
        recommended = min(measured, key=lambda path: path["cost"])
    return answer | {"draft": is_draft, "recommended": recommended, "shortest": shortest}


def read_weight(question: Question, scene: MapScene) -> float:
    """Return the weight of a question; the scene's weight by default."""
    weight = scene.costs.weight if scene.field else 0.0
    return question.number("weight", 0.0, MAX_WEIGHT, weight)


def prepare_searches(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> None:
    """Prepare drafts and searches from the stops, so that the next drag is fast.

    Does nothing while a field is being computed, because its costs will change.
    """
    if session.busy is not None or scene is not session.scene or scene.field is None:
        return
    stops, held = read_stops(question, scene.parts)
    if held is not None or question.flag("draft"):
        return
    weights = None, read_weight(question, scene)
    searches = PathSearches(session.searches, scene, job.check)
    for weight in weights if has_drafts(session.opening, scene.site.grid) else ():
        job.check()
        searches.coarse_grid(weight)
    grids = [searches.grid(weight).bordered for weight in weights]
    room = session.searches.limit - PathTree.estimate_search_bytes(grids[0])
    # A coarse costmap takes three arrays of coarse cells.
    room -= sum(grid.half.nbytes + 3 * grid.half.nbytes // FACTOR**2 for grid in grids)
    for stop in _sort_by_drag_frequency(stops):
        room -= sum(grid.half.size for grid in grids)
        if room < 0:
            return  # another search would displace one that is needed
        for weight in weights:
            job.check()
            searches.get_tree(weight, stop, job.check)


def _sort_by_drag_frequency(stops: Sequence[Position]) -> list[Position]:
    """Return the stops in the order in which drags need their searches: ends move most often."""
    start, *via, goal = stops
    order = [via[-1], via[0], start, goal, *via[1:-1]] if via else [start, goal]
    return list(dict.fromkeys(order))


def has_drafts(start_settings: StartSettings, grid: OccupancyGrid) -> bool:
    """Return True if drafts are planned on larger cells: on large maps, up to 10 m a cell."""
    is_large = max(grid.shape) > start_settings.limits.draft_cells
    return is_large and grid.resolution * FACTOR <= RESOLUTIONS[1]


def find_crossed_cells(costs: Costmap, path: Path) -> tuple[Ints, Ints, Floats]:
    """Return the rows and columns of the cells that a path crosses, and the lengths in them."""
    _, *at, lengths = find_cells_of_path(costs.grid, path)
    rows, cols = (np.clip(i, 0, n - 1) for i, n in zip(at, costs.grid.shape, strict=True))
    return rows, cols, lengths


def measure_path(scene: MapScene, path: Path, weight: float, has_profile: bool) -> dict[str, Any]:
    """Return the metrics of a path at a weight, as `locplan.planning.path_metrics` does.

    A draft may cross blocked cells. They cost as much as open ones.
    """
    costs = scene.costs
    rows, cols, lengths = find_crossed_cells(costs, path)
    answer = {"xy": np.round(path.xy, 3).tolist(), "length": path.length}
    sigma = np.full(len(lengths), np.nan)
    if scene.field is None:
        answer |= {"degenerate": None, "cost": path.length}
    else:
        u, density = np.nan_to_num(costs.u[rows, cols]), costs.density[rows, cols]
        degenerate = float(u @ lengths)
        # Blocked cells have no density: the largest charge stands for their zones.
        open_density = 1 + costs.weight * u + scene.site.zones.max_cost_per_metre
        density = np.where(np.isfinite(density), density, open_density)
        cost = float(density @ lengths)
        answer |= {"degenerate": degenerate, "cost": cost + (weight - costs.weight) * degenerate}
        middles = np.column_stack(costs.grid.grid_to_world(rows + 0.5, cols + 0.5))
        sigma = 100 * scene.field.at(middles, "position_std")
    is_known = ~np.isnan(sigma)
    mean = math.nan
    if is_known.any():
        mean = np.average(sigma[is_known], weights=lengths[is_known] + TINY)
    answer |= {"mean_sigma_cm": float(mean)}
    return answer | ({"profile": _describe_profile(sigma, lengths)} if has_profile else {})


def _describe_profile(sigma: Floats, lengths: Floats) -> dict[str, list[float]]:
    """Return the largest deviation in each step of a path, at the step's end."""
    ends, count = np.cumsum(lengths), len(lengths)
    first = np.unique(np.linspace(0, count, min(count, MAX_STEPS), endpoint=False).astype(int))
    last = np.append(first[1:], count) - 1
    return {
        "s": np.round(ends[last], 3).tolist(),
        "sigma_cm": np.round(np.fmax.reduceat(sigma, first), 2).tolist(),
    }

"""Choice of the page's first route, on which localizability makes a large difference."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from locplan.app.explorer.plans import find_crossed_cells
from locplan.planning.cost_to_go import find_farthest_pairs
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.protocol import Position

if TYPE_CHECKING:
    from locplan.app.explorer.scene import StartSettings
    from locplan.app.explorer.searches import PathSearches

NAMES = "ABCDEFG"
"""Names of the distant places. All pairs of them are compared."""


@dataclass(frozen=True)
class RouteStops:
    """The stops of a route."""

    start: Position
    """Position of the start [m]."""
    goal: Position
    """Position of the goal [m]."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way [m]."""


def choose_first_route(
    searches: PathSearches, start_settings: StartSettings, *, is_draft: bool
) -> RouteStops | None:
    """Return the pair of distant places whose two paths differ most; None without a free place.

    The difference is the degenerate metres that the recommended path avoids, times their share of
    the degenerate metres of the shortest path.

    Parameters
    ----------
    searches : Searches
        The searches on a scene with a field.
    start_settings : Opening
        The settings of the session, which may name the start or the goal.
    is_draft : bool
        If True, plan on larger cells.
    """
    places, scene = find_far_places(searches), searches.scene
    starts = [start_settings.start] if start_settings.start else places
    goals = [start_settings.goal] if start_settings.goal else places
    pairs = [(a, b) for a, b in itertools.product(starts, goals) if a != b]
    if not start_settings.start and not start_settings.goal:
        pairs = list(itertools.combinations(sorted(places), 2))
    if not pairs:
        return RouteStops(places[0], places[0]) if places else None

    def compute_avoided_length(pair: tuple[Position, Position]) -> float:
        weights = None, scene.costs.weight
        paths = [searches.path(pair, weight, 1, is_draft=is_draft) for weight in weights]
        if None in paths:
            return -1.0
        shortest, recommended = (
            _measure_degenerate_length(scene.costs, path) for path in paths if path
        )
        return (shortest - recommended) ** 2 / shortest if shortest > recommended else 0.0

    return RouteStops(*max(pairs, key=compute_avoided_length), start_settings.via)


def _measure_degenerate_length(costs: Costmap, path: Path) -> float:
    """Return the degenerate metres of a path."""
    rows, cols, lengths = find_crossed_cells(costs, path)
    return float(np.nan_to_num(costs.u[rows, cols]) @ lengths)


def find_far_places(searches: PathSearches) -> list[Position]:
    """Return places far apart in the largest connected part of the free space."""
    parts = searches.scene.parts
    if not parts.largest:
        return []
    pairs = find_farthest_pairs(parts.grid, parts.labels, parts.largest, NAMES, 0.0)
    ends = [(place.x, place.y) for pair in pairs for place in (pair.start, pair.goal)]
    row, col = np.argwhere(parts.labels == parts.largest)[0].tolist()
    return list(dict.fromkeys(ends)) or [parts.grid.position(row, col)]

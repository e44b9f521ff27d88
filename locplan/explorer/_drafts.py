"""Drafts of paths on a map that is several times coarser, while a marker is dragged."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap, Path
from locplan.explorer._profiles import PathAnswer, path_answer
from locplan.explorer._scene import Scene
from locplan.explorer._searches import Flood, index_of
from locplan.explorer._session import Session
from locplan.explorer._snap import FACTOR, Floor
from locplan.planners import Bordered, Position, any_angle_path

NEAR = 2
"""Distance in coarse cells within which a stop finds a free one."""


@dataclass(frozen=True, eq=False)
class Coarse:
    """A costmap with larger cells."""

    costs: Costmap
    """The costmap; its map is free where most of a cell is."""
    bordered: Bordered
    """The same as the searches take it."""

    @classmethod
    def of(cls, floor: Floor, weight: float) -> Coarse:
        """Make the costmap of a coarse floor at a weight."""
        density = np.where(floor.grid.free, 1 + weight * floor.u, np.inf)
        costs = Costmap.from_density(floor.grid, density)
        return cls(costs, Bordered.of(costs))

    @property
    def bytes(self) -> int:
        """Bytes that it takes."""
        return 3 * self.bordered.half.nbytes

    @staticmethod
    def expected(fine: Bordered) -> int:
        """Bytes that the one of a costmap takes, roughly."""
        return 3 * fine.half.nbytes // FACTOR**2

    def free_near(self, xy: Position) -> Position | None:
        """The position, or the centre of a free cell near it; None where there is none [m]."""
        grid, density = self.costs.grid, self.costs.density
        row, col = grid.world_to_cell(*xy[:2])
        if grid.contains(row, col) and np.isfinite(density[row, col]):
            return xy
        rows, cols = (slice(max(0, at - NEAR), max(0, at + NEAR + 1)) for at in (row, col))
        near: NDArray[np.int64] = np.argwhere(np.isfinite(density[rows, cols]))
        if not near.size:
            return None
        near = near + np.array((rows.start, cols.start))
        at = near[int(np.argmin(((near - np.array((row, col))) ** 2).sum(axis=1)))]
        return grid.cell_to_world(int(at[0]), int(at[1]))


def drafted(
    session: Session,
    scene: Scene,
    stops: Sequence[Position],
    weights: tuple[float, float],
    held: int | None,
    check: Callable[[], None],
) -> tuple[PathAnswer, PathAnswer | None] | None:
    """Drafts of the shortest and the aware path at two weights; None where there are none.

    The aware one is None before there is a field.
    """
    answers: list[PathAnswer] = []
    for weight in weights if scene.field is not None else weights[:1]:
        check()
        path = _over(session, scene, stops, weight, held)
        if path is None:
            return None
        made = path_answer(scene.costs, scene, path)
        answers.append(replace(made, cost=made.length + weights[1] * made.degenerate))
    return answers[0], (answers[1] if len(answers) > 1 else None)


def coarse_of(session: Session, scene: Scene, weight: float) -> Coarse:
    """The costmap of drafts at a weight, which is kept."""
    key = ("coarse", scene.serial, weight)

    def make() -> Coarse:
        return Coarse.of(scene.floor, weight)

    return session.kept.made(key, make, lambda made: made.bytes)


def _over(
    session: Session, scene: Scene, stops: Sequence[Position], weight: float, held: int | None
) -> Path | None:
    """A draft over all stops; None if a leg has none."""
    coarse = coarse_of(session, scene, weight)
    legs: list[Path] = []
    for n, (start, goal) in enumerate(itertools.pairwise(stops)):
        first, last = coarse.free_near(start), coarse.free_near(goal)
        if first is None or last is None:
            return None
        backwards = held == n  # the search is kept from the end that rests
        rests, moves = (last, first) if backwards else (first, last)
        flood = _flood(session, coarse, ("coarse flood", scene.serial, weight), rests)
        moving = index_of(coarse.costs, moves)
        cells_of = flood.cells_from if backwards else flood.cells_to
        cells = cells_of(coarse.bordered, moving)
        if cells is None:
            return None
        found = any_angle_path(coarse.costs, coarse.bordered, cells, first, last)
        legs.append(Path(np.vstack([start, found.xy[1:-1], goal])))
    path = Path.joined(legs) if len(legs) > 1 else legs[0]
    return path if math.isfinite(path.length) else None


def _flood(session: Session, coarse: Coarse, key: tuple[object, ...], end: Position) -> Flood:
    """The search from an end of a leg, which is kept."""
    source = index_of(coarse.costs, end)

    def make() -> Flood:
        return Flood.of(coarse.bordered, source)

    return session.kept.made((*key, source), make, lambda made: made.steps.nbytes)

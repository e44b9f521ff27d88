"""Rigid moves of a map under which many of its places look the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.poses import wrapped
from locplan._util.progress import ProgressCallback
from locplan.matching import Database, ScanOnMap, in_batches
from locplan.twins._places import THRESHOLD, Looks

ALIKE, ALIKE_TURN = 1.0, 0.1
"""Distance up to which two moves take the middle of the map to one place [m], and turn by which
such moves may differ [rad]."""
DRIFT, DRIFT_TURN = 0.8, 0.2
"""Distance [m] and angle [rad] that a place's twin may have from where the move takes it."""
MIN_VOTES = 4


@dataclass(frozen=True)
class Symmetry:
    """A rigid move of the map after which many places look the same."""

    turn: float
    """Turn, counter-clockwise [rad]."""
    middle: tuple[float, float]
    """World position of the middle of the map's reachable places [m]."""
    moved: tuple[float, float]
    """World position that the move takes this middle to [m]."""
    share: float
    """Share of the places that the move takes to a twin, 0..1."""

    @property
    def distance(self) -> float:
        """Distance by which the middle of the map is moved [m]."""
        return math.dist(self.middle, self.moved)

    @property
    def shift(self) -> tuple[float, float]:
        """How far the middle of the map is moved along x and y [m]."""
        (x, y), (to_x, to_y) = self.middle, self.moved
        return to_x - x, to_y - y

    @property
    def turn_deg(self) -> int:
        """The turn in whole degrees, above -180 [deg]."""
        turn = round(math.degrees(self.turn))
        return 180 if turn == -180 else turn

    def __str__(self) -> str:
        turn = f"{self.turn_deg:+d}°" if self.turn_deg else "no turn"
        x, y = self.shift
        return f"{turn}, middle moved by {x:+z.1f},{y:+z.1f} m: {self.share:.0%} of the places"


def find_symmetries(
    database: Database,
    homes: Floats,
    ranges: Floats,
    looks: Sequence[Looks],
    threads: int = 1,
    progress: ProgressCallback | None = None,
) -> tuple[list[Symmetry], list[Bools]]:
    """The moves that take many poses to twins, the one with the greatest share first.

    Each twin of a pose proposes a move. Moves are compared by where they take the middle of the
    map. Those that many poses propose are tried on all poses.

    Parameters
    ----------
    database : Database
        The map.
    homes : (n, 3) array
        Poses x, y [cells] and heading on the map.
    ranges : (n, 96) array
        The scans there [m].
    looks : sequence of n Looks
        The twins of each.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with (done, total) poses, those of all moves taken together.

    Returns
    -------
    symmetries : list of Symmetry
    covered : list of (n,) arrays of bool
        The poses that each takes to a twin.
    """
    resolution = database.grid.resolution
    middle = (homes[:, :2].min(axis=0) + homes[:, :2].max(axis=0)) / 2
    found: list[tuple[Bools, float, Floats]] = []
    moves = _proposed(middle, homes, looks, resolution)
    trials = in_batches(
        lambda some: [_tried(database, homes, ranges, middle, *moves[n]) for n in some],
        len(moves),
        threads,
        progress and (lambda done, total: progress(done * len(homes) // max(total, 1), len(homes))),
        batch=1,
    )
    if progress:
        progress(len(homes), len(homes))
    for (turn, moved), (covered, twins) in zip(moves, trials, strict=True):
        # Share of the places from which on a move is a symmetry.
        if covered.mean() >= 0.1:
            turn, moved = _fitted(middle, homes[covered], twins[covered])
            known = [(0.0, middle), *((a, to) for _, a, to in found)]  # to stay is no symmetry
            if not any(_alike(turn - a, moved - to, resolution) for a, to in known):
                found.append((covered, turn, moved))
    found.sort(key=lambda each: -float(each[0].mean()))
    points = np.array([middle, *(moved for _, _, moved in found)])
    world = np.column_stack(database.grid.grid_to_world(points[:, 1], points[:, 0])).tolist()
    at = world[0][0], world[0][1]
    return [
        Symmetry(turn, at, (x, y), float(covered.mean()))
        for (covered, turn, _), (x, y) in zip(found, world[1:], strict=True)
    ], [covered for covered, _, _ in found]


def _proposed(
    middle: Floats, homes: Floats, looks: Sequence[Looks], resolution: float
) -> list[tuple[float, Floats]]:
    """Moves that most twins propose: their turn, and where they take the middle."""
    from scipy.spatial import cKDTree

    pairs = [
        (n, twin) for n, look in enumerate(looks) for twin in look.twins if twin[3] <= THRESHOLD
    ]
    if len(pairs) < MIN_VOTES:
        return []
    places = np.array([n for n, _ in pairs])
    twins = np.array([twin[:3] for _, twin in pairs])
    turns = wrapped(twins[:, 2] - homes[places, 2])
    moved = twins[:, :2] + _rotated(middle - homes[places, :2], turns)
    # A turn by `ALIKE_TURN` counts as much as a move by `ALIKE`.
    around = np.column_stack([np.cos(turns), np.sin(turns)]) / ALIKE_TURN
    points = np.column_stack([moved * resolution / ALIKE, around])
    tree = cKDTree(points)
    # Only the numbers: where everything repeats, the neighbours of all points take gigabytes.
    votes = tree.query_ball_point(points, 1.0, return_length=True).tolist()
    left = np.ones(len(points), bool)
    proposed: list[tuple[float, Floats]] = []
    for n in sorted(range(len(points)), key=lambda n: (-votes[n], n)):
        # Number of moves that are tried on all places.
        if votes[n] < MIN_VOTES or len(proposed) == 24:
            break
        if not left[n]:
            continue
        own = np.array(tree.query_ball_point(points[n], 1.0))
        left[own] = False
        turn = turns[n] + float(np.median(wrapped(turns[own] - turns[n])))
        proposed.append((turn, np.median(moved[own], axis=0)))
    return proposed


def _tried(
    database: Database, homes: Floats, ranges: Floats, middle: Floats, turn: float, to: Floats
) -> tuple[Bools, Floats]:
    """Which poses a move takes to a twin, (n,), and the twins, (n, 3)."""
    moved = np.column_stack(
        [to + _rotated(homes[:, :2] - middle, np.full(len(homes), turn)), homes[:, 2] + turn]
    )
    covered, twins = np.zeros(len(homes), bool), moved.copy()
    resolution = database.grid.resolution
    rows, cols = database.fits.shape
    inside = ((moved[:, :2] >= 0) & (moved[:, :2] < (cols, rows))).all(axis=1)
    for n in np.flatnonzero(inside):
        scan = ScanOnMap(database, ranges[n])
        if not scan.returns.any():
            continue
        twin, loss = scan.moved_to_min(moved[n])
        drift = math.hypot(*(twin[:2] - moved[n, :2])) * resolution
        if drift > DRIFT or abs(float(wrapped(twin[2:] - moved[n, 2])[0])) > DRIFT_TURN:
            continue
        twins[n] = twin
        covered[n] = loss - scan.losses_at(homes[n : n + 1])[0] <= THRESHOLD
    return covered, twins


def _fitted(middle: Floats, homes: Floats, twins: Floats) -> tuple[float, Floats]:
    """The move that takes poses closest to their twins: its turn, and where it takes the middle."""
    a, b = homes[:, :2] - homes[:, :2].mean(axis=0), twins[:, :2] - twins[:, :2].mean(axis=0)
    across = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    turn = math.atan2(across, float((a * b).sum()))
    to = twins[:, :2].mean(axis=0) + _rotated(
        (middle - homes[:, :2].mean(axis=0))[None], np.array([turn])
    )
    return turn, to[0]


def _alike(turn: float, apart: Floats, resolution: float) -> bool:
    """Whether two moves are one, that differ by a turn, and by this at the middle [cells]."""
    near = math.hypot(*apart) * resolution <= 2 * ALIKE
    return near and abs(math.remainder(turn, 2 * math.pi)) <= 2 * ALIKE_TURN


def _rotated(xy: Floats, turns: Floats) -> Floats:
    cos, sin = np.cos(turns), np.sin(turns)
    return np.column_stack([cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]])

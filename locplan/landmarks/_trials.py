"""Placements that promise the same, driven, and the best of them kept.

Placements whose objectives differ by a hundredth may lose no drive or every tenth one: the
objective knows nothing of landmarks that are taken for one another.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback, parts
from locplan.landmarks._landmarks import Landmarks
from locplan.landmarks._objects import with_objects
from locplan.landmarks._search import Search
from locplan.landmarks._verification import drive_on
from locplan.simulation import Drives
from locplan.simulation._simulator import random_of

TRIALS = 4
"""Default number of placements that are driven."""
MAX_TRIALS = 100
SHARE = 0.5
"""Share of the places that a further placement is searched among."""
FIRST_DRIVES = 40
"""Number of drives along each route in the first round; it doubles while placements halve."""
MIN_ERROR = 1e-3
"""Least error of a drive [m], since its logarithm counts."""
VARIANTS, ROUNDS = 101, 102
"""Streams of random numbers, beside those of `Simulator` and of places at random."""


def best_of_trials(
    made: Landmarks,
    trials: int = TRIALS,
    *,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Drive a placement and others that promise the same, and return the best.

    Each of the others is searched among a random half of the places. In each round all are driven,
    and the better half of them stays: those with the fewest lost drives, of these those with the
    least error. `Landmarks.verify` has other drives.

    Parameters
    ----------
    made : Landmarks
        The placement.
    trials : int
        Number of placements, with `made`; 1 returns it without a drive.
    seed : int
        Seed of all random numbers.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """
    whole("trials", trials, 1, MAX_TRIALS)
    whole("seed", seed, 0)
    left = [made, *(variant(made, random_of(seed, VARIANTS, n)) for n in range(1, trials))]
    sizes, size, drives = [], trials, FIRST_DRIVES
    while size > 1:
        sizes += [drives * len(made.setting.routes)] * size
        size, drives = -(-size // 2), 2 * drives
    callbacks = iter(parts(progress, sizes))
    drives, round_ = FIRST_DRIVES, 0
    scores: dict[int, list[Drives]] = {id(each): [] for each in left}
    while len(left) > 1:
        own_seed = int(random_of(seed, ROUNDS, round_).integers(2**31))
        for each in left:
            scores[id(each)] += drive_on(
                each.setting, each.grid, drives, own_seed, threads, next(callbacks)
            )
        left.sort(key=lambda each: score(scores[id(each)]))
        left = left[: -(-len(left) // 2)]
        drives, round_ = 2 * drives, round_ + 1
    return left[0]


def score(driven: list[Drives]) -> tuple[int, float]:
    """Number of lost drives, and the mean logarithm of the error of all."""
    squares: NDArray[np.float64] = np.concatenate([each.mean_squares for each in driven])
    lost = sum(int(each.lost.sum()) for each in driven)
    return lost, float(np.log(np.maximum(squares, MIN_ERROR**2)).mean())


def variant(made: Landmarks, random: np.random.Generator) -> Landmarks:
    """Placement of as many objects that is searched among a random half of the places."""
    search, first = made.search, made.existing
    keep = random.random(len(search.places)) < SHARE
    keep[:first] = True
    keep |= not keep.any()
    own = Search(
        search.objective, search.places[keep], search.shape, search.passages, search.resolution
    )
    order = own.run(list(range(first)), max(len(made) - first, 0))
    indices = np.flatnonzero(keep)[order]
    grid = made.setting.grid
    poses = search.in_world(grid, indices)
    return dataclasses.replace(
        made,
        poses=poses,
        indices=indices,
        curve=own.curve(order),
        grid=with_objects(grid, made.setting.kind, poses),
    )

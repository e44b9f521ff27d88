"""Placements that promise the same, driven, and the best of them kept.

Placements whose objectives differ by a hundredth may lose no drive or every tenth one: no objective
knows of landmarks that are taken for one another, and neither of the two wins everywhere.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from locplan._kernels.arrays import Bools
from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts
from locplan.landmarks._landmarks import Landmarks, Trial
from locplan.landmarks._objectives import MeanDegeneracy, Objective
from locplan.landmarks._outcomes import Outcome, driven_in
from locplan.landmarks._search import Search
from locplan.simulation import Simulator

FIRST_DRIVES = 40
"""Number of drives along each route in the first round; it doubles while placements halve."""
MIN_ERROR = 1e-3
"""Minimum error of a drive [m], since its logarithm counts."""
VARIANTS, ROUNDS = 101, 102
"""Streams of random numbers, beside those of `Simulator` and of places at random."""


def best_of_trials(
    made: Landmarks,
    trials: int = 4,
    *,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Drive a placement and others that promise as much, and return the best.

    Along routes the second one has the least degeneracy at the poses there, which often drives
    better, and often worse. Further ones are searched among a random half of the places, by either
    objective in turn. In each round all are driven, and the better half of them stays: those with
    the fewest lost drives, of these those with the least error. `Landmarks.trials` says what was
    driven. `Landmarks.verify` has other drives.

    Parameters
    ----------
    made : Landmarks
        The placement, as `place_landmarks` returns it.
    trials : int, default 4
        Number of placements, `made` among them, 1 to 100; 1 returns it without a drive. More take
        longer, and may find a better one.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Landmarks
        The best placement, with the results of all in `trials`.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """
    whole("trials", trials, 1, 100)
    whole("seed", seed, 0)
    if trials == 1:
        return made
    left = [(each, Outcome(())) for each in _placements(made, trials, seed)]
    sizes = [len(left)]  # placements in each round
    while sizes[-1] > 1:
        sizes.append(-(-sizes[-1] // 2))
    setting, beaten = made.setting, left[:0]
    first = FIRST_DRIVES * len(setting.routes)
    drives = [[first * 2**n] * size for n, size in enumerate(sizes[:-1])]
    callbacks = parts(progress, [sum(each) for each in drives])
    for n, stay in enumerate(sizes[1:]):
        own_seed = int(random_of(seed, ROUNDS, n).integers(2**31))
        run = partial(Simulator, robot=setting.robot, seed=own_seed, threads=threads)
        worlds = ((run(each.grid), setting.on(each.grid)) for each, _ in left)
        driven = zip(left, driven_in(worlds, drives[n], callbacks[n]), strict=True)
        left = [(each, Outcome(before.drives + more.drives)) for (each, before), more in driven]
        left.sort(key=lambda each: _trial(*each)[-2:])
        left, beaten = left[:stay], left[stay:] + beaten
    trials_made = tuple(_trial(*each) for each in [*left, *beaten])
    return dataclasses.replace(left[0][0], trials=trials_made)


def _trial(made: Landmarks, driven: Outcome) -> Trial:
    """What the drives with a placement say; the last two numbers rank it."""
    squares = np.maximum(driven.mean_squares, MIN_ERROR**2)
    error = math.exp(float(np.log(squares).mean()) / 2)
    return Trial(made.chosen_by, driven.number, int(driven.lost.sum()), error)


def _placements(made: Landmarks, trials: int, seed: int) -> Iterator[Landmarks]:
    """A placement and others of as many: by the other objective, and among half of the places.

    Their curves are those of the objective of `made`, so that they compare.
    """
    yield made
    first, own = made.existing, made.search
    objectives: list[Objective] = [own.objective]
    if made.setting.region is None:
        sight = own.objective.sight
        objectives.append(MeanDegeneracy.of(sight, made.setting.robot.known_lidar))
    for n in range(1, trials):
        objective, half = objectives[n % len(objectives)], n >= len(objectives)
        keep: Bools = np.ones(len(own.places), bool)
        if half:
            # Share of the places that a further placement is searched among.
            keep = random_of(seed, VARIANTS, n).random(len(keep)) < 0.5
            keep |= not keep.any()
        search = Search(objective, own.passages, np.flatnonzero(keep))
        order = search.run(list(range(first)), max(len(made) - first, 0))
        order, shifts = search.without_rows(order)
        among = ", half of the places" if half else ""
        yield dataclasses.replace(
            made,
            indices=np.array(own.in_order(order), np.int64),
            shifts=shifts,
            chosen_by=objective.name + among,
        )

"""Placements that promise the same, driven, and the best of them kept.

Placements whose objectives differ by a hundredth may lose no drive or every tenth one: no objective
knows of landmarks that are taken for one another, and neither of the two wins everywhere.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts
from locplan.landmarks._landmarks import Landmarks, Trial
from locplan.landmarks._objectives import MeanDegeneracy, Objective
from locplan.landmarks._routes import drive_on
from locplan.landmarks._search import Search
from locplan.simulation import Drives

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
    left = [Contender(each) for each in _placements(made, trials, seed)]
    sizes, size, drives = [], len(left), FIRST_DRIVES
    while size > 1:
        sizes += [drives * len(made.setting.routes)] * size
        size, drives = -(-size // 2), 2 * drives
    callbacks = iter(parts(progress, sizes))
    drives, round_ = FIRST_DRIVES, 0
    beaten: list[Contender] = []
    while len(left) > 1:
        own_seed = int(random_of(seed, ROUNDS, round_).integers(2**31))
        for each in left:
            setting, grid = each.made.setting, each.made.grid
            each.driven += drive_on(setting, grid, drives, own_seed, threads, next(callbacks))
        left.sort(key=lambda each: each.score)
        stay = -(-len(left) // 2)
        left, beaten = left[:stay], left[stay:] + beaten
        drives, round_ = 2 * drives, round_ + 1
    trials_made = tuple(each.trial for each in [*left, *beaten])
    return dataclasses.replace(left[0].made, trials=trials_made)


@dataclass
class Contender:
    """A placement, and its drives so far."""

    made: Landmarks
    driven: list[Drives] = field(default_factory=list)

    @property
    def score(self) -> tuple[int, float]:
        """Number of lost drives, and the mean logarithm of the squared error of all."""
        squares: NDArray[np.float64] = np.concatenate([each.mean_squares for each in self.driven])
        lost = sum(int(each.lost.sum()) for each in self.driven)
        return lost, float(np.log(np.maximum(squares, MIN_ERROR**2)).mean())

    @property
    def trial(self) -> Trial:
        """What its drives say."""
        lost, error = self.score
        number = sum(len(each.errors) for each in self.driven)
        return Trial(self.made.chosen_by, number, lost, math.exp(error / 2))


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
        keep: NDArray[np.bool_] = np.ones(len(own.places), bool)
        if half:
            # Share of the places that a further placement is searched among.
            keep = random_of(seed, VARIANTS, n).random(len(keep)) < 0.5
            keep |= not keep.any()
        search = Search(objective, own.passages, np.flatnonzero(keep))
        order = search.run(list(range(first)), max(len(made) - first, 0))
        order, shifts = search.without_rows(order)
        found = Landmarks.of(
            made.setting, own, own.in_order(order), made.rejected, made.before, first, shifts
        )
        among = ", half of the places" if half else ""
        yield dataclasses.replace(found, chosen_by=objective.name + among)

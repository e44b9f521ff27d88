"""Compute how often the rule of `recommend_path` finds a better path, and how often it errs.

Errors are random numbers, without drives: the logarithms of the paired ratios deviate by 0.35 on
average, by more on some queries than on others, and paths have 0.36 of their variance in common.
The program also computes the critical values of the rule's looks.

Run: python tests/benchmarks/power_of_choices.py [CHOICES]
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
from scipy.optimize import brentq
from scipy.signal import fftconvolve
from scipy.stats import norm

from locplan.simulation.driver import FIRST_CHOOSING_DRIVE
from locplan.simulation.race import DriveScores, RaceResult, run_race
from locplan.simulation.verdict import BOUNDARY_EXPONENT

Errors = Callable[[np.random.Generator], np.ndarray]
"""Draws the true ratios of ten paths, the shortest first."""


def one_better(ratio: float, random: np.random.Generator) -> np.ndarray:
    """One path has this ratio, the others are as bad as the shortest or worse."""
    return np.array([1.0, ratio, *random.permutation(np.linspace(1.0, 1.3, 8))])


def one_among_equals(ratio: float, random: np.random.Generator) -> np.ndarray:
    """One path has this ratio, the others are as good as the shortest."""
    return np.array([1.0, ratio, *[1.0] * 8])


def as_on_maps(random: np.random.Generator) -> np.ndarray:
    """Ratios about as on real maps: some queries have better paths, and many have none."""
    logs = random.normal(0.08, 0.12) + random.normal(0, 0.12, 9)
    return np.exp([0.0, *logs])


CASES: dict[str, Errors] = {
    **{f"one of {r:g}, others worse": partial(one_better, r) for r in (1.0, 0.95, 0.9, 0.8, 0.7)},
    **{f"one of {r:g}, others equal": partial(one_among_equals, r) for r in (1.0, 0.8)},
    "as on maps": as_on_maps,
}


def choice_of(case: str, seed: int) -> tuple[RaceResult, float, int]:
    """One choice, the true ratio of its leader, and how many drives it took."""
    random = np.random.default_rng([seed, 7])
    ratios = CASES[case](random)
    deviation = 0.35 * math.exp(random.normal(0, 0.25)) / math.sqrt(2 * 0.64)
    common, own = random.normal(size=72), random.normal(size=(len(ratios), 72))
    errors = np.log(ratios)[:, None] + deviation * (0.6 * common + 0.8 * own)
    drives = 0

    def drive(paths: list[int], numbers: range) -> DriveScores:
        nonlocal drives
        drives += len(paths) * len(numbers)
        # The race has other drives than the confirmation, whose numbers begin at 0.
        columns = [
            n + 64 - FIRST_CHOOSING_DRIVE if n >= FIRST_CHOOSING_DRIVE else n for n in numbers
        ]
        some = errors[paths][:, columns]
        return DriveScores(some, np.zeros(some.shape, bool))

    found = run_race(drive, np.zeros(len(ratios)), 1.0, 64)
    return found, float(ratios[found.leader]), drives


def critical_value(exponent: float, looks: int, error: float = 0.0125) -> float:
    """Critical value at the last of some doubling looks, of which each before it has more.

    It grows by 2 ** exponent a look backwards (Wang and Tsiatis, Biometrics 43, 1987). The density
    of the sum of all drives that has passed no boundary yet is carried from look to look.
    """
    shares = 0.5 ** np.arange(looks)[::-1]
    sums = np.linspace(-8, 8, 3201)
    step = sums[1] - sums[0]

    def passed(critical: float) -> float:
        ends = critical * 2 ** (exponent * np.arange(looks)[::-1]) * np.sqrt(shares)
        density = norm.pdf(sums, scale=shares[0] ** 0.5)
        probability = norm.sf(ends[0], scale=shares[0] ** 0.5)
        for end, following, more in zip(ends, ends[1:], np.diff(shares), strict=False):
            density *= np.clip((end - sums) / step + 0.5, 0, 1)
            probability += step * density @ norm.sf(following - sums, scale=more**0.5)
            density = step * fftconvolve(density, norm.pdf(sums, scale=more**0.5), "same")
        return probability - error

    return brentq(passed, 1.9, 3.0)


def main(choices: int = 1000) -> None:
    found = ", ".join(f"{critical_value(BOUNDARY_EXPONENT, looks):.3f}" for looks in (1, 2, 4, 8))
    print(f"critical value: {found} at the last of 1, 2, 4, 8 looks")
    print("share of the choices; of the last three columns: of the recommended, of the confirmed")
    print(f"{'ten paths':26} recommended undecided median mean  above .95  covered")
    for case in CASES:
        with ProcessPoolExecutor() as pool:
            made = list(pool.map(partial(choice_of, case), range(choices), chunksize=50))
        said = Counter(found.verdict for found, *_ in made)
        taken = [truth for found, truth, _ in made if found.recommends_leader(bold=False)]
        held = [found.ratio.low <= t <= found.ratio.high for found, t, _ in made if found.leader]
        undecided = said["undecided"]
        drives = [drives for *_, drives in made]
        wrong = np.mean([truth > 0.95 for truth in taken]) if taken else math.nan
        print(
            f"{case:26} {len(taken) / choices:10.1%} {undecided / choices:9.1%}"
            f" {np.median(drives):6.0f} {np.mean(drives):4.0f}"
            f" {wrong:9.1%} {np.mean(held):9.1%} of {len(held)}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""Race, confirmation and guard: how often paths are recommended, whatever drives them."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from locplan.simulation.driver import FIRST_CHOOSING_DRIVE
from locplan.simulation.race import DriveScores, run_race
from locplan.simulation.verdict import BETTER, UNDECIDED, VERDICT_WORDS


class Paths:
    """Paths with known errors: ln RMSE is normal about the logarithm of the ratio.

    Drives of one number have a part in common, and a drive is lost where its error is large.
    """

    def __init__(self, ratios, seed, deviation=0.35, losing=()):
        self.means = np.log(ratios)
        random = np.random.default_rng(seed)
        common, own = random.normal(size=72), random.normal(size=(len(ratios), 72))
        self.errors = self.means[:, None] + 0.4 * common + deviation / math.sqrt(2) * own
        self.losing = losing
        self.driven = Counter()

    def __call__(self, paths, numbers):
        for path in paths:
            self.driven[path] += len(numbers)
        rows = [[self.drive(path, number) for number in numbers] for path in paths]
        return DriveScores(
            *(np.array(rows)[..., n].astype(kind) for n, kind in enumerate((float, bool)))
        )

    def drive(self, path, number):
        if number >= FIRST_CHOOSING_DRIVE:  # no drive of the confirmation
            number += 64 - FIRST_CHOOSING_DRIVE
        error = self.errors[path, number]
        return error, error > 0.8 or (path in self.losing and number % 3 == 0)

    def judged(self, **more):
        asked = {"loss_penalty": 1.0, "n_drives": 64, **more}
        return run_race(self, np.zeros(len(self.means)), **asked)


def verdicts(ratios, count=300, **more):
    made = [Paths(ratios, seed, **more).judged() for seed in range(count)]
    return made, Counter(each.verdict for each in made)


def test_race_rarely_recommends_equal_path():
    made, said = verdicts([1.0] * 10, count=500)
    assert said[BETTER] <= 0.025 * len(made)


def test_race_finds_ratio_of_four_fifths():
    made, said = verdicts([1.0, 1.1, 1.2, 0.8, 1.1, 1.3], count=200, deviation=0.25)
    assert said[BETTER] >= 0.9 * len(made)
    assert {each.leader for each in made if each.verdict == BETTER} == {3}


def test_race_rarely_recommends_slight_gain():
    made, _ = verdicts([1.0, 0.96, 1.1, 1.2], count=200)
    assert np.mean([each.recommends_leader(bold=False) for each in made]) <= 0.06


@pytest.mark.parametrize("ratio", [1.0, 0.85, 0.6])
def test_ratio_intervals_cover_true_ratio(ratio):
    """The drives end early if they decide."""
    made, _ = verdicts([1.0, ratio, 1.05, 1.1])
    held = [
        low <= math.exp(math.log([1.0, ratio, 1.05, 1.1][each.leader])) <= high
        for each in made
        if each.leader
        for _, low, high in [each.ratio]
    ]
    assert np.mean(held) >= 0.95


def test_confirming_drives_are_fresh_and_paired():
    paths = Paths([1.0, 0.4, 2.0], 1)
    found = paths.judged()
    assert (found.leader, found.verdict, found.drives) == (1, BETTER, range(8))
    assert paths.driven == {0: 16, 1: 16, 2: 4}
    assert found.ratio.low < found.ratio.value < found.ratio.high < 1


def test_first_rounds_keep_five_paths():
    """The shortest path is always among them."""
    paths = Paths([1.0, *[0.99] * 6, 9.0], 3)
    paths.judged(n_drives=2)
    assert sorted(paths.driven.values())[:3] == [4, 4, 4]
    assert paths.driven[7] == 4
    assert sum(count >= 8 for count in paths.driven.values()) == 5


def test_race_confirms_three_paths_at_most():
    paths = Paths([1.0, *[0.6] * 8, 1.5], 3, deviation=0.05)
    found = paths.judged()
    assert found.verdict == BETTER
    assert sorted(paths.driven.values())[-4:] == [16, 16, 16, 16]
    assert sum(count > 8 for count in paths.driven.values()) == 4


def test_worse_finalist_is_dropped_early():
    made = [Paths([1.0, 0.91, 0.98], seed, deviation=0.1) for seed in range(20)]
    for paths in made:
        paths.judged()
    assert any(paths.driven[1] > paths.driven[2] > 8 for paths in made)


def test_interval_covers_ratio_of_best_finalist():
    made, _ = verdicts([1.0, *[0.9] * 5], deviation=0.5)
    held = [each.ratio.low <= 0.9 <= each.ratio.high for each in made if each.leader]
    assert np.mean(held) >= 0.95


def test_race_prefers_path_with_fewer_losses():
    paths = Paths([1.0, 0.5, 0.51], 1, deviation=0.2, losing=(1,))
    found = paths.judged(loss_penalty=0.0)
    assert (found.leader, found.verdict, found.more_lost) == (2, BETTER, False)


def test_race_doubles_drives_until_decision():
    for seed in range(20):
        paths = Paths([1.0, 0.9], seed)
        found = paths.judged()
        if found.leader:
            assert len(found.drives) in (8, 16, 32, 64)
            assert found.verdict in VERDICT_WORDS
    for seed in range(20):
        found = Paths([1.0, 0.93], seed, deviation=0.5).judged(is_time_up=lambda: True)
        assert len(found.drives) == 8


def test_race_never_recommends_more_losses():
    paths = Paths([1.0, 0.5], 1, losing=(1,))
    found = paths.judged(loss_penalty=0.0)
    assert (found.leader, found.more_lost) == (1, True)
    assert not found.recommends_leader(bold=True)
    assert found.ratio.high < 0.8


def test_race_counts_losses_and_handicap():
    assert Paths([1.0, 0.5], 1, losing=(1,)).judged(loss_penalty=9.0).leader == 0
    paths = Paths([1.0, 0.8, 0.7], 1, deviation=0.1)
    assert run_race(paths, np.array([0.0, 0.0, 0.5]), 1.0, 8).leader == 1


def test_price_of_length_decides_between_finalists():
    handicaps = np.array([0.0, 0.0, 0.5])
    leaders = [
        run_race(Paths([1.0, 0.2, 0.16], seed, deviation=0.6), handicaps, 1.0, 8).leader
        for seed in range(20)
    ]
    assert leaders.count(1) >= 16


def test_race_without_leader_confirms_nothing():
    paths = Paths([1.0, 2.0], 1)
    found = paths.judged()
    assert (found.leader, found.verdict, found.drives) == (0, UNDECIDED, range(8))
    assert math.isnan(found.ratio.value)
    assert paths.driven == {0: 16, 1: 4}
    alone = Paths([1.0], 1)
    assert (alone.judged().leader, alone.driven) == (0, {0: 16})

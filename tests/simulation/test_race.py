"""Race, confirmation and guard of paths with known errors; test_verdict has equal paths."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from locplan.simulation.driver import FIRST_CHOOSING_DRIVE
from locplan.simulation.race import DriveScores, run_race
from locplan.simulation.verdict import BETTER, UNDECIDED


class Paths:
    """Paths with known errors: ln RMSE is normal about the logarithm of the ratio.

    Drives of one number share a part of their error. A drive with a large error is lost.
    """

    def __init__(self, ratios, seed, deviation=0.35, losing=()):
        self.means = np.log(ratios)
        random = np.random.default_rng(seed)
        common, own = random.normal(size=72), random.normal(size=(len(ratios), 72))
        self.errors = self.means[:, None] + 0.4 * common + deviation / math.sqrt(2) * own
        self.losing = losing
        self.driven, self.numbers = Counter(), {n: [] for n in range(len(ratios))}

    def __call__(self, paths, numbers):
        for path in paths:
            self.driven[path] += len(numbers)
            self.numbers[path] += numbers
        rows = [[self.drive(path, number) for number in numbers] for path in paths]
        return DriveScores(
            *(np.array(rows)[..., n].astype(kind) for n, kind in enumerate((float, bool)))
        )

    def drive(self, path, number):
        if number >= FIRST_CHOOSING_DRIVE:  # no drive of the confirmation
            number += 64 - FIRST_CHOOSING_DRIVE
        error = self.errors[path, number]
        return error, error > 0.8 or (path in self.losing and number % 3 == 0)

    def race(self, **options):
        options = {"loss_penalty": 1.0, "n_drives": 64, **options}
        return run_race(self, np.zeros(len(self.means)), **options)


def run_races(ratios, count=300, **options):
    """Return the results of races of equal ratios, and the count of each verdict."""
    races = [Paths(ratios, seed, **options).race() for seed in range(count)]
    return races, Counter(race.verdict for race in races)


def test_race_finds_ratio_of_four_fifths():
    races, verdicts = run_races([1.0, 1.1, 1.2, 0.8, 1.1, 1.3], count=200, deviation=0.25)
    assert verdicts[BETTER] >= 0.9 * len(races)
    assert {race.leader for race in races if race.verdict == BETTER} == {3}


def test_race_rarely_recommends_slight_gain():
    races, _ = run_races([1.0, 0.96, 1.1, 1.2], count=200)
    assert np.mean([race.recommends_leader(bold=False) for race in races]) <= 0.06


@pytest.mark.parametrize("ratio", [1.0, 0.85, 0.6])
def test_ratio_intervals_cover_true_ratio(ratio):
    """Races end early if their drives decide."""
    ratios = [1.0, ratio, 1.05, 1.1]
    races, _ = run_races(ratios)
    is_covered = [
        race.ratio.low <= ratios[race.leader] <= race.ratio.high for race in races if race.leader
    ]
    assert np.mean(is_covered) >= 0.95


def test_confirming_drives_are_fresh_and_paired():
    paths = Paths([1.0, 0.4, 2.0], 1)
    race = paths.race()
    assert (race.leader, race.verdict, race.drives) == (1, BETTER, range(8))
    assert paths.driven == {0: 16, 1: 16, 2: 4}
    assert paths.numbers[0] == paths.numbers[1]
    assert len(set(paths.numbers[1])) == 16
    assert race.ratio.low < race.ratio.value < race.ratio.high < 1


def test_first_rounds_keep_five_paths():
    """The shortest path is always among them."""
    paths = Paths([1.0, *[0.99] * 6, 9.0], 3)
    paths.race(n_drives=2)
    assert sorted(paths.driven.values())[:3] == [4, 4, 4]
    assert paths.driven[7] == 4
    assert sum(count >= 8 for count in paths.driven.values()) == 5


def test_race_confirms_three_paths_at_most():
    paths = Paths([1.0, *[0.6] * 8, 1.5], 3, deviation=0.05)
    assert paths.race().verdict == BETTER
    assert sorted(paths.driven.values())[-4:] == [16, 16, 16, 16]
    assert sum(count > 8 for count in paths.driven.values()) == 4


def test_worse_finalist_is_dropped_early():
    path_sets = [Paths([1.0, 0.91, 0.98], seed, deviation=0.1) for seed in range(20)]
    for paths in path_sets:
        paths.race()
    assert any(paths.driven[1] > paths.driven[2] > 8 for paths in path_sets)


def test_interval_covers_ratio_of_best_finalist():
    races, _ = run_races([1.0, *[0.9] * 5], deviation=0.5)
    is_covered = [race.ratio.low <= 0.9 <= race.ratio.high for race in races if race.leader]
    assert np.mean(is_covered) >= 0.95


def test_race_prefers_path_with_fewer_losses():
    race = Paths([1.0, 0.5, 0.51], 1, deviation=0.2, losing=(1,)).race(loss_penalty=0.0)
    assert (race.leader, race.verdict, race.more_lost) == (2, BETTER, False)


def test_race_doubles_drives_until_decision():
    races = [race for race in run_races([1.0, 0.75], 40)[0] if race.leader]
    assert {len(race.drives) for race in races} == {8, 16, 32, 64}
    for race in races:
        assert len(race.drives) == 64 or race.verdict == BETTER or race.ratio.low > 0.9


def test_race_ends_at_time_limit():
    """Without the limit, most of these paths have 64 drives."""
    races = [
        Paths([1.0, 0.93], seed, deviation=0.5).race(is_time_up=lambda: True) for seed in range(20)
    ]
    assert {len(race.drives) for race in races if race.leader} == {8}


def test_race_never_recommends_more_losses():
    race = Paths([1.0, 0.5], 1, losing=(1,)).race(loss_penalty=0.0)
    assert (race.leader, race.more_lost) == (1, True)
    assert not race.recommends_leader(bold=True)
    assert race.ratio.high < 0.8


def test_race_counts_losses_and_handicap():
    assert Paths([1.0, 0.5], 1, losing=(1,)).race(loss_penalty=9.0).leader == 0
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
    race = paths.race()
    assert (race.leader, race.verdict, race.drives) == (0, UNDECIDED, range(8))
    assert math.isnan(race.ratio.value)
    assert paths.driven == {0: 16, 1: 4}
    alone = Paths([1.0], 1)
    assert (alone.race().leader, alone.driven) == (0, {0: 16})

"""The verdict on paired drives: how often each caller errs, and how often it finds a gain.

Errors are drawn, not simulated. The logarithms of their ratios have a known mean and a standard
deviation of 0.45. A tenth of the drives is lost, in half of the pairs together as in one world.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from support.maps import blocks

from locplan import Lidar, OccupancyGrid, Robot, place_landmarks, repair
from locplan.advice import Pole, verify_landmarks
from locplan.advice.landmarks import Verification, VerificationDrives as LandmarkDrives
from locplan.advice.preset_choice import USER_SETTINGS, LevelCase, choose_preset
from locplan.advice.trials import DrivesOnRoutes, compare_fix, confirm_fixes, select_fixes, try_fix
from locplan.maps import FREE, OCCUPIED
from locplan.robots import Amcl
from locplan.robots.presets import list_applicable_presets
from locplan.simulation import Drives
from locplan.simulation.driver import FIRST_CHOOSING_DRIVE
from locplan.simulation.drives import LOST_DISTANCE
from locplan.simulation.race import DriveScores, run_race
from locplan.simulation.verdict import (
    BETTER,
    NO_DIFFERENCE,
    UNDECIDED,
    WORSE,
    DriveSet,
    compare_drives,
    confirm_alternative,
    evaluate_look,
    plan_looks,
)

DEVIATION, LOST_SHARE = 0.45, 0.1
LINE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


def draw_pairs(ratios, n_drives, seed, lost=(LOST_SHARE, LOST_SHARE)):
    """Draw (baseline, alternative) log errors and lost flags of some ratios, (ratios, n_drives)."""
    random = np.random.default_rng(seed)
    shape = len(ratios), n_drives
    common, *own = random.normal(size=(3, *shape))
    errors = [0.4 * common + DEVIATION / math.sqrt(2) * each for each in own]
    errors[1] += np.log(ratios)[:, None]
    ranks = random.uniform(size=shape)
    again = random.uniform(size=shape)
    # Half of the pairs share their rank, and are lost together.
    others = np.where(random.uniform(size=shape) < 0.5, ranks, again)
    return errors, [ranks < lost[0], others < lost[1]]


def evaluate_pairs(ratio, n_drives=64, count=4000, seed=1, lost=(LOST_SHARE, LOST_SHARE), **more):
    (before, after), flags = draw_pairs([ratio] * count, n_drives, seed, lost)
    return evaluate_look(after - before, *flags, **more)


def count_words_at_looks(ratio, count=4000, limit=64, **more):
    """Count the words of drives that double until they are decided."""
    (before, after), (lost, others) = draw_pairs([ratio] * count, limit, 7, **more)
    words = np.full(count, UNDECIDED, object)
    counts = plan_looks(limit)
    for left, n in zip(reversed(range(len(counts))), counts, strict=True):
        look = evaluate_look(
            after[:, :n] - before[:, :n], lost[:, :n], others[:, :n], looks_left=left
        )
        words = np.where(words == UNDECIDED, look.words, words)
    return Counter(words.tolist())


def drive_set(errors, lost):
    return DriveSet(np.asarray(errors, float), np.asarray(lost, bool))


# The rule


@pytest.mark.parametrize("lost", [(0.0, 0.0), (0.1, 0.1), (0.4, 0.4)])
def test_verdict_rarely_prefers_equal_drives(lost):
    count = 4000
    words = count_words_at_looks(1.0, count, lost=lost)
    for word in (BETTER, WORSE):
        assert words[word] <= (0.025 + 2 * math.sqrt(0.025 / count)) * count
    assert 2 * words[WORSE] >= words[BETTER] - 20


def test_verdict_finds_ratio_of_four_fifths():
    assert np.mean(evaluate_pairs(0.8).is_better) >= 0.9
    words = count_words_at_looks(0.8)
    assert words[BETTER] >= 0.9 * sum(words.values())
    assert words[WORSE] <= 0.001 * sum(words.values())


def test_verdict_finds_fewer_lost_drives():
    look = evaluate_pairs(1.0, lost=(0.4, 0.1))
    assert np.mean(look.has_fewer_lost & look.is_better) >= 0.9


def test_single_look_has_full_error_probability():
    """A single look finds more gains than the last of several looks."""
    assert np.mean(evaluate_pairs(1.0, looks_left=None).is_better) <= 0.025
    alone, last = (np.mean(evaluate_pairs(0.8, looks_left=left).is_better) for left in (None, 0))
    assert alone > last + 0.01


def test_verdict_is_its_own_mirror_image():
    (before, after), (lost, others) = draw_pairs([0.85] * 500, 32, 3, (0.3, 0.1))
    one, other = (
        evaluate_look(after - before, lost, others),
        evaluate_look(before - after, others, lost),
    )
    mirror = {BETTER: WORSE, WORSE: BETTER}
    assert other.words == [mirror.get(word, word) for word in one.words]
    assert len({*one.words}) > 1


def test_contradicting_errors_and_losses_are_undecided():
    errors = np.linspace(-0.1, 0.1, 64)
    lost = np.arange(64) < 20
    verdict = compare_drives(drive_set(errors, ~lost & lost), drive_set(errors * 1.1 - 0.5, lost))
    assert (verdict.word, verdict.has_more_lost) == (UNDECIDED, True)
    assert verdict.ratio.high < 1


def test_narrow_interval_means_no_difference():
    errors = np.linspace(-0.3, 0.3, 64)
    drives = drive_set(errors, [False] * 64)
    similar_drives = drive_set(errors[::-1] * 0.1 + errors, [False] * 64)
    assert compare_drives(drives, similar_drives).word == NO_DIFFERENCE
    assert compare_drives(drives, drives).ratio.value == 1


def test_wide_interval_is_undecided():
    drives = drive_set([0.0] * 4, [False] * 4)
    scattered_drives = drive_set([0.3, -0.3, 0.3, -0.3], [False] * 4)
    assert compare_drives(drives, scattered_drives).word == UNDECIDED


def test_verdict_intervals_cover_true_ratio():
    look = evaluate_pairs(0.8, looks_left=0)
    assert np.mean((look.low <= math.log(0.8)) & (math.log(0.8) <= look.high)) >= 0.975
    verdict = compare_drives(
        drive_set([0.0] * 8, [True] * 4 + [False] * 4), drive_set([1.0] * 8, [0] * 8)
    )
    assert verdict.lost.baseline.value == 0.5
    assert verdict.lost.baseline.low < 0.5 < verdict.lost.baseline.high
    assert verdict.lost.alternative.value == 0.0
    assert (verdict.off_at_end, verdict.reached, verdict.n_drives) == (None, None, 8)


def test_drive_set_joins_several_paths():
    errors = np.zeros((3, 5, 3))
    errors[0, 2, 0], errors[1, -1, 1], errors[2, -1, 0] = (
        LOST_DISTANCE + 0.5,
        LOST_DISTANCE + 0.1,
        LOST_DISTANCE - 0.1,
    )
    drives = Drives(np.zeros((5, 3)), errors)
    joined = DriveSet.from_drives([drives, drives])
    assert joined.lost.tolist() == [True, True, False] * 2
    assert joined.off_at_end.tolist() == [False, True, False] * 2
    assert joined.log_error[0] == pytest.approx(
        0.5 * math.log((LOST_DISTANCE + 0.5) ** 2 / 5), abs=1e-5
    )
    verdict = compare_drives(joined, joined)
    assert verdict.off_at_end.alternative.value == pytest.approx(1 / 3)


# The confirmation


def make_drive(ratio, seed, limit=64):
    """Return a function that drives pairs of a known ratio, and the counts of its drives."""
    (before, after), (lost, others) = draw_pairs([ratio], limit, seed)
    counts = []

    def drive(numbers):
        counts.append(len(numbers))
        at = [*numbers]
        return drive_set(before[0, at], lost[0, at]), drive_set(after[0, at], others[0, at])

    return drive, counts


def test_confirmation_ends_at_first_decision():
    drive, counts = make_drive(0.2, 1)
    assert confirm_alternative(drive, range(64)).word == BETTER
    assert counts == [8]
    drive, counts = make_drive(0.9, 1)
    verdict = confirm_alternative(drive, range(64))
    assert sum(counts) == verdict.n_drives in (16, 32, 64)
    drive, counts = make_drive(0.9, 1)
    assert confirm_alternative(drive, range(64), is_time_up=lambda: True).n_drives == counts[0] == 8
    drive, counts = make_drive(0.2, 1)
    assert confirm_alternative(drive, range(64), looks=[64]).n_drives == counts[0] == 64


def test_confirmation_rarely_prefers_equal_drives():
    words = Counter(confirm_alternative(make_drive(1.0, n)[0], range(64)).word for n in range(1000))
    assert words[BETTER] <= 30


# The callers


def index_drives(numbers, n_confirming):
    """Return the columns of drives: first those that confirm, then those that choose."""
    return [
        number if number < FIRST_CHOOSING_DRIVE else number - FIRST_CHOOSING_DRIVE + n_confirming
        for number in numbers
    ]


def race_paths(ratios, seed, n_confirming=64):
    """Return the race of paths with known ratios of errors, the shortest first."""
    random = np.random.default_rng(seed)
    shape = len(ratios), n_confirming + 8
    errors = 0.4 * random.normal(size=shape[1]) + random.normal(0, DEVIATION / math.sqrt(2), shape)
    errors += np.log(ratios)[:, None]
    lost = random.uniform(size=shape) < LOST_SHARE

    def drive(paths, numbers):
        at = np.ix_([*paths], index_drives(numbers, n_confirming))
        return DriveScores(errors[at], lost[at])

    return run_race(drive, np.zeros(len(ratios)), 1.0, n_confirming)


def test_recommend_path_rarely_prefers_equal_paths():
    verdicts = [race_paths([1.0] * 10, seed).verdict for seed in range(400)]
    assert np.mean([verdict == BETTER for verdict in verdicts]) <= 0.025


def test_recommend_path_agrees_with_verdict():
    words = []
    for seed in range(30):
        (before, after), (lost, others) = draw_pairs([0.7], 16, seed, (0.1, 0.1))

        def drive(paths, numbers, pairs=((before, lost), (after, others))):
            at = index_drives(numbers, 8)
            rows = [(errors[0, at], flags[0, at]) for errors, flags in (pairs[n] for n in paths)]
            return DriveScores(*(np.array(part) for part in zip(*rows, strict=True)))

        race = run_race(drive, np.zeros(2), 1.0, 8)
        if race.leader:
            both = drive_set(before[0, :8], lost[0, :8]), drive_set(after[0, :8], others[0, :8])
            verdict = compare_drives(*both)
            assert (verdict.word, verdict.ratio) == (race.verdict, race.ratio)
            words.append(verdict.word)
    assert {BETTER, UNDECIDED} <= set(words)


class DrawnSite:
    """A check's site of three routes, on which each fix has a known ratio of errors."""

    few, many, fresh = range(8), range(8, 40), range(40, 72)

    def __init__(self, ratios, seed, lost=None):
        random = np.random.default_rng(seed)
        shape = len(ratios) + 1, 3, 72
        spread = DEVIATION / math.sqrt(2)
        self.errors = 0.4 * random.normal(size=shape[1:]) + spread * random.normal(size=shape)
        self.errors[1:] += np.log(ratios)[:, None, None]
        rates = np.array(lost or [LOST_SHARE] * shape[0])[:, None, None]
        self.lost = random.uniform(size=shape) < rates

    def drive(self, kinds, numbers):
        """Drive with the best of some fixes, since they do not add up."""
        row = min((int(kind) for kind in kinds), key=lambda n: self.errors[n].mean(), default=0)
        errors, lost = (each[row][:, numbers] for each in (self.errors, self.lost))
        return DrivesOnRoutes(errors, lost, np.where(lost, 0.0, np.nan), lost)

    def recommend(self):
        """Return the fixes that a check recommends."""
        known = [(numbers, self.drive((), numbers)) for numbers in (self.few, self.many)]
        trials = {
            f"{n}": try_fix(lambda numbers, kind=f"{n}": self.drive((kind,), numbers), *known)
            for n in range(1, len(self.errors))
        }
        better = [kind for kind, trial in trials.items() if trial.contrast.verdict.word == BETTER]
        order = sorted(better, key=lambda kind: trials[kind].contrast.score)
        selected = select_fixes((), order, self.drive, self.many)
        return confirm_fixes((), selected, self.drive, self.many, self.fresh).kinds


def test_check_rarely_recommends_equal_fixes():
    recommended = [DrawnSite([1.0] * 8, seed).recommend() for seed in range(300)]
    assert np.mean([bool(kinds) for kinds in recommended]) <= 0.025


def test_check_finds_fix_of_four_fifths():
    recommended = [DrawnSite([1.0, 0.8, 1.0, 1.1], seed).recommend() for seed in range(150)]
    assert np.mean([kinds == ("2",) for kinds in recommended]) >= 0.9


def test_check_finds_fix_with_fewer_losses():
    lost = [0.4, 0.4, 0.05]
    recommended = [DrawnSite([1.0, 1.0], seed, lost).recommend() for seed in range(60)]
    assert np.mean([kinds == ("2",) for kinds in recommended]) >= 0.9


class AdditiveSite(DrawnSite):
    """A check's site on which the fixes add up, each with its known ratio of errors."""

    def drive(self, kinds, numbers):
        rows = [int(kind) for kind in kinds]
        effect = (self.errors[rows] - self.errors[0]).mean(axis=(1, 2)).sum()
        row = max(rows, default=0)
        lost = self.lost[row][:, numbers]
        errors = self.errors[row] - self.errors[row].mean() + self.errors[0].mean() + effect
        return DrivesOnRoutes(errors[:, numbers], lost, np.where(lost, 0.0, np.nan), lost)


def test_check_combines_fixes_that_add_up():
    recommended = [{*AdditiveSite([0.5, 0.6, 1.0, 1.1], seed).recommend()} for seed in range(100)]
    assert np.mean([kinds >= {"1", "2"} for kinds in recommended]) >= 0.9
    assert np.mean([bool(kinds - {"1", "2"}) for kinds in recommended]) <= 0.05


def test_check_drops_fix_without_extra_gain():
    """On a `DrawnSite` fixes do not add up: the better one alone is as good as both."""
    sites = [DrawnSite([0.5, 0.3], seed) for seed in range(60)]
    selected = [select_fixes((), ["1", "2"], site.drive, site.many) for site in sites]
    assert np.mean([kinds == ("2",) for kinds in selected]) >= 0.95


def test_check_lets_fresh_drives_alone_decide():
    """A fix that only seemed better in the drives that chose it is not recommended."""
    site = DrawnSite([0.5], 1)
    assert site.recommend() == ("1",)
    site.errors[1][:, 40:] = site.errors[0][:, 40:]
    site.lost[1][:, 40:] = site.lost[0][:, 40:]
    assert site.recommend() == ()


def make_drives(log_errors, lost, n_poses=400):
    """Return Drives of known errors; the lost drives exceed LOST_DISTANCE at one pose."""
    errors = np.zeros((len(lost), n_poses, 3))
    errors[..., 0] = np.minimum(np.exp(log_errors), LOST_DISTANCE - 0.1)[:, None]
    errors[lost, n_poses // 2, 0] = LOST_DISTANCE + 0.1
    return Drives(np.zeros((n_poses, 3)), errors)


class DrawnDriver:
    """A driver whose calls in turn return drives of a baseline and of an alternative."""

    def __init__(self, ratio, seed):
        self.ratio, self.seed, self.calls = ratio, seed, 0

    def __call__(self, simulator, paths, numbers, **options):
        pair, side = divmod(self.calls, 2)
        self.calls += 1
        draws = draw_pairs([self.ratio] * len(paths), len(numbers), self.seed + 1000 * pair)
        errors, lost = (both[side] for both in draws)
        return {
            name: make_drives(errors[n] - 2.0, lost[n], n_poses=200) for n, name in enumerate(paths)
        }


def count_landmark_verdicts(monkeypatch, ratio, count, drives):
    """Count the verdicts on landmarks from drives of a known ratio."""
    cells = np.full((40, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    line = {"a": [[1.0, 2.0], [5.0, 2.0]], "b": [[1.0, 1.0], [5.0, 1.0]]}
    paths = {name: np.array(xy) for name, xy in line.items()}
    robot = Robot(Lidar(range=2.0))
    landmarks = place_landmarks(OccupancyGrid(cells, 0.1), Pole(0.2), 1, paths=paths, robot=robot)
    words = []
    for seed in range(count):
        monkeypatch.setattr(LANDMARK_DRIVER, DrawnDriver(ratio, seed))
        words.append(verify_landmarks(landmarks, drives, random_sets=1).word)
    return Counter(words)


def count_repair_verdicts(monkeypatch, ratio, count, drives):
    """Count the verdicts on a repaired map from drives of a known ratio."""
    words = []
    for seed in range(count):
        monkeypatch.setattr(REPAIR_DRIVER, DrawnDriver(ratio, seed))
        words += [each.verdict for each in repair(blocks(), paths=2, drives=drives).verdicts]
    return Counter(words)


LANDMARK_DRIVER = "locplan.advice.landmarks.drive_open"
REPAIR_DRIVER = "locplan.advice.map_repair.drive_open"


@pytest.mark.parametrize(
    ("count_verdicts", "count"),
    [
        (count_landmark_verdicts, 400),
        (count_repair_verdicts, 80),  # a call plans its routes, which takes 30 ms
        pytest.param(count_repair_verdicts, 800, marks=pytest.mark.long),
    ],
)
def test_landmarks_and_repair_err_rarely(monkeypatch, count_verdicts, count):
    words = count_verdicts(monkeypatch, 1.0, count, 32)
    assert words[BETTER] <= 0.025 * count
    assert words[BETTER] + words[WORSE] <= 0.05 * count
    count //= 4
    words = count_verdicts(monkeypatch, 0.8, count, 32)  # 64 pairs of drives
    assert words[BETTER] >= 0.9 * count


def test_check_and_landmarks_agree_with_verdict():
    """`check` and `landmarks` read the same pairs, and return the words of the verdict."""
    seen = set()
    for seed, ratio in enumerate([1.0, 0.9, 0.8, 0.7, 0.5, 1.5] * 3):
        (before, after), flags = draw_pairs([ratio], 48, seed, (0.2, 0.1))
        both = [
            make_drives(errors[0] - 2.5, lost[0])
            for errors, lost in zip((before, after), flags, strict=True)
        ]
        sets = [DriveSet.from_drives([drives]) for drives in both]
        word = compare_drives(*sets).word
        landmarks = Verification(*(LandmarkDrives((drives,)) for drives in both), None, {}, 1)
        outcomes = [
            DrivesOnRoutes(
                each.log_error.reshape(3, 16),
                each.lost.reshape(3, 16),
                np.empty((3, 16)),
                each.lost.reshape(3, 16),
            )
            for each in sets
        ]
        assert landmarks.word == compare_fix(*outcomes).verdict.word == word
        seen.add(word)
    assert {BETTER, UNDECIDED} <= seen


def recommend_preset(ratios, seed):
    """Return the preset that `tune` recommends if the ratios of errors are known.

    The ratios belong to the user's settings, the precise preset and the safe preset.
    """
    user_settings = Amcl()
    settings = [user_settings, *list_applicable_presets(user_settings).values()]
    random = np.random.default_rng(seed)
    shape = len(settings), 64
    errors = 0.4 * random.normal(size=64) + random.normal(0, DEVIATION / math.sqrt(2), shape)
    errors += np.log(ratios)[:, None] - 2
    lost = random.uniform(size=shape) < LOST_SHARE

    def drive(amcl, numbers):
        row = settings.index(amcl)
        return DriveSet(errors[row, numbers], lost[row, numbers], lost[row, numbers])

    return choose_preset(user_settings, [LevelCase("usual", drive, (64,))], [LINE]).name


def test_tune_rarely_recommends_equal_presets():
    """Both presets equal the user's settings."""
    recommended = [recommend_preset([1.0] * 3, seed) for seed in range(400)]
    assert np.mean([name != USER_SETTINGS for name in recommended]) <= 0.025


def test_tune_finds_preset_of_four_fifths():
    ratios = {"safe": [1.0, 1.0, 0.8], "precise": [1.0, 0.8, 1.0]}
    hits = [recommend_preset(ratios[name], seed) == name for name in ratios for seed in range(600)]
    assert np.mean(hits) >= 0.9


def test_has_more_off_needs_significant_difference():
    """Seven harmed drives are significant, six are not; returning drives weigh against them."""
    errors, none = np.zeros(64), np.zeros(64, bool)

    def has_more(n_harmed, n_returned=0):
        baseline, alternative = none.copy(), none.copy()
        alternative[:n_harmed] = True
        baseline[n_harmed : n_harmed + n_returned] = True
        sets = [DriveSet(errors, none, off) for off in (baseline, alternative)]
        return compare_drives(*sets).has_more_off

    assert [has_more(6), has_more(7), has_more(8, 6), has_more(22, 8)] == [False, True, False, True]
    assert not compare_drives(DriveSet(errors, none), DriveSet(errors, none)).has_more_off


def test_drives_are_rarely_off_below_limit():
    """With a true rate of 20 %, at most 3 % of the sets have so few drives off."""

    def drives_with(n_off, n_drives):
        is_off = np.arange(n_drives) < n_off
        return DriveSet(np.zeros(n_drives), is_off, is_off)

    limits = [(0, 16), (1, 32), (6, 64)]
    assert all(drives_with(*limit).is_rarely_off for limit in limits)
    assert not any(drives_with(n_off + 1, n).is_rarely_off for n_off, n in limits)
    assert drives_with(6, 16).can_be_rarely_off(64)
    assert not drives_with(7, 16).can_be_rarely_off(64)

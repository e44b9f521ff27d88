"""The two sentences that an evaluation comes to, branch by branch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from locplan import OccupancyGrid, Robot
from locplan._util import intervals
from locplan.maps import FREE
from locplan.simulation import Evaluation, Places, Predictor

ABOVE, ZERO, BELOW = (
    intervals.Interval(0.6, 0.4, 0.8),
    intervals.Interval(0.1, -0.2, 0.4),
    intervals.Interval(-0.3, -0.5, -0.1),
)
CHANCE, FINDS = intervals.Interval(0.6, 0.4, 0.8), intervals.Interval(0.9, 0.7, 1.0)
UNKNOWN = intervals.Interval(math.nan, math.nan, math.nan)
PLANNED = [
    *(Predictor(name, "position_std") for name in ("fused", "scan", "fisher")),
    *(Predictor(name, "e") for name in ("sad", "sad visible", "paper", "paper visible")),
]
"""Fields that paths are planned with, in the order in which they are looked at."""


class Made(Evaluation):
    """An evaluation of which the ranks and the agreement are given."""

    ranks, agreement = {}, ABOVE


def moments(rmse):
    """Second moments (n, 3, 3) of position errors."""
    found = np.zeros((len(rmse), 3, 3))
    found[:, 0, 0] = np.square(rmse)
    return found


def said(
    correlations,
    *,
    agreement=ABOVE,
    auc=CHANCE,
    count=100,
    tracking_median=0.12,
    tracking_rmse=0.5,
    lost=0.1,
    match_median=0.02,
    failed=0.01,
):
    """What an evaluation comes to whose first fields correlate so, the others like nothing."""
    every = np.ones(count)
    places = Places(
        OccupancyGrid(np.full((4, 4), FREE), 0.1),
        np.zeros((count, 2), int),
        moments(tracking_rmse * every),
        moments(np.where(np.arange(count) < round(failed * count), 0.4, 0.03)),
        tracking_median * every,
        match_median * every,
        lost * every,
        lost * every,
        tracking_rmse * every,
        np.full((count, 2), tracking_rmse),
    )
    made = Made([places], [{}], Robot("turtlebot4"), 16, 16, 1)
    others = [ZERO] * (len(PLANNED) - len(correlations))
    found = zip(PLANNED, [*correlations, *others], strict=True)
    ranks = {(each, "tracking"): intervals.Rank(value, value, auc) for each, value in found}
    made.__dict__.update(ranks=ranks, agreement=agreement)
    return made.conclusion


def first(agreement, *correlations, auc=CHANCE):
    return said(correlations, agreement=agreement, auc=auc)[0]


def second(**sizes):
    return said([ABOVE], **sizes)[1]


def test_too_few_places_conclude_nothing():
    assert said([ABOVE], count=19) == ["19 places are too few to tell: take at least 20."]
    assert len(said([ABOVE], count=20)) == 2


@pytest.mark.parametrize(("lost", "text"), [(0.0, "no drive was off by"), (0.003, "0.3 % of the")])
def test_a_filter_that_holds_its_position_needs_nothing(lost, text):
    good = {"tracking_rmse": 0.08, "lost": lost}
    sentences = said([ABOVE], **good)
    assert sentences[0].startswith("The filter holds its position: at 90 % of the places its RMSE")
    assert "at most 0.080 m" in sentences[0]
    assert text in sentences[0]
    assert "little to gain" in sentences[1]
    for worse in ({"tracking_rmse": 0.11}, {"lost": 0.006}):
        assert "holds" not in said([ABOVE], **{**good, **worse})[0]


def test_the_first_field_above_zero_is_named_with_its_interval():
    assert first(ABOVE, ZERO, ABOVE, intervals.Interval(0.9, 0.8, 1.0)) == (
        "Where the filter errs depends on the place, and `scan, position` ranks the"
        " places (.60 [.40, .80]): plan with --lidar and --estimator scan."
    )


def test_of_many_fields_one_is_not_named_by_chance():
    barely = intervals.Interval(0.3, 0.02, 0.55)
    assert "`fused, position` ranks" in first(ABOVE, intervals.Interval(0.3, 0.1, 0.5))
    assert "no field that" in first(ABOVE, barely, ZERO, ZERO, ZERO)


def test_a_field_may_find_the_worst_places_without_ranking_the_others():
    sentence = first(ABOVE, ZERO, auc=FINDS)
    assert "`fused, position` finds the worst fifth of the places (AUC .90 [.70, 1.00])" in sentence


def test_errors_that_depend_on_the_place_may_be_ranked_by_no_field():
    sentence = first(ABOVE, ZERO, ZERO)
    assert "two halves of the drives correlate by .60 [.40, .80]" in sentence
    assert "takes was shown to rank the places (no interval excludes chance)" in sentence
    assert sentence.endswith("may not help; more places narrow the intervals.")


def test_fields_the_wrong_way_round_are_called_so():
    sentence = first(ABOVE, ZERO, BELOW)
    assert "`scan, position` ranks them the wrong way round, -.30 [-.50, -.10]" in sentence
    assert "a path by a field may not help" in sentence


@pytest.mark.parametrize("agreement", [ZERO, BELOW])
def test_errors_that_no_place_explains_come_from_the_filter(agreement):
    sentence = first(agreement, ZERO)
    assert sentence.startswith("No field that `locplan plan` takes ranks the errors of this filter")
    assert "they come from the filter rather than from the places" in sentence


def test_without_a_second_drive_nothing_is_said_of_where_errors_come_from():
    assert first(UNKNOWN, ZERO) == (
        "No field that `locplan plan` takes ranks the errors of this filter (no interval excludes"
        " chance)."
    )


def test_a_filter_far_worse_than_single_scans_is_to_be_tuned():
    assert second() == (
        "Tune the filter first with `locplan tune`: its median error is 0.12 m, that of single"
        " scans 0.020 m, and single scans fail (RMSE above 0.25 m) at 1 % of the places."
    )
    assert second(failed=0.0).endswith("single scans fail (RMSE above 0.25 m) at no place.")
    both = second(failed=0.2)
    assert both.startswith("Tune the filter first")
    assert "at 20 % of the places: avoid these with `locplan plan`, or add landmarks" in both


def test_a_tuned_filter_avoids_the_places_where_scans_fail():
    sentence = second(tracking_median=0.03, failed=0.2)
    assert sentence.startswith("Single scans fail (RMSE above 0.25 m) at 20 % of the places: avoid")
    assert "add landmarks" in sentence
    assert "the filter needs no tuning" in sentence


def test_a_tuned_filter_where_scans_match_compares_paths():
    sentence = second(tracking_median=0.03)
    assert sentence.startswith("The filter is about as good as single scans")
    assert "10.0 % of the drives were off by more than 1 m at some time" in sentence
    assert "`locplan plan`" in sentence
    assert "tune" not in sentence


def test_no_conclusion_has_more_than_two_sentences_or_speaks_of_a_best():
    for agreement in (ABOVE, ZERO, BELOW, UNKNOWN):
        for correlation in (ABOVE, ZERO, BELOW):
            for tracking in (0.01, 0.3):
                for failed in (0.0, 0.5):
                    every = said(
                        [correlation],
                        agreement=agreement,
                        tracking_median=tracking,
                        failed=failed,
                    )
                    assert len(every) == 2
                    for each in every:
                        assert each.endswith(".")
                        assert ". " not in each
                        assert "best" not in each

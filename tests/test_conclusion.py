"""The two sentences that an evaluation comes to, branch by branch."""

from __future__ import annotations

import dataclasses
import math

import pytest

from locplan._util.intervals import Interval
from locplan.simulation._predictors import FEW_PLACES, Ranked, Sizes, conclusion

ABOVE, ZERO, BELOW = Interval(0.6, 0.4, 0.8), Interval(0.1, -0.2, 0.4), Interval(-0.3, -0.5, -0.1)
CHANCE, FINDS = Interval(0.6, 0.4, 0.8), Interval(0.9, 0.7, 1.0)
UNKNOWN = Interval(math.nan, math.nan, math.nan)
POOR = Sizes(tracking_median=0.12, tracking_rmse=0.5, lost=0.1, match_median=0.02, failed=0.01)


def fields(*correlations, auc=CHANCE):
    return [
        Ranked(f"field {n}", f"with --option {n}", each, auc) for n, each in enumerate(correlations)
    ]


def first(agreement, *correlations, auc=CHANCE):
    return conclusion(40, agreement, fields(*correlations, auc=auc), POOR)[0]


def second(**sizes):
    return conclusion(40, ABOVE, fields(ABOVE), dataclasses.replace(POOR, **sizes))[1]


def test_too_few_places_conclude_nothing():
    said = conclusion(FEW_PLACES - 1, ABOVE, fields(ABOVE), POOR)
    assert said == ["19 places are too few to tell: take at least 20."]
    assert len(conclusion(FEW_PLACES, ABOVE, fields(ABOVE), POOR)) == 2


@pytest.mark.parametrize(("lost", "text"), [(0.0, "no drive was lost"), (0.003, "0.3 % of the")])
def test_a_filter_that_holds_its_position_needs_nothing(lost, text):
    good = dataclasses.replace(POOR, tracking_rmse=0.08, lost=lost)
    said = conclusion(40, ABOVE, fields(ABOVE), good)
    assert said[0].startswith("The filter holds its position: at 90 % of the places its RMSE is at")
    assert "at most 0.080 m" in said[0]
    assert text in said[0]
    assert "little to gain" in said[1]
    for worse in ({"tracking_rmse": 0.11}, {"lost": 0.006}):
        said = conclusion(40, ABOVE, fields(ABOVE), dataclasses.replace(good, **worse))
        assert "holds" not in said[0]


def test_the_first_field_above_zero_is_named_with_its_interval():
    assert first(ABOVE, ZERO, ABOVE, Interval(0.9, 0.8, 1.0)) == (
        "Where the filter errs depends on the place, and field 1 ranks the places"
        " (.60 [.40, .80]): plan with --option 1."
    )


def test_of_many_fields_one_is_not_named_by_chance():
    barely = Interval(0.3, 0.02, 0.55)
    assert "field 0 ranks" in first(ABOVE, Interval(0.3, 0.1, 0.5))
    assert "no field that" in first(ABOVE, barely, ZERO, ZERO, ZERO)


def test_a_field_may_find_the_worst_places_without_ranking_the_others():
    said = first(ABOVE, ZERO, auc=FINDS)
    assert "field 0 finds the worst fifth of the places (AUC .90 [.70, 1.00])" in said


def test_errors_that_depend_on_the_place_may_be_ranked_by_no_field():
    said = first(ABOVE, ZERO, ZERO)
    assert "two halves of the drives correlate by .60 [.40, .80]" in said
    assert "takes was shown to rank the places (no interval excludes chance)" in said
    assert said.endswith("may not help; more places narrow the intervals.")


def test_fields_the_wrong_way_round_are_called_so():
    said = first(ABOVE, ZERO, BELOW)
    assert "field 1 ranks them the wrong way round, -.30 [-.50, -.10]" in said
    assert "a path by a field may not help" in said


@pytest.mark.parametrize("agreement", [ZERO, BELOW])
def test_errors_that_no_place_explains_come_from_the_filter(agreement):
    said = first(agreement, ZERO)
    assert said.startswith("No field that `locplan plan` takes ranks the errors of this filter")
    assert "they come from the filter rather than from the places" in said


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
    said = second(tracking_median=0.03, failed=0.2)
    assert said.startswith("Single scans fail (RMSE above 0.25 m) at 20 % of the places: avoid")
    assert "add landmarks" in said
    assert "the filter needs no tuning" in said


def test_a_tuned_filter_where_scans_match_compares_paths():
    said = second(tracking_median=0.03)
    assert said.startswith("The filter is about as good as single scans")
    assert "10.0 % of the drives were lost" in said
    assert "`locplan plan`" in said
    assert "tune" not in said


def test_no_conclusion_has_more_than_two_sentences_or_speaks_of_a_best():
    for agreement in (ABOVE, ZERO, BELOW, UNKNOWN):
        for correlation in (ABOVE, ZERO, BELOW):
            for tracking in (0.01, 0.3):
                for failed in (0.0, 0.5):
                    sizes = dataclasses.replace(POOR, tracking_median=tracking, failed=failed)
                    said = conclusion(40, agreement, fields(correlation), sizes)
                    assert len(said) == 2
                    for each in said:
                        assert each.endswith(".")
                        assert ". " not in each
                        assert "best" not in each

"""What an evaluation comes to, in two sentences: if places matter, and what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from locplan._util.intervals import Interval, in_metres, short
from locplan.simulation._drives import LOST

FEW_PLACES = 20
"""Number of places below which nothing is concluded."""
SMALL_RMSE = 0.1
"""RMSE up to which a filter holds its position [m]."""
FEW_LOST = 0.005
"""Share of lost drives up to which a filter holds its position."""
FAILED_MATCH = 0.25
"""RMSE of single scans above which they fail at a place [m]."""
MANY_FAILED = 0.05
"""Share of places where scans fail above which something must be done about them."""
UNTUNED = 2.0
"""Median error of a filter, over that of single scans, above which the filter is to be tuned."""


class Ranked(NamedTuple):
    """A field, and how well it ranks the filter's errors."""

    name: str
    options: str
    """Options of `locplan plan` with this field."""
    correlation: Interval
    """Spearman's rank correlation of the field with the RMSE of the position."""
    auc: Interval
    """Probability that a place among the worst fifth ranks higher than another; .5 by chance."""


@dataclass(frozen=True)
class Sizes:
    """How large the errors of a filter and of single scans are over all places."""

    tracking_median: float
    """Median over the places of the filter's median error [m]."""
    tracking_rmse: float
    """RMSE of the filter's position that 90 % of the places do not exceed [m]."""
    lost: float
    """Share of the drives that were lost at any time."""
    match_median: float
    """Median over the places of the median error of single scans [m]."""
    failed: float
    """Share of the places where the RMSE of single scans exceeds `FAILED_MATCH`."""


def conclusion(
    places: int, agreement: Interval, fields: Sequence[Ranked], sizes: Sizes
) -> list[str]:
    """Two sentences on what a user should do; one if the places are too few to tell.

    Parameters
    ----------
    places : int
        Number of places.
    agreement : Interval
        Rank correlation, over the places, of the errors of half of the drives with those of the
        other half; NaN if it is not known.
    fields : sequence of Ranked
        Fields that paths can be planned with. The first that ranks the places better than by
        chance is named: to name the greatest correlation of many would be to name chance.
    sizes : Sizes
        Sizes of the errors.
    """
    if places < FEW_PLACES:
        return [f"{places} places are too few to tell: take at least {FEW_PLACES}."]
    if sizes.tracking_rmse <= SMALL_RMSE and sizes.lost <= FEW_LOST:
        lost = f"{_percent(sizes.lost, 1)} of the drives were" if sizes.lost else "no drive was"
        return [
            f"The filter holds its position: at 90 % of the places its RMSE is at most"
            f" {in_metres(sizes.tracking_rmse)}, and {lost} lost.",
            "There is little to gain here, whether from other settings or from other paths.",
        ]
    return [_about_places(agreement, fields), _about_deeds(sizes)]


def _about_places(agreement: Interval, fields: Sequence[Ranked]) -> str:
    """Whether the errors depend on the place, and which field ranks them."""
    halves = f"the errors of two halves of the drives correlate by {short(agreement)}"
    looks = 2 * len(fields)
    for name, options, correlation, auc in fields:
        if _excludes(correlation, 0.0, looks):
            good = f"ranks the places ({short(correlation)})"
        elif _excludes(auc, 0.5, looks):
            good = f"finds the worst fifth of the places (AUC {short(auc)})"
        else:
            continue
        return f"Where the filter errs depends on the place, and {name} {good}: plan {options}."
    wrong = [each for each in fields if each.correlation.high < 0]
    why = "no interval excludes chance"
    if wrong:
        why = f"{wrong[0].name} ranks them the wrong way round, {short(wrong[0].correlation)}"
    if agreement.low > 0:
        return (
            f"Where the filter errs depends on the place ({halves}), but no field that"
            f" `locplan plan` takes was shown to rank the places ({why}): with this filter a path"
            " by a field may not help; more places narrow the intervals."
        )
    if math.isnan(agreement.low):
        return f"No field that `locplan plan` takes ranks the errors of this filter ({why})."
    return (
        f"No field that `locplan plan` takes ranks the errors of this filter ({why}), and they come"
        f" from the filter rather than from the places ({halves})."
    )


def _excludes(interval: Interval, chance: float, looks: int) -> bool:
    """Whether an interval lies above chance, as wide as `looks` of them make it (Bonferroni)."""
    from scipy.special import ndtri

    wider = ndtri(1 - 0.025 / max(looks, 1)) / ndtri(0.975)
    return bool(interval.value - (interval.value - interval.low) * wider > chance)


def _about_deeds(sizes: Sizes) -> str:
    """What to do: tune the filter, avoid places or mark them, or compare paths."""
    avoid = "avoid these with `locplan plan`, or add landmarks there"
    share = f"{_percent(sizes.failed)} of the places" if sizes.failed else "no place"
    failed = f"fail (RMSE above {FAILED_MATCH:g} m) at {share}"
    medians = (
        f"its median error is {in_metres(sizes.tracking_median)},"
        f" that of single scans {in_metres(sizes.match_median)}"
    )
    if sizes.tracking_median > UNTUNED * sizes.match_median:
        tune = f"Tune the filter first with `locplan tune`: {medians}"
        if sizes.failed > MANY_FAILED:
            return f"{tune}; and single scans {failed}: {avoid}."
        return f"{tune}, and single scans {failed}."
    if sizes.failed > MANY_FAILED:
        return f"Single scans {failed}: {avoid}; the filter needs no tuning: {medians}."
    return (
        f"The filter is about as good as single scans ({medians}), but"
        f" {_percent(sizes.lost, 1)} of the drives were lost (> {LOST:g} m at any time), and at"
        f" 10 % of the places its RMSE exceeds {in_metres(sizes.tracking_rmse)}: compare paths with"
        " `locplan plan`."
    )


def _percent(share: float, digits: int = 0) -> str:
    return f"{100 * share:.{digits}f} %"

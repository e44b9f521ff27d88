"""Findings in a sentence each, as they come."""

from __future__ import annotations

import math
from collections.abc import Sequence

from locplan._util.intervals import Interval
from locplan.diagnosis._result import Cure, Rates
from locplan.diagnosis._weak_spots import WeakSpot
from locplan.maps import MapFaults
from locplan.simulation import LOST


def share(rate: Interval) -> str:
    """A share of drives with its interval, such as 34 % [25, 44]; a dash if it is not known."""
    if math.isnan(rate.value):
        return "-"
    value, low, high = (f"{100 * each:.0f}" for each in rate)
    return f"{value} % [{low}, {high}]"


def faults(found: MapFaults) -> str:
    """The faults of the map."""
    said = "; ".join(f"{each.kind}: {each.what}" for each in found)
    return f"map: {said or 'no fault that the map alone shows'}"


def spots(found: Sequence[WeakSpot]) -> str:
    """The worst weak spot, and how many there are."""
    if not found:
        return "weak spots: none"
    first = found[0]
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"weak spots: {first.size} at {first.place}, {first.missing}{more}"


def as_it_is(rates: Rates) -> str:
    """How often the robot gets lost now."""
    said = f"{share(rates.lost)} of {rates.drives} drives get lost (off by over {LOST:g} m)"
    return f"as it is: {said}; {share(rates.arrives)} arrive"


def cure(found: Cure, before: Rates) -> str:
    """What a cure that is clearly better gains."""
    return f"{found.title}: {share(before.lost)} -> {share(found.rates.lost)}"

"""Findings in one sentence each, as they come, and rates as text."""

from __future__ import annotations

from collections.abc import Sequence

from locplan._util.intervals import share
from locplan.diagnosis._rates import DriveRates, FixResult
from locplan.diagnosis._weak_spots import WeakSpot
from locplan.maps import MapFaults
from locplan.simulation import LOST


def faults(found: MapFaults) -> str:
    """Name the faults of the map."""
    kinds = "; ".join(f"{fault.kind}: {fault.what}" for fault in found)
    return f"map: {kinds or 'no fault that the map alone shows'}"


def spots(found: Sequence[WeakSpot]) -> str:
    """Describe the worst weak spot, and count the others."""
    if not found:
        return "weak spots: none"
    first = found[0]
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"weak spots: {first.size} at {first.place}, {first.missing}{more}"


def baseline(rates: DriveRates) -> str:
    """Report the rates of the baseline."""
    lost = f"lost (error > {LOST:g} m) in {share(rates.lost)} of {rates.n_drives} drives"
    return f"baseline: {lost}; {share(rates.reached)} reach the goal"


def fix(result: FixResult, before: DriveRates) -> str:
    """Report the gain of a fix that is better."""
    return f"{result.title}: lost {share(before.lost)} -> {share(result.rates.lost)}"

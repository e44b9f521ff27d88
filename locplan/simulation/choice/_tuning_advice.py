"""Advice on the filter's settings, which may matter more than the path."""

from __future__ import annotations

from locplan._util.intervals import short
from locplan.robots import Amcl, Filter
from locplan.simulation.choice._ask import TUNED
from locplan.simulation.choice._driven import Candidate, Driven

MOSTLY_LOST = 0.5
"""Share of lost drives from which a path, or a filter, is no remedy."""


def tuning_advice(
    shortest: Candidate,
    chosen: Candidate,
    ratio: float,
    filter: Amcl | Filter,
    rival: Driven | None,
    rival_filter: Amcl | None,
) -> list[str]:
    """Return sentences on the filter: whether to tune it first, or why that does not help.

    Parameters
    ----------
    shortest, chosen : Candidate
        The shortest path, and the path to take.
    ratio : float
        Error on the path to take, over that on the shortest.
    filter : Amcl or Filter
        The robot's filter.
    rival : Driven or None
        Drives of another filter on the shortest path.
    rival_filter : Amcl or None
        That filter.
    """
    if chosen.driven is None:
        return []
    which = "this filter" if isinstance(filter, Amcl) else "AMCL"
    other = f"{which} with all alphas 0.05 and likelihood_field_prob"
    if rival_filter not in (None, TUNED):
        other = rival_filter.title
    if rival and shortest.driven:
        lost = min(shortest.driven.lost_rate.value, rival.lost_rate.value)
        if lost >= MOSTLY_LOST:
            return [_tuning_fails(shortest, rival, other)]
    advice = []
    if chosen.driven.lost_rate.value >= MOSTLY_LOST:  # paths are not the remedy
        tool = " with `locplan tune`" if isinstance(filter, Amcl) else ""
        advice.append(
            f"half of its drives or more are off by over 1 m: tune the filter first{tool};"
            " `locplan evaluate` tells if single scans fail as well"
        )
    if rival and rival_filter and rival.ratio.high < 1 and rival.ratio.value < 0.9 * ratio:
        advice.append(
            f"tune first, with `locplan tune`: on the shortest path {other} has"
            f" x{short(rival.ratio)} of the error"
        )
    return advice


def _tuning_fails(shortest: Candidate, rival: Driven, other: str) -> str:
    """Say that drives on the shortest path get lost with another filter as well, and why."""
    sentence = (
        f"tuning alone does not help here: {other} is off by over 1 m in"
        f" {rival.lost_rate.value:.0%} of the drives on the shortest path"
    )
    share = shortest.metrics.degenerate_share
    if share >= MOSTLY_LOST:
        sentence += f"; the lidar sees too little on {share:.0%} of it"
    return sentence

"""Advice on the filter's settings, which may matter more than the path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locplan._util.intervals import short
from locplan.robots import Amcl
from locplan.simulation.choice._ask import TUNED

if TYPE_CHECKING:
    from locplan.simulation.choice._choice import Choice

MOSTLY_LOST = 0.5
"""Share of lost drives from which a path, or a filter, is no remedy."""


def tuning_advice(choice: Choice) -> list[str]:
    """Return sentences on the filter, whether to tune it first or why that does not help.

    Parameters
    ----------
    choice : Choice
        The choice, with the drives of another filter on the shortest path if there are any.
    """
    chosen, judgement, rival = choice.chosen, choice.judgement, choice.rival
    if chosen is None or chosen.driven is None or judgement is None:
        return []
    if sentence := _tuning_fails(choice):
        return [sentence]
    advice = []
    if chosen.driven.lost_rate.value >= MOSTLY_LOST:  # paths are not the remedy
        tool = " with `locplan tune`" if isinstance(choice.robot.filter, Amcl) else ""
        advice.append(
            f"half of its drives or more are off by over 1 m: tune the filter first{tool};"
            " `locplan evaluate` tells if single scans fail as well"
        )
    taken = judgement.ratio.value if choice.best else 1.0
    if rival and choice.settings.rival and rival.ratio.high < 1 and rival.ratio.value < 0.9 * taken:
        advice.append(
            f"tune first, with `locplan tune`: on the shortest path {_rival_filter(choice)} has"
            f" x{short(rival.ratio)} of the error"
        )
    return advice


def _tuning_fails(choice: Choice) -> str:
    """Say that drives on the shortest path are lost with another filter as well; empty if not."""
    shortest, rival = choice.shortest, choice.rival
    if not (shortest and shortest.driven and rival):
        return ""
    if min(shortest.driven.lost_rate.value, rival.lost_rate.value) < MOSTLY_LOST:
        return ""
    sentence = (
        f"tuning alone does not help here: {_rival_filter(choice)} is off by over 1 m in"
        f" {rival.lost_rate.value:.0%} of the drives on the shortest path"
    )
    share = shortest.metrics.degenerate_share
    if share >= MOSTLY_LOST:
        sentence += f"; the lidar sees too little on {share:.0%} of it"
    return sentence


def _rival_filter(choice: Choice) -> str:
    """Describe the filter of the rival's drives."""
    which = "this filter" if isinstance(choice.robot.filter, Amcl) else "AMCL"
    preset = f"{which} with all alphas 0.05 and likelihood_field_prob"
    rival = choice.settings.rival
    return preset if rival in (None, TUNED) else rival.title

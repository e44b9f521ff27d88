"""The abilities of OMPL's planners on a costmap, found by trying each in every space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from locplan.planners._protocol import SPACES

_NOT_DUBINS = tuple(space for space in SPACES if space != "Dubins")
"""Spaces of planners that drive Dubins' curves backwards, or find none, as FMT within 25 s."""


@dataclass(frozen=True)
class Kind:
    """The abilities of one of OMPL's planners."""

    minimises: bool
    """True if it seeks the least J; the others stop at the first path that they find."""
    spaces: tuple[str, ...] = SPACES
    """The spaces in which it works."""
    from_grid: bool = False
    """True if it can begin with the grid planner's path, in "R2"."""
    anytime: bool = False
    """True if it goes on improving its path, so that it can stop on convergence."""


KINDS: dict[str, Kind] = {
    "RRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "InformedRRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "SORRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "BITstar": Kind(minimises=True, anytime=True),
    "FMT": Kind(minimises=True, spaces=_NOT_DUBINS),
    "BFMT": Kind(minimises=True, spaces=_NOT_DUBINS),
    "PRM": Kind(minimises=True, from_grid=True),
    "PRMstar": Kind(minimises=True, from_grid=True),
    "RRT": Kind(minimises=False),
    "RRTConnect": Kind(minimises=False),
    "KPIECE1": Kind(minimises=False),
    "BKPIECE1": Kind(minimises=False, spaces=_NOT_DUBINS),
    "LBKPIECE1": Kind(minimises=False, spaces=_NOT_DUBINS),
}
"""The planners by OMPL's own names."""


def able(fits: Callable[[Kind], bool]) -> str:
    """The names of the planners of the kinds that fit, for messages."""
    return ", ".join(name for name, kind in KINDS.items() if fits(kind))

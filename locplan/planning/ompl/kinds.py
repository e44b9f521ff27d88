"""The planners of OMPL by name, with the abilities of each."""

from __future__ import annotations

from dataclasses import dataclass

from locplan.planning.protocol import SPACES

_NOT_DUBINS = tuple(space for space in SPACES if space != "Dubins")
"""Spaces of planners that drive Dubins' curves backwards, or find none, as FMT within 25 s."""


@dataclass(frozen=True)
class PlannerKind:
    """The abilities of one of OMPL's planners."""

    minimises: bool
    """True if it seeks the least J; the others stop at the first path that they find."""
    spaces: tuple[str, ...] = SPACES
    """The spaces in which it works."""
    from_grid: bool = False
    """True if it can begin with the grid planner's path, in "R2"."""
    anytime: bool = False
    """True if it goes on improving its path, so that it can stop on convergence."""
    settled_after: int = 1000
    """Minimum iterations before it may count as converged."""
    roadmap: bool = False
    """True if it grows a roadmap."""


KINDS: dict[str, PlannerKind] = {
    "RRTstar": PlannerKind(minimises=True, from_grid=True, anytime=True),
    "InformedRRTstar": PlannerKind(minimises=True, from_grid=True, anytime=True),
    "SORRTstar": PlannerKind(minimises=True, from_grid=True, anytime=True),
    "BITstar": PlannerKind(minimises=True, anytime=True, settled_after=30_000),  # they are edges
    "FMT": PlannerKind(minimises=True, spaces=_NOT_DUBINS),
    "BFMT": PlannerKind(minimises=True, spaces=_NOT_DUBINS),
    "PRM": PlannerKind(minimises=True, from_grid=True, roadmap=True),
    "PRMstar": PlannerKind(minimises=True, from_grid=True, roadmap=True),
    "RRT": PlannerKind(minimises=False),
    "RRTConnect": PlannerKind(minimises=False),
    "KPIECE1": PlannerKind(minimises=False),
    "BKPIECE1": PlannerKind(minimises=False, spaces=_NOT_DUBINS),
    "LBKPIECE1": PlannerKind(minimises=False, spaces=_NOT_DUBINS),
}
"""The planners by OMPL's own names."""

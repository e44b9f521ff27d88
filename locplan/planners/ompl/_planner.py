"""OMPL's planners; ompl itself is imported when one is used."""

from __future__ import annotations

from dataclasses import dataclass

from locplan.costs import Costmap
from locplan.planners._protocol import Found, Position
from locplan.planners.ompl._options import Options


@dataclass(frozen=True)
class Ompl(Options):
    """One of OMPL's sampling-based planners.

    RRT, RRTConnect, KPIECE1, BKPIECE1 and LBKPIECE1 do not look at costs and stop at the first
    path; the others seek the least J.
    """

    def prepare(self) -> None:
        """Load OMPL and compile the kernels, so that the first plan is not timed with them."""
        from locplan.planners.ompl._solver import prepare

        prepare()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan between positions [m], or in all spaces but "R2" poses [m, rad].

        It is a "timeout" if nothing was found in time.
        """
        from locplan.planners.ompl._solver import solve

        return solve(self, costs, start, goal)

"""A tree that first grows along a path that is known already."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from locplan.planners._any_angle import subdivided
from locplan.planners.ompl._bindings import base
from locplan.planners.ompl._setup import write_pose

SPACING = 0.1
"""Of the positions along it, in the tree's greatest steps."""


class LeadingGoal(base.GoalSampleableRegion):
    """The goal, whose samples are at first those of a path that leads there.

    A tree planner reaches for samples of the goal now and then. OMPL offers no other way to hand
    it states from Python.
    """

    def __init__(
        self,
        information: base.SpaceInformation,
        positions: NDArray[np.float64],
        goal: Sequence[float],
    ) -> None:
        super().__init__(information)
        self._positions, self._goal = positions.tolist(), (float(goal[0]), float(goal[1]))
        self.setThreshold(1e-9)
        self.leads = False
        """Off while the planner is set up: then it asks for the goal itself."""

    @property
    def arrived(self) -> bool:
        """Whether the whole path was sampled."""
        return not self._positions

    def sampleGoal(self, state: base.State) -> None:
        """Write the next position of the path, or the goal."""
        following = self._goal
        if self.leads and self._positions:
            following = self._positions.pop(0)
        write_pose(state, "R2", following)

    def maxSampleCount(self) -> int:
        """There is one goal."""
        return 1

    def distanceGoal(self, state: base.State) -> float:
        """Distance from the goal [m]."""
        return math.hypot(state[0] - self._goal[0], state[1] - self._goal[1])


def lead(
    tree: base.Planner,
    information: base.SpaceInformation,
    problem: base.ProblemDefinition,
    path: NDArray[np.float64],
    goal: Sequence[float],
    ends: Callable[[], bool],
) -> Callable[[], bool]:
    """Let a tree, set up, first grow along a path (n, 2) [m]; returns when to end its search."""
    positions = subdivided(path, SPACING * tree.getRange())[1:]
    leading = LeadingGoal(information, positions, goal)
    problem.setGoal(leading)
    usual = tree.getGoalBias()
    tree.setGoalBias(1.0)

    def ends_after_leading() -> bool:
        if not leading.leads:
            leading.leads = True
        elif leading.arrived:
            tree.setGoalBias(usual)
        return ends()

    return ends_after_leading

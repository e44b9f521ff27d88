"""Trees of OMPL's planners that first grow along a known path."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from locplan.planners._any_angle import subdivided
from locplan.planners._protocol import Position
from locplan.planners.ompl._bindings import base
from locplan.planners.ompl._setup import write_pose

SPACING = 0.1
"""Spacing of the positions along the path, in the tree's greatest steps."""


class LeadingGoal(base.GoalSampleableRegion):
    """A goal whose samples are at first the positions of a path that leads there.

    Trees steer to samples of the goal now and then; OMPL takes states from Python in no other way.
    """

    def __init__(self, information: base.SpaceInformation, goal: Position) -> None:
        super().__init__(information)
        self._goal = float(goal[0]), float(goal[1])
        self._positions: list[Position] = []
        self.setThreshold(1e-9)
        self._leads = False  # while the tree is set up, it asks for the goal itself

    def sampleGoal(self, state: base.State) -> None:
        """Write the next position of the path, or the goal."""
        ahead = self._leads and self._positions
        write_pose(state, "R2", self._positions.pop(0) if ahead else self._goal)

    def maxSampleCount(self) -> int:
        """Return 1, since there is one goal."""
        return 1

    def distanceGoal(self, state: base.State) -> float:
        """Distance from the goal [m]."""
        return math.hypot(state[0] - self._goal[0], state[1] - self._goal[1])

    def lead(
        self, tree: base.Planner, path: NDArray[np.float64], ends: Callable[[], bool]
    ) -> Callable[[], bool]:
        """Let a tree that is set up first grow along a path (n, 2) [m]; return its new `ends`."""
        self._positions = list(map(tuple, subdivided(path, SPACING * tree.getRange())[1:].tolist()))
        usual = tree.getGoalBias()
        tree.setGoalBias(1.0)

        def ends_after_leading() -> bool:
            if not self._leads:
                self._leads = True
            elif not self._positions:
                tree.setGoalBias(usual)
            return ends()

        return ends_after_leading

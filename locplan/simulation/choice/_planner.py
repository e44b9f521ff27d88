"""The simulated choice as a planner, beside which others are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from locplan._util.checks import instance, whole
from locplan.costs import Costmap
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import LONGEST_ALTERNATIVE, AnyAngle, Found, Position
from locplan.robots import Robot
from locplan.simulation._scores import Minimise
from locplan.simulation.choice._choose import FEW_DRIVES, check_choice, choose


@dataclass(frozen=True)
class SimulatedChoice:
    """The planner that drives dissimilar paths in simulation, and returns the one it recommends.

    It drives on one thread, since a comparison's workers run at the same time.
    """

    name: ClassVar[str] = "simulated choice"
    space: ClassVar[str] = "R2"
    minimises: ClassVar[str | None] = "simulated error"

    drives: int = FEW_DRIVES
    """Greatest number of drives of each candidate, 2 to 100,000."""
    minimise: Minimise = "rmse"
    """Error that the chosen path has least of: "rmse", "goal-error", "heading" or "lost", see
    `locplan.choose`."""
    price: float | None = None
    """Metres of detour that are accepted for a halved error, above 0; by default length does not
    count."""
    longest: float = LONGEST_ALTERNATIVE
    """Greatest length of an alternative, in lengths of the shortest path, >= 1."""
    robot: Robot | str | None = None
    """The robot, or a file of it that `Robot.load` reads; its size is that of the costmap. By
    default it has Nav2's filter, and the lidar of the costmap's field."""
    seed: int | None = None
    """Seed of the drives, >= 0; by default 1, or each seed of a comparison."""

    def __post_init__(self) -> None:
        if isinstance(self.robot, str):  # once: workers need no file
            object.__setattr__(self, "robot", Robot.load(self.robot))

    def check(self) -> None:
        """Raise a ConfigError unless the options are within their ranges."""
        check_choice(self.longest, self.minimise, self.price, self.drives)
        if self.seed is not None:
            whole("seed", self.seed, 0)
        if self.robot is not None:
            instance("robot", self.robot, Robot)

    def prepare(self) -> None:
        """Load the kernels of the planners and of the drives."""
        SimulatedChoice(drives=2).solve(*_tiny())

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Choose among paths of this costmap, and return the chosen one.

        See `locplan.planners.Planner.solve`.
        """
        if start[:2] == goal[:2]:
            return AnyAngle().solve(costs, start, goal)
        choice = choose(
            costs.grid,
            start[:2],
            goal[:2],
            costs=costs,
            robot=None if isinstance(self.robot, str) else self.robot,
            longest=self.longest,
            minimise=self.minimise,
            price=self.price,
            drives=self.drives,
            seed=1 if self.seed is None else self.seed,
            threads=1,
        )
        return Found(choice.path, choice.status)


def _tiny() -> tuple[Costmap, Position, Position]:
    """A small query, which takes some milliseconds."""
    grid = OccupancyGrid(np.full((8, 8), FREE, np.uint8), 0.1)
    return Costmap.blank(grid, robot_radius=0.05), (0.25, 0.35), (0.55, 0.35)

"""The simulated choice as a planner, beside which others are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from locplan._util.checks import instance, whole
from locplan.costs import Costmap
from locplan.field import equipped
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import AnyAngle, Found, Position
from locplan.robots import Robot
from locplan.simulation._drives import Minimise
from locplan.simulation.choice._choose import choose
from locplan.simulation.choice._settings import ChoiceSettings


@dataclass(frozen=True)
class SimulatedChoice:
    """The planner that drives dissimilar paths in simulation, and returns the one it recommends.

    It drives on one thread, since a comparison's workers run at the same time.
    """

    name: ClassVar[str] = "simulated choice"
    space: ClassVar[str] = "R2"
    minimises: ClassVar[str | None] = "simulated error"

    drives: int = 64
    """Greatest number of confirming drives of a path, 2 to 1024."""
    minimise: Minimise = "rmse"
    """Error that decides: "rmse", "goal-error", "heading" or "lost", see `ChoiceSettings`."""
    price: float = 0.3
    """What the logarithm of the length counts in the race, >= 0."""
    longest: float = 1.5
    """Greatest length of a candidate, in lengths of the shortest path, >= 1."""
    bold: bool = False
    """Whether a path that is only probably better is taken, too."""
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
        ChoiceSettings.of(self._settings)
        if self.seed is not None:
            whole("seed", self.seed, 0)
        if self.robot is not None:
            instance("robot", self.robot, Robot)

    @property
    def _settings(self) -> dict[str, Any]:
        names = "drives", "minimise", "price", "longest", "bold"
        return {name: getattr(self, name) for name in names} | {"rival": None}

    def prepare(self) -> None:
        """Load the kernels of the planners and of the drives."""
        SimulatedChoice(drives=2).solve(*_tiny())

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Choose among paths of this costmap, and return the chosen one.

        See `locplan.planners.Planner.solve`.
        """
        if start[:2] == goal[:2]:
            return AnyAngle().solve(costs, start, goal)
        config = costs.settings.config if costs.settings else None
        choice = choose(
            costs.grid,
            start[:2],
            goal[:2],
            equipped(None if isinstance(self.robot, str) else self.robot, config),
            costs=costs,
            seed=1 if self.seed is None else self.seed,
            threads=1,
            **self._settings,
        )
        return Found(choice.path, choice.status)


def _tiny() -> tuple[Costmap, Position, Position]:
    """A small query, which takes some milliseconds."""
    grid = OccupancyGrid(np.full((8, 8), FREE, np.uint8), 0.1)
    return Costmap.blank(grid, robot_radius=0.05), (0.25, 0.35), (0.55, 0.35)

"""The lattice planner: an exact search over position and heading, with the robot's outline."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from locplan._support.checks import check_integer, check_number, check_positive, short_repr
from locplan.errors import ConfigError
from locplan.planning.costmap import Costmap
from locplan.planning.grid import make_blank_costs
from locplan.planning.protocol import LATTICE, PlannerResult, Position
from locplan.planning.smoothing import GEAR_CHANGE, REVERSE, TURN, PathSmoother
from locplan.robots.parts import Footprint
from locplan.robots.robot import Robot


@dataclass(frozen=True)
class Lattice:
    """This planner finds the cheapest motions that the robot itself can make.

    It searches over position and heading on the costmap's robot: outline, drive, turning
    radius, and whether it drives in reverse. Its path has headings. It is the cheapest one of the
    motions of the lattice, which begin and end in the middle of cells, and then smoothed. Either
    end may have a heading. If no motions lead into the goal's cell, it ends within the robot's
    goal tolerance, if it can. The outline keeps the robot's margin from walls, its corners moved
    outwards as by Nav2's footprint_padding; if no path does, it ignores the margin, and the plan's
    note reports it.

    Examples
    --------
    >>> from locplan.planning import plan
    >>> plan(make_blank_costs(9, 9), (1.5, 4.5), (7.5, 4.5, 0.0), planner="lattice").status
    'solved'
    """

    headings: int = 16
    """Number of headings: 8, 16 or 32."""
    span: int = 1
    """Number of headings, 1 to 4, that one turn may pass; more makes turns closer to the turning
    radius, and takes longer. Take 2 or more with 32 headings."""
    reverse: float = REVERSE
    """Factor on the cost of driving in reverse or sideways, above 1."""
    gear_change: float = GEAR_CHANGE
    """Cost of changing between forward and reverse, >= 0 [m]."""
    turn_cost: float = TURN
    """Cost of turning on the spot, above 0 [m/rad]."""
    smooth: bool = True
    """True smooths the path by curves that the robot can drive, which begin and end at just the
    poses asked for where they can; see `planning.smooth_path`."""
    time_limit: float | None = None
    """Time after which the search ends [s], above 0; by default it is not limited."""
    name: ClassVar[str] = "lattice"
    minimises: ClassVar[str] = "J"
    space: ClassVar[str] = LATTICE

    def check(self) -> None:
        """Raise a ConfigError if an option is out of its range."""
        if self.headings not in (8, 16, 32):
            raise ConfigError(f"headings must be 8, 16 or 32, not {short_repr(self.headings)}")
        check_integer("span", self.span, 1, 4)
        check_number("reverse", self.reverse, 1.0 + 1e-6)
        check_number("gear_change", self.gear_change, 0.0)
        check_positive("turn_cost", self.turn_cost, "m/rad")
        if self.time_limit is not None:
            check_positive("time_limit", self.time_limit, "seconds")

    def prepare(self) -> None:
        """Compile the kernels, so that the first plan is not timed with them."""
        square = Footprint(np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 4)
        costs = dataclasses.replace(make_blank_costs(9, 9), robot=Robot(footprint=square))
        self.solve(costs, (1.5, 1.5), (7.5, 1.5))

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between two world positions [m] or poses [m, rad] in free cells.

        See `locplan.planning.Planner.solve`.
        """
        until = time.perf_counter() + (self.time_limit or math.inf)
        robot = costs.robot
        if robot is None or robot.outline is None or robot.margin == 0:
            return self._search(costs, start, goal, until)
        wider = dataclasses.replace(costs, robot=_with_margin(robot, robot.outline))
        planner_result = self._search(wider, start, goal, until)
        if planner_result.status != "infeasible":
            margin_text = (
                f" if it keeps the robot's margin of {robot.margin:g} m"
                if planner_result.note
                else ""
            )
            return dataclasses.replace(planner_result, note=planner_result.note + margin_text)
        planner_result = self._search(costs, start, goal, until)
        if planner_result.path is None:
            return planner_result
        near = f"comes nearer to walls than the robot's margin of {robot.margin:g} m"
        note = f"{near}: no path of the lattice keeps it"
        return dataclasses.replace(
            planner_result, note="; ".join(filter(None, [planner_result.note, note]))
        )

    def _search(
        self, costs: Costmap, start: Position, goal: Position, until: float
    ) -> PlannerResult:
        """Plan for the costmap's robot as it is, until a time of `time.perf_counter`."""
        from locplan.planning.lattice_search import LatticeSearch, MotionPrices

        prices = MotionPrices(self.reverse, self.gear_change, self.turn_cost)
        search = LatticeSearch(costs, self.headings, self.span, prices, until)
        planner_result = search.find_path(start, goal)
        if planner_result.path is None or not self.smooth:
            return planner_result
        smoother = PathSmoother(costs, costs.robot, self.reverse, self.gear_change, self.turn_cost)
        at_goal = costs.find_cell(planner_result.path.xy[-1].tolist()) == costs.find_cell(goal[:2])
        path = smoother.smooth(planner_result.path, start, goal if at_goal else None)
        return dataclasses.replace(planner_result, path=path)


def _with_margin(robot: Robot, outline: Footprint) -> Robot:
    """Return a robot whose outline includes the margin."""
    around = robot.margin * np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    wider = Footprint((outline.vertices[:, None] + around).reshape(-1, 2))
    return dataclasses.replace(robot, footprint=wider, margin=0.0)

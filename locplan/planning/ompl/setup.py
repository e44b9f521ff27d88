"""A costmap as OMPL sees it: state space, motion validator and objective.

A callback takes longer to enter than its kernel to run, so there is one for each motion and none
for the states along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from locplan._support.kernels.arrays import Floats
from locplan.planning.any_angle import subdivide_line
from locplan.planning.ompl.motions import Motions
from locplan.planning.ompl.settings import Cost, base
from locplan.planning.ompl.stopping import OPTIMAL
from locplan.planning.protocol import Position, wrap_heading

BLOCKED = 1e15
"""Cost of a blocked motion for OMPL, some of whose planners crash on infinity [m]."""
Pose = tuple[float, float, float]


class CostObjective(base.PathLengthOptimizationObjective):
    """The objective J of `motions`, with their length as a lower bound.

    OMPL takes it for a kind of path length, so that informed planners sample the ellipse of that
    bound. Costs are finite and at least the length: a motion that is blocked costs `BLOCKED`.
    """

    def __init__(self, space_information: base.SpaceInformation, motions: Motions) -> None:
        super().__init__(space_information)
        self._cost = _make_cost_function(motions)
        self._length = space_information.getStateSpace().distance
        if motions.space == "SE2":  # the distance of this space counts turns
            self._length = lambda first, last: math.hypot(
                first.getX() - last.getX(), first.getY() - last.getY()
            )

    def motionCost(self, first: base.State, last: base.State) -> base.Cost:
        """Return the exact integral of the density along the motion [m].

        Parameters
        ----------
        first, last : ompl.base.State
            The motion's first and last state.
        """
        return Cost(self._cost(first, last))

    def motionCostHeuristic(self, first: base.State, last: base.State) -> base.Cost:
        """Return the least possible cost of the motion: its length with a density of 1 [m].

        Parameters
        ----------
        first, last : ompl.base.State
            The motion's first and last state.
        """
        return Cost(self._length(first, last))


class ClearMotionValidator(base.MotionValidator):
    """The exact check, in one call, whether one of the `motions` crosses free cells only."""

    def __init__(self, space_information: base.SpaceInformation, motions: Motions) -> None:
        # It must not keep the space information: the two would hold each other forever.
        super().__init__(space_information)
        self._cost = _make_cost_function(motions)

    def checkMotion(self, first: base.State, last: base.State) -> bool:
        """Return True if the motion between two states is free.

        Parameters
        ----------
        first, last : ompl.base.State
            The motion's first and last state.
        """
        return self._cost(first, last) < BLOCKED


def state_space(motions: Motions) -> base.StateSpace:
    """Return OMPL's space of the robot's states, bounded by the map [m].

    Parameters
    ----------
    motions : Motions
        The costmap, whose map gives the bounds, and the kind of motion.
    """
    kinds = {"R2": base.RealVectorStateSpace, "SE2": base.SE2StateSpace}
    kinds |= {"Dubins": base.DubinsStateSpace, "ReedsShepp": base.ReedsSheppStateSpace}
    arguments = {"R2": (2,), "SE2": ()}.get(motions.space, (motions.turning_radius,))
    space = kinds[motions.space](*arguments)
    rows, cols = motions.costs.grid.shape
    corners = motions.costs.grid.grid_to_world([0, rows, 0, rows], [0, 0, cols, cols])
    bounds = base.RealVectorBounds(2)
    for axis, values in enumerate(corners):
        bounds.setLow(axis, float(values.min()))
        bounds.setHigh(axis, float(values.max()))
    space.setBounds(bounds)
    return space


def space_information(motions: Motions) -> base.SpaceInformation:
    """Set up the state space with the checks whether states and motions are free.

    Parameters
    ----------
    motions : Motions
        The costmap and the kind of motion.
    """
    from locplan.planning.kernels.motions import can_stand

    pose, (half, columns, _, _, frame) = make_pose_reader(motions.space), motions.kernel_arguments

    def is_free(state: base.State) -> bool:
        x, y, _ = pose(state)
        return bool(can_stand(half, columns, frame, x, y))

    information = base.SpaceInformation(state_space(motions))
    information.setStateValidityChecker(is_free)
    information.setMotionValidator(ClearMotionValidator(information, motions))
    information.setup()
    return information


def problem_definition(
    information: base.SpaceInformation, motions: Motions, start: Position, goal: Position
) -> base.ProblemDefinition:
    """Make the problem of least J between two poses.

    Parameters
    ----------
    information : ompl.base.SpaceInformation
        What `space_information` made of the motions.
    motions : Motions
        The costmap and the kind of motion.
    start, goal : (x, y) or (x, y, heading)
        Poses in the world [m, rad], with a heading in all spaces but "R2".
    """
    problem = base.ProblemDefinition(information)
    ends = [state_from_pose(information, motions, pose) for pose in (start, goal)]
    problem.setStartAndGoalStates(*ends)
    objective = CostObjective(information, motions)
    bound = objective.motionCostHeuristic(*ends).value()
    objective.setCostThreshold(base.Cost(max(bound * (1 + OPTIMAL), OPTIMAL)))
    problem.setOptimizationObjective(objective)
    return problem


def state_from_pose(
    information: base.SpaceInformation, motions: Motions, pose: Position
) -> base.State:
    """Make a state of a pose.

    Parameters
    ----------
    information : ompl.base.SpaceInformation
        What `space_information` made of the motions.
    motions : Motions
        The costmap and the kind of motion.
    pose : (x, y) or (x, y, heading)
        Pose in the world [m, rad], with a heading in all spaces but "R2".
    """
    state = information.allocState()
    write_pose(state, motions.space, pose)
    return state


def write_pose(state: base.State, space: str, pose: Position) -> None:
    """Write a pose into a state of the space."""
    if space == "R2":
        state[0], state[1] = float(pose[0]), float(pose[1])
    else:
        state.setX(float(pose[0]))
        state.setY(float(pose[1]))
        state.setYaw(wrap_heading(float(pose[2])))


def make_pose_reader(space: str) -> Callable[[base.State], Pose]:
    """Make the function that reads a state as (x, y, heading); in "R2" the heading is 0."""
    if space == "R2":
        return lambda state: (state[0], state[1], 0.0)
    return lambda state: (state.getX(), state.getY(), state.getYaw())


def _make_cost_function(motions: Motions) -> Callable[[base.State, base.State], float]:
    """Make the function of J between two states, finite and fast: it is called all the time."""
    from locplan.planning.kernels.motions import compute_world_cost

    half, columns, kind, radius, frame = motions.kernel_arguments
    body = motions.collision_map

    def compute_cost_of_positions(state: base.State, other: base.State) -> float:
        start, end = (state[0], state[1], 0.0), (other[0], other[1], 0.0)
        return float(
            compute_world_cost(half, columns, kind, radius, frame, body, start, end, BLOCKED)
        )

    def compute_cost_of_poses(state: base.State, other: base.State) -> float:
        start = state.getX(), state.getY(), state.getYaw()
        end = other.getX(), other.getY(), other.getYaw()
        return float(
            compute_world_cost(half, columns, kind, radius, frame, body, start, end, BLOCKED)
        )

    return compute_cost_of_positions if motions.space == "R2" else compute_cost_of_poses


class SingleGoalWithHints(base.GoalSampleableRegion):
    """A goal whose samples are at first the positions of a path that leads there.

    Trees steer to samples of the goal from time to time; only in this way does
    OMPL take states from Python.
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
        """Return the distance from the goal [m]."""
        return math.hypot(state[0] - self._goal[0], state[1] - self._goal[1])

    def lead(
        self, tree: base.Planner, path: Floats, ends: Callable[[], bool]
    ) -> Callable[[], bool]:
        """Let a newly set-up tree first grow along a path (n, 2) [m]; return its new `ends`."""
        self._positions = list(map(tuple, subdivide_line(path, 0.1 * tree.getRange())[1:].tolist()))
        goal_bias = tree.getGoalBias()
        tree.setGoalBias(1.0)

        def stop_after_seeding() -> bool:
            if not self._leads:
                self._leads = True
            elif not self._positions:
                tree.setGoalBias(goal_bias)
            return ends()

        return stop_after_seeding

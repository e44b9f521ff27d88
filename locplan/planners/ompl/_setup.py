"""A costmap as OMPL sees it: state space, motion validator and objective.

A callback takes longer to enter than its kernel to run, so there is one for each motion and none
for the states along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from locplan.planners._spaces import wrapped
from locplan.planners.ompl._bindings import Cost, base
from locplan.planners.ompl._motions import Motions

BLOCKED = 1e15
"""J of a motion that is not free, for OMPL, some of whose planners crash on infinity [m]."""

OPTIMAL = 1e-6
"""A path this close to the straight line's length, relatively, ends a search.

The ellipse of informed sampling then has no area, and some planners would look for samples in it
for ever.
"""
Pose = tuple[float, float, float]


class CostObjective(base.PathLengthOptimizationObjective):
    """J of motions, with their length as a lower bound.

    Since it is a kind of path length to OMPL, informed planners sample the ellipse of that bound.
    Costs are finite and at least the length: a motion that is blocked costs `BLOCKED`.

    Parameters
    ----------
    space_information : ompl.base.SpaceInformation
        As `space_information` makes it.
    motions : Motions
        The costmap and the kind of motion.
    """

    def __init__(self, space_information: base.SpaceInformation, motions: Motions) -> None:
        super().__init__(space_information)
        self._cost = _cost_of(motions)
        self._length = space_information.getStateSpace().distance
        if motions.space == "SE2":  # where that counts turns
            self._length = _distance_of_positions

    def motionCost(self, state: base.State, other: base.State) -> base.Cost:
        """Exact integral of the density along the motion [m]."""
        return Cost(self._cost(state, other))

    def motionCostHeuristic(self, state: base.State, other: base.State) -> base.Cost:
        """Length of the motion as if all were free [m]: it cannot cost less."""
        return Cost(self._length(state, other))


class ClearMotionValidator(base.MotionValidator):
    """Whether a motion crosses free cells only, exactly, in one call.

    Parameters
    ----------
    space_information : ompl.base.SpaceInformation
        To be set up with this.
    motions : Motions
        The costmap, blocked for the robot's radius, and the kind of motion.
    """

    def __init__(self, space_information: base.SpaceInformation, motions: Motions) -> None:
        # It must not keep the space information: the two would hold each other for ever.
        super().__init__(space_information)
        self._cost = _cost_of(motions)

    def checkMotion(self, state: base.State, other: base.State) -> bool:
        """Whether the motion from one state to the other is free."""
        return self._cost(state, other) < BLOCKED


def state_space(motions: Motions) -> base.StateSpace:
    """OMPL's space of the robot's states, bounded by the map [m]."""
    radius = motions.turning_radius
    if motions.space == "R2":
        space = base.RealVectorStateSpace(2)
    elif motions.space == "SE2":
        space = base.SE2StateSpace()
    elif motions.space == "Dubins":
        space = base.DubinsStateSpace(radius)
    else:
        space = base.ReedsSheppStateSpace(radius)
    rows, cols = motions.costs.grid.shape
    corners = motions.costs.grid.grid_to_world([0, rows, 0, rows], [0, 0, cols, cols])
    bounds = base.RealVectorBounds(2)
    for axis, values in enumerate(corners):
        bounds.setLow(axis, float(values.min()))
        bounds.setHigh(axis, float(values.max()))
    space.setBounds(bounds)
    return space


def space_information(motions: Motions) -> base.SpaceInformation:
    """The state space with what decides whether states and motions are free, set up."""
    from locplan._kernels.motions import stands

    pose, (half, columns, _, _, frame) = pose_reader(motions.space), motions.arguments

    def is_free(state: base.State) -> bool:
        x, y, _ = pose(state)
        return bool(stands(half, columns, frame, x, y))

    information = base.SpaceInformation(state_space(motions))
    information.setStateValidityChecker(is_free)
    information.setMotionValidator(ClearMotionValidator(information, motions))
    information.setup()
    return information


def problem_definition(
    information: base.SpaceInformation,
    motions: Motions,
    start: Sequence[float],
    goal: Sequence[float],
) -> base.ProblemDefinition:
    """From a start to a goal, (x, y) or (x, y, heading) [m, rad], at the least J."""
    problem = base.ProblemDefinition(information)
    ends = [state_of(information, motions, pose) for pose in (start, goal)]
    problem.setStartAndGoalStates(*ends)
    objective = CostObjective(information, motions)
    bound = objective.motionCostHeuristic(*ends).value()
    objective.setCostThreshold(base.Cost(max(bound * (1 + OPTIMAL), OPTIMAL)))
    problem.setOptimizationObjective(objective)
    return problem


def state_of(
    information: base.SpaceInformation, motions: Motions, pose: Sequence[float]
) -> base.State:
    """A pose as a state."""
    state = information.allocState()
    write_pose(state, motions.space, pose)
    return state


def write_pose(state: base.State, space: str, pose: Sequence[float]) -> None:
    """Set a state."""
    if space == "R2":
        state[0], state[1] = float(pose[0]), float(pose[1])
    else:
        state.setX(float(pose[0]))
        state.setY(float(pose[1]))
        state.setYaw(wrapped(float(pose[2])))


def pose_reader(space: str) -> Callable[[base.State], Pose]:
    """What reads a state of the space as (x, y, heading); in "R2" the heading is 0."""
    if space == "R2":
        return lambda state: (state[0], state[1], 0.0)
    return lambda state: (state.getX(), state.getY(), state.getYaw())


def poses_of(path: base.Path, space: str) -> np.ndarray:
    """The states (n, 3) of one of OMPL's paths."""
    pose = pose_reader(space)
    return np.array([pose(path.getState(n)) for n in range(path.getStateCount())])


def _cost_of(motions: Motions) -> Callable[[base.State, base.State], float]:
    """J of the motion between two states, finite. Written for speed: it is called all the time."""
    from locplan._kernels.motions import world_cost

    half, columns, kind, radius, frame = motions.arguments

    def between_positions(state: base.State, other: base.State) -> float:
        x0, y0, x1, y1 = state[0], state[1], other[0], other[1]
        return float(
            world_cost(half, columns, kind, radius, frame, x0, y0, 0.0, x1, y1, 0.0, BLOCKED)
        )

    def between_poses(state: base.State, other: base.State) -> float:
        start = state.getX(), state.getY(), state.getYaw()
        end = other.getX(), other.getY(), other.getYaw()
        return float(world_cost(half, columns, kind, radius, frame, *start, *end, BLOCKED))

    return between_positions if motions.space == "R2" else between_poses


def _distance_of_positions(state: base.State, other: base.State) -> float:
    return math.hypot(state.getX() - other.getX(), state.getY() - other.getY())

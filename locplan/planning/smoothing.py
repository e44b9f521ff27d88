"""Paths straightened by curves that the robot can drive, and shifted to reduce their cost."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap, check_costs
from locplan.planning.path import Path
from locplan.planning.protocol import Position
from locplan.robots.parts import Kinematics
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.planning.kernels.smoothing import MotionModel

REVERSE, GEAR_CHANGE, TURN = 2.0, 0.5, 0.3
"""Default prices: factor on the cost in reverse and sideways, a change of the gear [m], and a turn
on the spot [m/rad]."""
SPOT = 1e-4
"""Turning radius that stands for turns on the spot [cells]."""
LOOKAHEAD = 60
"""Maximum number of knots that one curve may replace."""
ROUNDS = 3
"""Rounds of shifts, each followed by straightening."""


def smooth_path(
    costs: Costmap,
    path: Path,
    robot: Robot | None = None,
    *,
    reverse: float = REVERSE,
    gear_change: float = GEAR_CHANGE,
    turn_cost: float = TURN,
) -> Path:
    """Smooth a path of any planner by curves that the robot can drive.

    The curves are by Dubins, or by Reeds and Shepp for a robot that drives in reverse. The
    result costs no more than the path, keeps the turning radius, and its outline meets no wall;
    otherwise the path is returned unchanged.

    Parameters
    ----------
    costs : Costmap
        The costmap, whose density is integrated.
    path : Path
        The path; without headings it is driven forward.
    robot : Robot, optional
        The robot, by default the costmap's; without one it turns on the spot.
    reverse : float, default 2.0
        Factor on the cost of driving in reverse or sideways, above 1.
    gear_change : float, default 0.5
        Cost of changing between forward and reverse, >= 0 [m].
    turn_cost : float, default 0.3
        Cost of turning on the spot, above 0 [m/rad].

    Returns
    -------
    Path
        The path with headings, from the same start to the same goal.
    """
    check_costs(costs)
    smoother = PathSmoother(costs, robot or costs.robot, reverse, gear_change, turn_cost)
    return smoother.smooth(path, None, None)


class PathSmoother:
    """What smooths the paths of a robot on a costmap."""

    def __init__(
        self,
        costs: Costmap,
        robot: Robot | None,
        reverse: float,
        gear_change: float,
        turn_cost: float,
    ) -> None:
        from locplan._support.kernels.outlines import CollisionMap, sum_occupied_along_rows
        from locplan._support.kernels.search import make_bordered_half_density
        from locplan.planning.kernels.curves import DUBINS, REEDS_SHEPP
        from locplan.planning.kernels.motions import MotionCostmap
        from locplan.planning.kernels.smoothing import MotionModel

        grid, self._costs = costs.grid, costs
        kinematics = robot.kinematics if robot else Kinematics()
        self._outline = robot.outline if robot else None
        half = np.array(
            [make_bordered_half_density(layer, 1) for layer in costs.density_of_heading]
        )
        self._ground = MotionCostmap(half, grid.shape[1] + 2, -grid.origin[2], False)
        on_spot = kinematics.turning_radius == 0
        self._drive: MotionModel = MotionModel(
            REEDS_SHEPP if kinematics.reverse else DUBINS,
            SPOT if on_spot else kinematics.turning_radius / grid.resolution,
            kinematics.drive == "omnidirectional",
            reverse,
            gear_change / grid.resolution,
            turn_cost / grid.resolution if on_spot else 0.0,
        )
        corners = self._outline.vertices / grid.resolution if self._outline else np.empty((0, 2))
        self._body: CollisionMap = CollisionMap(
            sum_occupied_along_rows(grid.cells == OCCUPIED), corners
        )

    def smooth(self, path: Path, start: Position | None, goal: Position | None) -> Path:
        """Return a path smoothed, or itself; it ends at start and goal if curves lead there."""
        poses = self._grid_from_path(path)
        improved_poses = self._find_better_poses(self._add_ends(poses, start, goal))
        if improved_poses is None and (start or goal):
            improved_poses = self._find_better_poses(poses)
        if improved_poses is None:
            return path
        world_path = self._path_from_grid(improved_poses)
        if (
            self._outline
            and self._outline.find_first_collision(self._costs.grid, world_path) is not None
        ):
            return path
        return world_path

    def cost(self, poses: Floats) -> float:
        """Return the cost of poses (n, 3) on the bordered grid, with all prices [cells]."""
        from locplan.planning.kernels.smoothing import compute_step_costs

        return float(compute_step_costs(self._ground, self._drive, poses).sum())

    def _find_better_poses(self, poses: Floats) -> Floats | None:
        """Return better poses, or None if there are none."""
        best, lowest_cost = None, self.cost(poses)
        step, turn = 1.5, 0.2
        poses = self._straighten_by_chain(poses)
        for _ in range(ROUNDS + 1):
            if len(poses) < 2:
                break
            cost = self.cost(poses)
            if cost < lowest_cost * (1 - 1e-9):
                best, lowest_cost = poses, cost
            shifted = self._shift_knots(poses, (step, turn))
            poses = poses if shifted is poses else self._straighten_by_chain(shifted)
            step, turn = 0.6 * step, 0.6 * turn
        return best

    def _straighten_by_chain(self, poses: Floats) -> Floats:
        """Return poses along the cheapest chain of curves; empty without a chain."""
        from locplan.planning.kernels.smoothing import find_cheapest_chain

        if len(poses) < 2:
            return poses
        at = self._choose_knots(poses, max(2.0, 0.25 * self._drive.radius))
        step_costs = np.add.reduceat(self._compute_step_costs(poses), at[:-1])
        chain = find_cheapest_chain(
            self._ground, self._drive, self._body, poses[at], step_costs, LOOKAHEAD
        )
        pieces, last = [], len(at) - 1
        while last > 0:
            before = int(chain[last])
            if before == -1:
                return poses[:0]
            if before >= 0:
                pieces.append(self._sample_curve(poses[at[before]], poses[at[last]])[1:])
            else:
                before = -2 - before
                pieces.append(poses[at[before] + 1 : at[last] + 1])
            last = before
        return np.concatenate([poses[:1], *pieces[::-1]])

    def _shift_knots(self, poses: Floats, steps: tuple[float, float]) -> Floats:
        """Shift knots to positions of lower cost; return the poses unchanged without gain."""
        from locplan.planning.kernels.smoothing import shift_knots

        at = self._choose_knots(poses, max(3.0, 0.75 * self._drive.radius))
        step_costs = np.add.reduceat(self._compute_step_costs(poses), at[:-1])
        knots, curved = poses[at].copy(), np.zeros(len(step_costs), bool)
        shift_knots(self._ground, self._drive, self._body, knots, step_costs, curved, steps)
        if not curved.any():
            return poses
        pieces = [
            self._sample_curve(knots[n], knots[n + 1])[1:] if curved[n] else poses[a + 1 : b + 1]
            for n, (a, b) in enumerate(itertools.pairwise(at.tolist()))
        ]
        return np.concatenate([poses[:1], *pieces])

    def _compute_step_costs(self, poses: Floats) -> Floats:
        from locplan.planning.kernels.smoothing import compute_step_costs

        return np.asarray(compute_step_costs(self._ground, self._drive, poses))

    def _choose_knots(self, poses: Floats, spacing: float) -> Ints:
        """Return knots of poses at least a spacing [cells], or a quarter of a radian, apart."""
        steps = np.diff(poses, axis=0)
        turn = np.abs(np.remainder(steps[:, 2] + math.pi, 2 * math.pi) - math.pi)
        still = np.hypot(*steps[:, :2].T) < 1e-3
        way = np.hypot(*steps[:, :2].T) / spacing + np.where(still, 4 * turn, 0.0)
        along = np.concatenate([[0.0], np.cumsum(way)])
        is_knot = np.concatenate([[True], np.diff(np.floor(along)) > 0])
        is_knot[-1] = True
        return np.flatnonzero(is_knot)

    def _sample_curve(self, start: Floats, end: Floats) -> Floats:
        from locplan.planning.kernels.motions import sample_motion_poses

        ends = tuple(start.tolist()), tuple(end.tolist())
        return np.asarray(sample_motion_poses(self._drive.kind, self._drive.radius, *ends))

    def _add_ends(self, poses: Floats, start: Position | None, goal: Position | None) -> Floats:
        """Add the true ends before and after poses; a missing heading is taken from the poses."""
        for pose, place, at in ((start, 0, 0), (goal, -1, None)):
            if pose is not None:
                row, col = self._costs.grid.world_to_grid(*pose[:2])
                yaw = self._costs.grid.origin[2]
                heading = pose[2] - yaw if len(pose) == 3 else poses[place, 2]
                index = len(poses) if at is None else at
                poses = np.insert(poses, index, (float(col) + 1, float(row) + 1, heading), axis=0)
        return poses

    def _grid_from_path(self, path: Path) -> Floats:
        """Return poses on the bordered grid; without headings, with turns where lines meet."""
        x, y, heading = path.drive_poses.T
        row, col = self._costs.grid.world_to_grid(x, y)
        return np.column_stack([col + 1, row + 1, heading - self._costs.grid.origin[2]])

    def _path_from_grid(self, poses: Floats) -> Path:
        grid = self._costs.grid
        x, y = grid.grid_to_world(poses[:, 1] - 1, poses[:, 0] - 1)
        return Path(np.column_stack([x, y]), poses[:, 2] + grid.origin[2])

"""The costs of motions between poses: straight lines, Dubins' and Reeds-Shepp curves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan.errors import ConfigError
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.protocol import CURVED, check_pose, check_space

MIN_RADIUS, MAX_RADIUS = 0.01, 10.0
"""Limits of the turning radius, in cells and in diagonals of the map; beyond, it is of no use."""


@dataclass(frozen=True, eq=False)
class Motions:
    """The motions of a robot between two poses (x, y, heading) in the world [m, m, rad].

    A motion's cost is the exact integral of the costmap's density along its true curve, found in
    one compiled call. In "R2" headings do not count; in all spaces with headings the density for
    the heading counts if the costmap has several, and the outline of the costmap's robot must
    meet no occupied cell.

    Raises
    ------
    ConfigError
        If the space is unknown, or the turning radius is missing, useless or out of its range.

    Examples
    --------
    >>> from locplan.maps import FREE, OccupancyGrid
    >>> costs = Costmap.blank(OccupancyGrid(np.full((8, 8), FREE), resolution=1.0))
    >>> turn = Motions(costs, "Dubins", turning_radius=2.0)
    >>> round(turn.cost((1.0, 2.0, 0.0), (1.0, 6.0, math.pi)), 3)  # half a circle
    6.283
    >>> turn.cost((1.0, 2.0, 0.0), (7.5, 6.0, 0.0)) < turn.cost((1.0, 2.0, 0.0), (7.5, 6.0, 3.0))
    True
    """

    costs: Costmap = field(repr=False)
    """The costmap that the robot moves on."""
    space: str = "R2"
    """The space, "R2", "SE2", "Dubins" or "ReedsShepp"."""
    turning_radius: float | None = None
    """Minimum radius of the curves [m], from a hundredth of a cell to ten diagonals of the map;
    "Dubins" and "ReedsShepp" need it, the others have none."""

    def __post_init__(self) -> None:
        check_space(self.space, self.turning_radius)
        if self.turning_radius is None:
            return
        grid = self.costs.grid
        min_radius, greatest = (
            MIN_RADIUS * grid.resolution,
            math.hypot(*grid.shape) * grid.resolution,
        )
        if not min_radius <= self.turning_radius <= MAX_RADIUS * greatest:
            raise ConfigError(
                f"turning_radius must lie in {min_radius:g}..{MAX_RADIUS * greatest:.4g} m"
                f" on this map, not {self.turning_radius:g}"
            )

    def validate_pose(self, pose: Sequence[float], role: str) -> tuple[float, ...]:
        """Return a pose as numbers, its heading in -pi..pi.

        Parameters
        ----------
        pose : (x, y) or (x, y, heading)
            Pose in the world [m, rad], with a heading in all spaces but "R2".
        role : str
            The word for the pose in errors, such as "start".

        Raises
        ------
        PoseError
            If the robot cannot stand there, or a heading is missing or not wanted.
        """
        return check_pose(self.costs, pose, role, has_heading=self.space != "R2")

    def cost(self, start: Sequence[float], end: Sequence[float]) -> float:
        """Return the cost J of the motion from one pose to another [m]; infinite if it is blocked.

        Parameters
        ----------
        start, end : (x, y) or (x, y, heading)
            Poses in the world [m, rad]; a heading that is left out is 0.
        """
        from locplan.planning.kernels.motions import compute_world_cost

        return float(
            compute_world_cost(
                *self.kernel_arguments,
                self.collision_map,
                _complete_pose(start),
                _complete_pose(end),
                math.inf,
            )
        )

    def is_free(self, x: float, y: float) -> bool:
        """Return whether the robot can stand at a position.

        Parameters
        ----------
        x, y : float
            The position in the world [m].
        """
        from locplan.planning.kernels.motions import can_stand

        half, columns, _, _, frame = self.kernel_arguments
        return bool(can_stand(half, columns, frame, float(x), float(y)))

    def meets_wall(self, pose: Sequence[float]) -> bool:
        """True if the outline of the costmap's robot meets a wall at a pose; never in "R2".

        Parameters
        ----------
        pose : (x, y, heading)
            The pose in the world [m, rad].
        """
        robot = self.costs.robot
        if self.space == "R2" or robot is None or robot.outline is None:
            return False
        return robot.outline.find_collisions(self.costs.grid, np.array([pose, pose])).size > 0

    def compute_motion_costs(self, poses: Floats, pairs: Ints) -> Floats:
        """Return the costs J of motions between pairs of poses.

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading of each pose in the world [m, m, rad].
        pairs : (m, 2) array of int
            Indices of the first and the last pose of each motion.

        Returns
        -------
        (m,) array
            Cost of each motion [m]; infinite if it is blocked.
        """
        from locplan.planning.kernels.motions import compute_world_costs

        return np.asarray(
            compute_world_costs(*self.kernel_arguments, self.collision_map, poses, pairs)
        )

    def path(self, poses: Floats) -> Path:
        """Return the path of the motions through poses; its lines cross the cells of the curves.

        Parameters
        ----------
        poses : (n, 3) array
            x, y and heading of each pose in the world, n >= 2 [m, m, rad].
        """
        from locplan.planning.kernels.motions import sample_world_motion

        if self.space == "R2":
            return Path(poses[:, :2])
        if self.space in CURVED:
            pieces = [
                sample_world_motion(
                    *self.kernel_arguments[2:], _complete_pose(start), _complete_pose(end)
                )
                for start, end in itertools.pairwise(poses)
            ]
            poses = np.vstack([poses[:1], *(piece[1:] for piece in pieces)])
        return Path(poses[:, :2], poses[:, 2])

    @cached_property
    def collision_map(self) -> Any:
        """The outline of the costmap's robot for the kernels; none in "R2", and of a circle."""
        from locplan._support.kernels.outlines import CollisionMap, sum_occupied_along_rows

        robot, grid = self.costs.robot, self.costs.grid
        if robot is None or robot.outline is None or self.space == "R2":
            return CollisionMap(np.empty((0, 1), np.int32), np.empty((0, 2)))
        return CollisionMap(
            sum_occupied_along_rows(grid.cells == OCCUPIED),
            robot.outline.vertices / grid.resolution,
        )

    @cached_property
    def kernel_arguments(self) -> tuple[Any, ...]:
        """The kernels' arguments: the bordered grid, the kind and radius of curves, the frame."""
        from locplan._support.kernels.search import make_bordered_half_density
        from locplan.planning.kernels.curves import DUBINS, REEDS_SHEPP, STRAIGHT

        grid = self.costs.grid
        x, y, yaw = grid.origin
        along, across = math.cos(yaw) / grid.resolution, math.sin(yaw) / grid.resolution
        frame = along, across, 1 - along * x - across * y, 1 - along * y + across * x, yaw
        kind = {"Dubins": DUBINS, "ReedsShepp": REEDS_SHEPP}.get(self.space, STRAIGHT)
        radius = (self.turning_radius or grid.resolution) / grid.resolution
        # Without a heading the merged cost counts.
        density = self.costs.density[None] if self.space == "R2" else self.costs.density_of_heading
        half = np.array([make_bordered_half_density(layer, 1) for layer in density])
        return half, grid.shape[1] + 2, kind, radius, frame


def _complete_pose(pose: Iterable[float]) -> tuple[float, float, float]:
    """Return a pose as three floats; without a heading, that is 0."""
    x, y, heading = map(float, (*pose, 0.0)[:3])
    return x, y, heading

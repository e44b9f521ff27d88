"""Whether an object would cut a passage for the robot."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locplan._util.windows import window_around
from locplan.landmarks._objects import Shape
from locplan.maps import OccupancyGrid

AROUND = 3.0
"""Distance from an object within which the robot must get from one side to the other [m]."""
POCKET = 0.25
"""Area of free space that may be closed off, since it is no passage [m^2]."""

Pose = NDArray[np.float64]
"""Row, column and heading on the map, (3,) [cells, cells, rad]."""


class Passages:
    """The space where the centre of a robot can be, beside the objects that were placed.

    A passage is cut if what hung together within `AROUND` of an object no longer does: for the
    robot alone, since it may have to pass a narrow door, or for the robot with a margin.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    shape : Shape
        Outline of the objects.
    robot_radius, margin : float
        Radius of the robot, and the distance that it keeps besides [m].
    """

    def __init__(
        self, grid: OccupancyGrid, shape: Shape, robot_radius: float, margin: float
    ) -> None:
        self.shape, self.resolution = shape, grid.resolution
        self.radii = sorted({robot_radius, robot_radius + margin})
        self.open = [grid.free & ~grid.closer_than(radius - 1e-9) for radius in self.radii]

    def place(self, pose: Pose) -> None:
        """Close the space around an object that stands from now on."""
        for space, radius in zip(self.open, self.radii, strict=True):
            window, closed = self._closed(pose, radius, 0.0)
            space[window] &= ~closed

    def copy(self) -> Passages:
        """Copy in which other objects can be placed."""
        other = object.__new__(Passages)
        other.shape, other.resolution, other.radii = self.shape, self.resolution, self.radii
        other.open = [space.copy() for space in self.open]
        return other

    def cuts(self, pose: Pose) -> bool:
        """Whether an object at a pose would cut a passage."""
        return any(
            self._cuts(space, radius, pose, 2 * self.resolution)
            and self._cuts(space, radius, pose, AROUND)  # the narrow look settles nearly all
            for space, radius in zip(self.open, self.radii, strict=True)
        )

    def _cuts(self, space: NDArray[np.bool_], radius: float, pose: Pose, around: float) -> bool:
        import cv2

        window, closed = self._closed(pose, radius, around)
        before = space[window]
        touched = closed & before
        if not touched.any():
            return False
        after = before & ~closed
        _, parts, about, _ = cv2.connectedComponentsWithStats(
            after.astype(np.uint8), connectivity=4
        )
        least = POCKET / self.resolution**2 if around >= AROUND else 0
        large = np.flatnonzero(about[:, cv2.CC_STAT_AREA] >= least)
        large = large[large > 0]
        if large.size < 2:
            return False
        _, joined = cv2.connectedComponents(before.astype(np.uint8), connectivity=4)
        within = np.unique(joined[touched])
        owners = [joined[parts == part][0] for part in large.tolist()]
        return any(owners.count(each) > 1 for each in within.tolist())

    def _closed(
        self, pose: Pose, radius: float, around: float
    ) -> tuple[tuple[slice, slice], NDArray[np.bool_]]:
        """A window on the map, and where in it the robot would be nearer than a radius [m]."""
        row, col, heading = pose.tolist()
        reach = math.ceil((self.shape.reach + radius + around) / self.resolution) + 1
        rows, cols = window_around(row, col, reach, (self.open[0].shape[0], self.open[0].shape[1]))
        y = (np.arange(rows.start, rows.stop) + 0.5 - row) * self.resolution
        x = (np.arange(cols.start, cols.stop) + 0.5 - col) * self.resolution
        near = self.shape.distance(x[None, :], y[:, None], heading) < radius - 1e-9
        return (rows, cols), near

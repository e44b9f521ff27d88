"""A path of any planner checked for a robot: its outline, its turning radius, and its drive."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from locplan._support.kernels.arrays import Array, Bools, Floats
from locplan._support.output import ResultFiles
from locplan._support.records import POSE, Result, Table, TableColumn
from locplan._support.saved import EqualByValue
from locplan._support.tables import nan_to_none
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import path_cost
from locplan.planning.path import AnyPath, Path, as_path
from locplan.robots.parts import Footprint
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CORNERS = 32
"""Number of corners of the polygon around a circle, which is at most 0.5 % larger."""
EXACT = 1e-3
"""Distance up to which the clearance is searched for [m]."""
TIGHT = 0.01
"""Share by which a turn may be tighter than the turning radius."""


@dataclass(frozen=True)
class PathFault:
    """A stretch of a path that the robot cannot drive."""

    kind: Literal["collision", "tight turn", "reverse"]
    """Its outline meets a wall, it turns on less than its radius, or it does not drive back."""
    x: float
    """World x where it begins [m]."""
    y: float
    """World y where it begins [m]."""
    heading: float
    """Heading there [rad]."""
    along: float
    """Distance travelled up to there [m]."""
    length: float
    """Length of the stretch [m]; 0 for a turn on the spot."""


@dataclass(frozen=True, eq=False, repr=False)
class PathCheck(Result, EqualByValue):
    """What a robot's outline meets along a path, and whether the robot can drive it.

    `save` writes path-check.json, a picture, and path-check.csv with the faults.
    """

    files: ClassVar[ResultFiles] = ResultFiles(
        "path-check", ("path-check.json", "path-check.png", "path-check.csv")
    )
    columns: ClassVar[tuple[TableColumn, ...]] = (
        TableColumn("kind", title="fault"),
        *POSE,
        TableColumn("along", "m", "along"),
        TableColumn("length", "m", "length"),
    )
    grid: OccupancyGrid = field(compare=False)
    """The map."""
    path: Path
    """The path, with headings: where it had none the robot heads along each line."""
    outline: Footprint
    """The outline; of a circle a polygon around it."""
    length: float
    """Length of the path [m]."""
    cost: float
    """J on the costmap that was given [m]; NaN without one."""
    least_radius: float
    """Least radius on which it turns [m]; 0 on the spot, infinite without a turn."""
    clearance: float
    """Least distance of the outline from an occupied cell [m]; 0 where it meets one. It may be 1 mm
    or 0.5 % too small."""
    swept: Bools = field(compare=False)
    """Cells of the map that the outline sweeps, (H, W)."""
    faults: tuple[PathFault, ...]
    """Stretches that the robot cannot drive, in their order along the path; none where it can."""

    def __repr__(self) -> str:
        return f"PathCheck({self._format_totals()})"

    @property
    def drivable(self) -> bool:
        """True if the robot can drive the path."""
        return not self.faults

    def summary(self) -> dict[str, object]:
        """Return the figures and the faults, fit for JSON."""
        names = "drivable", "length", "cost", "least_radius", "clearance"
        record: dict[str, object] = {name: getattr(self, name) for name in names}
        record["swept_area"] = float(self.swept.sum()) * self.grid.resolution**2
        return nan_to_none({**record, "faults": self.table().records()})

    def table(self) -> Table:
        """Return the faults, a row each."""
        return Table.from_records(self.columns, self.faults)

    def report(self) -> str:
        """Return the figures as text, and the faults below them."""
        return f"{self._format_totals()}\n{self.table()}" if self.faults else self._format_totals()

    def _format_totals(self) -> str:
        kinds = [fault.kind for fault in self.faults]
        counted = ", ".join(f"{kind} {kinds.count(kind)}x" for kind in dict.fromkeys(kinds))
        cost = "" if math.isnan(self.cost) else f", cost {self.cost:.2f} m"
        turns = math.isfinite(self.least_radius)
        return (
            f"{counted or 'drivable'}: {self.length:.2f} m long{cost},"
            f" {f'least radius {self.least_radius:.2f} m' if turns else 'no turn'},"
            f" clearance of the outline {self.clearance:.3f} m"
        )

    def figure(self) -> Figure:
        """Draw the robot's outline along the path, in red at places it cannot drive."""
        from locplan.planning.figures import path_check_figure

        return path_check_figure(self)


def check_path(
    grid: OccupancyGrid, path: AnyPath, robot: Robot, *, costs: Costmap | None = None
) -> PathCheck:
    """Check whether a robot can drive a path that any planner made.

    Its outline must meet no occupied cell, the path turn on no less than its turning radius, and
    never lead back if the robot cannot drive in reverse. Plans of Nav2, such as Smac's, can be
    given as they were published.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    path : Path, Plan, or (n, 2) or (n, 3) array
        Positions in the world, with headings or without [m, m, rad]. Without headings the robot
        heads along each line and turns on the spot where two meet.
    robot : Robot
        The robot; its margin does not count.
    costs : Costmap, optional
        The costmap, for J.

    Returns
    -------
    PathCheck
        The least radius, the clearance, the swept cells, J, and the places it cannot drive.

    Raises
    ------
    ConfigError
        If it is no robot, or the costmap is of another map.
    LocplanError
        If the path is none.

    Examples
    --------
    >>> from locplan.maps import FREE
    >>> grid = OccupancyGrid(np.full((20, 40), FREE), resolution=0.1)
    >>> robot = Robot(footprint=Footprint([(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)]))
    >>> check_path(grid, [(0.5, 1.0), (3.0, 1.0)], robot).drivable
    True
    """
    check_grid(grid)
    if not isinstance(robot, Robot):
        raise ConfigError(f"robot must be a locplan.Robot, not {type(robot).__name__}")
    if costs is not None and costs.grid != grid:
        raise ConfigError("the costmap is of another map than the one that is given")
    path = as_path(path)
    poses = path.drive_poses
    drive_path = Path(poses[:, :2], poses[:, 2])
    outline = make_outline(robot)
    faults = find_path_faults(grid, drive_path, robot)
    collides = any(fault.kind == "collision" for fault in faults)
    return PathCheck(
        grid=grid,
        path=drive_path,
        outline=outline,
        length=path.length,
        cost=math.nan if costs is None else path_cost(costs, path),
        least_radius=float(_compute_turning_radii(poses).min(initial=math.inf)),
        clearance=0.0 if collides else _measure_clearance(grid, outline, poses),
        swept=_sweep_outline(grid, outline, poses),
        faults=faults,
    )


def find_path_faults(grid: OccupancyGrid, path: Path, robot: Robot) -> tuple[PathFault, ...]:
    """Find the places on a path that a robot cannot drive, without the rest of `check_path`.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    path : Path
        The path; without headings the robot heads along each line and turns where two meet.
    robot : Robot
        The robot.

    Returns
    -------
    tuple of PathFault
        In their order along the path; none if it can be driven.
    """
    poses, kinematics = path.drive_poses, robot.kinematics
    drive_path = Path(poses[:, :2], poses[:, 2])
    tight = _compute_turning_radii(poses) < kinematics.turning_radius * (1 - TIGHT)
    backward = (_compute_travel_cosines(poses) < -0.5) & (not kinematics.reverse)
    faults = [
        *_merge_faults("collision", make_outline(robot).find_collisions(grid, poses), drive_path),
        *_merge_faults("tight turn", np.flatnonzero(tight), drive_path),
        *_merge_faults("reverse", np.flatnonzero(backward), drive_path),
    ]
    return tuple(sorted(faults, key=lambda fault: (fault.along, fault.kind)))


def make_outline(robot: Robot) -> Footprint:
    """Return the outline without a margin: a polygon around a circle, a tiny one around a point."""
    return robot.outline or grow_outline(np.zeros((1, 2)), max(1e-6, robot.radius - robot.margin))


def grow_outline(corners: Floats, distance: float) -> Footprint:
    """Return an outline that encloses all points within a distance [m] of a convex one."""
    angles = 2 * math.pi * np.arange(CORNERS) / CORNERS
    circle = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(math.pi / CORNERS)
    return Footprint((corners[:, None] + distance * circle).reshape(-1, 2))


def _compute_turning_radii(poses: Floats) -> Floats:
    """Return the radius of each line between poses [m]; infinite if it does not turn."""
    turn = np.abs(np.remainder(np.diff(poses[:, 2]) + math.pi, 2 * math.pi) - math.pi)
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    turning = turn > 1e-6
    chord = 2 * np.sin(np.where(turning, turn, 1.0) / 2)
    return np.where(turning, length / chord, math.inf)


def _compute_travel_cosines(poses: Floats) -> Floats:
    """Return the cosine between heading and direction of each line between poses; 0 on the spot."""
    step, heading = np.diff(poses[:, :2], axis=0), np.unwrap(poses[:, 2])
    middle = (heading[1:] + heading[:-1]) / 2
    along = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    length = np.hypot(*step.T)
    return np.asarray(np.divide(along, length, out=np.zeros_like(along), where=length > 1e-6))


def _merge_faults(
    kind: Literal["collision", "tight turn", "reverse"], lines: Array, path: Path
) -> list[PathFault]:
    """Return the faults of lines between poses; adjacent faults are merged."""
    faults = []
    runs = np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1)
    for run in runs if len(lines) else ():
        begin_index, end_index = int(run[0]), int(run[-1]) + 1
        begin, end = path.distance[[begin_index, end_index]].tolist()
        x, y, heading = path.poses[begin_index].tolist()
        faults.append(PathFault(kind, x, y, heading, begin, end - begin))
    return faults


def _measure_clearance(grid: OccupancyGrid, outline: Footprint, poses: Floats) -> float:
    """Return the least distance from walls of an outline that meets none [m]."""
    if not (grid.cells == OCCUPIED).any():
        return math.inf

    def hits_wall(distance: float) -> bool:
        return (
            grow_outline(outline.vertices, distance).find_first_collision(grid, poses) is not None
        )

    doubled = itertools.accumulate(itertools.repeat(2.0), lambda by, two: by * two, initial=0.1)
    high = next(by for by in doubled if by > 1e6 or hits_wall(by))
    low = 0.0
    while high - low > EXACT:
        middle = (low + high) / 2
        low, high = (low, middle) if hits_wall(middle) else (middle, high)
    return low


def _sweep_outline(grid: OccupancyGrid, outline: Footprint, poses: Floats) -> Bools:
    """Return the cells of the map that an outline sweeps, (H, W)."""
    from locplan._support.kernels.outlines import find_swept_cells

    row, col = grid.world_to_grid(*poses[:, :2].T)
    local = np.column_stack([col, row, poses[:, 2] - grid.origin[2]])
    middle = np.floor((local[:, :2].max(axis=0) + local[:, :2].min(axis=0)) / 2)
    local[:, :2] -= middle
    body = outline.circumscribed_radius / grid.resolution
    reach = math.ceil(np.abs(local[:, :2]).max() + body) + 2
    met = np.argwhere(find_swept_cells(outline.vertices / grid.resolution, local, reach))
    row, col = (met - reach + middle[::-1].astype(int)).T
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    is_swept = np.zeros(grid.shape, bool)
    is_swept[row[inside], col[inside]] = True
    return is_swept

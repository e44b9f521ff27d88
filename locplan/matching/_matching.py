"""How scans are matched: with the whole map by losses of beams' ends, or about a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Bools, Floats
from locplan._util.checks import Settings, instance, positive, setting
from locplan._util.poses import ends_in_map, turning
from locplan.errors import ConfigError
from locplan.field import Scan, wall_cells
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Lidar

TURNS = 96
"""Number of beams all round, and of turns, at which a scan is compared with the map."""
STEP = 2 * math.pi / TURNS
"""Angle from one beam to the next [rad]."""
GLOBAL_EFFECTIVE_BEAMS = 36.0
"""Number of independent beams of a full circle, fitted to global matches of simulated scans."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Matching(Settings):
    """How the scan of a lidar is matched with a whole map.

    A pose's loss is ``global_effective_beams / 96`` times the sum over the beams that return of
    ``-ln((1 - z_rand) exp(-D^2 / 2 sigma_hit^2) + z_rand)``, D the distance of the beam's end from
    the nearest wall. The beams are 96 all round; a lidar of a narrower view has fewer of them.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """

    lidar: Lidar
    """The lidar: its range, field of view and mount; its number of beams does not matter."""
    global_effective_beams: float = setting(GLOBAL_EFFECTIVE_BEAMS, positive, "beams")
    """Number of independent beams that count as much as 96 all round, above 0."""
    sigma_hit: float = setting(0.1, positive, "m")
    """Standard deviation of the distance of a beam's end from a wall [m], above 0; it counts as at
    least a cell."""
    z_rand: float = setting(0.05, positive)
    """Share of the beams that end anywhere, above 0 and below 1."""
    robot_radius: float = setting(0.25, 0.0)
    """Distance from walls at which a pose is possible [m], >= 0."""
    shortlisted: int = setting(600, 1, 100_000)
    """Number of pairs of a place and a turn that are refined, before alike ones are dropped, 1 to
    100,000."""

    def __post_init__(self) -> None:
        instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        super().__post_init__()
        if self.z_rand >= 1:
            raise ConfigError(f"z_rand must be below 1, not {self.z_rand:g}")

    def sigmas(self, resolution: float) -> Floats:
        """Deviations at which a pose is refined, one after the other, at least a cell [m].

        Parameters
        ----------
        resolution : float
            Edge of the map's cells [m].
        """
        levels = [max(factor * self.sigma_hit, resolution) for factor in (4, 2, 1)]
        return np.array(sorted(set(levels), reverse=True))

    @property
    def bearings(self) -> Floats:
        """Directions of the beams that are compared, from the robot's front, (96,) [rad]."""
        return np.arange(TURNS, dtype=np.float64) * STEP

    @property
    def seen(self) -> Bools:
        """Mask of these beams that lie in the lidar's field of view, (96,)."""
        aside = (self.bearings - self.lidar.mount_yaw + math.pi) % (2 * math.pi) - math.pi
        half = math.radians(self.lidar.field_of_view_deg) / 2
        return np.asarray(np.abs(aside) <= half + 1e-9)

    def compared(self, ranges: Floats) -> Floats:
        """Ranges of scans at `bearings`.

        Parameters
        ----------
        ranges : (n, beams) array
            Distances along all the lidar's beams [m], in the order of ``lidar.angles``.

        Returns
        -------
        (n, 96) array
            Range of the beam next to each bearing, which errs as much as any [m]: infinite without
            a return, which is what a range below the least or beyond the greatest one is, and NaN
            out of the view.
        """
        beams = self.lidar.angles + self.lidar.mount_yaw
        aside = (self.bearings[:, None] - beams + math.pi) % (2 * math.pi) - math.pi
        chosen = ranges[:, np.abs(aside).argmin(axis=1)]
        returns = (chosen > self.lidar.min_range) & (chosen <= self.lidar.range)
        return np.where(self.seen, np.where(returns, chosen, np.inf), np.nan)

    def beams(self, forward: float, left: float) -> Any:
        """The beams that are compared, of a lidar so mounted, as the kernels take them.

        Parameters
        ----------
        forward, left : float
            Mount of the lidar ahead and to the left of the robot's centre [m].
        """
        mounted = {"forward": forward, "left": left, "yaw": 0.0}
        return self.lidar.for_kernels()._replace(angles=self.bearings, **mounted)

    @property
    def nats_a_loss(self) -> float:
        """Nats of the greatest loss of one beam."""
        return -math.log(self.z_rand) * self.global_effective_beams / TURNS


BAND = 1 << 20
"""Number of cells of a strip, which bounds the memory."""


def loss_tables(grid: OccupancyGrid, matching: Matching, fits: Bools) -> Any:
    """The losses around the map at each deviation, in the form that the kernels take."""
    import cv2

    from locplan._kernels.scan_losses import LossTables

    sigmas, resolution = matching.sigmas(grid.resolution), grid.resolution
    margin = math.ceil(4 * sigmas[0] / resolution) + 2
    clear = 1 - np.pad(wall_cells(grid.cells == OCCUPIED), margin)
    height, width = clear.shape
    levels = _losses_of_squares(sigmas, matching.z_rand, resolution, math.hypot(height, width))
    far = levels.shape[1] - 1
    reach = math.isqrt(far) + 1
    corners = np.empty((len(sigmas), height, width), np.uint32)
    rows = max(reach, BAND // width)
    for top in range(0, height, rows):
        above = max(0, top - reach)  # wall_cells farther away than this do not count
        part = clear[above : top + rows + 1 + reach]
        part = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        part = np.minimum(part[top - above : top - above + rows + 1], reach)
        count = min(rows, height - top)
        squares = np.full((count + 1, width + 1), far)
        squares[: len(part), :-1] = np.minimum(np.rint(part * part), far)
        for level, words in zip(levels, corners[:, top : top + count], strict=True):
            steps = level[squares]
            words[:] = steps[:-1, :-1]
            for n, each in enumerate((steps[:-1, 1:], steps[1:, :-1], steps[1:, 1:]), 1):
                words |= each << np.uint32(8 * n)
    # Steps of the refinement: only with the least deviation there are several.
    steps = sigmas[:, None] / resolution * (0.5, 0.25, 0.125)
    steps[:-1, 1:] = 0
    return LossTables(
        corners.reshape(len(sigmas), -1),
        fits.astype(np.uint8),
        margin=margin,
        width=width,
        height=height,
        steps=steps,
    )


def _losses_of_squares(
    sigmas: Floats, z_rand: float, resolution: float, farthest: float
) -> NDArray[np.uint32]:
    """Losses at a squared distance of 0, 1, ... cells^2 for each deviation; the last one is `TOP`.

    Distances of a map are at most the farthest [cells].
    """
    from locplan._kernels.scan_losses import TOP

    # At this distance a hit is half a step of loss above z_rand.
    excess = z_rand * math.expm1(-math.log(z_rand) / TOP / 2) / (1 - z_rand)
    reach = float(sigmas[0]) * math.sqrt(max(0.0, -2 * math.log(excess))) / resolution
    squares = np.arange(math.ceil(min(reach + 1, farthest)) ** 2 + 2)
    distance = np.sqrt(squares.astype(np.float32)) * np.float32(resolution)
    hit = (1 - z_rand) * np.exp(-0.5 * (distance / sigmas[:, None]) ** 2)
    losses = np.rint(TOP * np.log(hit + z_rand) / math.log(z_rand)).astype(np.uint32)
    losses[:, -1] = TOP
    return losses


class Posteriors(NamedTuple):
    """The posteriors of n scans about n poses, in the world's frame."""

    mean: Floats
    """Mean offset from the pose, (n, 3) [m, m, rad]."""
    covariance: Floats
    """Covariance about the mean, (n, 3, 3) [m, m, rad]."""
    best: Floats
    """Most probable offset, (n, 3) [m, m, rad]."""
    summary: Floats
    """Entropy [nat], ambiguity, and log-likelihood a return at the most probable offset, (n, 3)."""


class Matcher:
    """The likelihood field of a map, made once for many scans.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    settings : Scan
        The search window, and how a beam's end is scored.
    """

    def __init__(self, grid: OccupancyGrid, settings: Scan) -> None:
        self.grid, self.settings = grid, settings
        self.window = settings.lattice(grid.resolution)

    @classmethod
    def of(cls, grid: OccupancyGrid, lidar: Lidar) -> Matcher:
        """Matcher with the default settings for a lidar.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        lidar : Lidar
            The lidar, with its mount on the robot.
        """
        # So many independent beams tell as much as a scan of half a turn.
        return cls(grid, Scan(lidar, effective_beams=15.0))

    @cached_property
    def prepared(self) -> Any:
        """Likelihood field and offsets, in the form that the kernels take."""
        from locplan._kernels.likelihood import make_lattice

        field = self.settings.prepare(self.grid.cells, self.grid.resolution).likelihood
        return field, make_lattice(self.window.half_steps, self.window.angles)

    def posteriors(self, on_robot: Floats, poses: Floats) -> Posteriors:
        """Match scans about poses, each from the centre of its cell.

        Parameters
        ----------
        on_robot : (n, beams, 2) array
            Ends of all the lidar's beams ahead and to the left of the robot [m]; NaN for none.
        poses : (n, 3) array
            Poses in the world, on the map [m, m, rad].
        """
        from locplan._kernels.matches import recorded_posteriors

        count, compared = len(poses), self.settings.beam_numbers
        ends = ends_in_map(on_robot[:, compared], poses)
        row, col = self.grid.world_to_grid(*poses[:, :2].T)
        cells = np.column_stack([np.floor(row), np.floor(col)]).astype(np.int64)
        ends_row, ends_col = self.grid.world_to_grid(*np.moveaxis(ends, -1, 0))
        middle = cells + 0.5
        from_cell = np.stack([ends_col - middle[:, 1, None], ends_row - middle[:, 0, None]], -1)
        mean, covariance = np.empty((count, 3)), np.empty((count, 3, 3))
        best, summary = np.zeros((count, 3), np.int64), np.empty((count, 3))
        found = mean, covariance, best, summary
        field, lattice = self.prepared
        recorded_posteriors(field, lattice, cells, from_cell, self.settings.temperature, *found)
        turn, steps = turning(self.grid.origin[2]), self.window.steps
        return Posteriors(
            mean * steps @ turn.T,
            turn @ (covariance * np.outer(steps, steps)) @ turn.T,
            best * steps @ turn.T,
            summary,
        )

"""Posteriors of scans over the search window about poses on a map."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from locplan._util.poses import Numbers, ends_in_map, turning
from locplan.field import Scan
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar


class Posteriors(NamedTuple):
    """The posteriors of n scans about n poses, in the world's frame."""

    mean: Numbers
    """Mean offset from the pose, (n, 3) [m, m, rad]."""
    covariance: Numbers
    """Covariance about the mean, (n, 3, 3) [m, m, rad]."""
    best: Numbers
    """Most probable offset, (n, 3) [m, m, rad]."""
    summary: Numbers
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
        # So many independent beams tell as much as a whole scan.
        return cls(grid, Scan(lidar, effective_beams=15.0))

    @cached_property
    def prepared(self) -> Any:
        """Likelihood field and offsets, in the form that the kernels take."""
        from locplan._kernels.likelihood import make_lattice

        field = self.settings.prepare(self.grid.cells, self.grid.resolution).likelihood
        return field, make_lattice(self.window.half_steps, self.window.angles)

    def posteriors(self, on_robot: Numbers, poses: Numbers) -> Posteriors:
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
        recorded_posteriors(field, lattice, cells, from_cell, self.settings.effective_beams, *found)
        turn, steps = turning(self.grid.origin[2]), self.window.steps
        return Posteriors(
            mean * steps @ turn.T,
            turn @ (covariance * np.outer(steps, steps)) @ turn.T,
            best * steps @ turn.T,
            summary,
        )

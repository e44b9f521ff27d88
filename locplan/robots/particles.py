"""AMCL's particle filter, and the arguments of its kernels: settings, map and lidar."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Floats
from locplan._support.poses import make_rotation_matrix
from locplan.maps.grid import OccupancyGrid, world_to_map_frame
from locplan.maps.occupancy import FREE, OCCUPIED

if TYPE_CHECKING:
    from locplan._support.kernels.particles import BeamScores, FilterSettings
    from locplan.robots.amcl import Amcl, Deviation
    from locplan.robots.lidar import Lidar

UPDATED, RESAMPLED, NOW = range(3)
"""Rows of odometry that a running filter keeps: at the last update, the last resampling, now."""


class ParticleFilter:
    """AMCL as a running filter, see `Tracker`; simulated drives and replays use the same numbers.

    Parameters
    ----------
    amcl : Amcl
        The settings.
    grid, lidar, pose, deviation, random
        See `Filter.start`.
    """

    def __init__(
        self,
        amcl: Amcl,
        grid: OccupancyGrid,
        lidar: Lidar,
        pose: Floats,
        deviation: Deviation,
        random: np.random.Generator,
    ) -> None:
        from locplan._support.kernels.drives import AT, StartSpread, start_filter

        self._amcl, self._grid, self._lidar, self._random = amcl, grid, lidar, random
        self._scores, self._settings = (
            make_beam_scores(grid, amcl, lidar),
            make_filter_settings(amcl),
        )
        first = world_to_map_frame(grid, np.asarray(pose, np.float64)[None])[0]
        self._tracker = start_filter(random, first, StartSpread(*deviation), self._settings)
        self._tracker.state[AT] = RESAMPLED
        self._odometry = np.zeros((3, 3))
        self._has_started = False
        self._covariance = np.full((3, 3), np.nan)

    def motion(self, odometry: Floats) -> None:
        """Update with the accumulated pose of odometry; see `Tracker.motion`."""
        self._odometry[NOW] = odometry
        if not self._has_started:
            self._odometry[:] = odometry

    def scan(self, ranges: NDArray[np.float32]) -> None:
        """Update with a scan if the robot came far enough; see `Tracker.scan`."""
        from locplan._support.kernels import drives

        state, random = self._tracker.state, self._random
        due = drives.is_update_due(self._tracker, self._odometry, NOW, self._settings)
        if due:
            drives.advance_particles(random, self._tracker, self._odometry, NOW, self._settings)
        self._covariance[:] = np.nan
        if not due and self._has_started:
            return
        self._has_started = True
        ends = compute_compared_ends(self._amcl, self._lidar, np.asarray(ranges)[None])[0]
        cells = np.ascontiguousarray(ends / self._grid.resolution)
        if drives.correct_particles(
            random, self._tracker, self._scores, cells, NOW, self._settings
        ):
            drives.write_cloud_covariance(self._tracker, self._covariance)
            self._odometry[RESAMPLED], state[drives.AT] = self._odometry[NOW], RESAMPLED
        self._odometry[UPDATED], state[drives.UPDATED] = self._odometry[NOW], UPDATED

    def estimate(self) -> Floats:
        """Return the mean of the heaviest cluster, moved by odometry; see `Tracker.estimate`."""
        from locplan._support.kernels.drives import estimate_pose

        x, y, heading = estimate_pose(self._tracker, self._odometry, NOW)
        resolution = self._grid.resolution
        at = self._grid.grid_to_world(np.float64(y / resolution), np.float64(x / resolution))
        return np.array([*map(float, at), heading + self._grid.origin[2]])

    def covariance(self) -> Floats:
        """Return the covariance of all particles, as AMCL publishes it right after resampling."""
        turn = make_rotation_matrix(self._grid.origin[2])
        return np.asarray(turn @ self._covariance @ turn.T)


def make_filter_settings(amcl: Amcl) -> FilterSettings:
    """Return AMCL's parameters as the kernels take them.

    Parameters
    ----------
    amcl : Amcl
        The parameters.
    """
    from locplan._support.kernels.particles import FilterSettings

    return FilterSettings(
        alpha1=amcl.alpha1,
        alpha2=amcl.alpha2,
        alpha3=amcl.alpha3,
        alpha4=amcl.alpha4,
        alpha5=amcl.alpha5,
        omnidirectional=amcl.is_omnidirectional,
        min_particles=amcl.min_particles,
        max_particles=amcl.max_particles,
        pf_err=amcl.pf_err,
        pf_z=amcl.pf_z,
        resample_interval=amcl.resample_interval,
        update_min_d=amcl.update_min_d,
        update_min_a=amcl.update_min_a,
        recovery_alpha_slow=amcl.recovery_alpha_slow,
        recovery_alpha_fast=amcl.recovery_alpha_fast,
    )


def compute_compared_ends(amcl: Amcl, lidar: Lidar, ranges: NDArray[Any]) -> Floats:
    """Return the ends of the beams that AMCL compares, (n, some beams, 2) on the robot [m].

    Parameters
    ----------
    amcl : Amcl
        The filter.
    lidar : Lidar
        The lidar.
    ranges : (n, beams) array
        Distances along all beams [m].

    Returns
    -------
    array
        Ends ahead and to the left of the robot; NaN without a return.
    """
    beams = slice(None, None, amcl.compute_beam_step(lidar.beams))
    min_range, max_range = max(lidar.min_range, amcl.laser_min_range), amcl.laser_max_range
    compared_ranges = ranges[:, beams]
    used = (compared_ranges >= min_range) & (
        compared_ranges < (max_range if max_range > 0 else math.inf)
    )
    return lidar.compute_ends_on_robot(np.where(used, compared_ranges, np.nan), beams)


def make_beam_scores(
    grid: OccupancyGrid, amcl: Amcl, lidar: Lidar, values: NDArray[np.float32] | None = None
) -> BeamScores:
    """Return the scores that beams add to particles on a map, as the kernels take them.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    amcl : Amcl
        Parameters of the filter.
    lidar : Lidar
        The lidar, for its range.
    values : (H + 2, W + 2) array of float32, optional
        Result of `compute_score_values` for these; by default it is computed.
    """
    from locplan._support.kernels.particles import BeamScores

    values = compute_score_values(grid, amcl, lidar) if values is None else values
    recovers = amcl.recovery_alpha_slow > 0 or amcl.recovery_alpha_fast > 0
    return BeamScores(
        values=values.ravel(),
        rows=values.shape[0],
        cols=values.shape[1],
        resolution=grid.resolution,
        product=amcl.multiplies_likelihoods,
        shift=1.5 if amcl.half_cell else 1.0,
        free=np.flatnonzero(grid.cells == FREE) if recovers else np.empty(0, np.int64),
    )


def compute_score_values(grid: OccupancyGrid, amcl: Amcl, lidar: Lidar) -> NDArray[np.float32]:
    """Compute a beam's score by AMCL's models, for each cell in which it may end.

    Parameters
    ----------
    grid : OccupancyGrid
        The filter's map.
    amcl : Amcl
        Parameters of the filter.
    lidar : Lidar
        The lidar, for its range.

    Returns
    -------
    (H + 2, W + 2) array of float32
        Cube of the beam's likelihood, or its logarithm for "likelihood_field_prob". The ring
        around the map is for beams that end outside of it.
    """
    import cv2

    occupied = np.asarray(grid.cells == OCCUPIED, np.uint8)
    furthest, reach = amcl.laser_likelihood_max_dist, amcl.compute_max_range(lidar)
    far_score = _compute_score(np.float64(furthest), amcl, reach)
    scores = np.full((grid.shape[0] + 2, grid.shape[1] + 2), far_score, np.float32)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for top in range(0, len(cells), 256):  # in parts, which saves memory on a large map
            distance = np.minimum(cells[top : top + 256] * grid.resolution, furthest)
            scored = _compute_score(distance.astype(np.float64), amcl, reach)
            scores[1 + top : 1 + top + len(scored), 1:-1] = scored
    return scores


def _compute_score(distance: Any, amcl: Amcl, reach: float) -> Any:
    """Compute the score of a beam that ends at a distance from the nearest wall [m], float32."""
    hit = amcl.z_hit * np.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood = hit + amcl.z_rand / reach
    if amcl.multiplies_likelihoods:
        tiny = np.finfo(np.float32).tiny
        return np.log(np.maximum(likelihood, tiny)).astype(np.float32)
    return (likelihood**3).astype(np.float32)

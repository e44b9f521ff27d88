"""A map, worlds that differ from it, and robots in them: drives with a filter, and single scans."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.environments import with_boundary_noise
from locplan.errors import ConfigError
from locplan.grid import OCCUPIED, OccupancyGrid
from locplan.progress import ProgressCallback
from locplan.simulation.drives import Drives
from locplan.simulation.motion import Poses
from locplan.simulation.settings import Amcl, Reality

MATCH_WINDOW = 2.0
"""Half width of the window in which single scans are matched [m]."""
MATCH_STEP = 0.05
"""Spacing of its offsets [m], rounded to whole cells."""
MATCH_ROTATIONS = 61
"""Headings of the window, over 120 deg."""
MATCH_SIGMA, MATCH_Z_RAND = 0.1, 0.05
"""Of the likelihood field on which they are matched: sigma_hit [m] and z_rand."""


NEAREST, FARTHEST = 0.5, 2.0
"""How far from the lidar something may stand before it [m]."""
FOR_KERNELS = ("scores", "lidar", "disturbances", "odometry", "start", "filter")
"""What kernels take of a simulator."""


class Simulator:
    """Drives and scans on one map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map that the robot has. Worlds are made of it with `Reality.boundary_noise`.
    amcl : Amcl, optional
        The filter.
    reality : Reality, optional
        What it is up against.
    seed : int
        Of all random numbers. Drive n has the same ones whatever is driven beside it.
    threads : int, optional
        All cores by default. The results do not depend on it.

    Raises
    ------
    ConfigError
        If seed or threads are out of their range.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        amcl: Amcl | None = None,
        reality: Reality | None = None,
        *,
        seed: int = 1,
        threads: int | None = None,
    ) -> None:
        if seed < 0:
            raise ConfigError(f"seed must be an integer of at least 0, not {seed!r}")
        if threads is not None and threads < 1:
            raise ConfigError(f"threads must be at least 1, not {threads}")
        self.grid, self.seed, self.threads = grid, seed, threads
        self.amcl, self.reality = amcl or Amcl(), reality or Reality()

    @cached_property
    def worlds(self) -> list[NDArray[np.uint8]]:
        """What rays meet in each world, as `locplan._kernels.rays.empty_squares`."""
        from locplan._kernels.rays import empty_squares

        noise = self.reality.boundary_noise
        count = self.reality.worlds if noise else 1
        return [
            empty_squares(
                with_boundary_noise(self.grid, noise, seed=_seed(self.seed, n)).cells == OCCUPIED
            )
            for n in range(count)
        ]

    def drive(
        self,
        lines: Sequence[Poses],
        *,
        progress: ProgressCallback | None = None,
    ) -> NDArray[np.float64]:
        """Drive each line once, all with as many poses.

        Parameters
        ----------
        lines : sequence of (n, 3) arrays
            True poses in the world [m, m, rad]; the k-th is driven in the k-th world, and over
            again.
        progress : callable, optional
            Called with (done, total) drives.

        Returns
        -------
        (lines, n, 3) array
            The filter's pose less the true one, in the world [m, m, rad].
        """
        from locplan._kernels import drives as kernel

        own = [self._on_grid(line) for line in lines]
        errors = np.empty((len(own), *own[0].shape))

        def run(n: int) -> None:
            kernel.drive(
                self._random(n),
                own[n],
                self.worlds[n % len(self.worlds)],
                self.scores,
                self.lidar,
                self.disturbances,
                self.odometry,
                self.start,
                self.filter,
                errors[n],
            )

        self._in_threads(run, len(own), progress)
        return _turned(errors, self.grid.origin[2])

    def drive_along(
        self, poses: Poses, drives: int, *, progress: ProgressCallback | None = None
    ) -> Drives:
        """Drive one line so many times."""
        return Drives(poses, self.drive([poses] * drives, progress=progress))

    def match(
        self,
        cells: NDArray[np.int64],
        scans: int,
        *,
        progress: ProgressCallback | None = None,
    ) -> NDArray[np.float64]:
        """Match single scans on the map, by correlation over a window of +-2 m and +-60 deg.

        Parameters
        ----------
        cells : (n, 2) array
            Row and column of each place; the robot stands and heads anywhere in the cell.
        scans : int
            How many at each.
        progress : callable, optional
            Called with (done, total) places.

        Returns
        -------
        (n, scans, 3) array
            The likeliest pose less the true one, in the world [m, m, rad]. Offsets are whole
            cells of about 0.05 m, and headings 2 deg apart.
        """
        from locplan._kernels.matches import match
        from locplan._kernels.offsets import make_lattice
        from locplan.estimators.scan import likelihood_field

        resolution = self.grid.resolution
        step = max(1, round(MATCH_STEP / resolution))
        half_steps = round(MATCH_WINDOW / (step * resolution))
        field = likelihood_field(
            self.grid.cells,
            resolution,
            step,
            half_steps,
            sigma_hit=MATCH_SIGMA,
            z_rand=MATCH_Z_RAND,
        )
        angles = np.linspace(-np.pi / 3, np.pi / 3, MATCH_ROTATIONS)
        lattice = make_lattice(half_steps, angles)
        errors = np.empty((len(cells), scans, 3))

        def run(n: int) -> None:
            random = self._random(n)
            for scan in range(scans):
                match(
                    random,
                    field,
                    lattice,
                    angles,
                    self.worlds[scan % len(self.worlds)],
                    resolution,
                    int(cells[n, 0]),
                    int(cells[n, 1]),
                    self.lidar,
                    self.disturbances,
                    errors[n, scan : scan + 1],
                )

        self._in_threads(run, len(cells), progress)
        errors[..., :2] *= resolution
        return _turned(errors, self.grid.origin[2])

    def _on_grid(self, poses: Poses) -> Poses:
        """In the map's own axes [m, m, rad]."""
        rows, cols = self.grid.world_to_grid(*poses[:, :2].T)
        heading = poses[:, 2] - self.grid.origin[2]
        return np.column_stack([cols * self.grid.resolution, rows * self.grid.resolution, heading])

    def _random(self, n: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, n])

    @cached_property
    def scores(self) -> Any:
        """What a beam's end scores on the map, for the kernels."""
        from locplan._kernels.particles import BeamScores

        values = beam_scores(self.grid, self.amcl, self.reality.sensor.range)
        product = self.amcl.laser_model_type == "likelihood_field_prob"
        rows, cols = values.shape
        return BeamScores(values.ravel(), rows, cols, self.grid.resolution, product)

    @cached_property
    def lidar(self) -> Any:
        """The sensor for the kernels, with the beams that AMCL compares."""
        from locplan._kernels.lidar import Lidar

        sensor = self.reality.sensor
        angles = sensor.angles
        every = (len(angles) - 1) // (self.amcl.max_beams - 1)
        return Lidar(
            angles=np.ascontiguousarray(angles[:: max(1, every)]),
            forward=sensor.mount_x,
            left=sensor.mount_y,
            yaw=sensor.mount_yaw,
            sigma=sensor.range_sigma,
            max_range=min(sensor.range, self.amcl.laser_max_range),
        )

    @cached_property
    def disturbances(self) -> Any:
        """What scans show beside the walls, for the kernels."""
        from locplan._kernels.measured import Disturbances

        return Disturbances(
            outliers=self.reality.outliers,
            occlusion=self.reality.occlusion,
            width=math.radians(self.reality.occlusion_deg),
            nearest=NEAREST,
            farthest=FARTHEST,
        )

    @cached_property
    def odometry(self) -> Any:
        """The wheels for the kernels."""
        from locplan._kernels.drives import Odometry

        reality = self.reality
        return Odometry(
            distance_drift=reality.distance_drift,
            heading_drift=math.radians(reality.heading_drift_deg),
            turn_drift=math.radians(reality.turn_drift_deg),
            distance_bias=reality.distance_bias,
            heading_bias=math.radians(reality.heading_bias_deg),
            turn_bias=reality.turn_bias,
        )

    @cached_property
    def start(self) -> Any:
        """How well the filter knows where it begins, for the kernels."""
        from locplan._kernels.drives import Start

        return Start(self.reality.start_sigma, math.radians(self.reality.start_sigma_deg))

    @cached_property
    def filter(self) -> Any:
        """AMCL's parameters for the kernels."""
        from locplan._kernels.particles import Filter

        return Filter(*(getattr(self.amcl, name) for name in Filter._fields))

    def _in_threads(
        self, run: Callable[[int], None], count: int, progress: ProgressCallback | None
    ) -> None:
        for name in ("worlds", *FOR_KERNELS):  # made once, not by every thread
            getattr(self, name)
        pool = ThreadPoolExecutor(self.threads or os.cpu_count())
        try:
            tasks = [pool.submit(run, n) for n in range(count)]
            for done, task in enumerate(as_completed(tasks), 1):
                task.result()
                if progress:
                    progress(done, count)
        finally:
            pool.shutdown(cancel_futures=True)


def beam_scores(grid: OccupancyGrid, amcl: Amcl, sensor_range: float) -> NDArray[np.float32]:
    """What a beam that ends in each cell adds to a particle's score, as AMCL's models have it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    amcl : Amcl
        The filter.
    sensor_range : float
        [m]

    Returns
    -------
    (H + 2, W + 2) array of float32
        In a ring of what lies outside: the cube of the beam's likelihood, or for
        "likelihood_field_prob" its logarithm.
    """
    import cv2

    occupied = np.asarray(grid.cells == OCCUPIED, np.uint8)
    furthest = amcl.laser_likelihood_max_dist
    distance = np.full((grid.shape[0] + 2, grid.shape[1] + 2), furthest)
    if occupied.any():
        cells = cv2.distanceTransform(1 - occupied, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distance[1:-1, 1:-1] = np.minimum(cells * grid.resolution, furthest)
    hit = amcl.z_hit * np.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood = hit + amcl.z_rand / min(sensor_range, amcl.laser_max_range)
    if amcl.laser_model_type == "likelihood_field_prob":
        tiny = np.finfo(np.float32).tiny
        return np.log(np.maximum(likelihood, tiny)).astype(np.float32)
    return (likelihood**3).astype(np.float32)


def _seed(seed: int, world: int) -> int:
    return int(np.random.SeedSequence([seed, 1, world]).generate_state(1)[0])


def _turned(errors: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """From the map's own axes into the world's."""
    if not yaw:
        return errors
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = errors[..., 0], errors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, errors[..., 2]], axis=-1)

"""A particle filter along a recorded drive: it finds itself anywhere, and samples trajectories."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.arrays import read_arrays, write_arrays
from locplan._support.files import make_folder
from locplan._support.intervals import make_generator
from locplan._support.kernels.arrays import Floats, Singles
from locplan._support.output import replace_file
from locplan._support.progress import ProgressCallback
from locplan.field.beams import find_wall_cells
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.recordings.matching import ScanDatabase, ScanOnMap

SMOOTH = 19
"""Stream of random numbers of the smoother."""
PARTICLES, MAX_PARTICLES = 3000, 60_000
"""Number of particles, and the maximum if they fit badly."""
TRAJECTORIES = 16
"""Number of sampled trajectories."""
BEAMS = 15.0
"""Number of independent beams that a scan counts as when particles compete."""
SIGMA, ANYWHERE = 0.15, 0.1
"""Deviation of beams' ends from walls in the filter [m], and share of ends anywhere."""
UNEXPLAINED = -1.0
"""Log-likelihood a beam below which the map does not explain a scan, which then says nothing."""
FAR_FROM_WALLS = 2.0
"""Maximum distance from walls that counts [m]."""
BLOCK = 64
"""Number of scans after which intermediate results are saved."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The distances of a map's cells from its walls."""

    grid: OccupancyGrid

    @cached_property
    def distances(self) -> Any:
        """Distances of the cells' centres from the walls', up to 2 m, as the kernels take them."""
        import cv2

        from locplan._support.kernels.particles import BeamScores

        is_clear = 1 - find_wall_cells(self.grid.cells == OCCUPIED)
        distances = cv2.distanceTransform(is_clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distances = np.minimum(distances * self.grid.resolution, FAR_FROM_WALLS)
        distances = np.pad(distances, 1, constant_values=FAR_FROM_WALLS).astype(np.float32)
        rows, cols = distances.shape
        return BeamScores(distances.ravel(), rows, cols, self.grid.resolution, True, 1.0)

    @cached_property
    def scores(self) -> Any:
        """Log-likelihoods of beams' ends, as coarse as a filter needs them."""
        hit = (1 - ANYWHERE) * np.exp(-0.5 * (self.distances.values / SIGMA) ** 2)
        return self.distances._replace(values=np.log(hit + ANYWHERE).astype(np.float32))

    @property
    def kidnap_density(self) -> float:
        """Density of a robot that was carried to any pose [1 / (m^2 rad)]."""
        area = float(self.grid.free.sum()) * self.grid.resolution**2
        return 1e-12 / (2 * math.pi * area)


def beam_model(sigma: float, effective: float) -> Any:
    """Return how the kernels score a scan: `effective` beams whose ends err by `sigma` [m]."""
    from locplan.recordings.kernels.least_squares import Beams

    return Beams(sigma, ANYWHERE, effective, UNEXPLAINED)


@dataclass(frozen=True, eq=False)
class FilterPass:
    """One run of the filter along k scans of a drive, in one direction."""

    walls: Walls
    database: ScanDatabase
    """Scans of the whole map, with which a lost filter finds itself."""
    ranges: NDArray[np.float32]
    """The scans, (k, beams) [m]; infinite without a return."""
    ends: Floats
    """Ends of some beams on the robot, (k, b, 2) [m]; NaN without a return."""
    ways: Floats
    """The way to each scan by odometry, (k, 3) [m, m, rad]."""
    deviations: Floats
    """Scales of its errors, (k, 3) [m, m, rad]."""
    start: Floats | None
    """The first pose on the map [m, m, rad]; None if it is not known."""
    seed: int
    number: int
    """Number of the pass, for its random numbers and files."""

    def sample_trajectories(self, folder: Path | None, progress: ProgressCallback) -> Floats:
        """Run the filter, and sample trajectories from its particles, (16, k, 3).

        `folder` keeps intermediate results: an interrupted pass resumes from them.
        """
        from locplan.recordings.kernels.trajectory import sample_backwards

        count = len(self.ways)
        clouds = np.empty((count, 3, PARTICLES), np.float32)
        best_fits, n_poor = np.full(count, np.nan), 0
        n_done = self._read_blocks(folder, clouds, best_fits)
        for k in range(count):
            if k >= n_done:
                clouds[k], best_fits[k] = self._update(k, clouds[k - 1], best_fits[:k], n_poor)
                if folder and (k + 1) % BLOCK == 0:
                    self._write_block(folder, k + 1, clouds, best_fits)
            n_poor = n_poor + 1 if best_fits[k] < _poor_fit(best_fits[:k]) else 0
            progress(k + 1, count)
        samples = np.empty((TRAJECTORIES, count, 3))
        random = make_generator(self.seed, SMOOTH, self.number, count)
        kidnapped = self.walls.kidnap_density
        sample_backwards(random, clouds, self.ways, self.deviations, kidnapped, samples)
        return samples

    def _update(
        self, k: int, cloud: Singles, earlier_fits: Floats, n_poor: int
    ) -> tuple[Singles, float]:
        """Move the particles of a cloud to scan `k`, and draw them by how well they fit.

        If they fit badly, more particles are tried. If these fit badly as well, the whole map is
        searched. `n_poor` is the number of scans before that fit badly without interruption.
        Returns the new cloud and its best fit.
        """
        from locplan.recordings.kernels.trajectory import resample_evenly

        random, poor = make_generator(self.seed, SMOOTH, self.number, k), _poor_fit(earlier_fits)
        for size in (PARTICLES, 4 * PARTICLES, MAX_PARTICLES):
            poses = self._predict(random, k, cloud, size)
            fits = self._compute_fits(k, poses)
            weights = _weigh(fits)
            effective = weights.sum() ** 2 / (weights**2).sum()
            is_poor = fits.max() < poor
            # So many effective particles suffice.
            if k == 0 or (effective >= 150.0 and not is_poor):
                break
        # A scan that no particle explains, or the third one that fits badly.
        if k and is_poor and (n_poor % 3 == 2 or fits.max() < UNEXPLAINED):
            map_poses, count = self._draw_anywhere(random, k, 1000), poses.shape[1]
            poses = np.ascontiguousarray(np.concatenate([poses, map_poses], axis=1))
            fits = np.concatenate([fits, self._compute_fits(k, map_poses)])
            weights = _weigh(fits)
            # Poses from the whole map weigh little next to the particles.
            weights[count:] *= math.exp(-14.0) * count / map_poses.shape[1]
        new_cloud = np.empty_like(cloud)
        resample_evenly(random, poses, weights, new_cloud)
        return new_cloud, fits.max()

    def _predict(self, random: np.random.Generator, k: int, cloud: Singles, size: int) -> Floats:
        """Draw poses at scan `k` from a cloud at the scan before, (3, size)."""
        from locplan.recordings.kernels.trajectory import spread_particles

        if k == 0:
            return self._draw_first(random)
        poses = np.empty((3, size))
        spread_particles(random, cloud, self.ways[k], self.deviations[k], poses)
        return poses

    def _compute_fits(self, k: int, poses: Floats) -> Floats:
        """Compute log-likelihoods a beam of a scan at poses (3, m), (m,); 0 with few returns."""
        from locplan._support.kernels.particles import add_scores

        ends, sums = self.ends[k] / self.walls.grid.resolution, np.zeros(poses.shape[1])
        returns = int(np.isfinite(ends[:, 0]).sum())
        # A scan of fewer returns says nothing.
        if returns >= 5:
            add_scores(self.walls.scores, ends, poses, poses.shape[1], sums)
        return sums / max(returns, 1)

    def _draw_first(self, random: np.random.Generator) -> Floats:
        """Draw particles about the first pose, or where its scan may have been taken, (3, m)."""
        if self.start is None:
            return self._draw_anywhere(random, 0, 2 * PARTICLES)
        errors = random.standard_normal((2 * PARTICLES, 3)) * (0.5, 0.5, math.radians(10))
        return np.ascontiguousarray((self.start + errors).T)

    def _draw_anywhere(self, random: np.random.Generator, k: int, size: int) -> Floats:
        """Draw poses of the whole map that explain a scan, or any if it says too little, (3, m)."""
        places, resolution = self.database.full_database, self.walls.grid.resolution
        ranges = places.matching.select_ranges(self.ranges[[k]].astype(np.float64))[0]
        modes = ScanOnMap(places, ranges).find_modes()
        if len(modes.poses):
            shares = np.exp(-0.5 * np.minimum(modes.losses - modes.losses[0], 8.0))
            choice = random.choice(len(shares), size, p=shares / shares.sum())
            poses = modes.poses[choice] + random.standard_normal((size, 3)) * (0.0, 0.0, 0.03)
            poses[:, :2] = poses[:, :2] * resolution + 0.1 * random.standard_normal((size, 2))
        else:
            xy = places.positions[random.integers(0, len(places.positions), size)] * resolution
            poses = np.column_stack([xy, random.uniform(-math.pi, math.pi, size)])
        return np.ascontiguousarray(poses.T)

    def _write_block(self, folder: Path, n_done: int, clouds: Singles, best_fits: Floats) -> None:
        """Save the last block of scans."""
        make_folder(folder)
        with replace_file(self._block_file(folder, n_done)) as file:
            scans = slice(n_done - BLOCK, n_done)
            block: dict[str, NDArray[Any]] = {"clouds": clouds[scans], "best": best_fits[scans]}
            write_arrays(file, block, plain=block)

    def _read_blocks(self, folder: Path | None, clouds: Singles, best_fits: Floats) -> int:
        """Read the blocks of an interrupted pass; return the number of their scans."""
        n_done = 0
        while folder and (file := self._block_file(folder, n_done + BLOCK)).is_file():
            try:
                block = read_arrays(file, 2 * clouds[:BLOCK].nbytes)
                clouds[n_done : n_done + BLOCK] = block["clouds"]
                best_fits[n_done : n_done + BLOCK] = block["best"]
            except (OSError, ValueError, KeyError):
                break  # a damaged block is computed again
            n_done += BLOCK
        return n_done

    def _block_file(self, folder: Path, n_done: int) -> Path:
        return folder / f"pass_{self.number}_{self._key}_{n_done}.npz"

    @cached_property
    def _key(self) -> str:
        """Digest of all that the pass depends on, which keeps blocks of other drives out."""
        digest = hashlib.sha256(repr((self.walls.grid.digest, self.seed)).encode())
        for array in (self.ranges, self.ends, self.ways, self.deviations, self.start):
            digest.update(b"-" if array is None else array.tobytes())
        return digest.hexdigest()[:16]


def _weigh(fits: Floats) -> Floats:
    """Return the weights of particles by their log-likelihoods a beam."""
    return np.asarray(np.exp(BEAMS * np.maximum(fits, UNEXPLAINED)))


def _poor_fit(best_fits: Floats) -> float:
    """Return the fit below which a scan fits badly, by the best fits of the scans before."""
    finite_fits = best_fits[np.isfinite(best_fits)]
    return max(-0.8, float(np.median(finite_fits)) - 0.35) if len(finite_fits) > 10 else -0.8

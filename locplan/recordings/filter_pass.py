"""Particle filter along a recorded drive with global localization, which samples trajectories."""

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
from locplan.field.beams import find_wall_surface_cells
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.recordings.matching import ScanDatabase, ScanOnMap

SMOOTH = 19
"""Stream of random numbers of the smoother."""
PARTICLES, MAX_PARTICLES = 3000, 60_000
"""Number of particles, and maximum number if they fit badly."""
TRAJECTORIES = 16
"""Number of sampled trajectories."""
BEAMS = 15.0
"""Number of independent beams of a scan in the weights of particles."""
SIGMA, ANYWHERE = 0.15, 0.1
"""Standard deviation of beams' ends from walls in the filter [m], and share of ends anywhere."""
UNEXPLAINED = -1.0
"""Log-likelihood per beam below which a scan does not match the map and is ignored."""
FAR_FROM_WALLS = 2.0
"""Bound on the distance from walls [m]."""
BLOCK = 64
"""Number of scans after which intermediate results are saved."""


@dataclass(frozen=True, eq=False)
class WallDistances:
    """The distances of a map's cells from its walls."""

    grid: OccupancyGrid

    @cached_property
    def distances(self) -> Any:
        """Distances of cells from walls, up to 2 m, in the form of the kernels."""
        import cv2

        from locplan._support.kernels.particles import BeamScores

        is_clear = 1 - find_wall_surface_cells(self.grid.cells == OCCUPIED)
        distances = cv2.distanceTransform(is_clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distances = np.minimum(distances * self.grid.resolution, FAR_FROM_WALLS)
        distances = np.pad(distances, 1, constant_values=FAR_FROM_WALLS).astype(np.float32)
        rows, cols = distances.shape
        return BeamScores(distances.ravel(), rows, cols, self.grid.resolution, True, 1.0)

    @cached_property
    def scores(self) -> Any:
        """Log-likelihoods of beams' ends in the filter, in the form of the kernels."""
        hit = (1 - ANYWHERE) * np.exp(-0.5 * (self.distances.values / SIGMA) ** 2)
        return self.distances._replace(values=np.log(hit + ANYWHERE).astype(np.float32))

    @property
    def kidnap_density(self) -> float:
        """Probability density of a robot that is carried to any pose [1 / (m^2 rad)]."""
        area = float(self.grid.free.sum()) * self.grid.resolution**2
        return 1e-12 / (2 * math.pi * area)


def make_beam_model(sigma: float, n_effective_beams: float) -> Any:
    """Make the likelihood model of a scan for the kernels.

    `n_effective_beams` is the number of independent beams, `sigma` their standard deviation [m].
    """
    from locplan.recordings.kernels.least_squares import BeamMixture

    return BeamMixture(sigma, ANYWHERE, n_effective_beams, UNEXPLAINED)


@dataclass(frozen=True, eq=False)
class FilterPass:
    """One run of the filter along k scans of a drive, in one direction."""

    walls: WallDistances
    database: ScanDatabase
    """Scans at all places of the map, for global localization."""
    ranges: NDArray[np.float32]
    """The scans, (k, beams) [m]; infinite without a return."""
    ends: Floats
    """Ends of selected beams in the robot's frame, (k, b, 2) [m]; NaN without a return."""
    ways: Floats
    """Motion to each scan by odometry, (k, 3) [m, m, rad]."""
    deviations: Floats
    """Scales of the errors of odometry, (k, 3) [m, m, rad]."""
    start: Floats | None
    """The first pose on the map [m, m, rad]; None if it is unknown."""
    seed: int
    number: int
    """Number of the pass, for its random numbers and files."""

    def sample_trajectories(self, folder: Path | None, progress: ProgressCallback) -> Floats:
        """Run the filter, and sample trajectories from its particles, (16, k, 3).

        Intermediate results are saved in `folder`, so that an interrupted pass resumes.
        """
        from locplan.recordings.kernels.trajectory import sample_trajectories_backwards

        count = len(self.ways)
        clouds = np.empty((count, 3, PARTICLES), np.float32)
        best_fits, n_poor = np.full(count, np.nan), 0
        n_done = self._read_blocks(folder, clouds, best_fits)
        for k in range(count):
            if k >= n_done:
                clouds[k], best_fits[k] = self._process_scan(
                    k, clouds[k - 1], best_fits[:k], n_poor
                )
                if folder and (k + 1) % BLOCK == 0:
                    self._write_block(folder, k + 1, clouds, best_fits)
            n_poor = n_poor + 1 if best_fits[k] < _compute_poor_fit_threshold(best_fits[:k]) else 0
            progress(k + 1, count)
        samples = np.empty((TRAJECTORIES, count, 3))
        random = make_generator(self.seed, SMOOTH, self.number, count)
        kidnapped = self.walls.kidnap_density
        sample_trajectories_backwards(
            random, clouds, self.ways, self.deviations, kidnapped, samples
        )
        return samples

    def _process_scan(
        self, scan_number: int, cloud: Singles, earlier_fits: Floats, n_poor_scans: int
    ) -> tuple[Singles, float]:
        """Move a cloud of particles to scan `scan_number`, weigh it by the scan, and resample it.

        If no particle fits, more particles are tried, then the whole map. `n_poor_scans` is
        the number of consecutive previous scans with a poor fit. Returns the new cloud and its
        best fit.
        """
        from locplan.recordings.kernels.trajectory import resample_evenly

        random, poor = (
            make_generator(self.seed, SMOOTH, self.number, scan_number),
            _compute_poor_fit_threshold(earlier_fits),
        )
        for size in (PARTICLES, 4 * PARTICLES, MAX_PARTICLES):
            poses = self._predict_particles(random, scan_number, cloud, size)
            fits = self._compute_fits(scan_number, poses)
            weights = _compute_particle_weights(fits)
            effective = weights.sum() ** 2 / (weights**2).sum()
            is_poor = fits.max() < poor
            # 150 effective particles suffice.
            if scan_number == 0 or (effective >= 150.0 and not is_poor):
                break
        # Search the whole map at every third poor scan, and if no particle explains the scan.
        if scan_number and is_poor and (n_poor_scans % 3 == 2 or fits.max() < UNEXPLAINED):
            map_poses, count = self._draw_on_whole_map(random, scan_number, 1000), poses.shape[1]
            poses = np.ascontiguousarray(np.concatenate([poses, map_poses], axis=1))
            fits = np.concatenate([fits, self._compute_fits(scan_number, map_poses)])
            weights = _compute_particle_weights(fits)
            # Poses from the whole map have a low prior.
            weights[count:] *= math.exp(-14.0) * count / map_poses.shape[1]
        new_cloud = np.empty_like(cloud)
        resample_evenly(random, poses, weights, new_cloud)
        return new_cloud, fits.max()

    def _predict_particles(
        self, random: np.random.Generator, scan_number: int, cloud: Singles, size: int
    ) -> Floats:
        """Predict poses at scan `scan_number` from the cloud at the previous scan, (3, size)."""
        from locplan.recordings.kernels.trajectory import spread_particles

        if scan_number == 0:
            return self._draw_first_particles(random)
        poses = np.empty((3, size))
        spread_particles(random, cloud, self.ways[scan_number], self.deviations[scan_number], poses)
        return poses

    def _compute_fits(self, scan_number: int, poses: Floats) -> Floats:
        """Compute log-likelihoods per beam of a scan at poses (3, m), (m,); 0 with few returns."""
        from locplan._support.kernels.particles import add_scores

        ends, sums = self.ends[scan_number] / self.walls.grid.resolution, np.zeros(poses.shape[1])
        returns = int(np.isfinite(ends[:, 0]).sum())
        # Scans with fewer returns are ignored.
        if returns >= 5:
            add_scores(self.walls.scores, ends, poses, poses.shape[1], sums)
        return sums / max(returns, 1)

    def _draw_first_particles(self, random: np.random.Generator) -> Floats:
        """Draw particles around the first pose, or from the whole map, (3, m)."""
        if self.start is None:
            return self._draw_on_whole_map(random, 0, 2 * PARTICLES)
        errors = random.standard_normal((2 * PARTICLES, 3)) * (0.5, 0.5, math.radians(10))
        return np.ascontiguousarray((self.start + errors).T)

    def _draw_on_whole_map(
        self, random: np.random.Generator, scan_number: int, size: int
    ) -> Floats:
        """Draw poses from the whole map that explain a scan, or random poses, (3, m)."""
        places, resolution = self.database.full_database, self.walls.grid.resolution
        ranges = places.matching.select_ranges(self.ranges[[scan_number]].astype(np.float64))[0]
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
            write_arrays(file, block, uncompressed_names=block)

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
        return folder / f"pass_{self.number}_{self._digest}_{n_done}.npz"

    @cached_property
    def _digest(self) -> str:
        """Digest of all inputs of the pass, which identifies its saved blocks."""
        digest = hashlib.sha256(repr((self.walls.grid.digest, self.seed)).encode())
        for array in (self.ranges, self.ends, self.ways, self.deviations, self.start):
            digest.update(b"-" if array is None else array.tobytes())
        return digest.hexdigest()[:16]


def _compute_particle_weights(fits: Floats) -> Floats:
    """Compute the weights of particles from their log-likelihoods per beam."""
    return np.asarray(np.exp(BEAMS * np.maximum(fits, UNEXPLAINED)))


def _compute_poor_fit_threshold(best_fits: Floats) -> float:
    """Compute the threshold of a poor fit from the best fits of previous scans."""
    finite_fits = best_fits[np.isfinite(best_fits)]
    return max(-0.8, float(np.median(finite_fits)) - 0.35) if len(finite_fits) > 10 else -0.8

"""A particle filter along a recorded drive that finds itself anywhere, and trajectories of it."""

from __future__ import annotations

import hashlib
import math
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.files import make_folder, replacing
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback
from locplan.field import wall_cells
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.matching import ScanDatabase, ScanOnMap

SMOOTH = 19
"""Stream of random numbers of the smoother."""
PARTICLES, MAX_PARTICLES = 3000, 60_000
"""Number of particles, and that up to which it is raised where they fit badly."""
BEAMS = 15.0
"""Number of independent beams that a scan counts as, beside the particles of other places."""
UNEXPLAINED = -1.0
"""Log-likelihood a beam below which the map does not explain a scan, which then says nothing."""
FAR = 2.0
"""Distance from walls from which on a beam's end is far from all of them [m]."""
BLOCK = 64
"""Number of scans after which what was done is put down."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The distances from a map's walls, as the kernels take them."""

    grid: OccupancyGrid

    @cached_property
    def distances(self) -> Any:
        """Distances of the cells' centres from the walls', up to 2 m."""
        import cv2

        from locplan._kernels.particles import BeamScores

        clear = 1 - wall_cells(self.grid.cells == OCCUPIED)
        away = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        away = np.minimum(away * self.grid.resolution, FAR)
        away = np.pad(away, 1, constant_values=FAR).astype(np.float32)
        rows, cols = away.shape
        return BeamScores(away.ravel(), rows, cols, self.grid.resolution, True, 1.0)

    @cached_property
    def scores(self) -> Any:
        """Log-likelihoods of beams' ends, as coarse as a filter needs them."""
        beams = scoring(0.15, BEAMS)
        away = self.distances.values
        hit = (1 - beams.anywhere) * np.exp(-0.5 * (away / beams.sigma) ** 2)
        return self.distances._replace(values=np.log(hit + beams.anywhere).astype(np.float32))

    @property
    def kidnapped(self) -> float:
        """Density of a robot that was carried to any pose [1 / (m^2 rad)]."""
        area = float(self.grid.free.sum()) * self.grid.resolution**2
        return 1e-12 / (2 * math.pi * area)


def scoring(sigma: float, effective: float) -> Any:
    """How beams are scored, with ends that err by `sigma` [m], as so many independent ones."""
    from locplan._kernels.least_squares import Beams

    return Beams(sigma, 0.1, effective, UNEXPLAINED)


@dataclass(frozen=True, eq=False)
class Pass:
    """A filter's way along the k scans of a drive, in one direction."""

    walls: Walls
    database: ScanDatabase
    """What finds a scan's pose on the whole map."""
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

    def trajectories(self, folder: Path | None, progress: ProgressCallback) -> Floats:
        """Trajectories that the filter holds for likely, (40, k, 3).

        What a folder holds of an interrupted pass is taken from there, and what is done is added.
        """
        from locplan._kernels.trajectory import sample_backwards

        count = len(self.ways)
        clouds = np.empty((count, 3, PARTICLES), np.float32)
        best, poor = np.full(count, np.nan), 0
        done = self._read(folder, clouds, best)
        for k in range(count):
            if k >= done:
                self._step(k, clouds, best, poor)
                if folder and (k + 1) % BLOCK == 0:
                    self._write(folder, k + 1, clouds, best)
            poor = poor + 1 if best[k] < self._usual(best[:k]) else 0
            progress(k + 1, count)
        samples = np.empty((40, count, 3))
        random = random_of(self.seed, SMOOTH, self.number, count)
        kidnapped = self.walls.kidnapped
        sample_backwards(random, clouds, self.ways, self.deviations, kidnapped, samples)
        return samples

    def _step(self, k: int, clouds: Any, best: Floats, poor: int) -> None:
        """Move the particles to scan `k`, and draw them by it.

        Where they fit badly, they become more; and where they still do, the whole map is searched.
        `poor` is the number of scans before that fit badly, on end.
        """
        from locplan._kernels.trajectory import draw_evenly, spread

        random, usual = random_of(self.seed, SMOOTH, self.number, k), self._usual(best[:k])
        for size in (PARTICLES, 4 * PARTICLES, MAX_PARTICLES):
            if k:
                poses = np.empty((3, size))
                spread(random, clouds[k - 1], self.ways[k], self.deviations[k], poses)
            else:
                poses = self._first(random)
            fits = self._fits(k, poses)
            weights = np.exp(BEAMS * np.maximum(fits, UNEXPLAINED))
            effective, bad = weights.sum() ** 2 / (weights**2).sum(), fits.max() < usual
            # So many effective particles suffice.
            if k == 0 or (effective >= 150.0 and not bad):
                break
        # A scan that nothing explains, or the third one that fits badly.
        if k and bad and (poor % 3 == 2 or fits.max() < UNEXPLAINED):
            found, many = self._anywhere(random, k, 1000), poses.shape[1]
            poses = np.ascontiguousarray(np.concatenate([poses, found], axis=1))
            fits = np.concatenate([fits, self._fits(k, found)])
            weights = np.exp(BEAMS * np.maximum(fits, UNEXPLAINED))
            # Poses found on the whole map weigh little beside those of the particles.
            weights[many:] *= math.exp(-14.0) * many / found.shape[1]
        best[k] = fits.max()
        draw_evenly(random, poses, weights, clouds[k])

    def _usual(self, best: Floats) -> float:
        """The best fit of a scan below which it is poor."""
        known = best[np.isfinite(best)]
        return max(-0.8, float(np.median(known)) - 0.35) if len(known) > 10 else -0.8

    def _fits(self, k: int, poses: Floats) -> Floats:
        """Log-likelihoods a beam of a scan at poses (3, m), (m,); 0 without enough returns."""
        from locplan._kernels.particles import add_scores

        ends, sums = self.ends[k] / self.walls.grid.resolution, np.zeros(poses.shape[1])
        returns = int(np.isfinite(ends[:, 0]).sum())
        # A scan of fewer returns says nothing.
        if returns >= 5:
            add_scores(self.walls.scores, ends, poses, poses.shape[1], sums)
        return sums / max(returns, 1)

    def _first(self, random: np.random.Generator) -> Floats:
        """Particles about the first pose, or where its scan may have been taken, (3, m)."""
        if self.start is None:
            return self._anywhere(random, 0, 2 * PARTICLES)
        off = random.standard_normal((2 * PARTICLES, 3)) * (0.5, 0.5, math.radians(10))
        return np.ascontiguousarray((self.start + off).T)

    def _anywhere(self, random: np.random.Generator, k: int, size: int) -> Floats:
        """Poses of the whole map that explain a scan, or any where it says too little, (3, m)."""
        places, resolution = self.database.everywhere, self.walls.grid.resolution
        ranges = places.matching.compared(self.ranges[[k]].astype(np.float64))[0]
        found = ScanOnMap(places, ranges).modes()
        if len(found.poses):
            shares = np.exp(-0.5 * np.minimum(found.losses - found.losses[0], 8.0))
            at = random.choice(len(shares), size, p=shares / shares.sum())
            poses = found.poses[at] + random.standard_normal((size, 3)) * (0.0, 0.0, 0.03)
            poses[:, :2] = poses[:, :2] * resolution + 0.1 * random.standard_normal((size, 2))
        else:
            xy = places.positions[random.integers(0, len(places.positions), size)] * resolution
            poses = np.column_stack([xy, random.uniform(-math.pi, math.pi, size)])
        return np.ascontiguousarray(poses.T)

    def _write(self, folder: Path, done: int, clouds: Any, best: Floats) -> None:
        make_folder(folder)
        with replacing(self._file(folder, done)) as file:
            some = slice(done - BLOCK, done)
            np.savez(file, clouds=clouds[some], best=best[some])

    def _read(self, folder: Path | None, clouds: Any, best: Floats) -> int:
        """Read what an interrupted pass has put down; return the number of its scans."""
        done = 0
        while folder and (file := self._file(folder, done + BLOCK)).is_file():
            try:
                with file.open("rb") as opened, np.load(opened) as block:
                    clouds[done : done + BLOCK] = block["clouds"]
                    best[done : done + BLOCK] = block["best"]
            except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
                break  # a damaged one is made anew
            done += BLOCK
        return done

    def _file(self, folder: Path, done: int) -> Path:
        return folder / f"pass_{self.number}_{self._key}_{done}.npz"

    @cached_property
    def _key(self) -> str:
        """Digest of what the pass depends on: it goes on with no blocks of another drive."""
        digest = hashlib.sha256(repr((self.walls.grid.digest, self.seed)).encode())
        for array in (self.ranges, self.ends, self.ways, self.deviations, self.start):
            digest.update(b"-" if array is None else array.tobytes())
        return digest.hexdigest()[:16]

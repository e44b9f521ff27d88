"""The covariance of a simulated scan's posterior at given cells: correlative scan matching.

The ends of the noise-free scan's beams are scored on the map's likelihood field (as in AMCL, see S.
Thrun, W. Burgard and D. Fox, "Probabilistic Robotics", section 6.4) at every offset of the search
window. Unlike derivatives, it sees repeating bays, and several modes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan._support.checks import is_number, set_frozen_fields, short_repr
from locplan._support.kernels.arrays import Floats, Octets
from locplan.errors import ConfigError
from locplan.field.beams import LidarEstimator, compute_beam_reach, find_wall_surface_cells
from locplan.field.estimator import EstimatorLayer, MapPart, Values
from locplan.maps.occupancy import OCCUPIED
from locplan.robots.lidar import MAX_BEAMS


class ScanMap(NamedTuple):
    """Data of a map that a simulated scan needs."""

    squares: Octets
    likelihood: Any


@dataclass(frozen=True, repr=False)
class Scan(LidarEstimator):
    """The covariance of the posterior of a simulated scan over the search window.

    It sees corridors, halls, repetition and several modes: correlative scan matching.
    """

    name: ClassVar[str] = "scan"
    layers: ClassVar[tuple[EstimatorLayer, ...]] = (
        EstimatorLayer(
            "ambiguity", "probability outside the central mode", "1", lambda _: (0.0, 1.0)
        ),
        EstimatorLayer(
            "entropy", "entropy of the posterior", "nat", lambda on: (0.0, math.log(on.size))
        ),
    )

    z_rand: float = field(default=0.05, kw_only=True)
    """Share of the beams that end anywhere, above 0 and below 1; more suits a crowded place."""
    endpoint_noise: tuple[float, float] = field(default=(0.03, 0.01), kw_only=True)
    """Deviation of the ends of the scan's beams along them [m], and its growth with the range.

    Both are >= 0, the growth in metres a metre; (0, 0) simulates a scan without noise.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.z_rand) and 0 < self.z_rand < 1):
            raise ConfigError(f"z_rand must lie between 0 and 1, not {short_repr(self.z_rand)}")
        set_frozen_fields(self, endpoint_noise=_check_noise(self.endpoint_noise))

    def covariances(self, part: MapPart) -> Values:
        """Return the covariance of the posterior about its mean, times k, and the layers.

        See `locplan.field.Estimator.covariances`.
        """
        from locplan._support.kernels.likelihood import make_scan_lattice
        from locplan._support.kernels.posterior import compute_scan_posteriors

        scene = part.prepared or self.prepare(part.levels, part.resolution)
        window = self.lattice(part.resolution)
        posteriors = compute_scan_posteriors(
            scene.likelihood,
            make_scan_lattice(window.half_steps, window.angles),
            scene.squares,
            part.resolution,
            part.rows - part.corner[0],
            part.cols - part.corner[1],
            part.headings,
            self.make_kernel_lidar(),
            np.outer(self.end_deviations, self.endpoint_noise),
            self.temperature,
            part.control,
        )
        in_steps = posteriors.covariance[:, :, : window.dimension, : window.dimension]
        steps = window.steps[: window.dimension]
        covariance = self.noise_level * in_steps * np.outer(steps, steps) + self.q(window)
        return {
            "covariance": covariance[:, part.heading_axis],
            "ambiguity": posteriors.ambiguity[:, part.heading_axis],
            "entropy": posteriors.entropy[:, part.heading_axis],
        }

    @property
    def end_deviations(self) -> Floats:
        """Return standard normal deviations of the beams' ends, the same at all poses, (beams,).

        They are the quantiles at the base-2 van der Corput sequence: evenly spread, and different
        for neighbouring beams. Mirrored beams have the same deviation, and so have, for a lidar
        that sees all round, beams a quarter turn apart. The covariances then turn with the map. A
        smaller field of view does not change the deviations of the remaining beams.
        """
        from scipy.special import ndtri

        numbers = self._compared_beams.number_symmetric_beams(self.lidar)
        digits = np.arange(MAX_BEAMS.bit_length())
        reversed_digits = numbers[:, None] >> digits & 1
        return np.asarray(ndtri(reversed_digits @ 0.5 ** (digits + 1.0)))

    def prepare(self, levels: Octets, resolution: float) -> ScanMap:
        """Compute empty squares and the likelihood field of a map or a part of it.

        See `locplan.field.Estimator.prepare`.
        """
        from locplan._support.kernels.rays import compute_empty_squares

        window, law = self.lattice(resolution), (self.sigma(resolution), self.z_rand)
        likelihood = make_likelihood_field(
            levels, resolution, window.step_cells, window.half_steps, *law
        )
        return ScanMap(compute_empty_squares(levels == OCCUPIED), likelihood)

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        from locplan._support.kernels.likelihood import compute_likelihood_reach

        around = compute_likelihood_reach(resolution, self.sigma(resolution), self.z_rand) + 2
        offsets = self.lattice(resolution).reach
        shift, growth = self.endpoint_noise
        farthest = float(np.abs(self.end_deviations).max())
        noise_cells = math.ceil(farthest * (shift + growth * self.lidar.range) / resolution)
        reach = compute_beam_reach(self.lidar, resolution) + noise_cells + offsets + around
        return min(reach, math.ceil(math.hypot(*map_shape)) + offsets + around)

    def seconds(self, resolution: float) -> float:
        """Return a time in proportion to the beams, and to the offsets at which each is scored [s].

        See `locplan.field.Estimator.seconds`.
        """
        return self.beams_compared * (1e-7 + 1e-10 * self.lattice(resolution).size)

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        """Return the memory of the likelihood field of the whole map and its surroundings [bytes].

        See `locplan.field.Estimator.memory`.
        """
        from locplan._support.kernels.likelihood import compute_likelihood_reach

        reach = compute_likelihood_reach(resolution, self.sigma(resolution), self.z_rand)
        margin = 2.0 * self.lattice(resolution).reach + reach
        height, width = (size + 2 * margin for size in map_shape)
        return 4 * height * width + 32.0 * reach**2


def _check_noise(noise: object) -> tuple[float, float]:
    """Return the two numbers of the endpoint noise; raise a ConfigError if they are not valid."""
    if not (
        isinstance(noise, (tuple, list))
        and len(noise) == 2
        and all(is_number(deviation) and deviation >= 0 for deviation in noise)
    ):
        raise ConfigError(
            "endpoint_noise must be two numbers of at least 0, [m] and [m per m], such as"
            f" (0.03, 0.01), not {short_repr(noise)}"
        )
    return float(noise[0]), float(noise[1])


def make_likelihood_field(
    levels: Octets,
    resolution: float,
    step: int,
    half_steps: int,
    sigma_hit: float = 0.1,
    z_rand: float = 0.05,
) -> Any:
    """Make the likelihood field of a map, or of a part of it, for the kernels that match scans.

    Only occupied cells matter, and there are none beyond the edges. A part must reach as far beyond
    every end of a beam, at every offset, as the likelihood does.

    Parameters
    ----------
    levels : (H, W) array of uint8
        Levels of the cells.
    resolution : float
        Edge of a cell [m].
    step : int
        Distance between the offsets of a match [cells].
    half_steps : int
        Number of offsets on either side.
    sigma_hit : float, default 0.1
        Standard deviation of a beam's end from a wall [m].
    z_rand : float, default 0.05
        Likelihood of an end far from all walls, relative to one on a wall.

    Returns
    -------
    locplan._support.kernels.likelihood.LikelihoodField
        Costs in whole numbers, laid out for the kernels.
    """
    from locplan._support.kernels import likelihood as kernel
    from locplan._support.kernels.simd import SHORTS

    costs = kernel.tabulate_costs(resolution, sigma_hit, z_rand)
    reach = kernel.compute_likelihood_reach(resolution, sigma_hit, z_rand)
    margin = reach + 2 * half_steps * step + 1
    rows, cols = (size + 2 * margin for size in levels.shape)
    height, width = -(-rows // step), -(-cols // step)
    # Rows that are scored in a group, and the ends of the vectors, may lie beyond the last plane.
    shape = step, step, height, width
    planes = np.full(math.prod(shape) + kernel.GROUP * width + SHORTS, kernel.TOP, np.uint16)
    laid_out = planes[: math.prod(shape)].reshape(shape)
    kernel.write_cost_planes(
        find_wall_surface_cells(levels == OCCUPIED), costs, reach, margin, laid_out
    )
    return kernel.LikelihoodField(
        planes,
        first=-margin,
        last_row=rows - 1 - 2 * half_steps * step,
        last_col=cols - 1 - 2 * half_steps * step,
        step=step,
        width=width,
        plane=height * width,
        nats=-math.log(z_rand) / kernel.TOP,
    )

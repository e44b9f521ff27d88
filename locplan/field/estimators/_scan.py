"""The covariance of a simulated scan's posterior at given cells: correlative scan matching.

The ends of the noise-free scan's beams are scored on the map's likelihood field (that of AMCL, see
S. Thrun, W. Burgard and D. Fox, "Probabilistic Robotics", section 6.4) at every offset of the
search window. It sees what derivatives cannot: repeating bays, and several modes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan.field._config import FieldConfig
from locplan.field._search_window import SearchWindow
from locplan.field._surfaces import walls
from locplan.field.estimators._beams import beams_of, on_grid, reach_of_beams
from locplan.maps import OCCUPIED


class Scene(NamedTuple):
    """What a scan needs of a map."""

    squares: NDArray[np.uint8]
    likelihood: Any


def covariances(
    levels: NDArray[np.uint8],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    resolution: float,
    config: FieldConfig,
    *,
    yaw: float = 0.0,
    corner: tuple[int, int] = (0, 0),
    control: NDArray[np.int64] | None = None,
    prepared: Scene | None = None,
    **_: Any,
) -> dict[str, NDArray[np.float64]]:
    """Covariance of the posterior about its mean at each cell, in the grid's own axes.

    Parameters
    ----------
    levels, rows, cols, resolution, config, yaw, corner, control, prepared
        As for `locplan.field.estimators._fisher.covariances`.

    Returns
    -------
    dict of arrays
        "covariance", (n, 3, 3), or (n, 2, 2) without rotation, or (n, headings, d, d): of (x, y,
        theta) [m, m, rad], times k, plus Q if `config.quantisation`; "ambiguity" and "entropy" of
        `locplan.field.estimators.LAYERS`, (n,) or (n, headings).
    """
    from locplan._kernels.offsets import make_lattice
    from locplan._kernels.posterior import scan_posteriors

    scene = prepared or prepare(levels, resolution, config)
    window = SearchWindow.from_config(config, resolution)
    found = scan_posteriors(
        scene.likelihood,
        make_lattice(window.half_steps, window.angles),
        scene.squares,
        resolution,
        rows - corner[0],
        cols - corner[1],
        config.heading_angles - yaw,
        beams_of(config, config.max_beams),
        config.temperature,
        np.zeros(2, np.int64) if control is None else control,
    )
    steps = np.array([window.step, window.step, window.rotation_step])
    covariance = config.noise_level * found.covariance * np.outer(steps, steps)
    covariance = covariance[..., : window.dimension, : window.dimension]
    single = 0 if config.headings == 1 else slice(None)
    return {
        "covariance": on_grid(covariance, window, config),
        "ambiguity": found.ambiguity[:, single],
        "entropy": found.entropy[:, single],
    }


def prepare(levels: NDArray[np.uint8], resolution: float, config: FieldConfig) -> Scene:
    """Empty squares and the likelihood field of a map or a part of it."""
    from locplan._kernels.rays import empty_squares

    window = SearchWindow.from_config(config, resolution)
    field = likelihood_field(
        levels,
        resolution,
        window.step_cells,
        window.half_steps,
        sigma_hit=config.sigma_hit,
        z_rand=config.z_rand,
    )
    return Scene(empty_squares(levels == OCCUPIED), field)


def likelihood_field(
    levels: NDArray[np.uint8],
    resolution: float,
    step: int,
    half_steps: int,
    *,
    sigma_hit: float = 0.1,
    z_rand: float = 0.05,
) -> Any:
    """The field of a map, or of a part of it.

    Parameters
    ----------
    levels : (H, W) array of uint8
        Only what is occupied matters, and beyond the edges nothing is. A part must reach as far
        beyond every end of a beam, at every offset, as the likelihood does.
    resolution : float
        Edge of a cell [m].
    step, half_steps : int
        Spacing of the search window's offsets [cells], and their number on either side of zero.
    sigma_hit : float
        Standard deviation of an endpoint [m].
    z_rand : float
        Share of the beams that end anywhere, above 0 and below 1.
    """
    from locplan._kernels import likelihood as kernel
    from locplan._kernels.simd import SHORTS

    costs = kernel.costs_of_squared_distance(resolution, sigma_hit, z_rand)
    reach = kernel.likelihood_reach(resolution, sigma_hit, z_rand)
    margin = reach + 2 * half_steps * step + 1
    rows, cols = (size + 2 * margin for size in levels.shape)
    height, width = -(-rows // step), -(-cols // step)
    # Rows that are scored in a group, and the ends of the vectors, may lie beyond the last plane.
    size = step * step * height * width + kernel.GROUP * width + SHORTS
    planes = np.full(size, kernel.TOP, np.uint16)
    solid = walls(levels == OCCUPIED)
    kernel.lay_out(solid, costs, reach, margin, step, width, height * width, planes)
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


def halo(config: FieldConfig, resolution: float, map_shape: tuple[int, int]) -> int:
    """How far beyond a cell its covariance depends on the map [cells]."""
    from locplan._kernels.likelihood import likelihood_reach

    window = SearchWindow.from_config(config, resolution)
    around = likelihood_reach(resolution, config.sigma_hit, config.z_rand) + 2
    offsets = window.half_steps * window.step_cells
    reach = reach_of_beams(config, resolution) + offsets + around
    return min(reach, math.ceil(math.hypot(*map_shape)) + offsets + around)


def points_apart(config: FieldConfig, resolution: float, stride: int) -> int:
    """Every how many lattice points had best share a tile: all."""
    return 1

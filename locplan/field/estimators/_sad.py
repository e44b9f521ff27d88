"""The SAD-correlation covariance at given cells (the paper's Eq. 2, 8 and 9).

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import Settings, instance, keep, one_of, positive, shown
from locplan.errors import ConfigError
from locplan.field._estimator import TILE_CELLS, Estimator, MapPart, Values
from locplan.field._lidar import Lidar, checked_range
from locplan.field._search_window import OffsetLattice, SearchWindow
from locplan.field._template import BEHIND, beam_count, beam_of_cell, disc, map_centre
from locplan.maps import FREE, OCCUPIED

LEVEL_STEP = 127
"""Difference of two neighbouring levels."""
PAPER_RANGE = 6.0
"""Radius of the paper's template disc [m]."""
TAU = {"disc": 0.57, "visible": 0.23}
"""Scale of the exponential weights that ranks places best, for each template [m^2]."""


@dataclass(frozen=True, repr=False)
class Exponential(Settings):
    """Weights exp(-S / tau) of offsets with the mismatch area S."""

    name: ClassVar[str] = "exponential"
    tau: float | None = None
    """Mismatch area at which the weight falls to 1/e [m^2]; None takes the template's `TAU`."""

    def __post_init__(self) -> None:
        if self.tau is not None:
            keep(self, tau=positive("tau", self.tau, "m^2"))


@dataclass(frozen=True, repr=False)
class InverseSquare(Settings):
    """Weights 1 / max(S, floor)^2 of offsets with the mismatch area S (Eq. 9)."""

    name: ClassVar[str] = "inverse-square"
    floor: float | None = None
    """Lower limit of the mismatch area [m^2]; None takes half a cell's area."""

    def __post_init__(self) -> None:
        if self.floor is not None:
            keep(self, floor=positive("floor", self.floor, "m^2"))


@dataclass(frozen=True, kw_only=True, repr=False)
class Sad(Estimator):
    """The paper's estimator, which correlates the map around a place with the map itself.

    The sums of absolute differences between a template and the map at every offset of the window
    give weights, and they the covariance. The defaults predict errors of scan matching best;
    `Sad.paper` follows Eq. 8-10 as printed (doi 10.1186/s40648-023-00256-w).

    Examples
    --------
    >>> Sad(range=8.0).tau
    0.57
    >>> Sad(weights=Exponential(tau=-1.0))
    Traceback (most recent call last):
    locplan.errors.ConfigError: tau must be a positive number of m^2, not -1.0
    """

    name: ClassVar[str] = "sad"
    remedy: ClassVar[str] = (
        "a lidar's beams tell more apart: --lidar NAME, with the estimator that it takes"
    )

    window: SearchWindow = field(default_factory=SearchWindow)
    """Search window of pose offsets, which bounds the covariance."""
    quantisation: bool = True
    """True to add Q, the variance that the window's steps cannot resolve (step^2 / 12)."""
    range: float = PAPER_RANGE
    """Radius of the template disc [m]."""
    template: Literal["disc", "visible"] = "disc"
    """Compared part of the disc: all of it, as in the paper, or what a ray from the cell sees."""
    weights: Exponential | InverseSquare = Exponential()
    """Law that gives the weight of an offset from its mismatch."""

    lidar: Lidar | None = field(default=None, compare=False)
    """The lidar whose range it is, for titles and simulations; it decides nothing."""

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("window", self.window, SearchWindow)
        if not isinstance(self.quantisation, bool):
            raise ConfigError(f"quantisation must be true or false, not {shown(self.quantisation)}")
        keep(self, range=checked_range("range", self.range))
        one_of("template", self.template, tuple(TAU))
        if self.lidar is not None:
            instance("lidar", self.lidar, Lidar)
        if not isinstance(self.weights, InverseSquare):
            instance("weights", self.weights, Exponential)

    @classmethod
    def paper(cls, *, range: float = PAPER_RANGE, noise_level: float = 1.0) -> Sad:
        """Settings for Eq. 8-10 of the paper as printed: inverse-square weights, no Q."""
        law = InverseSquare()
        return cls(range=range, noise_level=noise_level, weights=law, quantisation=False)

    @property
    def adds_q(self) -> bool:
        return self.quantisation

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.window.on(resolution)

    @property
    def reach(self) -> float:
        """Radius of the template disc [m]."""
        return self.range

    @property
    def summary(self) -> str:
        """Name, lidar, range, template and weights of the estimator, for titles."""
        how = f"{self.name}, {self.template}, {self.weights.name}"
        if self.lidar:
            return f"{how}, {self.lidar.model or 'lidar'}, {self.range:g} m"
        disc = "the paper's disc, 6 m assumed" if self.range == PAPER_RANGE else f"{self.range:g} m"
        return f"{how}; no lidar named: {disc}"

    @classmethod
    def of(cls, lidar: Lidar, **settings: Any) -> Sad:
        """The estimator whose disc reaches as far as a lidar."""
        return replace(cls(**settings), range=lidar.range, lidar=lidar)

    def with_lidar(self, lidar: Lidar) -> Sad:
        return replace(self, range=lidar.range, lidar=lidar)

    @property
    def tau(self) -> float:
        """Scale of the exponential weights [m^2]; infinite with other weights."""
        if isinstance(self.weights, InverseSquare):
            return math.inf
        return TAU[self.template] if self.weights.tau is None else self.weights.tau

    def identity(self) -> dict[str, object]:
        """All settings but the lidar's name, with the scale that the weights have by default."""
        settings = super().identity()
        del settings["lidar"]
        if isinstance(self.weights, InverseSquare):
            return settings
        return {**settings, "weights": {"name": "exponential", "tau": self.tau}}

    def covariances(self, part: MapPart) -> Values:
        """Weighted covariance of the offsets about their mean, times k (Eq. 8)."""
        from locplan._kernels import sad

        window = self.window.on(part.resolution)
        radius = template_radius(self.range, window, part.map_shape)
        greatest = 2 * np.count_nonzero(disc(radius)) * LEVEL_STEP
        weights = self.offset_weights(np.arange(0, greatest + 1, LEVEL_STEP), part.resolution)
        tile = lay_out_tile(part, radius, window, visible=self.template == "visible")
        in_steps = sad.tile_covariances(tile, weights, part.control)
        covariance = self.noise_level * in_steps * np.outer(window.steps, window.steps)
        covariance = covariance[:, : window.dimension, : window.dimension]
        return {"covariance": covariance + self.q(window) if self.adds_q else covariance}

    def offset_weights(self, mismatch: NDArray[Any], resolution: float) -> NDArray[np.float64]:
        """Weight of offsets with the sums of absolute differences `mismatch` (Eq. 9).

        S is held as mismatch area, ``mismatch / 254`` cells [m^2], so that tau and floor mean the
        same at every resolution.
        """
        cell_area = resolution**2
        area = mismatch / (FREE - OCCUPIED)
        area *= cell_area
        if isinstance(self.weights, Exponential):
            area /= -self.tau
            return np.asarray(np.exp(area, out=area))
        floor = cell_area / 2 if self.weights.floor is None else self.weights.floor
        return (floor / np.maximum(area, floor)) ** 2  # a common factor has no effect

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        window = self.window.on(resolution)
        # A turned cell lies within one cell of its rounded place, and so does its source.
        return template_radius(self.range, window, map_shape) + max(window.reach, 2)

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        """Memory of a tile's layout: turned maps, the window, templates, weights of mismatches."""
        from locplan._kernels.bitplanes import SQUARE

        window = self.window.on(resolution)
        radius, turns = template_radius(self.range, window, map_shape), window.angles.size
        turned = min(TILE_CELLS, max(map_shape)) * math.sqrt(2) + 2.0 * radius
        still = min(TILE_CELLS, max(map_shape)) + 2.0 * (radius + window.reach)
        words = 32 / math.gcd(window.step_cells, SQUARE) ** 2 + 6
        sight = 20 if self.template == "visible" else 4
        return 2 * turns * turned**2 + words * still**2 + (sight * turns + 16 * math.pi) * radius**2

    def points_apart(self, resolution: float, stride: int) -> int:
        """Spacing of the lattice points, `stride` cells apart, that best share a tile.

        Where cells and offsets fall on a common lattice of more than one cell the layout of the
        map is thinner, and on a fine lattice only then fits into the processor's caches.
        """
        from locplan._kernels.bitplanes import SQUARE

        thinnest = math.gcd(self.window.on(resolution).step_cells, SQUARE)
        return thinnest // math.gcd(thinnest, stride)


def template_radius(reach: float, window: OffsetLattice, map_shape: tuple[int, int]) -> int:
    """Radius of the disc in whole cells, at least one, for a range of `reach` metres.

    Cells that are further away than the map is long are unknown at every offset and add no
    mismatch, so that a larger disc gives the same sums.
    """
    whole_map = math.ceil(math.hypot(*map_shape) + math.sqrt(2) * window.reach) + 2
    return max(1, min(math.floor(reach / window.resolution + 1e-9), whole_map))


def lay_out_tile(part: MapPart, radius: int, window: OffsetLattice, *, visible: bool) -> Any:
    """Lay out the map and its turned copies for the kernel, for all cells of a tile at once."""
    from locplan._kernels import bitplanes, sad, templates

    levels = np.array(part.levels, order="C")  # one type of array, for kernels compiled once
    rows, cols, corner = part.rows, part.cols, part.corner
    step, half_steps, reach = window.step_cells, window.half_steps, window.reach
    disc_squares = templates.disc_squares(disc(radius))
    diameter = disc_squares.rows * bitplanes.SQUARE
    centre_row, centre_col = map_centre(part.map_shape)
    cos, sin = np.cos(window.angles), np.sin(window.angles)

    # The templates: the turned maps around the cells' turned and rounded places.
    dy, dx = (rows - centre_row)[:, None], (cols - centre_col)[:, None]
    turned_rows = np.floor(sin * dx + cos * dy + centre_row + 0.5).astype(np.int64)
    turned_cols = np.floor(cos * dx - sin * dy + centre_col + 0.5).astype(np.int64)
    turned = bitplanes.cut_strips(
        levels,
        *corner,
        centre_row,
        centre_col,
        cos,
        sin,
        turned_rows.min(axis=0) - radius,
        turned_cols.min(axis=0) - radius,
        int(np.ptp(turned_rows, axis=0).max()) + diameter,
        int(np.ptp(turned_cols, axis=0).max()) + diameter,
    )

    # The map: the rows and columns that a square starts at, of any cell and any offset.
    spacing = int(np.gcd.reduce(np.concatenate([rows - rows[0], cols - cols[0], [step]])))
    around = bitplanes.lay_out_window(
        levels,
        *corner,
        int(rows.min()) - radius - reach,
        int(cols.min()) - radius - reach,
        int(np.ptp(rows)) + 2 * reach,
        int(np.ptp(cols)) + 2 * reach,
        radius,
        diameter,
        step,
        spacing,
        -(-(2 * half_steps + 1) // sad.GROUP) * sad.GROUP,
    )
    return sad.Tile(
        window=around,
        turned=turned,
        rows=rows,
        cols=cols,
        turned_rows=turned_rows,
        turned_cols=turned_cols,
        disc=disc_squares,
        sight=_sight(radius, window if visible else None),
        levels=levels,
        level_rows=rows - corner[0],
        level_cols=cols - corner[1],
        radius=radius,
        step=step,
        half_steps=half_steps,
    )


@lru_cache(maxsize=4)
def _sight(radius: int, window: OffsetLattice | None) -> Any:
    """Rays of the visible templates; no rays without a window."""
    from locplan._kernels import templates

    if window is None:
        none = np.empty(0), np.empty(0), np.empty((0, 0, 0), np.int32), np.empty((0, 0), np.int32)
        return templates.Sight(*none, BEHIND)
    angles = 2 * np.pi * np.arange(beam_count(radius)) / beam_count(radius)
    offset = 2 * np.arange(-radius, radius + 1, dtype=np.int32)
    beams = [beam_of_cell(radius, theta).astype(np.int32) for theta in window.angles]
    return templates.Sight(
        cos=np.cos(angles),
        sin=np.sin(angles),
        beam=np.array([templates.by_squares(beam) for beam in beams]),
        distance=templates.by_squares(offset[:, None] ** 2 + offset[None, :] ** 2),
        behind=BEHIND,
    )

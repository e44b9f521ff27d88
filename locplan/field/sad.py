"""The SAD-correlation covariance at given cells (the paper's Eq. 2, 8 and 9).

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from locplan._support.checks import (
    Settings,
    check_instance,
    check_positive,
    check_range,
    checked_setting,
    set_frozen_fields,
    short_repr,
)
from locplan._support.kernels.arrays import Array, Floats
from locplan.errors import ConfigError
from locplan.field.estimator import TILE_CELLS, Estimator, MapPart, Values, dict_from_settings
from locplan.field.search_window import OffsetLattice, SearchWindow
from locplan.field.templates import make_disc_mask
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.robots.lidar import Lidar

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
    """Mismatch area at which the weight falls to 1/e [m^2], above 0.

    None takes 0.57 for the template "disc" and 0.23 for "visible", which rank places best. Less
    makes all covariances smaller.
    """

    def __post_init__(self) -> None:
        if self.tau is not None:
            set_frozen_fields(self, tau=check_positive("tau", self.tau, "m^2"))

    def weigh(self, area: Floats, cell_area: float, template: str) -> Floats:
        """Return the weights, 0..1, of offsets with mismatch areas [m^2]."""
        area /= -self.get_tau(template)
        return np.asarray(np.exp(area, out=area))

    def get_tau(self, template: str) -> float:
        """Return the mismatch area with the weight 1/e [m^2]."""
        return TAU[template] if self.tau is None else self.tau


@dataclass(frozen=True, repr=False)
class InverseSquare(Settings):
    """Weights 1 / max(S, floor)^2 of offsets with the mismatch area S (Eq. 9)."""

    name: ClassVar[str] = "inverse-square"
    floor: float | None = None
    """Lower limit of the mismatch area [m^2], above 0; None takes half a cell's area."""

    def __post_init__(self) -> None:
        if self.floor is not None:
            set_frozen_fields(self, floor=check_positive("floor", self.floor, "m^2"))

    def weigh(self, area: Floats, cell_area: float, template: str) -> Floats:
        """Return the weights, 0..1, of offsets with mismatch areas [m^2]."""
        floor = cell_area / 2 if self.floor is None else self.floor
        return (floor / np.maximum(area, floor)) ** 2  # a common factor has no effect


WeightLaw = Exponential | InverseSquare
"""A law that gives the weight of an offset from its mismatch; a new one is a class with `name` and
`weigh`, and its name here."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Sad(Estimator):
    """The paper's estimator, which correlates the map around a place with the map itself.

    The sums of absolute differences between a template and the map at every offset of the window
    give weights, and they the covariance. The defaults predict errors of scan matching best;
    `Sad.paper` follows Eq. 8-10 as printed (doi 10.1186/s40648-023-00256-w).

    Two approximations for speed change ln e by under 2 % in the median. The template is turned with
    the whole map, and so about a point up to half a cell from its centre. If cells do not divide
    the window's step, offsets are rounded to whole cells and their sums are interpolated between
    whole steps.

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
        "a lidar's beams distinguish more: give --lidar NAME, with the estimator that it takes"
    )

    window: SearchWindow = field(default_factory=SearchWindow)
    """Search window of pose offsets, which bounds the covariance; by default the paper's."""
    quantisation: bool = True
    """True to add Q, the variance that the window's steps cannot resolve (step^2 / 12)."""
    range: float = checked_setting(PAPER_RANGE, check_range)
    """Radius of the template disc [m], above 0 up to 10,000; take the range of your lidar."""
    template: Literal["disc", "visible"] = checked_setting("disc", *TAU)
    """Compared part of the disc: all of it, as in the paper, or what a ray from the cell sees.

    "visible" does not look through walls, in several times the time.
    """
    weights: WeightLaw = Exponential()
    """Law that gives the weight of an offset from its mismatch; `InverseSquare` is the paper's."""

    lidar: Lidar | None = field(default=None, compare=False)
    """The lidar whose range it is, for titles and simulations; it decides nothing."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_instance("window", self.window, SearchWindow)
        if not isinstance(self.quantisation, bool):
            raise ConfigError(
                f"quantisation must be true or false, not {short_repr(self.quantisation)}"
            )
        if self.lidar is not None:
            check_instance("lidar", self.lidar, Lidar)
        if not isinstance(self.weights, WeightLaw):
            check_instance("weights", self.weights, Exponential)

    @classmethod
    def paper(cls, *, range: float = PAPER_RANGE, noise_level: float = 1.0) -> Sad:
        """Return the settings for Eq. 8-10 of the paper as printed: inverse-square weights, no Q.

        Parameters
        ----------
        range : float, default 6.0
            Radius of the template disc [m], above 0; the paper's is 6.
        noise_level : float, default 1.0
            Factor k on the covariance (Eq. 8), above 0.
        """
        law = InverseSquare()
        return cls(range=range, noise_level=noise_level, weights=law, quantisation=False)

    @property
    def adds_q(self) -> bool:
        return self.quantisation

    def lattice(self, resolution: float) -> OffsetLattice:
        return self.window.to_lattice(resolution, exact=True)

    def template_radius(self, resolution: float, map_shape: tuple[int, int]) -> int:
        """Return the radius of the disc in whole cells, at least one.

        Cells that are further away than the map is long are unknown at every offset and add no
        mismatch, so that a larger disc gives the same sums.

        Parameters
        ----------
        resolution, map_shape
            See `locplan.field.Estimator.halo`.
        """
        window = self.lattice(resolution).cell_lattice
        max_radius = math.ceil(math.hypot(*map_shape) + math.sqrt(2) * window.reach) + 2
        return max(1, min(math.floor(self.range / resolution + 1e-9), max_radius))

    @property
    def reach(self) -> float:
        """Radius of the template disc [m]."""
        return self.range

    @property
    def title(self) -> str:
        """Name, lidar, range, template and weights of the estimator, for titles."""
        settings_text = f"{self.name}, {self.template}, {self.weights.name}"
        if self.lidar:
            return f"{settings_text}, {self.lidar.model or 'lidar'}, {self.range:g} m"
        disc = "the paper's disc, 6 m assumed" if self.range == PAPER_RANGE else f"{self.range:g} m"
        return f"{settings_text}; no lidar named: {disc}"

    def with_lidar(self, lidar: Lidar) -> Sad:
        """Return the estimator with a disc of a lidar's range.

        See `locplan.field.Estimator.with_lidar`.
        """
        return replace(self, range=lidar.range, lidar=lidar)

    @property
    def tau(self) -> float:
        """Scale of the exponential weights [m^2]; infinite for weights that are not exponential."""
        law = self.weights
        return law.get_tau(self.template) if isinstance(law, Exponential) else math.inf

    def identity(self) -> dict[str, object]:
        """Return all settings but the lidar's name, with the default scale of the weights filled
        in.
        """
        settings = super().identity()
        del settings["lidar"]
        if not isinstance(self.weights, Exponential):
            return settings
        return {**settings, "weights": dict_from_settings(replace(self.weights, tau=self.tau))}

    def covariances(self, part: MapPart) -> Values:
        """Return the weighted covariance of the offsets about their mean, times k (Eq. 8).

        See `locplan.field.Estimator.covariances`.
        """
        from locplan.field.sad_tiles import MapLayout, compute_step_covariances

        window = self.lattice(part.resolution)
        radius = self.template_radius(part.resolution, part.map_shape)
        greatest = 2 * np.count_nonzero(make_disc_mask(radius)) * LEVEL_STEP
        weights = self.offset_weights(np.arange(0, greatest + 1, LEVEL_STEP), part.resolution)
        layout = MapLayout.from_part(part, radius, window.cell_lattice)
        negligible, visible = self.negligible_mismatch(part.resolution), self.template == "visible"
        covariance_in_steps = compute_step_covariances(
            layout, weights, window.cell_lattice_places, negligible, visible
        )
        covariance = self.noise_level * covariance_in_steps * np.outer(window.steps, window.steps)
        covariance = covariance[:, : window.dimension, : window.dimension]
        return {"covariance": covariance + self.q(window) if self.adds_q else covariance}

    def negligible_mismatch(self, resolution: float) -> int | None:
        """Return the mismatch S / 127 beyond which offsets are left out; None to keep all.

        Only ranges of 10 m or more gain by it, in cells so small that the disc holds enough blocks.
        An omitted offset weighs less than exp(-40) of the zero lag, and their moments add up to no
        more than 1e-12 of a covariance [m^2, rad^2].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        if (
            not isinstance(self.weights, Exponential)
            or self.template != "disc"
            or self.range < max(10.0, 60 * resolution)
        ):
            return None
        window = self.lattice(resolution)
        turn = window.rotation_step * window.half_rotations
        greatest = max(window.step * window.half_steps, turn)
        moments = 2 * self.noise_level * window.size * greatest**2
        nats = max(40.0, math.log(moments / 1e-12))
        return math.floor(nats * self.tau * 2 / resolution**2)

    def offset_weights(self, mismatch: Array, resolution: float) -> Floats:
        """Return the weights of offsets with given sums of absolute differences (Eq. 9).

        S is held as mismatch area, ``mismatch / 254`` cells [m^2], so that tau and floor mean the
        same at every resolution.

        Parameters
        ----------
        mismatch : (...) array
            Sums of absolute differences of levels (Eq. 2), 254 for a free cell on an occupied one.
        resolution : float
            Edge of a cell of the map [m].

        Returns
        -------
        (...) array
            Weights, 0..1; a common factor has no effect.
        """
        cell_area = resolution**2
        area = mismatch / (FREE - OCCUPIED)
        area *= cell_area
        return self.weights.weigh(area, cell_area, self.template)

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        window = self.lattice(resolution).cell_lattice
        # A turned cell lies within one cell of its rounded place, and so does its source.
        return self.template_radius(resolution, map_shape) + max(window.reach, 2)

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        """Return the memory of a tile's turned maps, window and templates [bytes].

        See `locplan.field.Estimator.memory`.
        """
        from locplan.field.kernels.bitplanes import SQUARE

        window = self.lattice(resolution).cell_lattice
        radius, turns = self.template_radius(resolution, map_shape), window.angles.size
        rotated_edge = min(TILE_CELLS, max(map_shape)) * math.sqrt(2) + 2.0 * radius
        still = min(TILE_CELLS, max(map_shape)) + 2.0 * (radius + window.reach)
        words = 32 / math.gcd(window.step_cells, SQUARE) ** 2 + 8
        strips = 2.0 * turns
        if (
            self.negligible_mismatch(resolution) is not None
        ):  # sums of one heading, and of the blocks
            strips, words = strips + 4, words + 12
        sight = 20 if self.template == "visible" else 4
        return (
            strips * rotated_edge**2 + words * still**2 + (sight * turns + 16 * math.pi) * radius**2
        )

    def seconds(self, resolution: float) -> float:
        """Return a time in proportion to the offsets and, but for rejected ones, to the disc's
        cells [s].

        See `locplan.field.Estimator.seconds`.
        """
        compared = self.lattice(resolution).size * math.pi * (self.range / resolution) ** 2
        if self.template == "visible":
            return 6e-12 * compared
        if self.negligible_mismatch(resolution) is None:
            return 1e-12 * compared
        return 5e-8 * self.lattice(resolution).size + 1e-13 * compared

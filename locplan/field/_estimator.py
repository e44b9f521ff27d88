"""What every estimator of the pose covariance is and says of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import instance, keep, positive
from locplan.errors import ConfigError
from locplan.field._search_window import OffsetLattice, SearchWindow
from locplan.field._settings import settings_of

Values = dict[str, NDArray[np.float64]]
"""Arrays by name: "covariance", and the layers of an estimator."""


class Layer(NamedTuple):
    """Something that an estimator says of a place besides its covariance."""

    name: str
    label: str
    """What a colour bar calls it."""
    unit: str
    anchors: Callable[[OffsetLattice], tuple[float, float]]
    """Its value of a perfect match, and its value of a featureless place."""


@dataclass(frozen=True, eq=False, repr=False)
class MapPart:
    """Some cells of a map, with the part of the map that their covariances depend on."""

    levels: NDArray[np.uint8]
    """Levels of the part, (h, w); it reaches `Estimator.halo` cells beyond each of the cells."""
    rows: NDArray[np.int64]
    """Rows of the cells in the whole map, (n,)."""
    cols: NDArray[np.int64]
    """Columns of the cells in the whole map, (n,)."""
    resolution: float
    """Edge of a cell [m]."""
    map_shape: tuple[int, int]
    """Shape of the whole map, which turns about its centre."""
    corner: tuple[int, int] = (0, 0)
    """Row and column of the whole map at which the part begins."""
    headings: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    """Headings of the robot in the grid's own axes, (k,) [rad]."""
    prepared: Any = None
    """What `Estimator.prepare` made of these levels, or None."""
    shared: NDArray[np.int64] | None = None
    """Two numbers shared with other threads: 1 to stop early, and the count of cells done."""

    def __repr__(self) -> str:
        return f"MapPart({len(self.rows)} cells, {self.levels.shape} of {self.map_shape})"

    @classmethod
    def whole(
        cls,
        cells: NDArray[np.uint8],
        rows: NDArray[np.int64],
        cols: NDArray[np.int64],
        resolution: float,
    ) -> MapPart:
        """Some cells of a whole map, for a robot that heads along its rows."""
        return cls(cells, rows, cols, resolution, (cells.shape[0], cells.shape[1]))

    @cached_property
    def control(self) -> NDArray[np.int64]:
        """`shared`, or numbers of one's own for the kernels."""
        return np.zeros(2, np.int64) if self.shared is None else self.shared


@dataclass(frozen=True, kw_only=True)
class Estimator(ABC):
    """What gives the covariance of a pose match; estimators are frozen dataclasses of settings.

    A new estimator is a subclass in a module of its own and a line in `locplan.field._registry`.
    """

    name: ClassVar[str]
    """What it is called on the command line and in files."""
    layers: ClassVar[tuple[Layer, ...]] = ()
    """What it says of a place besides the covariance."""
    remedy: ClassVar[str] = ""
    """What resolves more where its field is saturated."""
    weight: ClassVar[float] = 4.0
    """Metres of detour that are accepted per degenerate metre, by default."""
    criterion: ClassVar[str] = "e"
    """The scalar that makes u, by default."""
    casts_rays: ClassVar[bool] = False
    """Whether a lidar is simulated, which must not stand in a wall."""

    window: SearchWindow = field(default_factory=SearchWindow)
    """The pose offsets that bound the covariance."""
    noise_level: float = 1.0
    """Factor k on the covariance (Eq. 8)."""
    quantisation: bool = True
    """Whether the variance that the window's steps cannot resolve (step^2 / 12) is added."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """How far it looks [m]."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """Its name and the settings that decide most, for titles."""

    @property
    def headings(self) -> int:
        """How many headings of the robot it tells apart, unless more are wanted."""
        return 1

    @abstractmethod
    def covariances(self, part: MapPart) -> Values:
        """Covariance of a pose match at each cell of a part of a map, in the grid's own axes.

        Returns
        -------
        dict of arrays
            "covariance", (n, d, d), or (n, k, d, d) for several headings, with d = 3 for (x, y,
            theta) [m, m, rad], or d = 2 without turns; each of `layers`, (n,) or (n, k).
            NaN where it was stopped early.
        """

    def prepare(self, levels: NDArray[np.uint8], resolution: float) -> object:
        """What threads may share that work on these levels of a map."""
        return None

    @abstractmethod
    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        """How far beyond a cell its covariance depends on the map [cells]."""

    def points_apart(self, resolution: float, stride: int) -> int:
        """Every how many lattice points, `stride` cells apart, had best share a tile."""
        return 1

    def identity(self) -> dict[str, object]:
        """The settings that decide the values, fit for JSON."""
        return settings_of(self)

    def plus_q(self, covariance: NDArray[np.float64], window: OffsetLattice) -> NDArray[np.float64]:
        """Covariances (..., d, d) with Q if it is wanted, without turns where there are none."""
        covariance = covariance[..., : window.dimension, : window.dimension]
        return covariance + window.quantisation if self.quantisation else covariance

    def __post_init__(self) -> None:
        instance("window", self.window, SearchWindow)
        keep(self, noise_level=positive("noise_level", self.noise_level, "times Sigma"))
        if not isinstance(self.quantisation, bool):
            raise ConfigError(f"quantisation must be true or false, not {self.quantisation!r}")

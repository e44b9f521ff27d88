"""Arrays of a costmap, and what is read from them."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from locplan._util.public import Pictured
from locplan.costs._cells import (
    standing_cell,
)
from locplan.costs._degeneracy import (
    CostSettings,
    HeadingLayers,
    density_of,
    sealed,
)
from locplan.maps import OccupancyGrid

LAYERS = ("density", "u", "e")
"""Names of the arrays of a costmap."""


@dataclass(frozen=True, eq=False, repr=False)
class CostLayers(Pictured):
    """The arrays of a costmap, with what they were made of."""

    grid: OccupancyGrid
    """The map."""
    density: NDArray[np.float64]
    """Cost per metre, at least 1; infinite where the robot cannot be, (H, W)."""
    weight: float
    """Metres of detour accepted per degenerate metre (lambda), >= 0; NaN without a field."""
    robot_radius: float
    """Minimum distance from the robot's centre to an occupied cell [m], >= 0."""
    u: NDArray[np.float64]
    """Degeneracy of a cell, 0..1, (H, W); NaN where there is no field."""
    e: NDArray[np.float64]
    """The field's e [m^2 rad], (H, W); NaN where there is no field."""
    of_heading: HeadingLayers | None = None
    """u and e for n headings of the robot, evenly spaced from 0 on; None if they are alike."""
    settings: CostSettings | None = None
    """Settings of u; None without a field."""

    def __post_init__(self) -> None:
        for name in LAYERS:
            layer = getattr(self, name)
            if layer.flags.writeable:
                object.__setattr__(self, name, sealed(layer.copy()))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in LAYERS:
            sealed(state[name])

    def copy(self) -> Self:
        """Copy of the costmap that shares nothing with it, not even the map."""
        return copy.deepcopy(self)

    def __repr__(self) -> str:
        own = math.isnan(self.weight)
        made = "a density of one's own" if own else f"weight {self.weight:g}"
        grid = repr(self.grid).removeprefix("OccupancyGrid(").partition(", origin")[0]
        return f"{type(self).__name__}({grid}, robot radius {self.robot_radius:g} m, {made})"

    @property
    def u_of_heading(self) -> NDArray[np.float32] | None:
        """u for n headings of the robot, evenly spaced from 0 on, (n, H, W); None if alike."""
        return None if self.of_heading is None else self.of_heading.both[0]

    @property
    def e_of_heading(self) -> NDArray[np.float32] | None:
        """e for the headings of `u_of_heading` [m^2 rad], (n, H, W); None if alike."""
        return None if self.of_heading is None else self.of_heading.both[1]

    @property
    def density_of_heading(self) -> NDArray[np.float64]:
        """`density` for each heading, (n, H, W), or once where headings are alike, (1, H, W)."""
        if self.u_of_heading is None:
            return self.density[None]
        density = density_of(self.u_of_heading.astype(np.float64), self.weight)
        return np.where(np.isfinite(self.density), density, np.inf)

    @property
    def unblocked_density(self) -> NDArray[np.float64]:
        """`density` also where only the robot's radius blocks a cell, if there is a field."""
        return self.density if math.isnan(self.weight) else density_of(self.u, self.weight)

    @property
    def e_unit(self) -> str:
        """Unit of e, without the angle where poses have no heading."""
        estimator = self.settings and self.settings.config.estimator
        flat = estimator and estimator.lattice(self.grid.resolution).dimension == 2
        return "m²" if flat else "m² rad"

    @property
    def has_weak_spots(self) -> bool:
        """Whether u is above 0 anywhere; True where there is no field."""
        return bool((self.u > 0).any() or np.isnan(self.u).all())

    def cell_of(self, xy: Sequence[float], role: str = "position") -> tuple[int, int]:
        """Row and column of the cell at a world position where the robot can stand.

        Parameters
        ----------
        xy : (x, y)
            The world position [m].
        role : str, default "position"
            What the error calls the position, such as "start".

        Raises
        ------
        PoseError
            If the robot cannot stand there. The error says why, and names the nearest position
            where it can.
        """
        return standing_cell(self.grid, self.density, self.robot_radius, xy, role)

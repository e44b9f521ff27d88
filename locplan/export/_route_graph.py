"""Route graphs: nodes and straight edges, with their costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from locplan._kernels.arrays import Floats, Ints
from locplan._kernels.search import bordered_half
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid

Positions = Floats
"""World positions (n, 2) [m]."""
Pairs = Ints
"""Pairs of nodes (m, 2)."""
Space = tuple[NDArray[Any], int, tuple[Any, ...]]
"""Half the density with its border, its columns, and the frame; see `locplan._kernels.route`."""
FINENESS = 0.02
"""Coarsest step of single precision that is accepted [cells]."""


@dataclass(frozen=True, eq=False, repr=False)
class RouteGraph:
    """Nodes and straight one-way edges, see `recommended_ways`."""

    nodes: Positions
    """World positions (n, 2) [m], exact in single precision: Nav2 keeps no more."""
    edges: Pairs
    """Pairs of nodes (m, 2), from the first to the second."""
    length: Floats
    """Length of each edge (m,) [m]."""
    cost: Floats
    """Cost of each edge (m,) [m], at least its length."""
    integrated_e: Floats
    """Integral of e over each edge (m,) [m^2 rad m]; NaN without a field."""
    integrated_u: Floats
    """Integral of u over each edge (m,) [m]; NaN without a field."""

    def __repr__(self) -> str:
        return f"RouteGraph({len(self.nodes)} nodes, {len(self.edges)} directed edges)"

    @property
    def penalty(self) -> Floats:
        """Excess of the cost over the length (m,) [m]."""
        return self.cost - self.length

    @property
    def matrix(self) -> csr_array:
        """Cost between nodes, (n, n), for `scipy.sparse.csgraph`."""
        count = len(self.nodes)
        return csr_array(coo_array((self.cost, tuple(self.edges.T)), shape=(count, count)))


def space_of(costs: Costmap) -> Space:
    """A costmap as the kernels of route graphs take it.

    Raises
    ------
    ConfigError
        If the map is too far from the world's origin for Nav2's single precision.
    """
    grid = costs.grid
    check_precision(grid)
    x, y, yaw = grid.origin
    frame = math.cos(yaw) / grid.resolution, math.sin(yaw) / grid.resolution, x, y
    return bordered_half(costs.density, 1), grid.shape[1] + 2, frame


def check_precision(grid: OccupancyGrid) -> None:
    """Raise a ConfigError if the map is too far from the world's origin for single precision."""
    x, y, _ = grid.origin
    farthest = max(abs(x), abs(y)) + math.hypot(*grid.shape) * grid.resolution
    if np.spacing(np.float32(farthest)) > FINENESS * grid.resolution:
        raise ConfigError(f"positions {farthest:.4g} m from the origin are too coarse for Nav2")

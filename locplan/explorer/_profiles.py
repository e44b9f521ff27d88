"""A path as the page shows it: its metrics, and what lies along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.tables import finite
from locplan.costs import Costmap, Path
from locplan.explorer._scene import Scene
from locplan.explorer._view import STEPS
from locplan.field import read_known_at


@dataclass(frozen=True, eq=False)
class PathAnswer:
    """A path with its metrics; those of a field are NaN without one."""

    xy: NDArray[np.float64]
    """Positions in the world, (n, 2) [m]."""
    length: float
    """Length [m]."""
    degenerate: float
    """Integral of u [m]."""
    cost: float
    """J [m]."""
    integrated_e: float
    """Integral of e [m^2 rad m]."""
    mean_sigma_cm: float
    """Mean of the largest standard deviation of the position over the length [cm]."""
    worst_sigma_cm: float
    """Greatest of them [cm]."""
    s: NDArray[np.float64]
    """Distance along the path at which each step of the profile ends [m]."""
    u: NDArray[np.float64]
    """Greatest u within each step, 0..1."""
    sigma_cm: NDArray[np.float64]
    """Greatest standard deviation within each step [cm]."""

    def to_json(self) -> dict[str, Any]:
        """The path, fit for JSON."""
        names = ("length", "degenerate", "cost", "integrated_e", "mean_sigma_cm", "worst_sigma_cm")
        profile = {"s": _listed(self.s, 3), "u": _listed(self.u, 4)}
        profile["sigma_cm"] = _listed(self.sigma_cm, 2)
        values = finite({name: getattr(self, name) for name in names})
        return {"xy": np.round(self.xy, 4).tolist(), **values, "profile": profile}


def path_answer(costs: Costmap, scene: Scene, path: Path) -> PathAnswer:
    """Measure a path on a scene's costmap of half the cost, and read what lies along it.

    The numbers are those of `locplan.costs.path_metrics`, which takes the clearance of the whole
    map besides.
    """
    from locplan._kernels.rays import cells_along

    rows, cols, lengths = cells_along(np.column_stack(costs.grid.world_to_grid(*path.xy.T)))
    if not lengths.size:  # a path within one position
        rows, cols = (np.array([v]) for v in costs.grid.world_to_cell(*path.xy[0]))
        lengths = np.zeros(1)
    rows, cols = (np.clip(i, 0, n - 1) for i, n in zip((rows, cols), costs.grid.shape, strict=True))
    lengths = lengths * costs.grid.resolution
    ends, u = np.cumsum(lengths), costs.u[rows, cols]
    density = costs.density[rows, cols]
    sigma = np.full(len(u), np.nan)
    if scene.field is not None and scene.log_deviation is not None:
        log = read_known_at(*scene.log_deviation, rows, cols, scene.field.stride)
        sigma = 100 * np.exp(log)
    first = np.unique(np.linspace(0, len(ends), min(len(ends), STEPS), endpoint=False).astype(int))
    last = np.append(first[1:], len(ends)) - 1
    known = ~np.isnan(sigma)
    way = lengths[known].sum()
    mean = float(sigma[known] @ lengths[known] / way) if way else float("nan")
    return PathAnswer(
        path.xy,
        path.length,
        float(u @ lengths),
        2 * float(density @ lengths) if np.isfinite(density).all() else float("inf"),
        float(costs.e[rows, cols] @ lengths),
        mean,
        float(sigma[known].max()) if known.any() else float("nan"),
        ends[last],
        np.fmax.reduceat(u, first),
        np.fmax.reduceat(sigma, first),
    )


def _listed(values: NDArray[np.float64], decimals: int) -> list[float | None]:
    """Rounded values as a list, with None for NaN."""
    listed: list[float | None] = np.round(values, decimals).tolist()
    if np.isnan(values).any():
        listed = [None if value != value else value for value in listed]
    return listed

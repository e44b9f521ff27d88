"""A path in the plane: its positions, how long it is, and positions at equal distances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from locplan.errors import LocplanError


@dataclass(frozen=True, eq=False)
class Path:
    """A polyline in the world.

    Parameters
    ----------
    xy : (n, 2) array of float64
        World positions from start to goal [m], n >= 1. Copied, and read-only afterwards.

    Examples
    --------
    >>> path = Path(np.array([[0.0, 0.0], [3.0, 4.0]]))
    >>> path.length
    5.0
    >>> path.resampled(2.5).xy.tolist()
    [[0.0, 0.0], [1.5, 2.0], [3.0, 4.0]]
    """

    xy: NDArray[np.float64]

    def __post_init__(self) -> None:
        try:
            xy = np.array(self.xy, dtype=np.float64)
        except (TypeError, ValueError):
            raise LocplanError("a path needs an (n, 2) array of metres") from None
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) == 0 or not np.isfinite(xy).all():
            raise LocplanError(f"a path needs an (n, 2) array of finite metres, not {xy.shape}")
        xy.setflags(write=False)
        object.__setattr__(self, "xy", xy)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Distance travelled at each position, (n,) [m]."""
        steps = np.hypot(*np.diff(self.xy, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return float(self.distance[-1])

    def resampled(self, spacing: float) -> Path:
        """The same line with positions at equal distances of at most `spacing` [m]."""
        if not spacing > 0:
            raise LocplanError(f"spacing must be positive metres, not {spacing}")
        count = max(1, int(np.ceil(self.length / spacing - 1e-9)))
        at = np.linspace(0.0, self.length, count + 1)
        return Path(np.stack([np.interp(at, self.distance, v) for v in self.xy.T], axis=1))

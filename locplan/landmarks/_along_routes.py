"""The objective along routes: how uncertain the filter's position is on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.landmarks._objects import Shape
from locplan.landmarks._search import in_threads
from locplan.landmarks._surroundings import Surroundings


@dataclass
class AlongRoutes:
    """Mean of P_xx + P_yy along routes [m^2], P the covariance that an information filter has.

    Between two looks P becomes F P F^T + Q ds, and at each (P^-1 + I)^-1, I the information of
    the beams that the filter compares.
    """

    seen: Surroundings
    shape: Shape
    resolution: float
    threads: int
    hits: NDArray[np.float32] = field(init=False)
    sums: NDArray[np.float64] = field(init=False)
    hits_of_map: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        self.start(np.empty((0, 3)))

    @property
    def outline(self) -> Any:
        """The object as the kernels take it."""
        from locplan._kernels.landmarks import Outline

        return Outline(*self.shape)

    def start(self, chosen: NDArray[np.float64]) -> None:
        """Begin from objects at these poses, (k, 3) [cells, cells, rad]."""
        from locplan._kernels.landmarks import HITS, add_object, sums_of

        self.hits = self.seen.hits.copy()
        for x, y, heading in self.own(chosen):
            add_object(self.hits, self.seen.rays, self.outline, x, y, heading)
        self.sums = sums_of(self.hits, self.seen.rays)
        if len(chosen):
            self.sums[:, HITS] = self.hits_of_map
        else:
            self.hits_of_map = self.sums[:, HITS].copy()

    def value(self) -> float:
        """The objective with the objects [m^2]."""
        return float(self.profile().mean())

    def profile(self) -> NDArray[np.float64]:
        """P_xx + P_yy at each pose with the objects, (n,) [m^2]."""
        from locplan._kernels.landmarks import XX, YY
        from locplan._kernels.way_covariances import covariances

        seen = self.seen
        _, after = covariances(self.sums, seen.rays.poses, seen.routes, seen.told, seen.motion)
        return np.asarray(after[:, XX] + after[:, YY])

    def values(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """The objective with each place besides, (m,) [m^2]."""
        from locplan._kernels.way_covariances import uncertainties

        seen = self.seen

        def run(part: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(
                uncertainties(
                    part,
                    self.hits,
                    self.sums,
                    seen.rays,
                    seen.routes,
                    self.outline,
                    seen.told,
                    seen.motion,
                )
            )

        return in_threads(run, self.own(places), self.threads)

    def own(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (row, col, heading) as x, y and heading in the map's own axes [m, m, rad]."""
        return np.ascontiguousarray(
            np.column_stack([places[:, [1, 0]] * self.resolution, places[:, 2]])
        )

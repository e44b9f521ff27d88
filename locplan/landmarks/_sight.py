"""What a robot sees at its poses with some objects in place, and which poses see which place."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.machine import check_memory
from locplan.landmarks._objects import Shape
from locplan.landmarks._surroundings import Surroundings

LOT = 64
"""Number of places that a thread takes at a time: near ones cost alike."""


@dataclass
class Sight:
    """What a robot sees at its poses, with objects at some of the places."""

    seen: Surroundings
    shape: Shape
    places: NDArray[np.float64]
    """Row, column and heading of each place on the map, (m, 3) [cells, cells, rad]."""
    resolution: float
    threads: int
    hits: NDArray[np.float32] = field(init=False)
    """Hits of the rays with the objects, (n, beams, 4)."""
    sums: NDArray[np.float64] = field(init=False)
    """What `sums_of` makes of them, but for the number of hits, which is that of the map."""
    sightings: Any = field(init=False)
    """`sightings.Sightings` of the places."""

    def __post_init__(self) -> None:
        from locplan._kernels.landmarks import sums_of

        self.own = np.ascontiguousarray(
            np.column_stack([self.places[:, [1, 0]] * self.resolution, self.places[:, 2]])
        )
        self.hits = self.seen.hits.copy()
        self.sums = sums_of(self.hits, self.seen.rays)
        self._sums_of_map = self.sums.copy()
        self._touched = np.zeros(len(self.sums), bool)
        self.sightings = self._found()

    @property
    def outline(self) -> Any:
        """The object as the kernels take it."""
        from locplan._kernels.landmarks import Outline

        return Outline(*self.shape)

    def start(self, chosen: NDArray[np.int64]) -> None:
        """Begin from objects at these places, (k,)."""
        from locplan._kernels.landmarks import HITS, add_object, sum_up

        touched, rays = self._touched, self.seen.rays
        self.hits[touched] = self.seen.hits[touched]
        self.sums[touched] = self._sums_of_map[touched]
        touched[:] = False
        for x, y, heading in self.own[chosen]:
            add_object(self.hits, rays, self.outline, x, y, heading, touched)
        sum_up(self.hits, rays, touched, self.sums)
        self.sums[:, HITS] = self._sums_of_map[:, HITS]

    def seen_with(self, place: int) -> NDArray[np.bool_]:
        """Which places are seen from any pose that sees this one, (m,)."""
        starts, poses, _ = self.sightings
        here = np.zeros(len(self.sums), bool)
        here[poses[starts[place] : starts[place + 1]]] = True
        counts = np.concatenate([[0], np.cumsum(here[poses])])
        return np.asarray(counts[starts[1:]] > counts[starts[:-1]])

    def in_threads(
        self, run: Callable[[NDArray[np.int64]], NDArray[np.float64]], indices: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Values of some places that are computed in parts, each on a thread."""
        indices = np.asarray(indices, np.int64)
        if self.threads < 2 or len(indices) <= LOT:
            return run(indices)
        result = np.empty(len(indices))
        lots = range(0, len(indices), LOT)
        with ThreadPoolExecutor(self.threads) as pool:
            parts = pool.map(lambda at: run(indices[at : at + LOT]), lots)
            for at, part in zip(lots, parts, strict=True):
                result[at : at + LOT] = part
        return result

    def _found(self) -> Any:
        """Which poses see which place, and by which rays."""
        from locplan._kernels.sightings import Sightings, count_sightings, fill_sightings

        given = self.seen.hits, self.seen.rays, self.outline
        counts = np.zeros(len(self.own), np.int64)
        self._for_lots(lambda begin, end: count_sightings(self.own, begin, end, *given, counts))
        starts = np.concatenate([[0], np.cumsum(counts)])
        check_memory(
            f"{starts[-1]:,} sightings of {len(counts):,} places",
            8.0 * starts[-1],
            "try fewer places (spacing), shorter routes or a smaller region",
        )
        found = Sightings(
            starts, np.empty(starts[-1], np.int32), np.empty((starts[-1], 2), np.int16)
        )
        self._for_lots(lambda begin, end: fill_sightings(self.own, begin, end, *given, found))
        return found

    def _for_lots(self, run: Callable[[int, int], None]) -> None:
        """Call a function with the first and last index of each lot of places."""
        count = len(self.own)
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(lambda at: run(at, min(at + LOT, count)), range(0, count, LOT)))

"""The result of a search for twins: what every place of a map can be mistaken for."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import instance, number, one_of, position, positive, whole
from locplan._util.progress import ProgressCallback
from locplan._util.public import called
from locplan._util.records import Result, Table
from locplan._util.results import Results
from locplan._util.tables import finite
from locplan.maps import OccupancyGrid
from locplan.matching import Matching
from locplan.robots import Disturbances
from locplan.twins._places import (
    LAYERS,
    PLACES,
    STARTS,
    SYMMETRIES,
    THRESHOLD,
    TWIN,
    GlobalMatches,
    Start,
    Twin,
    best_starts,
)
from locplan.twins._symmetries import Symmetry

SHOWN = 12
"""Maximum number of a place's twins, and of symmetries, in a table or a picture."""


@dataclass(frozen=True, eq=False, repr=False)
class Twins(Result):
    """What every place of a map can be mistaken for by a lidar's single scan.

    A twin is a pose more than 2 m away at which the scan is explained almost as well. Poses that a
    match can slide to without a rise of the loss, as along a corridor, are a stretch instead.
    """

    _drawn_by: ClassVar[str] = "locplan.twins:twins_figure"
    _reported_by: ClassVar[str] = "locplan.twins._find:twins_report"
    files: ClassVar[Results] = Results(
        "twins",
        ("twins.json", "twins.png", "twins.csv", "twins.npz", "symmetries.csv", "starts.csv"),
    )

    grid: OccupancyGrid
    """The map."""
    matching: Matching
    """The lidar, and how scans are matched."""
    spacing: float
    """Distance between neighbouring places [m]."""
    places: Floats
    """World x and y of the places, (n, 2) [m]."""
    headings: Floats
    """Headings of the robot at each place, (h,) [rad]; one where the lidar sees all round."""
    values: dict[str, Floats]
    """Arrays of `LAYERS` by name, (n, h)."""
    twins: Floats
    """x, y, heading and excess of the best twins, (n, h, k, 4) [m, m, rad, nat]; else NaN."""
    symmetries: tuple[Symmetry, ...]
    """Rigid moves of the map after which places look the same, the greatest share first."""
    covered: Bools
    """The places that each symmetry takes to a twin, (s, n)."""

    def __repr__(self) -> str:
        return (
            f"Twins({len(self)} places of {self.grid.name or 'map'}, {self.share:.0%} with a twin,"
            f" {len(self.symmetries)} symmetries)"
        )

    def __len__(self) -> int:
        return len(self.places)

    @property
    def excess(self) -> Floats:
        """Minimum excess of any pose more than 2 m away, (n,) [nats]; infinite if there is none.

        It is that of the worst heading, and 0 where hardly a beam returns.
        """
        return np.asarray(self.values["excess"].min(axis=1))

    @property
    def elsewhere(self) -> Floats:
        """Share of the posterior more than 2 m away, the mean of the headings, (n,)."""
        return np.asarray(self.values["elsewhere"].mean(axis=1))

    @property
    def modes(self) -> Floats:
        """Number of modes more than 2 m away with an excess up to 3 nats, worst heading, (n,)."""
        return np.asarray(self.values["modes"].max(axis=1))

    @property
    def turned(self) -> Floats:
        """Number of such modes in place, turned by more than 60 deg, worst heading, (n,)."""
        return np.asarray(self.values["turned"].max(axis=1))

    @property
    def stretch(self) -> Floats:
        """Distance that a match can slide without a rise of the loss, worst heading, (n,) [m]."""
        return np.asarray(self.values["stretch"].max(axis=1))

    @property
    def share(self) -> float:
        """Share of the places with another pose of up to 3 nats more than 2 m away."""
        return float((self.excess <= THRESHOLD).mean())

    @property
    def unseen(self) -> float:
        """Share of the places where too few beams return to say anything."""
        return float((self.elsewhere == 1).mean())

    def of(self, place: int) -> list[Twin]:
        """The best twins of a place, the one with the least excess first.

        Parameters
        ----------
        place : int
            Number of the place, from 0 on, as `nearest` gives it.
        """
        found = [
            Twin(x, y, heading, excess, here)
            for here, twins in zip(self.headings.tolist(), self.twins[place].tolist(), strict=True)
            for x, y, heading, excess in twins
            if not np.isnan(excess)
        ]
        return sorted(found, key=lambda twin: twin.excess)

    def nearest(self, x: float | Sequence[float], y: float | None = None) -> int:
        """Number of the place nearest to a position.

        Parameters
        ----------
        x : float or (x, y)
            World x [m], or both.
        y : float, optional
            World y [m], unless `x` is both.

        Raises
        ------
        PoseError
            If the position is not two finite numbers.
        """
        at = np.array(position(x, y))
        return int(np.hypot(*(self.places - at).T).argmin())

    def layer(self, name: str, *, stride: int = 1) -> Floats:
        """Values of `LAYERS` on the map's cells, (H, W): those of the nearest place, else NaN.

        Cells where the robot may not stand, or far from all places, have none.

        Parameters
        ----------
        name : str
            "excess" [nats], "elsewhere" (0..1), "modes", "turned" or "stretch" [m]; see the
            properties of these names.
        stride : int, default 1
            Only cells whose row and column are multiples of it are looked at, such as those of a
            field of this stride, (h, w).

        Raises
        ------
        ConfigError
            If there is no such layer, or the stride is less than 1.
        """
        one_of("layer", name, LAYERS)
        whole("stride", stride, 1)
        values = np.full(self.grid.cells[::stride, ::stride].shape, np.nan)
        rows, cols, place = self.nearest_places if stride == 1 else self._nearest(stride)
        values[rows, cols] = getattr(self, name)[place]
        return values

    def density(self, weight: float) -> Floats:
        """Cost per metre ``1 + weight * elsewhere``, (H, W), for `Costmap.from_density`.

        It is infinite where the robot may not stand. Other cells without a place count as places
        without a twin. Paths planned with it are not shown to lose fewer robots: in simulated
        drives with AMCL they lost 21 instead of the shortest paths' 33 % on 16 routes of a
        warehouse, but 71 instead of 30 % on 8 routes of one that repeats everywhere.

        Parameters
        ----------
        weight : float
            Metres of detour accepted per metre of a path that is all elsewhere, >= 0.
        """
        number("weight", weight, 0.0)
        density = 1 + weight * np.nan_to_num(self.layer("elsewhere"), nan=0.0)
        return np.where(self._fits, density, np.inf)

    @property
    def _fits(self) -> Bools:
        """Mask of the cells where the robot may stand, (H, W)."""
        return self.grid.free & ~self.grid.closer_than(self.matching.robot_radius - 1e-9)

    @cached_property
    def nearest_places(self) -> tuple[Ints, Ints, Ints]:
        """Rows and columns of the cells that have a place near them, and its number, (k,) each."""
        return self._nearest(1)

    def _nearest(self, stride: int) -> tuple[Ints, Ints, Ints]:
        """The same of every so many-th cell; rows and columns count these."""
        from scipy.spatial import cKDTree

        rows, cols = np.nonzero(self._fits[::stride, ::stride])
        xy = np.column_stack(self.grid.grid_to_world(stride * rows + 0.5, stride * cols + 0.5))
        bound = 1.5 * self.spacing  # farther cells have no values of a place
        apart, place = cKDTree(self.places).query(xy, distance_upper_bound=bound)
        near = np.isfinite(apart)
        return rows[near], cols[near], place[near]

    def best_starts(self, count: int = 5, *, apart: float = 3.0) -> list[Start]:
        """Where to start the robot, or put its dock: the places with the greatest excess.

        A place counts as the worst of its neighbours. There are fewer where no more fit.

        Parameters
        ----------
        count : int, default 5
            Maximum number of starts, at least 1.
        apart : float, default 3.0
            Minimum distance between two of them [m], above 0.

        Raises
        ------
        ConfigError
            If a number is out of its range.
        """
        whole("count", count, 1)
        positive("apart", apart, "m")
        values = self.places, self.excess, self.elsewhere
        return list(best_starts(*values, count, self.spacing, apart))

    def verify(
        self,
        count: int = 400,
        *,
        disturbances: Disturbances | None = None,
        seed: int = 1,
        threads: int | None = None,
        progress: ProgressCallback | None = None,
    ) -> GlobalMatches:
        """Match noisy scans from poses near the places with the map, and compare with what is said.

        Parameters
        ----------
        count : int, default 400
            Number of scans, at least 2. More narrow the interval of the failure rate.
        disturbances : Disturbances, optional
            Outliers, occlusions and errors of the map; those of a small robot indoors by default.
        seed : int, default 1
            Seed of all random numbers, >= 0.
        threads : int, optional
            Number of threads, at least 1; all cores by default.
        progress : callable, optional
            Called with (done, total) scans.

        Returns
        -------
        GlobalMatches
            What was matched where, how often it failed, and whether that was foreseen.

        Raises
        ------
        ConfigError
            If a number is out of its range, or no cell of the map lies near a place.
        """
        whole("count", count, 2)
        whole("seed", seed, 0)
        disturbances = disturbances or Disturbances()
        instance("disturbances", disturbances, Disturbances)
        how = count, disturbances, seed, threads, progress
        found: GlobalMatches = called("locplan.twins._find:global_matches", self, *how)
        return found

    def table(self) -> Table:
        """The places, each with its layers and the best of its twins."""
        known = np.column_stack([self.places, *(getattr(self, name) for name in LAYERS)]).tolist()
        unknown = (np.nan,) * len(TWIN)
        best = (next(iter(self.of(n)), unknown) for n in range(len(self)))
        return Table(PLACES, tuple((*own, *twin) for own, twin in zip(known, best, strict=True)))

    def _write(
        self,
        folder: Path,
        starts: Sequence[Start] | None = None,
        matches: GlobalMatches | None = None,
    ) -> None:
        self.table().write_csv(folder / "twins.csv")
        arrays: dict[str, Any] = {name: self.layer(name).astype(np.float32) for name in LAYERS}
        arrays |= {"places": self.places, "headings": self.headings, "twins": self.twins}
        np.savez_compressed(folder / "twins.npz", **arrays)
        Table.of(SYMMETRIES, self.symmetries).write_csv(folder / "symmetries.csv")
        starts = self.best_starts() if starts is None else starts
        Table.of(STARTS, starts, number="start").write_csv(folder / "starts.csv")

    def summary(
        self, starts: Sequence[Start] | None = None, matches: GlobalMatches | None = None
    ) -> dict[str, object]:
        """Shares, symmetries, starts and settings in numbers, fit for JSON; of one place its twins.

        Parameters
        ----------
        starts : sequence of Start, optional
            Starts; `best_starts` by default.
        matches : GlobalMatches, optional
            What `verify` gave.
        """
        at = {}
        if len(self) == 1:
            twins = Table.of(TWIN, self.of(0)).records()
            at = {"at": {**self.table().records()[0], "twins": twins}}
        starts = self.best_starts() if starts is None else starts
        return finite(
            {
                "map": {"name": self.grid.name, "digest": self.grid.digest},
                "places": len(self),
                "spacing": self.spacing,
                "share_with_twin": self.share,
                "mean_elsewhere": float(self.elsewhere.mean()),
                "share_unseen": self.unseen,
                "share_on_stretch": float((self.stretch > 0).mean()),
                "symmetries": Table.of(SYMMETRIES, self.symmetries).records(),
                "starts": Table.of(STARTS, starts).records(),
                "matches": matches.summary() if matches else None,
                "matching": dataclasses.asdict(self.matching),
                **at,
            }
        )

"""The features of a map that localization depends on: the result of `key_features`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import ClassVar

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.tables import finite
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.landmarks._objects import Shape, outline_of
from locplan.landmarks._outcomes import DRIVES, FeatureDrives, World, compared
from locplan.maps import FREE, OccupancyGrid
from locplan.robots import Robot
from locplan.simulation import Simulator, check_drives

MATTERS = 0.1
"""Share of the expected deviation by which it rises without a feature that matters."""
MATTERS_M = 0.01
"""Minimum such rise [m]: what is less is lost in a filter's own noise."""
PLACE, PLACE_M = 0.5, 0.1
"""Share, and least rise [m], of the deviation at a place that depends on a feature."""


@dataclass(frozen=True, eq=False)
class Feature:
    """A part of a map that rays meet: an object that stands free, or a piece of a wall."""

    number: int
    """Its place in order of loss, from 1."""
    kind: str
    """It is an "object", a "corner" (also an end or a door frame) or a piece of "wall"."""
    x: float
    """World x of its middle [m]."""
    y: float
    """World y of its middle [m]."""
    length: float
    """Longer side of the least rectangle around it [m]."""
    width: float
    """Shorter side of that rectangle [m]."""
    heading: float
    """Heading of the longer side in the world, 0..pi [rad]."""
    seen: float
    """Share of the poses along the routes at which rays meet it, 0..1."""
    loss: float
    """How far the expected deviation along the routes rises without it [m].

    It may be negative: an object can hide what helps more.
    """
    share: float
    """The loss as a share of the expected deviation with all features."""
    worst: float
    """Maximum rise of the deviation without it at any place [m]."""
    worst_share: float
    """That rise as a share of the deviation there with all features."""
    worst_at: tuple[float, float]
    """World x and y of that place [m]."""
    error: float
    """Error of the position, root mean square along the routes, if it stands elsewhere [m].

    It is that to first order for a shift by `KeyFeatures.shift` in the worst direction, while the
    map shows it where it was: beams that meet it still count fully, so that a filter which
    rejects far ends errs less.
    """
    cells: Ints = dataclasses.field(repr=False)
    """Rows and columns of its cells, (k, 2)."""

    @property
    def matters(self) -> bool:
        """Whether the expected deviation rises by 10 % and 1 cm without it, or at a place.

        A place does where the deviation rises by half and 10 cm.
        """
        return (self.share >= MATTERS and self.loss >= MATTERS_M) or self.local

    @property
    def local(self) -> bool:
        """Whether the deviation rises by half and 10 cm at some place without it."""
        return self.worst_share >= PLACE and self.worst >= PLACE_M

    @property
    def title(self) -> str:
        """Kind and size."""
        return f"{self.kind} of {self.length:.1f} x {self.width:.1f} m"

    def corners(self) -> Floats:
        """Corners of the least rectangle around it in the world, (4, 2) [m]."""
        shape = Shape(self.length / 2, self.width / 2, is_round=False)
        return outline_of(shape, np.array([self.x, self.y, self.heading]))


COLUMNS = (
    Column("number", title="", digits=0),
    Column("kind", title="what"),
    Column("x", "m", "x", 1),
    Column("y", "m", "y", 1),
    Column("length", "m", "long", 1),
    Column("width", "m", "wide", 1),
    Column("heading", "rad"),
    Column("seen"),
    Column("loss", "m", "rise", 1, "cm"),
    Column("share", "", "rise", 0, "%", signed=True),
    Column("worst", "m", "worst", 1, "cm"),
    Column("worst_share"),
    Column("worst_x", "m", value=lambda feature: feature.worst_at[0]),
    Column("worst_y", "m", value=lambda feature: feature.worst_at[1]),
    Column("error", "m", "moved", 1, "cm"),
    Column("matters"),
)


@dataclass(frozen=True, eq=False, repr=False)
class KeyFeatures(Result):
    """The features of a map in order of loss, and the few whose loss together is greatest."""

    _drawn_by: ClassVar[str] = "locplan.landmarks:key_features_figure"
    _reported_by: ClassVar[str] = "locplan.landmarks._key_features:features_report"
    files: ClassVar[Results] = Results(
        "features",
        ("features.json", "features.png", "features.csv", "features.geojson", "verification.csv"),
    )

    grid: OccupancyGrid
    """The map."""
    routes: Mapping[str, Path]
    """Routes of the robot by name."""
    robot: Robot
    """The robot that was simulated."""
    features: tuple[Feature, ...]
    """All features that rays meet, the greatest loss first."""
    together: tuple[int, ...]
    """Numbers of the few features, from 1, whose removal hurts most: each is the worst beside those
    before it."""
    curve: Floats
    """Mean of P_xx + P_yy along the routes without the first 0, 1, ... of them, (k + 1,) [m^2]."""
    positions: Floats
    """World x and y of the poses along the routes, (n, 2) [m]."""
    begins: tuple[int, ...]
    """Indices at which the routes begin among `positions`, and the number of all, n."""
    profiles: Floats
    """P_xx + P_yy at `positions` with all, without feature 1, and without the few, (3, n) [m^2]."""
    shift: float
    """Distance by which `Feature.error` moves a feature [m]."""

    def __repr__(self) -> str:
        return f"KeyFeatures({len(self)} in {self.grid.name or 'map'}: {self.verdict})"

    def __len__(self) -> int:
        return len(self.features)

    @property
    def deviations(self) -> Floats:
        """Expected deviation without the first 0, 1, ... of the few, (k + 1,) [m]."""
        return np.sqrt(self.curve)

    @property
    def mattering(self) -> tuple[Feature, ...]:
        """Features that matter alone, see `Feature.matters`."""
        return tuple(each for each in self.features if each.matters)

    @property
    def stand_in(self) -> bool:
        """Whether the few stand in for each other: all matter, and each hides what another does.

        The rise without all is at least twice the sum of their own.
        """
        rise = float(self.deviations[-1] - self.deviations[0])
        alone = sum(max(self.features[n - 1].loss, 0.0) for n in self.together)
        large = rise >= max(MATTERS_M, MATTERS * float(self.deviations[0]))
        # Features stand in for each other if the rise without all is so many times the sum of
        # theirs.
        return len(self.together) > 1 and large and rise >= 2.0 * alone

    @property
    def verdict(self) -> str:
        """What the losses say, in one line."""
        if not self.features:
            return "no feature is seen from the routes: nothing there fixes its position"
        first, low = self.features[0], float(self.deviations[0])
        count = len(self.mattering)
        if count:
            what, it = ("1 feature", "it") if count == 1 else (f"{count} features", "the first")
            routes = "this route" if len(self.routes) == 1 else f"these {len(self.routes)} routes"
            at = self.mattering[0]
            said = (
                f"localization on {routes} depends on {what}: without {it} the expected deviation"
                f" rises from {in_cm(low)} to {in_cm(low + at.loss)} (+{at.share:.0%}), and by"
                f" {in_cm(at.worst)} at the worst place"
            )
        else:
            most = f"{first.share:.0%}, {in_cm(first.loss)}" if first.loss > 0 else "none"
            said = f"no single feature matters: the largest loss is {most}"
        few = len(self.together)
        if few > 1:
            high = float(self.deviations[-1])
            said += f"; without {few} together it is {in_cm(high)} (+{high / low - 1:.0%})"
            if self.stand_in:
                said += ", since they stand in for each other"
        return said

    def feature(self, number: int) -> Feature:
        """The feature of a number.

        Parameters
        ----------
        number : int
            Its place in order of loss, from 1.

        Raises
        ------
        ConfigError
            If there is no such feature.
        """
        if not 1 <= number <= len(self.features):
            raise ConfigError(f"there is no feature {number}: they are 1 to {len(self.features)}")
        return self.features[number - 1]

    def verify(
        self,
        drives: int = DRIVES,
        *,
        seed: int = 1,
        random_sets: int = 5,
        threads: int | None = None,
        progress: ProgressCallback | None = None,
    ) -> FeatureDrives:
        """Drive with all features, without the few in the world, and without random ones.

        Each of the few is also taken away alone.

        The robot's map stays, so that the filter compares with what is no longer there.

        Parameters
        ----------
        drives : int, default 100
            Number of drives along each route, 2 to 100,000; as many are made in all sets of random
            features together, and without the few one by one. More narrow the intervals.
        seed : int, default 1
            Seed of all random numbers, >= 0.
        random_sets : int, default 5
            Number of sets of as many random features, 1 to 1000.
        threads : int, optional
            Number of threads, at least 1; all cores by default.
        progress : callable, optional
            Called with (done, total) drives.

        Returns
        -------
        FeatureDrives
            Share of lost drives and errors in each world, and a verdict.

        Raises
        ------
        ConfigError
            If a number is out of its range, or there is no feature.
        """
        if not self.together:
            raise ConfigError("there is no feature to take away; choose routes that see some")
        check_drives(drives)
        whole("random_sets", random_sets, 1, 1000)
        few = {n: self.features[n - 1].cells for n in self.together}
        others = [each.cells for each in self.features if each.number not in few]
        count = min(len(few), len(others))
        sets = range(min(random_sets, drives // 2) if count else 0)
        # Stream of random numbers of features at random, beside those of places.
        orders = (random_of(seed, 103, n).permutation(len(others)) for n in sets)
        random = [[others[k] for k in order[:count]] for order in orders]
        single = self.together if len(few) > 1 else ()
        lacking = [[], [*few.values()], *([few[n]] for n in single)]
        run = partial(Simulator, robot=self.robot, filter_map=self.grid, seed=seed, threads=threads)

        def enter(cells: Sequence[Ints]) -> World:
            world = self.grid.cells.copy()
            for each in cells:
                world[tuple(each.T)] = FREE
            return run(dataclasses.replace(self.grid, cells=world)), self.routes

        driven, alone = compared(enter, lacking, random, drives, self.routes, progress)
        return FeatureDrives(*driven, seed, dict(zip(single, alone, strict=True)), len(few))

    def table(self) -> Table:
        """The features in order of loss; `together` says which of the few each is, if any."""
        order = {number: n for n, number in enumerate(self.together, 1)}
        together = Column("together", value=lambda each: order.get(each.number, math.nan))
        return Table.of((*COLUMNS, together), self.features)

    def _write(self, folder: FilePath, drives: FeatureDrives | None = None) -> None:
        table = self.table()
        table.write_csv(folder / "features.csv")
        outlines = (each.corners() for each in self.features)
        table.write_geojson(folder / "features.geojson", outlines)
        if drives:
            drives.table().write_csv(folder / "verification.csv")

    def summary(self, drives: FeatureDrives | None = None) -> dict[str, object]:
        """Verdict, features and settings in numbers, fit for JSON.

        Parameters
        ----------
        drives : FeatureDrives, optional
            What `verify` gave.
        """
        return finite(
            {
                "verification": drives.summary() if drives else None,
                "map": {"name": self.grid.name, "digest": self.grid.digest},
                "verdict": self.verdict,
                "expected_deviation": float(self.deviations[0]),
                "features": self.table().records(),
                "together": list(self.together),
                "expected_deviation_without": self.deviations.tolist(),
                "stand_in": self.stand_in,
                "shift": self.shift,
                "routes": {name: path.length for name, path in self.routes.items()},
                "robot": self.robot.summary(),
            }
        )


def in_cm(value: float) -> str:
    """A length in centimetres, or in metres from one on."""
    return f"{value:.2f} m" if value >= 1 else f"{100 * value:.1f} cm"

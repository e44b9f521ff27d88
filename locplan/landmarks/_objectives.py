"""What the choice of places makes small: uncertainty along routes, or degeneracy in a region."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.records import Column
from locplan.field import Fisher
from locplan.landmarks._sight import Sight
from locplan.robots import Lidar


@dataclass
class Objective(ABC):
    """What is made small by the choice of places."""

    name: ClassVar[str]
    """What it is, in a few words."""
    column: ClassVar[Column]
    """What is shown to people and in files: the objective to a power."""
    power: ClassVar[float]
    sight: Sight

    def start(self, chosen: Ints) -> None:
        """Begin from objects that stand at these places, (k,)."""
        self.sight.start(chosen)

    def value(self) -> float:
        """The objective with the objects."""
        return float(self.profile().mean())

    @abstractmethod
    def profile(self) -> Floats:
        """What it is the mean of, at each pose with the objects, (n,)."""

    @abstractmethod
    def values(self, indices: Ints) -> Floats:
        """The objective with each of these places besides, (m,)."""


@dataclass
class AlongRoutes(Objective):
    """Mean of P_xx + P_yy along routes [m^2], P the covariance that an information filter has.

    Between two looks P becomes F P F^T + Q ds, and at each (P^-1 + I)^-1, I the information of
    the beams that the filter compares.
    """

    name: ClassVar[str] = "deviation along the routes"
    column: ClassVar[Column] = Column("expected_deviation", "m", "expected deviation", 3)
    power: ClassVar[float] = 0.5

    def profile(self) -> Floats:
        """P_xx + P_yy at each pose with the objects, (n,) [m^2]."""
        return self.sight.seen.profile(self.sight.sums)

    def values(self, indices: Ints) -> Floats:
        """The objective with each of these places besides, (m,) [m^2]."""
        from locplan._kernels.objectives import uncertainties

        sight, seen = self.sight, self.sight.seen
        given = sight.sightings, sight.scene, seen.routes, seen.a_step, seen.motion
        return sight.in_threads(lambda part: uncertainties(sight.own, part, *given), indices)


@dataclass
class MeanDegeneracy(Objective):
    """Mean of the degeneracy u at the poses, 0 to 1.

    u is that of the estimators: the logarithm of the position's greatest deviation, from 0.05 m to
    that in a featureless place. The match there has the beams that the filter compares in 1 m of
    way, and the search window of `Fisher` as its prior.

    What a place changes depends only on the objects that are seen from where it is seen, so that it
    is found again only when these are others.
    """

    name: ClassVar[str] = "degeneracy"
    column: ClassVar[Column] = Column("mean_degeneracy", "", "mean degeneracy u", 3)
    power: ClassVar[float] = 1.0
    anchors: Any
    """`objectives.Anchors`."""

    @classmethod
    def of(cls, sight: Sight, lidar: Lidar) -> MeanDegeneracy:
        """The objective with the anchors of `Fisher`, and its search window as the prior."""
        from locplan._kernels.objectives import Anchors

        fisher = Fisher(lidar)
        window = fisher.lattice(sight.grid.resolution)
        prior = 1 / np.diag(window.uniform_covariance)
        turn = prior[2] if len(prior) > 2 else 1e6
        least = float(np.sqrt(fisher.perfect(window)[0, 0]))
        return cls(
            sight, Anchors(float(prior[0]), float(turn), least, float(1 / np.sqrt(prior[0])))
        )

    def __post_init__(self) -> None:
        count = len(self.sight.places)
        self._names = np.random.default_rng(0).integers(1, 2**63, count)
        """A number for each place; what stands is named by those of its places, by XOR."""
        self._beside = np.zeros(count, np.int64)
        """Name of the objects that matter to each place now."""
        self._known = np.full(count, -1)
        """Name of those beside which each place was looked at."""
        self._changes = np.zeros(count)
        """What each place changes beside these."""
        self._together: dict[int, Bools] = {}

    def start(self, chosen: Ints) -> None:
        """Begin from objects that stand at these places, (k,)."""
        super().start(chosen)
        self._beside[:] = 0
        for n in chosen.tolist():
            if n not in self._together:
                self._together[n] = self.sight.seen_with(n)
            self._beside[self._together[n]] ^= self._names[n]

    def profile(self) -> Floats:
        """The degeneracy u at each pose with the objects, (n,)."""
        from locplan._kernels.objectives import degeneracies_at

        sight = self.sight
        return np.asarray(degeneracies_at(sight.sums, sight.seen.a_metre, self.anchors))

    def values(self, indices: Ints) -> Floats:
        """The objective with each of these places besides, (m,)."""
        from locplan._kernels.objectives import mean_changes

        sight, seen = self.sight, self.sight.seen
        profile = self.profile()
        given = sight.sightings, sight.scene, seen.a_metre, self.anchors, profile
        indices = np.asarray(indices, np.int64)
        anew = indices[self._known[indices] != self._beside[indices]]
        self._changes[anew] = sight.in_threads(
            lambda part: mean_changes(sight.own, part, *given), anew
        )
        self._known[anew] = self._beside[anew]
        return np.asarray(float(profile.mean()) + self._changes[indices])

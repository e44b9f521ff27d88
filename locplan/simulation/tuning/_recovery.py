"""How often a filter finds its robot again: after it was lost, and after a kidnapping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.intervals import Interval, in_percent, wilson
from locplan._util.poses import Poses, after_way, way_along, way_between
from locplan.simulation._drives import OFF

KIDNAPPINGS = (1.0, 3.0)
"""Distances by which robots are kidnapped [m]."""
BEFORE, AFTER = 3.0, 10.0
"""Length of the way up to a kidnapping, and up to where the filter must be back [m]."""


@dataclass(frozen=True)
class Recovery:
    """How often a filter came back to within 0.5 m."""

    derived: ClassVar[tuple[str, ...]] = ("share",)

    after: str
    """What it came back from."""
    back: int
    """Number of the drives in which it came back."""
    drives: int
    """Number of all drives in which this happened."""

    @classmethod
    def of(cls, after: str, errors: Floats) -> Recovery:
        """The recoveries of drives with these position errors in the end [m]."""
        return cls(after, int((errors <= OFF).sum()), len(errors))

    @property
    def share(self) -> Interval:
        """Share of the drives in which it came back."""
        return wilson(self.back / self.drives, self.drives)

    @property
    def sentence(self) -> str:
        """The counts in words."""
        ends = in_percent(self.share).split(" ", 1)[1]
        return f"{self.after}, in {self.back} of {self.drives} drives {ends}"


class Kidnapping(NamedTuple):
    """A robot that is carried on along its way, of which its odometry knows nothing."""

    first: int
    """Index of the last pose before."""
    kept: Ints
    """Indices of the poses before and after it, up to 10 m later."""

    @classmethod
    def on(cls, poses: Poses, metres: float) -> Kidnapping | None:
        """The kidnapping by a distance early on a line; None if the line is too short.

        Parameters
        ----------
        poses : (n, 3) array
            The line [m, m, rad].
        metres : float
            The distance [m].
        """
        way = way_along(poses)
        first = int(np.searchsorted(way, min(BEFORE, way[-1] / 4)))
        away = np.hypot(*(poses[first:, :2] - poses[first, :2]).T)
        if away.max() < metres:
            return None
        last = first + int(np.argmax(away >= metres))
        end = int(np.searchsorted(way, way[last] + AFTER)) + 1
        kept = np.r_[: first + 1, last : min(end, len(poses))]
        return cls(first, kept)

    def odometry(self, poses: Poses) -> Poses:
        """The poses that are kept, (kept, 3), as a robot reports them that does not know of it.

        Parameters
        ----------
        poses : (n, 3) array
            Those of the whole line, true or reported [m, m, rad].
        """
        after = self.first + 1
        some = poses[self.kept]
        on = after_way(some[self.first], way_between(some[after], some[after:]))
        return np.concatenate([some[:after], on])

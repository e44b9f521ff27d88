"""Closed-loop drives and how they end: steered by its estimate, does the robot arrive?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from locplan._util.checks import Settings, positive
from locplan._util.intervals import Interval, wilson
from locplan._util.poses import Poses
from locplan._util.records import POSE, Column, Table
from locplan.simulation._drives import check_drives

ARRIVED, ELSEWHERE, STUCK, TIMED_OUT = "arrived", "elsewhere", "stuck", "timed out"
"""How a drive ends; elsewhere, the robot believes to be at the goal, and is not."""
FOLLOWER = "a pursuit follower"
"""What steers."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Closed(Settings):
    """Closed-loop drives that `simulate` adds.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """

    drives: int = 40
    """Number of drives along each path, 2 to 100,000."""
    replan: float | None = None
    """Time after which a new plan is made in any case, above 0 [s]; None plans only where something
    is in the way."""

    def __post_init__(self) -> None:
        check_drives(self.drives)
        if self.replan is not None:
            positive("replan", self.replan, "s")


@dataclass(frozen=True, eq=False, repr=False)
class Arrival:
    """One closed-loop drive."""

    outcome: str
    """How it ended: arrived, elsewhere, stuck or timed out."""
    truth: Poses
    """The true poses every 0.1 s, (n, 3), in the world [m, m, rad]."""
    believed: Poses
    """The filter's poses, (n, 3), in the world [m, m, rad]."""
    follower_fails: bool = False
    """Whether the drive fails with perfect localization, too."""

    def __repr__(self) -> str:
        return f"Arrival({self.outcome} after {self.seconds:.1f} s)"

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        from locplan._kernels.follower import TICK

        return (len(self.truth) - 1) * TICK


@dataclass(frozen=True, eq=False, repr=False)
class Arrivals:
    """Closed-loop drives along one path; the n-th of two paths have the same world and seed."""

    drives: tuple[Arrival, ...]
    """The drives by number."""

    def __repr__(self) -> str:
        return f"Arrivals({self.arrived.value:.0%} of {len(self.drives)} arrived)"

    @property
    def arrived(self) -> Interval:
        """Share of the drives that arrive, 0..1, with its 95 % interval."""
        return wilson(self._share(ARRIVED), len(self.drives))

    @property
    def elsewhere(self) -> float:
        """Share of those that end where the robot believes to be at the goal, and is not."""
        return self._share(ELSEWHERE)

    @property
    def stuck(self) -> float:
        """Share of those that come no farther."""
        return self._share(STUCK)

    @property
    def timed_out(self) -> float:
        """Share of those that take too long."""
        return self._share(TIMED_OUT)

    @property
    def follower_fails(self) -> float:
        """Share of those that fail with perfect localization, too: they are the follower's."""
        return sum(each.follower_fails for each in self.drives) / len(self.drives)

    def _share(self, outcome: str) -> float:
        return sum(each.outcome == outcome for each in self.drives) / len(self.drives)

    def summary(self) -> dict[str, object]:
        """Shares of the drives by their ends, fit for JSON."""
        about = {each.name: each.of(self) for each in ARRIVING}
        return {"drives": len(self.drives), **about, "arrived": list(self.arrived)}


ARRIVING = (
    Column("arrived", "", f"arrives, with {FOLLOWER}", 0, "%", interval=True),
    Column("elsewhere", "", "believes to be there, is elsewhere", 0, "%"),
    Column("stuck", "", "gets stuck", 0, "%"),
    Column("timed_out", "", "runs out of time", 0, "%"),
    Column("follower_fails", "", "fails with perfect localization, too", 0, "%"),
)
"""Columns of `Arrivals`."""


ENDS = (
    Column("path"),
    Column("drive"),
    Column("outcome"),
    Column("seconds", "s"),
    *POSE,
    *(Column(f"believed_{each.name}", each.unit) for each in POSE),
)
"""Columns of the ends of closed-loop drives."""


def ends_of(arrivals: Mapping[str, Arrivals]) -> Table:
    """Where the closed-loop drives along some paths ended, and where the filter believed to be."""
    rows = (
        (name, n, each.outcome, each.seconds, *each.truth[-1], *each.believed[-1])
        for name, found in arrivals.items()
        for n, each in enumerate(found.drives)
    )
    return Table(ENDS, tuple(rows))

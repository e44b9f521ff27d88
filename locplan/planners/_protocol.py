"""What a planner is: checked options, preparation, and a search from a start to a goal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from locplan.costs import Costmap, Path

Position = tuple[float, ...]
"""x, y in the world [m], and a heading [rad] where the planner's space has one."""
Status = Literal["solved", "unreachable", "infeasible", "timeout"]


@dataclass(frozen=True)
class Found:
    """What a planner found from a start to a goal."""

    path: Path | None = field(default=None, repr=False)
    """The path from start to goal, or None."""
    status: Status = "unreachable"
    """Why there is no path; with a path it is always "solved"."""
    note: str = ""
    """Why there is no path, and what would help, if that is known."""
    history: tuple[tuple[float, float], ...] = field(default=(), repr=False)
    """Seconds since an anytime planner began and its best J [m], whenever that fell."""
    bound: float | None = None
    """Least length that a path within the budget can have [m]."""
    feasible_from: float | None = None
    """Least limit with which there is a path, in the unit of the limit, if infeasible."""
    solve_time: float | None = None
    """Time spent planning, where the planner measures that itself [s]."""

    def __post_init__(self) -> None:
        if self.path is not None:
            object.__setattr__(self, "status", "solved")


@runtime_checkable
class Planner(Protocol):
    """A planner with its options, most simply a frozen dataclass whose fields are the options.

    `locplan.plan` and `locplan.compare` take any object with these members. An option `seed` (None
    by default) is set to each of a comparison's seeds, an option `time_limit` [s] to its limit.
    """

    @property
    def name(self) -> str:
        """What the planner is called."""

    @property
    def minimises(self) -> str | None:
        """What its paths have least of, such as "J"; None if it stops at any path."""

    @property
    def space(self) -> str:
        """Where it plans: "R2", or "SE2", "Dubins" or "ReedsShepp", whose poses have headings."""

    def check(self) -> None:
        """Raise a ConfigError if the options do not fit together."""

    def prepare(self) -> None:
        """Compile and load what `solve` needs, so that no plan is timed with it."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan between two world positions [m] or poses [m, rad] where the robot can stand."""


@dataclass(frozen=True)
class Wrapper:
    """A planner that adds something to another one; what it does not say itself is the other's."""

    planner: Planner
    """The planner that searches."""

    @property
    def name(self) -> str:
        """What the planner is called."""
        return self.planner.name

    @property
    def minimises(self) -> str | None:
        """What its paths have least of."""
        return self.planner.minimises

    @property
    def space(self) -> str:
        """Where it plans."""
        return self.planner.space

    def check(self) -> None:
        """Raise a ConfigError if the options do not fit together."""
        self.planner.check()

    def prepare(self) -> None:
        """Compile and load what `solve` needs."""
        self.planner.prepare()

    def solve(self, costs: Costmap, start: Position, goal: Position) -> Found:
        """Plan between two positions."""
        return self.planner.solve(costs, start, goal)

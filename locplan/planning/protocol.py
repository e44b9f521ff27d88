"""The protocol of planners, from checked options to a search, and the spaces that they plan in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

from locplan._support.checks import check_choice, check_positive, short_repr
from locplan.errors import ConfigError, PoseError

if TYPE_CHECKING:
    from locplan.planning.costmap import Costmap
    from locplan.planning.path import Path

SPACES: tuple[str, ...] = ("R2", "SE2", "Dubins", "ReedsShepp")
"""The spaces: positions; poses that turn on the spot; forward curves; curves that may reverse."""
CURVED = ("Dubins", "ReedsShepp")
"""The spaces whose motions are curves with a least turning radius."""
LATTICE = "lattice"
"""The space of the robot's own motions, whose ends may have a heading or none."""
Position = tuple[float, ...]
"""Position x, y in the world [m], and a heading [rad] where the planner's space has one."""
MAX_SEED = 2**32 - 1
"""Maximum seed of a planner's random numbers; OMPL's have 32 bits."""
Status = Literal["solved", "unreachable", "infeasible", "timeout", "not found"]
"""What became of a plan: "unreachable" and "infeasible" are proven, "not found" is not."""


@dataclass(frozen=True)
class PlannerResult:
    """A path that a planner found from a start to a goal, or why it found none."""

    path: Path | None = field(default=None, repr=False)
    """The path from start to goal, or None."""
    status: Status = "not found"
    """The reason why there is no path; with a path it becomes "solved"."""
    note: str = ""
    """A text on why there is no path and what would help; empty if that is not known."""
    history: tuple[tuple[float, float], ...] = field(default=(), repr=False)
    """Time since an anytime planner began [s] and its best J [m], whenever that fell."""
    bound: float | None = None
    """Minimum length that a path within the budget can have [m]; None without a budget."""
    feasible_from: float | None = None
    """Limit below which there is no path, in the limit's unit, if it is infeasible."""
    expanded: int | None = None
    """Number of cells that a search over the grid expanded, over all legs; None if not counted."""
    solve_time: float | None = None
    """Time spent planning [s], where the planner measures that itself; else `plan` does."""

    def __post_init__(self) -> None:
        if self.path is not None:
            if self.status not in ("not found", "solved"):
                raise ConfigError(
                    "the status of a result with a path must be solved, not"
                    f" {short_repr(self.status)}"
                )
            object.__setattr__(self, "status", "solved")


@runtime_checkable
class Planner(Protocol):
    """A planner with its options, most simply a frozen dataclass whose fields are the options.

    `locplan.plan` and `locplan.compare` take any object with these members. An option `seed` (None
    by default) is set to each of a comparison's seeds, an option `time_limit` [s] to its limit.
    """

    @property
    def name(self) -> str:
        """The planner's name."""

    @property
    def minimises(self) -> str | None:
        """The quantity that its paths minimise, such as "J"; None if it stops at any path."""

    @property
    def space(self) -> str:
        """The space it plans in: "R2"; one with headings, "SE2", "Dubins" or "ReedsShepp"; or
        "lattice", where ends may have a heading or none."""

    def check(self) -> None:
        """Raise a ConfigError if the options do not fit together."""

    def prepare(self) -> None:
        """Compile and load what `solve` needs, so that no plan is timed with it."""

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between two free world positions [m] or poses [m, rad].

        Parameters
        ----------
        costs : Costmap
            The costmap to plan on, which must not be changed.
        start, goal : (x, y) or (x, y, heading)
            Positions in the world [m], with a heading in -pi..pi [rad] in all spaces but "R2".
            `locplan.plan` has checked them.

        Returns
        -------
        PlannerResult
            The path from start to goal, whose ends may be off by 1.5 cells; or the reason why
            there is none.
        """


@dataclass(frozen=True)
class PlannerWrapper(Planner):
    """A planner that wraps another planner and adds to it."""

    planner: Planner
    """The planner that searches."""

    @property
    def name(self) -> str:
        return self.planner.name

    @property
    def minimises(self) -> str | None:
        return self.planner.minimises

    @property
    def space(self) -> str:
        return self.planner.space

    def check(self) -> None:
        self.planner.check()

    def prepare(self) -> None:
        self.planner.prepare()


def check_space(space: str, turning_radius: float | None) -> None:
    """Raise a ConfigError unless the space and the turning radius go together."""
    check_choice("space", space, SPACES)
    if space not in CURVED:
        if turning_radius is not None:
            raise ConfigError(f"a turning radius is for the spaces {', '.join(CURVED)}")
    elif turning_radius is None:
        raise ConfigError(f"space {short_repr(space)} needs a turning radius, in metres")
    else:
        check_positive("turning_radius", turning_radius, "m")


def check_pose(
    costs: Costmap, pose: Sequence[float], role: str, *, has_heading: bool | None
) -> tuple[float, ...]:
    """Return a pose as numbers, or raise a PoseError if the robot cannot stand there.

    `has_heading` is True if it must have a heading, False if it has none, None if both are allowed.
    """
    try:
        numbers = tuple(float(value) for value in pose)
    except (TypeError, ValueError):
        numbers = ()
    if has_heading is None:
        has_heading = len(numbers) == 3
    if has_heading and not (len(numbers) == 3 and math.isfinite(numbers[2])):
        raise PoseError(f"{role} must be x, y [m] and a heading, not {short_repr(pose)}")
    if not has_heading and len(numbers) == 3:
        raise PoseError(
            f"{role} must be x, y [m]; only plans in SE2, Dubins or ReedsShepp have a heading"
        )
    costs.find_cell(numbers[:2] if has_heading else pose, role)
    if has_heading:
        return (*numbers[:2], wrap_heading(numbers[2]))
    return numbers


def wrap_heading(heading: float) -> float:
    """Return a heading wrapped to -pi..pi [rad]; pi becomes -pi, since OMPL's spaces reject pi."""
    if -math.pi <= heading < math.pi:
        return heading
    return (heading + math.pi) % (2 * math.pi) - math.pi

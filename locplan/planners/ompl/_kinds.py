"""What OMPL's planners can do on a costmap, found by trying each in every space."""

from __future__ import annotations

from dataclasses import dataclass

from locplan.planners._spaces import SPACES

_NOT_DUBINS = tuple(space for space in SPACES if space != "Dubins")
"""Of planners that drive curves backwards, or find none: FMT and its kin not within 25 s."""


@dataclass(frozen=True)
class Kind:
    """One of OMPL's planners."""

    minimises: bool
    """Whether it seeks the least J; the others stop at the first path that they find."""
    spaces: tuple[str, ...] = SPACES
    """Where it works."""
    from_grid: bool = False
    """Whether it can begin with the grid planner's path, in "R2"."""
    anytime: bool = False
    """Whether it goes on improving its path, so that it can be asked to stop on convergence."""


KINDS: dict[str, Kind] = {
    "RRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "InformedRRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "SORRTstar": Kind(minimises=True, from_grid=True, anytime=True),
    "BITstar": Kind(minimises=True, anytime=True),
    "FMT": Kind(minimises=True, spaces=_NOT_DUBINS),
    "BFMT": Kind(minimises=True, spaces=_NOT_DUBINS),
    "PRM": Kind(minimises=True, from_grid=True),
    "PRMstar": Kind(minimises=True, from_grid=True),
    "RRT": Kind(minimises=False),
    "RRTConnect": Kind(minimises=False),
    "KPIECE1": Kind(minimises=False),
    "BKPIECE1": Kind(minimises=False, spaces=_NOT_DUBINS),
    "LBKPIECE1": Kind(minimises=False, spaces=_NOT_DUBINS),
}
"""By OMPL's own names."""


def able(**wanted: object) -> str:
    """The names of the planners with these properties, for messages: `space` or a field."""
    names = []
    for name, kind in KINDS.items():
        fits = all(
            value in kind.spaces if key == "space" else getattr(kind, key) == value
            for key, value in wanted.items()
        )
        names += [name] if fits else []
    return ", ".join(names)

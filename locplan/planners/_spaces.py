"""The spaces that planners plan in, and the poses in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from locplan._util.checks import one_of, positive, shown
from locplan.errors import ConfigError, PoseError

if TYPE_CHECKING:
    from locplan.costs import Costmap

SPACES: tuple[str, ...] = ("R2", "SE2", "Dubins", "ReedsShepp")
"""The spaces: positions; poses that turn on the spot; forward curves; curves that may reverse."""
CURVED = ("Dubins", "ReedsShepp")
"""The spaces whose motions are curves with a least turning radius."""


def check_space(space: str, turning_radius: float | None) -> None:
    """Raise a ConfigError unless the space and the turning radius go together."""
    one_of("space", space, SPACES)
    if space not in CURVED:
        if turning_radius is not None:
            raise ConfigError(f"a turning radius is for the spaces {', '.join(CURVED)}")
    elif turning_radius is None:
        raise ConfigError(f"space {shown(space)} needs a turning radius, in metres")
    else:
        positive("turning_radius", turning_radius, "m")


def check_pose(
    costs: Costmap, pose: Sequence[float], role: str, *, headed: bool
) -> tuple[float, ...]:
    """A pose as numbers, or a PoseError if the robot cannot stand there; see `Motions.checked`."""
    try:
        numbers = tuple(float(value) for value in pose)
    except (TypeError, ValueError):
        numbers = ()
    if headed and not (len(numbers) == 3 and math.isfinite(numbers[2])):
        raise PoseError(f"{role} must be x, y [m] and a heading, not {shown(pose)}")
    if not headed and len(numbers) == 3:
        raise PoseError(f"{role} must be x, y [m]: without SE2, Dubins or ReedsShepp no heading")
    costs.cell_of(numbers[:2] if headed else pose, role)
    if headed:
        return (*numbers[:2], wrapped(numbers[2]))
    return numbers


def wrapped(heading: float) -> float:
    """A heading wrapped to -pi..pi [rad]; pi becomes -pi, since OMPL's spaces do not take it."""
    if -math.pi <= heading < math.pi:
        return heading
    return (heading + math.pi) % (2 * math.pi) - math.pi

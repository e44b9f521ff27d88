"""How a robot moves, and how far its navigation keeps it off the walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from locplan._util.checks import Settings, instance, keep_checked, number, one_of, positive
from locplan.errors import ConfigError

CAR_LIKE: Final = "car-like"
DRIVES = ("differential", "omnidirectional", CAR_LIKE)


@dataclass(frozen=True, kw_only=True, repr=False)
class Kinematics(Settings):
    """How a robot moves.

    Raises
    ------
    ConfigError
        If a value is out of its range, or a robot that turns on the spot has a turning radius.

    Examples
    --------
    >>> Kinematics(drive="car-like", turning_radius=1.2)
    Kinematics(drive='car-like', turning_radius=1.2)
    """

    drive: Literal["differential", "omnidirectional", "car-like"] = "differential"
    """A differential drive turns on the spot, an omnidirectional one moves sideways, too, and a
    car-like one needs a turning radius."""
    turning_radius: float = 0.0
    """Least turning radius, above 0 for a car-like robot and else 0 [m]."""
    reverse: bool = True
    """Whether the robot drives in reverse, too."""
    speed: float = 0.5
    """Usual speed, above 0 [m/s]."""

    def __post_init__(self) -> None:
        one_of("drive", self.drive, DRIVES)
        instance("reverse", self.reverse, bool, "give true or false")
        keep_checked(self, ("turning_radius",), number, 0.0)
        keep_checked(self, ("speed",), positive)
        if (self.drive == CAR_LIKE) != (self.turning_radius > 0):
            raise ConfigError(
                "a car-like robot, and no other, has a turning_radius above 0; this one is"
                f" {self.drive} with {self.turning_radius:g} m"
            )


@dataclass(frozen=True, kw_only=True, repr=False)
class Inflation(Settings):
    """Nav2's inflation of a costmap, which keeps planned paths off the walls.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> Inflation(inflation_radius=0.7).cost_scaling_factor
    10.0
    """

    inflation_radius: float = 0.55
    """Distance from walls up to which cells cost more, >= 0 [m]."""
    cost_scaling_factor: float = 10.0
    """Decay of the cost with the distance, above 0 [1/m]."""

    def __post_init__(self) -> None:
        keep_checked(self, ("inflation_radius",), number, 0.0)
        keep_checked(self, ("cost_scaling_factor",), positive)

"""The size of a robot in its parameters of Nav2."""

from __future__ import annotations

import os
from dataclasses import dataclass

from locplan._util.checks import positive
from locplan.costs._footprint import Footprint
from locplan.errors import ConfigError
from locplan.maps import read_parameters

COSTMAPS = ("global_costmap", "local_costmap")
"""Costmaps with the size of the robot; that of the first one counts."""


@dataclass(frozen=True)
class RobotSize:
    """The radius or the outline of a robot, without any padding."""

    radius: float
    """Radius of the robot, or of the largest circle about its centre within its outline [m]."""
    footprint: Footprint | None
    """The outline, if the robot is not round."""
    source: str
    """What was read, and from where, for people."""


def read_robot_size(path: str | os.PathLike[str]) -> RobotSize | None:
    """Read a robot's size from a parameter file of Nav2; None where the file does not say it.

    It is that of the global costmap, or else that of the local one: as in Nav2 `footprint` where
    it is not "[]", or else `robot_radius`. Footprint_padding and the inflation are left out.

    Parameters
    ----------
    path : path
        The YAML file; where it has several robots, the namespace of one follows, as in
        "nav2.yaml:robot1".

    Raises
    ------
    LocplanError
        If the file cannot be read, or the size is none.
    """
    parameters = read_parameters(path)
    for costmap in COSTMAPS:
        own = parameters.of(f"{costmap}/{costmap}")
        footprint, radius = str(own.get("footprint") or "[]"), own.get("robot_radius")
        where = f"of {costmap} in {path}"
        try:
            if footprint != "[]":
                outline = Footprint.from_text(footprint)
                inner = outline.inscribed_radius
                source = f"footprint {footprint} (inscribed radius {inner:.3g} m) {where}"
                return RobotSize(inner, outline, source)
            if radius is not None:
                radius = positive("robot_radius", radius, "m")
                return RobotSize(radius, None, f"robot_radius {radius:g} m {where}")
        except ConfigError as error:
            raise ConfigError(f"{path}: {costmap}: {error}") from None
    return None

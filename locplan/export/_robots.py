"""A robot's own Nav2: its distribution, its parameters, and what in them does not go with ours."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from locplan.export._distros import Distribution, distribution
from locplan.export._travel_costs import PLANNERS
from locplan.robots import (
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
)

PLANNER = "smac2d"
"""The planner of Nav2 that a mask is for where the robot's own is not known."""
SPEED_TOPIC = "/speed_limit"
"""Topic of the limits that the controller server obeys."""


class RobotWarning(UserWarning):
    """A robot's own parameters do not go with an export."""


@dataclass(frozen=True)
class Robot:
    """A robot's own parameters of Nav2, into which ours are merged."""

    distribution: Distribution
    """The distribution of ROS 2 that it runs."""
    file: Path | None
    """The file of its parameters, if there is one."""
    parameters: Nav2Parameters
    """The parameters in the file; none without a file."""

    @classmethod
    def of(cls, params: str | Path | None, distro: str) -> Robot:
        """Read the file and warn of the distribution's faults; a LocplanError where it cannot."""
        robot = cls(distribution(distro), Path(params) if params else None, read_parameters(params))
        robot.distribution.warn()
        robot.warn(robot._misspelt())
        return robot

    @property
    def planners(self) -> dict[str, str]:
        """The plugin of each of its planners by name, as it is written from Jazzy on."""
        return {name: plugin.replace("/", "::") for name, plugin in self._plugins().items()}

    @property
    def planner(self) -> str:
        """Its first planner of those that a mask can be for, as `PLANNERS` names it."""
        known = {each.plugin: name for name, each in PLANNERS.items()}
        return next((known[each] for each in self.planners.values() if each in known), PLANNER)

    def warn(self, notes: Iterator[str]) -> None:
        """Warn of what does not go together."""
        for note in notes:
            name = self.file.name if self.file else ""
            warnings.warn(RobotWarning(f"{name}: {note}"), stacklevel=4)

    def of_planner(self, called: str) -> Iterator[str]:
        """That ours stands beside its own planners."""
        others = [f"{name} ({plugin})" for name, plugin in self.planners.items() if name != called]
        if others and called not in self.planners:
            yield (
                f"its planners are {', '.join(others)}; {called} is added for the mask, and plans"
                " only where the behaviour tree names it (planner_id), or take another --planner"
            )

    def of_speed(self, own: str) -> Iterator[str]:
        """That another speed filter limits the same robot."""
        for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for name, value in self.parameters.of(costmap).items():
                layer, _, last = name.rpartition(".")
                if last == "plugin" and layer != own and str(value).endswith("SpeedFilter"):
                    yield (
                        f"{costmap.partition('/')[0]} has a speed filter, {layer}; both publish"
                        " limits, and the one that came last counts: merge the masks, or leave one"
                        " out"
                    )

    def of_radius(self, radius: float) -> Iterator[str]:
        """That it is larger than the robot that lanes were made for."""
        own = self.parameters.of(GLOBAL_COSTMAP).get("robot_radius")
        if isinstance(own, (int, float)) and own > radius + 1e-9 and math.isfinite(own):
            yield (
                f"its robot_radius is {own:g} m, but the ways are for {radius:g} m; give"
                f" --set footprint={own:g}"
            )

    def _misspelt(self) -> Iterator[str]:
        """That its planners are written as in another distribution."""
        for name, plugin in self._plugins().items():
            if "/" in plugin and not self.distribution.slashes:
                yield f"{name} is {plugin}, as in humble; give --distro humble if that runs there"
            elif "::" in plugin and self.distribution.slashes:
                yield f"{name} is {plugin}, as from jazzy on, but humble has / for ::"

    def _plugins(self) -> dict[str, str]:
        """The plugin of each of its planners by name, as the file has it."""
        server = self.parameters.of(PLANNER_SERVER)
        names = self.parameters.names(PLANNER_SERVER, "planner_plugins")
        return {name: str(server.get(f"{name}.plugin", "")) for name in names}

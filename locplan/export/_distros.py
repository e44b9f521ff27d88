"""What differs between the distributions of ROS 2 in what an export for Nav2 must say.

Read from the branches humble, jazzy, kilted, lyrical and main of ros-navigation/navigation2
(2026-11); rolling is built from main.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

from locplan._util.checks import one_of


class DistroWarning(UserWarning):
    """A distribution of ROS 2 has a fault that concerns the localization."""


@dataclass(frozen=True)
class Distribution:
    """A distribution of ROS 2, as far as exports depend on it."""

    name: str
    """The name, such as jazzy."""
    slashes: bool = False
    """Whether planners' plugins are named with / for :: (nav2_smac_planner/smac_plugin_2d.xml and
    its like), up to iron."""
    quadratic_penalty: bool = True
    """Whether SmacPlannerHybrid has `use_quadratic_cost_penalty`, from jazzy on."""
    graph_by: Literal["launch", "parameters", "argument"] = "argument"
    """How the route server gets its graph (nav2_bringup/launch): bringup starts none in humble, so
    that our launch file does; one with graph_filepath of its parameters in jazzy; and one with the
    argument ``graph:=``, which replaces graph_filepath, from kilted on."""
    inscribed_value: bool = True
    """Whether a StaticLayer takes one value of a map for the inscribed cost, by default 99
    (nav2_costmap_2d/plugins/static_layer.cpp, inscribed_obstacle_cost_value), from lyrical on."""
    unsure_field: bool = True
    """Whether AMCL's likelihood field is made from an uninitialised variable (`CellData cell` in
    nav2_amcl/src/map/map_cspace.cpp), from kilted on."""

    def warn(self) -> None:
        """Warn of what a user of this distribution should know."""
        if self.unsure_field:
            warnings.warn(
                DistroWarning(
                    f"{self.name}: AMCL's likelihood field may be wrong there, since it starts from"
                    " an uninitialised variable (map_cspace.cpp, CellData cell); build nav2_amcl"
                    " with its occ_dist set to 0"
                ),
                stacklevel=2,
            )


DISTRIBUTIONS = {
    each.name: each
    for each in (
        Distribution("humble", True, False, "launch", inscribed_value=False, unsure_field=False),
        Distribution("jazzy", graph_by="parameters", inscribed_value=False, unsure_field=False),
        Distribution("kilted", inscribed_value=False),
        Distribution("lyrical"),
        Distribution("rolling"),
    )
}
"""Distributions that exports are made for, by name."""


def distribution(name: str) -> Distribution:
    """A distribution of ROS 2 by its name.

    Parameters
    ----------
    name : str
        One of `DISTRIBUTIONS`.

    Raises
    ------
    ConfigError
        If there is none of this name.
    """
    one_of("distro", name, DISTRIBUTIONS)
    return DISTRIBUTIONS[name]

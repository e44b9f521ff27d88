"""What differs between the distributions of ROS 2, and what Nav2's planners charge for costs.

Formulas read from ros-navigation/navigation2, branches humble to main (2026-08): node_2d.cpp,
node_hybrid.cpp, navfn.cpp and theta_star.hpp.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import one_of
from locplan._util.reading import ROS_BOOLEANS, ROS_NUMBER
from locplan.errors import ConfigError
from locplan.export._registry import rendered


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


@dataclass(frozen=True)
class Server:
    """A lifecycle node of Nav2."""

    package: str
    executable: str
    name: str
    parameters: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)
    """Parameters that name a file in the folder; the launch file alone has them.

    It writes them for all nodes, "/**". rclcpp would take a name in the parameter file, written
    for this node, instead of it where a -p comes before the files (parameter_map.cpp), as
    launch_ros's SetParameter puts it.
    """


def write_servers(folder: Path, servers: Sequence[Server], manager_name: str) -> None:
    """Write the nodes' parameters, and a launch file that starts and activates them."""
    manager = Server(
        "nav2_lifecycle_manager",
        "lifecycle_manager",
        manager_name,
        {"autostart": True, "node_names": [server.name for server in servers]},
    )
    nodes = [*servers, manager]
    parameters = {node.name: {"ros__parameters": dict(node.parameters)} for node in nodes}
    write_yaml(folder / "servers.yaml", parameters)
    launch = folder / "localizability.launch.xml"
    launch.write_text(rendered("servers.launch.xml", nodes=nodes), "utf-8")


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write parameters so that ROS reads each text as a text."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """A dumper that quotes what is a text to PyYAML only."""

    def represent(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
        plain = text in ROS_BOOLEANS or ROS_NUMBER.fullmatch(text)
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, '"' if plain else None)

    Dumper.add_representer(str, represent)
    text = yaml.dump(dict(content), Dumper=Dumper, sort_keys=False, allow_unicode=True)
    path.write_text(text, "utf-8")


RETROSPECTIVE_PENALTY = 0.015
"""SmacPlannerHybrid's default, which multiplies every step by 1 minus it."""
_NO_LIMIT = {"max_iterations": -1}
"""A mask can make the Smac planners expand several times as many cells, on large maps more than the
million at which they give up by default; so they get no limit, and five times their own time."""


@dataclass(frozen=True)
class NavPlanner:
    """A planner of Nav2, and its charge per metre beyond that of free space, as a share of it."""

    name: str
    plugin: str
    """Name of the plugin from Jazzy on; Humble writes / for ::."""
    parameter: str | None
    """The parameter that scales costs; None if there is none."""
    excess: Callable[[NDArray[np.float64], float], NDArray[np.float64]]
    """Function from costmap values 0..252 and the parameter to the share charged."""
    parameter_for: Callable[[float, float], float]
    """Function from a costmap value and an excess to the parameter at which it means that."""
    default: float = math.nan
    """Value of that parameter in Nav2's code; NaN if there is none."""
    assumed: Mapping[str, Any] = field(default_factory=dict)
    """Other parameters that must be as they are here."""
    planning_time: float | None = None
    """Minimum time that the planner needs for a way over a mask [s]; None if it has no limit."""


def _theta_star_term(costs: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return ((26 + 0.9 * np.asarray(costs)) / 252) ** 2


def _theta_star_weight(cost: float, excess: float) -> float:
    free, full = float(_theta_star_term(0)), float(_theta_star_term(cost))
    if full <= free * (1 + excess):
        raise ConfigError(
            f"thetastar cannot charge {1 + excess:g} times as much for degenerate cells as for free"
            f" ones, {full / free:.0f} times at most: set the parameter, or a smaller weight"
        )
    return excess / (full - free * (1 + excess))


PLANNERS = {
    planner.name: planner
    for planner in (
        NavPlanner(
            "smac2d",
            "nav2_smac_planner::SmacPlanner2D",
            "cost_travel_multiplier",
            lambda costs, k: k * costs / 252,
            lambda cost, excess: excess * 252 / cost,
            1.0,
            _NO_LIMIT,
            planning_time=10.0,
        ),
        NavPlanner(
            "smac-hybrid",
            "nav2_smac_planner::SmacPlannerHybrid",
            "cost_penalty",
            lambda costs, k: k * costs / 252 / (1 - RETROSPECTIVE_PENALTY),
            lambda cost, excess: excess * (1 - RETROSPECTIVE_PENALTY) * 252 / cost,
            2.0,
            {
                "retrospective_penalty": RETROSPECTIVE_PENALTY,
                "use_quadratic_cost_penalty": False,
                **_NO_LIMIT,
            },
            planning_time=25.0,
        ),
        NavPlanner(
            "navfn",
            "nav2_navfn_planner::NavfnPlanner",
            None,
            lambda costs, _: np.trunc(50 + 0.8 * costs) / 50 - 1,
            lambda cost, excess: np.nan,
        ),
        NavPlanner(
            "thetastar",
            "nav2_theta_star_planner::ThetaStarPlanner",
            "w_traversal_cost",
            lambda costs, w: (1 + w * _theta_star_term(costs)) / (1 + w * _theta_star_term(0)) - 1,
            _theta_star_weight,
            2.0,
            {"w_euc_cost": 1.0},
        ),
    )
}


@dataclass(frozen=True)
class Conversion:
    """The accuracy of a planner's J = integral of (1 + weight u) ds with the exported values."""

    planner: NavPlanner = field(repr=False)
    """The planner of Nav2, with the name and the parameter that scale its costs."""
    param: float
    """Value of `planner.parameter`; NaN where there is none."""
    greatest: float
    """The excess weight u at which the planner saturates [m per m]."""
    saturated_share: float
    """Share of the cells whose excess is above that, 0..1."""
    quantisation: float
    """Largest difference of weight u and the planner's charge [m per m], where none saturates."""
    mean_quantisation: float
    """Mean of that difference over the cells that do not saturate [m per m]."""

    def summary(self) -> dict[str, float | str | None]:
        """The facts by name, fit for JSON."""
        return {
            "planner": self.planner.name,
            "parameter": self.planner.parameter,
            "value": None if np.isnan(self.param) else self.param,
            "saturates_at_weight_u": self.greatest,
            "saturated_share": self.saturated_share,
            "largest_quantisation_error": self.quantisation,
            "mean_quantisation_error": self.mean_quantisation,
        }

    def rows(self) -> tuple[tuple[str, str], ...]:
        """The facts for people: labels and texts."""
        parameter = self.planner.parameter
        with_value = f", {parameter}: {self.param:.4g}" if parameter else ""
        return (
            ("planner", self.planner.name + with_value),
            ("cost beyond the length", f"at most {self.greatest:.3f} a metre"),
            ("cells that would cost more", f"{self.saturated_share:.1%}"),
            ("rounding of this cost", f"{self.mean_quantisation:.4f} a metre on average,"),
            ("", f"{self.quantisation:.4f} at most"),
        )


def checked_planner(name: str, param: float | None) -> NavPlanner:
    """One of `PLANNERS`; another name, or a parameter that it cannot have, is a ConfigError."""
    one_of("planner", name, PLANNERS)
    planner = PLANNERS[name]
    if param is not None and planner.parameter is None:
        raise ConfigError(f"{name} has no parameter that scales costs")
    if param is not None and not 0 < param < math.inf:
        raise ConfigError(f"{planner.parameter} must be a positive number, not {param:g}")
    return planner


def values_for(
    density: NDArray[np.float64],
    planner: NavPlanner,
    greatest: float,
    param: float | None = None,
    *,
    static: bool = False,
) -> tuple[NDArray[np.int8], Conversion]:
    """The values of a mask, or of a `static` layer, by which a planner has `density` as costs.

    Where the density is infinite the values are -1. By default the planner's parameter is such
    that the excess `greatest` over 1 just fits.
    """
    excess = density[np.isfinite(density)] - 1
    if static:  # a StaticLayer truncates with trinary_costmap false, and may take 99 for inscribed
        choices = np.arange(99)
        costs = np.trunc(choices / 100 * 254)
    else:  # a KeepoutFilter rounds to the nearest, and 100 would be lethal
        choices = np.arange(100)
        costs = np.floor(choices * 254 / 100 + 0.5)
    if planner.parameter is None:
        param = math.nan
    elif param is None:  # the least of three decimals
        needed = planner.parameter_for(float(costs[-1]), greatest) if greatest > 0 else 1.0
        param = math.ceil(needed * 1000 - 1e-9) / 1000
    charged = planner.excess(costs, param)
    borders = (charged[1:] + charged[:-1]) / 2
    nearest = np.searchsorted(borders, excess)
    values = np.full(density.shape, -1, np.int8)
    values[np.isfinite(density)] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    largest, mean = (float(error.max()), float(error.mean())) if error.size else (0.0, 0.0)
    charges = float(charged[-1]), float(above.mean())
    return values, Conversion(planner, param, *charges, largest, mean)

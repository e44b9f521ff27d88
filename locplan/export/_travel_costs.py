"""The prices that Nav2's planners charge for costmap values, and values that make them J.

Formulas read from ros-navigation/navigation2, branches humble to main (2026-08): node_2d.cpp,
node_hybrid.cpp, navfn.cpp and theta_star.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import one_of
from locplan.errors import ConfigError

NO_VALUE = -1
"""Value of a mask that does not change the cost."""
RETROSPECTIVE_PENALTY = 0.015
"""SmacPlannerHybrid's default, which multiplies every step by 1 minus it."""
NO_LIMIT = -1
"""A mask can make the Smac planners expand several times as many cells, on large maps more than the
million at which they give up by default; so they get no limit, and five times their own time."""
_DECIMALS = 3
"""Decimals of the parameters chosen here."""


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
    """Least time that the planner needs to find a way over a mask [s]; None if it has no limit."""


def _theta_star_term(costs: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return ((26 + 0.9 * np.asarray(costs)) / 252) ** 2


def _theta_star_excess(costs: NDArray[np.float64], w: float) -> NDArray[np.float64]:
    return (1 + w * _theta_star_term(costs)) / (1 + w * _theta_star_term(0)) - 1


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
            {"max_iterations": NO_LIMIT},
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
                "max_iterations": NO_LIMIT,
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
            _theta_star_excess,
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
            ("charges, beyond the length", f"at most {self.greatest:.3f} a metre"),
            ("cells worth more", f"{self.saturated_share:.1%}"),
            ("rounding of the charge", f"{self.mean_quantisation:.4f} a metre on average,"),
            ("", f"{self.quantisation:.4f} at most"),
        )


def planner_named(name: str) -> NavPlanner:
    """One of `PLANNERS`; another name is a ConfigError."""
    one_of("planner", name, PLANNERS)
    return PLANNERS[name]


def check_planner(name: str, param: float | None) -> None:
    """Raise a ConfigError unless the planner is known and can have the parameter."""
    planner = planner_named(name)
    if param is None:
        return
    if planner.parameter is None:
        raise ConfigError(f"{name} has no parameter that scales costs")
    if not 0 < param < math.inf:
        raise ConfigError(f"{planner.parameter} must be a positive number, not {param:g}")


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
    check_planner(planner.name, param)
    excess = density[np.isfinite(density)] - 1
    if static:  # a StaticLayer truncates with trinary_costmap false, and may take 99 for inscribed
        choices = np.arange(99)
        costs = np.trunc(choices / 100 * 254)
    else:  # a KeepoutFilter rounds to the nearest, and 100 would be lethal
        choices = np.arange(100)
        costs = np.floor(choices * 254 / 100 + 0.5)
    if planner.parameter is None:
        param = math.nan
    elif param is None:  # the least of few decimals
        needed = planner.parameter_for(float(costs[-1]), greatest) if greatest > 0 else 1.0
        param = float(math.ceil(needed * 10**_DECIMALS - 1e-9) / 10**_DECIMALS)
    charged = planner.excess(costs, param)
    borders = (charged[1:] + charged[:-1]) / 2
    nearest = np.searchsorted(borders, excess)
    values = np.full(density.shape, NO_VALUE, np.int8)
    values[np.isfinite(density)] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    greatest, saturated_share = float(charged[-1]), float(above.mean())
    largest, mean = (float(error.max()), float(error.mean())) if error.size else (0.0, 0.0)
    return values, Conversion(planner, param, greatest, saturated_share, largest, mean)

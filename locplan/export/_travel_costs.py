"""What Nav2's planners charge for a costmap's values, and the values that make them charge J.

Formulas read from ros-navigation/navigation2, branches humble to main (2026-08): node_2d.cpp,
node_hybrid.cpp, navfn.cpp and theta_star.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError

MASK_VALUES = np.arange(100)
"""Of a mask, 0..99; 100 would be lethal."""
STATIC_VALUES = np.arange(99)
"""Of a static layer: newer versions take 99 for the inscribed radius."""
NO_VALUE = -1
"""Of a mask: leaves the cost as it is."""
RETROSPECTIVE_PENALTY = 0.015
"""SmacPlannerHybrid's default, which multiplies every step by 1 minus it."""
_DECIMALS = 3
"""Of the parameters chosen here."""


def mask_costs(values: NDArray[Any]) -> NDArray[np.float64]:
    """What KeepoutFilter makes of a mask's 0..99: the nearest of 254ths."""
    return np.floor(values * 254 / 100 + 0.5)


def static_costs(values: NDArray[Any]) -> NDArray[np.float64]:
    """What StaticLayer makes of 0..98 with ``trinary_costmap: false``: 254ths, truncated."""
    return np.trunc(values / 100 * 254)


@dataclass(frozen=True)
class NavPlanner:
    """A planner of Nav2: what it charges per metre beyond free space, as a share of that."""

    name: str
    plugin: str
    """From Iron on; Humble writes / for ::."""
    parameter: str | None
    """The parameter that scales costs; None if there is none."""
    excess: Callable[[NDArray[np.float64], float], NDArray[np.float64]]
    """Of costmap values 0..252 and the parameter."""
    wanted: Callable[[float, float], float]
    """The parameter at which a costmap value means this excess."""
    assumed: Mapping[str, Any]
    """Other parameters that must be as they are here."""


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
            {},
        ),
        NavPlanner(
            "smac-hybrid",
            "nav2_smac_planner::SmacPlannerHybrid",
            "cost_penalty",
            lambda costs, k: k * costs / 252 / (1 - RETROSPECTIVE_PENALTY),
            lambda cost, excess: excess * (1 - RETROSPECTIVE_PENALTY) * 252 / cost,
            {
                "retrospective_penalty": RETROSPECTIVE_PENALTY,
                "use_quadratic_cost_penalty": False,
            },
        ),
        NavPlanner(
            "navfn",
            "nav2_navfn_planner::NavfnPlanner",
            None,
            lambda costs, _: np.trunc(50 + 0.8 * costs) / 50 - 1,
            lambda cost, excess: np.nan,
            {},
        ),
        NavPlanner(
            "thetastar",
            "nav2_theta_star_planner::ThetaStarPlanner",
            "w_traversal_cost",
            _theta_star_excess,
            _theta_star_weight,
            {"w_euc_cost": 1.0},
        ),
    )
}


@dataclass(frozen=True)
class Conversion:
    """How well a planner realises J = integral of (1 + weight u) ds with the values exported."""

    planner: NavPlanner
    param: float
    """Of `planner.parameter`; NaN where there is none."""
    greatest: float
    """The excess weight u at which the planner saturates."""
    saturated_share: float
    """Share of the cells whose excess is above that, 0..1."""
    quantisation: float
    """Largest difference of weight u and what the planner charges, in cells below that."""
    mean_quantisation: float
    """Its mean over those cells."""

    def summary(self) -> dict[str, float | str | None]:
        """Fit for JSON."""
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
        """The same for people: labels and texts."""
        parameter = self.planner.parameter
        with_value = f", {parameter}: {self.param:.4g}" if parameter else ""
        return (
            ("planner", self.planner.name + with_value),
            ("saturates at weight · u", f"{self.greatest:.3f}"),
            ("cells above that", f"{self.saturated_share:.1%}"),
            ("rounding of weight · u", f"{self.mean_quantisation:.4f} on average"),
            ("", f"{self.quantisation:.4f} at most"),
        )


def planner_named(name: str) -> NavPlanner:
    """One of `PLANNERS`.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    if name not in PLANNERS:
        raise ConfigError(f"the planner must be one of {', '.join(PLANNERS)}, not {name!r}")
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
    """The values of a mask that make a planner charge `density` per metre.

    Parameters
    ----------
    density : (H, W) array
        Cost per metre, at least 1; infinite where the mask is to change nothing.
    planner : NavPlanner
    greatest : float
        The excess over 1 that must fit, where the parameter is free to choose.
    param : float, optional
        The planner's own parameter; by default such that `greatest` just fits.
    static : bool
        Of a static layer instead of a mask.

    Returns
    -------
    values : (H, W) array of int8
        0..99, or 98 of a static layer; -1 where the density is infinite.
    conversion : Conversion

    Raises
    ------
    ConfigError
        If the parameter is not positive, the planner has none, or no cell is passable.
    """
    check_planner(planner.name, param)
    excess = density[np.isfinite(density)] - 1
    if not excess.size:
        raise ConfigError(
            "no cell of the costmap is passable, so a mask would be empty; check the"
            " robot's radius [m]"
        )
    choices = STATIC_VALUES if static else MASK_VALUES
    costs = (static_costs if static else mask_costs)(choices)
    if param is None:
        param = _param_for(planner, float(costs[-1]), greatest)
    charged = planner.excess(costs, param)
    borders = (charged[1:] + charged[:-1]) / 2
    nearest = np.searchsorted(borders, excess)
    values = np.full(density.shape, NO_VALUE, np.int8)
    values[np.isfinite(density)] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    return values, Conversion(
        planner=planner,
        param=param,
        greatest=float(charged[-1]),
        saturated_share=float(above.mean()),
        quantisation=float(error.max()) if error.size else 0.0,
        mean_quantisation=float(error.mean()) if error.size else 0.0,
    )


def _param_for(planner: NavPlanner, cost: float, excess: float) -> float:
    """The least parameter, of few decimals, at which a costmap value means so much."""
    if planner.parameter is None:
        return math.nan
    wanted = planner.wanted(cost, excess) if excess > 0 else 1.0
    return float(math.ceil(wanted * 10**_DECIMALS - 1e-9) / 10**_DECIMALS)

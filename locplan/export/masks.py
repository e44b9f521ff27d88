"""Values of Nav2's filter masks: what its planners charge for them, and the clearance they need."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_choice
from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.tables import nan_to_none
from locplan.errors import ConfigError
from locplan.export.registry import ExportSummary
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.robots.nav2 import read_nav2_inflation
from locplan.robots.parameters import Nav2Parameters
from locplan.robots.parts import Inflation

LETHAL, INSCRIBED = 254, 253
AT_WALLS = 2.5
"""Excess at walls for which a mask carries the inflation, beside weight u [m per m]."""
FOLLOWER_ROOM, MIN_ROOM = 0.2, 0.45
"""Room that a path follower needs beyond the robot's radius, and the least from walls [m].

Regulated pure pursuit stopped again and again ("collision ahead") where a plan passed 0.33 m from
walls, beside a robot of 0.22 m whose pose was off by 0.05 m."""
TOO_NARROW = 8.0
"""Excess of cells at the robot's radius from walls, falling to 0 at the follower's room."""
STEEP = 10.0
"""A cost_scaling_factor with which an inflation hides no mask."""


def follower_room(radius: float) -> float:
    """Return the distance from walls that a path follower needs [m].

    Parameters
    ----------
    radius : float
        Radius of the robot, with its margin [m].
    """
    return max(MIN_ROOM, radius + FOLLOWER_ROOM)


def room_excess(costs: Costmap) -> Floats:
    """Return what a mask charges where a follower has too little room, (H, W) [m per m].

    Parameters
    ----------
    costs : Costmap
        The costmap, with the robot's radius.
    """
    room, radius = follower_room(costs.robot_radius), costs.robot_radius
    shortfall: Floats = np.clip((room - costs.grid.clearance) / (room - radius), 0, 1)
    return TOO_NARROW * shortfall


@dataclass(frozen=True)
class CostmapInflation:
    """The inflation layer of a robot's global costmap.

    Nav2 takes the larger one of mask and costmap. So the slope that keeps paths off the walls is
    lost under high values of a mask unless the mask carries the sum of both, and a mask may be
    hidden by a wide and flat inflation.
    """

    layer: str
    """Name of the layer in the costmap's parameters."""
    inflation: Inflation
    """Its settings."""
    inscribed_radius: float
    """Distance from the centre of an occupied cell up to which the robot would touch it [m]."""

    @classmethod
    def from_parameters(cls, parameters: Nav2Parameters) -> CostmapInflation | None:
        """That of a robot's parameters, or None where they have none.

        Parameters
        ----------
        parameters : Nav2Parameters
            The parameters of Nav2.
        """
        layer_values = read_nav2_inflation(parameters)
        return cls(*layer_values) if layer_values else None

    @property
    def steeper(self) -> CostmapInflation | None:
        """The layer with a factor that hides no mask; None if its own factor is as steep."""
        if self.inflation.cost_scaling_factor >= STEEP:
            return None
        inflation = dataclasses.replace(self.inflation, cost_scaling_factor=STEEP)
        return dataclasses.replace(self, inflation=inflation)

    @classmethod
    def for_mask(cls, costs: Costmap, layer: CostmapInflation | None) -> CostmapInflation | None:
        """Return the inflation that a mask carries, of the costmap's robot; None without any.

        Parameters
        ----------
        costs : Costmap
            The costmap. The inflation of its robot, if it has one, replaces that of the layer.
        layer : CostmapInflation or None
            The layer of the robot's parameters.
        """
        inflation = (costs.robot and costs.robot.inflation) or (layer and layer.inflation)
        name = layer.layer if layer else ""
        return cls(name, inflation, costs.robot_radius) if inflation else None

    def share_beyond(self, distance: float) -> float:
        """Return the cost at a distance beyond the robot's edge, as a share of the highest, 0..1.

        Parameters
        ----------
        distance : float
            The distance [m].
        """
        if distance > self.inflation.inflation_radius - self.inscribed_radius:
            return 0.0
        return math.exp(-self.inflation.cost_scaling_factor * distance)

    def costs(self, grid: OccupancyGrid) -> Floats:
        """The costs 0..254 of a map's cells, (H, W), as inflation_layer.cpp has them.

        Parameters
        ----------
        grid : OccupancyGrid
            The map; its unknown cells are as free ones.
        """
        import cv2

        free = (grid.cells != OCCUPIED).astype(np.uint8)
        distances = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distances = np.where(free.all(), np.inf, distances.astype(np.float64))
        edge_distances = distances * grid.resolution - self.inscribed_radius
        cost: Floats = np.trunc(
            252 * np.exp(-self.inflation.cost_scaling_factor * np.maximum(edge_distances, 0))
        )
        cost[distances > math.ceil(self.inflation.inflation_radius / grid.resolution)] = 0
        cost[edge_distances <= 0] = INSCRIBED
        cost[distances == 0] = LETHAL
        return cost


@dataclass(frozen=True)
class PlannedPath:
    """The path that a planner of Nav2 takes, beside a recommended one with the same ends."""

    name: str
    """Name of the recommended path."""
    planner: str
    """Name of the planner, as `nav2_keepout` has it."""
    ratio: float
    """J over that of the recommended path; NaN where the planner finds none."""
    clearance: float
    """Median distance from walls along the path [m]."""
    least_clearance: float
    """Least distance from walls along the path [m]."""
    narrowest: tuple[float, float] = (math.nan, math.nan)
    """Position of the least distance, farther than half a metre from both ends [m]."""
    room: float = math.inf
    """Distance from walls there [m]."""
    roomy_ratio: float = 1.0
    """J of the best path that keeps a follower's room, over that of the recommended path."""

    @property
    def follows(self) -> bool:
        """True if the path costs about as much as the recommended one with a follower's room."""
        return self.ratio <= 1.12 * self.roomy_ratio

    @property
    def text(self) -> str:
        """The path in a few words."""
        if math.isnan(self.ratio):
            return "finds no path"
        near = f"clearance {self.clearance:.2f} m, {self.least_clearance:.2f} m at least"
        return f"{self.ratio:.2f} times its J, {near}"


@dataclass(frozen=True)
class NavPlanner:
    """A planner of Nav2, and its charge per metre beyond that of free space, as a share of it."""

    name: str
    plugin: str
    """Name of the plugin from Jazzy on; Humble writes / for ::."""
    parameter: str | None
    """The parameter that scales costs; None if there is none."""
    excess: Callable[[Floats, float], Floats]
    """Function from costmap values 0..252 and the parameter to the share charged."""
    parameter_for: Callable[[float, float], float]
    """Function from a costmap value and an excess to the parameter at which it means that."""
    default: float = math.nan
    """Value of that parameter in Nav2's code; NaN if there is none."""
    assumed: Mapping[str, Any] = field(default_factory=dict)
    """Other parameters that must be as they are here."""
    planning_time: float | None = None
    """Minimum time that the planner needs for a way over a mask [s]; None if it has no limit."""
    any_angle: bool = False
    """Whether its paths turn by any angle."""
    caveat: str = ""
    """The reason why it does not follow masks; empty if it does."""


def _theta_star_term(costs: Floats | float) -> Floats:
    return ((26 + 0.9 * np.asarray(costs)) / 252) ** 2


def _theta_star_weight(cost: float, excess: float) -> float:
    free, full = float(_theta_star_term(0)), float(_theta_star_term(cost))
    if full <= free * (1 + excess):
        raise ConfigError(
            f"thetastar cannot charge {1 + excess:g} times as much for degenerate cells as for free"
            f" ones, {full / free:.0f} times at most: set the parameter, or a smaller weight"
        )
    return excess / (full - free * (1 + excess))


def _make_smac_planner(
    name: str, kind: str, parameter: str, default: float, seconds: float, **assumed: Any
) -> NavPlanner:
    """A Smac planner, which multiplies each step by 1 less its `retrospective_penalty`.

    A mask can make it expand several times as many cells, on large maps more than the million at
    which it gives up by default; so it gets no limit, and five times its own time.
    """
    step = 1 - assumed.get("retrospective_penalty", 0.0)
    return NavPlanner(
        *(name, f"nav2_smac_planner::SmacPlanner{kind}", parameter),
        lambda costs, k: k * costs / 252 / step,
        lambda cost, excess: excess * step * 252 / cost,
        *(default, {**assumed, "max_iterations": -1}, seconds),
    )


PLANNERS = {
    planner.name: planner
    for planner in (
        _make_smac_planner("smac2d", "2D", "cost_travel_multiplier", 1.0, 10.0),
        _make_smac_planner(
            *("smac-hybrid", "Hybrid", "cost_penalty", 2.0, 25.0),
            retrospective_penalty=0.015,  # its default
            use_quadratic_cost_penalty=False,
        ),
        NavPlanner(
            "navfn",
            "nav2_navfn_planner::NavfnPlanner",
            None,
            lambda costs, _: np.trunc(50 + 0.8 * costs) / 50 - 1,
            lambda cost, excess: np.nan,
            caveat="its wave stops early and does not see costs beyond twice that of free space (on"
            " a real Nav2 1.3.13 J was 1.05 to 2.98 times the best with its mask, and 2 of 6 plans"
            " failed on a map of 1674 x 1006 cells)",
        ),
        NavPlanner(
            "thetastar",
            "nav2_theta_star_planner::ThetaStarPlanner",
            "w_traversal_cost",
            lambda costs, w: (1 + w * _theta_star_term(costs)) / (1 + w * _theta_star_term(0)) - 1,
            _theta_star_weight,
            2.0,
            {"w_euc_cost": 1.0},
            any_angle=True,
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
    """Share of the cells whose excess is above that, 0..1, of those with a follower's room."""
    quantisation: float
    """Largest difference of weight u and the planner's charge [m per m], where none saturates."""
    mean_quantisation: float
    """Mean of that difference over the cells that do not saturate [m per m]."""
    paths: tuple[PlannedPath, ...] = ()
    """The paths that planners take on the exported mask, of those that were asked for."""
    most_saturated: tuple[float, float] | None = None
    """Middle of the widest place with a follower's room that saturates [m]; None without one."""
    closed: tuple[tuple[float, float, float], ...] = ()
    """Gaps that the mask closes: position and distance from walls [m]."""

    def facts(self) -> ExportSummary:
        """Return the facts by name, and as rows of a table for people."""
        paths = [nan_to_none(dataclasses.asdict(nav2_path)) for nav2_path in self.paths]
        values = {
            "planner": self.planner.name,
            "parameter": self.planner.parameter,
            "value": None if np.isnan(self.param) else self.param,
            "saturates_at_weight_u": self.greatest,
            "saturated_share": self.saturated_share,
            "largest_quantisation_error": self.quantisation,
            "mean_quantisation_error": self.mean_quantisation,
            "most_saturated": self.most_saturated,
            "closed_gaps": [list(gap_values) for gap_values in self.closed],
            "paths": paths,
        }
        parameter = self.planner.parameter
        parameter_text = f", {parameter}: {self.param:.4g}" if parameter else ""
        rows = (
            ("planner", self.planner.name + parameter_text),
            ("cost beyond the length", f"at most {self.greatest:.3f} a metre"),
            ("cells that would cost more", f"{self.saturated_share:.1%}"),
            ("rounding of this cost", f"{self.mean_quantisation:.4f} a metre on average,"),
            ("", f"{self.quantisation:.4f} at most"),
            *(
                (f"{nav2_path.planner} for {nav2_path.name}", nav2_path.text)
                for nav2_path in self.paths
            ),
            *(
                ("closed gap", "{:.2f}, {:.2f}: {:.2f} m from walls".format(*gap))
                for gap in self.closed
            ),
        )
        return ExportSummary(values, rows)


def find_planner(name: str, param: float | None) -> NavPlanner:
    """One of `PLANNERS`; another name, or a parameter that it cannot have, is a ConfigError."""
    check_choice("planner", name, PLANNERS)
    planner = PLANNERS[name]
    if param is not None and planner.parameter is None:
        raise ConfigError(f"{name} has no parameter that scales costs")
    if param is not None and not 0 < param < math.inf:
        raise ConfigError(f"{planner.parameter} must be a positive number, not {param:g}")
    return planner


def compute_mask_values(
    density: Floats,
    planner: NavPlanner,
    max_excess: float,
    param: float | None,
    counted: Bools | None = None,
) -> tuple[NDArray[np.int8], Conversion, Bools]:
    """The values of a mask by which a planner has `density` as costs.

    Where the density is infinite the values are -1. By default the planner's parameter is such
    that the excess `max_excess` over 1 just fits. The last array is True in saturated cells,
    of the `counted` ones, by default of all.
    """
    is_finite = np.isfinite(density)
    excess = density[is_finite] - 1
    # A KeepoutFilter rounds to the nearest, and 100 would be lethal.
    choices = np.arange(100)
    costs = np.floor(choices * 254 / 100 + 0.5)
    if planner.parameter is None:
        param = math.nan
    elif param is None:  # the least of three decimals
        min_parameter = (
            planner.parameter_for(float(costs[-1]), max_excess) if max_excess > 0 else 1.0
        )
        param = math.ceil(min_parameter * 1000 - 1e-9) / 1000
    charged = planner.excess(costs, param)
    nearest = np.searchsorted((charged[1:] + charged[:-1]) / 2, excess)
    values = np.full(density.shape, -1, np.int8)
    values[is_finite] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    largest, mean = (float(error.max()), float(error.mean())) if error.size else (0.0, 0.0)
    saturated = np.zeros(density.shape, bool)
    saturated[is_finite] = above
    counted = is_finite if counted is None else counted & is_finite
    share = float(saturated[counted].mean()) if counted.any() else 0.0
    conversion = Conversion(planner, param, float(charged[-1]), share, largest, mean)
    return values, conversion, saturated & counted


def mask_density(costs: Costmap, inflation: CostmapInflation | None = None) -> Floats:
    """Return the density that a mask stands for, (H, W): J's, and what places near walls cost.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    inflation : CostmapInflation, optional
        The inflation that the mask carries.
    """
    density = costs.unblocked_density + room_excess(costs)
    if inflation:
        density = density + AT_WALLS * np.minimum(inflation.costs(costs.grid) / 252, 1)
    return density


def keepout_mask(
    costs: Costmap,
    *,
    planner: str = "smac2d",
    planner_param: float | None = None,
    inflation: CostmapInflation | None = None,
) -> tuple[NDArray[np.int8], Conversion]:
    """The values of a mask that make a planner's costs J, (H, W): 0..99, or -1 to change nothing.

    Every free cell whose u is known has a value, or where a density of one's own is finite. Free
    cells that are blocked farther from walls than the robot's radius, as by `blocked_where`, have
    100, which is lethal, and so have all cells in no-go zones. Outside preferred zones a metre
    costs 1 more, as in J. Cells closer to walls than the robot's radius and 0.2 m, and at least
    0.45 m, cost more, since a path follower stops there. A planner that does not follow masks has
    J alone.

    Parameters
    ----------
    costs, planner_param
        See `nav2_keepout`.
    planner : str, default "smac2d"
        "smac2d", "smac-hybrid", "navfn" or "thetastar".
    inflation : CostmapInflation, optional
        The inflation that the values carry, too, with an excess of 2.5 at walls.

    Returns
    -------
    values : (H, W) array of int8
        The values, row 0 at the lowest y.
    conversion : Conversion
        Where the planner saturates, and how exact the mask is.

    Raises
    ------
    ConfigError
        If no cell is passable, or the planner is unknown or cannot charge as much.
    """
    passable = np.isfinite(costs.density)
    if not passable.any():
        raise ConfigError(
            "no cell of the costmap is passable, so a mask would be empty; check the"
            " robot's radius [m]"
        )
    greatest, density = costs.max_excess, costs.unblocked_density
    if np.isnan(greatest):
        greatest = float(costs.density[passable].max()) - 1
    runs = find_planner(planner, planner_param)
    counted = None
    if not runs.caveat:
        greatest += AT_WALLS
        density = mask_density(costs, inflation)
        counted = costs.grid.clearance >= follower_room(costs.robot_radius)
    values, conversion, saturated = compute_mask_values(
        density, runs, greatest, planner_param, counted
    )
    if saturated.any():
        middle = costs.grid.position(*_find_middle(saturated))
        conversion = dataclasses.replace(conversion, most_saturated=middle)
    near = costs.grid.cells_near_walls(costs.robot_radius - 1e-9)
    values[~passable & costs.grid.free & ~near] = 100  # lethal
    values[costs.zones.cells(costs.grid, "no-go")] = 100
    return values, conversion


def _find_middle(cells: Bools) -> tuple[int, int]:
    """Row and column of the cell that lies deepest among cells of its kind."""
    import cv2

    distances = cv2.distanceTransform(np.pad(cells, 1).astype(np.uint8), cv2.DIST_L2, 3)
    row, col = np.unravel_index(int(np.argmax(distances)), distances.shape)
    return int(row) - 1, int(col) - 1

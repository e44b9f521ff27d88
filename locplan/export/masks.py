"""Values of Nav2's filter masks, the charges of its planners, and their clearance."""

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
from locplan.export.values import world_to_unrotated_map
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.planning.costmap import Costmap
from locplan.robots.nav2 import read_nav2_inflation
from locplan.robots.parameters import Nav2Parameters
from locplan.robots.parts import Inflation

LETHAL, INSCRIBED = 254, 253
WALL_EXCESS = 2.5
"""Excess at walls of the inflation in a mask, in addition to weight * u [m per m]."""
FOLLOWER_ROOM, MIN_ROOM = 0.2, 0.45
"""Room that a path follower needs beyond the robot's radius, and minimum distance from walls [m].

Regulated pure pursuit stopped repeatedly ("collision ahead") on a plan that passed 0.33 m from
walls, with a robot radius of 0.22 m and a pose error of 0.05 m."""
NARROW_EXCESS = 8.0
"""Excess of cells at the robot's radius from walls, falling to 0 at the follower's room."""
STEEP_SCALING_FACTOR = 10.0
"""A cost_scaling_factor with which the inflation does not hide a mask."""


def compute_follower_room(radius: float) -> float:
    """Return the distance from walls that a path follower needs [m].

    Parameters
    ----------
    radius : float
        Radius of the robot, with its margin [m].
    """
    return max(MIN_ROOM, radius + FOLLOWER_ROOM)


def compute_follower_room_excess(costs: Costmap) -> Floats:
    """Return the excess of cells in which a path follower lacks room, (H, W) [m per m].

    Parameters
    ----------
    costs : Costmap
        The costmap, with the robot's radius.
    """
    room, radius = compute_follower_room(costs.robot_radius), costs.robot_radius
    shortfall: Floats = np.clip((room - costs.grid.clearance) / (room - radius), 0, 1)
    return NARROW_EXCESS * shortfall


@dataclass(frozen=True)
class CostmapInflation:
    """The inflation layer of a robot's global costmap.

    Nav2 takes the larger value of mask and costmap. High values of a mask would therefore hide the
    slope that keeps paths off walls, so the mask has the sum of both. A wide and flat inflation may
    hide the mask.
    """

    layer: str
    """Name of the layer in the costmap's parameters."""
    inflation: Inflation
    """The layer's settings."""
    inscribed_radius: float
    """Distance from the centre of an occupied cell up to which the robot would touch it [m]."""

    @classmethod
    def from_parameters(cls, parameters: Nav2Parameters) -> CostmapInflation | None:
        """Return the inflation layer of a robot's parameters, or None without one.

        Parameters
        ----------
        parameters : Nav2Parameters
            The parameters of Nav2.
        """
        layer_values = read_nav2_inflation(parameters)
        return cls(*layer_values) if layer_values else None

    @property
    def steeper_layer(self) -> CostmapInflation | None:
        """The layer with a factor that does not hide a mask; None if the layer is steep enough."""
        if self.inflation.cost_scaling_factor >= STEEP_SCALING_FACTOR:
            return None
        inflation = dataclasses.replace(self.inflation, cost_scaling_factor=STEEP_SCALING_FACTOR)
        return dataclasses.replace(self, inflation=inflation)

    @classmethod
    def choose_for_mask(
        cls, costs: Costmap, layer: CostmapInflation | None
    ) -> CostmapInflation | None:
        """Return the inflation to include in a mask; None without one.

        Parameters
        ----------
        costs : Costmap
            The costmap. If its robot has an inflation, it replaces the layer's inflation.
        layer : CostmapInflation or None
            The layer of the robot's parameters.
        """
        inflation = (costs.robot and costs.robot.inflation) or (layer and layer.inflation)
        name = layer.layer if layer else ""
        return cls(name, inflation, costs.robot_radius) if inflation else None

    def compute_cost_share(self, distance: float) -> float:
        """Return the cost at a distance from the robot's edge, as a share of the maximum, 0..1.

        Parameters
        ----------
        distance : float
            The distance [m].
        """
        if distance > self.inflation.inflation_radius - self.inscribed_radius:
            return 0.0
        return math.exp(-self.inflation.cost_scaling_factor * distance)

    def compute_costs(self, grid: OccupancyGrid) -> Floats:
        """Return the costs 0..254 of a map's cells, (H, W), as in inflation_layer.cpp.

        Parameters
        ----------
        grid : OccupancyGrid
            The map; unknown cells count as free.
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
    """The path of a Nav2 planner, compared with a recommended path between the same ends."""

    name: str
    """Name of the recommended path."""
    planner: str
    """Name of the planner, as in `nav2_keepout`."""
    ratio: float
    """Ratio of J to that of the recommended path; NaN if the planner finds no path."""
    clearance: float
    """Median distance from walls along the path [m]."""
    least_clearance: float
    """Minimum distance from walls along the path [m]."""
    narrowest: tuple[float, float] = (math.nan, math.nan)
    """Position of the minimum distance, at least half a metre from both ends [m]."""
    room: float = math.inf
    """Distance from walls at that position [m]."""
    roomy_ratio: float = 1.0
    """Ratio of J of the best path with room for a follower to that of the recommended path."""

    @property
    def is_equivalent(self) -> bool:
        """True if the path costs at most 12 % more than the best path with room for a follower."""
        return self.ratio <= 1.12 * self.roomy_ratio

    @property
    def verdict_text(self) -> str:
        """The comparison in a few words."""
        if math.isnan(self.ratio):
            return "finds no path"
        side = "above" if self.ratio >= 1 else "below"
        return (
            f"planning cost J {100 * abs(self.ratio - 1):.0f} % {side} the recommended path's,"
            f" {self.clearance:.2f} m from walls in the median, {self.least_clearance:.2f} m at"
            " the nearest"
        )


@dataclass(frozen=True)
class NavPlanner:
    """A planner of Nav2, with the formula of its charge per metre relative to free space."""

    name: str
    plugin: str
    """Name of the plugin from Jazzy on; Humble uses / instead of ::."""
    parameter: str | None
    """The parameter that scales costs; None if there is none."""
    compute_excess: Callable[[Floats, float], Floats]
    """Function of costmap values 0..252 and the parameter that returns the excess."""
    compute_parameter: Callable[[float, float], float]
    """Function of a costmap value and its excess that returns the parameter."""
    default_parameter: float = math.nan
    """Value of that parameter in Nav2's code; NaN if there is none."""
    fixed_parameters: Mapping[str, Any] = field(default_factory=dict)
    """Other parameters, which must have these values."""
    planning_time: float | None = None
    """Time limit that the planner needs on a mask [s]; None if it has no limit."""
    any_angle: bool = False
    """Whether its paths are any-angle paths."""
    caveat: str = ""
    """The reason why the planner does not follow masks; empty if it does."""


def _compute_theta_star_term(costs: Floats | float) -> Floats:
    return ((26 + 0.9 * np.asarray(costs)) / 252) ** 2


def _compute_theta_star_weight(cost: float, excess: float) -> float:
    free, full = float(_compute_theta_star_term(0)), float(_compute_theta_star_term(cost))
    if full <= free * (1 + excess):
        raise ConfigError(
            f"thetastar cannot charge {1 + excess:g} times as much for degenerate cells as for free"
            f" ones, only {full / free:.0f} times; set the parameter or a smaller weight"
        )
    return excess / (full - free * (1 + excess))


def _make_smac_planner(
    name: str, kind: str, parameter: str, default: float, seconds: float, **assumed: Any
) -> NavPlanner:
    """Return a Smac planner, which multiplies each step by 1 - `retrospective_penalty`.

    With a mask it expands several times as many cells. On large maps these exceed its default limit
    of a million, so it gets no limit and five times the default time.
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
            retrospective_penalty=0.015,  # Nav2's default
            use_quadratic_cost_penalty=False,
        ),
        NavPlanner(
            "navfn",
            "nav2_navfn_planner::NavfnPlanner",
            None,
            lambda costs, _: np.trunc(50 + 0.8 * costs) / 50 - 1,
            lambda cost, excess: np.nan,
            caveat="it ignores most of a mask's costs, and may find no path on large maps",
        ),
        NavPlanner(
            "thetastar",
            "nav2_theta_star_planner::ThetaStarPlanner",
            "w_traversal_cost",
            lambda costs, w: (
                (1 + w * _compute_theta_star_term(costs)) / (1 + w * _compute_theta_star_term(0))
                - 1
            ),
            _compute_theta_star_weight,
            2.0,
            {"w_euc_cost": 1.0},
            any_angle=True,
        ),
    )
}


@dataclass(frozen=True)
class MaskConversion:
    """The difference between a planner's cost on a mask and J."""

    planner: NavPlanner = field(repr=False)
    """The planner of Nav2."""
    parameter_value: float
    """Value of `planner.parameter`; NaN if the planner has none."""
    max_excess: float
    """The excess weight * u at which the planner saturates [m per m]."""
    saturated_share: float
    """Share of the cells with room for a follower whose excess is higher, 0..1."""
    quantisation: float
    """Maximum difference of weight * u and the planner's charge in other cells [m per m]."""
    mean_quantisation: float
    """Mean difference of weight * u and the planner's charge in other cells [m per m]."""
    paths: tuple[PlannedPath, ...] = ()
    """The planner's paths on the exported mask, each compared with a recommended path."""
    most_saturated_place: tuple[float, float] | None = None
    """Centre of the widest saturated place with room for a follower [m]; None without one."""
    closed_gaps: tuple[tuple[float, float, float], ...] = ()
    """Gaps that the mask closes: position and distance from walls [m]."""

    def drop_yaw(self, grid: OccupancyGrid) -> MaskConversion:
        """Return the conversion with its places on the map without its yaw, as Nav2 has them.

        Parameters
        ----------
        grid : OccupancyGrid
            The map of the costmap.
        """

        def move(x: float, y: float) -> tuple[float, float]:
            x, y = world_to_unrotated_map(grid, np.array([[x, y]]))[0].tolist()
            return x, y

        place = self.most_saturated_place
        return dataclasses.replace(
            self,
            paths=tuple(
                dataclasses.replace(path, narrowest=move(*path.narrowest)) for path in self.paths
            ),
            most_saturated_place=move(*place) if place else None,
            closed_gaps=tuple((*move(x, y), clearance) for x, y, clearance in self.closed_gaps),
        )

    def summarize(self) -> ExportSummary:
        """Return the accuracy as plain data for JSON, and as table rows for people."""
        paths = [nan_to_none(dataclasses.asdict(nav2_path)) for nav2_path in self.paths]
        values = {
            "planner": self.planner.name,
            "parameter": self.planner.parameter,
            "value": None if np.isnan(self.parameter_value) else self.parameter_value,
            "saturates_at_weight_u": self.max_excess,
            "saturated_share": self.saturated_share,
            "largest_quantisation_error": self.quantisation,
            "mean_quantisation_error": self.mean_quantisation,
            "most_saturated": self.most_saturated_place,
            "closed_gaps": [list(gap_values) for gap_values in self.closed_gaps],
            "paths": paths,
        }
        parameter = self.planner.parameter
        parameter_text = f", {parameter}: {self.parameter_value:.4g}" if parameter else ""
        rows = (
            ("planner", self.planner.name + parameter_text),
            ("cost in addition to the length", f"at most {self.max_excess:.3f} per metre"),
            ("saturated cells", f"{self.saturated_share:.1%}"),
            ("rounding of this cost", f"{self.mean_quantisation:.4f} per metre on average,"),
            ("", f"{self.quantisation:.4f} at most"),
            *(
                (f"path of {nav2_path.planner} ({nav2_path.name})", nav2_path.verdict_text)
                for nav2_path in self.paths
            ),
            *(
                ("closed gap", "{:.2f}, {:.2f}: {:.2f} m from walls".format(*gap))
                for gap in self.closed_gaps
            ),
        )
        return ExportSummary(values, rows)


def find_planner(name: str, param: float | None) -> NavPlanner:
    """Return the planner of a name; raise a ConfigError if it or its parameter is invalid."""
    check_choice("planner", name, PLANNERS)
    planner = PLANNERS[name]
    if param is not None and planner.parameter is None:
        raise ConfigError(f"{name} has no parameter that scales costs; leave it out")
    if param is not None and not 0 < param < math.inf:
        raise ConfigError(f"{planner.parameter} must be a positive number, not {param:g}")
    return planner


def compute_mask_values(
    density: Floats,
    planner: NavPlanner,
    max_excess: float,
    param: float | None,
    is_counted: Bools | None = None,
) -> tuple[NDArray[np.int8], MaskConversion, Bools]:
    """Return mask values that make a planner's costs equal to `density`.

    Cells of infinite density have the value -1. By default, the planner's parameter is the lowest
    value that can charge the excess `max_excess`. The last array is True in saturated cells among
    the `is_counted` ones, by default among all.
    """
    is_finite = np.isfinite(density)
    excess = density[is_finite] - 1
    # A KeepoutFilter rounds to the nearest cost, and 100 would be lethal.
    choices = np.arange(100)
    costs = np.floor(choices * 254 / 100 + 0.5)
    if planner.parameter is None:
        param = math.nan
    elif param is None:  # rounded up to three decimals
        min_parameter = (
            planner.compute_parameter(float(costs[-1]), max_excess) if max_excess > 0 else 1.0
        )
        param = math.ceil(min_parameter * 1000 - 1e-9) / 1000
    charged = planner.compute_excess(costs, param)
    nearest = np.searchsorted((charged[1:] + charged[:-1]) / 2, excess)
    values = np.full(density.shape, -1, np.int8)
    values[is_finite] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    largest, mean = (float(error.max()), float(error.mean())) if error.size else (0.0, 0.0)
    saturated = np.zeros(density.shape, bool)
    saturated[is_finite] = above
    is_counted = is_finite if is_counted is None else is_counted & is_finite
    share = float(saturated[is_counted].mean()) if is_counted.any() else 0.0
    conversion = MaskConversion(planner, param, float(charged[-1]), share, largest, mean)
    return values, conversion, saturated & is_counted


def compute_mask_density(costs: Costmap, inflation: CostmapInflation | None = None) -> Floats:
    """Return the density that a mask encodes, (H, W): J's density plus the excess near walls.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    inflation : CostmapInflation, optional
        The inflation to include in the mask.
    """
    density = costs.unblocked_density + compute_follower_room_excess(costs)
    if inflation:
        density = density + WALL_EXCESS * np.minimum(inflation.compute_costs(costs.grid) / 252, 1)
    return density


def compute_keepout_mask(
    costs: Costmap,
    *,
    planner: str = "smac2d",
    planner_param: float | None = None,
    inflation: CostmapInflation | None = None,
) -> tuple[NDArray[np.int8], MaskConversion]:
    """Return mask values with costs equal to J, (H, W): 0..99, or -1 for no change.

    Every free cell with u, or with a finite custom density, has a value. Cells in no-go zones have
    the lethal value 100, as do free cells that are blocked farther from walls than the robot's
    radius. Outside preferred zones a metre costs 1 more, as in J. Cells closer to walls than the
    robot's radius plus 0.2 m, or than 0.45 m, cost more, because path followers stop there. For a
    planner that does not follow masks, the values encode only J.

    Parameters
    ----------
    costs, planner_param
        See `nav2_keepout`.
    planner : str, default "smac2d"
        "smac2d", "smac-hybrid", "navfn" or "thetastar".
    inflation : CostmapInflation, optional
        The inflation to include in the values, with an excess of 2.5 at walls.

    Returns
    -------
    values : (H, W) array of int8
        The values, row 0 at the lowest y.
    conversion : MaskConversion
        The accuracy of the mask.

    Raises
    ------
    ConfigError
        If no cell is passable, or the planner is unknown or cannot charge the costs.
    """
    passable = np.isfinite(costs.density)
    if not passable.any():
        raise ConfigError(
            "no cell of the costmap is passable, so the mask would be empty; check the"
            " robot's radius [m]"
        )
    greatest, density = costs.max_excess, costs.unblocked_density
    if np.isnan(greatest):
        greatest = float(costs.density[passable].max()) - 1
    runs = find_planner(planner, planner_param)
    counted = None
    if not runs.caveat:
        greatest += WALL_EXCESS
        density = compute_mask_density(costs, inflation)
        counted = costs.grid.clearance >= compute_follower_room(costs.robot_radius)
    values, conversion, saturated = compute_mask_values(
        density, runs, greatest, planner_param, counted
    )
    if saturated.any():
        middle = costs.grid.position(*_find_deepest_cell(saturated))
        conversion = dataclasses.replace(conversion, most_saturated_place=middle)
    near = costs.grid.cells_near_walls(costs.robot_radius - 1e-9)
    values[~passable & costs.grid.free & ~near] = 100  # lethal
    values[costs.zones.cells(costs.grid, "no-go")] = 100
    return values, conversion


def _find_deepest_cell(cells: Bools) -> tuple[int, int]:
    """Return row and column of the cell that is farthest inside the True cells."""
    import cv2

    distances = cv2.distanceTransform(np.pad(cells, 1).astype(np.uint8), cv2.DIST_L2, 3)
    row, col = np.unravel_index(int(np.argmax(distances)), distances.shape)
    return int(row) - 1, int(col) - 1

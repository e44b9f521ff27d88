"""The costmap: the cost of travel of each cell, made from localizability."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from locplan import __version__
from locplan._support.checks import check_choice, check_instance
from locplan._support.kernels.arrays import Bools
from locplan._support.saved import StoredObject
from locplan._support.tables import nan_to_none
from locplan.errors import ConfigError, FieldError
from locplan.field.beams import LidarEstimator
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.zones import Zones, normalize_zones
from locplan.planning.layers import (
    LAYERS,
    MAX_DENSITY,
    CostLayers,
    CostSettings,
    HeadingLayers,
    add_zone_costs,
    block_near_walls,
    check_weight,
    compute_degeneracy,
    compute_density,
    copy_checked_layer,
    copy_layer,
    make_readonly,
    robot_or_none,
)
from locplan.robots.robot import Robot, planning_radius

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CellWindow = tuple[slice, slice]
"""Rows and columns of a map."""


def find_changed_window(
    before: OccupancyGrid, field: CovarianceField, robot_radius: float
) -> CellWindow | None:
    """Return the window of cells whose costs an edit of the map may change; None without changes.

    An edit reaches as far as the estimator sees, and as far as the robot's radius.

    Parameters
    ----------
    before : OccupancyGrid
        The map.
    field : CovarianceField
        The field of the edited map.
    robot_radius : float
        Radius of the robot [m].

    Raises
    ------
    FieldError
        If the maps differ in shape, resolution or origin.
    """
    after = field.grid
    for name in ("shape", "resolution", "origin"):
        if getattr(before, name) != getattr(after, name):
            raise FieldError(f"the field's map has another {name}; make a costmap of its own")
    changed = before.cells != after.cells
    if not changed.any():
        return None
    # A lidar that would stand in a wall is moved by a stride; values are read a stride further.
    halo = field.config.estimator.halo(after.resolution, after.shape) + 2 * field.stride
    reach = max(halo, math.ceil(robot_radius / after.resolution) + 1)
    rows, cols = (_find_widened_slice(changed.any(axis=1 - axis), reach) for axis in (0, 1))
    return rows, cols


def join_windows(first: CellWindow | None, second: CellWindow | None) -> CellWindow | None:
    """Return the least window that holds two windows; None stands for no cell.

    Parameters
    ----------
    first, second : (slice, slice) or None
        The windows, rows and columns of a map.
    """
    if first is None or second is None:
        return first or second
    rows, cols = (
        slice(min(a.start, b.start), max(a.stop, b.stop))
        for a, b in zip(first, second, strict=True)
    )
    return rows, cols


def crop_field(
    field: CovarianceField, window: CellWindow, robot_radius: float
) -> tuple[CovarianceField, CellWindow]:
    """Return the part of a field around a window of its map, and the window within the part."""
    grid, stride = field.grid, field.stride
    margin = 2 * stride + math.ceil(robot_radius / grid.resolution) + 1
    cells, points, inside = [], [], []
    for inner, size in zip(window, grid.shape, strict=True):
        first = max(0, inner.start - margin) // stride
        last = min(size, inner.stop + margin)
        cells.append(slice(first * stride, last))
        points.append(slice(first, -(-last // stride)))
        inside.append(slice(inner.start - first * stride, inner.stop - first * stride))
    crop = OccupancyGrid(grid.cells[tuple(cells)], grid.resolution, name=grid.name)
    values = {name: array[tuple(points)] for name, array in field.values.items()}
    return CovarianceField.from_values(values, crop, field.config), (inside[0], inside[1])


def _find_widened_slice(is_marked: Bools, reach: int) -> slice:
    """Return all marked places and those up to `reach` from the first and the last one."""
    places = np.flatnonzero(is_marked)
    return slice(max(0, int(places[0]) - reach), min(is_marked.size, int(places[-1]) + reach + 1))


ROBOT_RADIUS = 0.25
"""Default radius of the robot [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Costmap(CostLayers, StoredObject):
    """Cost of travel for every cell: J(path) = integral of density ds.

    The density is 1 + weight * u. If there are preferred zones, cells outside of them have 1 more.
    In no-go zones it is infinite.

    It is made by `from_field`, `from_layers`, `from_density` or `blank`. Its arrays are read-only;
    read-only arrays are kept, writable ones are copied.
    """

    kind: ClassVar[str] = "costmap"
    version: ClassVar[int] = 2

    @classmethod
    def from_field(
        cls,
        field: CovarianceField,
        *,
        weight: float | None = None,
        robot: Robot | float = ROBOT_RADIUS,
        law: Literal["logarithmic", "linear", "cube-root"] = "logarithmic",
        criterion: str | None = None,
        headings: Literal["mean", "worst"] = "mean",
        zones: Zones | None = None,
    ) -> Costmap:
        """Make a density 1 + weight * u on free cells, with u between the field's absolute anchors.

        Parameters
        ----------
        field : CovarianceField
            The field, with its map; u is made of Sigma + Q, whether or not its estimator adds Q.
        weight : float, optional
            Metres of detour accepted per degenerate metre, >= 0; by default the estimator's weight.
            A higher weight avoids degenerate places by longer paths.
        robot : Robot, or float, default 0.25
            The robot, or its radius [m], >= 0: cells closer to an occupied cell are
            blocked;
            `Footprint` has the radii of a robot that is not round.
        law : str, default "logarithmic"
            "logarithmic": u = ln(s/s_min) / ln(s_max/s_min) of the criterion's value s; "linear":
            s / s_max, which charges the worst places only; "cube-root": the cube root of s / s_max.
            All are clipped to 0..1.
        criterion : str, optional
            Value that u is made of, by default the estimator's criterion ("e" for `Sad`, otherwise
            "position_std"): "e", "position_std", "position_rms", "heading_std" (see
            `locplan.field.scalar`), or a layer of the field, "ambiguity" or "entropy", with the
            linear law.
        headings : str, default "mean"
            Value of u and e if the field has several headings and the robot's heading is unknown:
            the "mean" or the "worst" value over the headings. Planners whose states have a heading
            use the value at that heading.
        zones : Zones, optional
            The zones: cells in no-go ones are blocked, and those outside preferred ones cost 1
            more per metre.

        Raises
        ------
        ConfigError
            If weight or radius is negative or not finite, or a name is unknown.
        """
        check_instance("field", field, CovarianceField, "compute one with locplan.load_or_compute")
        grid, estimator = field.grid, field.config.estimator
        weight = estimator.weight if weight is None else weight
        criterion = criterion or estimator.criterion
        check_weight(weight)
        check_choice("law", law, ("logarithmic", "linear", "cube-root"))
        check_choice("headings", headings, ("mean", "worst"))
        settings = CostSettings(
            law, criterion, headings, field.config, not field.is_interpolated.any()
        )
        u, e = compute_degeneracy(field, criterion, law, headings)
        zones = normalize_zones(zones)
        density = add_zone_costs(compute_density(u, weight), grid, zones)
        return cls(
            grid=grid,
            density=block_near_walls(density, grid, planning_radius(robot)),
            weight=float(weight),
            robot_radius=planning_radius(robot),
            u=make_readonly(u),
            e=make_readonly(e),
            of_heading=HeadingLayers.from_field(field, settings),
            settings=settings,
            robot=robot_or_none(robot),
            zones=zones,
        )

    @classmethod
    def from_layers(
        cls,
        grid: OccupancyGrid,
        *,
        u: ArrayLike,
        e: ArrayLike | None = None,
        weight: float = LidarEstimator.weight,
        robot: Robot | float = ROBOT_RADIUS,
        zones: Zones | None = None,
    ) -> Costmap:
        """Make a density 1 + weight * u on free cells from a custom degeneracy.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        u : (H, W) array
            Degeneracy of each cell, 0 to 1, row 0 at the lowest y. Cells that are not free are
            blocked, whatever their value.
        e : (H, W) array, optional
            Uncertainty of each free cell, >= 0 [m^2 rad], of which paths have the integral; without
            it a path's `integrated_e` is NaN.
        weight : float, default 8.0
            Metres of detour accepted per degenerate metre, >= 0; by default the weight of
            estimators that simulate a lidar.
        robot : Robot, or float, default 0.25
            The robot, or its radius [m], >= 0: cells closer to an occupied cell are
            blocked.
        zones : Zones, optional
            The zones: cells in no-go ones are blocked, and those outside preferred ones cost 1
            more per metre.

        Raises
        ------
        ConfigError
            If an array has another shape than the map, or is out of its range in a free cell.

        Examples
        --------
        >>> from locplan.maps import FREE, OccupancyGrid
        >>> grid = OccupancyGrid(np.full((3, 4), FREE), resolution=0.5)
        >>> u = np.array([[0.0], [1.0], [0.5]]) * np.ones(grid.shape)
        >>> Costmap.from_layers(grid, u=u, weight=4.0).density[:, 0].tolist()
        [1.0, 5.0, 3.0]
        """
        check_grid(grid)
        check_weight(weight)
        of_u = copy_checked_layer("u", u, grid, 1.0)
        of_e = (
            np.full(grid.shape, np.nan) if e is None else copy_checked_layer("e", e, grid, math.inf)
        )
        zones, radius, robot_model = (
            normalize_zones(zones),
            planning_radius(robot),
            robot_or_none(robot),
        )
        density = block_near_walls(
            add_zone_costs(compute_density(of_u, weight), grid, zones), grid, radius
        )
        return cls(grid, density, float(weight), radius, of_u, of_e, robot=robot_model, zones=zones)

    @classmethod
    def from_density(
        cls,
        grid: OccupancyGrid,
        density: ArrayLike,
        *,
        robot: Robot | float = 0.0,
        zones: Zones | None = None,
    ) -> Costmap:
        """Make a costmap from a custom density.

        Without a field a path's `integrated_e` and `integrated_u` are NaN.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        density : (H, W) array
            Cost per metre of each cell, 1 to 1e9, or inf to block it, row 0 at the lowest y. Cells
            that are not free are blocked in any case.
        robot : Robot, or float, default 0.0
            The robot, or its radius [m], >= 0: cells whose centre is closer to an occupied cell are
            blocked as well;
            0 if the density does that already.
        zones : Zones, optional
            The zones: cells in no-go ones are blocked, and those outside preferred ones cost 1
            more per metre.

        Raises
        ------
        ConfigError
            If the array has another shape than the map, or holds NaN, values below 1, or finite
            ones above 1e9.
        """
        check_grid(grid)
        values = copy_layer("density", density, grid)
        if not ((values >= 1) & ((values <= MAX_DENSITY) | np.isposinf(values))).all():
            raise ConfigError(
                f"density must lie in 1..{MAX_DENSITY:g} everywhere, or be inf to block"
            )
        values[~grid.free] = np.inf
        zones = normalize_zones(zones)
        values = block_near_walls(add_zone_costs(values, grid, zones), grid, planning_radius(robot))
        nothing = np.broadcast_to(np.nan, grid.shape)
        radius, robot_model = planning_radius(robot), robot_or_none(robot)
        return cls(
            grid, values, math.nan, radius, u=nothing, e=nothing, robot=robot_model, zones=zones
        )

    @classmethod
    def blank(
        cls,
        grid: OccupancyGrid,
        *,
        robot: Robot | float = ROBOT_RADIUS,
        zones: Zones | None = None,
    ) -> Costmap:
        """Return a costmap with cost 1 in each cell that the robot can enter, without a field.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        robot : Robot, or float, default 0.25
            The robot, or its radius [m], >= 0: cells closer to an occupied cell are
            blocked.
        zones : Zones, optional
            The zones; only no-go zones count, since preferred ones do not make paths shorter.
        """
        check_grid(grid)
        closed = normalize_zones(zones).no_go_zones
        return cls.from_density(grid, np.ones(grid.shape), robot=robot, zones=closed)

    def with_weight(self, weight: float) -> Costmap:
        """Return a copy of the costmap with the density of another weight.

        Parameters
        ----------
        weight : float
            Metres of detour accepted per degenerate metre, 0 to 1e9; 0 finds shortest paths.

        Raises
        ------
        ConfigError
            If the costmap has no field, or the weight is negative or not finite.
        """
        check_weight(weight)
        if math.isnan(self.weight):
            raise ConfigError("a costmap from a density has no weight; make another one instead")
        density = compute_density(self.u, weight) + self.zones.cost_per_metre(self.grid)
        density[np.isinf(self.density)] = np.inf
        return dataclasses.replace(self, density=make_readonly(density), weight=float(weight))

    @property
    def for_shortest(self) -> Costmap:
        """Copy of the costmap whose cheapest path is the least degenerate of the shortest paths.

        Preferred zones do not count.
        """
        return dataclasses.replace(self, zones=self.zones.no_go_zones).with_weight(1e-6)

    def update(self, field: CovarianceField, *, window: CellWindow | None = None) -> Costmap:
        """Return the costmap of an edited map, recomputed only in cells that the edit can change.

        It equals `from_field` with this costmap's settings; cells that `with_blocked` has blocked
        must be blocked again. All cells are recomputed if a field has values at some points only.

        Parameters
        ----------
        field : CovarianceField
            The field of the edited map, such as `CovarianceField.update` gives.
        window : (slice, slice), optional
            Rows and columns of cells that are recomputed in any case, such as those whose field
            values are older than an edit.

        Raises
        ------
        ConfigError
            If the costmap has no field, or the new one has another config.
        FieldError
            If the new map has another shape, resolution or origin.
        """
        check_instance("field", field, CovarianceField, "compute one with field.update(grid)")
        grid, settings = field.grid, self.settings
        if settings is None or settings.config != field.config:
            raise ConfigError("the field has another config than the costmap; make a new costmap")
        window = join_windows(window, find_changed_window(self.grid, field, self.robot_radius))
        if not settings.whole_field or field.is_interpolated.any():
            costs = self._make_from_field(field, settings, self.zones)
            return dataclasses.replace(costs, robot=self.robot)
        arrays = {name: getattr(self, name) for name in LAYERS}
        if window:
            part, inside = crop_field(field, window, self.robot_radius)
            costs = self._make_from_field(part, settings, Zones())
            for name in LAYERS:
                arrays[name] = arrays[name].copy()
                arrays[name][window] = getattr(costs, name)[inside]
            charge = np.broadcast_to(self.zones.cost_per_metre(grid), grid.shape)[window]
            arrays["density"][window] += charge
            arrays["density"][window][self.zones.cells(grid, "no-go")[window]] = np.inf
            for name in LAYERS:
                make_readonly(arrays[name])
        return dataclasses.replace(
            self,
            grid=grid,
            density=arrays["density"],
            u=arrays["u"],
            e=arrays["e"],
            of_heading=HeadingLayers.from_field(field, settings),
        )

    def _make_from_field(
        self, field: CovarianceField, settings: CostSettings, zones: Zones
    ) -> Costmap:
        """Make a costmap of another field with the weight and radius of this one."""
        return Costmap.from_field(
            field,
            weight=self.weight,
            robot=self.robot_radius,
            law=settings.law,
            criterion=settings.criterion,
            headings=settings.headings,
            zones=zones,
        )

    def with_blocked(self, blocked: Bools) -> Costmap:
        """Return a copy of the costmap with more cells blocked, such as a closed zone.

        Parameters
        ----------
        blocked : (H, W) array of bool
            True for cells that the robot must not enter, row 0 at the lowest y.
        """
        return dataclasses.replace(
            self, density=make_readonly(np.where(blocked, np.inf, self.density))
        )

    def with_robot(self, robot: Robot | float) -> Costmap:
        """Return a copy of the costmap for another robot.

        Parameters
        ----------
        robot : Robot, or float
            The robot, or its radius [m], at least the costmap's: blocked cells cannot be freed
            again.
        """
        radius = planning_radius(robot)
        if radius < self.robot_radius:
            raise ConfigError(
                f"a costmap for a radius of {self.robot_radius:g} m cannot serve one of"
                f" {radius:g} m; make another one instead"
            )
        density = block_near_walls(self.density, self.grid, radius)
        robot_model = robot_or_none(robot) or self.robot
        return dataclasses.replace(self, density=density, robot_radius=radius, robot=robot_model)

    def figure(self) -> Figure:
        """Draw the degeneracy u of a costmap over its map; blocked cells show the map."""
        from locplan.planning.figures import costmap_figure

        return costmap_figure(self)


def summarize_costs(costs: Costmap) -> dict[str, object]:
    """Return the version, map and settings of a costmap as data for JSON.

    Parameters
    ----------
    costs : Costmap
        The costmap, whether or not it has a field.
    """
    return {
        "locplan": __version__,
        "map": {"name": costs.grid.name, "digest": costs.grid.digest},
        **nan_to_none({"weight": costs.weight, "robot_radius": costs.robot_radius}),
        **({"zones": costs.zones.to_json()} if costs.zones else {}),
        **(costs.settings.to_json() if costs.settings else {}),
    }


def check_costs(costs: object) -> None:
    """Raise a ConfigError unless this is a costmap.

    Parameters
    ----------
    costs : object
        What a function was given for a costmap.
    """
    check_instance("costs", costs, Costmap, "make one with locplan.Costmap.from_field(field)")

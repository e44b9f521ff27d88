"""Layers of a costmap: a field's degeneracy between absolute anchors, and the cost density."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.checks import (
    check_choice,
    check_number,
    check_position,
    parse_poses,
    short_repr,
)
from locplan._support.kernels.arrays import Array, Floats, Singles
from locplan._support.public import DrawableResult
from locplan.errors import ConfigError, PoseError
from locplan.field.config import FieldConfig
from locplan.field.covariance import SCALARS
from locplan.field.field import CovarianceField
from locplan.field.sad import Sad
from locplan.maps.grid import OccupancyGrid, format_extent
from locplan.maps.occupancy import OCCUPIED, UNKNOWN
from locplan.maps.zones import Zones
from locplan.robots.robot import Robot


def check_criterion(criterion: str, config: FieldConfig) -> None:
    """Check that fields have a scalar, before they are computed.

    Parameters
    ----------
    criterion : str
        The scalar or layer that degeneracy is to be made of, see `Costmap.from_field`.
    config : FieldConfig
        Settings of the fields.

    Raises
    ------
    ConfigError
        If they have none of this name.
    """
    layers = [layer.name for layer in config.estimator.layers]
    check_choice("criterion", criterion, [*SCALARS, *layers])


def compute_degeneracy(
    field: CovarianceField, criterion: str, law: str, headings: Literal["mean", "worst"] | None
) -> tuple[Floats, Floats]:
    """Compute u and e of a field, (H, W), or without `headings` of each heading, (n, H, W)."""
    check_criterion(criterion, field.config)
    if not np.less(*field.anchors(criterion)):
        raise ConfigError(
            f"criterion {short_repr(criterion)} is meaningless in a field without rotation"
        )
    values, of_e = field.scalar(criterion, with_q=True), field.scalar("e")
    if values.ndim == 2:
        return _compute_degeneracy(field, criterion, law, values, of_e)
    count = values.shape[2]
    if headings is None:
        heading_layers = np.empty((2, count, *field.grid.shape))
        for k in range(count):
            heading_layers[:, k] = _compute_degeneracy(
                field, criterion, law, values[..., k], of_e[..., k]
            )
        return heading_layers[0], heading_layers[1]
    # One heading at a time, since all of a large map take much memory.
    combined = np.zeros((2, *field.grid.shape))
    join = np.add if headings == "mean" else np.maximum
    for k in range(count):
        join(
            combined,
            _compute_degeneracy(field, criterion, law, values[..., k], of_e[..., k]),
            out=combined,
        )
    u, e = combined / count if headings == "mean" else combined
    return u, e


def _compute_degeneracy(
    field: CovarianceField, criterion: str, law: str, values: Floats, of_e: Floats
) -> tuple[Floats, Floats]:
    """Compute u and e, (H, W), from the criterion and e on the lattice, (h, w)."""
    lowest, greatest = field.anchors(criterion)
    e = field.interpolate_on_map(of_e)
    if criterion in field.layers:
        u = field.interpolate_on_map((values - lowest) / (greatest - lowest), logarithmic=False)
    elif law == "logarithmic" and np.shares_memory(values, of_e):
        u = e / lowest
        u = np.log(u, out=u)
        u /= math.log(greatest / lowest)
    elif law == "logarithmic":
        values = np.log(np.maximum(values, np.finfo(float).tiny) / lowest)
        u = field.interpolate_on_map(values / math.log(greatest / lowest), logarithmic=False)
    else:
        u = field.interpolate_on_map(values / greatest)
        u = np.cbrt(u, out=u) if law == "cube-root" else u
    return np.clip(u, 0.0, 1.0, out=u), e


LAYERS = ("density", "u", "e")
"""Names of the arrays of a costmap."""
SHORTEST_WEIGHT = 1e-3
"""Weight up to which the cheapest path is a shortest one, whatever u is."""


@dataclass(frozen=True, eq=False, repr=False)
class CostLayers(DrawableResult):
    """The arrays of a costmap, with the settings they were made with."""

    grid: OccupancyGrid
    """The map."""
    density: Floats
    """Cost per metre, at least 1; infinite where the robot cannot be, (H, W)."""
    weight: float
    """Metres of detour accepted per degenerate metre (lambda), >= 0; NaN without a field."""
    robot_radius: float
    """Minimum distance from the robot's centre to an occupied cell [m], >= 0."""
    u: Floats
    """Degeneracy of a cell, 0..1, (H, W); NaN where there is no field."""
    e: Floats
    """The field's e [m^2 rad], (H, W); NaN where there is no field."""
    of_heading: HeadingLayers | None = None
    """u and e for n headings of the robot, evenly spaced from 0 on; None if they are equal."""
    settings: CostSettings | None = None
    """Settings of u; None without a field."""
    robot: Robot | None = field(default=None, compare=False)
    """The robot that it was made for, which is not saved; None where only its radius is known."""
    zones: Zones = field(default_factory=Zones)
    """The zones: no-go cells are blocked, and cells outside the preferred zones cost 1 more."""

    def __post_init__(self) -> None:
        for name in LAYERS:
            layer = getattr(self, name)
            if layer.flags.writeable:
                object.__setattr__(self, name, make_readonly(layer.copy()))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in LAYERS:
            make_readonly(state[name])

    def copy(self) -> Self:
        """Return a copy of the costmap that shares nothing with it, not even the map."""
        return copy.deepcopy(self)

    def __repr__(self) -> str:
        is_custom = math.isnan(self.weight)
        source_text = "a density of one's own" if is_custom else f"weight {self.weight:g}"
        grid = repr(self.grid).removeprefix("OccupancyGrid(").partition(", origin")[0]
        return f"{type(self).__name__}({grid}, robot radius {self.robot_radius:g} m, {source_text})"

    @property
    def u_of_heading(self) -> Singles | None:
        """Degeneracy u for n headings of the robot, evenly spaced from 0 on, (n, H, W), or None."""
        return None if self.of_heading is None else self.of_heading.u_and_e[0]

    @property
    def e_of_heading(self) -> Singles | None:
        """Values of e for the headings of `u_of_heading` [m^2 rad], (n, H, W), or None."""
        return None if self.of_heading is None else self.of_heading.u_and_e[1]

    @property
    def density_of_heading(self) -> Floats:
        """Values of `density` for each heading, (n, H, W); (1, H, W) without heading layers."""
        if self.u_of_heading is None:
            return self.density[None]
        density = compute_density(self.u_of_heading.astype(np.float64), self.weight)
        density += self.zones.cost_per_metre(self.grid)
        return np.where(np.isfinite(self.density), density, np.inf)

    @property
    def unblocked_density(self) -> Floats:
        """`density` also where only the robot's radius blocks a cell, if there is a field."""
        if math.isnan(self.weight):
            return self.density
        return add_zone_costs(compute_density(self.u, self.weight), self.grid, self.zones)

    @property
    def max_excess(self) -> float:
        """Largest finite `density` beyond 1 that weight and zones allow; NaN without a weight."""
        return self.weight + self.zones.max_cost_per_metre

    @property
    def e_unit(self) -> str:
        """Unit of e, without the angle where poses have no heading."""
        estimator = self.settings and self.settings.config.estimator
        flat = estimator and estimator.lattice(self.grid.resolution).dimension == 2
        return "m²" if flat else "m² rad"

    @property
    def estimator_note(self) -> str:
        """A text on a better estimator for the robot's lidar; empty if there is none."""
        estimator = self.settings and self.settings.config.estimator
        if not isinstance(estimator, Sad) or not self.weight > SHORTEST_WEIGHT:
            return ""
        if not (estimator.lidar or (self.robot and self.robot.lidar)):
            return ""
        return (
            "u is made of Sad, which does not simulate the robot's lidar; make the field with"
            " locplan.Fused(robot.lidar), on the command line --field fused"
        )

    @property
    def has_weak_spots(self) -> bool:
        """True if u is above 0 anywhere; True where there is no field."""
        return bool((self.u > 0).any() or np.isnan(self.u).all())

    @overload
    def at(self, poses: ArrayLike, name: None = None) -> dict[str, Floats]: ...
    @overload
    def at(self, poses: ArrayLike, name: str) -> Floats: ...
    def at(self, poses: ArrayLike, name: str | None = None) -> Any:
        """Return the values of the cells at poses, of the nearest heading if headings differ.

        Outside the map, as in cells that are not free, u and e are NaN, and the density infinite.

        Parameters
        ----------
        poses : (n, 2) or (n, 3) array, or one (x, y) or (x, y, heading)
            Poses in the world [m, m, rad]. If they have no heading, `density`, `u` and `e` count.
        name : str, optional
            "density", "u" or "e" [m^2 rad], (n,) each, numbers of one pose; by default all by name.

        Examples
        --------
        >>> from locplan import Costmap
        >>> grid = OccupancyGrid([[254, 254, 0]], resolution=0.5)
        >>> costs = Costmap.from_layers(grid, u=[[0.0, 0.5, 0.0]], weight=4.0, robot=0.0)
        >>> costs.at([[0.2, 0.1], [0.7, 0.1], [1.2, 0.1], [9.0, 0.1]], "density").tolist()
        [1.0, 3.0, inf, inf]
        """
        array, is_single = parse_poses(poses)
        cell_indices = self.grid.cell(array)
        inside = self.grid.contains(*cell_indices)
        cells = tuple(np.where(inside, index, 0) for index in cell_indices)
        values: dict[str, Floats] = {layer: getattr(self, layer)[cells] for layer in LAYERS}
        if array.shape[1] == 3 and self.of_heading is not None:
            count = len(self.of_heading.u_and_e[0])
            nearest = np.floor(array[:, 2] / (2 * np.pi) * count + 0.5).astype(int) % count
            u, e = (layer[nearest, *cells].astype(float) for layer in self.of_heading.u_and_e)
            charge = np.broadcast_to(self.zones.cost_per_metre(self.grid), self.grid.shape)[cells]
            density = compute_density(u, self.weight) + charge
            density = np.where(np.isfinite(values["density"]), density, np.inf)
            values = {"density": density, "u": u, "e": e}
        for layer in LAYERS:
            values[layer][~inside] = np.inf if layer == "density" else np.nan
        values = {layer: value[0] if is_single else value for layer, value in values.items()}
        return values if name is None else values[str(check_choice("name", name, LAYERS))]

    def find_cell(self, xy: Sequence[float], role: str = "position") -> tuple[int, int]:
        """Return row and column of the cell at a world position that is free for the robot.

        Parameters
        ----------
        xy : (x, y)
            The world position [m].
        role : str, default "position"
            Name of the position in errors, such as "start".

        Raises
        ------
        PoseError
            If the robot cannot stand there. The error has the reason, and the nearest free
            position.
        """
        x, y = check_position(xy, name=role)
        row, col = self.grid.cell((x, y))
        fault = self._find_cell_fault(row, col)
        if fault is None:
            return row, col
        remedy = f"no cell of the map is free for a robot of radius {self.robot_radius:g} m"
        rows, cols = np.nonzero(np.isfinite(self.density))
        if rows.size:
            grid_position = self.grid.world_to_grid(x, y)
            at = np.argmin(
                (rows + 0.5 - grid_position[0]) ** 2 + (cols + 0.5 - grid_position[1]) ** 2
            )
            nearest = self.grid.position(int(rows[at]), int(cols[at]))
            decimals = max(2, math.ceil(1 - math.log10(self.grid.resolution)))
            remedy = "the nearest free position is "
            remedy += ",".join(f"{v:.{decimals}f}" for v in nearest)
        is_outside = not self.grid.contains(row, col)
        if is_outside and self._find_cell_fault(*self.grid.cell((y, x))) is None:
            remedy = f"did you swap x and y? {y:.10g},{x:.10g} is free"
        hint = "locplan info MAP -o PICTURE shows coordinates"
        raise PoseError(f"{role} {x:.10g},{y:.10g} {fault}; {remedy}; {hint}")

    def _find_cell_fault(self, row: int, col: int) -> str | None:
        """Return the reason why a robot cannot stand in a cell; None if it can."""
        if not self.grid.contains(row, col):
            return f"lies outside the map, which reaches from {format_extent(self.grid)}"
        if np.isfinite(self.density[row, col]):
            return None
        level = self.grid.cells[row, col]
        if level in (OCCUPIED, UNKNOWN):
            return "lies in a wall" if level == OCCUPIED else "lies in unknown space"
        if self.zones.cells(self.grid, "no-go")[row, col]:
            return "lies in a no-go zone"
        clearance, radius = self.grid.clearance[row, col], self.robot_radius
        if clearance < radius:
            return (
                f"is {clearance:.2f} m from a wall, closer than the robot's radius of {radius:g} m"
            )
        return "lies in a blocked cell"


MAX_DENSITY = 1e9
"""Maximum finite density; with a higher one, rounding would swallow a path's short steps."""


@dataclass(frozen=True)
class CostSettings:
    """Settings of the degeneracy u of a costmap; see `Costmap.from_field`."""

    law: Literal["logarithmic", "linear", "cube-root"]
    """Law that makes u of the criterion: "logarithmic", "linear" or "cube-root"."""
    criterion: str
    """Scalar or layer of the field that u is made of, such as "e" or "position_std"."""
    headings: Literal["mean", "worst"]
    """Value that counts where the robot's heading is not known: "mean" or "worst"."""
    config: FieldConfig
    """The settings of the field."""
    whole_field: bool = True
    """False if the field has values at some lattice points only, as near paths."""

    def to_json(self) -> dict[str, object]:
        """Return all settings, fit for JSON."""
        return {**vars(self), "config": self.config.to_json()}


@dataclass(frozen=True, eq=False)
class HeadingLayers:
    """u and e for each heading of the robot, read from a field when they are first asked for."""

    read: Callable[[], tuple[NDArray[np.floating], NDArray[np.floating]]]
    """It returns u, 0..1, and e [m^2 rad] for n headings, (n, H, W) each."""

    @classmethod
    def from_field(cls, field: CovarianceField, settings: CostSettings) -> HeadingLayers | None:
        """Return the layers of a field's headings; None if it has one heading."""
        if field.config.headings == 1:
            return None
        return cls(partial(compute_degeneracy, field, settings.criterion, settings.law, None))

    @cached_property
    def u_and_e(self) -> tuple[Singles, Singles]:
        """u and e, (n, H, W) each, read-only."""
        u, e = (np.array(layer, np.float32) for layer in self.read())
        return make_readonly(u), make_readonly(e)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, HeadingLayers):
            return NotImplemented
        pairs = zip(self.u_and_e, other.u_and_e, strict=True)
        return self is other or all(np.array_equal(*pair, equal_nan=True) for pair in pairs)

    def __hash__(self) -> int:
        return 0  # the costmaps that have them differ in more

    def to_json(self) -> dict[str, Singles]:
        """Return both layers by name."""
        return dict(zip(("u", "e"), self.u_and_e, strict=True))

    @classmethod
    def from_json(cls, layers: Mapping[str, Singles]) -> HeadingLayers:
        """Return the layers that `to_json` encoded."""
        return cls(lambda: (layers["u"], layers["e"]))

    def __getstate__(self) -> dict[str, Any]:
        # Once both are read, the field, which is large, is no longer needed.
        layers = vars(self).get("u_and_e")
        return {"read": partial(tuple, layers), "u_and_e": layers} if layers else vars(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for layer in state.get("u_and_e", ()):
            make_readonly(layer)


def compute_density(u: Floats, weight: float) -> Floats:
    """Return 1 + weight u; infinite where u is NaN."""
    density = u * weight
    density += 1
    np.copyto(density, np.inf, where=np.isnan(u))
    return density


def add_zone_costs(density: Floats, grid: OccupancyGrid, zones: Zones) -> Floats:
    """Add the cost of zones to a density: infinite in no-go ones, 1 outside preferred ones."""
    if zones.max_cost_per_metre:
        density += zones.cost_per_metre(grid)
    if zones.has_kind("no-go"):
        np.copyto(density, np.inf, where=zones.cells(grid, "no-go"))
    return density


def copy_layer(name: str, layer: ArrayLike, grid: OccupancyGrid) -> Floats:
    """Return a copy of a custom layer; a ConfigError if its shape differs from the map's."""
    values = np.array(layer, dtype=np.float64)
    if values.shape != grid.shape:
        raise ConfigError(f"{name} has shape {values.shape}, but the map {grid.shape}")
    return values


def copy_checked_layer(name: str, layer: ArrayLike, grid: OccupancyGrid, highest: float) -> Floats:
    """Return a read-only copy of a custom layer, (H, W), NaN in cells that are not free.

    Raises
    ------
    ConfigError
        If it has another shape than the map, or values below 0, above the highest or not finite
        in a free cell.
    """
    values = copy_layer(name, layer, grid)
    values[~grid.free] = np.nan
    free = values[grid.free]
    if not (np.isfinite(free) & (free >= 0) & (free <= highest)).all():
        bounds = "finite and at least 0" if math.isinf(highest) else f"from 0 to {highest:g}"
        raise ConfigError(f"{name} must be {bounds} in every free cell")
    return make_readonly(values)


def block_near_walls(density: Array, grid: OccupancyGrid, robot_radius: float) -> Array:
    """Block the cells closer to occupied cells than a radius [m]; return a read-only density."""
    density = density if density.flags.writeable else density.copy()
    np.copyto(density, np.inf, where=grid.cells_near_walls(robot_radius - 1e-9))
    return make_readonly(density)


def check_weight(weight: float) -> None:
    """Check a weight of degenerate metres, before a costmap is made.

    Parameters
    ----------
    weight : float
        The weight, see `Costmap.from_field`.

    Raises
    ------
    ConfigError
        If it is no number, or not from 0 to 1e9.
    """
    check_number("weight", weight, 0, MAX_DENSITY)


def robot_or_none(robot: Robot | float) -> Robot | None:
    """Return the robot, or None if only its radius is given."""
    return robot if isinstance(robot, Robot) else None


def make_readonly(layer: Array) -> Array:
    """Make an array read-only, and return it."""
    layer.setflags(write=False)
    return layer

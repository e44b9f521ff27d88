"""Values 0..100 of masks and maps: by what Nav2's planners charge for costs, or u in per cent.

Formulas read from ros-navigation/navigation2, branches humble to main (2026-08): node_2d.cpp,
node_hybrid.cpp, navfn.cpp, theta_star.hpp and nav2_map_server's map_io.cpp; and from ROS 1's
image_loader.cpp.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import number, one_of
from locplan._util.reading import dumped
from locplan._util.tables import finite
from locplan.costs import Costmap, about_costs, costs_caption
from locplan.errors import ConfigError
from locplan.export._costmap import PlannedPath
from locplan.export._registry import check_has_field, export_folder
from locplan.maps import OccupancyGrid


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


def _smac(
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
        _smac("smac2d", "2D", "cost_travel_multiplier", 1.0, 10.0),
        _smac(
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
    """Share of the cells whose excess is above that, 0..1."""
    quantisation: float
    """Largest difference of weight u and the planner's charge [m per m], where none saturates."""
    mean_quantisation: float
    """Mean of that difference over the cells that do not saturate [m per m]."""
    paths: tuple[PlannedPath, ...] = ()
    """The paths that planners take on the exported mask, of those that were asked for."""

    def summary(self) -> dict[str, Any]:
        """The facts by name, fit for JSON."""
        paths = [finite(dataclasses.asdict(each)) for each in self.paths]
        return {
            "planner": self.planner.name,
            "parameter": self.planner.parameter,
            "value": None if np.isnan(self.param) else self.param,
            "saturates_at_weight_u": self.greatest,
            "saturated_share": self.saturated_share,
            "largest_quantisation_error": self.quantisation,
            "mean_quantisation_error": self.mean_quantisation,
            "paths": paths,
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
            *((f"{each.planner} for {each.name}", each.text) for each in self.paths),
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
    density: Floats, planner: NavPlanner, greatest: float, param: float | None, static: bool
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
    nearest = np.searchsorted((charged[1:] + charged[:-1]) / 2, excess)
    values = np.full(density.shape, -1, np.int8)
    values[np.isfinite(density)] = choices[nearest]
    above = excess > charged[-1] * (1 + 1e-9)
    error = np.abs(charged[nearest] - excess)[~above]
    largest, mean = (float(error.max()), float(error.mean())) if error.size else (0.0, 0.0)
    charges = float(charged[-1]), float(above.mean())
    return values, Conversion(planner, param, *charges, largest, mean)


_LOW, _HIGH = 20, 216
"""Greys, counted from white, between which the 1..99 of "scale-ros1" lie."""


class YawWarning(UserWarning):
    """A map's yaw was left out."""


def without_yaw(grid: OccupancyGrid) -> OccupancyGrid:
    """The map without its yaw, which Nav2's and ROS 1's planners ignore; warns if there is one."""
    x, y, yaw = grid.origin
    if not yaw:
        return grid
    text = f"{grid.name or 'the map'} has a yaw of {yaw:g} rad, which the stacks ignore:"
    warnings.warn(YawWarning(f"{text} written as they have it, unturned"), stacklevel=2)
    return dataclasses.replace(grid, origin=(x, y, 0.0))


def where_unturned(grid: OccupancyGrid, xy: Floats) -> Floats:
    """World positions (n, 2) as they are on the map without its yaw [m]."""
    unturned = dataclasses.replace(grid, origin=(*grid.origin[:2], 0.0))
    return np.column_stack(unturned.grid_to_world(*grid.world_to_grid(*xy.T)))


def write_values(
    stem: Path, values: NDArray[np.int8], grid: OccupancyGrid, mode: str = "raw"
) -> None:
    """Write values 0..100, or -1 for unknown, that map servers read back unchanged.

    The YAML is `stem` with its suffix. The image is a .pgm in mode "raw", with grey n for n and
    255 for unknown, which Nav2 and ROS 1 read alike. It is a .png in the modes "scale" for Nav2
    and "scale-ros1" for ROS 1, whose scale has other steps.
    """
    from PIL import Image

    if mode == "raw":
        picture = Image.fromarray(values[::-1].view(np.uint8))
        image = stem.with_suffix(".pgm")
        free, occupied = 0.196, 0.65
    else:
        greys, (free, occupied) = _greys(mode)
        known = values >= 0  # ROS 1 looks at the opacity between its thresholds only
        shown = np.dstack([greys[np.where(known, values, 50)], np.where(known, 255, 0)])
        picture = Image.fromarray(shown[::-1].astype(np.uint8))
        image = stem.with_suffix(".png")
    picture.save(image)
    entries = {
        "image": image.name,
        "mode": mode.partition("-")[0],
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": occupied,
        "free_thresh": free,
    }
    stem.with_suffix(".yaml").write_text(dumped(entries, default_flow_style=None), "utf-8")


def percent(costs: Costmap) -> NDArray[np.int8]:
    """u in per cent, 0..100, and -1 where it is not known, (H, W).

    Parameters
    ----------
    costs : Costmap
        A costmap that was made of a field.

    Raises
    ------
    ConfigError
        If the costmap was made without a field.
    """
    check_has_field(costs)
    values = np.floor(100 * np.nan_to_num(costs.u) + 0.5)
    return np.where(np.isnan(costs.u), -1, values).astype(np.int8)


def speed_mask(costs: Costmap, slowest: float, lead: float) -> NDArray[np.int8]:
    """The per cent of its speed that a robot gives up, 0..99 (H, W), or -1 where u is not known.

    Arguments and errors are those of `nav2_speed`.
    """
    import cv2

    number("slowest", slowest, 0.01, 1)
    number("lead", lead, 0)
    check_has_field(costs)
    known = ~np.isnan(costs.u)
    if not known.any():
        raise ConfigError("u is not known in any cell of the map, so a mask would be empty")
    given_up = np.floor(100 * (1 - slowest) * np.nan_to_num(costs.u) + 0.5)
    reach = min(round(lead / costs.grid.resolution), max(costs.grid.shape))
    around = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    widened = cv2.dilate(given_up.astype(np.uint8), around.astype(np.uint8))
    return np.where(known, np.minimum(widened, 99), -1).astype(np.int8)  # 100 means full speed


def ros_map(folder: str | Path, costs: Costmap) -> None:
    """Write u in per cent as maps in the modes raw and scale.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    costs : Costmap
        A costmap that was made of a field.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or there is no field.
    """
    from locplan.export import _figures

    values = percent(costs)
    about = {"kind": "ros-map"} | about_costs(costs)
    grid = without_yaw(costs.grid)
    with export_folder(folder, "ros-map.md", about, map=grid.name or "a map") as temporary:
        for mode in ("raw", "scale", "scale-ros1"):
            write_values(temporary / mode.replace("-", "_"), values, grid, mode)
        title = f"{grid.name or 'map'}: as it is published{costs_caption(costs)}"
        figure = _figures.values_figure(costs.grid, values, "degeneracy u [%]", title)
        _figures.save_preview(temporary, figure, dpi=90)


def _greys(mode: str) -> tuple[Ints, tuple[float, float]]:
    """The grey of each value 0..100, and free_thresh and occupied_thresh."""
    n = np.arange(101)
    if mode == "scale":
        return np.floor(255 * (1 - n / 100) + 0.5).astype(np.int64), (0.0, 1.0)
    # ROS 1 truncates 1 + 98 r, r the share of the way between the thresholds: n lies in the
    # middle of its step of two greys, and 99 on the threshold itself.
    from_white = np.clip(_LOW + 2 * n - 1, _LOW, _HIGH)
    from_white[[0, 99, 100]] = 0, _HIGH, 255
    return 255 - from_white, (_LOW / 255, _HIGH / 255)

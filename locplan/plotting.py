"""Pictures of maps, fields and paths.

The functions that begin with ``draw_`` draw on given Axes; the others make a whole figure.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import matplotlib.patheffects as effects
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from locplan.captions import LABELS, how, request, unit_of
from locplan.costmap import Costmap
from locplan.field import CovarianceField
from locplan.files import PICTURES, check_target, replacing
from locplan.grid import FREE, UNKNOWN, OccupancyGrid
from locplan.metrics import DEGRADED, profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from locplan.path import Path
    from locplan.planners.pareto import ParetoFront
    from locplan.planners.result import Plan

FIELD_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.0, 0.8, 256)))
"""Never as dark as a wall."""
FRONT_COLOURS = "viridis"
FRONT_PATHS = 12
"""How many paths of a front are drawn at most."""
PATH_STYLES: tuple[dict[str, Any], ...] = (
    {"color": "black", "linestyle": (0, (4, 1.5))},
    {"color": "#0072b2", "linestyle": "-"},
    {"color": "#009e73", "linestyle": (0, (1, 1))},
    {"color": "#cc79a7", "linestyle": (0, (6, 1, 1, 1))},
)
"""In the order of the plans; told apart by dash as well as by colour."""
END_STYLE: dict[str, Any] = {"color": "white", "markeredgecolor": "black"}


def field_figure(field: CovarianceField, name: str = "e") -> Figure:
    """The map with one scalar of its field as a heat map.

    Parameters
    ----------
    field : CovarianceField
        The field.
    name : str
        "e", "position_std", "position_rms" or "heading_std", see `locplan.covariance.scalar`, or
        one of the field's layers. Of several headings that of the mean information is drawn.
    """
    figure = Figure(figsize=_map_size(field.grid), layout="constrained")
    axes = figure.add_subplot()
    image = draw_field(axes, field, name)
    figure.colorbar(image, ax=axes, label=f"{LABELS[name]} [{unit_of(field, name)}]", shrink=0.9)
    config = field.config
    axes.set_title(
        f"{field.grid.name or 'map'}: {field.saturated_share:.0%} saturated\n"
        f"{how(config)}, range {config.sensor_range:g} m",
        fontsize="medium",
    )
    return figure


def fields_figure(rows: Sequence[Mapping[str, CovarianceField]], name: str = "e") -> Figure:
    """A scalar of several fields side by side on one scale, a row for each map.

    Parameters
    ----------
    rows : sequence of mappings of str to CovarianceField
        Of each map its fields, by the name to show; all rows alike, e in one unit.
    name : str
        As for `field_figure`.
    """
    columns = max(map(len, rows))
    sizes = [_map_size(next(iter(fields.values())).grid) for fields in rows]
    heights = [height / width for width, height in sizes]
    size = 3.6 * columns + 1, sum(3.6 * height + 0.6 for height in heights)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    image = unit = None
    for axes_of_row, fields in zip(grid, rows, strict=True):
        for axes, (label, field) in zip(axes_of_row, fields.items(), strict=False):
            image, unit = draw_field(axes, field, name), unit_of(field, name)
            axes.set_title(label, fontsize="medium")
            axes.set(xlabel="", ylabel="")
    assert image is not None
    figure.colorbar(image, ax=grid.ravel().tolist(), label=f"{LABELS[name]} [{unit}]", shrink=0.6)
    figure.supxlabel("x [m]", fontsize="medium")
    figure.supylabel("y [m]", fontsize="medium")
    return figure


def plan_figure(costs: Costmap, field: CovarianceField, plans: Mapping[str, Plan]) -> Figure:
    """Paths over the e field of the map and, below, u along each of them.

    Parameters
    ----------
    costs : Costmap
        What the paths were planned on.
    field : CovarianceField
        The field behind it.
    plans : mapping of str to Plan
        At most four, by the name to show; unreachable ones are only named.
    """
    width, height = _map_size(costs.grid)
    figure = Figure(figsize=(width, height + 2.4), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.2))
    image = draw_field(upper, field)
    figure.colorbar(image, ax=upper, label=f"{LABELS['e']} [{field.e_unit}]", shrink=0.9)
    solved = {label: plan for label, plan in plans.items() if plan.path is not None}
    handles = []
    for (label, plan), style in zip(solved.items(), PATH_STYLES, strict=False):
        assert plan.path is not None
        assert plan.metrics is not None
        metrics = plan.metrics
        text = (
            f"{label}: {metrics.length:.1f} m, {metrics.integrated_u:.1f} m blind,"
            f" ∫e ds = {metrics.integrated_e:.3g} {field.e_unit} m"
        )
        blindness: NDArray[np.floating] = costs.u
        if plan.path.heading is not None and costs.u_of_heading is not None:
            blindness = costs.u_of_heading
        distance, u = profile(costs, plan.path, blindness)
        lower.step(distance, [*u, u[-1]], where="post", linewidth=1.8, **style)
        handles.append(Line2D([], [], path_effects=_outline(), linewidth=2, label=text, **style))
    handles += [
        Line2D([], [], linestyle="none", label=f"{label}: {plan.status}")
        for label, plan in plans.items()
        if label not in solved
    ]
    # The first plan comes out on top, with its dashes visible where paths coincide.
    for plan, style in reversed(list(zip(solved.values(), PATH_STYLES, strict=False))):
        assert plan.path is not None
        draw_path(upper, plan.path, **style)
    for plan in plans.values():
        draw_ends(upper, plan.start, plan.goal)
        if plan.via:
            upper.plot(
                *np.transpose([xy[:2] for xy in plan.via]), "s", markersize=6, zorder=4, **END_STYLE
            )
    handles += [
        Line2D([], [], linestyle="none", marker="o", label="start", **END_STYLE),
        Line2D([], [], linestyle="none", marker="*", markersize=10, label="goal", **END_STYLE),
    ]
    if any(plan.via for plan in plans.values()):
        square = Line2D([], [], linestyle="none", marker="s", label="waypoint", **END_STYLE)
        handles.append(square)
    lower.axhline(DEGRADED, color="0.6", linewidth=0.8, zorder=0)
    lower.set(xlabel="distance along the path [m]", ylabel="blindness u", ylim=(-0.03, 1.03))
    lower.margins(x=0.01)
    if not solved:
        lower.text(0.5, 0.25, "no path", transform=lower.transAxes, ha="center", va="center")
        lower.set_xticks([])
    figure.legend(
        handles=handles, loc="outside lower center", frameon=False, fontsize="medium", ncols=2
    )
    upper.set_title(f"{costs.grid.name or 'map'}: {request(costs, plans)}", fontsize="medium")
    return figure


def front_figure(front: ParetoFront, e_unit: str = "m² rad") -> Figure:
    """A Pareto front and, over the map, paths along it in the same colours, the knee's bold.

    Parameters
    ----------
    front : ParetoFront
        With at least one path.
    e_unit : str
        `CovarianceField.e_unit`.
    """
    grid = front.costs.grid
    width, height = _map_size(grid)
    figure = Figure(figsize=(width, height + 3.2), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 3.0))
    draw_map(upper, grid)
    norm = Normalize(front.length[0], max(front.length[-1], front.length[0] + 1))
    wanted = np.linspace(front.length[0], front.length[-1], FRONT_PATHS)
    chosen = np.unique(np.abs(front.length[:, None] - wanted).argmin(axis=0))
    for index in chosen:
        plan = front.plan(int(index))
        assert plan.path is not None
        colour = colormaps[FRONT_COLOURS](norm(front.length[index]))
        draw_path(upper, plan.path, color=colour, linewidth=1.6, path_effects=[])
    knee = front.knee
    best = front.plan(knee).path
    assert best is not None
    draw_path(upper, best, color=colormaps[FRONT_COLOURS](norm(front.length[knee])), linewidth=3)
    draw_ends(upper, front.start, front.goal)
    epsilon = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%}"
    name = grid.name or "map"
    upper.set_title(f"{name}: {len(chosen)} of {len(front)} paths, front {epsilon}")
    unit = "m" if front.objective == "u" else f"{e_unit} m"
    lower.plot(front.length, front.integral, color="0.7", linewidth=0.8, zorder=1)
    image = lower.scatter(
        front.length, front.integral, c=front.length, cmap=FRONT_COLOURS, norm=norm, s=14
    )
    label = f"knee, bold above: {front.length[knee]:.1f} m long, {front.integral[knee]:.3g} {unit}"
    lower.plot(
        front.length[knee], front.integral[knee], "D", markersize=9, label=label, **END_STYLE
    )
    label = "blind, ∫u ds" if front.objective == "u" else "∫e ds"
    lower.set(xlabel="length [m]", ylabel=f"{label} [{unit}]")
    lower.legend(loc="upper right", frameon=False)
    figure.colorbar(image, ax=[upper, lower], label="length [m]", shrink=0.6)
    return figure


def history_figure(plans: Mapping[str, Plan]) -> Figure:
    """The best J of sampling planners over the time since they began.

    Parameters
    ----------
    plans : mapping of str to Plan
        At most four that have a history, by the name to show.
    """
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for (label, plan), style in zip(plans.items(), PATH_STYLES, strict=False):
        if not plan.history:
            continue
        seconds, cost = np.transpose(plan.history)
        name = f"{label}: {plan.planner}, {cost[-1]:.2f} m after {seconds[-1]:.1f} s"
        axes.step(seconds, cost, where="post", linewidth=1.8, label=name, **style)
    axes.set(
        xscale="log", xlabel="time since the search began [s]", ylabel="best cost J so far [m]"
    )
    axes.set_title("best cost of each search, as it went on", fontsize="medium")
    axes.legend(frameon=False)
    return figure


def draw_map(axes: Axes, grid: OccupancyGrid) -> None:
    """The occupancy grid in world coordinates: walls black, unknown space grey, free white."""
    shades = np.zeros(grid.shape, np.uint8)
    shades[grid.cells == UNKNOWN] = 1
    shades[grid.cells == FREE] = 2
    _draw_cells(axes, grid, shades, cmap=ListedColormap(["black", "0.82", "white"]), vmin=0, vmax=2)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    _limit_to(axes, grid)


def draw_field(axes: Axes, field: CovarianceField, name: str = "e") -> AxesImage:
    """A scalar of the field over its map, on a logarithmic scale between its anchors."""
    draw_map(axes, field.grid)
    layer = name in field.layers
    values = field.on_map(field.scalar(name, headings="mean"), logarithmic=not layer)
    low, high = field.anchors(name)
    if layer:
        return _draw_cells(axes, field.grid, values, cmap=FIELD_COLOURS, norm=Normalize(low, high))
    if not field.config.quantisation and field.evaluated.any():
        low, high = np.nanmin(values), np.nanmax(values)
    low = max(low, np.finfo(float).tiny)
    norm = LogNorm(low, max(high, low * 1.001))
    return _draw_cells(axes, field.grid, values, cmap=FIELD_COLOURS, norm=norm)


def draw_path(axes: Axes, path: Path, **style: Any) -> None:
    """A path as a line; the style is matplotlib's."""
    axes.plot(*path.xy.T, **{"linewidth": 2.2, "path_effects": _outline(), **style})


def draw_ends(axes: Axes, start: Sequence[float], goal: Sequence[float]) -> None:
    """Start (circle) and goal (star), each with an arrow if it has a heading."""
    axes.plot(*start[:2], "o", markersize=7, zorder=4, **END_STYLE)
    axes.plot(*goal[:2], "*", markersize=13, zorder=4, **END_STYLE)
    for x, y, *heading in (start, goal):
        if heading:
            ahead = 22 * np.cos(heading[0]), 22 * np.sin(heading[0])  # in points, at any scale
            arrow = {"arrowstyle": "<|-", "color": "black", "linewidth": 1.5, "shrinkA": 0}
            axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow)


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = 130) -> None:
    """Write a figure, whole or not at all; the suffix chooses the format (.png, .pdf, .svg)."""
    check_target(FilePath(path), *PICTURES)
    suffix = FilePath(path).suffix.lower().lstrip(".")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=suffix, bbox_inches="tight", pad_inches=0.1)


def _draw_cells(axes: Axes, grid: OccupancyGrid, values: NDArray, **options: Any) -> AxesImage:
    height, width = (size * grid.resolution for size in grid.shape)
    x, y, yaw = grid.origin
    image = axes.imshow(
        values,
        origin="lower",
        extent=(0, width, 0, height),
        interpolation="antialiased" if values.dtype == np.uint8 else "nearest",
        **options,
    )
    image.set_transform(Affine2D().rotate(yaw).translate(x, y) + axes.transData)
    return image


def _limit_to(axes: Axes, grid: OccupancyGrid) -> None:
    """Show the cells that are known, with a margin."""
    rows, cols = np.nonzero(grid.cells != UNKNOWN)
    if rows.size == 0:
        rows, cols = np.array([0, grid.shape[0] - 1]), np.array([0, grid.shape[1] - 1])
    corner_rows = np.array([rows.min(), rows.min(), rows.max() + 1, rows.max() + 1])
    corner_cols = np.array([cols.min(), cols.max() + 1, cols.min(), cols.max() + 1])
    x, y = grid.grid_to_world(corner_rows, corner_cols)
    margin = 0.02 * max(np.ptp(x), np.ptp(y)) + grid.resolution
    axes.set(xlim=(x.min() - margin, x.max() + margin), ylim=(y.min() - margin, y.max() + margin))


def _map_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Figure size [inch] for the known part of a map with a colour bar at its side."""
    rows, cols = np.nonzero(grid.cells != UNKNOWN)
    height, width = (np.ptp(rows) + 1, np.ptp(cols) + 1) if rows.size else grid.shape
    cos, sin = abs(np.cos(grid.origin[2])), abs(np.sin(grid.origin[2]))
    height, width = sin * width + cos * height, cos * width + sin * height
    drawn_width = min(9.0, 8.0 * width / height)
    return max(drawn_width, 5.0) + 1.6, max(drawn_width * height / width, 2.0) + 0.8


def _outline() -> list[Any]:
    return [effects.Stroke(linewidth=4, foreground="white"), effects.Normal()]

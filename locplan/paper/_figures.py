"""Figures of matches: the seven models along an axis, and mismatch over the search window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from locplan._kernels.arrays import Floats
from locplan.field import OffsetLattice, Sad
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.paper import template_matching
from locplan.paper._claims import Slide
from locplan.plotting import MAP_COLOURS, Picture

MODEL_STYLES: dict[str, dict[str, Any]] = {
    "SSD": {"color": "#d55e00", "linestyle": "-", "linewidth": 1.2},
    "SAD": {"color": "#0072b2", "linestyle": "-", "linewidth": 3.5, "zorder": 1.5},
    "NSSD": {"color": "#e69f00", "linestyle": (0, (5, 1.5))},
    "NCC": {"color": "#009e73", "linestyle": (0, (5, 1.5))},
    "ZNCC": {"color": "#cc79a7", "linestyle": "-", "linewidth": 2.8, "zorder": 1.6},
    "ZCC": {"color": "black", "linestyle": (0, (1, 1))},
    "CC": {"color": "#56b4e9", "linestyle": (0, (6, 1, 1, 1))},
}
"""Line styles of the models, which differ in dashes and colour; SAD, the paper's, is broad."""


def place_figure(
    grid: OccupancyGrid, at: tuple[float, float], estimator: Sad, axis: str | None = None
) -> Figure:
    """Draw the mismatch around a place, or the seven models along an axis there.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    at : (x, y)
        Position of the place in the world [m].
    estimator : Sad
        The settings of template and window.
    axis : str, optional
        "x", "y" or "theta" draws the models along it.
    """
    title = f"{grid.name} at {at[0]:g}, {at[1]:g} m, range {estimator.range:g} m"
    if axis is not None:
        return models_figure(*template_matching.along_axis(grid, *at, axis, estimator), axis, title)
    window = estimator.lattice(grid.resolution)
    return distribution_figure({title: template_matching.mismatch(grid, *at, estimator)}, window)


def slides_figure(slides: Sequence[Slide]) -> Figure:
    """Draw slides of `locplan.paper.one_dimensional` side by side (Figs. 4-11).

    Each is a template and a map above the curves of the seven models.

    Parameters
    ----------
    slides : sequence of Slide
        The slides, at least one.
    """
    figure = Picture(figsize=(5 * len(slides), 6.4), layout="constrained")
    rows = figure.subplots(2, len(slides), squeeze=False, height_ratios=(1, 2))
    for upper, lower, slide in zip(*rows, slides, strict=True):
        _draw_strip(upper, slide)
        draw_models(lower, slide.shift, slide.curves)
        lower.set_xlabel("shift of the template [m]")
        upper.set_title(slide.title, fontsize="medium")
    rows[1][0].set_ylabel("share of each model's own greatest value")
    handles, labels = rows[1][-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=7, frameon=False)
    return figure


def models_figure(offsets: Floats, curves: Mapping[str, Floats], axis: str, title: str) -> Figure:
    """Draw the seven models along one axis of the search window at a place.

    Parameters
    ----------
    offsets : (n,) array
        Offsets along the axis [m], or [rad] for axis "theta".
    curves : mapping of str to (n,) array
        Values of the models, see `locplan.paper.template_matching.along_axis`.
    axis : str
        "x", "y" or "theta".
    title : str
        Title of the figure, such as the place.
    """
    figure = Picture(figsize=(7, 4.6), layout="constrained")
    axes = figure.subplots()
    turned = axis == "theta"
    draw_models(axes, np.degrees(offsets) if turned else offsets, curves)
    axes.set_xlabel("turn θ of the template [°]" if turned else f"shift {axis} of the template [m]")
    axes.set_ylabel("share of each model's own greatest value")
    axes.set_title(title, fontsize="medium")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)
    return figure


def draw_models(axes: Axes, offsets: Floats, curves: Mapping[str, Floats]) -> None:
    """Draw the seven models over offsets, each divided by its own greatest magnitude.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on.
    offsets : (n,) array
        Offsets along the axis, in the unit that the caller labels.
    curves : mapping of str to (n,) array
        Values of the models by name; where one is NaN, the title says that it is undefined.
    """
    undefined = []
    for name, values in curves.items():
        known = values[np.isfinite(values)]
        greatest = np.abs(known).max() if known.size else 0.0
        style = {"linewidth": 1.8} | MODEL_STYLES[name]
        axes.plot(offsets, values / (greatest or 1.0), label=name, **style)
        if known.size < values.size:
            undefined.append(name if known.size == 0 else f"{name} in parts")
    if undefined:
        text = f"undefined: {', '.join(undefined)}"
        axes.set_title(text, fontsize="small", loc="right", color="0.3")
    axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    axes.margins(x=0.01)


def distribution_figure(distributions: Mapping[str, Floats], window: OffsetLattice) -> Figure:
    """Draw mismatch over the window's planes, as surfaces and as heat maps (Figs. 18-28).

    Parameters
    ----------
    distributions : mapping of str to (nx, ny, ntheta) array
        Mismatch at every offset [m^2] for each place, by the name to show; 0 at zero offset.
    window : OffsetLattice
        The offsets.
    """
    planes = [("x", "y"), ("x", "θ"), ("y", "θ")][: 3 if window.dimension == 3 else 1]
    axes = dict.fromkeys("xy", (window.offsets, window.half_steps))
    axes["θ"] = np.degrees(window.angles), window.half_rotations
    figure = Picture(figsize=(4.2 * len(planes) + 0.8, 6.4 * len(distributions)))
    parts = figure.subfigures(len(distributions), 1, squeeze=False)[:, 0]
    for part, (label, mismatch) in zip(parts, distributions.items(), strict=True):
        nothing = "" if mismatch.any() else ": S = 0 everywhere"
        part.suptitle(label + nothing, fontsize="large")
        # Up to 1 m^2 at least, so that a featureless place looks like one.
        norm = Normalize(0, max(mismatch.max(), 1.0))
        look: dict[str, Any] = {"cmap": "cividis", "norm": norm}
        for column, plane in enumerate(planes):
            offsets = [axes[name][0] for name in plane]
            # The plane goes through the middle of the axis that it leaves out.
            cut = tuple(
                slice(None) if name in plane else middle for name, (_, middle) in axes.items()
            )
            values, names = (
                mismatch[cut],
                dict(zip(("xlabel", "ylabel"), map(_label, plane), strict=True)),
            )
            above: Any = part.add_subplot(2, len(planes), column + 1, projection="3d")
            across, along = np.meshgrid(*offsets, indexing="ij")
            above.plot_surface(across, along, values, rstride=1, cstride=1, linewidth=0.2, **look)
            above.set(zlim=(norm.vmin, norm.vmax), zlabel="S [m²]", **names)
            above.view_init(elev=32, azim=-55)
            below = part.add_subplot(2, len(planes), len(planes) + column + 1, **names)
            image = below.pcolormesh(*offsets, values.T, shading="nearest", **look)
            below.plot(0, 0, "+", color="white", markersize=9, markeredgewidth=2)
            part.colorbar(image, ax=below, label="mismatch S [m²]", shrink=0.9)
        part.subplots_adjust(0.07, 0.09, 0.94, 0.92, wspace=0.35, hspace=0.22)
    return figure


def _label(axis: str) -> str:
    return "turn θ [°]" if axis == "θ" else f"shift {axis} [m]"


def _draw_strip(axes: Axes, slide: Slide) -> None:
    """Draw the strip of map, and the template above it where its slide begins."""
    length = slide.shift[-1] / (len(slide.shift) - 1) if len(slide.shift) > 1 else 1.0
    for levels, bottom in ((slide.strip, 0.0), (slide.template, 7.0)):
        height, width = (size * length for size in levels.shape)
        shades = np.select([levels == OCCUPIED, levels == UNKNOWN, levels == FREE], [0, 1, 2])
        extent = (0, width, bottom, bottom + height)
        axes.imshow(shades, cmap=MAP_COLOURS, vmin=0, vmax=3, extent=extent, origin="lower")
        axes.add_patch(Rectangle((0, bottom), width, height, fill=False, edgecolor="black"))
    axes.annotate("template", (6.4, 10), va="center")
    axes.annotate("", (9.0, 8.4), (6.4, 8.4), arrowprops={"arrowstyle": "->", "color": "#0072b2"})
    axes.set(xlim=(-0.3, 15.3), ylim=(-0.3, 13.3), aspect="equal", yticks=(0, 6))
    axes.set(xlabel="x [m]", ylabel="y [m]")

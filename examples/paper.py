"""The paper's experiments on our maps: every figure and claim, with an index page.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.

Run: python examples/paper.py [FOLDER [RESOLUTION]]
Or, for the figures of a place of your map: python examples/paper.py FOLDER MAP X,Y
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle, Wedge

import locplan
from locplan import CovarianceField
from locplan._support.drawing import BLUE, FIELD_COLOURS, MAP_COLOURS, NotebookFigure, save_figure
from locplan.field import OffsetLattice, Sad, position_axes, sample_covariances, scalar
from locplan.maps import FREE, OCCUPIED, UNKNOWN
from locplan.maps.figures import compute_figure_size, downsample, draw_cells, draw_map
from locplan.paper import template_matching
from locplan.paper.claims import (
    PLACES,
    TemplateSlide,
    compare_models_along_strips,
    compute_claim_shares,
    compute_place_mismatch,
    compute_share_smaller_with_range,
    draw_place_maps,
)

Floats = np.ndarray
TURN = "#d62728"
"""Colour of the heading's deviation."""
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

PRESETS = {"paper": Sad.paper, "default": Sad}
RANGES = (6.0, 8.0)
NOISES = (0.0, 0.1, 0.2)


def main(
    folder: str = "paper",
    resolution: float = 0.05,
    seeds: int = 5,
    presets: tuple[str, ...] = tuple(PRESETS),
) -> None:
    columns = [(p, reach, noise) for p in presets for reach in RANGES for noise in NOISES]
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    maps = draw_place_maps(resolution=resolution)
    sections = []
    for name, caption, figure in figures(maps, presets):
        save_figure(figure, target / name, dpi=100)
        print(f"wrote {target / name}")
        sections.append(
            f'<figure><img src="{name}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
        )
    page = PAGE.format(
        figures="\n".join(sections),
        models=table(
            ("model", *(slide.title for slide in compare_models_along_strips())), models()
        ),
        claims=table(
            ("claim", *(column_title(*column) for column in columns)),
            claims(columns, resolution, seeds),
        ),
    )
    (target / "index.html").write_text(page, encoding="utf-8")
    print(f"wrote {target / 'index.html'}")


def draw_place(folder: str, map_file: str, at: str) -> None:
    """Draw the field's ellipses and e, and the correlation and the seven models at a place."""
    grid, (x, y) = locplan.load_map(map_file), map(float, at.split(","))
    target, estimator = Path(folder), Sad()
    target.mkdir(parents=True, exist_ok=True)
    fields = {
        f"{grid.name}, range {reach:g} m": locplan.load_or_compute(grid, Sad(range=reach))
        for reach in RANGES
    }
    title = f"{grid.name} at {x:g}, {y:g} m, range {estimator.range:g} m"
    mismatch = {title: template_matching.compute_mismatch_areas(grid, x, y, estimator)}
    drawn = {
        "ellipses": ellipses_figure(fields),
        "e": e_figure(fields),
        "distribution": distribution_figure(mismatch, estimator.lattice(grid.resolution)),
    }
    for axis in ("x", "y", "theta"):
        curves = template_matching.compare_models_along_axis(grid, x, y, axis, estimator)
        drawn[f"models_{axis}"] = models_figure(*curves, axis, title)
    for name, figure in drawn.items():
        save_figure(figure, target / f"{name}.png", dpi=100)
        print(f"wrote {target / name}.png")


def figures(
    maps: dict[str, locplan.OccupancyGrid], presets: tuple[str, ...]
) -> Iterator[tuple[str, str, Figure]]:
    """File name, caption and figure of each experiment."""
    yield (
        "figs_04-11_models.png",
        "Figs. 4-11: the seven models in one dimension. Templates of 6 m x 6 m slide by 9 m.",
        slides_figure(compare_models_along_strips()),
    )
    window = Sad().lattice(maps["places"].resolution)
    for place in PLACES:
        mismatch = compute_place_mismatch(maps, place, Sad())
        yield (
            f"figs_18-28_{place}.png",
            f"Figs. 18-28: correlation at {place} over x-y, x-θ and y-θ; 0 is a perfect match.",
            distribution_figure({title_of(place): mismatch}, window),
        )
    for preset in presets:
        for name, grid in maps.items():
            fields = {}
            for reach in RANGES:
                field = locplan.load_or_compute(grid, PRESETS[preset](range=reach))
                title = f"{name}, preset {preset}, range {reach:g} m"
                fields[f"{title}\nposition known to {deviations_text(field, name)}"] = field
            yield (
                f"figs_29_31_ellipses_{name}_{preset}.png",
                f"Figs. 29 and 31: error ellipses in {name}, preset {preset}.",
                labelled(ellipses_figure(fields), name),
            )
            yield (
                f"figs_30_32_e_{name}_{preset}.png",
                f"Figs. 30 and 32: e in {name}, preset {preset}; 0 in unknown and occupied cells.",
                labelled(e_figure(fields), name),
            )


def title_of(place: str) -> str:
    x, y = locplan.maps.environments.place_positions(PLACES[place])[place]
    return f"{place}, at {x:g}, {y:g} m of {PLACES[place]}, range 6 m"


def deviations_text(field: CovarianceField, name: str) -> str:
    """Return the standard deviation of the position at the paper's places on a map, as text."""
    places = locplan.maps.environments.place_positions(name)
    return ", ".join(
        f"{100 * float(field.at([*places[place], 0.0], 'position_std')):.0f} cm at {place}"
        for place, where in PLACES.items()
        if where == name
    )


def labelled(figure: Figure, name: str) -> Figure:
    """The letters of the paper's places on each map."""
    for axes in figure.axes:
        for place, where in PLACES.items():
            if where == name and axes.get_xlabel() == "x [m]":
                axes.annotate(
                    place,
                    locplan.maps.environments.place_positions(name)[place],
                    (0, 9),
                    textcoords="offset points",
                    ha="center",
                    weight="bold",
                    size="large",
                    bbox={"boxstyle": "circle,pad=0.2", "facecolor": "white", "alpha": 0.8},
                    zorder=5,
                )
    return figure


def models() -> Iterator[tuple[str, ...]]:
    """For each model, what it does in each of the three slides."""
    slides = compare_models_along_strips()
    for model in slides[0].curves:
        yield (model, *(said(slide, model) for slide in slides))


def said(slide: TemplateSlide, model: str) -> str:
    undefined = np.isnan(slide.curves[model]).mean()
    peaks = slide.find_peaks(model)
    if undefined == 1:
        return "undefined: 0 / 0"
    if not peaks.size:
        return "0 everywhere"
    best = f"best at {peaks[0]:g} m" if peaks.size == 1 else f"best at {peaks[0]:g}-{peaks[-1]:g} m"
    if np.any(np.diff(np.flatnonzero(np.isin(slide.shift, peaks))) > 1):
        best += ", with a gap"
    return best + (", undefined in occupied space" if undefined else "")


def column_title(preset: str, reach: float, noise: float) -> str:
    return f"{preset}, {reach:g} m, {f'noise {noise:.0%}' if noise else 'clean'}"


def claims(
    columns: list[tuple[str, float, float]], resolution: float, seeds: int
) -> Iterator[tuple[str, ...]]:
    """For each claim, the share of poses at which it holds, of every preset, range and noise."""
    shares = []
    for preset, reach, noise in columns:
        found = [
            compute_claim_shares(
                draw_place_maps(resolution=resolution, boundary_noise=noise, seed=seed),
                PRESETS[preset](range=reach),
            )
            for seed in range(seeds if noise else 1)
        ]
        shares.append({claim: np.mean([each[claim] for each in found]) for claim in found[0]})
    for claim in shares[0]:
        yield (claim, *(f"{share[claim]:.0%}" for share in shares))
    yield ("at 8 m e is nowhere greater than at 6 m", *larger_template(columns, resolution))


def larger_template(columns: list[tuple[str, float, float]], resolution: float) -> Iterator[str]:
    """For each column of 6 m, the share of poses over the map where e is no greater at 8 m."""
    for preset, reach, noise in columns:
        if reach == RANGES[1]:
            yield "–"
            continue
        maps = draw_place_maps(resolution=resolution, boundary_noise=noise)
        shares = [
            compute_share_smaller_with_range(grid, PRESETS[preset](), RANGES[1])
            for grid in maps.values()
        ]
        yield f"{min(shares):.0%}"


def table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    lines = ["<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>"]
    lines += [
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    ]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def slides_figure(slides: Sequence[TemplateSlide]) -> Figure:
    """Draw slides of `locplan.paper.compare_models_along_strips` side by side (Figs. 4-11).

    Each is a template and a map above the curves of the seven models.
    """
    figure = NotebookFigure(figsize=(5 * len(slides), 6.4), layout="constrained")
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


def ellipses_figure(
    fields: Mapping[str, CovarianceField], *, spacing: float = 2.0, magnify: float = 1.0
) -> Figure:
    """Draw error ellipses of several fields side by side, at sampled poses (Figs. 29 and 31)."""
    figure, grid_of_axes = _side_by_side(fields)
    for axes, (title, field) in zip(grid_of_axes, fields.items(), strict=True):
        draw_ellipses(axes, field, spacing=spacing, magnify=magnify)
        axes.set_title(title, fontsize="medium")
    factor = "" if magnify == 1 else f", {magnify:g} times as large"
    handles = [
        Line2D([], [], color=BLUE, label=f"position, one std. deviation{factor}"),
        Line2D([], [], color="black", label="first eigenvector"),
        Line2D([], [], color=TURN, linewidth=6, alpha=0.6, label="heading ± one std. deviation"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def draw_ellipses(
    axes: Axes, field: CovarianceField, *, spacing: float = 2.0, magnify: float = 1.0
) -> None:
    """Draw the map with error ellipses, first eigenvectors and heading wedges at sampled poses."""
    draw_map(axes, field.grid)
    xy, covariance = sample_covariances(field, spacing)
    if not len(xy):
        return
    major, minor, direction = position_axes(covariance)
    wedge = 0.4 * spacing
    reach = np.maximum(magnify * major, wedge)[:, None]
    corners = np.transpose([axes.get_xlim(), axes.get_ylim()])
    every = np.concatenate([corners, xy - reach, xy + reach])
    axes.set(**dict(zip(("xlim", "ylim"), np.transpose([every.min(0), every.max(0)]), strict=True)))
    along = (magnify * major)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    where: dict[str, Any] = {"units": "xy", "offsets": xy, "offset_transform": axes.transData}
    style: dict[str, Any] = {
        "facecolors": "none",
        "edgecolors": BLUE,
        "linewidths": 1.4,
    }
    width, height, angle = 2 * magnify * major, 2 * magnify * minor, np.degrees(direction)
    ellipses = EllipseCollection(width, height, angle, zorder=4, **where, **style)
    if covariance.shape[-1] == 3:
        half = np.degrees(scalar(covariance, "heading_std"))
        wedges = [Wedge(at, wedge, -turn, turn) for at, turn in zip(xy, half, strict=True)]
        axes.add_collection(PatchCollection(wedges, color=TURN, alpha=0.6, linewidth=0.8))
    axes.add_collection(ellipses)
    lines = np.stack([xy - along, xy + along], axis=1)
    axes.add_collection(LineCollection(list(lines), colors="black", linewidths=0.8, zorder=3))


def e_figure(fields: Mapping[str, CovarianceField]) -> Figure:
    """Maps of e on one linear scale, 0 in unknown and occupied cells (Figs. 30 and 32).

    The colours end at the 98 % quantile of the free cells' e.
    """
    maps = [field.e_map() for field in fields.values()]
    known = np.concatenate([values[np.isfinite(values)] for values in maps])
    norm = Normalize(0.0, float(np.quantile(known, 0.98)) if known.size else 1.0)
    figure, grid_of_axes = _side_by_side(fields)
    for axes, (title, field), e in zip(grid_of_axes, fields.items(), maps, strict=True):
        draw_map(axes, field.grid)  # sets the axes; the values cover the map
        shown = downsample(np.nan_to_num(e), maximum=True)
        image = draw_cells(axes, field.grid, shown, cmap=FIELD_COLOURS, norm=norm)
        cells = downsample(field.grid.cells)  # half black over e = 0 shows walls
        walls = np.where(cells == OCCUPIED, 150, 0).astype(np.uint8)
        black = np.zeros((*walls.shape, 3), np.uint8)
        draw_cells(axes, field.grid, np.dstack([black, walls]))
        axes.set_title(title, fontsize="medium")
    figure.colorbar(image, ax=grid_of_axes, label="e [m² rad]", extend="max", shrink=0.8)
    return figure


def _side_by_side(fields: Mapping[str, CovarianceField]) -> tuple[Figure, list[Axes]]:
    """Figure and Axes for maps of one size, one above the other where that shows them larger."""
    width, height = compute_figure_size(next(iter(fields.values())).grid)
    shape = (len(fields), 1) if 1.4 * width > height else (1, len(fields))
    figure = NotebookFigure(figsize=(width * shape[1], height * shape[0]), layout="constrained")
    return figure, figure.subplots(*shape, squeeze=False).ravel().tolist()


def models_figure(offsets: Floats, curves: Mapping[str, Floats], axis: str, title: str) -> Figure:
    """Draw the seven models along one axis of the search window at a place."""
    figure = NotebookFigure(figsize=(7, 4.6), layout="constrained")
    axes = figure.subplots()
    turned = axis == "theta"
    draw_models(axes, np.degrees(offsets) if turned else offsets, curves)
    axes.set_xlabel("turn θ of the template [°]" if turned else f"shift {axis} of the template [m]")
    axes.set_ylabel("share of each model's own greatest value")
    axes.set_title(title, fontsize="medium")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)
    return figure


def draw_models(axes: Axes, offsets: Floats, curves: Mapping[str, Floats]) -> None:
    """Draw the seven models over offsets, each divided by its own greatest magnitude."""
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
    """Draw mismatch over the window's planes, as surfaces and as heat maps (Figs. 18-28)."""
    planes = [("x", "y"), ("x", "θ"), ("y", "θ")][: 3 if window.dimension == 3 else 1]
    axes = dict.fromkeys("xy", (window.offsets, window.half_steps))
    axes["θ"] = np.degrees(window.angles), window.half_rotations
    figure = NotebookFigure(figsize=(4.2 * len(planes) + 0.8, 6.4 * len(distributions)))
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


def _draw_strip(axes: Axes, slide: TemplateSlide) -> None:
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


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>The paper's experiments</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; }}
img {{ max-width: 100%; }}
figure {{ margin: 2rem 0; }}
div {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-size: 14px; }}
th, td {{ border: 1px solid #ccc; padding: 0.3rem 0.6rem; text-align: left; }}
</style>
</head>
<body>
<h1>The paper's experiments on our maps</h1>
<p>“Localizability estimation using correlation on occupancy grid maps”, ROBOMECH Journal 10
(2023), <a href="https://doi.org/10.1186/s40648-023-00256-w">doi 10.1186/s40648-023-00256-w</a>.
Maps: “places” (A complex room, B corridor, C round room, D repeating corridor) and “hall”
(E open hall).</p>
<h2>Seven models in one dimension</h2>
<div>{models}</div>
<h2>Claims, and the share of poses at which they hold</h2>
<p>Nine poses within 0.4 m of each place; with noise, five maps each.</p>
<div>{claims}</div>
<h2>Figures</h2>
{figures}
</body>
</html>
"""


if __name__ == "__main__":
    if {"-h", "--help"} & {*sys.argv}:
        print(__doc__)
    elif len(sys.argv) > 3:
        draw_place(*sys.argv[1:4])
    else:
        main(*sys.argv[1:2], *map(float, sys.argv[2:3]))

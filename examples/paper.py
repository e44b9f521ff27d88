"""The paper's experiments on our maps: every figure and claim, with an index page.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.

Run: python examples/paper.py [FOLDER [RESOLUTION]]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import locplan
from locplan import paper, plotting
from locplan.field import Sad

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
    maps = paper.maps_of_places(resolution=resolution)
    sections = []
    for name, caption, figure in figures(maps, presets):
        plotting.save_figure(figure, target / name, dpi=100)
        print(f"wrote {target / name}")
        sections.append(
            f'<figure><img src="{name}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
        )
    page = PAGE.format(
        figures="\n".join(sections),
        models=table(("model", *(slide.title for slide in paper.one_dimensional())), models()),
        claims=table(
            ("claim", *(column_title(*column) for column in columns)),
            claims(columns, resolution, seeds),
        ),
    )
    (target / "index.html").write_text(page, encoding="utf-8")
    print(f"wrote {target / 'index.html'}")


def figures(
    maps: dict[str, locplan.OccupancyGrid], presets: tuple[str, ...]
) -> Iterator[tuple[str, str, Figure]]:
    """File name, caption and figure of each experiment."""
    yield (
        "figs_04-11_models.png",
        "Figs. 4-11: the seven models in one dimension. Templates of 6 m x 6 m slide by 9 m.",
        paper.slides_figure(paper.one_dimensional()),
    )
    window = Sad().lattice(maps["places"].resolution)
    for place in paper.PLACES:
        mismatch = paper.mismatch_at(maps, place, Sad())
        yield (
            f"figs_18-28_{place}.png",
            f"Figs. 18-28: correlation at {place} over x-y, x-θ and y-θ; 0 is a perfect match.",
            paper.distribution_figure({title_of(place): mismatch}, window),
        )
    for preset in presets:
        for name, grid in maps.items():
            fields = {
                f"{name}, preset {preset}, range {reach:g} m": locplan.load_or_compute(
                    grid, PRESETS[preset](range=reach)
                )
                for reach in RANGES
            }
            yield (
                f"figs_29_31_ellipses_{name}_{preset}.png",
                f"Figs. 29 and 31: error ellipses in {name}, preset {preset}.",
                labelled(plotting.ellipses_figure(fields), name),
            )
            yield (
                f"figs_30_32_e_{name}_{preset}.png",
                f"Figs. 30 and 32: e in {name}, preset {preset}; 0 in unknown and occupied cells.",
                labelled(plotting.e_figure(fields), name),
            )


def title_of(place: str) -> str:
    x, y = locplan.maps.environments.landmarks(paper.PLACES[place])[place]
    return f"{place}, at {x:g}, {y:g} m of {paper.PLACES[place]}, range 6 m"


def labelled(figure: Figure, name: str) -> Figure:
    """The letters of the paper's places on each map."""
    for axes in figure.axes:
        for place, where in paper.PLACES.items():
            if where == name and axes.get_xlabel() == "x [m]":
                axes.annotate(
                    place,
                    locplan.maps.environments.landmarks(name)[place],
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
    slides = paper.one_dimensional()
    for model in slides[0].curves:
        yield (model, *(said(slide, model) for slide in slides))


def said(slide: paper.Slide, model: str) -> str:
    undefined = np.isnan(slide.curves[model]).mean()
    peaks = slide.peaks(model)
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
            paper.shares_of_claims(
                paper.maps_of_places(resolution=resolution, boundary_noise=noise, seed=seed),
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
        maps = paper.maps_of_places(resolution=resolution, boundary_noise=noise)
        shares = [
            paper.share_smaller_with_range(grid, PRESETS[preset](), RANGES[1])
            for grid in maps.values()
        ]
        yield f"{min(shares):.0%}"


def table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    lines = ["<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>"]
    lines += [
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    ]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


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
    main(*sys.argv[1:2], *map(float, sys.argv[2:3]))

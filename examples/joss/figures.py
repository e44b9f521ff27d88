"""Draw the two figures of paper.md.

Run: python examples/joss/figures.py [FOLDER]

paths.png shows both paths through the hall, on the field, with the range of the lidar.
estimators.png shows how well estimators and published measures rank the uncertainty of real lasers.
Without FOLDER, both replace the figures next to paper.md. Takes half a minute.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

import locplan
from locplan._support.drawing import BLUE, VERMILION, draw_field_bar, make_white_outline
from locplan.field.figures import draw_field
from locplan.maps import OCCUPIED
from locplan.planning.figures import draw_path, draw_start_and_goal

HERE = Path(__file__).resolve().parent
ROWS = HERE.parent / "evidence"
MAP = HERE.parent.parent / "maps" / "hall.yaml"
START, GOAL = (32.2, 16.0), (4.3, 15.0)
QUERY = "hall 32.2,16 to 4.3,15"
"""The route in the rows of closed-loop drives."""
SHOWN_HEIGHT = 33.5
"""Height of the drawn part of the hall [m]; the rooms above are left out."""
GREY = "0.35"
DPI = 220


class Measure(NamedTuple):
    """A row of the figure of estimators."""

    name: str
    """Its name in lasers.csv."""
    label: str
    colour: str


MEASURES = (
    Measure("fused", "fused (locplan's default)", BLUE),
    Measure("scan", "scan", BLUE),
    Measure("fisher", "fisher", BLUE),
    Measure("degeneracy factor", "degeneracy factor, Zhang et al.", VERMILION),
    Measure("perturbation loss", "perturbation loss, after LF-3PM", VERMILION),
    Measure("X-ICP", "contributions, after X-ICP", VERMILION),
    Measure("sad", "sad, correlation of map discs", BLUE),
    Measure("clearance", "distance to the nearest wall", GREY),
)


def main(folder: str | None = None, stride: float = 0.2) -> None:
    """Write both figures; the field has a value every `stride` metres."""
    target = HERE if folder is None else Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    figures = {"paths.png": draw_paths(stride), "estimators.png": draw_estimators()}
    for name, figure in figures.items():
        figure.savefig(target / name, dpi=DPI)
        print(f"wrote {target / name}")


def read_rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a file of the evidence."""
    with (ROWS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def draw_paths(stride: float) -> Figure:
    """Draw the shortest and the recommended path through the hall, with their drives."""
    grid, robot = locplan.load_map(MAP), locplan.Robot("turtlebot4")
    choice = locplan.recommend_path(grid, START, GOAL, robot)
    estimator = locplan.Fused(robot.lidar)
    field = locplan.load_or_compute(grid, locplan.FieldConfig(estimator, stride=stride))
    drives = {row["path"]: row for row in read_rows("closed_loop") if row["query"] == QUERY}

    figure = Figure(figsize=(6.4, 4.3), layout="constrained")
    axes = figure.subplots()
    image = draw_field(axes, field, "position_std")
    draw_field_bar(figure, image, axes, "standard deviation of the position [cm]", shrink=0.8)
    shortest, recommended = choice.shortest.path, choice.path
    draw_path(axes, shortest, color="black", linestyle=(0, (4, 1.5)))
    draw_path(axes, recommended, color=BLUE, linewidth=3.2)
    label_path(axes, shortest, "shortest", drives, (0, 11), "black")
    label_path(axes, recommended, "recommended", drives, (0, 13), BLUE)
    draw_range(axes, find_middle(shortest), robot.lidar.range)
    draw_nearest_wall(axes, grid, find_middle(recommended))
    draw_start_and_goal(axes, START, GOAL)
    for (x, y), text, side in ((START, "start", 11), (GOAL, "goal", -11)):
        anchor = "left" if side > 0 else "right"
        write(axes, text, (x, y), (side, 0), "black", ha=anchor, va="center")
    axes.set(ylim=(grid.origin[1], SHOWN_HEIGHT), xlabel="x [m]", ylabel="y [m]")
    return figure


def label_path(
    axes: Axes,
    path: locplan.Path,
    name: str,
    drives: Mapping[str, Mapping[str, str]],
    offset: tuple[float, float],
    colour: str,
) -> None:
    """Write length and arrivals of a path at its middle."""
    row = drives[name]
    arrived = f"{row['arrived']} of {row['closed_loop_drives']} arrive"
    text = f"{name}, {float(row['length']):.0f} m: {arrived}"
    write(axes, text, find_middle(path), offset, colour, ha="center", va="center", weight="bold")


def find_middle(path: locplan.Path) -> np.ndarray:
    """Return the position on a path that is halfway from start to goal along x."""
    return path.xy[np.abs(path.xy[:, 0] - (START[0] + GOAL[0]) / 2).argmin()]


def draw_range(axes: Axes, place: np.ndarray, lidar_range: float) -> None:
    """Draw the range of the lidar around a place that has no wall within it."""
    style = {"fill": False, "edgecolor": "black", "linewidth": 1.4, "linestyle": (0, (1, 1.2))}
    axes.add_patch(Circle(place, lidar_range, path_effects=make_white_outline(3), **style))
    draw_place(axes, place, "black")
    above = place[0], place[1] + lidar_range
    text = f"no wall within the lidar's {lidar_range:g} m"
    write(axes, text, above, (0, 8), "black", ha="center", va="center")


def draw_nearest_wall(axes: Axes, grid: locplan.OccupancyGrid, place: np.ndarray) -> None:
    """Draw the distance from a place to the wall below it."""
    row, column = grid.cell(place)
    walls = np.flatnonzero(grid.cells[:row, column] == OCCUPIED)
    _, wall = grid.grid_to_world(walls[-1] + 1, column)
    arrow = {"arrowstyle": "<->", "color": BLUE, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "", (place[0], wall), place, arrowprops=arrow | {"path_effects": make_white_outline(4)}
    )
    draw_place(axes, place, BLUE)
    text = f"{place[1] - wall:.0f} m to a wall"
    write(axes, text, (place[0], (place[1] + wall) / 2), (8, 0), BLUE, ha="left", va="center")


def draw_place(axes: Axes, place: np.ndarray, colour: str) -> None:
    """Draw a place on a path as a dot."""
    axes.plot(*place, "o", color=colour, markeredgecolor="white", markersize=7, zorder=5)


def write(
    axes: Axes,
    text: str,
    place: Sequence[float],
    offset: tuple[float, float],
    colour: str,
    ha: str,
    va: str,
    weight: str = "normal",
) -> None:
    """Write a text with a white outline, at an offset [points] from a place."""
    axes.annotate(
        text,
        place,
        offset,
        textcoords="offset points",
        color=colour,
        fontsize=9,
        fontweight=weight,
        horizontalalignment=ha,
        verticalalignment=va,
        path_effects=make_white_outline(3),
        zorder=6,
    )


def draw_estimators() -> Figure:
    """Draw the rank correlations with real lasers, and their intervals."""
    ranks = select_pooled_ranks(read_rows("lasers"))
    ranks_apart = select_pooled_ranks(read_rows("lasers_other"))
    figure = Figure(figsize=(6.4, 3.1), layout="constrained")
    axes = figure.subplots()
    for height, measure in enumerate(reversed(MEASURES)):
        row = ranks[measure.name]
        value, low, high = (float(row[column]) for column in ("value", "low", "high"))
        axes.plot((low, high), (height, height), color=measure.colour, linewidth=2)
        axes.plot(value, height, "o", color=measure.colour, markersize=7)
        place = (1.03, height)
        axes.text(*place, f"{value:.2f} [{low:.2f}, {high:.2f}]", fontsize=8.5, va="center")
        if measure.name in ranks_apart:
            apart = float(ranks_apart[measure.name]["value"])
            axes.plot(apart, height - 0.32, "D", **make_diamond(measure.colour))
    axes.set_yticks(range(len(MEASURES)), [measure.label for measure in reversed(MEASURES)])
    axes.set(
        xlim=(-0.25, 1.0),
        xticks=np.arange(-0.2, 1.01, 0.2),
        xlabel="rank correlation with the uncertainty of real lasers",
    )
    axes.axvline(0.0, color="0.7", linewidth=0.8, zorder=0)
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    handles = [
        Line2D([], [], color=BLUE, linewidth=6, label="locplan"),
        Line2D([], [], color=VERMILION, linewidth=6, label="published measures"),
        Line2D([], [], color="black", marker="o", markersize=7, linewidth=2, label="six logs"),
        Line2D([], [], marker="D", label="seven logs kept apart", **make_diamond("black")),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False, fontsize=8.5)
    return figure


def make_diamond(colour: str) -> dict[str, Any]:
    """Return the style of the values on logs that were kept apart."""
    return {"color": colour, "markerfacecolor": "white", "markersize": 5.5, "linewidth": 0}


def select_pooled_ranks(rows: Sequence[dict[str, str]]) -> dict[str, dict[str, str]]:
    """Return the rank correlation of each estimator, all logs together."""
    return {
        row["estimator"]: row
        for row in rows
        if row["quantity"] == "rank" and row["log"] == "pooled" and row["n"]
    }


if __name__ == "__main__":
    main(*sys.argv[1:2])

"""Figures of a comparison: the costs, and the paths of the query with the largest difference."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from locplan._support import drawing as styles
from locplan._support.checks import make_printable
from locplan._support.drawing import NotebookFigure, label_with_plain_numbers
from locplan._support.kernels.arrays import Floats
from locplan.comparison.statistics import (
    PlannerRun,
    RunSetting,
    compute_median_costs,
    group_records,
    query_key_from_run,
)
from locplan.field.figures import draw_field
from locplan.maps.figures import draw_map
from locplan.planning.figures import draw_path, draw_start_and_goal
from locplan.planning.path import Path
from locplan.planning.queries import Query

if TYPE_CHECKING:
    from locplan.comparison.result import Comparison, MapCase, PlannerStanding

COLOURS = ("#1b1f24", "#0072b2", "#008a64", "#b8548f", "#c05000", "#2f93d1", "#a07800", "#6a51a3")
"""Colours of planners after Okabe and Ito."""
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.6, 1.4, 1.6)), (0, (2, 1)))
VERDICT_COLOURS = {"cheaper": styles.BLUE, "costlier": styles.VERMILION, "": "0.45"}
MAX_ROWS = 40
"""Maximum number of rows in the figure of costs; if there are more, the maps are pooled."""


def cost_figure(comparison: Comparison) -> Figure:
    """Draw the ratio of each planner's J to the baseline's with its interval, a row per setting.

    Parameters
    ----------
    comparison : Comparison
        The comparison.
    """
    rows = _select_compared_standings(comparison.standings())
    if len(rows) > MAX_ROWS:
        rows = _select_compared_standings(comparison.standings(pooled=True))[:MAX_ROWS]
    figure = NotebookFigure(figsize=(7, 1.0 + 0.34 * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    axes.axvline(1, color="0.2", linewidth=1.4)
    low, high = _compute_cost_range(rows)
    for place, row in enumerate(rows):
        _draw_cost(axes, place, row, low, high)
    axes.set_yticks(range(len(rows)), _format_row_names(rows), parse_math=False)
    baseline = make_printable(comparison.baseline)
    axes.set(
        xlim=(low, high),
        ylim=(max(len(rows), 1) - 0.5, -0.5),
        xlabel=f"J / J of {baseline}: cheaper to the left, costlier to the right",
    )
    axes.grid(axis="x", color="0.88")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


def _select_compared_standings(rows: list[PlannerStanding]) -> list[PlannerStanding]:
    """Return the rows of other planners that share a solved query with the baseline."""
    return [row for row in rows if row.summary.planner != row.cost.baseline and row.cost.pairs]


def _compute_cost_range(rows: list[PlannerStanding]) -> tuple[float, float]:
    """Return limits around 1 that show most rows, even if one planner is very bad."""
    ends = np.array([row.cost.estimate for row in rows]).reshape(-1, 3)
    ends = np.where(np.isfinite(ends), ends, ends[:, :1])
    reach = 1.5 * np.median(np.abs(ends - 1).max(axis=1)) if rows else 0.0
    reach = max(float(reach), 0.02)  # below 2 % rounding would fill the figure
    low, high = (float(f(ends, initial=1.0)) for f in (np.min, np.max))
    return max(low, 1 - reach) - 0.1 * reach, min(high, 1 + reach) + 0.1 * reach


def _draw_cost(axes: Axes, place: int, row: PlannerStanding, low: float, high: float) -> None:
    """Draw a ratio with its interval; an arrow stands for a ratio beyond the figure."""
    value, *ends = row.cost.estimate
    colour = VERDICT_COLOURS[row.verdict]
    if all(map(math.isfinite, ends)):
        axes.plot(ends, [place, place], color=colour, linewidth=3, solid_capstyle="butt")
    if value > high or value < low:
        edge, marker = (high, ">") if value > high else (low, "<")
        axes.plot([edge], [place], marker, color=colour, markersize=9, clip_on=False)
    else:
        axes.plot([value], [place], "o", color=colour, markersize=8)
    text = f"{value:.3f}"
    axes.text(1.02, place, text, transform=axes.get_yaxis_transform(), va="center", color=colour)


def _format_row_names(rows: list[PlannerStanding]) -> list[str]:
    """Return the planner of each row, and those parts of its setting that differ."""
    parts = [
        [row.setting.map or "all maps", row.setting.config, f"weight {row.setting.weight:g}"]
        for row in rows
    ]
    columns = [len(set(column)) > 1 for column in zip(*parts, strict=True)]
    return [
        make_printable(", ".join([row.summary.planner, *np.array(names)[columns].tolist()]))
        for row, names in zip(rows, parts, strict=True)
    ]


class QueryScene(NamedTuple):
    """A query at one weight, with a path of each planner."""

    case: MapCase
    query: Query
    runs: dict[str, PlannerRun]
    """The run of median J of each planner that has a path."""
    weight: float

    @property
    def title(self) -> str:
        """The names of query, map and field, and the weight."""
        return f"{self.query.name} on {self.case.map}, {self.case.config}, weight {self.weight:g}"


def find_most_telling_scene(comparison: Comparison) -> QueryScene | None:
    """Return the query with the largest median difference of J from the baseline.

    The result is None if the baseline has no path on a known map.
    """
    queries = group_records(
        compute_median_costs(comparison.runs).items(), lambda median_cost: median_cost[0][0]
    )
    gaps: dict[tuple[RunSetting, str], float] = {}
    for (setting, name), median_costs_of_query in queries.items():
        costs = {planner: cost for (_, planner), cost in median_costs_of_query}
        reference = costs.pop(comparison.baseline, 0.0)
        if reference and (setting.map, setting.config) in comparison.cases:
            gap = [abs(cost / reference - 1) for cost in costs.values()] or [0.0]
            gaps[setting, name] = float(np.median(gap))
    if not gaps:
        return None
    setting, name = max(gaps, key=lambda key: (round(gaps[key], 9), key[0].weight))
    case = comparison.cases[str(setting.map), setting.config]
    query = next(query for query in case.queries if query.name == name)
    return QueryScene(case, query, _select_median_runs(comparison, setting, name), setting.weight)


def _select_median_runs(
    comparison: Comparison, setting: RunSetting, query: str
) -> dict[str, PlannerRun]:
    runs = [
        run for run in comparison.runs if query_key_from_run(run) == (setting, query) and run.xy
    ]
    groups = group_records(runs, lambda run: run.task.planner)
    ordered = {
        name: sorted(group, key=lambda run: run.measures["cost"]) for name, group in groups.items()
    }
    return {name: group[(len(group) - 1) // 2] for name, group in ordered.items()}


def scene_figure(scene: QueryScene) -> Figure:
    """Draw the paths of a query over the field, or over the map if there is no field.

    Parameters
    ----------
    scene : QueryScene
        The query with its paths.
    """
    figure = NotebookFigure(figsize=(7, 5), layout="constrained")
    axes = figure.subplots()
    _, field = scene.case.costmap()
    if field is None:
        draw_map(axes, scene.case.grid)
    else:
        image = draw_field(axes, field)
        label = f"{field.quantity().axis} (darker: scans localize less well)"
        bar = figure.colorbar(image, ax=axes, label=label, location="bottom", aspect=40, pad=0.04)
        label_with_plain_numbers(bar.ax.xaxis, 6)
    axes.set(xlabel="", ylabel="")
    paths = {name: Path(np.array(run.xy)) for name, run in scene.runs.items()}
    handles = []
    # Each line is thinner than the previous one, so that no path is hidden.
    widths = np.linspace(4.4, 1.6, max(len(paths), 2)).tolist()
    for n, ((name, path), width) in enumerate(zip(paths.items(), widths, strict=False)):
        color, dashes = COLOURS[n % len(COLOURS)], DASHES[n % len(DASHES)]
        effects = styles.make_white_outline(width + 1.4)
        draw_path(axes, path, linewidth=width, path_effects=effects, color=color, linestyle=dashes)
        text = make_printable(f"{name}, J {scene.runs[name].measures['cost']:.1f} m")
        handles.append(Line2D([], [], linewidth=2.2, label=text, color=color, linestyle=dashes))
    draw_start_and_goal(axes, scene.query.start, scene.query.goal)
    _crop_to_paths(axes, np.concatenate([path.xy for path in paths.values()]))
    spans = np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim())
    lines = math.ceil(len(handles) / 2)
    figure.set_figheight(min(6.8 * spans, 6.0) + 0.9 + 0.25 * lines)
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False)
    return figure


def _crop_to_paths(axes: Axes, xy: Floats) -> None:
    """Limit the axes to the surroundings of the paths."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = 0.15 * max(float((high - low).max()), 5.0)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    axes.set(
        xlim=(max(left, low[0] - margin), min(right, high[0] + margin)),
        ylim=(max(bottom, low[1] - margin), min(top, high[1] + margin)),
    )

"""Figures of what is advised: a choice among paths, and tuned settings of AMCL."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from locplan import plotting
from locplan._kernels.arrays import Floats
from locplan.costs import Path
from locplan.simulation._drives import LOST
from locplan.simulation._figures import MAP_MARKS, draw_places, place_handles
from locplan.simulation.choice._choice import Choice
from locplan.simulation.choice._driven import Candidate

if TYPE_CHECKING:
    from locplan.simulation.tuning._results import Tuning

WIDTH = 8.6
"""Minimum width of the figure [inch]."""
COLOURS, WIDTHS = ("0.72", "black", "#0072b2"), (1.0, 2.0, 3.6)
"""Styles of the other candidates, of the shortest path, and of the recommended one."""


def choice_figure(choice: Choice) -> Figure:
    """Draw the candidates over the map, the recommended path strongest, and the errors along it.

    Where nothing was driven, the degeneracy u along the paths is drawn instead. A choice that was
    loaded has no map to draw.

    Parameters
    ----------
    choice : Choice
        The choice; without a path only its ends are shown.
    """
    ends = Path(np.array([choice.start[:2], choice.goal[:2]]))
    paths = [*(each.path for each in choice.candidates), ends]
    width, height, part = WIDTH, 4.0, None
    if choice.costs is not None:
        part = plotting.map_around(choice.costs.grid, [*paths, *_marked(choice)])
        width, height = plotting.map_size(part)
        width = max(width, WIDTH)
    # Height of what is drawn along the paths [inch].
    below = 2.4 if choice.candidates else 0.0
    figure = plotting.Picture(figsize=(width, height + below + 0.8), layout="constrained")
    axes = figure.subplots(
        2 if below else 1, squeeze=False, height_ratios=[height, below][: 1 + bool(below)]
    )
    upper = axes[0, 0]
    if choice.costs is not None and part is not None:
        plotting.draw_map(upper, part)
        plotting.draw_inset(upper, choice.costs.grid, part, paths)
        if choice.judgement is None:
            plotting.draw_degeneracy(figure, upper, choice.costs, part)
    else:
        upper.set_aspect("equal")
    # The recommended path is drawn last.
    for each in sorted(choice.candidates, key=lambda each: _rank(choice, each)):
        rank = _rank(choice, each)
        draw_places(upper, each.arrivals, COLOURS[rank])
        plotting.draw_path(upper, each.path, color=COLOURS[rank], linewidth=WIDTHS[rank])
    plotting.draw_ends(upper, choice.start, choice.goal)
    if choice.candidates:
        (_draw_errors if choice.judgement else _draw_degeneracy)(axes[1, 0], choice)
    marks = place_handles(each.arrivals for each in choice.candidates)
    figure.key([*_handles(choice), *marks, *plotting.end_handles()], ncols=3)
    name = choice.map["name"] or "map"
    figure.title(f"{name}: {choice.answer[0]}", *choice.answer[1:], choice.driven)
    return figure


def _marked(choice: Choice) -> list[Path]:
    """The places that are marked, as one path, if there are any."""
    every = [each.arrivals.places().rows for each in choice.candidates if each.arrivals]
    places = [row[2:4] for rows in every for row in rows]
    return [Path(np.array(places))] if places else []


def _rank(choice: Choice, each: Candidate) -> int:
    """2 of the recommended path, 1 of the shortest, 0 of the others."""
    return 2 if each is choice.chosen else int(each is choice.shortest)


def _handles(choice: Choice) -> list[Line2D]:
    shown = dict.fromkeys(each for each in (choice.chosen, choice.shortest) if each is not None)
    handles = []
    for each in shown:
        rank = _rank(choice, each)
        name = f"{each.name} path" if each is choice.shortest else each.name
        recommended = "recommended" if choice.judgement else "untested"
        role = f"{recommended}: " if each is choice.chosen else ""
        label = f"{role}{name}, {_figures(each)}"
        line = Line2D([], [], color=COLOURS[rank], linewidth=WIDTHS[rank], label=label)
        handles.append(line)
    others = len(choice.candidates) - len(handles)
    if others > 0:
        label = f"{others} other candidate{'s' if others > 1 else ''}"
        handles.append(Line2D([], [], color=COLOURS[0], linewidth=WIDTHS[0], label=label))
    return handles


def _figures(each: Candidate) -> str:
    """Length, error and lost drives of a candidate."""
    if each.driven is None:
        return f"{each.path.length:.1f} m, {each.metrics.integrated_u:.1f} m degenerate"
    rates = {
        "lost": each.driven.lost_rate.value,
        "off at the end": each.driven.off_at_end_rate.value,
    }
    texts = [f"{100 * rate:.0f} % {name}" for name, rate in rates.items() if rate >= 0]
    return ", ".join([f"{each.path.length:.1f} m", *texts])


def _draw_errors(axes: Axes, choice: Choice) -> None:
    """Draw the median error along the shortest and the recommended path, and the middle 80 %."""
    for each in dict.fromkeys((choice.shortest, choice.chosen)):
        if each is None or each.driven is None:
            continue
        distance, median, low, high = each.driven.profile.T
        rank = _rank(choice, each)
        colour = COLOURS[rank]
        axes.fill_between(distance, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(distance, median, color=colour, linewidth=0.8 * WIDTHS[rank])
    axes.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(plotting.style.MIN_ERROR / 2, axes.get_ylim()[0]))
    plotting.label_plainly(axes.yaxis, 4)
    axes.set(xlabel="distance along the path [m]", ylabel="position error [m]")
    axes.margins(x=0.01)
    axes.set_title("open-loop drives: median, and where 80 % of them are", fontsize="small")


def _draw_degeneracy(axes: Axes, choice: Choice) -> None:
    """The degeneracy along each path of which it is known."""
    costs: Any = choice.costs
    paths = [
        (each.path, {"color": COLOURS[_rank(choice, each)]})
        for each in (choice.candidates if costs else ())
        if np.isfinite(each.metrics.integrated_u)
    ]
    plotting.draw_u_along(axes, costs, paths)


def tuning_figure(tuning: Tuning) -> Figure:
    """Errors of the user's settings and of the presets, and drives off at the end, case by case.

    Parameters
    ----------
    tuning : Tuning
        The result of `tune` or `locplan.recordings.tune_on_drive`.
    """
    figure = plotting.Picture(figsize=(9.6, 4.2), layout="constrained")
    errors, off_at_end = figure.subplots(1, 2)
    results = tuning.choice.results
    cases = [*dict.fromkeys(result.case for result in results)]
    for place, name in enumerate(dict.fromkeys(result.settings for result in results)):
        mark = MAP_MARKS[place]
        of_settings = [result for result in results if result.settings == name]
        at = np.array([cases.index(result.case) for result in of_settings]) + 0.15 * (place - 1)
        error = np.array([result.error for result in of_settings])
        share = np.array([result.off_at_end for result in of_settings])
        _draw_intervals(errors, at, error, mark, name)
        _draw_intervals(off_at_end, at, 100 * share, mark, name)
    for axes in (errors, off_at_end):
        axes.set_xticks(range(len(cases)), [textwrap.fill(name, 10) for name in cases])
        axes.tick_params(axis="x", labelsize="small")
        axes.grid(axis="y", color="0.92")
        axes.margins(x=0.1)
    errors.set_title("error, 95 %", fontsize="medium")
    off_at_end.set_title("share of the drives, 95 %", fontsize="medium")
    plotting.make_logarithmic(errors.yaxis)
    errors.set_ylabel("RMSE of the position [m]")
    off_at_end.set_ylabel(f"drives off by > {LOST:g} m at the end [%]")
    off_at_end.set_ylim(bottom=-0.04 * off_at_end.get_ylim()[1])
    figure.key(errors.get_legend_handles_labels()[0], ncols=3)
    figure.title(f"{tuning.conclusion}. {tuning.where}, {tuning.robot.known_lidar.title}")
    return figure


def _draw_intervals(
    axes: Axes, at: NDArray[Any], intervals: Floats, mark: tuple[str, str], label: str
) -> None:
    """Values with their intervals, rows of (value, low, high), as marks of one colour."""
    value, low, high = intervals.T
    colour, marker = mark
    bars = np.maximum([np.nan_to_num(value - low), np.nan_to_num(high - value)], 0)
    axes.errorbar(at, value, bars, fmt="none", ecolor=colour, elinewidth=1.5)
    axes.plot(at, value, marker, color=colour, label=label)

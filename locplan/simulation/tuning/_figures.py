"""Figure of tuned settings of AMCL."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from locplan.plotting import Picture, make_logarithmic
from locplan.simulation._figures import LETTERS, MAP_MARKS
from locplan.simulation.tuning._results import Tuning
from locplan.simulation.tuning._space import changed_axes


def tuning_figure(tuning: Tuning) -> Figure:
    """Errors of the settings that were judged at each level, and what each change gains.

    Parameters
    ----------
    tuning : Tuning
        What `tune`, or `locplan.recordings.tune_on_drive`, returned.
    """
    gains = sorted(tuning.contributions.items(), key=lambda each: each[1])
    below = 1.1 + 0.28 * len(gains) if gains else 0.0
    figure = Picture(figsize=(8.6, 4.6 + below), layout="constrained")
    rows: Any = [["errors", "lost"], *([["changes"] * 2] if gains else [])]
    heights = [3.4, below][: len(rows)]
    panels: Any = figure.subplot_mosaic(rows, height_ratios=heights)
    errors, lost = panels["errors"], panels["lost"]
    _draw_judged(errors, lost, tuning)
    if gains:
        _draw_gains(panels["changes"], tuning, gains)
    handles, labels = errors.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    what = f"stretches of {tuning.drive}" if tuning.drive else "random paths"
    runs = "replays" if tuning.drive else "drives"
    verdict = "" if tuning.changes else f"; nothing is clearly better than {tuning.judged[0].name}"
    title = (
        f"{tuning.grid.name or 'map'}, {tuning.robot.known_lidar.title}: {tuning.paths} {what},"
        f" {tuning.drives} {runs} each, that nothing was chosen on{verdict}"
    )
    title = textwrap.fill(title, int(LETTERS * figure.get_figwidth()), break_on_hyphens=False)
    figure.suptitle(title, fontsize="medium")
    return figure


def _draw_judged(errors: Axes, lost: Axes, tuning: Tuning) -> None:
    """The error and the share of lost drives at each level, beside each other by setting."""
    at = np.arange(len(tuning.levels))
    count = len(tuning.judged)
    for n, (each, (colour, marker)) in enumerate(zip(tuning.judged, itertools.cycle(MAP_MARKS))):
        aside = at + 0.14 * (n - (count - 1) / 2)
        cpu = each.cpu_per_metre / tuning.judged[0].cpu_per_metre
        label = f"{each.name}, CPU x{cpu:.2g}" if n else each.name
        label = textwrap.fill(label, 46, break_on_hyphens=False)
        for axes, intervals, factor in (
            (errors, [level.rmse for level in each.levels], 1.0),
            (lost, [level.lost for level in each.levels], 100.0),
        ):
            value, low, high = factor * np.array(intervals).T
            axes.plot(aside, value, linewidth=0.8, alpha=0.5, color=colour)
            below, above = np.nan_to_num(value - low), np.nan_to_num(high - value)
            bars = np.maximum([below, above], 0)
            axes.errorbar(aside, value, bars, fmt="none", ecolor=colour, elinewidth=1.5)
            axes.plot(aside, value, marker, color=colour, label=label)
    for axes in (errors, lost):
        axes.set_xticks(at, [level.name for level in tuning.levels])
        if not tuning.drive:
            axes.set_xlabel("odometry's errors, relative to those asked")
        axes.grid(axis="y", color="0.92")
        axes.margins(x=0.1)
    parts, runs = ("stretches", "replays") if tuning.drive else ("paths", "drives")
    errors.set_title(f"geometric mean over the {parts}, 95 %", fontsize="medium")
    lost.set_title(f"share of all {runs}, 95 %", fontsize="medium")
    make_logarithmic(errors.yaxis)
    errors.set_ylabel("RMSE of the position [m]")
    lost.set_ylabel(f"lost {runs} [%]")
    lost.set_ylim(bottom=-0.04 * lost.get_ylim()[1])


def _draw_gains(axes: Any, tuning: Tuning, gains: Sequence[tuple[str, float]]) -> None:
    """Draw how much each change gains, the largest on top."""
    kept = {axis.name for axis in changed_axes(tuning.own, tuning.candidate)}
    colours = ["#0072b2" if name in kept else "0.7" for name, _ in gains]
    percent = [100 * (ratio - 1) for _, ratio in gains]
    axes.barh([name for name, _ in gains], percent, color=colours)
    axes.axvline(0, color="0.4", linewidth=0.8)
    axes.set_xlabel("increase of the RMSE without it [%] (grey: put back)")
    where = "" if tuning.drive else ", at its worst level"
    axes.set_title(f"what each change gains{where}", fontsize="medium")

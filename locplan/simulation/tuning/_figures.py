"""Figure of tuned settings of AMCL."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from locplan.plotting._picture import Picture
from locplan.plotting._ticks import make_logarithmic
from locplan.simulation.tuning._results import Tuning
from locplan.simulation.tuning._space import changed_axes

COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00")
MARKERS = ("o", "s", "D", "^", "v")
KEPT, BACK = "#0072b2", "0.7"
WIDTH = 46
"""Number of letters after which a line of a label ends."""


def tuning_figure(tuning: Tuning) -> Figure:
    """Errors of the settings that were judged at each level, and what each change gains."""
    gains = sorted(tuning.contributions.items(), key=lambda each: each[1])
    figure = Picture(figsize=(12, 4.8), layout="constrained")
    panels: Any = figure.subplots(1, 3, width_ratios=(3.4, 3.0, 2.6))
    errors, lost, changes = panels
    at = np.arange(len(tuning.levels))
    count = len(tuning.judged)
    for n, each in enumerate(tuning.judged):
        aside = at + 0.14 * (n - (count - 1) / 2)
        style = {"color": COLOURS[n % len(COLOURS)], "marker": MARKERS[n % len(MARKERS)]}
        cpu = "" if n == 0 else f", CPU x{_cpu(tuning, n):.2g}"
        label = _broken(f"{each.name}{cpu}")
        for axes, intervals, factor in (
            (errors, [level.rmse for level in each.levels], 1.0),
            (lost, [level.lost for level in each.levels], 100.0),
        ):
            value, low, high = factor * np.array(intervals).T
            axes.plot(aside, value, linewidth=0.8, alpha=0.5, color=style["color"])
            below, above = np.nan_to_num(value - low), np.nan_to_num(high - value)
            bars = np.maximum([below, above], 0)
            axes.errorbar(aside, value, bars, fmt="none", ecolor=style["color"], elinewidth=1.5)
            axes.plot(aside, value, linestyle="none", label=label, **style)
    for axes in (errors, lost):
        axes.set_xticks(at, [level.name for level in tuning.levels])
        if not tuning.drive:
            axes.set_xlabel("odometry's errors, relative to those asked for")
        axes.grid(axis="y", color="0.92")
    make_logarithmic(errors.yaxis)
    errors.set_ylabel("RMSE of the position [m]")
    lost.set_ylabel(f"lost {'replays' if tuning.drive else 'drives'} [%]")
    lost.set_ylim(bottom=-0.04 * lost.get_ylim()[1])
    kept = {axis.name for axis in changed_axes(tuning.own, tuning.candidate)}
    ratios = [ratio for _, ratio in gains]
    colours = [KEPT if name in kept else BACK for name, _ in gains]
    changes.barh([name for name, _ in gains], [100 * (v - 1) for v in ratios], color=colours)
    changes.axvline(0, color="0.4", linewidth=0.8)
    changes.set_xlabel("increase of the RMSE without it [%]\n(grey: put back)")
    where = "" if tuning.drive else ", at its worst level"
    changes.set_title(f"what each change gains{where}", fontsize="medium")
    if not gains:
        changes.set_axis_off()
    handles, labels = errors.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    what = f"stretches of {tuning.drive}" if tuning.drive else "random paths"
    runs = "replays" if tuning.drive else "drives"
    parts = "stretches" if tuning.drive else "paths"
    errors.set_title(f"geometric mean over the {parts}, 95 %", fontsize="medium")
    lost.set_title(f"share of all {runs}, 95 %", fontsize="medium")
    verdict = "" if tuning.changes else f"; nothing is clearly better than {tuning.judged[0].name}"
    figure.suptitle(
        f"{tuning.grid.name or 'map'}, {tuning.lidar.title}: {tuning.paths} {what},"
        f" {tuning.drives} {runs} each, that nothing was chosen on{verdict}",
        fontsize="medium",
    )
    return figure


def _cpu(tuning: Tuning, n: int) -> float:
    """CPU time a metre, relative to that of the user's settings."""
    return tuning.judged[n].cpu_per_metre / tuning.judged[0].cpu_per_metre


def _broken(text: str) -> str:
    """Text on lines of about `WIDTH` letters."""
    lines = [""]
    for part in text.split(", "):
        if lines[-1] and len(lines[-1]) + len(part) > WIDTH:
            lines.append("")
        lines[-1] += f"{', ' if lines[-1] else ''}{part}"
    return ",\n".join(lines)

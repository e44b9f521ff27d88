"""Figures of simulated drives."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from locplan import plotting
from locplan._kernels.arrays import Floats
from locplan._util.intervals import Interval, in_metres
from locplan.robots import Robot
from locplan.simulation._arrivals import ENDS, LEAVES, STOPS, Arrivals, faults_of
from locplan.simulation._drives import LOST, contrasts, rates_of

if TYPE_CHECKING:
    from locplan.simulation._routes import Routes
    from locplan.simulation._simulate import Simulation

POOLED = "#0072b2"
MAP_MARKS = (*zip(plotting.style.COLOURS, "o^sDvP", strict=True),)
"""Colour and marker of each map; where there are more maps, all of them look alike."""


def simulation_figure(simulation: Simulation) -> Figure:
    """Paths over the map, coloured by the mean error there, and the error along each of them.

    Parameters
    ----------
    simulation : Simulation
        Drives along at most four paths; with more, colours repeat.
    """
    grid = simulation.grid
    shown = list(simulation.paths.values())
    part = plotting.zoomed_to(grid, shown)
    width, height = plotting.map_size(part)
    figure = plotting.Picture(figsize=(width, height + 2.8), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.6))
    plotting.draw_map(upper, part)
    plotting.draw_inset(upper, grid, part, shown)
    profiles = {name: each.profile() for name, each in simulation.drives.items()}
    every = np.concatenate([profile[:, 4] for profile in profiles.values()])
    norm = plotting.along_norm(every, of_errors=True)
    ratios, handles = contrasts(simulation.drives), []
    for (name, profile), style in zip(profiles.items(), itertools.cycle(plotting.PATH_STYLES)):
        distance, xy, mean = profile[:, 0], profile[:, 1:3], profile[:, 4]
        colour, drives = style["color"], simulation.drives[name]
        plotting.draw_path(
            upper, simulation.paths[name], color=colour, linewidth=7, path_effects=[]
        )
        coloured = plotting.draw_along(upper, xy, mean[:-1], norm=norm)
        lower.fill_between(distance, profile[:, 6], profile[:, 7], color=colour, alpha=0.15, lw=0)
        lower.plot(distance, mean, linewidth=1.8, **style)
        text = (
            f"{name}: {distance[-1]:.1f} m, median error {in_metres(drives.median_error.value)},"
            f" {rates_of(drives)}, RMSE {in_metres(drives.rmse.value)}"
        )
        if 0 < drives.lost_rate.value < 1:
            text += f" ({in_metres(drives.kept_rmse.value)} of those never lost)"
        if name in ratios:
            first = next(iter(profiles))
            text += f"; error of a typical drive {_formatted(ratios[name])} times {first}'s"
        if simulation.arrivals:
            found = simulation.arrivals[name]
            draw_places(upper, found, colour)
            text += f"; steered by the filter, {found.words} arrive{faults_of(found)}"
        label = "\n".join(plotting.lines_within(text, width - 1))
        handles.append(Line2D([], [], linewidth=2, label=label, **style))
        plotting.draw_ends(upper, xy[0], xy[-1])
    plotting.draw_along_bar(figure, coloured, upper)
    lower.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
    lower.set(xlabel="distance along the path [m]", ylabel="position error [m]")
    plotting.make_logarithmic(lower.yaxis)
    lower.margins(x=0.01)
    marks = place_handles((simulation.arrivals or {}).values())
    figure.key([*handles, *marks, *plotting.end_handles()])
    count = len(next(iter(simulation.drives.values())).errors)
    upper.set_title(
        f"{grid.name or 'map'}: {count} simulated drives of each path,"
        f" {simulation.robot.known_lidar.title}\n"
        "below: mean error of the position, and where 80 % of the drives are",
        fontsize="medium",
    )
    return figure


MARKS = {ENDS: "x", STOPS: "s", LEAVES: "."}
"""Marks of where closed-loop drives go wrong."""
FAINT: dict[str, Any] = {"markersize": 4, "markeredgewidth": 0.8, "alpha": 0.6}
"""Style of the mark of which there are many, near each other."""


def draw_places(axes: Axes, arrivals: Arrivals | None, colour: Any) -> None:
    """Mark where robots stop, end without having arrived, and leave the path.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    arrivals : Arrivals or None
        Closed-loop drives along one path, if there are any.
    colour : color
        The path's colour.
    """
    rows = arrivals.places().rows if arrivals else ()
    for what, mark in MARKS.items():
        if xy := [row[2:4] for row in rows if row[1] == what]:
            # Below start and goal, which stay to be seen.
            style: dict[str, Any] = {"markersize": 6, "markeredgewidth": 1.5, "zorder": 3.5}
            style |= {"mfc": "none", **(FAINT if what == LEAVES else {})}
            axes.plot(*np.array(xy).T, mark, color=colour, **style)


def place_handles(arrivals: Iterable[Arrivals | None]) -> list[Line2D]:
    """Entries of a legend for the marks that there are.

    Parameters
    ----------
    arrivals : iterable of Arrivals, or of None
        Closed-loop drives along some paths.
    """
    shown = {row[1] for each in arrivals if each for row in each.places().rows}
    style: dict[str, Any] = {"linestyle": "", "color": "0.3", "mfc": "none"}
    kinds = [(what, mark) for what, mark in MARKS.items() if what in shown]
    return [Line2D([], [], marker=mark, label=f"a robot {what}", **style) for what, mark in kinds]


def queries_figure(routes: Routes) -> Figure:
    """RMSE and share of lost drives of both paths of each query, and the mean ratios.

    Parameters
    ----------
    routes : Routes
        Drives along both paths of some queries, as `simulate_queries` returns them.
    """
    rmse, lost = routes.pairs("rmse"), routes.pairs("lost")
    figure = plotting.Picture(figsize=(8.5 if lost.any() else 6.6, 4.9), layout="constrained")
    left, *others = figure.subplots(1, 2 if lost.any() else 1, squeeze=False)[0]
    ends = _equal_ends(left, rmse)
    left.plot(ends, ends, color="0.6", linewidth=0.8, zorder=0)
    left.plot(*rmse.T, "o", color=POOLED, alpha=0.7)
    left.set(xlabel="RMSE along the shortest path [m]", ylabel="RMSE along the aware path [m]")
    for right in others:
        right.plot((0, 1), (0, 1), color="0.6", linewidth=0.8, zorder=0)
        right.plot(*lost.T, "o", color=POOLED, alpha=0.7)
        right.set(
            xlim=(-0.03, 1.03),
            ylim=(-0.03, 1.03),
            aspect="equal",
            xlabel="lost (off by > 1 m) on the shortest path, share of drives",
            ylabel="the same on the aware path",
        )
    for number, at in enumerate(_beside(np.log(rmse)), 1):
        style = {"ha": "center", "va": "center", "fontsize": "small"}
        left.annotate(str(number), rmse[number - 1], at, textcoords="offset points", **style)
    robot: Any = routes.about.get("robot")
    lidar = f", {Robot.from_summary(robot).known_lidar.title}" if robot else ""
    figure.title(
        f"{routes.grid.name or 'map'}{lidar}, {len(routes.routes)} queries: {routes.verdict}",
        f"aware over shortest: RMSE {_formatted(routes.rmse_ratio)},"
        f" length {_formatted(routes.length_ratio)}",
        *([] if lost.any() else ["no drive was off by more than 1 m on either path"]),
    )
    return figure


def _equal_ends(axes: Any, values: Floats) -> Floats:
    """Make both axes logarithmic and alike, a bit wider than the values; return their ends."""
    ends = np.array([values.min() * 0.8, values.max() * 1.25])
    for axis in (axes.xaxis, axes.yaxis):
        plotting.make_logarithmic(axis)
    axes.set(xlim=tuple(ends), ylim=tuple(ends), aspect="equal")
    return ends


def _beside(points: Floats) -> list[tuple[float, float]]:
    """Where the number of each point stands from it, away from the others [points]."""
    sides = 6.0 * np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    size = extent / 200.0  # the points of a panel take nearly as many typographic points
    taken, chosen = points, []
    for n, point in enumerate(points):
        others = np.delete(taken, n, axis=0)[:, None]
        apart = np.hypot(*(point + sides * size - others).transpose(2, 0, 1))
        best = int(apart.min(axis=0, initial=np.inf).argmax())
        taken = np.vstack([taken, point + sides[best] * size])
        chosen.append((float(sides[best, 0]), float(sides[best, 1])))
    return chosen


def _formatted(interval: Interval) -> str:
    value, low, high = interval
    return f"{value:.3g}" + ("" if np.isnan(low) else f" [{low:.3g}, {high:.3g}]")

"""The pictures of a report, with their captions, legends, and what filters them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from locplan._util.checks import printable
from locplan.comparison import _figures as figures
from locplan.comparison._figures import THEME, Drawing, Legend, Limits, Mark, filtered, svg_of
from locplan.comparison._result import Case, Comparison
from locplan.comparison._statistics import (
    MEASURES,
    Array,
    Convergence,
    Run,
    Setting,
    convergence,
    grouped,
    median_costs,
    setting_of,
)
from locplan.costs import Path as Route
from locplan.field import CovarianceField
from locplan.planners import ParetoFront, Query, pareto_front
from locplan.plotting import draw_ends, draw_field, draw_path, label_plainly, style as styles

Points = Mapping[str, Array]
HOLLOW: Mapping[str, Any] = {"markerfacecolor": "none", "linestyle": "none"}


class Scene(NamedTuple):
    """What is drawn of a case: its field, the query that is large, and perhaps that one's front."""

    field: CovarianceField
    query: Query
    front: ParetoFront | None


@dataclass(frozen=True, eq=False)
class Pictures:
    """The pictures of a comparison."""

    limits: ClassVar[Limits] = Limits()
    comparison: Comparison
    left_out: Counter[str] = field(default_factory=Counter)
    """Numbers of pictures beyond the limits."""

    @property
    def runs(self) -> Sequence[Run]:
        """All runs."""
        return self.comparison.runs

    @property
    def baseline(self) -> str:
        """The label of the planner that the others are compared with."""
        return self.comparison.baseline

    @cached_property
    def marks(self) -> dict[str, Mark]:
        """The planners' lines with their markers."""
        return figures.marks_of(self.runs)

    @cached_property
    def lines(self) -> dict[str, Mark]:
        """The planners' lines alone."""
        return {planner: mark._replace(marker="") for planner, mark in self.marks.items()}

    @cached_property
    def cases(self) -> dict[figures.CaseKey, list[Run]]:
        """The runs of each map and settings."""
        return grouped(self.runs, lambda run: (run.task.map, run.task.config))

    @cached_property
    def scenes(self) -> dict[figures.CaseKey, Scene]:
        """The scenes to draw; a case without one has no pictures of paths and no front."""
        scenes, limits = {}, self.limits
        for n, case in enumerate([*self.comparison.cases.values()][: limits.scenes]):
            costs, made = case.costmap()
            if made is not None:
                query, front = self._revealing(case), None
                if n < limits.fronts:
                    ends = query.start[:2], query.goal[:2]
                    front = pareto_front(costs, *ends, time_limit=limits.front_time)
                scenes[case.key] = Scene(made, query, front or None)
        return scenes

    def _revealing(self, case: Case) -> Query:
        """The query of a case in which the baseline's degenerate metres differ most."""
        found: dict[str, list[float]] = {}
        for run in self.cases[case.key]:
            if run.task.planner == self.baseline and run.measures:
                found.setdefault(run.task.query, []).append(run.measures["integrated_u"])
        spans = {name: np.ptp(values) for name, values in found.items()}
        return max(case.queries, key=lambda query: spans.get(query.name, -1.0))

    def trade_offs(self) -> Iterator[Drawing]:
        """Length against degenerate metres with the exact front, and J of every query."""
        for key, runs in self.cases.items():
            scene = self.scenes.get(key)
            if scene is not None and scene.front is not None:
                yield self._front(key, scene.query.name, scene.front)
            for setting, own in sorted(grouped(runs, setting_of).items()):
                yield from self._query_costs(own, setting)

    def _front(self, key: figures.CaseKey, name: str, front: ParetoFront) -> Drawing:
        """Length against degenerate metres of the runs of one query, and its exact front.

        A line joins the medians of each planner's weights. Dotted are the lines of the baseline's
        J, one for each weight.
        """
        found = [run for run in self.cases[key] if run.task.query == name and run.measures]
        groups, names = grouped(found, lambda run: run.task.planner), ("length", "integrated_u")
        points = {
            planner: np.array([[r.task.weight, *map(r.measure, names)] for r in groups[planner]])
            for planner in self.marks
            if planner in groups
        }
        worst = [own[:, 1:].max(axis=0) for own in points.values()]
        usual = np.median(worst, axis=0) if worst else np.zeros(2)
        # Runs are shown up to a little beyond the front and most planners.
        edge = 1.3 * np.maximum((front.length.max(), front.integral.max()), usual)
        weights = sorted({run.task.weight for run in found})
        sizes = dict(zip(weights, np.linspace(4, 9, len(weights)).tolist(), strict=True))
        what = MEASURES["integrated_u"].title
        ends = [f"{front.length[n]:.1f} m and {front.integral[n]:.3g} m" for n in (0, -1)]
        caption = f"{figures.title_of(key)}, query {name}"
        alt = f"Length against {what} on {caption}. The front goes from {' to '.join(ends)}."
        if outside := sum(int((own[:, 1:] > edge).any(axis=1).sum()) for own in points.values()):
            caption += f"; {figures.counted(outside, 'run')} too far out to show"
        exact = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%}"
        legend: Legend = [(self.marks[planner], planner) for planner in points]
        legend.append(
            (Mark("muted"), f"front of the grid, {exact}, {figures.counted(len(front), 'path')}")
        )
        if self.baseline in points:
            legend.append((Mark("muted", 2), f"J of {self.baseline}"))
        legend += [
            (Mark("muted", -1, "o", size), f"weight {each:g}") for each, size in sizes.items()
        ]
        svg = svg_of(lambda axes: self._draw_front(axes, front, points, edge, sizes), 2.5, alt)
        return Drawing(svg, legend, caption, figures.attributes(key))

    def _draw_front(
        self, axes: Any, front: ParetoFront, points: Points, edge: Array, sizes: dict[float, float]
    ) -> None:
        alone, muted = "." if len(front) == 1 else "", THEME["muted"]
        axes.step(front.length, front.integral, "-", marker=alone, where="post", color=muted)
        dotted: dict[str, Any] = {"color": muted, "linewidth": 0.9, "linestyle": (0, (1, 2))}
        for weight, middle in figures.medians_of(
            points.get(self.baseline, np.empty((0, 3)))
        ).items():
            if weight:
                axes.axline(tuple(middle), slope=-1 / weight, **dotted)
            else:
                axes.axvline(middle[0], **dotted)
        for planner, own in points.items():
            mark, part = self.marks[planner], filtered(planner)
            near = own[(own[:, 1:] <= edge).all(1)]
            if len(near):
                ways = np.transpose([*figures.medians_of(near).values()])
                axes.plot(*ways, **mark.line, linewidth=1.0, gid=part)
            about: dict[str, Any] = {"color": THEME[mark.colour], "gid": part, **HOLLOW}
            for weight, size in sizes.items():
                group = near[near[:, 0] == weight, 1:].T
                axes.plot(*group, mark.marker, markersize=size, markeredgewidth=1.2, **about)
        axes.set(xlabel="length [m]", ylabel=f"{MEASURES['integrated_u'].title} [m]")
        axes.margins(0.06)
        axes.grid()

    def _query_costs(self, runs: Sequence[Run], setting: Setting) -> Iterator[Drawing]:
        """J of every query of a setting; nothing where the baseline has no path.

        A row for each query has a marker for each planner; an arrow stands for J beyond the edge.
        """
        every = list(dict.fromkeys(run.task.query for run in runs))
        compared = [query for query in every if self._cost(setting, query, self.baseline) > 0]
        if not compared:
            return
        shown = compared[: self.limits.queries]
        costs = [self._cost(setting, query, self.baseline) for query in shown]
        ratios = {
            planner: np.array([self._cost(setting, query, planner) for query in shown]) / costs
            for planner in self.marks
        }
        ratios = {planner: each for planner, each in ratios.items() if np.isfinite(each).any()}
        words = "; ".join(f"{name} {np.nanmedian(each):.3f}" for name, each in ratios.items())
        name = figures.title_of(setting)
        alt = (
            f"J of every query as a multiple of that of {self.baseline}, {name}. Medians: {words}."
        )
        legend: Legend = [(Mark("muted"), f"{self.baseline}, the baseline, with its J")]
        legend += [(self.marks[each], each) for each in ratios if each != self.baseline]
        caption = f"J of every query, {name}"
        if len(shown) < len(compared):
            caption += (
                f"; the first {len(shown)} of {figures.counted(len(compared), 'query', 'queries')}"
            )
        if len(compared) < len(every):
            lost = figures.counted(len(every) - len(compared), "query", "queries")
            caption += f"; {lost} without a path of {self.baseline} left out"
        labels = [f"{query}, {cost:.1f} m" for query, cost in zip(shown, costs, strict=True)]
        draw = partial(self._draw_query_costs, ratios=ratios, labels=labels)
        svg = svg_of(draw, 0.75 + 0.19 * len(shown), alt)
        yield Drawing(svg, legend, caption, figures.attributes(setting))

    def _draw_query_costs(self, axes: Any, ratios: Points, labels: Sequence[str]) -> None:
        values, rows = np.array(list(ratios.values())), np.arange(len(labels))
        excess = np.median([np.nanmax(own) - 1 for own in values])
        # Up to half more than the usual excess is to scale; 2 % at least, lest rounding fill it.
        top = min(1 + 1.5 * max(float(excess), 0.02), max(float(np.nanmax(values)), 1.02))
        bottom = min(1.0, float(np.nanmin(values)))
        margin = 0.05 * (top - bottom)
        axes.axvline(1, color=THEME["muted"], linewidth=1.4)
        shifts = np.linspace(-0.25, 0.25, len(ratios)) if len(ratios) > 1 else [0.0]
        for (planner, own), shift in zip(ratios.items(), shifts, strict=True):
            if (own == 1).all():  # the baseline is the line
                continue
            mark, near, far = self.marks[planner], own <= top, own > top
            about: dict[str, Any] = {"color": THEME[mark.colour], "gid": filtered(planner)}
            about |= {"linestyle": "none", "markersize": 5}
            axes.plot(own[near], (rows + shift)[near], mark.marker, **{**about, **HOLLOW})
            axes.plot(np.full(far.sum(), top), rows[far] + shift, ">", **about)
        # The end of a label tells queries apart, as far as there is room for it.
        texts = [printable(label) for label in labels]
        short = [text if len(text) <= 24 else f"…{text[-24:]}" for text in texts]
        axes.set_yticks(rows, short, parse_math=False)
        axes.set(xlim=(bottom - margin, top + margin), ylim=(len(labels) - 0.5, -0.5))
        axes.set_xlabel("J / baseline's J")
        axes.grid()

    @cached_property
    def _costs(self) -> dict[tuple[Any, str], float]:
        return median_costs(self.runs)

    def _cost(self, setting: Setting, query: str, planner: str) -> float:
        """The median over seeds of J [m]; NaN without a path."""
        return self._costs.get(((setting, query), planner), math.nan)

    def progress(self) -> Iterator[Drawing]:
        """Best J over time of the anytime planners: medians and interquartile bands."""
        for runs in self.cases.values():
            # Without a query that the baseline has solved there is no ratio to draw.
            curves = [each for each in convergence(runs, self.baseline) if each.queries]
            for setting, group in sorted(grouped(curves, lambda each: each.setting).items()):
                yield self._progress(setting, group)

    def _progress(self, setting: Setting, curves: Sequence[Convergence]) -> Drawing:
        top = max(map(figures.shown_until, curves))
        bottom = min(1.0, *(float(curve.lower.min()) for curve in curves))
        margin = 0.06 * (top - bottom)

        def draw(axes: Any) -> None:
            axes.axhline(1, color=THEME["muted"], linewidth=1.4)
            for curve in curves:
                quartiles = np.array([curve.lower, curve.median, curve.upper])
                low, middle, high = np.minimum(quartiles, 10 * top)
                line, part = self.marks[curve.planner].line, filtered(curve.planner)
                band = {"alpha": 0.2, "linewidth": 0, "color": line["color"], "gid": part}
                axes.fill_between(curve.times, low, high, step="post", **band)
                axes.step(curve.times, middle, where="post", linewidth=1.8, gid=part, **line)
            axes.set(xscale="log", ylim=(bottom - margin, top + margin))
            axes.set(xlabel="time since the search began [s]", ylabel="best J / baseline's J")
            label_plainly(axes.xaxis, 6)
            axes.grid()

        name, courses = figures.title_of(setting), []
        for curve in curves:
            end = float(curve.median[-1])
            text = f"ends at {end:.3f}" if end < math.inf else "has no path in half of the queries"
            courses.append(f"{curve.planner} {text}")
        alt = f"Best J over time as a multiple of that of {self.baseline}, {name}: "
        legend: Legend = [(Mark("muted"), f"{self.baseline}, the baseline")]
        legend += [(self.lines[curve.planner], curve.planner) for curve in curves]
        svg = svg_of(draw, 2.3, f"{alt}{'; '.join(courses)}.")
        return Drawing(svg, legend, name, figures.attributes(setting))

    def paths(self) -> Iterator[Drawing]:
        """The paths of one query of each scene over its field, at the greatest weight."""
        for key, scene in self.scenes.items():
            asked = [run for run in self.cases[key] if run.task.query == scene.query.name]
            weight = max(run.task.weight for run in asked)
            yield self._paths(scene, [run for run in asked if run.task.weight == weight])

    def _paths(self, scene: Scene, runs: Sequence[Run]) -> Drawing:
        query, setting, found = scene.query, setting_of(runs[0]), self._typical(runs)
        drawn = {name: run for name, run in found.items() if run is not None}

        def draw(axes: Any) -> None:
            image = draw_field(axes, scene.field)
            axes.set(xlabel="", ylabel="")
            axes.spines[["top", "right"]].set_visible(True)
            # Ever thinner, so that none hides another.
            widths = np.linspace(4.2, 1.5, len(drawn)).tolist() if len(drawn) != 1 else [2.2]
            for (name, run), width in zip(drawn.items(), widths, strict=True):
                look = {"linewidth": width, "path_effects": styles.outline(width + 1.2)}
                look |= {"gid": filtered(name), **self.marks[name].line}
                draw_path(axes, Route(np.array(run.xy)), **look)
            draw_ends(axes, query.start, query.goal)
            figure = axes.figure
            label = f"{scene.field.quantity().axis}, x and y [m]"
            place: dict[str, Any] = {"location": "bottom", "aspect": 40, "pad": 0.04}
            bar = figure.colorbar(image, ax=axes, label=label, **place)
            label_plainly(bar.ax.xaxis, 6)
            bar.outline.set_linewidth(0.5)
            spans = np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim())
            wide = figure.get_figwidth()
            figure.set_figheight(min((wide - 0.35) * spans + 0.85, 5.0))

        caption = f"{figures.title_of(setting[:2])}, query {query.name}, weight {setting[2]:g}"
        lengths = {name: f"{name}, {run.measures['length']:.1f} m" for name, run in drawn.items()}
        alt = f"Paths over the field of {caption}: {'; '.join(lengths.values()) or 'none'}."
        legend: Legend = [(self.lines[name], text) for name, text in lengths.items()]
        legend += [(None, f"{name}: no path") for name in found if name not in drawn]
        legend += [(Mark("ink", -1, "o"), "start"), (Mark("ink", -1, "*", 10.0), "goal")]
        about = figures.attributes(setting) | {"class": "map"}
        return Drawing(svg_of(draw, 5.0, alt), legend, caption, about)

    def _typical(self, runs: Sequence[Run]) -> dict[str, Run | None]:
        """The run of median J of each planner; None for one that has no path."""
        groups, found = grouped(runs, lambda run: run.task.planner), {}
        for planner in filter(groups.get, self.marks):
            own = (run for run in groups[planner] if run.xy)
            solved = sorted(own, key=lambda run: run.measures["cost"])
            found[planner] = solved[(len(solved) - 1) // 2] if solved else None
        return found

"""The pictures of a report, with their captions, legends, and what filters them."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from markupsafe import Markup

from locplan.comparison._figures import (
    MARKERS,
    Look,
    looks_of,
    marker_sizes,
    paths_picture,
    progress_picture,
    query_costs_picture,
    trade_off_picture,
)
from locplan.comparison._result import Case, Comparison
from locplan.comparison._statistics import (
    MEASURES,
    Convergence,
    Run,
    Setting,
    convergence,
    grouped,
    median_costs,
    query_of,
    setting_of,
)
from locplan.costs import Path as Route
from locplan.field import CovarianceField
from locplan.planners import ParetoFront, Query, pareto_front


class Mark(NamedTuple):
    """A line in a colour of the page, or none if `dash` is -1, with a marker of a size [pt]."""

    colour: str
    dash: int = 0
    marker: str = ""
    size: float = 6.0

    @classmethod
    def of(cls, look: Look, marked: bool = False) -> Mark:
        """A planner's line, with its marker if it is `marked`."""
        return cls(f"p{look.colour}", look.dash, MARKERS[look.marker] if marked else "")


CaseKey = tuple[str, str]
Attributes = dict[str, str]
Legend = list[tuple[Mark | None, str]]
"""Marks with their texts; a dash stands for no mark."""


class Limits(NamedTuple):
    """How much a report shows."""

    scenes: int = 24
    """Number of cases that are drawn."""
    fronts: int = 8
    """Number of those with the front of a query."""
    front_time: float = 20.0
    """Time limit of the exact front of a query [s]."""
    queries: int = 60
    """Number of queries in a picture of J of every query."""
    thumbnails: int = 400
    """Number of small pictures."""
    runs: int = 2000
    """Number of runs in the table."""
    failures: int = 200
    """Number of kinds of failures in the table."""


class Drawing(NamedTuple):
    """A picture with its caption, its legend, and the attributes by which it is filtered."""

    svg: Markup
    legend: Legend
    caption: str
    attributes: Attributes


@dataclass(frozen=True, eq=False)
class Scene:
    """A case with its field, the query that is drawn large, and perhaps its Pareto front."""

    case: Case
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
    def looks(self) -> dict[str, Look]:
        """The planners' looks, in the order of the runs, which decides their colours."""
        return looks_of(list(dict.fromkeys(run.task.planner for run in self.runs)))

    @cached_property
    def marks(self) -> dict[str, Mark]:
        """The planners' lines."""
        return {planner: Mark.of(look) for planner, look in self.looks.items()}

    @cached_property
    def cases(self) -> dict[CaseKey, list[Run]]:
        """The runs of each map and settings."""
        return grouped(self.runs, lambda run: (run.task.map, run.task.config))

    @cached_property
    def scenes(self) -> dict[CaseKey, Scene]:
        """The scenes to draw; a case without one has no pictures of paths and no front."""
        scenes = {}
        cases = itertools.islice(self.comparison.cases.items(), self.limits.scenes)
        for n, (key, case) in enumerate(cases):
            costs, made = case.costmap()
            if made is not None:
                query = self._revealing(case)
                ends = query.start[:2], query.goal[:2]
                front = None
                if n < self.limits.fronts:
                    front = pareto_front(costs, *ends, time_limit=self.limits.front_time)
                scenes[key] = Scene(case, made, query, front if front and len(front) else None)
        return scenes

    def _revealing(self, case: Case) -> Query:
        """The query of a case in which the baseline's degenerate metres differ most."""
        every = (run for run in self.cases[case.key] if run.task.planner == self.baseline)
        own = (run for run in every if run.measures)
        spans = {
            name: np.ptp([run.measures["integrated_u"] for run in runs])
            for name, runs in grouped(own, lambda run: run.task.query).items()
        }
        return max(case.queries, key=lambda query: spans.get(query.name, -1.0))

    def trade_offs(self) -> Iterator[Drawing]:
        """Length against degenerate metres with the exact front, and J of every query."""
        for key, runs in self.cases.items():
            scene = self.scenes.get(key)
            if scene is not None and scene.front is not None:
                yield self._front(scene, scene.front)
            for setting, own in sorted(grouped(runs, setting_of).items()):
                yield from self._query_costs(own, setting)

    def _front(self, scene: Scene, front: ParetoFront) -> Drawing:
        case, name = scene.case, scene.query.name
        runs = [r for r in self.cases[case.key] if r.task.query == name and r.measures]
        unit = f"{scene.field.e_unit} m" if front.objective == "e" else "m"
        ends = [f"{front.length[n]:.1f} m and {front.integral[n]:.3g} {unit}" for n in (0, -1)]
        caption = f"{title_of(case.key)}, query {name}"
        what = MEASURES[f"integrated_{front.objective}"].title
        alt = f"Length against {what} on {caption}. The front goes from {' to '.join(ends)}."
        svg, outside = trade_off_picture(
            front, scene.field.e_unit, runs, self.looks, self.baseline, alt
        )
        if outside:
            caption += f"; {counted(outside, 'run')} too far out to show"
        used = {run.task.planner for run in runs}
        legend: Legend = [
            (Mark.of(look, marked=True), name) for name, look in self.looks.items() if name in used
        ]
        exact = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%}"
        legend.append((Mark("muted"), f"front of the grid, {exact}, {counted(len(front), 'path')}"))
        if front.objective == "u" and self.baseline in used:
            legend.append((Mark("muted", 2), f"J of {self.baseline}"))
        sizes = marker_sizes(sorted({run.task.weight for run in runs}))
        legend += [
            (Mark("muted", -1, MARKERS[0], size), f"weight {weight:g}")
            for weight, size in sizes.items()
        ]
        return Drawing(Markup(svg), legend, caption, attributes(case.key))

    def _query_costs(self, runs: Sequence[Run], setting: Setting) -> Iterator[Drawing]:
        """J of every query of a setting; nothing where the baseline has no path."""
        every = list(dict.fromkeys(run.task.query for run in runs))
        compared = [query for query in every if self._cost(setting, query, self.baseline) > 0]
        if not compared:
            return
        shown = compared[: self.limits.queries]
        own = [self._cost(setting, query, self.baseline) for query in shown]
        ratios = {
            planner: np.array([self._cost(setting, query, planner) for query in shown]) / own
            for planner in self.looks
        }
        ratios = {planner: each for planner, each in ratios.items() if np.isfinite(each).any()}
        words = "; ".join(f"{name} {np.nanmedian(each):.3f}" for name, each in ratios.items())
        name = title_of(setting)
        alt = (
            f"J of every query as a multiple of that of {self.baseline}, {name}. Medians: {words}."
        )
        labels = [f"{query}, {cost:.1f} m" for query, cost in zip(shown, own, strict=True)]
        legend: Legend = [(Mark("muted"), f"{self.baseline}, the baseline, with its J")]
        legend += [
            (Mark.of(self.looks[planner], marked=True), planner)
            for planner in ratios
            if planner != self.baseline
        ]
        caption = f"J of every query, {name}"
        if len(shown) < len(compared):
            caption += f"; the first {len(shown)} of {counted(len(compared), 'query', 'queries')}"
        if len(compared) < len(every):
            lost = counted(len(every) - len(compared), "query", "queries")
            caption += f"; {lost} without a path of {self.baseline} left out"
        svg = query_costs_picture(ratios, labels, self.looks, alt)
        yield Drawing(Markup(svg), legend, caption, attributes(setting))

    @cached_property
    def _costs(self) -> dict[tuple[Any, str], float]:
        return median_costs(self.runs)

    def _cost(self, setting: Setting, query: str, planner: str) -> float:
        """The median over seeds of J [m]; NaN without a path."""
        return self._costs.get(((setting, query), planner), math.nan)

    def ratio(self, run: Run) -> float:
        """J of a run as a multiple of the baseline's for the same query; NaN if unknown."""
        reference = self._costs.get((query_of(run), self.baseline), math.nan)
        return run.measure("cost") / (reference or math.nan)

    def progress(self) -> Iterator[Drawing]:
        """Best J over time of the anytime planners."""
        for runs in self.cases.values():
            # Without a query that the baseline has solved there is no ratio to draw.
            curves = [each for each in convergence(runs, self.baseline) if each.queries]
            for setting, group in sorted(grouped(curves, lambda each: each.setting).items()):
                own = {curve.planner: curve for curve in group}
                name = title_of(setting)
                courses = "; ".join(f"{each} {_course(curve)}" for each, curve in own.items())
                alt = (
                    f"Best J over time as a multiple of that of {self.baseline}, {name}: {courses}."
                )
                legend: Legend = [(Mark("muted"), f"{self.baseline}, the baseline")]
                legend += [(self.marks[planner], planner) for planner in own]
                svg = progress_picture(own, self.looks, alt)
                yield Drawing(Markup(svg), legend, name, attributes(setting))

    def paths(self) -> Iterator[Drawing]:
        """The paths of one query of each scene, at the greatest weight."""
        for key, scene in self.scenes.items():
            query = scene.query
            asked = [run for run in self.cases[key] if run.task.query == query.name]
            weight = max(run.task.weight for run in asked)
            found = self._typical([run for run in asked if run.task.weight == weight])
            drawn = {name: run for name, run in found.items() if run is not None}
            caption = f"{title_of(key)}, query {query.name}, weight {weight:g}"
            lengths = {
                name: f"{name}, {run.measures['length']:.1f} m" for name, run in drawn.items()
            }
            alt = f"Paths over the field of {caption}: {'; '.join(lengths.values()) or 'none'}."
            routes = {name: Route(np.array(run.xy)) for name, run in drawn.items()}
            svg = paths_picture(scene.field, query, routes, self.looks, alt)
            legend: Legend = [(self.marks[name], text) for name, text in lengths.items()]
            legend += [(None, f"{name}: no path") for name in found if name not in drawn]
            legend += [(Mark("ink", -1, "o"), "start"), (Mark("ink", -1, "*"), "goal")]
            about = attributes((*key, weight)) | {"class": "map"}
            yield Drawing(Markup(svg), legend, caption, about)

    def _typical(self, runs: Sequence[Run]) -> dict[str, Run | None]:
        """The run of median J of each planner; None for one that has no path."""
        found: dict[str, Run | None] = {}
        for planner, own in grouped(runs, lambda run: run.task.planner).items():
            solved = sorted((run for run in own if run.xy), key=lambda run: run.measures["cost"])
            found[planner] = solved[(len(solved) - 1) // 2] if solved else None
        return {planner: found[planner] for planner in self.looks if planner in found}


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, in the plural unless it is 1."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def attributes(setting: Sequence[Any]) -> Attributes:
    """The attributes that filter what belongs to a map and settings, and perhaps to a weight."""
    name, config, *weights = setting
    own = {"data-map": str(name), "data-config": str(config)}
    if weights:
        own["data-weight"] = f"{weights[0]:g}"
    return own


def title_of(setting: Sequence[Any]) -> str:
    """The names of map and settings, and perhaps the weight, in words."""
    name, config, *weight = setting
    return ", ".join([name, config, *(f"weight {each:g}" for each in weight)])


def _course(curve: Convergence) -> str:
    ratio = float(curve.median[-1])
    return f"ends at {ratio:.3f}" if ratio < float("inf") else "has no path in half of the queries"

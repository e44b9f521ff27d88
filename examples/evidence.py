"""Does the field predict where a robot gets lost, and what do paths change? On any maps.

Run: python examples/evidence.py [FOLDER [MAP.yaml ...]]
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import locplan
from locplan._util.intervals import Interval
from locplan.field import SHORT_LIDAR
from locplan.planners import random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation import (
    Drives,
    Evaluation,
    Simulator,
    evaluate,
    poses_along,
)

OWN = Path(__file__).resolve().parent.parent / "maps"
PRODUCT = {"laser_model_type": "likelihood_field_prob"}
CALM = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4"), 0.05)
PLACES_FILTERS = {"Nav2's defaults": Amcl(), "beams multiplied": Amcl(**PRODUCT)}
LONG_LIDAR = dataclasses.replace(SHORT_LIDAR, range=12.0)
ROUTE_FILTERS = {
    "Nav2's defaults, 6 m": (Amcl(), SHORT_LIDAR),
    "the same, no half cell": (Amcl(half_cell=False), SHORT_LIDAR),
    "alphas 0.05, 6 m": (Amcl(**CALM), SHORT_LIDAR),
    "alphas 0.05, beams multiplied, 6 m": (Amcl(**CALM, **PRODUCT), SHORT_LIDAR),
    "alphas 0.05, 12 m": (Amcl(**CALM), LONG_LIDAR),
    "alphas 0.05, beams multiplied, 12 m": (Amcl(**CALM, **PRODUCT), LONG_LIDAR),
}
"""The filters that drive, and their lidars; tuned ones beside Nav2's."""
QUERIES_TRIED, QUERIES_TAKEN = 16, 4
"""Random queries on each map, and the most that are taken of those with real alternatives."""
ALTERNATIVES = 2
"""Least number of ways beside the shortest of a query that counts."""
LEAST_DISTANCE, LONGEST_DISTANCE = 10.0, 80.0
"""Least distance from start to goal, and greatest length of the shortest path [m]."""
DRIVES = 32
"""Drives of each path that judge, in other worlds than those that chose."""
WEIGHTS = (4.0, 8.0, 12.0)
SHORTEST, INFLATED = "shortest", "inflated"
CHOICE, HINDSIGHT = "the simulated choice", "hindsight"


def main(
    folder: str = "evidence", maps: Sequence[str] = (), places: int = 100, drives: int = DRIVES
) -> None:
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    grids = [locplan.load_map(file) for file in maps or sorted(OWN.glob("*.yaml"))]
    driven = [each for grid in grids for each in routes_of(grid, drives)]
    text = [routes_table(driven), sizes_table(driven), maps_table(driven)]
    print("\n\n".join(text), flush=True)
    evaluations = {}
    for name, amcl in PLACES_FILTERS.items():
        evaluations[name] = evaluate(grids, robot=Robot(filter=amcl), places=places)
        evaluations[name].save(target / f"{name}, places")
        print(f"{name}\n{evaluations[name].report()}", flush=True)
    text += [predictors(evaluations), errors(evaluations)]
    (target / "evidence.md").write_text("\n\n".join(text) + "\n", encoding="utf-8")
    print(f"wrote {target / 'evidence.md'}")


# Routes: what an objective's path changes.


@dataclass(frozen=True)
class Driven:
    """The drives of all paths of one query with one filter."""

    grid: locplan.OccupancyGrid
    filter: str
    lengths: Mapping[str, float]
    drives: Mapping[str, Drives]
    candidates: Sequence[str]
    """The names of the paths among which the simulated choice is made, the shortest first."""
    chosen: str
    """The name of the path that it takes."""

    def rmse(self, name: str) -> float:
        """The error of a typical drive [m]."""
        return self.drives[name].typical_rmse.value

    def path_of(self, objective: str) -> str:
        """The path that an objective takes."""
        if objective == HINDSIGHT:
            return min(self.candidates, key=self.rmse)
        if objective == CHOICE:
            return self.chosen
        return objective if objective in self.drives else self.candidates[0]

    def changes(self, objective: str) -> Change:
        """What an objective's path changes against the shortest."""
        name, shortest = self.path_of(objective), self.candidates[0]
        squares = [self.drives[path].mean_squares for path in (name, shortest)]
        apart = 0.5 * np.log(squares[0] / squares[1])
        deviation = apart.std(ddof=1) / np.sqrt(len(apart))
        clear = name != shortest and abs(apart.mean()) > 2.1 * deviation
        return Change(
            float(apart.mean()),
            self.lengths[name] / self.lengths[shortest] - 1,
            float(self.drives[name].lost.mean()),
            better=bool(clear and apart.mean() < np.log(0.9)),
            worse=bool(clear and apart.mean() > -np.log(0.9)),
        )


@dataclass(frozen=True)
class Change:
    """What the path of an objective changes against the shortest, on one query."""

    log_ratio: float
    """The mean logarithm of the ratio of the RMSE of the drives."""
    longer: float
    """The share by which it is longer."""
    lost: float
    """The share of its judged drives that were lost."""
    better: bool
    """Its errors are significantly less, by more than a tenth."""
    worse: bool
    """Its errors are significantly more, by more than a tenth."""


def routes_of(grid: locplan.OccupancyGrid, count: int) -> Iterator[Driven]:
    """Drive all paths of the queries with real alternatives, with each filter."""
    sad = locplan.Costmap.from_field(grid, locplan.load_or_compute(grid, locplan.Sad()))
    try:
        queries = random_queries(sad, QUERIES_TRIED, 1, least_distance=LEAST_DISTANCE)
    except locplan.LocplanError:  # the map is too small
        return
    for lidar in (SHORT_LIDAR, LONG_LIDAR):
        scan = locplan.load_or_compute(grid, locplan.Scan(lidar))
        costs = locplan.Costmap.from_field(grid, scan)
        taken = 0
        for query in queries:
            known = Robot(lidar)
            found = paths_of(locplan.choose(grid, *ends_of(query), known, costs=costs, drives=2))
            long = not found or next(iter(found.values())).length > LONGEST_DISTANCE
            if long or len(found) <= ALTERNATIVES or taken == QUERIES_TAKEN:
                continue
            taken += 1
            others = {
                **{f"`scan`, weight {w:g}": planned(costs, w, ends_of(query)) for w in WEIGHTS},
                "`sad`, weight 4": planned(sad, 4.0, ends_of(query)),
            }
            for name, (amcl, own) in ROUTE_FILTERS.items():
                if own is lidar:
                    yield driven_by(Robot(lidar, filter=amcl), name, costs, query, others, count)


def driven_by(
    robot: Robot,
    name: str,
    costs: locplan.Costmap,
    query: locplan.Query,
    others: Mapping[str, locplan.Path],
    count: int,
) -> Driven:
    """Choose a path with a filter, and drive all candidates and others afresh."""
    choice = locplan.choose(costs.grid, *ends_of(query), robot, costs=costs, rival=None)
    found = paths_of(choice)
    paths = {**found, **others}
    lines = [poses_along(path, costs.grid) for path in paths.values()]
    errors = Simulator(costs.grid, robot).drive_together(lines, count)
    triples = zip(paths, lines, errors, strict=True)
    drives = {path: Drives(line, each) for path, line, each in triples}
    lengths = {path: each.length for path, each in paths.items()}
    return Driven(costs.grid, name, lengths, drives, list(found), choice.chosen.name)


def ends_of(query: locplan.Query) -> tuple:
    return query.start[:2], query.goal[:2]


def paths_of(choice: locplan.Choice) -> dict[str, locplan.Path]:
    return {each.name: each.path for each in choice.candidates}


def planned(costs: locplan.Costmap, weight: float, ends: tuple) -> locplan.Path:
    path = locplan.plan(costs.with_weight(weight), *ends).path
    assert path is not None
    return path


def routes_table(driven: Sequence[Driven]) -> str:
    """What each objective changes against the shortest path, for each filter."""
    objectives = [f"`scan`, weight {w:g}" for w in WEIGHTS]
    rows = []
    for objective in [SHORTEST, INFLATED, "`sad`, weight 4", *objectives, CHOICE, HINDSIGHT]:
        cells = [objective]
        for name in ROUTE_FILTERS:
            own = [each for each in driven if each.filter == name]
            changes = [each.changes(objective) for each in own]
            ratios = ratio(changes, [each.grid.name for each in own])
            longer = 100 * np.mean([each.longer for each in changes])
            better = sum(each.better for each in changes)
            worse = sum(each.worse for each in changes)
            lost = np.mean([each.lost for each in changes])
            cells.append(f"{text_of(ratios)} {better}/{worse}, +{longer:.1f} %, {lost:.0%} lost")
        rows.append(cells)
    counts = {name: sum(each.filter == name for each in driven) for name in ROUTE_FILTERS}
    default, _, *others = ROUTE_FILTERS
    pooled = [each for each in driven if each.filter in (default, *others)]
    gains = [
        sum(each.changes(objective).log_ratio for each in pooled)
        for objective in (CHOICE, HINDSIGHT)
    ]
    share = f"the choice has {gains[0] / gains[1]:.0%} of the hindsight's gain"
    heads = [f"{name} ({counts[name]} queries)" for name in ROUTE_FILTERS]
    return f"{markdown(['objective', *heads], rows)}\n\n{share}"


def sizes_table(driven: Sequence[Driven]) -> str:
    """How large the errors are on the shortest paths, for each filter."""
    rows = []
    for name in ROUTE_FILTERS:
        drives = [each.drives[SHORTEST] for each in driven if each.filter == name]
        values = [(d.median_error.value, d.kept_rmse.value, d.rmse.value) for d in drives]
        median, kept, rmse = np.exp(np.nanmean(np.log(values), axis=0)).tolist()
        lost = np.mean([each.lost.mean() for each in drives])
        rows.append([name, f"{median:.3f}", f"{lost:.0%}", f"{kept:.3f}", f"{rmse:.3f}"])
    return markdown(["filter", "median [m]", "lost", "RMSE of the others", "RMSE of all"], rows)


def maps_table(driven: Sequence[Driven]) -> str:
    """What the simulated choice changes on each map, for each filter."""
    rows = []
    for name in dict.fromkeys(each.grid.name for each in driven):
        own = [each for each in driven if each.grid.name == name]
        cells = [name, str(sum(each.filter == own[0].filter for each in own))]
        for kind in ROUTE_FILTERS:
            here = [each for each in own if each.filter == kind]
            changes = [each.changes(CHOICE) for each in here]
            shortest = [each.drives[each.candidates[0]] for each in here]
            median = np.median([each.median_error.value for each in shortest])
            before = np.mean([each.lost.mean() for each in shortest])
            after = np.mean([each.lost for each in changes])
            factor = np.exp(np.mean([each.log_ratio for each in changes]))
            cells.append(f"{median:.2f} m, {before:.0%} → {after:.0%}, x{factor:.2f}")
        rows.append(cells)
    return markdown(["map", "queries", *ROUTE_FILTERS], rows)


def ratio(changes: Sequence[Change], maps: Sequence[str], resamples: int = 1000) -> Interval:
    """The geometric mean of the RMSE ratios, with its 95 % interval over maps and queries."""
    random = np.random.default_rng(0)
    logs, names = np.array([each.log_ratio for each in changes]), np.array(maps)
    groups = [logs[names == name] for name in dict.fromkeys(maps)]
    means = []
    for _ in range(resamples):
        drawn = [groups[n] for n in random.integers(0, len(groups), len(groups))]
        means.append(np.concatenate([random.choice(g, len(g)) for g in drawn]).mean())
    low, high = np.exp(np.quantile(means, (0.025, 0.975))).tolist()
    return Interval(float(np.exp(logs.mean())), low, high)


# Places: how well the fields rank errors.


def predictors(evaluations: dict[str, Evaluation]) -> str:
    """Each predictor's rank correlation over all places, mean within a map, and AUC."""
    columns = {name: (each, "tracking") for name, each in evaluations.items()}
    columns["single scans"] = next(iter(evaluations.values())), "match"
    rows = []
    for predictor in next(iter(evaluations.values())).predictions[0]:
        cells = [f"{predictor}{' (of heading)' if predictor.of_heading else ''}"]
        for evaluation, kind in columns.values():
            found = evaluation.ranks[predictor, kind]
            cells.append(
                f"{text_of(found.spearman)}, {found.within.value:.2f}, {found.auc.value:.2f}"
            )
        rows.append(cells)
    return markdown(["predictor", *columns], rows)


def errors(evaluations: dict[str, Evaluation]) -> str:
    """For each map how large the errors are, and how well e ranks them there."""
    rows = []
    for number, places in enumerate(next(iter(evaluations.values())).places):
        cells = [places.grid.name]
        for evaluation in evaluations.values():
            alone = evaluation.of_map(number)
            low, median, high = alone.quantiles(0, "tracking_rmse")
            ranks = [alone.ranks[p, "tracking"].spearman.value for p in shown(evaluation)]
            cells += [f"{low:.2f} / {median:.2f} / {high:.2f}", *(f"{r:.2f}" for r in ranks)]
        rows.append(cells)
    heads = [f"{name}: {what}" for name in evaluations for what in ("RMSE [m]", "sad e", "scan e")]
    return markdown(["map", *heads], rows)


def shown(evaluation: Evaluation) -> list:
    return [p for p in evaluation.predictions[0] if str(p) in ("sad, e", "scan, e")]


def text_of(interval: Interval) -> str:
    return f"{interval.value:.2f} [{interval.low:.2f}, {interval.high:.2f}]"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main(*sys.argv[1:2], maps=sys.argv[2:])

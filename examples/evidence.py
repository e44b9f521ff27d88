"""Does the field predict where a robot gets lost, and do its paths prevent it? On any maps.

Run: python examples/evidence.py [FOLDER [MAP.yaml ...]]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import locplan
from locplan._util.intervals import Interval
from locplan.planners import random_queries
from locplan.simulation import (
    Amcl,
    Evaluation,
    Routes,
    _reports as reports,
    evaluate,
    simulate_queries,
)

FILTERS = {
    "Nav2's defaults": Amcl(),
    "beams multiplied": Amcl(laser_model_type="likelihood_field_prob"),
}
OWN = Path(__file__).resolve().parent.parent / "maps"
MIN_DISTANCE = 8.0
RADIUS = 0.25


def main(
    folder: str = "evidence",
    maps: Sequence[str] = (),
    places: int = 100,
    queries: int = 10,
    drives: int = 50,
) -> None:
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    grids = [locplan.load_map(file) for file in maps or sorted(OWN.glob("*.yaml"))]
    evaluations, routes = {}, {}
    for name, amcl in FILTERS.items():
        evaluations[name] = evaluate(grids, amcl=amcl, places=places)
        reports.write_evaluation(
            reports.EVALUATION.into(target / f"{name}, places"), evaluations[name]
        )
        print(f"{name}\n{reports.evaluation_table(evaluations[name])}", flush=True)
        routes[name] = [driven(grid, amcl, queries, drives) for grid in grids]
        reports.write_routes(reports.QUERIES.into(target / f"{name}, paths"), routes[name])
        print(reports.routes_table(routes[name]), flush=True)
    text = "\n\n".join([predictors(evaluations), errors(evaluations), paths(routes)])
    (target / "evidence.md").write_text(text + "\n", encoding="utf-8")
    print(f"wrote {target / 'evidence.md'}")


def driven(grid: locplan.OccupancyGrid, amcl: Amcl, queries: int, drives: int) -> Routes:
    field = locplan.load_or_compute(grid)
    costs = locplan.Costmap.from_field(grid, field, weight=4.0, robot_radius=RADIUS)
    chosen = random_queries(costs, queries, 1, least_distance=MIN_DISTANCE)
    return simulate_queries(costs, chosen, amcl=amcl, drives=drives)


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
            low, median, high = alone.quantiles(0, "tracking")
            ranks = [alone.ranks[p, "tracking"].spearman.value for p in shown(evaluation)]
            cells += [f"{low:.2f} / {median:.2f} / {high:.2f}", *(f"{r:.2f}" for r in ranks)]
        rows.append(cells)
    heads = [f"{name}: {what}" for name in evaluations for what in ("RMSE [m]", "sad e", "scan e")]
    return markdown(["map", *heads], rows)


def shown(evaluation: Evaluation) -> list:
    return [p for p in evaluation.predictions[0] if str(p) in ("sad, e", "scan, e")]


def paths(routes: dict[str, list[Routes]]) -> str:
    """For each map what the aware path costs, and what it changes."""
    rows = []
    for every in zip(*routes.values(), strict=True):
        cells = [every[0].grid.name, f"{100 * (every[0].length_ratio.value - 1):+.1f} %"]
        for each in every:
            lost = f"{each.lost[0]:.0%} → {each.lost[1]:.0%}"
            cells += [text_of(each.rmse_ratio), lost, each.verdict]
        rows.append(cells)
    heads = [f"{name}: {what}" for name in routes for what in ("RMSE ratio", "lost", "verdict")]
    return markdown(["map", "length", *heads], rows)


def text_of(interval: Interval) -> str:
    return f"{interval.value:.2f} [{interval.low:.2f}, {interval.high:.2f}]"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main(*sys.argv[1:2], maps=sys.argv[2:])

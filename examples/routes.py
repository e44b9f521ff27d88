"""Measure how recommended paths change the error of a simulated robot, on any maps.

Run: python examples/routes.py [FOLDER [MAP.yaml ...]]

On each map some random queries, of 10 m or more and with a shortest path of at most 40 m, get a
recommended path as from `locplan plan`, seed 1. Then `simulate` drives the shortest, the inflated
and the leading path 64 times with seed 1001: in other worlds than those that decided. In 40 more
drives of each path, a pursuit follower steers by the filter's pose.

Writes FOLDER/routes.csv, one row for each path. Interrupted runs resume.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from evidence import find_version, read_rows, write_rows

import locplan
from locplan._support.intervals import Interval, estimate_mean
from locplan.field.config import SHORT_LIDAR
from locplan.planning import random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation import ClosedLoopSettings, simulate

MAPS = Path(__file__).resolve().parent.parent / "maps"
CALM = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4", "alpha5"), 0.05)
FILTERS = {
    "defaults": Amcl(),
    "alphas 0.05": Amcl(**CALM),
    "precise": Amcl(**CALM, laser_model_type="likelihood_field_prob"),
}
"""The filters that drive with a lidar of 6 m."""
MIN_DISTANCE, MAX_LENGTH = 10.0, 40.0
"""Least distance from start to goal, and greatest length of the shortest path [m]."""
CLOSED_LOOP_DRIVES = 40
"""Number of closed-loop drives of each path."""
SHORTEST, INFLATED = "shortest", "inflated"
Row = dict[str, Any]


def main(
    folder: str = "routes", maps: Sequence[str] = (), drives: int = 64, queries: int = 2
) -> None:
    """Measure each query on each map with each filter."""
    rows = read_rows("routes", Path(folder))
    known = {(row["map"], row["filter"], row["query"]) for row in rows}
    for name, amcl in FILTERS.items():
        robot = Robot(SHORT_LIDAR, filter=amcl)
        for file in map(Path, maps or sorted(MAPS.glob("*.yaml"))):
            grid = locplan.load_map(file)
            for number, ends in enumerate(find_queries(grid, robot, queries)):
                if (grid.name, name, number) in known:
                    continue
                case = {"map": grid.name, "filter": name, "query": number}
                rows += measure_query(case, grid, robot, ends, drives)
                write_rows(Path(folder) / "routes.csv", rows)
                print(f"{grid.name}, {name}, {number}: {describe(rows)}", flush=True)
    print(f"wrote {Path(folder) / 'routes.csv'}")


def find_queries(
    grid: locplan.OccupancyGrid, robot: Robot, count: int
) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Find start and goal of some random queries; none if the map is too small."""
    costs = locplan.Costmap.blank(grid, robot=robot)
    try:
        queries = random_queries(costs, 4 * count, 2, min_distance=MIN_DISTANCE)
    except locplan.LocplanError:
        return
    for query in queries:
        ends = query.start[:2], query.goal[:2]
        shortest = locplan.plan(costs, *ends).path
        if shortest is None or shortest.length > MAX_LENGTH or not count:
            continue
        count -= 1
        yield ends


def measure_query(
    case: Row, grid: locplan.OccupancyGrid, robot: Robot, ends: tuple[Any, Any], drives: int
) -> Iterator[Row]:
    """Recommend a path, and drive the shortest, the inflated and the leading one again."""
    field_seconds = 0.0

    def compute(part: locplan.OccupancyGrid, points: np.ndarray | None = None) -> object:
        nonlocal field_seconds
        began = time.perf_counter()
        field = locplan.load_or_compute(part, locplan.Fused(robot.lidar), points=points)
        field_seconds += time.perf_counter() - began
        return field

    began = time.perf_counter()
    choice = locplan.recommend_path(grid, *ends, robot, compute=compute)
    seconds = time.perf_counter() - began - field_seconds
    names = [candidate.name for candidate in choice.candidates]
    leader, best = names[choice.judgement.leader], names[choice.best]
    paths = {
        candidate.name: candidate
        for candidate in choice.candidates
        if candidate.name in (SHORTEST, INFLATED, leader)
    }
    simulated = simulate(
        grid,
        {name: candidate.path for name, candidate in paths.items()},
        robot,
        drives=drives,
        closed=ClosedLoopSettings(drives=CLOSED_LOOP_DRIVES),
        seed=1001,
    )
    log_errors = {name: np.log(d.mean_squares) / 2 for name, d in simulated.drives.items()}
    inflated = INFLATED if INFLATED in paths else SHORTEST  # they may be the same path
    shown_ratio = choice.judgement.ratio if choice.judgement.leader else (np.nan,) * 3
    for name, candidate in paths.items():
        arrivals = simulated.arrivals[name]
        faults = [drive.fault for drive in arrivals.drives]
        yield make_row(
            case,
            name,
            candidate.path.length,
            is_leader=name == leader,
            is_recommended=name == best,
            log_errors=log_errors,
            inflated=inflated,
            lost=simulated.drives[name].lost,
            off_at_end=simulated.drives[name].off_at_end,
            arrived=arrivals.arrival_rate.value,
            faults=faults,
            shown_error=candidate.driven.error,
            shown_lost=candidate.driven.lost_rate,
            shown_ratio=shown_ratio if name == leader else (np.nan,) * 3,
            verdict=str(choice.judgement.verdict),
            seconds=seconds,
            version=find_version(),
        )


def make_row(
    case: Row,
    name: str,
    length: float,
    *,
    is_leader: bool,
    is_recommended: bool,
    log_errors: dict[str, np.ndarray],
    inflated: str,
    lost: np.ndarray,
    off_at_end: np.ndarray,
    arrived: float,
    faults: Sequence[str | None],
    shown_error: Sequence[float],
    shown_lost: Sequence[float],
    shown_ratio: Sequence[float],
    verdict: str,
    seconds: float,
    version: str,
) -> Row:
    """Return the row of a path: fresh drives, and the figures that the recommendation shows."""
    error = np.exp(estimate_mean(log_errors[name]))
    over_shortest = compare_errors(log_errors[name], log_errors[SHORTEST])
    over_inflated = compare_errors(log_errors[name], log_errors[inflated])
    return {
        **case,
        "path": name,
        "is_inflated": name == inflated,
        "is_leader": is_leader,
        "is_recommended": is_recommended,
        "length": length,
        "drives": len(lost),
        **name_bounds("error", error),
        "lost": int(lost.sum()),
        "off_at_end": int(off_at_end.sum()),
        **name_bounds("ratio", over_shortest),
        **name_bounds("inflated_ratio", over_inflated),
        "closed_loop_drives": len(faults),
        "arrived": round(arrived * len(faults)),
        "follower_faults": sum(fault == "follower" for fault in faults),
        "world_faults": sum(fault == "world" for fault in faults),
        **name_bounds("shown_error", shown_error),
        **name_bounds("shown_lost", shown_lost),
        **name_bounds("shown_ratio", shown_ratio),
        "verdict": verdict,
        "seconds": seconds,
        "version": version,
    }


def compare_errors(log_error: np.ndarray, reference: np.ndarray) -> Interval:
    """Return the ratio of the errors of paired drives, with its interval over the drives."""
    difference = log_error - reference
    middle = float(difference.mean())
    half = 2.0 * float(difference.std(ddof=1)) / len(difference) ** 0.5
    return Interval(*np.exp((middle, middle - half, middle + half)).tolist())


def name_bounds(name: str, interval: Sequence[float]) -> dict[str, float]:
    """Return the columns of an interval."""
    value, low, high = (float(bound) for bound in interval)
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def describe(rows: Sequence[Row]) -> str:
    """Describe the recommended path of the last query in a line."""
    row = [row for row in rows if row["is_recommended"]][-1]
    return f"{row['path']}, {row['ratio']:.2f} of the shortest path's error"


if __name__ == "__main__":
    main(*sys.argv[1:2], maps=sys.argv[2:])

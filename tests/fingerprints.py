"""Fingerprints of results on real and made maps, to compare two states or two environments.

    python tests/fingerprints.py now.npz                      # prints the digest of each result
    python tests/fingerprints.py now.npz --beside before.npz  # and how far each differs

With --beside it ends with exit code 1 if a difference exceeds the tolerance that is stated below:
results of two processors agree within it.

Results are fields of all estimators, costmaps, paths of every planner, Pareto fronts, drives by
seed, choices, keepout masks, and the images of exports, as pixels. Real maps are those of
../shared/data/rosmaps. The script runs the locplan that Python finds; PYTHONPATH can name another
state than this file's.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

import locplan
from locplan import FieldConfig, Fisher, Footprint, Fused, Lidar, OccupancyGrid, Robot, Sad, Scan
from locplan.export import nav2_keepout, nav2_speed
from locplan.export.masks import compute_keepout_mask
from locplan.maps import environments
from locplan.planning import random_queries
from locplan.planning.pareto import BudgetPlanner
from locplan.robots import Kinematics
from locplan.simulation import RecommendationSettings

REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "rosmaps"
MAPS = ("tb4_maze", "aws_small_house", "nav2_depot", "fetch_4_26_15", "mit_stata_basement_yaw")
ROUND, AHEAD = Lidar.preset("turtlebot4"), Lidar(range=8.0, field_of_view_deg=180.0, beams=90)
CONFIGS = {
    "sad": FieldConfig(Sad(), stride=0.4),
    "sad of the paper": FieldConfig(Sad.paper(), stride=0.8),
    "sad, visible": FieldConfig(Sad(template="visible"), stride=0.8),
    "sad, long range": FieldConfig(Sad(range=20.0), stride=1.6),
    "fisher": FieldConfig(Fisher(ROUND), stride=0.4),
    "fisher of ranges": FieldConfig(Fisher(ROUND, model="range"), stride=0.8),
    "scan": FieldConfig(Scan(ROUND), stride=0.8),
    "fused": FieldConfig(Fused(ROUND), stride=0.8),
    "fused, headings": FieldConfig(Fused(AHEAD), stride=1.6),
}
Arrays = dict[str, np.ndarray]
OMPL_ITERATIONS = {
    "RRTstar": 2000,
    "InformedRRTstar": 5000,
    "SORRTstar": 2000,
    "BITstar": 4000,
    "FMT": 3000,
    "BFMT": 3000,
    "PRM": 500,
    "PRMstar": 500,
    "RRT": 2000,
    "RRTConnect": 20000,
    "KPIECE1": 2000,
    "BKPIECE1": 2000,
    "LBKPIECE1": 10000,
}
PLANNERS: dict[str, dict[str, int]] = {
    "grid": {},
    "astar": {},
    "dijkstra": {},
    "any-angle": {},
    "lattice": {},
    **{name: {"iterations": count, "seed": 1} for name, count in OMPL_ITERATIONS.items()},
}
CAR = Robot(
    ROUND,
    footprint=Footprint([(0.45, 0.2), (0.45, -0.2), (-0.15, -0.2), (-0.15, 0.2)]),
    kinematics=Kinematics(drive="car-like", turning_radius=0.6),
)
CURVES = {"space": "ReedsShepp", "turning_radius": 0.6, "iterations": 3000, "seed": 1}


def results(grid: OccupancyGrid) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of one map by name."""
    made = {}
    for name, config in CONFIGS.items():
        made[name] = field = locplan.covariance_field(grid, config)
        for array, values in field.values.items():
            yield f"field/{name}/{array}", values
    for name in ("sad", "fused"):
        costs = locplan.Costmap.from_field(made[name], robot=0.2)
        yield f"costs/{name}/u", costs.u
        yield f"costs/{name}/density", costs.density
        yield from routes(grid, costs, name)
        yield from masks(costs, name)
    car_costs = locplan.Costmap.from_field(made["fused"], robot=CAR)
    yield from car_paths(car_costs)
    if (grid.shape[0] * grid.shape[1]) < 200_000:  # a minute otherwise
        yield from default_choice(grid)


def routes(
    grid: OccupancyGrid, costs: locplan.Costmap, name: str
) -> Iterator[tuple[str, np.ndarray]]:
    """Paths, fronts, drives and choices on a costmap."""
    (query,) = random_queries(costs, 1, 1, min_distance=5.0)
    ends = query.start, query.goal
    for planner, options in PLANNERS.items():
        plan = locplan.plan(costs, *ends, planner=planner, **options)
        yield from plan_arrays(f"path/{name}/{planner}", plan)
    front = locplan.pareto_front(costs, *ends, time_limit=120.0, max_labels=2_000_000)
    yield f"front/{name}/length", front.length
    yield f"front/{name}/integral", front.integral
    yield f"front/{name}/epsilon", np.array([front.epsilon])
    if front.epsilon == 0:  # otherwise the search depends on the time
        budget = BudgetPlanner(float(np.median(front.integral)), time_limit=120.0)
        yield from plan_arrays(f"path/{name}/budget", locplan.plan(costs, *ends, planner=budget))
    robot = Robot(ROUND)
    straight = {"any-angle": locplan.plan(costs, *ends).path}
    driven = locplan.simulation.simulate(grid, straight, robot, drives=8, seed=1)
    yield f"drives/{name}/errors", driven.drives["any-angle"].errors
    choice = locplan.recommend_path(
        grid,
        *ends,
        robot,
        costs=costs,
        settings=RecommendationSettings(drives=8, time_limit=3600.0),
        seed=1,
    )
    yield from choice_arrays(f"choice/{name}", choice)


def default_choice(grid: OccupancyGrid) -> Iterator[tuple[str, np.ndarray]]:
    """The choice of default settings, with the field that it computes itself."""
    field = locplan.covariance_field(grid, CONFIGS["sad"])
    costs = locplan.Costmap.from_field(field, robot=0.2)
    (query,) = random_queries(costs, 1, 1, min_distance=5.0)
    choice = locplan.recommend_path(grid, query.start, query.goal, Robot(ROUND))
    yield from choice_arrays("choice/default", choice)


def choice_arrays(name: str, choice: locplan.Recommendation) -> Iterator[tuple[str, np.ndarray]]:
    """The chosen path, its verdict, and its ratio of errors with the interval."""
    yield f"{name}/path", choice.path.xy
    yield f"{name}/verdict", as_bytes(choice.verdict)
    if choice.judgement:
        ratio = choice.judgement.ratio
        yield f"{name}/ratio", np.array([ratio.value, ratio.low, ratio.high])


def car_paths(costs: locplan.Costmap) -> Iterator[tuple[str, np.ndarray]]:
    """Paths of a car with an outline: the lattice's, and OMPL's between the poses at its ends."""
    (query,) = random_queries(costs, 1, 1, min_distance=5.0)
    lattice = locplan.plan(costs, query.start, query.goal, planner="lattice")
    yield from plan_arrays("path/car/lattice", lattice)
    if lattice.path is None:
        return
    start, goal = lattice.path.poses[[0, -1]]
    for planner in ("RRTstar", "RRTConnect"):
        plan = locplan.plan(costs, start, goal, planner=planner, **CURVES)
        yield from plan_arrays(f"path/car/{planner}", plan)


def plan_arrays(name: str, plan: locplan.Plan) -> Iterator[tuple[str, np.ndarray]]:
    """A plan's status, path, cost J and length."""
    yield f"{name}/status", as_bytes(plan.status)
    if plan.path:
        yield name, plan.path.xy
        yield f"{name}/cost", np.array([plan.metrics.cost, plan.metrics.length])


def masks(costs: locplan.Costmap, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Keepout masks for Nav2's planners, and the pixels of the exports' images."""
    for planner in ("smac2d", "smac-hybrid", "thetastar"):
        yield f"mask/{name}/{planner}", compute_keepout_mask(costs, planner=planner)[0]
    writers = {"keepout": nav2_keepout, "speed": nav2_speed}
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in writers.items():
            write(Path(folder) / kind, costs)
        yield from pixels(Path(folder), name)


def as_bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), np.uint8)


def pixels(folder: Path, name: str) -> Iterator[tuple[str, np.ndarray]]:
    for file in sorted(folder.rglob("*")):
        if file.suffix in (".pgm", ".png", ".tif"):
            with Image.open(file) as image:
                yield f"image/{name}/{file.relative_to(folder).as_posix()}", np.asarray(image)


def digest(array: np.ndarray) -> str:
    return hashlib.sha256(f"{array.dtype} {array.shape}".encode() + array.tobytes()).hexdigest()


def difference(one: np.ndarray, other: np.ndarray) -> str:
    """How far two arrays differ, in the greatest of their values."""
    if one.shape != other.shape:
        return f"shapes {one.shape} and {other.shape}"
    if one.dtype != other.dtype:
        return f"types {one.dtype} and {other.dtype}"
    one, other = one.astype(float), other.astype(float)
    if (np.isnan(one) != np.isnan(other)).any():
        return "other values are known"
    apart = np.zeros(one.shape)
    unlike = (one != other) & ~np.isnan(one)
    apart[unlike] = abs(one[unlike] - other[unlike])
    at = np.unravel_index(apart.argmax(), apart.shape)
    return f"by {apart.max():.3g} at {one[at]:.6g}, {unlike.mean():.3%} of the values"


class Tolerance(NamedTuple):
    """How far results of another processor may differ; the last bits of its exp and sin do."""

    relative: float
    """Greatest difference, as a share of the value, or of 1 if the value is smaller."""
    ties: float = 0.0
    """Share of the values that may differ by more, since equal costs lead to either result."""


ROUNDING = Tolerance(1e-7)
"""Tolerance of numbers. Normals of walls have single precision, and so a last bit of 6e-8."""
TOLERANCES = {
    "field": ROUNDING,
    "costs": ROUNDING,
    "path": ROUNDING,
    "front": ROUNDING,
    "mask": Tolerance(0.0, ties=1e-3),
    "image": Tolerance(0.0, ties=1e-3),
}
"""Tolerance by the kind of a result. Paths are judged by their cost and length, since paths of
equal cost are equally good. Covariances are shares of the greatest entry of their matrix."""
SAMPLED = Tolerance(0.25)
"""Tolerance of costs and lengths of OMPL's paths, whose random trees may part at one other bit."""
DEVIATIONS = 3.0
"""Standard errors by which the mean of log RMSE may differ between two sets of drives."""


def is_within_tolerance(name: str, one: np.ndarray, other: np.ndarray) -> bool:
    """True if a result of two processors, or of two states, is the same but for rounding."""
    _, kind, *parts = name.split("/")
    if parts[-1] in ("status", "verdict"):
        return digest(one) == digest(other)
    if kind == "choice":  # an equally short candidate has other drives
        return parts[-1] != "ratio" or bool(one[1] <= other[2] and other[1] <= one[2])
    if kind == "path" and parts[-1] != "cost":
        return True
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    if kind == "drives":
        return are_drives_alike(one, other)
    is_sampled = kind == "path" and parts[1] in OMPL_ITERATIONS
    tolerance = SAMPLED if is_sampled else TOLERANCES[kind]
    one, other = one.astype(float), other.astype(float)
    scale = np.maximum(abs(one), abs(other))
    scale = scale.max(axis=(-2, -1), keepdims=True) if parts[-1] == "covariance" else scale.clip(1)
    with np.errstate(invalid="ignore"):  # NaN and infinity are alike only if they are equal
        is_near = abs(one - other) <= tolerance.relative * scale
    is_near &= np.isfinite(one) & np.isfinite(other)
    is_alike = is_near | (one == other) | (np.isnan(one) & np.isnan(other))
    return not is_alike.size or bool(1 - is_alike.mean() <= tolerance.ties)


def are_drives_alike(one: np.ndarray, other: np.ndarray) -> bool:
    """True if the errors (drive, pose, 3) of two sets of drives have about the same mean."""
    logs = [np.log(np.sqrt((errors[..., :2] ** 2).sum(-1).mean(-1))) for errors in (one, other)]
    error = math.sqrt(sum(values.var(ddof=1) / len(values) for values in logs))
    return bool(abs(logs[0].mean() - logs[1].mean()) <= DEVIATIONS * error)


def compared(found: Arrays, others: Arrays) -> dict[bool, list[str]]:
    """The results that are not the same to the bit, with how far they differ.

    They are listed by whether the difference is within the tolerance.
    """
    lines: dict[bool, list[str]] = {True: [], False: []}
    lines[False] += [f"{name}: in one only" for name in sorted(set(found) ^ set(others))]
    for name in sorted(set(found) & set(others)):
        one, other = found[name], others[name]
        if digest(one) != digest(other):
            lines[is_within_tolerance(name, one, other)] += [f"{name}: {difference(one, other)}"]
    return lines


def maps() -> Iterator[tuple[str, OccupancyGrid]]:
    for name in ("two_corridors", "places"):
        yield name, environments.make(name, resolution=0.1)
    for name in MAPS if REAL.is_dir() else ():
        yield name, locplan.load_map(next((REAL / name).glob("*.yaml")))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("target", type=Path, help="file of all results, *.npz")
    parser.add_argument("--beside", type=Path, help="file of other results")
    parser.add_argument("--map", help="one map only")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    found = {}
    for name, grid in maps():
        if options.map in (None, name):
            for what, array in results(grid):
                found[f"{name}/{what}"] = array
                print(digest(array)[:16], f"{name}/{what}", flush=True)
    np.savez_compressed(options.target, **found)
    if not options.beside:
        return 0
    with np.load(options.beside) as others:
        lines = compared(found, dict(others))
    for is_within, text in ((True, "within the tolerance"), (False, "beyond the tolerance")):
        print(f"{len(lines[is_within])} of {len(found)} differ {text}", *lines[is_within], sep="\n")
    return int(bool(lines[False]))


if __name__ == "__main__":
    sys.exit(main())

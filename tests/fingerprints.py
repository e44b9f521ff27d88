"""Fingerprints of results on real and made maps, to compare two states or two environments.

    python tests/fingerprints.py now.npz                      # prints the digest of each result
    python tests/fingerprints.py now.npz --beside before.npz  # and how far each differs

Results are fields of all estimators, costmaps, paths, Pareto fronts, drives by seed, and the images
of exports, as pixels. Real maps are those of ../shared/data/rosmaps. The locplan that Python finds
is the one that is run; with PYTHONPATH it can be another state than this file's.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

import locplan
from locplan import FieldConfig, Fisher, Fused, Lidar, OccupancyGrid, Robot, Sad, Scan, export
from locplan.maps import environments
from locplan.planners import random_queries

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
    "fused": FieldConfig(Fused.of(ROUND), stride=0.8),
    "fused, headings": FieldConfig(Fused.of(AHEAD), stride=1.6),
}
Arrays = dict[str, np.ndarray]
PLANNERS = {
    "grid": {},
    "any-angle": {},
    "RRTstar": {"iterations": 3000, "seed": 1},
    "PRM": {"iterations": 1000, "seed": 1},
}


def results(grid: OccupancyGrid) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of one map by name."""
    made = {}
    for name, config in CONFIGS.items():
        made[name] = field = locplan.covariance_field(grid, config)
        for array, values in field.values.items():
            yield f"field/{name}/{array}", values
    for name in ("sad", "fused"):
        costs = locplan.Costmap.from_field(grid, made[name], robot=0.2)
        yield f"costs/{name}/u", costs.u
        yield f"costs/{name}/density", costs.density
        yield from routes(grid, costs, name)
        yield from images(costs, name)
    with tempfile.TemporaryDirectory() as folder:
        export.layer(Path(folder) / "layer", made["fused"])
        yield from pixels(Path(folder), "layer")


def routes(
    grid: OccupancyGrid, costs: locplan.Costmap, name: str
) -> Iterator[tuple[str, np.ndarray]]:
    """Paths, fronts and drives on a costmap."""
    (query,) = random_queries(costs, 1, 1, min_distance=5.0)
    ends = query.start, query.goal
    for planner, options in PLANNERS.items():
        plan = locplan.plan(costs, *ends, planner=planner, **options)
        yield f"path/{name}/{planner}/status", np.frombuffer(plan.status.encode(), np.uint8)
        if plan.path:
            yield f"path/{name}/{planner}", plan.path.xy
            measured = plan.metrics.cost, plan.metrics.length
            yield f"path/{name}/{planner}/cost", np.array(measured)
    front = locplan.pareto_front(costs, *ends, time_limit=120.0, max_labels=2_000_000)
    yield f"front/{name}/length", front.length
    yield f"front/{name}/integral", front.integral
    yield f"front/{name}/epsilon", np.array([front.epsilon])
    robot = Robot(ROUND)
    straight = {"any-angle": locplan.plan(costs, *ends).path}
    driven = locplan.simulation.simulate(grid, straight, robot, drives=8, seed=1)
    yield f"drives/{name}/errors", driven.drives["any-angle"].errors
    choice = locplan.choose(grid, *ends, robot, costs=costs, drives=8, seed=1, time_limit=3600.0)
    yield f"choice/{name}/path", choice.path.xy
    verdict = np.frombuffer(choice.verdict.encode(), np.uint8)
    yield f"choice/{name}/verdict", verdict


def images(costs: locplan.Costmap, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Pixels of the exports' images: masks, and their previews."""
    writers = {"keepout": export.nav2_keepout, "static": export.nav2_static}
    writers |= {"speed": export.nav2_speed, "ros-map": export.ros_map}
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in writers.items():
            write(Path(folder) / kind, costs)
        yield from pixels(Path(folder), name)


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


def compared(found: Arrays, others: Arrays) -> list[str]:
    """The results that are not the same to the bit, by name, with how far they differ."""
    lines = [f"{name}: in one only" for name in sorted(set(found) ^ set(others))]
    for name in sorted(set(found) & set(others)):
        if digest(found[name]) != digest(others[name]):
            lines.append(f"{name}: {difference(found[name], others[name])}")
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
        apart = compared(found, dict(others))
    print(*apart, f"{len(apart)} of {len(found)} differ", sep="\n")
    return int(bool(apart))


if __name__ == "__main__":
    sys.exit(main())

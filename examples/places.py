"""Measure how well fields rank a robot's errors at places, on any maps.

On each map a filter drives 16 times to each of 100 random places, along shortest paths of 10 m from
all directions. At each place, 16 single scans are matched. The filter's error is its RMSE over the
last metre. The program ranks the fields and two baselines by both kinds of errors.

Run: python examples/places.py [FOLDER [MAP.yaml ...]]

Writes FOLDER/places.csv, one row for each predictor and kind of error, and FOLDER/places_maps.csv,
the errors on each map.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from evidence import find_version, write_rows
from numba import njit
from scipy.spatial import cKDTree

import locplan
from locplan import FieldConfig, Fisher, Fused, Lidar, OccupancyGrid, Sad, Scan
from locplan._support.intervals import (
    BootstrapResamples,
    RankStatistics,
    compute_rank_statistics,
    make_generator,
)
from locplan._support.kernels.arrays import Floats, Ints, Octets, Random
from locplan._support.kernels.lidar import (
    BeamDisturbances,
    LidarBeams as KernelLidar,
    simulate_measured_ends,
)
from locplan._support.kernels.likelihood import (
    NOWHERE,
    LikelihoodField,
    ScanLattice,
    make_scan_lattice,
)
from locplan._support.kernels.posterior import score_scan
from locplan._support.poses import find_window
from locplan.field import equip_robot, scalar
from locplan.field.scan import make_likelihood_field
from locplan.field.summary import select_spaced_positions
from locplan.maps import OCCUPIED
from locplan.planning import Costmap, plan_field
from locplan.robots import Amcl, Robot, planning_radius
from locplan.simulation import NO_FAULT, Simulator
from locplan.simulation.worlds import (
    POSE_SPACING,
    _make_facing_poses as facing_ahead,
    rotate_errors,
)

OWN = Path(__file__).resolve().parent.parent / "maps"
FILTERS = {
    "defaults": Amcl(),
    "beams multiplied": Amcl(laser_model_type="likelihood_field_prob"),
}
LENGTH = 10.0
"""Length of the drives [m]."""
MATCH_WINDOW, MATCH_STEP = 2.0, 0.05
"""Half of the edge and step of the window in which scans are matched [m]."""
MATCH, POINTS, APPROACH = 1, 3, 4
"""Streams of random numbers."""
Row = dict[str, Any]
ErrorKind = Literal["tracking", "match"]
KINDS: tuple[ErrorKind, ...] = ("tracking", "match")
"""Kinds of errors: of the filter, and of single scans."""


def main(
    folder: str = "places", maps: Sequence[str] = (), places: int = 100, drives: int = 16
) -> None:
    grids = [locplan.load_map(file) for file in maps or sorted(OWN.glob("*.yaml"))]
    evaluations = {
        name: evaluate(grids, equip_robot(Robot(filter=amcl)), places, drives)
        for name, amcl in FILTERS.items()
    }
    for name, rows in (
        ("places", list(compare_predictors(evaluations))),
        ("places_maps", list(describe_maps(evaluations))),
    ):
        print(f"wrote {write_rows(Path(folder) / f'{name}.csv', rows)}")


# The errors of a robot at places.


@dataclass(frozen=True)
class Places:
    """Places of a map and the errors there."""

    grid: OccupancyGrid
    points: Ints
    """Rows and columns on the lattice of a field's default stride, (n, 2)."""
    errors: Mapping[ErrorKind, Floats]
    """Errors of each kind at the places, (n, k, 3), in the world [m, m, rad]."""

    def rmse(self, kind: ErrorKind, of_heading: bool = False) -> Floats:
        """RMSE of the position [m] or of the heading [rad], (n,)."""
        squares = self.errors[kind] ** 2
        summed = squares[..., 2] if of_heading else squares[..., :2].sum(axis=2)
        return np.sqrt(summed.mean(axis=1))


def choose_points(grid: OccupancyGrid, count: int, *, robot: Robot, seed: int) -> Ints:
    """Random lattice points where a robot can stand, at least 1 m apart, (n, 2)."""
    wide = grid.free & (grid.clearance >= planning_radius(robot))
    _, labels, about, _ = cv2.connectedComponentsWithStats(wide.astype(np.uint8), connectivity=4)
    largest = 1 + int(np.argmax(about[1:, cv2.CC_STAT_AREA]))
    stride = FieldConfig().stride_cells(grid.resolution)
    points = np.argwhere(labels[::stride, ::stride] == largest).reshape(-1, 2)
    priority = make_generator(seed, POINTS).random(len(points))
    spacing = 1.0 / (stride * grid.resolution)
    chosen = select_spaced_positions(points.astype(float), priority, spacing)[:count]
    return points[chosen]


def measure(grid: OccupancyGrid, robot: Robot, count: int, drives: int, seed: int = 1) -> Places:
    """Drive to random places of a map, and match scans there."""
    simulator = Simulator(grid, robot, seed=seed)
    points = choose_points(grid, count, robot=robot, seed=seed)
    cells = points * FieldConfig().stride_cells(grid.resolution)
    costs, random = Costmap.blank(grid, robot=robot), make_generator(seed, APPROACH)
    lines = [
        line
        for row, col in cells
        for line in approaches(costs, (int(row), int(col)), drives, LENGTH, random)
    ]
    driven = driven_once(simulator, lines).reshape(len(points), drives, -1, 3)
    last = driven[:, :, -max(1, round(0.1 * driven.shape[2])) :]  # the last metre of 10 m
    errors = last.reshape(len(points), -1, 3)
    return Places(grid, points, {"tracking": errors, "match": matched(simulator, cells, drives)})


def driven_once(simulator: Simulator, lines: list[Floats]) -> Floats:
    """Errors of one drive along each line, in a world of its own, (lines, n, 3)."""
    errors = np.empty((len(lines), *lines[0].shape))

    def run(n: int) -> None:
        line = simulator.make_drive_poses(lines[n])
        stage = simulator.make_world_region([line])
        errors[n] = stage.drive(line, stage.make_world(0, n), 0, n, simulator.arguments, NO_FAULT)

    simulator.run_in_threads(run, len(lines), None)
    return rotate_errors(errors, simulator.filter_map.origin[2])


def approaches(
    costs: Costmap, cell: tuple[int, int], count: int, length: float, random: np.random.Generator
) -> list[Floats]:
    """Drives along shortest paths that end in a cell, all with the same number of poses.

    They begin at random where the path to the cell is as long as `length` [m], or as long as paths
    get there.
    """
    near, (row, col) = cut_out(costs, cell, length)
    to_cell = plan_field(near, near.grid.position(row, col))
    distance = np.where(to_cell.cost <= length, to_cell.cost, -1.0)
    # Paths count as equally long within 0.5 m.
    rows, cols = np.nonzero(distance >= max(distance.max() - 0.5, 0.0))
    drives = []
    for n in random.choice(len(rows), count, replace=len(rows) < count):
        path = to_cell.path(near.grid.position(int(rows[n]), int(cols[n])))
        assert path is not None
        drives.append(
            facing_ahead(path, np.linspace(0.0, path.length, round(length / POSE_SPACING) + 1))
        )
    return drives


def cut_out(costs: Costmap, cell: tuple[int, int], reach: float) -> tuple[Costmap, tuple[int, int]]:
    """Part of a costmap within `reach` [m] of a cell, and the cell's row and column in it."""
    cells = int(np.ceil(reach / costs.grid.resolution)) + 1
    rows, cols = part = find_window(*cell, cells, costs.grid.shape)
    near = Costmap.from_density(costs.grid.crop(*part), costs.density[part])
    return near, (cell[0] - rows.start, cell[1] - cols.start)


def matched(simulator: Simulator, cells: Ints, scans: int) -> Floats:
    """Errors of single scans at cells, matched over +-2 m and +-60 deg, (n, scans, 3).

    AMCL's number of beams of each scan is compared, on a likelihood field for matching alone.
    """
    resolution = simulator.grid.resolution
    step = max(1, round(MATCH_STEP / resolution))
    half_steps = round(MATCH_WINDOW / (step * resolution))
    field = make_likelihood_field(
        simulator.grid.cells, resolution, step, half_steps, sigma_hit=0.1, z_rand=0.05
    )
    angles = np.linspace(-np.pi / 3, np.pi / 3, 61)
    window = field, make_scan_lattice(half_steps, angles), angles
    sensed = simulator.arguments.lidar, simulator.arguments.disturbances
    worlds, errors = simulator.worlds, np.empty((len(cells), scans, 3))

    def run(n: int) -> None:
        random, cell = make_generator(simulator.seed, MATCH, n), cells[n].tolist()
        for scan in range(scans):
            world = worlds[scan % len(worlds)]
            match_scans(
                random, *window, world, resolution, *cell, *sensed, errors[n, scan : scan + 1]
            )

    simulator.run_in_threads(run, len(cells), None)
    errors[..., :2] *= resolution
    return rotate_errors(errors, simulator.grid.origin[2])


@njit(nogil=True)
def one_of_least(random: Random, costs: np.ndarray) -> int:
    """Index of the least cost; a random one if several are equal."""
    least = costs.min()
    ties = 0
    for n in range(costs.size):
        ties += costs[n] == least
    chosen = random.integers(0, ties)
    for n in range(costs.size):
        if costs[n] == least:
            if chosen == 0:
                return n
            chosen -= 1
    return 0


@njit(nogil=True, error_model="numpy")
def match_scans(
    random: Random,
    field: LikelihoodField,
    lattice: ScanLattice,
    angles: Floats,
    squares: Octets,
    resolution: float,
    row: int,
    col: int,
    lidar: KernelLidar,
    disturbances: BeamDisturbances,
    errors: Floats,
) -> None:
    """Match n scans from a cell, and write the errors of the most likely poses into `errors`.

    The robot's position in the cell and its heading are random. The window's middle is the cell's
    centre and a heading within half a step of the robot's.
    """
    turn_step = angles[1] - angles[0] if angles.size > 1 else 0.0
    measured, ends = np.empty((lidar.angles.size, 2)), np.empty((lidar.angles.size, 2))
    pose, costs = np.empty(3), np.empty_like(lattice.empty)
    for n in range(len(errors)):
        pose[0], pose[1] = row + random.random(), col + random.random()
        pose[2] = (2 * random.random() - 1) * np.pi
        aside = (random.random() - 0.5) * turn_step  # offset of the window's heading
        simulate_measured_ends(random, squares, resolution, pose, lidar, disturbances, measured)
        cos, sin = np.cos(pose[2] + aside), np.sin(pose[2] + aside)
        for b in range(len(ends)):
            ends[b, 0] = cos * measured[b, 0] - sin * measured[b, 1]
            ends[b, 1] = sin * measured[b, 0] + cos * measured[b, 1]
        score_scan(field, lattice, row, col, ends, costs)
        for k in range(costs.size):
            if lattice.empty[k] == NOWHERE:
                costs[k] = NOWHERE
        best = one_of_least(random, costs)
        heading, rest = best // lattice.plane, best % lattice.plane
        dy = rest // lattice.width - lattice.half_steps
        dx = rest % lattice.width - lattice.half_steps
        errors[n, 0] = col + 0.5 + dx * field.step - pose[1]
        errors[n, 1] = row + 0.5 + dy * field.step - pose[0]
        errors[n, 2] = angles[heading] + aside


# Predictors, and how well they rank the errors.


class Predictor(NamedTuple):
    """A source and the scalar that is read of it; greater values should mean greater errors."""

    source: str
    """Name of the field, or of a baseline."""
    scalar: str
    """e, position_std or heading_std; nothing for a baseline."""

    @property
    def of_heading(self) -> bool:
        """True if it predicts the heading's error instead of the position's."""
        return self.scalar == "heading_std"

    def __str__(self) -> str:
        short = self.scalar.removesuffix("_std")
        return f"{self.source}, {short}" if short else self.source


def configs(lidar: Lidar) -> dict[str, FieldConfig]:
    """Settings of the fields that are tried, by name.

    "sad" is the default preset and "paper" the paper's; "visible" ones have templates of what is
    visible.
    """
    default, paper = Sad(), Sad.paper()
    estimators = {
        "sad": default,
        "sad visible": replace(default, template="visible"),
        "paper": paper,
        "paper visible": replace(paper, template="visible"),
        "fisher": Fisher(lidar),
        "scan": Scan(lidar),
        "fused": Fused(lidar),
    }
    return {name: FieldConfig(estimator) for name, estimator in estimators.items()}


def predictions(
    grid: OccupancyGrid,
    fields: Mapping[str, FieldConfig],
    points: Ints,
) -> dict[Predictor, Floats]:
    """Values of each predictor at points of the lattice of the default stride, (n,)."""
    found: dict[Predictor, Floats] = {}
    for name, config in fields.items():
        config = replace(config, stride=FieldConfig.stride)
        near = np.zeros(config.lattice_points(grid).shape, bool)
        near[tuple(points.T)] = True
        field = locplan.covariance_field(grid, config, points=near)
        covariance = field.average_headings[tuple(points.T)]
        for each in ("e", "position_std", "heading_std"):
            found[Predictor(name, each)] = scalar(covariance, each)
    config = next(iter(fields.values()))
    cells = points * config.stride_cells(grid.resolution)
    found[Predictor("clearance", "")] = grid.clearance[tuple(cells.T)]
    found[Predictor("few occupied cells", "")] = -occupied_about(
        grid, cells, config.estimator.reach / grid.resolution
    )
    return found


def occupied_about(grid: OccupancyGrid, cells: Ints, radius: float) -> Floats:
    """Number of occupied cells within a radius [cells] of each cell, also behind walls, (n,)."""
    occupied = np.argwhere(grid.cells == OCCUPIED)
    if not len(occupied):
        return np.zeros(len(cells))
    counts = cKDTree(occupied).query_ball_point(cells, radius, return_length=True)
    return np.asarray(counts.astype(float))


@dataclass(frozen=True)
class Evaluation:
    """Errors at places of some maps, and the values of each predictor there."""

    places: Sequence[Places]
    predictions: Sequence[dict[Predictor, Floats]]

    @cached_property
    def ranks(self) -> dict[tuple[Predictor, ErrorKind], RankStatistics]:
        """Rank statistics of each predictor for each kind of error.

        Deviations of the heading are compared with the heading's error, all others with the
        position's.
        """
        drawn = BootstrapResamples.from_counts([len(places.points) for places in self.places])
        return {
            (predictor, kind): compute_rank_statistics(
                [found[predictor] for found in self.predictions],
                [places.rmse(kind, predictor.of_heading) for places in self.places],
                drawn,
            )
            for predictor in self.predictions[0]
            for kind in KINDS
        }

    def of_map(self, number: int) -> Evaluation:
        """Evaluation of one map by itself."""
        return Evaluation([self.places[number]], [self.predictions[number]])


def evaluate(grids: Sequence[OccupancyGrid], robot: Robot, places: int, drives: int) -> Evaluation:
    """Measure errors at places of maps, and compute what predictors say there."""
    measured = [measure(grid, robot, places, drives) for grid in grids]
    fields = configs(robot.known_lidar)
    return Evaluation(measured, [predictions(p.grid, fields, p.points) for p in measured])


def compare_predictors(evaluations: Mapping[str, Evaluation]) -> Iterator[Row]:
    """Compare each predictor with each kind of error: over all places, and within a map."""
    kinds: dict[str, tuple[Evaluation, ErrorKind]] = {
        name: (evaluation, "tracking") for name, evaluation in evaluations.items()
    }
    kinds["single scans"] = next(iter(evaluations.values())), "match"
    for name, (evaluation, kind) in kinds.items():
        for predictor in evaluation.predictions[0]:
            ranks = evaluation.ranks[predictor, kind]
            yield {
                "predictor": str(predictor),
                "error": name,
                "rank": ranks.spearman.value,
                "rank_low": ranks.spearman.low,
                "rank_high": ranks.spearman.high,
                "within": ranks.within.value,
                "auc": ranks.auc.value,
                "maps": len(evaluation.places),
                "places": sum(len(places.points) for places in evaluation.places),
                "version": find_version(),
            }


def describe_maps(evaluations: Mapping[str, Evaluation]) -> Iterator[Row]:
    """Describe the errors on each map, and how well two estimators rank them there."""
    for name, evaluation in evaluations.items():
        for number, places in enumerate(evaluation.places):
            ranks = {
                str(predictor): statistics.spearman.value
                for (predictor, kind), statistics in evaluation.of_map(number).ranks.items()
                if kind == "tracking"
            }
            low, median, high = np.quantile(places.rmse("tracking"), (0.1, 0.5, 0.9)).tolist()
            yield {
                "map": places.grid.name,
                "error": name,
                "low": low,
                "median": median,
                "high": high,
                "rank_sad": ranks["sad, e"],
                "rank_scan": ranks["scan, e"],
                "version": find_version(),
            }


if __name__ == "__main__":
    main(*sys.argv[1:2], maps=sys.argv[2:])

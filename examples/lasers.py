"""Rank the uncertainty of real lasers with the estimators, and with published measures.

Run: python examples/lasers.py DATA [FOLDER]

Writes FOLDER/lasers.csv, the rows of the evidence on real lasers. DATA holds
carmen/NAME-corrected.log.gz, a recorded drive; carmen/localizability_NAME.csv, the reference: one
row per scan, matched on a map of the other scans; and rosmaps_carmen/NAME_even, that map. The
tenth of each log with the lowest scores is left out: people, or places that are not on the map.
The estimators are fields of 8 headings. The published measures are computed at the exact pose.
"""

from __future__ import annotations

import csv
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from evidence import estimate_over_groups, find_version, write_rows
from scipy.ndimage import distance_transform_edt, map_coordinates

import locplan
from locplan._support.intervals import (
    BootstrapResamples,
    Interval,
    compute_rank_statistics,
    compute_spearman,
)
from locplan._support.kernels.lidar import write_scan_ends
from locplan.field import position_axes, scalar
from locplan.maps import OCCUPIED
from locplan.recordings import read_recording

MIN_RANGE = 0.05
"""Range above which beams count as returns in the reference [m]."""
MAX_RANGES = {"intel": 30.0, "orebro": 30.0}
"""Range up to which beams count as returns in the reference [m]; 40 in the other logs."""
LEFT_OUT = 0.1
CLASSES = 0.0, 0.08, 0.12, 0.2, 0.4, 1.0
"""Bounds of the measured deviations between which predictions are compared in metres [m]."""
LARGE = 0.2
"""Measured deviation above which a prediction in metres matters most [m]."""
FACTOR = 1.5
"""Factor within which a predicted deviation is right."""
ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""
STEPS = 0.1, 0.2, 0.4
"""Distances by which the perturbation loss moves a scan [m]."""
STRONG = 0.5
"""Share of a normal along a direction from which a beam contributes to it, as in X-ICP."""


Row = dict[str, Any]


class Log(NamedTuple):
    """The reference of a log at n poses, and the map to predict it on."""

    grid: locplan.OccupancyGrid
    lidar: locplan.Lidar
    measured: dict[str, np.ndarray]  # columns of the reference, (n,) each

    @property
    def poses(self) -> np.ndarray:
        """Poses of the scans, (n, 3) [m, m, rad]."""
        return np.column_stack([self.measured[key] for key in ("x", "y", "theta")])

    @property
    def is_elongated(self) -> np.ndarray:
        """Mask of the poses at which the measured ellipse has a direction."""
        return self.measured["sd_major"] > ELONGATED * self.measured["sd_minor"]


def main(data: str, folder: str = "lasers") -> None:
    logs = read_logs(Path(data))
    if not logs:
        sys.exit(f"{data}: holds no carmen/localizability_NAME.csv")
    rows: list[Row] = []
    for name in ("sad", "fisher", "scan", "fused"):
        rows += compare_estimator(name, logs)
        print(f"{name}: {describe(rows)}", flush=True)
    for name, measure in MEASURES.items():
        predicted = {each: measure(log, simulate_ends(log)) for each, log in logs.items()}
        rows += compare_ranks(name, "rank", logs, predicted, "sd_major")
        print(f"{name}: {describe(rows)}", flush=True)
    print(f"wrote {write_rows(Path(folder) / 'lasers.csv', rows)}")


def read_logs(data: Path) -> dict[str, Log]:
    """Read all logs with a reference, by name."""
    files = sorted((data / "carmen").glob("localizability_*.csv"))
    return {file.stem.removeprefix("localizability_"): read_log(file) for file in files}


def read_log(file: Path) -> Log:
    """Read the reference in a file, without the scans that match worst."""
    name = file.stem.removeprefix("localizability_")
    with file.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    counts = column["score_per_beam"] >= np.quantile(column["score_per_beam"], LEFT_OUT)
    limits = MIN_RANGE, MAX_RANGES.get(name, 40.0)
    return Log(
        locplan.load_map(file.parent.parent / "rosmaps_carmen" / f"{name}_even"),
        read_recording(file.parent / f"{name}-corrected.log.gz", range_limits=limits).lidar,
        {key: values[counts] for key, values in column.items()},
    )


# The estimators.


def compare_estimator(name: str, logs: Mapping[str, Log]) -> Iterator[Row]:
    """Compare one estimator with the reference: ranks, directions and metres."""
    covariances = {each: predict_covariances(log, name) for each, log in logs.items()}
    criterion = "e" if name == "sad" else "position_std"
    positions = {each: scalar(values, criterion) for each, values in covariances.items()}
    headings = {each: scalar(values, "heading_std") for each, values in covariances.items()}
    yield from compare_ranks(name, "rank", logs, positions, "sd_major")
    yield from compare_ranks(name, "rank of heading", logs, headings, "sd_theta_deg")
    axes = [position_axes(values) for values in covariances.values()]
    measured = [log.measured["sd_major"] for log in logs.values()]
    ratios = [np.log(major / size) for (major, _, _), size in zip(axes, measured, strict=True)]
    known = [np.isfinite(ratio) for ratio in ratios]
    yield average(name, "ratio", ratios, known, exponential=True)
    is_right = [
        angle_between(direction, log.measured["major_dir"]) < math.radians(15.0)
        for (_, _, direction), log in zip(axes, logs.values(), strict=True)
    ]
    yield average(name, "direction", is_right, [log.is_elongated for log in logs.values()])
    for low, high in itertools.pairwise(CLASSES):
        part = [(low <= m) & (m < high) & k for m, k in zip(measured, known, strict=True)]
        yield average(name, f"ratio, {low:g} to {high:g} m", ratios, part, exponential=True)
    near = [np.abs(ratio) < math.log(FACTOR) for ratio in ratios]
    large = [(m > LARGE) & k for m, k in zip(measured, known, strict=True)]
    yield average(name, f"within a factor of {FACTOR:g} above {LARGE:g} m", near, large)
    yield average(name, f"within a factor of {FACTOR:g}", near, known)


def predict_covariances(log: Log, name: str) -> np.ndarray:
    """Return the covariances at the poses of a log, (n, 3, 3)."""
    estimator = {
        "sad": locplan.Sad(),
        "fisher": locplan.Fisher(log.lidar),
        "scan": locplan.Scan(log.lidar),
        "fused": locplan.Fused(log.lidar),
    }[name]
    config = locplan.FieldConfig(estimator)
    points = config.lattice_points(log.grid, log.poses)
    field = locplan.load_or_compute(log.grid, config, points=points)
    return field.at(log.poses, "covariance")


def compare_ranks(
    name: str,
    quantity: str,
    logs: Mapping[str, Log],
    predicted: Mapping[str, np.ndarray],
    column: str,
) -> Iterator[Row]:
    """Compare ranks: of each log, of all poses together, and the mean of the logs."""
    values, errors = [], []
    for log, reference in logs.items():
        known = np.isfinite(predicted[log])
        values.append(predicted[log][known])
        errors.append(reference.measured[column][known])
        rank = Interval(compute_spearman(values[-1], errors[-1]), math.nan, math.nan)
        yield make_row(name, quantity, log, rank, len(values[-1]))
    counts = [len(each) for each in values]
    ranks = compute_rank_statistics(values, errors, BootstrapResamples.from_counts(counts))
    for log, rank in (("pooled", ranks.spearman), ("within", ranks.within)):
        yield make_row(name, quantity, log, rank, sum(counts))


def average(
    name: str,
    quantity: str,
    values: Sequence[np.ndarray],
    counts: Sequence[np.ndarray],
    exponential: bool = False,
) -> Row:
    """Return the mean of the values that count, with its interval over logs and poses."""
    groups = [v[c] for v, c in zip(values, counts, strict=True)]
    mean = estimate_over_groups([group for group in groups if len(group)])
    if exponential:
        mean = Interval(*np.exp(mean).tolist())
    return make_row(name, quantity, "pooled", mean, sum(map(len, groups)))


def make_row(name: str, quantity: str, log: str, interval: Interval, count: int) -> Row:
    """Return the row of a quantity of an estimator, for a log, or for all of them."""
    return {
        "estimator": name,
        "quantity": quantity,
        "log": log,
        "n": count,
        "value": interval.value,
        "low": interval.low,
        "high": interval.high,
        "version": find_version(),
    }


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between two axes, 0 to pi / 2 [rad]."""
    return np.abs((one - other + np.pi / 2) % np.pi - np.pi / 2)


# Published measures of one simulated scan at the exact pose. Greater values mean less certain.


class Scan(NamedTuple):
    """The ends of the beams of a scan that return, in cells from the map's corner."""

    rows: np.ndarray
    cols: np.ndarray
    normals: np.ndarray  # unit normals (row, col) of the surfaces there, (n, 2)
    levers: np.ndarray  # the ends (row, col) from the robot [m], (n, 2)


def simulate_ends(log: Log) -> list[Scan]:
    """Simulate the scan at each pose of a log, with the beams that the estimators compare."""
    grid, fisher = log.grid, locplan.Fisher(log.lidar)
    squares, normals = fisher.prepare(grid.cells, grid.resolution)
    lidar = fisher.make_kernel_lidar()
    ends = np.empty((lidar.angles.size, 2))
    scans = []
    for x, y, heading in log.poses:
        row, col = (y - grid.origin[1]) / grid.resolution, (x - grid.origin[0]) / grid.resolution
        write_scan_ends(squares, grid.resolution, row, col, heading, lidar, ends)
        returns = ends[np.isfinite(ends).all(axis=1)][:, ::-1]
        rows, cols = (returns + np.array([row, col])).T
        at_ends = normals[np.floor(rows).astype(int), np.floor(cols).astype(int)]
        scans.append(Scan(rows, cols, at_ends, returns * grid.resolution))
    return scans


def measure_degeneracy_factor(log: Log, scans: Sequence[Scan]) -> np.ndarray:
    """Return minus the least eigenvalue of J'J (Zhang, Kaess and Singh, ICRA 2016)."""
    factors = []
    for scan in scans:
        turns = scan.levers[:, 1] * scan.normals[:, 0] - scan.levers[:, 0] * scan.normals[:, 1]
        jacobian = np.column_stack([scan.normals, turns])
        factors.append(np.linalg.eigvalsh(jacobian.T @ jacobian)[0])
    return -np.array(factors)


def measure_contributions(log: Log, scans: Sequence[Scan]) -> np.ndarray:
    """Return minus the least localizability contribution of a position axis, as in X-ICP.

    A beam contributes |n . v| to an eigenvector v of J'J of positions if this is at least
    `STRONG` (Tuna, Nubert, Nava, Khattak and Hutter, T-RO 2024).
    """
    least = []
    for scan in scans:
        _, axes = np.linalg.eigh(scan.normals.T @ scan.normals)
        contributions = np.abs(scan.normals @ axes)
        least.append(np.where(contributions >= STRONG, contributions, 0.0).sum(axis=0).min())
    return -np.array(least)


def measure_perturbation_loss(log: Log, scans: Sequence[Scan]) -> np.ndarray:
    """Return minus the mean increase of the ends' distances from walls if the scan moves.

    It moves by `STEPS` in eight directions, and the direction with the least increase counts. The
    idea is that of LF-3PM (Chai, Xu, Wang, Xu, Yin and Gao, IROS 2024).
    """
    distances = distance_transform_edt(log.grid.cells != OCCUPIED) * log.grid.resolution
    angles = np.arange(8) * np.pi / 4
    moves = [(r * np.sin(a), r * np.cos(a)) for r in STEPS for a in angles]
    losses = []
    for scan in scans:
        ends = np.array([scan.rows, scan.cols])[:, None] - 0.5
        moved = ends + np.array(moves).T[:, :, None] / log.grid.resolution
        increase = read_at(distances, moved) - read_at(distances, ends)
        by_direction = increase.reshape(len(STEPS), len(angles), -1)
        losses.append(by_direction.mean(axis=(0, 2)).min() if increase.size else 0.0)
    return -np.array(losses)


def measure_clearance(log: Log, scans: Sequence[Scan]) -> np.ndarray:
    """Return the distance to the nearest wall [m]."""
    grid = log.grid
    cells = np.array([grid.cell((x, y)) for x, y, _ in log.poses])
    return grid.clearance[tuple(cells.T)]


def read_at(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Read values of a grid between its cells, by linear interpolation."""
    return map_coordinates(values, places, order=1, mode="nearest")


MEASURES: dict[str, Callable[[Log, Sequence[Scan]], np.ndarray]] = {
    "perturbation loss": measure_perturbation_loss,
    "degeneracy factor": measure_degeneracy_factor,
    "X-ICP": measure_contributions,
    "clearance": measure_clearance,
}


def describe(rows: Sequence[Row]) -> str:
    """Describe the last ranks of some rows in a line."""
    ranks = [row for row in rows if row["quantity"] == "rank"][-2:]
    return ", ".join(f"{row['log']} {row['value']:.3f}" for row in ranks)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])

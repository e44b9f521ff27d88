"""How well the estimators rank the uncertainty of real lasers, from logs with a reference.

Run: python examples/lasers.py DATA [FOLDER]

DATA holds carmen/NAME-corrected.log.gz, a recorded drive; carmen/localizability_NAME.csv, the
reference: one row per scan, matched on a map of the other scans; and rosmaps_carmen/NAME_even, that
map. The lowest tenth by score of each log is left out: people, or places that are not on the map.
Each field has 8 headings, and is computed near the poses of the reference.
"""

from __future__ import annotations

import csv
import itertools
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

import locplan
from locplan.field import position_axes, scalar
from locplan.recordings import read_recording

LEAST = 0.05
"""Range above which beams count as returns in the reference [m]."""
RETURNS = {"intel": 30.0, "orebro": 30.0}
"""Range up to which beams count as returns in the reference [m]; 40 in the other logs."""
LEFT_OUT = 0.1
CLASSES = 0.0, 0.08, 0.12, 0.2, 0.4, 1.0
"""Bounds of the measured deviations between which predictions are compared in metres [m]."""
LARGE = 0.2
"""Measured deviation above which a prediction in metres matters most [m]."""
ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""


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
    def elongated(self) -> np.ndarray:
        """Mask of the poses at which the measured ellipse has a direction."""
        return self.measured["sd_major"] > ELONGATED * self.measured["sd_minor"]


def main(data: str, folder: str = "lasers") -> None:
    logs = read_logs(Path(data))
    if not logs:
        sys.exit(f"{data}: holds no carmen/localizability_NAME.csv")
    lines = ["| estimator | " + " | ".join(logs) + " | pooled / within | heading | < 15° | in m |"]
    lines.append("|---" * (len(logs) + 5) + "|")
    classes = [f"{low:g}-{high:g} m" for low, high in itertools.pairwise(CLASSES)]
    metres = ["| estimator | " + " | ".join(classes) + f" | right above {LARGE:g} m |"]
    metres.append("|---" * (len(classes) + 2) + "|")
    for name in ("sad", "fisher", "scan", "fused"):
        predicted = {each: predict(log, name) for each, log in logs.items()}
        lines.append(row(name, logs, predicted))
        metres.append(row_of_metres(name, logs, predicted))
        print(lines[-1], metres[-1], sep="\n", flush=True)
    target = Path(folder) / "lasers.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join([*lines, "", *metres]) + "\n", encoding="utf-8")
    print(f"wrote {target}")


def read_logs(data: Path) -> dict[str, Log]:
    """All logs with a reference, by name."""
    files = sorted((data / "carmen").glob("localizability_*.csv"))
    return {file.stem.removeprefix("localizability_"): read(file) for file in files}


def read(file: Path) -> Log:
    """The reference in a file, without the scans that match worst."""
    name = file.stem.removeprefix("localizability_")
    with file.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    column = {key: np.array([float(each[key]) for each in rows]) for key in rows[0]}
    kept = column["score_per_beam"] >= np.quantile(column["score_per_beam"], LEFT_OUT)
    limits = LEAST, RETURNS.get(name, 40.0)
    return Log(
        locplan.load_map(file.parent.parent / "rosmaps_carmen" / f"{name}_even"),
        read_recording(file.parent / f"{name}-corrected.log.gz", range_limits=limits).lidar,
        {key: values[kept] for key, values in column.items()},
    )


def predict(log: Log, name: str) -> np.ndarray:
    """Covariances at the poses of a log, (n, 3, 3)."""
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


def row(name: str, logs: dict[str, Log], predicted: dict[str, np.ndarray]) -> str:
    """The ranks of one estimator as a row of a table."""
    criterion = "e" if name == "sad" else "position_std"
    values = {each: scalar(found, criterion) for each, found in predicted.items()}
    measured = {each: log.measured["sd_major"] for each, log in logs.items()}
    turns = {each: log.measured["sd_theta_deg"] for each, log in logs.items()}
    each = [rank(values[log], measured[log]) for log in logs]
    headings = {log: scalar(found, "heading_std") for log, found in predicted.items()}
    of_headings = [rank(headings[log], turns[log]) for log in logs]
    pooled = rank(together(values), together(measured))
    turned = rank(together(headings), together(turns))
    off, metres = [], []
    for log, found in predicted.items():
        major, _, direction = position_axes(found)
        apart = angle_between(direction, logs[log].measured["major_dir"])
        off.append(apart[logs[log].elongated])
        metres.append(np.log(major / measured[log]))
    right = np.mean(np.concatenate(off) < math.radians(15.0))
    factor = np.exp(np.nanmean(np.concatenate(metres)))
    cells = [f"{name}, {criterion}", *map(plain, each)]
    cells += [f"{plain(pooled)} / {plain(np.mean(each))}"]
    cells += [f"{plain(turned)} / {plain(np.mean(of_headings))}", f"{right:.0%}", f"{factor:.2f}"]
    return "| " + " | ".join(cells) + " |"


def row_of_metres(name: str, logs: dict[str, Log], predicted: dict[str, np.ndarray]) -> str:
    """Predicted over measured deviation of one estimator by measured class, as a row of a table.

    The last column is the share within a factor of 1.5, of the poses with a large deviation.
    """
    measured = together({each: log.measured["sd_major"] for each, log in logs.items()})
    ratios = scalar(together(predicted), "position_std") / measured
    large = ratios[(measured > LARGE) & np.isfinite(ratios)]
    right = np.mean(np.abs(np.log(large)) < math.log(1.5))
    cells = [f"{name}, position_std", *(f"{each:.2f}" for each in by_class(measured, ratios))]
    return "| " + " | ".join([*cells, f"{right:.0%}"]) + " |"


def by_class(measured: np.ndarray, ratios: np.ndarray) -> list[float]:
    """Geometric mean of ratios between the bounds of each class of measured deviations."""
    return [
        float(np.exp(np.nanmean(np.log(ratios[(low <= measured) & (measured < high)]))))
        for low, high in itertools.pairwise(CLASSES)
    ]


def rank(predicted: np.ndarray, measured: np.ndarray) -> float:
    """Spearman's coefficient where both are known."""
    known = np.isfinite(predicted)
    return float(spearmanr(predicted[known], measured[known])[0])


def together(values: dict[str, np.ndarray]) -> np.ndarray:
    return np.concatenate(list(values.values()))


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angle between two axes, 0 to pi / 2 [rad]."""
    return np.abs((one - other + np.pi / 2) % np.pi - np.pi / 2)


def plain(value: float) -> str:
    return f"{value:.3f}".replace("0.", ".", 1)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])

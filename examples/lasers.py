"""How well the estimators rank the uncertainty of real lasers, from logs with a reference.

Run: python examples/lasers.py DATA [FOLDER]

DATA holds carmen/localizability_NAME.csv, the reference: one row per scan, matched on a map of the
other scans; and rosmaps_carmen/NAME_even, that map. The lowest tenth by score of each log is left
out: people, or places that are not on the map. Each field has 8 headings and is read at the poses
of the reference.
"""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

import locplan
from locplan.field import position_axes, scalar

RETURNS = {"intel": 30.0, "orebro": 30.0}
"""Range up to which beams count as returns in the reference [m]; 40 in the other logs."""
BEAMS = {"csail": 361, "seattle": 361}
"""Number of beams of the lasers; 181 in the other logs."""
LEFT_OUT = 0.1
ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""


class Log(NamedTuple):
    """The reference of a log at n poses, and the map to predict it on."""

    grid: locplan.OccupancyGrid
    lidar: locplan.Lidar
    poses: np.ndarray  # (n, 3) x, y [m], heading [rad]
    major: np.ndarray  # (n,) measured deviation along the ellipse's major axis [m]
    ratio: np.ndarray  # (n,) of the major to the minor deviation
    direction: np.ndarray  # (n,) of the major axis [rad]
    heading: np.ndarray  # (n,) measured deviation of the heading [deg]


def main(data: str, folder: str = "lasers") -> None:
    logs = {
        file.stem.removeprefix("localizability_"): read(file)
        for file in sorted((Path(data) / "carmen").glob("localizability_*.csv"))
    }
    if not logs:
        sys.exit(f"{data}: holds no carmen/localizability_NAME.csv")
    lines = ["| estimator | " + " | ".join(logs) + " | pooled / within | heading | < 15° | in m |"]
    lines.append("|---" * (len(logs) + 5) + "|")
    for name in ("sad", "fisher", "scan", "fused"):
        predicted = {each: predict(log, name) for each, log in logs.items()}
        lines.append(row(name, logs, predicted))
        print(lines[-1], flush=True)
    target = Path(folder) / "lasers.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"wrote {target}")


def read(file: Path) -> Log:
    """The reference in a file, without the scans that match worst."""
    name = file.stem.removeprefix("localizability_")
    with file.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    column = {key: np.array([float(each[key]) for each in rows]) for key in rows[0]}
    kept = column["score_per_beam"] >= np.quantile(column["score_per_beam"], LEFT_OUT)
    column = {key: values[kept] for key, values in column.items()}
    lidar = locplan.Lidar(
        range=RETURNS.get(name, 40.0),
        least_range=0.05,
        field_of_view_deg=180.0,
        beams=BEAMS.get(name, 181),
    )
    return Log(
        locplan.load_map(file.parent.parent / "rosmaps_carmen" / f"{name}_even"),
        lidar,
        np.column_stack([column[key] for key in ("x", "y", "theta")]),
        column["sd_major"],
        column["sd_major"] / column["sd_minor"],
        column["major_dir"],
        column["sd_theta_deg"],
    )


def predict(log: Log, name: str) -> np.ndarray:
    """Covariances at the poses of a log, (n, 3, 3)."""
    estimator = {
        "sad": locplan.Sad(),
        "fisher": locplan.Fisher(log.lidar),
        "scan": locplan.Scan(log.lidar),
        "fused": locplan.Fused.of(log.lidar),
    }[name]
    field = locplan.load_or_compute(log.grid, estimator)
    return np.array([field.at(x, y, heading) for x, y, heading in log.poses])


def row(name: str, logs: dict[str, Log], predicted: dict[str, np.ndarray]) -> str:
    """The ranks of one estimator as a row of a table."""
    criterion = "e" if name == "sad" else "position_std"
    values = {each: scalar(found, criterion) for each, found in predicted.items()}
    each = [rank(values[log], logs[log].major) for log in logs]
    headings = {log: scalar(found, "heading_std") for log, found in predicted.items()}
    of_headings = [rank(headings[log], logs[log].heading) for log in logs]
    pooled = rank(together(values), np.concatenate([log.major for log in logs.values()]))
    turned = rank(together(headings), np.concatenate([log.heading for log in logs.values()]))
    off, metres = [], []
    for log, found in predicted.items():
        major, _, direction = position_axes(found)
        off.append(angle_between(direction, logs[log].direction)[logs[log].ratio > ELONGATED])
        metres.append(np.log(major / logs[log].major))
    right = np.mean(np.concatenate(off) < math.radians(15.0))
    factor = np.exp(np.nanmean(np.concatenate(metres)))
    cells = [f"{name}, {criterion}", *map(plain, each)]
    cells += [f"{plain(pooled)} / {plain(np.mean(each))}"]
    cells += [f"{plain(turned)} / {plain(np.mean(of_headings))}", f"{right:.0%}", f"{factor:.2f}"]
    return "| " + " | ".join(cells) + " |"


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

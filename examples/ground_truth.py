"""Compare the ground truth of `recording`, and the places of `locate`, with corrected poses.

Run: python examples/ground_truth.py DATA [FOLDER]

DATA is the folder that lasers.py describes. The odd scans of each log are smoothed on the map of
the even scans, and the even scans on the map of the odd ones. The start is not known. Every few
scans, one is located by itself. Errors are differences from the poses of the SLAM that made the
maps. Takes minutes.

Writes FOLDER/ground_truth.csv and FOLDER/locate.csv, one row for each log.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from evidence import find_version, read_rows, write_rows
from lasers import MAX_RANGES, MIN_RANGE
from scipy.stats import chi2

import locplan
from locplan.recordings import Recording, read_recording
from locplan.recordings.location import locate_drive
from locplan.recordings.smoothing import smooth

LOGS = ("aces", "csail", "fhw", "intel", "seattle")
HALVES = {"odd": ("even", 1), "even": ("odd", 0)}
"""The scans of a log, with the other half, which made the map, and the first scan."""
N_LOCATED = 100
"""Number of scans of a log that are located."""
Row = dict[str, Any]


def main(data: str, folder: str = "ground_truth", logs: Sequence[str] = LOGS) -> None:
    """Smooth both halves of each log, and locate single scans."""
    target = Path(folder)
    for log in logs:
        limits = MIN_RANGE, MAX_RANGES.get(log, 40.0)
        file = Path(data) / "carmen" / f"{log}-corrected.log.gz"
        recording = read_recording(file, range_limits=limits)
        for half, (other, first) in HALVES.items():
            grid = locplan.load_map(Path(data) / "rosmaps_carmen" / f"{log}_{other}")
            scans = recording[first::2]
            for name, measure in (("ground_truth", measure_truth), ("locate", measure_places)):
                rows = read_rows(name, target)
                if any((row["log"], row["scans"]) == (log, half) for row in rows):
                    continue
                row = {"log": log, "scans": half, **measure(scans, grid)}
                write_rows(target / f"{name}.csv", [*rows, {**row, "version": find_version()}])
                print(row, flush=True)
    print(f"wrote {target / 'ground_truth.csv'}, {target / 'locate.csv'}")


def measure_truth(recording: Recording, grid: locplan.OccupancyGrid) -> Row:
    """Compare smoothed poses with the poses of the log."""
    trajectory = smooth(grid, recording)
    errors = trajectory.poses - recording.poses
    errors[:, 2] = (errors[:, 2] + np.pi) % (2 * np.pi) - np.pi
    distances = np.hypot(errors[:, 0], errors[:, 1])
    scaled = np.linalg.solve(trajectory.covariances[:, :2, :2], errors[:, :2, None])[..., 0]
    is_inside = (scaled * errors[:, :2]).sum(axis=1) < chi2.ppf(0.95, 2)
    is_trusted = trajectory.is_trusted
    median, high, most = np.quantile(distances[is_trusted], (0.5, 0.95, 1.0)).tolist()
    return {
        "count": len(errors),
        "median": median,
        "p95": high,
        "most": most,
        "heading_median_deg": float(np.degrees(np.median(np.abs(errors[is_trusted, 2])))),
        "inside_95": float(is_inside[is_trusted].mean()),
        "doubtful": float(1.0 - is_trusted.mean()),
    }


def measure_places(recording: Recording, grid: locplan.OccupancyGrid) -> Row:
    """Locate single scans, and compare their places with the poses of the log."""
    located = locate_drive(recording.subsample(max(1, len(recording.poses) // N_LOCATED)), grid)
    return {
        "count": len(located),
        "right": int(located.is_right.sum()),
        "certain": int(located.is_certain.sum()),
        "certain_right": int((located.is_certain & located.is_right).sum()),
    }


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:3])

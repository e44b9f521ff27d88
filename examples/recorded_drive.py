"""Evaluate a recorded drive: where the robot localizes badly, and which path is better.

Run: python examples/recorded_drive.py [FOLDER [MAP.yaml DRIVE]]

DRIVE is a bag of ROS 1 or 2, a CARMEN log, or an .npz file. Without one, the built-in recording of
two_corridors is read.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

import locplan
from locplan.planning import Path as Route, path_metrics
from locplan.recordings import evaluate_drive, fit_to_map, read_recording

LEG = 25.0
"""Distance along the drive between the places that new paths join [m]."""


def main(folder: str = "recorded", map_file: str | None = None, file: str | None = None) -> None:
    grid = locplan.load_map(map_file or "two_corridors")
    drive = read_recording(file or "two_corridors")
    print(drive.report())
    print(fit_to_map(drive, grid).sentence)

    evaluation = evaluate_drive(drive.subsample(max(1, len(drive) // 200)), grid)
    for sentence in evaluation.verdict:
        print(sentence)

    field = locplan.load_or_compute(grid, locplan.Fused(drive.lidar))
    costs = locplan.Costmap.from_field(field)
    driven = path_metrics(costs, Route(drive.poses[:, :2]))
    print(f"driven: {driven.length:.1f} m, {driven.integrated_u:.1f} degenerate metres")
    places = [drive.poses[n, :2].tolist() for n in pick_scans(drive)]
    plans = [locplan.plan(costs, *ends) for ends in pairwise(places)]
    plan_metrics = [plan.metrics for plan in plans if plan.metrics is not None]
    length = sum(metrics.length for metrics in plan_metrics)
    degenerate = sum(metrics.integrated_u for metrics in plan_metrics)
    print(f"by aware paths over places {LEG:.0f} m apart: {length:.1f} m, {degenerate:.1f} of them")

    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    drive.save(target / "drive.npz")
    evaluation.figure().savefig(target / "drive.png", dpi=130)
    print(f"wrote {target / 'drive.npz'}, {target / 'drive.png'}")


def pick_scans(drive: locplan.recordings.Recording) -> list[int]:
    """Return the indices of scans about `LEG` apart, from the first to the last."""
    distance = np.concatenate([[0.0], np.hypot(*np.diff(drive.poses[:, :2], axis=0).T).cumsum()])
    legs = max(1, round(distance[-1] / LEG))
    return np.searchsorted(distance, np.linspace(0, distance[-1], legs + 1)).tolist()


if __name__ == "__main__":
    main(*sys.argv[1:])

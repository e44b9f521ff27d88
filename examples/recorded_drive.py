"""What a recorded drive says: where the robot is badly localized, and which way is better.

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
"""Length of way between the places that better paths lead over [m]."""


def main(folder: str = "recorded", map_file: str | None = None, file: str | None = None) -> None:
    grid = locplan.load_map(map_file or "two_corridors")
    drive = read_recording(file or "two_corridors")
    print(drive.report())
    print(fit_to_map(drive, grid).sentence)

    found = evaluate_drive(drive.subsample(max(1, len(drive) // 200)), grid)
    for sentence in found.verdict:
        print(sentence)

    field = locplan.load_or_compute(grid, locplan.Fused(drive.lidar))
    costs = locplan.Costmap.from_field(field)
    driven = path_metrics(costs, Route(drive.poses[:, :2]))
    print(f"driven: {driven.length:.1f} m, {driven.integrated_u:.1f} degenerate metres")
    places = [drive.poses[n, :2].tolist() for n in between(drive)]
    plans = [locplan.plan(costs, *ends) for ends in pairwise(places)]
    found_all = [each.metrics for each in plans if each.metrics is not None]
    length = sum(each.length for each in found_all)
    degenerate = sum(each.integrated_u for each in found_all)
    print(f"by aware paths over places {LEG:.0f} m apart: {length:.1f} m, {degenerate:.1f} of them")

    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    drive.save(target / "drive.npz")
    found.figure().savefig(target / "drive.png", dpi=130)
    print(f"wrote {target / 'drive.npz'}, {target / 'drive.png'}")


def between(drive: locplan.recordings.Recording) -> list[int]:
    """Scans about every `LEG` of the way, the first and the last among them."""
    way = np.concatenate([[0.0], np.hypot(*np.diff(drive.poses[:, :2], axis=0).T).cumsum()])
    legs = max(1, round(way[-1] / LEG))
    return np.searchsorted(way, np.linspace(0, way[-1], legs + 1)).tolist()


if __name__ == "__main__":
    main(*sys.argv[1:])

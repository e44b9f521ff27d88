"""Compare `locate` with a plain search over all places and headings.

pytest tests/benchmarks/bench_locate.py --benchmark-only -s
"""

from __future__ import annotations

import time

import numpy as np
from numba import njit

import locplan
from locplan.recordings.kernels.scan_losses import compute_loss_at_pose, refine_pose
from locplan.recordings.matching import STEP, TURNS, ScanOnMap

LIDAR = locplan.Lidar(range=12.0, beams=360)
SCANS = 12
TARGET = 0.5
"""Greatest time of a scan, with the database built [s]."""


@njit(cache=True)
def losses_everywhere(tables, ends, positions, turns, step):
    """Loss of each place at each turn with the widest deviation."""
    losses = np.empty((len(positions), turns))
    for n in range(len(positions)):
        for k in range(turns):
            losses[n, k] = compute_loss_at_pose(
                tables, 0, ends, positions[n, 0], positions[n, 1], k * step
            )
    return losses


def everywhere(places, ranges, best_of=300):
    """Pose of least loss: all places and turns are scored, and the best of them refined."""
    scan = ScanOnMap(places, ranges)
    ends, lever = scan.ends, scan.turn_lever
    losses = losses_everywhere(places.tables, ends, places.positions, TURNS, STEP)
    place, turn = np.divmod(np.argsort(losses, axis=None)[:best_of], TURNS)
    poses = np.column_stack([places.positions[place], turn * STEP])
    least = []
    for pose in poses:
        for level in range(len(places.tables.corners)):
            loss = refine_pose(places.tables, level, ends, lever, pose)
        least.append(loss)
    return poses[int(np.argmin(least))]


def test_a_scan_on_a_map_of_940_by_620_cells(benchmark):
    """One scan after the other on the office, at places that the lidar tells apart."""
    grid = locplan.maps.environments.make("office", resolution=0.05)
    database = locplan.recordings.matching.ScanDatabase(grid, LIDAR)
    began = time.process_time()
    places = database.full_database
    built = time.process_time() - began
    random = np.random.default_rng(3)
    at = places.positions[random.integers(len(places.positions), size=SCANS)]
    homes = np.column_stack([at, random.uniform(-3, 3, SCANS)])
    compared = places.simulate_scans(homes)
    beams = np.rint((LIDAR.angles % (2 * np.pi)) / STEP).astype(int) % TURNS
    scans = compared[:, beams]
    found = [locplan.locate(grid, scan, LIDAR, database=database) for scan in scans]
    certain = [n for n in range(SCANS) if found[n].is_certain]
    assert len(certain) >= SCANS / 3
    ours, theirs = [], []
    for n in certain:
        began = time.process_time()
        locplan.locate(grid, scans[n], LIDAR, database=database)
        ours.append(time.process_time() - began)
        began = time.process_time()
        pose = places.convert_to_world(everywhere(places, compared[n])[None])[0]
        theirs.append(time.process_time() - began)
        assert np.hypot(*(pose[:2] - found[n].best.pose[:2])) < 0.2
    benchmark.pedantic(
        lambda: locplan.locate(grid, scans[certain[0]], LIDAR, database=database),
        rounds=5,
        warmup_rounds=1,
    )
    ratio = float(np.median(theirs) / np.median(ours))
    benchmark.extra_info.update(
        ratio_to_the_loss_of_every_pose=ratio, places=len(places.positions), built_s=built
    )
    print(
        f"\n{len(places.positions)} places built in {built:.2f} s; a scan {np.median(ours):.3f} s"
        f" (at most {TARGET}), {ratio:.1f} times as fast as the loss of every pose"
    )

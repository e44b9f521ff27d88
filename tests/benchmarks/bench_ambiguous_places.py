"""Time the search for ambiguous places, and compare its shortlist with NumPy.

The map has 1000 x 1000 cells.
"""

from __future__ import annotations

import time

import numpy as np

from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.recordings.ambiguous_places import find_ambiguous_places
from locplan.recordings.kernels.matches import find_best_place_turn_pairs
from locplan.recordings.matching import TURNS, ScanDatabase
from locplan.robots import Lidar, Robot

CAP = 8
SIZE = 1000
SPACING = 4.8


def cluttered() -> OccupancyGrid:
    """A map of 50 m x 50 m with 120 blocks."""
    cells = np.full((SIZE, SIZE), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    random = np.random.default_rng(3)
    for _ in range(120):
        top, left = random.integers(10, SIZE - 60, 2)
        height, width = random.integers(8, 50, 2)
        cells[top : top + height, left : left + width] = OCCUPIED
    return OccupancyGrid(cells, 0.05)


def summed_gaps(codes, scan):
    """Sums of the gaps of all places at all turns, (places, TURNS), by NumPy."""
    sums = np.empty((len(codes), TURNS), np.uint16)
    for turn in range(TURNS):
        apart = np.roll(codes, -turn, axis=1) - scan
        gaps = np.minimum(np.minimum(apart, -apart), CAP)
        sums[:, turn] = gaps.sum(axis=1, dtype=np.uint16)
    return sums


def test_a_place_of_a_thousand_by_a_thousand_cells(benchmark):
    """CPU time of a place; the shortlist's peer computes the same sums by NumPy."""
    grid = cluttered()
    robot = Robot(Lidar.preset("rplidar-a1"))
    kept = ScanDatabase(grid, robot.lidar, robot.radius)
    database = kept.full_database
    ranges = database.simulate_scans(np.array([[*database.positions[0], 0.0]]))

    def every():
        return find_ambiguous_places(grid, robot, spacing=SPACING, threads=1)

    places = every().places
    took = []
    for _ in range(3):
        began = time.process_time()
        every()
        took.append((time.process_time() - began) / len(places))
    benchmark.pedantic(every, rounds=1)
    blocks = database.codes.reshape(-1, 2 * TURNS, 64)[:, :TURNS]
    codes = blocks.transpose(0, 2, 1).reshape(-1, TURNS)[: len(database.positions)]
    scan, beams = database.encode_ranges(ranges)[0], np.arange(TURNS)
    ours, theirs = [], []
    for _ in range(3):
        began = time.process_time()
        scores, where = find_best_place_turn_pairs(
            database.codes, len(codes), beams, scan, CAP, 600
        )
        ours.append(time.process_time() - began)
        began = time.process_time()
        sums = summed_gaps(codes, scan)
        theirs.append(time.process_time() - began)
    np.testing.assert_array_equal(scores, sums.ravel()[where])
    benchmark.extra_info["places"] = len(places)
    benchmark.extra_info["ms_a_place"] = 1000 * min(took)
    benchmark.extra_info["ratio_to_numpy"] = min(theirs) / min(ours)
    print(
        f"\n{len(codes)} places in the database, {1000 * min(took):.2f} ms of CPU a place;"
        f" shortlist {min(theirs) / min(ours):.0f} times as fast as NumPy"
    )

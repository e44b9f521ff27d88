"""Matching of scans with a whole map: the database, the modes and the losses."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases
from support.maps import random_rooms
from support.rooms import GAP_CELLS, LIDAR, ROOM_CELLS, join_rooms, room_cells, two_rooms

from locplan import LocplanError
from locplan._support.kernels.lidar import LidarBeams as Beams
from locplan._support.kernels.rays import compute_empty_squares
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.recordings.kernels import matches as lists, scan_losses as losses
from locplan.recordings.matching import (
    TURNS,
    MatchingSettings,
    ScanOnMap,
    make_range_database,
    select_spaced_places,
)
from locplan.robots import Lidar


def test_partial_view_has_unseen_beams():
    matching = MatchingSettings(lidar=Lidar(range=8.0, field_of_view_deg=90.0, mount_yaw_deg=90.0))
    seen = np.degrees(matching.bearings[matching.is_in_view])
    assert (seen.min(), seen.max()) == pytest.approx((45.0, 135.0))
    database = make_range_database(join_rooms(room_cells()), matching)
    (scan,) = database.simulate_scans(np.array([[20.5, 30.5, 0.0]]))
    assert np.isnan(scan[~matching.is_in_view]).all()
    assert not np.isnan(scan[matching.is_in_view]).any()


def test_measured_ranges_keep_their_bearings():
    lidar = Lidar(range=8.0, min_range=0.5, beams=720, field_of_view_deg=180.0)
    measured = 1.0 + lidar.angles + math.pi / 2  # each beam knows its angle
    measured[:3], measured[-3:] = 0.1, 9.0
    (scan,) = MatchingSettings(lidar=lidar).select_ranges(measured[None])
    bearings = (MatchingSettings(lidar=lidar).bearings + math.pi) % (2 * math.pi) - math.pi
    finite = np.isfinite(scan)
    apart = np.abs(scan[finite] - 1.0 - math.pi / 2 - bearings[finite])
    assert apart.max() <= math.radians(180 / 719)
    assert np.isnan(scan).sum() == 96 - 49
    assert np.isinf(scan).sum() == 2


def test_scan_modes_include_both_rooms():
    database = make_range_database(two_rooms(), MatchingSettings(lidar=LIDAR))
    home = np.array([[15.5, 30.5, 1.1]])
    scans = database.simulate_scans(home)
    found = ScanOnMap(database, scans[0]).find_modes()
    assert found.losses[0] <= found.losses[1]
    at = {tuple(np.round(pose[:2] - home[0, :2]).astype(int)) for pose in found.poses[:2]}
    assert at == {(0, 0), (ROOM_CELLS + GAP_CELLS, 0)}
    assert ScanOnMap(database, np.full(96, np.inf)).find_modes().poses.shape == (0, 3)


def test_spaced_places_are_unique_per_square():
    fits = np.zeros((8, 9), bool)
    fits[1, 2] = fits[2, 2] = fits[6, 7] = True
    assert select_spaced_places(0.4, fits, 0.1).tolist() == [[2.5, 1.5], [7.5, 6.5]]


def test_spaced_places_equal_plain_loops(monkeypatch):
    """The height of the bands must not change the places."""
    fits = np.random.default_rng(4).random((61, 47)) < 0.3
    monkeypatch.setattr("locplan.recordings.matching.BAND", 10**6)
    whole = select_spaced_places(0.5, fits, 0.1)
    expected = {}  # the cell next to the middle of each square, the first one in order of rows
    for row, col in np.argwhere(fits).tolist():
        aside = (row % 5 - 2) ** 2 + (col % 5 - 2) ** 2
        square = expected.setdefault((row // 5, col // 5), (aside, row, col))
        expected[row // 5, col // 5] = min(square, (aside, row, col))
    assert whole.tolist() == [[c + 0.5, r + 0.5] for _, (_, r, c) in sorted(expected.items())]
    monkeypatch.setattr("locplan.recordings.matching.BAND", 600)
    np.testing.assert_array_equal(select_spaced_places(0.5, fits, 0.1), whole)


@pytest.mark.parametrize("band", sample_cases([1000, 1, 10**6]))
@pytest.mark.parametrize("settings", [{}, {"sigma_hit": 0.02}, {"z_rand": 0.6, "sigma_hit": 0.3}])
def test_loss_tables_equal_plain_loops(monkeypatch, band, settings):
    """The height of the bands must not change the losses."""
    monkeypatch.setattr("locplan.recordings.matching.BAND", band)
    cells = np.where(np.random.default_rng(5).random((70, 40)) < 0.004, OCCUPIED, FREE)
    grid = OccupancyGrid(cells.astype(np.uint8), 0.05)
    matching = MatchingSettings(lidar=LIDAR, **settings)
    made = make_range_database(grid, matching).tables
    expected = oracles.matching.loss_tables(
        grid.cells == OCCUPIED, 0.05, matching.sigmas(0.05), matching.z_rand, made.margin
    )
    np.testing.assert_array_equal(made.corners.reshape(expected.shape), expected)


def test_isolated_free_space_is_unreachable():
    cells = np.full((60, 60), UNKNOWN, np.uint8)
    cells[2:40, 2:40] = FREE
    cells[50:58, 50:58] = FREE
    cells[0] = OCCUPIED
    grid, matching = OccupancyGrid(cells, 0.1), MatchingSettings(lidar=LIDAR, robot_radius=0.0)
    fits = make_range_database(grid, matching).fits
    assert not fits[54, 54]
    assert fits[20, 20]


def test_matching_settings_reject_invalid_values():
    for wrong in ({"z_rand": 1.0}, {"z_rand": 0.0}, {"shortlisted": 0}):
        with pytest.raises(LocplanError, match=next(iter(wrong))):
            MatchingSettings(lidar=LIDAR, **wrong)


def test_cell_size_limits_matching_sigmas():
    assert MatchingSettings(lidar=LIDAR).sigmas(0.05).tolist() == [0.4, 0.2, 0.1]
    assert MatchingSettings(lidar=LIDAR).sigmas(0.2).tolist() == [0.4, 0.2]
    assert MatchingSettings(lidar=LIDAR).sigmas(0.5).tolist() == [0.5]


CAP = 8
"""Difference from which on a beam costs no more."""
FARTHEST = 40
"""Cells that an end may move before its bound is 0."""


def laid_out(codes):
    """Codes (place, beam) as the kernel has them."""
    blocks = -(-len(codes) // 64)
    padded = np.zeros((blocks * 64, TURNS), np.uint8)
    padded[: len(codes)] = codes
    once = padded.reshape(blocks, 64, TURNS).transpose(0, 2, 1)
    return np.concatenate([once, once], axis=1).reshape(-1)


@pytest.mark.parametrize(("places", "beams", "keep"), [(70, 96, 40), (3, 5, 400), (64, 33, 7)])
def test_shortlist_equals_plain_loops(places, beams, keep):
    random = np.random.default_rng(places)
    codes = random.integers(0, 256, (places, TURNS)).astype(np.uint8)
    codes[0] = codes[1]  # equal ones
    chosen = random.permutation(TURNS)[:beams]
    scan = np.roll(codes[0], 5)[chosen]
    scan = (scan + random.integers(0, 3, beams)).astype(np.uint8)  # past 255 and on from 0
    scores, where = lists.find_best_place_turn_pairs(
        laid_out(codes), places, chosen, scan, CAP, keep
    )
    expected = oracles.matching.shortlist(codes, chosen, scan, CAP, keep)
    assert scores.tolist() == [score for score, _ in expected]
    last = scores[-1]
    sure = scores < last  # of equal ones at the end any may be kept
    assert where[sure].tolist() == [at for score, at in expected if score < last]


def test_cast_ranges_equal_plain_loops():
    random = np.random.default_rng(2)
    stops = random.random((14, 17)) < 0.15
    lidar = Beams(np.linspace(-2, 2, 7), 0.3, -0.2, 0.4, 0.03, 0.2, 1.6)
    poses = np.column_stack(
        [random.uniform(3, 10, 12), random.uniform(3, 13, 12), random.uniform(-3, 3, 12)]
    )
    ranges = np.empty((12, 7))
    lists.cast_ranges(compute_empty_squares(stops), 0.2, poses, lidar, ranges)
    expected = oracles.matching.ranges_from(stops, 0.2, poses, lidar)
    inside = expected > 0.2
    np.testing.assert_allclose(ranges[inside], expected[inside], atol=1e-6)
    assert np.isfinite(ranges).any()
    assert np.isinf(ranges).any()


class Table:
    """A table of random losses, in the kernel's form and as it is."""

    def __init__(self, seed, shape=(30, 24), margin=3):
        random = np.random.default_rng(seed)
        smooth = np.add.outer(np.arange(shape[0]) ** 2, np.arange(shape[1]) * 3.0) % 97
        self.values = np.rint(smooth + random.uniform(0, 40, shape)).astype(np.uint32)
        padded = np.pad(self.values, (0, 1), constant_values=losses.TOP)
        parts = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
        word = sum(part << (8 * n) for n, part in enumerate(parts)).astype(np.uint32)
        self.margin = margin
        rows, cols = shape[0] - 2 * margin, shape[1] - 2 * margin
        self.free = (random.random((rows, cols)) < 0.9).astype(np.uint8)
        self.tables = losses.LossTables(
            np.array([word.ravel()]), self.free, margin, shape[1], shape[0],
            np.array([[1.0, 0.5, 0.0]]),
        )  # fmt: skip
        self.ends = random.uniform(-8, 8, (2, 11)).astype(np.float32)

    def loss(self, x, y, heading):
        return losses.compute_loss_at_pose(self.tables, 0, self.ends, x, y, heading)

    def fits(self, x, y):
        return losses.can_robot_stand_at(self.tables, x, y)


@pytest.mark.parametrize("seed", range(4))
def test_pose_losses_equal_plain_loops(seed):
    table = Table(seed)
    for x, y, heading in np.random.default_rng(seed).uniform(-3, 20, (20, 3)):
        expected = oracles.matching.loss_at(table.values, table.margin, table.ends, x, y, heading)
        # Ends are rounded down to 1/256 of a cell, and losses differ by up to 140 between cells.
        assert table.loss(x, y, heading) == pytest.approx(expected, abs=11 * 140 * 2 / 256)


def test_robot_stands_only_in_mask():
    table = Table(1)
    rows, cols = table.free.shape
    for x, y in np.random.default_rng(1).uniform(-2, 28, (200, 2)):
        row, col = math.floor(y), math.floor(x)
        inside = 0 <= row < rows and 0 <= col < cols
        assert table.fits(x, y) == (inside and table.free[row, col] == 1)


@pytest.mark.parametrize("seed", range(6))
def test_refinement_equals_plain_loops(seed):
    table = Table(seed)
    pose = np.array([8.2, 9.4, 0.3 * seed])
    steps, start = table.tables.steps[0], pose.copy()
    best = losses.refine_pose(table.tables, 0, table.ends, 6.0, pose)
    expected, least = oracles.matching.refine(
        table.loss, table.fits, start, steps, 6.0, losses.ROUNDS
    )
    assert best == least
    assert pose.tolist() == expected
    assert best < table.loss(*start)


@pytest.mark.parametrize("seed", range(6))
def test_polishing_equals_plain_loops(seed):
    table = Table(seed)
    pose = np.array([9.2, 8.4, 0.3 * seed])
    steps, start = table.tables.steps[0], pose.copy()
    best = losses.polish_pose(table.tables, table.ends, 6.0, pose)
    expected, least = oracles.matching.polish(
        table.loss, table.fits, start, steps, 6.0, losses.ROUNDS
    )
    assert best == least
    assert pose.tolist() == expected
    assert best < table.loss(*start)


def test_distinct_poses_equal_plain_loops():
    random = np.random.default_rng(4)
    poses = np.column_stack([random.uniform(0, 6, (60, 2)), random.uniform(-9, 9, 60)])
    order = random.permutation(60)
    kept = losses.find_distinct_poses(poses, order, 1.5, 0.8)
    assert kept.tolist() == oracles.matching.unlike(poses, order, 1.5, 0.8)
    assert 1 < len(kept) < 60


def almost_equal_rooms(seed):
    """Two rooms with the same boxes in them, but for a few cells, closed by walls."""
    room = random_rooms((30, 32), seed, blocks=5)
    room[room != OCCUPIED] = FREE
    other = room.copy()
    other[12:15, 20:22] = OCCUPIED
    cells = np.concatenate([room, np.zeros((30, 2), np.uint8), other], axis=1)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1)


@pytest.mark.parametrize("seed", sample_cases([3, 8, 5, 11], 1))
def test_branch_and_bound_confirms_best_mode(seed):
    """Branch and bound over all poses 0.1 m and 3 deg apart finds none with a lower loss."""
    grid = almost_equal_rooms(seed)
    database = make_range_database(grid, MatchingSettings(lidar=Lidar(range=5.0), robot_radius=0.2))
    home = np.array([*database.positions[len(database.positions) // 3], 0.4])
    (ranges,) = database.simulate_scans(home[None])
    scan = ScanOnMap(database, ranges)
    found = scan.find_modes(home)
    away = np.hypot(*(found.poses[:, :2] - home[:2]).T) * grid.resolution > 2.0
    ends = scan.ends.astype(float)
    tables, last = database.tables, len(database.tables.corners) - 1
    values = (tables.corners[last] & 255).reshape(tables.height, tables.width).astype(float)
    reach = np.hypot(*ends)
    # The least loss of all cells within a number of cells is a bound on what an end can cost there.
    around = [np.ones((2 * cells + 1, 2 * cells + 1)) for cells in range(FARTHEST)]
    least = np.array([cv2.erode(values, each) for each in around])

    def bound(middle, half):
        x, y, heading = middle
        cos, sin = math.cos(heading), math.sin(heading)
        u = x + tables.margin - 0.5 + cos * ends[0] - sin * ends[1]
        v = y + tables.margin - 0.5 + sin * ends[0] + cos * ends[1]
        moved = np.ceil(np.maximum(*half[:2]) + reach * half[2]).astype(int) + 1
        col = np.clip(np.floor(u), 0, tables.width - 1).astype(int)
        row = np.clip(np.floor(v), 0, tables.height - 1).astype(int)
        near = moved < FARTHEST
        return float(least[moved[near], row[near], col[near]].sum())

    def fits(x, y):
        far = math.hypot(x - home[0], y - home[1]) * grid.resolution > 2.0
        return far and losses.can_robot_stand_at(tables, x, y)

    def loss(x, y, heading):
        return losses.compute_loss_at_pose(
            tables, last, ScanOnMap(database, ranges).ends, x, y, heading
        )

    rows, cols = grid.shape
    box = [(0.0, cols), (0.0, rows), (-math.pi, math.pi)]
    where, expected = oracles.matching.best_pose(
        bound, loss, fits, box, (1.0, 1.0, math.radians(3.0))
    )
    assert where is not None
    exact = loss(*where) * database.matching.max_loss_nats / losses.TOP
    assert exact < 15  # beyond, modes need not be found
    assert expected > 0
    assert found.losses[away].min() <= exact + 0.05

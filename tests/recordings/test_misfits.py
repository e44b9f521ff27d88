"""Places where recorded scans do not fit the map: false and missing walls, and wrong ranges."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases
from support.machine import SHARED_DATA
from support.small_drive import FILE, MAP

from locplan import Lidar, load_map
from locplan._support.kernels.walls import count_scans
from locplan.errors import RecordingError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, environments
from locplan.recordings import Recording, find_misfits, read_recording
from locplan.recordings.map_fit import fit_ranges


@pytest.fixture(scope="module")
def drive():
    return read_recording(FILE)


@pytest.fixture(scope="module")
def office():
    return load_map(MAP)


def remove_walls(grid, share=0.5, size=20):
    """The map without the walls in a share of its blocks of so many cells."""
    random, cells = np.random.default_rng(0), grid.cells.copy()
    for row in range(0, cells.shape[0], size):
        for col in range(0, cells.shape[1], size):
            block = cells[row : row + size, col : col + size]
            block[(block == OCCUPIED) & (random.random() < share)] = FREE
    return replace(grid, cells=cells)


def add_false_walls(grid, shift=8):
    """The map with its walls drawn again in free space, so many cells to the side."""
    ghosts = (np.roll(grid.cells, shift, axis=1) == OCCUPIED) & (grid.cells == FREE)
    ghosts[:, : grid.shape[1] // 2] = False
    return replace(grid, cells=np.where(ghosts, np.uint8(OCCUPIED), grid.cells))


def add_pose_errors(drive, deviation):
    """The drive with poses that are off by a normal deviation [m]."""
    random, poses = np.random.default_rng(0), drive.poses.copy()
    poses[:, :2] += random.normal(0, deviation / np.sqrt(2), (len(poses), 2))
    return replace(drive, poses=poses)


@pytest.mark.parametrize("seed", range(3))
def test_scan_counts_equal_plain_loops(seed):
    random = np.random.default_rng(seed)
    origins, ends = random.uniform(2, 18, (6, 2)), random.uniform(-4, 26, (6, 9, 2))
    ends[1, 2:5] = np.nan
    ends[2, 0] = origins[2]
    for margin in (0.0, 2.0):
        for stops in (np.zeros((20, 22), bool), random.random((20, 22)) < 0.05):
            counts = count_scans(stops, origins, ends, margin)
            assert np.array_equal(counts, oracles.lines.count_scans(stops, origins, ends, margin))


def test_missing_walls_lie_at_true_walls(office, drive):
    half = remove_walls(office)
    misfits = find_misfits(half, [drive])
    assert misfits.share_at_walls < 0.7
    assert misfits.missing.sum() > 500
    assert (half.cells[misfits.missing] == FREE).all()
    # By up to a cell.
    assert office.cells_near_walls(2 * office.resolution)[misfits.missing].mean() > 0.98


def test_scans_see_through_false_walls(office, drive):
    misfits = find_misfits(add_false_walls(office), [drive])
    assert misfits.false_share > 0.02
    assert misfits.false.sum() > 500
    assert (office.cells[misfits.false] == FREE).mean() > 0.95


def test_misfits_find_visible_false_walls(office, drive):
    """Only false walls out of view may remain."""
    ghosts = add_false_walls(office, shift=40)  # far from the true walls, behind which none is seen
    false = (ghosts.cells == OCCUPIED) & (office.cells == FREE)
    misfits = find_misfits(ghosts, [drive])
    (x, y, turn), ahead = drive.poses.T[:, :, None], drive.ends_on_robot()
    sin, cos = np.sin(turn), np.cos(turn)
    positions = (
        x + cos * ahead[..., 0] - sin * ahead[..., 1],
        y + sin * ahead[..., 0] + cos * ahead[..., 1],
    )
    ends = np.stack(ghosts.world_to_grid(*positions), -1)
    origins = np.stack(ghosts.world_to_grid(*drive.poses.T[:2]), -1)
    # Beams that pass no true wall.
    near_walls = cv2.dilate((office.cells == OCCUPIED).view(np.uint8), np.ones((3, 3))) > 0
    passed, _ = count_scans(near_walls, origins, ends, 2.0)
    visible = false & (passed >= 3)
    assert visible.sum() > 1000
    assert misfits.false[visible].mean() > 0.9
    assert (misfits.false & (office.cells == OCCUPIED)).sum() < 0.03 * misfits.false.sum()


def make_room_with_posts(*posts):
    """A room with posts, the cell of each, and a recording of 13 scans from one place in it.

    Of each post: whether the map has it, numbers of the scans that end at it and that pass it, the
    beam that does, and perhaps how far away it is. The other beams end at the room's walls.
    """
    cells = np.full((80, 80), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    grid, lidar = OccupancyGrid(cells, 0.1), Lidar(range=12.0, beams=72)
    pose, post_cells = np.array([3.05, 3.55, 0.0]), []
    directions = np.stack([np.cos(lidar.angles), np.sin(lidar.angles)])
    wall_distances = (
        np.where(directions > 0, 7.95 - pose[:2, None], 0.05 - pose[:2, None]) / directions
    )
    ranges = np.tile(wall_distances.min(axis=0), (13, 1))
    for drawn, ended, passed, beam, *start in posts:
        distances = np.arange(0.0, 0.3, 0.01) + (start or [1.4])[0]
        positions = (pose[:2, None] + distances * directions[:, [beam]]) / 0.1
        best = np.abs(positions % 1 - 0.5).max(axis=0).argmin()
        col, row = positions[:, best].astype(int)
        cells[row, col] = OCCUPIED if drawn else FREE
        ranges[:ended, beam] = distances[best]
        ranges[ended + passed :, beam] = np.inf
        post_cells.append((row, col))
    grid = replace(grid, cells=cells)
    return grid, tuple(np.transpose(post_cells)), Recording(ranges, lidar, np.tile(pose, (13, 1)))


def test_false_wall_needs_mostly_passing_scans():
    """Over three times as many scans must pass the wall as end at it."""
    posts = [(True, 2, 7, 3), (True, 2, 6, 9), (True, 3, 9, 15), (True, 0, 3, 21), (True, 0, 2, 27)]
    grid, where, drive = make_room_with_posts(*posts)
    assert find_misfits(grid, [drive]).false[where].tolist() == [True, False, False, True, False]


def test_missing_wall_needs_three_ending_scans():
    """If over three times as many scans pass, no wall is missing."""
    posts = [(False, 3, 9, 3), (False, 2, 0, 9), (False, 2, 7, 15), (False, 3, 0, 21)]
    grid, where, drive = make_room_with_posts(*posts, (False, 3, 10, 27))
    assert find_misfits(grid, [drive]).missing[where].tolist() == [True, False, False, True, False]


def test_false_wall_includes_diagonal_neighbour():
    grid, where, drive = make_room_with_posts((True, 0, 3, 45), (True, 0, 1, 46))
    assert np.abs(np.diff(where)).ravel().tolist() == [1, 1]
    assert find_misfits(grid, [drive]).false[where].all()


def test_missing_walls_block_beams():
    grid, where, drive = make_room_with_posts((False, 3, 9, 15), (True, 0, 12, 15, 2.4))
    assert not find_misfits(grid, [drive]).false[where].any()


def test_missing_wall_excludes_wall_neighbours():
    """A neighbour counts only if five scans pass the drawn wall."""
    posts = [(True, 0, 5, 3), (False, 3, 0, 4), (True, 0, 4, 15), (False, 3, 0, 16)]
    grid, where, drive = make_room_with_posts(*posts)
    assert find_misfits(grid, [drive]).missing[where].tolist() == [False, True, False, False]


def test_misfits_locate_wall_faults(office, drive):
    cells = office.cells.copy()
    cells[140:148, 300:700] = OCCUPIED  # in the corridor
    grid = replace(office, cells=cells, origin=(3.0, -2.0, 0.0))
    moved = drive.move(3.6, -1.4, 0.0)
    (false,) = find_misfits(grid, [moved]).faults(grid)
    assert (false.kind, false.is_certain) == ("false walls", True)
    left, right, low, top = false.boxes[0]
    assert (left, right) == pytest.approx((18.0, 38.0), abs=0.15)
    assert (low, top) == pytest.approx((5.0, 5.4), abs=0.15)
    assert "at 28.0,5.2 (20.0 x 0.4 m)" in false.sentence
    faults = [*find_misfits(remove_walls(office), [drive]).faults(office)]
    assert [each.kind for each in faults] == ["missing walls"]
    assert not [*find_misfits(office, [drive]).faults(office)]


@pytest.mark.parametrize("deviation", [0.1, 0.2])
def test_misfits_reject_inaccurate_poses(office, drive, deviation):
    for grid in (office, remove_walls(office)):
        with pytest.raises(RecordingError, match="too far to find wrong walls"):
            find_misfits(grid, [add_pose_errors(drive, deviation)])
    for side in ([deviation / 2, 0, 0], [0, deviation, 0]):
        with pytest.raises(RecordingError, match="too far to find wrong walls"):
            find_misfits(office, [replace(drive, poses=drive.poses + side)])
    with pytest.raises(
        RecordingError, match="too far to find wrong walls"
    ):  # of several drives the worst counts
        find_misfits(office, [drive, add_pose_errors(drive, deviation)])


def test_misfits_reject_drive_of_another_map(drive):
    with pytest.raises(RecordingError, match="no scan fits two_corridors"):
        find_misfits(environments.make("two_corridors"), [drive])


def scale_map(grid, drive, ratio):
    """The map with another resolution than the true one, and the drive's poses on it."""
    x, y, yaw = grid.origin
    poses = drive.poses.copy()
    poses[:, :2] *= ratio
    resolution = ratio * grid.resolution
    scaled_grid = replace(grid, resolution=resolution, origin=(ratio * x, ratio * y, yaw))
    return scaled_grid, replace(drive, poses=poses)


@pytest.mark.parametrize("ratio", [0.96, 1.0, 1.02])
def test_range_fit_finds_wrong_resolution(office, drive, ratio):
    grid, scaled_drive = scale_map(office, drive, ratio)
    fit = fit_ranges(grid, [scaled_drive])
    assert fit.factor.value == pytest.approx(1 / ratio, abs=0.002)
    assert fit.factor.low < fit.factor.value < fit.factor.high
    assert abs(fit.depth.value) < 0.2 * grid.resolution
    assert [each.kind for each in fit.faults(grid)] == ["resolution"] * (ratio != 1)


@pytest.mark.parametrize("cells", sample_cases([1, 2, 3], 2))
def test_range_fit_finds_inflated_walls(office, drive, cells):
    around = cv2.dilate((office.cells == OCCUPIED).view(np.uint8), np.ones((2 * cells + 1,) * 2))
    grid = replace(office, cells=np.where(around > 0, np.uint8(OCCUPIED), office.cells))
    fit = fit_ranges(grid, [drive])
    assert fit.depth.value == pytest.approx(cells * grid.resolution, abs=0.5 * grid.resolution)
    assert fit.factor.value == pytest.approx(1, abs=0.005)
    assert [each.kind for each in fit.faults(grid)] == ["deep walls"] * (cells > 1)


def test_short_drive_has_no_range_faults(office, drive):
    grid, scaled_drive = scale_map(office, drive, 0.9)
    assert not [*fit_ranges(grid, [scaled_drive[:40]]).faults(grid)]
    assert np.isnan(fit_ranges(remove_walls(office, share=1.0), [drive]).factor.value)


def test_misfits_tolerate_small_pose_errors(office, drive):
    assert [*find_misfits(remove_walls(office), [add_pose_errors(drive, 0.03)]).faults(office)]


@pytest.mark.long
@pytest.mark.parametrize("name", ["fhw", "intel"])
def test_misfits_find_faults_in_real_maps(name):
    if not all((SHARED_DATA / each).is_dir() for each in ("carmen", "rosmaps_carmen")):
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    log = read_recording(SHARED_DATA / "carmen" / f"{name}-corrected.log.gz", every=3)
    true = load_map(SHARED_DATA / "rosmaps_carmen" / f"{name}_even")
    assert not [*find_misfits(true, [log]).faults(true)]
    for grid, kind in (
        (remove_walls(true), "missing walls"),
        (add_false_walls(true), "false walls"),
    ):
        assert [each.kind for each in find_misfits(grid, [log]).faults(grid)] == [kind]

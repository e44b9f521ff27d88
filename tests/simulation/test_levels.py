"""Levels of disturbance: faults of odometry, kinks of maps, and drives at each level."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from support.maps import ascii_map

from locplan import Lidar, OccupancyGrid, Path, Robot
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, UNKNOWN
from locplan.robots import Amcl, Odometry
from locplan.simulation import LEVELS, NO_FAULT, Level, Simulator, drive_open, select_levels
from locplan.simulation.drives import LOST_DISTANCE
from locplan.simulation.levels import (
    KINKED_MAP,
    REVERSAL,
    SLIP,
    STANDSTILL,
    TURNS,
    MapKink,
    find_kink,
)
from locplan.simulation.worlds import make_path_poses

LIDAR = Lidar(range=5.0, beams=60)
ROBOT = Robot(
    LIDAR,
    filter=Amcl(min_particles=200, max_particles=200, update_min_d=0.1),
    odometry=Odometry(distance_bias=0.0, heading_bias_deg=0.1, turn_bias=0.0),
    footprint=0.2,
)
STRAIGHT = Path(np.array([[2.0, 2.0], [22.0, 2.0]]))
BACK = Path(np.array([[4.0, 2.0], [12.0, 2.0], [8.0, 2.0]]), np.zeros(3))


def corridor() -> OccupancyGrid:
    """Return a corridor of 24 m with niches between two rooms, of 0.1 m cells."""
    cells = np.full((120, 260), UNKNOWN, np.uint8)
    cells[4:36, 9:251] = OCCUPIED
    cells[12:28, 10:250] = FREE
    for col in (46, 95, 120, 175, 210):
        cells[5:12, col : col + 8] = FREE
    for col in (60, 140, 190):
        cells[28:34, col : col + 10] = FREE
    return OccupancyGrid(cells, 0.1, name="corridor")


def wavy_poses(n: int = 400) -> np.ndarray:
    """Return poses every 0.05 m that drive a curve, with a part in reverse."""
    steps = np.full(n - 1, 0.05)
    steps[250:290] *= -1
    heading = 0.8 * np.sin(np.arange(n) / 40)
    x = np.append(0, np.cumsum(steps * np.cos(heading[:-1])))
    y = np.append(0, np.cumsum(steps * np.sin(heading[:-1])))
    return np.column_stack([x, y, heading])


# Odometry


@pytest.mark.parametrize("level", [SLIP, STANDSTILL, REVERSAL, Level("back", "", missing=2.0)])
def test_disturbed_odometry_equals_plain_loop(level):
    poses = wavy_poses()
    odometry = poses + np.random.default_rng(5).normal(0, 0.002, poses.shape)
    disturbed = level.disturb_odometry(odometry, poses, np.random.default_rng(1))
    length = 0.05 * (len(poses) - 1)
    begin = np.random.default_rng(1).random() * (2 * length / 3 - 2)
    x, y, _ = odometry[0]
    for n in range(1, len(poses)):
        share = 1.0
        if level.missing and begin <= 0.05 * (n - 0.5) < begin + 2:
            share -= level.missing
        if level is REVERSAL and 250 <= n - 1 < 290:
            share = -1.0
        x += share * (odometry[n, 0] - odometry[n - 1, 0])
        y += share * (odometry[n, 1] - odometry[n - 1, 1])
        assert disturbed[n] == pytest.approx([x, y, odometry[n, 2]], abs=1e-9)
    assert (disturbed[0] == odometry[0]).all()
    assert not np.allclose(disturbed, odometry)


@pytest.mark.parametrize(("length", "count"), [(7.0, 1), (20.0, 1), (240.0, 2), (390.0, 4)])
def test_missing_motion_precedes_path_end(length, count):
    n = round(length / 0.05) + 1
    poses = np.column_stack([np.linspace(0, length, n), np.zeros((n, 2))])
    for seed in range(20):
        random = np.random.default_rng(seed)
        x = STANDSTILL.disturb_odometry(poses, poses, random)[:, 0]
        stands = np.flatnonzero(np.diff(x) == 0)
        assert len(stands) * 0.05 == pytest.approx(2.0 * count, abs=0.06 * count)
        assert poses[stands[-1], 0] <= length - min(length / 3, 45.0) + 0.05


def test_reversal_ignores_jitter_of_poses():
    """A recording's poses may jitter back while its robot moves forward."""
    poses, odometry = wavy_poses(), wavy_poses()
    odometry[250:291, :2] = odometry[250, :2] + 0.01 * np.arange(41)[:, None] * (1.0, 0.2)
    random = np.random.default_rng(1)
    assert REVERSAL.disturb_odometry(odometry, poses, random) == pytest.approx(odometry)


def test_level_only_raises_errors_of_odometry():
    worse = Odometry(turn_drift_deg=9.0, heading_bias_deg=3.0)
    assert TURNS.change_odometry(worse) == worse
    changed = TURNS.change_odometry(Odometry())
    assert changed == dataclasses.replace(Odometry(), turn_drift_deg=6.7)
    turn = math.radians(60)
    assert math.hypot(6.7 * math.sqrt(turn), 0.02 * 60) == pytest.approx(7.0, abs=0.1)
    assert NO_FAULT.change_odometry(Odometry()) == Odometry()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"missing": 2.5}, "missing must be 0 to 2, not 2.5"),
        ({"over": 0.0}, "over must be a positive number of m"),
        ({"kink_deg": 100.0}, "kink_deg must be -90 to 90"),
        ({"odometry": 7.0}, "odometry must be a"),
    ],
)
def test_level_rejects_bad_value(changes, message):
    with pytest.raises(ConfigError, match=message):
        Level("mine", "a fault", **changes)


# Drives


def test_drives_differ_only_after_fault():
    """Before the fault, a drive has the same world, odometry and filter as without the fault."""
    simulator = Simulator(corridor(), ROBOT, threads=1)
    no_fault = Level("no fault", "", missing=1e-12)
    usual = drive_open(simulator, {"a": STRAIGHT}, range(6), level=no_fault)["a"]
    stopped = drive_open(simulator, {"a": STRAIGHT}, range(6), level=STANDSTILL)["a"]
    assert stopped.poses[-1, :2] == pytest.approx(stopped.poses[0, :2])  # it drives back
    same = np.isclose(stopped.errors, usual.errors, atol=1e-6).all(axis=2)
    first = same.argmin(axis=1)
    assert not same[:, -1].any()
    assert len(set(first.tolist())) == 6
    assert stopped.distance[first].max() <= 2 * stopped.length / 3 - 1.9
    assert usual.position_error.max() < LOST_DISTANCE < stopped.position_error.max(axis=1).min()


def test_drive_open_leaves_out_unaffected_paths():
    simulator, paths = Simulator(corridor(), ROBOT, threads=1), {"a": STRAIGHT, "b": BACK}
    reversed_ones = drive_open(simulator, paths, range(2), level=REVERSAL)
    assert [*reversed_ones] == ["b"]
    usual = drive_open(simulator, paths, range(2))["b"]
    assert reversed_ones["b"].rmse.value > 2 * usual.rmse.value


def test_levels_for_leaves_out_impossible_faults():
    grid = corridor()
    names = [level.name for level in LEVELS]
    assert names == ["usual", "slip", "standstill", "reversal", "turns", "kinked map"]
    assert [level.name for level in select_levels([STRAIGHT, BACK], grid)] == names
    assert REVERSAL not in select_levels([STRAIGHT], grid)
    hall = ascii_map("##########", *["#........#"] * 6, "##########", resolution=2.0)
    assert KINKED_MAP not in select_levels([Path(np.array([[4.0, 7.0], [16.0, 7.0]]))], hall)


# Kinks


def test_kink_lies_in_corridor_crossed_once():
    grid = corridor()
    kink = find_kink(STRAIGHT, grid)
    assert (kink.y, kink.direction) == pytest.approx((2.0, 0.0), abs=1e-6)
    assert 5.0 <= kink.x <= 2 + 20 * 2 / 3 + 1e-6
    niches = [(4.6, 5.4), (9.5, 10.3), (12.0, 12.8), (6.0, 7.0), (14.0, 15.0)]
    assert not any(low < kink.x < high for low, high in niches)  # fewest free cells
    # A path that comes back crosses every cut of the first part three times.
    xy = np.array([[4.0, 2.0], [20.0, 2.0], [4.1, 2.2], [20.0, 2.4]])
    assert find_kink(Path(xy), grid) is None


def test_kink_avoids_wide_places_and_doors():
    rows = ["#" * 40, *["#" + "." * 38 + "#"] * 8, "#" * 40]
    rows = [row[:20] + ("#" if n not in (4, 5) else ".") + row[21:] for n, row in enumerate(rows)]
    grid = ascii_map(*rows, resolution=0.7)
    assert find_kink(Path(np.array([[2.0, 3.5], [26.0, 3.5]])), grid) is None


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (5.0, -3.0, 0.7)])
@pytest.mark.parametrize("angle", [math.radians(10.0), -0.3])
def test_kinked_map_equals_turned_cells(origin, angle):
    """Every known cell that lies clear of the cut is found again, turned behind the cut."""
    grid = corridor()
    grid = OccupancyGrid(grid.cells, 0.1, origin)
    x, y = (float(at) for at in grid.grid_to_world(20.0, 110.5))
    kink = MapKink(x, y, origin[2])
    kinked = kink.turn_map(grid, angle)
    cells = np.argwhere(grid.cells != UNKNOWN)
    # Off borders between values, so that the nearest cell of both maps has one value.
    inner = [
        (r, c)
        for r, c in cells.tolist()
        if len(set(grid.cells[r - 1 : r + 2, c - 1 : c + 2].flat)) == 1
    ]
    clear = np.array([(r, c) for r, c in inner if abs(c - 110) > 5 + 16 * abs(math.tan(angle))])
    xy = np.column_stack(grid.grid_to_world(*(clear.T + 0.5)))
    behind = clear[:, 1] > 110
    assert (kink.are_in_turned_part(xy) == behind).all()
    turned = np.where(behind[:, None], kink.turn_positions(xy, angle), xy)
    rows, cols = (np.floor(at).astype(int) for at in kinked.world_to_grid(*turned.T))
    assert (kinked.cells[rows, cols] == grid.cells[clear[:, 0], clear[:, 1]]).all()
    assert kinked.origin[2] == grid.origin[2]


def test_drive_follows_kink_of_map():
    """A filter that tracks the map is right on the map, though the building is straight."""
    simulator = Simulator(corridor(), ROBOT, threads=1)
    drives = drive_open(simulator, {"a": STRAIGHT}, range(4), level=KINKED_MAP)["a"]
    assert (drives.poses == make_path_poses(STRAIGHT, simulator.grid)).all()
    ends = drives.position_error[:, -20:]
    assert ends.max() < 0.6  # a truth that is not turned is off by more than 1.3 m
    kink = find_kink(STRAIGHT, simulator.grid)
    turn = np.diff(drives.errors[..., 2], axis=1)
    place = int(np.searchsorted(drives.poses[:, 0], kink.x))
    jumps = np.degrees(turn[:, place - 2 : place + 2])
    # The true heading turns at the kink while odometry goes straight; the side alternates.
    strongest = jumps[np.arange(4), np.abs(jumps).argmax(axis=1)]
    assert strongest * [-1, 1, -1, 1] == pytest.approx(10.0, abs=6.0)

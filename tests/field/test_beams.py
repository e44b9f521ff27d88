"""Rays, normals and the Fisher information of beams."""

import math

import numpy as np
import pytest
from support import oracles
from support.maps import random_rooms

from locplan._support.kernels.arrays import N_DONE, STOP
from locplan._support.kernels.lidar import (
    BeamDisturbances,
    LidarBeams,
    add_end_noise,
    compute_fisher_information,
    simulate_measured_ends,
    write_scan_ends,
)
from locplan._support.kernels.rays import cast_ray, compute_empty_squares
from locplan.field.beams import find_surface_normals
from locplan.maps import FREE, OCCUPIED
from locplan.robots import Lidar as Settings

FULL_CIRCLE = 2 * np.pi * np.arange(360) / 360
FAR = 1e6


def lidar(
    angles=FULL_CIRCLE, forward=0.0, left=0.0, yaw=0.0, sigma=0.03, min_range=0.0, max_range=30.0
):
    return LidarBeams(np.asarray(angles, float), forward, left, yaw, sigma, min_range, max_range)


@pytest.fixture(params=[False, True], ids=["endpoint", "range"])
def of_ranges(request) -> bool:
    """True for the range model of a beam, False for the endpoint model."""
    return request.param


def information_at_pose(occupied, resolution, row, col, heading, beams, of_ranges, normals=None):
    """Compute the information at one pose, (3, 3), for a standard deviation of 1 m."""
    normals = find_surface_normals(occupied) if normals is None else normals
    one = [np.array([float(value)]) for value in (row, col, heading)]
    control = np.zeros(2, np.int64)
    squares = compute_empty_squares(occupied)
    return compute_fisher_information(
        squares, normals, resolution, *one, beams, of_ranges, control
    )[0, 0]


def random_stops(shape, seed, density=0.08):
    return np.random.default_rng(seed).random(shape) < density


def cells_from_drawing(*lines):
    """Return the occupied cells of a drawing, its first line at the top."""
    return np.array([[character == "#" for character in line] for line in reversed(lines)])


@pytest.mark.parametrize("density", [0.0, 0.02, 0.3, 1.0])
def test_empty_squares_equal_oracle(density):
    stops = random_stops((13, 17), seed=3, density=density)
    np.testing.assert_array_equal(compute_empty_squares(stops), oracles.beams.empty_squares(stops))


def test_empty_squares_are_limited_to_255():
    squares = compute_empty_squares(np.zeros((600, 400), bool))
    assert squares.max() == 255
    assert cast_ray(squares, 0.5, 0.5, 1.0, 0.0, FAR)[0] == math.inf


def assert_between_oracles(stops, squares, row, col, drow, dcol, max_range=FAR):
    """Cells that are only touched may stop the ray or not; everything else is exact."""
    found, hit_row, hit_col = cast_ray(squares, row, col, drow, dcol, max_range)
    low = oracles.beams.cast(stops, row, col, drow, dcol, max_range, margin=-1e-9)
    high = oracles.beams.cast(stops, row, col, drow, dcol, max_range, margin=1e-9)
    assert low - 1e-6 <= found <= high + 1e-6
    if found == math.inf:
        assert (hit_row, hit_col) == (-1, -1)
    else:
        assert stops[hit_row, hit_col]
        entry = oracles.beams.enters(row, col, drow, dcol, hit_row, hit_col, -1e-9)
        assert found == pytest.approx(entry, abs=1e-6)
    return low, high


@pytest.mark.parametrize("density", [0.01, 0.08, 0.4])
def test_random_rays_equal_oracle(density):
    rng = np.random.default_rng(11)
    decided = 0
    for seed in range(6):
        stops = random_stops((19, 23), seed, density)
        squares = compute_empty_squares(stops)
        for _ in range(60):
            row, col = rng.random(2) * stops.shape
            angle = rng.uniform(-7, 7)
            low, high = assert_between_oracles(
                stops, squares, row, col, math.sin(angle), math.cos(angle)
            )
            decided += low == high or abs(low - high) < 1e-6
    assert decided > 355  # hardly any ray at random is a matter of taste


SQUARE_ROOT = math.sqrt(0.5)
EXACT_DIRECTIONS = [
    (drow * scale, dcol * scale)
    for drow in (-1.0, 0.0, 1.0)
    for dcol in (-1.0, 0.0, 1.0)
    if drow or dcol
    for scale in [SQUARE_ROOT if drow and dcol else 1.0]
]


@pytest.mark.parametrize("shift", [(0.5, 0.5), (0.0, 0.5), (0.5, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("by_angle", [False, True])
def test_edge_and_corner_rays_equal_oracle(shift, by_angle):
    for seed in range(3):
        stops = random_stops((8, 7), seed, 0.15)
        squares = compute_empty_squares(stops)
        for row in range(8):
            for col in range(7):
                for drow, dcol in EXACT_DIRECTIONS:
                    if by_angle:  # as a lidar's beams come: rounded, and hardly ever 0
                        angle = math.atan2(drow, dcol)
                        drow, dcol = math.sin(angle), math.cos(angle)
                    start = row + shift[0], col + shift[1]
                    assert_between_oracles(stops, squares, *start, drow, dcol)


def test_ray_on_edge_hits_upper_cell():
    stops = cells_from_drawing("....#", ".....", "#....")  # row 2, 1, 0
    squares = compute_empty_squares(stops)
    assert cast_ray(squares, 2.0, 0.5, 0.0, 1.0, FAR) == (3.5, 2, 4)
    assert cast_ray(squares, 1.0, 4.5, 0.0, -1.0, FAR)[0] == math.inf
    assert cast_ray(squares, 1.5, 0.0, -1.0, 0.0, FAR) == (0.5, 0, 0)
    assert cast_ray(squares, 2.5, 4.0, -0.0, 1.0, FAR) == (0.0, 2, 4)


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize("jitter", [0.0, 1e-16, -1e-16, 1e-12])
def test_ray_does_not_cross_diagonal_wall(quarters, jitter):
    stops = np.rot90(np.eye(40, dtype=bool), quarters)
    squares = compute_empty_squares(stops)
    away = math.pi / 4 + math.pi / 2 * quarters + math.pi / 2 + jitter
    for k in range(2, 37):
        for start in ((k + 0.5, 1.5), (1.5, k + 0.5)):
            found = [
                cast_ray(squares, *start, math.sin(angle), math.cos(angle), FAR)[0]
                for angle in (away, away + math.pi)
            ]
            on_wall = stops[int(start[0]), int(start[1])]
            assert on_wall or min(found) < math.inf


@pytest.mark.parametrize("lost", ["outside", "maximum", "map's edge"])
def test_ray_without_hit_has_infinite_range(lost):
    squares = compute_empty_squares(cells_from_drawing("....#", "....."))
    start, max_range = {
        "outside": ((1.5, -0.5), FAR),
        "maximum": ((1.5, 0.5), 3.49),
        "map's edge": ((0.5, 0.5), FAR),
    }[lost]
    assert cast_ray(squares, *start, 0.0, 1.0, max_range) == (math.inf, -1, -1)
    assert cast_ray(squares, 1.5, 0.5, 0.0, 1.0, 3.5) == (3.5, 1, 4)


def test_range_is_zero_inside_wall():
    squares = compute_empty_squares(cells_from_drawing(".#."))
    assert cast_ray(squares, 0.5, 1.5, 0.0, 1.0, FAR) == (0.0, 0, 1)


def test_ray_leaps_equal_single_steps():
    """Against squares of one cell, which are Amanatides and Woo's steps."""
    stops = np.zeros((300, 500), bool)
    stops[:, [0, 499]] = stops[[0, 299]] = True
    stops[140:150, 200:260] = True
    rng = np.random.default_rng(2)
    squares = compute_empty_squares(stops)
    single_steps = np.minimum(squares, 1)
    for _ in range(3000):
        row, col = rng.uniform(1, 299), rng.uniform(1, 499)
        angle = rng.uniform(0, 2 * math.pi)
        ray = row, col, math.sin(angle), math.cos(angle), FAR
        assert cast_ray(squares, *ray) == cast_ray(single_steps, *ray)


def cell_centres(size, resolution):
    """Return x and y of the cells' centres from the middle of a square map [m]."""
    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) * resolution
    return x, y


def error_deg(normals, x, y):
    """Angle between normals and the axis (x, y), where both are given [deg]."""
    along = normals[..., 1] * x + normals[..., 0] * y
    return np.degrees(np.arccos(np.clip(np.abs(along), 0, 1)))


@pytest.mark.parametrize("thickness", [1.0, 1.42, 2.0, 3.0])
@pytest.mark.parametrize("degrees", range(0, 91, 7))
def test_normals_are_perpendicular_to_straight_walls(degrees, thickness):
    x, y = cell_centres(160, 1.0)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    across, along = cos * y - sin * x + 0.37, cos * x + sin * y
    occupied = (abs(across) <= thickness / 2) & (abs(along) < 70)
    chosen = occupied & (abs(along) < 60)
    error = error_deg(find_surface_normals(occupied)[chosen], -sin, cos)
    assert np.median(error) < 0.8
    assert np.quantile(error, 0.95) < 2


@pytest.mark.parametrize("radius", [20, 40, 80])
def test_normals_are_radial_on_round_walls(radius):
    x, y = cell_centres(200, 1.0)
    distance = np.hypot(x, y)
    occupied = abs(distance - radius) <= 1
    normals = find_surface_normals(occupied)[occupied]
    error = error_deg(normals, (x / distance)[occupied], (y / distance)[occupied])
    assert np.median(error) < 1.5
    assert np.quantile(error, 0.95) < 4


def test_only_occupied_cells_have_unit_normals():
    occupied = random_stops((60, 70), 9, 0.1)
    lengths = np.linalg.norm(find_surface_normals(occupied), axis=-1)
    np.testing.assert_allclose(lengths[lengths > 0], 1, rtol=1e-6)
    assert not lengths[~occupied].any()
    assert (lengths[occupied] > 0).mean() > 0.99


def test_isolated_cell_has_no_normal():
    occupied = np.zeros((21, 21), bool)
    occupied[10, 10] = True
    assert not find_surface_normals(occupied).any()


def test_normals_are_exact_at_map_edge():
    occupied = np.zeros((30, 40), bool)
    occupied[15:17] = True
    occupied[29] = True
    np.testing.assert_allclose(np.abs(find_surface_normals(occupied)[occupied]), [[1, 0]] * 120)


@pytest.mark.parametrize("seed", range(6))
def test_fisher_information_equals_finite_differences(seed, of_ranges):
    rng = np.random.default_rng(seed)
    occupied = random_stops((24, 30), seed, 0.06)
    normals = find_surface_normals(occupied)
    beams = lidar(rng.uniform(-2, 2, 70), *rng.uniform(-0.4, 0.4, 3), 0.05, 0.7, 4.0)
    pose = rng.uniform(6, 18), rng.uniform(8, 22), rng.uniform(-4, 4)
    expected = oracles.beams.information(occupied, normals, 0.2, *pose, beams, of_ranges)
    found = information_at_pose(occupied, 0.2, *pose, beams, of_ranges, normals)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def polygon_range(corners, x, y, angle):
    """Range to the nearest side of a closed polygon."""
    dx, dy = math.cos(angle), math.sin(angle)
    best = math.inf
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        ex, ey = bx - ax, by - ay
        across = dx * ey - dy * ex
        if across == 0:
            continue
        at = ((ax - x) * ey - (ay - y) * ex) / across
        share = ((ax - x) * dy - (ay - y) * dx) / across
        if at > 0 and 0 <= share <= 1:
            best = min(best, at)
    return best


def distance_outside(corners, x, y):
    """Compute how far a point lies outside a convex, counter-clockwise polygon; negative inside."""
    along = np.roll(corners, -1, axis=0) - corners
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    return ((np.array([x, y]) - corners) * outwards).sum(axis=1).max()


def differentiate_information(corners, pose, beams, of_ranges, step=1e-5):
    """Information by central differences of ranges or ends in a convex room."""
    total = np.zeros((3, 3))

    def transform_to_world(x, y, theta, ahead, left):
        cos, sin = math.cos(theta), math.sin(theta)
        return x + cos * ahead - sin * left, y + sin * ahead + cos * left

    def range_at(pose, angle):
        start = transform_to_world(*pose, beams.forward, beams.left)
        return polygon_range(corners, *start, pose[2] + beams.yaw + angle)

    for angle in beams.angles:
        at, bearing = range_at(pose, angle), beams.yaw + angle
        end = beams.forward + at * math.cos(bearing), beams.left + at * math.sin(bearing)
        gradient = np.zeros(3)
        for axis in range(3):
            both = []
            for side in (step, -step):
                moved = np.array(pose, float)
                moved[axis] += side
                departs = distance_outside(corners, *transform_to_world(*moved, *end))
                both.append(range_at(moved, angle) if of_ranges else departs)
            gradient[axis] = (both[0] - both[1]) / (2 * step)
        total += np.outer(gradient, gradient)
    return total


def rectangle(width, height, turned):
    cos, sin = math.cos(turned), math.sin(turned)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    return corners @ np.array([[cos, sin], [-sin, cos]])


@pytest.mark.parametrize("turned", [0.0, 0.3, math.pi / 4, 1.2])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.4, -0.2, 0.5)])
def test_information_on_grid_approximates_exact_room(turned, mount, of_ranges):
    width, height, resolution, size = 6.0, 4.0, 0.05, 200
    x, y = cell_centres(size, resolution)
    cos, sin = math.cos(turned), math.sin(turned)
    side, end = abs(cos * y - sin * x) - height / 2, abs(cos * x + sin * y) - width / 2
    occupied = np.maximum(side, end) >= 0
    true_normals = np.where((side > end)[..., None], [cos, -sin], [sin, cos]).astype(np.float32)
    pose, beams = (0.7, -0.3, 0.4), lidar(FULL_CIRCLE + 0.003, *mount)
    corners = rectangle(width, height, turned)
    expected = differentiate_information(corners, pose, beams, of_ranges)
    row, col = pose[1] / resolution + size / 2, pose[0] / resolution + size / 2
    # Beside a corner the map's normals are those of both walls, which costs some information.
    for normals, tolerance in ((true_normals, 0.1), (None, 0.2)):
        found = information_at_pose(
            occupied, resolution, row, col, pose[2], beams, of_ranges, normals
        )
        shares = np.linalg.eigvals(np.linalg.solve(expected, found))
        assert np.abs(shares - 1).max() < tolerance


def test_square_room_information_equals_closed_form(of_ranges):
    """A beam at angle t to a wall's normal has the lever arm distance * tan(t).

    A range has 1 / cos(t)^2 times the information of an end.
    """
    resolution, half, beams = 0.05, 40, lidar(FULL_CIRCLE + np.pi / 360)
    occupied = np.ones((100, 100), bool)
    occupied[50 - half : 50 + half, 50 - half : 50 + half] = False
    row, col = np.mgrid[:100, :100] - 49.5
    walls = np.stack([abs(row) > abs(col), abs(col) > abs(row)], -1).astype(np.float32)
    found = information_at_pose(occupied, resolution, 50, 50, 0, beams, of_ranges, walls)
    angles = beams.angles[:45]  # half a wall
    weight = 1 / np.cos(angles) ** 2 if of_ranges else np.ones(45)
    across = 4 * weight.sum()
    turning = 8 * (weight * (half * resolution * np.tan(angles)) ** 2).sum()
    expected = np.diag([across, across, turning])
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6 * across)


@pytest.mark.parametrize("degrees", [0, 90])
def test_corridor_has_no_information_along_axis(degrees, of_ranges):
    occupied = np.zeros((401, 401), bool)
    occupied[[180, 181, 220, 221]] = True
    if degrees:
        occupied = occupied.T.copy()
    beams = lidar(max_range=8.0)
    found = information_at_pose(occupied, 0.05, 200.5, 200.5, 0.3, beams, of_ranges)
    along, across = (0, 1) if degrees == 0 else (1, 0)
    assert not found[along].any()
    assert found[across, across] > 1e5 * beams.sigma**2


def slanting_corridor(degrees, frames=0.0):
    """A corridor of 2 m, with a door frame that juts out every 3 m."""
    x, y = cell_centres(400, 0.05)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = cos * x + sin * y, abs(cos * y - sin * x)
    edge = 1 - frames * (along % 3 < 1)
    return (across > edge) & (across < 1.15)


def compute_worst_deviation(information, sigma=0.03):
    """Compute the largest deviation of the position [m] from the deviation of a beam [m]."""
    return sigma / math.sqrt(np.linalg.eigvalsh(information[:2, :2])[0])


@pytest.mark.parametrize("degrees", [7, 13, 30, 44, 71])
def test_position_is_uncertain_in_slanting_corridor(degrees, of_ranges):
    occupied = slanting_corridor(degrees)
    found = information_at_pose(occupied, 0.05, 200, 200, 0.3, lidar(max_range=6.0), of_ranges)
    assert compute_worst_deviation(found) > 1.0


@pytest.mark.parametrize("degrees", [0, 7, 13, 30, 44, 71])
def test_door_frames_fix_position_in_corridor(degrees, of_ranges):
    occupied = slanting_corridor(degrees, frames=0.15)
    found = information_at_pose(occupied, 0.05, 200, 200, 0.3, lidar(max_range=6.0), of_ranges)
    assert compute_worst_deviation(found) < 0.03


def test_heading_is_uncertain_at_round_centre(of_ranges):
    x, y = cell_centres(240, 0.05)
    distance = np.hypot(x, y)
    found = information_at_pose(distance > 4, 0.05, 120, 120, 0.7, lidar(), of_ranges)
    exact = 180  # half of the beams for each axis
    np.testing.assert_allclose(found[:2, :2], exact * np.eye(2), atol=0.02 * exact)
    assert found[2, 2] < 5e-3 * exact * 4**2
    off_centre = information_at_pose(distance > 4, 0.05, 120, 150, 0.7, lidar(), of_ranges)
    assert off_centre[2, 2] > 5 * found[2, 2]


def test_information_is_zero_without_returns(of_ranges):
    occupied = np.zeros((50, 50), bool)
    occupied[:, 49] = True
    for col, beams in (
        (5, lidar(max_range=4.0)),
        (45, lidar(min_range=100.0, max_range=200.0)),
        (49.5, lidar()),  # within the wall
        (45, lidar(forward=2.0)),  # beyond the map
        (45, lidar(angles=[])),
    ):
        assert not information_at_pose(occupied, 0.1, 25, col, 0, beams, of_ranges).any()


def near_and_far_wall():
    """Occupied cells of 0.1 m; walls 1 m to the left and 3 m to the right of row 20, column 15."""
    occupied = np.zeros((41, 60), bool)
    occupied[:, [5, 45]] = True
    return occupied


@pytest.mark.parametrize(("least", "returned"), [(0.9, 2), (0.96, 1), (2.9, 1), (3.0, 0)])
def test_returns_below_min_range_are_ignored(least, returned, of_ranges):
    occupied, ahead_and_back = near_and_far_wall(), lidar([0.0, math.pi], min_range=least)
    walls = np.zeros((*occupied.shape, 2), np.float32)
    walls[..., 1] = occupied
    found = information_at_pose(occupied, 0.1, 20.5, 15.5, 0.0, ahead_and_back, of_ranges, walls)
    np.testing.assert_allclose(found, np.diag([returned, 0.0, 0.0]), atol=1e-12)
    ends = np.empty((2, 2))
    write_scan_ends(compute_empty_squares(occupied), 0.1, 20.5, 15.5, 0.0, ahead_and_back, ends)
    there = np.array([[30.0, 0.0], [-10.0, 0.0]])
    there[returned:] = np.nan
    np.testing.assert_allclose(ends, there, atol=1e-9)


def simulate_ranges(occupied, beams, seed, **disturbances):
    """Simulate the ranges of a noisy scan from row 20, column 15 [m]."""
    settings = {"outliers": 0.0, "occlusion": 0.0, "width": 1.0, "nearest": 0.5, "farthest": 2.0}
    ends, pose = np.empty((beams.angles.size, 2)), np.array([20.5, 15.5, 0.0])
    of_beams = BeamDisturbances(**settings | disturbances)
    random, squares = np.random.default_rng(seed), compute_empty_squares(occupied)
    simulate_measured_ends(random, squares, 0.1, pose, beams, of_beams, ends)
    return np.hypot(*ends.T) * 0.1


def test_min_range_applies_to_measured_range():
    """The wall stands at the minimum range; noise moves about half of its returns below."""
    occupied, left = near_and_far_wall(), np.full(400, math.pi)
    all_of_them = simulate_ranges(occupied, lidar(left, sigma=0.02), seed=3)
    assert 0.4 < (all_of_them < 1.0).mean() < 0.6
    at = simulate_ranges(occupied, lidar(left, sigma=0.02, min_range=1.0), seed=3)
    np.testing.assert_array_equal(at, np.where(all_of_them < 1.0, np.nan, all_of_them))


def test_wall_below_min_range_blocks_beam():
    occupied, left = near_and_far_wall(), np.full(9, math.pi)
    beams = lidar(left, sigma=1e-9, min_range=1.05)
    for seed in range(20):
        behind = {"occlusion": 1.0, "nearest": 1.2, "farthest": 2.0}
        assert np.isnan(simulate_ranges(occupied, beams, seed, **behind)).all()


def test_noisy_ends_equal_plain_loop():
    levels, rng = random_rooms((30, 36), seed=13), np.random.default_rng(4)
    angles, noise = rng.uniform(-3, 3, 60), rng.normal(0, 0.2, (60, 2))
    sensor = Settings(
        range=2.5, min_range=0.3, mount_x=0.2, mount_y=-0.1, mount_yaw_deg=30.0, beams=60
    )
    beams = lidar(angles, 0.2, -0.1, sensor.mount_yaw, 0.03, 0.3, 2.5)
    squares, ends, moved = compute_empty_squares(levels == OCCUPIED), np.empty((60, 2)), 0
    for row, col in np.argwhere(levels[4:-4, 4:-4] == FREE)[::12] + 4:  # no mount off the map
        heading = rng.uniform(-4, 4)
        pose = row + 0.5, col + 0.5, heading
        write_scan_ends(squares, 0.1, *pose, beams, ends)
        for noisy in (np.zeros((60, 2)), noise):
            add_end_noise(0.1, heading, beams, noisy, ends)
            expected = oracles.beams.moved_ends(levels, 0.1, *pose, sensor, angles, noisy)
            np.testing.assert_allclose(ends, expected, atol=5e-5)  # levers are rounded
        moved += np.isfinite(ends[:, 0]).sum()
    assert moved > 300


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_information_turns_with_map_and_pose(quarters, of_ranges):
    occupied = random_stops((60, 60), 21, 0.02)
    occupied[[0, 59]] = occupied[:, [0, 59]] = True
    beams = lidar(FULL_CIRCLE + 0.1, 0.15, -0.1, 0.3, max_range=5.0)
    row, col, heading = 31.3, 20.6, 0.8
    before = information_at_pose(occupied, 0.1, row, col, heading, beams, of_ranges)
    turned_map, turned_row, turned_col = occupied, row, col
    for _ in range(quarters):  # x' = -y, y' = x
        turned_map = np.ascontiguousarray(turned_map.T[:, ::-1])
        turned_row, turned_col = turned_col, 60 - turned_row
    angle = quarters * math.pi / 2
    after = information_at_pose(
        turned_map, 0.1, turned_row, turned_col, heading + angle, beams, of_ranges
    )
    cos, sin = round(math.cos(angle)), round(math.sin(angle))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        after, turn @ before @ turn.T, rtol=1e-4, atol=1e-5 * np.abs(before).max()
    )


def test_mount_transforms_information_by_lever_arm(of_ranges):
    occupied = random_stops((60, 60), 22, 0.02)
    forward, left, yaw, heading = 0.35, -0.2, 0.6, 1.1
    cos, sin = math.cos(heading), math.sin(heading)
    lever = np.array([cos * forward - sin * left, sin * forward + cos * left])
    lever = np.round(lever / 0.1 / 2.0**-20) * 2.0**-20 * 0.1
    beams, at = lidar(FULL_CIRCLE, forward, left, yaw), 30 + lever[::-1] / 0.1
    mounted = information_at_pose(occupied, 0.1, 30, 30, heading, beams, of_ranges)
    there = information_at_pose(occupied, 0.1, *at, heading + yaw, lidar(), of_ranges)
    moves = np.array([[1, 0, -lever[1]], [0, 1, lever[0]], [0, 0, 1]])
    np.testing.assert_allclose(mounted, moves.T @ there @ moves, rtol=1e-9, atol=1e-6)


def test_full_circle_information_ignores_heading(of_ranges):
    occupied = random_stops((60, 60), 23, 0.02)
    one = information_at_pose(occupied, 0.1, 30.2, 30.4, 0.0, lidar(), of_ranges)
    other = information_at_pose(occupied, 0.1, 30.2, 30.4, math.radians(90), lidar(), of_ranges)
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * np.abs(one).max())


def test_batch_information_equals_single_poses(of_ranges):
    """A stopped batch returns NaN."""
    occupied = random_stops((60, 60), 25, 0.02)
    squares, normals, beams = (
        compute_empty_squares(occupied),
        find_surface_normals(occupied),
        lidar(forward=0.2),
    )
    rows, cols = np.array([20.5, 30.5, 40.5]), np.array([11.5, 30.5, 44.5])
    headings, control = np.array([0.0, 1.0]), np.zeros(2, np.int64)
    batch = squares, normals, 0.1, rows, cols, headings, beams, of_ranges
    found = compute_fisher_information(*batch, control)
    assert found.shape == (3, 2, 3, 3)
    assert control[N_DONE] == 3
    for n in range(3):
        for k in range(2):
            single = information_at_pose(
                occupied, 0.1, rows[n], cols[n], headings[k], beams, of_ranges
            )
            np.testing.assert_array_equal(found[n, k], single)
            np.testing.assert_array_equal(single, single.T)
            assert np.linalg.eigvalsh(single).min() > -1e-9 * single.max()
    uncounted = control[: STOP + 1]
    np.testing.assert_array_equal(compute_fisher_information(*batch, uncounted), found)
    assert control[N_DONE] == 3
    control[STOP] = 1
    assert np.isnan(compute_fisher_information(*batch, control)).all()
    assert np.isnan(compute_fisher_information(*batch, uncounted)).all()

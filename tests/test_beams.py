"""Rays, normals and the Fisher information of beams."""

import math

import naive
import numpy as np
import pytest

from locplan._kernels.information import DONE, STOP, information
from locplan._kernels.lidar import FRACTION, Lidar
from locplan._kernels.rays import cast, empty_squares
from locplan.field._surfaces import surface_normals

FULL_CIRCLE = 2 * np.pi * np.arange(360) / 360
FAR = 1e6


def lidar(angles=FULL_CIRCLE, forward=0.0, left=0.0, yaw=0.0, sigma=0.03, max_range=30.0):
    return Lidar(np.asarray(angles, float), forward, left, yaw, sigma, max_range)


def at_pose(occupied, resolution, row, col, heading, beams, normals=None):
    """Information at one pose, (3, 3)."""
    normals = surface_normals(occupied) if normals is None else normals
    one = [np.array([float(value)]) for value in (row, col, heading)]
    control = np.zeros(2, np.int64)
    result = information(empty_squares(occupied), normals, resolution, *one, beams, control)
    return result[0, 0]


def random_stops(shape, seed, density=0.08):
    return np.random.default_rng(seed).random(shape) < density


def drawn(*lines):
    """Occupied cells of a drawing, its first line at the top."""
    return np.array([[character == "#" for character in line] for line in reversed(lines)])


@pytest.mark.parametrize("density", [0.0, 0.02, 0.3, 1.0])
def test_empty_squares_are_those_of_the_oracle(density):
    stops = random_stops((13, 17), seed=3, density=density)
    np.testing.assert_array_equal(empty_squares(stops), naive.empty_squares(stops))


def test_long_empty_squares_are_cut_at_a_byte():
    squares = empty_squares(np.zeros((600, 400), bool))
    assert squares.max() == 255
    assert cast(squares, 0.5, 0.5, 1.0, 0.0, FAR)[0] == math.inf


def assert_between_oracles(stops, squares, row, col, drow, dcol, max_range=FAR):
    """Cells that are only touched may stop the ray or not; everything else is exact."""
    found, hit_row, hit_col = cast(squares, row, col, drow, dcol, max_range)
    low = naive.cast(stops, row, col, drow, dcol, max_range, margin=-1e-9)
    high = naive.cast(stops, row, col, drow, dcol, max_range, margin=1e-9)
    assert low - 1e-6 <= found <= high + 1e-6
    if found == math.inf:
        assert (hit_row, hit_col) == (-1, -1)
    else:
        assert stops[hit_row, hit_col]
        entry = naive.enters(row, col, drow, dcol, hit_row, hit_col, -1e-9)
        assert found == pytest.approx(entry, abs=1e-6)
    return low, high


@pytest.mark.parametrize("density", [0.01, 0.08, 0.4])
def test_rays_at_random_are_exact(density):
    rng = np.random.default_rng(11)
    decided = 0
    for seed in range(6):
        stops = random_stops((19, 23), seed, density)
        squares = empty_squares(stops)
        for _ in range(150):
            row, col = rng.random(2) * stops.shape
            angle = rng.uniform(-7, 7)
            low, high = assert_between_oracles(
                stops, squares, row, col, math.sin(angle), math.cos(angle)
            )
            decided += low == high or abs(low - high) < 1e-6
    assert decided > 890  # hardly any ray at random is a matter of taste


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
def test_rays_along_edges_and_through_corners(shift, by_angle):
    for seed in range(4):
        stops = random_stops((12, 11), seed, 0.15)
        squares = empty_squares(stops)
        for row in range(12):
            for col in range(11):
                for drow, dcol in EXACT_DIRECTIONS:
                    if by_angle:  # as a lidar's beams come: rounded, and hardly ever 0
                        angle = math.atan2(drow, dcol)
                        drow, dcol = math.sin(angle), math.cos(angle)
                    start = row + shift[0], col + shift[1]
                    assert_between_oracles(stops, squares, *start, drow, dcol)


def test_an_edge_belongs_to_the_upper_cell():
    stops = drawn("....#", ".....", "#....")  # row 2, 1, 0
    squares = empty_squares(stops)
    assert cast(squares, 2.0, 0.5, 0.0, 1.0, FAR) == (3.5, 2, 4)
    assert cast(squares, 1.0, 4.5, 0.0, -1.0, FAR)[0] == math.inf
    assert cast(squares, 1.5, 0.0, -1.0, 0.0, FAR) == (0.5, 0, 0)
    assert cast(squares, 2.5, 4.0, -0.0, 1.0, FAR) == (0.0, 2, 4)


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize("jitter", [0.0, 1e-16, -1e-16, 1e-12])
def test_a_diagonal_wall_does_not_leak(quarters, jitter):
    stops = np.rot90(np.eye(40, dtype=bool), quarters)
    squares = empty_squares(stops)
    away = math.pi / 4 + math.pi / 2 * quarters + math.pi / 2 + jitter
    for k in range(2, 37):
        for start in ((k + 0.5, 1.5), (1.5, k + 0.5)):
            found = [
                cast(squares, *start, math.sin(angle), math.cos(angle), FAR)[0]
                for angle in (away, away + math.pi)
            ]
            on_wall = stops[int(start[0]), int(start[1])]
            assert on_wall or min(found) < math.inf


@pytest.mark.parametrize("lost", ["outside", "maximum", "map's edge"])
def test_no_return(lost):
    squares = empty_squares(drawn("....#", "....."))
    start, max_range = {
        "outside": ((1.5, -0.5), FAR),
        "maximum": ((1.5, 0.5), 3.49),
        "map's edge": ((0.5, 0.5), FAR),
    }[lost]
    assert cast(squares, *start, 0.0, 1.0, max_range) == (math.inf, -1, -1)
    assert cast(squares, 1.5, 0.5, 0.0, 1.0, 3.5) == (3.5, 1, 4)


def test_within_a_wall_the_range_is_zero():
    assert cast(empty_squares(drawn(".#.")), 0.5, 1.5, 0.0, 1.0, FAR) == (0.0, 0, 1)


def test_leaps_change_nothing_on_large_maps():
    """Against squares of one cell, which are Amanatides and Woo's steps."""
    stops = np.zeros((300, 500), bool)
    stops[:, [0, 499]] = stops[[0, 299]] = True
    stops[140:150, 200:260] = True
    rng = np.random.default_rng(2)
    squares = empty_squares(stops)
    single_steps = np.minimum(squares, 1)
    for _ in range(3000):
        row, col = rng.uniform(1, 299), rng.uniform(1, 499)
        angle = rng.uniform(0, 2 * math.pi)
        ray = row, col, math.sin(angle), math.cos(angle), FAR
        assert cast(squares, *ray) == cast(single_steps, *ray)


def cells(size, resolution):
    """x and y of the cells' centres from the middle of a square map [m]."""
    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) * resolution
    return x, y


def error_deg(normals, x, y):
    """Angle between normals and the axis (x, y), where both are given [deg]."""
    along = normals[..., 1] * x + normals[..., 0] * y
    return np.degrees(np.arccos(np.clip(np.abs(along), 0, 1)))


@pytest.mark.parametrize("thickness", [1.0, 1.42, 2.0, 3.0])
@pytest.mark.parametrize("degrees", range(0, 91, 7))
def test_normals_of_straight_walls(degrees, thickness):
    x, y = cells(160, 1.0)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    across, along = cos * y - sin * x + 0.37, cos * x + sin * y
    occupied = (abs(across) <= thickness / 2) & (abs(along) < 70)
    chosen = occupied & (abs(along) < 60)
    error = error_deg(surface_normals(occupied)[chosen], -sin, cos)
    assert np.median(error) < 0.8
    assert np.quantile(error, 0.95) < 2


@pytest.mark.parametrize("radius", [20, 40, 80])
def test_normals_of_round_walls(radius):
    x, y = cells(200, 1.0)
    distance = np.hypot(x, y)
    occupied = abs(distance - radius) <= 1
    normals = surface_normals(occupied)[occupied]
    error = error_deg(normals, (x / distance)[occupied], (y / distance)[occupied])
    assert np.median(error) < 1.5
    assert np.quantile(error, 0.95) < 4


def test_normals_are_unit_vectors_on_occupied_cells_only():
    occupied = random_stops((60, 70), 9, 0.1)
    lengths = np.linalg.norm(surface_normals(occupied), axis=-1)
    np.testing.assert_allclose(lengths[lengths > 0], 1, rtol=1e-6)
    assert not lengths[~occupied].any()
    assert (lengths[occupied] > 0).mean() > 0.99


def test_a_lone_post_faces_no_way():
    occupied = np.zeros((21, 21), bool)
    occupied[10, 10] = True
    assert not surface_normals(occupied).any()


def test_a_wall_that_leaves_the_map_is_straight_to_its_end():
    occupied = np.zeros((30, 40), bool)
    occupied[15:17] = True
    occupied[29] = True
    np.testing.assert_allclose(np.abs(surface_normals(occupied)[occupied]), [[1, 0]] * 120)


@pytest.mark.parametrize("seed", range(6))
def test_information_is_that_of_finite_differences(seed):
    rng = np.random.default_rng(seed)
    occupied = random_stops((24, 30), seed, 0.06)
    normals = surface_normals(occupied)
    beams = lidar(rng.uniform(-2, 2, 70), *rng.uniform(-0.4, 0.4, 3), 0.05, 4.0)
    pose = rng.uniform(6, 18), rng.uniform(8, 22), rng.uniform(-4, 4)
    expected = naive.information(occupied, normals, 0.2, *pose, beams)
    found = at_pose(occupied, 0.2, *pose, beams, normals)
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


def information_of(range_at, pose, beams, step=1e-5):
    """Information by central differences of a range (x, y, bearing) of the lidar itself."""
    total = np.zeros((3, 3))

    def measured(x, y, theta, angle):
        cos, sin = math.cos(theta), math.sin(theta)
        return range_at(
            x + cos * beams.forward - sin * beams.left,
            y + sin * beams.forward + cos * beams.left,
            theta + beams.yaw + angle,
        )

    for angle in beams.angles:
        gradient = np.zeros(3)
        for axis in range(3):
            ahead, behind = np.array(pose, float), np.array(pose, float)
            ahead[axis] += step
            behind[axis] -= step
            gradient[axis] = (measured(*ahead, angle) - measured(*behind, angle)) / (2 * step)
        total += np.outer(gradient, gradient) / beams.sigma**2
    return total


def rectangle(width, height, turned):
    cos, sin = math.cos(turned), math.sin(turned)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    return corners @ np.array([[cos, sin], [-sin, cos]])


@pytest.mark.parametrize("turned", [0.0, 0.3, math.pi / 4, 1.2])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.4, -0.2, 0.5)])
def test_a_room_on_the_grid_is_the_room_itself(turned, mount):
    width, height, resolution, size = 6.0, 4.0, 0.05, 200
    x, y = cells(size, resolution)
    cos, sin = math.cos(turned), math.sin(turned)
    side, end = abs(cos * y - sin * x) - height / 2, abs(cos * x + sin * y) - width / 2
    occupied = np.maximum(side, end) >= 0
    true_normals = np.where((side > end)[..., None], [cos, -sin], [sin, cos]).astype(np.float32)
    pose, beams = (0.7, -0.3, 0.4), lidar(FULL_CIRCLE + 0.003, *mount)
    corners = rectangle(width, height, turned)
    expected = information_of(lambda x, y, angle: polygon_range(corners, x, y, angle), pose, beams)
    row, col = pose[1] / resolution + size / 2, pose[0] / resolution + size / 2
    # Beside a corner the map's normals are those of both walls, which costs some information.
    for normals, tolerance in ((true_normals, 0.1), (None, 0.2)):
        found = at_pose(occupied, resolution, row, col, pose[2], beams, normals)
        shares = np.linalg.eigvals(np.linalg.solve(expected, found))
        assert np.abs(shares - 1).max() < tolerance


def test_a_square_room_in_closed_form():
    """Each wall at distance a sees a quarter of the beams: sums of 1 / cos^2 and tan^2."""
    resolution, half, beams = 0.05, 40, lidar(FULL_CIRCLE + np.pi / 360)
    occupied = np.ones((100, 100), bool)
    occupied[50 - half : 50 + half, 50 - half : 50 + half] = False
    row, col = np.mgrid[:100, :100] - 49.5
    walls = np.stack([abs(row) > abs(col), abs(col) > abs(row)], -1).astype(np.float32)
    found = at_pose(occupied, resolution, 50, 50, 0, beams, walls)
    angles = beams.angles[:45]  # half a wall
    across = 4 * (1 / np.cos(angles) ** 2).sum()
    turning = 8 * ((half * resolution * np.tan(angles) / np.cos(angles)) ** 2).sum()
    expected = np.diag([across, across, turning]) / beams.sigma**2
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6 * across)


@pytest.mark.parametrize("degrees", [0, 90])
def test_a_corridor_says_nothing_along_its_axis(degrees):
    occupied = np.zeros((401, 401), bool)
    occupied[[180, 181, 220, 221]] = True
    if degrees:
        occupied = occupied.T.copy()
    beams = lidar(max_range=8.0)
    found = at_pose(occupied, 0.05, 200.5, 200.5, 0.3, beams)
    along, across = (0, 1) if degrees == 0 else (1, 0)
    assert not found[along].any()
    assert found[across, across] > 1e5


def slanting_corridor(degrees, frames=0.0):
    """A corridor of 2 m, with a door frame that juts out every 3 m."""
    x, y = cells(400, 0.05)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = cos * x + sin * y, abs(cos * y - sin * x)
    edge = 1 - frames * (along % 3 < 1)
    return (across > edge) & (across < 1.15)


def worst_sd(information):
    """Standard deviation of the position along its worst axis [m]."""
    return 1 / math.sqrt(np.linalg.eigvalsh(information[:2, :2])[0])


@pytest.mark.parametrize("degrees", [7, 13, 30, 44, 71])
def test_a_slanting_corridor_says_little_along_its_axis(degrees):
    occupied = slanting_corridor(degrees)
    found = at_pose(occupied, 0.05, 200, 200, 0.3, lidar(max_range=6.0))
    assert worst_sd(found) > 1.0


@pytest.mark.parametrize("degrees", [0, 7, 13, 30, 44, 71])
def test_door_frames_fix_the_position_along_a_corridor(degrees):
    occupied = slanting_corridor(degrees, frames=0.15)
    found = at_pose(occupied, 0.05, 200, 200, 0.3, lidar(max_range=6.0))
    assert worst_sd(found) < 0.03


def test_a_round_room_says_nothing_of_the_heading_in_its_centre():
    x, y = cells(240, 0.05)
    distance = np.hypot(x, y)
    found = at_pose(distance > 4, 0.05, 120, 120, 0.7, lidar())
    exact = 180 / 0.03**2  # half of the beams for each axis
    np.testing.assert_allclose(found[:2, :2], exact * np.eye(2), atol=0.02 * exact)
    assert found[2, 2] < 5e-3 * exact * 4**2
    off_centre = at_pose(distance > 4, 0.05, 120, 150, 0.7, lidar())
    assert off_centre[2, 2] > 5 * found[2, 2]


def test_without_a_return_there_is_no_information():
    occupied = np.zeros((50, 50), bool)
    occupied[:, 49] = True
    assert not at_pose(occupied, 0.1, 25, 5, 0, lidar(max_range=4.0)).any()
    assert not at_pose(occupied, 0.1, 25, 49.5, 0, lidar()).any()  # within the wall
    assert not at_pose(occupied, 0.1, 25, 45, 0, lidar(forward=2.0)).any()  # beyond the map
    assert not at_pose(occupied, 0.1, 25, 45, 0, lidar(angles=[])).any()


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_quarter_turn_of_everything_turns_the_information(quarters):
    occupied = random_stops((60, 60), 21, 0.02)
    occupied[[0, 59]] = occupied[:, [0, 59]] = True
    beams = lidar(FULL_CIRCLE + 0.1, 0.15, -0.1, 0.3, max_range=5.0)
    row, col, heading = 31.3, 20.6, 0.8
    before = at_pose(occupied, 0.1, row, col, heading, beams)
    turned_map, turned_row, turned_col = occupied, row, col
    for _ in range(quarters):  # x' = -y, y' = x
        turned_map = np.ascontiguousarray(turned_map.T[:, ::-1])
        turned_row, turned_col = turned_col, 60 - turned_row
    angle = quarters * math.pi / 2
    after = at_pose(turned_map, 0.1, turned_row, turned_col, heading + angle, beams)
    cos, sin = round(math.cos(angle)), round(math.sin(angle))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        after, turn @ before @ turn.T, rtol=1e-4, atol=1e-5 * np.abs(before).max()
    )


def test_a_mounted_lidar_is_a_lidar_there_seen_from_here():
    occupied = random_stops((60, 60), 22, 0.02)
    forward, left, yaw, heading = 0.35, -0.2, 0.6, 1.1
    cos, sin = math.cos(heading), math.sin(heading)
    lever = np.array([cos * forward - sin * left, sin * forward + cos * left])
    lever = np.round(lever / 0.1 / FRACTION) * FRACTION * 0.1
    mounted = at_pose(occupied, 0.1, 30, 30, heading, lidar(FULL_CIRCLE, forward, left, yaw))
    there = at_pose(occupied, 0.1, 30 + lever[1] / 0.1, 30 + lever[0] / 0.1, heading + yaw, lidar())
    moves = np.array([[1, 0, -lever[1]], [0, 1, lever[0]], [0, 0, 1]])
    np.testing.assert_allclose(mounted, moves.T @ there @ moves, rtol=1e-9, atol=1e-3)


def test_a_full_circle_of_beams_knows_no_heading():
    occupied = random_stops((60, 60), 23, 0.02)
    one = at_pose(occupied, 0.1, 30.2, 30.4, 0.0, lidar())
    other = at_pose(occupied, 0.1, 30.2, 30.4, math.radians(90), lidar())
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * np.abs(one).max())


def test_information_grows_as_the_noise_falls():
    occupied = random_stops((60, 60), 24, 0.02)
    coarse = at_pose(occupied, 0.1, 30, 30, 0, lidar(sigma=0.1))
    fine = at_pose(occupied, 0.1, 30, 30, 0, lidar(sigma=0.02))
    np.testing.assert_allclose(fine, 25 * coarse)


def test_a_batch_is_its_single_poses_and_can_be_stopped():
    occupied = random_stops((60, 60), 25, 0.02)
    squares, normals, beams = empty_squares(occupied), surface_normals(occupied), lidar(forward=0.2)
    rows, cols = np.array([20.5, 30.5, 40.5]), np.array([11.5, 30.5, 44.5])
    headings, control = np.array([0.0, 1.0]), np.zeros(2, np.int64)
    found = information(squares, normals, 0.1, rows, cols, headings, beams, control)
    assert found.shape == (3, 2, 3, 3)
    assert control[DONE] == 3
    for n in range(3):
        for k in range(2):
            single = at_pose(occupied, 0.1, rows[n], cols[n], headings[k], beams)
            np.testing.assert_array_equal(found[n, k], single)
            np.testing.assert_array_equal(single, single.T)
            assert np.linalg.eigvalsh(single).min() > -1e-9 * single.max()
    control[STOP] = 1
    stopped = information(squares, normals, 0.1, rows, cols, headings, beams, control)
    assert np.isnan(stopped).all()

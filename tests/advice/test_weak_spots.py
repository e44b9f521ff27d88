"""Degenerate areas: polygons of cells with high u, and their properties."""

import dataclasses
import math
from itertools import pairwise

import cv2
import numpy as np
import pytest
from matplotlib.path import Path
from support.maps import ascii_map, random_rooms

import locplan
from locplan.advice.weak_spots import find_degenerate_areas, find_weak_spots, mark_crossing_lines
from locplan.errors import ConfigError, FieldError
from locplan.field import CovarianceField, FieldConfig, Sad, SearchWindow
from locplan.field.covariance import DEGENERATE
from locplan.maps import FREE, OccupancyGrid, environments
from locplan.planning import Costmap

PERFECT = 0.2 / math.sqrt(12)


def make_random_field(
    cells, *, blur=0.5, seed=0, resolution=0.05, origin=(1.5, -2.0, 0.0), stride=None
):
    """Return a costmap and its field, whose random u varies smoothly over `blur` metres."""
    grid = OccupancyGrid(cells, resolution, origin, "random field")
    config = FieldConfig(Sad(), stride=stride or resolution)
    step = round((stride or resolution) / resolution)
    free = grid.free[::step, ::step]
    noise = np.random.default_rng(seed).normal(size=free.shape)
    if blur:
        noise = cv2.GaussianBlur(noise, (0, 0), blur / resolution / step)
    height = (noise - noise.min()) / np.ptp(noise)
    covariance = np.zeros((*free.shape, 3, 3))
    covariance[..., 0, 0] = (PERFECT * np.exp(3 * height)) ** 2
    covariance[..., 1, 1], covariance[..., 2, 2] = PERFECT**2, 0.05**2
    covariance[~free] = np.nan
    field = CovarianceField(covariance, grid, config)
    return Costmap.from_field(field), field


def find_mask_areas(mask, resolution=1.0):
    """Return the areas of the cells of a mask, (H, W), on a free map."""
    costs, field = make_random_field(np.full(mask.shape, FREE, np.uint8), resolution=resolution)
    costs = dataclasses.replace(costs, u=mask.astype(float))
    return find_degenerate_areas(costs, field, threshold=0.5, min_area=0.0)


def signed_area(ring):
    """Return the area of a ring (n, 2), negative if it runs clockwise."""
    (x, y), (ahead, above) = np.array(ring).T, np.roll(ring, -1, axis=0).T
    return np.sum(x * above - ahead * y) / 2


def number_cells(areas, grid):
    """Return the number of the area around each cell's centre, (H, W); 0 is outside."""
    rows, cols = np.indices(grid.shape) + 0.5
    centres = np.stack(grid.grid_to_world(rows.ravel(), cols.ravel()), axis=1)
    numbers = np.zeros(len(centres), int)
    for n, area in enumerate(areas, start=1):
        here = Path(area.outline).contains_points(centres)
        for hole in area.holes:
            here &= ~Path(hole).contains_points(centres)
        assert not numbers[here].any(), "areas overlap"
        numbers[here] = n
    return numbers.reshape(grid.shape)


def near_pairs(some, lines):
    """Yield pairs of lines with meeting boxes; the ends of a line are its last two items.

    The first line of a pair is one of `some`, with which `lines` begins.
    """
    ends = np.array([line[-2:] for line in lines])
    low, high = ends.min(axis=1), ends.max(axis=1)
    for m, line in enumerate(some):
        meet = (low[m + 1 :] <= high[m]).all(axis=1) & (high[m + 1 :] >= low[m]).all(axis=1)
        for other in np.flatnonzero(meet) + m + 1:
            yield line, lines[other]


def crosses(a, b, c, d):
    """True if two lines meet, by the orientation of their ends."""

    def side(p, q, r):
        value = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        return 0 if abs(value) < 1e-9 else math.copysign(1, value)

    if max(a[0], b[0]) < min(c[0], d[0]) or max(c[0], d[0]) < min(a[0], b[0]):
        return False
    if max(a[1], b[1]) < min(c[1], d[1]) or max(c[1], d[1]) < min(a[1], b[1]):
        return False
    return side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0


def check_valid(area):
    """Check that rings do not cross, wind in the right direction, and have holes inside."""
    lines = []
    for n, ring in enumerate([area.outline, *area.holes]):
        assert len(ring) >= 3
        closed = [*ring.tolist(), ring[0].tolist()]
        for k, (start, end) in enumerate(pairwise(closed)):
            lines.append((n, k, len(ring), start, end))
    for m, (n, k, size, a, b) in enumerate(lines):
        for other, j, _, c, d in lines[m + 1 :]:
            neighbours = n == other and (abs(k - j) == 1 or abs(k - j) == size - 1)
            assert neighbours or not crosses(a, b, c, d)
    assert signed_area(area.outline) > 0
    for hole in area.holes:
        assert signed_area(hole) < 0
        assert Path(area.outline).contains_points(hole).all()


@pytest.fixture(scope="module")
def corridors():
    grid = locplan.load_map("maps/two_corridors.yaml")
    field = locplan.load_or_compute(grid, Sad())
    return Costmap.from_field(field), field


def test_only_straight_corridor_is_degenerate(corridors):
    (area,) = find_degenerate_areas(*corridors)
    low, high = area.outline.min(axis=0), area.outline.max(axis=0)
    assert high[0] - low[0] > 15
    assert (low[1], high[1]) == pytest.approx((2.0, 4.0), abs=0.06)
    assert area.middle == pytest.approx((20.0, 3.0), abs=0.5)
    assert area.direction == pytest.approx(0.0, abs=0.02)
    assert area.agreement > 0.95
    assert 1.1 < area.position_std < 1.25
    assert area.area == pytest.approx(signed_area(area.outline), rel=0.02)
    assert math.degrees(area.heading_std) == pytest.approx(2.9, abs=0.1)
    assert repr(area).startswith("DegenerateArea(35.8 m²")


def test_areas_turn_with_map_cells():
    cells = np.full((33, 121), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    cells[1:13] = cells[21:32] = 0
    cells[6:28, 1:20] = FREE
    results = []
    for turned in (cells, np.rot90(cells, -1)):  # rows upwards: counter-clockwise
        grid = OccupancyGrid(np.ascontiguousarray(turned), 0.1)
        field = locplan.covariance_field(grid, Sad(range=2.0))
        results.append((grid, find_degenerate_areas(Costmap.from_field(field), field)))
    (_, (one, *others)), (turned, (other, *_)) = results
    assert not others
    width = turned.shape[1] * turned.resolution
    expected = np.stack([width - one.outline[:, 1], one.outline[:, 0]], axis=1)
    shape = Path(expected)
    rows, cols = np.indices(turned.shape) + 0.5
    centres = np.stack(turned.grid_to_world(rows.ravel(), cols.ravel()), axis=1)
    both = shape.contains_points(centres), Path(other.outline).contains_points(centres)
    assert np.sum(both[0] & both[1]) > 0.97 * np.sum(both[0] | both[1])
    assert math.cos(2 * (other.direction - one.direction)) == pytest.approx(-1, abs=1e-3)


@pytest.mark.parametrize("yaw", [0.7, math.pi / 2, -2.5])
def test_polygons_turn_with_map_yaw(yaw):
    cells = random_rooms((90, 130), seed=2)
    straight = find_degenerate_areas(
        *make_random_field(cells, origin=(0.0, 0.0, 0.0)), threshold=0.2
    )
    turned = find_degenerate_areas(*make_random_field(cells, origin=(3.0, 4.0, yaw)), threshold=0.2)
    matrix = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    assert len(straight) == len(turned) > 0
    for one, other in zip(straight, turned, strict=True):
        for ring, expected in zip(
            [other.outline, *other.holes], [one.outline, *one.holes], strict=True
        ):
            np.testing.assert_allclose(ring, expected @ matrix.T + (3.0, 4.0), atol=1e-9)
        np.testing.assert_allclose(other.middle, matrix @ one.middle + (3.0, 4.0))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blur", [0.15, 0.4, 1.0])
def test_valid_polygons_cover_degenerate_cells(seed, blur):
    costs, field = make_random_field(random_rooms((100, 140), seed), blur=blur, seed=seed)
    areas = find_degenerate_areas(costs, field, threshold=0.18, min_area=0.2)
    grid = costs.grid
    _, labels = cv2.connectedComponents((costs.u >= 0.18).astype(np.uint8), connectivity=4)
    cell = grid.resolution**2
    sizes = np.bincount(labels.ravel())[1:] * cell
    assert [a.area for a in areas] == pytest.approx(sorted(sizes[sizes >= 0.2 - 1e-9])[::-1])
    numbers = number_cells(areas, grid)
    chosen = np.isin(labels, np.flatnonzero(sizes >= 0.2 - 1e-9) + 1)
    assert np.mean(numbers[chosen] > 0) >= 0.97
    assert np.mean(chosen[numbers > 0]) >= 0.95
    for n, area in enumerate(areas, start=1):
        check_valid(area)
        row, col = grid.cell(area.middle)
        assert numbers[row, col] == n
        assert chosen[row, col]


@pytest.mark.parametrize("density", [0.3, 0.5, 0.6, 0.8])
def test_rings_of_noise_never_meet(density):
    mask = np.random.default_rng(7).random((40, 50)) < density
    areas = find_mask_areas(mask)
    number, _ = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    assert len(areas) == number - 1
    lines = []
    for m, area in enumerate(areas):
        check_valid(area)
        for n, ring in enumerate((area.outline, *area.holes)):
            lines += [
                (m, n, k, len(ring), ring[k], ring[(k + 1) % len(ring)]) for k in range(len(ring))
            ]
    edges = sum(np.count_nonzero(np.diff(np.pad(mask, 1), axis=axis)) for axis in (0, 1))
    assert len(lines) < 0.9 * edges
    for (*ring, k, size, a, b), (*other, j, _, c, d) in near_pairs(lines[:400], lines):
        if not (ring == other and (abs(k - j) == 1 or abs(k - j) == size - 1)):
            assert not crosses(a, b, c, d)


def test_ring_follows_cell_edges():
    (area,) = find_mask_areas(np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]], bool))
    corners = {tuple(each) for each in (area.outline - (1.5, -2.0)).tolist()}
    assert corners == {(0, 0), (2, 0), (2, 2), (0, 2)}


def test_narrow_holes_and_stripes_keep_shape():
    mask = np.ones((40, 40), bool)
    mask[20, 10:13] = False
    (area,) = find_mask_areas(mask, resolution=0.5)
    assert [signed_area(hole) for hole in area.holes] == [pytest.approx(-3 / 4, rel=0.1)]
    assert signed_area(area.outline) == pytest.approx(1600 / 4, rel=0.01)
    row, col = np.indices((30, 30))
    stripe = np.abs(col - 2 * row) <= 1
    (area,) = find_mask_areas(stripe)
    assert signed_area(area.outline) == pytest.approx(stripe.sum(), rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_polygons_of_noise_never_overlap(seed):
    costs, field = make_random_field(np.full((50, 60), FREE, np.uint8), blur=0)
    noise = np.random.default_rng(seed).random((50, 60)) * 0.95
    costs = dataclasses.replace(costs, u=np.maximum(noise, np.roll(noise, 1, axis=seed % 2)))
    areas = find_degenerate_areas(costs, field, threshold=0.62, min_area=0.01)
    assert len(areas) > 20
    assert sum(len(area.holes) for area in areas) > 0
    number_cells(areas, costs.grid)  # raises if areas overlap
    lines = []
    for n, area in enumerate(areas):
        check_valid(area)
        for ring in (area.outline, *area.holes):
            lines += [(n, a, b) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    for (n, a, b), (other, c, d) in near_pairs(lines, lines):
        assert n == other or not crosses(a, b, c, d)


def test_crossing_lines_are_marked():
    bow = np.array([[0, 0], [8, 8], [8, 0], [0, 8]])
    apart = np.array([[20, 0], [30, 0], [30, 10]])
    assert mark_crossing_lines([bow, apart]).tolist() == [
        True,
        False,
        True,
        False,
        False,
        False,
        False,
    ]
    touching = np.array([[25, 5], [21, 20], [11, 20]])  # its first corner lies on a line
    assert mark_crossing_lines([apart, touching]).any()
    back = np.array([[0, 0], [8, 0], [4, 0], [4, 6]])
    assert mark_crossing_lines([back]).any()


def test_small_holes_are_filled():
    """Larger holes stay."""
    cells = np.full((80, 100), FREE, np.uint8)
    cells[20:25, 20:25] = 0  # 0.0625 m²
    cells[40:50, 40:50] = 0  # 0.25 m²
    costs, field = make_random_field(cells)
    (area,) = find_degenerate_areas(costs, field, threshold=0.0)
    (hole,) = area.holes
    assert -signed_area(hole) == pytest.approx(0.25)
    assert area.area == pytest.approx(80 * 100 * 0.0025 - 0.3125)
    assert signed_area(area.outline) == pytest.approx(80 * 100 * 0.0025)


def test_filled_holes_stay_below_area_limit():
    cells = np.full((80, 100), FREE, np.uint8)
    cells[5::10, 5::10] = cells[5::10, 6::10] = 0  # 80 of 0.005 m²: 2 %
    cells[2:4, 2:4] = 0
    (area,) = find_degenerate_areas(*make_random_field(cells), threshold=0.0)
    assert 1 <= len(area.holes) < 10
    whole = signed_area(area.outline) + sum(map(signed_area, area.holes))
    assert area.area < whole < 1.021 * area.area


def test_areas_between_lattice_points_are_found():
    cells = np.zeros((41, 60), np.uint8)
    cells[::4] = FREE
    costs, field = make_random_field(cells, stride=0.2, blur=0)
    narrow = np.zeros(cells.shape)
    narrow[8, 1:4] = 1.0
    costs = dataclasses.replace(costs, u=np.where(costs.grid.free, narrow, np.nan))
    (area,) = find_degenerate_areas(costs, field, threshold=0.5, min_area=0.0)
    assert area.area == pytest.approx(3 * 0.0025)
    ends = sorted(np.sqrt(field.covariance[2, :2, 0, 0]))
    assert ends[0] <= area.position_std <= ends[1]


def test_default_threshold_is_half_of_corridor(corridors):
    """The corridor has no features."""

    def sizes(costs, threshold=None):
        return sum(each.area for each in find_degenerate_areas(costs, field, threshold=threshold))

    costs, field = corridors
    for law in ("logarithmic", "linear", "cube-root"):
        costs = Costmap.from_field(field, law=law)
        half = costs.u[60, 400] / 2  # in the corridor
        assert sizes(costs) == pytest.approx(sizes(costs, half), rel=0.02)
        assert sizes(costs, half * 0.8) > sizes(costs) > sizes(costs, half * 1.2)
    turn = Costmap.from_field(field, criterion="heading_std")
    assert sizes(turn) == sizes(turn, DEGENERATE)


def test_areas_without_rotation_have_no_heading():
    grid = ascii_map(*["." * 30] * 20, resolution=0.2)
    window = SearchWindow(half_rotation_deg=0)
    covariance = np.tile(np.diag([0.04, 0.3]), (20, 30, 1, 1))
    field = CovarianceField(covariance, grid, FieldConfig(Sad(window=window)))
    (area,) = find_degenerate_areas(Costmap.from_field(field), field)
    assert math.isnan(area.heading_std)
    assert abs(area.direction) == pytest.approx(math.pi / 2)


def test_degenerate_areas_reject_bad_arguments(corridors):
    costs, field = corridors
    for wrong in ({"threshold": -0.1}, {"threshold": math.nan}, {"min_area": -1.0}):
        with pytest.raises(ConfigError):
            find_degenerate_areas(costs, field, **wrong)
    assert find_degenerate_areas(Costmap.blank(costs.grid), field) == ()
    other = environments.make("two_corridors", resolution=0.1)
    with pytest.raises(FieldError, match="another map"):
        find_degenerate_areas(Costmap.blank(other), field)
    with pytest.raises(ConfigError, match="field must be"):
        find_degenerate_areas(costs, None)


def test_weak_spots_lie_in_largest_part(corridors):
    """Without routes, the largest connected part counts."""
    costs, field = corridors
    path = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0)).path
    (spot, *_), (of_route, *_) = (
        find_weak_spots(costs, field, 6.0, paths) for paths in ({}, {"": path})
    )
    assert (spot.length, spot.missing, spot.routes) == (of_route.length, of_route.missing, ())
    part = costs.with_blocked(
        np.arange(costs.grid.shape[1])[None] > costs.grid.cell((12.0, 3.0))[1]
    )
    assert all(other.x < 13.0 for other in find_weak_spots(part, field, 6.0, {}))

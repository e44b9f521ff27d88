"""Degenerate areas: polygons that hold the cells of high u, and what is said of them."""

import dataclasses
import json
import math
from itertools import pairwise
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import yaml
from conftest import drawn, random_rooms
from matplotlib.collections import LineCollection
from matplotlib.path import Path

import locplan
from locplan.costs import DEGENERATE, Costmap
from locplan.errors import ConfigError, FieldError
from locplan.export import degenerate_areas, save_degenerate_areas
from locplan.export._outlines import meeting
from locplan.field import CovarianceField, FieldConfig, Sad, Scan, SearchWindow
from locplan.maps import FREE, UNKNOWN, OccupancyGrid, environments
from locplan.robots import Lidar

PERFECT = 0.2 / math.sqrt(12)


def made_up(cells, *, blur=0.5, seed=0, resolution=0.05, origin=(1.5, -2.0, 0.0), stride=None):
    """A map with a costmap whose u varies smoothly over `blur` metres, and its field."""
    grid = OccupancyGrid(cells, resolution, origin, "made up")
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
    return Costmap.from_field(grid, field), field


def marked(mask, resolution=1.0):
    """The areas of the cells of a mask, (H, W), on a free map."""
    costs, field = made_up(np.full(mask.shape, FREE, np.uint8), resolution=resolution)
    costs = dataclasses.replace(costs, u=mask.astype(float))
    return degenerate_areas(costs, field, threshold=0.5, min_area=0.0)


def signed_area(ring):
    """Area of a ring (n, 2), negative if it runs clockwise."""
    (x, y), (ahead, above) = np.array(ring).T, np.roll(ring, -1, axis=0).T
    return np.sum(x * above - ahead * y) / 2


def inside(areas, grid):
    """The number of the area that each cell's centre lies in, from 1 on, (H, W)."""
    rows, cols = np.indices(grid.shape) + 0.5
    centres = np.stack(grid.grid_to_world(rows.ravel(), cols.ravel()), axis=1)
    found = np.zeros(len(centres), int)
    for n, area in enumerate(areas, start=1):
        here = Path(area.outline).contains_points(centres)
        for hole in area.holes:
            here &= ~Path(hole).contains_points(centres)
        assert not found[here].any(), "areas overlap"
        found[here] = n
    return found.reshape(grid.shape)


def near_pairs(some, lines):
    """Pairs of lines, each the last two of its tuple, whose boxes meet; `some` are the first."""
    ends = np.array([line[-2:] for line in lines])
    low, high = ends.min(axis=1), ends.max(axis=1)
    for m, line in enumerate(some):
        meet = (low[m + 1 :] <= high[m]).all(axis=1) & (high[m + 1 :] >= low[m]).all(axis=1)
        for other in np.flatnonzero(meet) + m + 1:
            yield line, lines[other]


def crosses(a, b, c, d):
    """Whether two lines meet, by the orientation of their ends."""

    def side(p, q, r):
        value = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        return 0 if abs(value) < 1e-9 else math.copysign(1, value)

    if max(a[0], b[0]) < min(c[0], d[0]) or max(c[0], d[0]) < min(a[0], b[0]):
        return False
    if max(a[1], b[1]) < min(c[1], d[1]) or max(c[1], d[1]) < min(a[1], b[1]):
        return False
    return side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0


def check_valid(area):
    """Raise unless an area's rings are simple, wound as they must be, and its holes inside."""
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
    return Costmap.from_field(grid, field), field


def test_the_straight_corridor_is_the_only_area(corridors):
    (area,) = degenerate_areas(*corridors)
    assert area.name == "area-1"
    low, high = area.outline.min(axis=0), area.outline.max(axis=0)
    assert high[0] - low[0] > 15
    assert (low[1], high[1]) == pytest.approx((2.0, 4.0), abs=0.06)
    assert area.middle == pytest.approx((20.0, 3.0), abs=0.5)
    assert area.direction == pytest.approx(0.0, abs=0.02)
    assert area.agreement > 0.95
    assert 1.1 < area.position_std < 1.25
    assert area.worst_position_std >= area.position_std > 10 * area.minor_position_std
    assert 0.1 < area.u_mean < area.u_max < 0.4
    assert area.area == pytest.approx(signed_area(area.outline), rel=0.02)
    assert math.degrees(area.heading_std) == pytest.approx(2.9, abs=0.1)
    assert repr(area).startswith("DegenerateArea(area-1: 35.8 m²")


def test_a_map_turned_by_90_degrees_has_turned_areas():
    cells = np.full((33, 121), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    cells[1:13] = cells[21:32] = 0
    cells[6:28, 1:20] = FREE
    results = []
    for turned in (cells, np.rot90(cells, -1)):  # rows upwards: counter-clockwise
        grid = OccupancyGrid(np.ascontiguousarray(turned), 0.1)
        field = locplan.covariance_field(grid, Sad(range=2.0))
        results.append((grid, degenerate_areas(Costmap.from_field(grid, field), field)))
    (_, (one, *others)), (turned, (other, *_)) = results
    assert not others
    width = turned.shape[1] * turned.resolution
    expected = np.stack([width - one.outline[:, 1], one.outline[:, 0]], axis=1)
    shape = Path(expected)
    rows, cols = np.indices(turned.shape) + 0.5
    centres = np.stack(turned.grid_to_world(rows.ravel(), cols.ravel()), axis=1)
    both = shape.contains_points(centres), Path(other.outline).contains_points(centres)
    assert np.sum(both[0] & both[1]) > 0.97 * np.sum(both[0] | both[1])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        other.covariance, quarter @ one.covariance @ quarter.T, rtol=0.1, atol=1e-4
    )
    assert math.cos(2 * (other.direction - one.direction)) == pytest.approx(-1, abs=1e-3)


@pytest.mark.parametrize("yaw", [0.7, math.pi / 2, -2.5])
def test_the_yaw_of_a_map_turns_polygons(yaw):
    cells = random_rooms((90, 130), seed=2)
    straight = degenerate_areas(*made_up(cells, origin=(0.0, 0.0, 0.0)), threshold=0.2)
    turned = degenerate_areas(*made_up(cells, origin=(3.0, 4.0, yaw)), threshold=0.2)
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
def test_polygons_hold_the_cells_and_are_valid(seed, blur):
    costs, field = made_up(random_rooms((100, 140), seed), blur=blur, seed=seed)
    areas = degenerate_areas(costs, field, threshold=0.18, min_area=0.2)
    grid = costs.grid
    _, labels = cv2.connectedComponents((costs.u >= 0.18).astype(np.uint8), connectivity=4)
    cell = grid.resolution**2
    sizes = np.bincount(labels.ravel())[1:] * cell
    assert [a.area for a in areas] == pytest.approx(sorted(sizes[sizes >= 0.2 - 1e-9])[::-1])
    assert [a.name for a in areas] == [f"area-{n + 1}" for n in range(len(areas))]
    found = inside(areas, grid)
    chosen = np.isin(labels, np.flatnonzero(sizes >= 0.2 - 1e-9) + 1)
    assert np.mean(found[chosen] > 0) >= 0.97
    assert np.mean(chosen[found > 0]) >= 0.95
    for n, area in enumerate(areas, start=1):
        check_valid(area)
        row, col = grid.world_to_cell(*area.middle)
        assert found[row, col] == n
        assert chosen[row, col]
        assert costs.u[labels == labels[row, col]].max() == pytest.approx(area.u_max)
        assert costs.u[labels == labels[row, col]].mean() == pytest.approx(area.u_mean)


@pytest.mark.parametrize("density", [0.3, 0.5, 0.6, 0.8])
def test_rings_of_noise_never_meet(density):
    mask = np.random.default_rng(7).random((40, 50)) < density
    areas = marked(mask)
    number, _ = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    assert len(areas) == number - 1
    lines = []
    for area in areas:
        check_valid(area)
        for n, ring in enumerate((area.outline, *area.holes)):
            lines += [
                (area.name, n, k, len(ring), ring[k], ring[(k + 1) % len(ring)])
                for k in range(len(ring))
            ]
    edges = sum(np.count_nonzero(np.diff(np.pad(mask, 1), axis=axis)) for axis in (0, 1))
    assert len(lines) < 0.9 * edges
    for (*ring, k, size, a, b), (*other, j, _, c, d) in near_pairs(lines[:400], lines):
        if not (ring == other and (abs(k - j) == 1 or abs(k - j) == size - 1)):
            assert not crosses(a, b, c, d)


def test_a_ring_follows_the_edges_of_cells():
    (area,) = marked(np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]], bool))
    corners = {tuple(each) for each in (area.outline - (1.5, -2.0)).tolist()}
    assert corners == {(0, 0), (2, 0), (2, 2), (0, 2)}


def test_narrow_holes_and_stripes_keep_their_shape():
    mask = np.ones((40, 40), bool)
    mask[20, 10:13] = False
    (area,) = marked(mask, resolution=0.5)
    assert [signed_area(hole) for hole in area.holes] == [pytest.approx(-3 / 4, rel=0.1)]
    assert signed_area(area.outline) == pytest.approx(1600 / 4, rel=0.01)
    row, col = np.indices((30, 30))
    stripe = np.abs(col - 2 * row) <= 1
    (area,) = marked(stripe)
    assert signed_area(area.outline) == pytest.approx(stripe.sum(), rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_polygons_of_noise_are_valid_and_apart(seed):
    costs, field = made_up(np.full((50, 60), FREE, np.uint8), blur=0)
    noise = np.random.default_rng(seed).random((50, 60)) * 0.95
    costs = dataclasses.replace(costs, u=np.maximum(noise, np.roll(noise, 1, axis=seed % 2)))
    areas = degenerate_areas(costs, field, threshold=0.62, min_area=0.01)
    assert len(areas) > 20
    assert sum(len(area.holes) for area in areas) > 0
    inside(areas, costs.grid)
    lines = []
    for n, area in enumerate(areas):
        check_valid(area)
        for ring in (area.outline, *area.holes):
            lines += [(n, a, b) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    for (n, a, b), (other, c, d) in near_pairs(lines, lines):
        assert n == other or not crosses(a, b, c, d)


def test_lines_that_meet_are_found():
    bow = np.array([[0, 0], [8, 8], [8, 0], [0, 8]])
    apart = np.array([[20, 0], [30, 0], [30, 10]])
    assert meeting([bow, apart]).tolist() == [True, False, True, False, False, False, False]
    touching = np.array([[25, 5], [21, 20], [11, 20]])  # its first corner lies on a line
    assert meeting([apart, touching]).any()
    back = np.array([[0, 0], [8, 0], [4, 0], [4, 6]])
    assert meeting([back]).any()


def test_small_holes_are_filled_and_others_kept():
    cells = np.full((80, 100), FREE, np.uint8)
    cells[20:25, 20:25] = 0  # 0.0625 m²
    cells[40:50, 40:50] = 0  # 0.25 m²
    costs, field = made_up(cells)
    (area,) = degenerate_areas(costs, field, threshold=0.0)
    (hole,) = area.holes
    assert -signed_area(hole) == pytest.approx(0.25)
    assert area.area == pytest.approx(80 * 100 * 0.0025 - 0.3125)
    assert signed_area(area.outline) == pytest.approx(80 * 100 * 0.0025)


def test_many_small_holes_are_not_all_filled():
    cells = np.full((80, 100), FREE, np.uint8)
    cells[5::10, 5::10] = cells[5::10, 6::10] = 0  # 80 of 0.005 m²: 2 %
    cells[2:4, 2:4] = 0
    (area,) = degenerate_areas(*made_up(cells), threshold=0.0)
    assert 1 <= len(area.holes) < 10
    whole = signed_area(area.outline) + sum(map(signed_area, area.holes))
    assert area.area < whole < 1.021 * area.area


def test_areas_between_the_points_of_the_lattice_are_read():
    cells = np.zeros((41, 60), np.uint8)
    cells[::4] = FREE
    costs, field = made_up(cells, stride=0.2, blur=0)
    narrow = np.zeros(cells.shape)
    narrow[8, 1:4] = 1.0
    costs = dataclasses.replace(costs, u=np.where(costs.grid.free, narrow, np.nan))
    (area,) = degenerate_areas(costs, field, threshold=0.5, min_area=0.0)
    assert area.area == pytest.approx(3 * 0.0025)
    assert np.isfinite(area.covariance).all()
    ends = sorted(np.sqrt(field.covariance[2, :2, 0, 0]))
    assert ends[0] <= area.position_std <= ends[1]


def test_the_default_is_half_of_a_corridor_without_features(tmp_path, corridors):
    def default(costs, field):
        save_degenerate_areas(tmp_path / "areas", costs, field)
        return json.loads((tmp_path / "areas" / "export.json").read_text())["threshold"]

    costs, field = corridors
    assert default(costs, field) == pytest.approx(0.176, abs=0.002)
    assert default(costs, field) == pytest.approx(costs.u[60, 400] / 2, rel=0.01)
    grid = drawn("....", "....", "....", resolution=0.2)
    by_scan = locplan.covariance_field(grid, Scan(Lidar(range=2.0)))
    assert default(Costmap.from_field(grid, by_scan), by_scan) == DEGENERATE
    for law in ("linear", "cube-root"):
        other = Costmap.from_field(costs.grid, field, law=law)
        assert default(other, field) == pytest.approx(other.u[60, 400] / 2, rel=0.02)
    turn = Costmap.from_field(costs.grid, field, criterion="heading_std")
    assert default(turn, field) == DEGENERATE


def test_geojson_is_wound_and_closed_as_rfc_7946_has_it(tmp_path):
    cells = np.full((80, 100), FREE, np.uint8)
    cells[30:50, 40:60] = 0
    costs, field = made_up(cells)
    (area,) = save_degenerate_areas(tmp_path / "out", costs, field, threshold=0.0, frame="lab")
    read = json.loads((tmp_path / "out" / "areas.geojson").read_text())
    assert read["type"] == "FeatureCollection"
    (feature,) = read["features"]
    assert feature["geometry"]["type"] == "Polygon"
    outer, hole = map(np.array, feature["geometry"]["coordinates"])
    for ring in (outer, hole):
        assert (ring[0] == ring[-1]).all()
    assert signed_area(outer[:-1]) == pytest.approx(20.0)
    assert signed_area(hole[:-1]) == pytest.approx(-1.0)
    about = feature["properties"]
    assert about["frame"] == "lab"
    assert about["area"] == pytest.approx(19.0)
    assert np.shape(about["covariance"]) == (3, 3)
    known = field.covariance[field.evaluated]
    deviations = np.sqrt(np.linalg.eigvalsh(known[:, :2, :2])[:, 1])
    assert about["position_std"] == pytest.approx(np.median(deviations))
    assert about["worst_position_std"] == pytest.approx(deviations.max())
    assert about["heading_std"] == pytest.approx(0.05)
    information = np.linalg.inv(known).mean(axis=0)
    np.testing.assert_allclose(about["covariance"], np.linalg.inv(information), rtol=1e-6)
    assert about["direction"] == pytest.approx(0.0)
    assert area.direction == about["direction"]


def test_areas_without_rotation_have_no_heading(tmp_path):
    grid = drawn(*["." * 30] * 20, resolution=0.2)
    window = SearchWindow(half_rotation_deg=0)
    covariance = np.tile(np.diag([0.04, 0.3]), (20, 30, 1, 1))
    field = CovarianceField(covariance, grid, FieldConfig(Sad(window=window)))
    (area,) = save_degenerate_areas(tmp_path / "out", Costmap.from_field(grid, field), field)
    assert math.isnan(area.heading_std)
    (feature,) = json.loads((tmp_path / "out" / "areas.geojson").read_text())["features"]
    assert feature["properties"]["heading_std"] is None
    assert abs(area.direction) == pytest.approx(math.pi / 2)
    assert area.covariance.shape == (2, 2)


@pytest.mark.draws
@pytest.mark.parametrize("level", [UNKNOWN, 0, FREE])
def test_without_any_area_files_are_valid_and_say_so(tmp_path, level):
    grid = OccupancyGrid(np.full((31, 22), level, np.uint8), 0.1, name="bare")
    field = locplan.covariance_field(grid, Sad(range=0.5))
    costs = Costmap.from_field(grid, field)
    areas = save_degenerate_areas(tmp_path / "out", costs, field, min_area=1000.0)
    assert areas == ()
    read = json.loads((tmp_path / "out" / "areas.geojson").read_text())
    assert read["features"] == []
    assert "No degenerate areas" in (tmp_path / "out" / "README.md").read_text()
    assert not ElementTree.parse(tmp_path / "out" / "degenerate_areas.osm").findall("way")
    assert yaml.safe_load((tmp_path / "out" / "environment_adaptor.param.yaml").read_text())


def lanelet2_polygons(file):
    """Polygons as Lanelet2 and Autoware's local projector read them: ways with area=yes."""
    root = ElementTree.parse(file).getroot()
    assert root.find("MetaInfo").get("format_version")[0].isdigit()

    def tags(element):
        return {tag.get("k"): tag.get("v") for tag in element.findall("tag")}

    nodes = {node.get("id"): tags(node) for node in root.findall("node")}
    ids = [each.get("id") for each in [*root.findall("node"), *root.findall("way")]]
    assert len(set(ids)) == len(ids)
    for way in root.findall("way"):
        about = tags(way)
        if about.get("area") == "yes" and about["type"] == "degenerate_area":
            points = [nodes[nd.get("ref")] for nd in way.findall("nd")]
            yield about["subtype"], [(float(p["local_x"]), float(p["local_y"])) for p in points]


def test_autoware_reads_polygons_without_holes_and_their_covariances(tmp_path):
    cells = np.full((120, 160), FREE, np.uint8)
    for row, col in [(20, 20), (20, 60), (20, 100), (60, 40), (80, 40), (60, 110)]:
        cells[row : row + 12, col : col + 15] = 0
    cells[:, 135] = 0
    costs, field = made_up(cells, origin=(3.0, 1.0, 0.3))
    areas = save_degenerate_areas(tmp_path / "out", costs, field, threshold=0.0)
    assert [len(area.holes) for area in areas] == [6, 0]
    polygons = dict(lanelet2_polygons(tmp_path / "out" / "degenerate_areas.osm"))
    text = (tmp_path / "out" / "environment_adaptor.param.yaml").read_text()
    parameters = yaml.safe_load(text)["/**"]["ros__parameters"]
    rows, cols = np.indices(costs.grid.shape) + 0.5
    centres = np.stack(costs.grid.grid_to_world(rows.ravel(), cols.ravel()), axis=1)
    found = inside(areas, costs.grid).ravel()
    for n, area in enumerate(areas, start=1):
        corners = polygons[f"area_{n}"]
        within = Path([*corners, corners[0]]).contains_points(centres)
        assert np.mean(within == (found == n)) > 0.999
        environment = parameters[f"area_subtype_area_{n}"]["environment_id"]
        values = parameters[f"environment_{environment}_output_pose_covariance"]
        assert len(values) == 36
        assert all(isinstance(value, float) for value in values)
        matrix = np.reshape(values, (6, 6))
        across = area.minor_position_std if area.agreement >= 0.5 else area.position_std
        expected = [area.position_std**2, across**2, 0.0225, 0.000625, 0.000625, 0.0025]
        np.testing.assert_allclose(matrix, np.diag(expected), atol=1e-6)


def test_cuts_to_holes_keep_the_area(tmp_path):
    mask = np.ones((20, 20), bool)
    for row, col in ((2, 2), (2, 8), (9, 8), (2, 14)):
        mask[row : row + 2, col : col + 2] = False
    costs, field = made_up(np.full(mask.shape, FREE, np.uint8), resolution=0.5)
    costs = dataclasses.replace(costs, u=mask.astype(float))
    save_degenerate_areas(tmp_path / "out", costs, field, threshold=0.5, min_area=2.0)
    ((_, ring),) = lanelet2_polygons(tmp_path / "out" / "degenerate_areas.osm")
    assert signed_area(ring) == pytest.approx(100 - 4)


def test_a_line_through_the_middle_of_an_area_shows_its_direction(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(
        "locplan.export._figures.save_preview", lambda folder, figure: figures.append(figure)
    )
    grid = drawn(*["." * 30] * 20, resolution=0.2)
    covariance = np.tile(np.diag([0.02, 0.3, 0.01]), (20, 30, 1, 1))
    field = CovarianceField(covariance, grid, FieldConfig(Sad()))
    (area,) = save_degenerate_areas(tmp_path / "out", Costmap.from_field(grid, field), field)
    (axes,) = figures[0].axes
    (lines,) = (each for each in axes.collections if isinstance(each, LineCollection))
    ((begin, end),) = lines.get_segments()
    np.testing.assert_allclose((begin + end) / 2, area.middle)
    assert abs(math.sin(math.atan2(*(end - begin)[::-1]) - area.direction)) < 1e-9
    assert 0.05 < np.hypot(*(end - begin)) < math.sqrt(area.area)


def test_what_areas_cannot_be_made_of_is_refused(corridors):
    costs, field = corridors
    for wrong in ({"threshold": -0.1}, {"threshold": math.nan}, {"min_area": -1.0}):
        with pytest.raises(ConfigError):
            degenerate_areas(costs, field, **wrong)
    with pytest.raises(ConfigError, match="made of a field"):
        degenerate_areas(Costmap.blank(costs.grid), field)
    other = environments.make("two_corridors", resolution=0.1)
    with pytest.raises(FieldError, match="another map"):
        degenerate_areas(Costmap.blank(other), field)
    with pytest.raises(ConfigError, match="field must be"):
        degenerate_areas(costs, None)


def test_the_summary_names_the_number_the_share_and_the_largest(run, tmp_path):
    target = tmp_path / "out"
    line = ("export", "maps/two_corridors.yaml", "--to", "degenerate-areas", "-o", target)
    code, out, _ = run(*line)
    assert code == 0
    assert "1 with u ≥ 0.18, 12% of the free space" in out
    assert "area-1: 35.8 m², std. deviation 121 cm" in out
    code, out, _ = run(*line, "--threshold", "0.9", "--json")
    values = json.loads(out)
    assert (code, values["areas"], values["share_of_free"]) == (0, 0, 0.0)
    assert "none with u ≥ 0.9" in run(*line, "--threshold", "0.9")[1]

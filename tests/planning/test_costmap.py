import dataclasses
import math
import pickle
from functools import partial

import numpy as np
import pytest
from support import oracles
from support.maps import ascii_map, corridor, random_rooms

from locplan._support.kernels import rays
from locplan.comparison import runs
from locplan.errors import ConfigError, FieldError, PoseError
from locplan.field import CovarianceField, FieldConfig, Fisher, Sad, SearchWindow, covariance_field
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, Zone, Zones
from locplan.planning import Costmap, Path, path_cost, path_metrics
from locplan.planning.layers import HeadingLayers
from locplan.planning.metrics import compute_profile
from locplan.robots import Lidar


@pytest.fixture(scope="module")
def field():
    return covariance_field(corridor(14.0, 2.0), FieldConfig(Sad(range=3.0)))


def random_lines(count: int, size: int):
    rng = np.random.default_rng(12)
    ends = rng.uniform(0, size, (count, 4))
    ends[::5, 2] = ends[::5, 0]  # along a row
    ends[1::5, 3] = ends[1::5, 1]  # along a column
    ends[2::5] = np.floor(ends[2::5]) + 0.5  # between centres, often through corners
    return ends


def test_crossed_cells_equal_plain_loops():
    for line in random_lines(300, 20):
        rows, cols, lengths = rays.find_crossed_cells(line.reshape(2, 2))
        expected = [
            cell for cell in oracles.lines.cells_along(line.reshape(2, 2)) if cell[2] > 1e-7
        ]
        keep = lengths > 1e-7
        assert list(zip(rows[keep], cols[keep], strict=True)) == [cell[:2] for cell in expected]
        np.testing.assert_allclose(lengths[keep], [cell[2] for cell in expected], atol=1e-9)


def test_line_integral_ignores_direction():
    density = np.random.default_rng(5).uniform(1, 9, (20, 20))
    for line in random_lines(100, 19.9):
        ends = line.reshape(2, 2)
        if not (ends == np.floor(ends)).any():
            forth, back = (rays.find_crossed_cells(each) for each in (ends, ends[::-1].copy()))
            totals = [(density[row, col] * length).sum() for row, col, length in (forth, back)]
            assert totals[0] == pytest.approx(totals[1])
            expected = oracles.lines.line_integral(density, *line)
            assert totals[0] == pytest.approx(expected, rel=1e-6)


def test_path_cost_ignores_touched_corners():
    density = np.ones((3, 3))
    density[0, 1] = density[1, 0] = np.inf
    for far in (0.0, 4.5e6):  # also where the world's coordinates are rounded
        grid = OccupancyGrid(np.full((3, 3), FREE), 0.05, (far, far, 0.3))
        costs = Costmap.from_density(grid, density)
        diagonal = [grid.position(0, 0), grid.position(2, 2)]
        metrics = path_metrics(costs, Path(np.array(diagonal)))
        assert metrics.cost == pytest.approx(0.1 * math.sqrt(2), rel=1e-4)


def test_u_is_clipped_at_absolute_anchors(field):
    costs = Costmap.from_field(field, weight=4.0, robot=0.0)
    low, high = field.anchors()
    expected = np.clip(np.log(costs.e / low) / np.log(high / low), 0, 1)
    np.testing.assert_allclose(costs.u, expected)
    free = field.grid.free
    np.testing.assert_allclose(costs.density[free], 1 + 4 * costs.u[free])
    assert np.isinf(costs.density[~free]).all()


def test_paper_preset_anchors_include_quantisation():
    grid = corridor(12.0, 2.0)
    field = covariance_field(grid, dataclasses.replace(FieldConfig(Sad.paper()), stride=0.4))
    u = Costmap.from_field(field, robot=0.0).u[grid.free]
    assert np.isfinite(u).all()
    assert 0 <= u.min() < u.max() <= 1
    assert field.anchors()[0] == pytest.approx(
        covariance_field(corridor(1.0, 1.0), FieldConfig()).anchors()[0]
    )


@pytest.mark.parametrize(("law", "power"), [("linear", 1.0), ("cube-root", 1 / 3)])
def test_law_is_power_of_relative_e(field, law, power):
    costs = Costmap.from_field(field, law=law, robot=0.0)
    expected = (costs.e / field.anchors()[1]) ** power
    np.testing.assert_allclose(costs.u, np.clip(expected, 0, 1))


def test_costmap_rejects_heading_std_without_rotation():
    grid = corridor(4.0, 2.0)
    field = covariance_field(
        grid, FieldConfig(Sad(range=1.0, window=SearchWindow(half_rotation_deg=0)))
    )
    with pytest.raises(ConfigError, match="without rotation"):
        Costmap.from_field(field, criterion="heading_std", robot=0.0)


@pytest.mark.parametrize(("radius", "resolution"), [(0.15, 0.02), (0.1, 0.04), (0.25, 0.05)])
def test_robot_fits_at_clearance_of_radius(radius, resolution):
    cells = np.full((1, 40), FREE, np.uint8)
    cells[0, 0] = 0
    grid = OccupancyGrid(cells, resolution)
    costs = Costmap.blank(grid, robot=radius)
    first = np.flatnonzero(np.isfinite(costs.density[0]))[0]
    assert (first - 0.5) * resolution >= radius - 1e-9
    assert (first - 1.5) * resolution < radius - 1e-9


def test_profile_covers_whole_path():
    grid = OccupancyGrid(np.full((1, 4), FREE), 1.0)
    costs = Costmap.blank(grid, robot=0.0)
    layer = np.array([[1.0, 2.0, 3.0, 4.0]])
    distance, values = compute_profile(costs, Path(np.array([[0.5, 0.5], [2.25, 0.5]])), layer)
    assert distance.tolist() == [0.0, 0.5, 1.5, 1.75]
    assert values.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("criterion", ["position_std", "position_rms", "heading_std"])
def test_costmap_accepts_other_criteria(field, criterion):
    """u is the logarithm of the criterion between its own anchors."""
    costs, (low, high) = Costmap.from_field(field, criterion=criterion), field.anchors(criterion)
    values = field.interpolate_on_map(field.scalar(criterion, with_q=True))
    expected = np.clip(np.log(values / low) / np.log(high / low), 0, 1)
    np.testing.assert_allclose(costs.u, expected)
    assert np.ptp(expected[field.grid.free]) > 0.05


def test_robot_radius_blocks_cells_near_walls(field):
    costs = Costmap.from_field(field, robot=0.4)
    free = field.grid.free
    np.testing.assert_array_equal(np.isfinite(costs.density), free & (field.grid.clearance >= 0.4))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"weight": -1.0}, "weight"),
        ({"weight": math.nan}, "weight"),
        ({"robot": -0.1}, "robot must"),
        ({"law": "square"}, "law"),
        ({"criterion": "volume"}, "criterion"),
    ],
)
def test_bad_options_are_named(field, option, message):
    with pytest.raises(ConfigError, match=message):
        Costmap.from_field(field, **option)


@pytest.mark.parametrize(
    "density", [np.zeros((2, 2)), np.full((2, 2), np.nan), np.full((2, 2), 1e12), np.ones((3, 2))]
)
def test_bad_densities_are_refused(density):
    with pytest.raises(ConfigError, match="density"):
        Costmap.from_density(ascii_map("..", ".."), density)


def test_from_layers_ignores_occupied_cells():
    grid = ascii_map("..#", "...")
    u = np.array([[0.0, 1.0, 0.5], [0.25, 0.0, np.nan]])  # the row at the lowest y first
    costs = Costmap.from_layers(grid, u=u, weight=2.0, robot=0.0)
    np.testing.assert_array_equal(costs.density, [[1.0, 3.0, 2.0], [1.5, 1.0, np.inf]])
    np.testing.assert_array_equal(costs.with_weight(4.0).density[0], [1.0, 5.0, 3.0])
    assert np.isnan(costs.e).all()
    near = Costmap.from_layers(grid, u=u, e=u + 1, robot=1.2)
    assert np.isinf(near.density).sum() == 4
    assert near.weight == 8.0
    assert near.e[0, 1] == 2.0
    assert not near.u.flags.writeable


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ({"u": np.zeros((3, 2))}, r"u has shape \(3, 2\), but the map \(2, 2\)"),
        ({"u": np.full((2, 2), np.nan)}, "u must be from 0 to 1 in every free cell"),
        ({"u": np.full((2, 2), 1.1)}, "u must be from 0 to 1"),
        ({"u": np.full((2, 2), -0.1)}, "u must be from 0 to 1"),
        ({"u": np.zeros((2, 2)), "e": np.full((2, 2), np.inf)}, "e must be finite and at least 0"),
        ({"u": np.zeros((2, 2)), "weight": -1.0}, "weight"),
    ],
)
def test_bad_layers_are_refused(layers, message):
    with pytest.raises(ConfigError, match=message):
        Costmap.from_layers(ascii_map("..", ".."), **layers)


@pytest.mark.parametrize(
    ("xy", "message"),
    [
        (
            (9, 0.5),
            "start 9,0.5 lies outside the map, which reaches from 0,0 to 4,2 m; the nearest",
        ),
        ((0.5, 3.5), r"reaches from 0,0 to 4,2 m; did you swap x and y\? 3.5,0.5 is free;"),
        ((0.5, 1.5), "lies in a wall; the nearest"),
        ((1.5, 1.5), "lies in unknown space; the nearest"),
        ((math.nan, 0.0), "finite"),
        ((1.0,), "two numbers"),
    ],
)
def test_find_cell_rejects_impossible_positions(xy, message):
    """The error for a blocked position names the nearest free one."""
    costs = Costmap.from_density(ascii_map("# ..", "...."), np.ones((2, 4)))
    with pytest.raises(PoseError, match=message):
        costs.find_cell(xy, "start")


def test_find_cell_rejects_position_near_wall():
    costs = Costmap.from_density(ascii_map("#....", "....."), np.ones((2, 5)), robot=1.2)
    with pytest.raises(PoseError, match=r"0\.50 m from a wall, closer than the robot's radius"):
        costs.find_cell((1.5, 1.5), "goal")


def test_costmap_rejects_robot_name():
    with pytest.raises(ConfigError, match="robot must be a Robot, not 'turtlebot4'; such as"):
        Costmap.blank(OccupancyGrid(np.full((3, 3), FREE), 0.1), robot="turtlebot4")


def test_find_cell_rejects_full_map():
    costs = Costmap.from_density(ascii_map("##", "##"), np.ones((2, 2)))
    with pytest.raises(PoseError, match="no cell of the map is free"):
        costs.find_cell((0.5, 0.5))


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """Corners of a rectangle."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def test_density_rises_outside_preferred_zones(field):
    grid = field.grid
    zones = Zones([Zone("prefer", box(-7, -1, 0, 1)), Zone("slow", box(-1, -1, 1, 1), 20)])
    plain, costs = (Costmap.from_field(field, zones=each) for each in (None, zones))
    outside = grid.position(*np.indices(grid.shape).reshape(2, -1))[:, 0].reshape(grid.shape) > 0
    np.testing.assert_array_equal(costs.density, plain.density + outside)
    np.testing.assert_array_equal(costs.unblocked_density, plain.unblocked_density + outside)
    np.testing.assert_array_equal(
        costs.with_weight(9.0).with_weight(costs.weight).density, costs.density
    )
    assert costs.max_excess == plain.weight + 1
    path = Path(np.array([[-4.0, 0.0], [3.0, 0.0]]))
    more = path_cost(costs, path) - path_cost(plain, path)
    assert more == pytest.approx(3.0)
    assert path_metrics(costs, path).cost == path_cost(costs, path)


def test_no_go_zones_have_infinite_density(field):
    grid, zones = field.grid, Zones([Zone("no-go", box(1, -1, 2, 0))])
    u = np.full(grid.shape, 0.5)
    for costs in (
        Costmap.from_field(field, zones=zones),
        Costmap.from_layers(grid, u=u, zones=zones),
        Costmap.from_density(grid, np.full(grid.shape, 2.0), zones=zones),
        Costmap.blank(grid, zones=zones),
    ):
        closed = zones.cells(grid, "no-go")
        assert np.isinf(costs.density[closed]).all()
        assert np.isinf(costs.unblocked_density[closed]).all()
        assert path_cost(costs, [[1.5, 0.5], [1.5, -0.5]]) == np.inf
        assert np.isfinite(path_cost(costs, [[1.5, 0.5], [-1.5, 0.5]]))
        with pytest.raises(PoseError, match=r"start 1.5,-0.5 lies in a no-go zone; the nearest"):
            costs.find_cell((1.5, -0.5), "start")


def test_shortest_path_needs_no_preferred_zone(field):
    zones = Zones([Zone("prefer", box(-7, 0.2, 7, 1)), Zone("no-go", box(1, -1, 2, 0))])
    costs = Costmap.from_field(field, weight=0.0, zones=zones)
    blank = Costmap.blank(field.grid, zones=zones)
    assert set(np.unique(blank.density)) == {1.0, np.inf}
    np.testing.assert_allclose(costs.for_shortest.density, blank.density, atol=2e-6)


def test_costmap_charges_zones_in_each_heading():
    grid = corridor(6.0, 2.0)
    ahead = FieldConfig(Fisher(Lidar(range=3.0, field_of_view_deg=90.0, beams=20)), stride=0.4)
    field = covariance_field(grid, ahead)
    zones = Zones([Zone("prefer", box(-3, -1, 0, 1)), Zone("no-go", box(1, -1, 2, 0))])
    plain, costs = (Costmap.from_field(field, robot=0.3, zones=z) for z in (None, zones))
    expected = plain.density_of_heading + zones.cost_per_metre(grid)
    expected[:, zones.cells(grid, "no-go")] = np.inf
    np.testing.assert_array_equal(costs.density_of_heading, expected)
    poses = [[-1.5, 0.2, 0.4], [1.5, 0.6, 0.4], [1.5, -0.5, 0.4]]
    density = plain.at(poses, "density") + np.array([0, 1, np.inf])
    np.testing.assert_allclose(costs.at(poses, "density"), density)


def test_loaded_costmap_has_its_zones(tmp_path, field):
    zones = Zones([Zone("prefer", box(-3, -1, 0, 1)), Zone("slow", box(1, -1, 2, 0), 30)])
    costs = Costmap.from_field(field, zones=zones)
    costs.save(tmp_path / "costs.npz")
    loaded = Costmap.load(tmp_path / "costs.npz")
    assert loaded == costs
    assert loaded.zones == zones


def test_costmap_at_reads_cells_of_poses():
    costs = Costmap.from_layers(
        ascii_map("#..", "..."), u=[[0.1, 0.2, 0.3], [1, 0.5, 0]], robot=0.0
    )
    inside, wall, outside = (0.9, 0.1), (0.5, 1.5), (-5.0, 0.5)
    values = costs.at([inside, wall, outside])
    np.testing.assert_array_equal(values["u"], [costs.u[0, 0], np.nan, np.nan])
    np.testing.assert_array_equal(values["density"], [costs.density[0, 0], np.inf, np.inf])
    assert np.isnan(values["e"]).all()
    assert costs.at(inside, "u") == costs.u[0, 0]
    assert costs.at((*outside, 1.0)) == pytest.approx(
        {"density": np.inf, "u": np.nan, "e": np.nan}, nan_ok=True
    )
    with pytest.raises(ConfigError, match="name must be one of density, u, e"):
        costs.at(inside, "cost")


def test_costmap_at_takes_nearest_heading():
    grid = corridor(6.0, 2.0)
    ahead = FieldConfig(Fisher(Lidar(range=3.0, field_of_view_deg=90.0, beams=20)), stride=0.4)
    costs = Costmap.from_field(covariance_field(grid, ahead), robot=0.3)
    xy = np.column_stack(grid.grid_to_world(*(np.argwhere(grid.free)[::40] + 0.5).T))
    count = len(costs.u_of_heading)
    cells = grid.cell(xy)
    for turn in (0.4, -0.4, count - 0.4):
        heading = (2 + turn) * 2 * np.pi / count
        values = costs.at(np.column_stack([xy, np.full(len(xy), heading)]))
        nearest = round(2 + turn) % count
        np.testing.assert_array_equal(values["u"], costs.u_of_heading[(nearest, *cells)])
        np.testing.assert_array_equal(values["e"], costs.e_of_heading[(nearest, *cells)])
        np.testing.assert_array_equal(
            values["density"], costs.density_of_heading[(nearest, *cells)]
        )
    np.testing.assert_array_equal(costs.at(xy, "density"), costs.density[cells])


def test_path_cost_accepts_several_paths():
    costs = Costmap.from_layers(
        ascii_map("#..", "..."), u=[[0.1, 0.2, 0.3], [1, 0.5, 0]], robot=0.0
    )
    paths = [Path([[0.5, 0.5], [2.5, 0.5]]), Path([[1.5, 0.5], [0.5, 1.5]])]
    alone = [path_cost(costs, path) for path in paths]
    assert alone == [path_metrics(costs, path).cost for path in paths]
    assert np.isfinite(alone).tolist() == [True, False]
    array = np.array([path.xy for path in paths])
    for several in (paths, tuple(paths), array, array.tolist(), [*array]):
        np.testing.assert_array_equal(path_cost(costs, several), alone)
    assert path_cost(costs, array[0].tolist()) == alone[0]
    assert path_cost(costs, np.empty((0, 2, 2))).shape == (0,)


def test_path_cost_of_poses_uses_headings():
    grid = corridor(6.0, 2.0)
    ahead = FieldConfig(Fisher(Lidar(range=3.0, field_of_view_deg=90.0, beams=20)), stride=0.4)
    costs = Costmap.from_field(covariance_field(grid, ahead), robot=0.0)
    random = np.random.default_rng(5)
    poses = random.uniform((-2.5, -0.9, -9.0), (2.5, 0.9, 9.0), (60, 3, 3))
    paths = [Path(line[:, :2], line[:, 2] if n % 3 else None) for n, line in enumerate(poses)]
    paths.append(Path([[2.0, 0.0]], [1.0]))
    paths.append(Path([[2.0, 0.0], [2.0, 0.0]]))
    alone = [path_metrics(costs, path).cost for path in paths]
    assert path_cost(costs, paths).tolist() == alone
    assert path_cost(costs, poses)[1] == alone[1]
    assert np.isfinite(alone).all()
    assert path_cost(costs, poses)[0] != alone[0]


def test_path_metrics_integrate_layers():
    grid = OccupancyGrid(np.full((1, 4), FREE), 0.5)
    costs = Costmap.from_layers(
        grid, u=[[0.0, 0.6, 0.7, 0.1]], e=[[0.1, 0.2, 0.3, 0.4]], weight=5.0, robot=0.0
    )
    metrics = path_metrics(costs, Path(np.array([[0.25, 0.25], [1.75, 0.25]])))
    assert metrics.length == pytest.approx(1.5)
    assert metrics.cost == pytest.approx(0.25 * 1 + 0.5 * 4 + 0.5 * 4.5 + 0.25 * 1.5)
    assert metrics.integrated_e == pytest.approx(0.25 * 0.1 + 0.5 * 0.2 + 0.5 * 0.3 + 0.25 * 0.4)
    assert metrics.mean_e == pytest.approx(metrics.integrated_e / 1.5)
    assert metrics.integrated_u == pytest.approx(0.5 * 0.6 + 0.5 * 0.7 + 0.25 * 0.1)
    assert metrics.max_e == 0.4
    assert metrics.degenerate_share == pytest.approx(1.0 / 1.5)
    assert metrics.longest_degenerate == pytest.approx(1.0)
    assert metrics.clearance == np.inf


def test_path_without_length_costs_nothing(field):
    costs = Costmap.from_field(field, robot=0.0)
    metrics = path_metrics(costs, Path(np.array([[0.0, 0.0], [0.0, 0.0]])))
    assert metrics.length == metrics.cost == metrics.integrated_e == 0.0
    assert metrics.mean_e == metrics.max_e > 0


def test_path_outside_map_costs_infinity():
    costs = Costmap.from_density(ascii_map("..", ".."), np.ones((2, 2)))
    metrics = path_metrics(costs, Path(np.array([[0.5, 0.5], [5.0, 0.5]])))
    assert metrics.cost == np.inf
    assert metrics.clearance == 0.0


def test_with_weight_keeps_blocked_cells(field):
    costs = Costmap.from_field(field, weight=4.0, robot=0.3)
    shortest = costs.with_weight(0.0)
    np.testing.assert_array_equal(np.isinf(shortest.density), np.isinf(costs.density))
    assert set(np.unique(shortest.density)) == {1.0, np.inf}
    np.testing.assert_allclose(shortest.with_weight(4.0).density, costs.density)
    with pytest.raises(ConfigError, match="no weight"):
        Costmap.from_density(field.grid, np.ones(field.grid.shape)).with_weight(1.0)


def two_headings(weight: float) -> Costmap:
    grid = ascii_map("..#", "...")
    u = np.array([[[0.0, 0.25, 0.5], [0.75, 1.0, 1.0]], [[0.5] * 3, [0.125] * 3]], np.float32)
    costs = dataclasses.replace(Costmap.blank(grid), u=u.mean(axis=0), e=u[0] / 10, weight=0.0)
    costs = dataclasses.replace(costs, of_heading=HeadingLayers(partial(tuple, (u, u / 10))))
    return costs.with_weight(weight)


@pytest.mark.parametrize("weight", [0.0, 1.5, 7.0])
def test_weight_scales_u_of_every_heading(weight):
    costs = two_headings(weight)
    density = costs.density_of_heading
    free = np.isfinite(costs.density)
    np.testing.assert_array_equal(density[:, free], 1 + weight * costs.u_of_heading[:, free])
    assert np.isinf(density[:, ~free]).all()
    assert not free.all()


def test_with_robot_widens_blocked_cells():
    """The costmap of a wide robot cannot serve a narrow one."""
    grid = ascii_map("#......", ".......", ".......")
    narrow, wide = (Costmap.blank(grid, robot=radius) for radius in (0.5, 2.2))
    widened = narrow.with_robot(2.2)
    assert widened.robot_radius == wide.robot_radius == 2.2
    np.testing.assert_array_equal(widened.density, wide.density)
    with pytest.raises(PoseError, match=r"closer than the robot's radius of 2\.2 m"):
        widened.find_cell((1.5, 1.5))
    with pytest.raises(ConfigError, match="cannot serve"):
        widened.with_robot(1.0)


@pytest.mark.parametrize(("u", "share"), [(0.45, 0.0), (0.5, 0.0), (0.55, 0.5)])
def test_degenerate_share_counts_u_above_half(u, share):
    costs = Costmap.blank(OccupancyGrid(np.full((1, 4), FREE), 1.0))
    costs = dataclasses.replace(costs, u=np.array([[0.0, u, u, 0.0]]))
    metrics = path_metrics(costs, Path(np.array([[0.0, 0.5], [4.0, 0.5]])))
    assert metrics.degenerate_share == pytest.approx(share)
    assert metrics.longest_degenerate == pytest.approx(4 * share)


def list_layers(costs: Costmap) -> list[np.ndarray]:
    return [costs.density, costs.u, costs.e, costs.u_of_heading, costs.e_of_heading]


def test_costmap_arrays_are_read_only(tmp_path):
    costs = two_headings(3.0)
    runs.write_costmap(costs, tmp_path / "shared")
    for other in (
        costs,
        costs.with_weight(2.0),
        costs.with_robot(0.6),
        costs.with_blocked(costs.e > 0.05),
        dataclasses.replace(costs, u=costs.u / 2),
        pickle.loads(pickle.dumps(costs)),
        costs.copy(),
        runs.read_costmap(tmp_path / "shared"),
        runs.read_weighted_costmap(tmp_path / "shared", 8.0),
    ):
        for layer in list_layers(other):
            with pytest.raises(ValueError, match="read-only"):
                layer[..., 0, 0] = 9.0
    for theirs, own in zip(list_layers(costs.copy()), list_layers(costs), strict=True):
        np.testing.assert_array_equal(theirs, own)
        assert not np.shares_memory(theirs, own)


def test_shared_costmap_has_layers_without_field(tmp_path):
    grid = OccupancyGrid(random_rooms((40, 50), seed=2), 0.2)
    lidar = Lidar(range=1.5, beams=40, field_of_view_deg=180.0)
    field = covariance_field(grid, FieldConfig(Fisher(lidar), headings=4))
    costs = Costmap.from_field(field)
    runs.write_costmap(costs, tmp_path / "shared")
    shared = runs.read_costmap(tmp_path / "shared")
    assert "u_and_e" in vars(shared.of_heading)
    np.testing.assert_array_equal(shared.u_of_heading, costs.u_of_heading)
    sizes = {file.stat().st_size for file in (tmp_path / "shared").glob("*.raw")}
    assert costs.u_of_heading.nbytes in sizes
    assert field.covariance.nbytes not in sizes


def test_costmap_copies_arrays_of_caller():
    array = np.ones((2, 3))
    for view in (array, array[:, ::-1]):
        costs = dataclasses.replace(two_headings(1.0), u=view)
        array[0, 0] += 1.0
        assert (costs.u == array[1, 1]).sum() >= 5
        assert costs.u.max() < array.max()


@pytest.fixture(scope="module", params=["sad", "fisher"])
def edited_fields(request) -> tuple[CovarianceField, list[CovarianceField]]:
    """A field of rooms, and those of maps with an edit each: inside, at an edge, and none."""
    before = OccupancyGrid(random_rooms((230, 260), seed=4), 0.1)
    seen = Sad(range=1.0) if request.param == "sad" else Fisher(Lidar(range=1.5, beams=40))
    field = covariance_field(before, FieldConfig(seen, stride=0.3))
    after = []
    for rows, cols in ((slice(60, 63), slice(60, 66)), (slice(0, 2), slice(250, 260)), ((), ())):
        cells = before.cells.copy()
        cells[rows, cols] = np.where(cells[rows, cols] == FREE, OCCUPIED, FREE)
        after.append(field.update(OccupancyGrid(cells, 0.1)))
    return field, after


@pytest.mark.parametrize("robot_radius", [0.0, 0.45])
@pytest.mark.parametrize("law", ["logarithmic", "cube-root"])
def test_updated_costmap_equals_new_costmap(edited_fields, robot_radius, law):
    field, after = edited_fields
    zones = Zones([Zone("no-go", box(5, 5, 7, 8)), Zone("prefer", box(2, 2, 20, 6.5))])
    settings = {"weight": 3.0, "robot": robot_radius, "law": law, "zones": zones}
    costs = Costmap.from_field(field, **settings)
    for each in after:
        updated, new = costs.update(each), Costmap.from_field(each, **settings)
        for name in ("density", "u", "e"):
            np.testing.assert_array_equal(getattr(updated, name), getattr(new, name))
            assert not getattr(updated, name).flags.writeable
        assert updated.grid is each.grid
        assert (updated.settings, updated.weight) == (new.settings, 3.0)


def test_update_accepts_field_of_other_points(edited_fields):
    """The result equals a new costmap."""
    field, (inside, *_) = edited_fields
    some = np.indices(field.is_evaluated.shape).sum(axis=0) % 2 == 0
    coarse = covariance_field(field.grid, field.config, points=some)
    for before, after in ((coarse, field), (field, coarse), (coarse, inside)):
        zones = Zones([Zone("no-go", box(5, 5, 7, 8)), Zone("prefer", box(2, 2, 20, 6.5))])
        updated = Costmap.from_field(before, zones=zones).update(after)
        new = Costmap.from_field(after, zones=zones)
        for name in ("density", "u", "e"):
            np.testing.assert_array_equal(getattr(updated, name), getattr(new, name))
        assert updated.settings == new.settings


def test_update_reads_only_changed_window(edited_fields, monkeypatch):
    field, (inside, _, same) = edited_fields
    costs, sizes = Costmap.from_field(field), []
    from_field = Costmap.from_field

    def counted(field, *arguments, **options):
        sizes.append(field.grid.cells.size)
        return from_field(field, *arguments, **options)

    monkeypatch.setattr(Costmap, "from_field", counted)
    costs.update(inside)
    costs.update(same)
    assert len(sizes) == 1
    assert sizes[0] < 0.5 * field.grid.cells.size


def test_update_rejects_incompatible_fields(edited_fields):
    field, _ = edited_fields
    costs = Costmap.from_field(field)
    with pytest.raises(ConfigError, match="another config than the costmap"):
        Costmap.blank(field.grid).update(field)
    with pytest.raises(ConfigError, match="field must be"):
        costs.update(field.covariance)
    other = OccupancyGrid(field.grid.cells, 0.1, (1.0, 0.0, 0.0))
    moved = CovarianceField.from_values(field.values, other, field.config)
    with pytest.raises(FieldError, match="another origin"):
        costs.update(moved)

"""The paths that a mask's planner takes on costmaps with masks, by its own formula."""

import dataclasses
import warnings

import numpy as np
import pytest
import yaml
from support import ros_readers
from support.cases import sample_cases
from support.maps import random_rooms

from locplan import load_or_compute, plan
from locplan.export import nav2_keepout, planned_paths as planned
from locplan.export.masks import CostmapInflation, compute_keepout_mask, compute_mask_density
from locplan.field import FieldConfig, Scan
from locplan.maps import FREE, OccupancyGrid, environments
from locplan.planning import Costmap, Path, path_metrics
from locplan.robots import Lidar, Robot, read_parameters
from locplan.robots.parts import Inflation

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def corridors():
    """two_corridors with the field of the TurtleBot 4's lidar."""
    grid = environments.make("two_corridors", resolution=0.05)
    field = load_or_compute(grid, FieldConfig(Scan(Lidar.preset("turtlebot4")), stride=0.4))
    return Costmap.from_field(field, weight=8.0, robot=0.25)


def make_inflation(radius, factor, inscribed=0.2255):
    inflation = Inflation(inflation_radius=radius, cost_scaling_factor=factor)
    return CostmapInflation("inflation_layer", inflation, inscribed)


ENDS = (
    ((2, 3), (38, 3)),
    ((0.875, 1.525), (27.525, 2.575)),
    ((8.875, 2.975), (27.675, 3.175)),
    ((35.875, 11.575), (3.525, 3.775)),
    ((36.725, 3.025), (2.225, 11.275)),
    ((30.575, 2.975), (0.975, 3.625)),
)
"""Ends on two_corridors."""


@pytest.mark.parametrize("name", ["smac2d", "thetastar"])
@pytest.mark.parametrize(
    ("radius", "factor"),
    sample_cases([(0.55, 10.0), (1.5, 1.5), (0.7, 3.0), (1.0, 3.0)], 2, are_rows=True),
)
def test_inflation_does_not_hide_mask(corridors, name, radius, factor):
    inflation = make_inflation(radius, factor)
    values, conversion = compute_keepout_mask(corridors, planner=name, inflation=inflation)
    assert conversion.saturated_share == 0
    cost = planned.compute_costmap_costs(
        corridors.grid, values, inflation.steeper_layer or inflation
    )
    density = compute_mask_density(corridors, inflation)
    meant = Costmap.from_density(corridors.grid, np.where(np.isnan(density), np.inf, density))
    for start, goal in ENDS:
        path = planned.simulate_nav2_planner(
            conversion.planner, conversion.parameter_value, corridors.grid, cost, start, goal
        )
        best = plan(meant, start, goal).metrics.cost
        assert path_metrics(meant, path).cost <= 1.15 * best


def test_inflation_costs_equal_nav2_costs():
    cells = random_rooms((40, 50), seed=3)
    grid = OccupancyGrid(cells, 0.1)
    for radius, factor in ((0.55, 10.0), (1.0, 2.5)):
        walls = np.where(cells == 0, ros_readers.LETHAL, 0).astype(np.uint8)
        expected = ros_readers.inflation(walls, 0.1, 0.23, radius, factor)
        np.testing.assert_array_equal(
            make_inflation(radius, factor, 0.23).compute_costs(grid), expected
        )
    empty = dataclasses.replace(grid, cells=np.full((5, 5), FREE))
    assert not make_inflation(0.7, 3.0).compute_costs(empty).any()


@pytest.mark.parametrize(
    ("costmap", "inscribed"),
    [
        ("robot_radius: 0.22", 0.2255),  # as measured on a real server
        ("robot_radius: 0.22, footprint_padding: 0.0", 0.22 * np.cos(np.pi / 16)),
        ('footprint: "[[0.5, 0.4], [0.5, -0.4], [-0.5, -0.4], [-0.5, 0.4]]"', 0.41),
        ("a: 1", 0.1078),
    ],
)
def test_inscribed_radius_includes_footprint_padding(tmp_path, costmap, inscribed):
    file = tmp_path / "own.yaml"
    layer = 'plugins: [walls], walls: {plugin: "nav2_costmap_2d::InflationLayer"}'
    start = "global_costmap: {global_costmap: {ros__parameters: {"
    file.write_text(f"{start}{costmap}, {layer}}}}}}}\n")
    found = CostmapInflation.from_parameters(read_parameters(file))
    assert (found.layer, found.inflation) == ("walls", Inflation())
    assert found.inscribed_radius == pytest.approx(inscribed, abs=1e-4)
    file.write_text(f"{start}{costmap}}}}}}}\n")
    assert (
        CostmapInflation.from_parameters(read_parameters(file)).layer == "inflation_layer"
    )  # as Nav2 has it
    file.write_text("amcl: {ros__parameters: {alpha1: 0.1}}\n")
    assert CostmapInflation.from_parameters(read_parameters(file)) is None


PARAMS = """\
planner_server:
  ros__parameters:
    planner_plugins: [GridBased]
    GridBased: {plugin: "nav2_smac_planner::SmacPlanner2D", cost_travel_multiplier: 2.0}
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: 0.22
      plugins: [static_layer, inflation_layer]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
      inflation_layer:
        {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 0.7, cost_scaling_factor: 3.0}
"""


def export_keepout(folder, costs, params=PARAMS, **settings):
    """The conversion of an exported mask, what was warned of, and the README."""
    (folder / "own.yaml").write_text(params)
    settings = {"params": folder / "own.yaml"} | settings
    with warnings.catch_warnings(record=True, action="always") as caught:
        conversion = nav2_keepout(folder / "mask", costs, **settings)
    texts = [str(each.message) for each in caught]
    return conversion, texts, (folder / "mask" / "README.md").read_text()


def test_mask_places_ignore_map_yaw(tmp_path, corridors):
    """They are on Nav2's map, like the mask, also in warnings."""
    ours = plan(corridors, (2, 3), (38, 3)).path
    turned = dataclasses.replace(corridors.grid, origin=(*corridors.grid.origin[:2], 0.4))
    xy = np.column_stack(turned.grid_to_world(*corridors.grid.world_to_grid(*ours.xy.T)))
    (tmp_path / "turned").mkdir()
    settings = {"planner_param": 1.0}  # saturates
    straight, _, _ = export_keepout(tmp_path, corridors, paths={"aware": ours}, **settings)
    conversion, texts, readme = export_keepout(
        tmp_path / "turned",
        dataclasses.replace(corridors, grid=turned),
        paths={"aware": Path(xy)},
        **settings,
    )
    np.testing.assert_allclose(conversion.closed_gaps, straight.closed_gaps, atol=1e-6)
    place = conversion.most_saturated_place
    np.testing.assert_allclose(place, straight.most_saturated_place, atol=1e-6)
    x, y = conversion.paths[0].narrowest
    np.testing.assert_allclose((x, y), straight.paths[0].narrowest, atol=1e-6)
    assert any(f"from walls at ({x:.2f}, {y:.2f}); path followers" in text for text in texts)
    assert "most of them around ({:.2f}, {:.2f})".format(*place) in readme


def test_masked_path_keeps_room_for_follower(tmp_path, corridors):
    """A real follower stopped up to 15 times where the masked path passed 0.33 m from walls."""
    ours = plan(corridors, (2, 3), (38, 3)).path
    conversion, texts, readme = export_keepout(tmp_path, corridors, paths={"aware": ours})
    (path,) = conversion.paths
    assert path.is_equivalent
    assert path.least_clearance >= 0.39
    x, y, clearance = conversion.closed_gaps[0]
    assert clearance == pytest.approx(0.325)
    assert f"closes the gap at ({x:.2f}, {y:.2f}), 0.3" in readme
    x, y = path.narrowest
    assert any(f"from walls at ({x:.2f}, {y:.2f}); path followers may" in text for text in texts)
    merged = yaml.safe_load((tmp_path / "mask" / "nav2.yaml").read_text())
    costmap = merged["global_costmap"]["global_costmap"]["ros__parameters"]
    assert costmap["inflation_layer"]["cost_scaling_factor"] == 3.0


def test_export_offers_steeper_inflation_with_cost(tmp_path, corridors):
    ours = plan(corridors, (2, 3), (38, 3)).path
    wide = PARAMS.replace("radius: 0.7", "radius: 1.5").replace("factor: 3.0", "factor: 1.5")
    conversion, texts, readme = export_keepout(tmp_path, corridors, wide, paths={"aware": ours})
    assert not conversion.paths[0].is_equivalent
    (option,) = [text for text in texts if "cost_scaling_factor: 10.0 (yours is 1.5)" in text]
    charged = [k * np.exp(-f * 0.4) for k, f in ((10.542, 10), (10.542, 1.5), (2.0, 1.5))]
    prices = "a cell costs {:.2f} per metre instead of {:.2f} ({:.2f} without".format(*charged)
    assert prices in option
    assert f"- Option: {option.removeprefix('own.yaml: ')}." in readme
    assert "cost_scaling_factor: 1.5" in (tmp_path / "mask" / "nav2.yaml").read_text()


ROBOT = Robot(footprint=0.22, margin=0.01)


@pytest.mark.parametrize("change", [{"footprint": 0.4}, {"margin": 0.2}, {"inflation_radius": 1.2}])
def test_robot_settings_change_mask(tmp_path, change):
    """A mask depends on the robot's size, margin and inflation, which `--set` changes."""
    grid = OccupancyGrid(random_rooms((70, 110), seed=6), 0.1)
    masks = []
    for robot in (ROBOT, ROBOT.with_settings(change)):
        costs = Costmap.from_layers(grid, u=np.full(grid.shape, 0.3), robot=robot)
        export_keepout(tmp_path, costs)
        masks.append((tmp_path / "mask" / "mask.pgm").read_bytes())
    assert masks[0] != masks[1]


def test_mask_keeps_only_door_open(tmp_path):
    """The only door of a room is no gap that a mask may close."""
    cells = np.full((60, 120), FREE)
    cells[:, 60], cells[27:33, 60] = 0, FREE
    costs = Costmap.from_layers(OccupancyGrid(cells, 0.1), u=np.full(cells.shape, 0.1), robot=ROBOT)
    path = plan(costs, (2.0, 3.0), (10.0, 3.0)).path
    conversion, texts, _ = export_keepout(tmp_path, costs, paths={"door": path})
    assert conversion.closed_gaps == ()
    assert any("smac2d's path for door passes 0.2" in text for text in texts)

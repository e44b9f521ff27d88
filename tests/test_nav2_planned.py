"""The paths that a mask's planner takes on costmaps with masks, by its own formula."""

import dataclasses

import numpy as np
import pytest
import stacks
from conftest import random_rooms

from locplan import export, load_or_compute, plan
from locplan.costs import Costmap, path_metrics
from locplan.export import CostmapInflation, _planned as planned
from locplan.field import FieldConfig, Scan
from locplan.maps import FREE, OccupancyGrid, environments
from locplan.robots import Inflation, Lidar


@pytest.fixture(scope="module")
def corridors():
    """two_corridors with the field of the TurtleBot 4's lidar."""
    grid = environments.make("two_corridors", resolution=0.05)
    field = load_or_compute(grid, FieldConfig(Scan.of(Lidar.preset("turtlebot4")), stride=0.4))
    return Costmap.from_field(grid, field, weight=8.0, robot=0.25)


def inflated(radius, factor, inscribed=0.2255):
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
@pytest.mark.parametrize(("radius", "factor"), [(0.7, 3.0), (0.55, 10.0), (1.0, 3.0), (1.5, 1.5)])
def test_no_inflation_hides_a_mask(corridors, name, radius, factor):
    inflation = inflated(radius, factor)
    values, conversion = export.keepout_mask(corridors, planner=name, inflation=inflation)
    assert conversion.saturated_share == 0
    cost = planned.costmap_costs(corridors.grid, values, inflation.below_a_mask)
    free = planned.unblocked(corridors)
    for start, goal in ENDS:
        ours = plan(corridors, start, goal).metrics.cost
        path = planned.planned(
            conversion.planner, conversion.param, corridors.grid, cost, start, goal
        )
        assert path_metrics(free, path).cost <= 1.12 * ours


def test_the_inflation_is_that_of_nav2():
    cells = random_rooms((40, 50), seed=3)
    grid = OccupancyGrid(cells, 0.1)
    for radius, factor in ((0.55, 10.0), (1.0, 2.5)):
        walls = np.where(cells == 0, stacks.LETHAL, 0).astype(np.uint8)
        expected = stacks.inflation(walls, 0.1, 0.23, radius, factor)
        np.testing.assert_array_equal(inflated(radius, factor, 0.23).costs(grid), expected)
    empty = dataclasses.replace(grid, cells=np.full((5, 5), FREE))
    assert not inflated(0.7, 3.0).costs(empty).any()


@pytest.mark.parametrize(
    ("costmap", "inscribed"),
    [
        ("robot_radius: 0.22", 0.2255),  # as measured on a real server
        ("robot_radius: 0.22, footprint_padding: 0.0", 0.22 * np.cos(np.pi / 16)),
        ('footprint: "[[0.5, 0.4], [0.5, -0.4], [-0.5, -0.4], [-0.5, 0.4]]"', 0.41),
        ("a: 1", 0.1078),
    ],
)
def test_the_inscribed_radius_is_that_of_the_padded_corners(tmp_path, costmap, inscribed):
    file = tmp_path / "own.yaml"
    layer = 'plugins: [walls], walls: {plugin: "nav2_costmap_2d::InflationLayer"}'
    start = "global_costmap: {global_costmap: {ros__parameters: {"
    file.write_text(f"{start}{costmap}, {layer}}}}}}}\n")
    found = CostmapInflation.of(file)
    assert (found.layer, found.inflation) == ("walls", Inflation())
    assert found.inscribed_radius == pytest.approx(inscribed, abs=1e-4)
    file.write_text(f"{start}{costmap}}}}}}}\n")
    assert CostmapInflation.of(file) is None

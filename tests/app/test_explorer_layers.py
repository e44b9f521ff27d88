"""Maps and layers as bytes, against plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.maps import random_rooms

import locplan
from locplan.app.explorer.layers import make_cell_classes, make_layers
from locplan.field import FieldConfig
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

LIDAR = locplan.Lidar(range=2.0, beams=40, field_of_view_deg=200.0)
CONFIGS = {
    "sad": FieldConfig(locplan.Sad(range=1.0), stride=0.3),
    "paper": FieldConfig(locplan.Sad.paper(range=1.0), stride=0.3),
    "headings": FieldConfig(locplan.Fisher(LIDAR), stride=0.5, headings=4),
}


def compute_field(name: str) -> locplan.CovarianceField:
    grid = OccupancyGrid(random_rooms((23, 31), 8), 0.1, (3.0, 1.0, 0.5))
    return locplan.covariance_field(grid, CONFIGS[name])


def naive_steps(values, low, high, *, is_log):
    """Steps of a layer, one point after the other, row 0 on top."""
    rows, cols = values.shape
    steps = np.zeros((rows, cols), np.uint8)
    for i in range(rows):
        for j in range(cols):
            value = values[i, j]
            if math.isnan(value):
                continue
            share = math.log(value / low) / math.log(high / low) if is_log else value
            steps[rows - 1 - i, j] = 1 + round(254 * min(max(share, 0.0), 1.0))
    return steps


@pytest.mark.parametrize("name", CONFIGS)
def test_deviation_equals_steps_of_field(name):
    field = compute_field(name)
    layer = make_layers(field)["deviation"]
    values = 100 * field.scalar("position_std", headings="mean")
    assert (layer.scale, layer.unit) == ("log", "cm")
    expected = naive_steps(values, layer.low, layer.high, is_log=True)
    np.testing.assert_array_equal(layer.texels, expected)
    assert ((layer.texels[::-1] > 0) == field.is_evaluated).all()


@pytest.mark.parametrize("name", ["sad", "paper"])
def test_degeneracy_equals_steps_of_costmap(name):
    field = compute_field(name)
    layer = make_layers(field)["degeneracy"]
    assert (layer.low, layer.high, layer.scale) == (0.0, 1.0, "linear")
    costs = locplan.Costmap.from_field(field, robot=0.0)
    u = costs.u[:: field.stride, :: field.stride]
    is_known = ~np.isnan(u)
    expected = naive_steps(u, 0.0, 1.0, is_log=False)[::-1][is_known]
    assert np.abs(layer.texels[::-1][is_known].astype(int) - expected).max() <= 1
    assert len(set(expected.tolist())) > 10


def test_layer_facts_hold_no_steps():
    facts = make_layers(compute_field("sad"))["deviation"].facts
    assert set(facts) == {"name", "title", "unit", "low", "high", "scale", "labels"}
    assert facts["labels"][0].endswith(" cm")


def test_layers_of_unknown_map_are_empty():
    grid = OccupancyGrid(np.full((4, 4), UNKNOWN, np.uint8), 0.1)
    for layer in make_layers(locplan.covariance_field(grid, CONFIGS["sad"])).values():
        assert not layer.texels.any()


def test_cell_classes_begin_with_top_row():
    cells = np.array([[FREE, OCCUPIED], [UNKNOWN, FREE]], np.uint8)
    assert make_cell_classes(cells).tolist() == [[0, 1], [1, 2]]

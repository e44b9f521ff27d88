"""Maps and layers as bytes, against plain loops."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from support.maps import random_rooms

import locplan
from locplan.app.explorer.scene import Opening
from locplan.app.explorer.session import Session
from locplan.field import FieldConfig
from locplan.maps import OccupancyGrid

LIDAR = locplan.Lidar(range=2.0, beams=40, field_of_view_deg=200.0)
CONFIGS = {
    "sad": FieldConfig(locplan.Sad(range=1.0), stride=0.3),
    "paper": FieldConfig(locplan.Sad.paper(range=1.0), stride=0.3),
    "headings": FieldConfig(locplan.Fisher(LIDAR), stride=0.5, headings=4),
    "flat": FieldConfig(
        locplan.Sad(range=1.0, window=locplan.field.SearchWindow(half_rotation_deg=0.0)), stride=0.3
    ),
}


def field_of(name: str) -> locplan.CovarianceField:
    grid = OccupancyGrid(random_rooms((23, 31), 8), 0.1, (3.0, 1.0, 0.5))
    return locplan.covariance_field(grid, CONFIGS[name])


def textures_of(field: locplan.CovarianceField):
    """The layers of a session with a field."""
    session = Session(field.grid, Opening(field.config))
    session.begin(field).result()
    return session.layers()


def naive_steps(values, low, high, logarithmic):
    """Steps of a layer, one point after the other, row 0 on top."""
    rows, cols = values.shape
    steps = np.zeros((rows, cols), np.uint8)
    for i in range(rows):
        for j in range(cols):
            value = values[i, j]
            if math.isnan(value):
                continue
            if logarithmic:
                share = -1.0
                if value > 0:
                    share = math.log(value / low) / math.log(high / low)
            else:
                share = (value - low) / (high - low)
            share = min(max(share, 0.0), 1.0)
            steps[rows - 1 - i, j] = 1 + round(254 * share)
    return steps


@pytest.mark.parametrize("logarithmic", [True, False])
def test_steps_equal_those_of_plain_loops(logarithmic):
    rng = np.random.default_rng(1)
    values = np.exp(rng.normal(size=(9, 7)))
    values[rng.random((9, 7)) < 0.2] = np.nan
    values[0, 0], values[1, 1], values[2, 2] = 0.0, 1e9, 1e-300
    layer = textures_of(field_of("sad"))["e"]
    given = {"values": values, "anchors": (0.3, 4.0), "logarithmic": logarithmic}
    steps = dataclasses.replace(layer, **given).texels
    np.testing.assert_array_equal(steps, naive_steps(values, 0.3, 4.0, logarithmic))
    assert {0, 1, 255} <= set(steps.ravel().tolist())


@pytest.mark.parametrize("name", CONFIGS)
def test_layers_are_those_of_the_field(name):
    field = field_of(name)
    textures = textures_of(field)
    assert ("heading" in textures) == (name != "flat")
    scalars = {"sigma": "position_std", "heading": "heading_std", "e": "e"}
    for layer, texture in textures.items():
        if layer in scalars:
            values = field.scalar(scalars[layer], headings="mean")
            assert texture.anchors == field.anchors(scalars[layer])
            assert texture.to_json()["scale"] == "log"
        else:
            values = texture.values
        low, high = texture.anchors
        logarithmic = texture.to_json()["scale"] == "log"
        expected = naive_steps(values, low, high, logarithmic)
        np.testing.assert_array_equal(texture.texels, expected)
        assert ((texture.texels[::-1] > 0) == field.evaluated).all()
        low, high = texture.to_json()["present"]
        assert low <= high
        assert texture.to_json()["factor"] > 0


@pytest.mark.parametrize("name", [name for name in CONFIGS if name != "headings"])
def test_degeneracy_on_the_lattice_is_that_of_the_costmap(name):
    field = field_of(name)
    costs = locplan.Costmap.from_field(field.grid, field, robot=0.0)
    u = textures_of(field)["degeneracy"].values
    on_map = costs.u[:: field.stride, :: field.stride]
    both = ~np.isnan(on_map)
    np.testing.assert_allclose(u[both], on_map[both], atol=1e-9)
    assert both.any()


def test_layers_without_any_value_have_their_anchors():
    grid = OccupancyGrid(np.full((4, 4), 127, np.uint8), 0.1)
    for texture in textures_of(locplan.covariance_field(grid, CONFIGS["sad"])).values():
        told = texture.to_json()
        assert told["present"] == told["anchors"]
        assert not texture.texels.any()

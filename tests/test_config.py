import math
from dataclasses import replace

import numpy as np
import pytest

from locplan.errors import ConfigError
from locplan.field import FieldConfig, SearchWindow


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"sensor_range": 0.0}, "sensor_range"),
        ({"sensor_range": math.nan}, "sensor_range"),
        ({"window": "wide"}, "window"),
        ({"step": 3.0}, "must not exceed window"),
        ({"rotation_window_deg": 200.0}, "rotation_window_deg"),
        ({"rotation_window_deg": 5.0}, "rotation_step_deg"),
        ({"weight_law": "gaussian"}, "exponential, inverse-square"),
        ({"template": "square"}, "template"),
        ({"estimator": "guess"}, "estimator"),
        ({"floor": -1.0}, "floor"),
        ({"noise_level": True}, "noise_level"),
        ({"quantisation": 1}, "quantisation"),
    ],
)
def test_settings_out_of_range_are_named(setting, message):
    with pytest.raises(ConfigError, match=message):
        FieldConfig(**setting)


def test_the_papers_preset_is_eq_8_to_10_as_printed():
    config = FieldConfig.paper()
    assert config.weight_law == "inverse-square"
    assert not config.quantisation
    assert config.noise_level == 1.0


def test_tau_follows_the_template_unless_set():
    assert FieldConfig().mismatch_scale == 0.57
    assert replace(FieldConfig(), template="visible").mismatch_scale == 0.23
    assert FieldConfig(template="visible", tau=0.4).mismatch_scale == 0.4


def test_whole_numbers_make_the_same_config():
    assert repr(FieldConfig(sensor_range=8, stride=np.float32(0.5))) == repr(
        FieldConfig(sensor_range=8.0, stride=0.5)
    )


def test_window_has_the_papers_lattice_at_5_cm():
    window = SearchWindow.from_config(FieldConfig(), 0.05)
    assert window.step_cells == 4
    np.testing.assert_allclose(window.offsets, np.arange(-10, 11) * 0.2)
    np.testing.assert_allclose(np.degrees(window.angles), np.arange(-60, 61, 10))


@pytest.mark.parametrize("resolution", [0.01, 0.03, 0.0504, 0.1, 0.25, 1.0])
def test_window_is_whole_cells_at_any_resolution(resolution):
    window = SearchWindow.from_config(FieldConfig(), resolution)
    assert window.step_cells >= 1
    assert window.offsets[-1] == pytest.approx(2.0, abs=window.step / 2)
    assert 0.0 in window.offsets


def test_cells_larger_than_the_window_are_refused():
    with pytest.raises(ConfigError, match="larger window"):
        SearchWindow.from_config(FieldConfig(), 5.0)


def test_without_rotation_poses_have_two_dimensions():
    window = SearchWindow.from_config(FieldConfig(rotation_window_deg=0), 0.05)
    assert window.angles.tolist() == [0.0]
    assert window.uniform_covariance.shape == window.quantisation.shape == (2, 2)


def test_uniform_covariance_is_that_of_the_offsets():
    window = SearchWindow.from_config(FieldConfig(), 0.05)
    expected = [window.offsets.var(), window.offsets.var(), window.angles.var()]
    np.testing.assert_allclose(np.diag(window.uniform_covariance), expected)

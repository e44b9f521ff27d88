import dataclasses
import json
import math
import re

import numpy as np
import pytest

import locplan
from locplan.errors import ConfigError
from locplan.field import FieldConfig, Fisher, Fused, Sad, Scan, SearchWindow
from locplan.field.config import config_from_settings
from locplan.field.estimators import estimator_class
from locplan.field.sad import Exponential, InverseSquare
from locplan.recordings.matching import MatchingSettings, ScanDatabase
from locplan.robots import Disturbances, Kinematics, Lidar, Odometry
from locplan.robots.parts import Inflation
from locplan.simulation.problem import RecommendationSettings


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sad(range=0.0), "range must be a positive number of m, not 0.0"),
        (lambda: Sad(range=math.nan), "range"),
        (lambda: SearchWindow(half_width="wide"), "half_width"),
        (lambda: SearchWindow(step=3.0), "must not exceed half_width"),
        (lambda: SearchWindow(half_rotation_deg=200.0), "half_rotation_deg must be 0 to 180"),
        (lambda: SearchWindow(half_rotation_deg=5.0), "rotation_step_deg"),
        (lambda: SearchWindow(step=1e-9), "at most 1000 times step"),
        (lambda: Sad(weights="gaussian"), "weights must be an Exponential"),
        (lambda: Sad(template="square"), "template must be one of disc, visible"),
        (lambda: InverseSquare(floor=-1.0), "floor"),
        (lambda: Sad(noise_level=True), "noise_level"),
        (lambda: Sad(quantisation=1), "quantisation must be true or false"),
        (lambda: Sad(window=2.0), "window must be a SearchWindow"),
        (lambda: FieldConfig("guess"), "estimator must be an Estimator, not 'guess'; such as"),
        (lambda: FieldConfig(stride=7.0), "must not exceed the range"),
        (lambda: estimator_class("guess"), "estimator must be one of sad, fisher, scan"),
        (
            lambda: config_from_settings("sad"),
            "config must be a FieldConfig, not 'sad'; give an estimator",
        ),
    ],
)
def test_settings_error_names_setting(make, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        make()


BEAMS = Lidar(range=9.0, field_of_view_deg=180.0, min_range=0.2)


@pytest.mark.parametrize(
    "config",
    [
        FieldConfig(),
        FieldConfig(Sad.paper(range=8.0), stride=0.5),
        FieldConfig(Sad(template="visible", weights=Exponential(0.4))),
        FieldConfig(Fisher(Lidar.preset("rplidar-a1"), window=SearchWindow(half_width=1.0))),
        FieldConfig(Scan(Lidar(field_of_view_deg=180.0), max_beams=np.int64(9)), headings=4),
        FieldConfig(
            Fused(
                BEAMS,
                fisher=Fisher(BEAMS, model="range"),
                scan=Scan(BEAMS, endpoint_noise=(0.1, 0.0)),
            )
        ),
        FieldConfig(Fused(BEAMS), stride=0.4),
    ],
)
def test_settings_survive_json(config):
    again = FieldConfig.from_json(json.loads(json.dumps(config.to_json())))
    assert again == config
    assert repr(again) == repr(config)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"estimator": {"name": "sad", "sigma_hit": 0.1}},
            "sad has no setting 'sigma_hit'; it has: noise_level",
        ),
        ({"estimator": {"name": "scan"}}, "lidar"),
        ({"estimator": {"name": "icp"}}, "one of sad, fisher, scan, fused"),
        (
            {"estimator": {"name": "scan", "lidar": {}, "temperature": 0.1}},
            "scan has no setting 'temperature'; it has: lidar",
        ),
        (
            {"estimator": {"name": "fisher", "lidar": {}, "endpoint_noise": [0.03, 0.01]}},
            "fisher has no setting 'endpoint_noise'",
        ),
        ({"estimator": {"name": "fused", "fisher": {"name": "sad"}}}, "fisher cannot be made of"),
        ({"estimator": {"name": "sad", "weights": {"name": "cubic"}}}, "weights cannot be made of"),
        ({"estimator": "sad"}, "estimator must be an object with a name"),
        ({"strides": 0.2}, "FieldConfig has no setting 'strides'"),
    ],
)
def test_config_rejects_unknown_settings(settings, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        FieldConfig.from_json(settings)


def test_paper_preset_follows_printed_equations():
    """Equations 8 to 10 of the paper."""
    paper = Sad.paper()
    assert paper.weights == InverseSquare()
    assert not paper.quantisation
    assert paper.noise_level == 1.0


def test_default_tau_depends_on_template():
    assert Sad().tau == 0.57
    assert Sad(template="visible").tau == 0.23
    assert Sad(weights=Exponential(0.4), template="visible").tau == 0.4
    assert Sad.paper().tau == math.inf


def test_config_ignores_number_type():
    assert repr(FieldConfig(Sad(range=8), stride=np.float32(0.5))) == repr(
        FieldConfig(Sad(range=8.0), stride=0.5)
    )


def test_default_window_equals_paper_lattice():
    """At 5 cm per cell, a step is 4 cells."""
    window = FieldConfig().estimator.window.to_lattice(0.05)
    assert window.step_cells == 4
    np.testing.assert_allclose(window.offsets, np.arange(-10, 11) * 0.2)
    np.testing.assert_allclose(np.degrees(window.angles), np.arange(-60, 61, 10))


@pytest.mark.parametrize("resolution", [0.01, 0.03, 0.0504, 0.1, 0.25, 1.0])
def test_window_step_is_whole_cells(resolution):
    window = FieldConfig().estimator.window.to_lattice(resolution)
    assert window.step_cells >= 1
    assert window.offsets[-1] == pytest.approx(2.0, abs=window.step / 2)
    assert 0.0 in window.offsets


def test_window_rejects_larger_cells():
    with pytest.raises(ConfigError, match="larger window"):
        FieldConfig().estimator.window.to_lattice(5.0)


def test_window_without_rotation_has_two_dimensions():
    window = SearchWindow(half_rotation_deg=0).to_lattice(0.05)
    assert window.angles.tolist() == [0.0]
    assert window.uniform_covariance.shape == window.quantisation.shape == (2, 2)


def test_uniform_covariance_equals_offset_variances():
    window = FieldConfig().estimator.window.to_lattice(0.05)
    expected = [window.offsets.var(), window.offsets.var(), window.angles.var()]
    np.testing.assert_allclose(np.diag(window.uniform_covariance), expected)


def test_lidar_estimators_have_fitted_defaults():
    """The values were fitted to real lasers."""
    fused = Fused(BEAMS)
    window = SearchWindow(half_width=1.5, step=0.1, half_rotation_deg=4.0, rotation_step_deg=1.0)
    assert fused.fisher == Fisher(
        BEAMS,
        window=window,
        noise_level=1.0,
        sigma_hit=0.1,
        effective_beams=12.6,
        max_beams=180,
        model="endpoint",
    )
    assert fused.scan == Scan(
        BEAMS,
        window=window,
        noise_level=1.0,
        sigma_hit=0.1,
        effective_beams=12.6,
        max_beams=180,
        z_rand=0.05,
        endpoint_noise=(0.03, 0.01),
    )
    for estimator in (fused, fused.fisher, fused.scan):
        assert estimator.criterion == "position_std"
        assert estimator.weight == 8.0
        assert estimator.headings == 8
    assert Sad().criterion == "e"
    assert Sad().weight == 4.0
    assert fused.scan.temperature == fused.fisher.temperature == pytest.approx(0.07)
    few = Lidar(range=9.0, beams=8)
    assert (Scan(few).temperature, Scan(few, effective_beams=2).temperature) == (1.0, 0.5)


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        (locplan.advice.Box, (0.6, 0.3)),
        (locplan.advice.Pole, (0.2,)),
        (FieldConfig, (0.2, 0)),
        (Fused, (1.0,)),
        (Sad, (1.0, True, 6.0)),
        (SearchWindow, (2.0, 0.2, 60.0, 10.0)),
        (Lidar, (12.0, 0.0, 360.0, 360, 0.03, 0.0, 0.0, 0.0)),
        (locplan.Robot, (0.2, 0.05, 0.25)),
        (Inflation, (0.55, 10.0)),
        (Kinematics, (0.0, True, 0.5)),
        (Odometry, (0.02, 1.0, 1.0, 0.02, 1.0, 0.02)),
        (Disturbances, (0.1, 8, 0.04, 0.2, 20.0, 0.1, 3.0)),
        (MatchingSettings, (36.0, 0.1, 0.05, 0.25, 600)),
        (ScanDatabase, (0.1,)),
        (RecommendationSettings, (1.5, False, 0.3, 64, False, False)),
    ],
)
def test_default_settings_equal_published_values(kind, numbers):
    defaults = [each.default for each in dataclasses.fields(kind)]
    assert tuple(each for each in defaults if isinstance(each, (int, float))) == numbers

"""Warnings about AMCL's parameters."""

import re

import numpy as np
import pytest
from support.maps import ascii_map

from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Amcl, Disturbances, Lidar, Robot
from locplan.robots.amcl import OMNIDIRECTIONAL
from locplan.robots.nav2 import read_amcl
from locplan.simulation import Simulator
from locplan.simulation.amcl_parameters import (
    BeamCount,
    find_filter_warnings,
    write_tuned_parameters,
)

LIDAR = Lidar(range=12.0, range_sigma=0.03)
CLEAN = Disturbances(outliers=0.0, boundary_noise=0.0)


@pytest.mark.parametrize("lidar", [LIDAR, Lidar(range=200.0)])
def test_nav2s_defaults_have_no_warnings(lidar):
    assert find_filter_warnings(Amcl(), lidar) == []
    assert (
        find_filter_warnings(Amcl(), lidar, {"z_short": 0.05, "z_max": 0.05, "use_sim_time": True})
        == []
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"z_hit": 0.9}, "z_hit and z_rand add up to 1.4"),
        (dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4"), 0.0), "are all 0"),
        ({"laser_max_range": 20.0}, r"laser_max_range \(20 m\) is beyond .* 12 m"),
        ({"laser_min_range": 12.0}, r"laser_min_range \(12 m\) is not below the range of 12 m"),
        ({"laser_max_range": 3.0, "laser_min_range": 3.5}, "not below the range of 3 m"),
        ({"sigma_hit": 0.6}, "sigma_hit .* is wide"),
        ({"sigma_hit": 0.02}, "below the lidar's own noise of 0.03 m"),
        ({"laser_likelihood_max_dist": 0.3}, "below twice sigma_hit"),
    ],
)
def test_parameter_fault_has_one_warning(changes, words):
    (found,) = find_filter_warnings(Amcl(**changes), LIDAR)
    assert re.search(words, found)
    assert "\n" not in found


def test_beam_model_weights_count_towards_sum():
    """A file for the beam model also has z_short and z_max."""
    amcl = Amcl(z_hit=0.85, z_rand=0.05)
    assert find_filter_warnings(amcl, LIDAR, {"z_short": 0.05, "z_max": 0.05}) == []
    assert len(find_filter_warnings(amcl, LIDAR, {"z_short": 0.5, "z_max": "much"})) == 1


def test_write_tuned_writes_changed_motion_model(tmp_path):
    """The settings were tuned for this model, which --set may have changed."""
    params, written = tmp_path / "nav2.yaml", tmp_path / "tuned.yaml"
    params.write_text("amcl:\n  ros__parameters:\n    robot_model_type: differential\n")
    write_tuned_parameters(written, Amcl(robot_model_type=OMNIDIRECTIONAL), params)
    assert read_amcl(written) == Amcl(robot_model_type=OMNIDIRECTIONAL)
    write_tuned_parameters(written, Amcl(alpha1=0.1), params)
    assert "robot_model_type: differential\n" in written.read_text()


def hall(size: float) -> OccupancyGrid:
    cells = np.full((int(size / 0.1),) * 2, FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1)


def test_all_beams_return_in_small_room():
    simulator = Simulator(hall(4.0), robot=Robot(LIDAR, disturbances=CLEAN))
    left = BeamCount.on_map(simulator)
    assert left.compared == 60  # every sixth of 360
    assert left.returned == 60
    assert left.find_warnings() == []


def test_beam_count_warns_in_wide_hall():
    """The lidar sees 4 m, and the hall is 30 m wide."""
    lidar = Lidar(range=4.0)
    left = BeamCount.on_map(Simulator(hall(30.0), robot=Robot(lidar, filter=Amcl(max_beams=30))))
    assert 0 < left.returned < 0.5 * left.compared
    (warning,) = left.find_warnings()
    assert str(left) in warning
    assert f"of {left.compared} beams compared, {left.returned:.0f} return on this map" in warning


def test_beam_count_needs_no_free_space():
    """A robot that fits nowhere still has beams to compare."""
    grid = ascii_map("####", "#..#", "####", resolution=0.1)
    assert BeamCount.on_map(Simulator(grid, robot=Robot(LIDAR))).compared == 60

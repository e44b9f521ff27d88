"""Small inputs that were misread, each with its expected result (../shared/data/reports)."""

import runpy
import shutil
import warnings

import pytest
from support.machine import SHARED_DATA

from locplan import load_map
from locplan.errors import LocplanError
from locplan.recordings import read_recording
from locplan.robots import Amcl, Kinematics, Lidar, Robot, read_parameters
from locplan.robots.parts import Inflation

REPORTS = SHARED_DATA / "reports"
WIDE = Inflation(inflation_radius=0.8, cost_scaling_factor=2.0)

pytestmark = pytest.mark.skipif(not REPORTS.is_dir(), reason=f"{REPORTS} is not here")


def load(*names, **settings):
    """The robot of the files, and the warnings."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        robot = Robot.load(*(REPORTS / name for name in names), **settings)
    return robot, [str(each.message) for each in caught]


def test_overlay_keeps_other_settings():
    robot, notes = load("layers/base.yaml", "layers/overlay.yaml")
    alphas = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4"), 0.05)
    model = {"laser_model_type": "likelihood_field_prob", "max_particles": 3000}
    assert robot.filter == Amcl(**alphas, **model)
    assert robot.inflation == Inflation(inflation_radius=0.9, cost_scaling_factor=2.0)
    assert notes == []


def test_order_of_separate_files_is_free():
    nav, loc = "split/nav.yaml", "split/loc.yaml"
    assert load(nav, loc) == load(loc, nav)
    merged = [
        read_parameters(*(REPORTS / name for name in names)).merge_files()
        for names in ((nav, loc), (loc, nav))
    ]
    assert merged[0].read_node_parameters("planner_server") == merged[1].read_node_parameters(
        "planner_server"
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("no_list", Inflation()),
        ("no_types", WIDE),
        ("disabled", None),
        ("as_they_should_read", WIDE),
    ],
)
def test_inflation_is_read_as_in_nav2(name, expected):
    assert load(f"default_layers/{name}.yaml")[0].inflation == expected


def test_beam_model_is_accepted():
    robot, notes = load("beam/beam.yaml")
    assert robot.filter == Amcl(z_hit=0.5)
    assert "beam model is not simulated" in notes[0]


def test_smac2d_has_no_motion_model():
    robot, _ = load("drive_of_smac/smac2d_leftover.yaml")
    assert robot.kinematics == Kinematics(drive="omnidirectional")


def test_comment_before_declaration_is_read():
    assert Lidar.from_file(REPORTS / "xml" / "comment_first.sdf").range == 8.0


@pytest.mark.parametrize("name", ["rear_joint.urdf", "rear_link.sdf"])
def test_mount_is_pose_of_link(name):
    lidar = Lidar.from_file(REPORTS / "lidar_pose" / name)
    assert (lidar.mount_x, lidar.mount_y) == (-0.3, 0.1)
    assert lidar.mount_yaw_deg == pytest.approx(180, abs=1e-3)


def test_description_without_sensor_has_mount():
    with pytest.raises(LocplanError, match="has no planar lidar; name the robot's"):
        load("lidar_pose/no_sensor.urdf")
    lidar = load("lidar_pose/no_sensor.urdf", lidar="turtlebot4")[0].lidar
    assert (lidar.range, lidar.mount_x) == (12.0, 0.1)
    assert lidar.mount_yaw_deg == pytest.approx(180, abs=1e-3)


def test_image_is_no_map():
    with pytest.raises(LocplanError, match="is an image, not a map's YAML"):
        load_map(REPORTS / "image" / "map.pgm")
    with pytest.raises(LocplanError, match=r"other_machine.yaml: line 1, image: .* 'map.pgm' lies"):
        load_map(REPORTS / "image" / "other_machine.yaml")


def test_bags_give_scans_and_odometry(tmp_path, monkeypatch):
    pytest.importorskip("rosbags")
    shutil.copy(REPORTS / "bags" / "make_bags.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    runpy.run_path("make_bags.py")
    for name in ("odom_nostatic", "odom_tf", "prefix", "tf_map_prefix"):
        drive = read_recording(name)
        assert len(drive.poses) == 150
    with pytest.raises(LocplanError, match="has no poses"):
        read_recording("scan_only")
    assert len(read_recording("scan_only", needs_poses=False)) == 150

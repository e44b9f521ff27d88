"""Lidars by data sheets, from scans and from robots' descriptions."""

import dataclasses
import math

import numpy as np
import pytest

from locplan.errors import ConfigError
from locplan.field import Fisher, Fused, Sad, Scan
from locplan.robots import LIDARS, Amcl, Lidar, Robot
from locplan.robots.nav2 import ParameterWarning
from locplan.simulation.drives import make_drive_arguments

URDF = """<robot name="r"><link name="laser"/>
<gazebo reference="laser"><sensor name="front" type="{kind}">
<pose>0.1 0.02 0.3 0 0 0.5</pose><ray><scan><horizontal><samples>{samples}</samples>
<resolution>1</resolution><min_angle>{first}</min_angle><max_angle>{last}</max_angle></horizontal>
</scan><range><min>0.12</min><max>8.0</max></range>
<noise><type>gaussian</type><mean>0</mean><stddev>0.01</stddev></noise></ray></sensor></gazebo>
<gazebo><sensor name="eye" type="camera"/></gazebo></robot>"""


def described(folder, text=None, **changes):
    values = {"kind": "gpu_ray", "samples": 271, "first": -math.radians(135)}
    file = folder / "robot.urdf"
    file.write_text(text or URDF.format(**{**values, "last": math.radians(135), **changes}))
    return file


def scan(**changes):
    fields = {
        "angle_min": -math.radians(135),
        "angle_max": math.radians(135),
        "angle_increment": math.radians(0.25),
        "range_min": 0.1,
        "range_max": 30.0,
    }
    return Lidar.from_scan(**{**fields, **changes})


@pytest.mark.parametrize("name", LIDARS)
def test_lidar_preset_has_source_and_title(name):
    lidar = Lidar.preset(name)
    assert lidar.model == name
    assert LIDARS[name].source
    assert 0 <= lidar.min_range < lidar.range
    assert lidar.title.startswith(f"{name}, {lidar.range:g} m")


def test_turtlebot_preset_equals_lidar_preset():
    assert Lidar.preset("turtlebot4") == Lidar.preset("rplidar-a1")
    assert Lidar.preset("turtlebot3") == Lidar.preset("lds-02")


@pytest.mark.parametrize("of", [Sad().with_lidar, Scan, Fisher, Fused])
def test_lidar_name_does_not_change_estimator(of):
    named = Lidar.preset("tim571")
    plain = dataclasses.replace(named, model="")
    assert of(named) == of(plain)
    assert of(named).identity() == of(plain).identity()
    assert "tim571" in of(named).title
    assert "tim571" not in of(plain).title


@pytest.mark.parametrize("of", [Sad().with_lidar, Scan, Fisher, Fused])
def test_estimator_keeps_settings_with_other_lidar(of):
    estimator = dataclasses.replace(of(Lidar(range=8.0)), noise_level=2.0)
    other = estimator.with_lidar(Lidar.preset("utm-30lx"))
    assert other == dataclasses.replace(of(Lidar.preset("utm-30lx")), noise_level=2.0)
    assert other.reach == 30.0


def test_lidar_is_read_from_scan():
    lidar = scan(mount=(0.2, -0.1, 0.3))
    assert (lidar.beams, lidar.range, lidar.min_range) == (1081, 30.0, 0.1)
    assert lidar.field_of_view_deg == pytest.approx(270.0)
    assert (lidar.mount_x, lidar.mount_y) == (0.2, -0.1)
    assert lidar.mount_yaw == pytest.approx(0.3)
    np.testing.assert_allclose(lidar.angles[[0, -1]], np.radians([-135, 135]), atol=1e-9)


def test_asymmetric_scan_sets_mount_yaw():
    lidar = scan(angle_min=0.0, angle_max=math.pi / 2)
    assert lidar.mount_yaw == pytest.approx(math.pi / 4)
    np.testing.assert_allclose(lidar.mount_yaw + lidar.angles[[0, -1]], [0, math.pi / 2], atol=1e-9)


@pytest.mark.parametrize(("first", "last"), [(0.0, 6.28), (-math.pi, math.pi), (0.0, 6.2657)])
@pytest.mark.parametrize(("resolution", "beams"), [("1", 360), ("0.299", 107)])
def test_beams_equal_samples_times_resolution(tmp_path, first, last, resolution, beams):
    text = described(tmp_path, samples=360, first=first, last=last).read_text()
    text = text.replace("<resolution>1<", f"<resolution>{resolution}<")
    lidar = Lidar.from_file(described(tmp_path, text=text))
    assert lidar.sees_all_round
    assert lidar.beams == beams


def test_clockwise_scan_gives_same_lidar():
    """A lidar that is mounted upside down scans clockwise."""
    turned = scan(
        angle_min=math.radians(135),
        angle_max=-math.radians(135),
        angle_increment=-math.radians(0.25),
    )
    assert turned == scan()


@pytest.mark.parametrize(
    ("first", "last", "increment", "beams"),
    [
        (0.0, 359.0, 1.0, 360),
        (-180.0, 180.0, 1.0, 360),
        (-179.0, 180.0, 1.0, 360),
        (0.0, 359.95, 0.05, 7200),
    ],
)
def test_full_circle_counts_closing_beam_once(first, last, increment, beams):
    angles = (math.radians(value) for value in (first, last, increment))
    lidar = scan(**dict(zip(("angle_min", "angle_max", "angle_increment"), angles, strict=True)))
    assert lidar.sees_all_round
    assert lidar.beams == beams
    assert np.ptp(lidar.angles) < 2 * math.pi


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"angle_increment": 0.0}, "angle_increment must lead"),
        ({"angle_increment": -0.1}, "angle_increment must lead"),
        ({"angle_increment": 1e-12}, "angle_increment must lead"),
        ({"angle_increment": 1e-320}, "angle_increment must"),
        ({"mount": (0, 0, None)}, "mount must be"),
        ({"angle_min": -7.0}, "at most 360 deg"),
        ({"angle_min": math.nan}, "angle_min must be"),
        ({"range_max": 0.0}, "range must be a positive"),
        ({"range_min": 40.0}, "min_range .* must be below"),
        ({"range_min": -1.0}, "min_range must be"),
    ],
)
def test_impossible_scans_are_refused(changes, reason):
    with pytest.raises(ConfigError, match=reason):
        scan(**changes)


@pytest.mark.parametrize("kind", ["ray", "gpu_ray", "lidar", "gpu_lidar"])
def test_lidar_is_read_from_description(tmp_path, kind):
    lidar = Lidar.from_file(described(tmp_path, kind=kind))
    assert (lidar.beams, lidar.range, lidar.min_range) == (271, 8.0, 0.12)
    assert lidar.field_of_view_deg == pytest.approx(270.0)
    assert (lidar.mount_x, lidar.mount_y, lidar.range_sigma) == (0.1, 0.02, 0.01)
    assert lidar.mount_yaw == pytest.approx(0.5)
    assert lidar.model == "front"


def test_lidar_upside_down_mirrors_mount_yaw(tmp_path):
    text = described(tmp_path, first=-0.5, last=1.5).read_text()
    level = Lidar.from_file(described(tmp_path, text=text))
    turned = Lidar.from_file(
        described(tmp_path, text=text.replace("0.3 0 0 0.5", "0.3 3.1416 0 0.5"))
    )
    assert level.mount_yaw == pytest.approx(0.5 + 0.5)
    assert turned.mount_yaw == pytest.approx(0.5 - 0.5, abs=1e-9)
    degrees = text.replace("<pose>", '<pose degrees="true">').replace("0 0 0.5<", "0 0 90<")
    assert Lidar.from_file(described(tmp_path, text=degrees)).mount_yaw == pytest.approx(
        0.5 + math.pi / 2
    )
    with pytest.raises(ConfigError, match="is tilted"):
        Lidar.from_file(described(tmp_path, text=text.replace("0.3 0 0 0.5", "0.3 0 0.5 0.5")))


def test_description_ignores_non_gaussian_noise(tmp_path):
    text = described(tmp_path).read_text().replace("<type>gaussian", "<type>none")
    assert Lidar.from_file(described(tmp_path, text=text)).range_sigma == Lidar().range_sigma


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"text": "no xml"}, "is no XML, see line 1; name a URDF or SDF file"),
        ({"text": "<!-- a\n -->\n<?xml version='1.0'?>\n<robot>"}, "is no XML, see line 4"),
        ({"text": "<launch><node pkg='amcl' type='amcl'/></launch>"}, "is a launch file of ROS 1"),
        ({"text": "<launch><node pkg='a' exec='b'/></launch>"}, "is a launch file; give the YAML"),
        (
            {"text": '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:a/></robot>'},
            "run xacro",
        ),
        ({"text": "<robot/>"}, "has no planar lidar"),
        ({"text": "<a>" * 5000}, "is no XML"),
        ({"text": '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'}, "is no robot's description"),
        ({"kind": "camera"}, "has no planar lidar"),
        ({"samples": "${samples}"}, r"samples must be a number.*run xacro"),
        ({"samples": 1}, "has 1 beams"),
        ({"samples": "9" * 400}, "samples must be a number|beams must be"),
        ({"last": "nan"}, "max_angle must be a number"),
    ],
)
def test_description_without_usable_lidar_is_refused(tmp_path, changes, reason):
    with pytest.raises(ConfigError, match=reason):
        Lidar.from_file(described(tmp_path, **changes))


def test_description_with_two_lidars_is_refused(tmp_path):
    one = described(tmp_path).read_text()
    two = one.replace("</robot>", "").replace("<?xml?>", "") + one[one.index("<gazebo") :]
    with pytest.raises(ConfigError, match=r"has 2 planar lidars .'front', 'front'."):
        Lidar.from_file(described(tmp_path, text=two))


# The mount on the robot

SENSOR = """<sensor name="back" type="gpu_lidar">{pose}<lidar><scan><horizontal>
<samples>181</samples><min_angle>-1.5708</min_angle><max_angle>1.5708</max_angle></horizontal></scan>
<range><min>0.1</min><max>8</max></range></lidar></sensor>"""
JOINTS = """<?xml version="1.0"?><robot name="r"><link name="world"/>
<joint name="a" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="9 9 0"/>
</joint><joint name="b" type="fixed"><parent link="base_link"/><child link="mast"/>
<origin xyz="-0.3 0.1 0.2" rpy="0 0 1.5707963"/></joint>
<joint name="c" type="fixed"><parent link="mast"/><child link="{link}"/>
<origin xyz="0.2 0 0.1" rpy="{rpy}"/></joint>
<link name="base_link"/><link name="mast"/><link name="{link}"/>{sensor}</robot>"""
ON_JOINTS = """<gazebo reference="scan_link">{sensor}</gazebo>"""
MODEL = """<!-- a comment first --><?xml version="1.0"?><sdf version="1.9"><model name="r">
<pose>5 5 0 0 0 2</pose><link name="base_link"><pose>1 0 0 0 0 1.5707963</pose></link>{links}
</model></sdf>"""


def joints(link="scan_link", rpy="0 0 1.5707963", pose="", sensor=ON_JOINTS):
    sensor = sensor.format(sensor=SENSOR.format(pose=pose))
    return JOINTS.format(link=link, rpy=rpy, sensor=sensor)


def model(links, pose=""):
    return MODEL.format(links=links.format(sensor=SENSOR.format(pose=pose)))


@pytest.mark.parametrize(
    ("text", "mount"),
    [
        (joints(), (-0.3, 0.3, 180)),
        (joints(pose="<pose>0.05 0 0 0 0 0</pose>"), (-0.35, 0.3, 180)),
        (joints(rpy="3.1415926 0 0"), (-0.3, 0.3, 90)),
        (model("<link name='l'><pose>1 -0.3 0.2 0 0 0</pose>{sensor}</link>"), (-0.3, 0, -90)),
        (
            model(
                "<link name='l'><pose relative_to='base_link'>0.2 0 0 0 0 1</pose>{sensor}</link>"
            ),
            (0.2, 0, math.degrees(1)),
        ),
        (
            model(
                "<frame name='f' attached_to='base_link'><pose degrees='true'>0.2 0 0 0 0 90</pose>"
                "</frame><link name='l'><pose relative_to='f'>0.1 0 0 0 0 0</pose>{sensor}</link>"
            ),
            (0.2, 0.1, 90),
        ),
        (
            model(
                "<model name='m'><pose relative_to='base_link'>0.2 0 0 0 0 0</pose>"
                "<link name='l'><pose>0.1 0 0 0 0 0</pose>{sensor}</link></model>"
            ),
            (0.3, 0, 0),
        ),
        (
            model(
                "<link name='l'>{sensor}</link><joint name='j'><child>l</child></joint>",
                "<pose relative_to='base_link' rotation_format='quat_xyzw'>0.4 0 0 0 0 0 1</pose>",
            ),
            (0.4, 0, 0),
        ),
    ],
)
def test_lidar_has_mount_of_description(tmp_path, text, mount):
    lidar = Lidar.from_file(described(tmp_path, text=text))
    assert (lidar.range, lidar.beams) == (8.0, 181)
    assert (lidar.mount_x, lidar.mount_y) == pytest.approx(mount[:2], abs=1e-6)
    assert math.remainder(lidar.mount_yaw_deg - mount[2], 360) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (joints(sensor=ON_JOINTS.replace("scan_link", "mast2")), "no pose of 'mast2'"),
        (
            model("<link name='l'><pose relative_to='x'>0 0 0 0 0 0</pose>{sensor}</link>"),
            "no pose of 'x'",
        ),
    ],
)
def test_lidar_warns_if_mount_is_unknown(tmp_path, text, fault):
    with pytest.warns(ParameterWarning, match=f"{fault}.*set mount_x, mount_y"):
        assert Lidar.from_file(described(tmp_path, text=text)).mount_x == 0


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (joints().replace('link="world"/><child', 'link="scan_link"/><child'), "form a circle"),
        (
            model("<link name='l'><pose relative_to='l'>0 0 0 0 0 0</pose>{sensor}</link>"),
            "frames form a circle",
        ),
        (joints(rpy="0 0 ${pi}"), "joint 'c' must be six numbers .*run xacro"),
        (joints(rpy="0 0.5 0"), "is tilted"),
    ],
)
def test_lidar_rejects_impossible_mounts(tmp_path, text, fault):
    with pytest.raises(ConfigError, match=fault):
        Lidar.from_file(described(tmp_path, text=text))


def test_named_lidar_takes_scanner_link_mount(tmp_path):
    """A real robot's URDF has no sensor of Gazebo, but the link that carries the scanner."""
    bare = described(tmp_path, text=joints("laser_frame", sensor=""))
    with pytest.raises(ConfigError, match="has no planar lidar; name the robot's, such as lidar="):
        Robot.load(bare)
    lidar = Robot.load(bare, lidar="tim571").lidar
    assert (lidar.range, lidar.mount_yaw_deg) == pytest.approx((25.0, 180), abs=1e-4)
    assert (lidar.mount_x, lidar.mount_y) == pytest.approx((-0.3, 0.3), abs=1e-6)
    mounted = Lidar.preset("tim571")
    mounted = dataclasses.replace(mounted, mount_x=0.7)
    assert Robot.load(bare, lidar=mounted).lidar == mounted
    with_sensor = described(tmp_path, text=joints())
    assert Robot.load(with_sensor, lidar="tim571").lidar.mount_x == pytest.approx(-0.3)


def test_named_lidar_warns_without_scanner_link(tmp_path):
    with pytest.warns(ParameterWarning, match="has no link named like a scanner"):
        Robot.load(described(tmp_path, text=joints("camera", sensor="")), lidar="tim571")
    two = joints("laser", sensor='<link name="rear_laser"/>')
    with pytest.warns(ParameterWarning, match="has 2 links named like a scanner .*set mount_x"):
        robot = Robot.load(described(tmp_path, text=two), lidar="tim571")
    assert robot.lidar == Lidar.preset("tim571")


def test_parameters_of_nav2_name_no_lidar(tmp_path):
    (tmp_path / "nav2.yaml").write_text("amcl: {ros__parameters: {laser_max_range: 12.0}}")
    with pytest.raises(ConfigError, match="only limit a lidar's range"):
        Lidar.from_file(tmp_path / "nav2.yaml")


def test_amcl_narrows_but_never_extends_range():
    from support.maps import ascii_map

    grid, lidar = ascii_map("###", "#.#", "###"), Lidar(range=10.0, min_range=0.2)
    for amcl, least, most in (
        (Amcl(), 0.2, 10.0),
        (Amcl(laser_min_range=0.5, laser_max_range=4.0), 0.5, 4.0),
        (Amcl(laser_min_range=0.1, laser_max_range=0.0), 0.2, 10.0),
    ):
        beams = make_drive_arguments(grid, Robot(lidar, filter=amcl)).lidar
        assert (beams.min_range, beams.max_range) == (least, most)

"""Lidars by data sheets, from scans and from robots' descriptions."""

import dataclasses
import math

import numpy as np
import pytest

from locplan.errors import ConfigError
from locplan.field import Fisher, Fused, Sad, Scan
from locplan.robots import PRESETS, Amcl, Lidar, Robot
from locplan.simulation import drive_arguments

URDF = """<robot name="r"><gazebo reference="laser"><sensor name="front" type="{kind}">
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


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_lidars_with_a_source(name):
    lidar = Lidar.preset(name)
    assert lidar.model == name
    assert PRESETS[name].source
    assert 0 <= lidar.min_range < lidar.range
    assert lidar.title.startswith(f"{name}, {lidar.range:g} m")


def test_robots_have_the_lidars_that_they_carry():
    assert Lidar.preset("turtlebot4") == Lidar.preset("rplidar-a1")
    assert Lidar.preset("turtlebot3") == Lidar.preset("lds-02")


@pytest.mark.parametrize("of", [Sad.of, Scan, Fisher, Fused.of])
def test_the_name_of_a_lidar_decides_nothing(of):
    named = Lidar.preset("tim571")
    plain = dataclasses.replace(named, model="")
    assert of(named) == of(plain)
    assert of(named).identity() == of(plain).identity()
    assert "tim571" in of(named).summary
    assert "tim571" not in of(plain).summary


@pytest.mark.parametrize("of", [Sad.of, Scan, Fisher, Fused.of])
def test_an_estimator_takes_another_lidar_and_keeps_its_settings(of):
    estimator = dataclasses.replace(of(Lidar(range=8.0)), noise_level=2.0)
    other = estimator.with_lidar(Lidar.preset("utm-30lx"))
    assert other == dataclasses.replace(of(Lidar.preset("utm-30lx")), noise_level=2.0)
    assert other.reach == 30.0


def test_a_scan_tells_its_lidar():
    lidar = scan(mount=(0.2, -0.1, 0.3))
    assert (lidar.beams, lidar.range, lidar.min_range) == (1081, 30.0, 0.1)
    assert lidar.field_of_view_deg == pytest.approx(270.0)
    assert (lidar.mount_x, lidar.mount_y) == (0.2, -0.1)
    assert lidar.mount_yaw == pytest.approx(0.3)
    np.testing.assert_allclose(lidar.angles[[0, -1]], np.radians([-135, 135]), atol=1e-9)


def test_the_middle_of_a_lopsided_scan_is_the_yaw_of_its_mount():
    lidar = scan(angle_min=0.0, angle_max=math.pi / 2)
    assert lidar.mount_yaw == pytest.approx(math.pi / 4)
    np.testing.assert_allclose(lidar.mount_yaw + lidar.angles[[0, -1]], [0, math.pi / 2], atol=1e-9)


@pytest.mark.parametrize(("first", "last"), [(0.0, 6.28), (-math.pi, math.pi), (0.0, 6.2657)])
@pytest.mark.parametrize(("resolution", "beams"), [("1", 360), ("0.299", 107)])
def test_a_described_lidar_has_a_beam_for_every_sample(tmp_path, first, last, resolution, beams):
    text = described(tmp_path, samples=360, first=first, last=last).read_text()
    text = text.replace("<resolution>1<", f"<resolution>{resolution}<")
    lidar = Lidar.from_file(described(tmp_path, text=text))
    assert lidar.sees_all_round
    assert lidar.beams == beams


def test_a_lidar_upside_down_has_as_many_beams():
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
def test_a_full_circle_is_seen_whether_or_not_its_ends_meet(first, last, increment, beams):
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
def test_a_description_tells_its_lidar(tmp_path, kind):
    lidar = Lidar.from_file(described(tmp_path, kind=kind))
    assert (lidar.beams, lidar.range, lidar.min_range) == (271, 8.0, 0.12)
    assert lidar.field_of_view_deg == pytest.approx(270.0)
    assert (lidar.mount_x, lidar.mount_y, lidar.range_sigma) == (0.1, 0.02, 0.01)
    assert lidar.mount_yaw == pytest.approx(0.5)
    assert lidar.model == "front"


def test_a_lidar_upside_down_sees_the_other_side(tmp_path):
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


def test_noise_that_is_not_gaussian_is_left_out(tmp_path):
    text = described(tmp_path).read_text().replace("<type>gaussian", "<type>none")
    assert Lidar.from_file(described(tmp_path, text=text)).range_sigma == Lidar().range_sigma


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"text": "no xml"}, "is no XML; name a URDF or SDF file"),
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
def test_descriptions_without_a_useful_lidar_are_refused(tmp_path, changes, reason):
    with pytest.raises(ConfigError, match=reason):
        Lidar.from_file(described(tmp_path, **changes))


def test_several_lidars_in_a_file_are_named(tmp_path):
    one = described(tmp_path).read_text()
    two = one.replace("</robot>", "").replace("<?xml?>", "") + one[one.index("<gazebo") :]
    with pytest.raises(ConfigError, match=r"has 2 planar lidars .'front', 'front'."):
        Lidar.from_file(described(tmp_path, text=two))


def test_parameters_of_nav2_name_no_lidar(tmp_path):
    (tmp_path / "nav2.yaml").write_text("amcl: {ros__parameters: {laser_max_range: 12.0}}")
    with pytest.raises(ConfigError, match="name no lidar, their ranges only limit one"):
        Lidar.from_file(tmp_path / "nav2.yaml")


def test_amcl_only_limits_the_lidar():
    from conftest import drawn

    grid, lidar = drawn("###", "#.#", "###"), Lidar(range=10.0, min_range=0.2)
    for amcl, least, most in (
        (Amcl(), 0.2, 10.0),
        (Amcl(laser_min_range=0.5, laser_max_range=4.0), 0.5, 4.0),
        (Amcl(laser_min_range=0.1, laser_max_range=0.0), 0.2, 10.0),
    ):
        beams = drive_arguments(grid, Robot(lidar, filter=amcl)).lidar
        assert (beams.min_range, beams.max_range) == (least, most)

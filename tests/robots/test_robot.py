"""Robots: their files, their settings, and the parameters of Nav2 that they are read from."""

import dataclasses
import math
from pathlib import Path

import pytest

from locplan import Footprint, Lidar, Robot
from locplan.errors import ConfigError, LocplanError
from locplan.robots import Amcl, Disturbances, Kinematics, Odometry
from locplan.robots.amcl import OMNIDIRECTIONAL
from locplan.robots.nav2 import ParameterWarning
from locplan.robots.parts import Inflation

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "nav2_params.yaml"
CORNERS = [(0.5, 0.3), (0.5, -0.3), (-0.4, -0.3), (-0.4, 0.3)]
FULL = Robot(
    Lidar(range=8.0, beams=91, model="on", mount_x=0.1, range_sigma=1e-6),
    footprint=Footprint(CORNERS),
    margin=0.1,
    kinematics=Kinematics(drive="car-like", turning_radius=1.2, reverse=False, speed=0.8),
    goal_tolerance=0.5,
    inflation=Inflation(inflation_radius=0.7, cost_scaling_factor=3.0),
    filter=Amcl(alpha1=0.05, laser_model_type="likelihood_field_prob", half_cell=False),
    odometry=Odometry(turn_bias=0.1),
    disturbances=Disturbances(worlds=3),
)
PARTS = ("lidar", "kinematics", "inflation", "filter", "odometry", "disturbances")
OTHER = {
    "model": "another",
    "field_of_view_deg": 270.0,
    "drive": "omnidirectional",
    "laser_model_type": "likelihood_field",
    "robot_model_type": OMNIDIRECTIONAL,
    "z_hit": 0.6,
}
"""Other values of some settings; numbers grow by a little, and truths become false."""
URDF = """<robot><gazebo><sensor name="tim" type="ray"><pose>0.2 0 0 0 0 0</pose><ray>
<scan><horizontal><samples>271</samples><min_angle>-2.3562</min_angle><max_angle>2.3562</max_angle>
</horizontal></scan><range><min>0.05</min><max>25.0</max></range></ray></sensor></gazebo></robot>
"""


def write_file(folder, text: str, name: str = "robot.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def from_nav2(folder, text: str) -> Robot:
    return Robot.load(write_file(folder, text, "nav2.yaml"))


# The robot and its settings


def test_radius_is_inscribed_radius_plus_margin():
    assert FULL.radius == pytest.approx(0.3 + 0.1)
    assert FULL.outline is FULL.footprint
    assert Robot(footprint=0.3, margin=0.02).radius == pytest.approx(0.32)
    assert Robot().radius == 0.25
    assert Robot().outline is None


def test_robot_accepts_lidar_name():
    assert (
        Robot("turtlebot4").lidar
        == Robot().with_settings(dataclasses.asdict(Lidar.preset("turtlebot4"))).lidar
    )
    with pytest.raises(ConfigError, match=r'lidar is not known; name it, as in Robot\("turtle'):
        _ = Robot().known_lidar


def test_title_names_lidar_and_changed_settings():
    assert FULL.title == (
        "on, 8 m, 360°; 4 corners, margin 0.1 m; AMCL's alpha1 0.05, laser_model_type"
        " likelihood_field_prob, half_cell false, turn_bias 0.1, worlds 3"
    )
    assert Robot().title == "no lidar named; radius 0.2 m, margin 0.05 m; Nav2's defaults"


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"lidar": 3}, "lidar must be a Lidar, not 3"),
        ({"lidar": "sonar"}, "lidar must be one of rplidar-a1"),
        ({"footprint": "wide"}, "footprint must be a number of at least 0, not 'wide'"),
        ({"footprint": -0.1}, "footprint must be at least 0"),
        ({"margin": -0.1}, "margin must be at least 0"),
        ({"goal_tolerance": math.nan}, "goal_tolerance must be at least 0"),
        ({"kinematics": None}, "kinematics must be a Kinematics"),
        ({"inflation": 0.5}, "inflation must be an Inflation, not 0.5"),
        ({"filter": {}}, "filter must be an Amcl"),
        ({"odometry": Disturbances()}, "odometry must be an Odometry"),
        ({"disturbances": Odometry()}, "disturbances must be a Disturbances"),
    ],
)
def test_parts_of_other_kinds_are_refused(part, said):
    with pytest.raises(ConfigError, match=said):
        Robot(**part)


@pytest.mark.parametrize(
    ("drive", "said"),
    [
        ({"drive": "car-like"}, "turning_radius must be above 0 for a car-like robot"),
        ({"turning_radius": 0.5}, "this robot is differential with 0.5 m"),
        ({"drive": "legs"}, "drive must be one of differential, omnidirectional, car-like"),
        ({"reverse": 1}, "reverse must be a bool"),
        ({"speed": 0.0}, "speed must be positive"),
    ],
)
def test_kinematics_reject_impossible_values(drive, said):
    with pytest.raises(ConfigError, match=said):
        Kinematics(**drive)


def settings(robot: Robot) -> dict[str, object]:
    """All settings of a robot by their flat names."""
    own = {name: getattr(robot, name) for name in ("footprint", "margin", "goal_tolerance")}
    return own | {
        name: value
        for part in PARTS
        for name, value in dataclasses.asdict(getattr(robot, part)).items()
    }


def another(name: str, value: object) -> object:
    if name in OTHER or isinstance(value, bool):
        return OTHER.get(name, not value)
    return value + 1 if isinstance(value, int) else 0.9 * value + 0.007


def test_setting_names_are_unique():
    names = [each.name for part in PARTS for each in dataclasses.fields(getattr(FULL, part))]
    assert len(names) == len(set(names)) == len(settings(FULL)) - 3


def test_lidar_name_does_not_change_robot():
    other = FULL.with_settings({"model": "another"})
    assert other == FULL
    assert other.digest == FULL.digest
    assert other.title != FULL.title


def test_setting_changes_digest_and_nothing_else():
    digests, before = {FULL.digest}, settings(FULL)
    for name, value in before.items():
        new = 0.4 if name == "footprint" else another(name, value)
        least = {"turning_radius": 0.0} if name == "drive" else {}
        changed = FULL.with_settings({name: new, **least})
        assert settings(changed) == before | {name: new} | least
        if name != "model":
            digests.add(changed.digest)
    for part in ("lidar", "inflation"):
        digests.add(dataclasses.replace(FULL, **{part: None}).digest)
    assert len(digests) == len(before) + 2
    assert Robot().digest == Robot(filter=Amcl()).digest


def test_robot_accepts_corners_as_footprint():
    changed = Robot().with_settings({"footprint": [list(corner) for corner in CORNERS]})
    assert changed == Robot(footprint=Footprint(CORNERS))
    assert changed.digest == Robot(footprint=Footprint(CORNERS)).digest
    assert changed != Robot(footprint=Footprint([(0.6, 0.3), *CORNERS[1:]]))


def test_settings_create_missing_robot_parts():
    assert Robot().with_settings({"range": 8}).lidar == Lidar(range=8.0)
    assert Robot().with_settings({"inflation_radius": 0.3}).inflation == Inflation(
        inflation_radius=0.3
    )
    assert (
        Robot("turtlebot4").with_settings({"range": 8}).lidar.beams
        == Lidar.preset("turtlebot4").beams
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"alpha9": 1},
            "a robot has no setting 'alpha9'; it has footprint, margin, goal_tolerance",
        ),
        ({"lidar": "tim571"}, "a robot has no setting 'lidar'"),
        ({"alpha1": -1}, "alpha1 must be at least 0"),
        ({"range": 8, "min_range": 9}, r"min_range \(9.0 m\) must be below range \(8.0 m\)"),
        ({"footprint": [[1, 1], [2, 1], [2, 2]]}, "footprint must be a polygon around"),
        ({"footprint": "0.3m"}, "footprint must be a number of at least 0, not '0.3m'"),
        ({"drive": "car-like"}, "turning_radius must be above 0"),
    ],
)
def test_robot_rejects_wrong_settings(changes, said):
    with pytest.raises(ConfigError, match=said):
        Robot().with_settings(changes)


# Its files


@pytest.mark.parametrize("robot", [Robot(), Robot("turtlebot4"), FULL], ids=["", "named", "full"])
def test_loaded_robot_equals_saved_robot(tmp_path, robot):
    file = tmp_path / "robot.yaml"
    file.write_text("old")
    robot.save(file)
    loaded = Robot.load(file)
    assert loaded == robot
    assert hash(loaded) == hash(robot)
    assert loaded.digest == robot.digest
    assert Robot.from_summary(robot.summary()) == robot


def test_robot_is_saved_only_as_yaml(tmp_path):
    with pytest.raises(LocplanError, match=r"must end in \.yaml"):
        Robot().save(tmp_path / "robot.json")


def test_later_robot_file_overrides_earlier_file(tmp_path):
    saved = tmp_path / "saved.yaml"
    FULL.save(saved)
    urdf = write_file(tmp_path, URDF, "robot.urdf")
    nav2 = write_file(tmp_path, "amcl: {ros__parameters: {alpha1: 0.1}}", "nav2.yaml")
    own = write_file(tmp_path, "robot: {margin: 0.02, lidar: tim571}", "own.yaml")
    robot = Robot.load(saved, nav2, urdf)
    assert robot.lidar == Lidar.from_file(urdf)
    assert robot.filter == dataclasses.replace(FULL.amcl, alpha1=0.1)
    assert (robot.kinematics, robot.footprint) == (FULL.kinematics, FULL.footprint)
    assert Robot.load(urdf, nav2, saved) == FULL
    last = Robot.load(saved, own)
    assert (last.margin, last.lidar) == (0.02, Lidar.preset("tim571"))
    assert last.filter == FULL.filter
    assert Robot.load() == Robot()


def test_robot_takes_lidar_from_description(tmp_path):
    robot = Robot.load(write_file(tmp_path, URDF, "robot.URDF"))
    assert (robot.lidar.range, robot.lidar.beams, robot.lidar.mount_x) == (25.0, 271, 0.2)
    assert robot == Robot(robot.lidar)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robot: {speed: 1}", "a robot has no 'speed'; it has lidar, kinematics"),
        ("robot: {filter: {alpha9: 1}}", "filter has no 'alpha9'; it has alpha1"),
        ("robot: {filter: {alpha1: -1}}", "filter: alpha1 must be at least 0"),
        ("robot: {filter: mine}", "filter must be an Amcl, not 'mine'"),
        ("robot: {lidar: [3]}", "lidar must hold settings by name"),
        ("robot: {lidar: sonar}", "lidar must be one of"),
        ("robot: {margin: -1}", "margin must be at least 0, not -1"),
        ("robot: {footprint: [[1, 2]]}", "footprint must be three or more finite corners"),
        ("robot: {kinematics: {drive: car-like}}", "kinematics: turning_radius must be above 0"),
        ("robot: 3", "has no parameters of Nav2's nodes; give Nav2's .* or a robot's file"),
    ],
)
def test_robot_file_errors_are_one_line(tmp_path, text, said):
    with pytest.raises(LocplanError, match=f"robot.yaml: {said}") as fault:
        Robot.load(write_file(tmp_path, text))
    assert "\n" not in str(fault.value)


# Parameters of Nav2


def test_example_robot_has_nav2_defaults():
    robot = Robot.load(EXAMPLE, lidar="turtlebot4")
    assert robot == Robot(
        "turtlebot4",
        footprint=0.22,
        margin=0.0,
        inflation=Inflation(inflation_radius=0.7, cost_scaling_factor=3.0),
    )
    assert Robot.load(EXAMPLE) == dataclasses.replace(robot, lidar=None)


GLOBAL = "global_costmap: {global_costmap: {ros__parameters: {%s}}}"


def test_inflation_is_read_from_costmap_layer(tmp_path):
    kind = "plugin: 'nav2_costmap_2d::InflationLayer'"
    layer = f"blown: {{{kind}, cost_scaling_factor: 2.0}}"
    walls = "walls: {plugin: 'nav2_costmap_2d::StaticLayer'}"
    robot = from_nav2(tmp_path, GLOBAL % f"plugins: [walls, blown], {walls}, {layer}")
    assert robot.inflation == Inflation(cost_scaling_factor=2.0)
    assert from_nav2(tmp_path, GLOBAL % f"plugins: [walls], {walls}, {layer}").inflation is None
    wrong = f"plugins: [blown], blown: {{{kind}, inflation_radius: -1.0}}"
    with pytest.raises(ConfigError, match=r"global_costmap: blown: inflation_radius must be at"):
        from_nav2(tmp_path, GLOBAL % wrong)


@pytest.mark.parametrize(
    ("planner", "expected"),
    [
        ("motion_model_for_search: DUBIN, minimum_turning_radius: 1.5", (1.5, False)),
        ("motion_model_for_search: REEDS_SHEPP, minimum_turning_radius: 2", (2.0, True)),
        ("motion_model_for_search: REEDS_SHEPP", (0.4, True)),
    ],
)
def test_kinematics_follow_planner_motion_model(tmp_path, planner, expected):
    plugin = "plugin: 'nav2_smac_planner::SmacPlannerHybrid'"
    planners = f"planner_plugins: [a], a: {{{plugin}, {planner}}}"
    text = f"planner_server: {{ros__parameters: {{{planners}}}}}"
    kinematics = from_nav2(tmp_path, text).kinematics
    assert kinematics.drive == "car-like"
    assert (kinematics.turning_radius, kinematics.reverse) == expected


def test_zero_turning_radius_is_refused(tmp_path):
    own = "a: {plugin: nav2_smac_planner/SmacPlannerHybrid, minimum_turning_radius: 0.0}"
    text = f"planner_server: {{ros__parameters: {{planner_plugins: [a], {own}}}}}"
    with pytest.raises(
        ConfigError, match=r"nav2\.yaml: planner_server: a: turning_radius must be above 0"
    ):
        from_nav2(tmp_path, text)


@pytest.mark.parametrize("model", [OMNIDIRECTIONAL, "omnidirectional"])
def test_omnidirectional_filter_makes_robot_omnidirectional(tmp_path, model):
    robot = from_nav2(tmp_path, f'amcl: {{ros__parameters: {{robot_model_type: "{model}"}}}}')
    assert robot == Robot(
        kinematics=Kinematics(drive="omnidirectional"),
        filter=Amcl(robot_model_type=OMNIDIRECTIONAL),
    )


def test_robot_warns_about_unsimulated_parameters(tmp_path):
    own = "robot_model_type: 'my::Legs', do_beamskip: true, beam_count: 3"
    own += ", laser_model_type: likelihood_field_prob, recovery_alpha_slow: 0.001"
    said = r"nav2\.yaml: not simulated: do_beamskip, robot_model_type, beam_count$"
    with pytest.warns(ParameterWarning, match=said):
        robot = from_nav2(tmp_path, f"amcl: {{ros__parameters: {{{own}}}}}")
    assert robot.filter == Amcl(laser_model_type="likelihood_field_prob", recovery_alpha_slow=0.001)

"""Parameters of Nav2 as ROS resolves them: wildcards, namespaces, several robots in a file."""

import numpy as np
import pytest
import yaml

from locplan.errors import LocplanError
from locplan.export import nav2_speed
from locplan.field import FieldConfig, Sad, covariance_field
from locplan.maps import FREE, OccupancyGrid
from locplan.planning import Costmap
from locplan.robots import Robot, read_parameters
from locplan.robots.nav2 import read_amcl
from locplan.robots.parameter_edits import edit_parameters

BESIDE = "amcl:\n  ros__parameters:\n    alpha1: 0.1\n    alpha2: 0.1\n"
SHARED = (
    "/**:\n  ros__parameters:\n    alpha1: 0.3\n    use_sim_time: true\n    robot_radius: 0.4\n"
)
FLEET = """/**/amcl:
  ros__parameters:
    alpha1: 0.3   # all robots
    alpha2: 0.3
robot1:
  amcl: {ros__parameters: {alpha2: 0.1}}
  global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2, filters: [mine]}}}
robot2/amcl:
  ros__parameters:
    alpha2: 0.2
/robot2:
  global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.5}}}
"""


def write(folder, text):
    file = folder / "nav2.yaml"
    file.write_text(text)
    return file


def amcl(folder, text, robot=""):
    return read_parameters(f"{write(folder, text)}{robot}").read_node_parameters("amcl")


@pytest.mark.parametrize(
    ("name", "fits"),
    [
        ("amcl", {"/"}),
        ("/amcl", {"/"}),
        ("/**", {"/", "robot1", "fleet/robot1"}),
        ("/**/amcl", {"/", "robot1", "fleet/robot1"}),
        ("/*/amcl", {"robot1"}),
        ("/*", {"/"}),
        ("robot1/**", {"robot1"}),
        ("/fleet/**/amcl", {"fleet/robot1"}),
        ("/**/robot1/*", {"robot1", "fleet/robot1"}),
        ("/**/planner_server", set()),
    ],
)
def test_wildcards_match_names_as_in_rclcpp(tmp_path, name, fits):
    text = f"{name}: {{ros__parameters: {{alpha1: 0.5}}}}\n/**: {{ros__parameters: {{b: 1}}}}\n"
    found = set()
    for robot in ("/", "robot1", "fleet/robot1"):
        try:
            own = read_parameters(f"{write(tmp_path, text)}:{robot}").read_node_parameters("amcl")
        except LocplanError:
            continue
        found |= {robot} if "alpha1" in own else set()
    assert found == fits


def test_last_matching_entry_sets_value(tmp_path):
    """A later wildcard wins over the node's name, as in ROS."""
    assert amcl(tmp_path, BESIDE + SHARED)["alpha1"] == 0.3
    assert amcl(tmp_path, SHARED + BESIDE)["alpha1"] == 0.1
    everywhere = SHARED.replace("/**", "/**/amcl")
    assert amcl(tmp_path, BESIDE + everywhere)["alpha1"] == 0.3
    assert amcl(tmp_path, "/**: {amcl: {ros__parameters: {a: 1}}}\n" + BESIDE)["a"] == 1
    # Entries of one name count where the first of them stands, and so do keys that stand twice.
    twice = "/**: {amcl: {ros__parameters: {alpha1: 0.5}}}\n" + BESIDE
    assert amcl(tmp_path, twice + everywhere)["alpha1"] == 0.1
    again = BESIDE + SHARED + BESIDE.replace("    alpha2: 0.1\n", "").replace("0.1", "0.7")
    assert [amcl(tmp_path, again)[name] for name in ("alpha1", "alpha2")] == [0.3, 0.1]


def test_plugins_settings_are_parameters_with_dots(tmp_path):
    text = "amcl: {ros__parameters: {a.b: 1, a: {c: 2}}}\n/**: {ros__parameters: {a: {b: 3}}}\n"
    assert amcl(tmp_path, text) == {"a.b": 3, "a.c": 2}


def test_amcl_reads_parameters_of_all_nodes(tmp_path):
    file = write(tmp_path, BESIDE + SHARED)
    found = read_amcl(file)  # robot_radius, which others read, is no warning
    assert (found.alpha1, found.alpha2) == (0.3, 0.1)
    file = write(tmp_path, SHARED)
    assert read_amcl(file).alpha1 == 0.3
    assert Robot.load(file).footprint == 0.4
    file = write(tmp_path, "/**: {ros__parameters: {use_sim_time: true}}\n")
    with pytest.raises(LocplanError, match="has no parameters of amcl"):
        read_amcl(file)


def test_single_namespace_needs_no_robot_name(tmp_path):
    text = "robot1: {amcl: {ros__parameters: {alpha1: 0.5}}}\n"
    for namespaced in (text, text.replace("robot1", "<robot_namespace>"), "/**" + text[6:]):
        assert read_amcl(write(tmp_path, namespaced)).alpha1 == 0.5


def test_several_robots_are_chosen_by_name(tmp_path):
    file = write(tmp_path, FLEET)
    for read in (read_amcl, Robot.load):
        with pytest.raises(LocplanError, match="several robots, '/robot1', '/robot2'; name one"):
            read(file)
    for robot, alpha2, radius in (("robot1", 0.1, 0.2), ("/robot2", 0.2, 0.5)):
        amcl_settings = read_amcl(f"{file}:{robot}")
        assert (amcl_settings.alpha1, amcl_settings.alpha2) == (0.3, alpha2)
        loaded = Robot.load(f"{file}:{robot}")
        assert (loaded.filter, loaded.footprint) == (amcl_settings, radius)
    with pytest.raises(LocplanError, match="has no robot '/robot3'; it has '/robot1', '/robot2'"):
        read_amcl(f"{file}:robot3")
    root = write(tmp_path, FLEET + BESIDE)
    assert read_amcl(f"{root}:/").alpha2 == 0.1


def test_parameter_file_name_may_contain_colon(tmp_path):
    file = tmp_path / "nav2.yaml:robot1"
    file.write_text(BESIDE)
    assert read_amcl(file).alpha1 == 0.1
    with pytest.raises(LocplanError, match="there is no such file"):
        read_amcl(tmp_path / "none.yaml:robot1")


@pytest.mark.parametrize(
    ("text", "robot", "line", "new"),
    [
        (BESIDE + SHARED, "", "    alpha1: 0.3\n", "    alpha1: 0.05\n"),
        (SHARED + BESIDE, "", "    alpha1: 0.1\n", "    alpha1: 0.05\n"),
        (FLEET, ":robot2", "    alpha1: 0.3   # all", "    alpha1: 0.05   # all"),
        (BESIDE + BESIDE.replace("0.1", "0.2"), "", "    alpha1: 0.2\n", "    alpha1: 0.05\n"),
    ],
)
def test_edit_changes_active_value(tmp_path, text, robot, line, new):
    file = write(tmp_path, text)
    made = edit_parameters(f"{file}{robot}", "amcl", {"alpha1": 0.05}).decode()
    assert made == text.replace(line, new)
    file.write_text(made)
    assert read_amcl(f"{file}{robot}").alpha1 == 0.05


def test_edit_adds_missing_value_to_node(tmp_path):
    file = write(tmp_path, FLEET)
    made = edit_parameters(f"{file}:robot1", "amcl", {"alpha3": 0.05}).decode()
    assert made == FLEET.replace("{alpha2: 0.1}", "{alpha3: 0.05, alpha2: 0.1}")
    everywhere = "/**/amcl: {ros__parameters: {beta: 1}}\n"
    made = edit_parameters(write(tmp_path, BESIDE + everywhere), "amcl", {"alpha3": 0.05})
    assert (
        made.decode() == BESIDE.replace("    alpha1", "    alpha3: 0.05\n    alpha1") + everywhere
    )
    file = write(tmp_path, "# mine\n" + SHARED)
    made = edit_parameters(file, "amcl", {"alpha2": 0.05}).decode()
    assert made == "# mine\namcl: {ros__parameters: {alpha2: 0.05}}\n" + SHARED


def test_export_merges_masks_into_named_robot(tmp_path):
    grid = OccupancyGrid(np.full((20, 30), FREE, np.uint8), 0.1)
    field = covariance_field(grid, FieldConfig(Sad(range=1.0)))
    costs = Costmap.from_field(field, robot=0.15)
    file = write(tmp_path, FLEET)
    nav2_speed(tmp_path / "mask", costs, params=f"{file}:robot1")
    merged = yaml.safe_load((tmp_path / "mask" / "nav2.yaml").read_text())
    before = yaml.safe_load(FLEET)
    own = merged["robot1"]["global_costmap"]["global_costmap"]["ros__parameters"]
    assert own["filters"] == ["mine", "localizability_speed_filter"]
    assert own["localizability_speed_filter"]["enabled"] is True
    del merged["robot1"]["global_costmap"], before["robot1"]["global_costmap"]
    assert merged == before

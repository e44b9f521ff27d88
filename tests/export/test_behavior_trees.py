"""Exports in force: the robot's own parameters and tree, with the planner that a mask is for."""

import json
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from support.cases import sample_cases

from locplan import plan
from locplan.errors import ConfigError, LocplanError
from locplan.export import nav2_keepout, nav2_routes, nav2_speed
from locplan.export.parameters import ParametersChanged, RobotWarning
from locplan.export.servers import write_filter_map
from locplan.maps import OccupancyGrid, environments
from locplan.planning import Costmap, Path
from locplan.robots import Amcl
from locplan.robots.parameter_edits import edit_parameters
from locplan.simulation.amcl_parameters import write_tuned_parameters

pytestmark = pytest.mark.usefixtures("undrawn")

PARAMS = """# The robot of hall 3.
bt_navigator:
  ros__parameters:
    global_frame: map  # not odom
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: 0.22  # measured
      plugins: ["static_layer", "inflation_layer"]
      filters:
        - mine   # the yard
      mine: {plugin: "nav2_costmap_2d::KeepoutFilter"}
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
        cost_scaling_factor: 3.0  # wide
        inflation_radius: 0.7
planner_server:
  ros__parameters:
    planner_plugins: ["GridBased"]
    # The old one.
    GridBased:
      plugin: "nav2_navfn_planner::NavfnPlanner"
"""
SELECTING = """<root BTCPP_format="4"><!-- ours -->
  <PlannerSelector selected_planner="{selected_planner}" default_planner="GridBased"/>
  <ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"/>
</root>
"""
NAMING = """<root><BehaviorTree ID="Main">
  <ComputePathToPose goal="{goal}" path="{path}" planner_id="GridBased"/>
  <ComputePathThroughPoses goals="{goals}" path="{path}"/>
</BehaviorTree></root>
"""


@pytest.fixture(scope="module")
def costs():
    grid = environments.make("two_corridors", resolution=0.1)
    y = np.indices(grid.shape)[0] * 0.1
    u = np.where((y > 1) & (y < 5), 1.0, 0.05)  # the straight corridor
    return Costmap.from_layers(grid, u=u, weight=8.0, robot=0.25)


def export_keepout(folder, costs, params=PARAMS, **settings):
    (folder / "own.yaml").write_text(params)
    with warnings.catch_warnings(record=True, action="always"):  # what is added and changed
        return nav2_keepout(folder / "m", costs, params=folder / "own.yaml", **settings)


def test_export_keeps_parameter_comments(tmp_path, costs):
    export_keepout(tmp_path, costs)
    text = (tmp_path / "m" / "nav2.yaml").read_text()
    for line in ("# The robot of hall 3.", "global_frame: map  # not odom", "# The old one."):
        assert line in text
    assert "robot_radius: 0.22  # measured" in text
    assert "cost_scaling_factor: 3.0  # wide" in text  # people inflate as before
    own = yaml.safe_load(text)
    costmap = own["global_costmap"]["global_costmap"]["ros__parameters"]
    assert costmap["filters"] == ["mine", "localizability_keepout_filter"]
    assert costmap["localizability_keepout_filter"]["enabled"] is True
    server = own["planner_server"]["ros__parameters"]
    assert server["planner_plugins"] == ["GridBased", "Localizability"]
    assert server["Localizability"]["cost_travel_multiplier"] == pytest.approx(10.542, abs=1e-3)
    assert "without its comments" not in (tmp_path / "m" / "README.md").read_text()


def test_default_planner_keeps_its_type(tmp_path, costs):
    """Nav2 gives GridBased a type only if no other planner is listed."""
    export_keepout(tmp_path, costs, PARAMS.replace('plugin: "nav2_navfn_planner::N', 'note: "N'))
    server = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())["planner_server"]
    assert server["ros__parameters"]["planner_plugins"] == ["GridBased", "Localizability"]
    default = server["ros__parameters"]["GridBased"]["plugin"]
    assert default == "nav2_navfn_planner::NavfnPlanner"


def test_keepout_export_avoids_navfn(tmp_path, costs):
    """NavFn ignores most of a mask, so the export adds Smac or Theta*."""
    (tmp_path / "own.yaml").write_text(PARAMS.replace("factor: 3.0", "factor: 12.0"))
    with pytest.warns(RobotWarning, match=r"NavfnPlanner\): it ignores most of a mask"):
        found = nav2_keepout(tmp_path / "m", costs, params=tmp_path / "own.yaml")
    assert found.planner.name == "smac2d"
    large = OccupancyGrid(np.full((1001, 1000), 254, np.uint8), 0.1)
    wide = Costmap.from_layers(large, u=np.zeros(large.shape), robot=0.1)
    assert export_keepout(tmp_path, wide).planner.name == "thetastar"
    assert "Its paths zigzag" in (tmp_path / "m" / "README.md").read_text()


@pytest.mark.parametrize(
    ("distro", "words"),
    [
        ("jazzy", "topic pub --qos-durability transient_local --qos-reliability reliable"),
        ("humble", "export again with `--tree TREE.xml`"),
    ],
)
def test_readme_explains_planner_selection(tmp_path, costs, distro, words):
    slashes = PARAMS.replace("planner::Nav", "planner/Nav") if distro == "humble" else PARAMS
    export_keepout(tmp_path, costs, slashes, distro=distro)
    text = (tmp_path / "m" / "README.md").read_text()
    assert words in text
    assert ('/planner_selector std_msgs/msg/String "{data: Localizability}"' in text) == (
        distro == "jazzy"
    )


@pytest.mark.parametrize("planner", sample_cases(["smac2d", "thetastar"]))
@pytest.mark.parametrize("tree", [SELECTING, NAMING])
def test_behavior_tree_uses_exported_planner(tmp_path, costs, tree, planner):
    (tmp_path / "own.xml").write_text(tree)
    export_keepout(tmp_path, costs, planner=planner, tree=tmp_path / "own.xml")
    text = (tmp_path / "m" / "tree.xml").read_text()
    root = ElementTree.fromstring(text)
    if tree is SELECTING:
        assert "<!-- ours -->" in text
        assert root.find(".//PlannerSelector").get("default_planner") == "Localizability"
        assert root.find(".//ComputePathToPose").get("planner_id") == "{selected_planner}"
    else:
        ids = [node.get("planner_id") for node in root.iter() if "Compute" in node.tag]
        assert ids == ["Localizability", "Localizability"]
    own = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())
    navigator = own["bt_navigator"]["ros__parameters"]
    assert navigator["default_nav_to_pose_bt_xml"] == str(tmp_path / "m" / "tree.xml")
    assert ("default_nav_through_poses_bt_xml" in navigator) == (tree is NAMING)
    smoothed = [node.get("smoothed_path") for node in root.iter("SmoothPath")]
    assert set(smoothed) == ({"{path}"} if planner == "thetastar" else set())
    assert ("smoother_server" in own) == (planner == "thetastar")
    assert "topic pub" not in (tmp_path / "m" / "README.md").read_text()
    # The tree of an export is one's own, too.
    (tmp_path / "own.xml").write_text(text)
    export_keepout(tmp_path, costs, planner=planner, tree=tmp_path / "own.xml")
    assert (tmp_path / "m" / "tree.xml").read_text() == text


def test_behavior_tree_replaces_unselected_planner(tmp_path, costs):
    """Without a PlannerSelector, nothing sets the planner's name on the tree's blackboard."""
    (tmp_path / "own.xml").write_text(NAMING.replace("GridBased", "{planner_id}"))
    export_keepout(tmp_path, costs, planner="smac2d", tree=tmp_path / "own.xml")
    assert "{planner_id}" not in (tmp_path / "m" / "tree.xml").read_text()


def test_behavior_tree_accepts_single_quotes(tmp_path, costs):
    for tree in (SELECTING, NAMING):
        (tmp_path / "own.xml").write_text(tree.replace('"', "'"))
        export_keepout(tmp_path, costs, planner="thetastar", tree=tmp_path / "own.xml")
        text = (tmp_path / "m" / "tree.xml").read_text()
        assert "GridBased" not in text
        assert 'smoothed_path="{path}"' in text
        ElementTree.fromstring(text)


@pytest.mark.parametrize(
    ("own", "names"),
    [
        ("{smoother_plugins: [sg], sg: {plugin: mine}}", ["sg", "simple_smoother"]),
        ("{smoother_plugins: [simple_smoother], simple_smoother: {}}", ["simple_smoother"]),
        ("{simple_smoother: {max_its: 5}}", None),  # Nav2's default is this name
    ],
)
def test_parameters_include_smoother_of_tree(tmp_path, costs, own, names):
    (tmp_path / "own.xml").write_text(NAMING)
    params = f"{PARAMS}smoother_server: {{ros__parameters: {own}}}\n"
    export_keepout(tmp_path, costs, params, planner="thetastar", tree=tmp_path / "own.xml")
    merged = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())
    server = merged["smoother_server"]["ros__parameters"]
    assert server.get("smoother_plugins") == names
    if names and "sg" in names:
        assert server["sg"] == {"plugin": "mine"}
        assert server["simple_smoother"]["plugin"] == "nav2_smoother::SimpleSmoother"
    else:
        assert "plugin" not in server["simple_smoother"]


@pytest.mark.parametrize("namespace", ["", "/r1"])
def test_topics_use_robot_namespace(tmp_path, costs, namespace):
    """Nav2's topics are relative, so a namespace prefixes their names."""
    params = PARAMS
    if namespace:
        params = f"r1:\n  {params.strip().replace(chr(10), chr(10) + '  ')}\n"
    export_keepout(tmp_path, costs, params)
    text = (tmp_path / "m" / "README.md").read_text()
    assert f"reliable {namespace}/planner_selector std_msgs" in text
    nav2_speed(tmp_path / "speed", costs, params=tmp_path / "own.yaml", lead=0.4)
    text = (tmp_path / "speed" / "README.md").read_text()
    assert f"limits from {namespace}/speed_limit." in text
    assert "begins 0.4 m before" in text
    merged = yaml.safe_load((tmp_path / "speed" / "nav2.yaml").read_text())
    costmap = (merged["r1"] if namespace else merged)["global_costmap"]["global_costmap"]
    own = costmap["ros__parameters"]["localizability_speed_filter"]
    assert own["speed_limit_topic"] == f"{namespace}/speed_limit"
    path = plan(costs, (2, 3), (38, 3)).path
    nav2_routes(tmp_path / "graph", costs, {"there": path}, params=tmp_path / "own.yaml")
    text = (tmp_path / "graph" / "README.md").read_text()
    assert f"send_goal {namespace}/compute_route" in text


@pytest.mark.parametrize("xy", [[(2, 3), (22.8, 12.1)], [(2, 3), (60, 3)], [(2, 3), (2, 3)]])
def test_keepout_export_rejects_invalid_paths(tmp_path, costs, xy):
    with pytest.raises(ConfigError, match="mine has no length, or leaves the map's free space"):
        nav2_keepout(tmp_path / "m", costs, paths={"mine": Path(np.array(xy, float))})
    assert not (tmp_path / "m").exists()


def test_export_rejects_tree_without_planning(tmp_path, costs):
    (tmp_path / "own.xml").write_text("<root/>")
    with pytest.raises(LocplanError, match=r"own\.xml: has no ComputePathToPose"):
        nav2_keepout(tmp_path / "m", costs, tree=tmp_path / "own.xml")
    assert not (tmp_path / "m").exists()


def test_export_reports_planner_path(tmp_path, costs):
    aware = plan(costs, (2, 3), (38, 3)).path
    found = export_keepout(tmp_path, costs, paths={"aware": aware})
    (smac,) = found.paths
    assert (smac.planner, smac.name) == ("smac2d", "aware")
    assert smac.is_equivalent
    assert smac.ratio < 1.12
    assert 0.25 < smac.least_clearance <= smac.clearance
    text = (tmp_path / "m" / "README.md").read_text()
    assert f"Path of smac2d (aware): {smac.verdict_text}" in text
    about = json.loads((tmp_path / "m" / "export.json").read_text())
    assert about["conversion"]["paths"][0]["ratio"] == smac.ratio


DECLARED = {
    "allow_unknown": bool,
    "cost_penalty": float,
    "cost_travel_multiplier": float,
    "max_iterations": int,
    "max_planning_time": float,
    "plugin": str,
    "retrospective_penalty": float,
    "use_quadratic_cost_penalty": bool,
    "w_euc_cost": float,
    "w_traversal_cost": float,
}
"""Parameters of Smac and Theta* with the types that Nav2 declares, in humble, jazzy and kilted;
humble has no use_quadratic_cost_penalty."""


@pytest.mark.parametrize("distro", sample_cases(["jazzy", "humble"]))
@pytest.mark.parametrize("planner", ["smac2d", "smac-hybrid", "thetastar"])
def test_parameter_types_match_nav2(tmp_path, costs, planner, distro):
    """A Nav2 node exits at startup if a parameter has another type than declared."""
    slashes = PARAMS.replace("planner::Nav", "planner/Nav") if distro == "humble" else PARAMS
    export_keepout(tmp_path, costs, slashes, planner=planner, distro=distro)
    own = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())
    ours = own["planner_server"]["ros__parameters"]["Localizability"]
    declared = {**DECLARED}
    if distro == "humble":
        del declared["use_quadratic_cost_penalty"]
    assert {name: type(value) for name, value in ours.items()} == {
        name: declared[name] for name in ours
    }
    layer = own["global_costmap"]["global_costmap"]["ros__parameters"]["inflation_layer"]
    assert type(layer["cost_scaling_factor"]) is float


FLOW = """\
amcl: {ros__parameters: {alpha1: 0.2, robot_model_type: "nav2_amcl::DifferentialMotionModel"}}
planner_server: {ros__parameters: {planner_plugins: [GridBased],
  GridBased: {plugin: "nav2_navfn_planner::NavfnPlanner"}}}
global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.22}}}
local_costmap: {local_costmap: {ros__parameters: {robot_radius: 0.22}}}
"""


@pytest.mark.parametrize("params", ["", FLOW, FLOW.replace("amcl: {ros", "amcl: &all {ros")])
def test_written_plugin_names_are_quoted(tmp_path, costs, params):
    """A plain :: between braces ends every node that reads it with libyaml below 0.2.2."""
    (tmp_path / "own.yaml").write_text(params)
    file = tmp_path / "own.yaml" if params else None
    there = {"there": plan(costs, (2, 3), (38, 3)).path}
    (tmp_path / "own.xml").write_text(NAMING)
    settings = {"params": file, "planner": "thetastar", "tree": tmp_path / "own.xml"}
    with warnings.catch_warnings(record=True, action="always"):
        nav2_keepout(tmp_path / "keepout", costs, **settings, paths=there)
        nav2_speed(tmp_path / "speed", costs, params=file)
        nav2_routes(tmp_path / "routes", costs, there, params=file)
    write_filter_map(tmp_path, costs.grid)
    write_tuned_parameters(tmp_path / "tuned.yaml", Amcl(alpha1=0.05), file)
    if file:
        omni = {"robot_model_type": "nav2_amcl::OmniMotionModel", "other": "a::b"}
        (tmp_path / "edited.yaml").write_bytes(edit_parameters(file, "amcl", omni))
    written = [path for path in tmp_path.rglob("*.yaml") if path != file]
    assert len(written) >= 6
    for path in written:
        for token in yaml.scan(path.read_text()):
            if isinstance(token, yaml.ScalarToken) and "::" in token.value:
                assert not token.plain, (path, token.value)


@pytest.mark.parametrize("order", [1, -1])
def test_export_edits_file_that_has_node(tmp_path, costs, order):
    """Of several files the planner's becomes nav2.yaml, whose mask carries its inflation."""
    (tmp_path / "loc.yaml").write_text("amcl: {ros__parameters: {alpha1: 0.1}}\n")
    smac = '"nav2_smac_planner::SmacPlanner2D"\n      cost_travel_multiplier: 2.0'
    text = PARAMS.replace('"nav2_navfn_planner::NavfnPlanner"', smac)
    (tmp_path / "nav.yaml").write_text(text)
    files = [tmp_path / "loc.yaml", tmp_path / "nav.yaml"][::order]
    with pytest.warns(ParametersChanged, match="changes values of nav.yaml: planner_server"):
        nav2_keepout(tmp_path / "both", costs, params=files)
    with pytest.warns(ParametersChanged):
        nav2_keepout(tmp_path / "one", costs, params=tmp_path / "nav.yaml")
    for name in ("mask.pgm", "nav2.yaml"):
        both, one = ((tmp_path / folder / name).read_bytes() for folder in ("both", "one"))
        assert both == one, name
    merged = yaml.safe_load((tmp_path / "both" / "merged.yaml").read_text())
    nav2 = yaml.safe_load((tmp_path / "both" / "nav2.yaml").read_text())
    assert merged == nav2 | {"amcl": {"ros__parameters": {"alpha1": 0.1}}}
    readme = (tmp_path / "both" / "README.md").read_text()
    assert "params_file:=$PWD/merged.yaml" in readme
    assert "merged.yaml: nav.yaml and loc.yaml merged with the export's parameters" in readme
    assert not (tmp_path / "one" / "merged.yaml").exists()


def test_export_merges_files_if_several_change(tmp_path, costs):
    """One file has the costmap, another the planner."""
    costmap, planner = PARAMS.split("planner_server:")
    (tmp_path / "costmap.yaml").write_text(costmap)
    (tmp_path / "planner.yaml").write_text(f"planner_server:{planner}")
    files = [tmp_path / "costmap.yaml", tmp_path / "planner.yaml"]
    with pytest.warns(RobotWarning):
        nav2_keepout(tmp_path / "both", costs, params=files)
    (tmp_path / "own.yaml").write_text(PARAMS)
    with pytest.warns(RobotWarning):
        nav2_keepout(tmp_path / "one", costs, params=tmp_path / "own.yaml")
    both, one = (yaml.safe_load((tmp_path / n / "nav2.yaml").read_text()) for n in ("both", "one"))
    assert both == one

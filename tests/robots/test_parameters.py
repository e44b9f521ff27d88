"""Several parameter files of Nav2, merged as ROS does, by an independent merger of the tests."""

import re
import warnings

import numpy as np
import pytest
import yaml

from locplan.errors import ConfigError, LocplanError
from locplan.robots import Amcl, Kinematics, Robot, read_parameters
from locplan.robots.nav2 import read_amcl, read_planner_types
from locplan.robots.parameter_edits import edit_files
from locplan.robots.parts import Inflation

pytestmark = pytest.mark.usefixtures("undrawn")

COSTMAP = "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.3, %s}}}\n"
PLANNERS = "planner_server: {ros__parameters: {%s}}\n"
OMNI = "amcl: {ros__parameters: {robot_model_type: 'nav2_amcl::OmniMotionModel'}}\n"
HYBRID = "{plugin: 'nav2_smac_planner%sSmacPlannerHybrid', minimum_turning_radius: 0.9}"


WALLS = "{plugin: 'nav2_costmap_2d::StaticLayer'}"
BLOW = "{plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: %s}"


def written(folder, *texts):
    files = [folder / f"{at}.yaml" for at in range(len(texts))]
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    return files


def load(*files, **settings):
    """The robot of the files, and what was warned of."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        robot = Robot.load(*files, **settings)
    return robot, [str(each.message) for each in caught]


def merged(texts, node):
    """A node's parameters by rcl's rules: one list of names, later values replace earlier ones."""
    names = {}

    def walk(content, keys):
        for key, value in content.items():
            if key == "ros__parameters":
                flatten(value, "", names.setdefault("/".join(keys), {}))
            elif isinstance(value, dict):
                walk(value, (*keys, key))

    def flatten(values, above, into):
        for key, value in values.items():
            if isinstance(value, dict):
                flatten(value, f"{above}{key}.", into)
            else:
                into[f"{above}{key}"] = value

    for text in texts:
        walk(yaml.safe_load(text), ())
    found = {}
    for name, values in names.items():
        pattern = re.sub(r"/\*\*?", lambda m: r"(/\w+)*" if m[0] == "/**" else r"/\w+", name)
        if re.fullmatch(pattern if name.startswith("/") else f"/{pattern}", f"/{node}"):
            found |= values
    return found


def test_values_equal_independent_merger(tmp_path):
    """Random overlays of wildcards and names, up to four files."""
    random = np.random.default_rng(5)
    names = ["/**", "amcl", "/amcl", "/*", "/**/amcl", "planner_server"]
    for _ in range(60):
        texts = []
        for _ in range(random.integers(1, 5)):
            chosen = random.permutation(names)[: random.integers(1, 4)]
            entry = {
                str(name): {
                    "ros__parameters": {
                        f"alpha{n}": round(float(random.uniform(0, 1)), 3)
                        for n in random.permutation(5)[:3] + 1
                    }
                }
                for name in chosen
            }
            texts.append(yaml.safe_dump(entry, sort_keys=False))
        files = written(tmp_path, *texts)
        expected = merged(texts, "amcl")
        parameters = read_parameters(*files)
        assert parameters.read_node_parameters("amcl") == expected
        assert parameters.merge_files().read_node_parameters("amcl") == expected
        if expected:
            robot, _ = load(*files)
            assert {name: getattr(robot.filter, name) for name in expected} == expected


@pytest.mark.parametrize(
    ("texts", "value", "component"),
    [
        (("/**: .1, amcl: .2", "/**: .3"), 0.2, 0.3),
        (("amcl: .2, /**: .3", "amcl: .4"), 0.3, 0.4),
        (("amcl: .2", "/**: .3"), 0.3, 0.3),
    ],
)
def test_wildcard_conflict_across_files_is_reported(tmp_path, texts, value, component):
    full = [re.sub(r": (\.\d)", r": {ros__parameters: {alpha1: 0\1}}", text) for text in texts]
    files = written(tmp_path, *(f"{{{text}}}\n" for text in full))
    robot, notes = load(*files)
    assert robot.filter.alpha1 == value
    parameters = read_parameters(*files)
    assert parameters.read_node_parameters("amcl", component=True)["alpha1"] == component
    (note,) = notes
    assert note.startswith("amcl: alpha1 is ")
    assert f"ROS takes {value}" in note


def test_usual_overlay_is_no_conflict(tmp_path):
    shared, named = (
        f"{name}: {{ros__parameters: {{alpha1: {value}}}}}\n"
        for name, value in (("/**", 0.1), ("amcl", 0.2))
    )
    assert load(*written(tmp_path, shared, named)) == (Robot(filter=Amcl(alpha1=0.2)), [])


def test_overlay_of_frames_keeps_amcl(tmp_path):
    base = "amcl: {ros__parameters: {alpha1: 0.05, max_particles: 3000}}\n"
    frames = "amcl: {ros__parameters: {base_frame_id: a/base}}\n"
    robot, notes = load(*written(tmp_path, base, frames))
    assert (robot.filter, notes) == (Amcl(alpha1=0.05, max_particles=3000), [])


def test_change_edits_file_that_has_node(tmp_path):
    base = "# mine\namcl: {ros__parameters: {alpha1: 0.05, alpha2: 0.1}}\n"
    other = COSTMAP % "inflation_layer: {inflation_radius: 0.8}"
    files = written(tmp_path, other, base, "amcl: {ros__parameters: {alpha2: 0.3}}\n")
    parameters = read_parameters(*files)
    assert parameters.find_file_index("amcl") == 1
    after = parameters.with_values("amcl", {"alpha1": 0.2, "alpha3": 0.4})
    edited = edit_files(parameters, after)
    assert edited == {files[1]: base.replace("{alpha1: 0.05", "{alpha3: 0.4, alpha1: 0.2").encode()}
    overlaid = edit_files(parameters, parameters.with_values("amcl", {"alpha2": 0.2}))
    assert list(overlaid) == [files[2]]


def test_files_of_different_robots_are_refused(tmp_path):
    one, other = (f"{name}/amcl: {{ros__parameters: {{alpha1: 0.1}}}}\n" for name in ("a", "b"))
    with pytest.raises(LocplanError, match=r"different robots: .*'/a', .*'/b'; name the robot"):
        read_parameters(*written(tmp_path, one, other))


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ("", Inflation()),
        (
            "plugins: [static_layer, obstacle_layer, inflation_layer],"
            " inflation_layer: {inflation_radius: 0.8, cost_scaling_factor: 2.0}",
            Inflation(inflation_radius=0.8, cost_scaling_factor=2.0),
        ),
        ("inflation_layer: {enabled: false}", None),
        (
            f"plugins: [first, walls, blow], first: {BLOW % 0.4}, walls: {WALLS},"
            f" blow: {BLOW % 0.9}",
            Inflation(inflation_radius=0.9),
        ),
        (
            "plugins: [one, two], one: {plugin: 'nav2_costmap_2d::PluginContainerLayer',"
            f" plugins: [blow], blow: {BLOW % 0.4}}}, two: {{plugins: [walls, blow],"
            " plugin: 'nav2_costmap_2d::PluginContainerLayer',"
            f" walls: {WALLS}, blow: {BLOW % 0.9}}}",
            Inflation(inflation_radius=0.9),
        ),
        (
            "plugins: [box], box: {plugins: [s, i],"
            " plugin: 'nav2_costmap_2d::PluginContainerLayer',"
            " s: {plugin: 'nav2_costmap_2d::StaticLayer'},"
            " i: {plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: 0.6}}",
            Inflation(inflation_radius=0.6),
        ),
    ],
)
def test_nav2_default_layers_count(tmp_path, settings, expected):
    assert load(*written(tmp_path, COSTMAP % settings))[0].inflation == expected


def test_list_without_types_is_reported(tmp_path):
    (file,) = written(tmp_path, COSTMAP % "plugins: [inflation_layer, static_layer]")
    robot, notes = load(file)
    assert robot.inflation is None
    assert notes[0].startswith("Nav2 refuses the plugins of global_costmap")


def test_inflation_before_walls_is_reported(tmp_path):
    """Layers update the costs in the order of the list."""
    (file,) = written(
        tmp_path, COSTMAP % f"plugins: [blow, walls], walls: {WALLS}, blow: {BLOW % 0.4}"
    )
    robot, notes = load(file)
    assert robot.inflation is None
    assert notes[0].startswith("blow stands before the StaticLayer in plugins")


def test_container_without_map_inflates_no_walls(tmp_path):
    layer = "i: {plugin: 'nav2_costmap_2d::InflationLayer'}"
    inner = f"{{plugin: 'nav2_costmap_2d::PluginContainerLayer', plugins: [i], {layer}}}"
    static = "plugins: [s, box], s: {plugin: 'nav2_costmap_2d::StaticLayer'}"
    robot, notes = load(*written(tmp_path, COSTMAP % f"{static}, box: {inner}"))
    assert robot.inflation is None
    assert "box.i inflates only the layers before it in box" in notes[0]


@pytest.mark.parametrize("slash", ["::", "/"])
def test_kinematics_follow_planner_in_use(tmp_path, slash):
    car = Kinematics(drive="car-like", turning_radius=0.9, reverse=False)
    hybrid = HYBRID % slash
    (file,) = written(tmp_path, PLANNERS % f"planner_plugins: [Mine], Mine: {hybrid}")
    assert load(file) == (Robot(kinematics=car), [])
    several = f"planner_plugins: [Mine, GridBased], GridBased: {{plugin: a}}, Mine: {hybrid}"
    (file,) = written(tmp_path, PLANNERS % several)
    robot, notes = load(file)
    assert robot.kinematics == Kinematics()
    assert "Mine is car-like with a turning radius of 0.9 m, forwards only" in notes[0]
    assert load(file, planner="Mine") == (Robot(kinematics=car), [])
    with pytest.raises(ConfigError, match="no planner 'Other'; its planners are Mine, GridBased"):
        Robot.load(file, planner="Other")


def test_planner_named_by_default_counts(tmp_path):
    """Nav2's default list is GridBased, which then needs no type either."""
    (file,) = written(tmp_path, PLANNERS % f"GridBased: {HYBRID % '::'}")
    assert load(file)[0].kinematics.turning_radius == 0.9
    (file,) = written(
        tmp_path, PLANNERS % "planner_plugins: [GridBased], GridBased: {tolerance: 1}"
    )
    assert read_planner_types(read_parameters(file)) == {
        "GridBased": "nav2_navfn_planner::NavfnPlanner"
    }
    assert load(file)[1] == []
    (file,) = written(tmp_path, PLANNERS % "planner_plugins: [GridBased, A], A: {plugin: a}")
    assert "since GridBased has no plugin type" in load(file)[1][0]


def test_planner_without_motion_model_leaves_amcls(tmp_path):
    plugin = "{plugin: 'nav2_smac_planner::SmacPlanner2D', motion_model_for_search: DUBIN}"
    (file,) = written(tmp_path, OMNI + PLANNERS % f"planner_plugins: [A], A: {plugin}")
    assert load(file)[0].kinematics == Kinematics(drive="omnidirectional")


@pytest.mark.parametrize(
    ("path", "drive"),
    [
        ("lattice.json", "omnidirectional"),
        ("/x/0.5m_turning_radius/ackermann/output.json", "car-like"),
    ],
)
def test_lattice_file_has_motion_model(tmp_path, path, drive):
    (tmp_path / "lattice.json").write_text(
        '{"lattice_metadata": {"motion_model": "omni", "turning_radius": 0.4}}'
    )
    plugin = f"{{plugin: 'nav2_smac_planner/SmacPlannerLattice', lattice_filepath: {path}}}"
    (file,) = written(tmp_path, PLANNERS % f"planner_plugins: [A], A: {plugin}")
    assert load(file)[0].kinematics.drive == drive


@pytest.mark.parametrize(
    ("model", "said"), [("beam", "beam model is not simulated"), ("x", "no laser_model_type 'x'")]
)
def test_unsupported_laser_model_becomes_likelihood_field(tmp_path, model, said):
    (file,) = written(tmp_path, f"amcl: {{ros__parameters: {{laser_model_type: {model}}}}}\n")
    robot, (note,) = load(file)
    assert robot.filter == Amcl()
    assert said in note
    assert "likelihood_field" in note
    with pytest.warns(match=said):
        assert read_amcl(file) == Amcl()


@pytest.mark.parametrize(
    ("enabled", "start"),
    [
        ("true", "global_costmap: k keeps"),
        ("KEEPOUT_ZONE_ENABLED", "If your launch enables it"),
        ("false", ""),
    ],
)
def test_zones_of_filters_are_reported(tmp_path, enabled, start):
    plugin = f"filters: [k], k: {{plugin: 'nav2_costmap_2d::KeepoutFilter', enabled: {enabled}}}"
    _, notes = load(*written(tmp_path, COSTMAP % plugin))
    assert len(notes) == bool(start)
    assert all(note.startswith(start) for note in notes)
    assert all("give its mask to `plan` with --zones" in note for note in notes)


@pytest.mark.parametrize(
    "text",
    [
        "amcl: {odom_alpha1: 0.2}\n",
        "TrajectoryPlannerROS: {max_vel_x: 0.4}\n",
        "obstacle_range: 2.5\n",
        "global_costmap: {robot_radius: 0.3}\n",
    ],
)
def test_ros1_file_is_named(tmp_path, text):
    with pytest.raises(LocplanError, match=r"ROS 1.*give Nav2's parameters of ROS 2"):
        Robot.load(*written(tmp_path, text))

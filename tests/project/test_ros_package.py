"""The ROS 2 package under examples/, without ROS: its pure parts, its files, and stand-ins."""

import ast
import importlib
import math
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import yaml
from rosbags.typesys import Stores, get_typestore

import locplan
from locplan.export import nav2_keepout, nav2_speed, plain_files
from locplan.field import FieldConfig, Sad, Scan, load_or_compute
from locplan.maps import OccupancyGrid, load_map
from locplan.robots import Lidar

ROOT = Path(__file__).resolve().parents[2]
LAUNCH = "localizability.launch.xml"
PACKAGE = ROOT / "examples" / "ros2" / "locplan_ros"
DECLARED = {
    "map_server": {"yaml_filename", "topic_name", "frame_id"},
    "costmap_filter_info_server": {
        *("type", "filter_info_topic", "mask_topic", "base", "multiplier"),
    },
    "lifecycle_manager": {"autostart", "node_names"},
}
"""Parameters that Nav2 declares in all of humble, jazzy, kilted, lyrical and main, by executable:
nav2_map_server/src/map_server/map_server.cpp,
nav2_map_server/src/costmap_filter_info/costmap_filter_info_server.cpp and
nav2_lifecycle_manager/src/lifecycle_manager.cpp."""
RVIZ_CLASSES = {
    *("Map", "MarkerArray", "Marker", "Path", "PoseWithCovariance", "TF", "TopDownOrtho"),
    *("MoveCamera", "Select", "Measure", "SetInitialPose", "SetGoal"),
}
"""Classes of ros2/rviz: rviz_default_plugins/plugins_description.xml, humble to rolling."""
LATCHED = {
    *("/map", "/global_costmap/costmap", "/amcl_pose"),
    *(f"/localizability_{kind}_mask" for kind in ("keepout", "speed")),
    *("/localizability_watch/ellipses", "/localizability_watch/warning"),
}
"""Topics whose publishers are transient local: Nav2's map_server, amcl and costmaps, and ours."""
DISTROS = [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL]


@pytest.fixture(autouse=True)
def modules(monkeypatch):
    """The package can be imported, and is forgotten after the test."""
    monkeypatch.syspath_prepend(str(PACKAGE))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "locplan_ros"]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def corridors():
    return load_or_compute(load_map(ROOT / "maps" / "two_corridors.yaml"), Scan(Lidar(range=6.0)))


@pytest.fixture(scope="module")
def corridors_npz(corridors, tmp_path_factory):
    file = tmp_path_factory.mktemp("ros") / "field.npz"
    plain_files.write_field_file(file, corridors)
    return str(file)


def part(name):
    return importlib.import_module(f"locplan_ros.{name}")


def events(watch, poses):
    return [(x, reading.event) for x, y in poses if (reading := watch.update(x, y)).event]


# The watch


def test_watch_enters_and_leaves_corridor_once(corridors_npz):
    field = part("field_file").FieldFile.load(corridors_npz)
    watch = part("watch").Watch(field)
    along = [(float(x), 3.0) for x in np.arange(2.0, 38.0, 0.05)]
    (start, entered), (end, left) = events(watch, along)
    assert entered.state == "degenerate"
    assert entered.is_warning
    assert "cm along 0 deg" in entered.text  # the corridor runs along x
    assert 6.0 < start < 10.0
    assert left.state == "clear"
    assert not left.is_warning
    assert 30.0 < end < 35.0
    assert float(left.text.split()[-2]) == pytest.approx(end - start, abs=0.1)


class Given:
    """A field of values of u by position; the deviation is 1 m along the diagonal."""

    def __init__(self, u):
        self.u = u

    def at(self, x, y, heading=None):
        return self.u(x), np.array([[0.5, 0.49, 0.0], [0.49, 0.5, 0.0], [0.0, 0.0, 0.01]])


def test_watch_reports_pose_off_field(corridors_npz):
    field = part("field_file").FieldFile.load(corridors_npz)
    watch = part("watch").Watch(field, part("watch").Limits(patience=1))
    ((_, event),) = events(watch, [(2.0, 3.0), (-50.0, 3.0), (2000.0, 3.0), (math.nan, 0.0)])
    assert event.state == "off the field"
    assert event.text.startswith("left the field at (-50.00, 3.00)")
    ((_, back),) = events(watch, [(2.0, 3.0)])
    assert back.text == "back on the field at (2.00, 3.00)"


# The field


def agrees(file, field, *headings):
    read = part("field_file").FieldFile.load(str(file))
    u = locplan.Costmap.from_field(field).u
    rows, cols = np.nonzero(field.grid.free)
    rng = np.random.default_rng(0)
    for n in rng.integers(len(rows), size=40):
        row, col = rows[n] + rng.uniform(0.01, 0.99), cols[n] + rng.uniform(0.01, 0.99)
        x, y = (float(v) for v in field.grid.grid_to_world(row, col))
        for heading in (None, *headings):
            pose = (x, y) if heading is None else (x, y, heading)
            expected = field.at(pose, "covariance")
            degeneracy, covariance = read.at(x, y, heading)
            assert degeneracy == u[rows[n], cols[n]]
            np.testing.assert_allclose(covariance, expected, atol=1e-12)
    positions = read.positions(1.0)
    assert len(positions)
    assert np.isfinite(field.at(positions, "covariance")).all()


def test_field_file_values_equal_library(corridors, corridors_npz):
    agrees(corridors_npz, corridors)


def turned_room(yaw):
    cells = np.full((30, 60), 254, np.uint8)
    cells[[0, -1]] = 0
    cells[:, 0] = 0
    return OccupancyGrid(cells, 0.1, (3.0, -2.0, yaw))


def test_turned_field_file_gives_world_values(tmp_path):
    lidar = Lidar(range=2.0, field_of_view_deg=180.0)
    config = FieldConfig(Scan(lidar), stride=0.2, headings=4)
    field = locplan.covariance_field(turned_room(0.7), config)
    file = tmp_path / "field.npz"
    plain_files.write_field_file(file, field)
    agrees(file, field, 0.3, -2.0)


def test_ellipse_turns_with_map(tmp_path):
    """Along a wall the position is free; with the map's yaw the wall turns."""
    axes = []
    for yaw in (0.0, 0.7):
        field = locplan.covariance_field(turned_room(yaw), Sad(range=1.0))
        plain_files.write_field_file(tmp_path / "f.npz", field)
        read = part("field_file").FieldFile.load(str(tmp_path / "f.npz"))
        x, y = field.grid.position(6, 35)
        axes.append(part("watch").compute_ellipse(read.at(x, y)[1])[2])
    assert axes[0] == pytest.approx(0.0, abs=0.1)
    assert axes[1] - axes[0] == pytest.approx(0.7, abs=1e-6)


# The messages


def readings():
    """One reading of each state."""
    watch = part("watch").Watch(
        Given(lambda x: math.nan if x < 0 else x), part("watch").Limits(patience=1)
    )
    return [watch.update(x, 2.0, 0.5) for x in (0.1, 0.9, -1.0)]


STAMP = {"sec": 1, "nanosec": 2}


def contents(field):
    """Each message's type and content."""
    messages = part("messages")
    yield (
        "visualization_msgs/msg/MarkerArray",
        messages.make_ellipses(STAMP, "map", field, 2.0, 1.0),
    )
    for reading in readings():
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        yield kind, messages.make_pose_with_covariance(STAMP, "map", reading)
        yield "diagnostic_msgs/msg/DiagnosticArray", messages.make_diagnostics(STAMP, reading)
        yield "visualization_msgs/msg/Marker", messages.make_warning(STAMP, "map", reading)


def check_fields(definitions, kind, content):
    """Each name is a field of its message, and each value of the field's sort."""
    fields = dict(definitions[kind][1])
    for name, value in content.items():
        node, of = fields[name]
        if node.name == "NAME":
            check_fields(definitions, of, value)
        elif node.name == "BASE":
            sorts = {"string": str, "octet": bytes, "byte": bytes}
            sort = sorts.get(of[0], float if "float" in of[0] else int)
            assert isinstance(value, sort), (kind, name, value)
            assert sort is not bytes or len(value) == 1
        else:
            (element, element_of), size = of
            assert isinstance(value, list)
            assert node.name == "SEQUENCE" or len(value) == size
            if element.name == "NAME":
                for each in value:
                    check_fields(definitions, element_of, each)


@pytest.mark.parametrize("distro", DISTROS, ids=lambda store: store.value)
def test_messages_fit_all_ros_distributions(corridors_npz, distro):
    definitions = get_typestore(distro).fielddefs
    for kind, content in contents(part("field_file").FieldFile.load(corridors_npz)):
        check_fields(definitions, kind, content)
    constants = {
        name: value
        for kind in ("visualization_msgs/msg/Marker", "diagnostic_msgs/msg/DiagnosticStatus")
        for name, _, value in definitions[kind][0]
    }
    messages = part("messages")
    assert (
        constants["CYLINDER"],
        constants["TEXT_VIEW_FACING"],
    ) == (messages.CYLINDER, messages.TEXT)
    assert (constants["ADD"], constants["DELETE"]) == (messages.ADD, messages.DELETE)
    assert (messages.OK[0], messages.WARN[0]) == (constants["OK"], constants["WARN"])


# The package's files


@pytest.fixture
def setup_arguments(monkeypatch):
    """What setup.py hands to setuptools."""
    given = {}
    setuptools = ModuleType("setuptools")
    setuptools.setup = lambda **arguments: given.update(arguments)
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    monkeypatch.chdir(PACKAGE)
    runpy.run_path("setup.py")
    return given


def test_setup_and_package_xml_agree(setup_arguments):
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert package.get("format") == "3"
    text = {child.tag: child.text for child in package}
    for tag, key in (("name", "name"), ("version", "version"), ("license", "license")):
        assert text[tag] == setup_arguments[key]
    assert text["description"] == setup_arguments["description"]
    assert text["version"] == locplan.__version__.partition(".dev")[0]
    assert package.findtext("export/build_type") == "ament_python"
    depends = [child.text for child in package.findall("exec_depend")]
    assert len(depends) == len(set(depends))
    test_depends = [child.text for child in package.findall("test_depend")]
    files = {file: "test" in file.parts[-2:] for file in PACKAGE.rglob("*.py")}
    named = {"tf2_ros": "tf2_ros_py", "numpy": "python3-numpy", "pytest": "python3-pytest"}
    own = {"locplan_ros", "setuptools", *sys.stdlib_module_names}
    for is_test, allowed in ((False, depends), (True, depends + test_depends)):
        imported = {
            name.partition(".")[0]
            for file in files
            if files[file] == is_test
            for name in imports_of(file)
        }
        assert {named.get(name, name) for name in imported - own} <= set(allowed)
    assert {"ament_copyright", "ament_flake8", "ament_pep257"} < set(test_depends)
    (maintainer,) = package.findall("maintainer")
    assert maintainer.text == setup_arguments["maintainer"]
    assert maintainer.get("email") == setup_arguments["maintainer_email"]
    assert (PACKAGE / package.find("license").get("file")).read_bytes() == (
        ROOT / "LICENSE"
    ).read_bytes()
    setup_cfg = (PACKAGE / "setup.cfg").read_text()
    assert setup_cfg.count(f"$base/lib/{text['name']}") == 2


def imports_of(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def test_setup_installs_all_package_files(setup_arguments):
    installed = {file for _, files in setup_arguments["data_files"] for file in files}
    assert all((PACKAGE / file).is_file() for file in installed)
    there = {
        str(file.relative_to(PACKAGE))
        for folder in ("launch", "config", "rviz", "resource")
        for file in (PACKAGE / folder).iterdir()
        if file.is_file()
    }
    assert installed == there | {"package.xml"}
    assert setup_arguments["packages"] == ["locplan_ros"]
    (script,) = setup_arguments["entry_points"]["console_scripts"]
    _, target = script.split(" = ")
    module, function = target.split(":")
    tree = ast.parse((PACKAGE / f"{module.replace('.', '/')}.py").read_text())
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_package_supports_python_3_10():
    """Humble has Python 3.10."""
    for file in PACKAGE.rglob("*.py"):
        ast.parse(file.read_text(), feature_version=(3, 10))
        later = {"tomllib", "StrEnum", "Self", "assert_never", "ExceptionGroup"}
        assert not later & {*imports_of(file), *file.read_text().split()}


def test_changelog_has_form_of_catkin_pkg():
    """Bloom reads the sections: a title, an underline as long, and bullet points."""
    lines = (PACKAGE / "CHANGELOG.rst").read_text().splitlines()
    assert lines[1] == "Changelog for package locplan_ros"
    assert lines[0] == lines[2] == "^" * len(lines[1])
    underlines = [n for n, line in enumerate(lines) if line and set(line) == {"-"}]
    titles = [lines[n - 1] for n in underlines]
    assert titles
    for n, title in zip(underlines, titles, strict=True):
        assert len(lines[n]) == len(title)
        assert re.fullmatch(r"Forthcoming|\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", title)
    headings = {at for n in underlines for at in (n - 1, n)}
    texts = [line for n, line in enumerate(lines) if n > 2 and n not in headings and line]
    assert all(text.startswith(("* ", "  ")) for text in texts)


def test_tests_of_package_pass():
    """`colcon test` runs them; here the linters of ROS are missing."""
    options = ("-c", os.devnull, "--rootdir", ".", "-p", "no:cacheprovider", "-q")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "test"],
        cwd=PACKAGE,
        env={**os.environ, "PYTHONPATH": str(PACKAGE)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


# RViz


def all_of(node, key):
    """All values of a key, wherever it is."""
    if isinstance(node, dict):
        for name, value in node.items():
            if name == key:
                yield value
            yield from all_of(value, key)
    elif isinstance(node, list):
        for each in node:
            yield from all_of(each, key)


def test_rviz_classes_and_topics_are_valid():
    view = yaml.safe_load((PACKAGE / "rviz" / "localizability.rviz").read_text())
    manager = view["Visualization Manager"]
    classes = set(filter(None, all_of(manager, "Class")))
    assert {name.removeprefix("rviz_default_plugins/") for name in classes} <= RVIZ_CLASSES
    assert {panel["Class"] for panel in view["Panels"]} <= {
        "rviz_common/Displays",
        "rviz_common/Views",
    }
    topics = list(all_of(manager["Displays"], "Topic"))
    assert {topic["Value"] for topic in topics} > LATCHED | {"/localizability_watch/covariance"}
    for topic in topics:
        latched = topic["Durability Policy"] == "Transient Local"
        assert latched == (topic["Value"] in LATCHED), topic["Value"]
        assert topic["Reliability Policy"] == "Reliable"
    masks = [display for display in manager["Displays"] if "_mask" in str(display.get("Topic"))]
    assert [display["Color Scheme"] for display in masks] == ["costmap"] * 2


def test_rviz_view_shows_published_topics(tmp_path):
    costs = locplan.Costmap.from_density(turned_room(0.0), np.ones((30, 60)))
    nav2_keepout(tmp_path / "keepout", costs)
    servers = yaml.safe_load((tmp_path / "keepout" / "servers.yaml").read_text())
    view = (PACKAGE / "rviz" / "localizability.rviz").read_text()
    (topic,) = all_of(servers, "topic_name")
    assert f"Value: {topic}\n" in view
    node = (PACKAGE / "locplan_ros" / "watch_node.py").read_text()
    for name in ("covariance", "warning", "ellipses"):
        assert f"'~/{name}'" in node
        assert f"Value: /localizability_watch/{name}\n" in view


# The launch file


class Action(SimpleNamespace):
    """A stand-in of an action of launch: it keeps what it was given."""

    def __init__(self, kind, *given, **named):
        super().__init__(kind=kind, given=given, **named)


@pytest.fixture
def launched(monkeypatch):
    """A function from arguments to the actions that the launch file starts."""

    def kind(name):
        return lambda *given, **named: Action(name, *given, **named)

    class LaunchConfiguration:
        def __init__(self, name):
            self.name = name

        def perform(self, context):
            return context[self.name]

    stand_ins = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            name: kind(name)
            for name in ("DeclareLaunchArgument", "IncludeLaunchDescription", "OpaqueFunction")
        },
        "launch.launch_description_sources": {"AnyLaunchDescriptionSource": str},
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {name: kind(name) for name in ("Node",)},
    }
    for name, names in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, name, module)
    file = PACKAGE / "launch" / "localizability.launch.py"
    description = runpy.run_path(str(file))["generate_launch_description"]()
    *declared, opaque = description
    defaults = {action.given[0]: action.default_value for action in declared}

    def start(**given):
        assert set(given) <= set(defaults)
        return opaque.function({**defaults, **given})

    return start


@pytest.fixture
def folders(tmp_path):
    u = np.full((30, 60), 0.5)
    costs = locplan.Costmap.from_layers(turned_room(0.0), u=u)
    nav2_keepout(tmp_path / "mask", costs)
    nav2_speed(tmp_path / "speed", costs)
    (tmp_path / "field.npz").touch()
    (tmp_path / "map.yaml").touch()
    return tmp_path


def test_launch_file_includes_export_folders(launched, folders):
    exports = f"{folders / 'mask'}, {folders / 'speed'}, "
    included = launched(exports=exports, rviz="false")
    assert [action.given[0] for action in included] == [
        str(folders / name / LAUNCH) for name in ("mask", "speed")
    ]


def test_exported_parameters_are_declared_by_nav2(folders):
    launch = ElementTree.parse(folders / "mask" / LAUNCH).getroot()
    parameters = yaml.safe_load((folders / "mask" / "servers.yaml").read_text())
    executables = {node.get("name"): node.get("exec") for node in launch}
    assert set(executables.values()) == set(DECLARED)
    assert set(parameters) == set(executables)
    for name, executable in executables.items():
        assert set(parameters[name]["ros__parameters"]) <= DECLARED[executable]


def test_launch_file_starts_all_nodes(launched, folders):
    given = {"map": str(folders / "map.yaml"), "field": str(folders / "field.npz")}
    server, manager, watch, rviz = launched(**given, use_sim_time="true")
    assert (server.package, server.executable) == ("nav2_map_server", "map_server")
    assert (manager.package, manager.executable) == ("nav2_lifecycle_manager", "lifecycle_manager")
    for node in (server, manager):
        (parameters,) = node.parameters
        assert set(parameters) <= DECLARED[node.executable]
    assert server.parameters[0]["yaml_filename"] == given["map"]
    assert manager.parameters[0]["node_names"] == [server.name]
    assert (watch.package, watch.executable) == ("locplan_ros", "watch")
    file, own = watch.parameters
    assert own == {"field": given["field"], "use_sim_time": True}
    assert rviz.parameters == [{"use_sim_time": True}]
    assert set(yaml.safe_load(Path(file).read_text())) == {watch.name}
    assert (rviz.package, rviz.executable) == ("rviz2", "rviz2")
    assert Path(rviz.arguments[1]).is_file()


def test_by_default_only_rviz_is_started(launched):
    (rviz,) = launched()
    assert (rviz.executable, rviz.parameters) == ("rviz2", [{"use_sim_time": False}])


@pytest.mark.parametrize("name", ["exports", "map", "field"])
def test_launch_file_names_missing_folder(launched, tmp_path, name):
    with pytest.raises(FileNotFoundError, match=r"there is no .*gone"):
        launched(**{name: str(tmp_path / "gone")})


# The node


class WrongType(Exception):
    """A stand-in of rclpy.exceptions.ParameterException."""


class Parent:
    """A stand-in of rclpy.node.Node with the parameters that a test sets."""

    given: ClassVar = {}

    def __init__(self, name):
        self.name, self.log, self.sent = name, [], {}
        self.timers_made, self.topics = [], {}

    def declare_parameter(self, name, value):
        if type(self.given.get(name, value)) is not type(value):
            raise WrongType(f"{name} must be a {type(value).__name__}")
        return SimpleNamespace(value=self.given.get(name, value))

    def create_publisher(self, kind, topic, qos):
        return SimpleNamespace(
            publish=lambda message: self.sent.setdefault(topic, []).append(message)
        )

    def create_subscription(self, kind, topic, callback, depth):
        self.topics[topic] = callback

    def create_timer(self, period, callback):
        self.timers_made.append((period, callback))

    def get_logger(self):
        def log(level):
            return lambda text, **_: self.log.append((level, text))

        return SimpleNamespace(info=log("info"), warning=log("warning"))

    def get_clock(self):
        stamp = SimpleNamespace(sec=5, nanosec=0)
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: stamp))


class Transforms:
    """A stand-in of tf2_ros.Buffer: None where there is no transform."""

    x = None

    def lookup_transform(self, target, source, time):
        assert (target, source) == ("map", "base_link")
        if self.x is None:
            raise RuntimeError("no transform")
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        place = SimpleNamespace(x=self.x, y=3.0, z=0.0)
        stamp = SimpleNamespace(sec=7, nanosec=8)
        transform = SimpleNamespace(translation=place, rotation=turn)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp), transform=transform)


@pytest.fixture
def node_module(monkeypatch, corridors_npz):
    def kind(name):
        return type(name, (), {})

    calls = []
    stand_ins = {
        "rclpy": {
            "init": lambda: calls.append("init"),
            "spin": lambda node: calls.append("spin"),
            "try_shutdown": lambda: calls.append("shutdown"),
        },
        "rclpy.exceptions": {"ParameterException": WrongType},
        "rclpy.executors": {"ExternalShutdownException": type("Ended", (Exception,), {})},
        "rclpy.node": {"Node": Parent},
        "rclpy.qos": {
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL=1),
            "QoSProfile": SimpleNamespace,
        },
        "rclpy.time": {"Time": SimpleNamespace},
        "rosidl_runtime_py": {
            "set_message_fields": lambda message, content: vars(message).update(content)
        },
        "tf2_ros": {
            "Buffer": Transforms,
            "TransformException": RuntimeError,
            "TransformListener": lambda buffer, node: None,
        },
        "diagnostic_msgs": {},
        "diagnostic_msgs.msg": {"DiagnosticArray": kind("DiagnosticArray")},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"PoseWithCovarianceStamped": kind("PoseWithCovarianceStamped")},
        "visualization_msgs": {},
        "visualization_msgs.msg": {name: kind(name) for name in ("Marker", "MarkerArray")},
    }
    for name, names in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Parent, "given", {"field": corridors_npz})
    module = part("watch_node")
    module.calls = calls
    return module


def test_node_warns_once_and_publishes_poses(node_module, monkeypatch):
    node = node_module.WatchNode()
    ((period, look_up),) = node.timers_made
    assert period == 0.2
    markers = node.sent["~/ellipses"][0].markers
    assert len(markers) > 20
    assert markers[0]["header"]["stamp"] == {"sec": 0, "nanosec": 0}
    look_up()
    assert node.log == [("info", "waiting for the pose: no transform")]
    node.log.clear()
    for x in (2.0, 15.0, 20.0, 37.0, -60.0):
        monkeypatch.setattr(Transforms, "x", x)
        look_up()
    assert [level for level, _ in node.log] == ["warning", "info"]
    poses = node.sent["~/covariance"]
    assert [message.pose["pose"]["position"]["x"] for message in poses] == [2.0, 15.0, 20.0, 37.0]
    assert poses[0].header == {"stamp": {"sec": 7, "nanosec": 8}, "frame_id": "map"}
    assert [message.action for message in node.sent["~/warning"]] == [2, 0, 0, 2, 2]
    assert len(node.sent["/diagnostics"]) == 5


def test_node_reads_poses_from_topic(node_module, corridors_npz, monkeypatch):
    monkeypatch.setattr(Parent, "given", {"field": corridors_npz, "pose_topic": "/amcl_pose"})
    node = node_module.WatchNode()
    assert not node.timers_made
    at = SimpleNamespace(
        position=SimpleNamespace(x=20.0, y=3.0),
        orientation=SimpleNamespace(x=0.0, y=0.0, z=1.0, w=0.0),
    )
    stamp = SimpleNamespace(sec=1, nanosec=0)
    node.topics["/amcl_pose"](
        SimpleNamespace(header=SimpleNamespace(stamp=stamp), pose=SimpleNamespace(pose=at))
    )
    assert [level for level, _ in node.log] == ["warning"]


def test_parameter_file_equals_node_defaults(node_module):
    content = yaml.safe_load((PACKAGE / "config" / "watch.yaml").read_text())
    parameters = content["localizability_watch"]["ros__parameters"]
    assert {"field": "", **parameters} == node_module.PARAMETERS
    assert {name: type(value) for name, value in parameters.items()} == {
        name: type(node_module.PARAMETERS[name]) for name in parameters
    }


@pytest.mark.parametrize(
    "wrong",
    [{"field": "gone.npz"}, {"rate": 0.0}, {"leave": 0.9}, {"enter": 1}],
    ids=lambda w: str(*w),
)
def test_node_refuses_wrong_parameter(node_module, monkeypatch, capsys, wrong):
    node_module.main()
    assert node_module.calls == ["init", "spin", "shutdown"]
    monkeypatch.setattr(Parent, "given", Parent.given | wrong)
    with pytest.raises(SystemExit, match="2"):
        node_module.main()
    assert capsys.readouterr().err.count("\n") == 1
    assert node_module.calls[-1] == "shutdown"

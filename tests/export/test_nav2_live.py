"""What a sourced ROS 2 with Nav2 makes of exports; skipped where there is none.

`pytest -m ros` runs these alone, after ``source /opt/ros/DISTRO/setup.bash``, in an environment
that sees its packages. Each starts nodes as an export's README.md says, and ends them.
"""

import csv
import os
import signal
import subprocess

import numpy as np
import pytest

from locplan import Costmap, Path, plan, save_map
from locplan.export import nav2_keepout, nav2_routes
from locplan.export.masks import CostmapInflation, compute_keepout_mask
from locplan.export.parameters import ROS_DISTRIBUTIONS
from locplan.maps import environments
from locplan.planning import path_metrics
from locplan.robots import read_parameters

rclpy = pytest.importorskip("rclpy", reason="no ROS 2 is sourced here")
pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(
        os.environ.get("ROS_DISTRO") not in ROS_DISTRIBUTIONS,
        reason="exports are made for other distributions of ROS 2",
    ),
]
DEFAULT_DISTRO = os.environ.get("ROS_DISTRO", "")
START, GOAL = (2.0, 3.0), (38.0, 3.0)
PATIENCE = 60.0
"""Time after which a node that does not answer counts as failed [s]."""
PARAMS = """global_costmap:
  global_costmap:
    ros__parameters:
      global_frame: map
      robot_base_frame: base_link
      robot_radius: 0.22
      resolution: 0.1
      plugins: ["static_layer", "inflation_layer"]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer", map_subscribe_transient_local: true}
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
        cost_scaling_factor: 3.0
        inflation_radius: 0.7
planner_server:
  ros__parameters:
    expected_planner_frequency: 1.0
"""


@pytest.fixture(scope="module")
def costs():
    """Two corridors, of which the straight one is degenerate."""
    grid = environments.make("two_corridors", resolution=0.1)
    y = np.indices(grid.shape)[0] * 0.1
    u = np.where((y > 1) & (y < 5), 1.0, 0.05)
    return Costmap.from_layers(grid, u=u, weight=8.0, robot=0.25)


@pytest.fixture
def started():
    """A function that starts a process of ROS, which is ended after the test."""
    running = []

    def start(*words):
        running.append(subprocess.Popen([*map(str, words)], start_new_session=True))

    yield start
    for each in running:
        os.killpg(each.pid, signal.SIGINT)
    for each in running:
        each.wait(PATIENCE)


@pytest.fixture
def node():
    rclpy.init()
    made = rclpy.create_node("locplan_test")
    yield made
    made.destroy_node()
    rclpy.shutdown()


def latched(node, kind, topic):
    """The message that is latched on a topic."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    quality = QoSProfile(
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        reliability=ReliabilityPolicy.RELIABLE,
    )
    arrived = rclpy.task.Future()
    subscription = node.create_subscription(kind, topic, arrived.set_result, quality)
    rclpy.spin_until_future_complete(node, arrived, timeout_sec=PATIENCE)
    node.destroy_subscription(subscription)
    assert arrived.done(), f"nothing came on {topic}"
    return arrived.result()


def done(node, future):
    rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
    assert future.done()
    return future.result()


def asked(node, kind, name, goal):
    """The path in the result of an action; None where it has none."""
    from rclpy.action import ActionClient

    client = ActionClient(node, kind, name)
    assert client.wait_for_server(timeout_sec=PATIENCE), f"no server of {name}"
    handle = done(node, client.send_goal_async(goal))
    poses = done(node, handle.get_result_async()).result.path.poses if handle.accepted else ()
    client.destroy()
    xy = np.array([(each.pose.position.x, each.pose.position.y) for each in poses])
    return Path(xy) if len(xy) > 1 else None


def pose_at(xy):
    from geometry_msgs.msg import PoseStamped

    made = PoseStamped()
    made.header.frame_id = "map"
    made.pose.position.x, made.pose.position.y = xy
    made.pose.orientation.w = 1.0
    return made


def cost_of(costs, path):
    """J of a path of a robot that may be smaller than the costmap's."""
    density = np.where(costs.grid.free, 1 + costs.weight * costs.u, np.inf)
    return path_metrics(Costmap.from_density(costs.grid, density), path).cost


def start_planning(started, folder):
    """Start a planner server with its map and its place, by the parameters of an export."""
    started("ros2", "launch", folder / "localizability.launch.xml")
    tf = "--frame-id", "map", "--child-frame-id", "base_link"
    started("ros2", "run", "tf2_ros", "static_transform_publisher", *tf)
    yaml = f"yaml_filename:={folder.parent / 'lab.yaml'}"
    started("ros2", "run", "nav2_map_server", "map_server", "--ros-args", "-p", yaml)
    own = "--ros-args", "--params-file", folder / "nav2.yaml"
    started("ros2", "run", "nav2_planner", "planner_server", *own)
    names = "-p", "autostart:=true", "-p", "node_names:=[map_server, planner_server]"
    manager = "nav2_lifecycle_manager", "lifecycle_manager", "--ros-args", *names
    started("ros2", "run", *manager, "-r", "__node:=lifecycle_manager_planning")


def exported(folder, costs, **settings):
    save_map(costs.grid, folder / "lab.yaml")
    (folder / "own.yaml").write_text(PARAMS)
    settings |= {"params": folder / "own.yaml", "distro": DEFAULT_DISTRO}
    return nav2_keepout(folder / "mask", costs, **settings)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_mask_server_publishes_exported_mask(tmp_path, costs, started, node):
    from nav2_msgs.msg import CostmapFilterInfo
    from nav_msgs.msg import OccupancyGrid

    exported(tmp_path, costs, planner="smac2d")
    started("ros2", "launch", tmp_path / "mask" / "localizability.launch.xml")
    mask = latched(node, OccupancyGrid, "/localizability_keepout_mask")
    layer = CostmapInflation.from_parameters(read_parameters(tmp_path / "own.yaml"))
    inflation = CostmapInflation.choose_for_mask(costs, layer)
    values, _ = compute_keepout_mask(costs, inflation=inflation)
    np.testing.assert_array_equal(np.reshape(mask.data, values.shape), values)
    info = latched(node, CostmapFilterInfo, "/localizability_keepout_info")
    assert (info.type, info.base, info.multiplier) == (0, 0.0, 1.0)
    assert info.filter_mask_topic == "/localizability_keepout_mask"


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("planner", ["smac2d", "thetastar"])
def test_nav2_planner_minimises_cost_with_mask(tmp_path, costs, started, node, planner):
    from nav2_msgs.action import ComputePathToPose

    exported(tmp_path, costs, planner=planner)
    start_planning(started, tmp_path / "mask")
    goal = ComputePathToPose.Goal()
    goal.start, goal.goal, goal.use_start = pose_at(START), pose_at(GOAL), True
    goal.planner_id = "GridBased"
    own = plan(costs, START, GOAL).metrics.cost
    ratio = np.inf
    for _ in range(30):  # the map and the mask come when they come
        path = asked(node, ComputePathToPose, "compute_path_to_pose", goal)
        ratio = cost_of(costs, path) / own if path else np.inf
        if ratio <= 1.12:
            return
        rclpy.spin_once(node, timeout_sec=1.0)
    pytest.fail(f"J is {ratio:.2f} times that of the own plan")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_route_server_follows_recommended_path(tmp_path, costs, started, node):
    action = pytest.importorskip("nav2_msgs.action", reason="this Nav2 has no actions")
    if not hasattr(action, "ComputeRoute"):
        pytest.skip("this Nav2 has no route server")
    aware = plan(costs, START, GOAL).path
    nav2_routes(tmp_path / "routes", costs, {"aware": aware}, distro=DEFAULT_DISTRO)
    started("ros2", "launch", tmp_path / "routes" / "localizability.launch.xml")
    with open(tmp_path / "routes" / "routes.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    goal = action.ComputeRoute.Goal()
    goal.start_id, goal.goal_id = int(row["start_id"]), int(row["goal_id"])
    path = asked(node, action.ComputeRoute, "compute_route", goal)
    assert path is not None
    assert cost_of(costs, path) <= 1.05 * cost_of(costs, aware)

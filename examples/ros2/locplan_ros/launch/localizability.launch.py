"""Serve the masks that locplan exported, and watch the robot; --show-args lists the arguments.

What the masks' servers are is written in each exported folder, in localizability.launch.xml, which
is included here.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).resolve().parent.parent
SERVERS = "localizability.launch.xml"
ARGUMENTS = {
    "exports": ("", "Folders of `locplan export --to nav2-...`, separated by commas"),
    "map": ("", "Map YAML to serve; leave it out where Nav2's bringup serves the map"),
    "field": ("", "Field (.npz) to watch the robot on; without it no node watches"),
    "params_file": (str(HERE / "config" / "watch.yaml"), "Parameters of the watching node"),
    "rviz": ("true", "Whether to start RViz"),
    "use_sim_time": ("false", "Whether the clock is that of a simulation or a bag"),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=about)
        for name, (value, about) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def start(context):
    """The actions for the arguments given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    clock = {"use_sim_time": is_true(given["use_sim_time"])}
    # The masks' servers keep the real clock: what they publish holds at any time.
    actions = [servers_of(each.strip()) for each in given["exports"].split(",") if each.strip()]
    if given["map"]:
        actions += map_server(existing(given["map"]))
    if given["field"]:
        parameters = [existing(given["params_file"]), {"field": existing(given["field"]), **clock}]
        actions.append(
            Node(
                package="locplan_ros",
                executable="watch",
                name="localizability_watch",
                output="screen",
                parameters=parameters,
            )
        )
    if is_true(given["rviz"]):
        view = str(HERE / "rviz" / "localizability.rviz")
        actions.append(
            Node(package="rviz2", executable="rviz2", arguments=["-d", view], parameters=[clock])
        )
    return actions


def servers_of(folder):
    """The servers of an exported folder."""
    launch = existing(str(Path(folder) / SERVERS))
    return IncludeLaunchDescription(AnyLaunchDescriptionSource(launch))


def map_server(yaml_filename):
    """A server of the robot's map, and its lifecycle manager."""
    name = "localizability_map_server"
    map_ = {"yaml_filename": yaml_filename, "topic_name": "/map", "frame_id": "map"}
    manager = {"autostart": True, "node_names": [name]}
    return [
        Node(
            package="nav2_map_server",
            executable="map_server",
            name=name,
            output="screen",
            parameters=[map_],
        ),
        Node(
            package="nav2_lifecycle_manager",
            executable="lifecycle_manager",
            name="lifecycle_manager_localizability_map",
            output="screen",
            parameters=[manager],
        ),
    ]


def existing(path):
    """An absolute path, which must exist."""
    absolute = Path(path).expanduser().resolve()
    if not absolute.exists():
        raise FileNotFoundError(f"there is no {absolute}; check the launch arguments")
    return str(absolute)


def is_true(text):
    return text.lower() in ("true", "1", "yes")

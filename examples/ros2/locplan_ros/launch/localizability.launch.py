# Copyright 2026 locplan developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Launch the masks that locplan exported, and watch the robot; --show-args lists the arguments.

Each exported folder has a localizability.launch.xml with the servers of its mask. This file
includes it.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(__file__).resolve().parent.parent
SERVERS = 'localizability.launch.xml'
ARGUMENTS = {
    'exports': ('', 'Folders of `locplan export --to nav2-...`, separated by commas'),
    'map': ('', "Map YAML to serve; omit it if Nav2's bringup serves the map"),
    'field': ('', 'Field (.npz) to watch the robot on; without it, the node does not start'),
    'params_file': (str(SHARE / 'config' / 'watch.yaml'), 'Parameters of the node'),
    'rviz': ('true', 'Whether to start RViz'),
    'use_sim_time': ('false', 'Whether to use the clock of a simulation or a bag'),
}


def generate_launch_description():
    """Return the arguments, and the actions that depend on them."""
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=description)
        for name, (value, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=make_actions)])


def make_actions(context):
    """Return the actions for the values of the arguments."""
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    clock = {'use_sim_time': values['use_sim_time'].lower() in ('true', '1', 'yes')}
    # The masks' servers keep the real clock, because masks do not depend on the time.
    folders = [folder.strip() for folder in values['exports'].split(',') if folder.strip()]
    actions = [include_servers(folder) for folder in folders]
    if values['map']:
        actions += make_map_server(resolve_path(values['map']))
    if values['field']:
        params_file, field = resolve_path(values['params_file']), resolve_path(values['field'])
        actions.append(
            Node(
                package='locplan_ros',
                executable='watch',
                name='localizability_watch',
                output='screen',
                parameters=[params_file, {'field': field, **clock}],
            )
        )
    if values['rviz'].lower() in ('true', '1', 'yes'):
        view = str(SHARE / 'rviz' / 'localizability.rviz')
        actions.append(
            Node(package='rviz2', executable='rviz2', arguments=['-d', view], parameters=[clock])
        )
    return actions


def include_servers(folder):
    """Return the action that starts the servers of an exported folder."""
    launch = resolve_path(str(Path(folder) / SERVERS))
    return IncludeLaunchDescription(AnyLaunchDescriptionSource(launch))


def make_map_server(yaml_filename):
    """Return a server of the robot's map, and its lifecycle manager."""
    name = 'localizability_map_server'
    server = {'yaml_filename': yaml_filename, 'topic_name': '/map', 'frame_id': 'map'}
    manager = {'autostart': True, 'node_names': [name]}
    return [
        Node(
            package='nav2_map_server',
            executable='map_server',
            name=name,
            output='screen',
            parameters=[server],
        ),
        Node(
            package='nav2_lifecycle_manager',
            executable='lifecycle_manager',
            name='lifecycle_manager_localizability_map',
            output='screen',
            parameters=[manager],
        ),
    ]


def resolve_path(path):
    """Return the absolute path of a file or folder, which must exist."""
    absolute = Path(path).expanduser().resolve()
    if not absolute.exists():
        raise FileNotFoundError(f'there is no {absolute}; check the launch arguments')
    return str(absolute)

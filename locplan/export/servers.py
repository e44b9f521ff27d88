"""Launch and parameter files of Nav2's lifecycle nodes, and of a separate map for AMCL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from locplan._support.files import write_text
from locplan.export.parameters import dump_parameters
from locplan.export.registry import render_template
from locplan.maps.files import save_map
from locplan.maps.grid import OccupancyGrid


@dataclass(frozen=True)
class LifecycleNode:
    """A lifecycle node of Nav2."""

    package: str
    executable: str
    name: str
    parameters: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)
    """Parameters that name a file in the folder; they stand only in the launch file.

    The launch file sets them for all nodes ("/**"). If they were also in the parameter file,
    rclcpp would prefer those whenever a -p comes before the files (parameter_map.cpp), as with
    launch_ros's SetParameter.
    """


def write_servers(folder: Path, servers: Sequence[LifecycleNode], manager_name: str) -> None:
    """Write the nodes' parameters, and a launch file that starts and activates them."""
    manager = LifecycleNode(
        "nav2_lifecycle_manager",
        "lifecycle_manager",
        manager_name,
        {"autostart": True, "node_names": [server.name for server in servers]},
    )
    nodes = [*servers, manager]
    parameters = {node.name: {"ros__parameters": dict(node.parameters)} for node in nodes}
    write_text(folder / "servers.yaml", dump_parameters(parameters))
    launch = folder / "localizability.launch.xml"
    write_text(launch, render_template("servers.launch.xml", {"nodes": nodes}))


def write_filter_map(folder: Path, grid: OccupancyGrid) -> None:
    """Write a separate map for AMCL, with the files that Nav2 needs to serve it.

    The planners keep their map. The files are the same for all distributions.

    Parameters
    ----------
    folder : path
        The folder, which must exist.
    grid : OccupancyGrid
        The map; it is written in mode trinary, since AMCL treats only 100 as a wall.
    """
    # From humble to main (2026-08) amcl has the parameter `map_topic`, map_server `topic_name`.
    topic = "/map_amcl"
    save_map(grid, folder / "map_amcl.yaml")
    parameters = {"topic_name": topic, "frame_id": "map"}
    files = {"yaml_filename": "map_amcl.yaml"}
    server = LifecycleNode("nav2_map_server", "map_server", "map_amcl_server", parameters, files)
    # The lifecycle manager of nav2_bringup manages only its own nodes.
    write_servers(folder, [server], "lifecycle_manager_map_amcl")
    amcl = {"amcl": {"ros__parameters": {"map_topic": topic}}}
    write_text(folder / "amcl.yaml", dump_parameters(amcl))
    readme = render_template("filter-map.md", {"map": grid.name, "topic": topic})
    write_text(folder / "README.md", readme)

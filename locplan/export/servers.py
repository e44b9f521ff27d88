"""Lifecycle nodes of Nav2 that are started: their files, and those of a map for AMCL alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
    """Parameters that name a file in the folder; the launch file alone has them.

    It writes them for all nodes, "/**". rclcpp would take a name in the parameter file, written
    for this node, instead of it where a -p comes before the files (parameter_map.cpp), as
    launch_ros's SetParameter puts it.
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
    (folder / "servers.yaml").write_text(dump_parameters(parameters), "utf-8")
    launch = folder / "localizability.launch.xml"
    launch.write_text(render_template("servers.launch.xml", nodes=nodes), "utf-8")


def write_filter_map(folder: Path, grid: OccupancyGrid) -> None:
    """Write a map for AMCL alone, beside the one that is planned on, and what Nav2 needs for it.

    It is the same in all distributions.

    Parameters
    ----------
    folder : path
        The folder, which is there.
    grid : OccupancyGrid
        The map; it is written in mode trinary, since AMCL takes only 100 as a wall.
    """
    # From humble to main (2026-08) amcl has the parameter `map_topic`, map_server `topic_name`.
    topic = "/map_amcl"
    save_map(grid, folder / "map_amcl.yaml")
    parameters = {"topic_name": topic, "frame_id": "map"}
    files = {"yaml_filename": "map_amcl.yaml"}
    server = LifecycleNode("nav2_map_server", "map_server", "map_amcl_server", parameters, files)
    # The lifecycle manager of nav2_bringup knows its own nodes only.
    write_servers(folder, [server], "lifecycle_manager_map_amcl")
    amcl = {"amcl": {"ros__parameters": {"map_topic": topic}}}
    (folder / "amcl.yaml").write_text(dump_parameters(amcl), "utf-8")
    readme = render_template("filter-map.md", map=grid.name, topic=topic)
    (folder / "README.md").write_text(readme, "utf-8")

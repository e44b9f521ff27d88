"""Lifecycle nodes of Nav2 that an export starts: their parameters, and their launch file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from locplan.export._parameters import yaml_text
from locplan.export._registry import rendered


@dataclass(frozen=True)
class Server:
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


def write_servers(folder: Path, servers: Sequence[Server], manager_name: str) -> None:
    """Write the nodes' parameters, and a launch file that starts and activates them."""
    manager = Server(
        "nav2_lifecycle_manager",
        "lifecycle_manager",
        manager_name,
        {"autostart": True, "node_names": [server.name for server in servers]},
    )
    nodes = [*servers, manager]
    parameters = {node.name: {"ros__parameters": dict(node.parameters)} for node in nodes}
    (folder / "servers.yaml").write_text(yaml_text(parameters), "utf-8")
    launch = folder / "localizability.launch.xml"
    launch.write_text(rendered("servers.launch.xml", nodes=nodes), "utf-8")

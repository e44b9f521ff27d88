"""The ROS 2 nodes that serve exported files: their parameters, and the launch file for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

LAUNCH = "localizability.launch.xml"
SERVERS = "servers.yaml"


@dataclass(frozen=True)
class Server:
    """A lifecycle node of Nav2."""

    package: str
    executable: str
    name: str
    parameters: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)
    """Parameters that name a file in the folder."""


def write_servers(folder: Path, servers: Sequence[Server], manager_name: str) -> None:
    """Write the nodes' parameters, and a launch file that starts and activates them."""
    manager = Server(
        "nav2_lifecycle_manager",
        "lifecycle_manager",
        manager_name,
        {"autostart": True, "node_names": [server.name for server in servers]},
    )
    nodes = [*servers, manager]
    write_yaml(
        folder / SERVERS,
        {node.name: {"ros__parameters": {**node.parameters, **node.files}} for node in nodes},
    )
    lines = ["<launch>"]
    for node in nodes:
        lines.append(f'  <node pkg="{node.package}" exec="{node.executable}" name="{node.name}">')
        lines.append(f'    <param from="$(dirname)/{SERVERS}"/>')
        for key, file in node.files.items():
            lines.append(f'    <param name="{key}" value="$(dirname)/{file}"/>')
        lines.append("  </node>")
    (folder / LAUNCH).write_text("\n".join([*lines, "</launch>"]) + "\n", encoding="utf-8")


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    import yaml

    path.write_text(yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True), "utf-8")

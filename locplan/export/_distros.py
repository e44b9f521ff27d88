"""What differs between the distributions of ROS 2, and the nodes that serve files there."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from locplan._util.checks import one_of
from locplan._util.reading import ROS_BOOLEANS, ROS_NUMBER

Distro = Literal["humble", "jazzy", "kilted", "lyrical", "rolling"]
"""A distribution of ROS 2."""
NavPlannerName = Literal["smac2d", "smac-hybrid", "navfn", "thetastar"]
"""A planner of Nav2."""


BRINGUP = "ros2 launch nav2_bringup bringup_launch.py map:=MAP.yaml params_file:=PARAMS.yaml"
LAUNCH = "localizability.launch.xml"
SERVERS = "servers.yaml"


class DistroWarning(UserWarning):
    """A distribution of ROS 2 has a fault that concerns the localization."""


@dataclass(frozen=True)
class Distribution:
    """A distribution of ROS 2, as far as exports depend on it."""

    name: str
    """The name, such as jazzy."""
    slashes: bool = False
    """Whether planners' plugins are named with / for :: (nav2_smac_planner/smac_plugin_2d.xml and
    its like), up to iron."""
    quadratic_penalty: bool = True
    """Whether SmacPlannerHybrid has `use_quadratic_cost_penalty`, from jazzy on."""
    graph_by: Literal["launch", "parameters", "argument"] = "argument"
    """How the route server gets its graph (nav2_bringup/launch): bringup starts none in humble, so
    that our launch file does; one with graph_filepath of its parameters in jazzy; and one with the
    argument ``graph:=``, which replaces graph_filepath, from kilted on."""
    inscribed_value: bool = True
    """Whether a StaticLayer takes one value of a map for the inscribed cost, by default 99
    (nav2_costmap_2d/plugins/static_layer.cpp, inscribed_obstacle_cost_value), from lyrical on."""
    unsure_field: bool = True
    """Whether AMCL's likelihood field is made from an uninitialised variable (`CellData cell` in
    nav2_amcl/src/map/map_cspace.cpp), from kilted on."""

    def warn(self) -> None:
        """Warn of what a user of this distribution should know."""
        if self.unsure_field:
            warnings.warn(
                DistroWarning(
                    f"{self.name}: AMCL's likelihood field may be wrong there, since it starts from"
                    " an uninitialised variable (map_cspace.cpp, CellData cell); build nav2_amcl"
                    " with its occ_dist set to 0"
                ),
                stacklevel=2,
            )


DISTRIBUTIONS = {
    each.name: each
    for each in (
        Distribution("humble", True, False, "launch", inscribed_value=False, unsure_field=False),
        Distribution("jazzy", graph_by="parameters", inscribed_value=False, unsure_field=False),
        Distribution("kilted", inscribed_value=False),
        Distribution("lyrical"),
        Distribution("rolling"),
    )
}
"""Distributions that exports are made for, by name."""


def distribution(name: str) -> Distribution:
    """A distribution of ROS 2 by its name.

    Parameters
    ----------
    name : str
        One of `DISTRIBUTIONS`.

    Raises
    ------
    ConfigError
        If there is none of this name.
    """
    one_of("distro", name, DISTRIBUTIONS)
    return DISTRIBUTIONS[name]


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
    write_yaml(
        folder / SERVERS,
        {node.name: {"ros__parameters": dict(node.parameters)} for node in nodes},
    )
    lines = ["<launch>"]
    for node in nodes:
        lines.append(f'  <node pkg="{node.package}" exec="{node.executable}" name="{node.name}">')
        lines.append(f'    <param from="$(dirname)/{SERVERS}"/>')
        for key, file in node.files.items():
            lines.append(f'    <param name="{key}" value="$(dirname)/{file}"/>')
        lines.append("  </node>")
    (folder / LAUNCH).write_text("\n".join([*lines, "</launch>"]) + "\n", encoding="utf-8")


def lines_on_serving(runs: Distribution, graph: str) -> list[str]:
    """Lines of a README.md that say how the route server of a folder is started."""
    here = f"`ros2 launch ./{LAUNCH}` (in this folder)"
    if runs.graph_by == "launch":
        return [f"- {here} starts the server; nav2_bringup has none in {runs.name}."]
    own = f"- Without nav2_bringup {here} starts a server of its own."
    if runs.graph_by == "parameters":
        return [
            f"- nav2_bringup starts a route server in {runs.name}: put `route_server` of {SERVERS}"
            f" into its parameters, with the full path of {graph} as graph_filepath.",
            own,
        ]
    return [
        f"- Put `route_server` of {SERVERS} into your parameters (without graph_filepath), then"
        f" `{BRINGUP} graph:=$PWD/{graph}`.",
        own,
    ]


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write parameters so that ROS reads each text as a text."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """A dumper that quotes what is a text to PyYAML only."""

    def represent(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
        plain = text in ROS_BOOLEANS or ROS_NUMBER.fullmatch(text)
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, '"' if plain else None)

    Dumper.add_representer(str, represent)
    text = yaml.dump(dict(content), Dumper=Dumper, sort_keys=False, allow_unicode=True)
    path.write_text(text, "utf-8")

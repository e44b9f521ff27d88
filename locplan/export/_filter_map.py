"""A map of its own for Nav2's AMCL, beside the one that is planned on.

From humble to main, amcl has the parameter `map_topic` and map_server `topic_name` (2026-08). A
second map_server needs a lifecycle manager, since that of nav2_bringup knows its own nodes only.
"""

from __future__ import annotations

from pathlib import Path

from locplan.export._parameters import yaml_text
from locplan.export._registry import rendered
from locplan.export._servers import Server, write_servers
from locplan.maps import OccupancyGrid, save_map

TOPIC = "/map_amcl"
"""Topic of the map for AMCL."""


def write_filter_map(folder: Path, grid: OccupancyGrid) -> None:
    """Write a map for AMCL alone, and what Nav2 needs for it, the same in all distributions.

    Parameters
    ----------
    folder : path
        The folder, which is there.
    grid : OccupancyGrid
        The map; it is written in mode trinary, since AMCL takes only 100 as a wall.
    """
    save_map(grid, folder / "map_amcl.yaml")
    parameters = {"topic_name": TOPIC, "frame_id": "map"}
    files = {"yaml_filename": "map_amcl.yaml"}
    server = Server("nav2_map_server", "map_server", "map_amcl_server", parameters, files)
    write_servers(folder, [server], "lifecycle_manager_map_amcl")
    amcl = {"amcl": {"ros__parameters": {"map_topic": TOPIC}}}
    (folder / "amcl.yaml").write_text(yaml_text(amcl), "utf-8")
    about = rendered("filter-map.md", map=grid.name, topic=TOPIC)
    (folder / "README.md").write_text(about, "utf-8")

"""ROS 2 bags, MCAP files, written without ROS."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from locplan._util.checks import shown
from locplan._util.extras import needed
from locplan._util.files import replacing
from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.export._cdr import encode, schema
from locplan.export._messages import (
    ellipse_markers,
    foxglove_grid,
    grid_map,
    layers_of,
    levels_of,
    occupancy_grid,
    path_message,
    topics_of,
)
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid

_INFINITE = "{sec: 9223372036, nsec: 854775807}"
# Integers, which rosbag2 reads from Humble on: keep the last, reliable, transient local, automatic.
_LATCHED = (
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {_INFINITE},"
    f" lifespan: {_INFINITE}, liveliness: 1, liveliness_lease_duration: {_INFINITE},"
    " avoid_ros_namespace_conventions: false}"
)


def bag(
    target: str | os.PathLike[str],
    grid: OccupancyGrid,
    *,
    mask: ArrayLike | None = None,
    field: CovarianceField | None = None,
    paths: Mapping[str, Path] | None = None,
    frame: str = "map",
    stamp: int = 0,
    spacing: float = 2.0,
    magnify: float = 1.0,
) -> None:
    """Write a ROS 2 bag: an MCAP file with one latched message on each topic.

    ``ros2 bag play FILE.mcap`` (Humble and later), Foxglove and PyPI's rosbags read it. The same
    input gives the same bytes.

    Parameters
    ----------
    target : path
        The file, named *.mcap.
    grid : OccupancyGrid
        "/locplan/map", nav_msgs/OccupancyGrid: the map, which gives the mask its place.
    mask : (H, W) array of integers, optional
        "/locplan/mask", nav_msgs/OccupancyGrid: 0..100, or -1 for unknown.
    field : CovarianceField, optional
        "/locplan/field", grid_map_msgs/GridMap: "e", "position_std", "heading_std",
        "principal_axis" and the field's own layers on its lattice; several headings are merged by
        their mean information. Grid maps cannot be turned: on a map with yaw finer cells take the
        nearest lattice points. "/locplan/grid", foxglove_msgs/Grid: these layers with the yaw.
        "/locplan/ellipses", visualization_msgs/MarkerArray: one standard deviation of the position
        each way, and the major axes.
    paths : dict of Path, optional
        "/locplan/path/NAME", nav_msgs/Path; poses without a heading face the way they go. What a
        topic cannot hold of a name becomes _, and topics that are alike then are numbered.
    frame : str, default "map"
        The frame of all coordinates.
    stamp : int, default 0
        Time of all messages since 1970 [ns], >= 0. To ROS, zero means "whenever".
    spacing : float, default 2.0
        Least distance between ellipses [m], above 0.
    magnify : float, default 1.0
        Factor on the ellipses, above 0; 1 draws one standard deviation to the map's scale.

    Raises
    ------
    LocplanError
        If the package mcap is missing, an argument is of the wrong kind, or the file cannot be
        written.
    """
    needed("mcap", "ros", "a bag")
    if not (isinstance(stamp, int) and 0 <= stamp < 2**31 * 10**9):
        raise LocplanError(f"stamp must be nanoseconds since 1970, not {shown(stamp)}")
    if not (spacing > 0 and magnify > 0):
        raise LocplanError("spacing and magnify of the ellipses must be positive")
    if field is not None and field.grid.digest != grid.digest:
        raise LocplanError("the field belongs to another map; compute it for this one")
    time = {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
    header = {"stamp": time, "frame_id": frame}
    content: dict[str, tuple[str, dict[str, Any]]] = {
        "/locplan/map": ("nav_msgs/OccupancyGrid", occupancy_grid(grid, levels_of(grid)))
    }
    if mask is not None:
        content["/locplan/mask"] = "nav_msgs/OccupancyGrid", occupancy_grid(grid, mask)
    if field is not None:
        layers = layers_of(field)
        markers = list(ellipse_markers(field, header, spacing, magnify))
        content |= {
            "/locplan/field": ("grid_map_msgs/GridMap", grid_map(field, layers)),
            "/locplan/grid": ("foxglove_msgs/Grid", foxglove_grid(field, layers, header)),
            "/locplan/ellipses": ("visualization_msgs/MarkerArray", {"markers": markers}),
        }
    topics = topics_of(paths or {})
    for name, route in (paths or {}).items():
        content[topics[name]] = "nav_msgs/Path", path_message(route, header)
    write_messages(target, content, header, stamp)


def write_messages(
    target: str | os.PathLike[str],
    content: Mapping[str, tuple[str, dict[str, Any]]],
    header: Mapping[str, Any],
    stamp: int,
) -> None:
    """Write one message on each topic, given by its type and its fields but for the header."""
    from mcap.writer import Writer

    messages = {topic: (kind, {"header": header} | m) for topic, (kind, m) in content.items()}
    schemas: dict[str, int] = {}
    with replacing(target) as temporary, open(temporary, "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="locplan")
        for topic, (kind, message) in messages.items():
            if kind not in schemas:
                name = kind.replace("/", "/msg/")
                schemas[kind] = writer.register_schema(name, "ros2msg", schema(kind).encode())
            latched = {"offered_qos_profiles": _LATCHED}
            channel = writer.register_channel(topic, "cdr", schemas[kind], latched)
            data = encode(kind, message)
            writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)
        writer.finish()  # type: ignore[no-untyped-call]

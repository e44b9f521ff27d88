"""ROS 2 bags, MCAP files, written without ROS: their messages' definitions and bytes."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from locplan._util.checks import shown
from locplan._util.files import replacing
from locplan._util.public import needed
from locplan.costs import Path
from locplan.errors import LocplanError
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

_TYPES = {
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec, uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "std_msgs/ColorRGBA": "float32 r, float32 g, float32 b, float32 a",
    "std_msgs/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim, uint32 data_offset",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout, float32[] data",
    "geometry_msgs/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header, geometry_msgs/Pose pose",
    "nav_msgs/Path": "std_msgs/Header header, geometry_msgs/PoseStamped[] poses",
    "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time, float32 resolution,"
    " uint32 width, uint32 height, geometry_msgs/Pose origin",
    "nav_msgs/OccupancyGrid": "std_msgs/Header header, nav_msgs/MapMetaData info, int8[] data",
    "grid_map_msgs/GridMapInfo": "float64 resolution, float64 length_x, float64 length_y,"
    " geometry_msgs/Pose pose",
    "grid_map_msgs/GridMap": "std_msgs/Header header, grid_map_msgs/GridMapInfo info,"
    " string[] layers, string[] basic_layers, std_msgs/Float32MultiArray[] data,"
    " uint16 outer_start_index, uint16 inner_start_index",
    "foxglove_msgs/Vector2": "float64 x, float64 y",
    "foxglove_msgs/PackedElementField": "string name, uint32 offset, uint8 type",
    "foxglove_msgs/Grid": "builtin_interfaces/Time timestamp, string frame_id,"
    " geometry_msgs/Pose pose, uint32 column_count, foxglove_msgs/Vector2 cell_size,"
    " uint32 row_stride, uint32 cell_stride, foxglove_msgs/PackedElementField[] fields,"
    " uint8[] data",
    "sensor_msgs/CompressedImage": "std_msgs/Header header, string format, uint8[] data",
    "visualization_msgs/UVCoordinate": "float32 u, float32 v",
    "visualization_msgs/MeshFile": "string filename, uint8[] data",
    "visualization_msgs/Marker": "std_msgs/Header header, string ns, int32 id, int32 type,"
    " int32 action, geometry_msgs/Pose pose, geometry_msgs/Vector3 scale,"
    " std_msgs/ColorRGBA color, builtin_interfaces/Duration lifetime, bool frame_locked,"
    " geometry_msgs/Point[] points, std_msgs/ColorRGBA[] colors, string texture_resource,"
    " sensor_msgs/CompressedImage texture, visualization_msgs/UVCoordinate[] uv_coordinates,"
    " string text, string mesh_resource, visualization_msgs/MeshFile mesh_file,"
    " bool mesh_use_embedded_materials",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
}
_NUMBERS = {"bool": "?", "int8": "b", "uint8": "B", "uint16": "H", "int32": "i", "uint32": "I"}
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


_NUMBERS |= {"float32": "f", "float64": "d"}
_PACK = {kind: struct.Struct("<" + code) for kind, code in _NUMBERS.items()}
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def schema(kind: str) -> str:
    """The definitions of a message type and of its parts, as MCAP's "ros2msg"."""
    needed = [kind]
    for name in needed:  # grows
        parts = (part.removesuffix("[]") for part, _ in _fields(name))
        needed += [part for part in dict.fromkeys(parts) if part in _TYPES and part not in needed]
    texts = ["\n".join(f"{part} {label}" for part, label in _fields(name)) for name in needed]
    heads = ["", *(f"{'=' * 80}\nMSG: {name}\n" for name in needed[1:])]
    return "\n".join(head + text for head, text in zip(heads, texts, strict=True)) + "\n"


def encode(kind: str, message: Mapping[str, Any]) -> bytes:
    """A message as CDR; fields that it does not hold are zero or empty.

    A value made of numbers of one type only, or a list of such values, may be an array.
    """
    out = bytearray()
    _append(out, kind, message)
    return _LITTLE_ENDIAN + out


def _append(out: bytearray, kind: str, value: Any) -> None:
    """Append a value as CDR: a number at a multiple of its size, a list behind its length."""
    item = kind.removesuffix("[]")
    if item != kind:
        _append(out, "uint32", 0 if value is None else len(value))
    if isinstance(value, np.ndarray):
        code = _code(item)
        if value.size:
            _align(out, struct.calcsize(code))
            out += np.ascontiguousarray(value, "<" + code).tobytes()
    elif item != kind:
        for one in value or ():
            _append(out, item, one)
    elif kind == "string":
        text = (value or "").encode() + b"\x00"
        _append(out, "uint32", len(text))
        out += text
    elif kind in _PACK:
        _align(out, _PACK[kind].size)
        out += _PACK[kind].pack(value or 0)
    else:
        for part, label in _fields(kind):
            _append(out, part, value and value.get(label))


def _align(out: bytearray, size: int) -> None:
    out += bytes(-len(out) % size)


@cache
def _fields(kind: str) -> list[tuple[str, str]]:
    return [(part, label) for part, label in map(str.split, _TYPES[kind].split(","))]


@cache
def _code(kind: str) -> str:
    return _NUMBERS[kind] if kind in _NUMBERS else _code(_fields(kind)[0][0])

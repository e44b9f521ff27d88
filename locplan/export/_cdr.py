"""ROS 2 messages without ROS: their definitions, and their bytes."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

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

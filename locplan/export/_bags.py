"""ROS 2 bags, MCAP files, written without ROS: maps, masks, fields and paths as messages."""

from __future__ import annotations

import itertools
import math
import os
import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._kernels.arrays import Floats
from locplan._util.checks import shown
from locplan._util.files import replacing
from locplan._util.public import needed
from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.field import CovarianceField, position_axes, sampled_covariances, scalar
from locplan.maps import OCCUPIED, OccupancyGrid

Message: TypeAlias = tuple[str, dict[str, Any]]
"""Type of a message, and its fields but for the header."""
_THICKNESS = 0.02  # of ellipses, which are flat cylinders, and of their axes [m]


def occupancy_grid(grid: OccupancyGrid, mask: ArrayLike) -> dict[str, Any]:
    """nav_msgs/OccupancyGrid of values 0..100 and -1, (H, W)."""
    values = np.asarray(mask)
    if values.shape != grid.shape or not np.issubdtype(values.dtype, np.integer):
        raise LocplanError(f"a mask needs integers of shape {grid.shape}, not {values.shape}")
    if values.min() < -1 or values.max() > 100:
        raise LocplanError("a mask holds 0..100, or -1 for unknown")
    rows, cols = grid.shape
    x, y, yaw = grid.origin
    origin = _poses(np.array([[x, y]]), np.array([yaw]))[0]
    info = {"resolution": grid.resolution, "width": cols, "height": rows, "origin": origin}
    return {"info": info, "data": values.ravel()}


def map_message(grid: OccupancyGrid) -> Message:
    """The map as ROS has it, 0 free, 100 occupied, -1 unknown."""
    levels = np.select([grid.free, grid.cells == OCCUPIED], [0, 100], -1)
    return "nav_msgs/OccupancyGrid", occupancy_grid(grid, levels.astype(np.int8))


def field_messages(
    field: CovarianceField, layers: Mapping[str, Floats], header: Mapping[str, Any]
) -> dict[str, Message]:
    """Layers of a field on its lattice, by topic."""
    return {
        "/locplan/field": ("grid_map_msgs/GridMap", grid_map(field, layers)),
        "/locplan/grid": ("foxglove_msgs/Grid", foxglove_grid(field, layers, header)),
    }


def layers_of(field: CovarianceField) -> dict[str, Floats]:
    """The layers of a field by name, (h, w) each."""
    covariance = field.mean_covariance
    names = ("e", "position_std", "heading_std")[: covariance.shape[-1]]
    layers = {name: scalar(covariance, name) for name in names}
    layers["principal_axis"] = position_axes(covariance)[2]
    return layers | {name: field.scalar(name, headings="mean") for name in field.layers}


def foxglove_grid(
    field: CovarianceField, layers: Mapping[str, Floats], header: Mapping[str, Any]
) -> dict[str, Any]:
    """foxglove_msgs/Grid: cells around the lattice's points, row by row from the lowest y."""
    grid, stride = field.grid, field.stride
    step = stride * grid.resolution
    corner = np.array(grid.grid_to_world((1 - stride) / 2, (1 - stride) / 2))
    values = np.stack(list(layers.values()), axis=-1).astype("<f4")
    size = values.shape[2] * values.itemsize
    # A PackedElementField of type 7 is a float32.
    fields = [{"name": name, "offset": 4 * n, "type": 7} for n, name in enumerate(layers)]
    return {
        "timestamp": header["stamp"],
        "frame_id": header["frame_id"],
        "pose": _poses(corner[None], np.array([grid.origin[2]]))[0],
        "column_count": values.shape[1],
        "cell_size": {"x": step, "y": step},
        "row_stride": values.shape[1] * size,
        "cell_stride": size,
        "fields": fields,
        "data": np.frombuffer(values.tobytes(), np.uint8),
    }


def grid_map(field: CovarianceField, layers: Mapping[str, Floats]) -> dict[str, Any]:
    """grid_map_msgs/GridMap: the first cell has the highest x and y, and x changes first."""
    grid, stride = field.grid, field.stride
    step = stride * grid.resolution
    if abs(math.sin(2 * grid.origin[2])) > 1e-9:
        step *= 2 / 3  # fine enough to meet every lattice point
    ends = [np.array([0, n]) * stride + (1 - stride) / 2 for n in field.covariance.shape[:2]]
    around = np.array(grid.grid_to_world(*np.meshgrid(*ends))).reshape(2, 4)
    low, high = around.min(axis=1), around.max(axis=1)
    cols, rows = np.maximum(np.ceil((high - low) / step - 1e-6), 1).astype(int)
    middle = (low + high) / 2
    x = middle[0] + (np.arange(cols)[::-1] - (cols - 1) / 2) * step
    y = middle[1] + (np.arange(rows)[::-1] - (rows - 1) / 2) * step
    near = [np.rint((v - 0.5) / stride).astype(int) for v in grid.world_to_grid(*np.meshgrid(x, y))]
    inside = [(k >= 0) & (k < n) for k, n in zip(near, field.covariance.shape, strict=False)]
    outside = ~(inside[0] & inside[1])
    i, j = (np.where(outside, 0, k) for k in near)
    dim = [
        {"label": "column_index", "size": rows, "stride": rows * cols},
        {"label": "row_index", "size": cols, "stride": cols},
    ]
    data = [np.where(outside, np.nan, values[i, j]).ravel() for values in layers.values()]
    pose = _poses(middle[None], np.zeros(1))[0]
    size = {"length_x": cols * step, "length_y": rows * step}
    return {
        "info": {"resolution": step, **size, "pose": pose},
        "layers": list(layers),
        "basic_layers": list(layers)[:1],
        "data": [{"layout": {"dim": dim}, "data": values} for values in data],
    }


def ellipse_markers(
    field: CovarianceField, header: Any, spacing: float, magnify: float
) -> Iterator[dict[str, Any]]:
    """visualization_msgs/Marker: flat cylinders (type 3), and last the major axes (a line list)."""
    xy, covariance = sampled_covariances(field, spacing)
    major, minor, direction = position_axes(covariance)
    low, high = np.log(field.anchors("position_std"))
    shade = (np.log(np.maximum(major, 1e-9)) - low) / (high - low)
    # Blue and vermilion, which colour-blind people distinguish, of small and large deviations.
    sharp, degenerate = np.array([0.0, 0.45, 0.7, 0.7]), np.array([0.84, 0.37, 0.0, 0.7])
    colors = sharp + np.clip(shade, 0, 1)[:, None] * (degenerate - sharp)
    scale = np.stack([2 * magnify * major, 2 * magnify * minor], axis=1)
    scale = np.column_stack([np.maximum(scale, 1e-3), np.full(len(scale), _THICKNESS)])
    for n, pose in enumerate(_poses(xy, direction)):
        kind = {"header": header, "ns": "ellipses", "id": n, "type": 3}
        yield kind | {"pose": pose, "scale": scale[n], "color": colors[n]}
    arm = (magnify * major)[:, None] * np.stack([np.cos(direction), np.sin(direction)], 1)
    ends = np.stack([xy - arm, xy + arm], axis=1).reshape(-1, 2)
    points = np.column_stack([ends, np.full(len(ends), _THICKNESS)])
    lines = {"header": header, "ns": "axes", "type": 5, "points": points}
    black = np.array([0.0, 0.0, 0.0, 1.0])
    pose = _poses(np.zeros((1, 2)), np.zeros(1))[0]
    yield lines | {"pose": pose, "scale": np.array([0.02, 0.0, 0.0]), "color": black}


def _poses(xy: NDArray[Any], yaw: NDArray[Any]) -> Floats:
    """Position and quaternion, (n, 7)."""
    nothing = np.zeros((len(xy), 3))
    return np.column_stack([xy, nothing, np.sin(yaw / 2), np.cos(yaw / 2)])


def topics_of(names: Iterable[str]) -> dict[str, str]:
    """The topic of each path: its name as ROS allows it, with a number where that is taken."""
    topics: dict[str, str] = {}
    taken = set()
    for name in names:
        token = "_".join(re.findall("[A-Za-z0-9]+", name))
        token = token if token and not token[0].isdigit() else f"path_{token}".rstrip("_")
        numbered = (token if n == 1 else f"{token}_{n}" for n in itertools.count(1))
        topic = next(each for each in numbered if each not in taken)
        taken.add(topic)
        topics[name] = f"/locplan/path/{topic}"
    return topics


_INFINITE = "{sec: 9223372036, nsec: 854775807}"
# Integers, which rosbag2 reads from Humble on: keep the last, reliable, transient local, automatic.
_LATCHED = (
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {_INFINITE},"
    f" lifespan: {_INFINITE}, liveliness: 1, liveliness_lease_duration: {_INFINITE},"
    " avoid_ros_namespace_conventions: false}"
)


def bag(
    path: str | os.PathLike[str],
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
    path : path
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
        Minimum distance between ellipses [m], above 0.
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
    content = {"/locplan/map": map_message(grid)}
    if mask is not None:
        content["/locplan/mask"] = "nav_msgs/OccupancyGrid", occupancy_grid(grid, mask)
    if field is not None:
        layers = layers_of(field)
        markers = list(ellipse_markers(field, header, spacing, magnify))
        content |= field_messages(field, layers, header)
        content["/locplan/ellipses"] = "visualization_msgs/MarkerArray", {"markers": markers}
    topics = topics_of(paths or {})
    for name, route in (paths or {}).items():
        poses = [{"header": header, "pose": pose} for pose in _poses(route.xy, route.facing)]
        content[topics[name]] = "nav_msgs/Path", {"poses": poses}
    write_messages(path, content, header, stamp)


def write_messages(
    target: str | os.PathLike[str],
    content: Mapping[str, Message],
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


_NUMBERS = {"bool": "?", "int8": "b", "uint8": "B", "uint16": "H", "int32": "i", "uint32": "I"}
_NUMBERS |= {"float32": "f", "float64": "d"}


def schema(kind: str) -> str:
    """The definitions of a message type and of its parts, as MCAP's "ros2msg"."""
    types, used = _types(), [kind]
    for name in used:  # grows
        parts = (part.removesuffix("[]") for part, _ in types[name])
        used += [part for part in dict.fromkeys(parts) if part in types and part not in used]
    head = "=" * 80 + "\nMSG: "
    texts = (f"{head}{name}\n" + "\n".join(map(" ".join, types[name])) for name in used)
    return "\n".join(texts).removeprefix(f"{head}{kind}\n") + "\n"


def encode(kind: str, message: Mapping[str, Any]) -> bytes:
    """A message as CDR; fields that it does not hold are zero or empty.

    A value made of numbers of one type only, or a list of such values, may be an array.
    """
    out = bytearray()
    _append(out, kind, message)
    return b"\x00\x01\x00\x00" + out  # little-endian


def _append(out: bytearray, kind: str, value: Any) -> None:
    """Append a value as CDR: a number at a multiple of its size, a list behind its length."""
    item = kind.removesuffix("[]")
    if item != kind:
        _append(out, "uint32", 0 if value is None else len(value))
    if isinstance(value, np.ndarray):
        if value.size:
            code = np.dtype("<" + _code(item))
            _align(out, code.itemsize)
            out += np.ascontiguousarray(value, code).tobytes()
    elif item != kind:
        for one in value or ():
            _append(out, item, one)
    elif kind == "string":
        text = (value or "").encode() + b"\x00"
        _append(out, "uint32", len(text))
        out += text
    elif kind in _NUMBERS:
        _align(out, struct.calcsize(_NUMBERS[kind]))
        out += struct.pack("<" + _NUMBERS[kind], value or 0)
    else:
        for part, label in _types()[kind]:
            _append(out, part, value and value.get(label))


def _align(out: bytearray, size: int) -> None:
    out += bytes(-len(out) % size)


@cache
def _types() -> dict[str, list[list[str]]]:
    """The type and the name of each field of the messages, by the messages' types."""
    text = files("locplan.export").joinpath("templates/messages.msg").read_text("utf-8")
    parts = (part.split("\n") for part in text.split("MSG: ")[1:])
    return {name: [line.split() for line in lines if line] for name, *lines in parts}


@cache
def _code(kind: str) -> str:
    return _NUMBERS[kind] if kind in _NUMBERS else _code(_types()[kind][0][0])

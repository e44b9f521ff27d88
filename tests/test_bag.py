"""What `export.bag` writes, read back by PyPI's rosbags, which shares nothing with it."""

import math
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from locplan.costs import Path
from locplan.errors import LocplanError
from locplan.export import bag
from locplan.export._bags import schema
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Sad,
    SearchWindow,
    covariance_field,
    position_axes,
    scalar,
)
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

TOPICS = ("nav_msgs/OccupancyGrid", "nav_msgs/Path", "grid_map_msgs/GridMap")
TOPICS += ("visualization_msgs/MarkerArray", "foxglove_msgs/Grid")
# Read in foxglove/foxglove-sdk, its ROS 2 messages.
FOXGLOVE = {
    "Vector2": "float64 x\nfloat64 y\n",
    "PackedElementField": "string name\nuint32 offset\nuint8 type\n",
    "Grid": """builtin_interfaces/Time timestamp
string frame_id
geometry_msgs/Pose pose
uint32 column_count
foxglove_msgs/Vector2 cell_size
uint32 row_stride
uint32 cell_stride
foxglove_msgs/PackedElementField[] fields
uint8[] data
""",
}
# Read in ANYbotics/grid_map, branches humble and jazzy.
GRID_MAP = """std_msgs/Header header
grid_map_msgs/GridMapInfo info
string[] layers
string[] basic_layers
std_msgs/Float32MultiArray[] data
uint16 outer_start_index
uint16 inner_start_index
"""
GRID_MAP_INFO = "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose\n"


def cells() -> np.ndarray:
    """100 x 150 cells without any symmetry."""
    values = np.full((100, 150), FREE)
    values[[0, -1]] = values[:, [0, -1]] = OCCUPIED
    values[30:34, 20:90] = OCCUPIED
    values[60:, 110:113] = OCCUPIED
    values[70:82, 30:37] = UNKNOWN
    return values


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return OccupancyGrid(cells(), 0.05, (-3.2, 7.45, 0.0), "hall")


@pytest.fixture(scope="module")
def field(grid):
    return covariance_field(grid, FieldConfig(Sad(range=1.0)), threads=1)


@pytest.fixture(scope="module")
def mask():
    return np.random.default_rng(1).integers(-1, 101, (100, 150)).astype(np.int8)


@pytest.fixture(scope="module")
def paths():
    xy = np.array([[-3.0, 8.0], [-2.0, 8.0], [-2.0, 8.0], [-2.0, 10.0], [-2.5, 9.5]])
    return {"any-angle": Path(xy), "2: Dubins": Path(xy, np.linspace(-4, 2, 5))}


def typestore_of(store):
    """The types of a ROS distribution, and those that it does not bring."""
    types = get_types_from_msg(GRID_MAP, "grid_map_msgs/msg/GridMap")
    types |= get_types_from_msg(GRID_MAP_INFO, "grid_map_msgs/msg/GridMapInfo")
    for name, definition in FOXGLOVE.items():
        types |= get_types_from_msg(definition, f"foxglove_msgs/msg/{name}")
    typestore = get_typestore(store)
    typestore.register(types)
    return typestore


def read(file, store=Stores.ROS2_HUMBLE):
    """Messages by topic, and that rosbags would write the very same bytes."""
    typestore = typestore_of(store)
    messages = {}
    with AnyReader([file], default_typestore=typestore) as reader:
        for connection, time, data in reader.messages():
            messages[connection.topic] = typestore.deserialize_cdr(data, connection.msgtype)
            again = typestore.serialize_cdr(messages[connection.topic], connection.msgtype)
            assert bytes(again) == bytes(data), connection.topic
            assert (connection.msgcount, time) == (1, 0)
            own = reader.deserialize(data, connection.msgtype)  # by the schema in the file
            assert type(own).__name__ == type(messages[connection.topic]).__name__
    return messages


@pytest.fixture(scope="module")
def messages(tmp_path_factory, grid, field, mask, paths):
    file = tmp_path_factory.mktemp("bag") / "plan.mcap"
    bag(file, grid, mask=mask, field=field, paths=paths, spacing=0.6, magnify=2.0)
    return read(file)


@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
@pytest.mark.parametrize("kind", TOPICS)
def test_definitions_are_those_of_ros(store, kind):
    known = typestore_of(store)
    ours = get_types_from_msg(schema(kind), kind.replace("/", "/msg/"))
    assert len(ours) > 3
    for name, (_, fields) in ours.items():
        assert fields == known.fielddefs[name][1], name


def cell_positions(info):
    """grid_map's own index -> position: from the corner of highest x and y downwards."""
    size = round(info.length_x / info.resolution), round(info.length_y / info.resolution)
    first_x = info.pose.position.x + 0.5 * info.length_x - 0.5 * info.resolution
    first_y = info.pose.position.y + 0.5 * info.length_y - 0.5 * info.resolution
    for row in range(size[0]):
        for col in range(size[1]):
            yield row, col, first_x - row * info.resolution, first_y - col * info.resolution


def matrices(message):
    """Each layer as Eigen would map it, by its own dimensions: column-major."""
    result = {}
    for name, array in zip(message.layers, message.data, strict=True):
        outer, inner = array.layout.dim
        assert (outer.label, inner.label) == ("column_index", "row_index")
        assert outer.stride == outer.size * inner.size == array.data.size
        assert (inner.stride, array.layout.data_offset) == (inner.size, 0)
        result[name] = array.data.reshape((inner.size, outer.size), order="F")
    return result


def values_of(field):
    layers = {name: scalar(field.covariance, name) for name in ("e", "position_std")}
    if field.covariance.shape[-1] == 3:
        layers["heading_std"] = scalar(field.covariance, "heading_std")
    return layers | {"principal_axis": position_axes(field.covariance)[2]}


def test_occupancy_grid_is_the_mask_from_the_lower_left(messages, grid, mask):
    message = messages["/locplan/mask"]
    assert message.header.frame_id == "map"
    assert (message.info.width, message.info.height) == (150, 100)
    assert message.info.resolution == np.float32(0.05)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-3.2, 7.45)
    assert message.info.origin.orientation.w == 1.0
    for row, col in [(0, 0), (0, 149), (99, 0), (37, 101)]:
        x, y = grid.cell_to_world(row, col)
        i, j = math.floor((y - 7.45) / 0.05), math.floor((x + 3.2) / 0.05)
        assert message.data[i * 150 + j] == mask[row, col]
    assert (message.data.reshape(100, 150) == mask).all()


def test_grid_map_holds_the_field_where_grid_map_looks_for_it(messages, grid, field):
    message = messages["/locplan/field"]
    assert message.basic_layers == ["e"]
    assert (message.outer_start_index, message.inner_start_index) == (0, 0)
    assert message.info.pose.orientation.w == 1.0
    layers, expected = matrices(message), values_of(field)
    assert list(layers) == list(expected)
    seen = set()
    for row, col, x, y in cell_positions(message.info):
        i, j = ((v - 0.5) / field.stride for v in grid.world_to_grid(x, y))
        assert abs(i - round(i)) + abs(j - round(j)) < 1e-6
        seen.add((round(i), round(j)))
        for name, values in expected.items():
            assert layers[name].shape == values.shape[::-1]
            one = np.float32(values[round(i), round(j)])
            np.testing.assert_array_equal(layers[name][row, col], one)
    assert len(seen) == expected["e"].size
    assert np.isnan(layers["e"]).any()


@pytest.mark.parametrize(("yaw", "stride"), [(0.4, 0.2), (math.pi / 2, 0.1), (-2.5, 0.2)])
def test_grid_map_of_a_turned_map_takes_the_nearest_point(tmp_path, yaw, stride):
    grid = OccupancyGrid(cells(), 0.05, (2.0, -1.0, yaw))
    config = FieldConfig(stride=stride)
    h, w = (len(range(0, n, round(stride / 0.05))) for n in grid.shape)
    factor = np.random.default_rng(2).normal(size=(h, w, 3, 3))
    field = CovarianceField(factor @ factor.swapaxes(-1, -2), grid, config)
    bag(tmp_path / "a.mcap", grid, field=field, mask=np.zeros(grid.shape, np.int8))
    messages = read(tmp_path / "a.mcap")
    turn = messages["/locplan/mask"].info.origin.orientation
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(yaw)
    message = messages["/locplan/field"]
    layers, expected, seen = matrices(message), values_of(field), set()
    for row, col, x, y in cell_positions(message.info):
        i, j = (round((float(v) - 0.5) / field.stride) for v in grid.world_to_grid(x, y))
        inside = 0 <= i < h and 0 <= j < w
        seen |= {(i, j)} if inside else set()
        for name, values in expected.items():
            one = np.float32(values[i, j]) if inside else np.nan
            np.testing.assert_array_equal(layers[name][row, col], one)
    assert len(seen) == h * w  # none is lost
    assert message.info.resolution == pytest.approx(stride * (1 if yaw == math.pi / 2 else 2 / 3))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_foxgloves_grid_has_each_value_at_its_place(tmp_path, yaw):
    grid = OccupancyGrid(cells(), 0.05, (-3.2, 7.45, yaw), "hall")
    field = covariance_field(grid, FieldConfig(Sad(range=0.5), stride=0.4), threads=1)
    bag(tmp_path / "a.mcap", grid, field=field)
    message = read(tmp_path / "a.mcap")["/locplan/grid"]
    corner, turn = message.pose.position, yaw_of(message.pose)
    expected, found = values_of(field), np.frombuffer(message.data.tobytes(), "<f4")
    found = found.reshape(-1, message.row_stride // message.cell_stride, len(message.fields))
    assert [(one.name, one.offset, one.type) for one in message.fields] == [
        (name, 4 * n, 7) for n, name in enumerate(expected)
    ]
    assert message.column_count == found.shape[1]
    for (i, j), _ in np.ndenumerate(field.evaluated):
        u, v = (j + 0.5) * message.cell_size.x, (i + 0.5) * message.cell_size.y
        x = corner.x + math.cos(turn) * u - math.sin(turn) * v
        y = corner.y + math.sin(turn) * u + math.cos(turn) * v
        at = grid.grid_to_world(i * field.stride + 0.5, j * field.stride + 0.5)
        assert (x, y) == pytest.approx(at)
        for n, values in enumerate(expected.values()):
            np.testing.assert_array_equal(found[i, j, n], np.float32(values[i, j]))


def yaw_of(pose):
    assert (pose.orientation.x, pose.orientation.y) == (0, 0)
    return 2 * math.atan2(pose.orientation.z, pose.orientation.w)


def test_paths_face_where_they_go_or_as_they_say(messages, paths):
    free = messages["/locplan/path/any_angle"].poses
    xy = [(pose.pose.position.x, pose.pose.position.y) for pose in free]
    assert xy == [tuple(point) for point in paths["any-angle"].xy]
    back = math.atan2(-0.5, -0.5)
    expected = [0, math.pi / 2, math.pi / 2, back, back]
    assert [yaw_of(pose.pose) for pose in free] == pytest.approx(expected)
    given = messages["/locplan/path/path_2_Dubins"].poses
    turns = np.array([yaw_of(pose.pose) for pose in given]) - paths["2: Dubins"].heading
    assert np.cos(turns) == pytest.approx(1)
    assert {pose.header.frame_id for pose in given} == {"map"}


def test_ellipses_lie_along_the_covariance(messages, grid, field):
    *ellipses, axes = messages["/locplan/ellipses"].markers
    assert len({(marker.ns, marker.id) for marker in [*ellipses, axes]}) == len(ellipses) + 1
    assert len(ellipses) > 20
    ends = np.array([(p.x, p.y) for p in axes.points]).reshape(-1, 2, 2)
    for marker, (begin, end) in zip(ellipses, ends, strict=True):
        assert (marker.type, marker.action, marker.lifetime.sec) == (3, 0, 0)
        x, y = marker.pose.position.x, marker.pose.position.y
        i, j = (round((float(v) - 0.5) / field.stride) for v in grid.world_to_grid(x, y))
        assert np.allclose(grid.cell_to_world(i * field.stride, j * field.stride), (x, y))
        yaw = yaw_of(marker.pose)
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        spread = np.diag([marker.scale.x / 4, marker.scale.y / 4]) ** 2  # 2 sd, twice magnified
        assert turn @ spread @ turn.T == pytest.approx(field.covariance[i, j, :2, :2])
        assert (begin + end) / 2 == pytest.approx((x, y))
        assert math.dist(begin, end) == pytest.approx(marker.scale.x)
        assert (end - begin) / marker.scale.x == pytest.approx(turn[:, 0])
        assert 0 <= marker.color.r <= 1
        assert marker.color.a == pytest.approx(0.7)


def test_fields_without_rotation_or_with_headings(tmp_path, grid):
    config = FieldConfig(Sad(window=SearchWindow(half_rotation_deg=0)))
    h, w = 25, 38
    covariance = np.tile(np.diag([0.04, 0.09]), (h, w, 1, 1))
    bag(tmp_path / "a.mcap", grid, field=CovarianceField(covariance, grid, config))
    message = read(tmp_path / "a.mcap")["/locplan/field"]
    assert message.layers == ["e", "position_std", "principal_axis"]
    covariance = np.tile(np.diag([0.04, 0.09, 0.01]), (h, w, 2, 1, 1))
    covariance[:, :, 1, 0, 0] = 0.02
    field = CovarianceField(covariance, grid, FieldConfig())
    bag(tmp_path / "b.mcap", grid, field=field)
    values = matrices(read(tmp_path / "b.mcap")["/locplan/field"])
    mean = 2 / (1 / 0.04 + 1 / 0.02)
    assert values["e"] == pytest.approx(math.sqrt(mean * 0.09 * 0.01))


def test_the_same_input_gives_the_same_bytes_and_latched_topics(tmp_path, grid, mask, paths):
    for name in "ab":
        bag(
            tmp_path / f"{name}.mcap", grid, mask=mask, paths=paths, stamp=1_700_000_000_000_000_005
        )
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert message.log_time == 1_700_000_000_000_000_005
            assert "durability: 1" in channel.metadata["offered_qos_profiles"]
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            assert (qos.durability.name, qos.history.name) == ("TRANSIENT_LOCAL", "KEEP_LAST")
            assert (qos.reliability.name, qos.liveliness.name) == ("RELIABLE", "AUTOMATIC")
        (_, _, data), *_ = reader.messages()
        stamp = reader.deserialize(data, "nav_msgs/msg/OccupancyGrid").header.stamp
        assert (stamp.sec, stamp.nanosec) == (1_700_000_000, 5)


def test_what_cannot_be_written_says_so(tmp_path, grid, field, mask, paths, monkeypatch):
    file = tmp_path / "a.mcap"
    other = OccupancyGrid(grid.cells, 0.05, (1.0, 0.0, 0.0))
    for wrong in (
        {"field": CovarianceField(field.covariance, other, field.config)},
        {"mask": mask[:50]},
        {"mask": mask.astype(float)},
        {"mask": mask.astype(int) + 1},
        {"stamp": -1},
        {"spacing": 0.0},
    ):
        with pytest.raises(LocplanError) as fault:
            bag(file, grid, **wrong)
        assert "\n" not in str(fault.value)
        assert not file.exists()
    monkeypatch.setitem(sys.modules, "mcap", None)
    with pytest.raises(LocplanError, match=r"locplan\[ros\]"):
        bag(file, grid, mask=mask)

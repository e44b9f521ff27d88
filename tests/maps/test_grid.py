import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from support.maps import ascii_map

from locplan.errors import MapError, PoseError
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def test_cell_accepts_position_array():
    grid = OccupancyGrid(np.full((4, 6), FREE), 0.5, (10.0, 20.0, 0.3))
    xy = np.random.default_rng(2).uniform((8, 18), (14, 24), (40, 2))
    rows, cols = grid.cell(xy)
    assert [*zip(rows, cols, strict=True)] == [grid.cell(position) for position in xy]
    single = [grid.contains(*grid.cell(position)) for position in xy]
    assert grid.contains(rows, cols).tolist() == single
    assert 0 < sum(single) < 40
    with pytest.raises(PoseError, match="pose 3 of the array"):
        grid.cell([*xy[:3], (np.nan, 1.0)])


def test_cell_ignores_headings():
    grid = OccupancyGrid(np.full((4, 6), FREE), 0.5, (10.0, 20.0, 0.3))
    poses = np.random.default_rng(2).uniform((8, 18, -9), (14, 24, 9), (40, 3))
    np.testing.assert_array_equal(grid.cell(poses), grid.cell(poses[:, :2]))
    assert grid.cell(poses[0]) == grid.cell(tuple(poses[0, :2]))


def test_position_accepts_cell_arrays():
    grid = OccupancyGrid(np.full((4, 6), FREE), 0.5, (10.0, 20.0, 0.3))
    cells = np.argwhere(grid.free)
    xy = grid.position(*cells.T)
    assert xy.tolist() == [list(grid.position(*cell)) for cell in cells.tolist()]
    np.testing.assert_array_equal(np.column_stack(grid.cell(xy)), cells)


def test_row_zero_has_lowest_y():
    grid = ascii_map(
        "#..",
        "...",
        resolution=0.5,
        origin=(10.0, 20.0, 0.0),
    )
    assert grid.cells[1, 0] == OCCUPIED
    assert grid.cell((10.1, 20.9)) == (1, 0)
    assert grid.position(1, 0) == (10.25, 20.75)


@pytest.mark.parametrize("yaw", [0.0, 0.3, -2.0, np.pi / 2])
def test_world_and_cells_are_inverse(yaw):
    grid = OccupancyGrid(np.full((7, 9), FREE), 0.1, (3.0, -4.0, yaw))
    for row, col in np.ndindex(grid.shape):
        assert grid.cell(grid.position(row, col)) == (row, col)
    x, y = grid.grid_to_world(2.25, 3.75)
    np.testing.assert_allclose(grid.world_to_grid(x, y), (2.25, 3.75))


def test_yaw_turns_axes_counter_clockwise():
    grid = OccupancyGrid(np.full((4, 4), FREE), 1.0, (0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(grid.grid_to_world(0.0, 2.0), (0.0, 2.0), atol=1e-12)


def test_grid_does_not_contain_outside_positions():
    grid = OccupancyGrid(np.full((4, 4), FREE), 1.0)
    assert grid.cell((-0.1, 5.0)) == (5, -1)
    assert not grid.contains(5, -1)


def test_clearance_is_distance_to_occupied_cell():
    """The distance ends at the cell's edge, not at its centre."""
    rng = np.random.default_rng(1)
    cells = np.where(rng.random((20, 23)) < 0.04, OCCUPIED, FREE).astype(np.uint8)
    grid = OccupancyGrid(cells, 0.05)
    rows, cols = np.nonzero(cells == OCCUPIED)
    for row, col in np.ndindex(cells.shape):
        gap_row = np.maximum(np.abs(rows - row) - 0.5, 0)
        gap_col = np.maximum(np.abs(cols - col) - 0.5, 0)
        expected = 0.05 * np.hypot(gap_row, gap_col).min()
        assert grid.clearance[row, col] == pytest.approx(expected, rel=1e-5)


def test_without_walls_clearance_is_infinite():
    assert np.isinf(ascii_map("..", "..").clearance).all()


def test_digest_depends_on_content_not_name():
    grid = OccupancyGrid(np.full((4, 4), FREE), 0.1, name="a")
    assert grid.digest == OccupancyGrid(grid.cells, 0.1, name="b").digest
    assert grid.digest != OccupancyGrid(grid.cells, 0.2).digest
    assert grid.digest != OccupancyGrid(grid.cells.reshape(2, 8), 0.1).digest


def test_digest_depends_on_origin():
    cells = np.full((4, 4), FREE)
    assert OccupancyGrid(cells, 0.1).digest != OccupancyGrid(cells, 0.1, (0, 0, 0.1)).digest


def test_occupancy_values_of_ros_become_levels():
    grid = OccupancyGrid.from_occupancy([[0, 19, 20, 64], [65, 100, -1, 50]], 0.1)
    assert grid.cells.tolist() == [
        [FREE, FREE, UNKNOWN, UNKNOWN],
        [OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN],
    ]


def test_cell_rejects_infinite_position():
    grid = OccupancyGrid(np.full((4, 4), FREE), 1.0)
    with pytest.raises(PoseError, match="finite"):
        grid.cell((np.inf, 0.0))


def test_cells_are_copied_and_read_only():
    cells = np.full((3, 3), FREE, np.uint8)
    grid = OccupancyGrid(cells, 0.1)
    cells[0, 0] = OCCUPIED
    assert grid.cells[0, 0] == FREE
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = OCCUPIED


@pytest.mark.parametrize(
    ("cells", "resolution", "origin", "message"),
    [
        (np.zeros(4), 0.1, (0, 0, 0), "non-empty"),
        (np.zeros((0, 4)), 0.1, (0, 0, 0), "non-empty"),
        (np.full((2, 2), 100), 0.1, (0, 0, 0), "may only hold"),
        (np.full((2, 2), np.nan), 0.1, (0, 0, 0), "may only hold"),
        (np.zeros((2, 2)), 0.0, (0, 0, 0), "resolution"),
        (np.zeros((2, 2)), np.inf, (0, 0, 0), "resolution"),
        (np.zeros((2, 2)), "fine", (0, 0, 0), "resolution"),
        (np.zeros((2, 2)), 0.1, (0, np.nan, 0), "origin"),
        (np.zeros((2, 2)), 0.1, (0, 0), "origin"),
    ],
)
def test_unusable_grids_are_refused(cells, resolution, origin, message):
    with pytest.raises(MapError, match=message):
        OccupancyGrid(cells, resolution, origin)


def test_true_is_occupied():
    grid = OccupancyGrid.from_occupancy([[True, False]], 0.1)
    assert grid.cells.tolist() == [[OCCUPIED, FREE]]


def test_from_occupancy_accepts_declared_probabilities():
    values = [[0.0, 0.195, 0.2], [0.65, 1.0, math.nan]]
    grid = OccupancyGrid.from_occupancy(values, 0.1, probabilities=True)
    assert grid.cells.tolist() == [[FREE, FREE, UNKNOWN], [OCCUPIED, OCCUPIED, UNKNOWN]]


@pytest.mark.parametrize(
    ("values", "probabilities", "remedy"),
    [
        ([[0, 1]], False, "give a bool array"),
        ([[-1, 1]], False, "give a bool array"),
        ([[0.0, 1.0]], False, "set probabilities=True"),
        ([[0, 255]], False, "there is 255; an image is read by locplan.load_map"),
        ([[0, -2]], False, "there is -2"),
        ([["wall"]], False, "is ambiguous"),
        ([[0, 100], [0]], False, "must be an array"),
        ([[0.0, 1.5]], True, "0.0 to 1.0, or NaN where unknown, but there is 1.5"),
        ([[0.0, -1.0]], True, "there is -1"),
        ([[0.0, math.inf]], True, "there is inf"),
        ([["wall"]], True, "must be numbers"),
    ],
)
def test_from_occupancy_rejects_ambiguous_values(values, probabilities, remedy):
    with pytest.raises(MapError, match=remedy):
        OccupancyGrid.from_occupancy(values, 0.1, probabilities=probabilities)


def make_message(data, yaw=0.0):
    """Return an object with the fields of a nav_msgs/OccupancyGrid of 2 rows and 3 columns."""
    position = SimpleNamespace(x=-1.0, y=2.0, z=0.0)
    orientation = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    origin = SimpleNamespace(position=position, orientation=orientation)
    info = SimpleNamespace(height=2, width=3, resolution=0.5, origin=origin)
    return SimpleNamespace(info=info, data=data)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -2.5])
def test_from_message_reads_cells_and_origin(yaw):
    grid = OccupancyGrid.from_message(make_message([0, 100, -1, 0, 0, 0], yaw), "lab")
    assert grid.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, FREE]]
    assert (grid.resolution, grid.name) == (0.5, "lab")
    np.testing.assert_allclose(grid.origin, (-1.0, 2.0, yaw), atol=1e-12)


@pytest.mark.parametrize("wrong", [make_message([0, 100]), make_message(None), [0, 100], None])
def test_from_message_rejects_other_objects(wrong):
    with pytest.raises(MapError, match="nav_msgs/OccupancyGrid"):
        OccupancyGrid.from_message(wrong)


@pytest.mark.parametrize(
    ("cells", "remedy"), [([0, 254], "from_message"), ([[0, 100]], "from_occupancy")]
)
def test_constructor_error_suggests_matching_method(cells, remedy):
    with pytest.raises(MapError, match=remedy):
        OccupancyGrid(cells, 0.1)


def test_cells_stay_read_only_when_pickled():
    grid = pickle.loads(pickle.dumps(OccupancyGrid(np.full((2, 2), FREE), 0.1)))
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = OCCUPIED

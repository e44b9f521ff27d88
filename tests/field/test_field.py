import dataclasses
import itertools
import math
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.linalg import expm, logm
from support.cases import sample_cases
from support.fields import change_estimator
from support.maps import ascii_map, corridor, random_rooms

from locplan.errors import ConfigError, FieldError, PoseError
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Fisher,
    Fused,
    Sad,
    Scan,
    SearchWindow,
    covariance_field,
    position_axes,
    sample_covariances,
    scalar,
    tiles,
)
from locplan.field.config import config_from_settings
from locplan.field.covariance import SCALARS
from locplan.field.estimator import MapPart
from locplan.maps import FREE, UNKNOWN, OccupancyGrid, environments
from locplan.robots import Lidar

QUICK = FieldConfig(Sad(range=1.0, window=SearchWindow(half_width=0.6, step=0.2)))
STILL = SearchWindow(half_width=QUICK.estimator.window.half_width, half_rotation_deg=0)
"""A small disc and window: the physics are the same."""


@pytest.fixture(scope="module")
def rooms() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((120, 140), seed=8), 0.05, (-1.0, 2.0, 0.0), name="rooms")


@pytest.fixture(scope="module")
def field(rooms) -> CovarianceField:
    return covariance_field(rooms, QUICK)


def covariance_at(grid: OccupancyGrid, row: int, col: int, config=QUICK):
    at = np.array([row]), np.array([col])
    return config_from_settings(config).estimator.covariances(
        MapPart.from_map(grid.cells, *at, grid.resolution)
    )["covariance"][0]


def test_quarter_turn_turns_covariance(rooms):
    turned = OccupancyGrid(rooms.cells.T[:, ::-1], rooms.resolution)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for row, col in np.argwhere(rooms.free)[::1500]:
        expected = turn @ covariance_at(rooms, row, col) @ turn.T
        result = covariance_at(turned, col, rooms.shape[0] - 1 - row)
        np.testing.assert_allclose(result, expected, atol=1e-9)


def test_padding_shifts_field(rooms):
    pad = 8  # two lattice points on each side: the map's centre stays where it is
    padded = OccupancyGrid(
        np.pad(rooms.cells, pad, constant_values=UNKNOWN),
        rooms.resolution,
        (rooms.origin[0] - pad * 0.05, rooms.origin[1] - pad * 0.05, 0.0),
    )
    inner, outer = covariance_field(rooms, QUICK), covariance_field(padded, QUICK)
    np.testing.assert_array_equal(outer.covariance[2:-2, 2:-2], inner.covariance)


def test_map_shift_barely_changes_field(rooms):
    # The map turns about its centre, so that only the rounding of turned cells differs.
    shifted = OccupancyGrid(
        np.pad(rooms.cells, ((4, 0), (12, 0)), constant_values=UNKNOWN), rooms.resolution
    )
    near = np.log(covariance_field(rooms, QUICK).e) - np.log(
        covariance_field(shifted, QUICK).e[1:, 3:]
    )
    assert np.nanmedian(np.abs(near)) < 0.05
    still = change_estimator(QUICK, window=STILL)
    np.testing.assert_array_equal(
        covariance_field(shifted, still).covariance[1:, 3:],
        covariance_field(rooms, still).covariance,
    )


def test_covariances_are_symmetric_and_positive(field):
    matrices = field.covariance[field.is_evaluated]
    np.testing.assert_array_equal(matrices, matrices.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(matrices).min() > 0


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2])
@pytest.mark.parametrize(("preset", "ratio"), [(Sad, 3.0), (Sad.paper, 1.8)])
def test_corridor_is_least_certain_along_axis(angle, preset, ratio):
    # Sampled walls that run obliquely are not quite featureless, and 1/S^2 notices it.
    grid = corridor(24.0, 2.0, angle=angle)
    row, col = grid.cell((0.0, 0.0))
    major, minor, direction = position_axes(covariance_at(grid, row, col, preset()))
    assert major > ratio * minor
    assert abs(np.angle(np.exp(2j * (direction - angle)))) / 2 < 0.03


def test_featureless_place_has_uniform_covariance():
    config = FieldConfig()
    window = config.estimator.window.to_lattice(0.1)
    grid = OccupancyGrid(np.full((200, 200), FREE), 0.1)
    covariance = covariance_at(grid, 100, 100, config)
    expected = window.uniform_covariance + window.quantisation
    np.testing.assert_allclose(covariance, expected, rtol=1e-13, atol=1e-15)
    assert covariance[0, 0] == pytest.approx(0.2**2 * (21**2 - 1) / 12 + 0.2**2 / 12)


def test_covariance_is_in_world_frame():
    cells = corridor(16.0, 2.0).cells
    config = FieldConfig(Sad(range=3.0), stride=1.0)
    plain = covariance_field(OccupancyGrid(cells, 0.05), config)
    turned = covariance_field(OccupancyGrid(cells, 0.05, (1.0, 2.0, 0.7)), config)
    middle = tuple(size // 2 for size in plain.covariance.shape[:2])
    _, _, direction = position_axes(turned.covariance[middle])
    assert direction == pytest.approx(0.7, abs=0.05)
    np.testing.assert_allclose(turned.e, plain.e, rtol=1e-9)


def test_parallel_field_equals_serial_field(rooms):
    serial = covariance_field(rooms, QUICK, threads=1)
    np.testing.assert_array_equal(covariance_field(rooms, QUICK, threads=3).e, serial.e)


def test_progress_counts_every_cell_once(rooms):
    seen = []
    field = covariance_field(rooms, QUICK, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (field.is_evaluated.sum(), field.is_evaluated.sum())
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


@pytest.mark.parametrize("template", ["disc", "visible"])
@pytest.mark.parametrize("stride", sample_cases([0.15, 0.05, 0.2]))
def test_field_ignores_tile_size(template, stride, monkeypatch):
    cells = random_rooms((70, 80), seed=2, blocks=5)
    cells[np.random.default_rng(3).random(cells.shape) < 0.02] = 0
    grid = OccupancyGrid(cells, 0.05)
    config = dataclasses.replace(change_estimator(QUICK, template=template), stride=stride)
    whole = covariance_field(grid, config)
    monkeypatch.setattr("locplan.field.tiles.TILE", 7)
    np.testing.assert_array_equal(covariance_field(grid, config).covariance, whole.covariance)
    i, j = (index[::9] for index in np.nonzero(whole.is_evaluated))
    at = i * whole.stride, j * whole.stride
    alone = config.estimator.covariances(MapPart.from_map(grid.cells, *at, grid.resolution))
    np.testing.assert_array_equal(whole.covariance[i, j], alone["covariance"])


def test_e_map_covers_exactly_free_cells(field):
    e = field.e_map()
    np.testing.assert_array_equal(np.isfinite(e), field.grid.free)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("stride", [1, 3, 4, 50])
def test_free_cells_have_lattice_points(seed, stride):
    free = np.random.default_rng(seed).random((23, 31)) < 0.05
    grid = OccupancyGrid(np.where(free, FREE, UNKNOWN).astype(np.uint8), 0.1)
    wanted = FieldConfig(stride=stride * 0.1).lattice_points(grid)
    for row, col in np.argwhere(free):
        i, j = row // stride, col // stride
        i1 = min(i + (row % stride > 0), wanted.shape[0] - 1)
        j1 = min(j + (col % stride > 0), wanted.shape[1] - 1)
        assert wanted[[i, i, i1, i1], [j, j1, j, j1]].any()


def test_single_cell_stride_evaluates_free_cells():
    grid = ascii_map("..#", " .#", resolution=0.05)
    field = covariance_field(grid, FieldConfig(Sad(range=0.2), stride=0.05))
    np.testing.assert_array_equal(field.is_evaluated, grid.free)
    np.testing.assert_allclose(field.e_map()[grid.free], field.e[grid.free])


def test_field_is_empty_without_free_cells():
    field = covariance_field(ascii_map("##", "  "), FieldConfig())
    assert not field.is_evaluated.any()
    assert np.isnan(field.e_map()).all()
    assert field.saturated_share == 0.0


def test_field_at_equals_lattice_and_map(field):
    i, j = np.argwhere(field.is_evaluated & field.grid.free[::4, ::4])[100]
    x, y = field.grid.position(int(i) * 4, int(j) * 4)
    np.testing.assert_allclose(field.at((x, y), "covariance"), field.covariance[i, j], rtol=1e-9)
    e_map, cells = field.e_map(), np.argwhere(field.grid.free)[::97]
    xy = np.column_stack(field.grid.grid_to_world(*(cells + 0.5).T))
    np.testing.assert_allclose(field.at(xy, "e"), e_map[tuple(cells.T)], rtol=1e-6)


def test_field_at_array_equals_single_poses(field):
    random = np.random.default_rng(1)
    poses = np.column_stack([random.uniform(-1, 13, (50, 2)), random.uniform(-9, 9, 50)])
    values = field.at(poses)
    assert list(values) == ["covariance", *SCALARS, *field.layers]
    assert 5 < np.isnan(values["e"]).sum() < 45
    for name, array in values.items():
        single = np.array([field.at(pose, name) for pose in poses])
        np.testing.assert_array_equal(array, single)
        np.testing.assert_array_equal(field.at(poses, name), array)
    for name in SCALARS:
        np.testing.assert_array_equal(scalar(values["covariance"], name), values[name])


def test_field_at_averages_matrix_logarithms(field):
    """SciPy computes the logarithms of the four corners around a position; ln e is bilinear."""
    known = field.is_evaluated & field.grid.free[::4, ::4]
    inner = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    i, j = np.argwhere(inner)[40]
    corners = {(0, 0): 0.75 * 0.25, (1, 0): 0.25**2, (0, 1): 0.75**2, (1, 1): 0.25 * 0.75}
    logs = [w * logm(field.covariance[i + k, j + m]) for (k, m), w in corners.items()]
    expected = expm(sum(logs))
    xy = np.array(field.grid.grid_to_world(4 * i + 1.5, 4 * j + 3.5))
    np.testing.assert_allclose(field.at(xy, "covariance"), expected, rtol=1e-8, atol=1e-12)
    log_e = sum(w * math.log(field.e[i + k, j + m]) for (k, m), w in corners.items())
    assert math.log(field.at(xy, "e")) == pytest.approx(log_e)


def test_walls_and_outside_have_no_values(field):
    wall = field.grid.position(*np.argwhere(~field.grid.free)[0].tolist())
    for value in field.at([wall, (1e6, 0.0), (-1e8, 1e8)]).values():
        assert np.isnan(value).all()
    assert field.at(np.empty((0, 2)), "e").shape == (0,)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ([[1.0, 2.0], [math.nan, 2.0]], r"pose 1 of the array must be finite .* not nan,2"),
        ((1.0, math.inf), r"a pose must be finite numbers within"),
        ((1.0,), r"\(n, 2\) or \(n, 3\) array.*shape \(1,\)"),
        (np.zeros((2, 4)), r"not an array of shape \(2, 4\)"),
        ("here", "not 'here'"),
    ],
)
def test_field_at_rejects_other_arrays(field, poses, message):
    with pytest.raises(PoseError, match=message):
        field.at(poses)


def test_field_at_rejects_unknown_names(field):
    with pytest.raises(ConfigError, match=r"name must be one of covariance, e, .*'position_std'"):
        field.at((1.0, 1.0), "position_sdt")


def test_anchors_bound_e(field):
    low, high = field.anchors()
    assert low * 0.999 <= np.nanmin(field.e) <= np.nanmax(field.e) <= high * 1.001


def test_anchors_scale_with_noise_level():
    grid = OccupancyGrid(np.full((3, 3), FREE), 0.05)
    fields = [covariance_field(grid, change_estimator(QUICK, noise_level=k)) for k in (1.0, 4.0)]
    for name in ("position_std", "heading_std"):
        (low, high), (low4, high4) = (field.anchors(name) for field in fields)
        assert low4 == low
        assert high4**2 - low**2 == pytest.approx(4 * (high**2 - low**2))


def test_saturated_share_counts_least_e_points():
    places = environments.make("places", resolution=0.1)
    field = covariance_field(places, FieldConfig(stride=0.5))
    e = field.e[field.is_evaluated]
    expected = np.mean(e <= 1.05 * field.anchors()[0])
    assert field.saturated_share == pytest.approx(expected)
    assert 0 < expected < 1


def test_scalars_of_diagonal_covariance_are_exact():
    matrix = np.diag([4.0, 9.0, 0.25])
    values = [float(scalar(matrix, name)) for name in SCALARS]
    assert values == pytest.approx([3.0, 3.0, math.sqrt(13.0), 0.5])


def test_threads_below_one_are_refused(rooms):
    with pytest.raises(ConfigError, match="threads"):
        covariance_field(rooms, QUICK, threads=0)


def test_interrupted_field_stops_threads(monkeypatch):
    interrupted = threading.Event()

    def interrupt(done, total):
        if done:
            interrupted.set()
            raise KeyboardInterrupt

    controls, turns = [], itertools.count()
    compute = Sad.covariances

    def spy(self, part):
        controls.append(part.control)
        if next(turns):  # one tile is finished first, however busy the machine is
            interrupted.wait()
        return compute(self, part)

    monkeypatch.setattr(Sad, "covariances", spy)
    grid = environments.make("office")
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        covariance_field(grid, progress=interrupt)
    assert threading.active_count() == before
    assert 0 < sum(control[1] for control in controls) < 27_655  # of all


def test_interrupted_field_cancels_executor_tasks(rooms, monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.TILE", 2)
    calls = []
    compute = Sad.covariances
    monkeypatch.setattr(Sad, "covariances", lambda *task: calls.append(1) or compute(*task))

    def interrupt(done, total):
        raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt):
        covariance_field(rooms, QUICK, executor=executor, progress=interrupt)
    interrupted = len(calls)
    covariance_field(rooms, QUICK)
    assert interrupted < (len(calls) - interrupted) / 2


LIDAR = Lidar(range=20.0, beams=360, field_of_view_deg=180.0)


@pytest.mark.parametrize(
    "estimator",
    [
        Sad(),
        Sad(range=20.0),
        Sad(range=20.0, template="visible"),
        Sad.paper(range=30.0),
        Sad(window=SearchWindow(half_width=6.0, step=0.05)),
        Fisher(LIDAR),
        Scan(LIDAR),
        Fused(LIDAR),
    ],
)
@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.5])
@pytest.mark.parametrize("stride", [0.02, 0.2])
def test_tile_size_is_bounded_by_cost(estimator, resolution, stride):
    config = FieldConfig(estimator, stride=stride)
    edge = tiles.compute_chunk_edge(config, resolution)
    seconds = config.headings * estimator.seconds(resolution)
    assert edge**2 * seconds <= 2.0 or edge == 1
    greatest = min(tiles.TILE, tiles.TILE_CELLS // config.stride_cells(resolution))
    assert (edge + 1) ** 2 * seconds > 2.0 or edge == greatest


def test_covariance_without_rotation_is_positional(rooms):
    field = covariance_field(
        rooms,
        change_estimator(QUICK, window=STILL),
    )
    assert field.covariance.shape[2:] == (2, 2)
    expected = np.sqrt(np.linalg.det(field.covariance[field.is_evaluated]))
    np.testing.assert_allclose(field.e[field.is_evaluated], expected)


def edit_map(grid: OccupancyGrid, at=(60, 60), size=3) -> OccupancyGrid:
    cells = grid.cells.copy()
    row, col = at
    cells[row : row + size, col : col + size] = 254 - cells[row, col] // 254 * 254
    return dataclasses.replace(grid, cells=cells)


@pytest.mark.parametrize("template", ["disc", "visible"])
@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_update_equals_full_computation(template, yaw):
    """It computes less than half of the points."""
    cells = random_rooms((140, 150), seed=3, blocks=8)
    grid = OccupancyGrid(cells, 0.05, (0.0, 0.0, yaw))
    config = change_estimator(QUICK, template=template)
    before = covariance_field(grid, config)
    for at in (0, 0), (60, 60), (137, 100):
        after = edit_map(grid, at)
        progress = []
        updated = before.update(after, progress=lambda *numbers, to=progress: to.append(numbers))
        full = covariance_field(after, config)
        np.testing.assert_array_equal(updated.covariance, full.covariance)
        assert updated.grid is after
        assert 0 < progress[-1][1] < full.is_evaluated.sum() / 2


def test_update_follows_changes_of_free_space(rooms, field):
    cells = rooms.cells.copy()
    cells[20:60, 20:60] = UNKNOWN
    cells[80:90, 80:90] = FREE
    after = dataclasses.replace(rooms, cells=cells)
    full = covariance_field(after, QUICK)
    np.testing.assert_array_equal(field.update(after).covariance, full.covariance)


def test_update_computes_only_selected_points(rooms, field):
    cells = rooms.cells.copy()
    cells[20:60, 20:60] = UNKNOWN
    after = dataclasses.replace(rooms, cells=cells)
    full = covariance_field(after, QUICK)
    points = np.zeros(full.is_evaluated.shape, bool)
    points[:, : points.shape[1] // 4] = True
    updated = field.update(after, points=points)
    known = ~np.isnan(updated.covariance[..., 0, 0])
    assert (known & points == full.is_evaluated & points).all()
    assert known.sum() < full.is_evaluated.sum()
    np.testing.assert_array_equal(updated.covariance[known], full.covariance[known])


def test_update_of_unchanged_map_computes_nothing(rooms, field):
    def complain(done, total):
        raise AssertionError

    updated = field.update(dataclasses.replace(rooms, name="again"), progress=complain)
    np.testing.assert_array_equal(updated.covariance, field.covariance)


@pytest.mark.parametrize(
    "change", [{"resolution": 0.1}, {"origin": (0.0, 0.0, 0.0)}, {"cells": np.full((9, 9), FREE)}]
)
def test_update_rejects_other_map_geometry(rooms, field, change):
    with pytest.raises(FieldError, match="compute a new field"):
        field.update(dataclasses.replace(rooms, **change))


def test_executor_error_has_one_line(rooms):
    def fail():
        raise RuntimeError("worker 3 died:\n  out of memory\n")

    class Broken(ThreadPoolExecutor):
        def submit(self, *_, **__):
            return super().submit(fail)

    with Broken(1) as executor, pytest.raises(FieldError) as caught:
        covariance_field(rooms, QUICK, executor=executor)
    assert str(caught.value).endswith("(RuntimeError: worker 3 died: out of memory)")


def test_sampled_positions_cover_field_evenly():
    grid = OccupancyGrid(random_rooms((90, 130), seed=4), 0.1, (3.0, -2.0, 0.4))
    field = covariance_field(grid, FieldConfig(Sad(range=1.0)))
    xy, covariance = sample_covariances(field, 1.5)
    clear = grid.clearance[:: field.stride, :: field.stride] >= 0.15
    i, j = np.nonzero(field.is_evaluated & clear)
    points = np.stack(grid.grid_to_world(i * field.stride + 0.5, j * field.stride + 0.5), axis=1)
    distance = np.hypot(*(points[:, None] - xy[None]).transpose(2, 0, 1))
    assert distance.min(axis=1).max() < 1.5
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    assert apart[~np.eye(len(xy), dtype=bool)].min() >= 1.5 - 1e-9
    nearest = distance.argmin(axis=0)
    np.testing.assert_array_equal(covariance, field.covariance[i[nearest], j[nearest]])

"""The layer for QGIS, RViz and Foxglove: each value at its place, in the unit that is said."""

import json
import math

import numpy as np
import pytest
from conftest import drawn
from figure_looks import check_looks
from matplotlib.figure import Figure
from PIL import Image
from test_bag import cell_positions, cells, matrices, read, yaw_of

from locplan.export import layer
from locplan.export._figures import legend_figure, norm_of
from locplan.export._plain_files import world_file
from locplan.field import CovarianceField, FieldConfig, Sad, SearchWindow, covariance_field
from locplan.maps import FREE, UNKNOWN, OccupancyGrid
from locplan.plotting import draw_field

YAW = 0.4


def made_up(grid: OccupancyGrid, *, headings: int = 1, dimension: int = 3) -> CovarianceField:
    """A field of covariances of no symmetry where a map is free, every 0.2 m."""
    window = SearchWindow() if dimension == 3 else SearchWindow(half_rotation_deg=0)
    config = FieldConfig(Sad(window=window))
    step = round(0.2 / grid.resolution)
    free = grid.free[::step, ::step]
    factor = np.random.default_rng(3).normal(size=(*free.shape, dimension, dimension)) / 10
    covariance = factor @ factor.swapaxes(-1, -2) + 0.01 * np.eye(dimension)
    covariance[~free] = np.nan
    return CovarianceField(covariance, grid, config)


@pytest.fixture(scope="module")
def field():
    return made_up(OccupancyGrid(cells(), 0.05, (-3.2, 7.45, YAW), "hall"))


@pytest.fixture(scope="module")
def folder(field, tmp_path_factory):
    target = tmp_path_factory.mktemp("layer") / "out"
    layer(target, field)
    return target


def deviations(field) -> dict[str, np.ndarray]:
    """Deviations on the lattice in metres and radians."""
    known = np.where(np.isnan(field.covariance), 0.0, field.covariance)
    largest = np.sqrt(np.linalg.eigvalsh(known[..., :2, :2])[..., 1])
    values = {"position_std": largest, "heading_std": np.sqrt(known[..., 2, 2])}
    return {name: np.where(field.evaluated, each, np.nan) for name, each in values.items()}


def at_pixel(world: str, col: float, row: float) -> tuple[float, float]:
    """Where a world file places a pixel, by the definition of its six lines."""
    a, d, b, e, c, f = map(float, world.split())
    return a * col + b * row + c, d * col + e * row + f


@pytest.mark.parametrize("yaw", [0.0, 0.4, math.pi / 2, 3.14, -2.5])
def test_a_world_file_places_the_corners_where_the_map_has_them(yaw):
    grid = OccupancyGrid(cells(), 0.05, (-3.2, 7.45, yaw))
    height, width = grid.shape
    text = world_file(grid)
    assert len(text.splitlines()) == 6
    for row in (0, 37, height - 1):
        for col in (0, 101, width - 1):
            found = at_pixel(text, col, height - 1 - row)
            assert found == pytest.approx(grid.cell_to_world(row, col), abs=1e-9)


@pytest.mark.parametrize("name", ["position_std", "heading_std"])
def test_rasters_hold_metres_and_radians_at_their_place(folder, field, name):
    grid, values = field.grid, deviations(field)[name]
    picture = Image.open(folder / f"{name}.tif")
    assert (picture.mode, picture.tag_v2[42113]) == ("F", "nan")
    raster = np.asarray(picture)
    world = (folder / f"{name}.tfw").read_text()
    assert world == (folder / f"{name}.pgw").read_text()
    for row, col in np.argwhere(grid.free[::4, ::4]) * 4:
        pixel = grid.shape[0] - 1 - row
        x, y = at_pixel(world, col, pixel)
        assert grid.world_to_cell(x, y) == (row, col)
        assert raster[pixel, col] == pytest.approx(values[row // 4, col // 4], rel=1e-5)
    np.testing.assert_array_equal(np.isfinite(raster), grid.free[::-1])


@pytest.mark.parametrize("name", ["position_std", "heading_std"])
def test_pictures_have_the_colours_of_plots_and_are_clear_elsewhere(folder, field, name):
    colours = np.asarray(Image.open(folder / f"{name}.png"))
    assert colours.shape == (*field.grid.shape, 4)
    np.testing.assert_array_equal(colours[..., 3] == 255, field.grid.free[::-1])
    assert not colours[colours[..., 3] < 255].any()
    plotted = draw_field(Figure().add_subplot(), field, name)
    values = field.quantity(name).factor * deviations(field)[name]
    for row, col in np.argwhere(field.evaluated):
        expected = plotted.to_rgba(values[row, col], bytes=True)
        found = colours[field.grid.shape[0] - 1 - 4 * row, 4 * col]
        assert np.abs(found.astype(int) - expected).max() <= 3


def test_the_bag_begins_with_the_deviations_at_their_place(folder, field):
    messages = read(folder / "layer.mcap")
    assert set(messages) == {"/locplan/map", "/locplan/field", "/locplan/grid"}
    grid, expected = field.grid, deviations(field)
    grid_map, seen = messages["/locplan/field"], 0
    layers = matrices(grid_map)
    assert grid_map.layers[:2] == ["position_std", "heading_std"]
    assert "e" in grid_map.layers
    assert grid_map.basic_layers == ["position_std"]
    for row, col, x, y in cell_positions(grid_map.info):
        i, j = (round((float(v) - 0.5) / field.stride) for v in grid.world_to_grid(x, y))
        if 0 <= i < field.evaluated.shape[0] and 0 <= j < field.evaluated.shape[1]:
            seen += 1
            for name, values in expected.items():
                assert layers[name][row, col] == pytest.approx(values[i, j], rel=1e-5, nan_ok=True)
    assert seen >= field.evaluated.size
    shown = messages["/locplan/grid"]
    assert [each.name for each in shown.fields][:2] == ["position_std", "heading_std"]
    assert yaw_of(shown.pose) == pytest.approx(YAW)
    found = np.frombuffer(shown.data.tobytes(), "<f4")
    found = found.reshape(*field.evaluated.shape, len(shown.fields))
    for n, values in enumerate(expected.values()):
        np.testing.assert_allclose(found[..., n], values, rtol=1e-5)
    assert yaw_of(messages["/locplan/map"].info.origin) == pytest.approx(YAW)


def test_the_legend_says_both_units(field):
    norms = {n: norm_of(field, n, field.on_map(v)) for n, v in deviations(field).items()}
    figure = legend_figure(field, norms, {"position_std": "m", "heading_std": "rad"})
    check_looks(figure, "legend of a layer")
    for axes, below, above in zip(figure.axes, ("[m]", "[rad]"), ("[cm]", "[deg]"), strict=True):
        (second,) = axes.child_axes
        assert below in axes.get_xlabel()
        assert above in second.get_xlabel()
    assert norms["position_std"].vmin == pytest.approx(field.anchors("position_std")[0])


def test_the_folder_describes_itself(folder):
    about = json.loads((folder / "export.json").read_text())
    names = {path.name for path in folder.iterdir()} - {"export.json"}
    assert set(about["files"]) == names
    readme = (folder / "README.md").read_text()
    for name in names - {"README.md", "position_std.pgw"}:
        assert name in readme or name[-4:] in readme, name
    for tool in ("QGIS", "RViz", "Foxglove"):
        assert tool in readme


def test_a_field_without_rotation_has_no_heading(tmp_path):
    layer(tmp_path / "out", made_up(OccupancyGrid(cells(), 0.05), dimension=2))
    assert not list((tmp_path / "out").glob("heading*"))
    assert read(tmp_path / "out" / "layer.mcap")["/locplan/field"].layers[0] == "position_std"


@pytest.mark.draws
@pytest.mark.parametrize("level", [UNKNOWN, FREE])
def test_maps_of_one_level_only_are_written(tmp_path, level):
    grid = OccupancyGrid(np.full((31, 22), level, np.uint8), 0.1)
    layer(tmp_path / "out", covariance_field(grid, Sad(range=0.5)))
    raster = np.asarray(Image.open(tmp_path / "out" / "position_std.tif"))
    assert np.isfinite(raster).all() == (level == FREE)
    assert np.isfinite(raster).any() == (level == FREE)


def test_layer_of_headings_is_that_of_their_mean_information(tmp_path):
    grid = drawn(*["." * 12] * 9, resolution=0.2)
    covariance = np.tile(np.diag([0.04, 0.02, 0.01]), (9, 12, 2, 1, 1))
    covariance[:, :, 1, 0, 0] = 0.12
    layer(tmp_path / "out", CovarianceField(covariance, grid, FieldConfig()))
    raster = np.asarray(Image.open(tmp_path / "out" / "position_std.tif"))
    np.testing.assert_allclose(raster, math.sqrt(2 / (1 / 0.04 + 1 / 0.12)), rtol=1e-5)

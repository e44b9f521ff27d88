"""Pictures are drawn once, in blocks where maps are large, and look as matplotlib draws them."""

import io
import re

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from PIL import Image

from locplan import Sad, covariance_field
from locplan._support.drawing import (
    ERROR_COLOURS,
    FIELD_COLOURS,
    CellImage,
    NotebookFigure,
    draw_field_bar,
)
from locplan.field import FieldConfig
from locplan.field.figures import field_figure
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, figures as _cells
from locplan.maps.environments import make
from locplan.maps.figures import AxesImage, draw_cells, draw_map, map_figure
from locplan.planning import Costmap
from locplan.planning.figures import costmap_figure


def room(rows=40, cols=60, origin=(0.0, 0.0, 0.0)):
    cells = np.full((rows, cols), UNKNOWN, np.uint8)
    cells[3:-3, 3:-3] = OCCUPIED
    cells[4:-4, 4:-4] = FREE
    cells[10:20, 30] = OCCUPIED
    return OccupancyGrid(cells, 0.1, origin, "room")


@pytest.fixture(scope="module")
def field():
    return covariance_field(room(), FieldConfig(Sad(range=1.0), stride=0.4))


def pixels(figure, save):
    written = io.BytesIO()
    save(figure, written, dpi=90, format="png", bbox_inches="tight", pad_inches=0.1)
    return np.asarray(Image.open(written).convert("RGB"))


def rendered(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_saved_figure_contains_its_title():
    grid = make("two_corridors", resolution=0.1)
    costs = Costmap.from_layers(grid, u=np.where(grid.free, 0.5, np.nan), weight=4.0, robot=0.25)
    figure = costmap_figure(costs)
    figure.savefig(io.BytesIO())
    top = figure.axes[0].title.get_window_extent(FigureCanvasAgg(figure).get_renderer()).y1
    assert top < figure.bbox.y1


def test_notebook_figure_equals_matplotlib_figure(field):
    figures = field_figure(field), field_figure(field)
    for _ in range(2):  # the layout of a second one begins where the first one's ended
        theirs = pixels(figures[0], Figure.savefig)
        np.testing.assert_array_equal(pixels(figures[1], NotebookFigure.savefig), theirs)


def test_saving_draws_once_and_keeps_layout(field, monkeypatch):
    figure = field_figure(field)
    engine, dpi, draws = figure.get_layout_engine(), figure.dpi, []
    draw = NotebookFigure.draw
    monkeypatch.setattr(
        NotebookFigure, "draw", lambda self, to: [draws.append(1), draw(self, to)][1]
    )
    pixels(figure, NotebookFigure.savefig)
    assert len(draws) == 1
    assert (figure.get_layout_engine(), figure.dpi) == (engine, dpi)


@pytest.mark.parametrize("yaw", [0.0, 0.5, np.pi])
@pytest.mark.parametrize("norm", [LogNorm(0.1, 10.0), Normalize(0.0, 8.0)])
def test_cell_image_equals_matplotlib_image(yaw, norm):
    grid = room(30, 45, (1.0, -2.0, yaw))
    values = np.geomspace(0.05, 20.0, grid.cells.size).reshape(grid.shape)
    values[grid.cells != FREE] = np.nan
    drawn = []
    for kind in (CellImage, AxesImage):
        figure = Figure(figsize=(5, 4), dpi=100)
        axes = figure.add_subplot(xlim=(-3, 6), ylim=(-7, 3))
        image = draw_cells(axes, grid, values, cmap=FIELD_COLOURS, norm=norm)
        if kind is not CellImage:
            image.make_image = AxesImage.make_image.__get__(image)
            image.set_interpolation_stage("rgba")
        drawn.append(rendered(figure).astype(int))
    assert (drawn[0] != 255).mean() > 0.03
    # Pixels whose centre lies on the border of two cells may show either.
    assert (np.abs(drawn[0] - drawn[1]).max(axis=2) > 3).mean() < 0.03


def test_vector_image_position_ignores_dpi(field):
    figure = map_figure(field.grid)

    def places(dpi):
        written = io.StringIO()
        figure.savefig(written, format="svg", dpi=dpi)
        images = re.findall(r"<image.*?>", written.getvalue(), re.DOTALL)
        return [float(re.search(r' x="(.*?)"', each)[1]) for each in images]

    assert places(288) == pytest.approx(places(72), abs=0.5)


def test_thin_wall_stays_dark_when_downscaled():
    cells = np.full((600, 600), FREE, np.uint8)
    cells[:, 301] = OCCUPIED
    grid = OccupancyGrid(cells, 0.05)
    figure = Figure(figsize=(3, 3), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, 30), ylim=(0, 30))
    draw_map(axes, grid)
    axes.set(xlim=(0, 30), ylim=(0, 30))
    axes.set_axis_off()
    row = rendered(figure)[150, :, 0]
    assert row.min() < 140
    assert 149 <= row.argmin() <= 151


def test_large_map_is_drawn_in_blocks(field, monkeypatch):
    """A block shows the field at its middle."""
    whole = field_figure(field).axes[0].images[1].get_array()
    monkeypatch.setattr(_cells, "MAX_DRAWN_CELLS", 30)
    walls, image = field_figure(field).axes[0].images
    shades, values = walls.get_array(), image.get_array()
    assert shades.shape == values.shape == (20, 30)
    assert (np.ma.getmaskarray(values) == (shades != 2)).all()
    between = np.sqrt(whole[20, 20] * whole[21, 21] * whole[20, 21] * whole[21, 20]) ** 0.5
    assert values[10, 10] == pytest.approx(between, rel=0.02)
    (_, u) = costmap_figure(Costmap.from_field(field)).axes[0].images
    assert u.get_array().shape == (20, 30)


@pytest.mark.parametrize("logarithmic", [True, False])
def test_interpolation_at_cells_equals_whole_map(field, logarithmic):
    free = field.grid.free
    rows, cols = np.nonzero(free)
    whole = field.interpolate_on_map(field.e, logarithmic=logarithmic)[free]
    read = field.interpolate_on_map(field.e, logarithmic=logarithmic, cells=(rows, cols))
    np.testing.assert_array_equal(read, whole)


def test_field_bar_writes_powers_in_unicode(field):
    figure = NotebookFigure(layout="constrained")
    axes = figure.subplots()
    values = np.ones(field.grid.shape)
    image = draw_cells(axes, field.grid, values, cmap=FIELD_COLOURS, norm=LogNorm(2e-4, 0.9))
    bar = draw_field_bar(figure, image, axes, "e")
    figure.canvas.draw()
    shown = {text.get_text() for text in bar.ax.get_yticklabels()}
    assert {"10⁻³", "10⁻²", "10⁻¹"} <= shown


def test_enlarged_cells_have_sharp_edges():
    cells = np.full((20, 20), FREE, np.uint8)
    cells[:, 10] = OCCUPIED
    figure = Figure(figsize=(2, 2), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    draw_map(axes, OccupancyGrid(cells, 0.05))
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.set_axis_off()
    assert set(rendered(figure)[100, :, 0].tolist()) == {0, 255}


@pytest.mark.parametrize("colours", [FIELD_COLOURS, ERROR_COLOURS])
def test_dark_means_bad(colours):
    shades = colours(np.linspace(0.0, 1.0, 20))[:, :3].sum(axis=1)
    assert (np.diff(shades) < 0).all()

"""Pictures show where a small path lies, say what they do not show, and have readable scales."""

import dataclasses

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from locplan import Scan, covariance_field
from locplan._support.drawing import NotebookFigure, make_logarithmic
from locplan.field import FieldConfig
from locplan.field.figures import draw_field, field_figure
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.maps.figures import crop_map, draw_map, make_map_axes, map_figure, zoom_map
from locplan.planning import Costmap, Path, Query, plan
from locplan.planning.figures import costmap_figure, draw_inset, path_figure, plan_figure
from locplan.robots import Lidar, Robot
from locplan.simulation.drives import LOST_TEXT
from locplan.simulation.figures import queries_figure
from locplan.simulation.query_routes import QueryDrives, Routes

LIDAR = Lidar(range=4.0, beams=60)


def hall(rows=120, cols=200, origin=(0.0, 0.0, 0.4)):
    """A hall with a pillar in each part of it."""
    cells = np.full((rows, cols), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[10::20, 10::20] = OCCUPIED
    return OccupancyGrid(cells, 0.2, origin, "hall")


@pytest.fixture(scope="module")
def field():
    return covariance_field(hall(), FieldConfig(Scan(LIDAR), stride=1.0))


@pytest.fixture(scope="module")
def costs(field):
    return Costmap.from_field(field, robot=0.1)


def limits_of(grid):
    """Ends of x and of y in a picture of the map."""
    axes = map_figure(grid).axes[0]
    return axes.get_xlim(), axes.get_ylim()


def between(costs, *cells):
    return plan(costs, *(costs.grid.position(*cell) for cell in cells))


def test_small_plan_is_enlarged_with_inset(costs, field):
    short, long = between(costs, (35, 35), (45, 45)), between(costs, (5, 5), (115, 195))
    upper = plan_figure(costs, field, {"short": short}).axes[0]
    assert np.ptp(upper.get_xlim()) < 0.5 * np.ptp(limits_of(costs.grid)[0])
    (inset,) = upper.child_axes
    assert (inset.get_xlim(), inset.get_ylim()) == limits_of(costs.grid)
    ((outline),) = inset.patches
    middle = np.mean(short.path.xy, axis=0)
    assert np.linalg.norm(outline.get_xy()[:4].mean(axis=0) - middle) < 2
    upper = plan_figure(costs, field, {"long": long}).axes[0]
    assert upper.child_axes == []
    assert (upper.get_xlim(), upper.get_ylim()) == limits_of(costs.grid)


def test_path_figure_enlarges_small_path(costs):
    short = between(costs, (35, 35), (45, 45))
    assert len(path_figure(short).axes[0].child_axes) == 1


@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_inset_never_covers_path(corner):
    grid = hall(300, 500, (0.0, 0.0, 0.0))
    way = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])  # one corner is free
    path = Path(16 + 20 * np.abs(way - corner))
    part = crop_map(grid, [path])
    figure, axes = make_map_axes(part)
    draw_map(axes, part)
    draw_inset(axes, grid, part, [path])
    (inset,) = axes.child_axes
    figure.canvas.draw()
    box, at = inset.get_window_extent(), axes.transData.transform(path.resample(0.1).xy)
    assert not any(box.contains(*point) for point in at)


def test_enlarged_field_keeps_map_values(field):
    rows, cols = np.array([60.5, 70.5]), np.array([90.5, 99.5])
    path = Path(np.column_stack(field.grid.grid_to_world(rows, cols)))
    part = zoom_map(field.grid, [path])
    assert part.shape < field.grid.shape
    _, axes = make_map_axes(part)
    shown = draw_field(axes, field, "e", part).get_array()
    row, col = np.round(field.grid.world_to_grid(*part.origin[:2])).astype(int)
    window = slice(row, row + part.shape[0]), slice(col, col + part.shape[1])
    np.testing.assert_array_equal(field.grid.cells[window], part.cells)
    whole = field.interpolate_on_map(field.scalar("e", headings="mean"))
    np.testing.assert_allclose(np.ma.filled(shown, np.nan), whole[window], rtol=1e-9)


def test_path_outside_map_shows_whole_map():
    grid = hall()
    beside = Path(np.array([[-500.0, -500.0], [-490.0, -500.0]]))
    assert crop_map(grid, [beside]) is grid


def test_figure_title_reports_equal_paths(costs, field):
    one, other = between(costs, (5, 5), (115, 195)), between(costs, (5, 5), (100, 20))
    for plans, title in (
        ({"a": one, "b": one}, "both take the same path"),
        ({"a": one, "b": one, "c": one}, "all take the same path"),
        ({"a": one, "b": other}, ""),
        ({"a": one}, ""),
    ):
        assert plan_figure(costs, field, plans).axes[1].get_title() == title


def test_inside_of_walls_is_grey():
    cells = np.full((60, 80), FREE, np.uint8)
    cells[:20], cells[40, :], cells[50:] = OCCUPIED, OCCUPIED, UNKNOWN
    drawn = map_figure(OccupancyGrid(cells, 0.1)).axes[0].images[0].get_array()
    assert (drawn[:17] == 3).all()
    assert (drawn[17:20] == 0).all()
    assert (drawn[40] == 0).all()
    assert (drawn[cells == FREE] == 2).all()
    assert (drawn[50:] == 1).all()


@pytest.mark.parametrize("yaw", [0.0, 0.6, 2.0, 4.0])
def test_figure_shows_whole_turned_map(yaw):
    grid = OccupancyGrid(np.full((30, 60), OCCUPIED, np.uint8), 0.1, (1.0, 2.0, yaw))
    figure = map_figure(grid)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes, drawn = figure.axes[0], np.asarray(canvas.buffer_rgba())[..., 0]
    rows, cols = np.array([1.5, 1.5, 28.5, 28.5]), np.array([1.5, 58.5, 1.5, 58.5])
    at = axes.transData.transform(np.column_stack(grid.grid_to_world(rows, cols)))
    assert (drawn[len(drawn) - 1 - at[:, 1].astype(int), at[:, 0].astype(int)] < 200).all()


def test_colour_scale_ends_at_map_values(field):
    image = field_figure(field).axes[0].images[1]
    low, high = image.get_clim()
    ends = [100 * anchor for anchor in field.anchors("position_std")]
    assert low == pytest.approx(ends[0])
    assert high == pytest.approx(min(np.nanmax(image.get_array()), ends[1]))
    assert high < ends[1]
    known = np.ma.compressed(np.ma.masked_invalid(image.get_array()))
    assert np.mean(known > low * (high / low) ** 0.25) > 0.05
    layer = field_figure(field, "ambiguity").axes[0].images[1]
    shown = np.ma.compressed(np.ma.masked_invalid(layer.get_array()))
    assert layer.get_clim()[1] == pytest.approx(max(0.02, np.quantile(shown, 0.98)))


def test_figure_title_reports_weak_spots():
    cells = np.full((30, 40), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[8:12, 10:16] = cells[20:24, 25:28] = cells[6:8, 30:33] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, name="room")
    field = covariance_field(grid, FieldConfig(Scan(Lidar(range=10.0)), stride=0.2))
    figure = field_figure(field)
    low, high = figure.axes[0].images[1].get_clim()
    assert "no weak spot: at most " in figure.axes[0].get_title()
    assert 1.5 * low < high < 90
    for deviation, said in (
        (0.15, "at most 15 cm"),
        (0.8, "100% weak (21 cm or more)"),
        (np.nan, "nothing is known"),
    ):
        covariance = np.broadcast_to(np.diag([deviation**2] * 3), field.covariance.shape)
        values = {
            **field.values,
            "covariance": np.where(field.is_evaluated[..., None, None], covariance, np.nan),
        }
        known = field.from_values(values, grid, field.config)
        assert said in field_figure(known, "position_std").axes[0].get_title()
    unclear = dataclasses.replace(Costmap.from_field(field, robot=0.0), u=np.full(grid.shape, 0.2))
    assert "no weak spot: u is 0.20" in costmap_figure(unclear).axes[0].get_title()


@pytest.mark.parametrize(
    "ends",
    [
        (0.06, 0.17),
        (0.05, 0.9),
        (1, 1.05),
        (1e-4, 1),
        (1e-9, 1e9),
        (4.1, 4.3),
        (64, 66.8),
        (0.0755, 0.164),
    ],
)
def test_logarithmic_axis_has_few_round_ticks(ends):
    axes = NotebookFigure().subplots()
    make_logarithmic(axes.xaxis)
    axes.set_xlim(*ends)
    found = axes.xaxis.get_majorticklocs()
    assert 3 <= len(found) <= 8
    assert (np.diff(found) > 0).all()
    assert (found >= ends[0] * (1 - 1e-6)).all()
    assert (found <= ends[1] * (1 + 1e-6)).all()
    assert all(float(f"{value:.4g}") == pytest.approx(value) for value in found)


@pytest.mark.parametrize(("lost", "panels"), [(0.0, 1), (0.25, 2)])
def test_queries_figure_omits_empty_panel(lost, panels):
    """Without a lost drive, the panel of lost drives would be empty."""
    query = Query("a", (1.0, 1.0), (5.0, 5.0))
    pair = (0.1, 0.12)
    routes = [QueryDrives(query, (5.0, 6.0), pair, (lost, 0.0), (lost, 0.0), pair, pair, {})] * 3
    figure = queries_figure(Routes(hall(), routes, {"robot": Robot(LIDAR).summary()}))
    assert len(figure.axes) == panels
    title = figure.get_suptitle()
    assert (f"no drive was {LOST_TEXT} on either path" in title.replace("\n", " ")) == (panels == 1)
    assert LIDAR.title in title.replace("\n", " ")


def numbers_beside(points):
    """Where the number of each query stands from its point in the figure [points]."""
    routes = []
    for x, y in np.exp(points):
        query, pair = Query("a", (1.0, 1.0), (5.0, 5.0)), (float(x), float(y))
        routes.append(QueryDrives(query, (5.0, 6.0), pair, (0.0, 0.0), (0.0, 0.0), pair, pair, {}))
    figure = queries_figure(Routes(hall(), routes, {}))
    return np.array([text.xyann for text in figure.axes[0].texts])


def test_numbers_of_points_keep_apart():
    points = np.array([[0.0, 0.0], [0.02, 0.02], [0.5, 0.1], [1.0, 1.0]])
    sides = numbers_beside(points)
    assert (sides[0] != sides[1]).any()
    at = points + sides / 200  # the points take about as much room [typographic points]
    assert np.hypot(*(at[0] - points[1])) > np.hypot(*(at[0] - points[0]))
    assert np.hypot(*(at[0] - at[1])) > 0.05
    assert len(numbers_beside(points[:1])) == 1


def test_numbers_of_logarithmic_axes_are_plain():
    figure = NotebookFigure(layout="constrained")
    axes = figure.subplots()
    axes.plot([0.3, 2.0], [1.0, 2.0])
    make_logarithmic(axes.xaxis)
    figure.canvas.draw()
    shown = [text.get_text() for text in axes.get_xticklabels()]
    assert {"0.3", "0.5", "1", "2"} <= set(shown)
    make_logarithmic(axes.yaxis, 4)
    axes.set_ylim(1.0, 1e9)
    assert len(axes.yaxis.get_majorticklocs()) <= 4

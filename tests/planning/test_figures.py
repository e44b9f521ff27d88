import dataclasses

import numpy as np
import pytest
from matplotlib.patches import PathPatch
from PIL import Image
from support.maps import ascii_map, random_rooms

from locplan._support.drawing import save_figure
from locplan.errors import LocplanError
from locplan.field import FieldConfig, Sad, Scan, covariance_field
from locplan.field.figures import field_figure, fields_figure
from locplan.maps import FREE, OccupancyGrid, Zone, Zones
from locplan.planning import Costmap, Plan, pareto_front, plan
from locplan.planning.figures import front_figure, plan_figure
from locplan.robots import Lidar


@pytest.fixture(scope="module")
def field():
    grid = OccupancyGrid(random_rooms((80, 120), seed=6), 0.1, (2.0, 1.0, 0.3), name="rooms")
    return covariance_field(grid, FieldConfig(Sad(range=1.0)))


def test_field_figure_names_map_and_unit(field):
    figure = field_figure(field, "position_std")
    axes, bar = figure.axes
    first, second = axes.get_title().split("\n")
    assert first == "rooms: u is about 0 on 0%; 100% weak (26 cm or more)"
    assert second.startswith("sad, disc, exponential")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert bar.get_ylabel() == "largest position std. deviation [cm]"


def test_field_figure_draws_empty_field(tmp_path):
    field = covariance_field(ascii_map("##", "  ", resolution=0.1), FieldConfig())
    save_figure(field_figure(field), tmp_path / "empty.png")
    assert (tmp_path / "empty.png").stat().st_size > 0


def test_field_figure_draws_world_coordinates(field):
    axes = field_figure(field).axes[0]
    for image in axes.images:
        assert image.origin == "lower"
        left, right, bottom, top = image.get_extent()
        to_world = image.get_transform() - axes.transData
        for row, col in ((0, 0), (0, 120), (80, 0), (80, 120)):
            corner = left + (right - left) * col / 120, bottom + (top - bottom) * row / 80
            expected = field.grid.grid_to_world(row, col)
            np.testing.assert_allclose(to_world.transform(corner), expected, atol=1e-9)


def test_plan_figure_shows_u_along_paths(field, tmp_path):
    costs = Costmap.from_field(field, weight=3.0, robot=0.0)
    free = np.argwhere(np.isfinite(costs.density))
    ends = [field.grid.position(*map(int, free[n])) for n in (0, -1)]
    found = plan(costs, *ends)
    assert found.status == "solved"
    nothing = Plan("unreachable", "grid", *ends, None, None, 0.0)
    figure = plan_figure(costs, field, {"aware": found, "other": nothing})
    lower = figure.axes[1]
    assert lower.get_xlabel() == "distance along the path [m]"
    distance, u = lower.lines[0].get_data()
    assert distance[-1] == pytest.approx(found.metrics.length)
    assert 0 <= min(u) <= max(u) <= 1
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert f"{found.metrics.length:.1f} m" in texts[0]
    assert texts[1:] == ["other: unreachable", "start", "goal"]
    save_figure(figure, tmp_path / "plan.png")
    with Image.open(tmp_path / "plan.png") as picture:
        assert picture.width > 500


def test_unknown_picture_formats_are_refused(field, tmp_path):
    with pytest.raises(LocplanError, match=r"\.png"):
        save_figure(field_figure(field), tmp_path / "field.doc")
    assert not list(tmp_path.iterdir())


def compute_room_front():
    grid = OccupancyGrid(np.full((40, 60), FREE), 0.1, name="room")
    u = np.tile(np.linspace(1, 0, 40)[:, None], (1, 60))
    costs = dataclasses.replace(Costmap.blank(grid, robot=0.0), u=u, e=u + 0.1, weight=1.0)
    return pareto_front(costs, (0.55, 0.55), (5.55, 0.55))


def test_front_figure_shows_paths_and_knee():
    front = compute_room_front()
    upper, lower = front_figure(front).axes[:2]
    assert "exact" in upper.get_title()
    assert f"of {len(front)} paths" in upper.get_title()
    assert lower.get_xlabel() == "length [m]"
    assert lower.get_ylabel() == "degenerate metres (∫u ds) [m]"
    assert "knee" in lower.get_legend().get_texts()[0].get_text()
    longer = front.length[front.knee] - front.length[0]
    assert upper.get_title().startswith(f"room: the knee is {longer:.1f} m longer and ")


def test_front_figure_without_knee_marks_none():
    front = compute_room_front()
    count = len(front)
    falling = np.arange(count, 0.0, -1)
    front = dataclasses.replace(front, length=falling[::-1], integral=falling)
    upper, lower = front_figure(front).axes[:2]
    assert lower.get_legend() is None
    assert max(line.get_linewidth() for line in upper.lines) < 3.0


def test_plan_figure_title_has_gain(field):
    costs = Costmap.from_field(field, robot=0.0)
    free = np.argwhere(np.isfinite(costs.density))
    found = plan(costs, *(field.grid.position(*map(int, free[n])) for n in (0, -1)))
    better = dataclasses.replace(found.metrics, length=9.0, integrated_u=1.0)
    worse = dataclasses.replace(found.metrics, length=7.0, integrated_u=4.0)
    plans = {"short": dataclasses.replace(found, metrics=worse)}
    plans["aware"] = dataclasses.replace(found, metrics=better)
    title = plan_figure(costs, field, plans).axes[0].get_title()
    assert ": 'aware' avoids 3.0 degenerate metres and is 2.0 m longer\n" in title


def test_plan_figure_title_names_settings(field):
    costs = Costmap.from_field(field, robot=0.0)
    free = np.argwhere(np.isfinite(costs.density))
    xy = field.grid.position(*map(int, free[0]))
    limited = plan(costs, xy, xy, max_e=1.0, footprint=[(0.1, 0), (-0.1, 0.1), (-0.1, -0.1)])
    title = plan_figure(costs, field, {"limited": limited}).axes[0].get_title()
    assert "weight 4" in title
    assert "e at most 1" in title
    assert "footprint" in title
    cheap = plan(costs, xy, xy, budget=2.5)
    title = plan_figure(costs, field, {"cheap": cheap}).axes[0].get_title()
    assert "budget 2.5 m" in title


def test_fields_figure_shares_colour_scale():
    grid = ascii_map("#" * 20, *["#" + "." * 18 + "#"] * 8, "#" * 20, resolution=0.2)
    estimators = Sad(range=2.0), Scan(Lidar(range=2.0))
    fields = {each.name: covariance_field(grid, each) for each in estimators}
    figure = fields_figure([fields], "position_std")
    scales = {axes.images[-1].get_clim() for axes in figure.axes[:2]}
    least = [100 * f.anchors("position_std")[0] for f in fields.values()]
    greatest = [100 * np.nanmax(f.scalar("position_std")) for f in fields.values()]
    ((low, high),) = scales
    assert low == pytest.approx(min(least))
    assert high == pytest.approx(max(greatest))


def test_figures_show_zones():
    """Without zones pictures stay as they are."""
    grid = ascii_map("#" * 20, *["#" + "." * 18 + "#"] * 8, "#" * 20, resolution=0.2)
    field = covariance_field(grid, FieldConfig(Sad(range=2.0)))
    zones = Zones(
        [
            Zone("no-go", [[1.6, 0.7], [2.1, 0.7], [2.1, 1.1], [1.6, 1.1]]),
            Zone("slow", [[2.4, 0.3], [3.0, 0.3], [3.0, 1.1]], 30),
            Zone("prefer", [[0.3, 0.3], [1.2, 0.3], [1.2, 1.5]]),
        ]
    )
    labels = ["no-go zone", "slow zone", "preferred zone"]
    for drawn in (zones, Zones()):
        costs, ends = Costmap.from_field(field, zones=drawn, robot=0.0), (0.5, 0.5, 3.5, 0.5)
        path = plan(costs, ends[:2], ends[2:])
        figures = [costs.figure(), path.figure(), plan_figure(costs, field, {"aware": path})]
        figures.append(front_figure(pareto_front(costs, ends[:2], ends[2:])))
        for figure in figures:
            shown = [patch for patch in figure.axes[0].patches if isinstance(patch, PathPatch)]
            texts = [text.get_text() for each in figure.legends for text in each.get_texts()]
            assert len(shown) == len(drawn)
            assert [text for text in texts if "zone" in text] == labels[: len(drawn)]

"""Names with signs of formulas, of markup, and of no text, in pictures and tables."""

import io
import re

import numpy as np
import pytest
from support.cases import sample_cases
from support.maps import ascii_map

import locplan
from locplan._support.drawing import NotebookFigure
from locplan._support.tables import format_table
from locplan.export import ros_map
from locplan.export.figures import values_figure
from locplan.field.figures import field_figure
from locplan.maps import OccupancyGrid
from locplan.maps.figures import map_figure
from locplan.planning import pareto_front
from locplan.planning.figures import costmap_figure, front_figure, plan_figure
from locplan.simulation import simulate
from locplan.simulation.figures import simulation_figure

NAMES = ("[red]$x$\\", "a$b$c", "$\\frac{", "x^2_3\\", "r\udcffm", "\U0001f600\x1b[1m", "[red]")


def named(name: str) -> OccupancyGrid:
    grid = ascii_map("##########", *["#........#"] * 6, "##########", resolution=1.0)
    return OccupancyGrid(grid.cells, 1.0, grid.origin, name)


def texts_of(figure) -> str:
    """All texts of a figure as it was drawn; matplotlib writes them into the SVG as comments."""
    written = io.StringIO()
    figure.savefig(written, format="svg", bbox_inches="tight")
    return "\n".join(re.findall(r"<!-- (.*?) -->", written.getvalue(), re.DOTALL))


def figures_of(name: str):
    grid = named(name)
    field = locplan.covariance_field(grid, locplan.Sad(range=3.0))
    costs = locplan.Costmap.from_field(field)
    ends = (1.5, 1.5), (8.5, 5.5)
    plans = {name: locplan.plan(costs, *ends), "other": locplan.plan(costs, *ends)}
    yield "map", map_figure(grid)
    yield "field", field_figure(field)
    yield "plans", plan_figure(costs, field, plans)
    yield "costs", costmap_figure(costs)
    yield "front", front_figure(pareto_front(costs, *ends))
    driven = simulate(
        grid, {name: plans[name].path, "other": plans["other"].path}, drives=2, costs=costs
    )
    yield "drives", simulation_figure(driven)
    values = np.arange(grid.cells.size).reshape(grid.shape) - 1
    yield "values", values_figure(grid, values, "mask", name)
    yield "falling values", values_figure(grid, values, "limit", name, is_falling=True)


@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_map_figure_shows_name_unchanged(name):
    shown = "".join(c if c.isprintable() else "\ufffd" for c in name)
    assert shown in texts_of(map_figure(named(name))).replace("?", "\ufffd")


@pytest.mark.parametrize("name", sample_cases(NAMES[:3]), ids=ascii)
def test_pictures_show_names_unchanged(name):
    shown = "".join(c if c.isprintable() else "\ufffd" for c in name)
    for kind, figure in figures_of(name):
        texts = texts_of(figure)
        assert shown in texts.replace("?", "\ufffd"), f"{kind}: {texts}"


def test_numbers_at_axes_stay_formulas():
    figure = NotebookFigure()
    axes = figure.add_subplot()
    axes.plot([1, 1000], [1, 1000])
    axes.set(xscale="log", title="10$^2$")
    texts = texts_of(figure)
    assert "10$^2$" in texts
    assert "\\mathdefault{10^{2}}" in texts
    ticks = axes.xaxis.get_major_ticks()
    assert all(tick.label1.get_parse_math() for tick in ticks)
    assert not axes.title.get_parse_math()


def test_tables_show_markup_unchanged():
    text = format_table(["[bold]map[/bold]", "n"], [["[red]a[/red]", "1"]])
    assert "[bold]map[/bold]" in text
    assert "[red]a[/red]" in text


def test_table_stays_text_in_notebook(monkeypatch):
    shown = []
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setattr("rich.jupyter.display", lambda *parts: shown.append(parts))
    assert "map" in format_table(["map"], [["a"]])
    assert shown == []


def test_maps_of_ros_take_any_name(tmp_path):
    grid = named("r\udcffm[red]$")
    field = locplan.covariance_field(grid, locplan.Sad(range=3.0))
    costs = locplan.Costmap.from_field(field)
    ros_map(tmp_path / "map", costs)
    assert np.isfinite(costs.u).any()
    assert (tmp_path / "map").is_dir()

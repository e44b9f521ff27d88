"""Tests of the report: one file, nothing loaded, hostile names harmless, holes in the data told."""

from __future__ import annotations

import base64
import dataclasses
import io
import math
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion

import locplan
from locplan.comparison._runs import MEASURES, Run, Task
from locplan.comparison.report import ReportData, Row, Scene, write_report
from locplan.comparison.report._figures import Look
from locplan.comparison.report._pictures import Backdrop, _line
from locplan.comparison.report._style import SCRIPT
from locplan.maps import OCCUPIED, environments

pytestmark = pytest.mark.draws

HOSTILE = '<script>alert("1")</script>'
NAMES = (HOSTILE, "any-angle", "_$\\frac{", "--></style><b onload='x'>", "計画 \u202e\ud800")
ENDS = ((2.0, 3.0), (38.0, 3.0))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    grid = environments.make("two_corridors", resolution=0.1)
    grid = dataclasses.replace(grid, name=HOSTILE)
    field = locplan.covariance_field(grid, locplan.FieldConfig(stride=4))
    costs = locplan.Costmap.from_field(grid, field, robot_radius=0.25)
    front = locplan.pareto_front(costs, *ENDS)
    return Scene(field, {HOSTILE: ENDS, "second": ENDS}, front, HOSTILE)


def run_of(
    planner: str,
    status: str = "solved",
    seed: int = 1,
    factor: float = 1.0,
    *,
    query: str = HOSTILE,
    weight: float = 4.0,
) -> Run:
    task = Task(HOSTILE, HOSTILE, query, weight, planner, seed)
    if status != "solved":
        return Run(task, status, 1.0, 1.0, note=HOSTILE)
    measures = dict.fromkeys(MEASURES, 40.0 * factor)
    history = ((0.01, 80.0 * factor), (0.5, 40.0 * factor))
    return Run(task, status, 1.0, 1.1, measures, history, ENDS)


def summary_of(planner: str, ratio: float = 1.0) -> Row:
    return Row(
        map=HOSTILE,
        config=HOSTILE,
        weight=4.0,
        planner=planner,
        solved_share=0.5,
        pairs=12,
        baseline_cost=1.0,
        measures=dict.fromkeys(MEASURES, (1.0, 0.0, 1234.5)),
        ratio=ratio,
        ratio_low=ratio,
        ratio_high=ratio,
        sentence=HOSTILE,
    )


def hostile(scene: Scene) -> ReportData:
    runs = [run_of(name) for name in NAMES] + [run_of(name, "crashed", 2) for name in NAMES]
    return ReportData(
        runs=runs,
        rows=[summary_of(name) for name in NAMES],
        scenes={(HOSTILE, HOSTILE): scene},
        baseline=HOSTILE,
        answers={HOSTILE: HOSTILE},
        settings={HOSTILE: HOSTILE},
        command=HOSTILE,
        title=HOSTILE,
    )


def written(tmp_path: Path, data: ReportData) -> str:
    write_report(tmp_path / "report.html", data)
    return (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def hostile_page(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> str:
    return written(tmp_path_factory.mktemp("hostile"), hostile(scene))


class Elements(HTMLParser):
    """The tags of a page in order, with their attributes, and whether they nest."""

    VOID = ("meta", "br", "wbr")

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def attributes(self, name: str) -> Iterator[str]:
        return (told[name] or "" for _, told in self.found if name in told)


def test_hostile_names_are_text(hostile_page: str) -> None:
    page = hostile_page
    elements = Elements(page)
    assert elements.open == []
    assert page.count("<script") == 1
    assert f"<script>{SCRIPT}</script>" in page
    assert "&lt;script&gt;" in page
    assert page.count("<style") - page.count('<style type="text/css">') == 1
    assert not any(name.startswith("on") for _, told in elements.found for name in told)
    assert not {"b onload", "iframe", "object"} & {tag for tag, _ in elements.found}


def test_ratios_tell_of_how_many_queries_they_are(hostile_page: str) -> None:
    assert hostile_page.count("(n = 12, ") == len(NAMES)


def test_nothing_is_loaded(hostile_page: str) -> None:
    elements = Elements(hostile_page)
    links = [*elements.attributes("src"), *elements.attributes("href")]
    links += elements.attributes("xlink:href")
    assert links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert not {"link", "img", "iframe"} & {tag for tag, _ in elements.found}


def test_identifiers_are_unique_and_pictures_have_texts(hostile_page: str) -> None:
    page = hostile_page
    elements = Elements(page)
    identifiers = list(elements.attributes("id"))
    assert len(identifiers) == len(set(identifiers))
    assert set(re.findall(r"url\(#([^)]*)\)", page)) <= set(identifiers)
    pictures = [told for tag, told in elements.found if tag == "svg"]
    assert all(told.get("aria-label") or told.get("aria-hidden") for told in pictures)
    assert sum("aria-label" in told for told in pictures) == 5


def several(scene: Scene) -> ReportData:
    """Two planners on two queries at two weights, one run of which has no path."""
    runs = [
        run_of(planner, factor=factor, query=query, weight=weight)
        for query in (HOSTILE, "second")
        for weight in (0.0, 4.0)
        for planner, factor in (("any-angle", 1.0), ("grid", 1.25))
    ]
    runs[-1] = run_of("grid", "timeout", query="second")
    rows = [summary_of("any-angle"), summary_of("grid", 1.25)]
    return ReportData(runs, rows, {(HOSTILE, HOSTILE): scene}, "any-angle")


def test_every_query_is_shown_at_every_weight_with_the_j_of_each_planner(
    tmp_path: Path, scene: Scene
) -> None:
    elements = Elements(written(tmp_path, several(scene)))
    labels = [label for label in elements.attributes("aria-label") if label.startswith("Paths of ")]
    assert labels == [
        f"Paths of {HOSTILE}, weight 0, J [m]: any-angle 40.0; grid 50.0.",
        f"Paths of {HOSTILE}, weight 4, J [m]: any-angle 40.0; grid 50.0.",
        "Paths of second, weight 0, J [m]: any-angle 40.0; grid 50.0.",
        "Paths of second, weight 4, J [m]: any-angle 40.0; grid no path.",
    ]
    images = [told for tag, told in elements.found if tag == "image" and told.get("id") == "map-0"]
    assert len(images) == 1
    assert sum(told.get("href") == "#map-0" for _, told in elements.found) == 4


def test_pictures_beyond_the_limit_are_counted(
    tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("locplan.comparison.report._pictures.MAX_THUMBNAILS", 3)
    monkeypatch.setattr("locplan.comparison.report._report.MAX_RUNS", 5)
    page = written(tmp_path, several(scene))
    assert page.count('aria-label="Paths of ') == 3
    assert "1 picture left out" in page
    assert "The first 5 of 8 runs are shown" in page


def test_j_of_every_query_stands_beside_the_baselines(tmp_path: Path, scene: Scene) -> None:
    page = written(tmp_path, several(scene))
    assert "weight 0. Medians: any-angle 1.000; grid 1.250." in page
    assert page.count("second, 40.0 m</text>") == 2


def test_paths_lie_on_the_map_as_in_the_world(scene: Scene) -> None:
    backdrop, grid = Backdrop.of(scene, "map-0"), scene.field.grid
    data = re.search('base64,([^"]*)', backdrop.image)
    assert data is not None
    image = np.asarray(Image.open(io.BytesIO(base64.b64decode(data[1]))).convert("L"))
    rows, cols = np.nonzero(binary_erosion(grid.cells == OCCUPIED, np.ones((2, 2))))
    corners = np.transpose(grid.grid_to_world(rows, cols))  # of four occupied cells each
    x, y = np.floor(backdrop.pixels(corners)).astype(int).T
    assert len(x) > 50
    assert (image[y, x] < 40).mean() > 0.98
    assert (image < 40).mean() < 0.2


def test_a_path_keeps_its_vertices_and_loses_what_lies_between() -> None:
    points = np.array([(0, 0), (10, 0.1), (20, 0), (20, 30)], np.float32)
    drawn = _line(points, Look(1, 0, 0), 2.0, "grid")
    assert drawn.count('d="M0.0 0.0 20.0 0.0 20.0 30.0"') == 2


def test_parts_of_pictures_are_filtered_by_their_planner(tmp_path: Path, scene: Scene) -> None:
    elements = Elements(written(tmp_path, several(scene)))
    parts = [
        told["data-planner"]
        for tag, told in elements.found
        if tag == "g" and "data-planner" in told
    ]
    assert {"any-angle", "grid"} == set(parts)
    assert not any("planner-" in name for name in elements.attributes("id"))
    buttons = [told for tag, told in elements.found if tag == "button" and "data-kind" in told]
    values = [(told["data-kind"], told["data-value"]) for told in buttons]
    assert values == [
        *(("weight", "0"), ("weight", "4")),
        *(("planner", "any-angle"), ("planner", "grid")),
        *(("status", "solved"), ("status", "timeout")),
    ]
    assert next(told for _, told in elements.found if told.get("id") == "filters")["hidden"]


def test_the_same_data_give_the_same_file(tmp_path: Path, scene: Scene, hostile_page: str) -> None:
    assert written(tmp_path, hostile(scene)) == hostile_page


def test_without_runs_or_scenes(tmp_path: Path) -> None:
    page = written(tmp_path, ReportData([], [], {}, "grid"))
    assert "Every run was solved" in page
    assert "Nothing to draw" in page


def test_when_nothing_was_solved(tmp_path: Path, scene: Scene) -> None:
    nothing = dict.fromkeys(MEASURES, (math.nan,) * 3)
    row = summary_of("grid", math.nan) | {"measures": nothing, "solved_share": 0.0}
    runs = [run_of("grid", "timeout"), run_of("any-angle", "hung")]
    case = {(HOSTILE, HOSTILE): scene}
    page = written(tmp_path, ReportData(runs, [row], case, "any-angle"))
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page)
    assert "1 timeout, 1 hung" in page

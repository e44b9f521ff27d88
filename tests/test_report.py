"""The report: one file, nothing loaded, hostile names harmless, holes in the data shown."""

from __future__ import annotations

import base64
import dataclasses
import functools
import hashlib
import io
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion

import locplan
from locplan.comparison import MEASURES, Case, Comparison, Run, Task, _pictures as pictures
from locplan.comparison._report import Backdrop
from locplan.maps import OCCUPIED, environments
from locplan.planners import Query

HOSTILE = '<script>alert("1")</script>'
NAMES = (HOSTILE, "any-angle", "_$\\frac{", "--></style><b onload='x'>", "計画 \u202e\ud800")
ENDS = ((2.0, 3.0), (38.0, 3.0))
ABOUT = {"began": "2025-03-04T05:06:07", "machine": HOSTILE}


@pytest.fixture(scope="module")
def case() -> Iterator[Case]:
    """A case with a hostile name, whose field and front are computed once."""
    grid = environments.make("two_corridors", resolution=0.1)
    grid = dataclasses.replace(grid, name=HOSTILE)
    config = locplan.FieldConfig(stride=4)
    field = locplan.covariance_field(grid, config)
    queries = Query(HOSTILE, *ENDS), Query("second", *ENDS)
    front = functools.cache(lambda *_, **__: locplan.pareto_front(costs, *ENDS))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("locplan.comparison._pictures.pareto_front", front)
        made = Case(HOSTILE, HOSTILE, grid, 0.25, config, "e", None, queries, lambda *_: field)
        costs, _ = made.costmap()
        yield made


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


def hostile(case: Case) -> Comparison:
    runs = [run_of(name) for name in NAMES] + [run_of(name, "crashed", 2) for name in NAMES]
    return Comparison(tuple(runs), HOSTILE, {case.key: case}, ABOUT, command=HOSTILE)


def written(tmp_path: Path, comparison: Comparison) -> str:
    comparison.save(tmp_path, force=True)
    return (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def hostile_page(tmp_path_factory: pytest.TempPathFactory, case: Case) -> str:
    return written(tmp_path_factory.mktemp("hostile"), hostile(case))


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
        return (own[name] or "" for _, own in self.found if name in own)


def test_hostile_names_are_text(hostile_page: str) -> None:
    page = hostile_page
    elements = Elements(page)
    assert elements.open == []
    assert page.count("<script") == 1
    (script,) = re.findall("<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert "&lt;script&gt;" in page
    assert page.count("<style") - page.count('<style type="text/css">') == 1
    assert not any(name.startswith("on") for _, own in elements.found for name in own)
    assert not {"b onload", "iframe", "object"} & {tag for tag, _ in elements.found}


def test_ratios_tell_of_how_many_queries_they_are(hostile_page: str) -> None:
    assert hostile_page.count("(n = 1, ") == len(NAMES)


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
    pictures = [own for tag, own in elements.found if tag == "svg"]
    assert all(own.get("aria-label") or own.get("aria-hidden") for own in pictures)
    assert sum("aria-label" in own for own in pictures) == 5


def several(case: Case) -> Comparison:
    """Two planners on two queries at two weights, one run of which has no path."""
    runs = [
        run_of(planner, factor=factor, query=query, weight=weight)
        for query in (HOSTILE, "second")
        for weight in (0.0, 4.0)
        for planner, factor in (("any-angle", 1.0), ("grid", 1.25))
    ]
    runs[-1] = run_of("grid", "timeout", query="second")
    return Comparison(tuple(runs), "any-angle", {case.key: case}, ABOUT)


def test_every_query_is_shown_at_every_weight_with_the_j_of_each_planner(
    tmp_path: Path, case: Case
) -> None:
    elements = Elements(written(tmp_path, several(case)))
    labels = [label for label in elements.attributes("aria-label") if label.startswith("Paths of ")]
    assert labels == [
        f"Paths of {HOSTILE}, weight 0, J [m]: any-angle 40.0; grid 50.0.",
        f"Paths of {HOSTILE}, weight 4, J [m]: any-angle 40.0; grid 50.0.",
        "Paths of second, weight 0, J [m]: any-angle 40.0; grid 50.0.",
        "Paths of second, weight 4, J [m]: any-angle 40.0; grid no path.",
    ]
    images = [own for tag, own in elements.found if tag == "image" and own.get("id") == "map-0"]
    assert len(images) == 1
    assert sum(own.get("href") == "#map-0" for _, own in elements.found) == 4


def test_the_query_whose_degenerate_metres_differ_most_is_drawn_large(
    tmp_path: Path, case: Case
) -> None:
    runs = [
        dataclasses.replace(run, measures={**run.measures, "integrated_u": 9.0 - run.task.weight})
        if (run.task.query, run.task.planner) == ("second", "any-angle")
        else run
        for run in several(case).runs
    ]
    page = written(tmp_path, dataclasses.replace(several(case), runs=tuple(runs)))
    assert page.count("query second, weight 4</figcaption>") == 1


def test_pictures_beyond_the_limit_are_counted(
    tmp_path: Path, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = pictures.Limits(thumbnails=3, runs=5)
    monkeypatch.setattr("locplan.comparison._pictures.Pictures.limits", limits)
    page = written(tmp_path, several(case))
    assert page.count('aria-label="Paths of ') == 3
    assert "1 picture left out" in page
    assert "The first 5 of 8 runs are shown" in page


@pytest.mark.long
def test_the_limit_of_pictures_is_that_of_all_maps(
    tmp_path: Path, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = pictures.Limits(thumbnails=4)
    monkeypatch.setattr("locplan.comparison._pictures.Pictures.limits", limits)
    other, both = dataclasses.replace(case, map="other"), several(case)
    tasks = [dataclasses.replace(run.task, map="other") for run in both.runs]
    more = [dataclasses.replace(run, task=task) for run, task in zip(both.runs, tasks, strict=True)]
    cases = {each.key: each for each in (case, other)}
    page = written(tmp_path, Comparison((*both.runs, *more), "any-angle", cases, ABOUT))
    assert page.count('aria-label="Paths of ') == 4
    assert "4 pictures left out" in page


def test_j_of_every_query_stands_beside_the_baselines(tmp_path: Path, case: Case) -> None:
    page = written(tmp_path, several(case))
    assert 'weight 0. Medians: any-angle 1.000; grid 1.250."' in page
    assert page.count("second, 40.0 m</text>") == 2


def test_paths_lie_on_the_map_as_in_the_world(case: Case) -> None:
    _, field = case.costmap()
    backdrop, grid = Backdrop.of(field), case.grid
    data = backdrop.data.partition("base64,")[2]
    image = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("L"))
    rows, cols = np.nonzero(binary_erosion(grid.cells == OCCUPIED, np.ones((2, 2))))
    corners = np.transpose(grid.grid_to_world(rows, cols))  # of four occupied cells each
    x, y = np.floor(backdrop.pixels(corners)).astype(int).T
    assert len(x) > 50
    assert (image[y, x] < 40).mean() > 0.98
    assert (image < 40).mean() < 0.2


def test_a_path_keeps_its_vertices_and_loses_what_lies_between() -> None:
    points = [(0, 30), (10, 29.9), (20, 30), (20, 0)]
    backdrop = Backdrop(np.zeros(2), 1.0, (20, 30), "")
    assert backdrop.line(points) == "M0.0 0.0 20.0 0.0 20.0 30.0"


def test_parts_of_pictures_are_filtered_by_their_planner(tmp_path: Path, case: Case) -> None:
    elements = Elements(written(tmp_path, several(case)))
    parts = [
        own["data-planner"] for tag, own in elements.found if tag == "g" and "data-planner" in own
    ]
    assert {"any-angle", "grid"} == set(parts)
    assert not any("planner-" in name for name in elements.attributes("id"))
    buttons = [own for tag, own in elements.found if tag == "button" and "data-kind" in own]
    values = [(own["data-kind"], own["data-value"]) for own in buttons]
    assert values == [
        *(("weight", "0"), ("weight", "4")),
        *(("planner", "any-angle"), ("planner", "grid")),
        *(("status", "solved"), ("status", "timeout")),
    ]
    assert next(own for _, own in elements.found if own.get("id") == "filters")["hidden"]


def test_the_same_data_give_the_same_file(tmp_path: Path, case: Case, hostile_page: str) -> None:
    assert written(tmp_path, hostile(case)) == hostile_page


def test_without_failures_or_scenes(tmp_path: Path) -> None:
    runs = [run_of("grid", query=str(n)) for n in range(3)]
    without = [dataclasses.replace(run, history=()) for run in runs]
    page = written(tmp_path, Comparison(tuple(without), "grid", {}, ABOUT))
    assert "Every run was solved" in page
    assert "Nothing to draw" in page


def test_when_nothing_was_solved(tmp_path: Path, case: Case) -> None:
    runs = run_of("grid", "timeout"), run_of("any-angle", "hung")
    page = written(tmp_path, Comparison(runs, "any-angle", {case.key: case}, ABOUT))
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page)
    assert "1 timeout, 1 hung" in page

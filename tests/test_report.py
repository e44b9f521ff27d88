"""Tests of the report: one file, nothing loaded, hostile names harmless, holes in the data told."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

import locplan
from locplan.comparison._runs import MEASURES, Run, Task
from locplan.comparison.report import ReportData, Row, Scene, write_report
from locplan.comparison.report._html import SCRIPT
from locplan.maps import environments

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
    return Scene(costs, field, {HOSTILE: ENDS}, locplan.pareto_front(costs, *ENDS), HOSTILE)


def run_of(planner: str, status: str = "solved", seed: int = 1, factor: float = 1.0) -> Run:
    task = Task(HOSTILE, HOSTILE, HOSTILE, 4.0, planner, seed)
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


def test_hostile_names_are_text(tmp_path: Path, scene: Scene) -> None:
    page = written(tmp_path, hostile(scene))
    elements = Elements(page)
    assert elements.open == []
    assert page.count("<script") == 1
    assert f"<script>{SCRIPT}</script>" in page
    assert "&lt;script&gt;" in page
    assert page.count("<style") - page.count('<style type="text/css">') == 1
    assert not any(name.startswith("on") for _, told in elements.found for name in told)
    assert not {"b onload", "iframe", "object"} & {tag for tag, _ in elements.found}


def test_nothing_is_loaded(tmp_path: Path, scene: Scene) -> None:
    elements = Elements(written(tmp_path, hostile(scene)))
    links = [*elements.attributes("src"), *elements.attributes("href")]
    links += elements.attributes("xlink:href")
    assert links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert not {"link", "img", "iframe"} & {tag for tag, _ in elements.found}


def test_identifiers_are_unique_and_pictures_have_texts(tmp_path: Path, scene: Scene) -> None:
    page = written(tmp_path, hostile(scene))
    elements = Elements(page)
    identifiers = list(elements.attributes("id"))
    assert len(identifiers) == len(set(identifiers))
    assert set(re.findall(r"url\(#([^)]*)\)", page)) <= set(identifiers)
    pictures = [told for tag, told in elements.found if tag == "svg"]
    assert all(told.get("aria-label") or told.get("aria-hidden") for told in pictures)
    assert sum("aria-label" in told for told in pictures) == 3


def test_the_same_data_give_the_same_file(tmp_path: Path, scene: Scene) -> None:
    assert written(tmp_path, hostile(scene)) == written(tmp_path, hostile(scene))


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

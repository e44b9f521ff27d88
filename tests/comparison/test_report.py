"""The report: one file, nothing loaded, hostile names harmless, holes in the data shown."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import locplan
from locplan.comparison.result import Comparison, MapCase
from locplan.comparison.statistics import MEASURES, PlannerRun, RunTask
from locplan.maps import environments
from locplan.planning import Query

HOSTILE = '<script>alert("1")</script>'
NAMES = (HOSTILE, "any-angle", "_$\\frac{", "--></style><b onload='x'>", "計画 \u202e\ud800")
ENDS = ((2.0, 3.0), (38.0, 3.0))
ABOUT = {"began": "2025-03-04T05:06:07", "machine": HOSTILE}


@pytest.fixture(scope="module")
def case() -> MapCase:
    """A case with a hostile name, whose field is computed once."""
    grid = environments.make("two_corridors", resolution=0.1)
    grid = dataclasses.replace(grid, name=HOSTILE)
    config = locplan.FieldConfig(stride=4)
    field = locplan.covariance_field(grid, config)
    queries = Query(HOSTILE, *ENDS), Query("second", *ENDS)
    return MapCase(
        HOSTILE,
        HOSTILE,
        grid,
        robot_radius=0.25,
        settings=config,
        criterion="e",
        queries=queries,
        load_field=lambda *_: field,
    )


def run_of(
    planner: str,
    status: str = "solved",
    seed: int = 1,
    factor: float = 1.0,
    *,
    query: str = HOSTILE,
    weight: float = 4.0,
) -> PlannerRun:
    task = RunTask(HOSTILE, HOSTILE, query, weight, planner, seed)
    if status != "solved":
        return PlannerRun(task, status, 1.0, 1.0, note=HOSTILE)
    measures = dict.fromkeys(MEASURES, 40.0 * factor)
    history = ((0.01, 80.0 * factor), (0.5, 40.0 * factor))
    return PlannerRun(task, status, 1.0, 1.1, measures, history, ENDS)


def hostile(case: MapCase) -> Comparison:
    runs = [run_of(name) for name in NAMES] + [run_of(name, "crashed", 2) for name in NAMES]
    return Comparison(tuple(runs), HOSTILE, {case.key: case}, ABOUT, command=HOSTILE)


def written(tmp_path: Path, comparison: Comparison) -> str:
    comparison.save(tmp_path, force=True)
    return (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def hostile_page(tmp_path_factory: pytest.TempPathFactory, case: MapCase) -> str:
    return written(tmp_path_factory.mktemp("hostile"), hostile(case))


class Elements(HTMLParser):
    """The tags of a page in order, with their attributes, and whether they nest."""

    VOID = ("meta", "wbr", "img")

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


@pytest.mark.usefixtures("undrawn")
def test_hostile_names_are_text(hostile_page: str) -> None:
    page = hostile_page
    elements = Elements(page)
    assert elements.open == []
    assert page.count("<script") == 1
    (script,) = re.findall("<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert "&lt;script&gt;" in page
    assert page.count("<style") == 1
    assert not any(name.startswith("on") for _, own in elements.found for name in own)
    assert not {"b onload", "iframe", "object"} & {tag for tag, _ in elements.found}


def test_page_loads_no_external_file(hostile_page: str) -> None:
    elements = Elements(hostile_page)
    links = [*elements.attributes("src"), *elements.attributes("href")]
    assert len(links) == 2
    assert all(link.startswith("data:image/png;base64,") for link in links)
    assert not {"link", "iframe"} & {tag for tag, _ in elements.found}


def several(case: MapCase, factor: float = 1.25) -> Comparison:
    """Two planners on six queries at two weights, one run of which has no path."""
    names = [HOSTILE, "second", "a", "b", "c", "d"]
    queries = tuple(Query(name, *ENDS) for name in names)
    runs = [
        run_of(planner, factor=other, query=query, weight=weight)
        for query in names
        for weight in (0.0, 4.0)
        for planner, other in (("any-angle", 1.0), ("grid", factor + 0.01 * names.index(query)))
    ]
    runs[3] = run_of("grid", "timeout", query=HOSTILE)
    case = dataclasses.replace(case, queries=queries)
    return Comparison(tuple(runs), "any-angle", {case.key: case}, ABOUT)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("factor", "title", "sentence"),
    [
        (1.25, "No planner beats any-angle", "% costlier than any-angle"),
        (0.8, "grid beats any-angle", "% cheaper than any-angle"),
        (0.97, "No planner beats any-angle", "no significant difference from any-angle"),
    ],
)
def test_report_begins_with_answer(
    tmp_path: Path, case: MapCase, factor: float, title: str, sentence: str
) -> None:
    page = written(tmp_path, several(case, factor))
    assert re.findall("<h2>(.*?)</h2>", page)[0] == title
    assert sentence in page
    verdicts = re.findall('<td class="number (cheaper|costlier)"', page)
    assert verdicts == [word for word in ("cheaper", "costlier") if word in sentence] * 2
    assert "solves 83%" in page


@pytest.mark.usefixtures("undrawn")
def test_few_queries_give_no_verdict(tmp_path: Path, case: MapCase) -> None:
    whole = several(case)
    runs = [run for run in whole.runs if run.task.query in ("a", "b")]
    page = written(tmp_path, dataclasses.replace(whole, runs=tuple(runs)))
    assert re.findall("<h2>(.*?)</h2>", page)[0] == "Too few queries for a verdict"
    assert not re.search('class="number (cheaper|costlier)"', page)


def test_pictures_have_texts(tmp_path: Path, case: MapCase) -> None:
    texts = list(Elements(written(tmp_path, several(case))).attributes("alt"))
    assert texts[0].startswith("Ratio of J to that of any-angle: ")
    # The planners differ most at query d; of equal weights the greatest is drawn.
    title = f"Paths of d on {HOSTILE}, {HOSTILE}, weight 4, with J: "
    assert texts[1] == f"{title}any-angle 40.0 m; grid 52.0 m."


def test_report_file_is_deterministic(tmp_path: Path, case: MapCase, hostile_page: str) -> None:
    assert written(tmp_path, hostile(case)) == hostile_page


def test_without_failures_or_scenes(tmp_path: Path) -> None:
    runs = [run_of("grid", query=str(n)) for n in range(3)]
    page = written(tmp_path, Comparison(tuple(runs), "grid", {}, ABOUT))
    assert "Runs without a path" not in page
    assert "Only grid was run" in page


def test_failures_are_counted_with_their_reason(tmp_path: Path, case: MapCase) -> None:
    runs = run_of("grid", "timeout"), run_of("grid", "timeout", 2), run_of("any-angle", "hung")
    page = written(tmp_path, Comparison(runs, "any-angle", {case.key: case}, ABOUT))
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page)
    reasons = re.findall("<li>(.*? on .*?)</li>", page)
    assert [re.sub("&lt;.*?&#34;\\)&lt;/script&gt;", "X", each) for each in reasons] == [
        "grid on X: 2 timeout – X",
        "any-angle on X: 1 hung – X",
    ]


LENGTHS = {"any-angle": 9.0, "grid": 10.0, "BITstar": 100.0}


def run_at_weight(planner: str, weight: float, query: str) -> PlannerRun:
    task = RunTask("office", "sad, 6 m", query, weight, planner, 0)
    if planner == "BITstar" and (weight == 0 or query == "second"):
        return PlannerRun(task, "timeout", 1.0, 1.0, note="no path")
    return PlannerRun(task, "solved", 1.0, 1.0, dict.fromkeys(MEASURES, LENGTHS[planner]))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    weights = 0.0, 4.0
    runs = [
        run_at_weight(planner, weight, query)
        for weight in weights
        for query in ("first", "second")
        for planner in LENGTHS
    ]
    folder = tmp_path_factory.mktemp("report")
    about = {"began": "2025-03-04T05:06:07"}
    Comparison(tuple(runs), "any-angle", {}, about).save(folder)
    return folder / "report.html"


@pytest.fixture
def page(browser: Any, report: Path) -> Iterator[Any]:
    opened = browser.new_page(viewport={"width": 1200, "height": 800})
    faults: list[str] = []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("request", lambda request: faults.append(request.url))
    opened.goto(report.as_uri())
    yield opened
    assert faults == [report.as_uri()]  # the page itself, and nothing that it loads
    opened.close()


def column(page: Any, title: str) -> list[str]:
    """The texts of a column of the table, from the top."""
    heads = page.locator("thead th").all_inner_texts()
    (n,) = (n for n, head in enumerate(heads) if head.split("\u00a0")[0].strip() == title)
    rows = page.locator("tbody tr").all()
    return [row.locator("th, td").nth(n).inner_text() for row in rows]


def test_table_head_sorts_rows(page: Any) -> None:
    """Click and Enter sort; unknown values come last."""
    head = page.locator("thead th").nth(2)
    assert column(page, "planner") == [*LENGTHS] * 2
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    ratios = ["1.000", "1.000", "1.111", "1.111", "11.111", "–"]
    assert column(page, "J / baseline's J") == ratios
    head.locator("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert column(page, "J / baseline's J") == [*ratios[-2::-1], "–"]
    page.locator("thead button").nth(1).click()
    assert head.get_attribute("aria-sort") is None
    assert column(page, "planner") == sorted([*LENGTHS] * 2, key=str.lower)


def test_numbers_are_sorted_as_numbers(page: Any) -> None:
    page.locator("thead button", has_text="length").click()
    assert column(page, "length [m]")[2:5] == ["10.00", "10.00", "100.0"]


@pytest.mark.parametrize("width", [1200, 400])
def test_page_fits_screen_width(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_page_shows_table_without_script(browser: Any, report: Path) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(report.as_uri())
    assert page.locator("tbody tr").count() == 6
    page.close()

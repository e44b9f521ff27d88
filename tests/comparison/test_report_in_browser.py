"""The report in a browser: a click on a head sorts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from locplan.comparison.result import Comparison
from locplan.comparison.statistics import MEASURES, Run, Task

LENGTHS = {"any-angle": 9.0, "grid": 10.0, "BITstar": 100.0}


def run_of(planner: str, weight: float, query: str) -> Run:
    task = Task("office", "sad, 6 m", query, weight, planner, 0)
    if planner == "BITstar" and (weight == 0 or query == "second"):
        return Run(task, "timeout", 1.0, 1.0, note="no path")
    return Run(task, "solved", 1.0, 1.0, dict.fromkeys(MEASURES, LENGTHS[planner]))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    weights = 0.0, 4.0
    runs = [
        run_of(planner, weight, query)
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


def test_a_head_sorts_by_click_and_by_key_with_unknown_values_last(page: Any) -> None:
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
def test_the_page_is_no_wider_than_the_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_without_a_script_all_is_there(browser: Any, report: Path) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(report.as_uri())
    assert page.locator("tbody tr").count() == 6
    page.close()

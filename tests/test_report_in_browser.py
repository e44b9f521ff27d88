"""The report in a browser: a click on a head sorts, a click on a filter leaves what it names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from locplan.comparison import MEASURES, Comparison, Run, Task

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


def planners(page: Any, table: int = 0) -> list[str]:
    """The planners in a table of the results, from the top."""
    return page.locator("details table").nth(table).locator("tbody th").all_inner_texts()


def test_a_head_sorts_by_click_and_by_key_with_unknown_values_last(page: Any) -> None:
    table = page.locator("details table").first
    head = table.locator("thead th").nth(1)
    assert planners(page) == ["any-angle", "grid", "BITstar"]
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert planners(page) == ["any-angle", "grid", "BITstar"]
    head.locator("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert planners(page) == ["grid", "any-angle", "BITstar"]
    table.locator("thead button").first.click()
    assert head.get_attribute("aria-sort") is None
    assert planners(page) == ["any-angle", "BITstar", "grid"]


def test_numbers_are_sorted_as_numbers(page: Any) -> None:
    page.locator("details table").nth(1).locator("thead button").nth(3).click()
    assert planners(page, 1) == ["any-angle", "grid", "BITstar"]  # 9, 10, 100


def shown(page: Any) -> int:
    return sum(row.is_visible() for row in page.locator("#every-run tbody tr").all())


def test_filters_leave_what_they_name_and_can_be_lifted(page: Any) -> None:
    bar = page.locator("#filters")
    count = bar.locator("output")
    assert count.inner_text() == "12 of 12 runs"
    weight = bar.get_by_role("button", name="4", exact=True)
    weight.click()
    assert weight.get_attribute("aria-pressed") == "true"
    assert (shown(page), count.inner_text()) == (6, "6 of 12 runs")
    assert page.locator("details .scroll").first.is_hidden()
    assert page.locator("details .scroll").nth(1).is_visible()
    bar.get_by_role("button", name="grid").click()
    bar.get_by_role("button", name="BITstar").click()
    assert shown(page) == 4
    bar.get_by_role("button", name="timeout").press("Space")
    assert shown(page) == 1
    bar.get_by_role("button", name="show all").click()
    assert shown(page) == 12
    assert weight.get_attribute("aria-pressed") == "false"


def test_parts_of_a_picture_are_filtered(page: Any) -> None:
    parts = page.locator("figure").last.locator("g[data-planner=grid]")
    assert parts.first.is_visible()
    page.locator("#filters").get_by_role("button", name="any-angle").click()
    assert not parts.first.is_visible()


@pytest.mark.parametrize("width", [1200, 400])
def test_the_page_is_no_wider_than_the_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_without_a_script_all_is_there_and_no_filter(browser: Any, report: Path) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(report.as_uri())
    assert page.locator("#filters").is_hidden()
    assert shown(page) == 12
    page.close()

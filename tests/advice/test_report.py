"""The report of a check in a browser: whole, in the dark, on a phone, and on paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.cases import sample_cases
from support.check_cases import CORNERS, ROBOT
from support.maps import furnished_room

from locplan import check


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    check(furnished_room(), ROBOT, CORNERS, effort="quick").save(folder)
    return folder / "report.html"


@pytest.mark.parametrize(
    ("width", "scheme"),
    sample_cases(
        [(390, "light"), (1200, "dark"), (390, "dark"), (1200, "light")], 2, are_rows=True
    ),
)
def test_report_page_is_self_contained(browser: Any, report: Path, width: int, scheme: str) -> None:
    """It also fits its window, on a phone and in dark mode."""
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    asked: list[str] = []
    page.on("pageerror", lambda error: asked.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(report.as_uri())
    assert [each for each in asked if not each.startswith("data:")] == [report.as_uri()]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(
        "[...document.querySelectorAll('table')]"
        ".every(table => table.offsetWidth <= table.parentElement.clientWidth)"
    )
    assert "`" not in page.locator("body").inner_text()
    assert "Your robot gets lost" in page.locator(".verdict").inner_text()
    assert page.locator("svg polyline").count() == len(CORNERS)
    boxes = page.evaluate(
        "[...document.querySelectorAll('.label')].map(label => label.getBoundingClientRect())"
        ".map(box => [box.left, box.right, box.top, box.bottom])"
    )
    assert len(boxes) >= len(CORNERS)
    for n, (left, right, top, bottom) in enumerate(boxes):
        for to_left, to_right, to_top, to_bottom in boxes[n + 1 :]:
            assert right <= to_left or to_right <= left or bottom <= to_top or to_bottom <= top
    ink, paper = page.evaluate(
        "['color', 'backgroundColor'].map(name => getComputedStyle(document.body)[name])"
    )
    dark = [sum(map(int, each[4:-1].split(","))) < 384 for each in (ink, paper)]
    assert dark == [scheme == "light", scheme == "dark"]
    page.close()


def test_report_details_unfold_on_click(browser: Any, report: Path) -> None:
    page = browser.new_page()
    page.goto(report.as_uri())
    robot = page.get_by_text("; effort quick")
    assert not robot.is_visible()
    page.get_by_text("Map, robot and recorded drives", exact=True).click()
    assert robot.is_visible()
    page.close()


def test_report_fits_on_three_pages(browser: Any, report: Path) -> None:
    page = browser.new_page()
    page.goto(report.as_uri())
    printed = page.pdf(format="A4", prefer_css_page_size=True)
    assert 1 <= printed.count(b"/Type /Page\n") + printed.count(b"/Type/Page\n") <= 3
    page.close()
